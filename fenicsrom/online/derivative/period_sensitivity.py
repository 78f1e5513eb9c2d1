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

The parameter p is any number of a problem: the data of the problem at p + i h, with h = `STEP`,
hold the derivatives of all numbers that depend on it, and dR/dp is the imaginary part of R / h.
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.state import Interval
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.derivative.contact_sensitivity import (
    ContactData,
    LawDerivative,
    contact_data,
    differentiate_law,
)
from fenicsrom.online.kernels.compilation import compiled, kernel, part
from fenicsrom.online.kernels.dense import copy_vector, lu_factor, lu_solve
from fenicsrom.online.kernels.numbers import STEP, as_complex
from fenicsrom.online.model.loads import LoadHistories, write_factors, write_pressure
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.polynomial import write_tangents
from fenicsrom.online.step.state import Record, Scheme
from fenicsrom.online.step.step import step_coefficients

BLENDING_RESOLVED = 1e-5
"""Weight of the implicit blending below which its changes are neglected.

They change a contact force by less than this part of it.
"""
SAME_STEP = 1e-9  # relative difference of two steps of one size, which is rounding
MODES = "it changes the mesh or the modes, which need a new model for each value"


class Drift(NamedTuple):
    """The data of a motion, with their derivatives by its parameter.

    Attributes:
        contacts: of the contacts.
        histories: the load histories at p + i `STEP`.
        damping: derivative of the mass-proportional damping alpha, 1/s.
        period: that of the period relative to the period: every time of the motion t changes by t
            times it.
        force: (n,) that of the elastic force at q = 0; no size if the elastic force stays as it is.
        stiffness: (n, n) that of its tangent, which is the same at all q; no size likewise.
        velocity: (n, n) that of D; no size likewise.
        rest: (n,) that of `Problem.rest`; no size if it stays.
    """

    contacts: ContactData
    histories: LoadHistories
    damping: float
    period: float
    force: Array
    stiffness: Array
    velocity: Array
    rest: Array


def drift_of(problem: Problem) -> Drift:
    """The data of a problem, with their derivatives by its parameter from `Problem.varied`.

    Raises:
        ValueError: a number of the model depends on the parameter that belongs to its basis.
    """
    varied = problem if problem.varied is None else problem.varied
    model, at = problem.model, varied.model
    for name in ("mass", "loads", "contact_rows", "contact_offset", "probe", "probe_offset"):
        if np.iscomplexobj(getattr(at, name)):
            raise ValueError(f"the parameter of a curve must not change the {name}: {MODES}")
    for name in ("quadratic", "cubic"):
        if np.iscomplexobj(getattr(at.elastic, name)):
            raise ValueError(f"the parameter of a curve must not change the {name} force: {MODES}")
    n, relative = model.size, float(_by(varied.period)) / problem.period
    force, stiffness = _by(at.elastic.force), _by(at.elastic.stiffness)
    velocity = _by(at.velocity_matrix) if at.velocity_matrix.size else np.zeros((n, n))
    rest = np.zeros(0) if varied.rest is None else _by(varied.rest)
    if not (force.any() or stiffness.any() or velocity.any()):
        force, stiffness, velocity = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    contacts = contact_data(problem.contacts, varied.contacts, retimed=relative != 0.0)
    histories, damping = as_complex(at.load_histories), float(_by(at.damping))
    return Drift(contacts, histories, damping, relative, force, stiffness, velocity, rest)


def _by(number: Any) -> Any:
    """The derivative of a number, or an array of numbers, at p + i `STEP`."""
    return np.imag(number) / STEP


class Sensitivity(NamedTuple):
    """Derivatives of the state by the k columns: start values of the period, then the parameter.

    Attributes:
        q: (n, k) of the coordinates.
        v: (n, k) of the velocities.
        a: (n, k) of the accelerations.
        w: (m, k) of the sliders of the points that touch.
        before: (3, n) at the start of the step: q, v, a.
        x0: (P, d) contact displacements at the start of the step.
        w0: (P, d) sliders at its start.
        normal_force: (P,) at its start, N.
        is_open: (P,) whether a point is open during the whole step.
        touching: (P,) the points that touch in the step come first.
        rests: (P,) whether its slider rests, as it sticks to a plane during the whole step.
        blending: (P,) derivatives of the weights of the implicit blending by the parameter.
        load: (n,) that of the load vector at the start of the step.
        rows: (m, n) the contact rows of the points that touch.
        by_start: (m, n) derivative of their forces, or sliders, by q0.
        by_step: (m, n) that by dq.
        by_rest: (m, k) the rest of it.
        pivots: (n,)
        law: derivative of the contact law.
    """

    q: Annotated[Array, "n k"]
    v: Annotated[Array, "n k"]
    a: Annotated[Array, "n k"]
    w: Annotated[Array, "m k"]
    before: Annotated[Array, "3 n"]
    x0: Annotated[Array, "P d"]
    w0: Annotated[Array, "P d"]
    normal_force: Annotated[Array, "P"]
    is_open: Annotated[NDArray[np.bool_], "P"]
    touching: Annotated[NDArray[np.int64], "P"]
    rests: Annotated[NDArray[np.bool_], "P"]
    blending: Annotated[Array, "P"]
    load: Annotated[Array, "n"]
    rows: Annotated[Array, "m n"]
    by_start: Annotated[Array, "m n"]
    by_step: Annotated[Array, "m n"]
    by_rest: Annotated[Array, "m k"]
    pivots: Annotated[NDArray[np.int64], "n"]
    law: LawDerivative


def no_sensitivity(n: int, columns: int, points: int, d: int) -> Sensitivity:
    """A `Sensitivity` of zeros, of n coordinates and P points in d dimensions, k columns."""
    return zeros(Sensitivity, n=n, k=columns, P=points, d=d, m=points * d, columns=3 * d + 1)


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
def add_to_last(out: Array, column: Array) -> None:
    """Add a column (n,) to the last one of an array (n, k)."""
    for i in range(column.size):
        out[i, out.shape[1] - 1] += column[i]


@compiled
def combined(by_dq: complex, by_v: complex, by_a: complex, dq: Array, s: Sensitivity) -> Array:
    """The derivative (n, k) of by_dq dq + by_v v0 + by_a a0 at fixed dq.

    The imaginary parts of the factors are `STEP` times their derivatives by the parameter.

    Args:
        by_dq: factor.
        by_v: factor.
        by_a: factor.
        dq: (n,) the step.
        s: the derivatives of v0 and a0.
    """
    found = by_v.real * s.v
    if by_a != 0.0:
        found += by_a.real * s.a
    moved = by_dq.imag * dq + by_v.imag * s.before[1] + by_a.imag * s.before[2]
    add_to_last(found, moved / STEP)
    return found


@compiled
def elastic_tangents(
    model: ReducedModel, scheme: Scheme, q0: Array, dq: Array
) -> tuple[Array, Array]:
    """The derivatives (n, n) of the mean elastic force by q0 and by dq."""
    elastic, work, shares, count = model.elastic, model.work, np.zeros((2, 2)), 0
    found = np.empty((2, q0.size, q0.size))
    for g in range(-1, scheme.points.size):
        weight = scheme.start_weight if g < 0 else scheme.weights[g]
        if weight == 0.0:
            continue
        point = 0.0 if g < 0 else scheme.points[g]
        shares[0, count], shares[1, count] = weight, weight * point
        copy_vector(work.points[count], q0 + point * dq)
        count += 1
    q = work.points[:count]
    write_tangents(elastic, work.columns, q, work.products, shares, found[0], found[1])
    return found[0], found[1]


@compiled
def add_pressure(
    model: ReducedModel,
    scheme: Scheme,
    drift: Drift,
    behind: complex,
    ahead: complex,
    q0: Array,
    dq: Array,
    by_start: Array,
    by_step: Array,
) -> Array:
    """Add the follower pressures to by_start and by_step; returns their part (n,) of dR/dp."""
    pressure, histories, n = model.pressure, drift.histories, q0.size
    start = np.zeros(histories.spans.shape[0], dtype=np.complex128)
    end = start.copy()
    force, tangent, found = np.empty(n), np.empty((n, n)), np.zeros(n)
    write_factors(histories, behind, start)
    write_factors(histories, ahead, end)
    for k in range(pressure.numbers.size):
        number = pressure.numbers[k]
        for g in range(-1, scheme.points.size):
            weight = scheme.start_weight if g < 0 else scheme.weights[g]
            if weight == 0.0:
                continue
            point = 0.0 if g < 0 else scheme.points[g]
            factor = weight * ((1.0 - point) * start[number] + point * end[number])
            write_pressure(pressure, k, q0 + point * dq, force, tangent)
            found -= factor.imag / STEP * force
            by_start -= factor.real * tangent
            by_step -= factor.real * point * tangent
    return found


@compiled
def load_derivative(model: ReducedModel, drift: Drift, time: complex) -> Array:
    """The derivative (n,) of the load vector by the parameter at a time."""
    factors = np.zeros(model.loads.shape[1], dtype=np.complex128)
    write_factors(drift.histories, time, factors)
    return model.loads @ (factors.imag / STEP)


@compiled
def structure(
    model: ReducedModel,
    scheme: Scheme,
    drift: Drift,
    h: complex,
    behind: complex,
    ahead: complex,
    dq: Array,
    s: Sensitivity,
) -> tuple[Array, Array, Array]:
    """The derivatives (n, n) of R by q0 and by dq, and the rest (n, k), without the contact.

    Args:
        model: the model.
        scheme: the weights of the scheme.
        drift: derivatives of the data by the parameter.
        h: size of the step, s.
        behind: start of the step, s.
        ahead: end of the step, s.
        dq: (n,) the step.
        s: the derivatives at its start.
    """
    q0 = s.before[0]
    damping = complex(scheme.damping, STEP * drift.damping)
    g = step_coefficients(scheme, damping, h)
    by_start, by_step = elastic_tangents(model, scheme, q0, dq)
    rest = model.mass @ combined(g.mass, g.inertia_v, g.inertia_a, dq, s)
    by_step += g.mass.real * model.mass
    velocity_v = complex(g.velocity_v)
    if scheme.velocity_forces:
        moved = combined(g.velocity_dq, velocity_v, g.velocity_a, dq, s)
        rest += model.velocity_matrix @ moved
        by_step += g.velocity_dq.real * model.velocity_matrix
    changed = s.load * (-scheme.alpha_f)
    copy_vector(s.load, load_derivative(model, drift, ahead))
    changed -= (1.0 - scheme.alpha_f) * s.load
    if model.pressure.numbers.shape[0] > 0:
        changed += add_pressure(model, scheme, drift, behind, ahead, q0, dq, by_start, by_step)
    if drift.force.shape[0] > 0:
        share = np.sum(scheme.weights * scheme.points)
        changed += drift.force + drift.stiffness @ (q0 + share * dq)
        mean = g.velocity_dq.real * dq + velocity_v.real * s.before[1]
        changed += drift.velocity @ (mean + g.velocity_a.real * s.before[2])
    add_to_last(rest, changed)
    return by_start, by_step, rest


@kernel
def write_law(model: ReducedModel, by: Array, p: int, place: int, s: Sensitivity) -> None:
    """Write what a force or a slider of point p takes from q0, dq and the columns.

    Args:
        model: the model.
        by: (d, 3 d + 1) `s.law.force[p]` or `s.law.slider[p]`.
        p: the point.
        place: its place among the points that touch.
        s: the arrays; out: `rows`, `by_start`, `by_step` and `by_rest`.
    """
    n, k = s.q.shape
    d = s.x0.shape[1]
    for i in range(d):
        at = place * d + i
        by_start, by_step, rest = s.by_start[at], s.by_step[at], s.by_rest[at]
        for a in range(n):
            s.rows[at, a] = model.contact_rows[p * d + i, a]
            by_start[a], by_step[a] = 0.0, 0.0
        for c in range(k):
            rest[c] = 0.0
        rest[k - 1] = by[i, 3 * d]
        for j in range(d):
            row = model.contact_rows[p * d + j]
            in_step, by_slider = by[i, d + j], by[i, 2 * d + j]
            at_start = by[i, j] + in_step
            for a in range(n):
                by_start[a] += at_start * row[a]
                by_step[a] += in_step * row[a]
            if by_slider != 0.0:
                for c in range(k):
                    rest[c] += by_slider * s.w[p * d + j, c]


@compiled
def advance_sliders(
    model: ReducedModel, points: NDArray[np.int64], dq: Array, s: Sensitivity
) -> None:
    """Carry the derivatives of the sliders of some points over a step with the derivatives dq."""
    d = s.x0.shape[1]
    m = points.size * d
    for place in range(points.size):
        write_law(model, s.law.slider[points[place]], points[place], place, s)
    moved = s.by_rest[:m] + s.by_start[:m] @ s.q + s.by_step[:m] @ dq
    for place in range(points.size):
        p = points[place]
        copy_vector(s.w[p * d : (p + 1) * d], moved[place * d : (place + 1) * d])


@compiled
def differentiate_blending(
    model: ReducedModel, contacts: Contacts, drift: Drift, h: float, s: Sensitivity
) -> None:
    """Write the derivatives of the weights b = r^2/(1 + r^2) in steps of size h to s.blending.

    With u = S^-1 b the flexibility b^T u of `ReducedModel.write_normal_flexibility` changes by
    -u^T dS u. The changes of weights below `BLENDING_RESOLVED` are neglected.
    """
    model.write_normal_flexibility(h, s.blending)
    unit, by_parameter = model.work.compliance.unit, 4.0 / h**2 * drift.period * model.mass
    if drift.force.shape[0] > 0:
        by_parameter = by_parameter - 0.5 * drift.stiffness
    for p in range(s.blending.size):
        flexibility, stiffness = s.blending[p], contacts.normal_stiffness[p]
        ratio = stiffness * flexibility
        s.blending[p] = 0.0
        if ratio**2 > BLENDING_RESOLVED:
            u = unit[:, p].copy()
            by_stiffness = drift.contacts.moved.normal_stiffness[p].imag / STEP
            change = by_stiffness * flexibility + stiffness * np.sum(u * (by_parameter @ u))
            s.blending[p] = 2.0 * ratio / (1.0 + ratio**2) ** 2 * change


@compiled
def start_derivatives(
    model: ReducedModel, drift: Drift, s: Sensitivity, memory: NDArray[np.int64], with_a: bool
) -> None:
    """Set the derivatives at the start of the period.

    Args:
        model: the model.
        drift: derivatives of the data by the parameter.
        s: in: the derivative of the law of the points at rest; out: the derivatives.
        memory: slider components that are variables of the period.
        with_a: whether the accelerations are variables.
    """
    n, points = s.q.shape[0], s.is_open.size
    s.q[:], s.v[:], s.a[:], s.w[:] = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        s.q[i, i], s.v[i, n + i] = 1.0, 1.0
        if with_a:
            s.a[i, 2 * n + i] = 1.0
    for c in range(memory.size):
        s.w[memory[c], (3 * n if with_a else 2 * n) + c] = 1.0
    advance_sliders(model, np.arange(points), np.zeros_like(s.q), s)
    copy_vector(s.load, load_derivative(model, drift, 0j))


@kernel
def count_touching(record: Record, row: int, s: Sensitivity) -> int:
    """Write `is_open` and `touching` in the step of a row of the record; returns their number."""
    count = 0
    for p in range(s.is_open.size):
        s.is_open[p] = True
        for i in range(s.x0.shape[1]):
            if record.mean_force[row, p, i] != 0.0:
                s.is_open[p] = False
        if not s.is_open[p]:
            s.touching[count] = p
            count += 1
    return count


@compiled
def carry_over_step(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    record: Record,
    row: int,
    begin: float,
    s: Sensitivity,
) -> bool:
    """Carry the derivatives in s over the step of a row of the record; arguments as below."""
    d, times = s.x0.shape[1], complex(1.0, STEP * drift.period)
    behind, ahead = begin * times, record.time[row] * times
    h = (record.time[row] - begin) * times
    step = Interval(behind, ahead, scheme.alpha_f, scheme.discrete_gradient)
    n, dq = s.q.shape[0], record.coordinates[row, : s.q.shape[0]] - s.before[0]
    touching, x1 = s.touching[: count_touching(record, row, s)], record.displacement[row]
    by_start, by_step, rest = structure(model, scheme, drift, h, behind, ahead, dq, s)
    sliding, count = np.empty_like(touching), 0
    for place in range(touching.size):
        p = touching[place]
        follows = not s.normal_force[p] > 0.0 or contacts.friction[p] == 0.0
        b = complex(record.blending[row, p], STEP * s.blending[p])
        if not differentiate_law(
            s.law, drift.contacts, step, p, s.x0[p], x1[p], s.w0[p], b, follows
        ):
            sliding[count] = p
            count += 1
        write_law(model, s.law.force[p], p, place, s)
    m = touching.size * d
    if m > 0:
        columns = np.ascontiguousarray(s.rows[:m].T)
        by_start += columns @ s.by_start[:m]
        by_step += columns @ s.by_step[:m]
        rest += columns @ s.by_rest[:m]
    change = -(rest + by_start @ s.q)
    if not lu_factor(by_step, s.pivots, n):
        return False
    lu_solve(by_step, s.pivots, change, n, change.shape[1])
    if count > 0:
        advance_sliders(model, sliding[:count], change, s)
    g = end_coefficients(scheme, h)
    q, v = s.q, g.v_dq.real * change + combined(g.v_dq, g.v_v, g.v_a, dq, s)
    q += change
    if not scheme.discrete_gradient:  # it has no accelerations
        a = combined(g.a_dq, g.a_v, g.a_a, dq, s)
        copy_vector(s.a, a + g.a_dq.real * change)
    copy_vector(s.v, v)
    for k in range(3):
        copy_vector(s.before[k], record.coordinates[row, k * n : (k + 1) * n])
    for p in range(s.is_open.size):
        s.normal_force[p] = record.force[row, p, 0]
        copy_vector(s.w0[p], x1[p] if s.is_open[p] else s.law.end[p])
    copy_vector(s.x0, x1)
    return True


@compiled
def carry_derivatives(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    record: Record,
    first: int,
    last: int,
    rows: int,
    rest: Interval,
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
    points, blended, d = s.is_open.size, 0.0, s.x0.shape[1]
    if first == 0:
        for p in range(points):
            x, w = s.x0[p], sliders[p]
            differentiate_law(s.law, drift.contacts, rest, p, x, x, w, 0j, rest.discrete_gradient)
        start_derivatives(model, drift, s, memory, not scheme.discrete_gradient)
    begin = record.time[first - 1] if first > 0 else 0.0
    for row in range(first, last):
        h = record.time[row] - begin
        if scheme.discrete_gradient and points > 0 and abs(h - blended) > SAME_STEP * h:
            differentiate_blending(model, contacts, drift, h, s)
            blended = h
        if not carry_over_step(model, contacts, scheme, drift, record, row, begin, s):
            return False
        begin = record.time[row]
    for p in range(points):
        if last == rows and s.is_open[p]:  # its slider follows it
            copy_vector(s.w[p * d : (p + 1) * d], model.contact_rows[p * d : (p + 1) * d] @ s.q)
    return True
