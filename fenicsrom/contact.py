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
from numba import njit
from numpy.typing import NDArray

from fenicsrom.dense import lu_factor, lu_solve

Array = NDArray[np.float64]

OPEN, SLIP, STICK = -1, 0, 1


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


@njit(cache=True, error_model="numpy")
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
        new_slider[:] = x[1:]
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
        new_slider[:] = slider
        for k in range(1, d):
            tangent[k, k] = kt
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


@njit(cache=True, error_model="numpy")
def energy(contacts: Contacts, x: Array, force: Array) -> float:
    """Energy in the contact springs, sum of N^2/(2 k_n) + |T|^2/(2 k_t) over the points, J; x and force (P, d)."""
    total = 0.0
    for p in range(x.shape[0]):
        total += 0.5 * force[p, 0] ** 2 / contacts.normal_stiffness[p]
        for k in range(1, x.shape[1]):
            total += 0.5 * force[p, k] ** 2 / contacts.tangential_stiffness[p]
    return total


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
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
    displacements), so the contact is solved in full: semismooth Newton, damped when the plain iteration cycles.

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
        True if the update fell to round-off (1e-15 of the displacements, at the least 1e-11), False otherwise.
    """
    points, d = x.shape
    m = points * d
    tangent = np.zeros((d, d))
    slopes = np.zeros((points, d, d))
    jacobian = np.zeros((m, m))
    update = np.zeros((m, 1))
    pivots = np.zeros(m, dtype=np.int64)
    residual = np.zeros(m)
    trial = x.copy()
    step = np.zeros((points, d))
    fraction = 1.0
    best = np.inf
    size = np.inf
    scale = 0.0
    for iteration in range(200):
        for p in range(points):
            for k in range(d):
                trial[p, k] = x[p, k] + fraction * step[p, k]
        scale = 0.0
        for p in range(points):
            state[p] = law(contacts, p, trial[p], slider0[p], force[p], tangent, slider[p])
            for k in range(d):
                mean[p, k] = start_weight * force0[p, k] + (1.0 - start_weight) * force[p, k]
                for j in range(d):
                    slopes[p, k, j] = (1.0 - start_weight) * tangent[k, j]
            if line:
                kn = contacts.normal_stiffness[p]
                before = contacts.preload[p] + kn * (x0[p, 0] - contacts.gap[p])
                after = contacts.preload[p] + kn * (trial[p, 0] - contacts.gap[p])
                mean[p, 0], slope = mean_normal_force(before, after)
                slopes[p, 0, 0] = slope * kn
            for k in range(d):
                scale = max(scale, abs(trial[p, k]), abs(free[p, k]), abs(x0[p, k]))
        norm = 0.0
        for i in range(m):
            residual[i] = trial[i // d, i % d] - free[i // d, i % d]
            for j in range(m):
                residual[i] += compliance[i, j] * mean[j // d, j % d]
        for i in range(m):
            for j in range(m):
                jacobian[i, j] = 1.0 if i == j else 0.0
                for k in range(d):
                    jacobian[i, j] += compliance[i, (j // d) * d + k] * slopes[j // d, k, j % d]
            update[i, 0] = -residual[i]
            norm += residual[i] ** 2
        norm = np.sqrt(norm)
        if iteration > 20 and fraction > 1e-3 and not norm < (1.0 - 1e-4 * fraction) * best:
            fraction *= 0.5  # the plain iteration cycles: shorten the step until the residual falls
            continue
        best = norm
        if not lu_factor(jacobian, pivots):
            return False
        lu_solve(jacobian, pivots, update)
        last = size
        size = 0.0
        for i in range(m):
            x[i // d, i % d] = trial[i // d, i % d]
            step[i // d, i % d] = update[i, 0]
            size = max(size, abs(update[i, 0]))
        fraction = 1.0
        if size <= 1e-15 * scale or (size <= 1e-11 * scale and size >= 0.5 * last):
            return True
    return size <= 1e-11 * scale
