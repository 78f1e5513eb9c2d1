"""Supports along directions that are not axes, as a projection of the unknowns.

A node that is held along the orthonormal directions n_1, .. has the displacement P u with the
orthogonal projection P = I − Σ n_k n_kᵀ. With the projection P of all nodes, the components of
vectors remain those along the global axes, and forces and matrices become

    P f,    P K P + c (I − P),    P M P.    (1)

Vectors with P u = u are an invariant space of these matrices. The other part of a solution stays
zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from dolfinx import fem
from petsc4py import PETSc

from fenicsrom.arrays import Array


class Held(NamedTuple):
    """The displacements that supports hold, ghosts included.

    Attributes:
        unknowns: (c,) sorted local numbers of the clamped unknowns.
        nodes: (s,) local numbers of the nodes that are also held along slanted directions.
        slanted: (s, d, d) Σ n_k n_kᵀ of these directions, which are orthogonal to the clamped axes.
    """

    unknowns: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32]
    slanted: Array


class Slanted:
    """The projection (1) on a displacement space. Every method is collective.

    Attributes:
        rank: number of directions that are held, over all ranks.
        nodes: (s,) local numbers of the nodes of this rank.
        held: (s, d, d) Σ n_k n_kᵀ of the directions along which they are held.
    """

    def __init__(self, space: fem.FunctionSpace, held: Held):
        """Make the projection of the nodes that this rank owns."""
        index = space.dofmap.index_map
        own = held.nodes < index.size_local
        self.nodes, self.held = held.nodes[own], held.slanted[own]
        d, local = space.dofmap.index_map_bs, index.size_local * space.dofmap.index_map_bs
        self._unknowns = self.nodes[:, None] * d + np.arange(d)
        comm, first = space.mesh.comm, index.local_range[0] * d
        self.rank = round(comm.allreduce(float(np.trace(self.held, axis1=1, axis2=2).sum())))
        rows = np.repeat(self._unknowns[:, :, None], d, axis=2).ravel()
        columns = np.repeat(self._unknowns[:, None, :], d, axis=1).ravel()
        blocks = scipy.sparse.csr_array((self.held.ravel(), (rows, columns)), shape=(local, local))
        matrix: Any = scipy.sparse.eye_array(local, format="csr") - blocks
        size = (local, index.size_global * d)
        starts, columns = (a.astype(PETSc.IntType) for a in (matrix.indptr, matrix.indices + first))
        self._matrix = PETSc.Mat().createAIJ(
            (size, size), csr=(starts, columns, matrix.data), comm=comm
        )
        self._first = first

    def project(self, block: Array) -> None:
        """Replace a block (local,) or (local, k) by its projection."""
        values = block[self._unknowns]
        block[self._unknowns] = values - np.einsum("sij,sj...->si...", self.held, values)

    def project_matrix(self, matrix: PETSc.Mat, diagonal: float) -> None:
        """Replace an assembled matrix by (1), with the same pattern.

        Args:
            matrix: the matrix.
            diagonal: c, relative to the largest entry on the diagonal of the node. Rounding couples
                the two parts by a 1e-16 of this entry.
        """
        product = matrix.ptap(self._matrix)
        entries = np.abs(product.getDiagonal().array_r[self._unknowns]).max(axis=1, initial=0.0)
        product.copy(matrix, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        product.destroy()
        scales = diagonal * np.where(entries > 0.0, entries, 1.0)
        for unknowns, block in zip(self._unknowns, scales[:, None, None] * self.held, strict=True):
            rows = (self._first + unknowns).astype(PETSc.IntType)
            matrix.setValues(rows, rows, block, PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()
