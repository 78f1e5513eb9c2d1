"""Contact between two regions of the mesh: rows averaged around the nodes of one of them.

For a point X of region A let Y be the closest point of region B, and n the unit vector from A into
B, minus the outer normal of B at Y. With the hats ψ_i of the facets of A, divided at their nodes,

    a_i = ∫_A ψ_i dA,    x_i = Q_i 1/a_i ∫_A ψ_i (u_A(X) − u_B(Y)) dA,                   (1)
    g_i = 1/a_i ∫_A ψ_i n · (Y − X) dA                                                   (2)

is the contact displacement of node i of A in its frame Q_i, and its gap. The hats are positive and
their sum is one, so a constant pressure gives constant contact forces per area (the patch test):
rows that compare a node with its closest point do not (Puso and Laursen, Comput. Methods Appl.
Mech. Eng. 193, 2004). The integrals are taken by quadrature on the facets of A. A point X has no
partner if another facet of the surface crosses the line from X to Y: a body that lies between.

In a disk, B may be a region of the neighbouring sector: turned by T, u_B(Y) is T times what the
neighbour moves in its own frame.
"""

from collections.abc import Sequence
from copy import copy
from typing import Any, NamedTuple

import basix
import numpy as np
import scipy.sparse
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.body.supports import node_pieces
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact.points import ContactPoints, points_on
from fenicsrom.online.contact.surfaces import frame
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.keys.contacts import Contact, Tie
from fenicsrom.scene.keys.places import Region
from fenicsrom.words import counted

GAUSS_POINTS = 8
"""Gauss points along an edge of a part of a facet of A; edges of B do not divide these parts."""

NEAREST = 16
"""Number of facets of B, those with the nearest midpoints, among which the closest point is."""

ITERATIONS = 10
"""Iterations for the closest point of a facet; one is enough if the facet is flat."""

OVER_THE_EDGE = 1e-6
"""Largest distance outside of a facet, and last change of an iteration, of a closest point, in
reference coordinates."""

FACING = 0.5
"""Cosine of the largest angle between n and the outer normal of A."""

LEAST_SHARE = 0.1
"""A node of A is a contact point if B lies opposite this part of its area."""

INSIDE = 1e-4
"""A may lie inside of B by this part of a facet of A, the rounding of mesh files."""

COARSER = 1.5
"""If the facets of A are larger than those of B by this factor, the two should be exchanged."""

SHUT = 1e-9
"""Smaller gaps, relative to a facet of A, are the rounding of coordinates."""

ROUNDING = 1e-14
"""Smaller entries of the rows are the rounding of those that cancel."""

PARTS = {
    "interval": [[0, 2], [2, 1]],
    "triangle": [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    "quadrilateral": [[0, 4, 5, 8], [4, 1, 8, 6], [5, 8, 2, 7], [8, 6, 7, 3]],
}
"""The nodes of the parts into which its nodes divide a quadratic facet."""

SIMPLICES = {"interval": [[0, 1]], "triangle": [[0, 1, 2]], "quadrilateral": [[0, 1, 2], [3, 2, 1]]}
"""The corners of the simplices into which a facet is divided."""

STIFFEST = 1e6
"""Largest stiffness of a contact, by the modulus of the bodies over a facet: stiffer contacts lose
digits, and their bodies can hardly be brought together."""

BETWEEN = 1e-6
"""A facet between two points lies by this part of their distance away from both."""


def lagrange(kind: Any, degree: int) -> Any:
    """The Lagrange element of basix that dolfinx takes on cells or facets of a kind."""
    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, kind, degree, variant)


class Side:
    """Some facets (F,) of all ranks, all of one kind, with their nodes; the same on every rank.

    Attributes:
        cells: (F,) the global number of the cell of each facet.
        cell_nodes: (F, c) the global numbers of its nodes.
        cell_x: (F, g, d) the nodes of its geometry, m.
        material: (F,) the number of its material.
        kind: the kind of the facets, of basix.
        element: their element.
        nodes: (F, k) the global numbers of the nodes of each facet.
        x: (F, k, d) their places, m.
        middle: (F, d) the mean of these places, m.
        size: (F,) the largest extent of each facet, m.
        thickness: (F,) thickness of the body there, m; 1 in 3D.
    """

    def __init__(self, body: Any, facets: Ints):
        """Take the facets of all ranks by their local numbers. Collective."""
        below, domain = body.dimension - 1, body.mesh.domain
        cells, numbers = body.mesh.sides(below, facets).T
        self.kind = basix.cell.subentity_types(domain.basix_cell())[below][0]
        self.element = lagrange(self.kind, body.geometry.degree)
        dofs, places = body.space.dofmap, body.space.tabulate_dof_coordinates()[:, : below + 1]
        layout, ways = dofs.dof_layout, range(int(np.max(numbers, initial=0)) + 1)
        on = np.array([layout.entity_closure_dofs(below, k) for k in ways])[numbers]
        of_cells, geometry = dofs.list[cells], domain.geometry
        nodes = np.take_along_axis(of_cells, on, axis=1)

        def of_all(values: Array, index: Any = None) -> Any:
            if index is not None:
                flat = index.local_to_global(values.astype(np.int32).ravel())
                values = flat.reshape(values.shape)
            return np.concatenate(body.comm.allgather(values))

        self.cells = of_all(cells, domain.topology.index_map(below + 1))
        self.cell_nodes, self.nodes = (of_all(at, dofs.index_map) for at in (of_cells, nodes))
        self.cell_x = of_all(geometry.x[geometry.dofmap[cells], : below + 1])
        self.material, self.x = of_all(body.materials.number[cells]), of_all(places[nodes])
        self.size = np.linalg.norm(np.ptp(self.x, axis=1), axis=1)
        self.middle = self.x.mean(axis=1)
        self.thickness = np.asarray(body.materials.thickness)[self.material]
        self._inwards = of_all(places[of_cells].mean(axis=1)) - self.middle

    def turned(self, cut: Any, rotation: Array) -> "Side":
        """The facets after a rotation (3, 3) about the axis of `cut`, a `CutFaces`."""
        found, d = copy(self), self.x.shape[2]
        x = self.x.reshape(-1, d)
        found.x = cut.turned(np.pad(x, [(0, 0), (0, 3 - d)]), rotation)[:, :d].reshape(self.x.shape)
        found.middle, found._inwards = found.x.mean(axis=1), self._inwards @ rotation[:d, :d].T
        return found

    def at(self, facets: Ints, points: Array) -> tuple[Array, Array, Array]:
        """Places (q, d), tangents (q, d - 1, d) and shape functions (q, k) of reference points."""
        values = np.zeros((self.x.shape[2], 0, self.x.shape[1]))
        if len(points):  # basix takes no empty array
            values = self.element.tabulate(1, points)[..., 0]
        x = self.x[facets]
        tangents = np.einsum("rqk,qkd->qrd", values[1:], x)
        return np.einsum("qk,qkd->qd", values[0], x), tangents, values[0]

    def normals(self, facets: Ints, tangents: Array) -> Array:
        """Outer unit normals (q, d) of facets with these tangents (q, d - 1, d)."""
        if tangents.shape[1] == 1:
            found = tangents[:, 0, ::-1] * [1.0, -1.0]
        else:
            found = np.cross(tangents[:, 0], tangents[:, 1])
        inwards = np.einsum("qd,qd->q", found, self._inwards[facets]) > 0.0
        return (
            np.where(inwards, -1.0, 1.0)[:, None] * found / np.linalg.norm(found, axis=1)[:, None]
        )

    def holds(self, points: Array, over: float = OVER_THE_EDGE) -> Array:
        """Whether reference points (q, d - 1) lie in the facet, or over its edge by so much."""
        found = np.all((points >= -over) & (points <= 1.0 + over), axis=1)
        if self.kind.name == "triangle":
            found &= points.sum(axis=1) <= 1.0 + over
        return np.asarray(found)

    def closest(self, x: Array, over: float = OVER_THE_EDGE) -> tuple[Ints, Array, Array]:
        """Facets (q,), reference points (q, d - 1) and distances (q,) of the points closest to x.

        The distance from x (q, d) is infinite if no facet has a point whose normal meets x, or the
        iterations for it do not converge. A facet ends `over` its edge, in reference coordinates.
        """
        count = min(NEAREST, len(self.middle))
        near = cKDTree(self.middle).query(x, [*range(1, count + 1)])[1]
        facet, distance = near[:, 0].copy(), np.full(len(x), np.inf)
        middle = np.asarray(basix.geometry(self.kind)).mean(axis=0)
        point = np.tile(middle, (len(x), 1))
        for facets in near.T:
            found = np.tile(middle, (len(x), 1))
            for _ in range(ITERATIONS):
                y, along, _ = self.at(facets, found)
                gram = np.einsum("qrd,qsd->qrs", along, along)
                away = np.einsum("qrd,qd->qr", along, x - y)
                step = np.linalg.solve(gram, away[:, :, None])[:, :, 0]
                found = np.clip(found + step, -1.0, 2.0)
                if np.max(np.abs(step), initial=0.0) < OVER_THE_EDGE**2:
                    break
            away = np.linalg.norm(x - self.at(facets, found)[0], axis=1)
            settled = np.max(np.abs(step), axis=1, initial=0.0) < OVER_THE_EDGE
            better = settled & self.holds(found, over) & (away < distance)
            facet[better], point[better], distance[better] = (
                values[better] for values in (facets, found, away)
            )
        return facet, point, distance

    def crosses(self, x: Array, y: Array) -> Array:
        """Whether a facet crosses the straight lines (q,) from x (q, d) to y (q, d) between both.

        A facet is taken as flat between its corners.
        """
        way, found = np.linalg.norm(y - x, axis=1), np.zeros(len(x), dtype=bool)
        near = cKDTree(self.middle).query_ball_point(0.5 * (x + y), 0.5 * (way + self.size.max()))
        line = np.repeat(np.arange(len(x)), [*map(len, near)])
        facet = np.concatenate([np.zeros(0), *near]).astype(int)
        for first, *others in SIMPLICES[self.kind.name]:
            start = self.x[facet, first]
            edges = [self.x[facet, other] - start for other in others]
            system = np.stack([*edges, (x - y)[line]], axis=2)
            regular = np.abs(np.linalg.det(system)) > 0.0
            away = (x[line] - start)[regular, :, None]
            at = np.linalg.solve(system[regular], away)[:, :, 0]
            along, inside = at[:, -1], at[:, :-1]
            met = (along > BETWEEN) & (along < 1.0 - BETWEEN)
            met &= np.all(inside >= 0.0, axis=1) & (inside.sum(axis=1) <= 1.0)
            found[line[regular][met]] = True
        return found


def sparse_rows(columns: Ints, values: Array, size: int) -> csr_array:
    """Sparse rows (q, size) with some values (q, k) in these columns (q, k)."""
    starts = np.arange(len(columns) + 1) * columns.shape[1]
    found = csr_array((values.ravel(), columns.ravel(), starts), shape=(len(columns), size))
    found.sum_duplicates()
    return found


def _quadrature(side: Side, whole: bool) -> tuple[Ints, Array, Array, Ints, Array]:
    """The points of a quadrature on all facets, with the hats of the parts of the facets.

    The only part of a `whole` facet is itself, with the hats of its corners.

    Returns:
        Facets (q,), reference points (q, d - 1), weights (q,) with the thickness, in m², and the
        nodes (q, c) at the corners of the part of each point with the values (q, c) of their hats.
    """
    hats = lagrange(side.kind, 1)
    points, weights = basix.make_quadrature(side.kind, 2 * GAUSS_POINTS * (1 + whole) - 1)
    values, count = hats.tabulate(1, points)[..., 0], len(side.x)
    facets = np.repeat(np.arange(count), len(points))
    whole |= side.element.degree == 1
    found: list[tuple[Any, ...]] = []
    for corners in [[*range(hats.dim)]] if whole else PARTS[side.kind.name]:
        places = np.asarray(side.element.points)[corners]
        at = np.tile(values[0] @ places, (count, 1))
        change = np.tile(np.einsum("rqk,ks->qrs", values[1:], places), (count, 1, 1))
        along = change @ side.at(facets, at)[1]
        area = np.sqrt(np.linalg.det(along @ along.swapaxes(1, 2)))
        weight = np.tile(weights, count) * area * side.thickness[facets]
        nodes = side.nodes[facets][:, corners]
        found.append((facets, at, weight, nodes, np.tile(values[0].T, count).T))
    facets, at, weight, nodes, hat = map(np.concatenate, zip(*found, strict=True))
    return facets, at, weight, nodes, hat


class Opposite(NamedTuple):
    """What lies opposite the q points of a quadrature on A.

    Attributes:
        hats: sparse (nodes, q) weights of the points times the hats ψ_i, in m².
        seen: (q,) 1 if a facet of B lies opposite, else 0.
        on: (q,) the facets of B.
        place: (q, d) the points X.
        first: sparse (q, nodes) u_A(X).
        second: sparse (q, nodes) u_B(Y).
        normal: (q, d) n.
        gap: (q,) n · (Y - X), m.
    """

    hats: csr_array
    seen: Array
    on: Ints
    place: Array
    first: csr_array
    second: csr_array
    normal: Array
    gap: Array


def opposite(
    body: Any, pair: Contact | Tie, key: str, sides: tuple[Side, ...], whole: bool = False
) -> Opposite:
    """Find the closest points of B for a quadrature on A; errors as `pair_rows`.

    Args:
        body: the body.
        pair: the contact or tie.
        key: its key in the scene.
        sides: both regions and the rest of the surface.
        whole: take the hats of the corners of the facets of A, and not those of their parts.
    """
    a, b, *others = sides
    elsewhere = _elsewhere(body, pair)
    facets, points, weights, corners, hats = _quadrature(a, whole)
    x, along, shapes = a.at(facets, points)
    on, place, distance = b.closest(x)
    y, along_b, shapes_b = b.at(on, place)
    outer, normal = a.normals(facets, along), -b.normals(on, along_b)
    seen = distance <= (np.finfo(float).max if pair.reach is None else pair.reach)
    if not seen.any():
        far = np.min(np.where(np.isfinite(distance), distance, np.linalg.norm(x - y, axis=1)))
        reason = f"no facet of {_named(pair)} lies opposite those of the first region"
        reason += "" if pair.reach is None else f" within {pair.reach:.3g} m"
        reason += f"; the nearest is {far:.3g} m away{elsewhere}"
        raise _refused(body, reason, key)
    if np.any(np.einsum("qd,qd->q", outer, normal)[seen] < FACING):
        reason = f"the outer normals of the two regions are not opposite{elsewhere}"
        raise _refused(body, reason, key)
    away = np.flatnonzero(seen & (distance > INSIDE * a.size.mean()))
    seen[away] = ~np.any([other.crosses(x[away], y[away]) for other in others], axis=0)
    if not seen.any():
        reason = f"other facets lie between the region and {_named(pair)}{elsewhere}"
        raise _refused(body, reason, key)
    size = body.size // body.dimension
    return Opposite(
        hats=csr_array(sparse_rows(corners, weights[:, None] * hats, size).T),
        seen=1.0 * seen,
        on=on,
        place=x,
        first=sparse_rows(a.nodes[facets], shapes, size),
        second=sparse_rows(b.nodes[on], shapes_b, size),
        normal=normal,
        gap=np.einsum("qd,qd->q", normal, y - x),
    )


def sides_of(
    body: Any, regions: dict[str, Region], key: str, beside: bool = False
) -> tuple[Side, Side, Side]:
    """The two regions of a contact or tie by their keys, and the rest of the surface. Collective.

    The second region may be one of the next sector (`beside`). Errors as `pair_rows`.
    """
    if body.slanted is not None:
        raise _refused(body, "supports must hold along the axes (components, not normal)", key)
    for where, region in regions.items():
        if body.mesh.reaches_inside(region):
            raise _refused(body, "facets of the region lie inside a body; take its surface", where)
    facets = [*map(body.mesh.facets, regions.values())]
    if not beside:
        facets = _of_two_bodies(body, [*regions.values()], facets, key)
    others = np.setdiff1d(body.mesh.outside(), np.concatenate(facets))
    a, b, rest = (Side(body, found) for found in (*facets, others))
    if shared := len(np.intersect1d(a.nodes, b.nodes)):
        reason = f"the two regions share {counted(shared, 'node')}; give each body its own nodes, "
        raise _refused(body, f"{reason}and the first region by a group of one body", key)
    return a, b, rest


def _of_two_bodies(
    body: Any, regions: Sequence[Region], facets: Sequence[Ints], key: str
) -> list[Ints]:
    """The facets of two regions, without what a box or a plane holds of the body of the other one.

    Where both are boxes or planes with the same two bodies, the smaller facets come first.
    """
    free, below = [region.group is None for region in regions], body.dimension - 1
    if not any(free):
        return [*facets]
    pieces, nodes = node_pieces(body.mesh, body.space)[0], body.space.dofmap.list
    own = body.mesh.domain.topology.index_map(below).size_local
    found = [one[one < own] for one in facets]
    piece = [pieces[nodes[body.mesh.sides(below, one)[:, 0], 0]] for one in found]
    first, second = (np.concatenate(body.comm.allgather(one)) for one in piece)
    size = Side(body, found[0]).size
    finest = min(np.unique(first).tolist(), key=lambda one: float(size[first == one].mean()))
    kept = _kept_bodies(free, {*first.tolist()}, {*second.tolist()}, finest)
    if kept is None:
        reason = "both regions hold facets of several bodies; pick one body, or give a group"
        raise _refused(body, reason, key)
    if not all(kept):
        reason = "the box or plane holds facets of one body only; bodies that share nodes are one "
        reason += "(geometry.glue = false keeps those of a CAD file apart)"
        raise _refused(body, reason, key)
    return [one[np.isin(of, [*held])] for one, of, held in zip(found, piece, kept, strict=True)]


def _kept_bodies(
    free: Sequence[bool], first: set[int], second: set[int], finest: int
) -> tuple[set[int], set[int]] | None:
    """The bodies of which two regions keep their facets; None if it is in doubt.

    A set is empty if both regions hold the same body only.

    Args:
        free: whether each region is a box or a plane, which may leave bodies out.
        first: the bodies of the facets of the first region.
        second: those of the second one.
        finest: the body of the smallest facets in the first region.
    """
    if all(free) and first == second and len(first) == 2:
        return {finest}, second - {finest}
    if all(free) and min(len(first), len(second)) > 1:
        return None
    if free[1] and (not free[0] or len(first) == 1):
        return first, second - first
    return first - second, second


class Averages(NamedTuple):
    """The averages (1) around P nodes of A.

    Attributes:
        places: (P, d) the places of the nodes, m.
        area: (P,) a_i, m².
        whole: area of A, m².
        mean: sparse (P, q) the averages of values at the points of the quadrature.
        first: sparse (P d, local) of the displacement u_A(X) in global axes.
        second: the same of u_B(Y).
    """

    places: Array
    area: Array
    whole: float
    mean: csr_array
    first: csr_array
    second: csr_array

    @property
    def moved(self) -> csr_array:
        """Sparse (P d, local) of u_A(X) - u_B(Y)."""
        return csr_array(self.first - self.second)


def averages(
    body: Any, pair: Contact | Tie, key: str, a: Side, found: Opposite, turn: Array
) -> Averages:
    """The averages around the nodes of A; arguments and errors as `opposite`.

    `turn` (d, d) is T of a neighbour.
    """
    d = body.dimension
    x = np.zeros((body.size // d, d))
    x[a.nodes] = a.x
    area, whole = found.hats @ found.seen, found.hats @ np.ones(len(found.seen))
    kept = np.flatnonzero(area > LEAST_SHARE * whole)
    if not kept.size:
        share = f"{100.0 * LEAST_SHARE:g} % of the area of any node of the first region"
        reason = f"less than {share} lies opposite {_named(pair)}; refine its facets, or "
        raise _refused(body, f"{reason}exchange group and against", key)
    longest_last = np.argsort(-np.ptp(x[kept], axis=0).round(9), kind="stable")[::-1]
    kept = kept[np.lexsort(x[kept][:, longest_last].round(12).T)]
    area = area[kept]
    scale = scipy.sparse.diags_array(1.0 / area), scipy.sparse.diags_array(found.seen)
    mean = scale[0] @ found.hats[kept] @ scale[1]
    free = np.ones(body.local)
    free[body.clamped] = 0.0
    own = body.own.T @ scipy.sparse.diags_array(free)
    first, second = (
        csr_array(scipy.sparse.kron(mean @ part, way) @ own)
        for part, way in ((found.first, np.eye(d)), (found.second, turn))
    )
    return Averages(x[kept], area, float(whole.sum()), mean, first, second)


class PairRows(NamedTuple):
    """The contact points of a contact between two regions.

    Attributes:
        own: sparse rows (P d, local) of (1) in the local frames, for the displacements of the body.
        ahead: the same for those of the next sector, in the sense of counting; else zero.
        points: the points.
        sides: the nodes of the first and of the second region on this rank.
    """

    own: csr_array
    ahead: csr_array
    points: ContactPoints
    sides: tuple[Ints, Ints]


def _of_neighbour(cut: Any, sides: tuple[Side, ...]) -> tuple[tuple[Side, ...], int, Array]:
    """The sides with B and the rest of a neighbour, the sense in which it follows, and T (3, 3)."""
    a, b, rest = sides
    ways = {s: cut.rotation(2.0 * np.pi * s / cut.sectors) for s in (1, -1)}
    places = {s: b.turned(cut, way).middle.mean(axis=0) for s, way in ways.items()}
    sense = min(ways, key=lambda s: float(np.linalg.norm(places[s] - a.middle.mean(axis=0))))
    moved = b.turned(cut, ways[sense]), rest, rest.turned(cut, ways[sense])
    return (a, *moved), sense, ways[sense]


def pair_rows(body: Any, contact: Contact, number: int) -> PairRows:
    """The contact points between two regions of a body, at the nodes of the first. Collective.

    Args:
        body: the body; its `pairs` take a sentence on what lies opposite.
        contact: the contact; `against` names the second region.
        number: number of the contact in the scene.

    Returns:
        The rows and the points, whose tributary areas are the a_i, with the gaps (2). A sector has
        the contact between itself and the next one.

    Raises:
        SceneError: a stiffness is out of range, a region is inside a body, the regions share nodes
            or do not face each other, no part of B lies opposite A or near enough, other facets
            lie between them, or A lies inside B and the scene gives no gap.
    """
    place, d = f"contacts[{number}]", body.dimension
    key, beside = f"{place}.against", contact.neighbour
    sense, turn = 0, np.eye(3)
    both = {f"{place}.group": contact.place, key: contact.other}
    sides: tuple[Side, ...] = sides_of(body, both, key, beside)
    if contact.neighbour:
        sides, sense, turn = _of_neighbour(body.cut, sides)
    _require_range(body, contact, place, sides)
    found = opposite(body, contact, key, sides)
    around = averages(body, contact, key, sides[0], found, turn[:d, :d])
    x = around.places
    frames = np.array([frame(n / np.linalg.norm(n)) for n in around.mean @ found.normal])
    gap = around.mean @ found.gap
    gap[np.abs(gap) < SHUT * sides[0].size.mean()] = 0.0
    depth = -float(gap.min())
    if contact.has_mesh_gaps and depth > INSIDE * sides[0].size.mean():
        worst = x[np.argmin(gap)].round(6).tolist()
        reason = f"the first region lies up to {depth:.3g} m inside {_named(contact)}, near "
        reason += f"{worst}; correct the mesh, or give contacts.gap{_elsewhere(body, contact)}"
        raise _refused(body, reason, key)
    turned = scipy.sparse.bsr_array((frames, np.arange(len(x)), np.arange(len(x) + 1)))
    parts = [around.moved] if not sense else [around.first, -around.second][::sense]
    rows = [csr_array(turned @ part) for part in parts]
    for part in rows:
        part.data[np.abs(part.data) < ROUNDING] = 0.0
        part.eliminate_zeros()
    own, ahead = rows if sense else (rows[0], csr_array(rows[0].shape))
    used = gap if contact.has_mesh_gaps else np.full(len(x), contact.gap or 0.0)
    tell(body, contact, place, around, used, sides[:2])
    points = points_on(number, around.area, x, frames, gap=gap)
    local = body.space.dofmap.index_map.global_to_local
    first, second = (local(np.unique(side.nodes)) for side in sides[:2])
    return PairRows(own, ahead, points, (first[first >= 0], second[second >= 0]))


def modulus_of(body: Any, sides: tuple[Side, ...]) -> float:
    """The largest entry of the elasticity tensors behind both regions, Pa."""
    used = np.unique(np.concatenate([side.material for side in sides[:2]]))
    return max(float(np.abs(body.materials.tensor(k)).max()) for k in used)


def _require_range(body: Any, contact: Contact, place: str, sides: tuple[Side, ...]) -> None:
    """Refuse a stiffness that is far beyond that of the bodies."""
    most = STIFFEST * modulus_of(body, sides) / float(sides[0].size.mean())
    for name in ("normal_stiffness", "tangential_stiffness"):
        if (given := getattr(contact, name)) > most:
            allowed = f"must be at most {most:.3g} N/m³, {STIFFEST:g} times the stiffness of one "
            raise Where(body.source, f"{place}.{name}").refuse(given, f"{allowed}cell of the body")


def tell(
    body: Any,
    pair: Contact | Tie,
    place: str,
    around: Averages,
    gap: Array,
    sides: tuple[Side, ...],
) -> None:
    """Tell the user what lies opposite, and if the second mesh is the finer one."""
    area = around.area
    a, b = (float(side.size.mean()) for side in sides)
    of = " of the next sector" * (isinstance(pair, Contact) and pair.neighbour)
    text = (
        f"{place}: {counted(len(area), 'point')} against {_named(pair)}{of} on "
        f"{area.sum():.4g} m² of {around.whole:.4g} m², gaps {gap.min():.3g} to {gap.max():.3g} m"
    )
    body.pairs.append(text)
    if a > COARSER * b:
        text = (
            f"{place}: the facets of the region are {a / b:.2g} times as large as those of "
            f"{_named(pair)}, whose nodes may pass between its points: exchange the two"
        )
        body.warnings.append(Note(NoteKind.IMPLAUSIBLE, text, place))


def _named(pair: Contact | Tie) -> str:
    """The second region in words."""
    return repr(pair.against) if isinstance(pair.against, str) else "the second region"


def _elsewhere(body: Any, pair: Contact | Tie) -> str:
    """What to do if the second region belongs to the next sector of a disk."""
    may_be_next = body.cut is not None and isinstance(pair, Contact) and not pair.neighbour
    return "; if it touches the next sector, set neighbour = true" * may_be_next


def _refused(body: Any, reason: str, key: str) -> SceneError:
    """The error of a contact between regions."""
    return refuse(body.source, reason, ErrorKind.PLACE, key)
