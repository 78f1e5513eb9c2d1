"""The contact problem of a time step: semismooth Newton, then nonlinear Gauss-Seidel.

The unknowns are the contact displacements x at the end of the step. With the contact displacement
x_free without contact forces, the mean contact force F(x) over the step and the Delassus operator
G (contact displacement by contact force),

    x + G F(x) = x_free.                                                                        (1)

Everything but the contact is linear in (1), which is one Newton iteration of the step condensed to
the contact displacements. The contact is therefore solved in full.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import kernel, part
from fenicsrom.online.contact_state import ContactScratch, ContactState, Interval
from fenicsrom.online.contact_step import contact_force, trial_normal_force
from fenicsrom.online.dense import lu_factor, lu_solve
from fenicsrom.online.friction import (
    blended_normal_force,
    friction_limits,
    kept_part,
    positive,
)
from fenicsrom.online.surfaces import Contacts, advect_with_surface, gap_discrete_gradient

CONTACT_ITERATIONS = 25  # Newton iterations; a longer iteration counts as a cycle between states
CONTACT_ROUNDS = 100  # rounds of Gauss-Seidel and Newton before the step is rejected
SWEEPS = 10  # Gauss-Seidel sweeps of a round
BISECTIONS = 100
ROUNDING = 4e-15  # relative to the displacements: a smaller residual is rounding


@part
def solve_contact(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    scratch: ContactScratch,
) -> bool:
    """Solve (1) by semismooth Newton, restarted from Gauss-Seidel where it cycles between states.

    Args:
        contacts: the parameters of P points.
        interval: the step.
        delassus: (m, m) G, m = P d, m/N.
        free: (P, d) x_free, m.
        start: the state at the start of the step.
        end: `end.x` holds a first guess on entry, and the displacement at the end of the step on
            exit.
        scratch: out: `mean_force` (P, d) over the step.

    Returns:
        True if the residual or the update fell to rounding; False if no round found a solution.
    """
    points, d = free.shape[0], len(scratch.space)
    for p in range(points):
        for k in range(d):
            scratch.guess[p, k] = end.x[p, k]
    for attempt in range(1 + CONTACT_ROUNDS):
        if attempt > 0:
            nonlinear_gauss_seidel(
                contacts, interval, delassus, free, start, end, scratch, attempt == 1
            )
        if semismooth_newton(contacts, interval, delassus, free, start, end, scratch):
            return True
    return False


@part
def _contact_residual(
    delassus: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    count: int,
    scratch: ContactScratch,
) -> tuple[float, float]:
    """Write the residual of (1), with `count` touching points.

    Returns:
        Its largest entry, and the largest displacement, m.
    """
    points, d = free.shape[0], len(scratch.space)
    touching, mean = scratch.touching, scratch.mean_force
    scale, worst, row = 0.0, 0.0, 0
    for p in range(points):
        for k in range(d):
            value = end.x[p, k] - free[p, k]
            for t in range(count):
                column = touching[t] * d
                for j in range(d):
                    value += delassus[row, column + j] * mean[touching[t], j]
            scratch.residual[p, k] = value
            worst = max(worst, abs(value))
            scale = max(scale, abs(end.x[p, k]), abs(free[p, k]), abs(start.x[p, k]))
            row += 1
    return worst, scale


@part
def _solve_touching(delassus: Array, count: int, scratch: ContactScratch) -> bool:
    """Write Newton's update of the touching points to `update`; False if it has none."""
    d, touching, jacobian = len(scratch.space), scratch.touching, scratch.jacobian
    for t in range(count):
        p = touching[t]
        for k in range(d):
            scratch.update[t * d + k, 0] = -scratch.residual[p, k]
            for s in range(count):
                column = touching[s] * d
                for j in range(d):
                    value = 1.0 if s == t and j == k else 0.0
                    for i in range(d):
                        value += (
                            delassus[p * d + k, column + i]
                            * scratch.force_derivative[touching[s], i, j]
                        )
                    jacobian[t * d + k, s * d + j] = value
    m = count * d
    if not lu_factor(jacobian, scratch.pivots, m):
        return False
    lu_solve(jacobian, scratch.pivots, scratch.update, m)
    return True


@part
def _update_all(delassus: Array, points: int, count: int, scratch: ContactScratch) -> float:
    """Turn the residual of all points into Newton's update, given that of the touching points.

    Returns:
        The largest entry of the update, m.
    """
    d, touching, update = len(scratch.space), scratch.touching, scratch.update
    residual, force_change = scratch.residual, scratch.force_change
    for p in range(points):
        for k in range(d):
            residual[p, k] = -residual[p, k]
    for t in range(count):
        p = touching[t]
        for k in range(d):
            force_change[p, k] = 0.0
            for j in range(d):
                force_change[p, k] += scratch.force_derivative[p, k, j] * update[t * d + j, 0]
    if count < points:
        row = 0
        for p in range(points):
            for k in range(d):
                for t in range(count):
                    for j in range(d):
                        residual[p, k] -= (
                            delassus[row, touching[t] * d + j] * force_change[touching[t], j]
                        )
                row += 1
    for t in range(count):
        for k in range(d):
            residual[touching[t], k] = update[t * d + k, 0]
    size = 0.0
    for p in range(points):
        for k in range(d):
            size = max(size, abs(residual[p, k]))
    return size


@part
def semismooth_newton(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    scratch: ContactScratch,
) -> bool:
    """Semismooth Newton for (1) from the given x; True if it converged.

    Only the points that touch are unknowns: the others follow from their forces.
    """
    points, d = free.shape[0], len(scratch.space)
    size, remained = np.inf, np.inf
    for _ in range(CONTACT_ITERATIONS):
        count = 0
        for p in range(points):
            if contact_force(contacts, interval, p, start, end, scratch):
                scratch.touching[count] = p
                count += 1
        worst, scale = _contact_residual(delassus, free, start, end, count, scratch)
        if worst <= ROUNDING * scale:
            return True
        if not _solve_touching(delassus, count, scratch):
            return False
        last = size
        size = _update_all(delassus, points, count, scratch)
        # rounding: neither the update nor the residual decreases (for a stiff contact that only
        # opens, the residual still decreases slowly)
        if size <= 1e-15 * scale or (
            size <= 1e-11 * scale and size >= 0.5 * last and worst >= 0.9 * remained
        ):
            return True  # the forces belong to the x at which they were evaluated
        remained = worst
        for p in range(points):
            for k in range(d):
                end.x[p, k] += scratch.residual[p, k]
    return False


@kernel
def nonlinear_gauss_seidel(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    scratch: ContactScratch,
    first: bool,
) -> None:
    """Ten sweeps over all points, from `scratch.guess`.

    The first round takes the forces at the guess; later rounds continue from the last forces.
    """
    points, d = free.shape[0], len(scratch.space)
    for p in range(points):
        for k in range(d):
            end.x[p, k] = scratch.guess[p, k]
        if first:
            contact_force(contacts, interval, p, start, end, scratch)
            for k in range(d):
                scratch.held_force[p, k] = scratch.mean_force[p, k]
                scratch.held_friction[p, k] = scratch.mean_friction[p, k]
    for _ in range(SWEEPS):
        for p in range(points):
            solve_point(contacts, interval, delassus, free, p, start, end, scratch)
    for p in range(points):
        for k in range(d):
            scratch.guess[p, k] = end.x[p, k]


@part
def _bisect_normal_force(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    p: int,
    start: ContactState,
    end: ContactState,
    scratch: ContactScratch,
) -> float:
    """Normal force of point p, N, with its friction and the forces of the others held.

    The displacement is x = rest - G (N n + T + start_weight N0 n0), with the rest in `point.place`
    and n in `point.mean_normal`. The normal force lies between zero and its value at N = 0.
    """
    x, friction, d = end.x[p], scratch.held_friction[p], len(scratch.space)
    n, rest = scratch.point.mean_normal, scratch.point.place
    a = 0.0 if interval.discrete_gradient else interval.start_weight
    theta, row = 1.0 - interval.start_weight, p * d
    low, high, force = 0.0, 0.0, 0.0
    for step in range(1 + BISECTIONS):
        force = 0.0 if step == 0 else 0.5 * (low + high)
        for k in range(d):
            x[k] = rest[k]
            for j in range(d):
                total = force * n[j] + friction[j] + a * start.normal[p, j]
                x[k] -= delassus[row + k, row + j] * total
        after = trial_normal_force(contacts, p, x, interval.end)
        if interval.discrete_gradient:
            found, _ = blended_normal_force(start.trial_normal_force[p], after, scratch.blending[p])
        else:
            found = theta * positive(after)
        if step == 0:
            high = found
        elif found > force:
            low = force
        else:
            high = force
    return force


@part
def _project_friction(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    p: int,
    start: ContactState,
    end: ContactState,
    force: float,
    scratch: ContactScratch,
) -> None:
    """Write the friction of point p, a force on the disc of radius mu `force`, to `held_friction`.

    Friction is taken at the weighted point, with the initial stretch, the limits and the fraction
    of contact of `fenicsrom.online.friction`. This friction is close to the mean along the path, so
    Newton's iteration then finds the solution.
    """
    point, d = scratch.point, len(scratch.space)
    x, x0, friction = end.x[p], start.x[p], scratch.held_friction[p]
    kt, mu, before = (
        contacts.tangential_stiffness[p],
        contacts.friction[p],
        start.trial_normal_force[p],
    )
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    n, stretch0, stretch, trial = (
        point.mean_normal,
        point.start_stretch,
        point.end_stretch,
        point.slip_force,
    )
    advect_with_surface(
        contacts, p, theta * (interval.end - interval.begin), start.slider[p], stretch
    )
    softness, size, across, across0 = 0.0, 0.0, 0.0, 0.0
    for k in range(d):
        softness += delassus[p * d + k, p * d + k]  # an upper bound for every direction
        stretch[k] = a * x0[k] + theta * x[k] - stretch[k]
        size += n[k] ** 2
    for k in range(d):
        across += n[k] * stretch[k] / size
        across0 += n[k] * (x0[k] - start.slider[p, k]) / size
    for k in range(d):
        stretch0[k] = x0[k] - start.slider[p, k] - across0 * n[k]
        stretch[k] -= across * n[k]
    limit, fraction, kept = mu * force, 1.0, 1.0
    if not interval.discrete_gradient:
        limit = mu * (force + a * positive(before))
    elif force > 0.0:
        after = trial_normal_force(contacts, p, x, interval.end)
        limits = friction_limits(mu, before, after, force, 0.0, scratch.blending[p])
        fraction = limits.fraction
        kept, _ = kept_part(kt, stretch0, limits.first)
    softness *= fraction * fraction * theta
    total = 0.0
    for k in range(d):
        middle = kept * stretch0[k] + fraction * (stretch[k] - stretch0[k])
        trial[k] = (fraction * middle + softness * friction[k]) / (1.0 / kt + softness)
        total += trial[k] ** 2
    total = np.sqrt(total)
    factor = limit / total if total > limit else 1.0
    for k in range(d):
        friction[k] = factor * trial[k]


@kernel
def solve_point(
    contacts: Contacts,
    interval: Interval,
    delassus: Array,
    free: Array,
    p: int,
    start: ContactState,
    end: ContactState,
    scratch: ContactScratch,
) -> None:
    """Solve point p with the forces of the others held: first its normal force, then its friction.

    This iteration is slow, but it does not cycle between states: the tangential force is projected
    on the friction disc as a force, and not computed from a displacement that a wrong normal force
    has made large.
    """
    points, d = free.shape[0], len(scratch.space)
    x, held, point, row = end.x[p], scratch.held_force[p], scratch.point, p * d
    n, rest = point.mean_normal, point.place
    for k in range(d):
        rest[k] = free[p, k]
        for q in range(points):
            if q != p:
                for j in range(d):
                    rest[k] -= delassus[row + k, q * d + j] * scratch.held_force[q, j]
    if interval.discrete_gradient:
        first, time, a = start.x[p], 0.5 * (interval.begin + interval.end), 0.0
    else:
        first, time, a = x, interval.end, interval.start_weight
    gap_discrete_gradient(contacts, p, first, x, time, n, point.mean_normal_derivative, point.work)
    force = _bisect_normal_force(contacts, interval, delassus, p, start, end, scratch)
    _project_friction(contacts, interval, delassus, p, start, end, force, scratch)
    for k in range(d):
        held[k] = force * n[k] + scratch.held_friction[p, k] + a * start.normal[p, k]
    for k in range(d):
        x[k] = rest[k]
        for j in range(d):
            x[k] -= delassus[row + k, row + j] * held[j]
