"""The contact forces of a motion in axes that do not turn with the surfaces."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.motion import Motion
from fenicsrom.online.surfaces import Contacts, unit_normals


def contact_forces(contacts: Contacts, motion: Motion) -> tuple[Array, Array]:
    """Contact forces that act against the motion, in the frames of the points on the body.

    A motion gives its forces along the current normals and tangents.

    Args:
        contacts: parameters of the contact points in the motion.
        motion: the motion.

    Returns:
        Normal forces and friction forces, N, both (ns, P, d).
    """
    normals = unit_normals(contacts, motion.displacement, motion.time)
    normal = motion.force[:, :, :1] * normals
    friction = motion.force.copy()
    friction[:, :, 0] = 0.0
    across = np.sum(friction * normals, axis=2, keepdims=True)
    friction -= across / (1.0 + normals[:, :, :1]) * (normals + np.eye(normals.shape[2])[0])
    return normal, friction
