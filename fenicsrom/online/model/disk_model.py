"""A disk of N reduced sectors as one model in time.

A sector has the coordinates q = (η, y, y′): those of its interior with both cut faces held, and
those of the few shapes in which each face moves. Large motions are those of the blades: the elastic
force has its nonlinear terms in η only. The following face of a sector is the leading face of its
neighbour, so that with z = (η_0, y_0, η_1, y_1, ..)

    q_j = (η_j, y_j, y_{j±1}),    q = P z,    M = Pᵀ diag(M_s, M_s, ..) P.                (1)

Every sector is described in its own frame, turned by j 360°/N about the axis, so that the matrices
of all sectors are equal. Mistuning changes the stiffness of sector j to (1 + δ_j) K_s. Contacts,
loads and probes of a sector are copied to all of them. A contact between sectors has the
displacements x_j = B_own q_j + B_ahead q_{j+1}. An engine order k is a pattern that stands
still while the disk turns at Ω. Sector j is ahead of sector 0, and meets it earlier:

    p_j(t) = p(t + j α/Ω),    α = 360°/N.                                                 (2)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.kernels.dense import negative_eigenvalues
from fenicsrom.online.model.cyclic_matrix import CyclicMatrix
from fenicsrom.online.model.kept_factor import KeptFactor
from fenicsrom.online.model.loads import histories_of
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import ElasticPolynomial, pair_numbers, pairs
from fenicsrom.scene import Load, Scene
from fenicsrom.scene.keys.rotation import Deviation

Complex = NDArray[np.complex128]

CONTRACTION = 0.1
"""Of the iteration with a kept factor. A factorisation takes as long as four iterations."""


class Sector(NamedTuple):
    """A reduced sector.

    Attributes:
        model: the linear model of one sector in the coordinates q.
        interior: the nonlinear terms in η; its force and its stiffness do not count.
        shapes: m, the number of shapes of a cut face, the last 2 m coordinates.
        neighbour: 1 or -1: y′ of sector j is y of sector j + neighbour.
        ahead: (m, n) the part of the contact rows of `model` by which sector j + 1 moves.
        springs: (m,) those of the contact points that stick in the equilibrium, else 0, N/m.
    """

    model: ReducedModel
    interior: ElasticPolynomial
    shapes: int
    neighbour: int
    ahead: Array
    springs: Array

    def of_disk(self, sectors: int, blocks: Array) -> CyclicMatrix:
        """Pᵀ diag(A_0, A_1, ..) P of (1), of matrices (N or 1, n, n) of the sectors."""
        return CyclicMatrix(sectors, blocks, self.shapes, self.neighbour)

    def in_waves(self, angles: Array) -> tuple[Complex, Complex]:
        """The coordinates and the contact displacements of a sector in waves.

        Args:
            angles: (k,) by which the next sector is ahead, rad.

        Returns:
            Rows (k, n, n - m) of q, and rows (k, m_c, n - m) of the m_c contact displacements, by
            the coordinates (η, y).
        """
        n, m = self.model.size, self.shapes
        angles = angles[:, None, None]
        joined = np.tile(np.eye(n, n - m, dtype=complex), (len(angles), 1, 1))
        joined[:, n - m :, n - 2 * m :] = np.exp(1j * self.neighbour * angles) * np.eye(m)
        rows = self.model.contact_rows + (np.exp(1j * angles) - 1.0) * self.ahead
        return joined, rows @ joined

    def wave_frequencies(self, h: int, sectors: int) -> Array:
        """Natural frequencies of the waves with h nodal diameters, ascending, Hz."""
        (joined,), (rows,) = self.in_waves(np.array([2.0 * np.pi * h / sectors]))
        stiffness, mass = (
            joined.conj().T @ matrix @ joined
            for matrix in (self.model.elastic.stiffness, self.model.mass)
        )
        stiffness = stiffness + rows.conj().T @ (self.springs[:, None] * rows)
        squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
        return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)

    def wave_damping(self, angles: Array, ratios: tuple[float, ...]) -> list[Complex]:
        """Columns U (n - m, r) of the modal damping of waves, by the coordinates (η, y).

        The modes φ of the r lowest families of a wave, without contact, have the damping ratios ζ:

            U Uᴴ = Σ 2 ζ ω (M φ) (M φ)ᴴ.                                                  (3)

        Args:
            angles: (k,) by which the next sector is ahead, rad.
            ratios: ζ of each family.
        """
        found, whole, last = [], (self.model.mass, self.model.elastic.stiffness), len(ratios) - 1
        for joined in self.in_waves(angles)[0]:
            p = np.real_if_close(joined)  # of waves that stand
            mass, stiffness = (p.conj().T @ matrix @ p for matrix in whole)
            squares, modes = scipy.linalg.eigh(stiffness, mass, subset_by_index=[0, last])
            sizes = np.sqrt(2.0 * np.array(ratios) * np.sqrt(np.abs(squares)))
            found.append(mass @ modes * sizes)
        return found

    def disk_damping(self, sectors: int, ratios: tuple[float, ...]) -> Array:
        """Real columns U (size, N r) of the modal damping U Uᵀ of all waves of a tuned disk."""
        found, step = [], 2.0 * np.pi / sectors
        angles: Array = step * np.arange(sectors // 2 + 1, dtype=np.float64)
        for angle, columns in zip(angles, self.wave_damping(angles, ratios), strict=True):
            lags = np.exp(1j * angle * np.arange(sectors)) / np.sqrt(sectors)
            waves = (lags[:, None, None] * columns).reshape(-1, len(ratios))
            both = [np.sqrt(2.0) * waves.real, np.sqrt(2.0) * waves.imag]
            found += both if np.iscomplexobj(columns) else [waves.real]
        return np.concatenate(found, axis=1)


@dataclass(eq=False)
class DiskModel(DenseModel):
    """A disk with the operations of a `ReducedModel`; its matrices are a `CyclicMatrix`.

    Attributes:
        probes: (N d, n) rows that give the displacement of the probe of each sector in its frame.
        forces: the elastic forces.
    """

    _: KW_ONLY
    probes: Array
    forces: _Forces

    def __post_init__(self) -> None:
        """Begin without a factor; a contact row reaches few coordinates."""
        super().__post_init__()
        self._rows = csr_array(self.contact_rows)
        self.exact_newton = self.linear
        self._kept = KeptFactor(self.dot, CONTRACTION)

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Any]:
        """Mean force over a step, and its `Slope` by dq."""
        if not self.linear:
            self._kept.note(q0, dq)
        force, slope = self.forces.mean(q0, dq, points, weights)
        return start_weight * start + force, slope

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy."""
        return self.forces.at(q)

    def keeps_factor(self, mass_coefficient: float) -> bool:
        """In a time step, S of an earlier state serves as long as few iterations need it."""
        return self.linear or (mass_coefficient > 0.0 and not self._kept.needs_factor)

    def inverse(self, matrix: Any) -> Callable[[Array], Array]:
        """The inverse of a `CyclicMatrix` times a block (n, k); NaN if the matrix is singular."""
        self._kept.renew()
        solve: Callable[[Array], Array] = matrix.inverse()
        return solve

    def negative_directions(self, tangent: Any) -> int:
        """Number of negative eigenvalues of a stiffness."""
        return int(negative_eigenvalues(tangent.matrix.toarray()))

    def sector_coordinates(self, coordinates: Array) -> Array:
        """Coordinates q (N, k, n) of the sectors, for coordinates (k, size) of the disk."""
        mass: Any = self.mass  # a CyclicMatrix
        return np.asarray(mass.of_sectors(coordinates.T).transpose(0, 2, 1))

    def displacements(self, coordinates: Array) -> Array:
        """Displacements (k, N, d) of the probes in the frames of their sectors, m."""
        moved = coordinates @ self.probes.T
        return moved.reshape(len(moved), -1, len(self.probe_offset)) + self.probe_offset


def disk_model(sector: Sector, scene: Scene, mistuning: Array) -> DiskModel:
    """The disk of a sector.

    Args:
        sector: the sector.
        scene: the scene with the loads of all sectors, as `disk_scene` gives it.
        mistuning: (N,) relative changes δ of the stiffness of the sectors.
    """
    model, count = sector.model, mistuning.size
    factors = 1.0 + (mistuning if mistuning.any() else mistuning[:1])[:, None, None]
    mass = sector.of_disk(count, model.mass[None])
    forces = _Forces(sector, count, factors)

    def rows_of(rows: Array, ahead: int = 0) -> Array:
        of_all, every = np.zeros((count, model.size, count, len(rows))), np.arange(count)
        of_all[(every + ahead) % count, :, every] = rows.T
        return mass.summed(of_all.reshape(count, model.size, -1)).T

    points = ContactPoints._make(
        np.concatenate([part] * count) if np.ndim(part) else part for part in model.points
    )
    d, probes = len(model.probe), rows_of(model.probe)
    velocity: Any = np.zeros((0, 0))
    ratios = scene.damping.modal
    if model.velocity_forces or any(ratios):  # mistuning changes the damping by stiffness only
        given = model.velocity_matrix if model.velocity_forces else 0.0 * model.mass
        damping = 0.5 * (given + given.T)
        velocity = sector.of_disk(count, factors * damping + (given - damping))
    if any(ratios):
        velocity = replace(velocity, columns=sector.disk_damping(count, ratios), weight=1.0)
    return DiskModel(
        mass=mass,  # type: ignore[arg-type]
        damping=model.damping,
        elastic=forces.with_tangent,
        energy=lambda q: forces.at(q)[1],
        forces=forces,
        loads=rows_of(model.loads.T).T,
        load_histories=histories_of(scene.loads),
        points=points,
        contact_rows=rows_of(model.contact_rows - sector.ahead) + rows_of(sector.ahead, 1),
        contact_offset=np.tile(model.contact_offset, count),
        probe=probes[:d],
        probe_offset=model.probe_offset,
        velocity_matrix=velocity,
        linear=forces.linear,
        gauss_points=1 if forces.linear else 2,
        probes=probes,
    )


class Slope(NamedTuple):
    """The derivative of the mean elastic force of a step by dq, as a `Tangent`.

    Attributes:
        make: gives the `CyclicMatrix`, which an iteration with a kept factor does not need.
        coefficient: as in `Tangent`.
    """

    make: Callable[[], CyclicMatrix]
    coefficient: float

    @property
    def matrix(self) -> CyclicMatrix:
        """The matrix, N/m."""
        return self.make()


class _Forces:
    """The elastic forces of N sectors, whose nonlinear terms are those of e coordinates η of each.

    a and b are those of `fenicsrom.online.model.polynomial`, of all sectors at once.

    Attributes:
        linear: there are no such terms.
    """

    def __init__(self, sector: Sector, sectors: int, factors: Array):
        """Take 1 + δ of the sectors (N or 1, 1, 1)."""
        elastic, interior = sector.model.elastic, sector.interior
        self._stiffness = sector.of_disk(sectors, factors * elastic.stiffness)
        every = np.broadcast_to(elastic.force, (sectors, sector.model.size))
        self._force = self._stiffness.summed(every)
        self._interior, e = interior, interior.force.size
        self._pairs, self._numbers = pairs(e), pair_numbers(e)
        self._factors = np.broadcast_to(factors[:, 0], (sectors, 1))
        self._copies = sectors // len(factors)
        self.linear = not interior.cubic.size

    def _inside(self, q: Array) -> Array:
        """η (N, e) in the coordinates of the disk, or of a force on them."""
        return q.reshape(len(self._factors), -1)[:, : self._interior.force.size]

    def mean(self, q0: Array, dq: Array, points: Array, weights: Array) -> tuple[Array, Slope]:
        """Mean force along a step, and its derivative by dq.

        The arguments are those of `DenseModel.elastic_over_step`.
        """
        moved = float(points @ weights)
        force = weights.sum() * self._force
        force += self._stiffness @ (weights.sum() * q0 + moved * dq)
        if self.linear:
            return force, Slope(lambda: moved * self._stiffness, moved)
        eta = self._inside(q0) + points[:, None, None] * self._inside(dq)
        a, b, _ = self._terms(eta)
        pulls = (weights[:, None, None] * (a / 2.0 + b / 3.0)).take(self._numbers, -1)
        self._inside(force)[:] += self._factors * (pulls @ eta[..., None])[..., 0].sum(0)

        def tangent() -> CyclicMatrix:
            whole = moved * self._stiffness
            blocks, e = np.repeat(whole.blocks, self._copies, axis=0), eta.shape[2]
            slopes = self._factors * np.tensordot(weights * points, a + b, 1)
            blocks[:, :e, :e] += slopes.take(self._numbers, -1)
            return replace(whole, blocks=blocks)

        return force, Slope(tangent, moved)

    def with_tangent(self, q: Array) -> tuple[Array, Any]:
        """Force and tangent at q."""
        force, slope = self.mean(q, 0.0 * q, np.ones(1), np.ones(1))
        return force, slope.matrix

    def at(self, q: Array) -> tuple[Array, float]:
        """Force and energy at q."""
        pull = self._stiffness @ q
        force, energy = self._force + pull, float((self._force + 0.5 * pull) @ q)
        if not self.linear:
            eta = self._inside(q)
            a, b, products = self._terms(eta)
            pulls = (a / 2.0 + b / 3.0).take(self._numbers, -1)
            self._inside(force)[:] += self._factors * (pulls @ eta[..., None])[..., 0]
            twice = np.where(self._pairs[0] == self._pairs[1], 1.0, 2.0)
            energy += float(np.sum(self._factors * twice * products * (a / 6.0 + b / 12.0)))
        return force, energy

    def _terms(self, eta: Array) -> tuple[Array, Array, Array]:
        """a, b and the products (.., pairs) at η (.., N, e)."""
        first, second = self._pairs
        products = eta[..., first] * eta[..., second]
        return eta @ self._interior.quadratic.T, products @ self._interior.cubic.T, products


def deviations(scene: Scene) -> Array:
    """The relative changes (N,) of the stiffness of the sectors."""
    assert scene.cyclic is not None
    given, count = scene.cyclic.mistuning, scene.cyclic.sectors
    if isinstance(given, Deviation):
        return given.deviation * np.random.default_rng(given.seed).standard_normal(count)
    return np.zeros(count) if given is None else np.array(given)


def require_families(sector: Sector, scene: Scene) -> None:
    """Check that a sector has the families of waves that `damping.ratios` damp.

    Raises:
        SceneError: it has fewer.
    """
    ratios, families = len(scene.damping.modal), sector.model.size - sector.shapes
    if ratios > families:
        reason = f"{ratios} damped families of waves are too many: the reduced sector has "
        reason += f"{families} coordinates; lower damping.modes, or raise basis.modes"
        raise refuse(scene.source, reason, ErrorKind.RANGE, "damping.ratios")


def load_diameters(scene: Scene) -> set[int]:
    """The nodal diameters of the waves that the loads excite in a tuned disk."""
    assert scene.cyclic is not None
    n = scene.cyclic.sectors
    return {min(load.order % n, -load.order % n) for load in scene.loads}


def disk_scene(scene: Scene) -> Scene:
    """A scene with [cyclic] with the loads of all sectors, one sector after the other: (2)."""
    assert scene.cyclic is not None
    loads: list[Load] = []
    for j in range(scene.cyclic.sectors):
        loads += [load.seen_ahead(j * _angle(scene)) for load in scene.loads]
    return replace(scene, loads=tuple(loads))


def _angle(scene: Scene) -> float:
    """The angle by which the next sector is ahead along the rotation, rad."""
    cyclic, rotation = scene.cyclic, scene.rotation
    assert cyclic is not None
    step = 2.0 * np.pi / cyclic.sectors
    if rotation is None:
        return step
    along = float(np.dot(cyclic.axis or (1.0,), rotation.axis or (1.0,)))
    return step * float(np.sign(along * rotation.speed_rpm))


def order_of(scene: Scene) -> int:
    """The engine order whose frequency is that of the period of the loads; 0 without one."""
    return math.gcd(*(load.order for load in scene.loads if not load.static))


def lag_of(scene: Scene) -> float:
    """The phase by which the loads of the next sector are ahead, rad of the period of the loads."""
    return order_of(scene) * _angle(scene)


def wave_of(scene: Scene) -> tuple[int, str]:
    """Nodal diameters of the wave of a tuned disk, and its way in the frame that turns.

    The way is "forward", with the rotation, "backward", or "" of a wave that stands.
    """
    assert scene.cyclic is not None
    n, h = scene.cyclic.sectors, order_of(scene) % scene.cyclic.sectors
    if 2 * h in (0, n):
        return h, ""
    return (h, "backward") if 2 * h < n else (n - h, "forward")
