"""Normal and friction force of one contact point over a time step, in closed form."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import kernel, part
from fenicsrom.online.contact_state import SLIP, STICK, ContactScratch, Interval
from fenicsrom.online.surfaces import Contacts

# ---------------------------------------------------------------------- the law


@part
def mean_normal_force(before: float, after: float) -> tuple[float, float]:
    """Mean normal force along a straight step, and its derivative by `after`.

    The discrete gradient of the spring energy: (N1^2 - N0^2) / (2 (y1 - y0)), where y is N before
    clamping at zero.

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


@part
def touch_lasts(before: float, after: float, lean: float) -> tuple[float, float]:
    """For how much of a straight step a point touches, its y as above, and the derivative by
    `after`.

    Where the normal force leans to the end, so does the touch that it closes with: it is that of
    the whole step that ends there, along all of which the point slides under it. Without, an impact
    too short for the step would pass without friction.
    """
    span = after - before
    if before < 0.0 < after:
        return lean + (1.0 - lean) * after / span, -(1.0 - lean) * before / span**2
    if after < 0.0 < before:
        return -before / span, before / span**2
    return (1.0, 0.0) if before >= 0.0 and after >= 0.0 else (0.0, 0.0)


@part
def leaning_normal_force(before: float, after: float, lean: float) -> tuple[float, float]:
    """The mean normal force of a step that may be too long for the contact, and its derivative by
    `after`: as above.

    It lies between the mean along the way and the force at the end. The force grows with the
    penetration, so the difference takes energy, whatever the step: (N1 - mean) (y1 - y0) >= 0.
    """
    mean, slope = mean_normal_force(before, after)
    if lean == 0.0:
        return mean, slope
    end, by_end = (after, 1.0) if after > 0.0 else (0.0, 0.0)
    return mean + lean * (end - mean), slope + lean * (by_end - slope)


@part
def return_mapping(
    stiffness: float, limit: float, n: Array, stretch: Array, force: Array
) -> tuple[int, float]:
    """Friction by return mapping: the projection of k_t P (x - w) on the disc of radius mu N.

    Args:
        stiffness: k_t, N/m.
        limit: mu N, N.
        n: (d,) unit normal.
        stretch: (d,) x - w, m.
        force: (d,) out: T, N.

    Returns:
        SLIP or STICK, and the size of T before it was projected.
    """
    across, size = 0.0, 0.0
    for k in range(n.size):
        across += n[k] * stretch[k]
    for k in range(n.size):
        force[k] = stiffness * (stretch[k] - across * n[k])
        size += force[k] ** 2
    size = np.sqrt(size)
    if size < limit or (size == limit and limit > 0.0):
        return STICK, size
    factor = limit / size if size > 0.0 else 0.0
    for k in range(n.size):
        force[k] *= factor
    return SLIP, size


@kernel
def into_the_plane(
    n: Array, bend: Array, reach: float, vector: Array, slope: Array, turned: Array
) -> None:
    """Project a vector (d,) that moves by `reach` with x1 on the plane of the unit normal n, whose
    derivative is bend (d, d).

    Its derivative by x1 is written to `slope` (d, d); turned (d,) is room.
    """
    d = n.size
    across = 0.0
    for k in range(d):
        across += n[k] * vector[k]
    for j in range(d):
        turned[j] = 0.0
        for i in range(d):
            turned[j] += vector[i] * bend[i, j]
    for k in range(d):
        vector[k] -= across * n[k]
        for j in range(d):
            slope[k, j] = (
                (reach if k == j else 0.0)
                - reach * n[k] * n[j]
                - across * bend[k, j]
                - n[k] * turned[j]
            )


@part
def sticks_until(a: float, b: float, c: float) -> float:
    """Where in [0, 1] a t^2 + 2 b t + c, not positive at 0, grows positive; 1 where it does not."""
    root = b * b - a * c
    if root < 0.0 or (b < 0.0 and a <= 0.0):
        return 1.0
    root = np.sqrt(root)
    if b < 0.0:
        return min((root - b) / a, 1.0)
    if b + root > 0.0:
        return min(-c / (b + root), 1.0)
    return 0.0 if a > 0.0 else 1.0


@part
def rub(
    contacts: Contacts,
    interval: Interval,
    p: int,
    before: float,
    after: float,
    push: float,
    by_after: float,
    room: ContactScratch,
) -> None:
    """The mean friction of point p over a step and the way of its slider; its slope is added to
    that of the mean force.

    The stretch e goes straight from `begin` to `finish` (their derivatives by x1 are `by_begin` and
    `by_finish`). Where the scheme weighs the ends, friction is the law at `finish`, the weighted
    point. Along the line the point sticks from where it touches,

        T = k_t (e_a + t G)    until    |T| = L_a + t (L_b - L_a),    0 <= t <= 1,

    with the limits of friction L where the touch begins and ends, and then slips: the law in the
    middle of what is left.
    """
    kt, theta, mu = (
        contacts.tangential_stiffness[p],
        1.0 - interval.start_weight,
        contacts.friction[p],
    )
    n, steepest = room.vectors[0], room.vectors[1]
    begin, finish, by_begin, by_finish = (
        room.vectors[2],
        room.vectors[3],
        room.matrices[2],
        room.matrices[3],
    )
    way, middle, force, way_j, middle_j = (
        room.vectors[4],
        room.vectors[5],
        room.vectors[6],
        room.vectors[7],
        room.vectors[8],
    )
    rubbing, slope, slip = room.rubbing[p], room.slopes[p], room.slip[p]
    d = len(room.space)
    # how much of the step the touch lasts, the limits of friction there, and their derivatives by
    # `after`
    lasts, by_lasts = 1.0, 0.0
    first, last, by_first, by_last = mu * push, mu * push, mu * by_after, mu * by_after
    until, kept, drawn, rate = 0.0, 1.0, 0.0, 0.0  # the way that sticks; what is kept of `begin`
    if interval.line:
        mean, by_mean = mean_normal_force(before, after)
        lasts, by_lasts = touch_lasts(before, after, room.lean[p])
        lean = push / mean if mean > 0.0 else 0.0  # the limit leans as the normal force does
        by_lean = (by_after - lean * by_mean) / mean if mean > 0.0 else 0.0
        first, by_first = mu * lean * max(before, 0.0), mu * by_lean * max(before, 0.0)
        last, by_last = (
            mu * lean * max(after, 0.0),
            mu * (by_lean * after + lean) if after > 0.0 else 0.0,
        )
        if before < 0.0:  # from nothing, so that its mean is that of the normal force
            last, by_last = (
                2.0 * mu * push / lasts,
                2.0 * mu * (by_after - push * by_lasts / lasts) / lasts,
            )
        for k in range(d):
            drawn += (kt * begin[k]) ** 2
        drawn = np.sqrt(drawn)
        if drawn > first:  # e_a is within the limit
            kept = first / drawn
    for k in range(d):
        way[k] = lasts * (finish[k] - begin[k])
    if interval.line:
        a, b, c = (
            -((last - first) ** 2),
            -first * (last - first),
            min(kept * drawn - first, 0.0) * (kept * drawn + first),
        )
        for k in range(d):
            a += (kt * way[k]) ** 2
            b += kt * kt * kept * begin[k] * way[k]
        until = sticks_until(a, b, c)
        rate = a * until + b
    # the law in the middle of what is left
    rest = 0.5 if interval.line else 1.0
    share = until + rest * (1.0 - until)
    limit, trial, motion = first + share * (last - first), 0.0, STICK
    for k in range(d):
        middle[k] = kept * begin[k] + share * way[k]
    if until < 1.0:
        motion, trial = return_mapping(kt, limit, n, middle, force)
    room.motion[p] = motion
    for k in range(d):
        rubbing[k] = kt * until * (kept * begin[k] + 0.5 * until * way[k])
        slip[k] = 0.0
        if until < 1.0:
            rubbing[k] += (1.0 - until) * force[k]
        if motion == SLIP:
            slip[k] = (middle[k] - force[k] / kt) / theta
        if interval.line:  # also what was let go before
            slip[k] += finish[k] - kept * begin[k] - way[k]
    for j in range(d):
        first_j, last_j, lasts_j = (
            by_first * steepest[j],
            by_last * steepest[j],
            by_lasts * steepest[j],
        )
        kept_j, until_j, along = 0.0, 0.0, 0.0
        if kept < 1.0:
            for k in range(d):
                along += kt * kt * begin[k] * by_begin[k, j]
            kept_j = (first_j - kept * along / drawn) / drawn
        for k in range(d):
            way_j[k] = lasts_j * (finish[k] - begin[k]) + lasts * (by_finish[k, j] - by_begin[k, j])
            middle_j[k] = kept_j * begin[k] + kept * by_begin[k, j]  # of e_a, so far
            slope[k, j] += (
                lasts * kt * until * (middle_j[k] + 0.5 * until * way_j[k]) + lasts_j * rubbing[k]
            )
        if until == 1.0:
            continue
        if until > 0.0 and rate > 0.0:
            bound, along = first + until * (last - first), 0.0
            for k in range(d):
                along += (kept * begin[k] + until * way[k]) * (middle_j[k] + until * way_j[k])
            until_j = (bound * (first_j + until * (last_j - first_j)) - kt * kt * along) / rate
        share_j = (1.0 - rest) * until_j
        limit_j = first_j + share * (last_j - first_j) + share_j * (last - first)
        along = 0.0
        for k in range(d):
            slope[k, j] += lasts * until_j * (kt * (kept * begin[k] + until * way[k]) - force[k])
            middle_j[k] += share * way_j[k] + share_j * way[k]
            along += force[k] * middle_j[k]
        for k in range(d):
            change = kt * middle_j[k]
            if motion == SLIP:  # the limit, and what turns the force
                change = 0.0
                if limit > 0.0:
                    change = (limit_j - along * kt / trial) / limit * force[
                        k
                    ] + limit * kt / trial * middle_j[k]
            slope[k, j] += lasts * (1.0 - until) * change
    for k in range(d):
        rubbing[k] *= lasts
