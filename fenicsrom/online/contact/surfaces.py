"""Rigid surfaces: distance, normal and motion of planes, cylinders and spheres.

The angle of a body whose speed of rotation varies.

The speed Ω(t) is linear between the rows of a table and constant after its last row. The angle
θ(t) = ∫ Ω dt is exact. Whatever turns uses θ(t): surfaces, sliders, wear and engine orders. An
engine order of the form sin(n Ω(t) t) would have the wrong frequency n (Ω + t dΩ/dt).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.kernels.compilation import kernel, part

NO_HISTORY = np.zeros((0, 3))
"""The history of a body that turns at a constant speed."""


def speed_history(rows: ArrayLike) -> Array:
    """The history (k, 3) of rows (k, 2) of times in s, the first one 0, and speeds in rad/s.

    Its columns are the times, the speeds Ω and the angles θ in rad.
    """
    time, speed = np.asarray(rows, dtype=np.float64).reshape(-1, 2).T
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))
    return np.column_stack([time, speed, np.concatenate([np.zeros(time.size)[:1], turned])])


def history_of(rotation: Any) -> Array:
    """The history (k, 3) of the [rotation] of a scene, or none."""
    if rotation is None or not rotation.history:
        return NO_HISTORY
    return speed_history(np.array(rotation.history) * [1.0, np.pi / 30.0])


def times_of_angles(history: Array, angle: float, end: float) -> Array:
    """The times (k,) in s between 0 and `end` at which θ is a multiple of an angle in rad.

    Multiples at a corner of the speed are left out.
    """
    found = []
    for row in range(len(history)):
        begin, speed, turned = map(float, history[row])
        until = min(end, history[row + 1, 0]) if row + 1 < len(history) else end
        if until <= begin:
            break
        first, last = np.array([turned, angle_at(history, until)]) / angle
        x = angle * np.arange(np.floor(first) + 1.0, np.ceil(last)) - turned
        growth = growth_after(history, row)
        found.append(begin + 2.0 * x / (speed + np.sqrt(speed**2 + 2.0 * growth * x)))
    return np.concatenate(found)


@part
def row_before(history: Array, time: float) -> int:
    """The last row of a history that is not after a time in s; the first one at least."""
    low, high = 0, history.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if history[middle, 0] <= time:
            low = middle
        else:
            high = middle
    return low


@part
def growth_after(history: Array, row: int) -> float:
    """dΩ/dt after a row of a history, rad/s²."""
    if row + 1 == history.shape[0]:
        return 0.0
    return (history[row + 1, 1] - history[row, 1]) / (history[row + 1, 0] - history[row, 0])


@part
def speed_at(history: Array, time: float) -> float:
    """Ω of a history at a time in s, rad/s."""
    row = row_before(history, time)
    return history[row, 1] + growth_after(history, row) * (time - history[row, 0])


@part
def angle_at(history: Array, time: float) -> float:
    """θ of a history at a time in s, rad."""
    row = row_before(history, time)
    x = time - history[row, 0]
    return history[row, 2] + (history[row, 1] + 0.5 * growth_after(history, row) * x) * x


PLANE, CYLINDER, SPHERE = 1, 2, 3  # number of coordinates that the distance depends on


class Coating(NamedTuple):
    """The abradable layers in front of P contact points (`fenicsrom.online.contact.coating`).

    Attributes:
        thickness: (P,) h, m.
        yield_force: (P,) A sigma_Y, N.
        hardening: (P,) A K/h, N/m.
        viscosity: (P,) A eta/h, N s/m.
        first: (P,) the node in `worn` where the ring of the point starts.
        cells: (P,) number of nodes of the ring: 1 before a surface at rest, 0 without a layer.
        angle: (P,) of the point on its ring at t = 0, rad.
        worn: (nodes,) worn depth w of all rings, m; empty if no point has a layer.
    """

    thickness: Array
    yield_force: Array
    hardening: Array
    viscosity: Array
    first: NDArray[np.int64]
    cells: NDArray[np.int64]
    angle: Array
    worn: Array


class Contacts(NamedTuple):
    """The parameters of P contact points in d dimensions, and of the surface opposite each point.

    With z = E (x - centre), E the first `kind` rows of `axes`, the penetration is

        delta = side (|z| - radius) + approach(t)
                + sum_k height_k cos(order_k (phi - alpha(t)) - phase_k)

    where phi is the angle of z, and alpha(t) = spin t + turns theta(t) is the angle by which the
    surface has turned (`surface_turn`). For a plane |z| is z itself. Only cylinders have waves.

    Attributes:
        preload: (P,) N0, normal force at penetration zero, N.
        normal_stiffness: (P,) k_n, N/m.
        tangential_stiffness: (P,) k_t, N/m.
        friction: (P,) mu.
        kind: (P,) PLANE, CYLINDER or SPHERE.
        axes: (P, d, d) orthonormal rows.
        centre: (P, d) a point of the plane or of the axis of the cylinder, or the centre of the
            sphere, m.
        radius: (P,) of the surface; of a plane, its distance from `centre` along the normal, m.
        side: (P,) 1 if the body is on the side of `centre`, else -1.
        spin: (P,) constant rate at which the surface turns about its axis, rad/s.
        turns: (P,) angle by which it turns for each radian of the body, where the speed varies.
        history: (r, 3) times, speeds and angles theta of the body (`online.contact.turning`); none
            at a constant speed.
        times: (k,) s.
        approach: (P, k) distance that the surface has moved towards the body at these times, linear
            between them, m.
        order: (h,) orders of the waves.
        height: (P, h) their heights, m.
        phase: (P, h) their phases, rad.
        coating: the abradable layers; `normal_stiffness` is then that of contact spring and layer.
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
    turns: Array
    history: Array
    times: Array
    approach: Array
    order: Array
    height: Array
    phase: Array
    coating: Coating


def frame(normal: Array) -> Array:
    """The local frame of a unit normal: rows normal, tangents; (d, d), right-handed.

    In 3D the first tangent is the projection of one of the axes y, z, x: the axis that is least
    aligned with the normal, or the first such axis. For a wall beyond a blade's tip along x, the
    tangents are therefore y and z.
    """
    if normal.size == 2:
        return np.array([normal, [-normal[1], normal[0]]])
    order = [1, 2, 0]
    axis = order[int(np.argmin(np.round(np.abs(normal[order]), 12)))]
    tangent = np.eye(3)[axis] - normal[axis] * normal
    tangent /= np.linalg.norm(tangent)
    return np.array([normal, tangent, np.cross(normal, tangent)])


def surface_normal(contact: Any, position: Array, where: str) -> Array:
    """Unit normal (d,) into the surface of a scene's contact at a position of the undeformed body.

    Args:
        contact: a contact of the scene.
        position: (d,) m.
        where: the file and the key of the contact, for the message.

    Raises:
        SceneError: the position is on the axis or at the centre of the surface.
    """
    if contact.surface is None:
        return np.array(contact.normal)
    axes = axes_of(contact.surface, position.size)
    z = axes @ (position - np.array(contact.surface.point))
    size = float(np.linalg.norm(z))
    if size == 0.0:
        raise SceneError(
            f"{where}.surface.point: must not lie at the contact point itself",
            kind=ErrorKind.RANGE,
            key=where.rsplit(": ", 1)[-1] + ".surface.point",
        )
    side = 1.0 if contact.surface.inside else -1.0
    return np.asarray(side / size * z @ axes)


def axes_of(surface: Any, d: int) -> Array:
    """Orthonormal rows (2 or 3, d) across the axis of a surface, or all axes without one."""
    return frame(np.array(surface.axis))[1:] if surface.axis is not None else np.eye(d)


@part
def surface_turn(contacts: Contacts, p: int, begin: float, end: float) -> float:
    """Angle in rad by which the surface of point p turns about its axis between two times in s."""
    angle = contacts.spin[p] * (end - begin)
    if contacts.history.shape[0] > 0:
        swept = angle_at(contacts.history, end) - angle_at(contacts.history, begin)
        angle += contacts.turns[p] * swept
    return angle


@part
def penetration(contacts: Contacts, p: int, x: Array, time: float) -> float:
    """Depth of point p at x (d,) in its surface, negative outside of it, m."""
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
    # |z| - radius = (|z|^2 - radius^2)/(|z| + radius); |z|^2 is split so that a small x is not
    # lost in a large radius
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
        angle = np.arctan2(second, first) - surface_turn(contacts, p, 0.0, time)
        for k in range(contacts.order.size):
            closed += contacts.height[p, k] * np.cos(
                contacts.order[k] * angle - contacts.phase[p, k]
            )
    return contacts.side[p] * beyond + closed


@kernel
def gap_discrete_gradient(
    contacts: Contacts,
    p: int,
    x0: Array,
    x1: Array,
    time: float,
    n: Array,
    derivative: Array,
    work: Array,
) -> None:
    """The discrete gradient of the penetration between two points, and its derivative by x1.

    It satisfies n . (x1 - x0) = delta(x1) - delta(x0). This is exact for planes, cylinders and
    spheres, because |z1| - |z0| = (z0 + z1) . (z1 - z0) / (|z0| + |z1|). For waves the error is of
    third order in the distance. If both points are equal, the discrete gradient is the gradient,
    and the derivative is half the second derivative of the penetration.

    Args:
        contacts: the parameters.
        p: the contact point.
        x0: (d,) m.
        x1: (d,) m.
        time: s.
        n: (d,) out.
        derivative: (d, d) out, 1/m.
        work: (d,) scratch.
    """
    d = n.size
    for k in range(d):
        n[k] = 0.0
        work[k] = 0.0
        for j in range(d):
            derivative[k, j] = 0.0
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
            work[k] += axes[r, k] * z1
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
                derivative[k, j] += side * axes[r, k] * axes[r, j] / total
            derivative[k, j] -= n[k] * work[j] / (end * total)
    if contacts.order.size > 0 and contacts.kind[p] == CYLINDER:
        _add_waves(contacts, p, first, second, time, n, derivative)


@kernel
def _add_waves(
    contacts: Contacts,
    p: int,
    first: float,
    second: float,
    time: float,
    n: Array,
    derivative: Array,
) -> None:
    """Add the gradient of the waves of a cylinder to n (d,), and half its derivative.

    `first` and `second` are the coordinates of the point across the axis, m.
    """
    axes, d = contacts.axes[p], n.size
    square = first * first + second * second
    angle = np.arctan2(second, first) - surface_turn(contacts, p, 0.0, time)
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
            derivative[k, j] += 0.5 * (
                twice * turned * turned_j - once * (outward * turned_j + turned * outward_j)
            )


@part
def advect_with_surface(
    contacts: Contacts, p: int, begin: float, end: float, point: Array, out: Array
) -> None:
    """Write to out (d,) where a point (d,) of a turning surface at `begin` is at `end`, in s."""
    d = point.size
    for k in range(d):
        out[k] = point[k]
    angle = surface_turn(contacts, p, begin, end)
    if angle == 0.0 or contacts.kind[p] == PLANE:
        return
    axes, centre = contacts.axes[p], contacts.centre[p]
    first, second = 0.0, 0.0
    for k in range(d):
        first += axes[0, k] * (point[k] - centre[k])
        second += axes[1, k] * (point[k] - centre[k])
    c, s = np.cos(angle) - 1.0, np.sin(angle)
    for k in range(d):
        out[k] += axes[0, k] * (c * first - s * second) + axes[1, k] * (s * first + c * second)


def unit_normals(contacts: Contacts, x: Array, time: Array) -> Array:
    """The unit normals (ns, P, d) of the surfaces, in the frames of the points.

    Args:
        contacts: the parameters.
        x: (ns, P, d) displacements of the points, m.
        time: (ns,) s.
    """
    found = np.zeros_like(x)
    found[:, :, 0] = 1.0
    d = x.shape[2]
    derivative, work = np.empty((d, d)), np.empty(d)
    for p in np.flatnonzero(contacts.kind != PLANE):
        for row in range(x.shape[0]):
            here = x[row, p]
            gap_discrete_gradient(
                contacts, p, here, here, time[row], found[row, p], derivative, work
            )
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))


def planes(
    preload: Array,
    gap: Array,
    normal_stiffness: Array,
    tangential_stiffness: Array,
    friction: Array,
    dimension: int,
) -> Contacts:
    """The contacts of most scenes: planes at rest at the distance `gap`; all arguments (P,)."""
    count = len(preload)
    given = preload, gap, normal_stiffness, tangential_stiffness, friction
    n0, g0, kn, kt, mu = (np.asarray(values, dtype=np.float64) for values in given)
    return Contacts(
        preload=n0,
        normal_stiffness=kn,
        tangential_stiffness=kt,
        friction=mu,
        kind=np.full(count, PLANE),
        axes=np.tile(np.eye(dimension), (count, 1, 1)),
        centre=np.zeros((count, dimension)),
        radius=g0,
        side=np.ones(count),
        spin=np.zeros(count),
        turns=np.zeros(count),
        history=NO_HISTORY,
        times=np.zeros(0),
        approach=np.zeros((count, 0)),
        order=np.zeros(0),
        height=np.zeros((count, 0)),
        phase=np.zeros((count, 0)),
        coating=Coating(
            thickness=np.zeros(count),
            yield_force=np.zeros(count),
            hardening=np.zeros(count),
            viscosity=np.zeros(count),
            first=np.zeros(count, dtype=np.int64),
            cells=np.zeros(count, dtype=np.int64),
            angle=np.zeros(count),
            worn=np.zeros(0),
        ),
    )


def no_contacts(dimension: int = 2) -> Contacts:
    """The contacts of a scene that has none."""
    none = np.zeros(0)
    return planes(none, none, none, none, none, dimension)
