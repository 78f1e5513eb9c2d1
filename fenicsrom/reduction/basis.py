"""Rubin and Craig-Bampton bases, plain and enriched: one labelled basis whose first coordinates are
the contact displacements.

    u = u0 + R q,    R = [R_m, R_s],    B^T R_m = I,    B^T R_s = 0

R_m = G (B^T G)^-1 for both methods: Rubin's Psi^r (B^T Psi^r)^-1 spans the same space together with
Phi, but loses rank as modes are added. Every other vector V, normal mode or derivative, enters as V
- R_m B^T V (eqs. 12 and 13), orthonormalised in the mass inner product against those before it.
What a vector adds is measured against its own size; where that is less than `DEPENDENCE` it is
dropped, and named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError

DEPENDENCE = 1e-7
ORTHOGONALITY = 1e-10


@dataclass(frozen=True, eq=False)
class ReducedBasis:
    """A basis of n vectors, m of them for the contact displacements.

    Attributes:
        method: "rubin" or "craig-bampton".
        vectors: (local, n) R.
        labels: (n,) of the coordinates: static modes first, then normal modes and derivatives.
        masters: m.
        dropped: labels of dependent vectors and what was left of them.
        condition: condition number of R^T M R scaled to unit diagonal.
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
    """Orthonormalise and assemble.

    Args:
        method: name of the method.
        masters: (local, m) R_m.
        rows: (m, local) B^T.
        vectors: (local, k) normal modes and derivatives, in order of importance.
        labels: (k,) their labels.
        inner: mass inner products of two blocks over all ranks.
        total: sums an array over all ranks.

    Returns:
        The basis.

    Raises:
        AccuracyError: the contact displacements of R are not [I, 0], or R_s is not orthonormal, to
            `ORTHOGONALITY`.
    """
    m = masters.shape[1]
    kept: list[Array] = []
    names: list[str] = []
    dropped: dict[str, float] = {}
    for k, label in enumerate(labels):
        v: Array = vectors[:, k] - masters @ total(rows @ vectors[:, k])
        size = float(np.sqrt(inner(vectors[:, k : k + 1], vectors[:, k : k + 1])[0, 0]))
        v /= size if size > 0.0 else 1.0
        for _ in range(2):  # the second pass removes what rounding left
            if kept:
                block = np.array(kept).T
                v = v - block @ inner(block, v[:, None])[:, 0]
        left = float(np.sqrt(inner(v[:, None], v[:, None])[0, 0]))
        if left <= DEPENDENCE:
            dropped[label] = left
            continue
        v /= left
        for _ in range(2):  # rounding grew by 1/left in both properties: restore them in turn
            v -= masters @ total(rows @ v)
            if kept:
                v = v - block @ inner(block, v[:, None])[:, 0]
            v /= np.sqrt(inner(v[:, None], v[:, None])[0, 0])
        kept.append(v)
        names.append(label)
    enrichment = np.array(kept).T if kept else np.zeros((masters.shape[0], 0))
    r = np.ascontiguousarray(np.concatenate([masters, enrichment], axis=1))
    identity = np.abs(total(rows @ r) - np.eye(m, r.shape[1])).max(initial=0.0)
    gram = inner(r, r)
    skew = np.abs(gram[m:, m:] - np.eye(r.shape[1] - m)).max(initial=0.0)
    largest = max(1.0, np.abs(total(np.abs(rows) @ np.abs(r))).max(initial=0.0))
    if identity > ORTHOGONALITY * largest or skew > 100 * ORTHOGONALITY:
        raise AccuracyError(
            f"the {method} basis lost its structure: contact rows off by {identity:.1e}, orthogonality by {skew:.1e}"
        )
    scale = np.sqrt(np.diag(gram))
    condition = float(np.linalg.cond(gram / np.outer(scale, scale)))
    static = [f"{k + 1}S" for k in range(m)]
    return ReducedBasis(method, r, (*static, *names), m, dropped, condition)
