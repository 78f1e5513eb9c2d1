"""`fenicsrom inspect` and `init`: describe a mesh file, and write a starter scene for it."""

import argparse
import tomllib
from pathlib import Path
from typing import Any

from fenicsrom.cli.arguments import FILE, MESH, OUTPUT, SCALE, SIZE, Argument, command, refused
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.cli.starting import inspected, positive
from fenicsrom.errors import ConvergenceError, ErrorKind, SceneError, refuse
from fenicsrom.notes import note_of

DENSITY = Argument("--density", metavar="NUMBER", help="density in kg/m³, for the mass")


@command(
    "describe a mesh file: cells, box, volume, mass, groups and what is not read",
    MESH,
    DENSITY,
    SCALE,
    SIZE,
    OUTPUT,
)
def inspect(options: argparse.Namespace) -> int:
    """Describe a mesh file.

    Raises:
        SceneError: the file cannot be read, or its mesh cannot be used.
    """
    from fenicsrom.post.base.picture import draw_pictures
    from fenicsrom.post.studies import mesh_report

    density = positive(options.density, "--density")
    found = inspected(options)
    warnings, files = [*map(note_of, found.warnings)], []
    if found.refusal is None:
        folder = target(options.output or f"out/{Path(options.mesh).stem}")
        picture = mesh_report.group_picture(found)
        files = [one.path for one in draw_pictures([picture], folder, warnings)]
        files += mesh_report.write_group_page(found, folder, warnings)
    lines = mesh_report.lines(found, density)
    print_results(None, "\n".join(lines), warnings, files=files)
    if found.refusal is not None:
        raise found.refusal
    return 0


UNITS = Argument(
    "--units",
    metavar="LENGTH,MASS,TIME",
    help="units of file and scene, such as mm,t,s; by default guessed from the material",
)
ROOT = Argument("--root", metavar="GROUP", help="group or number of the face to clamp")
TIP = Argument("--tip", metavar="GROUP", help="group or number of the face with load and contact")
TEMPLATE = Argument(
    "--template",
    choices=("response", "stop", "rub", "damper", "statics"),
    default="response",
    help="task of the scene: a response at the first mode (default), with a stop or with a "
    "friction damper; a blade that turns and rubs a casing; or a static load",
)


@command(
    "write a starter scene for a mesh file", MESH, SCALE, SIZE, UNITS, ROOT, TIP, TEMPLATE, FILE
)
def init(options: argparse.Namespace) -> int:
    """Write a starter scene beside a mesh file.

    Raises:
        SceneError: the mesh cannot be used, the scene file exists, or the scene that was written
            cannot run.
    """
    from fenicsrom.post.base.tables import write_text
    from fenicsrom.post.studies.starter import leaves_support, starter_scene, units_of

    path = target(options.output or Path(options.mesh).with_suffix(".toml"))
    if path.exists():
        reason = "the file exists; remove it, or choose another one with --output"
        raise refused("--output", path, reason, ErrorKind.FILE)
    found = inspected(options)
    if found.refusal is not None:
        raise found.refusal
    warnings = list(found.warnings)
    warnings += [f"not taken from the file: {what}" for what in found.physics.not_taken]
    if leaves_support(found) and options.root is None:
        warnings.append("the support is a guess, because that of the file is not taken: check it")
    if options.template == "rub":
        warnings.append("the axis of rotation is a guess from the box of the body: check it")
    system, why = units_of(found, options.units)
    if why and options.units is None:
        warnings.append(f"the units {system.names} are {why}")
    settings = {
        "units": (system, why),
        "root": options.root,
        "tip": options.tip,
        "template": options.template,
    }
    text = starter_scene(found, path.parent, **settings)
    write_text(path, text)  # the path of the mesh is relative to its folder, which exists now
    task = {"rub": "run", "stop": "run", "damper": "run"}.get(options.template, options.template)
    try:
        mode = _first_mode(text, path, options.tip)
        write_text(path, starter_scene(found, path.parent, **settings, mode=mode))
        _check(path, task)
    except SceneError as error:
        print_results(None, "", warnings, [], [path])
        reason = f"{error}. Change this in {path}, then run: fenicsrom plan {path} --picture a.png"
        raise SceneError(reason, kind=error.kind, key=error.key, source=error.source) from None
    steel = [] if found.physics.materials else ["The material is steel: the file has none."]
    print_results(None, "", warnings, [*steel, f"Now run: fenicsrom {task} {path}"], [path])
    return 0


def _check(path: Path, task: str) -> None:
    """Check a scene for a command, as `plan` does.

    Raises:
        SceneError: the command would refuse the scene.
    """
    from fenicsrom import study
    from fenicsrom.scene import read_scene

    scene = read_scene(path)
    study.set_up(scene)
    if reason := study.refusal_of(task, scene):
        raise SceneError(reason, kind=ErrorKind.CONFLICT, key=task, source=str(path))


def _first_mode(text: str, path: Path, tip: str | None) -> Any:
    """The first mode of a starter scene without loads.

    Raises:
        SceneError: the scene has none, or has no equilibrium under its static loads.
    """
    from fenicsrom.assess.studies.first_mode import first_mode
    from fenicsrom.scene import Place, parse_scene

    scene = parse_scene(tomllib.loads(text), str(path), path.parent, unloaded=True)
    try:
        return first_mode(scene, None if tip is None else Place(group=tip))
    except ConvergenceError as error:
        reason = f"{error}; check the static loads and the units"
        raise refuse(path, reason, ErrorKind.RANGE, "loads") from None
