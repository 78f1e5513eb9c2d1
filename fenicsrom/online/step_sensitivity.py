"""Derivative of one accepted time step: what a change of its start does to its end.

The step solves R(dq; q0, v0, a0, w0, p) = 0 for dq = q1 - q0, with F the mean contact forces and
p the parameter:

    R = M (mass dq + inertia_v v0 + inertia_a a0)
        + Gamma (gyroscopic dq + velocity_v v0 + velocity_a a0)
        + f_mean(q0, dq) + B F(x0, x1, w0, p) - load

with the coefficients of `fenicsrom.online.step.StepCoefficients`. With x = B^T q and
S = mass M + gyroscopic Gamma + df_mean/d(dq) + B dF/dx1 B^T

    S d(dq) = -[df_mean/dq0 dq0 + M (inertia_v dv0 + inertia_a da0)
                + Gamma (velocity_v dv0 + velocity_a da0)
                + B (dF/dx0 + dF/dx1) dx0 + B dF/dw0 dw0 + dR/dp dp].

One factorisation of S serves all columns. The end of the step follows from dq by the formulas of
the scheme, and the sliders by the derivative of the contact law.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import kernel, part
from fenicsrom.online.complex_step import STEP
from fenicsrom.online.contact_sensitivity import LawDerivative, differentiate_law
from fenicsrom.online.contact_state import OPEN
from fenicsrom.online.dense import add_combined_rows, lu_factor, lu_solve
from fenicsrom.online.load_histories import LoadHistories, write_factors
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.polynomial import elastic_force_with
from fenicsrom.online.scheme import Scheme
from fenicsrom.online.state import State
from fenicsrom.online.step import step_coefficients
from fenicsrom.online.surfaces import Contacts


class Drift(NamedTuple):
    """Derivatives of the data of a motion by its parameter.

    Attributes:
        contacts: of the parameters of the contacts.
        sines: (s, 8) of the sines of the load histories.
        damping: of the mass-proportional damping alpha, 1/s.
        period: of the period relative to the period: every time of the motion t changes by t times
            it.
    """

    contacts: Contacts
    sines: Array
    damping: float
    period: float


class Sensitivity(NamedTuple):
    """Derivatives of the state by the k columns: start values of the period, then the parameter.

    Attributes:
        q: (n, k) of the coordinates.
        v: (n, k) of the velocities.
        a: (n, k) of the accelerations.
        x: (m, k) of the contact displacements.
        w: (m, k) of the sliders.
        dq: (n, k) of the step.
        force: (m, k) of the mean contact force without the part by the end of the step.
        combined: (n, k) sum of velocities and accelerations to be multiplied by a matrix.
        before: the state at the start of the step: q (n,), v (n,), a (n,), load (n,).
        x0: (P, d) contact displacements there.
        w0: (P, d) sliders there.
        load_derivative: (2, n) of the load vector by the parameter, at both ends of the step.
        factors: (loads,) complex time factors of the loads.
        histories: complex load histories.
        by_start: (n, n) derivative of the mean elastic force by q0.
        by_step: (n, n) by dq.
        tangent: (n, n) tangent at a point of the step.
        vectors: (2, n) scratch.
        rows: (m, n) of the contact displacements, weighted.
        column: (d,) scratch.
        pivots: (n,)
        law: derivative of the contact law.
    """

    q: Array
    v: Array
    a: Array
    x: Array
    w: Array
    dq: Array
    force: Array
    combined: Array
    before: Array
    x0: Array
    w0: Array
    load_derivative: Array
    factors: Array
    histories: LoadHistories
    by_start: Array
    by_step: Array
    tangent: Array
    vectors: Array
    rows: Array
    column: Array
    pivots: NDArray[np.int64]
    law: LawDerivative


class EndCoefficients(NamedTuple):
    """How velocity and acceleration at the end of a step depend on dq, v0 and a0."""

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
        scheme.gyroscopic,
    )


@kernel
def elastic_tangents(
    model: ReducedModel, scheme: Scheme, q0: Array, dq: Array, out: Sensitivity
) -> None:
    """Write the derivatives of the mean elastic force by q0 and by dq: by_start and by_step."""
    n, work, q, force = q0.size, model.work, out.vectors[0], out.vectors[1]
    by_start, by_step, tangent = out.by_start, out.by_step, out.tangent
    for i in range(n):
        for j in range(n):
            by_start[i, j] = 0.0
            by_step[i, j] = 0.0
    for g in range(-1, scheme.points.size):
        weight = scheme.start_weight if g < 0 else scheme.weights[g]
        if weight == 0.0:
            continue
        point = 0.0 if g < 0 else scheme.points[g]
        for i in range(n):
            q[i] = q0[i] + point * dq[i]
        elastic_force_with(
            model.elastic, work.columns, work.points, work.products, q, force, tangent
        )
        for i in range(n):
            for j in range(n):
                by_start[i, j] += weight * tangent[i, j]
                by_step[i, j] += weight * point * tangent[i, j]


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
def keep_start(state: State, s: Sensitivity) -> None:
    """Keep the start of a step that is about to be accepted."""
    for i in range(state.q.size):
        s.before[0, i] = state.q[i]
        s.before[1, i] = state.v[i]
        s.before[2, i] = state.a[i]
    for p in range(state.contact.x.shape[0]):
        for i in range(state.contact.x.shape[1]):
            s.x0[p, i] = state.contact.x[p, i]
            s.w0[p, i] = state.contact.slider[p, i]


@kernel
def linearise_step(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    state: State,
    s: Sensitivity,
    begin: float,
    h: float,
) -> bool:
    """Carry the derivatives over the step of size h that was just accepted into the state.

    Returns:
        False if the matrix of the step is singular.
    """
    n, k = s.q.shape
    points, d = state.contact.x.shape
    last = k - 1
    dq = state.trial.dq
    q0, v0, a0 = s.before[0], s.before[1], s.before[2]
    scratch, law = state.trial.scratch, s.law
    end = begin + h
    complex_h = complex(h, STEP * h * drift.period)
    ahead = complex(end, STEP * end * drift.period)
    behind = complex(begin, STEP * begin * drift.period)
    f = step_coefficients(scheme, h)
    g = step_coefficients(
        with_damping(scheme, complex(scheme.damping, STEP * drift.damping)), complex_h
    )
    # structure
    elastic_tangents(model, scheme, q0, dq, s)
    with_a = not scheme.discrete_gradient
    matrix, right = s.by_step, s.dq
    for i in range(n):
        for c in range(k):
            right[i, c] = 0.0
            s.combined[i, c] = f.inertia_v * s.v[i, c]
        if with_a:
            for c in range(k):
                s.combined[i, c] += f.inertia_a * s.a[i, c]
        s.combined[i, last] += (
            g.inertia_v.imag * v0[i] + g.inertia_a.imag * a0[i] + g.mass.imag * dq[i]
        ) / STEP
        for j in range(n):
            matrix[i, j] += f.mass * model.mass[i, j]
    add_combined_rows(model.mass, s.combined, right)
    add_combined_rows(s.by_start, s.q, right)
    if scheme.gyroscopic:
        for i in range(n):
            for c in range(k):
                s.combined[i, c] = f.velocity_v * s.v[i, c]
            if with_a:
                for c in range(k):
                    s.combined[i, c] += f.velocity_a * s.a[i, c]
            s.combined[i, last] += (
                g.velocity_v.imag * v0[i] + g.velocity_a.imag * a0[i] + g.gyroscopic.imag * dq[i]
            ) / STEP
            for j in range(n):
                matrix[i, j] += f.gyroscopic * model.gyroscopic_matrix[i, j]
        add_combined_rows(model.gyroscopic_matrix, s.combined, right)
    for i in range(n):
        s.load_derivative[0, i] = s.load_derivative[1, i]
    write_load_derivative(model, s, ahead, s.load_derivative[1])
    for i in range(n):
        load_start, load_end = s.load_derivative[0, i], s.load_derivative[1, i]
        right[i, last] -= scheme.alpha_f * load_start + (1.0 - scheme.alpha_f) * load_end
    # contact
    for p in range(points):
        if scratch.mode[p] == OPEN:
            continue
        differentiate_law(
            law,
            contacts,
            drift.contacts,
            behind,
            ahead,
            scheme.alpha_f,
            scheme.discrete_gradient,
            p,
            s.x0[p],
            state.contact.x[p],
            s.w0[p],
            scratch.blending[p],
        )
        force, row = law.force[p], p * d
        for i in range(d):
            for c in range(k):
                s.force[row + i, c] = 0.0
            s.force[row + i, last] = force[i, 3 * d + 1]
            for j in range(d):
                by_x, by_w = force[i, j] + force[i, d + j], force[i, 2 * d + j]
                for c in range(k):
                    s.force[row + i, c] += by_x * s.x[row + j, c] + by_w * s.w[row + j, c]
            for b in range(n):
                s.rows[row + i, b] = 0.0
                for j in range(d):
                    s.rows[row + i, b] += force[i, d + j] * model.contact_rows[row + j, b]
        for i in range(d):
            for a in range(n):
                factor = model.contact_rows[row + i, a]
                if factor == 0.0:
                    continue
                for b in range(n):
                    matrix[a, b] += factor * s.rows[row + i, b]
                for c in range(k):
                    right[a, c] += factor * s.force[row + i, c]
    for i in range(n):
        for c in range(k):
            right[i, c] = -right[i, c]
    if not lu_factor(matrix, s.pivots, n):
        return False
    lu_solve(matrix, s.pivots, right, n)
    advance_derivatives(scheme, h, complex_h, state, s)
    advance_sliders(model, state, s)
    return True


@kernel
def advance_derivatives(
    scheme: Scheme, h: float, complex_h: complex, state: State, s: Sensitivity
) -> None:
    """Add the step to the derivatives of coordinates, velocities and accelerations."""
    f, g = end_coefficients(scheme, h), end_coefficients(scheme, complex_h)
    n, k = s.q.shape
    last, dq, v0, a0 = k - 1, state.trial.dq, s.before[1], s.before[2]
    for i in range(n):
        for c in range(k):
            s.q[i, c] += s.dq[i, c]
        if scheme.discrete_gradient:
            for c in range(k):
                s.v[i, c] = f.v_dq * s.dq[i, c] + f.v_v * s.v[i, c]
        else:
            for c in range(k):
                v, a = s.v[i, c], s.a[i, c]
                s.v[i, c] = f.v_dq * s.dq[i, c] + f.v_v * v + f.v_a * a
                s.a[i, c] = f.a_dq * s.dq[i, c] + f.a_v * v + f.a_a * a
            s.a[i, last] += (g.a_dq.imag * dq[i] + g.a_v.imag * v0[i] + g.a_a.imag * a0[i]) / STEP
        s.v[i, last] += (g.v_dq.imag * dq[i] + g.v_v.imag * v0[i] + g.v_a.imag * a0[i]) / STEP


@kernel
def advance_sliders(model: ReducedModel, state: State, s: Sensitivity) -> None:
    """Carry the derivatives of the sliders and of the contact displacements over the step.

    A point that is open all the time forgets its slider, which follows the point.
    """
    k = s.q.shape[1]
    points, d = state.contact.x.shape
    last, x1 = k - 1, s.force
    for r in range(points * d):
        for c in range(k):
            x1[r, c] = 0.0
    add_combined_rows(model.contact_rows, s.q, x1)
    for p in range(points):
        row = p * d
        if state.trial.scratch.mode[p] == OPEN:
            for i in range(d):
                for c in range(k):
                    s.w[row + i, c] = x1[row + i, c]
            continue
        by = s.law.slider[p]
        for c in range(k):
            for i in range(d):
                value = 0.0
                for j in range(d):
                    value += (
                        by[i, j] * s.x[row + j, c]
                        + by[i, d + j] * x1[row + j, c]
                        + by[i, 2 * d + j] * s.w[row + j, c]
                    )
                s.column[i] = value
            for i in range(d):
                s.w[row + i, c] = s.column[i]
        for i in range(d):
            s.w[row + i, last] += by[i, 3 * d + 1]
    for r in range(points * d):
        for c in range(k):
            s.x[r, c] = x1[r, c]
