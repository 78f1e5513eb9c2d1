"""Normal and friction force of one contact point over a time step, in closed form.

Over a step from t0 to t1 the point moves straight from x0 to x1. Its trial normal force goes from
y0 to y1; the normal force is N = max(y, 0). The discrete gradient of the spring energy,

    N_m = (N1^2 - N0^2) / (2 (y1 - y0)),                                                        (1)

is the mean normal force of the step (`mean_of_positive`). Where the step is too long to resolve
the contact, this mean is blended with the force at the end, with a weight b (`implicit_blending`):

    N_b = N_m + b (N1 - N_m)                                                                    (2)

(`blended`). The point touches during the fraction tau of the step
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

or 1 if there is none (`first_root`). From s* on the point slips. In the rest of the touch, the law
is applied at its middle sm = (1 + s*)/2, with the limit Lm = La + sm (Lb - La),

    Ts = Lm e_m/|e_m|,    e_m = ea + sm G,                                                      (8)

so that the mean friction of the step and the motion of the slider are

    T_m = tau [k_t s* (ea + s* G/2) + (1 - s*) Ts],                                             (9)
    dw = (e_m - Ts/k_t)/(1 - a) + (e1 - ea - G),    a = 1/2,                                   (10)

(`friction`). Every function runs on the numbers of `fenicsrom.online.kernels.numbers`, so that the
derivatives are those of the equations.

The schemes that weight the ends of the step apply the law once, at the weighted point: then
tau = 1, La = Lb = mu N, s* = 0 and sm = 1, with their weight a of the start.

The return mapping and its dissipation: Simo and Hughes (1998), Computational Inelasticity; friction
with a varying normal load: Yang and Menq (1998).
"""

from fenicsrom.online.contact.state import SLIP, STICK
from fenicsrom.online.kernels.compilation import part
from fenicsrom.online.kernels.numbers import (
    Number,
    Vector,
    constant,
    dot,
    minus,
    plus,
    positive,
    root,
    times,
    value,
)


@part
def mean_of_positive(before: Number, after: Number) -> Number:
    """Mean of the positive part along a straight step, equation (1)."""
    first, last = value(before), value(after)
    if first >= 0.0 and last >= 0.0:
        return 0.5 * (before + after)
    if first <= 0.0 and last <= 0.0:
        return constant(before + after, 0.0)
    if last > 0.0:
        return 0.5 * after * after / (after - before)
    return 0.5 * before * before / (before - after)


@part
def blended(before: Number, after: Number, blending: Number) -> Number:
    """Mean normal force blended with the force at the end, equation (2), N.

    The normal force grows with the penetration, so the blending takes energy in every step:
    (N1 - N_m) (y1 - y0) >= 0.
    """
    mean = mean_of_positive(before, after)
    return mean + blending * (positive(after) - mean)


@part
def contact_fraction(before: Number, after: Number, blending: Number) -> Number:
    """Fraction of a straight step during which a point touches, equation (3).

    A normal force that is blended with the one at the end acts along the whole step, and so does
    its friction. Without this, an impact too short for the step would pass without friction.
    """
    first, last = value(before), value(after)
    if first < 0.0 < last:
        return blending + (1.0 - blending) * after / (after - before)
    if last < 0.0 < first:
        return before / (before - after)
    return constant(after - before, 1.0 if first >= 0.0 and last >= 0.0 else 0.0)


@part
def friction_limits(
    mu: Number, before: Number, after: Number, force: Number, blending: Number
) -> Vector:
    """tau, La and Lb of a step with the mean normal force N_b > 0: equations (3) and (4)."""
    limit = mu * force
    if value(before) <= 0.0 and value(after) <= 0.0:
        return constant(limit, 1.0), limit, limit  # a worn surface that touches in the step only
    mean, fraction = mean_of_positive(before, after), contact_fraction(before, after, blending)
    ratio = limit / mean if value(mean) > 0.0 else constant(limit, 0.0)
    last = 2.0 * limit / fraction if value(before) < 0.0 else ratio * positive(after)
    return fraction, ratio * positive(before), last


@part
def kept_part(stiffness: Number, stretch: Vector, limit: Number) -> Number:
    """The part c of a stretch that the limit of friction allows, equation (5)."""
    force = stiffness * root(dot(stretch, stretch))
    return limit / force if value(force) > value(limit) else constant(force, 1.0)


@part
def return_mapping(stiffness: Number, limit: Number, stretch: Vector) -> tuple[Vector, int]:
    """The projection of the trial friction k_t e on the disc of a radius, and SLIP or STICK."""
    trial = times(stiffness, stretch)
    size = root(dot(trial, trial))
    if value(size) < value(limit) or (value(size) == value(limit) and value(limit) > 0.0):
        return trial, STICK
    return times(limit / size if value(size) > 0.0 else constant(limit, 0.0), trial), SLIP


@part
def first_root(a: Number, b: Number, c: Number) -> Number:
    """First s in [0, 1] at which a s^2 + 2 b s + c <= 0 becomes positive; 1 if there is none."""
    one, square = constant(c, 1.0), b * b - a * c
    if value(square) < 0.0 or (value(b) < 0.0 and value(a) <= 0.0):
        return one
    found, size = one, root(square)
    if value(b) < 0.0:
        found = (size - b) / a
    elif value(b) + value(size) > 0.0:
        found = -1.0 * c / (b + size)
    elif value(a) > 0.0:
        return constant(c, 0.0)
    return found if value(found) < 1.0 else one


@part
def first_slip(stiffness: Number, first: Number, last: Number, e: Vector, change: Vector) -> Number:
    """s*, where a point that sticks with the stretch ea + s G begins to slip, equation (7).

    Args:
        stiffness: k_t, N/m.
        first: La, N.
        last: Lb, N.
        e: ea, m.
        change: G, m.
    """
    rise, square = last - first, stiffness * stiffness
    start = stiffness * root(dot(e, e))
    a, b = square * dot(change, change) - rise * rise, square * dot(e, change) - first * rise
    return first_root(a, b, -1.0 * positive(first - start) * (first + start))


@part
def friction(
    stiffness: Number,
    first: Number,
    last: Number,
    fraction: Number,
    e0: Vector,
    e1: Vector,
    theta: float,
    line: bool,
) -> tuple[Vector, Vector, int]:
    """Mean friction (9) of a step, N, the motion (10) of its slider, m, and SLIP or STICK.

    The schemes that weight the ends of the step (`line` is False) apply the law once, at e1.

    Args:
        stiffness: k_t, N/m.
        first: La, N.
        last: Lb, N.
        fraction: tau.
        e0: the tangential stretch at the start, m.
        e1: that at the end, m.
        theta: 1 - a.
        line: whether slip is located along the straight path.
    """
    change, ea, until = times(fraction, minus(e1, e0)), e0, constant(first, 0.0)
    if line:
        ea = times(kept_part(stiffness, e0, first), e0)
        until = first_slip(stiffness, first, last, ea, change)
    mean = times(stiffness * until, plus(ea, times(0.5 * until, change)))
    cut = minus(minus(e1, ea), change)  # (10) of a point that sticks
    if value(until) >= 1.0:
        return times(fraction, mean), cut, STICK
    at = until + (0.5 if line else 1.0) * (1.0 - until)
    stretch = plus(ea, times(at, change))
    slipping, mode = return_mapping(stiffness, first + at * (last - first), stretch)
    mean = plus(mean, times(1.0 - until, slipping))
    slid = minus(stretch, times(1.0 / stiffness, slipping))
    moved = times(1.0 / theta if mode == SLIP else 0.0, slid)
    return times(fraction, mean), plus(moved, cut) if line else moved, mode
