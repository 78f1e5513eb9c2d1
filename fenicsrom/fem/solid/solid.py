"""The solid: a body in its static equilibrium, with its loads and contact points.

In a scene with [rotation], all quantities are described in the rotating frame
(`fem.body.rotation`). The centrifugal potential is part of the energy, of the internal force
and of the tangent. The equilibrium is that at speed, and is always geometrically nonlinear: a
linear one would lack the stiffening by the centrifugal tension. In a geometrically linear scene,
only the vibrations about this equilibrium are linear.
"""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.base.linalg import add_entries, eigenmodes, multiply
from fenicsrom.fem.body.attachments import attach, set_bolts
from fenicsrom.fem.body.elasticity import AnyFactor, ElasticBody, Joint
from fenicsrom.fem.body.free_bodies import (
    balanced_loads,
    free_motions_of,
    mass_orthonormal,
    require_held,
)
from fenicsrom.fem.body.loads import FollowerPressures, load_vector
from fenicsrom.fem.body.pairs import pair_rows
from fenicsrom.fem.body.places import Places
from fenicsrom.fem.body.supports import pieces_apart
from fenicsrom.fem.body.ties import tie
from fenicsrom.fem.equilibrium import statics as prediction
from fenicsrom.fem.equilibrium.buckling import check_snap, check_stability
from fenicsrom.fem.equilibrium.joined import Rubbing, bring_together
from fenicsrom.fem.equilibrium.statics import Statics
from fenicsrom.fem.mesh.mesh import Mesh, build_mesh
from fenicsrom.fem.solid.plausibility import implausible_inputs, implausible_normals
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact.points import (
    ContactPoints,
    all_points,
    contacts_of,
    paired,
    points_on,
)
from fenicsrom.online.contact.surfaces import frame, surface_normal
from fenicsrom.online.contact.together import all_closed, require_planes, sticking
from fenicsrom.online.kernels.dense import interpolation_weights
from fenicsrom.online.model.loads import PressurePolynomial, histories_of
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_polynomial
from fenicsrom.reduction.basis import strain_products
from fenicsrom.reduction.damping import ViscousDamping
from fenicsrom.reduction.protocols import Inverse
from fenicsrom.scene import Attachment, Contact, Load, Place, Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.keys.excitation import highest_frequency
from fenicsrom.scene.keys.unit_system import LENGTHS

EXTRAPOLATED = 4
"""Number of equilibria from which the next one of a load path is extrapolated."""

DIFFERENCE_STEP = 0.1
"""Largest displacement of the central difference of the tangent, relative to the extent."""


@dataclass(frozen=True, eq=False)
class KnownEquilibrium:
    """The equilibrium of a solid that was computed before.

    Attributes:
        displacement: (local,) m, or () of the same displacement at all unknowns.
        unstable: see `Solid`.
        displaced: whether supports are displaced, too; the residual is then not checked, because
            their inertia is no part of it.
    """

    displacement: Array
    unstable: int
    displaced: bool = False


UNDEFORMED = KnownEquilibrium(np.zeros(()), 0)
"""The undeformed body in place of the equilibrium, for a solid whose places are all that counts."""


class Solid(ElasticBody):
    """A body in its equilibrium; a `fenicsrom.reduction.protocols.Structure`.

    Attributes:
        geometrically_nonlinear: False for small displacements.
        mass_damping: α of the damping C = α M, 1/s.
        loads: the loads.
        static_load: (local,) sum of the static loads that do not follow the deformation, N.
        loaded: whether static loads or rotation deform the body.
        free_motions: (local, r) rigid motions that nothing holds.
        unstable: number of directions in which the equilibrium that the loads reach from the
            undeformed body is unstable; without contacts the body then is in a stable one nearby.
        equilibrium: (local,) displacement under the static loads, at speed, m.
        contact_rows: sparse Bᵀ (m, local): contact displacements in the local frames [normal,
            tangents], point by point; of a sector, if all sectors move alike.
        ahead_rows: sparse (m, local), the part of them by which the next sector moves.
        between: (P,) whether each contact point is one between sectors.
        points: the contact points.
        interface: (m, k) combinations of contact forces for the static modes, or None.
        deflections: (local, k) nonlinear static deflections of the first of several bases, or None.
        joined: whether there are contacts between bodies; their closed points are in the `factor`.
        contacts: the contacts at the points, if `joined`.
        pairs: a sentence on each of them, and on each tie.
        sides: the nodes of both regions of each contact between bodies, by its number.
        tied: (k, d) the places of the nodes of each tie, m.
        spring_couplings: the `couplings` without those of bolts.
        probe_rows: (d, local) displacement of the probe in global axes; (0, local) without a probe.
        probe_position: (3,) position of the probe, m.
        load_vectors: (local, loads) load vectors of unit loads, at the equilibrium.
        load_histories: time factors of the loads.
        excitation: the highest frequency that the scene excites, Hz.
        gauss_points: Gauss points that integrate the elastic force, a cubic, exactly along a
            straight line of states.
    """

    gauss_points = 2

    def __init__(self, mesh: Mesh, scene: Scene, known: KnownEquilibrium | None = None):
        """Assemble the matrices, compute the equilibrium and factorise the stiffness.

        With a known equilibrium, matrices and factor are made when they are first used.

        Args:
            mesh: the mesh.
            scene: the scene; the file of its mesh is not read. Without a probe, the place of the
                first contact is observed or, without contacts, that of the first load.
            known: the equilibrium of an equal solid; None computes it.

        Raises:
            SceneError: a group is missing, the supports do not hold the body, or a place is clamped
                or not found.
            ConvergenceError: no equilibrium was found under the static loads.
        """
        super().__init__(mesh, scene)
        self.geometrically_nonlinear = scene.geometrically_nonlinear
        self.mass_damping = scene.material.mass_damping
        self._damping = scene.damping
        if scene.cyclic is not None:  # the ratios are those of the waves of the disk
            self._damping = replace(scene.damping, ratios=())
        self.excitation = highest_frequency(scene)
        self.loads = scene.loads
        self._tangent_workspace: PETSc.Mat | None = None
        self.deflections: Array | None = None
        self._modes: list[tuple[Array, Inverse, tuple[Array, Array]]] = []  # of the last call
        self._places = Places(self)
        self._unit_length = float(LENGTHS[scene.units.length])
        self._set_attachments(scene.attachments)
        self._set_contacts(scene.contacts)
        self.tied = []
        for k, one in enumerate(scene.ties):
            stiffness, places = tie(self, one, k)
            self.couplings = csr_array(self.couplings + stiffness)
            self.tied.append(places)
        self.spring_couplings = self.couplings
        springs = [self.couplings]
        set_bolts(self, self._places, scene.bolts)
        self.joined = scene.joined
        if self.joined:
            self.contacts = contacts_of(scene, self.points)
            self._paired = paired(scene, self.points)
            self.joint = self._closed_joint()
            springs.append(self.joint.directions)
        linked = self.joined or scene.ties or any(one.to for one in scene.attachments)
        if not linked and (sentence := pieces_apart(mesh, self.space)):
            self.warnings.append(Note(NoteKind.APART, sentence, "geometry"))
        self.free_motions = free_motions_of(self, scene, springs)
        self.room = self._room()
        self._set_loads()
        self._set_probe(scene)

        self._several_speeds = scene.speeds_rpm is not None
        pushed = self.comm.allreduce(float(np.abs(self.static_load).sum())) > 0.0
        self.loaded: bool = self.spins or bool(pushed) or not self.symmetric or self.joined
        self._known = known
        if known is not None:
            self.equilibrium: Array = np.zeros(self.local) + known.displacement
            self.unstable = known.unstable
            if self.joined:
                x = self.contact_displacement(self.equilibrium)
                self.joint = Joint(self, self.contact_rows, *sticking(self.contacts, x))
            self._set_follower_loads()
        else:
            self._find_equilibrium()

    def _find_equilibrium(self) -> None:
        """Compute the equilibrium from the undeformed body; matrices and factor follow."""
        self.equilibrium, self.unstable = np.zeros(self.local), 0
        if self.joined:
            self._bring_together()
            self.unstable = check_stability(self) if self._bends else 0
            return
        _ = self.mass, self.factor, self.gyroscopic
        if not self.loaded:
            return
        pushing = self.static_load + self.pressure_force(self.equilibrium)
        linear = self.factor.solve(pushing[:, None])[:, 0]
        if not self._bends:
            self.equilibrium = linear
            return
        rest = np.zeros(self.local)
        self._move(rest, rest, 0.0, pressed=0.0, predicted=self._predicted())
        self.unstable = check_stability(self)
        if self.unstable:
            self._set_follower_loads()
        elif not self.spins:
            check_snap(self, linear)

    def _closed_joint(self) -> Joint:
        """The joint of bodies that touch at all contact points."""
        return Joint(self, self.contact_rows, *all_closed(self.contacts, self._paired))

    def _bring_together(self) -> None:
        """Compute the equilibrium of bodies that touch; the factor and the load vectors follow."""
        self.joint = self._closed_joint()
        try:
            self.equilibrium = bring_together(self, self.contacts, self._bends)
        except ConvergenceError as error:
            causes = [note for note in self.warnings if note.key.startswith("bolts")]
            if not causes:
                raise
            text = f"{error}; {causes[0]}"
            raise ConvergenceError(text, error.partial, kind=error.kind) from None
        if not self._several_speeds:  # a model of several speeds finds its equilibrium again
            x = self.contact_displacement(self.equilibrium)
            require_planes(self.contacts, self.points, x, self.source)
        if not self.symmetric:
            self._renew(self.factor)
        self._set_follower_loads()

    def _predicted(self) -> Array | None:
        """A state (local,) near the equilibrium, if one is cheap to find. Collective."""
        if self.spins and self.symmetric and self.free >= prediction.UNKNOWNS:
            return prediction.predicted_equilibrium(self)
        return None

    @property
    def spins(self) -> bool:
        """Whether the body turns."""
        return self.rotation is not None and self.rotation.omega_squared > 0.0

    @property
    def _bends(self) -> bool:
        """Whether the equilibrium changes the stiffness."""
        return self.loaded and (self.geometrically_nonlinear or self.spins)

    @cached_property
    def mass(self) -> PETSc.Mat:
        """M."""
        return self.mass_matrix(0.0)

    def _room(self) -> csr_array | None:
        """The entries that springs, dashpots and contacts between bodies add to a tangent."""
        found = abs(self.couplings) + abs(self.dashpots)
        if self.joined:
            rows = abs(self.contact_rows)
            found = found + self.product(rows, scipy.sparse.eye_array(rows.shape[0]))
        outside = found.nnz - np.count_nonzero(found.diagonal(self.first))
        return csr_array(found) if self.comm.allreduce(outside) else None

    def let_rub(self) -> Rubbing | None:
        """Let the contacts of bodies that touch open, slip and stick from the equilibrium on."""
        if self.joint is not None:
            d, rows = self.dimension, abs(self.contact_rows)
            of_points = scipy.sparse.kron(np.eye(rows.shape[0] // d), np.ones((d, d)))
            self.room = csr_array(self.room + self.product(rows, of_points))
            self.joint = Rubbing(self, self.contacts, self.equilibrium)
        return self.joint

    @cached_property
    def rigid(self) -> Array:
        """(local, r) mass-orthonormal rigid motions that nothing holds, alike in all sectors."""
        motions = self.free_motions
        if self.cut is not None:
            motions = self.cut.waves_among(0, motions).real
        return mass_orthonormal(self, motions)

    @cached_property
    def gyroscopic(self) -> PETSc.Mat | None:
        """G of the Coriolis force −G u̇, skew, N s/m; None without this force."""
        return self.rotation.gyroscopic() if self.rotation else None

    @cached_property
    def stiffness(self) -> PETSc.Mat:
        """K, the tangent at the equilibrium; its symmetric part under follower pressures."""
        if self.joint is None:
            return self.factor.matrix
        return self.tangent(
            self.equilibrium if self._bends else 0.0 * self.equilibrium, joined=False
        )

    @cached_property
    def strain_stiffness(self) -> PETSc.Mat:
        """The part K_ε of K that comes from strains and springs: `fenicsrom.reduction.damping`."""
        matrix = self.with_room(self.matrix(self._strain_form(), 1.0))
        add_entries(matrix, self.spring_couplings)
        return matrix

    def _strain_form(self) -> fem.Form:
        """The form of the stiffness of strains, whose fields are those of the equilibrium."""
        self.set_field(self._u, self.equilibrium if self._bends else np.zeros(self.local))
        return compiled_form(self._strain_integrand) if self._bends else self._tangent_form

    @cached_property
    def factor(self) -> AnyFactor:
        """K⁻¹, factorised once for modes, attachments, constraints and derivatives.

        For bodies that touch each other, K is K_lin of `fenicsrom.fem.equilibrium.joined`. For a
        known equilibrium, as for a computed one, the factors of the undeformed body come first, so
        that the results are the same to the last digit.
        """
        self.set_field(self._u, np.zeros(self.local))
        stiffness = self.with_room(self.matrix(self._tangent_form, 1.0))
        add_entries(stiffness, self.couplings)
        if self.joint is not None:
            add_entries(stiffness, self.joint.stiffness)
        factor = self.factorised(stiffness, "fenicsrom_stiffness")
        if self._known is not None and self._bends:
            if self.symmetric and not self._known.displaced:
                Statics(self, factor, overwrite=True).finish(self.equilibrium, self.static_load)
            else:
                self._renew(factor)
        return factor

    def destroy(self) -> None:
        """Free the matrices and the factor; PETSc frees nothing itself in parallel. Collective."""
        made = vars(self)  # without those that were not made
        if "factor" in made:
            self.factor.destroy(matrix=True)
        matrices = [made.get(name) for name in ("mass", "gyroscopic", "strain_stiffness")]
        matrices.append(self._tangent_workspace)
        if self.rotation is not None:
            matrices += self.rotation.matrices
        for matrix in matrices:
            if matrix is not None:
                matrix.destroy()

    def _set_attachments(self, attachments: Sequence[Attachment]) -> None:
        """Set the springs, the dashpots and the concentrated masses."""
        attach(self, self._places, attachments, self._unit_length)

    def _set_contacts(self, contacts: Sequence[Contact]) -> None:
        """Find the contact points, their frames and their displacements."""
        d = self.dimension
        self.pairs: list[str] = []
        self.sides: dict[int, tuple[Ints, Ints]] = {}
        self.interface: Array | None = None
        rows = [csr_array((0, self.local))]
        ahead = rows.copy()
        found: list[ContactPoints] = []
        for k, contact in enumerate(contacts):
            key = f"contacts[{k}]"
            if contact.against is not None:
                pairs = pair_rows(self, contact, k)
                rows.append(csr_array(pairs.own + pairs.ahead))
                ahead.append(pairs.ahead)
                found.append(pairs.points)
                self.sides[k] = pairs.sides
                continue
            at, position, area = self._places.contact_points(contact.place, key)
            where = f"{self.source}: {key}"
            axes = np.array([frame(surface_normal(contact, x[:d], where)) for x in position])
            blocks = np.arange(area.size + 1)
            rows.append(scipy.sparse.bsr_array((axes, blocks[:-1], blocks)) @ at)
            ahead.append(csr_array(rows[-1].shape))
            lengths = self.mesh.unit_lengths(contact.place) if contact.place.at == "nodes" else 0
            found.append(points_on(k, area, position[:, :d], axes, lengths))
        self.contact_rows = scipy.sparse.vstack(rows, format="csr")
        self.ahead_rows = scipy.sparse.vstack(ahead, format="csr")
        self.points = all_points(d, found)
        self.between = np.array([contacts[k].neighbour for k in self.points.contact], dtype=bool)

    def _set_probe(self, scene: Scene) -> None:
        """Find the probe: that of the scene, or the place of the first contact or load."""
        observed = [*filter(None, [scene.probe]), *(contact.place for contact in scene.contacts)]
        observed += [load.place for load in self.loads if not load.everywhere]
        self.probe_rows, self.probe_position = np.zeros((0, self.local)), np.full(3, np.nan)
        if observed:
            among = self.sides[0][0] if scene.probe is None and 0 in self.sides else None
            self.probe_rows, self.probe_position = self._places.find(observed[0], "probe", among)

    def _set_loads(self) -> None:
        """Assemble the load vectors."""
        self.load_vectors = self.without_held(self._assembled_loads())
        for k, moves in enumerate(self.comm.allreduce(np.abs(self.load_vectors).sum(axis=0)) > 0.0):
            if not moves:
                raise self._places.clamped(f"loads[{k}]")
        self.load_vectors = balanced_loads(self, self.load_vectors)
        self.load_histories = histories_of(self.loads)
        self.pressures = FollowerPressures(self, self.loads)
        constant = [load.static and not load.follower for load in self.loads]
        sizes = np.where(constant, [load.size for load in self.loads], 0.0)
        self.static_load = self.load_vectors @ sizes

    def _assembled_loads(self) -> Array:
        """The load vectors (local, loads) of all loads."""
        numbered = enumerate(self.loads)
        vectors = [self.load_vector(load, f"loads[{k}]") for k, load in numbered]
        return np.reshape(vectors, (len(self.loads), self.local)).T.copy()

    def _set_follower_loads(self) -> None:
        """Set the load vectors of the follower pressures to those at the equilibrium."""
        self.load_vectors[:, self.pressures.numbers] = self.pressures.unit_forces(self.equilibrium)

    def load_vector(self, load: Load, key: str) -> Array:
        """The load vector (local,) of a load of size 1: `fenicsrom.fem.body.loads.load_vector`."""
        return load_vector(self, self._places, load, key)

    def place(self, place: Place, key: str) -> tuple[Array, Array]:
        """Displacement rows and position of a place: `fenicsrom.fem.body.places.Places.find`."""
        return self._places.find(place, key)

    # ------------------------------------------------------------------ about the equilibrium

    @property
    def pressing(self) -> Array:
        """(P,) whether each contact point of a joint presses in the equilibrium."""
        if self.joint is None:
            return np.zeros(self.between.size, dtype=bool)
        return np.asarray(self.joint.springs[:: self.dimension] > 0.0)

    @property
    def wall_force(self) -> Array:
        """Force (local,) on rigid surfaces that bodies which touch press at rest, N."""
        if self.joint is None:
            return np.zeros(self.local)
        x = self.contact_displacement(self.equilibrium)
        pushed = self.joint.springs * (x - self.joint.reference)
        return np.asarray(self.contact_rows.T @ (pushed * ~np.repeat(self._paired, self.dimension)))

    @property
    def shifting_forces(self) -> Array:
        """Forces (local, k) that move the equilibrium if bolts or contacts change, N.

        They are the pulls of the bolts, and of the closed points of each contact the forces of a
        uniform gap, those at rest, and those that would hold their slides.
        """
        line = self.bolts.line / np.linalg.norm(self.bolts.line, axis=1, keepdims=True)
        pulls = np.einsum("bd,bdu->ub", line, self.bolts.apart)
        if self.joint is None:
            return pulls
        x, springs = self.contact_displacement(self.equilibrium), self.joint.springs
        normal = np.arange(x.size) % self.dimension == 0
        kinds = normal * springs, springs * (x - self.joint.reference), ~normal * springs * x
        of_point = np.repeat(self.points.contact, self.dimension)
        forces = [kind * (of_point == k) for k in np.unique(of_point) for kind in kinds]
        return np.column_stack([pulls, self.contact_rows.T @ np.array(forces).T])

    @property
    def rest_force(self) -> Array:
        """Internal force (local,) at the equilibrium, N; linear in a geometrically linear scene."""
        if self.geometrically_nonlinear or self.rotation is not None:
            return self.internal_force(self.equilibrium)
        return multiply(self.stiffness, self.equilibrium) - self.tension

    @cached_property
    def viscous(self) -> ViscousDamping:
        """The damping besides α M at the equilibrium."""
        return ViscousDamping(self, self._damping, self.dashpots)

    def contact_displacement(self, u: Array) -> Array:
        """Contact displacements (m,) of a displacement u (local,), m. Collective."""
        return np.asarray(self.comm.allreduce(self.contact_rows @ u))

    def stiffness_times(self, block: Array) -> Array:
        """K times a block (local, k)."""
        return multiply(self.stiffness, block)

    def strain_stiffness_times(self, block: Array) -> Array:
        """K_ε times a block (local, k)."""
        return multiply(self.strain_stiffness, block)

    def held_times(self, block: Array) -> Array:
        """The matrix of which `factor` is the inverse, times a block (local, k)."""
        return multiply(self.factor.matrix, block)

    def mass_times(self, block: Array) -> Array:
        """M times a block (local, k)."""
        return multiply(self.mass, block)

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b (k, l) over all ranks of two blocks."""
        return self.inner(a, multiply(self.mass, b))

    def gyroscopic_times(self, block: Array) -> Array:
        """G times a block (local, k); the scene must include the Coriolis force."""
        return multiply(self.gyroscopic, block)

    def unclamped_strain_stiffness_times(self, block: Array) -> Array:
        """K_ε without supports and springs, times a block (local, k)."""
        matrix = fem.petsc.assemble_matrix(self._strain_form())
        matrix.assemble()
        product = multiply(matrix, block)
        matrix.destroy()
        return product

    def tangent_times(self, u: Array, block: Array) -> Array:
        """Tangent at a displacement u (local,) times a block (local, k)."""
        if self._tangent_workspace is None:
            self._tangent_workspace = self.stiffness.duplicate()
        return multiply(
            self.tangent(u, self._tangent_workspace, symmetric=False, joined=False), block
        )

    def tangent_derivative(self, x: Array, y: Array) -> Array:
        """K′[x] y (local,) at the equilibrium, exact, for x and y (local,)."""
        found = self.derivative_at(self.equilibrium, x, y)
        return found - self.pressures.static_derivative(x, y)

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K′[x] y (local,) at the equilibrium by the central difference of the tangent.

        This is eq. (16) of Mashayekhi and Zucca (2024). The difference is exact at any step,
        because the tangent of this material is quadratic; a small step would lose digits by
        cancellation.
        """
        largest = self.comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX)
        h = DIFFERENCE_STEP * self.mesh.extent() / largest
        plus = self.tangent_times(self.equilibrium + h * x, y)
        minus = self.tangent_times(self.equilibrium - h * x, y)
        difference = (plus - minus) / (2.0 * h)
        return self.without_held(difference)

    def strain_polynomial(self, vectors: Array, degree: int | None = None) -> ElasticPolynomial:
        """The force of the body and its springs on vectors (local, n), as a cubic polynomial.

        The polynomial is exact with the quadrature rule of the forms, which has the default degree.
        """
        n, products = vectors.shape[1], np.zeros(())
        for k, cells in self.materials.cells():
            chunks = self.tabulate(vectors, self.equilibrium, degree, cells)
            products = products + strain_products(chunks, self.materials.tensor(k), n)
        elastic = elastic_polynomial(self.comm.allreduce(products), n)
        held = self.coupled(self.couplings, np.column_stack([self.equilibrium, vectors]))
        held[:, 0] -= self.tension
        if not self.comm.allreduce(bool(held.any())):
            return elastic
        found = self.inner(vectors, held)
        return elastic._replace(
            force=elastic.force + found[:, 0], stiffness=elastic.stiffness + found[:, 1:]
        )

    def elastic_polynomial(self, vectors: Array) -> ElasticPolynomial:
        """The internal force projected on vectors (local, n), as an exact cubic polynomial."""
        elastic = self.strain_polynomial(vectors)
        if (frame := self.rotation) is None:
            return elastic
        centrifugal = self.inner(vectors, frame.centrifugal_force(self.equilibrium)[:, None])
        softening = frame.omega_squared * self.inner(vectors, frame.mass_times(vectors))
        return elastic._replace(
            force=elastic.force - centrifugal[:, 0], stiffness=elastic.stiffness - softening
        )

    def pressure_polynomial(self, vectors: Array) -> PressurePolynomial:
        """The follower pressures on vectors (local, n), as exact quadratic polynomials."""
        return self.pressures.polynomial(self.equilibrium, vectors)

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (local, count).

        `inverse` is K⁻¹, or the inverse with the contact displacements held at zero. Rigid motions
        are not among them. Those of the last call are known.
        """
        for at, inverted, (squares, modes) in self._modes:
            if at is self.equilibrium and inverted is inverse and squares.size == count:
                return squares, modes
        found = eigenmodes(self.factor.matrix, self.mass, inverse, count, "fenicsrom_modes")
        self._modes = [(self.equilibrium, inverse, found)]
        return found

    # ------------------------------------------------------------------ statics

    def static(self, load: Array, guess: Array | None = None) -> Array:
        """Nonlinear equilibrium under a load vector, by Newton's method with load steps.

        The static follower pressures act besides this load.

        Args:
            load: (local,) N.
            guess: (local,) state at this speed to start from. Without it the iteration starts from
                the undeformed body at rest, and Ω² grows with the load.

        Returns:
            (local,) displacement, m.

        Raises:
            ConvergenceError: a load step below the smallest one failed.
        """
        rest = np.zeros(self.local)
        with closing(Statics(self, self.factor, overwrite=False)) as statics:
            if guess is None:
                return statics.follow(rest, rest, load, 0.0, pressed=0.0)
            return statics.follow(guess, self.residual(guess, rest), load)

    def load_path(self, force: Array, parts: Iterable[float], tolerance: float) -> Array:
        """Equilibria (local, k) under the static loads and k increasing parts of a force (local,).

        Args:
            force: (local,) N.
            parts: (k,) parts of the force, all above zero.
            tolerance: error in the energy norm, relative to the deflection.

        Raises:
            ConvergenceError: a load step below the smallest one failed.
        """
        rest = self.rest_force - self.pressure_force(self.equilibrium)
        found, at = [self.equilibrium], [0.0]
        with closing(Statics(self, self.factor, overwrite=False, tolerance=tolerance)) as statics:
            for part in parts:
                begin = rest + at[-1] * force
                known = at[-EXTRAPOLATED:]
                weights = interpolation_weights(known, part)
                ahead = np.array(found[-EXTRAPOLATED:]).T @ weights
                found.append(statics.follow(found[-1], begin, rest + part * force, predicted=ahead))
                at.append(part)
        return np.array(found[1:]).T

    def spin(self, omega: float) -> None:
        """Set another angular velocity (rad/s); update the equilibrium, K, its factor, G and C.

        Raises:
            ConvergenceError: no equilibrium was found at this speed.
        """
        assert self.rotation is not None
        square = self.rotation.omega_squared
        _ = self.factor, self.gyroscopic  # of the speed so far, if they were not made yet
        self.rotation.set_speed(omega)
        if self.joined:
            self._bring_together()
            vars(self).pop("stiffness", None)
        else:
            self._move(self.equilibrium, self.static_load, square)
        if self.gyroscopic is not None:
            self.gyroscopic.destroy()
        self.gyroscopic = self.rotation.gyroscopic()
        self._forget_damping()

    def _forget_damping(self) -> None:
        """Forget the damping of the equilibrium so far. Collective."""
        vars(self).pop("viscous", None)
        if (matrix := vars(self).pop("strain_stiffness", None)) is not None:
            matrix.destroy()

    def load_moments(self, block: Array) -> Array:
        """The moment of each unit load about the axis of rotation, with the loads on supports.

        Args:
            block: (local, k) displacements.

        Returns:
            (loads, 1 + k) the moments on the undeformed body, and their derivatives by the block.
        """
        assert self.rotation is not None
        found = self.rotation.moments(self._assembled_loads(), block)
        return np.asarray(self.comm.allreduce(found))

    def unload(self) -> None:
        """Take the undeformed body at rest in place of the equilibrium, for polynomials about it.

        K, its factor and the damping stay those of the last equilibrium.
        """
        assert self.rotation is not None
        if self._damping.stiffness > 0.0:
            _ = self.strain_stiffness
        self.rotation.set_speed(0.0)
        self.equilibrium = np.zeros(self.local)
        if self.gyroscopic is not None:
            self.gyroscopic.destroy()
            self.gyroscopic = None
        self._set_follower_loads()

    def _move(
        self,
        u: Array,
        start: Array,
        square: float,
        pressed: float | None = None,
        predicted: Array | None = None,
    ) -> None:
        """Follow the equilibrium u (local,) from a load (local,), Ω² and part of the pressures.

        K, its factor and the load vectors follow. A predicted state (local,) needs a factor there.

        Raises:
            ConvergenceError: no equilibrium was found.
        """
        self._forget_damping()
        with closing(Statics(self, self.factor, overwrite=self.symmetric)) as statics:
            if predicted is not None and not statics.renew(predicted):
                predicted = None
            load = self.static_load
            self.equilibrium = statics.follow(u, start, load, square, predicted, pressed)
            statics.finish(self.equilibrium, load)
        if not self.symmetric:
            self._renew(self.factor)
        self._set_follower_loads()

    def _renew(self, factor: AnyFactor) -> None:
        """Make a factor that of the symmetric part of the tangent at the equilibrium."""
        self.tangent(self.equilibrium, factor.matrix)
        factor.update()


def solid_of(
    scene: Scene, mesh: Mesh, known: KnownEquilibrium | None = None, free: bool = False
) -> Solid:
    """Build the solid of a scene on a mesh; arguments and errors as `Solid`.

    The likely cause of implausible numbers is a warning, and part of a failure.

    Args:
        scene: the scene.
        mesh: the mesh.
        known: as `Solid`.
        free: whether rigid motions may be left that nothing holds.

    Raises:
        SceneError: the mesh has another dimension than the scene, or nothing holds the body.
    """
    dimension, found = scene.geometry.dimension, mesh.domain.topology.dim
    if dimension != found:
        where = Where(scene.source, "geometry.dimension")
        raise where.refuse(dimension, f"{mesh.source} has dimension {found}", ErrorKind.MISMATCH)
    suspicious = implausible_inputs(scene, mesh)
    try:
        found = Solid(mesh, scene, known)
    except ConvergenceError as error:
        if not suspicious:
            raise
        cause = f"{error}; {suspicious[0]}"
        raise ConvergenceError(cause, error.partial, kind=error.kind) from None
    if not free:
        require_held(found, "this command")
    found.warnings += suspicious or implausible_normals(scene, mesh, found.points)
    return found


def build_solid(scene: Scene, comm: MPI.Comm) -> Solid:
    """Make or read the mesh of a scene, and build its solid; errors as `build_mesh` and `Solid`."""
    return solid_of(scene, build_mesh(scene.geometry, comm))
