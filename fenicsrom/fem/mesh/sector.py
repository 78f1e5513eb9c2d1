"""Bodies that are one sector of a disk: two cut faces that map onto each other by a rotation.

The cut faces may be plane, curved (of twisted blades) or kinked. The turn takes the outer normal of
one cut face to the inner normal of the other, and one middle to the other; both tell the axis. The
surface beside the cut faces must go on without a kink from one sector to the next one, as that of a
disk does and that of a tapered body does not.
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

SHARP = np.radians(30.0)
"""Two neighbouring facets belong to one face of the body if the angle between them is smaller."""

LEAST_AREA = 1e-3
"""Faces with a smaller share of the surface are no cut faces."""

MOST_FACES = 40
"""Most faces that are compared."""

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
            "this sector with free cut faces, not those of the disk: give the table [cyclic] "
            "(fenicsrom modes, campbell, run, sweep, compare, response), or mesh the whole disk"
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


def _surface(points: Floats, facets: Ints, inside: Floats) -> _Surface:
    """The boundary of facets (m, c) with corners in points (n, 3), beside places (m, 3) inside."""
    x = points[facets]
    across = (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    if facets.shape[1] == 4:
        across = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    areas = 0.5 * np.cross(*across)
    areas *= np.sign(np.einsum("ki,ki->k", x.mean(axis=1) - inside, areas))[:, None]  # outer
    ends = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    of, order = np.repeat(np.arange(len(facets)), facets.shape[1]), np.lexsort(ends.T)
    same = np.flatnonzero((ends[order][1:] == ends[order][:-1]).all(axis=1))
    sides = np.stack([of[order][same], of[order][same + 1]], axis=1)
    normals = areas / np.linalg.norm(areas, axis=1)[:, None]
    return _Surface(x, areas, normals, points[ends[order][same]], sides)


class _Turn(NamedTuple):
    """The rotation of faces a onto faces b: 360°/number about an axis through a point."""

    number: int
    turn: Rotation
    axis: Floats
    point: Floats
    a: Ints
    b: Ints

    def moved(self, x: Floats) -> Floats:
        """Places (..., 3) after the rotation."""
        return self.point + self.turn.apply(x - self.point)

    def equals(self, other: _Turn, extent: float) -> bool:
        """Whether another rotation is the same one, in a body of some extent, m."""
        away = np.linalg.norm(np.cross(other.point - self.point, self.axis))
        turned = (self.turn.as_rotvec() - other.turn.as_rotvec()) / self.turn.magnitude()
        return bool(np.linalg.norm(turned) < SAME and away < SAME * extent)


def find_sector(points: Floats, facets: Ints, inside: Floats) -> Sector | None:
    """Find two faces of a body that map onto each other by 360°/N, with N > 2.

    Args:
        points: coordinates (n, 3), m.
        facets: corners (k, 2 to 4) of the facets of the boundary, as indices of points. Those of a
            body in the plane z = 0 have two.
        inside: (k, 3) the middle of the cell of each facet, m.
    """
    count = len(points)
    if facets.shape[1] == 2:
        points, facets = _extruded(points, facets)
    surface = _surface(points, facets, inside)
    sizes = np.linalg.norm(surface.areas, axis=1)
    faces = _faces(surface)
    size = np.array([sizes[face].sum() for face in faces])
    large = np.argsort(-size)[:MOST_FACES]
    large = large[size[large] > LEAST_AREA * sizes.sum()]
    used = points[np.unique(facets)]
    extent = np.ptp(used, axis=0).max()
    turns: list[_Turn] = []
    for i, j in combinations(large, 2):
        turned = _between(surface, faces[i], faces[j], used)
        if abs(size[i] / size[j] - 1.0) < SAME and turned is not None:
            # a kinked cut face has several plane parts, which turn together
            same = next((k for k, turn in enumerate(turns) if turn.equals(turned, extent)), None)
            if same is None:
                turns.append(turned)
            else:
                a, b = (
                    np.concatenate(parts) for parts in zip(turns[same][4:], turned[4:], strict=True)
                )
                turns[same] = turned._replace(a=a, b=b)
    turns = [turn for turn in turns if _is_smooth(surface, turn)]
    if len(turns) != 1:  # a hexagonal bar has several axes, a sector has one
        return None
    corners = (np.unique(facets[face]) for face in (turns[0].a, turns[0].b))
    left, right = (points[at[at < count]] for at in corners)
    return Sector(turns[0].number, turns[0].axis, turns[0].point, (left, right))


def _extruded(points: Floats, edges: Ints) -> tuple[Floats, Ints]:
    """The sides (k, 4) of a plate above edges (k, 2), and its points: given ones, those above."""
    height = np.linalg.norm(np.diff(points[edges], axis=1), axis=2).min()
    above = points + np.array([0.0, 0.0, height])
    return np.concatenate([points, above]), np.hstack([edges, edges[:, ::-1] + len(points)])


def _faces(surface: _Surface) -> list[Ints]:
    """The facets of each face of the body: sharp edges are between faces."""
    first, second = surface.sides.T
    normals, count = surface.normals, len(surface.x)
    blunt = np.einsum("ki,ki->k", normals[first], normals[second]) > np.cos(SHARP)
    graph = coo_array((np.ones(blunt.sum()), (first[blunt], second[blunt])), shape=(count, count))
    face = connected_components(graph, directed=False)[1]
    order = np.argsort(face, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(face[order])) + 1)


def _between(surface: _Surface, a: Ints, b: Ints, points: Floats) -> _Turn | None:
    """The rotation that takes a face a, seen from outside, to a face b, seen from inside."""
    sums = [surface.areas[face].sum(axis=0) for face in (a, b)]
    weights = [np.linalg.norm(surface.areas[face], axis=1) for face in (a, b)]
    middles = [surface.x[face].mean(axis=1) for face in (a, b)]
    moments = [_moments(x, w) for x, w in zip(middles, weights, strict=True)]
    (first, _), (last, wanted) = moments
    axis = np.cross(sums[0] + sums[1], last - first)
    least = SAME * np.linalg.norm(sums[0]) * np.linalg.norm(last - first)
    if np.linalg.norm(axis) <= least:
        return None
    axis = axis / np.linalg.norm(axis)
    axis *= np.sign(axis[np.abs(axis).argmax()])
    angle = np.arctan2(
        axis @ np.cross(sums[1], sums[0]), (sums[0] @ axis) * (sums[1] @ axis) - sums[0] @ sums[1]
    )
    if angle < 0.0:
        return _between(surface, b, a, points)
    number = round(2.0 * np.pi / angle) if angle > SAME else 0
    if not 3 <= number <= MOST_SECTORS or abs(2.0 * np.pi / angle - number) > WHOLE:
        return None
    turn = Rotation.from_rotvec(angle * axis)
    point = np.linalg.lstsq(np.eye(3) - turn.as_matrix(), last - turn.apply(first), rcond=SAME)[0]
    found = _Turn(number, turn, axis, point, a, b)
    away = np.linalg.norm(np.cross(points - point, axis), axis=1)
    if number <= FEW and away.min() < BORE * np.ptp(points, axis=0).max():
        return None
    if sums[0] @ np.cross(axis, first - point) > 0.0:
        return None  # the body is the rest of the disk
    mean, square = _moments(found.moved(middles[0]), weights[0])
    scale = np.sqrt(np.trace(wanted))
    near = np.linalg.norm(mean - last) < SAME * scale
    return found if near and np.abs(square - wanted).max() < 10.0 * SAME * scale**2 else None


def _is_smooth(surface: _Surface, turned: _Turn) -> bool:
    """Whether the surface beside faces a, turned onto faces b, goes on beside b without kinks."""
    rims = []
    for face, opposite in ((turned.a, turned.b), (turned.b, turned.a)):
        inside = np.isin(surface.sides, face)
        rim = inside[:, 0] != inside[:, 1]
        rim &= ~np.isin(surface.sides, opposite).any(axis=1)  # the faces may meet on the axis
        beside = surface.sides[rim][~inside[rim]]
        rims.append((surface.ends[rim], surface.normals[beside]))
    (ends, normals), (others, wanted) = rims
    length = np.linalg.norm(np.diff(np.concatenate([ends, others]), axis=1), axis=2).max()
    near = cKDTree(others.mean(axis=1)).query_ball_point(turned.moved(ends.mean(axis=1)), length)
    least = np.cos(KINK * turned.turn.magnitude())
    pairs = zip(turned.turn.apply(normals), near, strict=True)
    return all(np.max(wanted[found] @ normal, initial=-1.0) > least for normal, found in pairs)


def _moments(places: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Mean (3,) and mean square (3, 3) of weighted places (k, 3)."""
    middle = np.average(places, axis=0, weights=weights)
    arm = places - middle
    return middle, np.einsum("k,ki,kj->ij", weights / weights.sum(), arm, arm)
