"""What a motion wore of the abradable layers on its surfaces."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.rings import Ring, rings_of
from fenicsrom.online.contact.surfaces import surface_turn
from fenicsrom.online.motion.motion import Motion


class Wear(NamedTuple):
    """What a motion wore of one ring.

    Attributes:
        ring: the ring.
        angle: (cells,) of its nodes, rad: the angle of `surface.waves`, positive about the axis.
        depth: (cells,) worn depth at the nodes at the end of the motion, m.
        turned: angle by which the surface turned during the motion, as the body sees it, rad.
    """

    ring: Ring
    angle: Array
    depth: Array
    turned: float

    @property
    def area(self) -> float:
        """The integral of the worn depth over the angle, m rad."""
        return float(np.mean(self.depth) * 2.0 * np.pi)

    @property
    def volume(self) -> float:
        """The worn volume, m^3."""
        return self.ring.volume(self.depth)

    @property
    def plastic_work(self) -> float:
        """The work that wore the layer, J, which comes from what turns the surface."""
        return self.ring.plastic_work(self.depth)

    @property
    def mean_torque(self) -> float:
        """The plastic work over the angle by which the surface turned, N m; 0 at rest."""
        return self.plastic_work / self.turned if self.turned else 0.0


def wear_of(motion: Motion, scene: Any, points: ContactPoints) -> list[Wear]:
    """What a motion wore of each ring; empty if no surface of the scene has an abradable layer.

    Args:
        motion: the motion.
        scene: its scene.
        points: the contact points.
    """
    if not scene.wears or motion.end is None or motion.end.worn is None:
        return []
    contacts, time, found = contacts_of(scene, points), float(motion.time[-1]), []
    for ring in rings_of(scene, points, contacts):
        angle: Array = 2.0 * np.pi / ring.cells * np.arange(ring.cells, dtype=np.float64)
        turned = abs(surface_turn(contacts, ring.points[0], 0.0, time)) if ring.radius else 0.0
        found.append(Wear(ring, angle, ring.depth(motion.end.worn), turned))
    return found
