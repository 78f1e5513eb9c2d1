"""The rings of abradable layers: where contact points wear them, and how much was worn.

`fenicsrom.online.contact.coating` has the law.
"""

from __future__ import annotations

from dataclasses import MISSING
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Coating, Contacts
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
