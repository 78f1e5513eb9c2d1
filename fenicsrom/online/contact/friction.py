"""Normal and friction force of one contact point over a time step, in closed form.

Over a step from t0 to t1 the point moves straight from x0 to x1. Its trial normal force goes from
y0 to y1; the normal force is N = max(y, 0). The discrete gradient of the spring energy,

    N_m = (N1^2 - N0^2) / (2 (y1 - y0)),                                                        (1)

is the mean normal force of the step (`mean_normal_force`). Where the step is too long to resolve
the contact, this mean is blended with the force at the end, with a weight b (`implicit_blending`):

    N_b = N_m + b (N1 - N_m)                                                                    (2)

(`blended_normal_force`). The point touches during the fraction tau of the step
(`contact_fraction`). For a touch that begins in the step (y0 < 0 < y1) and one that ends in it,

    tau = b + (1 - b) y1/(y1 - y0),        tau = -y0/(y1 - y0).                                 (3)

The friction spring has the tangential stretch e = P (x - w), from e0 at the start to e1 at the
end. The limit of friction goes linearly from La to Lb while the point touches,

    La = mu (N_b/N_m) N0,    Lb = mu (N_b/N_m) N1,    for y0 < 0: La = 0, Lb = 2 mu N_b/tau    (4)

(`friction_limits`); in the last case the mean limit is that of the mean normal force. A stretch e0
beyond the first limit is cut to this limit,

    ea = c e0,    c = min(1, La/(k_t |e0|)),                                                    (5)

(`kept_part`). While the point touches, s in [0, 1], it sticks with the force

    T(s) = k_t (ea + s G),    G = tau (e1 - e0),                                                (6)

until |T(s)| = La + s (Lb - La). The first such s is s*, the smallest root of the quadratic

    A s^2 + 2 B s + C = 0,    A = k_t^2 |G|^2 - (Lb - La)^2,
    B = k_t^2 ea . G - La (Lb - La),    C = k_t^2 |ea|^2 - La^2 <= 0,                           (7)

or 1 if there is none (`locate_slip`). From s* on the point slips. In the rest of the touch, the law
is applied at its middle sm = (1 + s*)/2, with the limit Lm = La + sm (Lb - La),

    Ts = Lm e_m/|e_m|,    e_m = ea + sm G,                                                      (8)

so that the mean friction of the step and the motion of the slider are

    T_m = tau [k_t s* (ea + s* G/2) + (1 - s*) Ts],                                             (9)
    dw = e_m - Ts/k_t + (e1 - ea - G)                                                          (10)

(`mean_friction`). `add_friction_derivative` differentiates (9) by x1; from (7),

    ds*/dx1 = [Ls dLs - k_t^2 (ea + s* G) . (dea + s* dG)] / (A s* + B),                       (11)
    Ls = La + s* (Lb - La)

The schemes that weight the ends of the step apply the law once, at the weighted point: then
tau = 1, La = Lb = mu N, s* = 0, sm = 1, and the slider moves by dw/(1 - a).

The return mapping and its dissipation: Simo and Hughes (1998), Computational Inelasticity; friction
with a varying normal load: Yang and Menq (1998).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.state import SLIP, STICK, ContactScratch, ContactStep, Interval
from fenicsrom.online.kernels.compilation import kernel, part


class FrictionLimits(NamedTuple):
    """Limits of friction over a step, equations (3) and (4).

    Attributes:
        fraction: tau, fraction of the step during which the point touches.
        fraction_by_end: derivative of `fraction` by y1, the trial normal force at the end, 1/N.
        first: La, limit where the touch begins, N.
        first_by_end: derivative of `first` by y1.
        last: Lb, limit where the touch ends, N.
        last_by_end: derivative of `last` by y1.
    """

    fraction: float
    fraction_by_end: float
    first: float
    first_by_end: float
    last: float
    last_by_end: float


class SlipEvent(NamedTuple):
    """Where a point turns from stick to slip in a step, equations (5) to (8).

    Attributes:
        kept: c, the part of the stretch at the start that is within the limit.
        start_force: k_t |e0|, N.
        stick_until: s*.
        rate: A s* + B, half the derivative of the quadratic at s*.
        slip_at: sm, where the slipping part is evaluated.
        limit: Lm, limit of friction there, N.
        trial_force: k_t |e_m|, N; 0 if the point does not slip.
        mode: SLIP or STICK.
    """

    kept: float
    start_force: float
    stick_until: float
    rate: float
    slip_at: float
    limit: float
    trial_force: float
    mode: int


@part
def positive(x: float) -> float:
    """The positive part of a number."""
    return max(x, 0.0)


@part
def mean_normal_force(before: float, after: float) -> tuple[float, float]:
    """Mean normal force along a straight step, equation (1).

    Args:
        before: y0, trial normal force at the start of the step, N.
        after: y1, the same at its end, N.

    Returns:
        The mean force in N, and its derivative by `after`.
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
def blended_normal_force(before: float, after: float, blending: float) -> tuple[float, float]:
    """Mean normal force blended with the force at the end, equation (2).

    The normal force grows with the penetration, so the blending takes energy in every step:
    (N1 - N_m) (y1 - y0) >= 0.

    Returns:
        The force in N, and its derivative by `after`.
    """
    mean, mean_by_end = mean_normal_force(before, after)
    if blending == 0.0:
        return mean, mean_by_end
    end, end_by_end = (after, 1.0) if after > 0.0 else (0.0, 0.0)
    return mean + blending * (end - mean), mean_by_end + blending * (end_by_end - mean_by_end)


@part
def contact_fraction(before: float, after: float, blending: float) -> tuple[float, float]:
    """Fraction of a straight step during which a point touches, equation (3).

    A normal force that is blended with the one at the end acts along the whole step, and so does
    its friction. Without this, an impact too short for the step would pass without friction.

    Returns:
        The fraction, and its derivative by `after` in 1/N.
    """
    span = after - before
    if before < 0.0 < after:
        return (
            blending + (1.0 - blending) * after / span,
            -(1.0 - blending) * before / span**2,
        )
    if after < 0.0 < before:
        return -before / span, before / span**2
    return (1.0, 0.0) if before >= 0.0 and after >= 0.0 else (0.0, 0.0)


@part
def friction_limits(
    mu: float, before: float, after: float, force: float, force_by_end: float, blending: float
) -> FrictionLimits:
    """Limits of friction over a step, equations (3) and (4).

    Args:
        mu: coefficient of friction.
        before: y0, N.
        after: y1, N.
        force: N_b, mean normal force of the step, N.
        force_by_end: derivative of `force` by y1.
        blending: b.
    """
    if before <= 0.0 and after <= 0.0:  # a worn surface that touches in the middle of the step
        limit, limit_by_end = mu * force, mu * force_by_end
        return FrictionLimits(
            1.0 + 0.0 * force, 0.0 * force, limit, limit_by_end, limit, limit_by_end
        )
    mean, mean_by_end = mean_normal_force(before, after)
    fraction, fraction_by_end = contact_fraction(before, after, blending)
    ratio = force / mean if mean > 0.0 else 0.0
    ratio_by_end = (force_by_end - ratio * mean_by_end) / mean if mean > 0.0 else 0.0
    first, first_by_end = mu * ratio * positive(before), mu * ratio_by_end * positive(before)
    last = mu * ratio * positive(after)
    last_by_end = mu * (ratio_by_end * after + ratio) if after > 0.0 else 0.0
    if before < 0.0:
        last = 2.0 * mu * force / fraction
        last_by_end = 2.0 * mu * (force_by_end - force * fraction_by_end / fraction) / fraction
    return FrictionLimits(fraction, fraction_by_end, first, first_by_end, last, last_by_end)


@part
def kept_part(stiffness: float, stretch: Array, limit: float) -> tuple[float, float]:
    """The part c of a stretch (d,) that the limit of friction allows, equation (5).

    Returns:
        c, and the force k_t |e| of the whole stretch in N.
    """
    force = 0.0
    for k in range(stretch.size):
        force += (stiffness * stretch[k]) ** 2
    force = np.sqrt(force)
    return (limit / force if force > limit else 1.0), force


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
def project_on_tangent_plane(
    n: Array, n_derivative: Array, weight: float, vector: Array, derivative: Array, work: Array
) -> None:
    """Project a vector on the plane of a unit normal, in place, and differentiate the projection.

    Args:
        n: (d,) unit normal.
        n_derivative: (d, d) derivative of `n` by x1.
        weight: the derivative of the vector by x1 is weight I.
        vector: (d,) in and out.
        derivative: (d, d) out: derivative of the projection by x1.
        work: (d,) scratch.
    """
    d = n.size
    across = 0.0
    for k in range(d):
        across += n[k] * vector[k]
    for j in range(d):
        work[j] = 0.0
        for i in range(d):
            work[j] += vector[i] * n_derivative[i, j]
    for k in range(d):
        vector[k] -= across * n[k]
        for j in range(d):
            derivative[k, j] = (
                (weight if k == j else 0.0)
                - weight * n[k] * n[j]
                - across * n_derivative[k, j]
                - n[k] * work[j]
            )


@part
def first_root(a: float, b: float, c: float) -> float:
    """First s in [0, 1] at which a s^2 + 2 b s + c <= 0 becomes positive; 1 if there is none."""
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
def locate_slip(
    stiffness: float,
    limits: FrictionLimits,
    kept: float,
    start_force: float,
    start_stretch: Array,
    stretch_change: Array,
) -> tuple[float, float]:
    """Where a sticking point begins to slip, equation (7).

    Returns:
        s*, and A s* + B.
    """
    first, last = limits.first, limits.last
    a, b, c = (
        -((last - first) ** 2),
        -first * (last - first),
        min(kept * start_force - first, 0.0) * (kept * start_force + first),
    )
    for k in range(start_stretch.size):
        a += (stiffness * stretch_change[k]) ** 2
        b += stiffness * stiffness * kept * start_stretch[k] * stretch_change[k]
    until = first_root(a, b, c)
    return until, a * until + b


@part
def slip_event(
    stiffness: float, interval: Interval, limits: FrictionLimits, scratch: ContactScratch
) -> SlipEvent:
    """Locate the slip of a point in a step, and apply the law in the slipping part: (5) to (8).

    The stretches at the ends of the step are read from `scratch.point`; `stretch_change`,
    `slip_stretch` and `slip_force` are written there.
    """
    point, d = scratch.point, len(scratch.space)
    start, end, change = point.start_stretch, point.end_stretch, point.stretch_change
    kept, start_force, until, rate, remainder = 1.0, 0.0, 0.0, 0.0, 1.0
    for k in range(d):
        change[k] = limits.fraction * (end[k] - start[k])
    if interval.discrete_gradient:
        kept, start_force = kept_part(stiffness, start, limits.first)
        until, rate = locate_slip(stiffness, limits, kept, start_force, start, change)
        remainder = 0.5
    slip_at = until + remainder * (1.0 - until)
    limit, trial_force, mode = limits.first + slip_at * (limits.last - limits.first), 0.0, STICK
    for k in range(d):
        point.slip_stretch[k] = kept * start[k] + slip_at * change[k]
    if until < 1.0:
        mode, trial_force = return_mapping(
            stiffness, limit, point.normal, point.slip_stretch, point.slip_force
        )
    return SlipEvent(kept, start_force, until, rate, slip_at, limit, trial_force, mode)


@part
def mean_friction(
    stiffness: float, interval: Interval, event: SlipEvent, p: int, scratch: ContactScratch
) -> None:
    """Write friction (9) of point p without the factor tau, and the motion (10) of its slider."""
    point, theta = scratch.point, 1.0 - interval.start_weight
    start, end, change = point.start_stretch, point.end_stretch, point.stretch_change
    friction, slider_motion = scratch.mean_friction[p], scratch.slider_motion[p]
    kept, until = event.kept, event.stick_until
    for k in range(len(scratch.space)):
        friction[k] = stiffness * until * (kept * start[k] + 0.5 * until * change[k])
        slider_motion[k] = 0.0
        if until < 1.0:
            friction[k] += (1.0 - until) * point.slip_force[k]
        if event.mode == SLIP:
            slider_motion[k] = (point.slip_stretch[k] - point.slip_force[k] / stiffness) / theta
        if interval.discrete_gradient:  # add the stretch that was cut at the start
            slider_motion[k] += end[k] - kept * start[k] - change[k]


# Longer than 60 lines: the terms share a dozen values of one stretch, and each call of a compiled
# function with so many arguments costs more than its arithmetic.
@kernel
def add_friction_derivative(
    step: ContactStep, p: int, limits: FrictionLimits, event: SlipEvent
) -> None:
    """Add the derivative of the mean friction (9) by x1 to `scratch.force_derivative[p]`.

    It is written column by column, j; a name that ends in _j is the derivative by x1[j]. The
    friction of point p is not yet multiplied by tau.
    """
    scratch, kt = step.scratch, step.contacts.tangential_stiffness[p]
    point, d = scratch.point, len(scratch.space)
    start, end, change = point.start_stretch, point.end_stretch, point.stretch_change
    start_derivative, end_derivative = point.start_stretch_derivative, point.end_stretch_derivative
    change_j, stretch_j, force = (
        point.stretch_change_column,
        point.slip_stretch_column,
        point.slip_force,
    )
    friction, derivative = scratch.mean_friction[p], scratch.force_derivative[p]
    first, last, fraction = limits.first, limits.last, limits.fraction
    kept, until = event.kept, event.stick_until
    remainder = 0.5 if step.interval.discrete_gradient else 1.0
    for j in range(d):
        first_j = limits.first_by_end * point.gradient[j]
        last_j = limits.last_by_end * point.gradient[j]
        fraction_j = limits.fraction_by_end * point.gradient[j]
        kept_j, until_j, along = 0.0, 0.0, 0.0
        if kept < 1.0:
            for k in range(d):
                along += kt * kt * start[k] * start_derivative[k, j]
            kept_j = (first_j - kept * along / event.start_force) / event.start_force
        for k in range(d):
            change_j[k] = fraction_j * (end[k] - start[k]) + fraction * (
                end_derivative[k, j] - start_derivative[k, j]
            )
            stretch_j[k] = kept_j * start[k] + kept * start_derivative[k, j]  # derivative of ea
            derivative[k, j] += (
                fraction * kt * until * (stretch_j[k] + 0.5 * until * change_j[k])
                + fraction_j * friction[k]
            )
        if until == 1.0:
            continue
        if until > 0.0 and event.rate > 0.0:  # equation (11)
            bound, along = first + until * (last - first), 0.0
            for k in range(d):
                along += (kept * start[k] + until * change[k]) * (
                    stretch_j[k] + until * change_j[k]
                )
            until_j = (
                bound * (first_j + until * (last_j - first_j)) - kt * kt * along
            ) / event.rate
        slip_at_j = (1.0 - remainder) * until_j
        limit_j = first_j + event.slip_at * (last_j - first_j) + slip_at_j * (last - first)
        along = 0.0
        for k in range(d):
            derivative[k, j] += (
                fraction * until_j * (kt * (kept * start[k] + until * change[k]) - force[k])
            )
            stretch_j[k] += event.slip_at * change_j[k] + slip_at_j * change[k]
            along += force[k] * stretch_j[k]
        for k in range(d):
            force_j = kt * stretch_j[k]
            if event.mode == SLIP:  # the limit changes the size, the stretch the direction
                force_j = 0.0
                if event.limit > 0.0:
                    force_j = (limit_j - along * kt / event.trial_force) / event.limit * force[
                        k
                    ] + event.limit * kt / event.trial_force * stretch_j[k]
            derivative[k, j] += fraction * (1.0 - until) * force_j


@kernel
def friction_force(
    step: ContactStep, p: int, after: float, force: float, force_by_end: float, derive: bool
) -> None:
    """Mean friction of point p over a step and motion of its slider, equations (3) to (11).

    Args:
        step: the step. In its scratch arrays, in: `point.normal`, `point.gradient` (of y1) and
            the stretches with their derivatives; out: `mean_friction`, `slider_motion` and `mode`
            of the point.
        p: the point.
        after: y1, N.
        force: mean normal force of the step, N.
        force_by_end: derivative of `force` by y1.
        derive: whether its derivative is added to `force_derivative`.
    """
    interval, scratch, before = step.interval, step.scratch, step.start.trial_normal_force[p]
    kt, mu = step.contacts.tangential_stiffness[p], step.contacts.friction[p]
    limits = FrictionLimits(
        1.0 + 0.0 * force,  # of the same number type as the force, real or complex
        0.0 * force,
        mu * force,
        mu * force_by_end,
        mu * force,
        mu * force_by_end,
    )
    if interval.discrete_gradient:
        limits = friction_limits(mu, before, after, force, force_by_end, scratch.blending[p])
    event = slip_event(kt, interval, limits, scratch)
    scratch.mode[p] = event.mode
    mean_friction(kt, interval, event, p, scratch)
    if derive:
        add_friction_derivative(step, p, limits, event)
    for k in range(len(scratch.space)):
        scratch.mean_friction[p, k] *= limits.fraction
