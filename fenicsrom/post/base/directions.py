"""The names of the directions in which displacements are given, for people.

All tables, sentences and pictures have the same order: the axes, or the normal of the contact and
then its tangents.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import NEGLIGIBLE
from fenicsrom.scene import Scene

ALIGNED = 1e-6  # largest components across an axis of a unit vector that is named by the axis


def plain_names(dimension: int, touching: bool) -> list[str]:
    """Name the directions of a motion whose contact frames are not known."""
    if not touching:
        return list("xyz"[:dimension])
    if dimension == 2:
        return ["normal", "tangential"]
    return ["normal", "tangential 1", "tangential 2"]


def direction_names(scene: Scene, points: ContactPoints) -> list[str]:
    """Name the directions of a motion: the axes of the probe, or those of the contact frames.

    A direction that is along the same axis at all points has the name of this axis, such as
    "tangential y".

    Args:
        scene: the scene.
        points: its contact points.
    """
    d = scene.geometry.dimension
    names = plain_names(d, bool(scene.contacts))
    if not scene.contacts:
        return names
    for k in range(d):
        rows = np.abs(points.frame[:, k])
        axis = int(np.argmax(rows[0]))
        if np.max(np.delete(rows, axis, axis=1)) <= ALIGNED:
            names[k] = f"{names[k].split()[0]} {'xyz'[axis]}"
    return names


def error_names(scene: Scene, points: ContactPoints) -> tuple[str, str]:
    """Name the first direction and all others together, as the errors of amplitudes are given."""
    first, *others = direction_names(scene, points)
    together = "tangential" if scene.contacts and len(others) > 1 else " and ".join(others)
    return first, together


def direction_note(scene: Scene, points: ContactPoints) -> str | None:
    """Give the vectors of the directions without an axis in their names; None if there are none."""
    names = direction_names(scene, points)
    plain = plain_names(len(names), bool(scene.contacts))
    told = [
        f"{name} ({', '.join(f'{value:.4g}' for value in np.round(points.frame[0, k], 6) + 0.0)})"
        for k, name in enumerate(names)
        if scene.contacts and name == plain[k]
    ]
    return f"Directions at the first contact point: {', '.join(told)}." if told else None


def millimetres(values: Sequence[float] | Array, digits: int = 5) -> list[str]:
    """Displacements in m as texts in mm; "0" for a displacement that is only rounding error."""
    largest = float(np.max(np.abs(values), initial=0.0))
    return [f"{1e3 * v:.{digits}g}" if abs(v) > NEGLIGIBLE * largest else "0" for v in values]


def in_order(amplitude: Mapping[str, Any]) -> list[float]:
    """Amplitudes of `online.motion.measures.amplitudes`, in the order of the directions."""
    return [amplitude["normal"], *amplitude["tangential"]]


def named_millimetres(
    names: Sequence[str], values: Sequence[float] | Array, digits: int = 5
) -> str:
    """List displacements given in m, each with the name of its direction, in mm."""
    texts = millimetres(values, digits)
    return ", ".join(f"{name} {text} mm" for name, text in zip(names, texts, strict=False))
