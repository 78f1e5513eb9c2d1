"""A reduced model of a linear superelement: matrices of another program, and a scene.

With the rows R of the interface displacements, the coordinates q and the static loads s0, the
equilibrium is q0 = K^-1 L s0. The model counts its coordinates from there, as every reduced model
does: its elastic force is L s0 + K q, and the interface moves by x0 + R q0 + R q.

A damping matrix of the file that is proportional to the mass becomes the factor α of the model. Any
other damping matrix, with its symmetric and its skew (gyroscopic) part, is a matrix D of forces D
v. To this matrix the table [damping] of the scene adds

    β K + Σ_k 2 ζ_k ω_k (M φ_k) (M φ_k)ᵀ                                              (1)

with the normal modes φ_k of the superelement, as `fenicsrom.reduction.damping` does for a body.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.exchange.abaqus import read_mtx
from fenicsrom.exchange.matrix_set import SYMMETRY, MatrixSet, read_mat, read_npz
from fenicsrom.exchange.nastran import read_dmig
from fenicsrom.exchange.op4 import read_op4
from fenicsrom.formats.collector import reading
from fenicsrom.online.contact.points import ContactPoints, all_points, points_on
from fenicsrom.online.contact.surfaces import frame, surface_normal
from fenicsrom.online.kernels.dense import scaled
from fenicsrom.online.model.loads import of_loads
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.store.archive import SUPERELEMENT, StoredModel
from fenicsrom.online.store.store import provenance
from fenicsrom.scene import Place, Region, Scene
from fenicsrom.scene.reading.superelement import InterfaceNode, SuperelementScene

READERS: Mapping[str, Callable[[Path], MatrixSet]] = {
    ".op4": read_op4,
    ".bdf": read_dmig,
    ".dat": read_dmig,
    ".pch": read_dmig,
    ".dmig": read_dmig,
    ".mtx": read_mtx,
    ".mat": read_mat,
    ".npz": read_npz,
}
"""Readers by the suffix of the file."""

SOFTEST = 1e-12
"""Smallest eigenvalue of a matrix, scaled to a unit diagonal, that is not a rounding error."""

NEAR = 1e-6
"""Distance of a node from the given coordinates, relative to the extent of the nodes."""

PROPORTIONAL = 1e-8
"""Largest part of the damping matrix, relative to it, that may not be proportional to the mass.

Files have ten significant digits or more.
"""


def read_matrices(path: Path) -> MatrixSet:
    """Read the matrices of a superelement; the suffix of the file gives its format.

    Raises:
        SceneError: the file cannot be read, or its format is not known.
    """
    if path.suffix.lower() not in READERS:
        known = ", ".join(READERS)
        raise refuse(path, f"the format of the file is not known: must end in one of {known}")
    with reading(path):
        return READERS[path.suffix.lower()](path)


def superelement_model(matrices: MatrixSet, given: SuperelementScene) -> StoredModel:
    """Make a reduced model.

    Args:
        matrices: the matrices.
        given: the scene and its interface nodes.

    Raises:
        SceneError: the scene names nodes or coordinates that do not exist, or the matrices are not
            those of a body that its supports hold.
    """
    return _Builder(matrices, given).model()


class _Builder:
    """The matrices of the free coordinates, and the interface nodes of a scene."""

    def __init__(self, matrices: MatrixSet, given: SuperelementScene):
        """Find the rows of the nodes, and clamp the supported coordinates."""
        self.scene: Scene = given.scene
        self.nodes = given.nodes
        self.positions = np.array([node.position for node in given.nodes])
        self.matrices = matrices
        n = len(matrices.mass)
        self.d = self.scene.geometry.dimension
        self.offsets = np.array([node.offset or (0.0,) * self.d for node in given.nodes])
        interface = np.eye(n) if matrices.interface is None else matrices.interface
        rows = [self._rows(k, node, interface) for k, node in enumerate(self.nodes)]
        kept = np.ones(n, dtype=bool)
        for k, support in enumerate(self.scene.supports if given.clamped else ()):
            key = f"supports[{k}]"
            if matrices.interface is not None:
                self._fail(key, "not allowed: the file has interface rows, not coordinates")
            for node in self._named(support, key):
                kept &= ~np.any(rows[node] != 0.0, axis=0)
        self.kept = np.flatnonzero(kept)
        self.rows = [block[:, self.kept] for block in rows]
        self.mass, self.stiffness = (
            m[np.ix_(self.kept, self.kept)] for m in (matrices.mass, matrices.stiffness)
        )
        self._require_positive("mass", self.mass, "condense coordinates without mass first")
        self._require_positive("stiffness", self.stiffness, "clamp the body by [[supports]]")

    def model(self) -> StoredModel:
        """The reduced model with its scene."""
        damping, velocity_matrix = self._damping()
        material = replace(self.scene.material, mass_damping=damping)
        scene = replace(self.scene, material=material)
        loads = self._loads()
        steady = loads @ np.array([load.size if load.static else 0.0 for load in scene.loads])
        rest = np.asarray(np.linalg.solve(self.stiffness, steady))
        points, contact_rows, contact_offset = self._contacts()
        seen, key = (scene.probe, "probe") if scene.probe else (scene.contacts[0].place, "contacts")
        probe, probe_offset, _ = self._mean(seen, key)
        none = np.zeros((0, 0))
        elastic = ElasticPolynomial(steady, self.stiffness, none, none)
        model = reduced_model(
            mass=self.mass,
            damping=damping,
            elastic=elastic,
            loads=loads,
            load_histories=of_loads(scene.loads),
            points=points,
            contact_rows=contact_rows,
            contact_offset=contact_offset + contact_rows @ rest,
            probe=probe,
            probe_offset=probe_offset + probe @ rest,
            velocity_matrix=velocity_matrix,
        )
        squares = scipy.linalg.eigh(self.stiffness, self.mass, eigvals_only=True)
        frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
        labels = tuple(f"q{k + 1}" for k in self.kept)
        return StoredModel(
            model, scene, SUPERELEMENT, labels, len(labels), frequencies, provenance()
        )

    def _damping(self) -> tuple[float, Array | None]:
        """The factor α of the file and of the scene, and the matrix (n, n) of other damping.

        Raises:
            SceneError: the damping matrix gives energy to the motion, or there are too many ratios.
        """
        factor, matrix = self._given_damping()
        matrix = matrix + self._table_damping()
        return self.scene.material.mass_damping + factor, matrix if np.any(matrix) else None

    def _given_damping(self) -> tuple[float, Array]:
        """The damping matrix of the file as the factor α, 1/s, and the rest D (n, n), kg/s.

        Raises:
            SceneError: the matrix gives energy to a motion.
        """
        given, mass = np.zeros_like(self.mass), self.mass
        if self.matrices.damping is not None:
            given = self.matrices.damping[np.ix_(self.kept, self.kept)]
        if not np.any(given):
            return 0.0, given
        alpha = float(np.vdot(given, mass) / np.vdot(mass, mass))
        off = float(np.linalg.norm(given - alpha * mass))
        if alpha >= 0.0 and off <= PROPORTIONAL * float(np.linalg.norm(given)):
            return alpha, np.zeros_like(mass)
        rates, vectors = np.linalg.eigh(0.5 * (given + given.T))
        if rates[0] < -SYMMETRY * float(np.max(np.abs(given))):
            self._fail("superelement", "the damping matrix of the file gives energy to the motion")
        dissipative = (vectors * np.maximum(rates, 0.0)) @ vectors.T
        return 0.0, np.asarray(dissipative + 0.5 * (given - given.T))

    def _table_damping(self) -> Array:
        """The matrix (1) (n, n) of the table [damping], kg/s.

        Raises:
            SceneError: there are more damping ratios than modes.
        """
        damping, mass, stiffness = self.scene.damping, self.mass, self.stiffness
        ratios = np.array(damping.modal)
        if ratios.size > len(mass):
            reason = f"{ratios.size} damped modes are too many: there are {len(mass)}"
            self._fail("damping.ratios", reason, ErrorKind.RANGE)
        squares, modes = scipy.linalg.eigh(stiffness, mass)
        rates = 2.0 * ratios * np.sqrt(squares[: ratios.size])
        moved = mass @ modes[:, : ratios.size]
        return np.asarray(damping.stiffness * stiffness + (moved * rates) @ moved.T)

    def _loads(self) -> Array:
        """The vectors (n, k) of unit loads."""
        columns = np.zeros((self.kept.size, len(self.scene.loads)))
        for k, load in enumerate(self.scene.loads):
            assert load.direction is not None
            rows = self._mean(load.place, f"loads[{k}]")[0]
            columns[:, k] = np.array(load.direction) @ rows
            if not np.any(columns[:, k]):
                self._fail(f"loads[{k}].direction", "the place does not move in this direction")
        return columns

    def _contacts(self) -> tuple[ContactPoints, Array, Array]:
        """The contact points, their rows (P d, n) in local frames, and their offsets (P d,)."""
        found: list[ContactPoints] = []
        rows: list[Array] = [np.zeros((0, self.kept.size))]
        offsets: list[Array] = [np.zeros(0)]
        for k, contact in enumerate(self.scene.contacts):
            key = f"contacts[{k}]"
            for block, offset, position, area in self._points(contact.place, key):
                where = f"{self.scene.source}: {key}"
                axes = frame(surface_normal(contact, position, where))
                lengths = 2 if contact.place.at == "nodes" else 0  # the area is a mere number
                one = np.array([area]), position[None, :], axes[None, :]
                found.append(points_on(k, *one, lengths))
                rows.append(axes @ block)
                offsets.append(axes @ offset)
        points = all_points(self.d, found)
        return points, np.concatenate(rows), np.concatenate(offsets)

    def _points(self, place: Place, key: str) -> list[tuple[Array, Array, Array, float]]:
        """Rows, offset, position and area of each point of a contact."""
        if place.at != "nodes":
            return [(*self._mean(place, key), 1.0)]
        return [
            (self.rows[k], self.offsets[k], self.positions[k], self.nodes[k].area)
            for k in self._named(place, key)
        ]

    def _mean(self, place: Place, key: str) -> tuple[Array, Array, Array]:
        """Rows (d, n), offset (d,) and position (d,) of the mean of the nodes of a place.

        With at = "centre" they are those of the node that is nearest to the mean position.

        Raises:
            SceneError: all its nodes are clamped.
        """
        found = self._named(place, key)
        if place.at == "centre":
            positions = self.positions[found]
            away = np.linalg.norm(positions - positions.mean(axis=0), axis=1)
            found = [found[int(np.argmin(away))]]
        rows = np.mean([self.rows[k] for k in found], axis=0)
        if not np.any(rows):
            self._fail(key, "the supports clamp this place, or it has no coordinates")
        return rows, self.offsets[found].mean(axis=0), self.positions[found].mean(axis=0)

    def _named(self, region: Region, key: str) -> list[int]:
        """The numbers of the nodes that a place or support names.

        Raises:
            SceneError: there is no such node.
        """
        if region.group is not None:
            found = [k for k, node in enumerate(self.nodes) if node.name == region.group]
            if not found:
                names = ", ".join(dict.fromkeys(node.name for node in self.nodes))
                self._fail(f"{key}.group", f"no node has the name {region.group!r}; has {names}")
            return found
        wanted = getattr(region, "node", None) or getattr(region, "nearest", None)
        if wanted is None:
            self._fail(key, "must name interface nodes by group, node or nearest")
        distance = np.linalg.norm(self.positions - np.array(wanted), axis=1)
        best = int(np.argmin(distance))
        extent = float(np.max(np.ptp(self.positions, axis=0), initial=0.0))
        if getattr(region, "node", None) and distance[best] > NEAR * max(extent, 1.0):
            at = list(self.nodes[best].position)
            self._fail(f"{key}.node", f"no node is at {list(wanted)}; the nearest is at {at}")
        return [best]

    def _rows(self, number: int, node: InterfaceNode, interface: Array) -> Array:
        """The rows (d, n) that give the displacement of a node.

        Raises:
            SceneError: the file does not have its coordinates.
        """
        key = f"nodes[{number}]"
        rows = np.zeros((self.d, interface.shape[1]))
        if node.grid is not None:
            labels = self.matrices.labels
            if labels is None or self.matrices.interface is not None:
                self._fail(f"{key}.grid", "the file does not name its coordinates by nodes")
            for axis in range(self.d):
                if (node.grid, axis + 1) in labels:
                    rows[axis, labels.index((node.grid, axis + 1))] = 1.0
            if not np.any(rows):
                self._fail(f"{key}.grid", f"the file has no coordinates of the node {node.grid}")
            return rows
        for axis, coordinate in enumerate(node.coordinates or ()):
            if coordinate > len(interface):
                allowed = f"the file has the numbers 1 to {len(interface)}"
                self._fail(f"{key}.coordinates", f"{coordinate}: {allowed}")
            if coordinate > 0:
                rows[axis] = interface[coordinate - 1]
        return rows

    def _require_positive(self, name: str, matrix: Array, hint: str) -> None:
        """Check that a symmetric matrix is positive definite.

        Raises:
            SceneError: the matrix is not positive definite.
        """
        diagonal = np.diag(matrix)
        if diagonal.size and np.all(diagonal > 0.0):
            if np.linalg.eigvalsh(scaled(matrix))[0] > SOFTEST:
                return
        self._fail("superelement", f"the {name} matrix is not positive definite: {hint}")

    def _fail(self, key: str, reason: str, kind: ErrorKind | None = None) -> NoReturn:
        """Raise the error of a key of the scene.

        Raises:
            SceneError: always.
        """
        source = self.scene.source
        kind = kind or (ErrorKind.SUPPORT if key == "superelement" else ErrorKind.PLACE)
        raise refuse(source, reason, kind, key)
