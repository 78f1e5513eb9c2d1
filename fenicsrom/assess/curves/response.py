"""Response curves: the periodic motions of a reduced model over a parameter of its scene.

Each value of the second number gives one curve, computed in this process or in another
(`fenicsrom.assess.curves.pieces`) and kept in a file of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.curves.balance_walk import BalanceWalk, balanced_motion
from fenicsrom.assess.curves.checks import contradictions, inaccuracies, unknown_errors
from fenicsrom.assess.curves.peaks import incomplete_peaks, peak_range
from fenicsrom.assess.curves.pieces import CurveProgress, CurveWalk
from fenicsrom.assess.curves.response_problem import check_response, family_of
from fenicsrom.assess.curves.results import (
    CurveFile,
    KeptCurve,
    Optimum,
    Reduced,
    Response,
    ResponseCurve,
    curve_file,
    curve_title,
    forget,
    is_wide,
    joined_notes,
    response_table,
)
from fenicsrom.assess.curves.stability_search import resolved_events
from fenicsrom.assess.curves.trust import Check, RicherModel
from fenicsrom.assess.errors.shortening import shortening_notes
from fenicsrom.assess.jobs import Workers, run_jobs
from fenicsrom.errors import AccuracyError, ConvergenceError, job_error
from fenicsrom.notes import AMPLITUDES, EVENTS, PEAKS, STABILITY, Note, NoteKind
from fenicsrom.online.curves.continuation import ForcedPeak
from fenicsrom.online.curves.curve import LOST, OUT_OF_POINTS, REPEATS, CurvePoint, Extremes, Piece
from fenicsrom.online.curves.nonlinear_mode import linear_modes
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, recorded_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import working_time
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.curve_checks import uses_balance
from fenicsrom.scene.keys.loads import OrderFrequency
from fenicsrom.scene.reading.overrides import in_words
from fenicsrom.words import counted

CLASSES = {
    kind.__name__: kind
    for kind in (ResponseCurve, Piece, CurvePoint, Extremes, Check, ForcedPeak, Optimum)
}
"""The dataclasses of which a kept curve consists."""


@dataclass(frozen=True)
class _Job:
    """One curve to compute, in this process or in another.

    Attributes:
        stored: the model under the scene of all curves.
        value: value of the second number; None without families.
        state: the file that keeps the curve; None keeps nothing.
        kept: the part of the curve that an earlier run kept, or None.
        richer: a model with a richer basis to compare with, or None.
    """

    stored: Reduced
    value: float | None
    state: CurveFile | None
    kept: KeptCurve | None
    richer: RicherModel | None


def response(
    stored: Reduced,
    *,
    state: Path | None = None,
    resume: Path | None = None,
    workers: Workers = 1,
    richer: RicherModel | None = None,
    comm: Any = None,
) -> Response:
    """Compute the response curves of a reduced model under its scene.

    Args:
        stored: the model; its scene has a table [response].
        state: folder of the files that keep what is done of each curve; None keeps nothing.
        resume: such a folder of an earlier run, from which the curves continue.
        workers: largest number of processes that compute curves at the same time, or an executor.
            With processes, the calling script must be importable: put its code under
            `if __name__ == "__main__"`.
        richer: a model with a richer basis to compare with at selected points.
        comm: MPI communicator; several ranks share the curves, and all get all curves.

    Returns:
        The curves. After an interrupt they end where they were, and `interrupted` is set; if a
        curve was not found, the others are there and `unfinished` holds the error.

    Raises:
        SceneError: as `check_response`; or `resume` does not belong to the model and the scene.
        OSError: a file of `state` cannot be written.
    """
    begin = working_time()
    scene = stored.scene
    check_response(scene)
    found = Response(scene, stored.size, stored.model.points)
    if scene.time.tolerance is not None and not uses_balance(scene):
        text = (
            f"The curves use {FALLBACK_STEPS} steps per period: a periodic motion needs a fixed "
            "step, and the scene asks for an adaptive one."
        )
        found.warnings.append(Note(NoteKind.REMARK, text, "time.tolerance"))
    jobs = _jobs(stored, state, resume, richer)
    if state is not None and (resume is None or resume.resolve() != state.resolve()):
        forget(state)
    outcomes = _outcomes(found, jobs, workers, comm)
    for outcome in outcomes:
        error = outcome.error or _incomplete(scene, outcome.curve)
        if error is not None:
            title = curve_title(scene, outcome.curve.value)
            found.warnings.append(Note(NoteKind.FAILED, str(error), curve=title))
            found.unfinished = found.unfinished or error
    found.curves = [outcome.curve for outcome in outcomes if outcome.curve.points]
    _leave_out_unresolved(found)
    _warn_of_wide(found)
    if isinstance(stored, StoredModel):  # the modes of a disk are those of its waves
        found.warnings += _light_modes(stored)
    found.warnings += _one_speed(scene)
    _warn_of_errors(found)
    if isinstance(stored, StoredModel):
        _warn_of_shortening(found, stored)
    _warn_of_peaks(found, stored)
    found.warnings = joined_notes(found)
    found.seconds = working_time() - begin
    return found


def _jobs(
    stored: Reduced, state: Path | None, resume: Path | None, richer: RicherModel | None
) -> list[_Job]:
    """The curves to compute; arguments and errors as `response`."""
    families = response_table(stored.scene).families
    values: Sequence[float | None] = families.values if families else (None,)
    state = None if state is None else state.resolve()  # workers may run in other folders
    return [
        _Job(
            stored,
            value,
            curve_file(state, stored, number) if state is not None else None,
            curve_file(resume, stored, number).load(CLASSES) if resume is not None else None,
            richer,
        )
        for number, value in enumerate(values, 1)
    ]


def _outcomes(found: Response, jobs: list[_Job], workers: Workers, comm: Any) -> list[_Outcome]:
    """Compute curves, as many as an interrupt allows, in order; arguments as `response`."""
    outcomes: dict[int, _Outcome] = {}
    progress = CurveProgress([curve_title(found.scene, job.value) for job in jobs])
    try:
        for number, outcome in run_jobs(_compute, jobs, progress, workers, comm):
            if isinstance(outcome, ConvergenceError | AccuracyError):
                outcome = _Outcome(ResponseCurve(jobs[number].value), outcome)
            outcomes[number] = outcome
            progress.finished(number)
            if outcome.interrupted:
                found.interrupted = True
                if workers == 1:
                    break
    except KeyboardInterrupt:
        found.interrupted = True
    for number, job in enumerate(jobs):
        if number not in outcomes and job.state is not None:  # its process gave no result
            kept = job.state.load(CLASSES)
            if kept is not None:
                outcomes[number] = _Outcome(kept.curve, interrupted=not kept.done)
    return [outcome for _, outcome in sorted(outcomes.items())]


def _leave_out_unresolved(found: Response) -> None:
    """Leave out contact events that the time steps do not resolve, and say how many."""
    for curve in found.curves:
        before = len(curve.special)
        for piece in curve.pieces:
            piece.special = resolved_events(piece, found.steps)
        if count := before - len(curve.special):
            text = (
                f"a contact point grazes its surface: {count} changes of contact were left out, "
                "because the time steps do not resolve them; increase time.steps_per_period."
            )
            title = curve_title(found.scene, curve.value)
            found.warnings.append(Note(NoteKind.ERROR, text, curve=title, quantity=EVENTS))


def _warn_of_wide(found: Response) -> None:
    """Say where special points were not located, so that more of them may lie there."""
    for curve in found.curves:
        wide = [p for p in curve.special if is_wide(found, p) and not p.denied]
        if wide:
            values = [point.parameter for point in wide]
            ends = sorted({min(values), max(values)})
            text = (
                f"{counted(len(wide), 'special point')} at "
                f"{in_words(found.scene, found.table.parameter, *ends)} could not be told apart "
                f"from others within {max(point.within for point in wide):.2g}: the motions "
                "between were not found, or there are too many; more time.steps_per_period may help"
            )
            title = curve_title(found.scene, curve.value)
            found.warnings.append(Note(NoteKind.ERROR, text, curve=title, quantity=EVENTS))


def _light_modes(stored: StoredModel) -> list[Note]:
    """A sentence on hardly damped higher modes that a harmonic of the loads excites."""
    scene = stored.scene
    table, frequency = response_table(scene), 1.0 / float(scene.period or np.inf)
    low, high = (table.low, table.high) if table.parameter == "frequency" else (frequency,) * 2
    problem = Problem.of(stored.model, scene).settled()
    if table.parameter == "rotation.speed_rpm":
        family = family_of(stored)
        problem = family(table.high)
        low, high = 1.0 / family(table.low).period, 1.0 / problem.period
    try:
        modes = linear_modes(problem)
    except ConvergenceError:
        return []
    found, lowest = [], np.inf
    for mode in modes[1:]:
        own = mode.omega / (2.0 * np.pi)
        orders = np.arange(2, HARMONIC + 1)
        within = (own >= orders * low * (1.0 - AROUND)) & (own <= orders * high * (1.0 + AROUND))
        if within.any() and mode.damping_ratio < LIGHT:
            found.append(
                f"mode {mode.number} at {own:.5g} Hz has a damping ratio of "
                f"{mode.damping_ratio:.1g} (harmonic {orders[within][0]})"
            )
            lowest = min(lowest, own)
    stuck = ", with contact points that stick" if scene.contacts else ""
    advice = (
        "expect narrow resonances, each of which takes points of the curve. If joints damp these "
        f"modes, say so: damping.stiffness = {ENOUGH / (np.pi * lowest):.1g} gives the lowest of "
        f"them a ratio of {ENOUGH:g}."
    )
    reason = f"Harmonics of the loads excite lightly damped modes{stuck}"
    text = f"{reason}: {'; '.join(found)}; {advice}"
    return [Note(NoteKind.REMARK, text, "damping")] if found else []


def _one_speed(scene: Scene) -> list[Note]:
    """A sentence on a curve over the frequency of an engine order, along which the speed stays."""
    ordered = any(isinstance(load.frequency, OrderFrequency) for load in scene.loads)
    if scene.rotation is None or not ordered or response_table(scene).parameter != "frequency":
        return []
    text = (
        "The frequency of an engine order changes along the curve, but the stiffness by rotation "
        f"stays that of {scene.rotation.speed_rpm:g} rpm: only the motion at this speed is right."
    )
    return [Note(NoteKind.WARNING, text, "response.parameter")]


def _warn_of_errors(found: Response) -> None:
    """Judge curves with large errors, or whose stability a richer basis judges otherwise."""
    for curve in found.curves:
        title = curve_title(found.scene, curve.value)
        said = [
            Note(NoteKind.ERROR, text, curve=title, quantity=quantity)
            for quantity, judge in ((AMPLITUDES, inaccuracies), (STABILITY, contradictions))
            for text in judge(curve.checks, found.scene, found.table.parameter)
        ]
        found.warnings += said
        found.warnings += unknown_errors(curve.checks, title)
        if unsure := [point.parameter for point in curve.points if point.denied]:
            ends = sorted({min(unsure), max(unsure)})
            text = (
                f"the stability of {counted(len(unsure), 'point')} of {len(curve.points)} is not "
                f"known ({in_words(found.scene, found.table.parameter, *ends)}): finer time steps "
                "find another one; increase time.steps_per_period"
            )
            found.warnings.append(Note(NoteKind.WARNING, text, curve=title, quantity=STABILITY))
        if said and found.unfinished is None:
            worst = said[0]
            found.unfinished = AccuracyError(f"response: {title}{worst}", quantity=worst.quantity)


def _warn_of_shortening(found: Response, stored: StoredModel) -> None:
    """Judge what stiffness damping takes from the largest motion of each curve."""
    families = found.table.families
    if found.interrupted or found.scene.damping.stiffness == 0.0:
        return
    for curve in found.curves:
        own = stored if families is None else stored.with_values({families.key: curve.value})
        top = max(curve.points, key=lambda point: float(point.amplitude.max()))
        try:
            if curve.harmonics:
                motion = balanced_motion(own, top)
            else:
                motion = recorded_motion(family_of(own)(top.parameter), top.z, top.periods)
        except ConvergenceError:
            continue
        title = curve_title(found.scene, curve.value)
        found.warnings += shortening_notes(own, motion, title, AMPLITUDES)


def _warn_of_peaks(found: Response, stored: Reduced) -> None:
    """Judge peaks over a second number that end within its range, or that are not the largest."""
    over = found.table.peak_over
    if over is None or found.interrupted or not isinstance(stored, StoredModel):
        return
    for curve in found.curves:
        said = incomplete_peaks(curve, over, peak_range(stored), found.scene)
        if said:
            title = curve_title(found.scene, curve.value)
            found.warnings.append(Note(NoteKind.WARNING, said, curve=title, quantity=PEAKS))
            found.unfinished = found.unfinished or ConvergenceError(
                f"response: {title}{said}", quantity=PEAKS
            )


LIGHT = 1e-3  # damping ratio below which a higher mode is named
ENOUGH = 5e-3  # damping ratio of the lowest of these modes that is advised
HARMONIC = 20  # highest harmonic of the loads whose resonance with a higher mode is named
MOSTLY = 0.5  # part of unstable points of an incomplete curve above which they are named
AROUND = 0.01  # part of a frequency within which a harmonic excites a mode
ADVICE = {
    LOST: "no next point was found; more time.steps_per_period or softer contacts may help",
    OUT_OF_POINTS: "it has as many points as response.points allows; raise this limit of its cost, "
    "or choose a shorter range",
    REPEATS: "it passes its own points again, round a closed curve onto which a step has jumped or "
    "to and fro where a contact point begins to slip; another response.first, for example beyond "
    "this place, or more time.steps_per_period may help",
}
"""Why a curve is incomplete, and what to do, by the reason for which it ends."""


def _incomplete(scene: Scene, curve: ResponseCurve) -> ConvergenceError | None:
    """The error of a curve that ends within the range."""
    for reason, advice in ADVICE.items():
        ended = [piece for piece in curve.pieces if piece.points and piece.reason == reason]
        if ended:
            ends = [piece.points[-1].parameter for piece in ended]
            places = in_words(scene, response_table(scene).parameter, *ends)
            points = [point for piece in ended for point in piece.points]
            unstable = sum(point.known_unstable for point in points)
            if unstable > MOSTLY * len(points):
                advice += (
                    f"; {unstable} of its {counted(len(points), 'point')} are unstable: the body "
                    "does not settle on these motions, so see by fenicsrom run how it moves there"
                )
            return ConvergenceError(f"the curve ends at {places}: {advice}")
    return None


@dataclass
class _Outcome:
    """The computed part of a curve, and the reason why the curve is not complete."""

    curve: ResponseCurve
    error: ConvergenceError | AccuracyError | None = None
    interrupted: bool = False


def _compute(job: _Job) -> _Outcome:
    """Compute the curve of a job, as far as an interrupt allows."""
    stored, families = job.stored, response_table(job.stored.scene).families
    richer = job.richer
    if families is not None:
        value = {families.key: job.value}
        stored = stored.with_values(value)
        if richer is not None:
            richer = replace(richer, stored=richer.stored.with_values(value))
    curve = job.kept.curve if job.kept is not None else ResponseCurve(job.value)
    outcome = _Outcome(curve)
    if job.kept is not None and job.kept.done:
        if job.state is not None:
            job.state.save(curve, done=True)
        return outcome
    kind = BalanceWalk if uses_balance(stored.scene) else CurveWalk
    walk = kind(stored, curve, job.state)
    done = False
    try:
        walk.compute(richer)
        done = True
    except Exception as error:
        outcome.error = job_error(error)
    except KeyboardInterrupt:
        outcome.interrupted = True
    try:
        walk.save(done)
    except OSError as error:
        outcome.error = outcome.error or job_error(error)
    return outcome
