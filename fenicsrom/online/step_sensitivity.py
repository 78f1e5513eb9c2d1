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
from fenicsrom.online.contact_sensitivity import LawDerivative, differentiate_law, perturb
from fenicsrom.online.contact_state import OPEN
from fenicsrom.online.dense import add_combined_rows, lu_factor, lu_solve
from fenicsrom.online.load_histories import LoadHistories, write_factors
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.polynomial import elastic_force_with
from fenicsrom.online.scheme import Scheme
from fenicsrom.online.state import LAST_STEP, State
from fenicsrom.online.step import step_coefficients
from fenicsrom.online.surfaces import Contacts, gap_discrete_gradient

BLENDING_RESOLVED = 1e-5
"""Weight of the implicit blending below which its changes are neglected.

They change a contact force by less than this part of it.
"""


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
        mean_velocity: (n, k) of the mean velocity of the last step.
        mean_acceleration: (n, k) of its growth.
        blending: (P, k) of the weight of the implicit blending.
        combined: (n, k) sum of velocities and accelerations to be multiplied by a matrix.
        before: (6, n) at the start of the step: q, v, a, mean velocity of the last step, its
            growth, and the first guess of dq.
        x0: (P, d) contact displacements there.
        w0: (P, d) sliders there.
        trial_normal_force: (P,) there.
        load_derivative: (2, n) of the load vector by the parameter, at both ends of the step.
        factors: (loads,) complex time factors of the loads.
        histories: complex load histories.
        by_start: (n, n) derivative of the mean elastic force by q0.
        by_step: (n, n) by dq.
        tangent: (n, n) tangent at a point of the step.
        vectors: (2, n) scratch.
        rows: (m, n) of the contact displacements, weighted.
        column: (d,) scratch.
        blending_vectors: (3, n) scratch.
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
    mean_velocity: Array
    mean_acceleration: Array
    blending: Array
    combined: Array
    before: Array
    x0: Array
    w0: Array
    trial_normal_force: Array
    load_derivative: Array
    factors: Array
    histories: LoadHistories
    by_start: Array
    by_step: Array
    tangent: Array
    vectors: Array
    rows: Array
    column: Array
    blending_vectors: Array
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
def keep_start(state: State, s: Sensitivity, h: float) -> None:
    """Keep the start of a step of size h that is about to be accepted."""
    ahead = 0.5 * h * (h + state.scalars[LAST_STEP])
    for i in range(state.q.size):
        s.before[3, i] = state.mean_velocity[i]
        s.before[4, i] = state.mean_acceleration[i]
        s.before[5, i] = h * state.mean_velocity[i] + ahead * state.mean_acceleration[i]
        s.before[0, i] = state.q[i]
        s.before[1, i] = state.v[i]
        s.before[2, i] = state.a[i]
    for p in range(state.contact.x.shape[0]):
        s.trial_normal_force[p] = state.contact.trial_normal_force[p]
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
    last_step: float,
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
            not s.trial_normal_force[p] > 0.0 or contacts.friction[p] == 0.0,
        )
        differentiate_blending(
            model, contacts, scheme, drift, state, s, p, behind, h, last_step, g.mass
        )
        force, row = law.force[p], p * d
        for i in range(d):
            for c in range(k):
                s.force[row + i, c] = force[i, 3 * d] * s.blending[p, c]
            s.force[row + i, last] += force[i, 3 * d + 1]
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
    advance_extrapolation(drift, h, last_step, state, s)
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
                value = by[i, 3 * d] * s.blending[p, c]
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


@kernel
def advance_extrapolation(
    drift: Drift, h: float, last_step: float, state: State, s: Sensitivity
) -> None:
    """Carry the derivatives of the mean velocity and its growth, which extrapolate, over a step."""
    n, k = s.q.shape
    last, factor = k - 1, 2.0 / (h + last_step)
    for i in range(n):
        for c in range(k):
            rate = s.dq[i, c] / h
            if c == last:
                rate -= drift.period * state.trial.dq[i] / h
            change = rate - s.mean_velocity[i, c]
            if c == last:
                change -= drift.period * (state.trial.dq[i] / h - s.before[3, i])
            s.mean_acceleration[i, c] = factor * change
            s.mean_velocity[i, c] = rate


@kernel
def differentiate_blending(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    state: State,
    s: Sensitivity,
    p: int,
    behind: complex,
    h: float,
    last_step: float,
    by_mass: complex,
) -> None:
    """Write the derivatives of the implicit blending of point p to s.blending.

    The weight is b = r^2/(1 + r^2), r = k_n n^T G n. With u = S^-1 B n the flexibility changes by

        d(n^T G n) = 2 dn^T G n - u^T dS u,

    where the last iteration gives u, and S is that of the first guess of dq (G is taken as
    symmetric, which it is without gyroscopic forces). The elastic part of
    u^T dS u needs the second derivative of the force along u. As the force is cubic,
    A u = (T(u) - T(-u))/2 and B u u = T(u) + T(-u) - 2 K give it exactly.
    """
    n, k = s.q.shape
    d = state.contact.x.shape[1]
    last, row, law = k - 1, p * d, s.law
    for c in range(k):
        s.blending[p, c] = 0.0
    weight = state.trial.scratch.blending[p]
    if not weight > BLENDING_RESOLVED:
        return
    ratio = np.sqrt(weight / (1.0 - weight))
    by_flexibility = 2.0 * ratio / (1.0 + ratio**2) ** 2 * contacts.normal_stiffness[p]
    perturb(law.contacts, p, contacts, drift.contacts, STEP)
    for i in range(d):
        law.start.x[p, i] = s.x0[p, i]
    point = law.scratch.point
    x0, bend = law.start.x[p], point.gradient_derivative
    gap_discrete_gradient(law.contacts, p, x0, x0, behind, point.gradient, bend, point.work)
    u = s.blending_vectors[0]
    for a in range(n):
        u[a] = 0.0
        for i in range(d):
            u[a] += point.gradient[i].real * model.work.block[a, 1 + row + i]
    for i in range(d):
        along = 0.0
        for a in range(n):
            along += model.contact_rows[row + i, a] * u[a]
        s.blending[p, last] += 2.0 * along * point.gradient[i].imag / STEP
        for j in range(d):
            for c in range(k):
                s.blending[p, c] += 4.0 * along * bend[i, j].real * s.x[row + j, c]
    quadratic = 0.0
    for a in range(n):
        for b in range(n):
            quadratic += by_mass.imag * u[a] * model.mass[a, b] * u[b]
    s.blending[p, last] -= quadratic / STEP
    if not scheme.linear:
        add_elastic_blending(model, drift, s, p, h, last_step)
    for c in range(k):
        s.blending[p, c] *= by_flexibility
    stiffness = drift.contacts.normal_stiffness[p] / contacts.normal_stiffness[p]
    s.blending[p, last] += 2.0 * ratio**2 / (1.0 + ratio**2) ** 2 * stiffness


@kernel
def add_elastic_blending(
    model: ReducedModel, drift: Drift, s: Sensitivity, p: int, h: float, last_step: float
) -> None:
    """Subtract the elastic part of u^T dS u from s.blending; S at the discrete gradient's guess."""
    n, k = s.q.shape
    last, work = k - 1, model.work
    u, scaled, force = s.blending_vectors[0], s.vectors[0], s.vectors[1]
    by_start, by_step = s.blending_vectors[1], s.blending_vectors[2]
    q0, guess = s.before[0], s.before[5]
    size, length = 0.0, 0.0
    for i in range(n):
        size += q0[i] ** 2
        length += u[i] ** 2
    scale = np.sqrt(max(size, 1e-12) / length)
    ahead, behind = s.by_start, s.tangent
    for sign in range(2):
        for i in range(n):
            scaled[i] = scale * u[i] if sign == 0 else -scale * u[i]
        elastic_force_with(
            model.elastic,
            work.columns,
            work.points,
            work.products,
            scaled,
            force,
            ahead if sign == 0 else behind,
        )
    # the mean over the step of s T'(q0 + s dq), and of s^2 T' for the part by dq
    for i in range(n):
        quadratic, at_start, at_step = 0.0, 0.0, 0.0
        for j in range(n):
            both = (ahead[i, j] + behind[i, j] - 2.0 * model.elastic.stiffness[i, j]) / scale**2
            quadratic += 0.5 * (ahead[i, j] - behind[i, j]) / scale * u[j]
            at_start += both * (0.5 * q0[j] + guess[j] / 3.0)
            at_step += both * (q0[j] / 3.0 + 0.25 * guess[j])
        by_start[i] = 0.5 * quadratic + at_start
        by_step[i] = quadratic / 3.0 + at_step
    growth = 0.5 * h * (h + last_step)
    for i in range(n):
        for c in range(k):
            moved = h * s.mean_velocity[i, c] + growth * s.mean_acceleration[i, c]
            s.blending[p, c] -= by_start[i] * s.q[i, c] + by_step[i] * moved
        moved = h * s.before[3, i] + 2.0 * growth * s.before[4, i]
        s.blending[p, last] -= by_step[i] * drift.period * moved
