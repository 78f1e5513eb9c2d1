"""Friction between points of the structure and rigid surfaces: one statement of the law, for every model.

A point is described by its displacement x (d,) in its own frame, whose first axis is the normal into the surface at the place
of the undeformed body, the others tangents there. The forces below act against the motion: the residual of the equations of
motion gains + B F. With the penetration delta(x, t) of the surface, n = grad delta, P = I - n n^T / |n|^2 and the slider w, a
point of the surface that friction pulls the body towards,

    y = N0 + k_n delta                         N = max(0, y)                the normal force is N n
    T = k_t P (x - w)                          if |T| <= mu N               stick, the slider rests on the surface
    T = mu N T/|T|                             otherwise                    slip, the slider is dragged: w = x - T/k_t
    T = 0, w = x                               if N = 0                     open, the slider follows

Surfaces are planes, cylinders and spheres, seen from inside (a casing) or outside, that may close in on the body and turn about
their axis; a cylinder may have waves. The normal is that of the current position, however far the point slides.

Over a time step the forces are weighted means of those at its ends, or (the discrete gradient) means along the straight way
of the point, as the scheme asks. Along the way every change of state is located within the step, in closed form: opening and
closing, and, with the limit of friction that goes with the normal force, where stick turns to slip (`rub`). What is left of the
step slips under the law at its middle: exact for a point that slides to and fro, of second order for one that turns as it
slides. Where the contact is too stiff for the step, the mean normal force leans to that at the end, which takes energy from
what would ring (`lean_to_the_end`); when a touch begins leans with it (`touch_lasts`). The weighted schemes apply the law at
the weighted point x_w = a x0 + (1 - a) x1, from which the slider moves on to the end, w1 = w0 + (w_w - w0)/(1 - a).

At the end the law is applied once more. In the discrete gradient friction so dissipates in every step, whatever its size: with
the mean force T and, in the slipping part, T_s at its middle and the way dw of the slider,

    T . dx - d(|T|^2 / 2 k_t) = T_s . dw + (what the law at the ends takes from the spring) >= 0

Everything is pure: it reads the last accepted state and writes into arrays of the caller; a rejected step leaves no trace.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.dense import compiled, kernel, lu_factor, lu_solve, part
from fenicsrom.errors import SceneError

Array = NDArray[np.float64]

OPEN, SLIP, STICK = -1, 0, 1
PLANE, CYLINDER, SPHERE = 1, 2, 3  # the number of coordinates that the distance from the surface depends on

CONTACT_ITERATIONS = 25  # of Newton before it is taken to cycle
CONTACT_SWEEPS = 100  # tens of sweeps before the contact is given up
ROUNDING = 4e-15  # of the displacements: a residual that no update could better


class ContactPoints(NamedTuple):
    """Where P contact points are on the undeformed body.

    Attributes:
        contact: (P,) the entry of the scene's contacts that each belongs to.
        share: (P,) its part of that: 1 for a single point, else area, length or number.
        position: (P, d) m.
        frame: (P, d, d) rows normal into the surface, tangents.
    """

    contact: NDArray[np.int64]
    share: Array
    position: Array
    frame: Array


def no_points(dimension: int) -> ContactPoints:
    """The points of a scene without contact."""
    return ContactPoints(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, dimension)), np.zeros((0, dimension, dimension)))


class Contacts(NamedTuple):
    """The parameters of P contact points in d dimensions and of the surface before each.

    With z = E (x - centre), E the first `kind` rows of `axes`, the penetration is

        delta = side (|z| - radius) + approach(t) + sum_k height_k cos(order_k (phi - spin t) - phase_k)

    where phi is the angle of z; for a plane |z| is z itself, and the waves are those of cylinders.

    Attributes:
        preload: (P,) N0, normal force at penetration zero, N.
        normal_stiffness: (P,) k_n, N/m.
        tangential_stiffness: (P,) k_t, N/m.
        friction: (P,) mu.
        kind: (P,) PLANE, CYLINDER or SPHERE.
        axes: (P, d, d) orthonormal rows.
        centre: (P, d) a point of the plane's, the axis of the cylinder or the centre of the sphere, m.
        radius: (P,) of the surface, of a plane its distance from `centre` along the normal, m.
        side: (P,) 1 if the body is on the side of `centre`, -1 if it is on the other.
        spin: (P,) rate at which the surface turns about its axis, rad/s.
        times: (k,) and
        approach: (P, k) how far the surface has come towards the body by then, linear between them, m.
        order: (h,), height: (P, h) in m and phase: (P, h) in rad of the waves.
    """

    preload: Array
    normal_stiffness: Array
    tangential_stiffness: Array
    friction: Array
    kind: NDArray[np.int64]
    axes: Array
    centre: Array
    radius: Array
    side: Array
    spin: Array
    times: Array
    approach: Array
    order: Array
    height: Array
    phase: Array


def planes(
    preload: Array, gap: Array, normal_stiffness: Array, tangential_stiffness: Array, friction: Array, dimension: int
) -> Contacts:
    """Points each before a plane at rest at a distance `gap`, all (P,): what most scenes have."""
    count = len(preload)
    given = preload, gap, normal_stiffness, tangential_stiffness, friction
    n0, g0, kn, kt, mu = (np.asarray(values, dtype=np.float64) for values in given)
    return Contacts(
        preload=n0, normal_stiffness=kn, tangential_stiffness=kt, friction=mu, kind=np.full(count, PLANE),
        axes=np.tile(np.eye(dimension), (count, 1, 1)), centre=np.zeros((count, dimension)), radius=g0, side=np.ones(count),
        spin=np.zeros(count), times=np.zeros(0), approach=np.zeros((count, 0)), order=np.zeros(0),
        height=np.zeros((count, 0)), phase=np.zeros((count, 0)),
    )  # fmt: skip


def no_contacts(dimension: int = 2) -> Contacts:
    """The contacts of a scene that has none."""
    none = np.zeros(0)
    return planes(none, none, none, none, none, dimension)


def frame(normal: Array) -> Array:
    """The local frame of a unit normal: rows normal, tangents; (d, d), right-handed.

    The first tangent in 3D lies nearest to the first of the axes y, z, x that is least aligned with the normal, so that a
    wall beyond a blade's tip along x has the tangents y and z.
    """
    if normal.size == 2:
        return np.array([normal, [-normal[1], normal[0]]])
    order = [1, 2, 0]
    axis = order[int(np.argmin(np.round(np.abs(normal[order]), 12)))]
    tangent = np.eye(3)[axis] - normal[axis] * normal
    tangent /= np.linalg.norm(tangent)
    return np.array([normal, tangent, np.cross(normal, tangent)])


def surface_normal(contact: Any, position: Array, where: str) -> Array:
    """Unit normal (d,) into the surface of a scene's contact at a position (d,) of the undeformed body.

    Raises:
        SceneError: the position is on the axis or at the centre of the surface; `where` names it.
    """
    if contact.surface is None:
        return np.array(contact.normal)
    z = axes_of(contact.surface, position.size) @ (position - np.array(contact.surface.point))
    size = float(np.linalg.norm(z))
    if size == 0.0:
        raise SceneError(f"{where}.surface.point: must not lie at the contact point itself")
    return np.asarray((1.0 if contact.surface.inside else -1.0) / size * z @ axes_of(contact.surface, position.size))


def axes_of(surface: Any, d: int) -> Array:
    """Orthonormal rows (2 or 3, d) of the directions in which the distance from the axis or centre is measured."""
    return frame(np.array(surface.axis))[1:] if surface.axis is not None else np.eye(d)


def spin_of(scene: Any, surface: Any) -> float:
    """Rate (rad/s) at which a surface turns about its axis, as the body sees it."""
    if surface.spin is not None or scene.rotation is None or surface.kind == "sphere":
        return float(surface.spin or 0.0)
    about = np.dot(surface.axis, scene.rotation.axis) if surface.axis is not None else 1.0
    return -about * 2.0 * np.pi * scene.rotation.speed_rpm / 60.0 if abs(about) > 1.0 - 1e-9 else 0.0


def contacts_of(scene: Any, points: ContactPoints) -> Contacts:
    """The parameters of a scene's contacts at their points.

    Raises:
        SceneError: a given radius lets the surface cut into the undeformed body.
    """
    count, d = points.position.shape
    chosen = [scene.contacts[k] for k in points.contact]

    def of(name: str) -> Array:
        return np.array([getattr(contact, name) for contact in chosen], dtype=np.float64)

    found = planes(
        points.share * of("preload"), of("gap"), points.share * of("normal_stiffness"),
        points.share * of("tangential_stiffness"), of("friction"), d,
    )  # fmt: skip
    times = np.array(sorted({time for contact in scene.contacts for time, _ in contact.approach}))
    orders = sorted({order for contact in scene.contacts if contact.surface for order, _, _ in contact.surface.waves})
    found = found._replace(
        times=times, approach=np.zeros((count, times.size)), order=np.array(orders),
        height=np.zeros((count, len(orders))), phase=np.zeros((count, len(orders))),
    )  # fmt: skip
    for p, contact in enumerate(chosen):
        if contact.approach:
            found.approach[p] = np.interp(times, *np.array(contact.approach).T)
        surface = contact.surface
        if surface is None:
            continue
        axes, local = axes_of(surface, d), points.frame[p]
        found.kind[p] = SPHERE if surface.kind == "sphere" else CYLINDER
        found.axes[p, : len(axes)] = axes @ local.T
        found.centre[p] = local @ (np.array(surface.point) - points.position[p])
        found.side[p] = 1.0 if surface.inside else -1.0
        found.spin[p] = spin_of(scene, surface)
        for order, height, phase in surface.waves:
            found.height[p, orders.index(order)] += height
            found.phase[p, orders.index(order)] = phase
    for k, contact in enumerate(scene.contacts):  # the radius of a surface: given, or the gap beyond the nearest node
        if contact.surface is None:
            continue
        mine = np.flatnonzero(points.contact == k)
        axes = axes_of(contact.surface, d)
        reach = [float(np.linalg.norm(axes @ (points.position[p] - contact.surface.point))) for p in mine]
        nearest = max(reach) if contact.surface.inside else min(reach)
        radius = contact.surface.radius or nearest + (contact.gap if contact.surface.inside else -contact.gap)
        if not radius > 0.0 or (nearest - radius) * (1.0 if contact.surface.inside else -1.0) > 1e-9 * radius:
            raise SceneError(
                f"{scene.source}: contacts[{k}].surface.radius = {radius:.9g}: the surface cuts into the undeformed body, whose "
                f"nearest contact point is at {nearest:.9g} m from its axis or centre"
            )
        found.radius[mine] = radius
    return found


class Touch(NamedTuple):
    """The state of P contact points.

    Attributes:
        x: (P, d) displacement, m.
        raw: (P,) y of the module docstring: the normal force before it is clamped at zero, N.
        normal: (P, d) normal force N n, N.
        friction: (P, d) T, N.
        slider: (P, d) w, m.
        state: (P,) OPEN, SLIP or STICK.
    """

    x: Array
    raw: Array
    normal: Array
    friction: Array
    slider: Array
    state: NDArray[np.int8]


class Room(NamedTuple):
    """Room to work in, and what is found of a step.

    Attributes:
        mean: (P, d) mean force, N.
        rubbing: (P, d) the friction in it, N.
        slip: (P, d) how far the slider goes over the surface, m.
        push: (P,) the normal force in it, N.
        motion: (P,) OPEN, SLIP or STICK.
        slopes: (P, d, d) derivative of the mean force by the displacement at the end, N/m.
        lean: (P,) how far the mean normal force leans to that of the end of the step, in [0, 1].
        space: d zeros: how many is known when this is compiled, and loops over it are unrolled.
    """

    mean: Array
    rubbing: Array
    slip: Array
    push: Array
    motion: NDArray[np.int8]
    slopes: Array
    lean: Array
    guess: Array
    held: Array
    held_rubbing: Array
    residual: Array
    product: Array
    touching: NDArray[np.int64]
    jacobian: Array
    update: Array
    pivots: NDArray[np.int64]
    vectors: Array
    matrices: Array
    space: tuple[int, ...]


class Interval(NamedTuple):
    """A time step.

    Attributes:
        begin: s.
        end: s.
        start_weight: a of the module docstring.
        line: the normal force is its mean along the straight way (discrete gradient) in place of the weighted ends.
    """

    begin: float
    end: float
    start_weight: float
    line: bool


def touch(points: int, d: int) -> Touch:
    """A `Touch` of zeros."""
    return Touch(
        np.zeros((points, d)), np.zeros(points), np.zeros((points, d)), np.zeros((points, d)), np.zeros((points, d)),
        np.zeros(points, dtype=np.int8),
    )  # fmt: skip


def room(points: int, d: int) -> Room:
    """A `Room` for P points in d dimensions."""
    m = points * d
    return Room(
        np.zeros((points, d)), np.zeros((points, d)), np.zeros((points, d)), np.zeros(points), np.zeros(points, dtype=np.int8),
        np.zeros((points, d, d)), np.zeros(points), np.zeros((points, d)), np.zeros((points, d)), np.zeros((points, d)),
        np.zeros((points, d)), np.zeros((points, d)), np.zeros(points, dtype=np.int64),
        np.zeros((m, m)), np.zeros((m, 1)), np.zeros(m, dtype=np.int64),
        np.zeros((9, d)), np.zeros((4, d, d)), (0,) * d,
    )  # fmt: skip


# ---------------------------------------------------------------------- the surface


@part
def penetration(contacts: Contacts, p: int, x: Array, time: float) -> float:
    """How far point p at x (d,) is in its surface, negative before it, m."""
    closed = 0.0
    times = contacts.times
    last = times.size - 1
    if last >= 0:
        k = 0
        while k < last and times[k + 1] < time:
            k += 1
        closed = contacts.approach[p, k]
        if k < last and time > times[k]:
            share = min((time - times[k]) / (times[k + 1] - times[k]), 1.0)
            closed += share * (contacts.approach[p, k + 1] - contacts.approach[p, k])
    if contacts.kind[p] == PLANE:
        return x[0] - contacts.radius[p] + closed
    # |z| - radius = (|z|^2 - radius^2)/(|z| + radius), taken apart so that a small x is not lost in a large radius
    square, added, first, second = 0.0, 0.0, 0.0, 0.0
    for r in range(contacts.kind[p]):
        there, moved = 0.0, 0.0
        for k in range(x.size):
            there -= contacts.axes[p, r, k] * contacts.centre[p, k]
            moved += contacts.axes[p, r, k] * x[k]
        square += there * there
        added += moved * (2.0 * there + moved)
        if r == 0:
            first = there + moved
        elif r == 1:
            second = there + moved
    radius = contacts.radius[p]
    beyond = (square - radius * radius + added) / (np.sqrt(max(square + added, 0.0)) + radius)
    if contacts.order.size > 0 and contacts.kind[p] == CYLINDER:
        angle = np.arctan2(second, first) - contacts.spin[p] * time
        for k in range(contacts.order.size):
            closed += contacts.height[p, k] * np.cos(contacts.order[k] * angle - contacts.phase[p, k])
    return contacts.side[p] * beyond + closed


@kernel
def direction(contacts: Contacts, p: int, x0: Array, x1: Array, time: float, n: Array, slope: Array, there: Array) -> None:
    """The discrete gradient of the penetration between two points, and its derivative by the second.

    n . (x1 - x0) is delta(x1) - delta(x0) exactly for planes, cylinders and spheres, as |z1| - |z0| = (z0 + z1) . (z1 - z0) /
    (|z0| + |z1|), and to third order in the distance for waves. Between a point and itself it is the gradient, and `slope`
    half the second derivative.

    Args:
        contacts: the parameters.
        p: the point.
        x0: (d,) m.
        x1: (d,) m.
        time: s.
        n: (d,) out.
        slope: (d, d) out, 1/m.
        there: (d,) room.
    """
    d = n.size
    for k in range(d):
        n[k] = 0.0
        there[k] = 0.0
        for j in range(d):
            slope[k, j] = 0.0
    if contacts.kind[p] == PLANE:
        n[0] = 1.0
        return
    axes, centre, side = contacts.axes[p], contacts.centre[p], contacts.side[p]
    square0, square1, first, second = 0.0, 0.0, 0.0, 0.0
    for r in range(contacts.kind[p]):
        z0, z1 = 0.0, 0.0
        for k in range(d):
            z0 += axes[r, k] * (x0[k] - centre[k])
            z1 += axes[r, k] * (x1[k] - centre[k])
        square0 += z0 * z0
        square1 += z1 * z1
        for k in range(d):
            n[k] += axes[r, k] * (z0 + z1)
            there[k] += axes[r, k] * z1
        if r == 0:
            first = 0.5 * (z0 + z1)
        elif r == 1:
            second = 0.5 * (z0 + z1)
    end = np.sqrt(square1)
    total = np.sqrt(square0) + end
    for k in range(d):
        n[k] *= side / total
    for k in range(d):
        for j in range(d):
            for r in range(contacts.kind[p]):
                slope[k, j] += side * axes[r, k] * axes[r, j] / total
            slope[k, j] -= n[k] * there[j] / (end * total)
    if contacts.order.size == 0 or contacts.kind[p] != CYLINDER:
        return
    square = first * first + second * second
    angle = np.arctan2(second, first) - contacts.spin[p] * time
    once, twice = 0.0, 0.0  # the derivatives of the waves by the angle
    for k in range(contacts.order.size):
        order, height, phase = contacts.order[k], contacts.height[p, k], contacts.phase[p, k]
        once -= height * order * np.sin(order * angle - phase)
        twice -= height * order**2 * np.cos(order * angle - phase)
    for k in range(d):
        outward = (first * axes[0, k] + second * axes[1, k]) / square
        turned = (first * axes[1, k] - second * axes[0, k]) / square  # the gradient of the angle
        n[k] += once * turned
        for j in range(d):
            outward_j = (first * axes[0, j] + second * axes[1, j]) / square
            turned_j = (first * axes[1, j] - second * axes[0, j]) / square
            slope[k, j] += 0.5 * (twice * turned * turned_j - once * (outward * turned_j + turned * outward_j))


@part
def carry(contacts: Contacts, p: int, time: float, point: Array, out: Array) -> None:
    """Where a point (d,) of the surface is carried by its turning, out (d,), in a time."""
    d = point.size
    for k in range(d):
        out[k] = point[k]
    if contacts.spin[p] == 0.0 or contacts.kind[p] == PLANE:
        return
    axes, centre = contacts.axes[p], contacts.centre[p]
    first, second = 0.0, 0.0
    for k in range(d):
        first += axes[0, k] * (point[k] - centre[k])
        second += axes[1, k] * (point[k] - centre[k])
    angle = contacts.spin[p] * time
    c, s = np.cos(angle) - 1.0, np.sin(angle)
    for k in range(d):
        out[k] += axes[0, k] * (c * first - s * second) + axes[1, k] * (s * first + c * second)


def unit_normals(contacts: Contacts, x: Array, time: Array) -> Array:
    """The unit normals (ns, P, d) of the surfaces at displacements x (ns, P, d) and times (ns,), in the frames of the points."""
    found = np.zeros_like(x)
    found[:, :, 0] = 1.0
    d = x.shape[2]
    slope, spare = np.empty((d, d)), np.empty(d)
    for p in np.flatnonzero(contacts.kind != PLANE):
        for row in range(x.shape[0]):
            direction(contacts, p, x[row, p], x[row, p], time[row], found[row, p], slope, spare)
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))


# ---------------------------------------------------------------------- the law


@part
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


@part
def touch_lasts(before: float, after: float, lean: float) -> tuple[float, float]:
    """For how much of a straight step a point touches, its y as above, and the derivative by `after`.

    Where the normal force leans to the end, so does the touch that it closes with: it is that of the whole step that ends there,
    along all of which the point slides under it. Without, an impact too short for the step would pass without friction.
    """
    span = after - before
    if before < 0.0 < after:
        return lean + (1.0 - lean) * after / span, -(1.0 - lean) * before / span**2
    if after < 0.0 < before:
        return -before / span, before / span**2
    return (1.0, 0.0) if before >= 0.0 and after >= 0.0 else (0.0, 0.0)


@part
def leaning_normal_force(before: float, after: float, lean: float) -> tuple[float, float]:
    """The mean normal force of a step that may be too long for the contact, and its derivative by `after`: as above.

    It lies between the mean along the way and the force at the end. The force grows with the penetration, so the difference
    takes energy, whatever the step: (N1 - mean) (y1 - y0) >= 0.
    """
    mean, slope = mean_normal_force(before, after)
    if lean == 0.0:
        return mean, slope
    end, by_end = (after, 1.0) if after > 0.0 else (0.0, 0.0)
    return mean + lean * (end - mean), slope + lean * (by_end - slope)


@part
def lean_to_the_end(contacts: Contacts, interval: Interval, compliance: Array, here: Touch, room: Room) -> None:
    """Say how far the mean normal force of each point is to lean to the end of the step: `room.lean`.

    Where the step is long for the contact, s = k_n n^T G n > 1, its spring would ring from step to step instead of passing on
    an impact, and with it the limit of friction. The lean s^2/(1 + s^2) stops that; it is of the fourth order in the step, and
    so leaves a contact that the step resolves as it is.

    Args:
        contacts: the parameters.
        interval: the step.
        compliance: (m, m) G, contact displacement at the end of the step by mean contact force, m/N.
        here: the state at the start of the step.
        room: its `lean` is written.
    """
    d = here.x.shape[1]
    n = room.vectors[0]
    for p in range(here.x.shape[0]):
        room.lean[p] = 0.0
        if not interval.line:
            continue
        give = compliance[p * d, p * d]
        if contacts.kind[p] != PLANE:
            direction(contacts, p, here.x[p], here.x[p], interval.begin, n, room.matrices[0], room.vectors[1])
            give = 0.0
            for k in range(d):
                for j in range(d):
                    give += n[k] * compliance[p * d + k, p * d + j] * n[j]
        ratio = contacts.normal_stiffness[p] * give
        room.lean[p] = ratio**2 / (1.0 + ratio**2)


@part
def return_mapping(stiffness: float, limit: float, n: Array, stretch: Array, force: Array) -> tuple[int, float]:
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


@part
def over_step(contacts: Contacts, interval: Interval, p: int, start: Touch, end: Touch, room: Room) -> bool:
    """The mean force of point p over a step to end.x[p], its slope and its parts, into `room`; False if it does not touch."""
    a = interval.start_weight
    theta = 1.0 - a
    kn = contacts.normal_stiffness[p]
    x0, x1, mean, slope = start.x[p], end.x[p], room.mean[p], room.slopes[p]
    d = len(room.space)
    before = start.raw[p]
    after = contacts.preload[p] + kn * penetration(contacts, p, x1, interval.end)
    end.raw[p] = after
    if interval.line:
        push, by_after = leaning_normal_force(before, after, room.lean[p])
    else:
        push = a * max(before, 0.0) + theta * max(after, 0.0)
        by_after = theta if after > 0.0 else 0.0
    room.push[p] = push
    for k in range(d):
        mean[k] = 0.0
        room.rubbing[p, k] = 0.0
        room.slip[p, k] = 0.0
        for j in range(d):
            slope[k, j] = 0.0
    if not push > 0.0:
        room.motion[p] = OPEN
        return False
    flat = contacts.kind[p] == PLANE
    n, steepest, there = room.vectors[0], room.vectors[1], room.vectors[5]
    bend, spare = room.matrices[0], room.matrices[1]
    if flat:
        for k in range(d):
            steepest[k] = 0.0
        steepest[0] = 1.0
        mean[0] = push
        slope[0, 0] = by_after * kn
    else:
        direction(contacts, p, x1, x1, interval.end, steepest, bend, there)
        if interval.line:
            direction(contacts, p, x0, x1, 0.5 * (interval.begin + interval.end), n, spare, there)
            for k in range(d):
                mean[k] = push * n[k]
                for j in range(d):
                    slope[k, j] = by_after * kn * n[k] * steepest[j] + push * spare[k, j]
        else:
            for k in range(d):
                mean[k] = a * start.normal[p, k] + theta * max(after, 0.0) * steepest[k]
                for j in range(d):
                    slope[k, j] = by_after * kn * steepest[k] * steepest[j] + theta * max(after, 0.0) * 2.0 * bend[k, j]
    # friction: the way of the stretch in the tangent plane, from the start of the step to its end or the weighted point
    reach = 1.0 if interval.line else theta
    begin, finish, by_begin, by_finish = room.vectors[2], room.vectors[3], room.matrices[2], room.matrices[3]
    carry(contacts, p, reach * (interval.end - interval.begin), start.slider[p], finish)
    for k in range(d):
        n[k] = steepest[k]
        begin[k] = x0[k] - start.slider[p, k]
        finish[k] = x0[k] + reach * (x1[k] - x0[k]) - finish[k]
    if flat:
        begin[0], finish[0] = 0.0, 0.0
        for k in range(d):
            for j in range(d):
                by_begin[k, j] = 0.0
                by_finish[k, j] = reach if k == j and k > 0 else 0.0
    else:
        middle = room.vectors[4]
        for k in range(d):
            middle[k] = a * x0[k] + theta * x1[k]
        direction(contacts, p, middle, middle, a * interval.begin + theta * interval.end, n, bend, there)
        size = 0.0
        for k in range(d):
            size += n[k] ** 2
        size = np.sqrt(size)
        for k in range(d):
            n[k] /= size
        for j in range(d):
            there[j] = 0.0
            for i in range(d):
                there[j] += 2.0 * n[i] * bend[i, j]
        for k in range(d):  # bend: the derivative of the unit normal by x1
            for j in range(d):
                bend[k, j] = theta * (2.0 * bend[k, j] - n[k] * there[j]) / size
        into_the_plane(n, bend, 0.0, begin, by_begin, there)
        into_the_plane(n, bend, reach, finish, by_finish, there)
    for k in range(d):
        steepest[k] *= kn  # the derivative of `after`
    rub(contacts, interval, p, before, after, push, by_after, room)
    for k in range(d):
        mean[k] += room.rubbing[p, k]
    return True


@kernel
def into_the_plane(n: Array, bend: Array, reach: float, vector: Array, slope: Array, turned: Array) -> None:
    """Project a vector (d,) that moves by `reach` with x1 on the plane of the unit normal n, whose derivative is bend (d, d).

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
            slope[k, j] = (reach if k == j else 0.0) - reach * n[k] * n[j] - across * bend[k, j] - n[k] * turned[j]


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
    contacts: Contacts, interval: Interval, p: int, before: float, after: float, push: float, by_after: float, room: Room
) -> None:
    """The mean friction of point p over a step and the way of its slider; its slope is added to that of the mean force.

    The stretch e goes straight from `begin` to `finish` (their derivatives by x1 are `by_begin` and `by_finish`). Where the
    scheme weighs the ends, friction is the law at `finish`, the weighted point. Along the line the point sticks from where it
    touches,

        T = k_t (e_a + t G)    until    |T| = L_a + t (L_b - L_a),    0 <= t <= 1,

    with the limits of friction L where the touch begins and ends, and then slips: the law in the middle of what is left.
    """
    kt, theta, mu = contacts.tangential_stiffness[p], 1.0 - interval.start_weight, contacts.friction[p]
    n, steepest = room.vectors[0], room.vectors[1]
    begin, finish, by_begin, by_finish = room.vectors[2], room.vectors[3], room.matrices[2], room.matrices[3]
    way, middle, force, way_j, middle_j = (
        room.vectors[4], room.vectors[5], room.vectors[6], room.vectors[7], room.vectors[8]
    )
    rubbing, slope, slip = room.rubbing[p], room.slopes[p], room.slip[p]
    d = len(room.space)
    # how much of the step the touch lasts, the limits of friction there, and their derivatives by `after`
    lasts, by_lasts = 1.0, 0.0
    first, last, by_first, by_last = mu * push, mu * push, mu * by_after, mu * by_after
    until, kept, drawn, rate = 0.0, 1.0, 0.0, 0.0  # the way that sticks; what is kept of `begin`
    if interval.line:
        mean, by_mean = mean_normal_force(before, after)
        lasts, by_lasts = touch_lasts(before, after, room.lean[p])
        lean = push / mean if mean > 0.0 else 0.0  # the limit leans as the normal force does
        by_lean = (by_after - lean * by_mean) / mean if mean > 0.0 else 0.0
        first, by_first = mu * lean * max(before, 0.0), mu * by_lean * max(before, 0.0)
        last, by_last = mu * lean * max(after, 0.0), mu * (by_lean * after + lean) if after > 0.0 else 0.0
        if before < 0.0:  # from nothing, so that its mean is that of the normal force
            last, by_last = 2.0 * mu * push / lasts, 2.0 * mu * (by_after - push * by_lasts / lasts) / lasts
        for k in range(d):
            drawn += (kt * begin[k]) ** 2
        drawn = np.sqrt(drawn)
        if drawn > first:  # e_a is within the limit
            kept = first / drawn
    for k in range(d):
        way[k] = lasts * (finish[k] - begin[k])
    if interval.line:
        a, b, c = -((last - first) ** 2), -first * (last - first), min(kept * drawn - first, 0.0) * (kept * drawn + first)
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
        first_j, last_j, lasts_j = by_first * steepest[j], by_last * steepest[j], by_lasts * steepest[j]
        kept_j, until_j, along = 0.0, 0.0, 0.0
        if kept < 1.0:
            for k in range(d):
                along += kt * kt * begin[k] * by_begin[k, j]
            kept_j = (first_j - kept * along / drawn) / drawn
        for k in range(d):
            way_j[k] = lasts_j * (finish[k] - begin[k]) + lasts * (by_finish[k, j] - by_begin[k, j])
            middle_j[k] = kept_j * begin[k] + kept * by_begin[k, j]  # of e_a, so far
            slope[k, j] += lasts * kt * until * (middle_j[k] + 0.5 * until * way_j[k]) + lasts_j * rubbing[k]
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
                    change = (limit_j - along * kt / trial) / limit * force[k] + limit * kt / trial * middle_j[k]
            slope[k, j] += lasts * (1.0 - until) * change
    for k in range(d):
        rubbing[k] *= lasts


@part
def settle(
    contacts: Contacts, interval: Interval, p: int, start: Touch, end: Touch, room: Room
) -> tuple[float, float, float]:
    """The state of point p at the end of a step whose mean force `over_step` has found.

    Returns:
        The energy that friction dissipates, the work that the motion of the surface does on body and springs, and the energy
        of impacts that the step does not resolve (`lean_to_the_end`), J.
    """
    kt = contacts.tangential_stiffness[p]
    x0, x1, slider, force, normal = start.x[p], end.x[p], end.slider[p], end.friction[p], end.normal[p]
    d = len(room.space)
    length = interval.end - interval.begin
    mean, rubbing, push = room.mean[p], room.rubbing[p], room.push[p]
    n, stretch, there, carried = room.vectors[0], room.vectors[1], room.vectors[2], room.vectors[3]
    pressed = max(end.raw[p], 0.0)
    size = 1.0
    if contacts.kind[p] == PLANE:
        for k in range(d):
            n[k] = 0.0
        n[0] = 1.0
    else:
        direction(contacts, p, x1, x1, interval.end, n, room.matrices[0], there)
        size = 0.0
        for k in range(d):
            size += n[k] ** 2
        size = np.sqrt(size)
    for k in range(d):
        normal[k] = pressed * n[k]
        n[k] /= size
    # the slider moves on to the end of the step, and the law is applied there
    carry(contacts, p, length, start.slider[p], slider)
    for k in range(d):
        slider[k] += room.slip[p, k]
        stretch[k] = x1[k] - slider[k]
    motion, _ = return_mapping(kt, contacts.friction[p] * pressed, n, stretch, force)
    slips = motion == SLIP or room.motion[p] == SLIP
    end.state[p] = OPEN if pressed == 0.0 else SLIP if slips else STICK
    # energies
    carry(contacts, p, length, x0, carried)
    available, stored, surface = 0.0, 0.0, 0.0
    for k in range(d):  # the schemes that balance forces at weighted ends do work by the trapezoidal rule
        rub = rubbing[k] if interval.line else 0.5 * (start.friction[p, k] + force[k])
        available += rub * (x1[k] - carried[k]) + 0.5 * start.friction[p, k] ** 2 / kt
        stored += 0.5 * force[k] ** 2 / kt
        surface -= rub * (carried[k] - x0[k])
    if interval.line and contacts.kind[p] != PLANE and stored > available:
        # the tangent plane has turned: the spring keeps what it was given
        factor = np.sqrt(max(available, 0.0) / stored)
        for k in range(d):
            force[k] *= factor
        stored = max(available, 0.0)
    if motion == SLIP or contacts.kind[p] != PLANE:
        for k in range(d):
            slider[k] = x1[k] - force[k] / kt
    if contacts.times.size > 0 or (contacts.order.size > 0 and contacts.spin[p] != 0.0):
        surface += push * (end.raw[p] - start.raw[p]) / contacts.normal_stiffness[p]
        for k in range(d):
            surface -= (mean[k] - rubbing[k]) * (x1[k] - x0[k])
    lost = 0.0
    if interval.line:
        mean_push, _ = mean_normal_force(start.raw[p], end.raw[p])
        lost = (push - mean_push) * (end.raw[p] - start.raw[p]) / contacts.normal_stiffness[p]
    return available - stored, surface, lost


@part
def energy(contacts: Contacts, here: Touch) -> float:
    """Energy in the contact springs, sum of N^2/(2 k_n) + |T|^2/(2 k_t) over the points, J."""
    total = 0.0
    for p in range(here.x.shape[0]):
        total += 0.5 * max(here.raw[p], 0.0) ** 2 / contacts.normal_stiffness[p]
        for k in range(here.x.shape[1]):
            total += 0.5 * here.friction[p, k] ** 2 / contacts.tangential_stiffness[p]
    return total


# ---------------------------------------------------------------------- the contact problem of a step


@part
def resolve(
    contacts: Contacts, interval: Interval, compliance: Array, free: Array, start: Touch, end: Touch, room: Room
) -> bool:
    """Find the contact displacements at the end of a step: x + G F(x) = x_free, with F the mean force over the step.

    Everything but the contact is linear in this problem (it is one Newton iteration of the step, condensed to the contact
    displacements), so the contact is solved in full: semismooth Newton and, where that cycles between states,
    Newton again from where a nonlinear Gauss-Seidel iteration has come to.

    Args:
        contacts: the parameters of P points.
        interval: the step.
        compliance: (m, m) G, contact displacement by contact force at this iteration, m = P d, m/N.
        free: (P, d) displacement at the end of the step without contact forces, m.
        start: the state at the start of the step.
        end: its x in: a first guess; out: the displacement at the end of the step.
        room: its mean (P, d) out: mean force over the step.

    Returns:
        True if the residual or the update fell to round-off; False if no iteration found a solution.
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
    contacts: Contacts, interval: Interval, compliance: Array, free: Array, start: Touch, end: Touch, room: Room, first: bool
) -> None:
    """Ten sweeps over all points from where the last ones came to, at first from the guess, with the forces there."""
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
    contacts: Contacts, interval: Interval, compliance: Array, free: Array, start: Touch, end: Touch, room: Room
) -> bool:
    """Semismooth Newton for x + G F(x) = x_free from the x given; True if it converged.

    Only the points that touch are unknowns: the others follow from their forces.
    """
    points, d = free.shape[0], len(room.space)
    x, x0, mean, slopes, touching = end.x, start.x, room.mean, room.slopes, room.touching
    residual, product, jacobian, update, pivots = room.residual, room.product, room.jacobian, room.update, room.pivots
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
                            residual[p, k] -= compliance[row, touching[t] * d + j] * product[touching[t], j]
                    row += 1
        for t in range(count):
            for k in range(d):
                residual[touching[t], k] = update[t * d + k, 0]
        last, size = size, 0.0
        for p in range(points):
            for k in range(d):
                size = max(size, abs(residual[p, k]))
        # rounding: neither update nor residual fall (of a stiff contact that only opens, the residual still does, slowly)
        if size <= 1e-15 * scale or (size <= 1e-11 * scale and size >= 0.5 * last and worst >= 0.9 * remained):
            return True  # the forces belong to the x they were evaluated at
        remained = worst
        for p in range(points):
            for k in range(d):
                x[p, k] += residual[p, k]
    return False


@kernel
def sweep(
    contacts: Contacts, interval: Interval, compliance: Array, free: Array, p: int, start: Touch, end: Touch, room: Room
) -> None:
    """Solve point p, the forces of the others held: first its normal force, by bisection, then its friction.

    This nonlinear Gauss-Seidel iteration is slow, but does not cycle between states: the tangential force is projected on
    the friction disc as a force, not found from a displacement that a wrong normal force has thrown far away. Friction is
    taken at the weighted point, near the mean along the way: it leads to where Newton's iteration ends.
    """
    points, d = free.shape[0], len(room.space)
    a = interval.start_weight
    theta = 1.0 - a
    x, mean, rubbing = end.x[p], room.held[p], room.held_rubbing[p]
    kn, kt, preload, before = contacts.normal_stiffness[p], contacts.tangential_stiffness[p], contacts.preload[p], start.raw[p]
    n, rest, spare, stretch = room.vectors[0], room.vectors[1], room.vectors[2], room.vectors[3]
    row = p * d
    for k in range(d):
        rest[k] = free[p, k]
        for q in range(points):
            if q != p:
                for j in range(d):
                    rest[k] -= compliance[row + k, q * d + j] * room.held[q, j]
    if interval.line:
        direction(contacts, p, start.x[p], x, 0.5 * (interval.begin + interval.end), n, room.matrices[0], spare)
    else:
        direction(contacts, p, x, x, interval.end, n, room.matrices[0], spare)
    low, high, push, held = 0.0, 0.0, 0.0, 0.0
    if not interval.line:  # what the start contributes is known
        held = a
    for step in range(101):  # the force lies between nothing and what it would be if it moved nothing
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


@compiled
def at_rest(contacts: Contacts, x: Array, slider: Array, time: float, here: Touch, room: Room) -> None:
    """Write the state of points at x (P, d) with sliders (P, d) into `here`: the law at a given displacement.

    A step of no length that ends where it starts.
    """
    here.x[:] = x
    here.slider[:] = slider
    here.friction[:] = 0.0
    interval = Interval(time, time, 0.0, False)
    for p in range(x.shape[0]):
        over_step(contacts, interval, p, here, here, room)
        settle(contacts, interval, p, here, here, room)
