"""A run of a stored model: no mesh and no dolfinx."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.motions import checked, integrated
from fenicsrom.study.stopwatch import Stopwatch, never, stop_where_asked

if TYPE_CHECKING:
    from fenicsrom.online.motion.motion import Motion
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.stress.stress_peaks import Stresses
    from fenicsrom.post.base.picture import Drawn
    from fenicsrom.records import Rerun


def rerun(
    stored: StoredModel,
    folder: Path,
    *,
    resume: Path | None = None,
    stop: Callable[[], bool] = never,
    given: Collection[str] = (),
) -> Rerun:
    """Integrate a stored model, check the motion and write the files: the numbers first.

    Args:
        stored: the stored model, under the scene of the run.
        folder: folder of the output files.
        resume: checkpoint from which the model continues.
        stop: called between stages and after each period; the run ends when it returns True.
        given: keys that the user gave, for the warning of keys without effect.

    Raises:
        SceneError: the checkpoint cannot be used.
        ConvergenceError, AccuracyError: the integration failed at its start.
        KeyboardInterrupt: `stop` returned True.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.errors.large_strains import equilibrium_warnings
    from fenicsrom.assess.errors.mesh_check import of_range
    from fenicsrom.assess.errors.plausibility import implausible_loads
    from fenicsrom.online.store.checkpoints import keeper, load_start
    from fenicsrom.post.run.sentences import range_warnings, rerun_left_out, rerun_warnings
    from fenicsrom.post.run.summary import CHECKPOINT
    from fenicsrom.records import Rerun
    from fenicsrom.reduction.modes import missing_modes

    watch, model, scene = Stopwatch(), stored.model, stored.scene
    begin = load_start(resume, model, scene) if resume is not None else None
    keep = keeper(folder / CHECKPOINT, model, scene)
    options: dict[str, Any] = {"resume": begin, "checkpoint": keep, "keep_coordinates": True}
    with watch("reduced motion"):
        motion, unfinished = integrated(watch, "reduced", model, scene, stop=stop, **options)
    if motion is None:
        assert unfinished is not None
        raise unfinished
    warnings = [*equilibrium_warnings(stored.deformation), *rerun_warnings(scene, given)]
    warnings += range_warnings(stored)
    warnings += [] if stored.whole is None else of_range(stored.whole).warnings(scene)
    too_few = missing_modes(scene, stored.frequencies_hz)
    warnings += [too_few] if too_few is not None else []
    warnings += implausible_loads(model, scene, stored.frequencies_hz)
    left_out = rerun_left_out(stored, motion)
    found = Rerun(stored, motion, {}, unfinished, warnings, left_out=left_out)
    if unfinished is None:
        _judge(found, folder, watch, stop)
    _write(found, folder, watch, stop)
    return found


def _judge(found: Rerun, folder: Path, watch: Stopwatch, stop: Callable[[], bool]) -> None:
    """Check a motion and find its stresses; an interrupt keeps its numbers.

    Raises:
        KeyboardInterrupt: `stop` returned True, or the run was interrupted.
    """
    from fenicsrom.post.run.sentences import unchecked_sentence
    from fenicsrom.post.run.summary import write_numbers

    try:
        stop_where_asked(stop)
        with watch("size"):
            _fit_size(found, stop)
        stop_where_asked(stop)
        with watch("checks"):
            rejected = checked(found, found.stored.meshes)
            found.unfinished = None if rejected is None else rejected[1]
        if found.unfinished is None:
            found.stresses = _stresses(found.stored, found.motion, found.warnings, watch)
    except KeyboardInterrupt:
        if "checks" not in watch.seconds:
            found.warnings.append(unchecked_sentence(found.errors))
        write_numbers(found, folder, whole=True)
        raise


def _fit_size(found: Rerun, stop: Callable[[], bool]) -> None:
    """Let the model take coordinates until its basis is accurate enough; describe its motion."""
    from fenicsrom.assess.errors.sizing import fitted
    from fenicsrom.assess.rotation.run_up import run_up
    from fenicsrom.online.store.archive import SUPERELEMENT
    from fenicsrom.post.run.sentences import (
        UNJUDGED,
        UNJUDGED_MATRICES,
        motion_warnings,
        rerun_left_out,
    )

    chosen = fitted(found.stored, found.motion, stop, found.warnings)
    if chosen is not None:
        found.sized, found.stored, found.motion = chosen, chosen.stored, chosen.motion
        found.left_out = rerun_left_out(found.stored, found.motion)
    found.run_up = run_up(found.stored, found.motion)
    found.warnings += motion_warnings("reduced", found.motion, found.stored.scene)
    if found.stored.candidates is None:
        superelement = found.stored.method == SUPERELEMENT
        found.warnings.append(UNJUDGED_MATRICES if superelement else UNJUDGED)


def _stresses(
    stored: StoredModel, motion: Motion, warnings: list[str], watch: Stopwatch
) -> Stresses | None:
    """Find the stresses if the scene asks for stresses; warn if the model has no stresses."""
    from fenicsrom.assess.errors.large_strains import state_warnings
    from fenicsrom.online.stress.stress_peaks import find_stresses

    scene = stored.scene
    if scene.output.stresses == "none":
        return None
    if stored.recovery is None:
        warnings.append(
            "the stored model has no stresses: it was made from a scene with output.stresses = "
            '"none"; run that scene again with another value'
        )
        return None
    with watch("stresses"):
        found = find_stresses(
            stored.recovery, scene, stored.model, motion, stored.frequencies_hz.size
        )
    warnings += state_warnings(found, motion_only=stored.deformation is not None)
    return found


def _write(found: Rerun, folder: Path, watch: Stopwatch, stop: Callable[[], bool]) -> None:
    """Write the numbers, the pictures and the report, and note the files, the report first.

    A picture that cannot be drawn adds a warning. An interrupt before the report keeps the whole
    motion in the checkpoint.

    Raises:
        KeyboardInterrupt: `stop` returned True, or the run was interrupted.
    """
    from fenicsrom.post.run.pictures import write_rerun_pictures
    from fenicsrom.post.run.report import write_run_report
    from fenicsrom.post.run.summary import write_checkpoint, write_numbers

    stored = found.stored
    stop_where_asked(stop)
    with watch("numbers"):
        files = write_numbers(found, folder)
    written: list[Drawn] = []
    try:
        stop_where_asked(stop)
        if stored.scene.output.pictures:
            with watch("pictures"):
                written = write_rerun_pictures(found, folder)
        report = write_run_report(found, written, folder)
    except KeyboardInterrupt:
        write_checkpoint(folder, stored.model, stored.scene, found.motion, whole=True)
        raise
    found.files += [report, *files, *(one.path for one in written)]
