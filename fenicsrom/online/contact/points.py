"""Contact points of the body, and the parameters of the surfaces opposite them."""

from collections.abc import Iterable
from dataclasses import MISSING
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import coated, pressing_areas, rings_of
from fenicsrom.online.contact.surfaces import (
    CYLINDER,
    PLANE,
    SPHERE,
    Contacts,
    axes_of,
    history_of,
    penetration,
    planes,
)
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.keys.contacts import surface_spin, surface_turns
from fenicsrom.scene.keys.unit_system import LENGTHS

NO_DIRECTION = 1e-3
"""The middle of points that is nearer to an axis, relative to their distance, has no direction."""


FACETS = np.zeros((), dtype=np.int64)
"""The `unit_lengths` of points on facets, and of single points."""


TOUCHING = np.zeros(())
"""The `gap` of points in front of a rigid surface."""


class ContactPoints(NamedTuple):
    """The places of P contact points on the undeformed body.

    Attributes:
        contact: (P,) index of the scene's contact of each point.
        tributary_area: (P,) its part of that contact: 1 for a single point, else area, length or
            number of nodes.
        position: (P, d) m.
        frame: (P, d, d) rows normal into the surface, tangents.
        unit_lengths: (P,) how many unit lengths of the scene complete the tributary area to an
            area: 0 of facets and of a single point, 1 of edges, 2 of nodes; () of all points.
        gap: (P,) distance from the other body in the mesh, m; 0 of a rigid surface; () of all
            points. It counts where the scene gives no gap.
    """

    contact: NDArray[np.int64]
    tributary_area: Array
    position: Array
    frame: Array
    unit_lengths: NDArray[np.int64] = FACETS
    gap: Array = TOUCHING


def points_on(
    contact: int,
    area: Array,
    position: Array,
    frame: Array,
    unit_lengths: int = 0,
    gap: Array = TOUCHING,
) -> ContactPoints:
    """The points of one contact of the scene, of which all have these `unit_lengths`."""
    numbers = np.full((2, area.size), [[contact], [unit_lengths]])
    return ContactPoints(numbers[0], area, position, frame, numbers[1], gap + np.zeros(area.size))


def no_points(dimension: int) -> ContactPoints:
    """The contact points of a scene without contact."""
    return points_on(0, np.zeros(0), np.zeros((0, dimension)), np.zeros((0, dimension, dimension)))


def all_points(dimension: int, parts: Iterable[ContactPoints]) -> ContactPoints:
    """The points of several contacts as one, in their order."""
    return ContactPoints(*map(np.concatenate, zip(no_points(dimension), *parts, strict=True)))


def shares(scene: Any, points: ContactPoints) -> Array:
    """The factors (P,) between the numbers of the scene's contacts and those of their points.

    The scene gives the numbers of a region per area, in SI units (N/m² and N/m³). For them, an edge
    is one unit of length of the scene wide, and a node is a square of this size. With mm, 20 N/mm
    for each node are 2e10 N/m³ of an area of 1e-6 m², which is 2e4 N/m.
    """
    length = float(LENGTHS[scene.units.length])
    return np.asarray(points.tributary_area * length**points.unit_lengths)


def paired(scene: Any, points: ContactPoints) -> NDArray[np.bool_]:
    """Which of the points (P,) touch another body, and not a rigid surface."""
    against = np.array([one.against is not None for one in scene.contacts], dtype=bool)
    return np.asarray(against[points.contact])


def contacts_of(scene: Any, points: ContactPoints) -> Contacts:
    """The parameters of a scene's contacts at their points.

    Raises:
        SceneError: a given radius lets the surface cut into the undeformed body, or waves have no
            angle.
    """
    count, d = points.position.shape
    chosen = [scene.contacts[k] for k in points.contact]

    def of(name: str) -> Array:
        return np.array([getattr(contact, name) for contact in chosen], dtype=np.float64)

    share = shares(scene, points)
    in_mesh = np.array([contact.has_mesh_gaps for contact in chosen], dtype=bool)
    given = np.array([contact.gap or 0.0 for contact in chosen])
    found = planes(
        share * of("preload"),
        np.where(in_mesh, points.gap, given),
        share * of("normal_stiffness"),
        share * of("tangential_stiffness"),
        of("friction"),
        d,
    )
    times = np.array(sorted({time for contact in scene.contacts for time, _ in contact.approach}))
    found = found._replace(
        history=history_of(scene.rotation), times=times, approach=np.zeros((count, times.size))
    )
    for p, contact in enumerate(chosen):
        if contact.approach:
            found.approach[p] = np.interp(times, *np.array(contact.approach).T)
    found = _with_surfaces(found, scene, points)
    rings = rings_of(scene, points, found)
    return coated(found, rings, pressing_areas(scene, points)) if rings else found


def _with_surfaces(contacts: Contacts, scene: Any, points: ContactPoints) -> Contacts:
    """The contacts with the round surfaces of the scene, and with their waves.

    Raises:
        SceneError: as `contacts_of`.
    """
    surfaces = {k: one.surface for k, one in enumerate(scene.contacts) if one.surface is not None}
    orders = sorted({order for surface in surfaces.values() for order, _, _ in surface.waves})
    shape = len(points.contact), len(orders)
    found = contacts._replace(order=np.array(orders), height=np.zeros(shape), phase=np.zeros(shape))
    for k, surface in surfaces.items():
        mine = np.flatnonzero(points.contact == k)
        frames, axes = points.frame[mine], _axes_of_waves(scene, points, scene.contacts[k])
        found.kind[mine] = SPHERE if surface.kind == "sphere" else CYLINDER
        found.axes[mine, : len(axes)] = axes @ frames.transpose(0, 2, 1)
        away = np.array(surface.point) - points.position[mine]
        found.centre[mine] = np.einsum("pij,pj->pi", frames, away)
        found.side[mine] = 1.0 if surface.inside else -1.0
        if found.history.size:
            found.spin[mine] = surface.spin or 0.0
            found.turns[mine] = surface_turns(surface, scene.rotation)
        else:
            found.spin[mine] = surface_spin(surface, scene.rotation)
        for order, height, phase in surface.waves:
            found.height[mine, orders.index(order)] += height
            found.phase[mine, orders.index(order)] = phase
        found.radius[mine] = _surface_radius(scene, k, points.position[mine])
    return found


def springs_of(contacts: Contacts, dimension: int) -> Array:
    """The springs k (m,) of all contact displacements, N/m."""
    found = np.repeat(contacts.tangential_stiffness, dimension)
    found[::dimension] = contacts.normal_stiffness
    return found


def trial_forces(contacts: Contacts, x: Array) -> Array:
    """The normal forces N₀ + k_n δ (P,) at displacements x (m,) before the motion begins, N."""
    at = x.reshape(len(contacts.preload), -1)
    depth = at[:, 0] - contacts.radius
    if contacts.times.size or np.any(contacts.kind != PLANE):
        depth = np.array([penetration(contacts, p, here, 0.0) for p, here in enumerate(at)])
    return np.asarray(contacts.preload + contacts.normal_stiffness * depth)


def closed_springs(contacts: Contacts, x: Array) -> Array:
    """The springs k (m,) of the planes that press at displacements x (m,), else 0, N/m."""
    d = x.size // max(len(contacts.preload), 1)
    closed = (trial_forces(contacts, x) > 0.0) & (contacts.kind == PLANE)
    return springs_of(contacts, d) * np.repeat(closed, d)


def _axes_of_waves(scene: Any, points: ContactPoints, contact: Any) -> Array:
    """The axes of the surface of a contact; the angle of waves and wear starts at the first one.

    The surface gives its direction, or it leads to the middle of all points with this surface.

    Raises:
        SceneError: the middle of the points is on the axis.
    """
    surface, d = contact.surface, points.position.shape[1]
    axes = axes_of(surface, d)
    if not surface.waves and (contact.abradable is None or surface.kind == "sphere"):
        return axes
    if surface.angle_from is not None:
        z = axes @ np.array(surface.angle_from)
    else:
        mine = [scene.contacts[k].surface == surface for k in points.contact]
        across = (points.position[mine] - np.array(surface.point)) @ axes.T
        z = np.average(across, axis=0, weights=points.tributary_area[mine])
        if np.linalg.norm(z) < NO_DIRECTION * np.linalg.norm(across, axis=1).max():
            key = f"contacts[{scene.contacts.index(contact)}].surface.angle_from"
            reason = "the contact points surround the axis, so the angle around it has no start; "
            reason += "give a direction across the axis"
            raise Where(scene.source, key).refuse(MISSING, reason)
    c, s = z / np.linalg.norm(z)
    return np.array([[c, s], [-s, c]]) @ axes


def _surface_radius(scene: Any, k: int, position: Array) -> float:
    """Radius of the round surface of contact k: the given one, or from its gap.

    Args:
        scene: the scene.
        k: the contact.
        position: (p, d) its points on the undeformed body, m.

    Raises:
        SceneError: the surface cuts into the undeformed body.
    """
    contact = scene.contacts[k]
    surface = contact.surface
    axes = axes_of(surface, position.shape[1])
    distances = [float(np.linalg.norm(axes @ (x - surface.point))) for x in position]
    nearest = max(distances) if surface.inside else min(distances)
    side = 1.0 if surface.inside else -1.0
    radius = float(
        surface.radius or nearest + (1.0 if surface.inside else -1.0) * (contact.gap or 0.0)
    )
    if not radius > 0.0 or (nearest - radius) * side > 1e-9 * radius:
        reason = "the surface cuts into the undeformed body, whose nearest contact point is at "
        reason += f"{nearest:.9g} m from the axis or centre of the surface"
        raise Where(scene.source, f"contacts[{k}].surface.radius").refuse(radius, reason)
    return radius
