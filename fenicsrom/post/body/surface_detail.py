"""Surfaces for pictures: fewer triangles of a fine mesh, more of a coarse one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body.body_surface import Ints, Surface, areas

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MOST = 12000
"""About the largest number of triangles: one takes about 0.01 ms in each picture of the body."""

LEAST = 4000
"""Fewer triangles, each of one colour, show steps of the colour."""

LEAST_OF_MANY = 1000
"""The same of small panels, which are drawn many times."""

LEAST_SMOOTH = 300
"""The same of an animation, whose colours are interpolated."""


def for_picture(
    surface: Surface, values: Mapping[str, Array], least: int = LEAST
) -> tuple[Surface, dict[str, Array]]:
    """Give a surface of `least` to about `MOST` triangles, and values (n, ...) on it."""
    surface, kept = simplified(surface)
    surface, mean = refined(surface, least)
    return surface, {label: mean @ found[kept] for label, found in values.items()}


def simplified(surface: Surface, most: int = MOST) -> tuple[Surface, Ints]:
    """Leave out the points inside, and merge points if there are too many triangles.

    Points in the same cube whose normals have the same direction, roughly, become one (vertex
    clustering, Rossignac and Borrel 1993). A surface of merged points has no edges of cells.

    Args:
        surface: the surface.
        most: about the largest number of triangles.

    Returns:
        The simplified surface, and the numbers (n,) of its points in the given surface.
    """
    kept, triangles = np.unique(surface.triangles, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    points = surface.points[kept]
    number = np.zeros(len(surface.points), dtype=np.int64)
    number[kept] = np.arange(len(kept))
    if len(triangles) <= most:
        edges, wires = number[surface.edges], number[surface.wires]
        return replace(surface, points=points, triangles=triangles, edges=edges, wires=wires), kept
    first, group = _clusters(points, triangles, most)
    triangles, edges = group[triangles], group[number[surface.edges]]
    a, b, c = triangles.T
    sound = np.flatnonzero((a != b) & (b != c) & (c != a))
    fate = np.full(len(triangles), -1)
    fate[sound] = np.arange(len(sound))
    triangles = triangles[sound]
    any_at = np.zeros(len(first), dtype=np.int64)
    any_at[triangles.ravel()] = np.repeat(np.arange(len(sound)), 3)
    _, once = np.unique(np.sort(edges, axis=1), axis=0, return_index=True)
    once = once[edges[once, 0] != edges[once, 1]]
    edges, sides = edges[once], fate[surface.sides[once]]
    sides = np.where(sides < 0, any_at[edges], sides)
    none = np.zeros((0, 2), dtype=np.int64)
    found = Surface(points[first], triangles, edges, sides, none, none[:, 0], surface.flat)
    return found, kept[first]


def _clusters(points: Array, triangles: Ints, most: int) -> tuple[Ints, Ints]:
    """Group points for about so many triangles: a point of each group, the group of each point."""
    sizes = areas(points, triangles)
    pitch = np.sqrt(2.0 * float(np.linalg.norm(sizes, axis=1).sum()) / most)
    direction = np.zeros_like(points)
    for corner in range(3):
        for axis in range(3):
            direction[:, axis] += np.bincount(
                triangles[:, corner], sizes[:, axis], minlength=len(points)
            )
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    octant = np.rint(direction / np.where(length > 0.0, length, 1.0)).astype(np.int64) + 1
    cube = ((points - points.min(axis=0)) / pitch).astype(np.int64)
    keys = np.ravel_multi_index((*cube.T, *octant.T), (*(cube.max(axis=0) + 1), 3, 3, 3))
    _, first, group = np.unique(keys, return_index=True, return_inverse=True)
    return first, group.ravel()


def refined(surface: Surface, least: int) -> tuple[Surface, csr_array]:
    """Divide each triangle into four until there are at least so many.

    Returns:
        The surface, and the matrix of the means that give the values at its points.
    """
    from scipy.sparse import csr_array, eye_array, vstack  # slow to import

    mean = eye_array(len(surface.points), format="csr")
    while 0 < len(surface.triangles) < least:
        triangles = surface.triangles
        pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        middles, number = np.unique(pairs, axis=0, return_inverse=True)
        size = len(surface.points)
        rows = np.repeat(np.arange(len(middles)), 2)
        half = csr_array((np.full(rows.size, 0.5), (rows, middles.ravel())), (len(middles), size))
        step = csr_array(vstack([eye_array(size), half]))
        ab, bc, ca = size + number.reshape(-1, 3).T
        a, b, c = triangles.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        surface = replace(
            surface,
            points=step @ surface.points,
            triangles=np.stack([np.column_stack(part) for part in parts], 1).reshape(-1, 3),
            sides=4 * surface.sides,
            wire_sides=4 * surface.wire_sides,
        )
        mean = step @ mean
    return surface, mean
