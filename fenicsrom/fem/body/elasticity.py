"""A clamped body of St Venant-Kirchhoff material on dolfinx: forms and their assembly.

With the displacement gradient ∇u, the deformation gradient F = I + ∇u, the Green-Lagrange strain
and the second Piola-Kirchhoff stress

    E = sym ∇u + ½ ∇uᵀ ∇u,    S = λ tr(E) I + 2 μ E  or  S = C E,    (1)

the internal force f, its tangent K and the derivative of the tangent along x are

    v · f(u)      = ∫ (F S) : ∇v,    (2)
    v · K w       = ∫ (∇w S + F S_w) : ∇v,                    S_w = S(sym Fᵀ ∇w),    (3)
    v · K′[x] y   = ∫ (∇x S_y + ∇y S_x + F S_xy) : ∇v,        S_xy = S(sym ∇xᵀ ∇y),    (4)

where S(E) is the stress of the strain E. The mixed tangent at u after a change c of u has

    S(E − ½ ∇cᵀ ∇c)    (5)

in place of S in (3): the stress of the strain that was predicted before the change. Newton's method
for independent stresses at the integration points has this tangent. With this tangent, Newton's
method converges from states far away, because the stretching by too large a rotation does not
enter. Source: Magisano, Leonetti and Garcea, Int. J. Numer. Methods Eng., 2017.

Plane stress replaces λ by λ* = 2 λ μ / (λ + 2 μ), which is exact for this material.

Vectors are numpy arrays of the unknowns that this rank owns, zero on the clamped ones. The clamped
rows of K are those of the identity; the clamped rows of M are zero.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import basix.ufl
import dolfinx.fem.petsc
import numpy as np
import numpy.typing as npt
import scipy.sparse
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_array, diags_array, eye_array
from scipy.spatial import cKDTree

from fenicsrom.arrays import Array
from fenicsrom.fem.base.forms import compiled_expression, compiled_form, quadrature_degree
from fenicsrom.fem.base.linalg import Factorisation, FreeFactorisation, add_entries
from fenicsrom.fem.body.cyclic import CutFaces, WaveFactorisation
from fenicsrom.fem.body.materials import Materials
from fenicsrom.fem.body.rotation import Inertia, RotatingFrame
from fenicsrom.fem.body.supports import Held, Slanted, conditions, held_displacements
from fenicsrom.fem.mesh.mesh import Mesh
from fenicsrom.fem.mesh.named_groups import require_groups
from fenicsrom.fem.mesh.picking import ROUNDING
from fenicsrom.notes import Note, NoteKind, note_of
from fenicsrom.online.model.bolts import no_bolts
from fenicsrom.scene import Scene

AnyFactor = Factorisation | FreeFactorisation | WaveFactorisation


class Joint(NamedTuple):
    """Contact points as springs, which add the force B k (Bᵀu − x_ref).

    Attributes:
        body: the body. Every method is collective.
        rows: sparse Bᵀ (m, local).
        springs: (m,) k, N/m.
        reference: (m,) x_ref, m.
    """

    body: Any
    rows: csr_array
    springs: Array
    reference: Array

    def force(self, u: Array) -> Array:
        """The force (local,) at a displacement u (local,), N."""
        moved = self.body.comm.allreduce(self.rows @ u)
        return np.asarray(self.rows.T @ (self.springs * (moved - self.reference)))

    @property
    def stiffness(self) -> csr_array:
        """B k Bᵀ, sparse (local, size)."""
        return self.body.product(self.rows, diags_array(self.springs))

    @property
    def directions(self) -> csr_array:
        """The stiffness if all springs had 1 N/m: it tells what they hold."""
        return self._replace(springs=np.sign(self.springs)).stiffness

    def tangent(self, u: Array, symmetric: bool) -> csr_array:
        """The derivative of `force`, sparse (local, size); it is the same at all u (local,)."""
        return self.stiffness


CHUNK_BYTES = 50e6
"""Memory of one chunk of tabulated gradients; each chunk copies all fields to their functions."""


class ElasticBody:
    """A clamped body, its forms and their assembly.

    Attributes:
        mesh: the mesh.
        geometry: dimension, degree, thickness and plane state.
        material: the material of the cells without a material of their group.
        source: name of the scene file, for messages.
        comm: the communicator.
        space: the displacement space.
        size: global number of unknowns, clamped ones included.
        local: number of unknowns that this rank owns, clamped ones included.
        free: global number of unknowns that no support clamps.
        supports: the supports.
        clamped: (c,) local numbers of the clamped unknowns that this rank owns.
        conditions: the boundary conditions of the clamped unknowns.
        slanted: the projection of nodes that are held along slanted directions; None without such
            nodes.
        cut: the cut faces of a sector of a disk; None of a whole body.
        thickness: thickness in m, as a coefficient of the forms; 1 in 3D.
        quadrature_degree: degree of the quadrature rule.
        dx: the volume measure.
        materials: the materials of the cells.
        density: mass per volume, or per area in 2D, as a coefficient of the forms.
        inertia: the matrices of inertia forces.
        first: global number of the first unknown that this rank owns.
        couplings: sparse, symmetric stiffness of springs and bolts, N/m: (local, size), the rows
            of this rank.
        bolts: the bolts, which move apart by rows (b, d, local) of the displacements.
        tension: (local,) their force on the undeformed body, N.
        joint: contacts between bodies as springs (on a path of equilibria, with friction), in
            `residual` and `tangent` only; None without.
        room: sparse (local, size); the tangent has its entries besides those of the forms; None.
        point_masses: (local,) concentrated mass at each unknown, kg.
        mass: M.
        rigid: (local, r) mass-orthonormal rigid motions that nothing holds.
        pressures: the follower pressures, a `fenicsrom.fem.body.loads.FollowerPressures`.
        dashpots: sparse, symmetric (local, size) damping matrix of the dashpots, N s/m.
        warnings: sentences for the user.
    """

    pressures: Any
    mass: PETSc.Mat
    rigid: Array

    def __init__(self, mesh: Mesh, scene: Scene):
        """Clamp the supports and compile the forms.

        Raises:
            SceneError: the mesh lacks a group of the scene, or a support holds nothing.
        """
        self.mesh, self.source = mesh, scene.source
        self.geometry, self.material = scene.geometry, scene.material
        self.comm = mesh.domain.comm
        require_groups(mesh, scene)
        self.warnings = [*map(note_of, mesh.warnings)]
        if self.geometry.degree == 1:
            text = (
                "linear elements lock in bending: frequencies may be several times too high (use "
                "geometry.degree = 2)"
            )
            self.warnings.append(Note(NoteKind.WARNING, text, "geometry.degree"))
        element = basix.ufl.element(
            "Lagrange", mesh.domain.basix_cell(), self.geometry.degree, shape=(self.dimension,)
        )
        self.space = fem.functionspace(mesh.domain, element)
        dofmap = self.space.dofmap
        bs = dofmap.index_map_bs
        self.local = dofmap.index_map.size_local * bs
        self.size = dofmap.index_map.size_global * bs
        self.first = dofmap.index_map.local_range[0] * bs
        held = held_displacements(mesh, self.space, scene.supports, scene.source)
        self.supports = scene.supports
        if mesh.sector and not scene.cyclic and not self._uses(scene, held, *mesh.sector.places):
            self.warnings.append(mesh.sector.note)
        self._zero = fem.Function(self.space)
        self.conditions = conditions(self.space, self._zero, held.unknowns)
        self.clamped = held.unknowns[held.unknowns < self.local]
        self.free = self.size - int(self.comm.allreduce(self.clamped.size))
        self.slanted: Slanted | None = None
        if self.comm.allreduce(held.nodes.size):
            self.slanted = Slanted(self.space, held)
            self.free -= self.slanted.rank
        self.materials = Materials(mesh, scene)
        self.cut = None if scene.cyclic is None else CutFaces(self, scene.cyclic)
        self.couplings, self.tension = csr_array((self.local, self.size)), np.zeros(self.local)
        self.dashpots = self.couplings.copy()
        self.bolts = no_bolts(self.dimension, self.local)
        self.joint: Any = None
        self.room: csr_array | None = None
        self.point_masses = np.zeros(self.local)
        self._compile_forms()
        self.inertia = Inertia(self)
        self._turning = scene.rotation

    def _uses(self, scene: Scene, held: Held, *faces: Array) -> bool:
        """Whether supports, a load or a contact have most corners (n, 3) of a face. Collective."""
        places = [one.place for one in (*scene.loads, *scene.contacts) if one.place is not None]
        regions = [place for place in places if place.group or place.box or place.plane]
        nodes = [self.mesh.nodes(region, self.space) for region in regions]
        nodes.append(np.union1d(held.unknowns // self.dimension, held.nodes))
        near = ROUNDING * self.mesh.extent()
        for corners in faces:
            for x in (self.space.tabulate_dof_coordinates()[chosen] for chosen in nodes):
                touched = np.zeros(len(corners), dtype=bool)
                if len(x):
                    touched = cKDTree(x).query(corners)[0] <= near
                if np.mean(np.any(self.comm.allgather(touched), axis=0)) >= 0.5:
                    return True
        return False

    @property
    def springs(self) -> Array:
        """(local,) stiffness of the springs at each unknown, N/m."""
        return np.asarray(self.couplings.diagonal(self.first))

    @property
    def held_matrix(self) -> csr_array:
        """Sparse (local, local) projection on the displacements that the supports hold."""
        found = np.zeros(self.local)
        found[self.clamped] = 1.0
        held = csr_array(diags_array(found))
        return held if self.slanted is None else csr_array(held + self.slanted.blocks)

    @property
    def extent(self) -> float:
        """Largest extent of the undeformed body along an axis, m. Collective."""
        return self.mesh.extent()

    @property
    def dimension(self) -> int:
        """Dimension d of space, 2 or 3."""
        return self.geometry.dimension

    def constant(self, value: Any) -> fem.Constant:
        """A number or vector of the forms; a form is compiled once for all values."""
        return fem.Constant(self.mesh.domain, np.asarray(value, dtype=np.float64))

    def _compile_forms(self) -> None:
        """Compile the forms (2) to (4), the energy and the mass."""
        domain, d = self.mesh.domain, self.dimension
        # the rule is that of quadratic displacements
        self.quadrature_degree = quadrature_degree(domain) + 2 * max(0, self.geometry.degree - 2)
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": self.quadrature_degree})
        self._u = fem.Function(self.space)
        self._x, self._y = fem.Function(self.space), fem.Function(self.space)
        self._change = fem.Function(self.space)
        self._out = fem.Function(self.space)
        trial, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        stress, self.density = self.materials.stress(), self.materials.density_field()
        self.thickness = self.materials.thickness_field()
        gradient, identity = ufl.grad(self._u), ufl.Identity(d)
        f = identity + gradient
        strain = ufl.sym(gradient) + 0.5 * gradient.T * gradient
        s = stress(strain)
        dg, dv = ufl.grad(trial), ufl.grad(test)
        gx, gy = ufl.grad(self._x), ufl.grad(self._y)
        sx, sy = stress(ufl.sym(f.T * gx)), stress(ufl.sym(f.T * gy))
        sxy = stress(ufl.sym(gx.T * gy))
        gc = ufl.grad(self._change)
        predicted = stress(strain - 0.5 * gc.T * gc)
        self._force_form = compiled_form(ufl.inner(f * s, dv) * self.dx)
        self._weight = self.constant(1.0)
        stretched = f * stress(ufl.sym(f.T * dg))
        self._tangent_form = compiled_form(
            self._weight * ufl.inner(dg * predicted + stretched, dv) * self.dx
        )
        self._strain_integrand = ufl.inner(stretched, dv) * self.dx
        self._energy_form = compiled_form(0.5 * ufl.inner(s, strain) * self.dx)
        self._derivative_form = compiled_form(ufl.inner(gx * sy + gy * sx + f * sxy, dv) * self.dx)

    @cached_property
    def rotation(self) -> RotatingFrame | None:
        """The rotating frame of the body with its masses, or None without rotation."""
        if self._turning is None:
            return None
        return RotatingFrame(self, self._turning)

    def matrix(self, form: fem.Form, diagonal: float) -> PETSc.Mat:
        """Assemble a bilinear form, with `diagonal` on the diagonal of the clamped rows."""
        matrix = fem.petsc.create_matrix(form)
        self._assemble(matrix, form, diagonal)
        return matrix

    def _assemble(self, matrix: PETSc.Mat, form: fem.Form, diagonal: float) -> None:
        """Assemble a bilinear form into a zero matrix."""
        fem.petsc.assemble_matrix(matrix, form, self.conditions, diagonal)
        matrix.assemble()
        if self.slanted is not None:
            self.slanted.project_matrix(matrix, diagonal)

    def set_field(self, function: fem.Function, values: Array) -> None:
        """Set the values (local,) of a function, and its ghost values."""
        function.x.array[: self.local] = values
        function.x.scatter_forward()

    def _vector(self, form: fem.Form) -> Array:
        """Assemble a linear form (local,), without the part that the supports hold."""
        return self.without_held(self.assembled(form))

    def without_held(self, block: Array) -> Array:
        """Remove from a block (local,) or (local, k) the part that the supports hold, in place."""
        block[self.clamped] = 0.0
        if self.slanted is not None:
            self.slanted.project(block)
        return block

    def assembled(self, form: fem.Form) -> Array:
        """Assemble a linear form (local,), the clamped unknowns included."""
        self._out.x.array[:] = 0.0
        fem.assemble_vector(self._out.x.array, form)
        self._out.x.scatter_reverse(dolfinx.la.InsertMode.add)
        return self._out.x.array[: self.local].copy()

    def field(self, values: Array) -> fem.Function:
        """A displacement field with the values (local,), its ghost values up to date."""
        function = fem.Function(self.space)
        self.set_field(function, values)
        return function

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors (local,) over all ranks."""
        return float(self.comm.allreduce(float(np.dot(a, b))))

    def inner(self, a: Array, b: Array) -> Array:
        """Inner products aᵀ b (k, l) over all ranks of two blocks (local, k) and (local, l)."""
        return np.asarray(self.comm.allreduce(a.T @ b))

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of a node in each column of a block, over all ranks."""
        nodes = block.reshape(-1, self.dimension, block.shape[1])
        mine = np.max(np.linalg.norm(nodes, axis=1), axis=0, initial=0.0)
        return np.max(self.comm.allgather(mine), axis=0)

    @property
    def own(self) -> csr_array:
        """Sparse (local, size): the unknowns of this rank among those of all ranks."""
        return csr_array(eye_array(self.local, self.size, k=self.first))

    def product(self, rows: csr_array, middle: Any) -> csr_array:
        """Rᵀ A R, sparse (local, size), of rows R (m, local) of all ranks and A (m, m). Collective.

        R u is the sum over the ranks of their rows times what they own of u.
        """
        every = scipy.sparse.hstack(self.comm.allgather(rows)) if self.comm.size > 1 else rows
        return csr_array(rows.T @ csr_array(middle) @ every)

    def coupled(self, matrix: csr_array, block: Any) -> Any:
        """A sparse matrix (local, size) times a vector or block of all ranks. Collective.

        The block (local,) or (local, k) may be sparse. The ranks exchange what the matrix uses.
        """
        if self.comm.size == 1:
            return matrix @ block
        used = np.unique(np.concatenate(self.comm.allgather(np.unique(matrix.indices))))
        mine = used[(used >= self.first) & (used < self.first + self.local)] - self.first
        join = scipy.sparse.vstack if scipy.sparse.issparse(block) else np.concatenate
        return matrix[:, used] @ join(self.comm.allgather(block[mine]))

    def translations(self) -> Array:
        """(local, d) unit translations along the axes."""
        return np.tile(np.eye(self.dimension), (self.local // self.dimension, 1))

    def mass_matrix(self, diagonal: float) -> PETSc.Mat:
        """M, with `diagonal` on the diagonal of the clamped rows, kg."""
        return self.inertia.matrix(np.eye(self.dimension), diagonal)

    def internal_force(self, u: Array) -> Array:
        """Internal force (2) minus the centrifugal force at a displacement u: (local,), N."""
        self.set_field(self._u, u)
        force = self._vector(self._force_form) + self.coupled(self.couplings, u) - self.tension
        return force if self.rotation is None else force - self.rotation.centrifugal_force(u)

    @property
    def symmetric(self) -> bool:
        """Whether no static follower pressure acts, whose tangent may not be symmetric."""
        return not self.pressures.acts

    def residual(self, u: Array, load: Array) -> Array:
        """Internal force at u (local,) minus a load (local,) and the static follower pressures.

        The force of the `joint` is added.
        """
        residual = self.internal_force(u) - load - self.pressure_force(u)
        return residual if self.joint is None else residual + self.joint.force(u)

    def pressure_force(self, u: Array) -> Array:
        """Force (local,) of the static follower pressures at a displacement u (local,), N."""
        return np.asarray(self.pressures.static_force(u))

    def tangent(
        self,
        u: Array,
        matrix: PETSc.Mat | None = None,
        change: Array | None = None,
        *,
        symmetric: bool = True,
        joined: bool = True,
    ) -> PETSc.Mat:
        """Tangent stiffness (3) at a displacement u (local,), N/m: the derivative of `residual`.

        Args:
            u: (local,).
            matrix: a matrix that is overwritten; a new one by default.
            change: (local,) the last change of u gives the mixed tangent (5).
            symmetric: take the symmetric part of the tangent of the static follower pressures, and
                constant limits of friction.
            joined: add the springs of the `joint`.
        """
        self.set_field(self._u, u)
        if change is not None:
            self.set_field(self._change, change)
        if matrix is None:
            matrix = self.with_room(self.matrix(self._tangent_form, 1.0))
        else:
            matrix.zeroEntries()
            self._assemble(matrix, self._tangent_form, 1.0)
        self._change.x.array[:] = 0.0
        add_entries(matrix, self.couplings)
        if joined and self.joint is not None:
            add_entries(matrix, self.joint.tangent(u, symmetric))
        if self.rotation is not None:
            self.rotation.add_spin_softening(matrix, 1.0)
        factors = self.pressures.part * self.pressures.static
        self.pressures.add_tangent(matrix, u, factors, symmetric=symmetric)
        return matrix

    def with_room(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """Give an assembled matrix the entries of the couplings and of contacts between bodies."""
        if self.room is not None:
            starts, columns = (
                a.astype(PETSc.IntType) for a in (self.room.indptr, self.room.indices)
            )
            empty = PETSc.Mat().createAIJ(
                ((self.local, self.size),) * 2,
                csr=(starts, columns, np.zeros(self.room.nnz)),
                comm=self.comm,
            )
            matrix.axpy(1.0, empty, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            empty.destroy()
        return matrix

    def factorised(self, matrix: PETSc.Mat, prefix: str, symmetric: bool = True) -> AnyFactor:
        """Factorise a stiffness matrix. Collective.

        The loads of a sector are alike on all sectors. For a free body, the factors give its
        deformation without a rigid part. Arguments and errors as `Factorisation`.
        """
        if self.cut is not None:
            return WaveFactorisation(self, matrix, prefix, symmetric)
        if self.rigid.shape[1]:
            return FreeFactorisation(matrix, self.rigid, self.mass, prefix)
        return Factorisation(matrix, prefix, symmetric)

    def add_form(self, matrix: PETSc.Mat, form: fem.Form) -> None:
        """Add a bilinear form to an assembled matrix, which has all entries of the form."""
        if self.slanted is None:
            fem.petsc.assemble_matrix(matrix, form, self.conditions, 1.0)
            # finish the assembly: PETSc would drop values that are added after the diagonal was
            # inserted
            matrix.assemble()
        else:
            added = matrix.duplicate()
            self._assemble(added, form, 1.0)
            matrix.axpy(1.0, added, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
            added.destroy()

    def add_tangent(self, matrix: PETSc.Mat, u: Array, weight: float) -> None:
        """Add `weight` times the tangent stiffness at a displacement u (local,) to a matrix."""
        self.set_field(self._u, u)
        self._weight.value = weight
        self.add_form(matrix, self._tangent_form)
        self._weight.value = 1.0
        add_entries(matrix, weight * self.couplings)
        if self.rotation is not None:
            self.rotation.add_spin_softening(matrix, weight)

    def energy(self, u: Array) -> float:
        """Elastic energy at a displacement u (local,) plus the centrifugal potential, J.

        The centrifugal potential of the undeformed body is zero.
        """
        self.set_field(self._u, u)
        own = float(fem.assemble_scalar(self._energy_form))
        own += float(u @ (0.5 * self.coupled(self.couplings, u) - self.tension))
        energy = float(self.comm.allreduce(own))
        return energy if self.rotation is None else energy + self.rotation.energy(u)

    def derivative_at(self, u: Array, x: Array, y: Array) -> Array:
        """K′[x] y of (4) at a displacement u (local,), for x and y (local,): (local,)."""
        self.set_field(self._u, u)
        self.set_field(self._x, x)
        self.set_field(self._y, y)
        return self._vector(self._derivative_form)

    def owned_cells(self) -> npt.NDArray[np.int32]:
        """Local numbers of the cells that this rank owns."""
        topology = self.mesh.domain.topology
        return np.arange(topology.index_map(topology.dim).size_local, dtype=np.int32)

    def quadrature_points(self, degree: int) -> Array:
        """Places (k, d) of the quadrature points of the owned cells, as `tabulate` orders them."""
        domain = self.mesh.domain
        points, _ = basix.make_quadrature(domain.basix_cell(), degree)
        place = compiled_expression(ufl.SpatialCoordinate(domain), points)
        cells = self.owned_cells()
        if not cells.size:
            return np.zeros((0, self.dimension))
        return np.asarray(place.eval(domain, cells)).reshape(-1, self.dimension)

    def tabulate(
        self,
        fields: Array,
        about: Array,
        degree: int | None = None,
        cells: npt.NDArray[np.int32] | None = None,
    ) -> Iterator[tuple[Array, Array]]:
        """Tabulate displacement gradients at the quadrature points, in chunks of cells. Collective.

        All ranks must take all chunks; a rank may have fewer chunks than another rank, or none.

        Args:
            fields: (local, n) displacement fields.
            about: (local,) one more displacement, which comes first.
            degree: degree of the quadrature rule; by default that of the forms.
            cells: local numbers of the cells; by default all that this rank owns.

        Yields:
            Quadrature weights (k,), thickness included, in m³, and gradients (k, 1 + n, d, d).
        """
        domain, d = self.mesh.domain, self.dimension
        degree = self.quadrature_degree if degree is None else degree
        points, weights = basix.make_quadrature(domain.basix_cell(), degree)
        gradient = compiled_expression(ufl.grad(self._x), points)
        volume = compiled_expression(abs(ufl.JacobianDeterminant(domain)), points)
        cells = self.owned_cells() if cells is None else cells
        n = fields.shape[1]
        chunk = max(1, int(CHUNK_BYTES / (8 * (1 + n) * d * d * weights.size)))
        # every rank sets the fields equally often, because their ghost values are exchanged
        parts = self.comm.allreduce(-(-cells.size // chunk), op=MPI.MAX)
        for start in range(0, parts * chunk, chunk):
            part = cells[start : start + chunk]
            gradients = np.empty((part.size * weights.size, 1 + n, d, d))
            for k in range(1 + n):
                self.set_field(self._x, about if k == 0 else fields[:, k - 1])
                if part.size:
                    gradients[:, k] = np.asarray(gradient.eval(domain, part)).reshape(-1, d, d)
            if part.size:
                detj = np.asarray(volume.eval(domain, part)).reshape(part.size, weights.size)
                thickness = self.materials.thickness[self.materials.number[part], None]
                yield (thickness * detj * weights).reshape(-1), gradients

    def tabulated(self, fields: Array, about: Array, **rule: Any) -> tuple[Array, Array]:
        """All chunks of `tabulate` together: weights (k,) and gradients (1 + n, k, d, d)."""
        chunks = list(self.tabulate(fields, about, **rule))
        none = np.zeros((0, 1 + fields.shape[1], self.dimension, self.dimension))
        weights = np.concatenate([np.zeros(0), *(weights for weights, _ in chunks)])
        return weights, np.concatenate([none, *(values for _, values in chunks)]).swapaxes(0, 1)
