"""How well the modes of a reduced model agree with those of the full model.

Both sets are free vibrations about the equilibrium without contact, damping and Coriolis forces.
The modal assurance criterion (Allemang and Brown 1982) of a full mode φᵢ and a reduced mode ψⱼ is

    MACᵢⱼ = (φᵢᵀ M ψⱼ)² / ((φᵢᵀ M φᵢ) (ψⱼᵀ M ψⱼ)).    (1)

It is 1 for the same shape and 0 for shapes without a common part. With the mass matrix M as the
weight it does not depend on the density of the nodes, and its sum over all reduced modes is the
part of the kinetic energy of φᵢ that the basis can represent.
"""

from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.protocols import Structure

MOST_COMPARED = 12
"""Largest number of modes of the full model that are compared."""


@dataclass(frozen=True, eq=False)
class ModeAgreement:
    """Modes of the full and of the reduced model.

    Attributes:
        full_hz: (k,) the lowest natural frequencies of the full model, Hz.
        reduced_hz: (size,) all natural frequencies of the reduced model, Hz.
        mac: (k, size) modal assurance criterion (1).
    """

    full_hz: Array
    reduced_hz: Array
    mac: Array

    @property
    def partners(self) -> list[int]:
        """The reduced mode that is most similar to each full mode."""
        return [int(j) for j in np.argmax(self.mac, axis=1)]

    @property
    def represented(self) -> Array:
        """(k,) part of the kinetic energy of each full mode that the basis can represent."""
        return np.asarray(self.mac.sum(axis=1))


def mode_agreement(structure: Structure, vectors: Array) -> ModeAgreement:
    """Compare the modes of a reduced basis with those of its structure. Collective.

    As many modes as the basis has vectors are compared, at most `MOST_COMPARED`.

    Args:
        structure: the structure.
        vectors: (local, size) vectors of the basis.

    Raises:
        ConvergenceError: the eigensolver did not find all modes of the structure.
        AccuracyError: a mode failed its residual check.
    """
    import scipy.linalg  # slow to import, and runs of stored models compare no modes

    size = vectors.shape[1]
    squares, full = structure.eigenmodes(structure.factor, min(size, MOST_COMPARED))
    stiffness = structure.inner(vectors, structure.stiffness_times(vectors))
    both = (0.5 * (a + a.T) for a in (stiffness, structure.mass_inner(vectors, vectors)))
    reduced_squares, shapes = scipy.linalg.eigh(*both)
    products = structure.mass_inner(full, vectors) @ shapes
    sizes = np.diag(structure.mass_inner(full, full))
    mac = products**2 / sizes[:, None]  # eigh gives ψᵀ M ψ = 1
    full_hz, reduced_hz = (
        np.sqrt(np.maximum(found, 0.0)) / (2.0 * np.pi) for found in (squares, reduced_squares)
    )
    return ModeAgreement(full_hz, reduced_hz, mac)
