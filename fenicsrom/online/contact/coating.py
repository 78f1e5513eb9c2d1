"""Abradable layers on rigid surfaces: the body crushes them, and they remember where.

A layer has the height h, Young's modulus E, the yield stress sigma_Y, the hardening modulus K and
the viscosity eta. A point of the body with the contact area A presses it to the depth d below its
new surface. The layer is worn by w = h eps_p, with the plastic strain eps_p, so that w is its only
state. In series with the contact spring k_n (`normal_stiffness` of a coated point is k),

    k = 1/(1/k_n + h/(E A)),    y = k (d - w),    F(w) = A (sigma_Y + K w/h)                    (1)
    N = max(y, 0) - c max(y - F, 0),    c = k/(k + A K/h + A eta/(h dt))                        (2)
    w += max(y - F, 0) c/k                                                                      (3)

over a step dt (Legrand, Batailly and Pierre 2012, Journal of Computational and Nonlinear Dynamics
7, 011010). (3) is a projection: (2) gives the same force before and after it.

A surface that turns has a ring of nodes, between which w is linear, at each position along the axis
where there are contact points. In a step a point sweeps the ring from one angle to another, while
its depth d goes linearly from d0 to d1. Its normal force is the mean of (2) over this arc. Between
two nodes both terms of (2) are positive parts of linear functions, whose mean is a closed form
(`fenicsrom.online.contact.friction.mean_of_positive`). For a surface at rest, w is a number of the
point, and the same formula is the discrete gradient of the energy. The angle of a point on its ring
is that of its place on the undeformed body: its displacement along the surface is neglected.

A step reads w. Only the acceptance of the step changes w, at each node in the arc, by (3).

Rings hold where contact points wear a layer, and how much was worn.
"""

from dataclasses import MISSING
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.friction import mean_of_positive
from fenicsrom.online.contact.state import Interval
from fenicsrom.online.contact.surfaces import Coating, Contacts, penetration, surface_turn
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.numbers import Number, Vector, constant, positive
from fenicsrom.scene.base.rules import Where

SAME_PLACE = 1e-9
"""Contact points whose positions along the axis differ by less, relative to the radius, share a
ring."""


class Ring(NamedTuple):
    """A ring of nodes around an axis, which all contact points at one position along it wear.

    Before a surface at rest each point has a ring of its own with one node.

    Attributes:
        contact: index of the scene's contact of its first point.
        points: the contact points that wear it.
        first: its first node in `Coating.worn`.
        cells: number of its nodes, at equal angles; the first one is at the angle 0.
        position: along the axis from the point of the surface, m; 0 before a surface at rest.
        radius: of the surface, m; 0 before a surface at rest.
        width: along the axis, m; 0 before a surface at rest.
        area: that one node stands for, m^2.
        layer: the `fenicsrom.scene.Abradable`.
    """

    contact: int
    points: tuple[int, ...]
    first: int
    cells: int
    position: float
    radius: float
    width: float
    area: float
    layer: Any

    @property
    def angle(self) -> Array:
        """(cells,) of its nodes, rad: the angle of `surface.waves`, positive about the axis."""
        return 2.0 * np.pi / self.cells * np.arange(self.cells, dtype=np.float64)

    def depth(self, worn: Array) -> Array:
        """The worn depth (cells,) in m at its nodes, of the depths (nodes,) of all rings.

        There is no more to wear than the layer; a run whose layer is worn through ends.
        """
        return np.minimum(worn[self.first : self.first + self.cells], self.layer.thickness)

    def volume(self, depth: Array) -> float:
        """The volume in m^3 that was worn, of the worn depth (cells,)."""
        return float(self.area * np.sum(depth))

    def plastic_work(self, depth: Array) -> float:
        """The work in J that wore the ring, h int(sigma_Y + K eps) d eps, without viscosity."""
        layer = self.layer
        work = layer.yield_stress * depth + 0.5 * layer.hardening * depth**2 / layer.thickness
        return float(self.area * np.sum(work))


def rings_of(scene: Any, points: Any, contacts: Contacts) -> list[Ring]:
    """The rings of a scene's contacts.

    Args:
        scene: the scene.
        points: the `ContactPoints`.
        contacts: the parameters of the points.

    Raises:
        SceneError: the width of a trace is not given and does not follow from the points.
    """
    members: dict[Any, list[int]] = {}
    along = np.zeros(points.contact.size)
    turns = (contacts.spin != 0.0) | (contacts.turns != 0.0)
    for p, k in enumerate(points.contact):
        contact = scene.contacts[k]
        if contact.abradable is None:
            continue
        place: Any = p
        if turns[p]:
            along[p] = _position(contact.surface, points.position[p])
            step = SAME_PLACE * contacts.radius[p]
            place = contact.surface, contact.abradable, round(along[p] / step)
        members.setdefault(place, []).append(p)
    found: list[Ring] = []
    first = 0
    for group in members.values():
        p, k = group[0], int(points.contact[group[0]])
        layer, cells, radius, width = scene.contacts[k].abradable, 1, 0.0, 0.0
        area = float(pressing_areas(scene, points)[p])
        if turns[p]:
            cells, radius = layer.cells, float(contacts.radius[p])
            width = max(_width(scene, points, along, q) for q in group)
            area = radius * 2.0 * np.pi / cells * width
        position = float(along[p])
        found.append(Ring(k, tuple(group), first, cells, position, radius, width, area, layer))
        first += cells
    return found


def _position(surface: Any, position: Array) -> float:
    """Where a position (d,) is along the axis of a surface, m."""
    if surface.axis is None:
        return 0.0
    return float((position - np.array(surface.point)) @ np.array(surface.axis))


def pressing_areas(scene: Any, points: Any) -> Array:
    """The area (P,) in m^2 with which each point presses its layer; zero without a layer."""
    layers = [scene.contacts[k].abradable for k in points.contact]
    return np.array(
        [0.0 if layer is None else _share(points, p) * layer.area for p, layer in enumerate(layers)]
    )


def _share(points: Any, p: int) -> float:
    """The part of its contact for which point p stands."""
    mine = points.contact == points.contact[p]
    return float(points.tributary_area[p] / np.sum(points.tributary_area[mine]))


def _width(scene: Any, points: Any, along: Array, p: int) -> float:
    """The width of the trace of point p, m.

    Raises:
        SceneError: it is not given, and all points of the contact are at one place along the axis.
    """
    k = int(points.contact[p])
    width = scene.contacts[k].abradable.width
    if width is None:
        width = scene.geometry.thickness or float(np.ptp(along[points.contact == k]))
    if not width > 0.0:
        reason = "the contact has one position along the axis; give the width of the trace"
        raise Where(scene.source, f"contacts[{k}].abradable.width").refuse(MISSING, reason)
    return _share(points, p) * width


def coated(contacts: Contacts, rings: list[Ring], area: Array) -> Contacts:
    """Contacts with new layers in front of the points of some rings.

    Args:
        contacts: the parameters of P points without layers.
        rings: the rings.
        area: (P,) area of the body that presses the layer, m^2.
    """
    stiffness, coating = contacts.normal_stiffness.copy(), contacts.coating
    first: NDArray[np.int64] = np.zeros_like(coating.first)
    cells = np.zeros_like(first)
    strength, hardening, viscosity, angle, thickness = np.zeros((5, area.size))
    for ring in rings:
        for p in ring.points:
            layer = ring.layer
            thickness[p], by_depth = layer.thickness, area[p] / layer.thickness
            stiffness[p] = 1.0 / (1.0 / stiffness[p] + 1.0 / (by_depth * layer.modulus))
            strength[p], hardening[p] = area[p] * layer.yield_stress, by_depth * layer.hardening
            viscosity[p] = by_depth * layer.viscosity
            first[p], cells[p] = ring.first, ring.cells
            if ring.radius:
                across, up = -contacts.axes[p, :2] @ contacts.centre[p]
                angle[p] = np.arctan2(up, across)
    nodes = sum(ring.cells for ring in rings)
    return contacts._replace(
        normal_stiffness=stiffness,
        coating=Coating(
            thickness, strength, hardening, viscosity, first, cells, angle, np.zeros(nodes)
        ),
    )


def worn_through(contacts: Contacts) -> bool:
    """Whether any layer is worn to its ground."""
    coating = contacts.coating
    return any(
        np.any(coating.worn[first : first + cells] >= thickness)
        for first, cells, thickness in zip(
            coating.first, coating.cells, coating.thickness, strict=True
        )
        if cells
    )


SHIFT = 1.234567e-6
"""The arc whose nodes a step wears is shifted by so many cells, so that its ends are not on nodes:
rounding then lets no node fall between two steps, or be worn in both."""


@part
def is_coated(contacts: Contacts, p: int) -> bool:
    """Whether point p presses an abradable layer."""
    return contacts.coating.worn.size > 0 and contacts.coating.cells[p] > 0


@part
def ring_place(contacts: Contacts, p: int, time: Number) -> Number:
    """Where point p is on its ring at a time, in cells: the nodes are at the integers."""
    angle = contacts.coating.angle[p] - surface_turn(contacts, p, 0.0, time)
    return angle * contacts.coating.cells[p] / (2.0 * np.pi)


@part
def worn_depth(contacts: Contacts, p: int, place: Number) -> Number:
    """The worn depth w at a place of the ring of point p, m."""
    coating, below = contacts.coating, int(np.floor(place.real))
    first, cells = coating.first[p], coating.cells[p]
    here, ahead = coating.worn[first + below % cells], coating.worn[first + (below + 1) % cells]
    return here + (place - below) * (ahead - here)


@part
def depth(contacts: Contacts, p: int, x: Vector, time: Number) -> Number:
    """Depth of point p at x, a vector or (d,), in its surface, which may be worn, m.

    It is negative outside of the surface.
    """
    found = penetration(contacts, p, x, time)
    if is_coated(contacts, p):
        found = found - worn_depth(contacts, p, ring_place(contacts, p, time))
    return found


@part
def softening(contacts: Contacts, interval: Interval, p: int) -> Number:
    """The factor c of (2)."""
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    viscous = coating.viscosity[p] / (interval.end - interval.begin)
    return k / (k + coating.hardening[p] + viscous)


@part
def force_beyond_yield(contacts: Contacts, p: int, y: Number, worn: Number) -> Number:
    """Y - F(w), N."""
    return y - contacts.coating.yield_force[p] - contacts.coating.hardening[p] * worn


@part
def coated_end_force(contacts: Contacts, interval: Interval, p: int, after: Number) -> Number:
    """The force y - c max(y - F, 0) of (2) at the end of a step, negative if the point is open, N.

    Args:
        contacts: the parameters.
        interval: the step.
        p: the point.
        after: y at the end, N.
    """
    worn = worn_depth(contacts, p, ring_place(contacts, p, interval.end))
    beyond = positive(force_beyond_yield(contacts, p, after, worn))
    return after - softening(contacts, interval, p) * beyond


@kernel
def coated_mean_force(
    contacts: Contacts, interval: Interval, p: int, x0: Vector, after: Number
) -> Number:
    """Mean normal force of point p over a step that starts at x0: (2) along the arc, N.

    Args:
        contacts: the parameters.
        interval: the step.
        p: the point.
        x0: displacement at the start, m.
        after: y at the end of the step, N.
    """
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    c, first, cells = softening(contacts, interval, p), coating.first[p], coating.cells[p]
    behind = ring_place(contacts, p, interval.begin)
    ahead = ring_place(contacts, p, interval.end)
    w, last = worn_depth(contacts, p, behind), worn_depth(contacts, p, ahead)
    virgin = contacts.preload[p] + k * penetration(contacts, p, x0, interval.begin)
    rise = after + k * last - virgin
    way = 1 if ahead.real >= behind.real else -1
    node = int(np.floor(behind.real)) + 1 if way > 0 else int(np.ceil(behind.real)) - 1
    zero = constant(rise, 0.0)
    s, y, mean = constant(behind, 0.0), virgin + zero - k * w, zero
    while s.real < 1.0:  # from node to node; s is the part of the step that is done
        s1, w1 = constant(behind, 1.0), last
        if way * (ahead.real - node) > 0.0:
            s1, w1 = (node - behind) / (ahead - behind), coating.worn[first + node % cells]
        y1 = virgin + s1 * rise - k * w1
        beyond = force_beyond_yield(contacts, p, y, w)
        beyond1 = force_beyond_yield(contacts, p, y1, w1)
        plastic = c * mean_of_positive(beyond, beyond1)
        mean = mean + (s1 - s) * (mean_of_positive(y, y1) - plastic)
        s, y, w, node = s1, y1, w1, node + way
    return mean


@kernel
def wear(contacts: Contacts, interval: Interval, p: int, x0: Array, x1: Array) -> None:
    """Wear the layer in the arc of an accepted step of point p from x0 to x1 (d,): equation (3)."""
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    first, cells = coating.first[p], coating.cells[p]
    behind = ring_place(contacts, p, interval.begin)
    ahead = ring_place(contacts, p, interval.end)
    virgin0 = contacts.preload[p] + k * penetration(contacts, p, x0, interval.begin)
    virgin1 = contacts.preload[p] + k * penetration(contacts, p, x1, interval.end)
    by_force = softening(contacts, interval, p) / k
    low, high = 0, 0
    if ahead > behind:
        low, high = int(np.floor(behind + SHIFT)) + 1, int(np.floor(ahead + SHIFT))
    elif ahead < behind:
        low, high = int(np.ceil(ahead - SHIFT)), int(np.ceil(behind - SHIFT)) - 1
    for node in range(low, high + 1):
        share = 1.0
        if ahead != behind:
            share = min(max((node - behind) / (ahead - behind), 0.0), 1.0)
        at, y = first + node % cells, virgin0 + share * (virgin1 - virgin0)
        beyond = force_beyond_yield(contacts, p, y - k * coating.worn[at], coating.worn[at])
        coating.worn[at] += by_force * positive(beyond)
