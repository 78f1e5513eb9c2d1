"""Modal derivatives along the principal directions of a motion.

The derivative θ(x, y) = −K⁻¹ K′[x] y (`fenicsrom.reduction.derivatives`) is bilinear, so it need
not be taken along pairs of modes. Snapshots of the motion in the modes, u = Y η(t), are

    u(t) = Σ_k p_k a_k(t),    p_kᵀ K p_l = δ_kl,    Σ_t a_k a_l = 0 for k ≠ l,    (1)

with the largest amplitudes first: the singular value decomposition of the snapshots in the energy
norm. Directions are kept until the rest has at most ε² of the elastic energy. Their number depends
on the motion, not on the number of modes or of contact points. The derivatives

    rms(a_k a_l) θ(p_k, p_l),  k < l,    and    ½ rms(a_k²) θ(p_k, p_k)    (2)

are what each pair adds to the displacement. On a slender body nearly all of them are the same few
fields along its axis. So they are combined: the eigenvectors of the Gram matrix of (2) in the
energy norm, outside of the linear vectors of the basis, are kept until the rest has at most ε² of
the elastic energy of the snapshots. None is kept where the motion is small.
"""

from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Structure

RANK_TOLERANCE = 1e-12
"""Smaller eigenvalues of a Gram matrix, relative to the largest, count as zero."""

REST = 1e-2
"""ε: the rest of the motion in the energy norm, relative to the motion."""

NEGLIGIBLE = 1e-4
"""A pair with a smaller rms(a_k a_l), relative to the largest, is not solved for."""

LEAST_ENERGY = 1e-10
"""A combination is left out if its energy, relative to the largest, is smaller: rounding."""


@dataclass(frozen=True, eq=False)
class PrincipalDirections:
    """The principal directions (1) of the snapshots of a motion.

    Attributes:
        vectors: (local, r) p_k.
        amplitudes: (r, s) a_k of each snapshot, sqrt(J).
        energy: mean of uᵀ K u over all snapshots, J.
    """

    vectors: Array
    amplitudes: Array
    energy: float

    @property
    def labels(self) -> tuple[str, ...]:
        """(r,) labels of the directions: 1P, 2P, ..."""
        return tuple(f"{k + 1}P" for k in range(self.vectors.shape[1]))

    def weights(self) -> dict[str, float]:
        """The factor (2) of each derivative, by its label such as 1P2P, where it counts."""
        squares = self.amplitudes**2
        found = np.sqrt(squares @ squares.T / squares.shape[1])
        least = NEGLIGIBLE * found.max(initial=0.0)
        first, second = np.nonzero(np.triu(found > least))
        return {
            self.labels[k] + self.labels[m]: float(found[k, m]) * (0.5 if k == m else 1.0)
            for k, m in zip(first, second, strict=True)
        }


def principal_directions(
    structure: Structure, vectors: Array, coordinates: Array
) -> PrincipalDirections:
    """Compute the principal directions (1) of snapshots u = Y η.

    Args:
        structure: the structure.
        vectors: (local, k) Y; they may depend on one another.
        coordinates: (k, s) η.
    """
    stiffness = structure.inner(vectors, structure.stiffness_times(vectors))
    size = np.sqrt(np.abs(np.diag(stiffness)))
    values, axes = np.linalg.eigh(stiffness / np.outer(size, size))
    kept = values > RANK_TOLERANCE * values[-1]
    root, axes = np.sqrt(values[kept]), axes[:, kept]
    left, sizes, right = np.linalg.svd(
        root[:, None] * (axes.T @ (size[:, None] * coordinates)), full_matrices=False
    )
    count = enough(sizes**2, REST**2 * float(np.sum(sizes**2)))
    directions = (axes / root / size[:, None]) @ left[:, :count]
    return PrincipalDirections(
        vectors @ directions,
        sizes[:count, None] * right[:count],
        float(np.sum(sizes**2)) / coordinates.shape[1],
    )


def enough(energies: Array, rest: float) -> int:
    """How many of the energies (k,), the largest first, leave at most this rest."""
    left = np.append(np.cumsum(energies[::-1])[::-1], 0.0)
    return int(np.argmax(left <= rest))


def combinations(
    structure: Structure, modes: ComponentModes, basis: ReducedBasis, vectors: Array
) -> tuple[Array, Array]:
    """Combine vectors by their elastic energy outside of a basis.

    Args:
        structure: the structure.
        modes: the component modes of the basis.
        basis: the basis.
        vectors: (local, k) vectors, each with its weight.

    Returns:
        The combinations (local, c), the largest energy first, and their energies (c,).
    """
    inner = basis.vectors[:, basis.masters :]
    rest = vectors - modes.masters @ structure.comm.allreduce(modes.rows @ vectors)
    for _ in range(2):  # the second pass removes rounding errors of the first
        rest = rest - inner @ structure.mass_inner(inner, rest)
    gram = structure.inner(rest, structure.stiffness_times(rest))
    values, axes = np.linalg.eigh(0.5 * (gram + gram.T))
    kept = values > LEAST_ENERGY * np.max(values, initial=0.0)
    return np.asarray(rest @ axes[:, kept][:, ::-1]), values[kept][::-1]
