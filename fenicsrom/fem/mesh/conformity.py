"""Checks that the cells of a mesh join at whole facets."""

import numpy as np
from scipy.spatial import cKDTree

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.formats.mesh_file import Floats, Ints
from fenicsrom.formats.shapes import distinct, facets_of

ON_FACET = 1e-5
"""Nodes at smaller distances from a facet, relative to its size, lie on it.

Files with six significant digits place the nodes of a refined edge that accurately.
"""

WAYS_OUT = (
    "contact between two elastic bodies is not supported: join bodies where they touch (merge "
    "their nodes, or give both bodies in one .step file), or replace one body by a rigid surface "
    "in [[contacts]]"
)
"""What to do about bodies that touch and are not joined."""

MOST_PIECES = 4
"""Most pieces of a mesh that a sentence names."""


def ends_of(piece: Ints, x: Floats, count: int) -> Floats:
    """Lowest and highest coordinates (2, count, d) of the points x (n, d) of each piece (n,)."""
    low, high = np.full((2, count, x.shape[1]), np.inf)
    np.minimum.at(low, piece, x)
    np.minimum.at(high, piece, -x)
    return np.array([low, -high])


def apart(low: Floats, high: Floats) -> str:
    """Name the pieces of a mesh by their corners (k, d); empty for one piece."""
    if (number := len(low)) == 1:
        return ""
    size = float(np.max(high - low))
    low, high = (size * (np.round(end[:MOST_PIECES] / size, 6) + 0.0) for end in (low, high))
    boxes = [
        f"({', '.join(f'{a:.4g} to {b:.4g}' for a, b in zip(*ends, strict=True))})"
        for ends in zip(low, high, strict=True)
    ]
    return (
        f"the mesh has {number} pieces that share no node, so they do not feel each other and "
        f"may pass through each other: {', '.join(boxes)}{', ..' * (number > MOST_PIECES)} m; "
        f"{WAYS_OUT}"
    )


def check_conforming(source: str, kind: int, cells: Ints, points: Floats, dimension: int) -> None:
    """Check that cells do not overlap and that no node hangs inside a facet of another cell.

    Args:
        source: name of the mesh, for messages.
        kind: gmsh's number of the straight cell.
        cells: corners of the cells (k, corners), as indices of points.
        points: coordinates of the nodes (n, 3), m.
        dimension: dimension of the cells.

    Raises:
        SceneError: a coordinate is not finite, a facet belongs to more than two cells, or a node
            hangs.
    """
    if not np.isfinite(points).all():
        raise refuse(source, "a node has coordinates that are not finite", ErrorKind.MESH)
    facets = facets_of(kind, cells)
    facets = facets.reshape(-1, facets.shape[-1])
    first, _, count = distinct(facets)

    def refused(number: int, what: str, place: Floats, advice: str = "") -> SceneError:
        where = ", ".join(f"{value:.6g}" for value in place[:dimension])
        return refuse(source, f"{number} {what}, one at ({where}){advice}", ErrorKind.MESH)

    crowded = facets[first[count > 2]]
    if len(crowded):
        what = "facets belong to more than two cells, so cells overlap"
        raise refused(len(crowded), what, points[crowded[0]].mean(axis=0))
    hanging = _hanging(facets[first[count == 1]], points)
    if len(hanging):
        what = (
            "nodes lie on a facet of a cell that does not have them, so the cells there are not "
            "joined"
        )
        advice = f": refine with whole cells; {WAYS_OUT}"
        raise refused(len(hanging), what, points[hanging[0]], advice)


def _hanging(facets: Ints, points: Floats) -> Ints:
    """Nodes of the boundary that lie inside facets (k, corners) of the boundary."""
    nodes = np.unique(facets)
    x = points[facets]
    centre = x.mean(axis=1)
    radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
    near = cKDTree(points[nodes]).query_ball_point(centre, radius)
    which = np.repeat(np.arange(len(facets)), [len(found) for found in near])
    node = nodes[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
    other = ~(facets[which] == node[:, None]).any(axis=1)
    which, node = which[other], node[other]
    corners, place, size = x[which], points[node], radius[which]
    apart = np.linalg.norm(corners - place[:, None], axis=2).min(axis=1) > ON_FACET * size
    inside = np.zeros(len(node), dtype=bool)
    if facets.shape[1] == 2:
        inside = _on_segment(corners[:, 0], corners[:, 1], place, size)
    for a, b, c in {2: [], 3: [(0, 1, 2)], 4: [(0, 1, 2), (0, 2, 3)]}[facets.shape[1]]:
        inside |= _on_triangle(corners[:, a], corners[:, b], corners[:, c], place, size)
    return np.unique(node[inside & apart])


def _on_segment(a: Floats, b: Floats, place: Floats, size: Floats) -> Ints:
    """Whether places (k, 3) in the ball around a segment from a to b (k, 3) lie on it."""
    along = b - a
    t = np.einsum("ki,ki->k", place - a, along) / np.einsum("ki,ki->k", along, along)
    off = np.linalg.norm(place - a - t[:, None] * along, axis=1)
    return off <= ON_FACET * size


def _on_triangle(a: Floats, b: Floats, c: Floats, place: Floats, size: Floats) -> Ints:
    """Whether places (k, 3) lie on the triangles a, b, c (k, 3)."""
    u, v, w = b - a, c - a, place - a
    normal = np.cross(u, v)
    area = np.einsum("ki,ki->k", normal, normal)
    area = np.where(area > 0.0, area, np.inf)
    off = np.abs(np.einsum("ki,ki->k", w, normal)) / np.sqrt(area)
    second = np.einsum("ki,ki->k", np.cross(w, v), normal) / area
    third = np.einsum("ki,ki->k", np.cross(u, w), normal) / area
    weights = np.column_stack([1.0 - second - third, second, third])
    return (off <= ON_FACET * size) & (weights >= -ON_FACET).all(axis=1)
