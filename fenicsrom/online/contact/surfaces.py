"""Rigid surfaces: distance, normal and motion of planes, cylinders and spheres.

The angle of a body whose speed of rotation varies.

The speed Ω(t) is linear between the rows of a table and constant after its last row. The angle
θ(t) = ∫ Ω dt is exact. Whatever turns uses θ(t): surfaces, sliders, wear and engine orders. An
engine order of the form sin(n Ω(t) t) would have the wrong frequency n (Ω + t dΩ/dt).
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.numbers import (
    Number,
    Vector,
    angle_of,
    constant,
    cosine,
    dot,
    minus,
    plus,
    positive,
    root,
    sine,
    times,
    vector,
)

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
        if history[middle, 0].real <= time.real:
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

    thickness: Annotated[Array, "P"]
    yield_force: Annotated[Array, "P"]
    hardening: Annotated[Array, "P"]
    viscosity: Annotated[Array, "P"]
    first: Annotated[NDArray[np.int64], "P"]
    cells: Annotated[NDArray[np.int64], "P"]
    angle: Annotated[Array, "P"]
    worn: Annotated[Array, "nodes"]


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
        history: (r, 3) times, speeds and angles theta of the body (`speed_history`); none at a
            constant speed.
        times: (k,) s.
        approach: (P, k) distance that the surface has moved towards the body at these times, linear
            between them, m.
        order: (h,) orders of the waves.
        height: (P, h) their heights, m.
        phase: (P, h) their phases, rad.
        coating: the abradable layers; `normal_stiffness` is then that of contact spring and layer.
    """

    preload: Annotated[Array, "P"]
    normal_stiffness: Annotated[Array, "P"]
    tangential_stiffness: Annotated[Array, "P"]
    friction: Annotated[Array, "P"]
    kind: Annotated[NDArray[np.int64], "P"]
    axes: Annotated[Array, "P d d"]
    centre: Annotated[Array, "P d"]
    radius: Annotated[Array, "P"]
    side: Annotated[Array, "P"]
    spin: Annotated[Array, "P"]
    turns: Annotated[Array, "P"]
    history: Annotated[Array, "r 3"]
    times: Annotated[Array, "k"]
    approach: Annotated[Array, "P k"]
    order: Annotated[Array, "h"]
    height: Annotated[Array, "P h"]
    phase: Annotated[Array, "P h"]
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
def approached(contacts: Contacts, p: int, time: Number) -> Number:
    """How far the surface of point p has moved towards the body at a time, m."""
    instants, k = contacts.times, 0
    last = instants.size - 1
    if last < 0:
        return constant(time, 0.0)
    while k < last and instants[k + 1].real < time.real:
        k += 1
    closed = contacts.approach[p, k] + constant(time, 0.0)
    if k < last and time.real > instants[k].real:
        share = (time - instants[k]) / (instants[k + 1] - instants[k])
        if share.real > 1.0:
            share = constant(share, 1.0)
        closed += share * (contacts.approach[p, k + 1] - contacts.approach[p, k])
    return closed


@part
def across_axis(contacts: Contacts, p: int, x: Vector) -> Vector:
    """E x, the coordinates of a vector across the axis of the surface of point p."""
    first, second = dot(vector(contacts.axes[p, 0]), x), dot(vector(contacts.axes[p, 1]), x)
    if contacts.kind[p] == SPHERE:
        return first, second, dot(vector(contacts.axes[p, 2]), x)
    return first, second, constant(first, 0.0)


@part
def in_frame(contacts: Contacts, p: int, z: Vector) -> Vector:
    """E^T z, the inverse of `across_axis`."""
    axes = contacts.axes
    found = plus(times(z[0], vector(axes[p, 0])), times(z[1], vector(axes[p, 1])))
    if contacts.kind[p] == SPHERE:
        found = plus(found, times(z[2], vector(axes[p, 2])))
    return found


@part
def has_waves(contacts: Contacts, p: int) -> bool:
    """Whether the surface of point p has waves."""
    return contacts.order.size > 0 and contacts.kind[p] == CYLINDER


@kernel
def penetration(contacts: Contacts, p: int, x: Vector, time: Number) -> Number:
    """Depth of point p at x, a vector or (d,), in its surface, negative outside of it, m."""
    place, closed, radius = vector(x), approached(contacts, p, time), contacts.radius[p]
    if contacts.kind[p] == PLANE:
        return place[0] - radius + closed
    # |z| - radius = (|z|^2 - radius^2)/(|z| + radius); |z|^2 is split so that a small x is not
    # lost in a large radius
    there = across_axis(contacts, p, times(-1.0, vector(contacts.centre[p])))
    moved = across_axis(contacts, p, place)
    z, square = plus(there, moved), dot(there, there)
    added = dot(moved, plus(there, z))
    beyond = (square - radius * radius + added) / (root(positive(square + added)) + radius)
    wave = constant(beyond, 0.0)
    if has_waves(contacts, p):
        angle = angle_of(z[0], z[1]) - surface_turn(contacts, p, 0.0, time)
        for k in range(contacts.order.size):
            phase = contacts.order[k] * angle - contacts.phase[p, k]
            wave = wave + contacts.height[p, k] * cosine(phase)
    return contacts.side[p] * beyond + wave + closed


@kernel
def gap_discrete_gradient(
    contacts: Contacts, p: int, x0: Vector, x1: Vector, time: Number
) -> Vector:
    """The discrete gradient of the penetration of point p between two places, at a time in s.

    It satisfies n . (x1 - x0) = delta(x1) - delta(x0). This is exact for planes, cylinders and
    spheres, because |z1| - |z0| = (z0 + z1) . (z1 - z0) / (|z0| + |z1|). For waves the error is of
    third order in the distance. If both places are equal, the discrete gradient is the gradient.
    """
    if contacts.kind[p] == PLANE:
        zero = constant(x0[0] + x1[0], 0.0)
        return constant(zero, 1.0), zero, zero
    centre = vector(contacts.centre[p])
    z0 = across_axis(contacts, p, minus(x0, centre))
    z1 = across_axis(contacts, p, minus(x1, centre))
    both = plus(z0, z1)
    found = times(contacts.side[p] / (root(dot(z0, z0)) + root(dot(z1, z1))), both)
    if has_waves(contacts, p):
        angle = angle_of(both[0], both[1]) - surface_turn(contacts, p, 0.0, time)
        slope = constant(angle, 0.0)  # the derivative of the waves by the angle
        for k in range(contacts.order.size):
            order = contacts.order[k]
            height = contacts.height[p, k]
            slope = slope - height * order * sine(order * angle - contacts.phase[p, k])
        turned = 2.0 * slope / (both[0] * both[0] + both[1] * both[1])
        found = plus(found, (-1.0 * turned * both[1], turned * both[0], constant(turned, 0.0)))
    return in_frame(contacts, p, found)


@part
def advect_with_surface(
    contacts: Contacts, p: int, begin: Number, end: Number, place: Vector
) -> Vector:
    """Where a place on a turning surface at `begin` is at `end`, in s."""
    angle = surface_turn(contacts, p, begin, end)
    if angle == 0.0 or contacts.kind[p] == PLANE:
        return times(constant(angle, 1.0), place)
    x, y, _ = across_axis(contacts, p, minus(place, vector(contacts.centre[p])))
    c, s = cosine(angle) - 1.0, sine(angle)
    moved = c * x - s * y
    return plus(place, in_frame(contacts, p, (moved, s * x + c * y, constant(moved, 0.0))))


def unit_normals(contacts: Contacts, x: Array, time: Array) -> Array:
    """The unit normals (ns, P, d) of the surfaces, in the frames of the points.

    Args:
        contacts: the parameters.
        x: (ns, P, d) displacements of the points, m.
        time: (ns,) s.
    """
    found = np.zeros_like(x)
    found[:, :, 0] = 1.0
    for p in np.flatnonzero(contacts.kind != PLANE):
        for row in range(x.shape[0]):
            here = vector(x[row, p])
            found[row, p] = gap_discrete_gradient(contacts, p, here, here, time[row])[: x.shape[2]]
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
    given = preload, normal_stiffness, tangential_stiffness, friction, gap, np.ones(count)
    names = "preload", "normal_stiffness", "tangential_stiffness", "friction", "radius", "side"
    fields: dict[str, Any] = {
        name: np.asarray(values, dtype=np.float64)
        for name, values in zip(names, given, strict=True)
    }
    fields |= {"kind": np.full(count, PLANE), "axes": np.tile(np.eye(dimension), (count, 1, 1))}
    return zeros(Contacts, fields, P=count, d=dimension, r=0, k=0, h=0, nodes=0)
