"""The 1D beam of a scene as a structure, with dense matrices.

`BeamStructure` is a `fenicsrom.reduction.protocols.Structure`, so the reduction treats the beam as
it treats the solid.
"""

from collections.abc import Iterable
from typing import Any, NoReturn

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.notes import Note
from fenicsrom.online.contact.points import ContactPoints, no_points
from fenicsrom.online.contact.surfaces import frame
from fenicsrom.online.model.dense_model import DenseModel
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.model.pressure import PressurePolynomial, no_pressure
from fenicsrom.online.model.support_motion import histories_of
from fenicsrom.online.step.newton import Correction, newton, small_against_load
from fenicsrom.reduction.damping import ViscousDamping
from fenicsrom.reduction.projection import projected_terms
from fenicsrom.reduction.protocols import Inverse
from fenicsrom.reduction.timoshenko import UNKNOWNS, TimoshenkoBeam
from fenicsrom.scene import Load, Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.keys.excitation import highest_frequency

STATIC_ITERATIONS = 50
"""Largest number of Newton iterations of an equilibrium."""

LARGEST_TURN = 1e-3
"""Rotation, in rad, of the central difference of the tangent."""


class SerialCommunicator:
    """The communicator of a structure that every rank holds completely."""

    rank, size = 0, 1

    def allreduce(self, value: Any) -> Any:
        """The value itself, because there is one rank."""
        return value

    def bcast(self, value: Any) -> Any:
        """The value itself."""
        return value


class Cholesky:
    """The inverse of a dense positive definite matrix (n, n), factorised once."""

    def __init__(self, matrix: Array):
        """Factorise the matrix."""
        self._factor = scipy.linalg.cho_factor(matrix)

    def solve(self, block: Array) -> Array:
        """The inverse times the columns of a block (n, k)."""
        return np.asarray(scipy.linalg.cho_solve(self._factor, block))


class DenseBody:
    """A body with dense matrices (n, n).

    Attributes:
        mass: M.
        stiffness: K.
        gyroscopic: G; None without the Coriolis force.
    """

    mass: Array
    stiffness: Array
    gyroscopic: Array | None = None

    def inner(self, a: Array, b: Array) -> Array:
        """Inner products aᵀ b (k, l) of two blocks (n, k) and (n, l)."""
        return a.T @ b

    def mass_times(self, block: Array) -> Array:
        """M times a block (n, k)."""
        return self.mass @ block

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b (k, l) of two blocks (n, k) and (n, l)."""
        return a.T @ (self.mass @ b)

    def stiffness_times(self, block: Array) -> Array:
        """K times a block (n, k)."""
        return self.stiffness @ block

    def gyroscopic_times(self, block: Array) -> Array:
        """G times a block (n, k), where the Coriolis force acts."""
        assert self.gyroscopic is not None
        return self.gyroscopic @ block


class BeamStructure(DenseBody):
    """The 1D beam as a `fenicsrom.reduction.protocols.Structure`.

    The equilibrium is the undeformed beam. The elastic force is not a polynomial; five Gauss points
    integrate it along a time step to round-off.
    """

    gauss_points = 5
    comm = SerialCommunicator()

    def __init__(self, beam: TimoshenkoBeam, scene: Scene):
        """Find where loads and contacts act, and factorise the stiffness."""
        self.beam, self.source = beam, scene.source
        self.mass_damping, self.excitation = scene.material.mass_damping, highest_frequency(scene)
        self.geometrically_nonlinear = not beam.linear
        self.mass, self.stiffness = beam.mass, beam.stiffness
        self.size = self.local = self.free = beam.mass.shape[0]
        self.dimension = d = scene.geometry.dimension
        self.probe_rows = self._rows(beam.tip_node)
        loads = [self._load_vector(load) for load in scene.loads]
        self.load_vectors: Array = np.array(loads).reshape(-1, self.size).T
        self.load_histories = histories_of(scene.loads)
        frames = [frame(np.array(contact.normal)) for contact in scene.contacts]
        rows: Array = np.zeros((0, self.size))
        self.points = no_points(d)
        if frames:
            position = np.zeros((1, d))
            position[0, 0] = beam.length
            number = np.zeros(1, dtype=np.int64)
            self.points = ContactPoints(number, np.ones(1), position, np.array(frames))
            rows = np.concatenate([axes @ self.probe_rows for axes in frames])
        self.contact_rows = csr_array(rows)
        self.equilibrium: Array = np.zeros(self.size)
        self.rest_force = self.equilibrium
        self.factor = Cholesky(beam.stiffness)
        self.warnings: list[Note] = []
        self.viscous = ViscousDamping(self, scene.damping)

    def _rows(self, node: int) -> Array:
        """(d, n) displacement of a node."""
        found = np.zeros((self.dimension, self.size))
        for component in range(2):
            found[component, self.beam.unknown(node, component)] = 1.0
        return found

    def _load_vector(self, load: Load) -> Array:
        """The load vector (n,) of a load of size 1."""
        direction = np.array(load.direction)
        if not load.everywhere:
            return direction @ self._rows(self.beam.load_node)
        found = self.beam.translated @ direction[:2]
        return np.asarray(-found if load.moves_supports else found)

    def full_model(self) -> DenseModel:
        """The full model for the time integration."""
        linear = self.beam.linear
        terms = projected_terms(self, np.eye(self.size)) | {"loads": self.load_vectors}
        return DenseModel(
            elastic=self.beam.elastic,
            energy=self.beam.energy,
            linear=linear,
            gauss_points=1 if linear else self.gauss_points,
            **terms,
        )

    def internal_force(self, u: Array) -> Array:
        """Elastic force (n,) at the unknowns u (n,)."""
        return self.beam.elastic(u)[0]

    def tangent_times(self, u: Array, block: Array) -> Array:
        """Tangent at the unknowns u (n,) times a block (n, k)."""
        return self.beam.elastic(u)[1] @ block

    def energy(self, u: Array) -> float:
        """Elastic energy at the unknowns u (n,), J."""
        return self.beam.energy(u)

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K′[x] y (n,) by central differences of fourth order.

        The step turns no section by more than `LARGEST_TURN`.
        """
        slope = np.max(self.largest(x[:, None])) / self.beam.length
        h = LARGEST_TURN / max(np.max(np.abs(x[2::UNKNOWNS])), slope)

        def change(step: float) -> Array:
            return self.tangent_times(step * x, y) - self.tangent_times(-step * x, y)

        return (8.0 * change(h) - change(2.0 * h)) / (12.0 * h)

    tangent_derivative = tangent_difference
    symmetric = True

    def elastic_polynomial(self, vectors: Array) -> ElasticPolynomial:
        """Refuse: the elastic force of the beam is not a polynomial.

        Raises:
            SceneError: always.
        """
        allowed = 'must be "projection" for the 1D beam, whose elastic force is not a polynomial'
        where = Where(self.source, "basis.elastic_force")
        raise where.refuse("polynomial", allowed, ErrorKind.CONFLICT)

    def pressure_polynomial(self, vectors: Array) -> PressurePolynomial:
        """No pressure: no follower pressure acts on the beam."""
        return no_pressure(vectors.shape[1])

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of each column of a block (n, k), without the rotations."""
        return np.asarray(np.max(np.hypot(block[0::UNKNOWNS], block[1::UNKNOWNS]), axis=0))

    def translations(self) -> Array:
        """(n, 2) unit translations along the axes."""
        return np.tile(np.eye(UNKNOWNS, 2), (self.size // UNKNOWNS, 1))

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The lowest modes, from M φ / ω² = M K⁻¹ M φ.

        Args:
            inverse: K⁻¹, or the inverse with coordinates held at zero.
            count: number of modes.

        Returns:
            ω² (count,), ascending, and mass-normalised modes (n, count).
        """
        lower: Array = np.asarray(np.linalg.cholesky(self.mass))
        compliance = lower.T @ inverse.solve(lower)
        values, vectors = scipy.linalg.eigh(0.5 * (compliance + compliance.T))
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        return 1.0 / values, scipy.linalg.solve_triangular(lower.T, vectors)

    def static(self, load: Array, guess: Array | None = None) -> Array:
        """Nonlinear equilibrium (n,) under a load (n,), by Newton's method from a guess (n,).

        Raises:
            ConvergenceError: the iteration did not converge.
        """
        start = np.zeros(self.size) if guess is None else guess

        def correct(u: Array) -> Correction:
            force, tangent = self.beam.elastic(u)
            change = np.asarray(np.linalg.solve(tangent, load - force))
            return change, abs(float((load - force) @ change))

        def converged(u: Array, decrement: float, first: float, last: float) -> bool:
            return small_against_load(decrement, first, float(load @ u))

        decrements: list[float] = []
        found = newton(start, correct, converged, STATIC_ITERATIONS, decrements=decrements)
        if found is None:
            raise ConvergenceError(
                "static equilibrium of the 1D beam: Newton's method did not converge in "
                f"{STATIC_ITERATIONS} iterations",
                start,
                decrements=decrements,
            )
        return found

    def load_path(self, force: Array, parts: Iterable[float], tolerance: float) -> Array:
        """Equilibria (n, k) under k increasing parts of a force (n,), to the last digits.

        Raises:
            ConvergenceError: an iteration did not converge.
        """
        found: list[Array] = [self.equilibrium]
        for part in parts:
            found.append(self.static(part * force, found[-1]))
        return np.array(found[1:]).T


def beam_model(scene: Scene) -> DenseModel:
    """The full model of the 1D beam of a scene.

    Raises:
        SceneError: the loads or contacts of the scene are not those of a planar beam along x.
    """
    return beam_structure(scene).full_model()


def beam_structure(scene: Scene) -> BeamStructure:
    """Build the planar Timoshenko beam of a scene, in the x-y plane.

    The load acts at the position that the scene gives; contact and probe are at the tip.

    Raises:
        SceneError: the loads or contacts of the scene are not those of a planar beam along x.
    """
    section = scene.reference.beam
    assert section is not None
    beam = TimoshenkoBeam(section, scene.material, not scene.geometrically_nonlinear, scene.source)
    _check_planar(scene)
    return BeamStructure(beam, scene)


def _check_planar(scene: Scene) -> None:
    """Check that the loads and contacts of a scene are those of a planar beam along x.

    Raises:
        SceneError: a load or contact is of another kind.
    """

    def refuse(reason: str) -> NoReturn:
        raise Where(scene.source, "reference.beam").refuse(True, reason, ErrorKind.CONFLICT)

    one_point = "the 1D beam has one contact point, against a plane"
    if len(scene.contacts) > 1:
        refuse(f"the 1D beam has one contact point, but the scene has {len(scene.contacts)}")
    for k, load in enumerate(scene.loads):
        if load.kind != "force" and not load.everywhere:
            kinds = "point forces, accelerations and motions of the supports only"
            refuse(f"the 1D beam takes {kinds}, but loads[{k}] is of kind {load.kind}")
    for contact in scene.contacts:
        if contact.normal is None or contact.place.at == "nodes":
            refuse(one_point)
    vectors = [item.direction for item in scene.loads] + [item.normal for item in scene.contacts]
    for vector in vectors:
        if vector is None:
            refuse(one_point)
        if scene.geometry.dimension == 3 and abs(vector[2]) > 1e-12:
            refuse(f"the 1D beam moves in the x-y plane, but {list(vector)} leaves this plane")
    if any(load.static and load.size for load in scene.loads):
        refuse("the 1D beam starts undeformed; remove the static loads")
