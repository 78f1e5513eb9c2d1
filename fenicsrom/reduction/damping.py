"""Viscous damping besides the mass-proportional one: stiffness-proportional and modal.

    C = α M + β K + Σ_k 2 ζ_k ω_k (M φ_k) (M φ_k)ᵀ                                       (1)

K is the stiffness at the equilibrium, and ω_k, φ_k are the frequencies and the mass-normalised
normal modes there, without contact (Craig and Kurdila, Fundamentals of Structural Dynamics, 2006,
section 10.3). A mode φ_k then has the damping ratio ζ_k + α/(2 ω_k) + β ω_k/2. The last two terms
of (1) depend on the body only and not on the basis: the full model and all reduced models have the
same damping.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Damping

UNDAMPED = Damping()


class ViscousDamping:
    """The last two terms of (1) for a structure.

    Attributes:
        stiffness: β, s.
        modal: (local, k) vectors sqrt(2 ζ_k ω_k) M φ_k.
    """

    def __init__(self, structure: Structure, damping: Damping):
        """Compute the damped modes.

        Args:
            structure: the structure in its equilibrium.
            damping: the table [damping] of its scene.

        Raises:
            SceneError: there are more damping ratios than modes.
        """
        self._structure = structure
        self.stiffness = damping.stiffness
        self.modal = np.zeros((structure.local, 0))
        ratios = np.array(damping.modal)
        if not np.any(ratios):
            return
        if ratios.size >= structure.free:
            raise SceneError(
                f"{structure.source}: damping.ratios: {ratios.size} damped modes are too many: the "
                f"body has {structure.free} unknowns",
                kind=ErrorKind.RANGE,
                key="damping.ratios",
                source=structure.source,
            )
        squares, modes = structure.eigenmodes(structure.factor, ratios.size)
        sizes = np.sqrt(2.0 * ratios * np.sqrt(squares))
        self.modal = structure.mass_times(modes[:, ratios > 0.0]) * sizes[ratios > 0.0]

    def times(self, block: Array) -> Array:
        """Give the damping matrix without α M, times a block (local, k)."""
        found = self.modal @ self._structure.inner(self.modal, block)
        if self.stiffness > 0.0:
            found += self.stiffness * self._structure.stiffness_times(block)
        return np.asarray(found)


def viscous_damping(structure: Structure, damping: Damping) -> ViscousDamping | None:
    """The viscous damping of a structure; None without any; errors as `ViscousDamping`."""
    if damping.stiffness == 0.0 and not any(damping.modal):
        return None
    return ViscousDamping(structure, damping)
