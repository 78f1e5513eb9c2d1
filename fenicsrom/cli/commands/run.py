"""`fenicsrom run`: run a scene, or integrate a stored model again."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom import study
from fenicsrom.cli.arguments import FROM_MODEL, SCENE_OR_MODEL, Argument, command
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.cli.starting import changed_model, given_keys, importing, require_scene, start
from fenicsrom.cli.termination import is_stopped

if TYPE_CHECKING:
    from fenicsrom.scene import Scene

RESUME = Argument(
    "--resume",
    metavar="CHECKPOINT",
    type=Path,
    help="continue the reduced model from the checkpoint.npz of an earlier run",
)


@command(
    "run a scene, or integrate a stored reduced model again", SCENE_OR_MODEL, RESUME, *FROM_MODEL
)
def run(options: argparse.Namespace) -> int:
    """Run a scene or a stored model."""
    if options.stored:
        return _from_model(options)
    require_scene(options)
    comm, scene = start(options)
    if scene.speeds_rpm is not None:
        return _of_range(options, comm, scene)
    with opened(options, scene, comm) as folder:
        settings = {"resume": options.resume, "stop": is_stopped, "fresh": options.fresh}
        found = study.run(scene, comm, folder=folder, **settings)
        return finish(found, comm)


def _from_model(options: argparse.Namespace) -> int:
    """Integrate a stored model again."""
    from dataclasses import replace

    with importing():
        from fenicsrom.online.store import archive
        from fenicsrom.online.store import store as checkpoints

    stored = archive.load_model(options.stored)
    if options.resume is not None:  # the stopped run may have used another scene than the model
        stored = replace(stored, scene=checkpoints.load_scene(options.resume))
    current = changed_model(options, stored)
    with opened(options, current.scene) as folder:
        settings = {"resume": options.resume, "stop": is_stopped, "given": given_keys(options)}
        return finish(study.rerun(current, folder, **settings), None)


def _of_range(options: argparse.Namespace, comm: Any, scene: Scene) -> int:
    """Build the model for a range of speeds, and integrate it at the speed of the scene."""
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL

    with opened(options, scene, comm) as folder:
        stored = study.build_model(scene, comm=comm)
        save_model(folder / MODEL, stored)
        found = study.rerun(stored, folder, resume=options.resume, stop=is_stopped)
        found.files.append(folder / MODEL)
        return finish(found, None)
