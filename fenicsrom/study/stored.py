"""A run of a stored model: no mesh and no dolfinx."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.notes import Note, NoteKind
from fenicsrom.scene import Scene
from fenicsrom.study import writing
from fenicsrom.study.execution import build_model, execute, run, run_disk
from fenicsrom.study.given import starts_from
from fenicsrom.study.motions import checked, integrated
from fenicsrom.study.stage import Run, Stage
from fenicsrom.study.stopwatch import Stopwatch

if TYPE_CHECKING:
    from fenicsrom.assess.rotation.disk_run import DiskRun
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.records import Rerun, Study


@starts_from("StoredModel", "StoredDisk", sectors=True)
def integrate(
    given: Scene | StoredModel | StoredDisk,
    comm: Any = None,
    *,
    folder: Path,
    resume: Path | None = None,
    fresh: bool = False,
    keys: Collection[str] = (),
) -> Study | DiskRun | Rerun:
    """Run a scene or a stored model; of a range of speeds, its model runs at that of the scene.

    Arguments and errors as `rerun` and `fenicsrom.study.execution.run`.
    """
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.post.base.origin import MODEL

    if isinstance(given, StoredDisk):
        if resume is not None:
            source = given.scene.source
            raise refuse(source, "not allowed with resume", ErrorKind.CONFLICT, "cyclic")
        return run_disk(given, folder=folder)
    if not isinstance(given, Scene):
        return rerun(given, folder, resume=resume, given=keys)
    if given.speeds_rpm is None or given.cyclic is not None:
        return run(given, comm, folder=folder, resume=resume, fresh=fresh)
    stored = build_model(given, comm=comm, fresh=fresh)
    save_model(folder / MODEL, stored)
    found = rerun(stored, folder, resume=resume)
    found.files.append(folder / MODEL)
    return found


def rerun(
    stored: StoredModel,
    folder: Path,
    *,
    resume: Path | None = None,
    given: Collection[str] = (),
) -> Rerun:
    """Integrate a stored model, check the motion and write the files: the numbers first.

    Args:
        stored: the stored model, under the scene of the run.
        folder: folder of the output files.
        resume: checkpoint from which the model continues.
        given: keys that the user gave, for the warning of keys without effect.

    Raises:
        SceneError: the checkpoint cannot be used.
        ConvergenceError, AccuracyError: the integration failed at its start.
        KeyboardInterrupt: the work was asked to stop.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.errors.comparisons import MeshCheck
    from fenicsrom.assess.errors.plausibility import equilibrium_warnings, implausible_loads
    from fenicsrom.online.store.store import keeper, load_start
    from fenicsrom.post.run.report import range_warnings, rerun_left_out, rerun_warnings
    from fenicsrom.post.run.summary import CHECKPOINT
    from fenicsrom.records import Rerun
    from fenicsrom.reduction.modes import missing_modes

    watch, model, scene = Stopwatch(), stored.model, stored.scene
    begin = load_start(resume, model, scene) if resume is not None else None
    keep = keeper(folder / CHECKPOINT, model, scene)
    options: dict[str, Any] = {"resume": begin, "checkpoint": keep, "keep_coordinates": True}
    with watch("reduced motion"):
        motion, unfinished = integrated(model, scene, **options)
    warnings = [*equilibrium_warnings(stored.deformation), *rerun_warnings(scene, given)]
    warnings += range_warnings(stored)
    warnings += MeshCheck(missing=stored.unjudged).warnings(scene)
    too_few = missing_modes(scene, stored.frequencies_hz)
    warnings += [too_few] if too_few is not None else []
    warnings += implausible_loads(model, scene, stored.frequencies_hz)
    failure = None if unfinished is None else ("reduced", unfinished)
    left_out = rerun_left_out(stored, motion)
    found = Rerun(stored, motion, {}, failure, warnings, left_out=left_out)
    stages = [
        Stage("size", True, "", _fit_size),
        Stage("checks", True, "", _check),
        Stage("stresses", scene.output.stresses != "none", "", _find_stresses),
        Stage("numbers", True, "", writing.numbers, writes=True),
        Stage("pictures", scene.output.pictures, "", _draw, writes=True),
        Stage("report", True, "", writing.report, writes=True),
    ]
    needed = [stage for stage in stages if stage.needed]
    execute(Run(found, None, watch, folder), needed)
    return found


def _check(run: Run) -> None:
    """Check the motion."""
    from fenicsrom.assess.errors.comparisons import MeshCheck
    from fenicsrom.errors import ConvergenceError

    found: Rerun = run.study
    try:
        meshes = found.stored.meshes
    except ConvergenceError as error:  # of finer elements at the speed of the scene
        meshes = None
        found.warnings += MeshCheck(missing=str(error)).warnings(found.scene)
    found.unfinished = checked(found, meshes)


def _draw(run: Run) -> None:
    """Draw the pictures of the motion and the stresses."""
    from fenicsrom.post.run.pictures import write_rerun_pictures

    assert run.folder is not None
    run.study.pictures = write_rerun_pictures(run.study, run.folder)


def _fit_size(run: Run) -> None:
    """Let the model take coordinates until its basis is accurate enough; describe its motion."""
    from fenicsrom.assess.errors.sizing import fitted
    from fenicsrom.assess.rotation.run_up import run_up
    from fenicsrom.online.store.archive import SUPERELEMENT
    from fenicsrom.post.run.report import (
        UNJUDGED,
        UNJUDGED_MATRICES,
        motion_warnings,
        rerun_left_out,
    )

    found: Rerun = run.study
    chosen = fitted(found.stored, found.motion, found.warnings)
    if chosen is not None:
        found.sized, found.stored, found.motion = chosen, chosen.stored, chosen.motion
        found.left_out = rerun_left_out(found.stored, found.motion)
    found.run_up = run_up(found.stored, found.motion)
    found.warnings += motion_warnings("reduced", found.motion, found.stored.scene)
    if found.stored.candidates is None:
        superelement = found.stored.method == SUPERELEMENT
        found.warnings.append(UNJUDGED_MATRICES if superelement else UNJUDGED)


def _find_stresses(run: Run) -> None:
    """Find the largest stresses, and warn of large strains and of a model without stresses."""
    from fenicsrom.assess.errors.plausibility import state_warnings
    from fenicsrom.online.stress.reactions import find_stresses

    found: Rerun = run.study
    stored, warnings = found.stored, found.warnings
    if stored.recovery is None:
        text = (
            "the stored model has no stresses: it was made from a scene with output.stresses = "
            '"none"; run that scene again with another value'
        )
        warnings.append(Note(NoteKind.LEFT_OUT, text, "output.stresses"))
        return
    modes = stored.normal_modes
    found.stresses = find_stresses(stored.recovery, found.scene, stored.model, found.motion, modes)
    warnings += state_warnings(found.stresses, motion_only=stored.deformation is not None)
