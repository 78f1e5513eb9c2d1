"""A disk of N reduced sectors as one model in time.

A sector has the coordinates q = (η, y, y′): those of its interior with both cut faces held, and
those of the few shapes in which each face moves. Large motions are those of the blades: the elastic
force has its nonlinear terms in η only. The following face of a sector is the leading face of its
neighbour, so that with z = (η_0, y_0, η_1, y_1, ..)

    q_j = (η_j, y_j, y_{j±1}),    q = P z,    M = Pᵀ diag(M_s, M_s, ..) P.                (1)

Every sector is described in its own frame, turned by j 360°/N about the axis, so that the matrices
of all sectors are equal. Mistuning changes the stiffness of sector j to (1 + δ_j) K_s. Contacts,
loads and probes of a sector are copied to all of them. An engine order k is a pattern that stands
still while the disk turns at Ω. Sector j is ahead of sector 0, and meets it earlier:

    p_j(t) = p(t + j α/Ω),    α = 360°/N.                                                 (2)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from scipy.sparse import csc_array, csr_array, diags_array, kron
from scipy.sparse.linalg import splu

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.kernels.dense import negative_eigenvalues
from fenicsrom.online.model.loads import histories_of
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import ReducedModel, Tangent
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force
from fenicsrom.scene import Load, Scene

ORDERING = "MMD_AT_PLUS_A"
"""SuperLU's order of elimination for a pattern that is symmetric: a third faster than its own."""


class Sector(NamedTuple):
    """A reduced sector.

    Attributes:
        model: the linear model of one sector in the coordinates q.
        interior: the nonlinear terms in η; its force and its stiffness do not count.
        shapes: m, the number of shapes of a cut face, the last 2 m coordinates.
        neighbour: 1 or -1: y′ of sector j is y of sector j + neighbour.
    """

    model: ReducedModel
    interior: ElasticPolynomial
    shapes: int
    neighbour: int

    def joined(self, sectors: int) -> csr_array:
        """P (N n, size) of (1)."""
        n = self.model.size
        own = np.arange(sectors * (n - self.shapes)).reshape(sectors, -1)
        next_ones = np.roll(own[:, own.shape[1] - self.shapes :], -self.neighbour, axis=0)
        places = np.concatenate([own, next_ones], axis=1).ravel()
        return csr_array((np.ones(places.size), (np.arange(places.size), places)))

    def wave_frequencies(self, h: int, sectors: int) -> Array:
        """Natural frequencies of the waves with h nodal diameters, ascending, Hz."""
        n, m = self.model.size, self.shapes
        joined = np.eye(n, n - m, dtype=complex)
        phase = np.exp(2j * np.pi * self.neighbour * h / sectors)
        joined[n - m :, n - 2 * m :] = phase * np.eye(m)
        stiffness, mass = (
            joined.conj().T @ matrix @ joined
            for matrix in (self.model.elastic.stiffness, self.model.mass)
        )
        squares = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
        return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)


@dataclass(eq=False)
class DiskModel(DenseModel):
    """A disk with the operations of a `ReducedModel`; its matrices are sparse.

    Attributes:
        probes: (N d, n) rows that give the displacement of the probe of each sector in its frame.
    """

    _: KW_ONLY
    probes: Array

    def inverse(self, matrix: Any) -> Callable[[Array], Array]:
        """The inverse of a sparse matrix (n, n) times a block; NaN if the matrix is singular."""
        try:
            solve: Callable[[Array], Array] = splu(csc_array(matrix), ORDERING).solve
        except (RuntimeError, ValueError):  # singular, or not finite
            return lambda block: np.full(block.shape, np.nan)
        return solve

    def negative_directions(self, tangent: Tangent) -> int:
        """Number of negative eigenvalues of a stiffness."""
        stiffness: Any = tangent.matrix  # sparse
        return int(negative_eigenvalues(stiffness.toarray()))

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
    to_sectors, every = sector.joined(count), np.ones(count)

    def of_disk(matrix: Array, factors: Array = every) -> csc_array:
        each = kron(diags_array(factors), csr_array(matrix))
        return csc_array(to_sectors.T @ each @ to_sectors)

    def rows_of(rows: Array) -> Array:
        return np.asarray((kron(diags_array(every), csr_array(rows)) @ to_sectors).toarray())

    force = to_sectors.T @ np.tile(model.elastic.force, count)
    stiffness = of_disk(model.elastic.stiffness, 1.0 + mistuning)
    blades = _Blades(sector, 1.0 + mistuning)

    def elastic(q: Array) -> tuple[Array, Any]:
        linear = force + stiffness @ q
        return (linear, stiffness) if blades.linear else blades.added(q, linear, stiffness)

    def energy(q: Array) -> float:
        linear = float((force + 0.5 * (stiffness @ q)) @ q)
        return linear if blades.linear else linear + blades.terms(q)[2]

    points = ContactPoints._make(
        np.concatenate([part] * count) if np.ndim(part) else part for part in model.points
    )
    d, probes = len(model.probe), rows_of(model.probe)
    velocity: dict[str, Any] = {}
    if model.velocity_forces:  # mistuning changes the damping by stiffness only
        damping = 0.5 * (model.velocity_matrix + model.velocity_matrix.T)
        turning = of_disk(model.velocity_matrix - damping)
        velocity["velocity_matrix"] = of_disk(damping, 1.0 + mistuning) + turning
    return DiskModel(
        mass=of_disk(model.mass),
        damping=model.damping,
        elastic=elastic,
        energy=energy,
        loads=rows_of(model.loads.T).T,
        load_histories=histories_of(scene.loads),
        points=points,
        contact_rows=rows_of(model.contact_rows),
        contact_offset=np.tile(model.contact_offset, count),
        probe=probes[:d],
        probe_offset=model.probe_offset,
        **velocity,
        linear=blades.linear,
        gauss_points=1 if blades.linear else 2,
        probes=probes,
    )


class _Blades:
    """The nonlinear terms of the elastic forces of N sectors, in e coordinates η of each."""

    def __init__(self, sector: Sector, factors: Array):
        """Find η of each sector in z; `factors` (N,) are 1 + δ."""
        e = sector.interior.force.size
        none = {"force": np.zeros(e), "stiffness": np.zeros((e, e))}
        self._polynomial = sector.interior._replace(**none)
        own = np.arange(factors.size * (e + sector.shapes)).reshape(factors.size, -1)
        self._places, self._factors = own[:, :e], factors
        self.linear = not sector.interior.cubic.size

    def terms(self, q: Array) -> tuple[Array, Array, float]:
        """Forces (N, e), tangents (N, e, e) and energy at q."""
        eta, energy = q[self._places], 0.0
        forces, tangents = np.empty(eta.shape), np.empty((*eta.shape, eta.shape[1]))
        for x, force, tangent, factor in zip(eta, forces, tangents, self._factors, strict=True):
            energy += factor * elastic_force(self._polynomial, x, force, tangent)
            force *= factor
            tangent *= factor
        return forces, tangents, float(energy)

    def added(self, q: Array, force: Array, stiffness: csc_array) -> tuple[Array, csc_array]:
        """A linear force and its stiffness with these terms at q."""
        forces, tangents, _ = self.terms(q)
        force[self._places] += forces
        rows = np.broadcast_to(self._places[:, :, None], tangents.shape).ravel()
        columns = np.broadcast_to(self._places[:, None, :], tangents.shape).ravel()
        more = csc_array((tangents.ravel(), (rows, columns)), shape=stiffness.shape)
        return force, stiffness + more


def disk_scene(scene: Scene) -> Scene:
    """A scene with [cyclic] with the loads of all sectors, one sector after the other: (2)."""
    cyclic, rotation = scene.cyclic, scene.rotation
    assert cyclic is not None
    step = 2.0 * np.pi / cyclic.sectors
    if rotation is not None:
        along = float(np.dot(cyclic.axis or (1.0,), rotation.axis or (1.0,)))
        step *= float(np.sign(along * rotation.speed_rpm))
    loads: list[Load] = []
    for j in range(cyclic.sectors):
        loads += [load.seen_ahead(j * step) for load in scene.loads]
    return replace(scene, loads=tuple(loads))
