"""The waves of a disk from one of its sectors, at rest or at speed.

About the equilibrium that is alike in all sectors, a wave with h nodal diameters has the matrices
of `fenicsrom.fem.body.cyclic`. A wave with 0 < h < N/2 goes around the disk in both directions. Its
modes without the Coriolis force come in pairs of equal frequency; the real and imaginary parts x of
a wave then move as

    x = Re (z e^{iωt}),    z = z₊ + z₋,    z± = ½ (1 ∓ i J) z,    J x = i x of the wave.       (1)

z₊ turns against the sense in which the sectors are counted, z₋ along it. With the Coriolis force

    (Pᴴ K P + λ Pᴴ G P + λ² Pᴴ M P) z = 0,                                                (2)

and the two have different frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.fem.base.linalg import Factorisation, eigenmodes, multiply
from fenicsrom.fem.body.cyclic import times, wave_matrix
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.reduction.protocols import Inverse

Complex = NDArray[np.complex128]


class Wave:
    """The body of one nodal diameter about the present equilibrium of a sector.

    Its vectors are the masters of `CutFaces.constraint` that this rank owns; real and imaginary
    parts of complex ones follow each other.

    Attributes:
        h: the nodal diameter.
        double: whether the vectors have imaginary parts, and each mode comes twice.
        free, own: number of unknowns, and of those that this rank owns.
    """

    def __init__(self, sector: Solid, h: int):
        """Make the matrices of a wave. Collective.

        Args:
            sector: the sector, in its equilibrium.
            h: nodal diameter, at most half the number of sectors.

        Raises:
            ConvergenceError: the stiffness is singular.
        """
        assert sector.cut is not None
        self.h, self.double, self._comm = h, not sector.cut.is_real(h), sector.comm
        self._constraint = sector.cut.constraint(h)
        self._stiffness, self._mass = (
            wave_matrix(matrix, self._constraint) for matrix in (sector.stiffness, sector.mass)
        )
        self.gyroscopic: PETSc.Mat | None = None
        if sector.gyroscopic is not None:
            self.gyroscopic = wave_matrix(sector.gyroscopic, self._constraint)
        self.factor = Factorisation(self._stiffness, "fenicsrom_wave")
        self.free, self.own = self._stiffness.getSize()[0], self._stiffness.getLocalSize()[0]

    def destroy(self) -> None:
        """Free the matrices and the factor. Collective."""
        self.factor.destroy(matrix=True)
        for matrix in (self._mass, self._constraint, self.gyroscopic):
            if matrix is not None:
                matrix.destroy()

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (own, count)."""
        return eigenmodes(self._stiffness, self._mass, inverse, count, "fenicsrom_wave_modes")

    def stiffness_times(self, block: Array) -> Array:
        """The stiffness times a block (own, k)."""
        return multiply(self._stiffness, block)

    def mass_times(self, block: Array) -> Array:
        """The mass matrix times a block (own, k)."""
        return multiply(self._mass, block)

    def gyroscopic_times(self, block: Array) -> Array:
        """The gyroscopic matrix times a block (own, k)."""
        return multiply(self.gyroscopic, block)

    def inner(self, a: Array, b: Array) -> Array:
        """Inner products aᵀ b (k, l) over all ranks of two blocks."""
        return np.asarray(self._comm.allreduce(a.T @ b))

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b (k, l) over all ranks of two blocks."""
        return self.inner(a, multiply(self._mass, b))

    def parts(self, z: Complex) -> tuple[Complex, Complex]:
        """z₊ and z₋ of (1) of a block (own, k); if the wave stands (h = 0, N/2), z and nothing."""
        if not self.double:
            return z, 0.0 * z
        turned = np.empty_like(z, dtype=complex)
        turned[::2], turned[1::2] = -1j * z[1::2], 1j * z[::2]
        return 0.5 * (z - turned), 0.5 * (z + turned)

    def displacements(self, z: Complex) -> Complex:
        """Complex amplitudes u (local, k) of Re (u e^{iωt}) in the sector, of a block (own, k)."""
        real, imaginary = (
            times(self._constraint, np.ascontiguousarray(part)) for part in (z.real, z.imag)
        )
        found = real + 1j * imaginary
        return np.asarray(found[::2] if self.double else found)


class Disk:
    """All waves of a disk, one after another: a vector has a part (own,) of each of them.

    Attributes:
        sector: the sector, in its equilibrium.
        waves: the waves.
        places: where the part of each wave stands in a vector.
    """

    def __init__(self, sector: Solid, diameters: Sequence[int]):
        """Make the waves with some nodal diameters; errors as `Wave`. Collective."""
        self.sector = sector
        self.diameters = tuple(diameters)
        self._set()

    def _set(self) -> None:
        self.waves = [Wave(self.sector, h) for h in self.diameters]
        ends = np.cumsum([0, *(wave.own for wave in self.waves)])
        self.places = [slice(a, b) for a, b in pairwise(ends)]

    @property
    def free(self) -> int:
        """Global number of unknowns of the smallest wave, in complex numbers."""
        return min(wave.free // (1 + wave.double) for wave in self.waves)

    @property
    def equilibrium(self) -> Array:
        """(local,) displacement of the sector at the present speed, m."""
        return self.sector.equilibrium

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of a node of the sector in each column of (local, k)."""
        return self.sector.largest(block)

    def spin(self, omega: float) -> None:
        """Set another angular velocity (rad/s), and the waves about the equilibrium there.

        Raises:
            ConvergenceError: no equilibrium was found at this speed.
        """
        self.sector.spin(omega)
        self.destroy()
        self._set()

    def destroy(self) -> None:
        """Free the matrices of the waves. Collective."""
        for wave in self.waves:
            wave.destroy()

    def inner(self, a: Array, b: Array) -> Array:
        """Inner products aᵀ b (k, l) over all ranks of two blocks."""
        return self.sector.inner(a, b)

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b (k, l) over all ranks of two blocks."""
        return self.inner(a, self._each("mass_times", b))

    def stiffness_times(self, block: Array) -> Array:
        """The stiffness times a block."""
        return self._each("stiffness_times", block)

    def displacements(self, z: Complex) -> Complex:
        """Complex amplitudes (local, k) in the sector of waves of one nodal diameter each."""
        parts = zip(self.waves, self.places, strict=True)
        return np.asarray(
            sum(wave.displacements(z[place].astype(complex)) for wave, place in parts)
        )

    def _each(self, name: str, block: Array) -> Array:
        parts = zip(self.waves, self.places, strict=True)
        return np.concatenate([getattr(wave, name)(block[place]) for wave, place in parts])
