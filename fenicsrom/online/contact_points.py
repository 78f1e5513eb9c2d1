"""Contact points of the body, and the parameters of the surfaces before them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError
from fenicsrom.online.surfaces import CYLINDER, SPHERE, Contacts, axes_of, planes, spin_of


class ContactPoints(NamedTuple):
    """Where P contact points are on the undeformed body.

    Attributes:
        contact: (P,) the entry of the scene's contacts that each belongs to.
        tributary_area: (P,) its part of that: 1 for a single point, else area, length or number.
        position: (P, d) m.
        frame: (P, d, d) rows normal into the surface, tangents.
    """

    contact: NDArray[np.int64]
    tributary_area: Array
    position: Array
    frame: Array


def no_points(dimension: int) -> ContactPoints:
    """The points of a scene without contact."""
    return ContactPoints(
        np.zeros(0, dtype=np.int64),
        np.zeros(0),
        np.zeros((0, dimension)),
        np.zeros((0, dimension, dimension)),
    )


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
        points.tributary_area * of("preload"),
        of("gap"),
        points.tributary_area * of("normal_stiffness"),
        points.tributary_area * of("tangential_stiffness"),
        of("friction"),
        d,
    )
    times = np.array(sorted({time for contact in scene.contacts for time, _ in contact.approach}))
    orders = sorted(
        {
            order
            for contact in scene.contacts
            if contact.surface
            for order, _, _ in contact.surface.waves
        }
    )
    found = found._replace(
        times=times,
        approach=np.zeros((count, times.size)),
        order=np.array(orders),
        height=np.zeros((count, len(orders))),
        phase=np.zeros((count, len(orders))),
    )
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
    for k, contact in enumerate(
        scene.contacts
    ):  # the radius of a surface: given, or the gap beyond the nearest node
        if contact.surface is None:
            continue
        mine = np.flatnonzero(points.contact == k)
        axes = axes_of(contact.surface, d)
        reach = [
            float(np.linalg.norm(axes @ (points.position[p] - contact.surface.point))) for p in mine
        ]
        nearest = max(reach) if contact.surface.inside else min(reach)
        radius = contact.surface.radius or nearest + (
            contact.gap if contact.surface.inside else -contact.gap
        )
        if (
            not radius > 0.0
            or (nearest - radius) * (1.0 if contact.surface.inside else -1.0) > 1e-9 * radius
        ):
            raise SceneError(
                f"{scene.source}: contacts[{k}].surface.radius = {radius:.9g}: the surface cuts into the undeformed body, whose "
                f"nearest contact point is at {nearest:.9g} m from its axis or centre"
            )
        found.radius[mine] = radius
    return found
