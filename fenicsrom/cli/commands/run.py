"""`fenicsrom run`: run a scene, or integrate a stored model again."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom import study
from fenicsrom.cli.arguments import FROM_MODEL, SCENE_OR_MODEL, Argument, Command
from fenicsrom.cli.ending import end
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import print_results
from fenicsrom.cli.starting import changed_model, given_keys, importing, require_scene, start
from fenicsrom.cli.termination import is_terminated

if TYPE_CHECKING:
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.records import Rerun, Study
    from fenicsrom.scene import Scene

RESUME = Argument(
    "--resume",
    metavar="CHECKPOINT",
    help="continue the reduced model from the checkpoint.npz of an earlier run",
)


def run(options: argparse.Namespace) -> int:
    """Run a scene or a stored model."""
    if options.stored:
        return _from_model(options)
    require_scene(options)
    comm, scene = start(options)
    if scene.speeds_rpm is not None:
        return _of_range(options, comm, scene)
    resume = Path(options.resume) if options.resume else None
    with opened(options, scene, comm) as folder:
        found = study.run(
            scene,
            comm,
            folder=folder,
            resume=resume,
            stop=is_terminated,
            fresh=options.fresh,
        )
        if comm.rank == 0:
            _show(found)
        return end(comm, found.unfinished[1] if found.unfinished else None)


def _from_model(options: argparse.Namespace) -> int:
    """Integrate a stored model again."""
    from dataclasses import replace

    with importing():
        from fenicsrom.online.store import archive, checkpoints

    stored = archive.load_model(Path(options.stored))
    resume = Path(options.resume) if options.resume else None
    if resume is not None:  # the stopped run may have used another scene than the model
        stored = replace(stored, scene=checkpoints.load_scene(resume))
    current = changed_model(options, stored)
    with opened(options, current.scene) as folder:
        return _rerun(current, folder, resume, given_keys(options))


def _of_range(options: argparse.Namespace, comm: Any, scene: Scene) -> int:
    """Build the model for a range of speeds, and integrate it at the speed of the scene."""
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL

    resume = Path(options.resume) if options.resume else None
    with opened(options, scene, comm) as folder:
        stored = study.build_model(scene, comm=comm)
        save_model(folder / MODEL, stored)
        return _rerun(stored, folder, resume, more=[folder / MODEL])


def _rerun(
    stored: StoredModel,
    folder: Path,
    resume: Path | None,
    given: Collection[str] = (),
    more: Sequence[Path] = (),
) -> int:
    """Integrate a stored model and print its results, with more written files.

    Other arguments as `fenicsrom.study.rerun`.
    """
    found = study.rerun(stored, folder, resume=resume, stop=is_terminated, given=given)
    _show(found, more)
    return end(None, found.unfinished)


def _show(found: Study | Rerun, more: Sequence[Path] = ()) -> None:
    """Print the results of a run, with more written files."""
    from fenicsrom.post.base.directions import direction_names
    from fenicsrom.post.run import motion_table, sentences

    names = direction_names(found.scene, found.points)
    table = motion_table.response_table(found.motions, found.sizes, names, found.scene)
    lines = sentences.run_sentences(found)
    print_results(found.scene, table, found.warnings, lines, [*found.files, *more])


COMMAND = Command(
    "run",
    "run a scene, or integrate a stored reduced model again",
    run,
    (SCENE_OR_MODEL, RESUME, *FROM_MODEL),
)
