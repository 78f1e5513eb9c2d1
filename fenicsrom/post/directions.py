"""The names of the directions in which displacements are given, for people."""

from __future__ import annotations

import numpy as np

from fenicsrom.online.surfaces import frame
from fenicsrom.scene import Scene

ALIGNED = 1.0 - 1e-9  # cosine of the angle between a direction and the axis that names it


def direction_names(scene: Scene) -> list[str]:
    """Name the directions of a motion: the axes of the probe, or those of the contact frame.

    A direction along an axis is called by it, such as "tangential y", if all contacts are planes
    with one normal. On round surfaces the directions differ from point to point.
    """
    d = scene.geometry.dimension
    if not scene.contacts:
        return list("xyz"[:d])
    names = ["normal", "tangential"] if d == 2 else ["normal", "tangential 1", "tangential 2"]
    normals = {contact.normal for contact in scene.contacts}
    (normal, *others) = normals
    if others or normal is None:
        return names
    rows = np.abs(frame(np.array(normal)))
    for k in range(d):
        axis = int(np.argmax(rows[k]))
        if rows[k, axis] > ALIGNED:
            names[k] = f"{'tangential' if k else 'normal'} {'xyz'[axis]}"
    return names
