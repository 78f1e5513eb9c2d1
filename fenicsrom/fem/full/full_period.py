"""The period map of the full model, and what it does to some directions.

The map is that of `fenicsrom.online.periodic.period_map` for all unknowns of the mesh: it takes the
variables z = (q, v, a, w) at the start of a period to its end, by the same steps. The full
monodromy matrix dP/dz is too large; its products with the columns of a block D are carried through
the period by the linearised step of `fenicsrom.online.derivative.period_sensitivity`,

    S d(dq) = -[df_mean/dq0 dq0 + M (inertia_v dv0 + inertia_a da0)
                + D (velocity_v dv0 + velocity_a da0) + B dF],

with the factor of S that the last iteration of the step left, and the contact terms of S by the
Woodbury formula.
"""

import copy
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.state import OPEN, ContactState, Interval
from fenicsrom.online.derivative.contact_sensitivity import (
    REST,
    contact_data,
    differentiate_law,
    law_derivative,
)
from fenicsrom.online.derivative.period_sensitivity import end_coefficients
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.period_map import PeriodVariables
from fenicsrom.online.run.march import initial_state
from fenicsrom.online.step.state import (
    LAST_STEP,
    STEP,
    TIME,
    Control,
    Record,
    Scheme,
    State,
    copied_rows,
    joined_rows,
    no_record,
)
from fenicsrom.online.step.step import FAILED, FULL, SMALLEST_STEP, march, step_coefficients


@dataclass(eq=False)
class _Columns:
    """Derivatives of the state by the columns of a block.

    Attributes:
        q: (local, k) derivatives of the coordinates.
        v: (local, k) derivatives of the velocities.
        a: (local, k) derivatives of the accelerations.
        x: (m, k) derivatives of the contact displacements.
        w: (m, k) derivatives of the sliders.
    """

    q: Array
    v: Array
    a: Array
    x: Array
    w: Array


@dataclass(frozen=True, eq=False)
class FullPeriodEnd:
    """Where a period of the full model ends.

    Attributes:
        z: (N,) variables at the end.
        columns: (N, k) dP/dz times the given block; (N, 0) without.
        record: rows of the accepted steps.
    """

    z: Array
    columns: Array
    record: Record


class FullPeriodMap(PeriodVariables):
    """The period map of a full model on vectors z (N,); each rank holds the unknowns it owns.

    The sliders are on every rank.
    """

    def __init__(self, problem: Problem, plan: Scheme, fractions: Array):
        """Keep the problem.

        Args:
            problem: of a `FullModel`.
            plan: the weights of the scheme.
            fractions: (steps + 1,) instants on which the steps land, from 0 to the number of
                periods of the loads.
        """
        model, contacts = problem.model, problem.contacts
        super().__init__(model.local, contacts, plan)
        self.problem, self.model, self.contacts, self.plan = problem, model, contacts, plan
        self.times = problem.period * np.asarray(fractions, float)
        self._law = law_derivative(self.points, self.dimension)
        data = contact_data(contacts, contacts)
        self._differentiate = partial(differentiate_law, self._law, data)
        self._guess: tuple[Array, Array, float] | None = None

    def __call__(self, z: Array, block: Array | None = None) -> FullPeriodEnd:
        """March over the period from z.

        Args:
            z: (N,) variables at the start.
            block: (N, k) directions whose derivatives are carried along; none if not given.

        Raises:
            ConvergenceError: the smallest step did not converge.
        """
        (q, v, a), sliders = self.coordinates(z), self.sliders(z)
        state = initial_state(self.problem, self.plan, q, v, sliders)
        state.a[:] = a
        if self._guess is not None:
            state.mean_velocity[:], state.mean_acceleration[:], last_step = self._guess
            state.scalars[LAST_STEP] = last_step
        columns = None if block is None else self._start(state, sliders, block)
        record = self._march(state, columns)
        last_step = float(state.scalars[LAST_STEP])
        self._guess = state.mean_velocity.copy(), state.mean_acceleration.copy(), last_step
        end = self.pack(state.q, state.v, state.a, state.contact.slider)
        moved = np.zeros((z.size, 0))
        if columns is not None:
            moved = self.pack(columns.q, columns.v, columns.a, columns.w)
        return FullPeriodEnd(end, moved, record)

    def _start(self, state: State, sliders: Array, block: Array) -> _Columns:
        """The derivatives at the start, where `at_rest` has accepted the sliders."""
        n, d = self.n, self.dimension
        a = block[2 * n : 3 * n].copy() if self.blocks == 3 else np.zeros((n, block.shape[1]))
        given = np.zeros((self.points * d, block.shape[1]))
        given[self.memory] = block[self.blocks * n :]
        x = self.model.contact_change(block[:n])
        w = np.zeros_like(given)
        for p in range(self.points):
            mine = slice(p * d, (p + 1) * d)
            here = state.contact.x[p].copy()
            self._differentiate(REST, p, here, here, sliders[p].copy(), 0j, REST.discrete_gradient)
            by = self._law.slider[p]
            by_x, by_w = by[:, :d] + by[:, d : 2 * d], by[:, 2 * d : 3 * d]
            w[mine] = by_x @ x[mine] + by_w @ given[mine]
        return _Columns(block[:n].copy(), block[n : 2 * n].copy(), a, x, w)

    def _march(self, state: State, columns: _Columns | None) -> Record:
        """March over all instants; a step that does not converge is halved.

        Raises:
            ConvergenceError: the smallest step did not converge.
        """
        times, rows, s = self.times, list[Record](), state.scalars
        control = Control(float(np.max(np.diff(times))), 0.0, 0.0, times)
        room = times.size if columns is None else 1
        row, status = no_record(room, self.points, self.dimension), FULL
        s[STEP] = times[1] - times[0]
        while status == FULL:  # with derivatives after each step
            begin, q, contact = float(s[TIME]), state.q.copy(), copy.deepcopy(state.contact)
            status, count = march(
                self.model, self.contacts, self.plan, control, state, 0.0, times[-1], row
            )
            rows.append(copied_rows(row, count))
            if count and columns is not None:
                self._linearise(state, q, contact, begin, columns)
        record = joined_rows(rows, [found.time.size for found in rows])
        if status == FAILED:
            raise ConvergenceError(
                f"a period of the full model stopped at t = {s[TIME]:.6g} s: no convergence with "
                f"the smallest step {SMALLEST_STEP * control.grid:.3g} s",
                record,
            )
        return record

    def _linearise(
        self, state: State, q: Array, before: ContactState, begin: float, columns: _Columns
    ) -> None:
        """Carry the derivatives over the step that was just accepted.

        Args:
            state: the state at its end.
            q: (local,) coordinates at its start.
            before: the contact at its start.
            begin: time of its start, s.
            columns: the derivatives.
        """
        model, plan, d = self.model, self.plan, self.dimension
        h = float(state.scalars[TIME]) - begin
        f, e = step_coefficients(plan, plan.damping, h), end_coefficients(plan, h)
        moved = model.mass_times(f.inertia_v * columns.v + f.inertia_a * columns.a)
        moved += model.elastic_by_start(q, state.q - q, plan, columns.q)
        if plan.velocity_forces:
            moved += model.velocity_times(f.velocity_v * columns.v + f.velocity_a * columns.a)
        m = self.points * d
        times: Any = complex(begin), complex(begin + h)
        step_times = Interval(*times, plan.alpha_f, plan.discrete_gradient)
        force, by_end = np.zeros((m, columns.q.shape[1])), np.zeros((m, m))
        for p in range(self.points):
            if state.trial.scratch.mode[p] == OPEN:
                continue
            ends = before.x[p], state.contact.x[p]
            blending = complex(state.trial.scratch.blending[p])
            follows = not before.trial_normal_force[p] > 0.0 or self.contacts.friction[p] == 0.0
            self._differentiate(step_times, p, *ends, before.slider[p], blending, follows)
            by, mine = self._law.force[p], slice(p * d, (p + 1) * d)
            by_x = by[:, :d] + by[:, d : 2 * d]
            force[mine] = by_x @ columns.x[mine] + by[:, 2 * d : 3 * d] @ columns.w[mine]
            by_end[mine, mine] = by[:, d : 2 * d]
        step = model.solve_with_contact(moved, force, by_end)
        v, a = columns.v, columns.a
        columns.q += step
        columns.v = e.v_dq * step + e.v_v * v + e.v_a * a
        if not plan.discrete_gradient:
            columns.a = e.a_dq * step + e.a_v * v + e.a_a * a
        x1 = model.contact_change(columns.q)
        for p in range(self.points):
            mine = slice(p * d, (p + 1) * d)
            if state.trial.scratch.mode[p] == OPEN:
                columns.w[mine] = x1[mine]
                continue
            changes = np.concatenate([columns.x[mine], x1[mine], columns.w[mine]])
            columns.w[mine] = self._law.slider[p][:, : 3 * d] @ changes
        columns.x = x1
