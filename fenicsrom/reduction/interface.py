"""Interface vectors of joints, from the contact forces of the motions themselves.

The most flexible combinations of contact forces describe the open edges of a joint. Its friction
happens in a narrow zone beside them, which such combinations hardly move: with 20 of 50 directions
they miss half of the dissipation, and still give the frequency. So the forces of a motion choose
the combinations W. With the springs k of the closed points and the rest x₀, F₀,

    ΔF = F − F₀ − k (x − x₀),    F − F₀                                                  (1)

are the part of the forces that no spring explains (slip), and all of them (the response of points
that stick). The columns of W are the leading left singular vectors of both histories, each in the
metric k^-½, the first of norm 1 and the second of norm 0.05, times k^½. The motion of a basis with
K_lin⁻¹ B W gives better forces, so the choice is repeated.
"""

from collections.abc import Sequence

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.motion.motion import Motion

VECTORS = 16
"""Number of interface vectors of a basis."""

MORE = 10
"""Number of the next ones, which are candidates of a larger basis."""

PASSES = 4
"""Most motions from which interface vectors are taken."""

SETTLED = 0.02
"""The vectors have settled if the dissipation by friction changes by less from pass to pass."""

STUCK_WEIGHT = 0.05
"""Weight of F − F₀ in (1) relative to ΔF."""

REST = 2e-3
"""ε of the principal derivatives (`reduction.derivatives`): friction has little of the energy."""

DEPENDENT = 1e-7
"""Directions whose singular value, relative to the largest, is smaller: its square is rounding."""

ROUNDED = 1e-12
"""Smaller energies, by the work of the loads, are rounding."""


def interface_vectors(
    springs: Array, closed: Array, at_rest: tuple[Array, Array], motions: Sequence[Motion]
) -> Array:
    """The interface vectors W (m, k) of motions.

    Args:
        springs: (m,) springs of all contact displacements, N/m.
        closed: (m,) those of the points that are closed at rest, else 0, N/m.
        at_rest: contact displacements x₀ (m,) and forces F₀ (m,) at rest, m and N.
        motions: the motions.
    """
    moved, pushed = (
        np.concatenate([getattr(motion, name).reshape(-1, springs.size) for motion in motions])
        - rest
        for name, rest in zip(("displacement", "force"), at_rest, strict=True)
    )
    root, blocks = np.sqrt(springs), list[Array]()
    for weight, part in ((1.0, pushed - closed * moved), (STUCK_WEIGHT, pushed)):
        scaled = part / root
        if (size := np.linalg.norm(scaled)) > 0.0:
            blocks.append(weight * scaled / size)
    if not blocks:
        return np.zeros((springs.size, 0))
    from scipy.linalg import eigh  # slow to import, and reused bases do not need it

    both, last = np.concatenate(blocks), springs.size - 1
    chosen = max(0, last + 1 - VECTORS - MORE), last
    squares, directions = eigh(both.T @ both, subset_by_index=chosen)
    kept = squares > DEPENDENT**2 * squares[-1]
    return np.asarray(root[:, None] * directions[:, kept][:, ::-1])


def dissipated(motion: Motion) -> float:
    """Energy that friction dissipates in a motion, J; rounding, of points that stick, is zero."""
    found = float(motion.friction_dissipation[-1] - motion.friction_dissipation[0])
    return found if found > ROUNDED * np.abs(motion.work).max() else 0.0


def settled(before: float, after: float) -> bool:
    """Whether the dissipation of two motions agrees."""
    return abs(after - before) <= SETTLED * abs(after)
