"""Static modal derivatives: how a component mode changes along another mode, without inertia.

    θ_ij = −K⁻¹ (K′[X_j] X_i)    (1)

K′[x] is the derivative of the tangent stiffness along x, at the equilibrium. Source: Mashayekhi and
Zucca (2024), eqs. (14) to (17); for the method see Weeger, Wever and Simeon, Int. J. Numer. Methods
Eng. 108, 2016, and Wu, Tiso, Tatsis, Chatzi and van Keulen, Multibody Syst. Dyn. 45, 2019.

Modal derivatives along the principal directions of a motion.

The derivative θ(x, y) = −K⁻¹ K′[x] y is bilinear, so it need
not be taken along pairs of modes. Snapshots of the motion in the modes, u = Y η(t), are

    u(t) = Σ_k p_k a_k(t),    p_kᵀ K p_l = δ_kl,    Σ_t a_k a_l = 0 for k ≠ l,    (2)

with the largest amplitudes first: the singular value decomposition of the snapshots in the energy
norm. Directions are kept until the rest has at most ε² of the elastic energy. Their number depends
on the motion, not on the number of modes or of contact points. The derivatives

    rms(a_k a_l) θ(p_k, p_l),  k < l,    and    ½ rms(a_k²) θ(p_k, p_k)    (3)

are what each pair adds to the displacement. On a slender body nearly all of them are the same few
fields along its axis. So they are combined: the eigenvectors of the Gram matrix of (3) in the
energy norm, outside of the linear vectors of the basis, are kept until the rest has at most ε² of
the elastic energy of the snapshots. None is kept where the motion is small.

Selection of the modes and derivatives that a scene needs: "mmi" and "mmi-nls".

The snapshots U are expressed in the component modes, U = Y Q, by least squares in the mass norm.
Every column of Y is scaled to a largest displacement of one; otherwise the selection would depend
on the scaling of the modes. A normal mode with a small row of Q is left out. A derivative has the
weight

    MMI:      W_ij = max_k |η_i^k|  max_k |η_j^k|     over U_t,    (4)
    MMI-NLS:  W_ij = Σ_k |η_i^k η_j^k|                over [U_st, U_t],    (5)

and is kept if W_ij, relative to the largest weight, exceeds the threshold. Source: Mashayekhi and
Zucca (2024), sec. 2.2; (4) and (5) are eqs. (19) and (20). `fenicsrom.reduction.snapshots` computes
U_t and U_st.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.progress import tracked
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.modes import ComponentModes
from fenicsrom.reduction.protocols import Inverse, Structure

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
    """The principal directions (2) of the snapshots of a motion.

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
        """The factor (3) of each derivative, by its label such as 1P2P, where it counts."""
        squares = self.amplitudes**2
        found = np.sqrt(squares @ squares.T / squares.shape[1])
        least = NEGLIGIBLE * found.max(initial=0.0)
        first, second = np.nonzero(np.triu(found > least))
        return {
            self.labels[k] + self.labels[m]: float(found[k, m]) * (0.5 if k == m else 1.0)
            for k, m in zip(first, second, strict=True)
        }


def principal_directions(
    structure: Structure, vectors: Array, coordinates: Array, rest: float = REST
) -> PrincipalDirections:
    """Compute the principal directions (2) of snapshots u = Y η.

    Args:
        structure: the structure.
        vectors: (local, k) Y; they may depend on one another.
        coordinates: (k, s) η.
        rest: ε.
    """
    stiffness = structure.inner(vectors, structure.held_times(vectors))
    size = np.sqrt(np.abs(np.diag(stiffness)))
    values, axes = np.linalg.eigh(stiffness / np.outer(size, size))
    kept = values > RANK_TOLERANCE * values[-1]
    root, axes = np.sqrt(values[kept]), axes[:, kept]
    left, sizes, right = np.linalg.svd(
        root[:, None] * (axes.T @ (size[:, None] * coordinates)), full_matrices=False
    )
    count = enough(sizes**2, rest**2 * float(np.sum(sizes**2)))
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
    gram = structure.inner(rest, structure.held_times(rest))
    values, axes = np.linalg.eigh(0.5 * (gram + gram.T))
    kept = values > LEAST_ENERGY * np.max(values, initial=0.0)
    return np.asarray(rest @ axes[:, kept][:, ::-1]), values[kept][::-1]


def all_pairs(labels: Sequence[str]) -> list[str]:
    """The labels of all derivatives of some modes, each pair once: 1V1V, 1V2V, 1V1S, ..."""
    return [first + second for k, first in enumerate(labels) for second in labels[k:]]


def split(label: str) -> tuple[str, str]:
    """Split the label of a derivative into its two directions: 1V2S gives 1V and 2S.

    Raises:
        ValueError: the text is not the label of a derivative.
    """
    match = re.fullmatch(r"(\d+[VSPL])(\d+[VSPL])", label)
    if match is None:
        raise ValueError(f"{label!r} is not the label of a modal derivative, such as 1V1V or 1V2S")
    return match.group(1), match.group(2)


def modal_derivatives(
    vectors: Array,
    labels: Sequence[str],
    wanted: Sequence[str],
    derivative: Callable[[Array, Array], Array],
    inverse: Inverse,
) -> Array:
    """Compute modal derivatives by (1), with one block solve.

    Args:
        vectors: (local, k) component modes X.
        labels: (k,) labels of the modes.
        wanted: (w,) labels of the derivatives.
        derivative: gives K′[x] y (local,) for two vectors (local,).
        inverse: K⁻¹, or the inverse with the contact displacements held at zero.

    Returns:
        (local, w) derivatives, in the unit of X_i X_j per metre.
    """
    column = {label: k for k, label in enumerate(labels)}
    rhs = np.zeros((vectors.shape[0], len(wanted)))
    for k, label in enumerate(tracked(wanted)):
        i, j = (column[part] for part in split(label))
        rhs[:, k] = derivative(vectors[:, j], vectors[:, i])
    return -inverse.solve(rhs) if len(wanted) else rhs


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
