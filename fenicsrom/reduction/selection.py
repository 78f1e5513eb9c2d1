"""Selection of the modes and derivatives that a scene needs: "mmi" and "mmi-nls".

The snapshots U are expressed in the component modes, U = Y Q, by least squares in the mass norm.
Every column of Y is scaled to a largest displacement of one; otherwise the selection would depend
on the scaling of the modes. A normal mode with a small row of Q is left out. A derivative has the
weight

    MMI:      W_ij = max_k |η_i^k|  max_k |η_j^k|     over U_t,    (1)
    MMI-NLS:  W_ij = Σ_k |η_i^k η_j^k|                over [U_st, U_t],    (2)

and is kept if W_ij, relative to the largest weight, exceeds the threshold. Source: Mashayekhi and
Zucca (2024), sec. 2.2; (1) and (2) are eqs. (19) and (20). `fenicsrom.reduction.snapshots` computes
U_t and U_st.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.principal import RANK_TOLERANCE, PrincipalDirections


@dataclass(frozen=True, eq=False)
class Selection:
    """The modes and derivatives that are kept, and the numbers behind the decision.

    Attributes:
        modes: labels of the normal and static modes that are kept.
        derivatives: labels of the derivatives that are kept.
        modal_coordinates: for the label of each mode its largest |Q|, relative to the largest of
            all modes.
        weights: for the label of each candidate derivative its weight W, relative to the largest W.
        principal: the directions along which derivatives are taken instead of those of modes.
    """

    modes: tuple[str, ...]
    derivatives: tuple[str, ...]
    modal_coordinates: dict[str, float]
    weights: dict[str, float]
    principal: PrincipalDirections | None = None


def modal_coordinates(
    vectors: Array, snapshots: Array, inner: Callable[[Array, Array], Array], scale: Array
) -> Array:
    """Express snapshots in the scaled modes, by least squares in the mass norm.

    Args:
        vectors: (local, k) modes Y.
        snapshots: (local, s) snapshots U, m.
        inner: gives the mass inner products of two blocks over all ranks.
        scale: (k,) largest displacement of each mode.

    Returns:
        Coordinates Q (k, s).
    """
    scaled = vectors / scale
    gram, rhs = inner(scaled, scaled), inner(scaled, snapshots)
    # scaled to unit diagonal, so that `RANK_TOLERANCE` has the same meaning for all columns
    size = np.sqrt(np.diag(gram))
    values, axes = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > RANK_TOLERANCE * values[-1]
    axes = axes[:, kept]
    return np.asarray((axes / values[kept]) @ (axes.T @ (rhs / size[:, None])) / size[:, None])


def select(coordinates: Array, labels: Sequence[str], method: str, threshold: float) -> Selection:
    """Select modes and derivatives by the coordinates of the snapshots.

    Static modes are always kept, because the contact displacements are coordinates of the reduced
    model. Without motion, all modes are kept, and no derivative.

    Args:
        coordinates: (k, s) coordinates Q of the scaled modes.
        labels: (k,) labels of the normal modes (V) and static modes (S).
        method: "mmi" or "mmi-nls".
        threshold: a normal mode is kept if its relative coordinate reaches the threshold, a
            derivative if its relative weight exceeds the threshold.

    Returns:
        The selection.
    """
    eta = np.abs(coordinates)
    largest = eta.max(axis=1)
    if not largest.any():
        return Selection(tuple(labels), (), dict.fromkeys(labels, 0.0), {})
    relative = dict(zip(labels, (largest / largest.max()).tolist(), strict=True))
    modes = tuple(label for label in labels if label.endswith("S") or relative[label] >= threshold)
    w = np.outer(largest, largest) if method == "mmi" else eta @ eta.T
    rows = [list(labels).index(label) for label in modes]
    found = w[np.ix_(rows, rows)][np.triu_indices(len(rows))]
    weights = dict(zip(all_pairs(modes), (found / found.max()).tolist(), strict=True))
    kept = tuple(label for label, weight in weights.items() if weight > threshold)
    return Selection(modes, kept, relative, weights)
