"""Function spaces on small meshes, and polynomial fields on them."""

import numpy as np
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

CELLS = {
    "triangle": (5, 22),
    "quadrilateral": (9, 28),
    "tetrahedron": (10, 24),
    "hexahedron": (12, 29),
}


LENGTH, HEIGHT = 2.0, 0.1


def space_on(cell, degree=2, comm=MPI.COMM_SELF, along=6):
    kind = dmesh.CellType[cell]
    if cell in ("triangle", "quadrilateral"):
        domain = dmesh.create_rectangle(comm, [[0, 0], [LENGTH, HEIGHT]], [along, 1], kind)
    else:
        domain = dmesh.create_box(comm, [[0, 0, 0], [LENGTH, HEIGHT, HEIGHT]], [along, 1, 1], kind)
    return fem.functionspace(domain, ("Lagrange", degree, (domain.geometry.dim,)))


def field(points, degree, d):
    """Components that are different polynomials of the degree of the space, (n, d)."""
    x, y, z = points.T
    return np.stack(
        [1 + 2 * x - y, x**degree - 3 * z + y * x ** (degree - 1), y**degree + 4 * z - x][:d],
        axis=1,
    )


def of_space(space, degree):
    return field(space.tabulate_dof_coordinates(), degree, space.dofmap.index_map_bs).ravel()
