"""Which modes and derivatives a scene needs: all, MMI, MMI-NLS (the paper, sec. 2.2).

A geometrically linear transient with friction gives deflections U_t over one period; nonlinear
statics under the force that would deflect the linear structure as far (eq. 18), at several levels,
give U_st. The snapshots are expressed in the modes, U = Y Q by least squares in the mass norm,
every column of Y scaled to unit largest displacement (else the choice would depend on how modes are
scaled). Modes with small rows of Q are left out; a derivative is weighed by

    MMI:      W_ij = max_k |eta_i^k|  max_k |eta_j^k|     over U_t             (eq. 19)
    MMI-NLS:  W_ij = sum_k |eta_i^k eta_j^k|              over [U_st, U_t]     (eq. 20)

and kept where W_ij, relative to the largest, exceeds the threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.reduction.derivatives import all_pairs

STATIC_LEVELS = 10


@dataclass(frozen=True, eq=False)
class Selection:
    """What was kept, and the numbers behind it.

    Attributes:
        modes: labels of the normal and static modes kept.
        derivatives: labels of the derivatives kept.
        participation: label of every mode -> largest |Q| in its row, relative to the largest of
        all.
        weights: label of every derivative weighed -> its W relative to the largest.
    """

    modes: tuple[str, ...]
    derivatives: tuple[str, ...]
    modal_coordinates: dict[str, float]
    weights: dict[str, float]


def modal_coordinates(
    vectors: Array, snapshots: Array, inner: Callable[[Array, Array], Array], scale: Array
) -> Array:
    """Coordinates Q (k, snapshots) of the snapshots in the scaled vectors, by least squares in the
    mass norm.

    Args:
        vectors: (local, k) Y.
        snapshots: (local, s) U.
        inner: mass inner products of two blocks over all ranks.
        scale: (k,) largest displacement of each column of Y.
    """
    scaled = vectors / scale
    gram, rhs = inner(scaled, scaled), inner(scaled, snapshots)
    # scaled to unit diagonal, so that the cut of the pseudo-inverse means the same for every column
    size = np.sqrt(np.diag(gram))
    values, axes = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > 1e-12 * values[-1]
    axes = axes[:, kept]
    return np.asarray((axes / values[kept]) @ (axes.T @ (rhs / size[:, None])) / size[:, None])


def select(coordinates: Array, labels: Sequence[str], method: str, threshold: float) -> Selection:
    """Choose modes and derivatives from the coordinates of the snapshots.

    Args:
        coordinates: (k, snapshots) Q of the scaled modes.
        labels: (k,) of the modes: normal modes (V) and static modes (S).
        method: "mmi" or "mmi-nls": how derivatives are weighed.
        threshold: smallest relative weight kept, and smallest relative participation of a normal
            mode kept.

    Returns:
        The selection; static modes are always kept: the contact displacements are coordinates of
        the model.
    """
    eta = np.abs(coordinates)
    largest = eta.max(axis=1)
    share = dict(zip(labels, (largest / largest.max()).tolist(), strict=True))
    modes = tuple(label for label in labels if label.endswith("S") or share[label] >= threshold)
    w = np.outer(largest, largest) if method == "mmi" else eta @ eta.T
    position = {label: k for k, label in enumerate(labels)}
    weights = {}
    for k, first in enumerate(modes):
        for second in modes[k:]:
            weights[first + second] = float(w[position[first], position[second]])
    top = max(weights.values())
    weights = {label: weight / top for label, weight in weights.items()}
    kept = tuple(label for label in all_pairs(modes) if weights[label] > threshold)
    return Selection(modes, kept, share, weights)
