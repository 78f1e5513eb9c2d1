"""A run of a stored model: no mesh and no dolfinx."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.study.stopwatch import Stopwatch, never, stop_where_asked

if TYPE_CHECKING:
    from fenicsrom.online.archive import StoredModel
    from fenicsrom.online.motion import Motion
    from fenicsrom.online.state import Checkpoint
    from fenicsrom.post.record import Rerun
    from fenicsrom.scene import Scene


def rerun(
    stored: StoredModel,
    model: Any,
    scene: Scene,
    folder: Path,
    *,
    resume: Path | None = None,
    say: Callable[[str], None] | None = None,
    stop: Callable[[], bool] = never,
) -> Rerun:
    """Integrate a stored model, check the motion and write the files: the numbers first.

    Args:
        stored: the stored model, for its provenance.
        model: the model with the parameters of the scene.
        scene: the scene.
        folder: folder of the output files.
        resume: checkpoint from which the model continues.
        say: receives the progress, one line at a time; by default nobody.
        stop: called between stages and after each period; the run ends when it returns True.

    Raises:
        SceneError: the checkpoint cannot be used.
        ConvergenceError, AccuracyError: the integration failed at its start.
        KeyboardInterrupt: `stop` returned True.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.verdicts import checked
    from fenicsrom.online.checkpoints import load_checkpoint
    from fenicsrom.post.record import Rerun
    from fenicsrom.post.sentences import motion_warnings, rerun_warnings
    from fenicsrom.reduction.mode_count import missing_modes
    from fenicsrom.scene.excitation import highest_frequency

    watch = Stopwatch(say)
    begin = load_checkpoint(resume, model, scene) if resume is not None else None
    with watch("reduced motion"):
        motion, unfinished = _integrate(model, scene, folder, begin, watch, stop)
    warnings = rerun_warnings(scene)
    errors: dict[str, float] = {}
    too_few = missing_modes(highest_frequency(scene), stored.frequencies_hz)
    warnings += [too_few] if too_few is not None else []
    if unfinished is None:
        warnings += motion_warnings("reduced", motion, scene)
        stop_where_asked(stop)
        with watch("checks"):
            errors, unfinished = checked(model, scene, motion)
    found = Rerun(motion, unfinished, errors, warnings, [])
    found.files.extend(_write(stored, scene, found, folder, watch, stop))
    return found


def _integrate(
    model: Any,
    scene: Scene,
    folder: Path,
    begin: Checkpoint | None,
    watch: Stopwatch,
    stop: Callable[[], bool],
) -> tuple[Motion, ConvergenceError | AccuracyError | None]:
    """Integrate the model from the checkpoint `begin`, or from its start, and write checkpoints.

    Returns:
        The motion, up to the failure if there was one, and the failure.
    """
    from fenicsrom.online.checkpoints import keeper
    from fenicsrom.online.simulate import simulate
    from fenicsrom.post.summary import CHECKPOINT

    try:
        motion = simulate(
            model,
            scene,
            resume=begin,
            checkpoint=keeper(folder / CHECKPOINT, model, scene),
            progress=watch.progress("reduced", scene.time.steady_tolerance),
            stop=stop,
        )
    except (AccuracyError, ConvergenceError) as error:
        if error.partial is None:
            raise
        return error.partial, error
    return motion, None


def _write(
    stored: StoredModel,
    scene: Scene,
    found: Rerun,
    folder: Path,
    watch: Stopwatch,
    stop: Callable[[], bool],
) -> list[Path]:
    """Write the numbers, the pictures and the report; give the written files.

    A picture that cannot be drawn adds a warning.
    """
    from fenicsrom.post.pictures import draw_pictures, motion_pictures
    from fenicsrom.post.report import write_rerun_report
    from fenicsrom.post.summary import write_rerun_numbers

    stop_where_asked(stop)
    with watch("numbers"):
        files = write_rerun_numbers(stored, scene, found, folder)
    stop_where_asked(stop)
    pictures = motion_pictures({"reduced": found.motion}) if scene.output.pictures else []
    with watch("pictures"):
        written = draw_pictures(pictures, folder, found.warnings)
    report = write_rerun_report(stored, scene, found, written, folder)
    return [report, *files, *(path for _, path in written)]
