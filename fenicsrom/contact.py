"""Friction between points of the structure and rigid planes: one statement of the law, for every model.

A point is described by its displacement x = [x_n, x_t] in its own frame, x_n along the unit normal n into the surface,
x_t in the tangent plane (one component in 2D, two in 3D). The forces below act against the motion: the residual of the
equations of motion gains + B F, with F = [N, T].

    N = max(0, N0 + k_n (x_n - g0))
    T = k_t (x_t - w)                 if |T| <= mu N      stick, the slider w rests
    T = mu N T/|T|                    otherwise           slip, the slider moves: w = x_t - T/k_t
    T = 0, w = x_t                    if N = 0            open, the slider follows

The law is pure: it reads the displacement and the slider of the last accepted state and writes what it finds into arrays
of the caller; a rejected step leaves no trace.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.dense import compiled, kernel, lu_factor, lu_solve

Array = NDArray[np.float64]

OPEN, SLIP, STICK = -1, 0, 1

CONTACT_ITERATIONS = 25  # of Newton before it is taken to cycle
CONTACT_SWEEPS = 100  # tens of sweeps before the contact is given up
ROUNDING = 5e-16  # of the displacements: a residual that no update could better


class Contacts(NamedTuple):
    """The parameters of P contact points, arrays of shape (P,): N, m, N/m, N/m, none."""

    preload: Array
    gap: Array
    normal_stiffness: Array
    tangential_stiffness: Array
    friction: Array


def no_contacts() -> Contacts:
    """The contacts of a scene that has none."""
    return Contacts(*(np.zeros(0) for _ in Contacts._fields))


@kernel
def law(contacts: Contacts, p: int, x: Array, slider: Array, force: Array, tangent: Array, new_slider: Array) -> int:
    """Forces of point p by return mapping, with the consistent tangent (unsymmetric in slip: T depends on N).

    Args:
        contacts: the parameters.
        p: the point.
        x: (d,) displacement in the local frame [normal, tangents], m.
        slider: (d-1,) slider w of the last accepted state, m.
        force: (d,) out: [N, T], N.
        tangent: (d, d) out: d force / d x, N/m.
        new_slider: (d-1,) out: w at x, m.

    Returns:
        The state: OPEN, SLIP or STICK.
    """
    d = x.size
    kn, kt = contacts.normal_stiffness[p], contacts.tangential_stiffness[p]
    normal = contacts.preload[p] + kn * (x[0] - contacts.gap[p])
    force[:] = 0.0
    tangent[:] = 0.0
    if not normal > 0.0:
        for k in range(1, d):
            new_slider[k - 1] = x[k]
        return OPEN
    force[0] = normal
    tangent[0, 0] = kn
    size = 0.0
    for k in range(1, d):
        force[k] = kt * (x[k] - slider[k - 1])
        size += force[k] ** 2
    size = np.sqrt(size)
    limit = contacts.friction[p] * normal
    if size < limit or (size == limit and limit > 0.0):
        for k in range(1, d):
            tangent[k, k] = kt
            new_slider[k - 1] = slider[k - 1]
        return STICK
    for k in range(1, d):
        direction = force[k] / size if size > 0.0 else 0.0
        force[k] = direction  # the unit vector for now: the tangent needs all its components
    for k in range(1, d):
        tangent[k, 0] = contacts.friction[p] * kn * force[k]
        if size > 0.0:
            for j in range(1, d):
                tangent[k, j] = limit * kt / size * ((1.0 if j == k else 0.0) - force[k] * force[j])
    for k in range(1, d):
        force[k] *= limit
        new_slider[k - 1] = x[k] - force[k] / kt
    return SLIP


@kernel
def energy(contacts: Contacts, x: Array, force: Array) -> float:
    """Energy in the contact springs, sum of N^2/(2 k_n) + |T|^2/(2 k_t) over the points, J; x and force (P, d)."""
    total = 0.0
    for p in range(x.shape[0]):
        total += 0.5 * force[p, 0] ** 2 / contacts.normal_stiffness[p]
        for k in range(1, x.shape[1]):
            total += 0.5 * force[p, k] ** 2 / contacts.tangential_stiffness[p]
    return total


@kernel
def mean_normal_force(before: float, after: float) -> tuple[float, float]:
    """Mean normal force along a straight step, and its derivative by `after`.

    The discrete gradient of the spring energy: (N1^2 - N0^2) / (2 (y1 - y0)), where y is N before clamping at zero.

    Args:
        before: y at the start of the step, N.
        after: y at its end, N.

    Returns:
        The mean force in N, and d mean / d after.
    """
    if before >= 0.0 and after >= 0.0:
        return 0.5 * (before + after), 0.5
    if before <= 0.0 and after <= 0.0:
        return 0.0, 0.0
    span = after - before
    if after > 0.0:
        return 0.5 * after**2 / span, after / span - 0.5 * (after / span) ** 2
    return -0.5 * before**2 / span, 0.5 * (before / span) ** 2


class Workspace(NamedTuple):
    """Room for `resolve` with m = P d unknowns."""

    guess: Array
    held: Array
    slopes: Array
    jacobian: Array
    update: Array
    pivots: NDArray[np.int64]


@compiled
def workspace(points: int, d: int) -> Workspace:
    """A `Workspace` for P points in d dimensions."""
    m = points * d
    return Workspace(
        np.zeros((points, d)), np.zeros((points, d)), np.zeros((points, d, d)), np.zeros((m, m)), np.zeros((m, 1)),
        np.zeros(m, dtype=np.int64),
    )  # fmt: skip


@compiled
def resolve(
    contacts: Contacts,
    compliance: Array,
    free: Array,
    x0: Array,
    force0: Array,
    slider0: Array,
    start_weight: float,
    line: bool,
    x: Array,
    force: Array,
    slider: Array,
    state: NDArray[np.int8],
    mean: Array,
) -> bool:
    """Find the contact displacements at the end of a step: x + G F(x) = x_free, with F the mean force over the step.

    Everything but the contact is linear in this problem (it is one Newton iteration of the step, condensed to the contact
    displacements), so the contact is solved in full: semismooth Newton and, where that cycles between states,
    Newton again from where a nonlinear Gauss-Seidel iteration has come to.

    Args:
        contacts: the parameters of P points.
        compliance: (m, m) G, contact displacement by contact force at this iteration, m = P d, m/N.
        free: (P, d) displacement at the end of the step without contact forces, m.
        x0: (P, d) displacement at the start of the step.
        force0: (P, d) force at the start of the step.
        slider0: (P, d-1) slider at the start of the step.
        start_weight: weight of the force at the start of the step; 1 minus it weighs the force at the end.
        line: the normal force is its mean along the step (discrete gradient) in place of the weighted ends.
        x: (P, d) in: a first guess; out: the displacement at the end of the step.
        force: (P, d) out: [N, T] at the end of the step.
        slider: (P, d-1) out: slider at the end of the step.
        state: (P,) out: OPEN, SLIP, STICK at the end of the step.
        mean: (P, d) out: mean force over the step.

    Returns:
        True if the residual or the update fell to round-off; False if no iteration found a solution.
    """
    work = workspace(x.shape[0], x.shape[1])
    return resolve_with(
        work, contacts, compliance, free, x0, force0, slider0, start_weight, line, x, force, slider, state, mean
    )


@kernel
def resolve_with(
    work: Workspace,
    contacts: Contacts,
    compliance: Array,
    free: Array,
    x0: Array,
    force0: Array,
    slider0: Array,
    start_weight: float,
    line: bool,
    x: Array,
    force: Array,
    slider: Array,
    state: NDArray[np.int8],
    mean: Array,
) -> bool:
    """`resolve` with room to work in."""
    points, d = x.shape
    guess, held = work.guess, work.held
    for p in range(points):
        for k in range(d):
            guess[p, k] = x[p, k]
    if newton(work, contacts, compliance, free, x0, force0, slider0, start_weight, line, x, force, slider, state, mean):
        return True
    evaluate(work.slopes, contacts, guess, x0, force0, slider0, start_weight, line, force, slider, state, held)
    for _ in range(CONTACT_SWEEPS):
        for _ in range(10):
            sweep(contacts, compliance, free, x0, force0, slider0, start_weight, line, guess, held)
        for p in range(points):
            for k in range(d):
                x[p, k] = guess[p, k]
        if newton(work, contacts, compliance, free, x0, force0, slider0, start_weight, line, x, force, slider, state, mean):
            return True
    return False


@kernel
def sweep(
    contacts: Contacts,
    compliance: Array,
    free: Array,
    x0: Array,
    force0: Array,
    slider0: Array,
    start_weight: float,
    line: bool,
    x: Array,
    mean: Array,
) -> None:
    """Solve each point in turn, the forces of the others held: first its normal force, by bisection, then its friction.

    This nonlinear Gauss-Seidel iteration is slow, but does not cycle between states: the tangential force is projected on
    the friction disc as a force, not found from a displacement that a wrong normal force has thrown far away.
    """
    points, d = x.shape
    end_weight = 1.0 - start_weight
    for p in range(points):
        kn, kt = contacts.normal_stiffness[p], contacts.tangential_stiffness[p]
        offset = contacts.preload[p] - kn * contacts.gap[p]
        before = offset + kn * x0[p, 0]
        row = p * d
        rest = free[p, 0]
        for j in range(points * d):
            if j != row:
                rest -= compliance[row, j] * mean[j // d, j % d]
        g = compliance[row, row]
        low, high = 0.0, 0.0
        for step in range(100):  # the displacement lies between rest and what the force at rest would leave of it
            middle = rest if step == 0 else 0.5 * (low + high)
            after = offset + kn * middle
            if line:
                push, _ = mean_normal_force(before, after)
            else:
                push = start_weight * force0[p, 0] + end_weight * max(after, 0.0)
            if step == 0:
                low, high = rest - g * push, rest
            elif middle + g * push > rest:
                high = middle
            else:
                low = middle
        x[p, 0] = 0.5 * (low + high)
        mean[p, 0] = max(rest - x[p, 0], 0.0) / g
        limit = contacts.friction[p] * max(offset + kn * x[p, 0], 0.0)
        g = 0.0
        for k in range(1, d):
            g = max(g, compliance[row + k, row + k])
        size = 0.0
        for k in range(1, d):
            rest = free[p, k]
            for j in range(points * d):
                if j != row + k:
                    rest -= compliance[row + k, j] * mean[j // d, j % d]
            rest += (g - compliance[row + k, row + k]) * mean[p, k]
            x[p, k] = (rest - g * start_weight * force0[p, k] - slider0[p, k - 1]) / (1.0 / kt + g * end_weight)
            size += x[p, k] ** 2
        size = np.sqrt(size)
        factor = limit / size if size > limit else 1.0
        for k in range(1, d):  # x held the trial force
            mean[p, k] = start_weight * force0[p, k] + end_weight * factor * x[p, k]
        for k in range(1, d):
            x[p, k] = free[p, k]
            for j in range(points * d):
                x[p, k] -= compliance[row + k, j] * mean[j // d, j % d]


@kernel
def evaluate(
    slopes: Array,
    contacts: Contacts,
    x: Array,
    x0: Array,
    force0: Array,
    slider0: Array,
    start_weight: float,
    line: bool,
    force: Array,
    slider: Array,
    state: NDArray[np.int8],
    mean: Array,
) -> None:
    """Forces and states at the end of the step for a displacement x, the mean forces, and their slopes (P, d, d) by x."""
    points, d = x.shape
    for p in range(points):
        state[p] = law(contacts, p, x[p], slider0[p], force[p], slopes[p], slider[p])
        for k in range(d):
            mean[p, k] = start_weight * force0[p, k] + (1.0 - start_weight) * force[p, k]
            for j in range(d):
                slopes[p, k, j] *= 1.0 - start_weight
        if line:
            kn = contacts.normal_stiffness[p]
            before = contacts.preload[p] + kn * (x0[p, 0] - contacts.gap[p])
            after = contacts.preload[p] + kn * (x[p, 0] - contacts.gap[p])
            mean[p, 0], slope = mean_normal_force(before, after)
            slopes[p, 0, 0] = slope * kn


@kernel
def newton(
    work: Workspace,
    contacts: Contacts,
    compliance: Array,
    free: Array,
    x0: Array,
    force0: Array,
    slider0: Array,
    start_weight: float,
    line: bool,
    x: Array,
    force: Array,
    slider: Array,
    state: NDArray[np.int8],
    mean: Array,
) -> bool:
    """Semismooth Newton for x + G F(x) = x_free from the x given; True if it converged."""
    points, d = x.shape
    m = points * d
    slopes, jacobian, update, pivots = work.slopes, work.jacobian, work.update, work.pivots
    size = np.inf
    for _ in range(CONTACT_ITERATIONS):
        evaluate(slopes, contacts, x, x0, force0, slider0, start_weight, line, force, slider, state, mean)
        scale = 0.0
        worst = 0.0
        for i in range(m):
            here, aim = x[i // d, i % d], free[i // d, i % d]
            residual = here - aim
            for j in range(m):
                residual += compliance[i, j] * mean[j // d, j % d]
            update[i, 0] = -residual
            worst = max(worst, abs(residual))
            scale = max(scale, abs(here), abs(aim), abs(x0[i // d, i % d]))
        if worst <= ROUNDING * scale:
            return True
        for i in range(m):
            for j in range(m):
                jacobian[i, j] = 1.0 if i == j else 0.0
                for k in range(d):
                    jacobian[i, j] += compliance[i, (j // d) * d + k] * slopes[j // d, k, j % d]
        if not lu_factor(jacobian, pivots):
            return False
        lu_solve(jacobian, pivots, update)
        last, size = size, 0.0
        for i in range(m):
            size = max(size, abs(update[i, 0]))
        if size <= 1e-15 * scale or (size <= 1e-11 * scale and size >= 0.5 * last):
            return True  # the forces belong to the x they were evaluated at
        for i in range(m):
            x[i // d, i % d] += update[i, 0]
    return False
