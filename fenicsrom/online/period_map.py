"""The period map of the time stepping and its derivative (the monodromy matrix).

The map takes the start of a period to its end by the steps of `fenicsrom.online.step`. Its
variables are z = (q, v, a, w): coordinates, velocities, accelerations and the sliders of the
contact points. The discrete gradient has no accelerations. The normal component of a slider before
a plane has no meaning and is left out. The derivative of every accepted step is taken with the step
(`fenicsrom.online.step_sensitivity`), so that one march gives the end and its derivatives by z and
by one parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import borrowed, compiled, kernel
from fenicsrom.online.complex_step import STEP as COMPLEX_STEP
from fenicsrom.online.complex_step import as_complex
from fenicsrom.online.contact_sensitivity import (
    PARAMETERS,
    differentiate_rest,
    law_derivative,
)
from fenicsrom.online.contact_step import at_rest
from fenicsrom.online.dense import copy_to_points, copy_vector
from fenicsrom.online.loop import SMALLEST_STEP, write
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.scheme import Scheme
from fenicsrom.online.state import (
    ITERATIONS,
    LAST_STEP,
    STEP,
    TIME,
    Record,
    State,
    no_record,
    no_state,
)
from fenicsrom.online.step import accept, attempt, measure
from fenicsrom.online.step_sensitivity import (
    Drift,
    Sensitivity,
    keep_start,
    linearise_step,
    write_load_derivative,
)
from fenicsrom.online.surfaces import PLANE, Contacts

DONE, FULL, FAILED, SINGULAR = range(4)


@kernel
def start_derivatives(
    model: ReducedModel,
    contacts: Contacts,
    drift: Drift,
    state: State,
    s: Sensitivity,
    sliders: Array,
    memory: NDArray[np.int64],
    with_a: bool,
) -> None:
    """Set the derivatives at the start of the period, where `at_rest` has accepted the sliders."""
    n, k = s.q.shape
    points, d = state.contact.x.shape
    m = points * d
    first = 3 * n if with_a else 2 * n
    for c in range(k):
        for i in range(n):
            s.q[i, c] = 1.0 if c == i else 0.0
            s.v[i, c] = 1.0 if c == n + i else 0.0
            s.mean_velocity[i, c] = 0.0
            s.mean_acceleration[i, c] = 0.0
            s.a[i, c] = 1.0 if with_a and c == 2 * n + i else 0.0
        for r in range(m):
            s.x[r, c] = model.contact_rows[r, c] if c < n else 0.0
            s.force[r, c] = 0.0
    for c in range(memory.size):
        s.force[memory[c], first + c] = 1.0
    for p in range(points):
        differentiate_rest(s.law, contacts, drift.contacts, p, state.contact.x[p], sliders[p])
        by = s.law.slider[p]
        for i in range(d):
            for c in range(k):
                value = by[i, 3 * d + 1] if c == k - 1 else 0.0
                for j in range(d):
                    value += by[i, j] * s.x[p * d + j, c] + by[i, d + j] * s.force[p * d + j, c]
                s.w[p * d + i, c] = value
    write_load_derivative(model, s, 0j, s.load_derivative[1])


@compiled
def begin_period(  # type: ignore[no-untyped-def]
    model, contacts, scheme, time, start, sliders, memory, state, drift, s, derive
):
    """Set the state, and its derivatives, at the start of a period; arguments as `march_period`."""
    scalars = state.scalars
    for i in range(scalars.size):
        if i != LAST_STEP:
            scalars[i] = 0.0
    scalars[TIME] = time
    copy_vector(state.q, start[0])
    copy_vector(state.v, start[1])
    copy_vector(state.a, start[2])
    copy_vector(state.mean_velocity, start[3])
    copy_vector(state.mean_acceleration, start[4])
    copy_vector(state.load_vector, model.load(time))
    copy_to_points(state.contact.x, model.contact_displacement(state.q))
    state.friction_dissipation[:] = 0.0
    at_rest(contacts, state.contact.x.copy(), sliders, time, state.contact, state.trial.scratch)
    measure(model, contacts, state)
    if derive:
        start_derivatives(
            model, contacts, drift, state, s, sliders, memory, not scheme.discrete_gradient
        )


# The compiled units below are pairs: the inner function is inlined into an outer function, which
# borrows the arrays and passes them as arguments (see `fenicsrom.online.loop.compiled_march`).


def _try_step(model, contacts, scheme, state, h):  # type: ignore[no-untyped-def]
    load_ahead = model.load(state.scalars[TIME] + h)
    converged, iterations = attempt(model, contacts, scheme, state, h, load_ahead)
    state.scalars[ITERATIONS] += iterations
    return converged


_inlined_try_step = compiled(_try_step, forceinline=True)


@compiled
def try_step(model, contacts, scheme, state, h):  # type: ignore[no-untyped-def]
    """Try a step of size h, and return whether it converged."""
    return _inlined_try_step(
        borrowed(model), borrowed(contacts), borrowed(scheme), borrowed(state), h
    )


def _take_step(model, contacts, scheme, state, h, record, row):  # type: ignore[no-untyped-def]
    load_ahead = model.load(state.scalars[TIME] + h)
    accept(model, contacts, scheme, state, h, load_ahead)
    write(model, contacts, state, record, row)


_inlined_take_step = compiled(_take_step, forceinline=True)


@compiled
def take_step(model, contacts, scheme, state, h, record, row):  # type: ignore[no-untyped-def]
    """Accept the converged step of size h, and write it to a row of the record."""
    _inlined_take_step(
        borrowed(model),
        borrowed(contacts),
        borrowed(scheme),
        borrowed(state),
        h,
        borrowed(record),
        row,
    )


def march_period(model, contacts, scheme, times, state, record, drift, s, derive):  # type: ignore[no-untyped-def]
    """March from the state over the instants `times`; a step that does not converge is halved.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        times: (N + 1,) instants on which the steps land, s.
        state: the start; holds the end on return.
        record: room for the rows, one for every accepted step.
        drift: derivatives of the data by the parameter.
        s: derivatives of the state.
        derive: whether to carry the derivatives.

    Returns:
        (status, rows written).
    """
    scalars = state.scalars
    rows, k = 0, 1
    scalars[STEP] = times[1] - times[0]
    while k < times.size:
        if rows == record.time.size:
            return FULL, rows
        begin, goal = scalars[TIME], times[k]
        grid = goal - times[k - 1]
        h = min(scalars[STEP], goal - begin)
        lands = goal - begin - h <= 1e-9 * grid
        if lands:
            h = goal - begin
        if try_step(model, contacts, scheme, state, h):
            if derive:
                keep_start(state, s, h)
            last_step = scalars[LAST_STEP]
            take_step(model, contacts, scheme, state, h, record, rows)
            rows += 1
            if derive and not linearise_step(
                model, contacts, scheme, drift, state, s, begin, h, last_step
            ):
                return SINGULAR, rows
            scalars[STEP] = 2.0 * h
            if lands:
                scalars[TIME] = goal
                k += 1
                if k < times.size:
                    scalars[STEP] = times[k] - goal
        else:
            scalars[STEP] = 0.5 * h
            if not scalars[STEP] > SMALLEST_STEP * grid:
                return FAILED, rows
    return DONE, rows


_inlined_march_period = compiled(march_period, forceinline=True)


@compiled
def _compiled_march_period(  # type: ignore[no-untyped-def]
    model, contacts, scheme, times, state, record, drift, s, derive
):
    return _inlined_march_period(
        borrowed(model),
        borrowed(contacts),
        borrowed(scheme),
        times,
        borrowed(state),
        borrowed(record),
        borrowed(drift),
        borrowed(s),
        derive,
    )


def no_drift(model: ReducedModel, contacts: Contacts) -> Drift:
    """The derivatives of the data by a parameter on which nothing depends."""
    nothing = {name: np.zeros_like(getattr(contacts, name)) for name in PARAMETERS}
    return Drift(contacts._replace(**nothing), np.zeros_like(model.load_histories.sines), 0.0, 0.0)


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


class PeriodMap:
    """The period map of one model with one scheme on one grid of times."""

    def __init__(
        self,
        model: ReducedModel,
        contacts: Contacts,
        plan: Scheme,
        dimension: int,
        fractions: Array,
    ):
        """Make the arrays.

        Args:
            model: gives the sizes; values may change from call to call.
            contacts: of P points, likewise.
            plan: the weights of the scheme.
            dimension: d, of space.
            fractions: (N + 1,) instants on which the steps land, from 0 to the number of periods.
        """
        self.plan, self.fractions, self.dimension = plan, np.asarray(fractions, float), dimension
        n, points = model.size, contacts.preload.size
        self.n, self.points = n, points
        kinds = np.repeat(contacts.kind, dimension)
        axis = np.tile(np.arange(dimension), points)
        self.memory = np.flatnonzero((kinds != PLANE) | (axis > 0))
        self.blocks = 2 if plan.discrete_gradient else 3
        self.size = self.blocks * n + self.memory.size
        k, m = self.size + 1, points * dimension
        self._state = no_state(n, points, dimension)
        self._record = no_record(4 * self.fractions.size, points, dimension)
        histories = model.load_histories
        self._sensitivity = Sensitivity(
            *(np.zeros((n, k)) for _ in range(3)),
            *(np.zeros((m, k)) for _ in range(2)),
            np.zeros((n, k)),
            np.zeros((m, k)),
            np.zeros((n, k)),
            np.zeros((n, k)),
            np.zeros((points, k)),
            np.zeros((n, k)),
            np.zeros((6, n)),
            np.zeros((points, dimension)),
            np.zeros((points, dimension)),
            np.zeros(points),
            np.zeros((2, n)),
            np.zeros(histories.spans.shape[0], dtype=np.complex128),
            as_complex(histories, ("sines",)),
            *(np.zeros((n, n)) for _ in range(3)),
            np.zeros((2, n)),
            np.zeros((m, n)),
            np.zeros(dimension),
            np.zeros((3, n)),
            np.zeros(n, dtype=np.int64),
            law_derivative(contacts, points, dimension),
        )

    @property
    def state(self) -> State:
        """The state at the end of the last call; the next call overwrites it."""
        return self._state

    def pack(self, q: Array, v: Array, a: Array, sliders: Array) -> Array:
        """The variables z (N,) of coordinates, velocities, accelerations and sliders (P, d)."""
        parts = [q, v, a][: self.blocks]
        return np.concatenate([*parts, sliders.reshape(-1)[self.memory]])

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

    def __call__(
        self,
        model: ReducedModel,
        contacts: Contacts,
        period: float,
        z: Array,
        *,
        drift: Drift | None = None,
        derive: bool = True,
        guess: Array | None = None,
        last_step: float = 0.0,
    ) -> tuple[int, PeriodEnd]:
        """March over the period from z.

        Args:
            model: the model.
            contacts: parameters of the contact points.
            period: s.
            z: (N,) variables at the start.
            drift: derivatives of the data by the parameter; none if not given.
            derive: whether to find the derivatives.
            guess: (2, n) mean velocity of the step before the start and its growth; zero if not
                given.
            last_step: size of that step, s.

        Returns:
            The status (DONE, or why the march stopped) and the end.
        """
        s, state, n = self._sensitivity, self._state, self.n
        drift = no_drift(model, contacts) if drift is None else drift
        start = np.zeros((5, n))
        start[:3] = self.coordinates(z)
        if guess is not None:
            start[3:] = guess
        state.scalars[LAST_STEP] = last_step
        s.histories.sines[:] = model.load_histories.sines + 1j * COMPLEX_STEP * drift.sines
        times = period * self.fractions
        # a new factor is due where a linear model or its step has changed
        model.work.key[:] = np.nan
        plan = self.plan._replace(damping=float(model.damping))
        sliders = self.sliders(z)
        begin_period(
            model, contacts, plan, 0.0, start, sliders, self.memory, state, drift, s, derive
        )
        status, count = _compiled_march_period(
            model, contacts, plan, times, state, self._record, drift, s, derive
        )
        end = self.pack(state.q, state.v, state.a, state.contact.slider)
        rows = [*[s.q, s.v, s.a][: self.blocks], s.w[self.memory]]
        derivative = np.concatenate(rows)
        record = Record._make(array[:count].copy() for array in self._record)
        return status, PeriodEnd(
            end,
            derivative[:, :-1].copy() if derive else np.zeros((0, 0)),
            derivative[:, -1].copy() if derive else np.zeros(0),
            record,
            np.stack([state.mean_velocity, state.mean_acceleration]),
            float(state.scalars[LAST_STEP]),
        )
