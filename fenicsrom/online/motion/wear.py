"""What a motion wore of the abradable layers on its surfaces."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.rings import Ring, rings_of
from fenicsrom.online.contact.surfaces import Contacts, penetration, surface_turn
from fenicsrom.online.kernels.compiled import kernel
from fenicsrom.online.motion.motion import Motion

EVEN = 0.01  # smallest amplitude of the lobes, relative to the largest depth


class Wear(NamedTuple):
    """What a motion wore of one ring.

    Attributes:
        ring: the ring.
        depth: (cells,) worn depth at the nodes at the end of the motion, m.
        turned: angle by which the surface turned during the motion, as the body sees it, rad.
    """

    ring: Ring
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
        turned = abs(surface_turn(contacts, ring.points[0], 0.0, time)) if ring.radius else 0.0
        found.append(Wear(ring, ring.depth(motion.end.worn), turned))
    return found


def worn_under_points(motion: Motion, contacts: Contacts) -> Array:
    """The worn depth (ns, P) of the layer in front of each point at each step, m.

    It is the gap to the worn surface less the gap to the new one, at most the whole layer.
    """
    found = motion.gap.copy()
    _add_depths(contacts, motion.time, motion.displacement, found)
    return np.clip(found, 0.0, contacts.coating.thickness)


@kernel
def _add_depths(contacts: Contacts, time: Array, x: Array, found: Array) -> None:
    """Add the depth of points at x (ns, P, d) below the new surface to `found` (ns, P)."""
    for row in range(time.size):
        for p in range(found.shape[1]):
            found[row, p] += penetration(contacts, p, x[row, p], time[row])


def worn_profile(rings: Sequence[Ring], worn: Array) -> tuple[Array, Array]:
    """Angles (c,) in rad around the axis, and the largest depth (c,) of all rings there, in m.

    Args:
        rings: the rings; those before a surface at rest have no angle and are left out.
        worn: (nodes,) worn depths.
    """
    turning = [ring for ring in rings if ring.radius]
    if not turning:
        return np.zeros(0), np.zeros(0)
    angle = max(turning, key=lambda ring: ring.cells).angle
    depths = [np.interp(angle, r.angle, r.depth(worn), period=2.0 * np.pi) for r in turning]
    return angle, np.max(depths, axis=0)


def lobes_of(depth: Array) -> int:
    """The number of lobes of a worn depth (c,) at equal angles: its largest harmonic; 0 if even."""
    if not depth.any():
        return 0
    amplitudes = 2.0 / depth.size * np.abs(np.fft.rfft(depth)[1:])
    if amplitudes.max() <= EVEN * depth.max():
        return 0
    return int(np.argmax(amplitudes)) + 1
