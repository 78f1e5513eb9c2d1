"""Matrices of inertia forces, from the mass matrix of one displacement component.

The density is the same in all directions, so that every matrix of inertia forces is a Kronecker
product of the mass matrix m of one component with a small matrix A between the components,

    m ⊗ A,    m_kl = ∫ ρ φ_k φ_l + δ_kl m_k,    (1)

with concentrated masses m_k, and with A = I for the mass matrix. `fem.body.rotation` has others.
The pattern of (1) is part of that of a stiffness matrix, which couples all components of two nodes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.base.linalg import add_to_diagonal


class Inertia:
    """The matrix m of (1), and the matrices that follow from it.

    Attributes:
        form: the form of m.
    """

    def __init__(self, body: Any):
        """Assemble m of a `fenicsrom.fem.body.elasticity.ElasticBody`, without point masses."""
        space = body.space
        # the nodes of this space and of the displacement space have the same numbers
        scalar = fem.functionspace(space.mesh, space.ufl_element().sub_elements[0])
        trial, test = ufl.TrialFunction(scalar), ufl.TestFunction(scalar)
        self.form = compiled_form(body.density * (trial * test) * body.dx)
        matrix = assemble_matrix(self.form)
        matrix.assemble()
        starts, columns, values = matrix.getValuesCSR()
        size = matrix.getLocalSize()[0], matrix.getSize()[1]
        self._nodes = scipy.sparse.csr_array((values, columns, starts), shape=size)
        matrix.destroy()
        self._comm, self._clamped, self._slanted = body.comm, body.clamped, body.slanted

    def add_point_masses(self, masses: Array) -> None:
        """Add concentrated masses (nodes,) of the nodes of this rank to m, kg."""
        first = self._comm.exscan(masses.size) or 0
        places = np.arange(masses.size)
        self._nodes = self._nodes + scipy.sparse.csr_array(
            (masses, (places, first + places)), self._nodes.shape
        )

    def matrix(self, between: Array, diagonal: float = 0.0) -> PETSc.Mat:
        """The matrix (1), without the part that the supports hold.

        Args:
            between: (d, d) A.
            diagonal: what stands on the diagonal of the clamped rows; of nodes that are held along
                a direction, see `Slanted.project_matrix`.

        Returns:
            kg, if A has no unit.
        """
        # slanted supports couple all components of a node
        entries = between != 0.0 if self._slanted is None else np.ones_like(between)
        rows, columns = np.nonzero(entries)
        block = scipy.sparse.coo_array((between[rows, columns], (rows, columns)), between.shape)
        product = scipy.sparse.kron(self._nodes, block, format="csr")
        if self._slanted is None:
            product.eliminate_zeros()
        local, size = product.shape
        starts, columns = (a.astype(PETSc.IntType) for a in (product.indptr, product.indices))
        found = PETSc.Mat().createAIJ(
            ((local, size), (local, size)), csr=(starts, columns, product.data), comm=self._comm
        )
        free = found.createVecLeft()
        free.set(1.0)
        free.array[self._clamped] = 0.0
        found.diagonalScale(free, free)
        free.destroy()
        added = np.zeros(local)
        added[self._clamped] = diagonal
        add_to_diagonal(found, added)
        if self._slanted is not None:
            self._slanted.project_matrix(found, diagonal)
        return found
