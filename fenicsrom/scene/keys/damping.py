"""Viscous damping besides the mass-proportional damping of the material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base.rules import either, integer, list_of, number

MOST_MODES = 1000
_RATIO = number(least=0.0, below=1.0)
_RATIOS = either(_RATIO, list_of(_RATIO, 0, MOST_MODES, distinct=False))


@dataclass(frozen=True, kw_only=True)
class Damping:
    """Viscous damping besides the mass-proportional damping of [material].

    The damping matrix is C = α M + β K + Σ 2 ζ_k ω_k M φ_k φ_kᵀ M, where K is the stiffness at the
    equilibrium and ω_k, φ_k are the normal modes there without contact, mass-normalised.

    Attributes:
        stiffness: factor β.
        ratios: damping ratios ζ_k of the first normal modes, or one ratio for all of them.
        modes: number of modes, if there is one ratio for all.
    """

    stiffness: Annotated[float, number(least=0.0, unit="s")] = 0.0
    ratios: Annotated[float | tuple[float, ...], _RATIOS] = ()
    modes: Annotated[int, integer(1, MOST_MODES)] = 10

    @property
    def modal(self) -> tuple[float, ...]:
        """The damping ratio of each damped mode."""
        if isinstance(self.ratios, tuple):
            return self.ratios
        return (self.ratios,) * self.modes

    @property
    def viscous(self) -> bool:
        """Whether anything is damped."""
        return self.stiffness > 0.0 or any(self.modal)
