"""Bodies that are one sector of a disk: two cut faces that map onto each other by a rotation.

Only plane cut faces are found. The axis is the line in which their planes meet.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from fenicsrom.formats.mesh_file import Floats, Ints, Marks

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
"""A body that comes nearer to the axis, relative to its extent, is no sector with a bore."""


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
    def note(self) -> str:
        """A sentence for the user."""
        axis = ", ".join(f"{value:.3g}" for value in np.round(self.axis, 9) + 0.0)
        return (
            f"the body looks like one of {self.number} sectors of a disk about the axis ({axis}): "
            "two cut faces map onto each other by a rotation; the modes and motions are those of "
            "this sector with free cut faces, not those of the disk: mesh the whole disk"
        )


def find_sector(points: Floats, facets: Ints) -> Sector | None:
    """Find two plane faces of a body in space that map onto each other by 360°/N, with N > 2.

    Args:
        points: coordinates (n, 3), m.
        facets: corners (k, 3 or 4) of the facets of the boundary, as indices of points.
    """
    x = points[facets]
    across = (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if facets.shape[1] == 4:
        across = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    areas = 0.5 * np.cross(*across)
    sizes = np.linalg.norm(areas, axis=1)
    areas *= np.sign(np.einsum("ki,ki->", x.mean(axis=1), areas))  # outer normals
    faces = _plane_faces(facets, areas / sizes[:, None])
    size = np.array([sizes[face].sum() for face in faces])
    large = np.argsort(-size)[:MOST_FACES]
    large = large[size[large] > LEAST_AREA * sizes.sum()]
    used, found = points[np.unique(facets)], []
    for a, b in combinations(large, 2):
        if abs(size[a] / size[b] - 1.0) < SAME:
            turned = _between(x, areas, faces[a], faces[b], used)
            if turned is not None:
                places = (points[np.unique(facets[faces[k]])] for k in (a, b))
                found.append(Sector(*turned, (next(places), next(places))))
    # a hexagonal bar has several axes, a sector has one
    one = all(abs(abs(sector.axis @ found[0].axis) - 1.0) < SAME for sector in found)
    one = one and all(s.distances(found[0].point) < SAME * np.ptp(used) for s in found)
    return found[0] if found and one else None


def _plane_faces(facets: Ints, normals: Floats) -> list[Ints]:
    """The facets of each plane part of the boundary."""
    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    of = np.repeat(np.arange(len(facets)), facets.shape[1])
    order = np.lexsort(ends.T)
    same = (ends[order][1:] == ends[order][:-1]).all(axis=1)
    first, second = of[order][:-1][same], of[order][1:][same]
    flat = np.linalg.norm(np.cross(normals[first], normals[second]), axis=1) < FLAT
    graph = coo_array((np.ones(flat.sum()), (first[flat], second[flat])), shape=(len(facets),) * 2)
    face = connected_components(graph, directed=False)[1]
    order = np.argsort(face, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(face[order])) + 1)


def _between(
    x: Floats, areas: Floats, a: Ints, b: Ints, points: Floats
) -> tuple[int, Floats, Floats] | None:
    """Number of sectors, axis and a point of it, if a face a maps onto a face b; else None."""
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
    if away.min() < BORE * np.ptp(points, axis=0).max():
        return None
    for sign in (1.0, -1.0):
        turn = Rotation.from_rotvec(sign * angle * axis)
        if np.allclose(turn.apply(normal), -other, atol=SAME):
            turned = point + turn.apply(x[a].mean(axis=1) - point)
            inertia = _moments(turned, weights[0]), _moments(x[b].mean(axis=1), weights[1])
            scale = np.sqrt(np.trace(inertia[1][1]))
            near = np.linalg.norm(inertia[0][0] - inertia[1][0]) < SAME * scale
            alike = np.abs(inertia[0][1] - inertia[1][1]).max() < 10.0 * SAME * scale**2
            return (number, axis, point) if near and alike else None
    return None


def _moments(places: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mean (3,) and mean square (3, 3) of weighted places (k, 3)."""
    middle = np.average(places, axis=0, weights=weights)
    arm = places - middle
    return middle, np.einsum("k,ki,kj->ij", weights / weights.sum(), arm, arm)
