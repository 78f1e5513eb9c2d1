"""The types of what the reduction needs of a structure.

`fenicsrom.fem.solid.solid.Solid` (a mesh on dolfinx, possibly distributed) and
`fenicsrom.reduction.beam.BeamStructure` (dense matrices) satisfy `Structure`. The reduction knows
no other interface, so it runs and is tested without dolfinx.

Vectors hold the unknowns that this rank owns: shape (local,), or (local, k) for k columns.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Protocol

from fenicsrom.arrays import Array
from fenicsrom.notes import Note
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.model.bolts import Bolts
from fenicsrom.online.model.loads import LoadHistories, PressurePolynomial
from fenicsrom.online.model.polynomial import ElasticPolynomial

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class Inverse(Protocol):
    """The inverse of a stiffness matrix."""

    def solve(self, block: Array) -> Array:
        """The inverse times the columns of a block (local, k)."""


class Structure(Protocol):
    """A clamped elastic structure in a static equilibrium, with its loads and contact points.

    Attributes:
        source: name of the scene file, for messages.
        warnings: notes for the user; the reduction appends to them.
        comm: communicator of the ranks that share the structure.
        dimension: d, 2 or 3.
        local: number of unknowns that this rank owns, clamped ones included.
        free: global number of unknowns that no support clamps.
        gauss_points: number of Gauss points that integrate the elastic force along a time step.
        geometrically_nonlinear: False for small displacements.
        mass_damping: α of the damping C = α M, 1/s.
        factor: K⁻¹ at the equilibrium.
        gyroscopic: the gyroscopic matrix G of the Coriolis force −G u̇, or None without this force.
        viscous: the damping besides α M.
        equilibrium: (local,) displacement u₀ under the static loads, m.
        rest_force: (local,) internal force at the equilibrium, N.
        load_vectors: (local, loads) load vectors of unit loads.
        load_histories: time factors of the loads.
        excitation: the highest frequency that the scene excites, Hz.
        points: the contact points.
        contact_rows: sparse Bᵀ (m, local): contact displacements in the local frames [normal,
            tangents].
        interface: (m, k) combinations of contact forces that give the static modes, the most
            important ones first; None: `basis.masters` chooses.
        deflections: (local, k) nonlinear static deflections of the first of several bases, or None.
        probe_rows: (d, local) displacement of the probe.
        bolts: the bolts, which move apart by rows (b, d, local) of the displacements.
    """

    source: str
    warnings: list[Note]
    local: int
    free: int
    geometrically_nonlinear: bool
    mass_damping: float
    equilibrium: Array
    load_vectors: Array
    load_histories: LoadHistories
    excitation: float
    points: ContactPoints
    contact_rows: csr_array
    interface: Array | None
    deflections: Array | None
    probe_rows: Array
    bolts: Bolts

    @property
    def comm(self) -> Any:
        """The MPI communicator, or a `fenicsrom.reduction.beam.SerialCommunicator`."""

    @property
    def dimension(self) -> int:
        """d, 2 or 3."""

    @property
    def gauss_points(self) -> int:
        """Gauss points along a time step."""

    @property
    def symmetric(self) -> bool:
        """Whether the stiffness is symmetric; otherwise `factor` is that of its symmetric part."""

    @property
    def shifting_forces(self) -> Array:
        """Forces (local, k) that move the equilibrium if bolts or contacts change, N."""

    @property
    def factor(self) -> Inverse:
        """K⁻¹ at the equilibrium."""

    @property
    def rest_force(self) -> Array:
        """(local,) internal force at the equilibrium, N."""

    @property
    def gyroscopic(self) -> Any:
        """The gyroscopic matrix G, or None."""

    @property
    def viscous(self) -> Any:
        """The `fenicsrom.reduction.damping.ViscousDamping` besides α M."""

    def inner(self, a: Array, b: Array) -> Array:
        """Inner products aᵀ b over all ranks of two blocks (local, k) and (local, l): (k, l)."""

    def mass_inner(self, a: Array, b: Array) -> Array:
        """Mass inner products aᵀ M b over all ranks of two blocks: (k, l)."""

    def mass_times(self, block: Array) -> Array:
        """M times a block (local, k)."""

    def stiffness_times(self, block: Array) -> Array:
        """K at the equilibrium times a block (local, k)."""

    def strain_stiffness_times(self, block: Array) -> Array:
        """The part of K that comes from strains and springs, times a block (local, k)."""

    def held_times(self, block: Array) -> Array:
        """The matrix of which `factor` is the inverse, times a block (local, k)."""

    def gyroscopic_times(self, block: Array) -> Array:
        """G times a block (local, k), where the Coriolis force acts."""

    def coupled(self, matrix: csr_array, block: Any) -> Any:
        """A sparse matrix (local, size) times a block (local, k) of all ranks."""

    def internal_force(self, u: Array) -> Array:
        """Internal force (local,) at a displacement u (local,), N."""

    def tangent_times(self, u: Array, block: Array) -> Array:
        """Tangent stiffness at a displacement u (local,) times a block (local, k)."""

    def energy(self, u: Array) -> float:
        """Potential energy of the internal force at a displacement u (local,), J."""

    def tangent_derivative(self, x: Array, y: Array) -> Array:
        """K′[x] y (local,) at the equilibrium, exact if the structure has an exact derivative."""

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K′[x] y (local,) at the equilibrium by central differences of the tangent."""

    def elastic_polynomial(self, vectors: Array) -> ElasticPolynomial:
        """The internal force projected on vectors (local, n), as an exact cubic polynomial.

        Raises:
            SceneError: the internal force of this structure is not a polynomial.
        """

    def pressure_polynomial(self, vectors: Array) -> PressurePolynomial:
        """The follower pressures on vectors (local, n), as exact quadratic polynomials."""

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (local, count)."""

    def load_path(self, force: Array, parts: Iterable[float], tolerance: float) -> Array:
        """Equilibria (local, k) under the static loads and k increasing parts of a force (local,).

        `tolerance` bounds the error in the energy norm, relative to the deflection.

        Raises:
            ConvergenceError: an equilibrium was not found.
        """

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of a node in each column of a block (local, k)."""

    def translations(self) -> Array:
        """(local, d) unit translations along the axes."""
