"""Contact forces of a point along a given periodic path, with their derivatives by the path.

Between equal instants of the period the point goes straight, as in a step of the discrete gradient,
so that the forces are means over these steps. The memory of the law is the slider w: a period maps
the slider at its start to that at its end, w -> W(w, x). The forces repeat if w does. The periodic
slider is found by periods from rest and, where these settle slowly, by Newton's method,

    (1 - dW/dw) dw = W(w, x) - w,                                                          (1)

in the directions in which the point slips at least once. A point that sticks all the time keeps its
slider; that of a point which slips at first only stays where the first period has dragged it. The
derivatives by the path are carried along, through all periods. After (1) they are exact only in
the directions in which the slider is unique.
"""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.law import end_of_step, point_force
from fenicsrom.online.contact.state import Interval
from fenicsrom.online.contact.surfaces import PLANE, Contacts
from fenicsrom.online.derivative.contact_sensitivity import state_of
from fenicsrom.online.kernels.compilation import compiled, part
from fenicsrom.online.kernels.numbers import Dual, Vector, plus, vector

MOST_PERIODS = 30
REPEATS = 1e-12  # relative to the path: a slider that moves by less in a period repeats
SETTLES = 0.1  # of the motion of the slider in the period before: periods that settle fast
HELD = 1e-9  # of a singular value of 1 - dW/dw: a direction in which the slider stays where it is


class Orbit(NamedTuple):
    """The contact of a point along a periodic path of T steps.

    Attributes:
        mean: (T, d) mean force of each step, N.
        slopes: (T, d, d C) its derivatives by the coefficients of the path, those of each axis
            together.
        force: (T, d) force at the end of each step, N.
        trial: (T,) normal force there before it is clamped at zero, N.
        slider: (T, d) there, m.
        dissipated: (T,) energy that friction dissipates in the step, J.
        state: (T,) OPEN, SLIP or STICK.
        free: number of directions in which the slider is not unique.
    """

    mean: Annotated[Array, "T d"]
    slopes: Annotated[Array, "T d columns"]
    force: Annotated[Array, "T d"]
    trial: Annotated[Array, "T"]
    slider: Annotated[Array, "T d"]
    dissipated: Annotated[Array, "T"]
    state: Annotated[NDArray[np.int8], "T"]
    free: int = 0


@part
def _duals(u: Vector, seeded: bool) -> Vector:
    """A vector with derivatives by its own components, or constants."""
    slope = 1.0 if seeded else 0.0
    return (Dual(u[0], slope, 0.0, 0.0), Dual(u[1], 0.0, slope, 0.0), Dual(u[2], 0.0, 0.0, slope))


@part
def _write_slopes(u: Vector, out: Array) -> None:
    """Write the derivatives of a vector of duals into an array (3, 3)."""
    out[0, 0], out[0, 1], out[0, 2] = u[0].a, u[0].b, u[0].c
    out[1, 0], out[1, 1], out[1, 2] = u[1].a, u[1].b, u[1].c
    out[2, 0], out[2, 1], out[2, 2] = u[2].a, u[2].b, u[2].c


@compiled
def march_point(
    contacts: Contacts,
    p: int,
    x: Array,
    waves: Array,
    period: float,
    w: Array,
    by: Array,
    orbit: Orbit,
) -> None:
    """Apply the law of point p over the steps of a period.

    Args:
        contacts: the parameters.
        p: the point.
        x: (T, d) its displacements at equal instants from the start of the period, m.
        waves: (T, C) their derivatives by the C coefficients of the same axis.
        period: s.
        w: (d,) in: slider at the start; out: at the end.
        by: (d, d + d C) in and out: its derivatives by itself at the start, and by the path.
        orbit: out; its `slopes` (T, d, d + d C) are by the same columns.
    """
    (count, d), columns, h = x.shape, waves.shape[1], period / x.shape[0]
    mean, last, before = np.zeros((3, 3, 3)), np.zeros((3, 3, 3)), np.empty_like(by)
    follows = contacts.friction[p] == 0.0
    for i in range(count):
        after = (i + 1) % count
        step = Interval(i * h, (i + 1) * h, 0.5, True)
        for g in range(3):  # derivatives by the start, by the end, and by the slider
            here = _duals(vector(x[i]), g == 0)
            there = _duals(vector(x[after]), g == 1)
            slider = here
            if not follows:
                slider = _duals(vector(w), g == 2)
            start = state_of(contacts, p, here, slider, step.begin)
            if g == 0 and not follows and start.trial.v <= 0.0:
                follows = True
                slider = here
                start = state_of(contacts, p, here, slider, step.begin)
            found = point_force(contacts, step, p, start, there, 0.0)
            end = end_of_step(contacts, step, p, start, there, found)
            whole, held = plus(found.normal, found.friction), end.state
            _write_slopes(whole, mean[g])
            _write_slopes(held.slider, last[g])
        force = plus(held.normal, held.friction)
        orbit.trial[i], orbit.state[i], orbit.dissipated[i] = (
            held.trial.v,
            end.mode,
            end.dissipated.v,
        )
        before[:] = by
        means, ends = (whole[0].v, whole[1].v, whole[2].v), (force[0].v, force[1].v, force[2].v)
        sliders = (held.slider[0].v, held.slider[1].v, held.slider[2].v)
        for a in range(d):
            orbit.mean[i, a], orbit.force[i, a] = means[a], ends[a]
            orbit.slider[i, a] = w[a] = sliders[a]
            for c in range(by.shape[1]):
                slope, slid = 0.0, 0.0
                for b in range(d):
                    slope += mean[2, a, b] * before[b, c]
                    slid += last[2, a, b] * before[b, c]
                orbit.slopes[i, a, c], by[a, c] = slope, slid
            for b in range(d):
                for c in range(columns):
                    u, v, k = waves[i, c], waves[after, c], d + b * columns + c
                    orbit.slopes[i, a, k] += mean[0, a, b] * u + mean[1, a, b] * v
                    by[a, k] += last[0, a, b] * u + last[1, a, b] * v
        follows = contacts.friction[p] == 0.0


def periodic_orbit(
    contacts: Contacts, p: int, x: Array, waves: Array, period: float, rest: Array
) -> Orbit | None:
    """The contact of point p along a periodic path; None if its slider does not come to repeat.

    Args:
        contacts: the parameters.
        p: the point.
        x: (T, d) its displacements at the instants k period / T, m.
        waves: (T, C) as in `march_point`; (T, 0) leaves the derivatives out.
        period: s.
        rest: (d,) slider before the motion, which a point that sticks all the time keeps.
    """
    (count, d), unit = x.shape, np.eye(x.shape[1])
    columns = d + d * waves.shape[1]
    orbit = zeros(Orbit, {"free": 0}, T=count, d=d, columns=columns)
    w, by = rest.copy(), np.zeros((d, columns))
    size, last, slow = REPEATS * float(np.max(np.abs(x))), np.inf, False
    for _ in range(MOST_PERIODS):
        start, carried = w.copy(), by[:, d:].copy()
        by[:, :d] = unit
        march_point(contacts, p, x, waves, period, w, by, orbit)
        if contacts.kind[p] == PLANE:  # the normal component of its slider has no meaning
            w[0], by[0] = start[0], 0.0
        change, moved = unit - by[:, :d], float(np.max(np.abs(w - start)))
        if moved <= size:
            free = int(np.sum(np.linalg.svd(change, compute_uv=False) < HELD))
            return orbit._replace(slopes=orbit.slopes[:, :, d:], free=free)
        slow = slow or moved > SETTLES * last
        if slow:
            back = np.linalg.pinv(change, rcond=HELD)
            w[:] = start + back @ (w - start)
            by[:, d:] = carried + back @ (by[:, d:] - carried)
        last = moved
    return None
