"""Derivatives carried over the recorded steps of a period.

The march records the accepted steps. The sliders, which the derivative of a step needs too, follow
from the contact law. No type depends on the dimension of space, so one compilation serves all
models.

Derivative of one accepted time step: what a change of its start does to its end.

The step solves R(dq; q0, v0, a0, w0, p) = 0 for dq = q1 - q0, with F the mean contact forces and
p the parameter:

    R = M (mass dq + inertia_v v0 + inertia_a a0)
        + D (velocity_dq dq + velocity_v v0 + velocity_a a0)
        + f_mean(q0, dq) + B F(x0, x1, w0, p) - load

with the coefficients of `fenicsrom.online.step.step.StepCoefficients`. With x = B^T q and
S = mass M + velocity_dq D + df_mean/d(dq) + B dF/dx1 B^T

    S d(dq) = -[df_mean/dq0 dq0 + M (inertia_v dv0 + inertia_a da0)
                + D (velocity_v dv0 + velocity_a da0)
                + B (dF/dx0 + dF/dx1) dx0 + B dF/dw0 dw0 + dR/dp dp].

One factorisation of S serves all columns. The end of the step follows from dq by the formulas of
the scheme, and the sliders by the derivative of the contact law.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.problem import list_candidates
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.derivative.contact_sensitivity import (
    ComplexInterval,
    Drift,
    Sensitivity,
    differentiate_law,
)
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.dense import (
    STEP,
    add_combined_columns,
    add_combined_rows,
    lu_factor,
    lu_solve,
)
from fenicsrom.online.model.loads import write_factors, write_pressure
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import write_tangents
from fenicsrom.online.step.state import Record, Scheme
from fenicsrom.online.step.step import step_coefficients

BLENDING_RESOLVED = 1e-5
"""Weight of the implicit blending below which its changes are neglected.

They change a contact force by less than this part of it.
"""


class EndCoefficients(NamedTuple):
    """How velocity and acceleration at the end of a step depend on dq, v0 and a0.

    `online.step.step.accept` has the same factors, written out: there they are part of the
    compiled loop, whose machine code is not to depend on that of the derivatives.
    """

    v_dq: float
    v_v: float
    v_a: float
    a_dq: float
    a_v: float
    a_a: float


@part
def end_coefficients(scheme: Scheme, h: float) -> EndCoefficients:
    """The factors of a step of size h, real or complex."""
    beta, gamma = scheme.beta, scheme.gamma
    return EndCoefficients(
        gamma / (beta * h),
        1.0 - gamma / beta + 0.0 * h,
        h * (1.0 - 0.5 * gamma / beta),
        1.0 / (beta * h * h),
        -1.0 / (beta * h),
        1.0 - 0.5 / beta + 0.0 * h,
    )


@part
def with_damping(scheme: Scheme, damping: complex) -> Scheme:
    """The scheme with another damping, which may be complex."""
    return Scheme(
        scheme.alpha_m,
        scheme.alpha_f,
        scheme.beta,
        scheme.gamma,
        scheme.discrete_gradient,
        scheme.start_weight,
        scheme.points,
        scheme.weights,
        damping,
        scheme.linear,
        scheme.velocity_forces,
        scheme.quadratic,
        scheme.all_points,
    )


@kernel
def elastic_tangents(model: ReducedModel, scheme: Scheme, s: Sensitivity) -> None:
    """Write the derivatives of the mean elastic force by q0 and by dq: by_start and by_step."""
    q0, dq, elastic, work, shares = s.before[0], s.step, model.elastic, model.work, s.shares
    n, count = q0.size, 0
    for g in range(-1, scheme.points.size):
        weight = scheme.start_weight if g < 0 else scheme.weights[g]
        if weight == 0.0:
            continue
        point = 0.0 if g < 0 else scheme.points[g]
        shares[0, count], shares[1, count] = weight, weight * point
        for i in range(n):
            work.points[count, i] = q0[i] + point * dq[i]
        count += 1
    q = work.points[:count]
    write_tangents(elastic, work.columns, q, work.products, shares, s.by_start, s.by_step)


@kernel
def add_pressure(
    model: ReducedModel, scheme: Scheme, behind: complex, ahead: complex, s: Sensitivity
) -> None:
    """Add the follower pressures to by_start, by_step and the right-hand side of a step."""
    q0, dq, pressure, work = s.before[0], s.step, model.pressure, model.work
    n, last = q0.size, s.q.shape[1] - 1
    q, force, tangent = s.vectors[0], s.vectors[1], s.tangents[0]
    start, end = s.pressure_factors[0], s.pressure_factors[1]
    write_factors(s.histories, behind, start)
    write_factors(s.histories, ahead, end)
    for k in range(pressure.numbers.size):
        number = pressure.numbers[k]
        work.pressure_factors[0, k] = start[number].real
        work.pressure_factors[1, k] = end[number].real
        for g in range(-1, scheme.points.size):
            weight = scheme.start_weight if g < 0 else scheme.weights[g]
            if weight == 0.0:
                continue
            point = 0.0 if g < 0 else scheme.points[g]
            factor = weight * ((1.0 - point) * start[number] + point * end[number])
            for i in range(n):
                q[i] = q0[i] + point * dq[i]
            write_pressure(pressure, k, q, force, tangent)
            for i in range(n):
                s.dq[i, last] -= factor.imag / STEP * force[i]
                for j in range(n):
                    s.by_start[i, j] -= factor.real * tangent[i, j]
                    s.by_step[i, j] -= factor.real * point * tangent[i, j]


@part
def share_of_step(scheme: Scheme) -> float:
    """The factor of a constant stiffness in the derivative of the mean elastic force by dq."""
    found = 0.0
    for g in range(scheme.points.size):
        found += scheme.weights[g] * scheme.points[g]
    return found


@kernel
def add_changed_forces(
    scheme: Scheme, drift: Drift, by_dq: float, by_v: float, by_a: float, s: Sensitivity
) -> None:
    """Add the changes of the elastic force and of D by the parameter to the right-hand side.

    Args:
        scheme: the weights of the scheme; those of the elastic force add up to 1.
        drift: the changes.
        by_dq: factor of D dq.
        by_v: factor of D v0.
        by_a: factor of D a0.
        s: the step.
    """
    n, last, share = s.step.size, s.q.shape[1] - 1, share_of_step(scheme)
    q0, v0, a0 = s.before[0], s.before[1], s.before[2]
    for i in range(n):
        value = drift.force[i]
        for j in range(n):
            value += drift.stiffness[i, j] * (q0[j] + share * s.step[j])
        if scheme.velocity_forces:
            for j in range(n):
                mean = by_dq * s.step[j] + by_v * v0[j] + by_a * a0[j]
                value += drift.velocity[i, j] * mean
        s.dq[i, last] += value


@kernel
def write_load_derivative(model: ReducedModel, s: Sensitivity, time: complex, out: Array) -> None:
    """Write the derivative (n,) of the load vector by the parameter at a time."""
    write_factors(s.histories, time, s.factors)
    for i in range(out.size):
        value = 0.0
        for k in range(s.factors.size):
            value += model.loads[i, k] * s.factors[k].imag
        out[i] = value / STEP


@kernel
def add_term(
    matrix: Array, by_dq: complex, by_v: complex, by_a: complex, with_a: bool, s: Sensitivity
) -> None:
    """Add matrix (by_dq dq + by_v v0 + by_a a0) to S and to the right-hand side.

    The imaginary parts of the factors are `STEP` times their derivatives by the parameter.
    """
    n, k = s.q.shape
    last, v0, a0 = k - 1, s.before[1], s.before[2]
    for i in range(n):
        for c in range(k):
            s.combined[i, c] = by_v.real * s.v[i, c]
        if with_a:
            for c in range(k):
                s.combined[i, c] += by_a.real * s.a[i, c]
        s.combined[i, last] += (
            by_v.imag * v0[i] + by_a.imag * a0[i] + by_dq.imag * s.step[i]
        ) / STEP
        for j in range(n):
            s.by_step[i, j] += by_dq.real * matrix[i, j]
    add_combined_rows(matrix, s.combined, s.dq)


@kernel
def add_structure(
    model: ReducedModel,
    scheme: Scheme,
    drift: Drift,
    h: complex,
    behind: complex,
    ahead: complex,
    s: Sensitivity,
) -> None:
    """Write S and the right-hand side of a step of size h, without the contact.

    Args:
        model: the model.
        scheme: the weights of the scheme.
        drift: derivatives of the data by the parameter.
        h: s.
        behind: start of the step, s.
        ahead: end of the step, s.
        s: in: the step; out: S and the right-hand side.
    """
    n, k = s.q.shape
    damping = complex(scheme.damping, STEP * drift.damping)
    g, with_a = step_coefficients(with_damping(scheme, damping), h), not scheme.discrete_gradient
    elastic_tangents(model, scheme, s)
    for i in range(n):
        for c in range(k):
            s.dq[i, c] = 0.0
        for c in range(s.contact.shape[1]):
            s.contact[i, c] = 0.0
    if model.pressure.numbers.shape[0] > 0:
        add_pressure(model, scheme, behind, ahead, s)
    add_term(model.mass, g.mass, g.inertia_v, g.inertia_a, with_a, s)
    if scheme.velocity_forces:
        add_term(
            model.velocity_matrix,
            g.velocity_dq,
            complex(g.velocity_v),
            g.velocity_a,
            with_a,
            s,
        )
    if drift.force.shape[0] > 0:
        by_v, by_a = g.velocity_v, g.velocity_a.real if with_a else 0.0
        add_changed_forces(scheme, drift, g.velocity_dq.real, by_v, by_a, s)
    for i in range(n):
        s.load_derivative[0, i] = s.load_derivative[1, i]
    write_load_derivative(model, s, ahead, s.load_derivative[1])
    for i in range(n):
        start, end = s.load_derivative[0, i], s.load_derivative[1, i]
        s.dq[i, k - 1] -= scheme.alpha_f * start + (1.0 - scheme.alpha_f) * end


@kernel
def write_law(model: ReducedModel, by: Array, p: int, s: Sensitivity) -> None:
    """Write what a force or a slider of point p takes from q0, dq and the columns to s.law_rows.

    Args:
        model: the model.
        by: (d, 3 d + 1) `s.law.force[p]` or `s.law.slider[p]`.
        p: the point.
        s: the arrays.
    """
    n, k = s.q.shape
    d = s.x0.shape[1]
    for i in range(d):
        by_start, by_step = s.law_rows[i, :n], s.law_rows[i, n : 2 * n]
        columns = s.law_rows[i, 2 * n :]
        for a in range(n):
            by_start[a], by_step[a] = 0.0, 0.0
        for c in range(k):
            columns[c] = 0.0
        columns[k - 1] = by[i, 3 * d]
        for j in range(d):
            row = model.contact_rows[p * d + j]
            in_step, by_slider = by[i, d + j], by[i, 2 * d + j]
            at_start = by[i, j] + in_step
            for a in range(n):
                by_start[a] += at_start * row[a]
                by_step[a] += in_step * row[a]
            if by_slider != 0.0:
                for c in range(k):
                    columns[c] += by_slider * s.w[p * d + j, c]


@kernel
def add_contact(model: ReducedModel, s: Sensitivity, p: int) -> None:
    """Add the mean contact force of point p to s.contact."""
    d = s.x0.shape[1]
    write_law(model, s.law.force[p], p, s)
    add_combined_columns(model.contact_rows[p * d : (p + 1) * d], s.law_rows, s.contact)


@kernel
def solve_step(s: Sensitivity) -> bool:
    """Solve S d(dq) = -(s.by_start s.q + s.dq) with s.contact, in place; False if S is singular."""
    n, k = s.q.shape
    for i in range(n):
        by_start, by_step, columns = (
            s.contact[i, :n],
            s.contact[i, n : 2 * n],
            s.contact[i, 2 * n :],
        )
        for j in range(n):
            s.by_start[i, j] += by_start[j]
            s.by_step[i, j] += by_step[j]
        for c in range(k):
            s.dq[i, c] += columns[c]
    add_combined_rows(s.by_start, s.q, s.dq)
    for i in range(n):
        for c in range(k):
            s.dq[i, c] = -s.dq[i, c]
    if not lu_factor(s.by_step, s.pivots, n):
        return False
    lu_solve(s.by_step, s.pivots, s.dq, n, k)
    return True


@kernel
def advance_derivatives(scheme: Scheme, h: complex, s: Sensitivity) -> None:
    """Add the step to the derivatives of coordinates, velocities and accelerations."""
    g = end_coefficients(scheme, h)
    n, k = s.q.shape
    last, dq, v0, a0 = k - 1, s.step, s.before[1], s.before[2]
    for i in range(n):
        for c in range(k):
            s.q[i, c] += s.dq[i, c]
        if scheme.discrete_gradient:
            for c in range(k):
                s.v[i, c] = g.v_dq.real * s.dq[i, c] + g.v_v.real * s.v[i, c]
        else:
            for c in range(k):
                v, a = s.v[i, c], s.a[i, c]
                s.v[i, c] = g.v_dq.real * s.dq[i, c] + g.v_v.real * v + g.v_a.real * a
                s.a[i, c] = g.a_dq.real * s.dq[i, c] + g.a_v.real * v + g.a_a.real * a
            s.a[i, last] += (g.a_dq.imag * dq[i] + g.a_v.imag * v0[i] + g.a_a.imag * a0[i]) / STEP
        s.v[i, last] += (g.v_dq.imag * dq[i] + g.v_v.imag * v0[i] + g.v_a.imag * a0[i]) / STEP


@kernel
def advance_slider(model: ReducedModel, s: Sensitivity, p: int) -> None:
    """Carry the derivatives of the slider of a point that touches over the step of `s.dq`."""
    n, k = s.q.shape
    d = s.x0.shape[1]
    write_law(model, s.law.slider[p], p, s)
    for i in range(d):
        columns = s.law_rows[i, 2 * n :]
        for a in range(n):
            at_start, in_step = s.law_rows[i, a], s.law_rows[i, n + a]
            for c in range(k):
                columns[c] += at_start * s.q[a, c] + in_step * s.dq[a, c]
    for i in range(d):
        columns = s.law_rows[i, 2 * n :]
        for c in range(k):
            s.w[p * d + i, c] = columns[c]


@kernel
def let_slider_follow(model: ReducedModel, s: Sensitivity, p: int) -> None:
    """Write the derivatives of the displacement of point p, which is open, to its slider."""
    d = s.x0.shape[1]
    slider = s.w[p * d : (p + 1) * d]
    for i in range(d):
        for c in range(slider.shape[1]):
            slider[i, c] = 0.0
    add_combined_rows(model.contact_rows[p * d : (p + 1) * d], s.q, slider)


@kernel
def differentiate_blending(
    model: ReducedModel, contacts: Contacts, drift: Drift, h: float, s: Sensitivity
) -> None:
    """Write the derivatives of the weights b = r^2/(1 + r^2) in steps of size h to s.blending.

    With u = S^-1 b the flexibility b^T u of `ReducedModel.write_normal_flexibility` changes by
    -u^T dS u. The changes of weights below `BLENDING_RESOLVED` are neglected.
    """
    n, unit, by_mass = model.mass.shape[0], model.work.compliance.unit, 4.0 / h**2 * drift.period
    model.write_normal_flexibility(h, s.blending)
    for p in range(s.blending.size):
        flexibility, stiffness = s.blending[p], contacts.normal_stiffness[p]
        ratio, change = stiffness * flexibility, drift.contacts.normal_stiffness[p] * flexibility
        s.blending[p] = 0.0
        if not ratio**2 > BLENDING_RESOLVED:
            continue
        for i in range(n):
            for j in range(n):
                by_parameter = by_mass * model.mass[i, j]
                if drift.force.shape[0] > 0:
                    by_parameter -= 0.5 * drift.stiffness[i, j]
                change += stiffness * unit[i, p] * by_parameter * unit[j, p]
        s.blending[p] = 2.0 * ratio / (1.0 + ratio**2) ** 2 * change


REST = ComplexInterval(0j, 0j, 0.0, False)
"""The step of zero length in which the points are at rest."""
SAME_STEP = 1e-9  # relative difference of two steps of one size, which is rounding


@kernel
def start_derivatives(
    model: ReducedModel, s: Sensitivity, memory: NDArray[np.int64], with_a: bool
) -> None:
    """Set the derivatives at the start of the period.

    Args:
        model: the model.
        s: in: the derivative of the law of the points at rest; out: the derivatives.
        memory: slider components that are variables of the period.
        with_a: whether the accelerations are variables.
    """
    n, k = s.q.shape
    points, d = s.x0.shape
    first = 3 * n if with_a else 2 * n
    for c in range(k):
        for i in range(n):
            s.q[i, c] = 1.0 if c == i else 0.0
            s.v[i, c] = 1.0 if c == n + i else 0.0
            s.a[i, c] = 1.0 if with_a and c == 2 * n + i else 0.0
            s.dq[i, c] = 0.0
        for r in range(points * d):
            s.w[r, c] = 0.0
    for c in range(memory.size):
        s.w[memory[c], first + c] = 1.0
    for p in range(points):
        advance_slider(model, s, p)
    write_load_derivative(model, s, 0j, s.load_derivative[1])


@kernel
def begin_step(record: Record, row: int, s: Sensitivity) -> int:
    """Write the step of a row of the record into s.

    Returns:
        The number of points that touch in it; they are the candidates of `s.law.scratch`.
    """
    for i in range(s.step.size):
        s.step[i] = record.coordinates[row, i] - s.before[0, i]
    for p in range(s.is_open.size):
        s.is_open[p] = True
        for i in range(s.x1.shape[1]):
            s.x1[p, i] = record.displacement[row, p, i]
            if record.mean_force[row, p, i] != 0.0:
                s.is_open[p] = False
        s.law.scratch.is_candidate[p] = not s.is_open[p]
    return list_candidates(s.law.scratch)


@kernel
def end_step(record: Record, row: int, s: Sensitivity) -> None:
    """Write the end of the step of a row of the record as the start of the next one."""
    n = s.step.size
    for i in range(n):
        for k in range(3):
            s.before[k, i] = record.coordinates[row, k * n + i]
    for p in range(s.is_open.size):
        s.normal_force[p] = record.force[row, p, 0]
        for i in range(s.x0.shape[1]):
            s.x0[p, i] = s.x1[p, i]
            s.w0[p, i] = s.x1[p, i] if s.is_open[p] else s.law.end.slider[p, i].real


@kernel
def carry_derivatives(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    record: Record,
    first: int,
    last: int,
    rows: int,
    rest: ComplexInterval,
    sliders: Array,
    memory: NDArray[np.int64],
    s: Sensitivity,
) -> bool:
    """Carry the derivatives in s over some of the steps of a recorded period.

    The steps from 0 to `rows` make the period. They may be split among several calls, so that a
    caller can be interrupted.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        drift: derivatives of the data by the parameter.
        record: of the accepted steps, with coordinates, from time 0.
        first: number of the first step to carry the derivatives over.
        last: number of the step before which this call ends.
        rows: number of the steps of the period.
        rest: `REST`, as an argument because numba compiles the contact law once more for constants.
        sliders: (P, d) the variables of the period, m.
        memory: which components of them are variables.
        s: in: `before`, `x0`, `w0` and `normal_force` at the start, or what the last call left;
            out: the derivatives.

    Returns:
        False if the matrix of a step is singular.
    """
    law, points, by, blended = s.law, s.is_open.size, drift.contacts, 0.0
    if first == 0:
        for p in range(points):
            x, w = s.x0[p], sliders[p]
            differentiate_law(law, contacts, by, rest, p, x, x, w, 0j, rest.discrete_gradient)
        start_derivatives(model, s, memory, not scheme.discrete_gradient)
    begin = record.time[first - 1] if first > 0 else 0.0
    for row in range(first, last):
        h = record.time[row] - begin
        times = complex(1.0, STEP * drift.period)
        behind, ahead, moved = begin * times, record.time[row] * times, h * times
        step = ComplexInterval(behind, ahead, scheme.alpha_f, scheme.discrete_gradient)
        if scheme.discrete_gradient and points > 0 and abs(h - blended) > SAME_STEP * h:
            differentiate_blending(model, contacts, drift, h, s)
            blended = h
        touching = law.scratch.candidates[: begin_step(record, row, s)]
        add_structure(model, scheme, drift, moved, behind, ahead, s)
        for p in touching:
            follows = not s.normal_force[p] > 0.0 or contacts.friction[p] == 0.0
            x0, x1, w0 = s.x0[p], s.x1[p], s.w0[p]
            weight = complex(record.blending[row, p], STEP * s.blending[p])
            s.rests[p] = differentiate_law(law, contacts, by, step, p, x0, x1, w0, weight, follows)
            add_contact(model, s, p)
        if not solve_step(s):
            return False
        for p in touching:
            if not s.rests[p]:
                advance_slider(model, s, p)
        advance_derivatives(scheme, moved, s)
        end_step(record, row, s)
        begin = record.time[row]
    for p in range(points):
        if last == rows and s.is_open[p]:
            let_slider_follow(model, s, p)
    return True
