"""The 1D beam of a scene as a structure, with dense matrices.

`BeamStructure` is a `fenicsrom.reduction.protocols.Structure`, so the reduction treats the beam as
it treats the solid.

A geometrically exact planar Timoshenko beam, clamped at x = 0: the 1D reference.

This is Reissner's beam (J. Appl. Math. Phys. 23, 1972) in a total-Lagrangian description, with
elements of two nodes. A section has the displacements u along the beam and w across it, and the
rotation θ. The strains are exact for any displacement and rotation,

    ε = (1 + u′) cos θ + w′ sin θ − 1,    γ = w′ cos θ − (1 + u′) sin θ,    κ = θ′,    (1)

and the elastic energy is

    Π = ½ ∫ (EA ε² + κ_s GA γ² + EI κ²) dx.    (2)

The shape functions are linear, with one integration point per element: this is exact for bending,
and free of the locking of ε and γ under full integration. Linear shape functions leave out the
bending of an element between two nodes that do not rotate. The compliance of this bending is added
to the compliance of shear (MacNeal's residual bending flexibility, Comput. Struct. 8, 1978): with
the length l of an element,

    1 / S = 1 / (κ_s GA) + l² / (12 EI),    (3)

and S replaces κ_s GA. Linear statics is then exact at the nodes for forces and moments at nodes,
for any number of elements. The mass matrix is consistent, integrated exactly, includes rotary
inertia, and is constant.
"""

from collections.abc import Iterable
from typing import Any, NoReturn

import numpy as np
import scipy.linalg
from numba import njit
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.notes import Note
from fenicsrom.online.contact.points import no_points, points_on
from fenicsrom.online.contact.surfaces import frame
from fenicsrom.online.model.bolts import no_bolts
from fenicsrom.online.model.loads import PressurePolynomial, histories_of, no_pressure
from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.step.statics import dense_newton
from fenicsrom.reduction.basis import projected_terms
from fenicsrom.reduction.damping import ViscousDamping
from fenicsrom.reduction.protocols import Inverse
from fenicsrom.scene import BeamSection, Load, Material, Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.keys.excitation import highest_frequency

SHEAR_CORRECTION = 5.0 / 6.0
"""κ_s of a rectangular section, from the energy of the parabolic shear stress."""

UNKNOWNS = 3
"""Unknowns per node: u, w, θ."""


@njit(cache=True)
def _assemble(
    q: Array, length: float, axial: float, shear: float, bending: float
) -> tuple[float, Array, Array]:
    """Energy (2), its gradient and its Hessian, for a beam without supports.

    The numbers (u′, w′, θ, κ) at the midpoint of an element of length l are linear in its six
    unknowns: u′ = (u₂ − u₁)/l, θ = (θ₁ + θ₂)/2. The derivatives of ε and γ with respect to
    (u′, w′, θ) are

        ∂ε = (cos θ, sin θ, γ),    ∂γ = (−sin θ, cos θ, −(1 + ε)).

    Args:
        q: unknowns (3 (elements + 1),), node after node, in m, m, rad.
        length: length of one element, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².

    Returns:
        Energy in J, force (as `q`) in N, N, N m, and the symmetric tangent.
    """
    # One long function, because energy, gradient and Hessian share every quantity of the element.
    n = q.size
    energy = 0.0
    force = np.zeros(n)
    tangent = np.zeros((n, n))
    for e in range(n // 3 - 1):
        i, j = 3 * e, 3 * e + 3
        lengthening = (q[j] - q[i]) / length
        slope = (q[j + 1] - q[i + 1]) / length
        rotation = 0.5 * (q[i + 2] + q[j + 2])
        curvature = (q[j + 2] - q[i + 2]) / length
        c, s = np.cos(rotation), np.sin(rotation)
        # ε without the difference (1 + ε) - 1, which would lose digits
        strain = lengthening * c + slope * s - 2.0 * np.sin(0.5 * rotation) ** 2
        along = 1.0 + strain
        across = slope * c - (1.0 + lengthening) * s  # γ

        normal = axial * strain
        transverse = shear * across
        moment = bending * curvature
        energy += 0.5 * length * (normal * strain + transverse * across + moment * curvature)

        # gradient and Hessian of the energy density with respect to x = u', y = w', t = θ
        f_x = normal * c - transverse * s
        f_y = normal * s + transverse * c
        f_t = normal * across - transverse * along
        k_xx = axial * c * c + shear * s * s
        k_xy = (axial - shear) * c * s
        k_yy = axial * s * s + shear * c * c
        k_xt = axial * c * across + shear * s * along - f_y
        k_yt = axial * s * across - shear * c * along + f_x
        k_tt = axial * across**2 + shear * along**2 - normal * along - transverse * across

        for a, sign_a in ((i, -1.0), (j, 1.0)):
            force[a] += sign_a * f_x
            force[a + 1] += sign_a * f_y
            force[a + 2] += 0.5 * length * f_t + sign_a * moment
            for b, sign_b in ((i, -1.0), (j, 1.0)):
                both = sign_a * sign_b / length
                tangent[a, b] += both * k_xx
                tangent[a, b + 1] += both * k_xy
                tangent[a + 1, b] += both * k_xy
                tangent[a + 1, b + 1] += both * k_yy
                tangent[a, b + 2] += 0.5 * sign_a * k_xt
                tangent[a + 2, b] += 0.5 * sign_b * k_xt
                tangent[a + 1, b + 2] += 0.5 * sign_a * k_yt
                tangent[a + 2, b + 1] += 0.5 * sign_b * k_yt
                tangent[a + 2, b + 2] += 0.25 * length * k_tt + both * bending
    return energy, force, tangent


class TimoshenkoBeam:
    """A cantilever of equal elements with a rectangular section that bends along its height.

    The n = 3 × elements unknowns are u, w, θ of the first free node, then of the next.

    Attributes:
        elements: number of elements; the nodes are 0 (clamped) to `elements` (the tip).
        length: length of the beam, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².
        linear: whether displacements are small, so that `stiffness` is the tangent everywhere.
        mass: consistent mass (n, n), kg, kg m and kg m².
        stiffness: tangent of the undeformed beam (n, n).
        load_node: node at which the load acts.
        translated: (n, 2) load vectors of unit accelerations along and across the beam, kg.
    """

    def __init__(
        self, section: BeamSection, material: Material, linear: bool, source: str = "scene"
    ):
        """Build the beam.

        Args:
            section: length, height and width in m, number of elements, and position of the load as
                a fraction of the length.
            material: Young's modulus in Pa, Poisson's ratio, density in kg/m³.
            linear: whether displacements are small.
            source: name of the scene file, for messages.

        Raises:
            SceneError: the load is not at a free node.
        """
        area = section.width * section.height
        inertia = section.width * section.height**3 / 12.0
        young, poisson = material.isotropic_constants
        self.elements, self.length, self.linear = section.elements, section.length, linear
        self.axial, self.bending = young * area, young * inertia
        element = self.length / self.elements
        section_shear = SHEAR_CORRECTION * self.axial / (2.0 * (1.0 + poisson))
        self.shear = 1.0 / (1.0 / section_shear + element**2 / (12.0 * self.bending))
        line = _consistent_mass(self.elements)
        each = np.diag(material.density * element * np.array([area, area, inertia]))
        self.mass: Array = np.asarray(np.kron(line[1:, 1:], each), np.float64)
        translated = np.kron(line[1:].sum(axis=1)[:, None], each[:, :2])
        self.translated: Array = np.asarray(translated, np.float64)
        tangent = self._free(np.zeros(UNKNOWNS * self.elements))[2]
        self.stiffness = tangent[UNKNOWNS:, UNKNOWNS:].copy()
        self.load_node = _node_at(section.load_at, self.elements, source)

    @property
    def tip_node(self) -> int:
        """The node at x = length."""
        return self.elements

    def unknown(self, node: int, component: int) -> int:
        """Index of an unknown.

        Args:
            node: 1 (next to the clamp) to `elements` (the tip).
            component: 0 for u (along the beam), 1 for w (across), 2 for θ (from the first axis to
                the second).
        """
        return UNKNOWNS * (node - 1) + component

    def elastic(self, q: Array) -> tuple[Array, Array]:
        """Elastic force (n,) and its tangent (n, n) at the unknowns q (n,).

        The tangent of a linear beam is `stiffness` itself, not a copy.
        """
        if self.linear:
            return self.stiffness @ q, self.stiffness
        _, force, tangent = self._free(q)
        return force[UNKNOWNS:], tangent[UNKNOWNS:, UNKNOWNS:]

    def energy(self, q: Array) -> float:
        """Elastic energy at the unknowns q (n,), J."""
        if self.linear:
            return float(0.5 * q @ self.stiffness @ q)
        return float(self._free(q)[0])

    def _free(self, q: Array) -> tuple[float, Array, Array]:
        """Energy, force and tangent at q (n,), with the unknowns of the clamped node first."""
        nodes = np.concatenate((np.zeros(UNKNOWNS), q))
        energy, force, tangent = _assemble(
            nodes, self.length / self.elements, self.axial, self.shear, self.bending
        )
        return energy, force, tangent


def _consistent_mass(elements: int) -> Array:
    """Consistent mass matrix of the nodes of one component, for elements of inertia 1."""
    first, second = np.eye(elements + 1)[:-1], np.eye(elements + 1)[1:]
    line = (2.0 * (first.T @ first + second.T @ second) + first.T @ second + second.T @ first) / 6.0
    return np.asarray(line, np.float64)


def _node_at(fraction: float, elements: int, source: str) -> int:
    """The free node at a fraction of the length.

    Raises:
        SceneError: there is no free node.
    """
    place = fraction * elements
    node = round(place)
    if abs(place - node) <= 1e-9 and 1 <= node <= elements:
        return node
    nearest = {min(max(k, 1), elements) for k in (int(np.floor(place)), int(np.ceil(place)))}
    places = " or ".join(f"{k / elements:.12g}" for k in sorted(nearest))
    allowed = f"must be at a free node of the {elements} elements; the nearest is at {places}"
    raise Where(source, "reference.beam_section.load_at").refuse(fraction, allowed)


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

    held_times = strain_stiffness_times = stiffness_times

    def coupled(self, matrix: csr_array, block: Any) -> Any:
        """A sparse matrix (n, n) times a block (n, k)."""
        return matrix @ block

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
            self.points = points_on(0, np.ones(1), position, np.array(frames))
            rows = np.concatenate([axes @ self.probe_rows for axes in frames])
        self.contact_rows = csr_array(rows)
        self.interface: Array | None = None
        self.deflections: Array | None = None
        self.bolts, self.shifting_forces = no_bolts(d, self.size), np.zeros((self.size, 0))
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

        decrements: list[float] = []
        found = dense_newton(
            start, self.beam.elastic, load, STATIC_ITERATIONS, decrements=decrements
        )
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
    section = scene.reference.beam_section
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
