"""A disk of N reduced sectors as one model in time.

A sector has the coordinates q = (η, y, y′): those of its interior with both cut faces held, and
those of the few shapes in which each face moves. The following face of a sector is the leading face
of its neighbour, so that with z = (η_0, y_0, η_1, y_1, ..)

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
from fenicsrom.scene import Load, Scene


class Sector(NamedTuple):
    """A reduced sector.

    Attributes:
        model: the linear model of one sector in the coordinates q.
        shapes: m, the number of shapes of a cut face, the last 2 m coordinates.
        neighbour: 1 or -1: y′ of sector j is y of sector j + neighbour.
    """

    model: ReducedModel
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
            solve: Callable[[Array], Array] = splu(csc_array(matrix)).solve
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
    d, probes = len(model.probe), rows_of(model.probe)
    velocity = {"velocity_matrix": of_disk(model.velocity_matrix)} if model.velocity_forces else {}
    return DiskModel(
        mass=of_disk(model.mass),
        damping=model.damping,
        elastic=lambda q: (force + stiffness @ q, stiffness),
        energy=lambda q: float((force + 0.5 * (stiffness @ q)) @ q),
        loads=rows_of(model.loads.T).T,
        load_histories=histories_of(scene.loads),
        points=_copied(model.points, count),
        contact_rows=rows_of(model.contact_rows),
        contact_offset=np.tile(model.contact_offset, count),
        probe=probes[:d],
        probe_offset=model.probe_offset,
        **velocity,
        linear=True,
        gauss_points=1,
        probes=probes,
    )


def _copied(points: ContactPoints, count: int) -> ContactPoints:
    """The contact points of all sectors, each in the frame of its sector."""
    return ContactPoints._make(
        np.concatenate([part] * count) if np.ndim(part) else part for part in points
    )


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
