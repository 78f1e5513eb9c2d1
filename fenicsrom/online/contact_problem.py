"""The contact problem of a time step: semismooth Newton, then nonlinear Gauss-Seidel."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import kernel, part
from fenicsrom.online.contact_state import ContactScratch, ContactState, Interval
from fenicsrom.online.contact_step import over_step
from fenicsrom.online.dense import lu_factor, lu_solve
from fenicsrom.online.friction import leaning_normal_force, mean_normal_force, touch_lasts
from fenicsrom.online.surfaces import Contacts, carry, direction, penetration

CONTACT_ITERATIONS = 25  # of Newton before it is taken to cycle
CONTACT_SWEEPS = 100  # tens of sweeps before the contact is given up
ROUNDING = 4e-15  # of the displacements: a residual that no update could better


# ---------------------------------------------------------------------- the contact problem of a
# step


@part
def resolve(
    contacts: Contacts,
    interval: Interval,
    compliance: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
) -> bool:
    """Find the contact displacements at the end of a step: x + G F(x) = x_free, with F the mean
    force over the step.

    Everything but the contact is linear in this problem (it is one Newton iteration of the step,
    condensed to the contact displacements), so the contact is solved in full: semismooth Newton
    and, where that cycles between states, Newton again from where a nonlinear Gauss-Seidel
    iteration has come to.

    Args:
        contacts: the parameters of P points.
        interval: the step.
        compliance: (m, m) G, contact displacement by contact force at this iteration, m = P d, m/N.
        free: (P, d) displacement at the end of the step without contact forces, m.
        start: the state at the start of the step.
        end: its x in: a first guess; out: the displacement at the end of the step.
        room: its mean (P, d) out: mean force over the step.

    Returns:
        True if the residual or the update fell to round-off; False if no iteration found a
        solution.
    """
    points, d = free.shape[0], len(room.space)
    for p in range(points):
        for k in range(d):
            room.guess[p, k] = end.x[p, k]
    for attempt in range(1 + CONTACT_SWEEPS):
        if attempt > 0:
            relax(contacts, interval, compliance, free, start, end, room, attempt == 1)
        if newton(contacts, interval, compliance, free, start, end, room):
            return True
    return False


@kernel
def relax(
    contacts: Contacts,
    interval: Interval,
    compliance: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
    first: bool,
) -> None:
    """Ten sweeps over all points from where the last ones came to, at first from the guess, with
    the forces there.
    """
    points, d = free.shape[0], len(room.space)
    for p in range(points):
        for k in range(d):
            end.x[p, k] = room.guess[p, k]
        if first:
            over_step(contacts, interval, p, start, end, room)
            for k in range(d):
                room.held[p, k], room.held_rubbing[p, k] = room.mean[p, k], room.rubbing[p, k]
    for _ in range(10):
        for p in range(points):
            sweep(contacts, interval, compliance, free, p, start, end, room)
    for p in range(points):
        for k in range(d):
            room.guess[p, k] = end.x[p, k]


@part
def newton(
    contacts: Contacts,
    interval: Interval,
    compliance: Array,
    free: Array,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
) -> bool:
    """Semismooth Newton for x + G F(x) = x_free from the x given; True if it converged.

    Only the points that touch are unknowns: the others follow from their forces.
    """
    points, d = free.shape[0], len(room.space)
    x, x0, mean, slopes, touching = end.x, start.x, room.mean, room.slopes, room.touching
    residual, product, jacobian, update, pivots = (
        room.residual,
        room.product,
        room.jacobian,
        room.update,
        room.pivots,
    )
    size, remained = np.inf, np.inf
    for _ in range(CONTACT_ITERATIONS):
        count = 0
        for p in range(points):
            if over_step(contacts, interval, p, start, end, room):
                touching[count] = p
                count += 1
        scale, worst, row = 0.0, 0.0, 0
        for p in range(points):
            for k in range(d):
                value = x[p, k] - free[p, k]
                for t in range(count):
                    column = touching[t] * d
                    for j in range(d):
                        value += compliance[row, column + j] * mean[touching[t], j]
                residual[p, k] = value
                worst = max(worst, abs(value))
                scale = max(scale, abs(x[p, k]), abs(free[p, k]), abs(x0[p, k]))
                row += 1
        if worst <= ROUNDING * scale:
            return True
        m = count * d
        for t in range(count):
            p = touching[t]
            for k in range(d):
                update[t * d + k, 0] = -residual[p, k]
                for s in range(count):
                    column = touching[s] * d
                    for j in range(d):
                        value = 1.0 if s == t and j == k else 0.0
                        for i in range(d):
                            value += compliance[p * d + k, column + i] * slopes[touching[s], i, j]
                        jacobian[t * d + k, s * d + j] = value
        if not lu_factor(jacobian, pivots, m):
            return False
        lu_solve(jacobian, pivots, update, m)
        for p in range(points):  # what the others do under the change of force
            for k in range(d):
                residual[p, k] = -residual[p, k]
        for t in range(count):
            p = touching[t]
            for k in range(d):
                product[p, k] = 0.0
                for j in range(d):
                    product[p, k] += slopes[p, k, j] * update[t * d + j, 0]
        if count < points:
            row = 0
            for p in range(points):
                for k in range(d):
                    for t in range(count):
                        for j in range(d):
                            residual[p, k] -= (
                                compliance[row, touching[t] * d + j] * product[touching[t], j]
                            )
                    row += 1
        for t in range(count):
            for k in range(d):
                residual[touching[t], k] = update[t * d + k, 0]
        last, size = size, 0.0
        for p in range(points):
            for k in range(d):
                size = max(size, abs(residual[p, k]))
        # rounding: neither update nor residual fall (of a stiff contact that only opens, the
        # residual still does, slowly)
        if size <= 1e-15 * scale or (
            size <= 1e-11 * scale and size >= 0.5 * last and worst >= 0.9 * remained
        ):
            return True  # the forces belong to the x they were evaluated at
        remained = worst
        for p in range(points):
            for k in range(d):
                x[p, k] += residual[p, k]
    return False


@kernel
def sweep(
    contacts: Contacts,
    interval: Interval,
    compliance: Array,
    free: Array,
    p: int,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
) -> None:
    """Solve point p, the forces of the others held: first its normal force, by bisection, then its
    friction.

    This nonlinear Gauss-Seidel iteration is slow, but does not cycle between states: the tangential
    force is projected on the friction disc as a force, not found from a displacement that a wrong
    normal force has thrown far away. Friction is taken at the weighted point, near the mean along
    the way: it leads to where Newton's iteration ends.
    """
    points, d = free.shape[0], len(room.space)
    a = interval.start_weight
    theta = 1.0 - a
    x, mean, rubbing = end.x[p], room.held[p], room.held_rubbing[p]
    kn, kt, preload, before = (
        contacts.normal_stiffness[p],
        contacts.tangential_stiffness[p],
        contacts.preload[p],
        start.raw[p],
    )
    n, rest, spare, stretch = room.vectors[0], room.vectors[1], room.vectors[2], room.vectors[3]
    row = p * d
    for k in range(d):
        rest[k] = free[p, k]
        for q in range(points):
            if q != p:
                for j in range(d):
                    rest[k] -= compliance[row + k, q * d + j] * room.held[q, j]
    if interval.line:
        direction(
            contacts,
            p,
            start.x[p],
            x,
            0.5 * (interval.begin + interval.end),
            n,
            room.matrices[0],
            spare,
        )
    else:
        direction(contacts, p, x, x, interval.end, n, room.matrices[0], spare)
    low, high, push, held = 0.0, 0.0, 0.0, 0.0
    if not interval.line:  # what the start contributes is known
        held = a
    for step in range(
        101
    ):  # the force lies between nothing and what it would be if it moved nothing
        push = 0.0 if step == 0 else 0.5 * (low + high)
        for k in range(d):
            x[k] = rest[k]
            for j in range(d):
                force = push * n[j] + rubbing[j] + held * start.normal[p, j]
                x[k] -= compliance[row + k, row + j] * force
        after = preload + kn * penetration(contacts, p, x, interval.end)
        if interval.line:
            found, _ = leaning_normal_force(before, after, room.lean[p])
        else:
            found = theta * max(after, 0.0)
        if step == 0:
            high = found
        elif found > push:
            low = push
        else:
            high = push
    limit = contacts.friction[p] * (push + held * max(before, 0.0))
    carry(contacts, p, theta * (interval.end - interval.begin), start.slider[p], stretch)
    softness, size, across, over = 0.0, 0.0, 0.0, 0.0
    for k in range(d):
        softness += compliance[row + k, row + k]  # at least that of any direction
        stretch[k] = a * start.x[p, k] + theta * x[k] - stretch[k]
        size += n[k] ** 2
    for k in range(d):
        across += n[k] * stretch[k] / size
        over += n[k] * (start.x[p, k] - start.slider[p, k]) / size
    lasts, kept, drawn = 1.0, 1.0, 0.0  # as in `rub`: of the step, and of the stretch at its start
    if interval.line and push > 0.0:
        after = preload + kn * penetration(contacts, p, x, interval.end)
        lasts, _ = touch_lasts(before, after, room.lean[p])
        full, _ = mean_normal_force(before, after)
        first = limit / full * max(before, 0.0) if full > 0.0 else 0.0
        for k in range(d):
            drawn += (kt * (start.x[p, k] - start.slider[p, k] - over * n[k])) ** 2
        drawn = np.sqrt(drawn)
        if drawn > first:
            kept = first / drawn
    softness *= lasts * lasts * theta
    total = 0.0
    for k in range(d):
        begin = start.x[p, k] - start.slider[p, k] - over * n[k]
        middle = kept * begin + lasts * (stretch[k] - across * n[k] - begin)
        spare[k] = (lasts * middle + softness * rubbing[k]) / (1.0 / kt + softness)
        total += spare[k] ** 2
    total = np.sqrt(total)
    factor = limit / total if total > limit else 1.0
    for k in range(d):
        rubbing[k] = factor * spare[k]
        mean[k] = push * n[k] + rubbing[k] + held * start.normal[p, k]
    for k in range(d):
        x[k] = rest[k]
        for j in range(d):
            x[k] -= compliance[row + k, row + j] * mean[j]
