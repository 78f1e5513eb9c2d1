"""The work of the stages that write files: the numbers first, the report last."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from fenicsrom.study.stage import Run

if TYPE_CHECKING:
    from fenicsrom.arrays import Array


Found = TypeVar("Found", bound=Any)


def written(found: Found, folder: Path | None, comm: Any = None) -> Found:
    """Write the report of a study on the first rank, if there is a folder; return its record.

    Raises:
        OSError: a file cannot be written.
    """
    from fenicsrom.post.reports import report

    if folder is not None and (comm is None or comm.rank == 0):
        found.files = report(found).write(folder)
    return found


def _output(run: Run) -> Path:
    """Give the folder of the output files."""
    assert run.folder is not None
    return run.folder


def numbers(run: Run) -> None:
    """Write the summary, the history and the checkpoint."""
    from fenicsrom.post.run.summary import write_numbers

    if run.first:
        run.study.files = [*write_numbers(run.study, _output(run)), *run.study.files]


def keep_motion(run: Run) -> None:
    """Write the numbers of a finished motion of an interrupted run; the checkpoint holds it all."""
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.post.run.report import unchecked_sentence
    from fenicsrom.post.run.summary import write_checkpoint, write_numbers

    study, done = run.study, run.watch.seconds
    if run.folder is None or not run.first or study.unfinished or "reduced" not in study.motions:
        return
    if "numbers" not in done:
        study.warnings.extend([] if "checks" in done else [unchecked_sentence(study.errors)])
        write_numbers(study, run.folder, whole=True)
    elif isinstance(study.model, ReducedModel):
        motion = study.motions["reduced"]
        write_checkpoint(run.folder, study.model, study.scene, motion, whole=True)


def paraview_modes(run: Run) -> None:
    """Write the shapes for ParaView."""
    from fenicsrom.post.paraview.paraview import write_shapes

    run.study.files += write_shapes(run.study, _output(run))


def paraview_motion(run: Run) -> None:
    """Write the last period of the reduced model for ParaView."""
    from fenicsrom.post.paraview.paraview import write_last_period

    if "reduced" in run.study.motions:
        run.study.files += write_last_period(run.study, _output(run))


def paraview_scene(run: Run) -> None:
    """Write the groups and the rigid surfaces, and the file that opens all ParaView files."""
    import numpy as np

    from fenicsrom.post.body.surface_mesh import write_surfaces
    from fenicsrom.post.paraview.paraview import frame_rows, write_groups, write_index

    study, folder = run.study, _output(run)
    study.files += write_groups(study.solid, folder)
    if not run.first:
        return
    motion = study.motions.get("reduced") if study.scene.output.motion else None
    times: Array = np.zeros(1)
    moved: Array | None = None
    if motion is not None:
        rows = frame_rows(motion)
        times, moved = motion.time[rows], motion.displacement[rows]
    if study.scene.contacts:
        study.files += write_surfaces(folder, study.scene, study.solid.points, times, moved)
    study.files += write_index(folder, study.files)


def pictures(run: Run) -> None:
    """Draw the motions and the shapes."""
    from fenicsrom.post.run.pictures import write_pictures

    run.study.pictures += write_pictures(run.study, _output(run))


def stress_picture(run: Run) -> None:
    """Draw the largest von Mises stress."""
    from fenicsrom.post.run.pictures import write_stress_picture

    if run.first:
        run.study.pictures += write_stress_picture(run.study, _output(run))


def animation(run: Run) -> None:
    """Animate the last period of the reduced model."""
    from fenicsrom.post.run.pictures import write_animation

    if "reduced" in run.study.motions:
        run.study.pictures += write_animation(run.study, _output(run))


def report(run: Run) -> None:
    """Write the report, and the summary again if there are new warnings about the pictures."""
    from fenicsrom.post.base.tables import write_summary
    from fenicsrom.post.run.pictures import turning_pages
    from fenicsrom.post.run.report import write_run_report
    from fenicsrom.post.run.summary import SUMMARY, summary
    from fenicsrom.records import Study

    study, folder = run.study, _output(run)
    turns = isinstance(study, Study) and study.scene.output.pictures
    pages = turning_pages(study) if turns else []
    if run.first:
        write_summary(folder / SUMMARY, summary(study))
        report = write_run_report(study, study.pictures, folder, pages)
        study.files = [report, *study.files, *(one.path for one in study.pictures)]
