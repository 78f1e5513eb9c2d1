"""Errors near a resonance: the shift of its frequency, and the change of the amplitude on it.

Near a resonance, the amplitude at a fixed frequency of the loads says little about a model. That of
a linear oscillator of the frequency f_r and the damping ratio ζ is

    a = a_s / |1 - r² + 2 i ζ r|,    r = f / f_r,    d ln a / d ln f ≈ 2 r² / (1 - r²).    (1)

If a finer mesh moves f_r by the part e, the amplitude at f = f_r changes by the factor
1 / sqrt(1 + (e / ζ)²), which is 1 / 5 for e = 1 % and ζ = 0.2 %, although the resonance curve is
only shifted. A motion is therefore compared with the motion of the other model that has
the same phase. With the mass matrix M = L Lᵀ and ω of the loads, the second one has the frequency
(1 + e) f of the loads at which

    sᵀ J s' = 0,    s = (Lᵀ q, Lᵀ v / ω),    J (x, y) = (y, -x),    (2)

for the states s of the motion and s' of the other one, each with its ω, at the start of a period.
On the resonance of a linear oscillator, e is the shift of f_r, and the amplitudes a and a' are
those of both peaks. Newton's method solves (2) for e together with the equation of a periodic
motion (`fenicsrom.online.periodic.shooting`). Both together are regular on a resonance, and at the
folds beside a nonlinear one.

A motion counts as near a resonance if the amplitude at the fixed frequency differs by more than
`STEEP` times the shift. After (1), its frequency is then within some ten percent of the resonance.
Away from a resonance, the amplitude at the fixed frequency stays the measure.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.estimates import MotionErrors, step_fractions, times_distance
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.model.loads import displacement_sines
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.measures import has_settled
from fenicsrom.online.motion.motion import Motion, check_scheme
from fenicsrom.online.periodic.shooting import (
    Shooting,
    force_family,
    frequency_family,
    hold_sliders,
    motion_of,
    solve,
    start_variables,
)
from fenicsrom.scene import Scene

STEEP = 10.0
"""Change of the amplitude at a fixed frequency near a resonance, in parts of the shift."""

MOST = 0.15
"""Largest shift of the frequency of the loads that is sought, relative."""

ITERATIONS = 20
"""Largest number of Newton iterations."""

TOLERANCE = 1e-8
"""Of the residuals of (2) and of the periodic motion, relative to the variables."""


def near_resonance(
    errors: MotionErrors, factor: float, model: Any, scene: Scene, motion: Motion, start: Any
) -> MotionErrors:
    """The errors of a motion near a resonance, by the shift of the frequency; others unchanged.

    Args:
        errors: those at the fixed frequency, infinite where there is no other motion.
        factor: the errors are this factor times the distances.
        model: the other model.
        scene: the scene of the other motion.
        motion: the motion.
        start: the end of the motion in the coordinates of the other model, as `start_variables`.
    """
    if not isinstance(model, ReducedModel) or model.load_histories.table.size:
        return errors
    if motion.period is None or not has_settled(motion) or scene.wears:
        return errors
    if np.isinf(errors.amplitude) and np.any(motion.force):
        return errors  # the motion of a contact may repeat for this step only
    assert scene.period is not None
    periods, fractions = round(motion.period / scene.period), step_fractions(scene, motion)
    try:
        shift, other = same_phase(Problem.of(model, scene), scene, start, periods, fractions)
        check_scheme(other, scene.time.scheme)
    except (AccuracyError, ConvergenceError):
        return errors
    if errors.amplitude < factor * STEEP * abs(shift):
        return errors
    near = times_distance(factor, motion, other)
    near = near._replace(shift=factor * abs(shift), at_frequency=errors.amplitude)
    return near._replace(peak_force=np.inf) if np.isinf(errors.peak_force) else near


def same_phase(
    problem: Problem, scene: Scene, start: Any, periods: int = 1, fractions: Array | None = None
) -> tuple[float, Motion]:
    """The periodic motion with the phase (2) of a start, and the shift of its frequency.

    The motion of the same size and phase under another force is a start that needs no luck: on a
    resonance, this force is nearly that of the scene.

    Args:
        problem: of the other model.
        scene: its scene.
        start: as `start_variables`.
        periods: number of periods of the loads in one of the motion.
        fractions: as `Shooting`.

    Returns:
        The shift e, relative to the frequency of the problem, and the motion.

    Raises:
        ConvergenceError: there is no such motion, or it is not stable.
    """
    problem = problem.settled()
    shooting, sines = Shooting(problem, periods, fractions), displacement_sines(scene.loads)
    begin = shooting.scaled(start_variables(shooting, start))
    alike = _of_phase(shooting, sines, begin, begin, 0.0, of_size=True)
    s, shift = _of_phase(shooting, sines, begin, *(alike or (begin, 0.0))) or (begin, np.inf)
    if not abs(shift) <= MOST:
        raise ConvergenceError("there is no periodic motion with the same phase nearby")
    shifted = Shooting(_at(problem, sines, shift), periods, fractions)
    found = solve(shifted, shifted.scaled(shooting.unscaled(s)))
    if not found.stable:
        raise ConvergenceError("the motion with the same phase is not stable")
    return shift, motion_of(found.record, found.period)


def _at(problem: Problem, sines: NDArray[np.bool_], shift: float) -> Problem:
    """A problem at another frequency, relative to its own; `sines` as in `frequency_family`."""
    spin = bool(np.any(problem.contacts.height))
    return frequency_family(problem, spin=spin, displaced=sines)((1.0 + shift) / problem.period)


def _of_phase(
    shooting: Shooting,
    sines: NDArray[np.bool_],
    begin: Array,
    s: Array,
    shift: float,
    of_size: bool = False,
) -> tuple[Array, float] | None:
    """The solution (N,) of (2) with the equation of a periodic motion, and its shift, or None.

    Args:
        shooting: the equation of a periodic motion at the shift 0.
        sines: as `_at`.
        begin: (N,) the state whose phase is asked for.
        s: (N,) from which Newton's method starts.
        shift: from which it starts.
        of_size: whether the motion has the size of `begin`, too, under another force.
    """
    problem, n, count = shooting.problem, shooting.problem.model.size, s.size
    size = max(float(np.linalg.norm(begin[: 2 * n])), 1e-300)
    along = np.append(begin[: 2 * n], np.zeros(count - 2 * n)) / size
    across = np.append(np.append(-along[n : 2 * n], along[:n]), along[2 * n :])
    factor, jacobian = 1.0, np.eye(count + 2)
    for _ in range(ITERATIONS):
        scaled = force_family(problem)(factor)
        found = shooting.march(s, _at(scaled, sines, shift))
        if found is None:
            return None
        moved = float(across[:n] @ s[:n])  # the velocities of s are over the omega of shift 0
        residual = np.concatenate([found[0], [across @ s + shift * moved, 0.0]])
        jacobian[:count, :count] = found[1] - np.eye(count)
        jacobian[:count, count] = found[2] / problem.period
        hold_sliders(jacobian[:count, : count + 1], shooting.sliders)
        jacobian[count, :count], jacobian[count, count] = across, moved
        jacobian[count, :n] *= 1.0 + shift
        if of_size:
            forced = shooting.march(s, force_family(_at(problem, sines, shift))(factor))
            if forced is None:
                return None
            jacobian[:count, -1], jacobian[-1, :count], jacobian[-1, -1] = forced[2], along, 0.0
            residual[-1] = along @ s - size
        if np.linalg.norm(residual) <= TOLERANCE * size:
            return s, shift
        try:
            step = np.linalg.solve(jacobian, -residual)
        except np.linalg.LinAlgError:
            return None
        s, shift, factor = s + step[:count], shift + float(step[count]), factor + float(step[-1])
        if not abs(shift) <= MOST:
            return None
    return None
