"""Static equilibria of a reduced model.

Newton's method with load steps, for every static equilibrium of the program.

The solid, the 1D beam and reduced models share `newton` and `in_load_steps`. They differ in how a
correction is computed and in when it is small enough, so each passes both as functions.

The equilibrium in which a motion starts: under the static loads and the preload of the contacts.

Newton's method adds the pressure of the contacts in load steps. In each iteration the contact
is solved in full as in a time step, but without friction: the sliders end at the points. An
equilibrium may be unstable: a beam that is pressed beyond its buckling load is an example. The
model is then displaced along its softest direction and follows

    M (q1 - q0)/tau + f(q1) + B N(q1) = f(0)

downhill in its energy, with tau short enough for the unstable direction to grow, to the buckled
equilibrium. Where Coriolis forces act, negative eigenvalues of the stiffness prove nothing: the
whole pencil of the softest directions decides (`online.model.pencil`).
"""

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.problem import delassus_of, solve_contact
from fenicsrom.online.contact.state import (
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.contact.together import LOOSE, Springs, bring_together, sliding
from fenicsrom.online.kernels.dense import negative_eigenvalues
from fenicsrom.online.model.loads import largest, static_factors
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.pencil import growing
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force
from fenicsrom.progress import tell

log = logging.getLogger(__name__)

STATIC_TOLERANCE = 1e-9
"""Newton's decrement relative to the work of the load is at most the square of this."""

Correction = tuple[Array, float]
"""Change (n,) of the unknowns, and Newton's decrement |residual · change|, J."""


def newton(
    start: Array,
    correct: Callable[[Array], Correction | None],
    converged: Callable[[Array, float, float, float], bool],
    iterations: int,
    growth: float = np.inf,
    last_resort: float = 0.0,
    decrements: list[float] | None = None,
) -> Array | None:
    """Iterate from a start to an equilibrium.

    Args:
        start: (n,) unknowns.
        correct: gives the correction at u (n,), or None if it cannot be computed.
        converged: says whether u (n,) is accepted. Its arguments are u after the correction, the
            decrement, and the decrements of the first and of the previous iteration (0 at first).
        iterations: largest number of iterations.
        growth: the iteration stops if the decrement exceeds its first value by this factor.
        last_resort: decrement (J) that is accepted after the last iteration.
        decrements: receives the decrement of each iteration, J, in place of what it held.

    Returns:
        The equilibrium (n,), or None.
    """
    u = start.copy()
    first, last = 0.0, 0.0
    noted = [] if decrements is None else decrements
    noted.clear()
    for k in range(iterations):
        correction = correct(u)
        if correction is None:
            log.debug("Newton's method, iteration %d: no correction", k + 1)
            return None
        change, decrement = correction
        noted.append(decrement)
        log.debug("Newton's method, iteration %d: decrement %.3e J", k + 1, decrement)
        first = first or decrement
        if not np.isfinite(decrement) or decrement > growth * first:
            return None
        u += change
        if converged(u, decrement, first, last):
            return u
        last = decrement
    return u if last <= last_resort else None


def small_against_load(decrement: float, first: float, work: float) -> bool:
    """Whether a decrement is small relative to the work of the load and to the first decrement."""
    return decrement <= STATIC_TOLERANCE**2 * max(first, abs(work))


def force_and_tangent(elastic: ElasticPolynomial, q: Array) -> tuple[Array, Array]:
    """The elastic force (n,) and its tangent (n, n) at q (n,), in new arrays."""
    force, tangent = np.empty(q.size), np.empty((q.size, q.size))
    elastic_force(elastic, q, force, tangent)
    return force, tangent


def dense_newton(
    start: Array,
    elastic: Callable[[Array], tuple[Array, Array]],
    load: Array,
    iterations: int,
    growth: float = np.inf,
    decrements: list[float] | None = None,
    work: float = 0.0,
) -> Array | None:
    """The equilibrium (n,) of a model with dense matrices under a load, or None; as `newton`.

    Args:
        start: (n,) unknowns.
        elastic: gives the force (n,) and the tangent (n, n) at q (n,).
        load: (n,) N.
        iterations: as those of `newton`.
        growth: as that of `newton`.
        decrements: as those of `newton`.
        work: of other forces, beside that of the load, J.
    """

    def correct(q: Array) -> Correction | None:
        force, tangent = elastic(q)
        try:
            change = np.asarray(np.linalg.solve(tangent, load - force), np.float64)
        except np.linalg.LinAlgError:
            return None
        return change, abs(float((load - force) @ change))

    def converged(q: Array, decrement: float, first: float, last: float) -> bool:
        return small_against_load(decrement, first, max(work, abs(float(load @ q))))

    return newton(start, correct, converged, iterations, growth, decrements=decrements)


def downhill(
    u: Array,
    rate: float,
    step: Callable[[Array, float], Array | None],
    unstable: Callable[[Array], int],
) -> Array | None:
    """Follow M (u1 - u0)/tau + f(u1) = load downhill in the energy to a stable equilibrium.

    Args:
        u: (n,) a state beside an unstable equilibrium.
        rate: 1/tau of the first steps, 1/s^2.
        step: gives the end of a step from u (n,) with 1/tau, or None without convergence. With
            1/tau = 0 it is an equilibrium.
        unstable: number of unstable directions at u (n,).

    Returns:
        The stable equilibrium (n,), or None.
    """
    for _ in range(DOWNHILL_STEPS):
        trial = step(u, rate)
        if trial is None:
            rate *= SHORTER
            continue
        u = trial
        if unstable(u):
            continue
        found = step(u, 0.0)
        if found is not None and not unstable(found):
            return found
        rate /= SHORTER
    return None


def in_load_steps(
    start: Array, solve: Callable[[Array, float], Array | None], smallest: float
) -> tuple[Array, float]:
    """Follow an equilibrium as the load grows from nothing to all of it, in adaptive steps.

    The first step is the whole load. A step that fails is halved, and a step that succeeds is
    doubled.

    Args:
        start: (n,) equilibrium without the load.
        solve: gives the equilibrium under a fraction of the load, from a nearby equilibrium, or
            None.
        smallest: the iteration stops if a step of at most this fraction fails.

    Returns:
        The last equilibrium (n,), and the fraction of the load that it carries: 1 on success.
    """
    u, reached, step = start, 0.0, 1.0
    while reached < 1.0:
        aim = min(1.0, reached + step)
        trial = solve(u, aim)
        if trial is not None:
            u, reached, step = trial, aim, 2.0 * step
            tell(reached)
        elif step <= smallest:
            break
        else:
            step *= 0.5
    return u, reached


TOLERANCE = 1e-14  # largest root of the relative Newton decrement
ROUNDING = 1e-13  # a smaller relative decrement that stops decreasing is rounding
CONTACT_ROUNDING = 1e-14  # the same, relative to contact forces times displacements
ITERATIONS = 25
DIVERGENCE = 1e8  # growth of the decrement at which the iteration stops
SMALLEST_PART = 1e-4  # smallest load step, as a part of the contacts' pressure
BUCKLING_PUSH = 1e-3  # displacement along an unstable direction, relative to the deflection
DOWNHILL_STEPS = 200  # about ten let the push grow to the size of the body
SHORTER = 4.0  # factor of 1/tau of a step downhill that failed
REGULAR = 1e9  # c of K + c M, 1/s^2
HELD = 1e-13  # eigenvalue of a tangent, scaled to a unit diagonal, below which a piece is loose
BALANCED = 1e-6  # forces balance if the rest is smaller, relative to the contact forces
INVERSE_ITERATIONS = 8
SOFTEST = 8  # further directions in which the whole pencil is judged
DEPENDENT = 1e-8  # a direction is left out if its independent part, relative to its norm, is less


def equilibrium(problem: Problem) -> tuple[Array, int]:
    """The equilibrium of a model nearest to its rest or, if it is unstable, another one.

    Args:
        problem: of a model whose rest, q = 0 or `Problem.rest`, is its equilibrium under the static
            loads.

    Returns:
        q (n,), and the number of directions in which the equilibrium nearest to the rest is
        unstable: 0 unless another equilibrium is returned.

    Raises:
        ConvergenceError: no equilibrium was found.
    """
    statics = _Statics(problem)
    q = statics.rest
    touching = statics.touches(q)
    held, balanced = statics.balance(q) if touching else (False, False)
    if balanced:  # bodies that were brought together
        return q, 0
    model = problem.model
    if held and isinstance(model, ReducedModel) and not model.pressure.numbers.size:
        return statics.brought_together(q), 0
    if held:
        statics.static_force = statics.loads
    if not touching:
        is_free = model.linear or not problem.contacts.preload.size
        unstable = 0 if is_free else statics.unstable(q)
        return (statics.downhill(q), unstable) if unstable else (q, 0)
    q, reached = in_load_steps(q, statics.newton, SMALLEST_PART)
    if reached < 1.0:
        raise ConvergenceError(
            f"equilibrium under the preload: Newton's method converged up to "
            f"{100.0 * reached:.4g} % of the preload, and then failed even with a load step of at "
            f"most {100.0 * SMALLEST_PART:g} %",
            decrements=statics.decrements,
        )
    unstable = statics.unstable(q)
    return (statics.downhill(q), unstable) if unstable else (q, 0)


def together(model: ReducedModel, contacts: Contacts, start: Springs, q: Array) -> Array:
    """The equilibrium q (n,) of bodies that touch, brought together without friction.

    Args:
        model: the model, without follower pressures.
        contacts: its contacts.
        start: the springs of the points from which the search starts.
        q: (n,) where it starts.

    Raises:
        ConvergenceError: there is no stable equilibrium, or nothing presses on a piece that
            contacts hold.
    """
    rows, offset = model.contact_rows, model.contact_offset
    load = model.loads @ static_factors(model.load_histories)

    def elastic(springs: Springs, q: Array) -> tuple[Array, Array]:
        force, tangent = force_and_tangent(model.elastic, q)
        pull = springs.force(offset + rows @ q)
        return force + rows.T @ pull, tangent + rows.T @ (springs.springs[:, None] * rows)

    def solve(springs: Springs, changed: bool) -> Array:
        nonlocal q
        x = offset + rows @ q
        work = float(np.abs(springs.force(x)) @ np.abs(x - springs.reference))
        found = dense_newton(q, partial(elastic, springs), load, ITERATIONS, work=work)
        tangent = elastic(springs, q if found is None else found)[1]
        scale = 1.0 / np.sqrt(np.abs(np.diag(tangent)))
        if np.abs(np.linalg.eigvalsh(scale[:, None] * tangent * scale)).min() < HELD:
            raise ConvergenceError(LOOSE.format("a piece of the mesh"), q)
        if found is None:
            reason = "Newton's method finds no equilibrium of the bodies that touch in the "
            raise ConvergenceError(f"{reason}coordinates of the model; run the scene again", q)
        q = found
        return np.asarray(offset + rows @ q)

    closed = bring_together(contacts, start, solve)
    if negative := negative_eigenvalues(elastic(closed, q)[1]):
        reason = f"the equilibrium of the bodies that touch is unstable in {negative} directions"
        raise ConvergenceError(reason, q, kind=ErrorKind.INSTABILITY)
    return q


def mass_norm(model: Any, vector: Array) -> float:
    """Size of a vector (n,) in the mass norm."""
    return float(np.sqrt(model.dot(vector, model.mass_times(vector))))


def _unit(model: Any, vector: Array) -> Array:
    """A vector (n,) of size 1 in the mass norm."""
    return np.asarray(vector / mass_norm(model, vector), np.float64)


class _Statics:
    """The equations of equilibrium of a model and its contacts."""

    def __init__(self, problem: Problem):
        model, contacts, dimension = problem.model, problem.contacts, problem.dimension
        count = contacts.preload.size
        self.model, self.d = model, dimension
        self.decrements: list[float] = []  # of the last attempt of Newton's method, J
        self.contacts = contacts._replace(friction=np.zeros(count))
        self.scratch = contact_scratch(count, dimension)
        self.start, self.end = (zero_contact_state(count, dimension) for _ in range(2))
        # (P,) normal forces at rest, N: the pressure of the contacts that is added in parts
        self.pressed: Array = np.zeros(count)
        zero = np.zeros_like(model.load(0.0))
        self.rest = zero if problem.rest is None else problem.rest
        model.set_at_rest()
        self.static_force = model.elastic_at(self.rest)[0].copy()
        self.undeformed = model.contact_displacement(self.rest).reshape(-1, dimension).copy()

    @property
    def loads(self) -> Array:
        """The static loads (n,), N."""
        return np.asarray(self.model.loads @ static_factors(self.model.load_histories))

    def touches(self, q: Array) -> bool:
        """Whether a contact presses at q (n,), the start of the load steps of its pressure."""
        self._close(q, self.contacts)
        self.pressed = np.maximum(self.start.trial_normal_force, 0.0)
        return bool(np.any(self.pressed > 0.0))

    def balance(self, q: Array) -> tuple[bool, bool]:
        """Whether the contacts hold the body at q (n,), after `touches`, and whether in balance.

        They hold it if body and static loads are not in balance alone. The forces are compared by
        their responses with (K + c M)⁻¹, because K is singular where contacts alone hold a part of
        the body. What is left is compared with the sum of the sizes of the responses to each
        contact force, because pressures on two sides may cancel each other.
        """
        model, directions = self.model, self.scratch.directions
        out_of_balance = model.elastic_at(q)[0] - self.loads
        tangent = self._tangent(q)
        y, unit, _ = model.solve_effective(REGULAR, 0.0, tangent, out_of_balance, directions)
        forces = (self.start.normal + self.start.friction).reshape(-1)
        each = sum(np.abs(f * one) for f, one in zip(forces, unit.T, strict=True) if f)
        least = BALANCED * mass_norm(model, each)
        return mass_norm(model, y) > least, mass_norm(model, y - unit @ forces) <= least

    def brought_together(self, q: Array) -> Array:
        """The equilibrium near q (n,) of bodies that touch, whose contacts or loads have changed.

        Raises:
            ConvergenceError: as `together`, or a round surface presses on the bodies.
        """
        x = np.asarray(self.model.contact_displacement(q)).copy()
        found = together(self.model, self.contacts, sliding(self.contacts, x), q)
        self.touches(found)
        if not self.balance(found)[1]:
            raise ConvergenceError(
                "a round surface presses on bodies that touch before the motion begins: give it a "
                "larger gap, a gap and an approach, or waves of another phase",
                found,
            )
        return found

    def _close(self, q: Array, contacts: Contacts) -> None:
        """Write the contact state at q (n,) to `start`."""
        x = self.model.contact_displacement(q).reshape(-1, self.d).copy()
        at_rest(contacts, x, x.copy(), 0.0, self.start, self.scratch)

    def _tangent(self, q: Array) -> Any:
        """The tangent of the model at q (n,)."""
        zero, one = np.zeros_like(q), np.ones(1)
        return self.model.elastic_over_step(zero, q, zero, 0.0, one, one)[1]

    def newton(self, q0: Array, part: float, mass_coefficient: float = 0.0) -> Array | None:
        """Equilibrium near q0 (n,), or a step downhill from q0; None without convergence.

        Args:
            q0: (n,).
            part: the part of the contacts' pressure that acts.
            mass_coefficient: 1/tau, or 0 for the equilibrium.
        """
        model, scratch, d = self.model, self.scratch, self.d
        preload = self.contacts.preload - (1.0 - part) * self.pressed
        contacts = self.contacts._replace(preload=preload)
        zero, one = np.zeros_like(q0), np.ones(1)
        self._close(q0, contacts)
        self.end.x[:] = self.start.x
        step = ContactStep(contacts, Interval(0.0, 0.0, 0.0, False), self.start, self.end, scratch)

        def correct(dq: Array) -> Correction | None:
            elastic, tangent = model.elastic_over_step(zero, q0, dq, 0.0, one, one)
            residual = elastic - self.static_force + mass_coefficient * model.mass_times(dq)
            y, unit, compliance = model.solve_effective(
                mass_coefficient, 0.0, tangent, residual, scratch.directions
            )
            before = self.end.x.copy()
            free = model.contact_displacement(q0 + dq + y).reshape(-1, d).copy()
            if not np.all(np.isfinite(free)):
                return None
            if before.size and not solve_contact(step, scratch.candidates, compliance, free):
                return None
            change = y - unit @ scratch.mean_force.reshape(-1)
            contact_work = float(np.sum(scratch.mean_force * (self.end.x - before)))
            return change, abs(model.dot(residual, change) + contact_work)

        def converged(dq: Array, decrement: float, first: float, last: float) -> bool:
            mean, x = scratch.mean_force, self.end.x
            work = abs(model.dot(self.static_force, q0 + dq)) + float(
                np.sum(np.abs(mean * (x - self.undeformed)))
            )
            scale = max(first, work)
            # the decrement after the next iteration, where the convergence is quadratic
            coming = decrement * (decrement / last) ** 2 if decrement < 1e-3 * last else decrement
            carried = np.sum(np.abs(mean), axis=1) @ np.max(np.abs(x), axis=1, initial=0.0)
            floor = max(ROUNDING * scale, CONTACT_ROUNDING * float(carried))
            is_rounding = decrement <= floor and decrement > 0.1 * last
            return bool(coming <= TOLERANCE**2 * scale or is_rounding)

        dq = newton(zero, correct, converged, ITERATIONS, DIVERGENCE, decrements=self.decrements)
        return None if dq is None else np.asarray(q0 + dq)

    def unstable(self, q: Array) -> int:
        """Number of directions in which the equilibrium q (n,) is unstable.

        They are the negative eigenvalues of the stiffness with the contacts that touch, unless
        Coriolis forces hold the body. With the springs S = B sqrt(k) n, the inertia of the matrix
        [[K, S], [S^T, -I]] is the sum of those of K and -(I + S^T K^-1 S), and of those of -I and
        K + S S^T (Haynsworth 1968, Linear Algebra and its Applications 1, 73-81). So
        neg(K + S S^T) = neg(K) - neg(I + S^T K^-1 S).
        """
        tangent = self._tangent(q)
        found: int = self.model.negative_directions(tangent)
        springs = self._springs(q)
        if springs.shape[1]:
            _, _, compliance = self.model.solve_effective(
                0.0, 0.0, tangent, np.zeros_like(q), self.scratch.directions
            )
            found -= negative_eigenvalues(
                np.eye(springs.shape[1]) + springs.T @ delassus_of(compliance) @ springs
            )
        return 0 if found and self._held_by_coriolis(q, found) else found

    def _held_by_coriolis(self, q: Array, negative: int) -> bool:
        """Whether no small motion about q (n,) grows without the damping.

        Args:
            q: the equilibrium.
            negative: number of negative eigenvalues of its stiffness.
        """
        model = self.model
        if not model.velocity_forces:
            return False
        solve = self._inverse(q)
        random = np.random.default_rng(0)
        block = [random.standard_normal(q.shape) for _ in range(negative + SOFTEST)]
        for _ in range(INVERSE_ITERATIONS):
            inertia = [model.mass_times(x).copy() for x in self._orthonormal(block)]
            block = [solve(b) for b in inertia]
        mass, velocity, stiffness = (
            np.array([[model.dot(y, force) for force in forces] for y in block])
            for forces in (
                [model.mass_times(x).copy() for x in block],
                [model.velocity_times(x).copy() for x in block],
                inertia,
            )
        )
        scale = 1.0 / np.sqrt(np.outer(mass.diagonal(), mass.diagonal()))
        skew, symmetric = velocity - velocity.T, stiffness + stiffness.T
        return not growing(scale * mass, 0.5 * scale * skew, 0.5 * scale * symmetric).size

    def _orthonormal(self, block: list[Array]) -> list[Array]:
        """The independent directions (n,) of a block, M-orthonormal."""
        kept: list[Array] = []
        for vector in block:
            x = _unit(self.model, vector)
            for _ in range(2):  # the second pass removes the rounding errors of the first
                for y in kept:
                    x = x - y * self.model.dot(y, self.model.mass_times(x))
            if mass_norm(self.model, x) > DEPENDENT:
                kept.append(_unit(self.model, x))
        return kept

    def _inverse(self, q: Array) -> Callable[[Array], Array]:
        """The inverse of the stiffness at q (n,) with the contacts that touch, for forces (n,)."""
        model, springs = self.model, self._springs(q)
        rest = model.contact_displacement(np.zeros_like(q)).copy()

        def solve(force: Array) -> Array:
            y, unit, compliance = model.solve_effective(
                0.0, 0.0, self._tangent(q), -force, self.scratch.directions
            )
            inner = np.eye(springs.shape[1]) + springs.T @ delassus_of(compliance) @ springs
            x = model.contact_displacement(y).copy() - rest
            return np.asarray(y - unit @ (springs @ np.linalg.solve(inner, springs.T @ x)))

        return solve

    def _springs(self, q: Array) -> Array:
        """(m, closed) sqrt(k) n of each contact that touches at q."""
        self._close(q, self.contacts)
        columns = []
        for p in np.flatnonzero(self.start.trial_normal_force > 0.0):
            column = np.zeros((self.start.trial_normal_force.size, self.d))
            column[p] = self.start.normal[p] / np.linalg.norm(self.start.normal[p])
            columns.append(np.sqrt(self.contacts.normal_stiffness[p]) * column.reshape(-1))
        return np.array(columns).T if columns else np.zeros((self.start.x.size, 0))

    def _soften(self, q: Array, shape: Array) -> tuple[Array, float]:
        """The softest direction, M-normalised, by inverse iteration from a shape (n,).

        Returns:
            The direction (n,), and its eigenvalue in 1/s^2.
        """
        model, solve = self.model, self._inverse(q)
        rate = 0.0
        for _ in range(INVERSE_ITERATIONS):
            shape = _unit(model, shape)
            inertia = model.mass_times(shape).copy()
            shape = solve(inertia)
            rate = 1.0 / model.dot(inertia, shape)
        return _unit(model, shape), rate

    def downhill(self, q: Array) -> Array:
        """A stable equilibrium with less energy than an unstable one."""
        model = self.model
        seed, force = self._seed(q)
        shape, rate = self._soften(q, seed)
        if model.dot(force, shape) < 0.0:  # towards the side to which the loads push
            shape = -shape
        size = max(mass_norm(model, q), mass_norm(model, seed))
        pushed = q + BUCKLING_PUSH * size * shape
        found = downhill(
            pushed, 2.0 * abs(rate), lambda u, rate: self.newton(u, 1.0, rate), self.unstable
        )
        if found is not None:
            return found
        raise ConvergenceError(
            "the equilibrium under the preload is unstable, and no stable one was found below it",
            q,
            kind=ErrorKind.INSTABILITY,
            decrements=self.decrements,
        )

    def _seed(self, q: Array) -> tuple[Array, Array]:
        """The response to the largest loads; it contains every mode that the loads excite.

        Returns:
            The response (n,) to the loads, or to unit contact forces if there are no loads; and the
            loads (n,), N.
        """
        model = self.model
        force = model.loads @ largest(model.load_histories)
        y, unit, _ = model.solve_effective(
            0.0, 0.0, self._tangent(q), -force, self.scratch.directions
        )
        if model.dot(y, model.mass_times(y)) > 0.0:
            return y.copy(), force
        return np.asarray(unit.sum(axis=1)), force
