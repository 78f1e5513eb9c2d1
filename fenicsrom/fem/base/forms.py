"""Forms and expressions, compiled with vectorised loops.

The loops over the basis functions of a cell are short sums. A compiler vectorises them only if it
may change the order of the additions. Infinities and numbers that are not defined keep their rules,
by which diverging iterations are recognised. The code suits every processor of an architecture, so
that computers may share a cache.

The degree of the quadrature rule, by the distortion of the cells.

The rule of degree 4 is exact for the force and the tangent on affine quadratic simplices. On
quadratic parallelepipeds it is exact for the linear stiffness, and accurate to 1e-8 for the force
at large displacements. On a distorted cell the integrand is a rational function. With the Jacobian
J of the mapping, its mean J̄ over the points and

    δ = max |J̄⁻¹ J − I|,    (1)

it is a power series in δ, whose term δᵏ has a degree that is k higher. A rule of degree p leaves a
relative error of the frequencies of about

    e_p = C mean((δ/2)ᵖ⁻²),    (2)

with the mean over the volume. C was measured: quarters of rings of 1 to 4 curved quadrilaterals
along the arc, and a twisted blade of hexahedra, give errors of 0.2 to 4 times (2) for δ below 1.
"""

from typing import Any

import basix
import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from fenicsrom.arrays import Array
from fenicsrom.fem.base.compat import cells_of

LEAST_DEGREE = 4
"""Degree on cells that are not distorted."""

LARGEST_DEGREE = 8
"""A rule of this degree has 125 points in a hexahedron; more would slow down the assembly."""

ERROR_FACTOR = 0.008
"""C of (2)."""

TOLERANCE = 1e-4
"""Accepted error (2) of the frequencies: less than the error of usual meshes."""

CHUNK = 20_000  # cells whose Jacobians are computed together


def quadrature_degree(domain: dolfinx.mesh.Mesh) -> int:
    """Degree of the rule for a mesh of quadratic displacements. Collective.

    Args:
        domain: the mesh.

    Returns:
        The smallest degree with positive weights that meets `TOLERANCE`, at most `LARGEST_DEGREE`.
    """
    volume, distortion = _distortions(domain)
    total = domain.comm.allreduce(float(volume.sum()))
    for degree in range(LEAST_DEGREE, LARGEST_DEGREE, 2):
        mean = domain.comm.allreduce(float(volume @ (0.5 * distortion) ** (degree - 2))) / total
        if ERROR_FACTOR * mean <= TOLERANCE and _is_positive(domain, degree):
            return degree
    degree = LARGEST_DEGREE
    while not _is_positive(domain, degree):
        degree += 1
    return degree


def _is_positive(domain: dolfinx.mesh.Mesh, degree: int) -> bool:
    """Whether all weights of a rule are positive; the elastic polynomial needs positive weights."""
    _, weights = basix.make_quadrature(domain.basix_cell(), degree)
    return bool(np.all(weights > 0.0))


def _distortions(domain: dolfinx.mesh.Mesh) -> tuple[Array, Array]:
    """Volume in the reference measure and δ of (1) of each cell that this rank owns."""
    geometry, cell, d = domain.geometry, domain.basix_cell(), domain.topology.dim
    count = domain.topology.index_map(d).size_local
    shape, nodes = cells_of(geometry)
    element = basix.create_element(
        basix.ElementFamily.P, cell, shape.degree, basix.LagrangeVariant(shape.variant)
    )
    points, weights = basix.make_quadrature(cell, LEAST_DEGREE)
    slopes = element.tabulate(1, points)[1:, :, :, 0]
    volume, distortion = np.zeros(count), np.zeros(count)
    for start in range(0, count, CHUNK):
        part = slice(start, min(start + CHUNK, count))
        corners = geometry.x[nodes[part], :d]
        jacobian = np.einsum("cni,jqn->cqij", corners, slopes)
        mean = np.einsum("cqij,q->cij", jacobian, weights / weights.sum())
        relative = np.linalg.solve(mean[:, None], jacobian) - np.eye(d)
        distortion[part] = np.linalg.norm(relative, axis=(2, 3)).max(axis=1, initial=0.0)
        volume[part] = np.abs(np.linalg.det(mean))
    return volume, distortion


VECTORISED = ("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math")
"""Options of the C compiler that let it reorder sums."""

OPTIONS = {"cffi_extra_compile_args": ["-O3", "-g0", *VECTORISED], "timeout": 60}
"""How forms are compiled; the timeout in s is for another process that compiles the same form."""


def compiled_form(form: ufl.Form) -> fem.Form:
    """Compile a form. Collective."""
    return fem.form(form, jit_options=OPTIONS)


def compiled_expression(expression: Any, points: npt.ArrayLike) -> fem.Expression:
    """Compile an expression at points (k, d) of the reference cell. Collective."""
    return fem.Expression(expression, points, jit_options=OPTIONS)
