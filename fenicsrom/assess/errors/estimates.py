"""Errors between motions, and estimates of the error due to time step, basis and mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.measures import (
    NEGLIGIBLE,
    amplitude,
    at_rest,
    friction_dissipation_per_period,
    has_contact,
    has_settled,
    interpolated,
    is_unsteady,
    peak_normal_force,
    rms,
    times_before_end,
)
from fenicsrom.online.motion.motion import Motion, check_scheme
from fenicsrom.online.periodic.shooting import Shooting, motion_of, solve, start_variables
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import coarser, refined

PHASES = 200  # instants at which two periods are compared
# A check whose periodic motion is so near to the motion that it checks, relative to the variables,
# needs no march that tends to it. What is farther away may belong to another motion.
NEARBY = 0.1
# Newton step, relative to the variables, that a nearby motion may lack: it changes an estimate of
# 0.1 % by a hundredth. As the iteration converges quadratically, most lack far less.
NEARBY_STEP = 1e-5
CHECK_PERIODS = 18  # of a check that starts from the motion: room for two of 8 periods of the loads
ENOUGH_PERIODS = 50  # of a motion that does not settle, for its root mean squares
# the distance from an enriched motion is the true error in the median of random scenes, and 0.8 to
# 1.1 times the true error in nine of ten (`tests/evidence/basis_estimate.py`)
BASIS_SAFETY = 1.5
# the distance from the motion with twice the step is three times the error of a scheme of second
# order, and the error of one of first order
STEP_SAFETY = 2.0
# the distance from the motion of elements of one degree more is 0.7 to 0.95 of the true error
# (`tests/README.md`); these elements have an error too, above all at corners and clamped edges
MESH_SAFETY = 1.5
PARTS = 4  # of a run without a period, whose root mean squares are compared
SMALL_DIRECTION = 0.05  # a direction with a smaller part of the motion is compared with this part
# a step whose peak force may be wrong by half of itself does not resolve the contact: the order of
# the scheme is then one at most
UNRESOLVED_FORCE = 0.5
# the steps do not resolve a stiff contact if its force changes by more than this part of the peak
# force in one of them: a pulse of twelve steps changes by a quarter
FORCE_JUMP = 0.25


class MotionErrors(NamedTuple):
    """Estimates of the relative errors of a motion, due to its time step, basis or mesh.

    Attributes:
        amplitude: error of the amplitudes of all directions together if the motion has settled,
            otherwise of the root mean squares (and of a motion without a period also of the
            amplitudes); infinite if there is no estimate. Near a resonance it is the change of the
            amplitude between motions of the same phase (`fenicsrom.assess.errors.resonance`).
        peak_force: error of the largest normal force; also infinite where the step does not resolve
            the contact.
        directions: errors (d,) by direction, each relative to this direction: [normal, tangents],
            or the global axes without contact. The error of a direction with less than
            `SMALL_DIRECTION` of the whole motion is relative to this part of the whole motion.
        shift: error of the frequency near a resonance, relative; 0 of any other motion.
        at_frequency: error of the amplitude at the frequency of the loads, near a resonance.
        from_rest: the errors against the other model's own run from rest, where sliders that stick
            all the time are free: each error is from that with the same sliders to this one. None
            of a motion that is unique.
        dissipation: error of the energy that friction dissipates in the last period.
        worn: error of the largest worn depth.
        probe: error of the amplitudes of the probe beside contact points.
        history: error of the displacements of this probe at equal times of a run without a period:
            that of the amplitudes and, in a vibration that goes on, of its phase.
    """

    amplitude: float
    peak_force: float
    directions: tuple[float, ...]
    shift: float = 0.0
    at_frequency: float = 0.0
    from_rest: MotionErrors | None = None
    dissipation: float = 0.0
    worn: float = 0.0
    probe: float = 0.0
    history: float = 0.0

    @property
    def largest(self) -> float:
        """The largest error of the displacements: of all directions together and of each.

        The shift of a resonance counts twice, as the error of the stiffness that causes it.
        """
        return max(self.amplitude, *self.directions, 2.0 * self.shift)

    def combined(self, rule: Callable[..., float], *others: MotionErrors) -> MotionErrors:
        """A rule applied to each error, but to the shift, and to those of other estimates."""
        rows = zip(self.directions, *(other.directions for other in others), strict=True)
        names = "amplitude", "peak_force", "dissipation", "worn", "probe", "history"
        found: dict[str, Any] = {
            name: rule(*(getattr(one, name) for one in (self, *others))) for name in names
        }
        return self._replace(directions=tuple(rule(*row) for row in rows), **found)

    def deciding(self, joined: bool) -> float:
        """The error that decides on a run: the largest one, or that of the probe of a joint.

        Bodies of a joint slide by micrometres along one another, so that the probe shows their
        motion. The error of their friction is judged separately.
        """
        return max(self.probe, 2.0 * self.shift) if joined else self.largest


def with_range(
    found: MotionErrors, factor: float, model: Any, scene: Scene, motion: Motion
) -> MotionErrors:
    """The errors of a motion, as a range where its sliders are free.

    A point that sticks all the time keeps the place of its slider, which its history decides. The
    other model's motion nearby has the same sliders, and hides what its own history does.

    Args:
        found: the errors against the motion nearby.
        factor: the errors are this factor times the distances.
        model: the other model.
        scene: the scene of the other motion.
        motion: the motion.
    """
    search = motion.search
    if search is None or not search.accepted or not search.free_sliders:
        return found
    try:
        other = simulate(model, scene, keep_coordinates=True)
    except (ConvergenceError, AccuracyError):
        return found
    return found._replace(from_rest=times_distance(factor, motion, other))


def step_errors(model: Any, scene: Scene, motion: Motion) -> MotionErrors:
    """Estimate the errors of a motion due to its time step, from a run with twice the step.

    The estimate is twice the distance of the two motions. That is six times the error of a scheme
    of second order, and twice the error of a scheme of first order; contacts that switch may reduce
    the order to one. Impacts may make the difference of the amplitudes small by chance. The
    estimate of a motion that has settled is therefore at least the error of its last period: a
    third of the distance between the last periods of both runs for a scheme of second order, and
    the whole distance for one of first order. The order counts as one if the estimated error of the
    peak force is above `UNRESOLVED_FORCE`. The peak force of impacts is compared with a run of four
    times the step, too. If a stiff contact lasts only a few steps, its peak force is not resolved.
    The error of this force counts as unknown if a contact has a blending weight of a half or more
    (`fenicsrom.online.contact.law`), and its force changes by more than `FORCE_JUMP` of the peak in
    a step. A motion with such a contact may repeat for this step only,
    and any motion may fail to repeat for this step only. There is then no estimate unless the
    motion with half the step, or with a quarter where the motion does not settle, does the same.
    The estimate of a motion that does not settle is that from a quarter or from twice the step,
    whichever is larger.

    Args:
        model: the model that was integrated.
        scene: the scene of the motion.
        motion: the motion.
    """
    dimension = motion.displacement.shape[2]
    unknown = _unknown(dimension)
    coarse = coarser(scene)
    if coarse.time == scene.time and not at_rest(motion):
        return unknown  # a single step cannot be made longer
    try:
        other = check_motion(model, coarse, motion)
    except (ConvergenceError, AccuracyError):
        return unknown
    if at_rest(motion) and at_rest(other):
        return MotionErrors(0.0, 0.0, (0.0,) * dimension)
    force = _force_error(motion, other)
    if has_settled(motion) and not has_settled(other):
        return unknown._replace(peak_force=force)
    compared = _compared(motion, other)
    if is_unsteady(motion) or (motion.steady and np.isinf(force)):
        try:
            fine = check_motion(model, refined(scene, 4 if is_unsteady(motion) else 2), motion)
        except (ConvergenceError, AccuracyError):
            return unknown
        if motion.steady != _fine_settles(fine, motion):
            return unknown
        if not motion.steady:
            compared += _compared(motion, fine)
    found = _errors(compared, dimension, STEP_SAFETY, relative_to=0)
    order = 1 if force > UNRESOLVED_FORCE else 2
    least = _shape_distance(motion, other) / (2**order - 1) if has_settled(motion) else 0.0
    if np.isfinite(force) and _has_impacts(motion):
        force = max(force, _impact_error(model, coarse, motion, other))
    found = found._replace(amplitude=max(found.amplitude, least), peak_force=force)
    return with_further(found, motion, other, 2.0)


def _unknown(dimension: int) -> MotionErrors:
    """The errors of a motion without an estimate."""
    found = MotionErrors(np.inf, np.inf, (np.inf,) * dimension)
    return found._replace(dissipation=np.inf, worn=np.inf, probe=np.inf, history=np.inf)


def with_further(found: MotionErrors, motion: Motion, other: Motion, factor: float) -> MotionErrors:
    """Add the estimated relative errors of the dissipated energy, of the wear, and of the probe.

    Energies that are `NEGLIGIBLE` beside the largest stored energy have no error.

    Args:
        found: the other errors.
        motion: the motion.
        other: the motion with which it is compared.
        factor: of the differences.
    """
    ours, theirs = (friction_dissipation_per_period(m, _start(motion)) for m in (motion, other))
    least = NEGLIGIBLE * float(np.max(motion.kinetic + motion.elastic, initial=0.0))
    apart = abs(ours - theirs) if max(ours, theirs) > least else 0.0
    depths = [0.0 if m.end is None or m.end.worn is None else m.end.worn for m in (motion, other)]
    deepest, other_deepest = (float(np.max(depth, initial=0.0)) for depth in depths)
    probe, other_probe = motion.at_probe(), other.at_probe()
    pairs: list[tuple[Array, Array]] = []
    drift = 0.0
    if has_contact(motion) and probe is not None and other_probe is not None:
        pairs = _compared(probe, other_probe)
        if motion.period is None:
            there = interpolated(other_probe, other_probe.displacement, motion.time)
            here = probe.displacement.reshape(there.shape)
            drift = _relative(float(np.linalg.norm(here - there)), float(np.linalg.norm(here)))
    return found._replace(
        probe=_errors(pairs, motion.displacement.shape[2], factor, relative_to=0).amplitude,
        dissipation=factor * _relative(apart, ours),
        worn=factor * _relative(abs(deepest - other_deepest), deepest),
        history=factor * drift,
    )


def _has_impacts(motion: Motion) -> bool:
    """Whether a contact point opens and closes again while the peak force is taken."""
    part = motion.last_period() if motion.period is not None else slice(None)
    closed = motion.force[part, :, 0] > 0.0
    return bool(np.any(closed.any(axis=0) & ~closed.all(axis=0)))


def _impact_error(model: Any, scene: Scene, motion: Motion, other: Motion) -> float:
    """Estimated relative error of the peak force of impacts, from a run with four times the step.

    The step changes the instants at which the contact is seen to close, so the peak forces of
    impacts converge with first order and scatter. Two runs may then agree by chance; the difference
    of the two longer steps is the error of first order that is left with the step itself. Without a
    motion with four times the step, the result is 0, and the estimate of the two runs stands.

    Args:
        model: the model that was integrated.
        scene: the scene with twice the step.
        motion: the motion.
        other: the motion with twice the step.
    """
    longest = coarser(scene)
    if longest.time == scene.time:
        return 0.0
    try:
        third = check_motion(model, longest, motion)
    except (ConvergenceError, AccuracyError):
        return 0.0
    start, peak = _start(motion), peak_normal_force(motion)
    return _relative(abs(peak_normal_force(other, start) - peak_normal_force(third, start)), peak)


def _fine_settles(fine: Motion, motion: Motion) -> bool:
    """Whether the motion with shorter steps settles in half of the periods of an unsteady one.

    An unsteady motion may nearly have settled, and shorter steps may settle a few periods earlier.
    """
    return has_settled(fine) and (motion.steady or 2 * fine.periods <= motion.periods)


def check_motion(
    model: Any,
    scene: Scene,
    motion: Motion,
    start: tuple[Array, ...] | None = None,
    march: bool = True,
) -> Motion:
    """A motion of another model, or with other steps, that checks a motion.

    If Newton's method found the motion, the check takes its own periodic motion nearby. Where there
    is none, the check starts where the motion ended, and marches until Newton's method finds the
    motion to which it tends. Otherwise, and where this does not succeed within `CHECK_PERIODS`, the
    check runs like the motion, from rest; so it does where a surface wears, which has a history.

    Args:
        model: the model of the check.
        scene: the scene of the check.
        motion: the motion to be checked.
        start: the end of the motion in the coordinates of the model: displacement and velocity
            (n,) and sliders (P, d); by default the models have the same coordinates.
        march: whether to march where there is no periodic motion nearby.

    Raises:
        ConvergenceError: the smallest step did not converge, or there is no motion nearby.
        AccuracyError: the energy balance is off.
    """
    if motion.newton_from is not None and motion.steady and not scene.wears:
        nearby = _nearby_motion(model, scene, motion, start)
        if nearby is not None:
            return nearby
        if not march:
            raise ConvergenceError("there is no periodic motion nearby")
        if not any(contact.approach for contact in scene.contacts):
            short = replace(scene, time=scene.time.changed(periods=CHECK_PERIODS))
            try:
                begin = motion if start is None else start
                other = simulate(model, short, start=begin, keep_coordinates=True)
            except (ConvergenceError, AccuracyError):
                return simulate(model, scene, keep_coordinates=True)
            if other.newton_from is not None and other.steady:
                return other
    return simulate(model, _as_long(scene, motion), keep_coordinates=True)


def _as_long(scene: Scene, motion: Motion) -> Scene:
    """The scene of a check from rest.

    The root mean squares of a motion that does not settle are known after half of its periods,
    unless these are fewer than `ENOUGH_PERIODS`.
    """
    if not is_unsteady(motion):
        return scene
    periods = scene.time.periods
    assert periods is not None
    enough = max(periods // 2, min(periods, ENOUGH_PERIODS))
    return replace(scene, time=scene.time.changed(periods=enough))


def _nearby_motion(
    model: Any, scene: Scene, motion: Motion, start: tuple[Array, ...] | None
) -> Motion | None:
    """The stable periodic motion of a check within `NEARBY` of a motion; None if there is none.

    Newton's method alone finds it, in full steps. The estimate is the distance of the two motions,
    so it is right for any stable motion nearby, whether or not a march from the start tends to it.
    Where the step is adaptive, another model takes the steps of the motion. The same model must
    choose its own, in a march.

    Args:
        model: the model of the check.
        scene: the scene of the check.
        motion: a motion that Newton's method found.
        start: as `check_motion`.
    """
    adaptive = scene.time.tolerance is not None
    if (adaptive and start is None) or not isinstance(model, ReducedModel):
        return None
    assert motion.search is not None
    fractions = step_fractions(scene, motion)
    shooting = Shooting(Problem.of(model, scene).settled(), motion.search.periods, fractions)
    s = shooting.scaled(start_variables(shooting, motion.end if start is None else start))
    try:
        found = solve(shooting, s, step_tolerance=NEARBY_STEP)
        other = motion_of(found.record, found.period)
        check_scheme(other, scene.time.scheme)
    except (ConvergenceError, AccuracyError):
        return None
    moved = np.linalg.norm(shooting.scaled(found.z) - s)
    return other if found.stable and moved <= NEARBY * np.linalg.norm(s) else None


def step_fractions(scene: Scene, motion: Motion) -> Array | None:
    """The adaptive steps of the last period of a motion, in periods of the loads, from 0.

    None where the scene asks for equal steps.
    """
    if scene.time.tolerance is None:
        return None
    assert scene.period is not None
    steps = motion.time[motion.last_period()] / scene.period
    return np.asarray(steps - steps[0])


def _start(motion: Motion) -> float:
    """Time of the first record, s: above 0 if the run was resumed."""
    return float(motion.time[0])


def _force_error(motion: Motion, other: Motion) -> float:
    """Estimated relative error of the largest normal force, infinite where it is not resolved."""
    peak = peak_normal_force(motion)
    apart = 2.0 * abs(peak - peak_normal_force(other, _start(motion)))
    if peak == apart == 0.0:
        return 0.0
    if motion.end is None or peak == 0.0:
        return _relative(apart, peak)
    part = motion.last_period() if motion.period is not None else slice(None)
    stiff = motion.end.state.trial.scratch.blending >= 0.5
    jumps = np.abs(np.diff(motion.force[part][:, stiff, 0], axis=0))
    return apart / peak if np.max(jumps, initial=0.0) <= FORCE_JUMP * peak else np.inf


def _shape_distance(motion: Motion, other: Motion) -> float:
    """Relative distance of the last periods of two motions that have settled."""
    shape, other_shape = _last_period(motion), _last_period(other)
    size = float(np.linalg.norm(shape - shape.mean(axis=0)))
    return _relative(float(np.linalg.norm(shape - other_shape)), size)


def _last_period(motion: Motion) -> Array:
    """Displacements (`PHASES`, P d) at equal phases of the last period, m."""
    times = times_before_end(motion, np.arange(PHASES) / PHASES)
    return interpolated(motion, motion.displacement, times)


def nested_motion(
    model: ReducedModel,
    scene: Scene,
    motion: Motion,
    chosen: Sequence[int] | None = None,
    near: Motion | None = None,
) -> Motion | None:
    """The motion of a model with more or fewer coordinates near a motion; its coordinates are kept.

    A motion that does not settle is compared by its root mean squares with a march, in which
    Newton's method does not look for a periodic motion.

    Args:
        model: the model, under the loads and the damping of the scene.
        scene: the scene of the motion.
        motion: the motion.
        chosen: the coordinates of the motion with which those of the model begin, -1 for another
            coordinate; by default all.
        near: a motion of more coordinates, which those of `chosen` belong to; near a motion of
            Newton's method only a periodic motion near this one is sought, without a march.

    Returns:
        The motion; None if the model fails, or does not settle although the motion did.
    """
    try:
        if motion.newton_from is None or motion.buckled:  # the run itself starts from rest
            alike = marched(scene) if is_unsteady(motion) else scene
            other = simulate(model, _as_long(alike, motion), keep_coordinates=True)
        else:
            *state, sliders = end_of(motion)
            if near is not None and near.coordinates is not None and near.velocity is not None:
                state = [near.coordinates[-1], near.velocity[-1]]
            first = np.arange(state[0].size) if chosen is None else np.array(chosen)
            more = np.zeros(model.size - first.size)
            q, v = (np.concatenate([(first >= 0) * values[first], more]) for values in state)
            other = check_motion(model, scene, motion, (q, v, sliders), march=near is None)
    except (ConvergenceError, AccuracyError):
        return None
    return None if has_settled(motion) and not has_settled(other) else other


def marched(scene: Scene) -> Scene:
    """A scene with a period whose motion is marched, without Newton's method."""
    return replace(scene, time=scene.time.changed(steady="march"))


def basis_errors(motion: Motion, other: Motion | None) -> MotionErrors:
    """Estimate the errors of a motion due to its basis, from that of an enriched model.

    The enriched model has all candidates (`fenicsrom.reduction.candidates`). The motion of the
    enriched model contains the effect of these vectors on the other coordinates, on the contact and
    on the probe. The estimate is `BASIS_SAFETY` times the distance of the two motions, because the
    enriched model has an error too.

    Args:
        motion: the motion.
        other: the motion of the enriched model; the estimates are infinite without it.
    """
    return times_distance(BASIS_SAFETY, motion, other)


def together(first: MotionErrors, second: MotionErrors) -> MotionErrors:
    """The errors due to different directions that a basis lacks: roots of sums of squares."""
    return first.combined(math.hypot, second)


def mesh_errors(motion: Motion, other: Motion | None) -> MotionErrors:
    """Estimate the errors of a motion due to its mesh, from that of a model of finer elements.

    The estimate is `MESH_SAFETY` times the distance of the two motions
    (`fenicsrom.reduction.candidates`).

    Args:
        motion: the motion.
        other: the motion of the finer model; the estimates are infinite without it.
    """
    return times_distance(MESH_SAFETY, motion, other)


def times_distance(factor: float, motion: Motion, other: Motion | None) -> MotionErrors:
    """The relative errors of a motion: a factor times its distances from a better one.

    Args:
        factor: the factor.
        motion: the motion.
        other: the better motion; None gives infinite errors.
    """
    if other is None:
        return _unknown(motion.displacement.shape[2])
    scaled = distances(motion, other).combined(lambda error: factor * error)
    return with_further(scaled, motion, other, factor)


def distances(motion: Motion, other: Motion) -> MotionErrors:
    """Relative distances of a motion from one of a better model.

    A preload that has buckled one of the models moves its start; the distance of the starts then
    counts too.

    Args:
        motion: the motion.
        other: the motion of the better model, to whose sizes the distances are relative.
    """
    compared = _compared(motion, other)
    if motion.buckled or other.buckled:
        compared.append((motion.displacement[:1], other.displacement[:1]))
    found = _errors(compared, motion.displacement.shape[2], 1.0, relative_to=1)
    peak, other_peak = peak_normal_force(motion), peak_normal_force(other, _start(motion))
    return found._replace(peak_force=_relative(abs(peak - other_peak), other_peak))


def _compared(motion: Motion, other: Motion) -> list[tuple[Array, Array]]:
    """The displacements by which two motions are compared: pairs of arrays (k, P, d), m.

    If the motion has settled, these numbers are the amplitudes. Otherwise they are the root mean
    squares. The other motion may start where the motion ends, so that the root mean squares of a
    settled motion would compare different parts of its history. A motion without a period is
    compared by its amplitudes and by the root mean squares of the parts of the run, which see a
    change that the whole may hide.
    """
    points = motion.displacement.shape[1:]
    if has_settled(motion):
        still = at_rest(motion) and at_rest(other)
        pairs = [] if still else [(amplitude(motion), amplitude(other))]
    elif motion.period is not None:
        # a check of fewer periods is compared with as many, unless the run was resumed
        shorter = is_unsteady(other) and not _start(motion)
        until = float(other.time[-1]) if shorter else np.inf
        pairs = [(rms(motion, until=until), rms(other, _start(motion)))]
    else:
        first = _start(motion)
        late = other.displacement[other.time >= first]
        pairs = [
            (np.ptp(motion.displacement, axis=0) / 2.0, np.ptp(late, axis=0) / 2.0),
            (_parts_rms(motion, first), _parts_rms(other, first)),
        ]
    return [(ours.reshape(-1, *points), theirs.reshape(-1, *points)) for ours, theirs in pairs]


def _parts_rms(motion: Motion, since: float) -> Array:
    """Root mean squares (`PARTS`, P d) of equal parts of a run about their means, m."""
    times = np.linspace(since, motion.time[-1], PARTS * PHASES + 1)
    parts = interpolated(motion, motion.displacement, times)[1:].reshape(PARTS, PHASES, -1)
    return np.asarray(np.std(parts, axis=1))


def _errors(
    compared: Sequence[tuple[Array, Array]], dimension: int, factor: float, relative_to: int
) -> MotionErrors:
    """Largest relative distances of pairs of displacements (k, P, d), without a peak force.

    Args:
        compared: the pairs; with none the errors are zero.
        dimension: d.
        factor: factor of the distances.
        relative_to: the one of a pair, 0 or 1, whose size counts.
    """
    together = 0.0
    apart: Array = np.zeros(dimension)
    for pair in compared:
        difference = factor * np.linalg.norm(pair[0] - pair[1], axis=(0, 1))
        sizes = np.linalg.norm(pair[relative_to], axis=(0, 1))
        whole = float(np.linalg.norm(sizes))
        together = max(together, _relative(float(np.linalg.norm(difference)), whole))
        least = np.maximum(sizes, SMALL_DIRECTION * whole)
        ratios = [_relative(float(d), float(s)) for d, s in zip(difference, least, strict=True)]
        apart = np.maximum(apart, ratios)
    return MotionErrors(together, 0.0, tuple(float(value) for value in apart))


def _relative(difference: float, size: float) -> float:
    """A difference relative to a size; infinite where only the size is zero."""
    return difference / size if size > 0.0 else (np.inf if difference > 0.0 else 0.0)
