"""`fenicsrom sweep`: run a scene or a stored model for many values of its keys."""

import argparse
from collections.abc import Sequence

from fenicsrom import study
from fenicsrom.cli.arguments import (
    FROM_MODEL,
    RESUME_FOLDER,
    SCENE_OR_MODEL,
    SCHEDULER,
    Argument,
    command,
)
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.cli.starting import changed_model, importing, ranks, require_scene, workers
from fenicsrom.cli.termination import is_stopped
from fenicsrom.scene import Scene, read_scene

OVER = Argument(
    "--over",
    action="append",
    default=[],
    metavar="KEY=VALUES",
    help="values of a key of the scene: a list such as loads.0.force=[50, 100], or a range "
    "FIRST:LAST:COUNT, with :log in equal ratios; all combinations run; may be repeated",
)
ZIP = Argument(
    "--zip",
    action="append",
    default=[],
    metavar="KEY=VALUES",
    dest="together",
    help="as --over, but all keys of --zip change together; may be repeated",
)


@command(
    "run a scene or a stored model for lists or ranges of values of its keys",
    SCENE_OR_MODEL,
    OVER,
    ZIP,
    RESUME_FOLDER,
    SCHEDULER,
    *FROM_MODEL,
)
def sweep(options: argparse.Namespace) -> int:
    """Run a scene or a stored model for lists or ranges of values of its keys.

    Returns:
        0, or 1 if a run has no motion.

    Raises:
        KeyboardInterrupt: the sweep was interrupted.
    """
    from fenicsrom.scene.reading.overrides import make_axes

    axes = make_axes(options.over, options.together)
    comm = ranks()
    with importing():
        from fenicsrom.assess.studies.sweep_runs import FAILED
        from fenicsrom.online.store import archive

    if options.stored:
        model = archive.load_model(options.stored)
        scene = changed_model(options, model).scene
    else:
        require_scene(options)
        scene = read_scene(options.scene, options.overrides)

    def variant(overrides: Sequence[str]) -> Scene:
        if options.scene is not None:
            return read_scene(options.scene, [*options.overrides, *overrides])
        return archive.changed_scene(model.scene, [*options.overrides, *overrides], model.file)

    with workers(options) as computing, opened(options, scene, comm) as folder:
        found = study.run_sweep(
            scene,
            variant,
            axes,
            folder,
            stored=options.stored,
            comm=comm,
            workers=computing,
            resume=options.resume,
            stop=is_stopped,
            fresh=options.fresh,
        )
        finish(found, comm)
    return 1 if found.with_outcome(FAILED) else 0
