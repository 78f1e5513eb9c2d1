"""Bodies that are one sector of a disk: two cut faces that map onto each other by a rotation.

Only plane cut faces are found. The axis is the line in which their planes meet. The surface beside
the cut faces must go on without a kink from one sector to the next one, as that of a disk does and
that of a tapered body does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fenicsrom.formats.mesh_file import Floats, Ints, Marks
from fenicsrom.notes import Note, NoteKind

FLAT = 1e-6
"""Two neighbouring facets lie in one plane if the sine between them is smaller."""

LEAST_AREA = 1e-3
"""Faces with a smaller share of the surface are no cut faces."""

MOST_FACES = 40
"""Most plane faces that are compared."""

SAME = 1e-3
"""Accepted difference of two faces after the rotation, relative to the face."""

WHOLE = 0.02
"""Accepted distance of the number of sectors from a whole number."""

MOST_SECTORS = 180
"""More sectors are no disk: two faces of a tapered body are nearly parallel."""

BORE = 1e-3
"""A body that comes nearer to the axis, relative to its extent, has no bore."""

FEW = 4
"""Bodies of so few sectors are more often brackets, bends or parts cut at planes of symmetry."""

KINK = 0.75
"""Largest kink beside the cut faces, relative to the angle of a sector.

Two facets in the width of a sector make one of 0.5, a tapered body makes one of 1.
"""


@dataclass(frozen=True, eq=False)
class Sector:
    """One sector of a disk.

    Attributes:
        number: sectors of the whole disk.
        axis: unit vector (3,) of the axis.
        point: a point (3,) of the axis, m.
        places: (n, 3) corners of the facets of each of the two cut faces, m.
    """

    number: int
    axis: Floats
    point: Floats
    places: tuple[Floats, Floats]

    def distances(self, x: Floats) -> Floats:
        """Distances of places (k, 3) or (3,) from the axis, m."""
        return np.linalg.norm(np.cross(x - self.point, self.axis), axis=-1)

    def are_cut(self, x: Floats) -> Marks:
        """Whether places (k, 3) are corners of facets of each cut face: (2, k)."""
        near = SAME**2 * np.ptp(np.concatenate(self.places), axis=0).max()
        return np.array([cKDTree(p).query(x)[0] < near for p in self.places])

    @property
    def is_likely(self) -> bool:
        """Whether the shape alone says that the body is a sector."""
        return self.number > FEW

    @property
    def note(self) -> Note:
        """A sentence for the user; it casts doubt only if the body is likely a sector."""
        axis = ", ".join(f"{value:.3g}" for value in np.round(self.axis, 9) + 0.0)
        looks, so = ("looks like", "the") if self.is_likely else ("may be", "if it is, the")
        text = (
            f"the body {looks} one of {self.number} sectors of a disk about the axis ({axis}): two "
            f"cut faces map onto each other by a rotation; {so} modes and motions are those of "
            "this sector with free cut faces, not those of the disk: mesh the whole disk"
        )
        return Note(NoteKind.WARNING if self.is_likely else NoteKind.REMARK, text, "geometry")


class _Surface(NamedTuple):
    """The boundary of a body: m facets with c corners, which share e edges.

    Attributes:
        x: (m, c, 3) corners, m.
        areas: (m, 3) outer normals times the areas, m².
        normals: (m, 3) outer normals.
        ends: (e, 2, 3) ends of the edges, m.
        sides: (e, 2) the two facets at each edge.
    """

    x: Floats
    areas: Floats
    normals: Floats
    ends: Floats
    sides: Ints


def _surface(points: Floats, facets: Ints) -> _Surface:
    """The boundary of facets (m, c) with corners in points (n, 3)."""
    x = points[facets]
    across = (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if facets.shape[1] == 4:
        across = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    areas = 0.5 * np.cross(*across)
    areas *= np.sign(np.einsum("ki,ki->", x.mean(axis=1), areas))  # outer normals
    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    of, order = np.repeat(np.arange(len(facets)), facets.shape[1]), np.lexsort(ends.T)
    same = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    sides = np.stack([of[order][same], of[order][same + 1]], axis=1)
    normals = areas / np.linalg.norm(areas, axis=1)[:, None]
    return _Surface(x, areas, normals, points[ends[order][same]], sides)


def find_sector(points: Floats, facets: Ints) -> Sector | None:
    """Find two plane faces of a body in space that map onto each other by 360°/N, with N > 2.

    Args:
        points: coordinates (n, 3), m.
        facets: corners (k, 3 or 4) of the facets of the boundary, as indices of points.
    """
    surface = _surface(points, facets)
    sizes = np.linalg.norm(surface.areas, axis=1)
    faces = _plane_faces(surface)
    size = np.array([sizes[face].sum() for face in faces])
    large = np.argsort(-size)[:MOST_FACES]
    large = large[size[large] > LEAST_AREA * sizes.sum()]
    used, found = points[np.unique(facets)], []
    for a, b in combinations(large, 2):
        if abs(size[a] / size[b] - 1.0) < SAME:
            turned = _between(surface, faces[a], faces[b], used)
            if turned is not None:
                places = (points[np.unique(facets[faces[k]])] for k in (a, b))
                found.append(Sector(*turned, (next(places), next(places))))
    # a hexagonal bar has several axes, a sector has one
    one = all(abs(abs(sector.axis @ found[0].axis) - 1.0) < SAME for sector in found)
    one = one and all(s.distances(found[0].point) < SAME * np.ptp(used) for s in found)
    return found[0] if found and one else None


def _plane_faces(surface: _Surface) -> list[Ints]:
    """The facets of each plane part of the boundary."""
    first, second = surface.sides.T
    normals, count = surface.normals, len(surface.x)
    flat = np.linalg.norm(np.cross(normals[first], normals[second]), axis=1) < FLAT
    graph = coo_array((np.ones(flat.sum()), (first[flat], second[flat])), shape=(count, count))
    face = connected_components(graph, directed=False)[1]
    order = np.argsort(face, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(face[order])) + 1)


def _between(
    surface: _Surface, a: Ints, b: Ints, points: Floats
) -> tuple[int, Floats, Floats] | None:
    """Number of sectors, axis and a point of it, if a face a maps onto a face b; else None."""
    x, areas = surface.x, surface.areas
    normal, other = (areas[face].sum(axis=0) for face in (a, b))
    normal, other = normal / np.linalg.norm(normal), other / np.linalg.norm(other)
    axis = np.cross(normal, other)
    sine = float(np.linalg.norm(axis))
    angle = np.pi - np.arctan2(sine, normal @ other)  # from one outer normal to the other inner one
    if sine < SAME or angle < SAME:
        return None
    number = round(2.0 * np.pi / angle)
    if not 3 <= number <= MOST_SECTORS or abs(2.0 * np.pi / angle - number) > WHOLE:
        return None
    axis = axis / sine * np.sign(axis[np.abs(axis).argmax()])
    weights = [np.linalg.norm(areas[face], axis=1) for face in (a, b)]
    middles = [
        np.average(x[face].mean(axis=1), axis=0, weights=w)
        for face, w in zip((a, b), weights, strict=True)
    ]
    planes = np.array([normal, other, axis])
    point = np.linalg.solve(planes, [normal @ middles[0], other @ middles[1], axis @ middles[0]])
    away = np.linalg.norm(np.cross(points - point, axis), axis=1)
    if number <= FEW and away.min() < BORE * np.ptp(points, axis=0).max():
        return None
    if max(normal @ (middles[1] - point), other @ (middles[0] - point)) > 0.0:
        return None  # the body is the rest of the disk
    for sign in (1.0, -1.0):
        turn = Rotation.from_rotvec(sign * angle * axis)
        if np.allclose(turn.apply(normal), -other, atol=SAME):
            turned = point + turn.apply(x[a].mean(axis=1) - point)
            inertia = _moments(turned, weights[0]), _moments(x[b].mean(axis=1), weights[1])
            scale = np.sqrt(np.trace(inertia[1][1]))
            near = np.linalg.norm(inertia[0][0] - inertia[1][0]) < SAME * scale
            alike = np.abs(inertia[0][1] - inertia[1][1]).max() < 10.0 * SAME * scale**2
            fits = near and alike and _is_smooth(surface, a, b, point, turn)
            return (number, axis, point) if fits else None
    return None


def _is_smooth(surface: _Surface, a: Ints, b: Ints, point: Floats, turn: Rotation) -> bool:
    """Whether the surface beside a face a, turned onto a face b, goes on beside b without kinks."""
    rims = []
    for face in (a, b):
        inside = np.isin(surface.sides, face)
        rim = inside[:, 0] != inside[:, 1]
        beside = surface.sides[rim][~inside[rim]]
        rims.append((surface.ends[rim], surface.normals[beside]))
    (ends, normals), (others, wanted) = rims
    length = np.linalg.norm(np.diff(np.concatenate([ends, others]), axis=1), axis=2).max()
    places = point + turn.apply(ends.mean(axis=1) - point)
    near = cKDTree(others.mean(axis=1)).query_ball_point(places, length)
    least = np.cos(KINK * turn.magnitude())
    pairs = zip(turn.apply(normals), near, strict=True)
    return all(np.max(wanted[found] @ normal, initial=-1.0) > least for normal, found in pairs)


def _moments(places: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mean (3,) and mean square (3, 3) of weighted places (k, 3)."""
    middle = np.average(places, axis=0, weights=weights)
    arm = places - middle
    return middle, np.einsum("k,ki,kj->ij", weights / weights.sum(), arm, arm)
