"""The parallel projection of a body, which looks at its broad side."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body.body_surface import Ints, areas, is_flat

BROAD = 1.5
"""Ratio of the areas seen from two sides from which one of them is the broad side."""

OBLIQUE = (0.72, 0.15, 0.66)
"""Direction to the viewer: parts along the broad side's normal, the long axis, and across both."""

SIDEWAYS = ((0.45, 0.15, 0.88), (0.88, 0.15, 0.45))
"""Other directions: they look across a displacement along the normal, or across the narrow side."""

END_ON = (0.65, 0.45, 0.60)
"""The same, so that an end of the body is seen as well."""


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection that looks at the broad side of a body.

    Attributes:
        right, up, towards: (3,) unit vectors of the picture; `towards` points to the viewer.
        length: largest extent of the body, m.
    """

    right: Array
    up: Array
    towards: Array
    length: float

    def project(self, points: Array) -> Array:
        """(n, 2) places in the picture, m."""
        return points @ np.column_stack([self.right, self.up])


def view_of(
    points: Array,
    triangles: Ints,
    facing: Array | None = None,
    oblique: tuple[float, float, float] = OBLIQUE,
    moved: Array | None = None,
) -> View:
    """Look at the broad side of a body; its longest axis lies across the picture.

    The broad side is the direction from which most of the surface is seen, perpendicular to the
    longest axis. A body along z stands upright.

    Args:
        points: (n, 3) points of the body, m.
        triangles: (k, 3) point numbers of its surface.
        facing: (3,) normal of a place that must be seen: the viewer moves to the other side, or
            below the body, if the place is not seen otherwise.
        oblique: direction to the viewer, `OBLIQUE` or `END_ON`.
        moved: (3,) the largest displacement that is shown: of `oblique` and `SIDEWAYS`, that
            direction is taken that looks across it.
    """
    extent = np.ptp(points, axis=0)
    thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
    if is_flat(points):
        x, y, z = np.eye(3)
        return View(x, y, z, float(extent.max()))
    normal = areas(points, triangles)
    sizes = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    plane = np.array([middle, thin])
    seen, turn = np.linalg.eigh(plane @ (normal.T @ (normal / sizes)) @ plane.T)
    broad = turn[:, 1] @ plane if seen[1] > BROAD * seen[0] else middle
    broad = broad * (-1.0 if np.cross(broad, along) @ [0.0, 0.6, 1.0] < 0.0 else 1.0)
    third = np.cross(broad, along)
    axes = np.array([broad, along, third])
    if moved is not None:
        oblique = min((oblique, *SIDEWAYS), key=lambda way: abs(float(way @ axes @ moved)))
    towards = oblique @ axes
    if facing is not None and facing @ towards < 0.0:
        sides = [(a, 1.0, b) for a, b in itertools.product((1.0, -1.0), repeat=2)]
        towards = max(
            (np.multiply(oblique, side) @ axes for side in sides),
            key=lambda direction: float(facing @ direction),
        )
    up = along if along[2] else third
    towards = towards / np.linalg.norm(towards)
    up = up - (up @ towards) * towards
    up = up / np.linalg.norm(up)
    return View(np.asarray(np.cross(up, towards)), up, towards, float(extent.max()))


def largest_of(displacement: Array) -> Array:
    """The largest of displacements (n, 3), (3,) m."""
    return np.asarray(displacement[int(np.argmax(np.linalg.norm(displacement, axis=1)))])


def frame_of(places: Sequence[Array], spare: float) -> tuple[Array, Array]:
    """The lower left and the upper right corner of places (n, 2) with a margin, m."""
    low = np.min([place.min(axis=0) for place in places], axis=0) - spare
    high = np.max([place.max(axis=0) for place in places], axis=0) + spare
    return low, high
