"""Rubin and Craig-Bampton bases, plain or enriched with modal derivatives.

The first coordinates of a basis are the contact displacements:

    u = u₀ + R q,    R = [R_m, R_s],    Bᵀ R_m = I,    Bᵀ R_s = 0,    (1)

with R_m = G (Bᵀ G)⁻¹ for both methods. Rubin's Ψʳ (Bᵀ Ψʳ)⁻¹ spans the same space together with Φ,
but loses rank as modes are added. Every other vector v, a normal mode or a derivative, enters as

    v − R_m Bᵀ v,    (2)

orthonormalised in the mass inner product against the vectors before it. What it adds is measured
relative to its own norm; if this is at most `DEPENDENCE`, the vector is dropped and named. Source:
Mashayekhi and Zucca (2024), eqs. (12) and (13).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ErrorKind

DEPENDENCE = 1e-7
"""Norm of the independent part of a vector, relative to the vector, that counts as zero."""

ORTHOGONALITY = 1e-10
"""Largest error of the properties (1), relative to the largest sum behind an entry of Bᵀ R."""


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """A basis of n vectors, the first m for the contact displacements.

    Attributes:
        method: "rubin" or "craig-bampton".
        vectors: (local, n) R.
        labels: (n,) labels of the coordinates: static modes, then normal modes and derivatives.
        masters: m.
        dropped: relative norm of the independent part of each dropped vector, by its label.
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


def build_basis(
    method: str,
    masters: Array,
    rows: Array,
    vectors: Array,
    labels: Sequence[str],
    inner: Callable[[Array, Array], Array],
    total: Callable[[Array], Array],
) -> ReducedBasis:
    """Orthonormalise the vectors and assemble the basis.

    Args:
        method: name of the method.
        masters: (local, m) R_m.
        rows: (m, local) Bᵀ.
        vectors: (local, k) normal modes and derivatives, the most important first.
        labels: (k,) labels of the vectors.
        inner: gives the mass inner products of two blocks over all ranks.
        total: sums an array over all ranks.

    Returns:
        The basis.

    Raises:
        AccuracyError: Bᵀ R is not [I, 0], or R_s is not orthonormal, to `ORTHOGONALITY`.
    """
    kept: list[Array] = []
    names: list[str] = []
    dropped: dict[str, float] = {}
    for k, label in enumerate(labels):
        v, remainder = _orthonormalised(vectors[:, k : k + 1], masters, rows, kept, inner, total)
        if remainder <= DEPENDENCE:
            dropped[label] = remainder
        else:
            kept.append(v)
            names.append(label)
    m = masters.shape[1]
    enrichment = np.array(kept).T if kept else np.zeros((masters.shape[0], 0))
    r = np.ascontiguousarray(np.concatenate([masters, enrichment], axis=1))
    gram = inner(r, r)
    _check(method, m, rows, r, gram, total)
    scale = np.sqrt(np.diag(gram))
    condition = float(np.linalg.cond(gram / np.outer(scale, scale)))
    static = [f"{k + 1}S" for k in range(m)]
    return ReducedBasis(method, r, (*static, *names), m, dropped, condition)


def _orthonormalised(
    vector: Array,
    masters: Array,
    rows: Array,
    kept: list[Array],
    inner: Callable[[Array, Array], Array],
    total: Callable[[Array], Array],
) -> tuple[Array, float]:
    """Apply (2) to a vector (local, 1) and orthonormalise it against those that are kept.

    Returns:
        The vector (local,), and the norm of its independent part relative to the given vector. The
        vector is normalised only if this exceeds `DEPENDENCE`.
    """
    block = np.array(kept).T if kept else np.zeros((0, 0))
    v: Array = vector[:, 0] - masters @ total(rows @ vector[:, 0])
    size = float(np.sqrt(inner(vector, vector)[0, 0]))
    v /= size if size > 0.0 else 1.0
    for _ in range(2):  # the second pass removes the rounding errors of the first
        if kept:
            v = v - block @ inner(block, v[:, None])[:, 0]
    remainder = float(np.sqrt(inner(v[:, None], v[:, None])[0, 0]))
    if remainder <= DEPENDENCE:
        return v, remainder
    v /= remainder
    for _ in range(2):  # rounding grew by 1/remainder in both properties: restore them in turn
        v -= masters @ total(rows @ v)
        if kept:
            v = v - block @ inner(block, v[:, None])[:, 0]
        v /= np.sqrt(inner(v[:, None], v[:, None])[0, 0])
    return v, remainder


def _check(
    method: str, m: int, rows: Array, r: Array, gram: Array, total: Callable[[Array], Array]
) -> None:
    """Check the properties (1) of a basis R (local, n) with the Gram matrix Rᵀ M R (n, n).

    Raises:
        AccuracyError: a property does not hold.
    """
    n = r.shape[1]
    contact_error = np.abs(total(rows @ r) - np.eye(m, n)).max(initial=0.0)
    skewness = np.abs(gram[m:, m:] - np.eye(n - m)).max(initial=0.0)
    largest = max(1.0, np.abs(total(np.abs(rows) @ np.abs(r))).max(initial=0.0))
    if contact_error > ORTHOGONALITY * largest or skewness > 100 * ORTHOGONALITY:
        raise AccuracyError(
            f"the {method} basis is inaccurate: the contact displacements are wrong by "
            f"{contact_error:.1e}, the orthogonality by {skewness:.1e}",
            kind=ErrorKind.BASIS,
        )
