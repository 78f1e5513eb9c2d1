"""Rubin and Craig-Bampton bases, plain or enriched with modal derivatives.

The first coordinates of a basis are the contact displacements:

    u = u₀ + R q,    R = [R_m, R_s],    Bᵀ R_m = I,    Bᵀ R_s = 0,    (1)

with R_m = G (Bᵀ G)⁻¹ for both methods. Together with Φ, Rubin's Ψʳ (Bᵀ Ψʳ)⁻¹ spans the same space,
but it loses rank as modes are added. Every other vector v, a normal mode or a derivative, enters as

    v − R_m Bᵀ v,    (2)

orthonormalised in the mass inner product against the vectors before it. If the norm of the
remaining part, relative to that of the vector (2), is at most `DEPENDENCE`, the vector is dropped
and named. Source: Mashayekhi and Zucca (2024), eqs. (12) and (13).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.kernels.symmetric import scaled_condition
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.reduction.modes import ComponentModes
    from fenicsrom.reduction.protocols import Structure

DEPENDENCE = 1e-7
"""A vector is dropped if the relative norm of its independent part is at most this."""

KEPT = 0.5
"""A vector of norm 1 is a rounding error if orthogonalising it once more leaves at most this."""

WELL_DEFINED = 1e-3
"""Smallest independent part of a vector, relative to its norm, that a Cholesky factor resolves.

The factor is accurate to 1e-16 of the square of the norm, so the part has six digits.
"""

ORTHOGONALITY = 1e-10
"""Largest error of the properties (1), relative to the largest sum of terms |b r| in Bᵀ R."""


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class ReducedBasis:
    """A basis of n vectors, the first m for the contact displacements.

    Attributes:
        method: "rubin" or "craig-bampton".
        vectors: (local, n) R.
        labels: (n,) labels of the coordinates: static modes, then normal modes and derivatives.
        masters: m.
        dropped: for the label of each dropped vector, the relative norm of its independent part.
        condition: condition number of Rᵀ M R after scaling to unit diagonal.
    """

    method: str
    vectors: Array
    labels: tuple[str, ...]
    masters: int
    dropped: dict[str, float]
    condition: float

    @property
    def size(self) -> int:
        """Number of coordinates n, masters included."""
        return self.vectors.shape[1]

    def part(self, labels: Sequence[str], mass: Array) -> ReducedBasis:
        """The basis of these vectors, the masters first; `mass` (n, n) is their Rᵀ M R."""
        vectors = self.vectors[:, [self.labels.index(label) for label in labels]]
        return replace(
            self, vectors=vectors, labels=tuple(labels), condition=scaled_condition(mass)
        )


def build_basis(
    structure: Structure,
    modes: ComponentModes,
    vectors: Array,
    labels: Sequence[str],
    dependence: float = DEPENDENCE,
) -> ReducedBasis:
    """Orthonormalise the vectors and assemble the basis.

    Args:
        structure: the structure.
        modes: its component modes, which give the method, R_m and Bᵀ.
        vectors: (local, k) normal modes and derivatives, the most important first.
        labels: (k,) labels of the vectors.
        dependence: a vector is dropped if the relative norm of its independent part is at most
            this.

    Returns:
        The basis.

    Raises:
        AccuracyError: Bᵀ R differs from [I, 0], or R_s is not orthonormal (`ORTHOGONALITY`).
    """
    enrichment, names, dropped = _orthonormalised(structure, modes, vectors, labels, dependence)
    m = modes.masters.shape[1]
    r = np.ascontiguousarray(np.concatenate([modes.masters, enrichment], axis=1))
    gram = structure.mass_inner(r, r)
    _check(structure, modes, r, gram)
    static = [f"{k + 1}S" for k in range(m)]
    return ReducedBasis(modes.method, r, (*static, *names), m, dropped, scaled_condition(gram))


def extended_space(inner: Callable[[Array, Array], Array], space: Array, vectors: Array) -> Array:
    """Extend an M-orthonormal space (local, k) by the vectors that it does not contain yet.

    Args:
        inner: the mass inner products of two blocks.
        space: the space.
        vectors: (local, m).

    Returns:
        (local, k + l) the space, then l ≤ m vectors.
    """
    sizes = np.sqrt(np.diag(inner(vectors, vectors)))
    vectors = vectors[:, sizes > 0.0] / sizes[sizes > 0.0]
    for least in (DEPENDENCE, KEPT):  # the second pass removes the rounding errors of the first
        vectors = vectors - space @ inner(space, vectors)
        values, turn = np.linalg.eigh(inner(vectors, vectors))
        keep = values > least**2
        vectors = vectors @ (turn[:, keep] / np.sqrt(values[keep]))
    return np.concatenate([space, vectors], axis=1)


def _orthonormalised(
    structure: Structure,
    modes: ComponentModes,
    vectors: Array,
    labels: Sequence[str],
    dependence: float,
) -> tuple[Array, list[str], dict[str, float]]:
    """Apply (2) to the vectors, and orthonormalise each vector against the kept ones before it.

    A block of vectors is orthonormalised by the Cholesky factor of its Gram matrix (Cholesky-QR,
    twice), as Gram-Schmidt does vector by vector. The factor loses digits where a vector is nearly
    dependent. The block then ends before this vector, and the next block begins with it.

    Returns:
        The kept vectors (local, k), their labels, and for the label of each other vector the
        relative norm of its independent part.
    """
    inner, total = structure.mass_inner, structure.comm.allreduce
    masters, rows = modes.masters, modes.rows
    kept, dropped = vectors[:, :0], dict[str, float]()
    names: list[str] = []
    sizes = np.sqrt(np.maximum(np.diag(inner(vectors, vectors)), 0.0))
    rest = (vectors - masters @ total(rows @ vectors)) / np.where(sizes > 0.0, sizes, 1.0)
    first = 0
    while first < len(labels):
        for _ in range(2 if names else 0):  # the second pass removes rounding errors of the first
            rest = rest - kept @ inner(kept, rest)
        gram = inner(rest, rest)
        remainder = float(np.sqrt(max(gram[0, 0], 0.0)))
        if remainder <= dependence:
            dropped[labels[first]] = remainder
            first, rest = first + 1, rest[:, 1:]
            continue
        block = _normalised(rest, gram, dependence)
        # the division has amplified rounding errors: restore both properties in turn
        for _ in range(2):
            block = block - masters @ total(rows @ block)
            block = block - kept @ inner(kept, block)
            block = _normalised(block, inner(block, block), dependence)
        kept = np.concatenate([kept, block], axis=1)
        names += labels[first : first + block.shape[1]]
        first, rest = first + block.shape[1], rest[:, block.shape[1] :]
    return kept, names, dropped


def _normalised(block: Array, gram: Array, dependence: float) -> Array:
    """The first vectors of a block (local, k) with Gram matrix (k, k), made orthonormal.

    The first vector is always taken. The next ones are taken as long as their independent part is
    at least `WELL_DEFINED` of their own norm and well above the `dependence`.
    """
    from scipy.linalg import solve_triangular  # slow to import, and reused bases do not need it

    size, taken = gram.shape[0], 1
    least = np.maximum(WELL_DEFINED**2 * np.diag(gram), (dependence / WELL_DEFINED) ** 2)
    lower = np.zeros((size, size))
    lower[0, 0] = np.sqrt(gram[0, 0])
    for k in range(1, size):
        lower[k, :k] = solve_triangular(lower[:k, :k], gram[:k, k], lower=True)
        square = gram[k, k] - float(lower[k, :k] @ lower[k, :k])
        if not square >= least[k]:
            break
        lower[k, k] = np.sqrt(square)
        taken = k + 1
    inverse = solve_triangular(lower[:taken, :taken], np.eye(taken), lower=True)
    return np.asarray(block[:, :taken] @ inverse.T)


def _check(structure: Structure, modes: ComponentModes, r: Array, gram: Array) -> None:
    """Check the properties (1) of a basis R (local, n) with the Gram matrix Rᵀ M R (n, n).

    Raises:
        AccuracyError: a property does not hold.
    """
    total, rows, m, n = structure.comm.allreduce, modes.rows, modes.rows.shape[0], r.shape[1]
    contact_error = np.abs(total(rows @ r) - np.eye(m, n)).max(initial=0.0)
    skewness = np.abs(gram[m:, m:] - np.eye(n - m)).max(initial=0.0)
    largest = max(1.0, np.abs(total(np.abs(rows) @ np.abs(r))).max(initial=0.0))
    if contact_error > ORTHOGONALITY * largest or skewness > 100 * ORTHOGONALITY:
        raise AccuracyError(
            f"the {modes.method} basis is inaccurate: the contact displacements are wrong by "
            f"{contact_error:.1e}, the orthogonality by {skewness:.1e}",
            kind=ErrorKind.BASIS,
        )
