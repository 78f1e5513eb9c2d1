"""Backbones: the damped nonlinear mode of a reduced model over its amplitude.

The curve starts at the linear mode and is followed by its amplitude
(`fenicsrom.online.curves.nonlinear_mode`). The report shows the peaks of the forced response
(`fenicsrom.online.curves.continuation`) beside the curve.

The motion of the largest amplitude judges the size of the model: the motion of all coordinates that
a stored model holds has another frequency and another amplitude at the probe. Where the change is
above `basis.accuracy`, coordinates join the model by their energies in this motion, as for a forced
motion (`fenicsrom.assess.errors.sizing`), and the mode is followed again.
"""

import re
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.results import CurveRecord, require_polynomial, required_table
from fenicsrom.assess.errors.estimates import BASIS_SAFETY
from fenicsrom.assess.errors.shortening import shortening_notes
from fenicsrom.assess.errors.sizing import candidate_energies, growing, spare_coordinates, unreached
from fenicsrom.assess.errors.verdicts import CONTACT_ERROR, FREQUENCY_ERROR
from fenicsrom.errors import ConvergenceError, ErrorKind, job_error, refuse
from fenicsrom.notes import DAMPING_RATIOS, FREQUENCIES, PEAKS, Note, NoteKind
from fenicsrom.online.curves.continuation import ForcedPeak, forced_peaks
from fenicsrom.online.curves.curve import BACK, END, LOST, OUT_OF_POINTS, REPEATS, CurvePoint
from fenicsrom.online.curves.nonlinear_mode import LinearMode, ModeContinuation, linear_modes
from fenicsrom.online.model.loads import displacement_sines
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, recorded_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.stress.reactions import reduced_modes
from fenicsrom.progress import duration, log, working_time
from fenicsrom.scene import Backbone as BackboneTable
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import brief, counted, two_digits

STILL = 1e-6  # a probe that a mode moves less than this part of its largest motion stands in a node
LEAST_DAMPING = 1e-4  # a smaller change of the damping ratio casts no doubt
SMALLER_STARTS = 12  # times the start is divided by `SMALLER` until the linear mode is near enough
SMALLER = 4.0
LARGEST_STEP = 0.02
"""Of the arc length. At strong friction, negative damping of the higher modes makes loops beside
the nonlinear mode; a step of 0.05 jumped onto one and went round it."""
ADVICE = {
    LOST: "the nonlinear mode was lost at a linear amplitude of {}: no next point was found; more "
    "time.steps_per_period may help",
    OUT_OF_POINTS: "the nonlinear mode ends at a linear amplitude of {}: it has as many points as "
    "backbone.points allows; raise this number, or lower backbone.last",
    BACK: "the nonlinear mode comes back to its first amplitude, {}, and has no motions of larger "
    "ones; lower backbone.last",
    REPEATS: "the nonlinear mode goes round a closed curve at a linear amplitude of {}, onto which "
    "a step has jumped; more time.steps_per_period may avoid the jump",
    "closed": "the nonlinear mode comes back to its own start at {}; lower backbone.last",
}
"""Why a mode is incomplete, and what to do, by the reason for which it ends."""
JUDGED = 8
"""Points, from the largest amplitude down, at which the motion of all coordinates is sought."""
REPORT_INTERVAL = 2.0  # shortest time between two lines of progress, s


@dataclass(frozen=True, eq=False)
class ModePoint:
    """One motion of the nonlinear mode.

    Attributes:
        linear_amplitude: modal coordinate, as the amplitude of the linear mode at the probe, m.
        modal_amplitude: modal coordinate, sqrt(kg) m.
        frequency: Hz.
        damping_ratio: zeta.
        amplitude: (d,) half of peak-to-peak of the probe, m.
        motion: the motion; because the damping is artificial, the stability of this motion means
            nothing.
    """

    linear_amplitude: float
    modal_amplitude: float
    frequency: float
    damping_ratio: float
    amplitude: Array
    motion: CurvePoint


@dataclass(frozen=True, eq=False)
class StepError:
    """The changes at one point by half the time step.

    Attributes:
        point: number of the point, from 0.
        frequency: relative change.
        damping_ratio: change.
    """

    point: int
    frequency: float
    damping_ratio: float


@brief()
@dataclass(eq=False, repr=False)
class Backbone(CurveRecord):
    """The nonlinear mode of a scene.

    Attributes:
        mode: the linear mode.
        direction: direction of the probe's largest motion in the linear mode.
        labels: of the coordinates of the model.
        points: the motions in the order in which they were found.
        reason: why the curve ends: "end of the range", "number of points", "no convergence" or
            "interrupted".
        step_errors: at the first, the middle and the last point.
        basis_error: estimated relative error of frequency and amplitude due to the basis, at the
            largest amplitude; None if it is not known.
        peaks: peaks of the forced response.
    """

    mode: LinearMode
    direction: int
    labels: tuple[str, ...]
    points: list[ModePoint] = field(default_factory=list)
    reason: str = "interrupted"
    step_errors: list[StepError] = field(default_factory=list)
    basis_error: float | None = None
    peaks: list[ForcedPeak] = field(default_factory=list)

    @property
    def table(self) -> BackboneTable:
        """The table [backbone] of the scene."""
        return backbone_table(self.scene)


def backbone_table(scene: Scene) -> BackboneTable:
    """The table [backbone] of a scene.

    Raises:
        SceneError: the scene has no table [backbone].
    """
    return required_table(scene, "backbone", scene.backbone)


def check_backbone(scene: Scene) -> None:
    """Check before the offline stage that the nonlinear mode of a scene can be computed.

    Raises:
        SceneError: there is no table [backbone], all loads are static, the model would not be an
            exact polynomial, or a surface with waves shakes the body.
    """
    backbone_table(scene)
    if scene.static_only:
        reason = "needs a reduced model, but all loads are static"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "backbone")
    require_polynomial(scene, "a nonlinear mode")
    for k, contact in enumerate(scene.contacts):
        if contact.surface is not None and contact.surface.waves:
            reason = "not allowed for a nonlinear mode, which moves without excitation"
            raise refuse(scene.source, reason, ErrorKind.CONFLICT, f"contacts[{k}].surface.waves")


def backbone(stored: StoredModel, spare: int | None = None) -> Backbone:
    """Compute the nonlinear mode of a reduced model under its scene.

    The model takes the coordinates that the largest amplitude needs.

    Args:
        stored: the model; its scene has a table [backbone].
        spare: number of coordinates that must stay out of the model, to judge it; by default
            `fenicsrom.assess.errors.sizing.spare_coordinates`.

    Returns:
        The motions. After an interrupt they end where they were, and `interrupted` is set; if the
        curve or a peak was not found, `unfinished` holds the error.

    Raises:
        SceneError: see `check_backbone`; or there is no such mode, or it does not move the probe.
        ConvergenceError: there is no equilibrium.
    """
    begin, scene = working_time(), stored.scene
    check_backbone(scene)
    spare = spare_coordinates(stored) if spare is None else spare
    problem = Problem.of(stored.model, scene).settled()
    mode, direction, unit = linear_mode(stored, problem)
    points = stored.model.points
    found = Backbone(scene, stored.size, points, mode, direction, stored.labels)
    if scene.time.steps_per_period is None:
        text = (
            f"The nonlinear mode uses {FALLBACK_STEPS} steps per period, because the scene does "
            "not set time.steps_per_period."
        )
        found.warnings.append(Note(NoteKind.REMARK, text, "time.steps_per_period"))
    try:
        path = _path(problem, found, unit)
        try:
            _follow(path, found, unit)
        except ConvergenceError as error:
            found.warnings.append(Note(NoteKind.FAILED, str(error)))
            found.unfinished = error
        larger = _larger_model(found, stored, spare)
        if larger is not None:
            log.info(f"  {counted(larger.size, 'coordinate')}: {' '.join(larger.labels)}")
            again = backbone(larger, spare)
            if _replaces(again, found):
                return again
            found.interrupted, found.unfinished = again.interrupted, again.unfinished
            text = (
                f"The nonlinear mode is that of {counted(found.size, 'coordinate')}, which are too "
                f"few for basis.accuracy; with {larger.size} it was not completed"
            )
            found.warnings.append(Note(NoteKind.ERROR, text, "basis.accuracy"))
        if found.points and not found.interrupted:  # also the peaks of a mode that was lost
            _step_errors(problem, found, unit)
            largest = max(found.points, key=lambda point: point.linear_amplitude).motion
            path = _path(problem, found, unit)
            motion = recorded_motion(path.problem_at(largest.s, largest.parameter), largest.z)
            found.warnings += shortening_notes(stored, motion, quantity=DAMPING_RATIOS)
            _peaks(problem, found)
    except Exception as cause:
        failure = job_error(cause)
        found.warnings.append(Note(NoteKind.FAILED, str(failure)))
        found.unfinished = found.unfinished or failure
    except KeyboardInterrupt:
        found.interrupted = True
    found.seconds = working_time() - begin
    return found


def _replaces(again: Backbone, found: Backbone) -> bool:
    """Whether the mode of more coordinates takes the place of one that is found."""
    is_complete = again.unfinished is None or found.unfinished is not None
    return bool(again.points) and not again.interrupted and is_complete


def linear_mode(
    stored: StoredModel, problem: Problem, table: str = "backbone"
) -> tuple[LinearMode, int, float]:
    """The linear mode of a table, the probe's direction, and its motion there, 1/sqrt(kg).

    Raises:
        SceneError: there is no such mode, or it does not move the probe.
    """
    number, modes = getattr(stored.scene, table).mode, linear_modes(problem)
    where = Where(str(stored.scene.source), f"{table}.mode")
    kept = [label for label in stored.labels if re.fullmatch(r"\d+V", label)]
    if kept and f"{number}V" not in kept:
        allowed = f"must be one of the normal modes of the basis, {', '.join(kept)}; to keep mode "
        raise where.refuse(number, f"{allowed}{number}, raise basis.modes or lower basis.threshold")
    numbers, _, free = reduced_modes(stored.model, stored.scene, stored.normal_modes)
    if number in numbers and numbers != list(range(1, 1 + len(numbers))):
        # a basis that leaves modes out has others: the mode is that of the same shape
        shape = stored.model.mass @ free[:, numbers.index(number)]
        number = 1 + int(np.argmax([abs(shape @ mode.shape) for mode in modes]))
    if number > len(modes):
        allowed = f"must be from 1 to {len(modes)}, the number of modes of the reduced model"
        raise where.refuse(number, allowed)
    moves = [np.abs(stored.model.probe @ mode.shape) for mode in modes]
    mine = moves[number - 1]
    direction = int(np.argmax(mine))
    if mine[direction] <= STILL * max(float(move.max()) for move in moves):
        reason = "this mode does not move the probe; choose another probe"
        raise where.refuse(number, reason, ErrorKind.CONFLICT)
    return modes[number - 1], direction, float(mine[direction])


def _path(problem: Problem, found: Backbone, unit: float) -> ModeContinuation:
    """The continuation over the range of the scene."""
    table = found.table
    return ModeContinuation(problem, found.mode, table.first / unit, table.last / unit)


def _follow(path: ModeContinuation, found: Backbone, unit: float) -> None:
    """Follow the nonlinear mode from the smallest to the largest amplitude.

    Raises:
        ConvergenceError: the first point was not found, or the curve ends within the range.
    """
    begin = last = clock.perf_counter()
    first, width = found.table.first, np.log(found.table.last / found.table.first)

    def keep(point: CurvePoint) -> None:
        nonlocal last
        found.points.append(_mode_point(path, point, unit))
        if clock.perf_counter() - last > REPORT_INTERVAL:
            last, here = clock.perf_counter(), found.points[-1]
            part = float(np.clip(np.log(here.linear_amplitude / first) / width, 0.01, 1.0))
            left = duration((last - begin) * (1.0 - part) / part)
            log.info(
                f"  {counted(len(found.points), 'point')}, linear amplitude "
                f"{1e3 * here.linear_amplitude:.4g} mm, {here.frequency:.6g} Hz, "
                f"damping ratio {100.0 * here.damping_ratio:.4g} %; {100.0 * part:.0f} % of the "
                f"range, about {left} left"
            )

    keep(_first_point(path, found, unit))
    curve = path.run(
        found.points[0].motion,
        1.0,
        largest_step=LARGEST_STEP,
        points=found.table.points,
        locate=False,
        progress=keep,
    )
    if curve.points[-1] is not found.points[-1].motion:  # `run` reports no point at the end
        keep(curve.points[-1])
    found.reason = curve.reason
    log.info(f"  {counted(len(found.points), 'point')}, {curve.reason}")
    if curve.reason != END:
        end = found.points[-1].linear_amplitude
        raise ConvergenceError(f"backbone: {ADVICE[curve.reason].format(f'{end:g} m')}")


def _first_point(path: ModeContinuation, found: Backbone, unit: float) -> CurvePoint:
    """The motion at the smallest amplitude: from the linear mode, or from a smaller amplitude.

    Raises:
        ConvergenceError: the first point was not found.
    """
    start, low, ends = path.linear_start(), path.low, "not even small motions were found"
    for tried in range(SMALLER_STARTS):
        begin = path.at_parameter(start, low - tried * np.log(SMALLER))
        if begin is None:
            continue
        if tried == 0:
            return begin
        path.low, path.high, high = begin.parameter, low, path.high
        curve = path.run(
            begin, 1.0, largest_step=LARGEST_STEP, points=found.table.points, locate=False
        )
        path.low, path.high = low, high
        if abs(curve.points[-1].parameter - low) <= 1e-9:
            return curve.points[-1]
        largest = unit * np.exp(max(point.parameter for point in curve.points))
        ends = f"from smaller amplitudes the mode reaches {largest:.3g} m"
        if begin.peak_force.size:
            ends += (
                f"; its contact sticks with {begin.peak_force.max():.3g} N at rest, and larger "
                "motions slip or lift off"
            )
        break
    raise ConvergenceError(
        "backbone: no nonlinear mode was found at the smallest amplitude, backbone.first = "
        f"{found.table.first:g} m at the probe: {ends}; lower backbone.first, or choose a probe "
        "that the mode moves more"
    )


def _larger_model(found: Backbone, stored: StoredModel, spare: int) -> StoredModel | None:
    """A model with the coordinates that the mode lacks; None if it lacks none, or none is left.

    The error of the mode joins its record; where the accuracy is not reached, so does a warning.

    Args:
        found: the mode.
        stored: its model.
        spare: number of coordinates that must stay out, to judge the others.
    """
    if not found.points or stored.candidates is None:
        return None
    basis, best = stored.scene.basis, None
    known = (*stored.labels, *stored.further)
    largest = int(np.argmax([point.linear_amplitude for point in found.points]))
    # a wrong model may lead to where the motion of all coordinates is far away
    places = dict.fromkeys(int(k) for k in np.linspace(largest, 0, JUDGED).round())
    points = [found.points[k] for k in places]
    motions = ((point, _motion_of(stored, known, found, point)) for point in points)
    point, whole = next((pair for pair in motions if pair[1] is not None), (points[0], None))
    error = np.inf if whole is None else _distance(point, whole[0])
    known_error = whole is not None and point is points[0]
    found.basis_error = error if known_error else None
    if not basis.adapts or basis.size is not None or (known_error and error <= basis.accuracy):
        return None
    if whole is not None and error > basis.accuracy:
        labels = list(candidate_energies(stored, whole[1]))
        for chosen in growing(labels[: len(labels) - spare]):
            best = (*stored.labels, *chosen)
            part = _motion_of(stored, best, found, point)
            if part is not None and _distance(part[0], whole[0]) <= basis.accuracy:
                break
    if best is None:
        found.warnings.append(unreached(stored, error if known_error else np.inf, basis.accuracy))
    return None if best is None else stored.resized(best)


def _distance(point: ModePoint, better: ModePoint) -> float:
    """Estimated error of a point by that of all coordinates: of frequency and amplitude."""
    moved = np.linalg.norm(point.amplitude - better.amplitude) / np.linalg.norm(better.amplitude)
    return BASIS_SAFETY * max(abs(point.frequency / better.frequency - 1.0), float(moved))


def _motion_of(
    stored: StoredModel, labels: Sequence[str], found: Backbone, near: ModePoint
) -> tuple[ModePoint, Motion] | None:
    """The point of a model with more coordinates next to a point of a mode; None if there is none.

    Args:
        stored: the model of the mode.
        labels: the coordinates; those of the model come first.
        found: the mode.
        near: the point, whose linear amplitude stays.
    """
    part = stored.resized(labels)
    problem = Problem.of(part.model, part.scene).settled()
    try:
        mode, _, unit = linear_mode(part, problem)
    except ConvergenceError:
        return None
    if np.real(np.vdot(mode.shape[: stored.size], stored.model.mass @ found.mode.shape)) < 0.0:
        mode = replace(mode, shape=-mode.shape)  # the sign of an eigenvector is arbitrary
    table = backbone_table(part.scene)
    path = ModeContinuation(problem, mode, table.first / unit, table.last / unit)
    blocks, n = path.shooting.map.blocks, stored.size
    moved, sliders = near.motion.z[: blocks * n], near.motion.z[blocks * n :]
    moved = np.pad(moved.reshape(blocks, n), ((0, 0), (0, part.size - n))).ravel()
    parameter = float(np.log(near.linear_amplitude / unit))
    start = path.start(
        np.concatenate([moved, sliders]), parameter, near.frequency, near.damping_ratio
    )
    point = path.at_parameter(start, parameter)
    if point is None:
        return None
    try:
        motion = recorded_motion(path.problem_at(point.s, parameter), point.z)
    except ConvergenceError:
        return None
    return _mode_point(path, point, unit), motion


def _mode_point(path: ModeContinuation, point: CurvePoint, unit: float) -> ModePoint:
    modal = float(np.exp(point.parameter))
    frequency, ratio = path.frequency(point), path.damping_ratio(point)
    return ModePoint(unit * modal, modal, frequency, ratio, point.probe_amplitude, point)


def _step_errors(problem: Problem, found: Backbone, unit: float) -> None:
    """Repeat the first, the middle and the last point with half the time step."""
    half = problem.time.changed(steps_per_period=2 * found.steps)
    path = _path(problem._replace(time=half), found, unit)
    for k in sorted({0, len(found.points) // 2, len(found.points) - 1}):
        log.info(f"  checking point {k + 1} with half the time step")
        point = found.points[k]
        finer = path.at_parameter(point.motion.s, point.motion.parameter)
        if finer is not None:
            found.step_errors.append(
                StepError(
                    k,
                    path.frequency(finer) / point.frequency - 1.0,
                    path.damping_ratio(finer) - point.damping_ratio,
                )
            )
    errors = found.step_errors
    found.warnings += change_notes(
        "half the time step",
        "time.steps_per_period",
        max((abs(error.frequency) for error in errors), default=0.0),
        max((abs(error.damping_ratio) for error in errors), default=0.0),
        max(abs(point.damping_ratio) for point in found.points),
    )


def change_notes(name: str, key: str, frequency: float, ratio: float, damping: float) -> list[Note]:
    """Notes on the changes by a better computation that cast doubt.

    Args:
        name: the computation.
        key: the key that makes it better.
        frequency: largest relative change of the frequency.
        ratio: largest change of the damping ratio.
        damping: the largest damping ratio.
    """
    allowed = max(LEAST_DAMPING, CONTACT_ERROR * damping)
    return [
        Note(
            NoteKind.ERROR,
            f"with {name}, the {what} changes by {two_digits(100.0 * change)} {unit} (at most "
            f"{two_digits(100.0 * limit)} casts no doubt): raise {key}",
            key,
            quantity=quantity,
        )
        for quantity, what, change, limit, unit in (
            (FREQUENCIES, "frequency", frequency, FREQUENCY_ERROR, "%"),
            (DAMPING_RATIOS, "damping ratio", ratio, allowed, "percentage points"),
        )
        if change > limit
    ]


def _peaks(problem: Problem, found: Backbone) -> None:
    """Find the peaks of the forced response.

    Raises:
        ConvergenceError: a peak was not found.
    """
    direction = found.direction
    factors = found.table.load_factors
    if not factors:
        return

    def amplitude(point: CurvePoint) -> float:
        return float(point.probe_amplitude[direction])

    log.info("  peaks of the forced response")
    rest, frequency = (found.mode.equilibrium, found.mode.sliders), found.points[0].frequency
    displaced = displacement_sines(found.scene.loads)
    for peak in forced_peaks(problem, rest, frequency, factors, amplitude, displaced):
        found.peaks.append(peak)
        log.info(
            f"  {peak.value:g} times the loads: largest amplitude {1e3 * peak.amplitude:.5g} mm "
            f"at {peak.frequency:.6g} Hz"
        )
        reasons = [reason for reason in dict.fromkeys(peak.ends) if reason != "fallen"]
        if reasons:
            text = (
                f"{peak.value:g} times the loads: the curve over the frequency ended early "
                f"({' and '.join(reasons)}), before the amplitude had fallen on both sides of the "
                "peak; a larger amplitude may lie beyond."
            )
            found.warnings.append(Note(NoteKind.WARNING, text, quantity=PEAKS))
