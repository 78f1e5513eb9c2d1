"""The period map of the time stepping and its derivative (the monodromy matrix).

The map takes the start of a period to its end by the compiled loop of `online.step.step`. Its
variables are z = (q, v, a, w): coordinates, velocities, accelerations and the sliders of the
contact points. The discrete gradient has no accelerations. The normal component of a slider before
a plane has no meaning and is left out. The derivative is carried over the recorded steps
(`online.derivative.period_sensitivity`), so that one march gives the end and its derivatives by z
and by one parameter.

Where a problem has a `rest`, q and w are measured from it: a static displacement that follows the
parameter, and is larger than the motion, would hide the motion.
"""

from dataclasses import dataclass, replace

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.surfaces import PLANE, Contacts
from fenicsrom.online.derivative.contact_sensitivity import REST
from fenicsrom.online.derivative.period_sensitivity import (
    carry_derivatives,
    drift_of,
    no_sensitivity,
)
from fenicsrom.online.model.model import Problem
from fenicsrom.online.step.state import (
    LAST_STEP,
    STEP,
    Control,
    Record,
    Scheme,
    State,
    copied_rows,
    no_record,
    no_state,
)
from fenicsrom.online.step.step import DONE, FULL, compiled_march, measure
from fenicsrom.progress import ask

SINGULAR = 3
"""Status of a period in which the matrix of a step is singular; the others are of `loop`."""
ASKED = 1e7  # operations, less than a second, after which an interrupt is noticed
EQUAL = 1e-9  # intervals that differ by less than this part are one grid


@dataclass(frozen=True, eq=False)
class PeriodEnd:
    """Where a period ends.

    Attributes:
        z: (N,) variables at the end.
        matrix: (N, N) monodromy matrix dP/dz; (0, 0) if it was not asked for.
        by_parameter: (N,) dP/dp; (0,) likewise.
        record: rows of the accepted steps.
        guess: (2, n) mean velocity of the last step and its growth.
        last_step: size of the last step, s.
    """

    z: Array
    matrix: Array
    by_parameter: Array
    record: Record
    guess: Array
    last_step: float


class PeriodVariables:
    """The variables z = (q, v, a, w) of a period map, of a reduced model or of the full one.

    Attributes:
        n: number of coordinates, of the full model those of this rank.
        points: number of contact points P.
        dimension: dimension of space d.
        blocks: number of vectors (n,) in z: 2 if the scheme has no accelerations, else 3.
        memory: the components of sliders in z among all (P d).
        size: number of variables N.
    """

    def __init__(self, n: int, contacts: Contacts, plan: Scheme):
        """Count the variables of n coordinates with a scheme."""
        self.n, (self.points, self.dimension) = n, contacts.centre.shape
        kinds = np.repeat(contacts.kind, self.dimension)
        axis = np.tile(np.arange(self.dimension), self.points)
        self.memory = np.flatnonzero((kinds != PLANE) | (axis > 0))
        self.blocks = 2 if plan.discrete_gradient else 3
        self.size = self.blocks * n + self.memory.size

    def pack(self, q: Array, v: Array, a: Array, sliders: Array) -> Array:
        """The variables z (N,) of coordinates, velocities, accelerations and sliders (P, d).

        Or their derivatives (N, k) by k numbers, of which those of the sliders are (P d, k).
        """
        sliders = sliders.reshape(self.points * self.dimension, *q.shape[1:])
        return np.concatenate([*[q, v, a][: self.blocks], sliders[self.memory]])

    def coordinates(self, z: Array) -> Array:
        """Coordinates, velocities and accelerations (3, n) of variables z."""
        found = np.zeros((3, self.n))
        found[: self.blocks] = z[: self.blocks * self.n].reshape(self.blocks, self.n)
        return found

    def sliders(self, z: Array) -> Array:
        """Sliders (P, d) of variables z; zero where they have no meaning."""
        found = np.zeros(self.points * self.dimension)
        found[self.memory] = z[self.blocks * self.n :]
        return found.reshape(self.points, self.dimension)


class PeriodMap(PeriodVariables):
    """The period map of one model with one scheme on one grid of times."""

    def __init__(self, problem: Problem, plan: Scheme, fractions: Array):
        """Make the arrays.

        Args:
            problem: gives the sizes; its values may change from call to call.
            plan: the weights of the scheme.
            fractions: (N + 1,) instants on which the steps land, from 0 to the number of periods.
        """
        super().__init__(problem.model.size, problem.contacts, plan)
        self.plan, self.fractions = plan, np.asarray(fractions, float)
        n, points, dimension = self.n, self.points, self.dimension
        self._state = no_state(n, points, dimension)
        self._record = no_record(4 * self.fractions.size, points, dimension, 3 * n)
        columns = 8 * (self.size // 8 + 1)  # loops over whole vectors of eight numbers are faster
        self._sensitivity = no_sensitivity(n, columns, points, dimension)
        work = n**4 / 50.0 + 0.02 * n * self.memory.size * self.size  # of a step with derivatives
        self._rows = max(int(ASKED / work), 1)
        # (first, last) instant of each run of equal intervals
        intervals = np.diff(self.fractions)
        changes = np.flatnonzero(np.abs(np.diff(intervals)) > EQUAL * intervals[1:]) + 1
        self._grids = list(zip([0, *changes], [*changes, intervals.size], strict=True))

    @property
    def state(self) -> State:
        """The state at the end of the last call; the next call overwrites it."""
        return self._state

    def origin(self, problem: Problem) -> Array:
        """The variables (N,) of the rest of a problem, from which z is measured."""
        if problem.rest is None:
            return np.zeros(self.size)
        nothing, x = np.zeros(self.n), problem.model.contact_displacement(problem.rest)
        return self.pack(problem.rest, nothing, nothing, x)

    def __call__(
        self,
        problem: Problem,
        z: Array,
        *,
        derive: bool = True,
        guess: Array | None = None,
        last_step: float = 0.0,
    ) -> tuple[int, PeriodEnd]:
        """March over the period from z.

        Args:
            problem: the problem; its `varied` gives the derivatives of its data by the parameter.
            z: (N,) variables at the start.
            derive: whether to find the derivatives.
            guess: (2, n) mean velocity of the step before the start and its growth; zero if not
                given.
            last_step: size of that step, s.

        Returns:
            The status (DONE, or why the march stopped) and the end.
        """
        origin = self.origin(problem)
        z = z + origin
        s, sliders = self._sensitivity, self.sliders(z)
        model, contacts = problem.model, problem.contacts
        plan = self.plan._replace(damping=float(model.damping))
        self._begin(problem, z, sliders, guess, last_step)
        if derive:
            self._begin_derivatives()
        status, count = self._march(problem, plan)
        drift = drift_of(problem) if derive else None
        if drift is not None and status == DONE:
            model.work.key[:] = np.nan
            for first in range(0, count, self._rows):
                ask()
                last = min(first + self._rows, count)
                if not carry_derivatives(
                    model,
                    contacts,
                    plan,
                    drift,
                    self._record,
                    first,
                    last,
                    count,
                    REST,
                    sliders,
                    self.memory,
                    s,
                ):
                    status = SINGULAR
                    break
        end = self._end(count, origin, derive=derive)
        if drift is not None and drift.rest.size:
            nothing, x = np.zeros(self.n), model.contact_rows @ drift.rest
            moved = self.pack(drift.rest, nothing, nothing, x)
            end = replace(end, by_parameter=end.by_parameter + end.matrix @ moved - moved)
        return status, end

    def _begin(
        self, problem: Problem, z: Array, sliders: Array, guess: Array | None, last_step: float
    ) -> None:
        """Set the state; arguments as the call."""
        state, model, contacts = self._state, problem.model, problem.contacts
        # a new factor is due where a linear model or its step has changed
        model.work.key[:] = np.nan
        state.scalars[:] = 0.0
        state.scalars[LAST_STEP] = last_step
        state.q[:], state.v[:], state.a[:] = self.coordinates(z)
        state.mean_velocity[:], state.mean_acceleration[:] = (0.0, 0.0) if guess is None else guess
        state.load_vector[:] = model.load(0.0)
        x = model.contact_displacement(state.q).reshape(self.points, self.dimension).copy()
        state.friction_dissipation[:] = 0.0
        at_rest(contacts, x, sliders, 0.0, state.contact, state.trial.scratch)
        measure(model, contacts, state)

    def _begin_derivatives(self) -> None:
        """Set the values at the start of the derivatives to those of the state."""
        state, s = self._state, self._sensitivity
        s.before[:] = state.q, state.v, state.a
        s.x0[:], s.w0[:] = state.contact.x, state.contact.slider
        s.normal_force[:] = np.maximum(state.contact.trial_normal_force, 0.0)

    def _march(self, problem: Problem, plan: Scheme) -> tuple[int, int]:
        """March over the period; returns the status and the number of steps."""
        status, count, most = DONE, 0, self._record.time.size
        for first, last in self._grids:
            begin, end = (float(problem.period * self.fractions[k]) for k in (first, last))
            control = Control((end - begin) / float(last - first), 0.0, 0.0)
            self._state.scalars[STEP] = control.grid
            status = FULL
            while status == FULL and count < most:
                ask()
                free = Record._make(array[count : count + self._rows] for array in self._record)
                status, rows = compiled_march(
                    problem.model, problem.contacts, plan, control, self._state, begin, end, free
                )
                count += rows
            if status != DONE:
                break
        return status, count

    def _end(self, count: int, origin: Array, *, derive: bool) -> PeriodEnd:
        """The end of a period of `count` steps, measured from `origin` (N,)."""
        s, state = self._sensitivity, self._state
        found = self.pack(s.q, s.v, s.a, s.w) if derive else np.zeros((0, 1))
        return PeriodEnd(
            z=self.pack(state.q, state.v, state.a, state.contact.slider) - origin,
            matrix=found[:, : self.size],
            by_parameter=found[:, -1],
            record=copied_rows(self._record, count),
            guess=np.array([state.mean_velocity, state.mean_acceleration]),
            last_step=float(state.scalars[LAST_STEP]),
        )
