"""The CalculiX deck of a scene: the same mesh, supports, materials, loads and rotation.

Quadratic hexahedra and quadrilaterals of CalculiX lack the nodes inside faces and cells. Their
displacements are those of this program with the values there that the serendipity functions give,

    u = T u_s,    p_s = Tᵀ p,    (1)

where u_s are the displacements of the remaining nodes, and p and p_s work-equivalent forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import basix
import numpy as np
from dolfinx import fem
from mpi4py import MPI
from numpy.typing import NDArray
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.exchange.calculix import CutSector, Deck, Equation, Pressed, Section, Transient
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import UNDEFORMED, Solid
from fenicsrom.formats.mesh_file import Block, Ints, MeshFile
from fenicsrom.formats.shapes import SERENDIPITY, SHAPES
from fenicsrom.online.model.loads import factors, histories_of
from fenicsrom.scene import Region, Scene, scene_heading
from fenicsrom.scene.checks.contact_checks import require_no_pairs
from fenicsrom.scene.keys.times import FixedStep, StepsPerPeriod

CORNERS = {
    basix.CellType.triangle: (2, (0, 1, 2), (0, 2, 1), (1, 2)),
    basix.CellType.quadrilateral: (3, (0, 1, 3, 2), (0, 2, 3, 1), (1, 3)),
    basix.CellType.tetrahedron: (4, (0, 1, 2, 3), (0, 2, 1, 3), (1, 2, 3)),
    basix.CellType.hexahedron: (5, (0, 1, 3, 2, 4, 5, 7, 6), (4, 5, 7, 6, 0, 1, 3, 2), (1, 3, 4)),
}
"""Straight kind of a cell, its corners in gmsh's order, those of a mirrored cell, and the places of
the corners beside the first one."""

MODES = 10
"""Number of natural frequencies if `basis.modes` does not give it."""

PERIODS = 3
"""Periods of the transient of a scene whose loads repeat."""

ZERO = 1e-12
"""Smaller coefficients of an equation, whose first one is 1, are rounding errors."""


def scene_deck(scene: Scene, *, frequencies: bool = False) -> Deck:
    """Make the deck of a scene.

    Args:
        scene: the scene.
        frequencies: leave out the loads that vary in time and their transient, so that the deck
            gives the frequencies of `fenicsrom modes`.

    Raises:
        SceneError: the mesh or a place cannot be used, or the deck cannot hold the scene.
    """
    require_no_pairs(scene)
    for k, found in enumerate(scene.attachments):
        if found.to is not None:
            reason = "not allowed in fenicsrom export, whose deck has springs to the ground only"
            raise refuse(scene.source, reason, ErrorKind.CONFLICT, f"attachments[{k}].to")
    if scene.ties:
        reason = "not allowed in fenicsrom export, whose deck cannot tie meshes that do not match"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "ties")
    if scene.cyclic is not None and scene.geometry.dimension == 2:
        reason = "not allowed in fenicsrom export for a plane sector, which CalculiX cannot join"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "cyclic")
    if frequencies:
        scene = replace(scene, loads=tuple(load for load in scene.loads if load.static))
    mesh = build_mesh(scene.geometry, MPI.COMM_SELF)
    bare = replace(scene, loads=(), contacts=(), rotation=None, probe=None)
    solid = Solid(mesh, bare, UNDEFORMED)
    d, nodes = solid.dimension, _Nodes(solid)
    force = np.zeros(solid.local)
    for k, load in enumerate(scene.loads):
        if load.static and not load.follower:
            force += load.size * solid.load_vector(load, f"loads[{k}]")
    clamped = nodes.clamped()
    rotation = scene.rotation
    axis = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    if rotation is not None:
        axis[0, :d] = rotation.point or 0.0
        axis[1] = rotation.axis or axis[1]
    modes = scene.basis.modes
    return Deck(
        title=scene_heading(scene),
        notes=tuple(_left_out(scene, nodes)),
        mesh=nodes.mesh_file(),
        plane=scene.geometry.plane,
        sections=tuple(
            Section(cells, solid.materials.every[k], float(solid.materials.thickness[k]))
            for k, cells in solid.materials.cells()
            if cells.size
        ),
        clamped=clamped,
        equations=tuple(nodes.equations()),
        masses=nodes.attached(solid.point_masses).max(axis=1),
        springs=nodes.attached(solid.springs),
        forces=np.where(clamped, 0.0, nodes.project(force)),
        pressures=tuple(
            nodes.pressed(load.place, load.size)
            for load in scene.loads
            if load.static and load.follower
        ),
        omega_squared=0.0 if rotation is None else rotation.omega**2,
        axis=axis,
        nonlinear=scene.geometrically_nonlinear or rotation is not None,
        modes=modes if isinstance(modes, int) and modes else MODES,
        printed=_observed(scene, solid, nodes),
        transient=_transient(scene, solid, nodes),
        sector=_sector(scene, solid, nodes),
    )


def _sector(scene: Scene, solid: Solid, nodes: _Nodes) -> CutSector | None:
    """How the deck makes a disk of a sector.

    Raises:
        SceneError: the cut faces meet on the axis.
    """
    cut, cyclic = solid.cut, scene.cyclic
    if cut is None or cyclic is None:
        return None
    cut.require_bore("a deck of CalculiX")
    following, leading = (np.flatnonzero(cut.marks[nodes.kept] == mark) for mark in (2.0, 1.0))
    ends = np.array([cut.point, cut.point + cut.axis])
    return CutSector(cut.sectors, following, leading, ends, cyclic.waves)


def _instants(scene: Scene) -> Array:
    """The ends (s,) of the time steps of a transient, from 0.

    They are empty without a fixed step, and for a sector, which would move as all others.
    """
    stepping = scene.time.stepping
    if scene.cyclic is not None:
        return np.zeros(0)
    if isinstance(stepping, FixedStep) and scene.time.duration is not None:
        return np.arange(round(scene.time.duration / stepping.step) + 1) * stepping.step
    if isinstance(stepping, StepsPerPeriod) and scene.period is not None:
        steps = stepping.steps_per_period
        return np.arange(PERIODS * steps + 1) * scene.period / steps
    return np.zeros(0)


def _transient(scene: Scene, solid: Solid, nodes: _Nodes) -> Transient | None:
    """The transient under the dead loads that vary in time; None without such loads or steps."""
    moving = [k for k, load in enumerate(scene.loads) if not load.static and not load.follower]
    times = _instants(scene)
    if not moving or not times.size:
        return None
    histories, clamped = histories_of(scene.loads), nodes.clamped()
    vectors = [solid.load_vector(scene.loads[k], f"loads[{k}]") for k in moving]
    return Transient(
        times,
        np.array([factors(histories, float(time))[moving] for time in times]),
        np.array([np.where(clamped, 0.0, nodes.project(vector)) for vector in vectors]),
    )


def _left_out(scene: Scene, nodes: _Nodes) -> list[str]:
    """Sentences on what the deck leaves out."""
    varying = [load for load in scene.loads if not load.static]
    stepless = bool(varying) and not _instants(scene).size
    coriolis = scene.rotation is not None and scene.rotation.coriolis
    masses = scene.rotation is not None and any(found.mass for found in scene.attachments)
    left = {
        "the contacts with friction are left out": scene.contacts,
        "the loads that vary in time are left out: they need a fixed time step and no [cyclic]": (
            stepless
        ),
        "the mistuning is left out": scene.cyclic and scene.cyclic.mistuning,
        "the follower pressures that vary in time are left out": not stepless
        and any(load.follower for load in varying),
        "CalculiX has another stiffness of follower pressures in its natural frequencies": any(
            scene.loads[k].static for k in scene.followers
        ),
        "the damping is left out": scene.material.mass_damping or scene.viscous,
        "the Coriolis force is left out": coriolis,
        "CalculiX has no spin softening of concentrated masses in its frequencies": masses,
        "the elements lack the nodes inside faces and cells, so they are stiffer than the cells of "
        "this program; triangles and tetrahedra are the same": nodes.drops,
    }
    return [sentence for sentence, applies in left.items() if applies]


def _observed(scene: Scene, solid: Solid, nodes: _Nodes) -> Ints:
    """The nodes of the probe or, without it, of the first contact or load that has a place."""
    places = [*([scene.probe] if scene.probe else []), *(c.place for c in scene.contacts)]
    places += [load.place for load in scene.loads if not load.everywhere]
    if not places:
        return np.zeros(0, dtype=np.int64)
    rows = solid.place(places[0], "probe")[0]
    weights = sum(np.abs(nodes.project(row)).sum(axis=1) for row in rows)
    return np.flatnonzero(weights)


class _Nodes:
    """For each node of the deck, its number in the displacement space.

    Attributes:
        kept: (k,) the numbers of the nodes of the deck.
        drops: whether nodes are left out.
    """

    def __init__(self, solid: Solid):
        """Order the nodes of the cells, and find the ones to leave out."""
        self._solid = solid
        cell, layout = solid.mesh.domain.basix_cell(), solid.space.dofmap.dof_layout
        self._topology = basix.topology(cell)
        straight, plain, mirrored, beside = CORNERS[cell]
        quadratic = solid.geometry.degree == 2
        self._kind = SERENDIPITY[straight] if quadratic else straight
        self._corner = [layout.entity_dofs(0, v)[0] for v in range(len(self._topology[0]))]
        self._middle: dict[frozenset[int], int] = {}
        if quadratic:
            for number, ends in enumerate(self._topology[1]):
                self._middle[frozenset(ends)] = layout.entity_dofs(1, number)[0]
        self._rows = np.asarray(solid.space.dofmap.list, dtype=np.int64)
        self._x = solid.space.tabulate_dof_coordinates()
        corners = self._x[self._rows[:, self._order(plain)]]
        sides = (corners[:, beside] - corners[:, :1])[:, :, : solid.dimension]
        self._mirrored = np.linalg.det(sides) < 0.0
        self._orders = plain, mirrored
        usual, turned = (self._rows[:, self._order(corners)] for corners in self._orders)
        cells = np.where(self._mirrored[:, None], turned, usual)
        self.kept, inverse = np.unique(cells, return_inverse=True)
        self._cells = inverse.reshape(cells.shape)
        self._number = np.full(len(self._x), -1)
        self._number[self.kept] = np.arange(len(self.kept))
        self._transfer = self._interpolation(layout)
        self.drops = len(self.kept) < len(self._x)

    def _order(self, corners: Sequence[int]) -> list[int]:
        """The nodes of a cell in gmsh's order, from the order of its corners."""
        edges = SHAPES[self._kind].edges if self._middle else ()
        between = [self._middle[frozenset((corners[a], corners[b]))] for a, b in edges]
        return [*(self._corner[v] for v in corners), *between]

    def _interpolation(self, layout: Any) -> csr_array:
        """T of (1), (nodes, kept nodes)."""
        rows, columns, values = [self.kept], [self._number[self.kept]], [np.ones(len(self.kept))]
        done = self._number >= 0
        for dimension, weight in ((2, 0.5), (3, 0.25)):
            entities = self._topology[dimension] if dimension < len(self._topology) else []
            for number, vertices in enumerate(entities):
                sides = [k for ends, k in self._middle.items() if ends <= set(vertices)]
                for inner in layout.entity_dofs(dimension, number):
                    nodes, first = np.unique(self._rows[:, inner], return_index=True)
                    new = ~done[nodes]
                    nodes, first = nodes[new], first[new]
                    done[nodes] = True
                    around = [(self._corner[v], -0.25) for v in vertices]
                    for other, share in [*around, *((k, weight) for k in sides)]:
                        rows.append(nodes)
                        columns.append(self._number[self._rows[first, other]])
                        values.append(np.full(len(nodes), share))
        places = np.concatenate(rows), np.concatenate(columns)
        return csr_array((np.concatenate(values), places), shape=(len(self._x), len(self.kept)))

    def project(self, force: Array) -> Array:
        """p_s (kept nodes, d) of (1) from p (local,)."""
        return np.asarray(self._transfer.T @ force.reshape(len(self._x), -1))

    def clamped(self) -> NDArray[np.bool_]:
        """Whether the components of the kept nodes are clamped (kept nodes, d).

        Raises:
            SceneError: a node is clamped that is left out, and the nodes around it are not.
        """
        held = np.zeros(self._solid.local)
        held[self._solid.clamped] = 1.0
        every = held.reshape(len(self._x), -1)
        if (slanted := self._solid.slanted) is not None:
            every[slanted.nodes] += np.diagonal(slanted.held, axis1=1, axis2=2)
        weights = abs(self._transfer)
        around = weights @ every[self.kept] / weights.sum(axis=1)[:, None]
        if np.any(every > around + 0.5 / SHAPES[self._kind].nodes):
            raise self._lost("supports")
        return (held.reshape(len(self._x), -1) == 1.0)[self.kept]

    def equations(self) -> list[Equation]:
        """The equations of the kept nodes that are held along slanted directions.

        The equations of one node are in reduced echelon form: the first component of each equation
        is in no other equation.
        """
        found = []
        slanted = self._solid.slanted
        for node, held in zip(slanted.nodes, slanted.held, strict=True) if slanted else ():
            rows, firsts = held.copy(), []
            for k in range(round(float(np.trace(held)))):
                row, axis = np.unravel_index(np.argmax(np.abs(rows[k:])), rows[k:].shape)
                rows[[k, k + row]] = rows[[k + row, k]]
                rows[k] /= rows[k, axis]
                others = np.arange(len(rows)) != k
                rows[others] -= np.outer(rows[others, axis], rows[k])
                firsts.append(int(axis))
            for first, row in zip(firsts, rows, strict=False):
                rest = [k for k in np.flatnonzero(np.abs(row) > ZERO) if k != first]
                terms = tuple((int(k), float(row[k])) for k in (first, *rest))
                if self._number[node] >= 0:
                    found.append((int(self._number[node]), terms))
        return found

    def pressed(self, region: Region, size: float) -> Pressed:
        """The faces of cells in a region, with a pressure on them, Pa."""
        mesh, d, shapes = self._solid.mesh, self._solid.dimension, SHAPES[self._kind].facets
        sides, faces = mesh.sides(d - 1, mesh.facets(region)), []
        for cell, inner in sides:
            order = self._orders[int(self._mirrored[cell])]
            corners = {order.index(vertex) for vertex in self._topology[d - 1][inner]}
            faces.append(next(k for k, shape in enumerate(shapes) if set(shape) == corners))
        return Pressed(sides[:, 0], np.array(faces, dtype=np.int64), size)

    def attached(self, values: Array) -> Array:
        """Of masses or stiffnesses (local,), those of the kept nodes, (kept nodes, d).

        Raises:
            SceneError: a node that is left out has an attachment.
        """
        every = values.reshape(len(self._x), -1)
        dropped = np.ones(len(every), dtype=bool)
        dropped[self.kept] = False
        if np.any(every[dropped]):
            raise self._lost("attachments")
        return np.asarray(every[self.kept])

    def _lost(self, key: str) -> SceneError:
        """The error that a node is left out which the scene needs."""
        reason = "they use a node inside a face or cell, which the elements of CalculiX lack; use "
        reason += "triangles or tetrahedra"
        return refuse(self._solid.source, reason, ErrorKind.CONFLICT, key)

    def mesh_file(self) -> MeshFile:
        """The mesh with its groups; groups of facets and of nodes are groups of nodes.

        A group that counts its nodes has the nodes of the file only.
        """
        mesh, space = self._solid.mesh, self._solid.space
        scalar = fem.functionspace(mesh.domain, ("Lagrange", self._solid.geometry.degree))

        def nodes_of(name: str) -> NDArray[np.int64]:
            if mesh.unit_lengths(name) < 2:
                return self._number[mesh.nodes(name, space)]
            return self._number[np.flatnonzero(mesh.node_counts(name, scalar))]

        groups = {}
        for name in mesh.cell_groups:
            groups[name] = np.zeros(len(self._cells), dtype=bool)
            groups[name][mesh.cells(name)] = True
        names = dict.fromkeys((*mesh.facet_groups, *mesh.node_groups))
        numbers = {name: nodes_of(name) for name in names}
        nodes = {name: found[found >= 0] for name, found in numbers.items()}
        return MeshFile(self._x[self.kept], (Block(self._kind, self._cells, groups),), nodes)
