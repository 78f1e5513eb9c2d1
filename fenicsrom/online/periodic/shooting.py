"""Periodic motions by shooting: Newton's method on the period map of the time stepping.

A periodic motion is a root of r(z) = P(z) - z, with P the map of
`fenicsrom.online.periodic.period_map`. The eigenvalues of dP/dz are its Floquet multipliers: the
motion is stable if all lie inside the unit circle, and loses stability by a fold where a real
multiplier passes +1, by period doubling where one passes -1, and by a torus bifurcation where a
complex pair leaves the circle.

A point that sticks all the time keeps its slider, whatever it is: a multiplier is exactly 1 and
the motion belongs to a family. In Newton's equation such a slider rests where it is.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.kernels.numbers import STEP
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA
from fenicsrom.online.model.model import Problem
from fenicsrom.online.model.turning import no_turning
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.period_map import PeriodEnd, PeriodMap
from fenicsrom.online.step.state import Checkpoint, Record, scheme
from fenicsrom.online.step.step import DONE
from fenicsrom.progress import ask, asking
from fenicsrom.words import counted

Family = Callable[[float], Problem]
"""The problem at a value of the parameter; its `varied` gives the derivatives by the parameter."""


def family_of(build: Callable[[Any], Problem]) -> Family:
    """A family of problems: any number of the online stage may depend on the parameter.

    Args:
        build: gives the problem at a value p, and at p + i `STEP`, where its numbers are complex.
            A number that belongs to the basis of the model must not depend on p.
    """
    return lambda value: build(value)._replace(varied=build(complex(value, STEP)))


def frequency_family(
    problem: Problem, *, spin: bool = False, displaced: NDArray[np.bool_] | None = None
) -> Family:
    """Problems by the excitation frequency in Hz: all sines keep their ratio to it.

    Args:
        problem: the problem at one frequency.
        spin: whether the surfaces turn in proportion to the frequency (an engine order).
        displaced: (s,) sines of a given displacement of the supports
            (`fenicsrom.online.model.loads.displacement_sines`); none by default.
    """
    return family_of(lambda frequency: _at_frequency(problem, frequency, spin, displaced))


def _at_frequency(
    problem: Problem, frequency: Any, spin: bool, displaced: NDArray[np.bool_] | None
) -> Problem:
    """The problem at a frequency in Hz, real or complex; arguments as `frequency_family`."""
    contacts, sines = problem.contacts, problem.model.load_histories.sines
    factor = frequency * problem.period
    # the amplitude of a load is proportional to this power of the frequency
    powers = np.zeros(len(sines)) if displaced is None else 2.0 * displaced
    sines = sines.astype(np.result_type(sines, factor))
    sines[:, OMEGA] *= factor
    sines[:, AMPLITUDE] *= factor**powers
    if spin:
        contacts = contacts._replace(spin=contacts.spin * factor)
    return _with_sines(problem, sines)._replace(contacts=contacts, period=1.0 / frequency)


def speed_family(problem: Problem, speed: float, displaced: NDArray[np.bool_]) -> Family:
    """Problems by the speed of rotation in rev/min, which all loads and surfaces follow.

    The model at a speed Omega has the elastic force f(q) - Omega^2 (c + Q q) and the forces
    (D + Omega G) v of `fenicsrom.online.model.turning`.

    Args:
        problem: the problem at one speed, whose model has the data of a varying speed.
        speed: this speed, rev/min.
        displaced: as `frequency_family`.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    model, ratio = problem.model, 1.0 / (problem.period * speed)
    turning = model.turning
    rest = CubicSpline(turning.rest[:, 0], turning.rest[:, 3:])

    def build(rpm: Any) -> Problem:
        found, omega = _at_frequency(problem, ratio * rpm, True, displaced), np.pi / 30.0 * rpm
        square = omega**2
        elastic = model.elastic._replace(
            force=model.elastic.force - square * turning.centrifugal,
            stiffness=model.elastic.stiffness - square * turning.softening,
        )
        velocity = model.velocity_matrix + omega * turning.coriolis
        q = rest(square.real)
        return found._replace(
            model=found.model._replace(
                elastic=elastic,
                velocity_matrix=velocity if velocity.any() else np.zeros((0, 0)),
                turning=no_turning(),
            ),
            rest=q + 1j * square.imag * rest(square.real, 1) if square.imag else q,
        )

    return family_of(build)


def force_family(problem: Problem, load: int | None = None) -> Family:
    """Problems by a factor on the amplitude of one load, or on those of all loads that vary."""
    histories = problem.model.load_histories
    if load is None:
        chosen = histories.sines[:, OMEGA] != 0.0
    else:
        chosen = np.zeros(histories.sines.shape[0], dtype=bool)
        chosen[slice(*histories.spans[load, :2])] = True

    def build(factor: Any) -> Problem:
        sines = histories.sines.astype(np.result_type(histories.sines, factor))
        sines[chosen, AMPLITUDE] *= factor
        return _with_sines(problem, sines)

    return family_of(build)


def contact_family(problem: Problem, name: str, weights: Array | None = None) -> Family:
    """Problems by a number of the contacts: p times `weights`.

    Args:
        problem: the problem, with P contact points.
        name: "preload", "normal_stiffness", "tangential_stiffness", "friction", "spin", or "gap".
            The gap is added to the radius (subtracted outside of a surface) of the contacts given.
        weights: (P,) what one unit of p means at each point; 0 leaves a point as it is. 1 if not
            given.
    """
    contacts = problem.contacts
    weights = np.ones(contacts.preload.size) if weights is None else np.asarray(weights, float)

    def build(value: Any) -> Problem:
        if name == "gap":
            chosen: dict[str, Any] = {"radius": contacts.radius + value * weights * contacts.side}
        else:
            chosen = {name: np.where(weights != 0.0, value * weights, getattr(contacts, name))}
        return problem._replace(contacts=contacts._replace(**chosen))

    return family_of(build)


def damping_family(problem: Problem) -> Family:
    """Problems by the mass-proportional damping alpha in 1/s."""
    return family_of(lambda value: problem._replace(model=problem.model._replace(damping=value)))


def _with_sines(problem: Problem, sines: Array) -> Problem:
    """The problem with other sines of its load histories."""
    histories = problem.model.load_histories._replace(sines=sines)
    return problem._replace(model=problem.model._replace(load_histories=histories))


log = logging.getLogger(__name__)

TOLERANCE = 1e-10  # of the residual relative to the variables, in the scaled norm
ROUNDING = 1e-8  # of a residual that stays, relative to the variables, in the norm of amplitudes
ITERATIONS = 60
PATIENCE = 12
LONGEST = 0.3  # Newton step relative to the variables; a longer one is shortened
SINGULAR = 1e-8  # residual in parts of the Newton step, below which the equation is singular
STAYS = 1e-12  # largest derivative of the change of a slider that sticks: rounding
STABLE_WITHIN = 1e-8  # a multiplier outside the unit circle by less counts as on it
FALLBACK_STEPS = 200  # of a period, where the scene asks for an adaptive step


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """A periodic motion.

    Attributes:
        z: (N,) variables at the start of the period: see `PeriodMap`.
        period: period of the motion, m times that of the loads, s.
        residuals: relative residual of each Newton iteration.
        multipliers: (N,) Floquet multipliers, the largest first.
        verdict: "stable", "fold", "period doubling" or "torus": how the stability was lost.
        free_sliders: number of slider components that are not unique.
        record: rows of the period.
        end: the end of the period.
    """

    z: Array
    period: float
    residuals: tuple[float, ...]
    multipliers: NDArray[np.complex128]
    verdict: str
    free_sliders: int
    record: Record
    end: PeriodEnd

    @property
    def stable(self) -> bool:
        """Whether the motion is stable."""
        return self.verdict == "stable"

    @property
    def displacement(self) -> Array:
        """(rows, P, d) contact displacement, or (rows, 1, d) of the probe without contact, m."""
        return self.record.observed

    @property
    def amplitude(self) -> Array:
        """(P, d) half of peak-to-peak of the displacement, m."""
        return np.asarray(np.ptp(self.displacement, axis=0) / 2.0)

    @property
    def probe_amplitude(self) -> Array:
        """(d,) half of peak-to-peak of the probe, m."""
        return np.asarray(np.ptp(self.record.probe, axis=0) / 2.0)

    @property
    def friction_dissipation(self) -> float:
        """Energy dissipated by friction in the period, J."""
        return float(np.sum(self.record.friction_dissipation[-1]))


class Shooting:
    """The equation of a periodic motion in scaled variables s = (L^T q, L^T v / omega, .., w).

    M = L L^T. Accelerations are scaled by the square of the shortest step h, L^T a h^2, as the step
    uses them: scaled by omega, the fast modes would make dP/dz - I seem singular. A slider
    component is scaled by the square root of the mass that its direction feels,
    1 / (b^T M^-1 b), so that the norm has the same unit in all components.

    Attributes:
        omega: that of the scales, 1/s.
        guess: (2, n) mean velocity of the step before the period and its growth, or None, and the
            size of that step, s: the first guess of the first step is extrapolated from them.
    """

    def __init__(self, problem: Problem, m: int = 1, fractions: Array | None = None):
        """Make the map and the scales.

        Args:
            problem: of a reduced model; scheme, spectral radius and steps per period are those of
                its `time`. Abradable layers stay as they are worn.
            m: number of periods of the loads in one of the motion.
            fractions: instants on which the steps land, from 0 to m; equal steps if not given.
        """
        problem = problem.with_yield(np.inf)
        model, settings, period = problem.model, problem.time, problem.period
        steps = settings.steps_per_period or FALLBACK_STEPS
        grid = np.arange(m * steps + 1) / steps if fractions is None else fractions
        plan = scheme(settings.scheme, model, settings.spectral_radius or 0.8)
        self.m, self.problem = m, problem
        self.map = PeriodMap(problem, plan, grid)
        n, omega = model.size, 2.0 * np.pi / period
        self.omega = omega
        root = np.linalg.cholesky(model.mass).T
        give = np.sum(model.contact_rows * np.linalg.solve(model.mass, model.contact_rows.T).T, 1)
        slider = 1.0 / np.sqrt(np.maximum(give, 1e-300))
        self._scale = np.zeros((self.map.size, self.map.size))
        self._unscale = np.zeros_like(self._scale)
        inverse = np.linalg.inv(root)
        rates = 1.0, omega, (period * float(np.min(np.diff(grid)))) ** -2
        for k in range(self.map.blocks):
            part = slice(k * n, (k + 1) * n)
            self._scale[part, part] = root / rates[k]
            self._unscale[part, part] = inverse * rates[k]
        rest = np.arange(self.map.blocks * n, self.map.size)
        self._scale[rest, rest] = slider[self.map.memory]
        self._unscale[rest, rest] = 1.0 / slider[self.map.memory]
        self.guess: tuple[Array | None, float] = (None, 0.0)

    @property
    def sliders(self) -> NDArray[np.int64]:
        """The variables that are sliders."""
        return np.arange(self.map.blocks * self.map.n, self.map.size)

    @cached_property
    def weights(self) -> Array:
        """W (N, N): in the length of W s, velocities count by the amplitudes that they cause.

        L^T v / omega of a mode with a frequency omega_k above omega is multiplied by
        omega / omega_k, so that a high mode that rings counts as little as it moves.
        """
        model, n = self.problem.model, self.problem.model.size
        inverse, stiffness = np.linalg.inv(np.linalg.cholesky(model.mass)), model.rest_stiffness()
        squares, shapes = np.linalg.eigh(inverse @ (0.5 * (stiffness + stiffness.T)) @ inverse.T)
        found = np.eye(self.map.size)
        ratios = self.omega / np.sqrt(np.maximum(squares, self.omega**2))
        found[n : 2 * n, n : 2 * n] = (shapes * ratios) @ shapes.T
        return found

    def scaled(self, z: Array) -> Array:
        """Scaled variables s."""
        return np.asarray(self._scale @ z)

    def unscaled(self, s: Array) -> Array:
        """Variables z."""
        return np.asarray(self._unscale @ s)

    def scaled_matrix(self, matrix: Array) -> Array:
        """A matrix (N, N) between variables z as one between scaled variables."""
        return np.asarray(self._scale @ matrix @ self._unscale)

    def march(
        self, s: Array, problem: Problem | None = None, *, derive: bool = True
    ) -> tuple[Array, Array, Array, PeriodEnd] | None:
        """The residual P(s) - s, dP/ds, dP/dp and the end of the period; None if a step failed.

        Args:
            s: (N,) scaled variables at the start.
            problem: a problem of the same sizes; by default that of the equation.
            derive: whether to find the derivatives.

        Raises:
            Stopped: the work was asked to stop.
        """
        ask()
        guess, last_step = self.guess
        here, z = self.problem if problem is None else problem, self.unscaled(s)
        status, end = self.map(here, z, derive=derive, guess=guess, last_step=last_step)
        if status != DONE or not np.isfinite(end.z).all() or not np.isfinite(end.matrix).all():
            return None
        self.guess = end.guess, end.last_step
        residual = self._scale @ end.z - s
        if not derive:
            return residual, end.matrix, end.by_parameter, end
        matrix, by_parameter = self.scaled_matrix(end.matrix), self._scale @ end.by_parameter
        return residual, matrix, by_parameter, end


def start_variables(shooting: Shooting, start: Any) -> Array:
    """The variables z of a start: a `Checkpoint`, (q, v, sliders), or z itself."""
    pmap = shooting.map
    if isinstance(start, Checkpoint):
        state = start.state
        shooting.guess = np.stack([state.mean_velocity, state.mean_acceleration]), 0.0
        found = pmap.pack(state.q, state.v, state.a, state.contact.slider)
        return found - pmap.origin(shooting.problem)
    if isinstance(start, tuple):
        q, v, sliders = start
        return pmap.pack(q, v, np.zeros_like(q), sliders)
    return np.array(start, dtype=np.float64)


def hold_sliders(jacobian: Array, sliders: NDArray[np.int64]) -> int:
    """Let sliders rest that stick during the whole period, whatever their place; their number.

    The equation 0 = 0 of such a slider becomes: minus its change is its residual.

    Args:
        jacobian: (n, n) or (n, n + 1); the rows of these sliders are replaced.
        sliders: the equations and unknowns that are sliders.
    """
    sizes = np.max(np.abs(jacobian[sliders]), axis=1, initial=0.0)
    free = sliders[sizes <= STAYS]
    jacobian[free, free] = -1.0
    return free.size


def judged(multipliers: NDArray[np.complex128], free: int) -> NDArray[np.complex128]:
    """The multipliers, the largest first, without those that belong to `free` slider components.

    A slider that is not unique has the multiplier 1, so the `free` ones nearest to 1 are left out.
    """
    if not free:
        return multipliers
    return np.delete(multipliers, np.argsort(np.abs(multipliers - 1.0))[:free])


def floquet(eigenvalues: Any, free: int) -> tuple[NDArray[np.complex128], str]:
    """Multipliers (N,), the largest first, and the verdict, from those of a monodromy matrix.

    The `free` multipliers nearest to 1 belong to sliders that are not unique and do not count.
    """
    found = np.asarray(eigenvalues, dtype=np.complex128)
    found = found[np.argsort(-np.abs(found))]
    worst = largest_multiplier(found, free)
    if abs(worst) <= 1.0 + STABLE_WITHIN:
        return found, "stable"
    if abs(worst.imag) > 1e-9 * abs(worst):
        return found, "torus"
    return found, "fold" if worst.real > 0.0 else "period doubling"


def largest_multiplier(multipliers: NDArray[np.complex128], free: int) -> complex:
    """The largest multiplier without the `free` ones nearest to 1; 0 if none is left."""
    deciding = judged(multipliers, free)
    return complex(deciding[np.argmax(np.abs(deciding))]) if deciding.size else 0j


def periodic_motion(
    problem: Problem, start: Any, m: int = 1, *, tolerance: float = TOLERANCE
) -> PeriodicMotion:
    """Find a periodic motion near a start by Newton's method.

    Args:
        problem: of a reduced model; surfaces are where their approach ends.
        start: near the motion at the start of a period: a `Checkpoint` (`motion.end`), a tuple
            (q (n,), v (n,), sliders (P, d)) or variables z (N,).
        m: number of periods of the loads in one of the motion.
        tolerance: tolerance of the residual relative to the variables.

    Raises:
        ConvergenceError: no periodic motion was found; `partial` holds the residuals.
    """
    shooting = Shooting(problem.settled(), m)
    return solve(shooting, shooting.scaled(start_variables(shooting, start)), tolerance)


def solve(
    shooting: Shooting,
    s: Array,
    tolerance: float = TOLERANCE,
    found: tuple[Array, Array, Array, PeriodEnd] | None = None,
    step_tolerance: float = 0.0,
    iterations: int = ITERATIONS,
) -> PeriodicMotion:
    """Find a periodic motion by Newton's method with bounded steps.

    Where many contact points change their state in a step, the first steps must make the residual
    larger. So it may grow, but a step is at most `LONGEST` times the variables; without contact,
    only one that makes the residual larger. The iteration ends if the steps did not become shorter
    for `PATIENCE` iterations. A residual that an iteration did not make ten times smaller is
    rounding if the amplitudes that it causes (`Shooting.weights`) are at most `ROUNDING` of those
    of the variables: forces at rest of stiff joints round the velocities of modes that hardly move.

    The last march of `shooting` is that of the motion.

    Args:
        shooting: the equation.
        s: (N,) scaled variables of the start.
        tolerance: tolerance of the residual relative to the variables.
        found: `shooting.march(s)`, if the caller has it.
        step_tolerance: tolerance of the Newton step, relative to the variables: the iteration also
            ends where the next step would be at most so large.
        iterations: largest number of iterations.

    Raises:
        ConvergenceError: no periodic motion was found; `partial` holds the residuals.
    """
    found = shooting.march(s) if found is None else found
    residuals: list[float] = []
    lengths: list[float] = []
    for _ in range(iterations):
        if found is None:
            break
        residual, matrix, _, end = found
        size = max(float(np.linalg.norm(s)), 1e-300)
        residuals.append(float(np.linalg.norm(residual)) / size)
        log.debug("shooting, iteration %d: relative residual %.3e", len(residuals), residuals[-1])
        jacobian = matrix - np.eye(s.size)
        free = hold_sliders(jacobian, shooting.sliders)
        if residuals[-1] <= tolerance or _rounds(shooting, s, residual, residuals):
            return _motion(shooting, s, matrix, free, end, residuals)
        try:
            step = np.linalg.solve(jacobian, -residual)
        except np.linalg.LinAlgError:
            break
        length = float(np.linalg.norm(step)) / size
        if length * SINGULAR > residuals[-1]:
            break
        if length <= step_tolerance:
            return _motion(shooting, s, matrix, free, end, residuals)
        lengths.append(length)
        if int(np.argmin(lengths)) < len(lengths) - PATIENCE:
            break
        bound = min(1.0, LONGEST * max(1.0, residuals[-1]) / length)
        s, found = _stepped(shooting, s, step, bound, residuals[-1] * size)
    raise ConvergenceError(
        f"no periodic motion of {counted(shooting.m, 'period')} was found near the start: relative "
        f"residual {residuals[-1] if residuals else np.inf:.3g} after "
        f"{counted(len(residuals), 'Newton iteration')}",
        residuals,
        decrements=residuals,
    )


def _rounds(shooting: Shooting, s: Array, residual: Array, residuals: list[float]) -> bool:
    """Whether a residual stays, and causes amplitudes that are rounding beside those of s."""
    if len(residuals) < 2 or residuals[-1] <= 0.1 * residuals[-2]:
        return False
    causes, moves = shooting.weights @ residual, shooting.weights @ s
    return bool(np.linalg.norm(causes) <= ROUNDING * np.linalg.norm(moves))


def _stepped(
    shooting: Shooting, s: Array, step: Any, bound: float, residual: float
) -> tuple[Array, tuple[Array, Array, Array, PeriodEnd] | None]:
    """The variables after a step and their march; the step is shortened by `bound` if need be."""
    ahead = None if shooting.map.points and bound < 1.0 else shooting.march(s + step)
    if bound < 1.0 and (ahead is None or np.linalg.norm(ahead[0]) > residual):
        step = bound * step
        ahead = shooting.march(s + step)
    return s + step, ahead


def _motion(
    shooting: Shooting, s: Array, matrix: Array, free: int, end: PeriodEnd, residuals: list[float]
) -> PeriodicMotion:
    multipliers, verdict = floquet(np.linalg.eigvals(matrix), free)
    return PeriodicMotion(
        z=shooting.unscaled(s),
        period=shooting.m * shooting.problem.period,
        residuals=tuple(residuals),
        multipliers=multipliers,
        verdict=verdict,
        free_sliders=free,
        record=end.record,
        end=end,
    )


def recorded_motion(problem: Problem, z: Array, m: int = 1) -> Motion:
    """One period of a periodic motion, for a report too: whoever asks to stop waits for it.

    Args:
        problem: of a reduced model.
        z: (N,) variables at the start of the period.
        m: number of periods of the loads in one of the motion.

    Raises:
        ConvergenceError: a step did not converge.
    """
    with asking(None):
        status, end = Shooting(problem, m).map(problem, z, derive=False)
    if status != DONE:
        raise ConvergenceError("the periodic motion was lost when it was recorded")
    return motion_of(end.record, m * problem.period)


def motion_of(record: Record, period: float) -> Motion:
    """The motion of the rows of a period, with the start, which equals the end, at their head."""
    rows = Record._make(np.concatenate([array[-1:], array]) for array in record)
    for summed in (rows.time, rows.friction_dissipation, rows.energies[:, :3]):
        summed[0] = 0.0
    return Motion.of_rows(
        rows, rows.coordinates, period=period, steady=True, periods=1, steps=record.time.size
    )
