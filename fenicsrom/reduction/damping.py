"""Viscous damping besides the mass-proportional one: stiffness-proportional, modal, and dashpots.

    C = α M + β K_ε + Σ_k 2 ζ_k ω_k (M φ_k) (M φ_k)ᵀ + D                                 (1)

K_ε is the part of the stiffness at the equilibrium that comes from strains and springs. A material
whose stress grows by β times the rate of stress has the damping β K_ε (Kelvin and Voigt). Stresses
at the equilibrium, bolts, pressures that follow and rotation change the stiffness K, but dissipate
nothing: with them β K would give energy to a body that is pressed and held by contact only.

ω_k and φ_k are the frequencies and the mass-normalised normal modes at the equilibrium (Craig and
Kurdila, Fundamentals of Structural Dynamics, 2006, section 10.3); D is the matrix of the dashpots.
Without dashpots and static loads a mode φ_k has the damping ratio ζ_k + α/(2 ω_k) + β ω_k/2. The
last three terms of (1) depend on the body only and not on the basis: the full model and all reduced
models have the same damping.
"""

import numpy as np
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.reduction.protocols import Structure
from fenicsrom.scene import Damping


class ViscousDamping:
    """The last three terms of (1) for a structure.

    Attributes:
        acts: whether there is any such damping.
        stiffness: β, s.
        modal: (local, k) vectors sqrt(2 ζ_k ω_k) M φ_k.
        modes: (local, k) sqrt(2 ζ_k ω_k) φ_k.
        dashpots: sparse (local, size) D, N s/m; None without.
    """

    def __init__(self, structure: Structure, damping: Damping, dashpots: csr_array | None = None):
        """Compute the damped modes.

        Args:
            structure: the structure in its equilibrium.
            damping: the table [damping] of its scene.
            dashpots: sparse (local, size) D, N s/m; by default there are none.

        Raises:
            SceneError: there are more damping ratios than modes.
        """
        self._structure, self.stiffness = structure, damping.stiffness
        drags = structure.comm.allreduce(0 if dashpots is None else dashpots.nnz)
        self.dashpots = dashpots if drags else None
        self.acts = bool(damping.viscous or drags)
        self.modal, self.modes = np.zeros((2, structure.local, 0))
        ratios = np.array(damping.modal)
        if not np.any(ratios):
            return
        if ratios.size >= structure.free:
            reason = f"{ratios.size} damped modes are too many: the body has {structure.free} "
            raise refuse(structure.source, f"{reason}unknowns", ErrorKind.RANGE, "damping.ratios")
        self.damp(ratios, *structure.eigenmodes(structure.factor, ratios.size))

    def damp(self, ratios: Array, squares: Array, modes: Array) -> None:
        """Damp modes (local, k) by ratios ζ (k,), which are the only ones; ω² are squares (k,)."""
        # above a critical speed some of the squares are negative
        sizes = np.sqrt(2.0 * ratios * np.sqrt(np.abs(squares)))
        self.modes = modes[:, ratios > 0.0] * sizes[ratios > 0.0]
        self.modal = self._structure.mass_times(self.modes)
        self.acts = True

    def times(self, block: Array) -> Array:
        """Give the damping matrix without α M, times a block (local, k)."""
        found = self.modal @ self._structure.inner(self.modal, block)
        if self.dashpots is not None:
            found += self._structure.coupled(self.dashpots, block)
        if self.stiffness > 0.0:
            found += self.stiffness * self._structure.strain_stiffness_times(block)
        return np.asarray(found)
