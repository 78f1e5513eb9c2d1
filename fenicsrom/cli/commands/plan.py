"""`fenicsrom plan`: list the stages of a scene."""

import argparse
from pathlib import Path

from fenicsrom import study
from fenicsrom.cli.arguments import SCENE, SET, Argument, command, refused
from fenicsrom.cli.output import require_lasting
from fenicsrom.cli.printing import logged_progress, print_results
from fenicsrom.cli.starting import given_keys
from fenicsrom.errors import ErrorKind, printable
from fenicsrom.scene import read_scene

PICTURE = Argument(
    "--picture",
    metavar="FILE",
    help="draw the undeformed mesh with its supports, loads and contacts to this PNG file",
)


OWN_TABLES = ("compare", "campbell", "map", "response", "backbone", "ringdown", "statics")
"""Commands that have a table in the scene; the table has the name of the command."""


@command(
    "list the stages of a scene, and say what a run will cost and what refuses the scene",
    SCENE,
    SET,
    PICTURE,
)
def plan(options: argparse.Namespace) -> int:
    """List the stages of `run`, its cost, and the other commands for which the scene has tables.

    The parts of a stage are indented. With --picture, the set-up is drawn.

    Raises:
        SceneError: the scene or the file of the picture cannot be used, or a run would be refused.
    """
    path = None if options.picture is None else Path(options.picture)
    if path is not None:
        require_lasting(path, "--picture")
        if path.suffix.lower() != ".png":
            raise refused("--picture", path, "must end in .png", ErrorKind.FORMAT)
    scene = read_scene(options.scene, options.overrides, unloaded=options.picture is not None)
    items = study.plan(scene) if scene.cyclic is None else []
    command = "run" if scene.cyclic is None or not scene.static_only else "modes"
    print(f"fenicsrom {command} {options.scene}:")
    for item in items:
        name = item.name if isinstance(item, study.Stage) else f"  {item.name}"
        print(f"{'runs     ' if item.needed else 'left out '} {name:26} {item.reason}")
    given = {key.split(".")[0] for key in given_keys(options)}
    for table in (name for name in OWN_TABLES if name in given):
        print(f"the table [{table}] is for another command: fenicsrom {table} {options.scene}")
        if reason := study.refusal_of(table, scene):
            print(f"  which refuses the scene: {reason}")
    with logged_progress(quiet=path is None):
        solid = study.set_up(scene)
    print("\n".join(study.forecast(scene, solid)))
    if path is None:
        for text in solid.warnings:
            print(f"warning: {printable(text)}")
    else:
        from fenicsrom.post.base.picture import draw_pictures
        from fenicsrom.post.run.pictures import setup_picture

        warnings = list(solid.warnings)
        picture = setup_picture(solid, scene, path.name)
        assert picture is not None
        files = [one.path for one in draw_pictures([picture], path.parent, warnings)]
        print_results(None, "", warnings, files=files)
    return 0
