"""The deformation of a solid at quadrature points, and the table from which its stresses follow."""

from dataclasses import dataclass

import basix
import numpy as np
import numpy.typing as npt

from fenicsrom.arrays import Array
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.online.stress import stress
from fenicsrom.scene import Scene


def stress_table(
    solid: ElasticBody, scene: Scene, equilibrium: Array, vectors: Array
) -> stress.StressTable:
    """Tabulate displacement gradients at the Gauss points of all ranks. Collective.

    Args:
        solid: the body.
        scene: its scene.
        equilibrium: (local,) u₀, m.
        vectors: (local, n) the basis vectors.

    Returns:
        The table, the same on every rank; the cells are in the order of the ranks.
    """
    degree = solid.geometry.degree
    cell = solid.mesh.domain.basix_cell()
    simplex = cell in (basix.CellType.triangle, basix.CellType.tetrahedron)
    rule = 2 * (degree - 1) if simplex else 2 * degree - 1
    d = solid.dimension
    volume, gradients = solid.tabulated(vectors, equilibrium, degree=rule)
    nodes = _vertex_nodes(solid)
    used, cells = np.unique(nodes, return_inverse=True)
    columns = [solid.field(column).x.array for column in (equilibrium, *vectors.T)]
    moved = np.array([column.reshape(-1, d)[used] for column in columns])
    names = solid.space.dofmap.index_map.local_to_global(used.astype(np.int32))
    every = solid.comm.allgather(names)
    order, first = np.unique(np.concatenate(every), return_index=True)

    def joined(values: Array, axis: int = 0) -> Array:
        return np.concatenate(solid.comm.allgather(values), axis=axis)

    places = solid.space.tabulate_dof_coordinates()[used, :d]
    mine = np.searchsorted(order, names)[cells.reshape(nodes.shape)].astype(np.int64)
    points, _ = basix.make_quadrature(cell, rule)
    return stress.StressTable(
        stress.StressLaw.of(scene),
        joined(solid.quadrature_points(rule)),
        joined(volume),
        joined(gradients, 1),
        joined(mine),
        joined(places)[first],
        joined(moved, 1)[:, first],
        _extrapolation(cell, degree, points),
        joined(solid.materials.of_points(len(points))) if scene.materials else None,
    )


def _vertex_nodes(solid: ElasticBody) -> Array:
    """Local nodes (cells, v) of the displacement space at the vertices of the owned cells."""
    dofmap = solid.space.dofmap
    topology = solid.mesh.domain.topology
    owned = topology.index_map(topology.dim).size_local
    count = basix.topology(solid.mesh.domain.basix_cell())[0]
    corner = [dofmap.dof_layout.entity_dofs(0, vertex)[0] for vertex in range(len(count))]
    return np.asarray(dofmap.list[:owned][:, corner])


def _extrapolation(cell: basix.CellType, degree: int, points: Array) -> Array:
    """Extrapolation (v, g) from Gauss points to vertices by polynomials of degree k - 1."""
    corners = np.asarray(basix.geometry(cell))
    at_points, at_corners = (_shapes_at(cell, degree - 1, x) for x in (points, corners))
    return np.asarray(at_corners @ np.linalg.inv(at_points))


def _shapes_at(cell: basix.CellType, degree: int, points: Array) -> Array:
    """Shape functions (points, nodes) of a degree at points of a cell."""
    family, variant = basix.ElementFamily.P, basix.LagrangeVariant.gll_warped
    element = basix.create_element(family, cell, degree, variant, discontinuous=degree == 0)
    return np.asarray(element.tabulate(0, points)[0, :, :, 0])


@dataclass(frozen=True, eq=False)
class LocalPart:
    """The part of a table that belongs to the cells of this rank.

    Attributes:
        cells: its cells in the table.
        nodes: (cells, k) local nodes of the displacement space in each cell.
        shapes: (k, v) linear shape functions of the vertices at the nodes.
        count: number of local nodes, ghosts included.
    """

    cells: slice
    nodes: npt.NDArray[np.int32]
    shapes: Array
    count: int

    def at_nodes(self, table: stress.StressTable, values: Array) -> Array:
        """Values (count, m) at the nodes of this rank from values (N, m) at the vertices.

        The values are linear between the vertices; nodes of other ranks keep the value zero.
        """
        found = np.zeros((self.count, values.shape[1]))
        found[self.nodes] = self.shapes @ values[table.cells[self.cells]]
        return found


def local_part(solid: ElasticBody) -> LocalPart:
    """Find the part of the table that belongs to this rank. Collective."""
    dofmap = solid.space.dofmap
    counts = solid.comm.allgather(solid.owned_cells().size)
    first = sum(counts[: solid.comm.rank])
    own = counts[solid.comm.rank]
    cell = solid.mesh.domain.basix_cell()
    at_nodes = _shapes_at(cell, 1, np.asarray(solid.space.element.basix_element.points))
    count = dofmap.index_map.size_local + dofmap.index_map.num_ghosts
    return LocalPart(slice(first, first + own), np.asarray(dofmap.list[:own]), at_nodes, count)


def body_deformation(body: ElasticBody, scene: Scene, u: Array) -> stress.Deformation:
    """The deformation at a displacement u (local,), over all ranks. Collective.

    It is that of the points at which the forms of the body of a scene are integrated.
    """
    position, found = body.quadrature_points(body.quadrature_degree), [stress.NOWHERE]
    number = body.materials.of_points(len(position) // max(1, body.owned_cells().size))
    for weights, gradients in body.tabulate(np.zeros((body.local, 0)), u):
        here, position = np.split(position, [weights.size])
        mine, number = np.split(number, [weights.size])
        law = stress.StressLaw.of(scene).at(mine if scene.materials else None)
        change = gradients[:, 0]
        found.append(stress.deformation(law, here, change, np.zeros_like(change)))
    return stress.extremes(body.comm.allgather(stress.extremes(found)))
