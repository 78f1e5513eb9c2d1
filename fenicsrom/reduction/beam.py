"""The one-dimensional reference: a geometrically exact planar Timoshenko beam.

Reissner's beam in a total-Lagrangian description, clamped at x = 0, with two-node elements. A
section has the displacements u along the beam and w across it, and the rotation θ. The strains hold
for any displacement and rotation,

    ε = (1 + u') cos θ + w' sin θ − 1,    γ = w' cos θ − (1 + u') sin θ,    κ = θ',
    (1)

and the elastic energy is

    Π = ½ ∫ (EA ε² + κ_s GA γ² + EI κ²) dx.
    (2)

Linear shape functions with one integration point an element: exact for the bending part, and free
of the locking that the full rule has in ε and γ. An element whose ends do not turn still bends in
between; linear shape functions leave that out, and its compliance is added to that of shear
(MacNeal's residual bending flexibility): with l the length of an element

    1 / S = 1 / (κ_s GA) + l² / (12 EI),
    (3)

and S in the place of κ_s GA. Linear statics is then exact at the nodes for forces and moments on
nodes, however few the elements. The mass is consistent and integrated exactly, rotary inertia
included; in the plane it does not depend on the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numba import njit

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, SceneError
from fenicsrom.online.contact_points import ContactPoints, no_points
from fenicsrom.online.load_histories import of_loads
from fenicsrom.online.model import DenseModel
from fenicsrom.online.surfaces import frame
from fenicsrom.scene import BeamSection, Material, Scene

SHEAR_CORRECTION = 5.0 / 6.0
"""κ_s of a rectangle, from the energy of the parabolic shear stress."""

UNKNOWNS = 3
"""Unknowns a node: u, w, θ."""


@njit(cache=True)
def _assemble(
    q: Array, length: float, axial: float, shear: float, bending: float
) -> tuple[float, Array, Array]:
    """Energy (2), its gradient and its Hessian for a beam none of whose nodes is held.

    In an element of length l the four numbers (u', w', θ, κ) at the midpoint are linear in the six
    unknowns: u' = (u₂ − u₁)/l, θ = (θ₁ + θ₂)/2. The derivatives of the strains (1) with respect to
    (u', w', θ) are

        ∂ε = (cos θ, sin θ, γ),    ∂γ = (−sin θ, cos θ, −(1 + ε)).

    Args:
        q: unknowns (3 (elements + 1),), node after node, in m, m, rad.
        length: of one element, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².

    Returns:
        Energy in J, force like `q` in N, N, N m, and the symmetric tangent.
    """
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
        strain = (
            lengthening * c + slope * s - 2.0 * np.sin(0.5 * rotation) ** 2
        )  # ε; to take 1 from 1 + ε would round EA ε
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


@dataclass(frozen=True, eq=False)
class TimoshenkoBeam:
    """A cantilever of equal elements with n = 3 × elements unknowns: u, w, θ of the first free
    node, then of the next.

    Attributes:
        elements: number of elements; the nodes are 0 (clamped) to `elements` (the tip).
        length: of the beam, m.
        axial: EA, N.
        shear: S of (3), N.
        bending: EI, N m².
        linear: small displacements: `stiffness` is the tangent everywhere.
        mass: consistent mass (n, n), kg, kg m and kg m²; read-only.
        stiffness: tangent of the undeformed beam (n, n); read-only.
        load_node: where the load acts.
    """

    elements: int
    length: float
    axial: float
    shear: float
    bending: float
    linear: bool
    mass: Array
    stiffness: Array
    load_node: int

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

        Raises:
            IndexError: the node is clamped or beyond the tip, or there is no such component.
        """
        if not (1 <= node <= self.elements and 0 <= component < UNKNOWNS):
            raise IndexError(
                f"node {node}, component {component}: nodes are 1 to {self.elements}, components 0 to 2"
            )
        return UNKNOWNS * (node - 1) + component

    def elastic(self, q: Array) -> tuple[Array, Array]:
        """Elastic force (n,), acting against the motion, and its tangent (n, n), at the unknowns q
        (n,).

        The tangent of a linear beam is `stiffness` itself, not a copy.
        """
        if self.linear:
            return self.stiffness @ q, self.stiffness
        _, force, tangent = self._free(q)
        return force[UNKNOWNS:], tangent[UNKNOWNS:, UNKNOWNS:]

    def energy(self, q: Array) -> float:
        """Elastic energy in J at the unknowns q (n,)."""
        if self.linear:
            return float(0.5 * q @ self.stiffness @ q)
        return float(self._free(q)[0])

    def _free(self, q: Array) -> tuple[float, Array, Array]:
        """Energy, force and tangent with the clamped node included."""
        nodes = np.concatenate((np.zeros(UNKNOWNS), q))
        energy, force, tangent = _assemble(
            nodes, self.length / self.elements, self.axial, self.shear, self.bending
        )
        return energy, force, tangent


def timoshenko(section: BeamSection, material: Material, linear: bool) -> TimoshenkoBeam:
    """The beam of a rectangular section, bending in the direction of its height.

    Args:
        section: length, height, width in m, number of elements, place of the load as a fraction of
        the length.
        material: Young's modulus in Pa, Poisson's ratio, density in kg/m³.
        linear: small displacements.

    Raises:
        SceneError: the load is not at a free node.
    """
    area = section.width * section.height
    inertia = section.width * section.height**3 / 12.0
    axial = material.young * area
    bending = material.young * inertia
    n, length = section.elements, section.length / section.elements
    section_shear = SHEAR_CORRECTION * axial / (2.0 * (1.0 + material.poisson))
    shear = 1.0 / (1.0 / section_shear + length**2 / (12.0 * bending))
    mass = _consistent_mass(n, material.density * length * np.array([area, area, inertia]))
    stiffness = _assemble(np.zeros(UNKNOWNS * (n + 1)), length, axial, shear, bending)[2][
        UNKNOWNS:, UNKNOWNS:
    ].copy()
    mass.setflags(write=False)
    stiffness.setflags(write=False)
    return TimoshenkoBeam(
        n,
        section.length,
        axial,
        shear,
        bending,
        linear,
        mass,
        stiffness,
        load_node=_node_at(section.load_at, n),
    )


def _consistent_mass(elements: int, inertia: Array) -> Array:
    """Mass matrix (3 elements, 3 elements) of linear shape functions, the clamped node left out.

    Args:
        elements: number of elements.
        inertia: of one element for u, w, θ (3,).
    """
    first, second = np.eye(elements + 1)[:-1], np.eye(elements + 1)[1:]
    line = (2.0 * (first.T @ first + second.T @ second) + first.T @ second + second.T @ first) / 6.0
    return np.kron(line[1:, 1:], np.diag(inertia))


def _node_at(fraction: float, elements: int) -> int:
    """The free node at a fraction of the length, refused if there is none."""
    place = fraction * elements
    node = round(place)
    if abs(place - node) <= 1e-9 and 1 <= node <= elements:
        return node
    nearest = {min(max(k, 1), elements) for k in (int(np.floor(place)), int(np.ceil(place)))}
    allowed = " or ".join(f"{k / elements:.12g}" for k in sorted(nearest))
    raise SceneError(
        f"reference.beam_section.load_at: {fraction:g} is not at a free node of a beam of {elements} elements, "
        f"nearest allowed: {allowed}"
    )


STATIC_TOLERANCE = 1e-9
"""Of Newton's decrement, relative to the work of the load, squared."""

STATIC_ITERATIONS = 50


class _Alone:
    """The communicator of a body that every rank holds whole."""

    rank, size = 0, 1

    def allreduce(self, value: Any) -> Any:
        """The sum over the one rank there is."""
        return value

    def bcast(self, value: Any) -> Any:
        """The value of the one rank there is."""
        return value


class _Cholesky:
    """A dense positive definite matrix, factorised once."""

    def __init__(self, matrix: Array):
        self._factor = scipy.linalg.cho_factor(matrix)

    def solve(self, block: Array) -> Array:
        """The inverse times the columns of a block (n, k)."""
        return np.asarray(scipy.linalg.cho_solve(self._factor, block))


class BeamStructure:
    """The beam as modes, derivatives, selection and projection want a body: what a
    `fenicsrom.fem.solid.Solid` offers, dense.

    Attributes are those of `Solid`, about the undeformed beam, which is its equilibrium. The
    elastic force is no polynomial; five Gauss points integrate it along a time step to rounding.
    """

    gauss_points = 5
    gyroscopic = None
    comm = _Alone()

    def __init__(
        self,
        scene: Scene,
        beam: TimoshenkoBeam,
        loads: Array,
        points: ContactPoints,
        contact_rows: Array,
        probe_rows: Array,
    ):
        """Keep the beam and its places: unit loads (n, loads), contact points, B^T (m, n) and the
        rows of the probe (d, n).
        """
        self.scene, self.beam = scene, beam
        self.mass, self.stiffness = beam.mass, beam.stiffness
        self.size = self.local = self.free = beam.mass.shape[0]
        self.load_vectors, self.points, self.contact_rows, self.probe_rows = (
            loads,
            points,
            contact_rows,
            probe_rows,
        )
        self.load_histories = of_loads(scene.loads)
        self.equilibrium = self.rest_force = np.zeros(self.size)
        self.factor = _Cholesky(beam.stiffness)
        self.warnings: list[str] = []

    def full_model(self) -> DenseModel:
        """All its unknowns, as the time integration wants them."""
        linear = self.beam.linear
        return DenseModel(
            self.mass,
            self.scene.material.mass_damping,
            self.beam.elastic,
            self.beam.energy,
            self.load_vectors,
            self.load_histories,
            self.points,
            self.contact_rows,
            np.zeros(self.contact_rows.shape[0]),
            self.probe_rows,
            np.zeros(self.probe_rows.shape[0]),
            linear=linear,
            gauss_points=1 if linear else self.gauss_points,
        )

    def inner(self, a: Array, b: Array) -> Array:
        """a^T b for blocks (n, k) and (n, l)."""
        return a.T @ b

    def mass_times(self, block: Array) -> Array:
        """M times a block (n, k)."""
        return self.mass @ block

    def mass_inner(self, a: Array, b: Array) -> Array:
        """a^T M b."""
        return a.T @ (self.mass @ b)

    def stiffness_times(self, block: Array) -> Array:
        """K times a block (n, k)."""
        return self.stiffness @ block

    def internal_force(self, u: Array) -> Array:
        """Elastic force (n,)."""
        return self.beam.elastic(u)[0]

    def tangent_times(self, u: Array, block: Array) -> Array:
        """Tangent at u times a block (n, k)."""
        return self.beam.elastic(u)[1] @ block

    def energy(self, u: Array) -> float:
        """Elastic energy, J."""
        return self.beam.energy(u)

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K'[x] y by central differences of fourth order; the step turns no section by more than a
        milliradian.
        """
        turn = max(
            np.max(np.abs(x[2::UNKNOWNS])), np.max(self.largest(x[:, None])) / self.beam.length
        )
        h = 1e-3 / turn

        def change(step: float) -> Array:
            return self.tangent_times(step * x, y) - self.tangent_times(-step * x, y)

        return (8.0 * change(h) - change(2.0 * h)) / (12.0 * h)

    tangent_derivative = tangent_difference

    def largest(self, block: Array) -> Array:
        """Largest displacement component of each column of a block (n, k), rotations apart."""
        return np.max(np.abs(np.concatenate([block[0::UNKNOWNS], block[1::UNKNOWNS]])), axis=0)

    def translations(self) -> Array:
        """(n, 2) unit translations along the axes."""
        return np.tile(np.eye(UNKNOWNS, 2), (self.size // UNKNOWNS, 1))

    def eigenmodes(self, inverse: Any, count: int) -> tuple[Array, Array]:
        """omega^2 (count,) and mass-normalised modes (n, count) of M phi / omega^2 = M K^-1 M phi,
        the lowest first.
        """
        lower = np.linalg.cholesky(self.mass)
        compliance = lower.T @ inverse.solve(lower)
        values, vectors = scipy.linalg.eigh(0.5 * (compliance + compliance.T))
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        return 1.0 / values, scipy.linalg.solve_triangular(lower.T, vectors)

    def static(self, load: Array, guess: Array | None = None) -> Array:
        """Nonlinear equilibrium (n,) under a load (n,), by Newton from a guess.

        Raises:
            ConvergenceError: no convergence.
        """
        u = np.zeros(self.size) if guess is None else guess.copy()
        first = 0.0
        for _ in range(STATIC_ITERATIONS):
            force, tangent = self.beam.elastic(u)
            change = np.linalg.solve(tangent, load - force)
            decrement = abs(float((load - force) @ change))
            first = first or decrement
            u += change
            if decrement <= STATIC_TOLERANCE**2 * max(first, abs(float(load @ u))):
                return u
        raise ConvergenceError("static equilibrium of the beam: no convergence", u)


def beam_model(scene: Scene) -> Any:
    """The full model of `beam_structure`.

    Raises:
        SceneError: the scene's loads or contacts are not those of a planar beam along x.
    """
    return beam_structure(scene).full_model()


def beam_structure(scene: Scene) -> BeamStructure:
    """The planar Timoshenko beam of a scene, in the plane of x and y: loads at its section, contact
    and probe at its tip.

    Raises:
        SceneError: the scene's loads or contacts are not those of a planar beam along x.
    """
    section, d = scene.reference.beam, scene.geometry.dimension
    assert section is not None
    try:
        beam = timoshenko(section, scene.material, not scene.geometrically_nonlinear)
    except SceneError as error:
        raise SceneError(f"{scene.source}: {error}") from None
    n = beam.mass.shape[0]
    if len(scene.contacts) > 1:
        count = len(scene.contacts)
        raise SceneError(
            f"{scene.source}: reference.beam = true: the beam has one contact point, the scene {count}"
        )
    for k, load in enumerate(scene.loads):
        if load.kind != "force":
            what = f"the beam takes point forces only, no {load.kind} as in loads[{k}]"
            raise SceneError(f"{scene.source}: reference.beam = true: {what}")
    for k, item in enumerate([*scene.loads, *scene.contacts]):
        vector = item.direction if k < len(scene.loads) else item.normal
        if vector is None or (k >= len(scene.loads) and item.place.at == "nodes"):
            raise SceneError(
                f"{scene.source}: reference.beam = true: the beam has one contact point, before a plane"
            )
        if d == 3 and abs(vector[2]) > 1e-12:
            raise SceneError(
                f"{scene.source}: reference.beam = true: the beam moves in the x-y plane, {list(vector)} leaves it"
            )

    def rows(node: int) -> Array:
        found = np.zeros((d, n))
        found[0, beam.unknown(node, 0)] = found[1, beam.unknown(node, 1)] = 1.0
        return found

    if any(load.static and load.size for load in scene.loads):
        raise SceneError(
            f"{scene.source}: reference.beam = true: the beam starts at rest, undeformed; leave out static loads"
        )
    tip = rows(beam.tip_node)
    loads = (
        np.array([np.array(load.direction) @ rows(beam.load_node) for load in scene.loads])
        .reshape(-1, n)
        .T
    )
    frames = [frame(np.array(contact.normal)) for contact in scene.contacts]
    contact_rows = np.concatenate([axes @ tip for axes in frames] or [np.zeros((0, n))])
    points = no_points(d)
    if frames:
        position = np.zeros((1, d))
        position[0, 0] = section.length
        points = ContactPoints(np.zeros(1, dtype=np.int64), np.ones(1), position, np.array(frames))
    return BeamStructure(scene, beam, loads, points, contact_rows, tip)
