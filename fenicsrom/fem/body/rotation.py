"""Inertia forces of a body, at rest and in a rotating frame.

The frame has the angular velocity Ω e and passes through the point a. With P = I − e eᵀ, the body
at X + u has the centrifugal potential

    V(u) = −½ Ω² ∫ ρ |P (X + u − a)|² = V(0) − Ω² (c · u + ½ u · Q u),    (1)
    c · v = ∫ ρ P (X − a) · v,    v · Q u = ∫ ρ P u · v.    (2)

The centrifugal force Ω² (c + Q u) is a load with spin softening by Q. The Coriolis force is −G u̇
with

    v · G w = 2 Ω ∫ ρ v · (e × w),    (3)

which is skew, so the force does no work. Where the speed varies, the Euler force
−dΩ/dt (g + ½ G u/Ω) acts, with

    v · g = ∫ ρ v · (e × (X − a)),    J₀ = ∫ ρ |P (X − a)|²,    (4)

and J₀ the moment of inertia about the axis. The integrals contain concentrated masses, too. For a
beam: Wright et al., J. Appl. Mech. 49, 1982.

The density is the same in all directions, so that every matrix of inertia forces is a Kronecker
product of the mass matrix m of one component with a small matrix A between the components,

    m ⊗ A,    m_kl = ∫ ρ φ_k φ_l + δ_kl m_k,    (5)

with concentrated masses m_k, and with A = I for the mass matrix. The rotating frame has others.
The pattern of (5) is part of that of a stiffness matrix, which couples all components of two nodes.
"""

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.base.linalg import add_to_diagonal, multiply
from fenicsrom.scene import Rotation


class Inertia:
    """The matrix m of (5), and the matrices that follow from it.

    Attributes:
        form: the form of m.
    """

    def __init__(self, body: Any):
        """Assemble m of a `fenicsrom.fem.body.elasticity.ElasticBody`, without point masses."""
        space = body.space
        # the nodes of this space and of the displacement space have the same numbers
        scalar = fem.functionspace(space.mesh, space.ufl_element().sub_elements[0])
        trial, test = ufl.TrialFunction(scalar), ufl.TestFunction(scalar)
        self.form = compiled_form(body.density * (trial * test) * body.dx)
        matrix = assemble_matrix(self.form)
        matrix.assemble()
        starts, columns, values = matrix.getValuesCSR()
        size = matrix.getLocalSize()[0], matrix.getSize()[1]
        self._nodes = scipy.sparse.csr_array((values, columns, starts), shape=size)
        matrix.destroy()
        self._comm, self._clamped, self._slanted = body.comm, body.clamped, body.slanted

    def add_point_masses(self, masses: Array) -> None:
        """Add concentrated masses (nodes,) of the nodes of this rank to m, kg."""
        first = self._comm.exscan(masses.size) or 0
        places = np.arange(masses.size)
        self._nodes = self._nodes + scipy.sparse.csr_array(
            (masses, (places, first + places)), self._nodes.shape
        )

    def matrix(self, between: Array, diagonal: float = 0.0) -> PETSc.Mat:
        """The matrix (5), without the part that the supports hold.

        Args:
            between: (d, d) A.
            diagonal: what stands on the diagonal of the clamped rows; of nodes that are held along
                a direction, see `Slanted.project_matrix`.

        Returns:
            kg, if A has no unit.
        """
        # slanted supports couple all components of a node
        entries = between != 0.0 if self._slanted is None else np.ones_like(between)
        rows, columns = np.nonzero(entries)
        block = scipy.sparse.coo_array((between[rows, columns], (rows, columns)), between.shape)
        product = scipy.sparse.kron(self._nodes, block, format="csr")
        if self._slanted is None:
            product.eliminate_zeros()
        local, size = product.shape
        starts, columns = (a.astype(PETSc.IntType) for a in (product.indptr, product.indices))
        found = PETSc.Mat().createAIJ(
            ((local, size), (local, size)), csr=(starts, columns, product.data), comm=self._comm
        )
        free = found.createVecLeft()
        free.set(1.0)
        free.array[self._clamped] = 0.0
        found.diagonalScale(free, free)
        free.destroy()
        added = np.zeros(local)
        added[self._clamped] = diagonal
        add_to_diagonal(found, added)
        if self._slanted is not None:
            self._slanted.project_matrix(found, diagonal)
        return found


class RotatingFrame:
    """Centrifugal and Coriolis terms of a body, at any angular velocity.

    Attributes:
        omega: angular velocity Ω, rad/s.
        omega_squared: Ω² of the centrifugal force, rad²/s²; load steps vary it between two speeds.
        mass: Q of (2), the mass matrix of the motion normal to the axis, kg.
        unit_centrifugal_force: (local,) c of (2), kg m.
        point_force: (local,) the part of c by concentrated masses, kg m.
        arm: X − a of (2), a UFL expression.
    """

    def __init__(self, body: Any, rotation: Rotation):
        """Assemble c, Q and, if the scene includes the Coriolis force, G / Ω.

        Args:
            body: the `fenicsrom.fem.body.elasticity.ElasticBody`, with its concentrated masses.
            rotation: the axis and the speed.
        """
        self._body, d = body, body.dimension
        point = body.constant(rotation.point or (0.0,) * d)
        self._axis = None if rotation.axis is None else body.constant(rotation.axis)
        self.arm = ufl.SpatialCoordinate(body.mesh.domain) - point
        across, turning = np.eye(d), np.array([[0.0, -1.0], [1.0, 0.0]])
        if rotation.axis is not None:
            axis = np.array(rotation.axis)
            across, turning = across - np.outer(axis, axis), np.cross(axis, np.eye(d)).T
        self.mass = body.inertia.matrix(across)
        self._unit = body.inertia.matrix(2.0 * turning) if rotation.coriolis else None
        nodes = body.space.tabulate_dof_coordinates()[: body.local // d, :d]
        self._across, self._turning = across, 2.0 * turning
        self._arms = np.asarray(nodes - point.value).reshape(-1)
        self._test = ufl.TestFunction(body.space)
        self.point_force = self._of_masses(across, self._arms)
        self.unit_centrifugal_force = self.point_force + self._vector(
            self.out_of_axis(self.arm, self._test)
        )
        self.set_speed(rotation.omega)

    def _vector(self, integrand: Any) -> Array:
        """The vector (local,) of a linear integrand times ρ, zero on the clamped unknowns."""
        body = self._body
        form = compiled_form(body.density * integrand * body.dx)
        return np.asarray(body.without_held(body.assembled(form)))

    @property
    def matrices(self) -> list[PETSc.Mat]:
        """The matrices of the frame."""
        return [self.mass] if self._unit is None else [self.mass, self._unit]

    def out_of_axis(self, a: Any, b: Any) -> Any:
        """P a · b of two UFL vectors."""
        if self._axis is None:
            return ufl.dot(a, b)
        return ufl.dot(a - ufl.dot(self._axis, a) * self._axis, b)

    def coriolis(self, w: Any, v: Any) -> Any:
        """The integrand 2 v · (e × w) of (3) for two UFL vectors, without ρ and Ω."""
        turned = ufl.as_vector([-w[1], w[0]]) if self._axis is None else ufl.cross(self._axis, w)
        return 2.0 * ufl.dot(turned, v)

    def _of_masses(self, between: Array, block: Array) -> Array:
        """The masses m_k times A b_k of the nodes, of a block (local,) or (local, k)."""
        return np.asarray((self._body.point_masses * _at_nodes(between, block).T).T)

    def point_mass_times(self, block: Array) -> Array:
        """The part of Q times a block (local, k) by concentrated masses."""
        return self._of_masses(self._across, block)

    def point_coriolis_times(self, block: Array) -> Array:
        """The part of G / Ω times a block (local, k) by concentrated masses."""
        return self._of_masses(self._turning, block)

    @cached_property
    def unit_euler_force(self) -> Array:
        """G of (4) (local,), kg m."""
        held = self._of_masses(0.5 * self._turning, self._arms)
        return np.asarray(held + self._vector(0.5 * self.coriolis(self.arm, self._test)))

    @cached_property
    def inertia(self) -> float:
        """J₀ of (4), kg m²."""
        body, square = self._body, self.out_of_axis(self.arm, self.arm)
        spread = fem.assemble_scalar(compiled_form(body.density * square * body.dx))
        held = body.comm.allreduce(float(self._arms @ self.point_force))
        return float(body.comm.allreduce(spread)) + held

    def moments(self, forces: Array, block: Array) -> Array:
        """The moments about the axis of forces at the nodes, on this rank.

        Args:
            forces: (local, l), N.
            block: (local, k) displacements.

        Returns:
            (l, 1 + k) the moments at rest, and their derivatives along the displacements, N m.
        """
        places = np.column_stack([self._arms, block])
        return np.asarray(forces.T @ _at_nodes(0.5 * self._turning, places))

    def set_speed(self, omega: float) -> None:
        """Set the angular velocity, rad/s."""
        self.omega, self.omega_squared = omega, omega**2

    def centrifugal_force(self, u: Array) -> Array:
        """Centrifugal force (local,) at a displacement u (local,), N."""
        return self.omega_squared * (self.unit_centrifugal_force + multiply(self.mass, u))

    def mass_times(self, block: Array) -> Array:
        """Q times a block (local, k)."""
        return multiply(self.mass, block)

    def energy(self, u: Array) -> float:
        """Centrifugal potential V(u) − V(0) of (1) at a displacement u (local,), J."""
        force = self.unit_centrifugal_force + 0.5 * multiply(self.mass, u)
        return float(self._body.comm.allreduce(-self.omega_squared * float(np.dot(u, force))))

    def add_spin_softening(self, matrix: PETSc.Mat, weight: float) -> None:
        """Add `weight` times −Ω² Q, the second derivative of (1), to a tangent stiffness."""
        subset = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(-weight * self.omega_squared, self.mass, structure=subset)

    def gyroscopic(self) -> PETSc.Mat | None:
        """G of (3) at this speed, N s/m; None without the Coriolis force."""
        if self._unit is None:
            return None
        matrix = self._unit.copy()
        matrix.scale(self.omega)
        return matrix


def _at_nodes(between: Array, block: Array) -> Array:
    """A matrix (d, d) times the vector of each node in a block (local,) or (local, k)."""
    nodes = block.reshape(-1, between.shape[0], *block.shape[1:])
    return np.einsum("ij,nj...->ni...", between, nodes).reshape(block.shape)
