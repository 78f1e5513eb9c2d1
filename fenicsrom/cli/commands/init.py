"""`fenicsrom init`: write a starter scene for a mesh file."""

import argparse
from pathlib import Path
from typing import Any

from fenicsrom.cli.arguments import FILE, MESH, SCALE, SIZE, Argument, command, refused
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.cli.starting import inspected
from fenicsrom.errors import ConvergenceError, ErrorKind, SceneError

UNITS = Argument(
    "--units",
    metavar="LENGTH,MASS,TIME",
    help="units of file and scene, such as mm,t,s; by default guessed from the material",
)
ROOT = Argument("--root", metavar="GROUP", help="group or number of the face to clamp")
TIP = Argument("--tip", metavar="GROUP", help="group or number of the face with load and contact")
TEMPLATE = Argument(
    "--template",
    choices=("response", "rub", "damper", "statics"),
    default="response",
    help="task of the scene: a response at the first mode (default), with a stop that it rubs "
    "against, with a friction damper, or a static load",
)


@command(
    "write a starter scene for a mesh file", MESH, SCALE, SIZE, UNITS, ROOT, TIP, TEMPLATE, FILE
)
def init(options: argparse.Namespace) -> int:
    """Write a starter scene beside a mesh file.

    Raises:
        SceneError: the mesh cannot be used, or the scene file exists.
    """
    from fenicsrom.post.base.writers import write_text
    from fenicsrom.post.studies.starter import starter_scene, units_of

    path = target(options.output or Path(options.mesh).with_suffix(".toml"))
    if path.exists():
        reason = "the file exists; remove it, or choose another one with --output"
        raise refused("--output", path, reason, ErrorKind.FILE)
    found = inspected(options)
    if found.refusal is not None:
        raise found.refusal
    warnings = list(found.warnings)
    settings = {
        "units": units_of(found, options.units),
        "root": options.root,
        "tip": options.tip,
        "template": options.template,
    }
    text = starter_scene(found, path.parent, **settings)
    mode = _first_mode(text, path, options.tip, warnings)
    if mode is not None:
        text = starter_scene(found, path.parent, **settings, mode=mode)
    write_text(path, text)
    task = {"rub": "run", "damper": "run"}.get(options.template, options.template)
    task = "modes" if mode is None else task
    print_results(None, "", warnings, [f"Now run: fenicsrom {task} {path}"], [path])
    return 0


def _first_mode(text: str, path: Path, tip: str | None, warnings: list[str]) -> Any:
    """The first mode of a starter scene without loads; None, and a warning, if it has none."""
    from fenicsrom.assess.studies.first_mode import first_mode
    from fenicsrom.scene import Place, parse_scene
    from fenicsrom.scene.base.toml import parse_toml

    try:
        scene = parse_scene(parse_toml(text), str(path), path.parent, unloaded=True)
        return first_mode(scene, None if tip is None else Place(group=tip))
    except (SceneError, ConvergenceError) as error:
        warnings.append(f"the scene has no load yet, because its modes were not found: {error}")
        return None
