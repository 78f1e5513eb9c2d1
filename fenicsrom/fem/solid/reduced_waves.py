"""The waves of all nodal diameters at all speeds, from those of a few diameters at a few speeds.

    u = R η + Ψ y + Ψ′ y′,    y′ = e^{ihα} y                                              (1)

is the displacement of a sector as in `fenicsrom.fem.solid.fixed_sector`, in one basis for all
speeds. The shapes W of the cut faces are those of waves with few nodal diameters at the first, the
middle and the last speed. Ψ carries them with clamped faces at the middle speed. R holds normal
modes with clamped faces at the middle speed, and what these waves have besides Ψ. The waves are
sampled without the Coriolis force.
"""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.fem.base.linalg import multiply
from fenicsrom.fem.body.cyclic import IMAGINARY, Complex
from fenicsrom.fem.solid.fixed_sector import clamped_interior
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.fem.solid.wave import one_way, wave
from fenicsrom.notes import Note
from fenicsrom.reduction.basis import extended_space
from fenicsrom.reduction.beam import DenseBody
from fenicsrom.scene import Scene

SPARE = 2
"""Number of waves of each diameter beyond those that are wanted, whose shapes the basis takes."""


def sampled_diameters(sectors: int) -> list[int]:
    """The nodal diameters whose waves give the shapes: 0, 1, 2 and half the number of sectors."""
    half = sectors // 2
    return sorted({0, 1, min(2, half), half})


class ReducedWave(DenseBody):
    """The body of one nodal diameter, with what modes need of a `fenicsrom.fem.solid.wave.Wave`.

    Attributes:
        double: whether the vectors have imaginary parts, and each mode comes twice.
        free: number of unknowns.
        rigid: (free, 0), as something holds the disk.
    """

    def __init__(self, joined: Complex, real: bool, *matrices: Array | None):
        """Make the matrices Pᴴ K P of P (n, n - m) from those of the sector: K, M and G."""
        p = joined.real if real else joined

        def of_wave(matrix: Array) -> Array:
            found = p.conj().T @ matrix @ p
            if real:
                return np.asarray(found)
            return np.kron(found.real, np.eye(2)) + np.kron(found.imag, IMAGINARY)

        self.double, self.stiffness, self.mass, self.gyroscopic = (
            not real,
            *(None if matrix is None else of_wave(matrix) for matrix in matrices),
        )
        self.free = len(self.mass)
        self.rigid = np.zeros((self.free, 0))
        self._factor = scipy.linalg.lu_factor(self.stiffness)

    @property
    def factor(self) -> ReducedWave:
        """The inverse of the stiffness, which `solve` applies."""
        return self

    def solve(self, block: Array) -> Array:
        """The inverse of the stiffness times a block (free, k)."""
        return np.asarray(scipy.linalg.lu_solve(self._factor, block))

    def eigenmodes(self, inverse: object, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (free, count)."""
        squares, modes = scipy.linalg.eigh(
            self.stiffness, self.mass, subset_by_index=(0, count - 1)
        )
        return squares, modes

    def parts(self, z: Complex) -> tuple[Complex, Complex]:
        """z₊ and z₋ as of a `Wave`."""
        return one_way(z, self.double)


class ReducedWaves:
    """A sector that turns at one speed after another, and its waves in the coordinates of (1).

    Attributes:
        sector: the sector.
        diameters: the nodal diameters whose waves give the shapes.
    """

    def __init__(self, sector: Solid, scene: Scene, count: int, speeds: Array):
        """Make the basis. Collective.

        Args:
            sector: the sector at the first speed.
            scene: its scene.
            count: number of the waves of each diameter that are wanted.
            speeds: the speeds, rev/min.

        Raises:
            ConvergenceError: there is no equilibrium.
            AccuracyError: waves were not found.
        """
        assert sector.cut is not None
        self.sector, self._cut, self._modes = sector, sector.cut, count + SPARE
        self.diameters = sampled_diameters(self._cut.sectors)
        middle = float(
            speeds[np.argmin(np.abs(speeds**2 - 0.5 * (speeds[0] ** 2 + speeds[-1] ** 2)))]
        )
        fields = [self._sampled()]
        for speed in (float(speeds[-1]), middle):
            sector.spin(np.pi / 30.0 * speed)
            fields.append(self._sampled())
        self._vectors = self._basis(scene.at_speed(middle), fields)
        self._mass = sector.inner(self._vectors, sector.mass_times(self._vectors))
        self.spin(np.pi / 30.0 * float(speeds[0]))

    def _sampled(self) -> list[tuple[int, Complex]]:
        """The lowest waves (local, k) of each of these diameters at the present speed."""
        found = []
        for h in self.diameters:
            with wave(self.sector, h) as one:
                copies = 2 if one.double else 1
                wanted = min(copies * self._modes, one.free)
                z = one.eigenmodes(one.factor, wanted)[1][:, ::copies]
                found.append((h, copies * self._cut.displacements(h, one.parts(z)[0])))
        return found

    def _basis(self, scene: Scene, sampled: list[list[tuple[int, Complex]]]) -> Array:
        """The columns (local, n) of R, Ψ and Ψ′ at the present speed."""
        cut, sector = self._cut, self.sector
        waves = [wave for speed in sampled for wave in speed]
        shapes = cut.face_shapes(np.concatenate([u for _, u in waves], axis=1))
        interior = clamped_interior(sector, scene)
        faces = cut.lifted(shapes)
        faces -= interior.factor.solve(interior.without_held(sector.stiffness_times(faces)))
        rests = []
        for h, u in waves:
            y = cut.coordinates(shapes, u)
            q = np.concatenate([y, np.exp(1j * h * cut.angle) * y])
            rest = u - faces @ q
            rests += [interior.without_held(part.copy()) for part in (rest.real, rest.imag)]
        wanted = min(self._modes * len(self.diameters), interior.free // 2)
        inside = interior.eigenmodes(interior.factor, wanted)[1]
        inside = extended_space(sector.mass_inner, inside, np.concatenate(rests, axis=1))
        interior.destroy()
        self._shapes = shapes.shape[1]
        return np.concatenate([inside, faces], axis=1)

    def spin(self, omega: float) -> None:
        """Move to the equilibrium at another speed in rad/s; errors as `Solid.spin`. Collective."""
        sector, v = self.sector, self._vectors
        sector.spin(omega)
        self._stiffness = sector.inner(v, sector.stiffness_times(v))
        g = sector.gyroscopic
        self._gyroscopic = None if g is None else sector.inner(v, multiply(g, v))

    @property
    def free(self) -> int:
        """Number of free unknowns of the sector."""
        return self.sector.free

    @property
    def warnings(self) -> list[Note]:
        """The notes on the sector."""
        return self.sector.warnings

    @property
    def equilibrium(self) -> Array:
        """(local,) the displacement of the sector in its equilibrium, m."""
        return self.sector.equilibrium

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) in each column (local, k)."""
        return self.sector.largest(block)

    def _joined(self, h: int) -> Complex:
        """P (n, n - m): q = P (η, y)."""
        n, m = self._vectors.shape[1], self._shapes
        found = np.eye(n, n - m, dtype=complex)
        found[n - m :, n - 2 * m :] = np.exp(1j * h * self._cut.angle) * np.eye(m)
        return found

    def wave(self, h: int) -> nullcontext[ReducedWave]:
        """The body of a nodal diameter at the present speed."""
        matrices = self._stiffness, self._mass, self._gyroscopic
        return nullcontext(ReducedWave(self._joined(h), self._cut.is_real(h), *matrices))

    def displacements(self, h: int, z: Complex) -> Complex:
        """As `CutFaces.displacements`, of vectors (free, k) of a wave."""
        joined = self._joined(h)
        if self._cut.is_real(h):
            return np.asarray(self._vectors @ (joined.real @ z))
        return np.asarray(self._vectors @ (joined.real @ z[::2] - joined.imag @ z[1::2]))
