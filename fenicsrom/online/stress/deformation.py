"""How far a body is deformed locally: the volume ratio and the principal stretches.

The volume ratio is det F of the deformation gradient F = I + ∇u. Where it is not positive, the
material is turned inside out. The St Venant-Kirchhoff law does not resist this: under uniaxial
stress along a stretch s (Poisson's ratio 0), the force on the undeformed area and its slope are

    P = ½ E s (s² − 1),    dP/ds = ½ E (3 s² − 1),    (1)

so that the material softens in compression. The slope vanishes at s = 1/√3, a compression of 42 %,
and the force returns to zero at s = 0, where the material has no volume. The principal stretches
are the square roots of the eigenvalues of FᵀF.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.stress.stress import StressLaw, StressTable


@dataclass(frozen=True, eq=False)
class Deformation:
    """The extremes of the deformation over some points of a body.

    Attributes:
        volume_ratio: smallest det F; in plane stress with the thickness, which is 0 where the law
            gives none.
        position: (d,) its place in the undeformed body, m.
        smallest_stretch: smallest principal stretch, in the plane of a plane body.
        largest_stretch: largest principal stretch.
    """

    volume_ratio: float
    position: Array
    smallest_stretch: float
    largest_stretch: float

    @property
    def is_inverted(self) -> bool:
        """Whether the material is turned inside out somewhere."""
        return self.volume_ratio <= 0.0

    def as_array(self) -> Array:
        """(3 + d,) smallest det F, smallest and largest stretch, place of det F, for archives."""
        stretches = self.volume_ratio, self.smallest_stretch, self.largest_stretch
        return np.array([*stretches, *self.position])

    @classmethod
    def of_array(cls, array: Array) -> Deformation:
        """The extremes of an array of `as_array`."""
        return cls(float(array[0]), array[3:], float(array[1]), float(array[2]))


NOWHERE = Deformation(np.inf, np.zeros(0), np.inf, 0.0)
"""The extremes over no points."""


def deformation(law: StressLaw, position: Array, start: Array, change: Array) -> Deformation:
    """The extremes over points (P,).

    Args:
        law: the law at these points.
        position: (P, d) their places, m.
        start: (P, d, d) displacement gradient of the equilibrium.
        change: (P, d, d) change of the gradient from the equilibrium.
    """
    if not position.shape[0]:
        return NOWHERE
    volume = law.volume_ratio(start, change)
    f = law.deformation_gradient(start, change)
    squares = np.linalg.eigvalsh(np.swapaxes(f, -1, -2) @ f)
    first = int(np.argmin(volume))
    smallest, largest = (float(np.sqrt(max(x, 0.0))) for x in (squares.min(), squares.max()))
    return Deformation(float(volume[first]), position[first], smallest, largest)


def extremes(parts: Sequence[Deformation]) -> Deformation:
    """The extremes over several sets of points."""
    first = min(parts, key=lambda part: part.volume_ratio)
    smallest = min(part.smallest_stretch for part in parts)
    largest = max(part.largest_stretch for part in parts)
    return replace(first, smallest_stretch=smallest, largest_stretch=largest)


def deformation_at(table: StressTable, q: Array) -> Deformation:
    """The extremes at the Gauss points of a table at coordinates q (n,)."""
    change = np.asarray(np.tensordot(q, table.gradients[1:], axes=1), np.float64)
    law = table.law.at(table.material)
    return deformation(law, table.position, table.gradients[0], change)
