"""The waves of a disk from one of its sectors, at rest or at speed.

About the equilibrium that is alike in all sectors, a wave with h nodal diameters has the matrices
of `fenicsrom.fem.body.cyclic`. A wave with 0 < h < N/2 goes around the disk in both directions. Its
modes without the Coriolis force come in pairs of equal frequency; the real and imaginary parts x of
a wave then move as

    x = Re (z e^{iωt}),    z = z₊ + z₋,    z± = ½ (1 ∓ i J) z,    J x = i x of the wave.       (1)

z₊ turns against the sense in which the sectors are counted, z₋ along it. With the Coriolis force

    (Pᴴ K P + λ Pᴴ G P + λ² Pᴴ M P) z = 0,                                                (2)

and the two have different frequencies. The points of contacts between sectors that are closed in
the equilibrium stick: with the springs k and the rows of the sector and of the next one,

    K + B k Bᴴ,    Bᴴ = B_ownᴴ + e^{ih 2π/N} B_aheadᴴ,                                      (3)

takes the place of K. A disk that nothing holds and that turns at the speed Ω moves across its axis
as it likes. In its frame this is

    u = a e^{iΩt}, against the rotation, with K a = −Ω² M a,                                (4)

and a double root, as the disk may also drift. No force joins these motions to others.
"""

from contextlib import closing

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.fem.base.linalg import (
    Factorisation,
    FreeFactorisation,
    eigenmodes,
    hermitian_eigenmodes,
    multiply,
)
from fenicsrom.fem.body.cyclic import Complex, paired, wave_matrix
from fenicsrom.fem.body.elasticity import Joint
from fenicsrom.fem.body.free_bodies import mass_orthonormal
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.reduction.protocols import Inverse


class Wave:
    """The body of one nodal diameter about the present equilibrium of a sector.

    Its vectors are the masters of `CutFaces.constraint` that this rank owns; real and imaginary
    parts of complex ones follow each other.

    Attributes:
        double: whether the vectors have imaginary parts, and each mode comes twice.
        free: number of unknowns.
        rigid: (own, r) mass-orthonormal rigid motions that nothing holds, which are the first
            modes: those of zero frequency, or (4) of a disk that turns.
        inner: inner products over all ranks of two blocks.
    """

    def __init__(self, sector: Solid, h: int, stuck: bool = True):
        """Make the matrices of a wave. Collective.

        Args:
            sector: the sector, in its equilibrium.
            h: nodal diameter, at most half the number of sectors.
            stuck: whether the closed points between sectors stick; else they are open.

        Raises:
            ConvergenceError: the stiffness is singular.
        """
        assert sector.cut is not None
        self.double, self._constraint = not sector.cut.is_real(h), sector.cut.constraint(h)
        springs = _sticking(sector, h, stuck)
        self._stiffness = wave_matrix(sector.stiffness, self._constraint, springs)
        self._mass = wave_matrix(sector.mass, self._constraint)
        self.gyroscopic: PETSc.Mat | None = None
        if sector.gyroscopic is not None:
            self.gyroscopic = wave_matrix(sector.gyroscopic, self._constraint)
        self.free, self.inner = self._stiffness.getSize()[0], sector.inner
        self._drifts = h == 1 and sector.spins
        self.rigid = mass_orthonormal(self, _rigid_masters(sector, h))
        self.factor: Factorisation | FreeFactorisation
        if self.rigid.shape[1] and not self._drifts:
            self.factor = FreeFactorisation(
                self._stiffness, self.rigid, self._mass, "fenicsrom_wave"
            )
        else:
            self.factor = Factorisation(self._stiffness, "fenicsrom_wave")

    def close(self) -> None:
        """Free the matrices and the factor. Collective."""
        self.factor.destroy(matrix=True)
        for matrix in (self._mass, self._constraint, self.gyroscopic):
            if matrix is not None:
                matrix.destroy()

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (own, count)."""
        asked = count if self._drifts else count - self.rigid.shape[1]
        if self.double and self._mass.comm.size == 1 and 0 < asked < self.free // 4:
            squares, modes = hermitian_eigenmodes(self._mass, inverse, asked)
        else:
            squares, modes = eigenmodes(
                self._stiffness, self._mass, inverse, max(asked, 0), "fenicsrom_wave_modes"
            )
        common = self.mass_inner(self.rigid, modes)
        elastic = np.sum(common**2, axis=0) < 0.5
        modes = (modes - self.rigid @ common)[:, elastic]
        own = np.diag(self.inner(self.rigid, self.stiffness_times(self.rigid)))
        squares = np.append(own * self._drifts, squares[elastic])[:count]
        return squares, np.hstack([self.rigid, modes])[:, :count]

    def stiffness_times(self, block: Array) -> Array:
        """The stiffness times a block (own, k)."""
        return multiply(self._stiffness, block)

    def mass_times(self, block: Array) -> Array:
        """The mass matrix times a block (own, k)."""
        return multiply(self._mass, block)

    def gyroscopic_times(self, block: Array) -> Array:
        """The gyroscopic matrix times a block (own, k)."""
        return multiply(self.gyroscopic, block)

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b (k, l) over all ranks of two blocks."""
        return self.inner(a, multiply(self._mass, b))

    def parts(self, z: Complex) -> tuple[Complex, Complex]:
        """z₊ and z₋ of (1) of a block (own, k); if the wave stands (h = 0, N/2), z and nothing."""
        return one_way(z, self.double)


def one_way(z: Complex, double: bool) -> tuple[Complex, Complex]:
    """As `Wave.parts`; `double` says whether the wave goes around."""
    if not double:
        return z, 0.0 * z
    turned = np.empty_like(z, dtype=complex)
    turned[::2], turned[1::2] = -1j * z[1::2], 1j * z[::2]
    return 0.5 * (z - turned), 0.5 * (z + turned)


def _rigid_masters(sector: Solid, h: int) -> Array:
    """The independent rigid motions (own, r) of `Wave.rigid`."""
    cut = sector.cut
    assert cut is not None
    motions = cut.waves_among(h, sector.free_motions)
    if h == 0:
        motions = motions + cut.turning(motions, sector.equilibrium)
    elif sector.spins:
        motions = cut.shifts_among(motions)
    parts = motions if cut.is_real(h) else np.hstack([motions, 1j * motions])
    return cut.masters_of(h, parts)


def _sticking(sector: Solid, h: int, stuck: bool) -> csr_array | None:
    """B k Bᴴ of (3) with the rows of `CutFaces.constraint`; None without contact."""
    if sector.joint is None:
        return None
    assert sector.cut is not None
    lag = np.exp(2j * np.pi * h / sector.cut.sectors)
    rows = sector.joint.rows + (lag - 1.0) * sector.ahead_rows
    rows = rows.real if sector.cut.is_real(h) else paired(rows)
    springs = sector.joint.springs * (stuck | ~np.repeat(sector.between, sector.dimension))
    springs = np.repeat(springs, rows.shape[0] // springs.size)
    return Joint(sector, csr_array(rows), springs, np.zeros(springs.size)).stiffness


def wave(sector: Solid, h: int, stuck: bool = True) -> closing[Wave]:
    """The wave of a sector; its matrices are freed. Arguments and errors as `Wave`."""
    return closing(Wave(sector, h, stuck))
