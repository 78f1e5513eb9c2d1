"""St Venant-Kirchhoff solid on dolfinx: mass, internal force, tangent and its directional derivative, about an equilibrium.

Strain E = sym(grad u) + grad u^T grad u / 2, stress S = lambda tr(E) I + 2 mu E, virtual work int (F S) : grad v, F = I + grad u.
Plane stress is exact for this material with lambda* = 2 lambda mu / (lambda + 2 mu). Vectors are numpy arrays of the unknowns
owned by this rank, zero on the clamped ones; clamped rows of the matrices are those of the identity in K, zero in M.
"""

from __future__ import annotations

from collections.abc import Iterator

import basix
import basix.ufl
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from fenicsrom.errors import ConvergenceError, SceneError
from fenicsrom.linalg import Factorisation, Inverse, eigenmodes, multiply
from fenicsrom.mesh import Mesh, unclamped_pieces
from fenicsrom.reduced import Signals
from fenicsrom.scene import Place, Region, Scene

Array = NDArray[np.float64]

# exact for the force and tangent of affine P2 simplices; on Q2 parallelepipeds exact for the linear stiffness, and to 1e-8 for
# the force at large displacements
QUADRATURE_DEGREE = 4
STATIC_TOLERANCE = 1e-9  # of Newton's decrement, relative to the work of the load, squared
STATIC_ITERATIONS = 25
SMALLEST_LOAD_STEP = 1e-4
CHUNK_BYTES = 200e6  # memory of one chunk of tabulated strains


class Solid:
    """A scene's body: forms, matrices about its equilibrium, places and loads.

    Attributes:
        scene: the scene.
        mesh: its mesh.
        comm: the communicator.
        space: the displacement space.
        size: global number of unknowns, clamped ones included.
        local: number of unknowns owned by this rank.
        free: global number of unknowns that no support clamps.
        first_lame: lambda (lambda* in plane stress), Pa.
        shear_modulus: mu, Pa.
        mass: M.
        stiffness: K, the tangent at the equilibrium.
        factor: K, factorised once: modes, attachments, constraints and derivatives all use it.
        equilibrium: (local,) displacement under the static loads, m.
        contact_rows: (m, local) B^T: contact displacements in the local frames [normal, tangents], point by point.
        probe_rows: (d, local) displacement of the probe in global axes.
        load_vectors: (local, loads) unit loads.
        signals: time factors of the loads.
        warnings: sentences for the user.
        gauss_points: points that integrate the elastic force exactly along a straight line: it is a cubic.
    """

    gauss_points = 2

    def __init__(self, mesh: Mesh, scene: Scene):
        """Form the matrices, find the equilibrium and factorise.

        Raises:
            SceneError: a group is missing, a piece of the body is unclamped, a place is clamped or outside.
            ConvergenceError: the static loads find no equilibrium.
        """
        self.scene, self.mesh, self.comm = scene, mesh, mesh.domain.comm
        geometry, material = scene.geometry, scene.material
        domain = mesh.domain
        d = geometry.dimension
        self.warnings = list(mesh.warnings)
        self._scratch: PETSc.Mat | None = None
        self._places: dict[Place, tuple[Array, Array]] = {}
        if geometry.degree == 1:
            self.warnings.append("linear elements lock in bending: frequencies may be several times too high (use degree 2)")
        element = basix.ufl.element("Lagrange", domain.basix_cell(), geometry.degree, shape=(d,))
        self.space = fem.functionspace(domain, element)
        dofmap = self.space.dofmap
        self.local = dofmap.index_map.size_local * dofmap.index_map_bs
        self.size = dofmap.index_map.size_global * dofmap.index_map_bs

        dofs = np.unique(np.concatenate([mesh.nodes(support, self.space) for support in scene.supports]))
        pieces = unclamped_pieces(mesh, scene.supports)
        if pieces:
            named = ", ".join(support.group or "picked by coordinates" for support in scene.supports)
            some = "1 connected piece of the mesh touches" if pieces == 1 else f"{pieces} connected pieces of the mesh touch"
            raise SceneError(
                f"{geometry.mesh}: {some} no support ({named}): the stiffness is singular; clamp every piece or join the parts "
                "of the mesh, whose nodes may lie on one another without being joined"
            )
        self._zero = fem.Function(self.space)
        self.conditions = [fem.dirichletbc(self._zero, dofs)]
        bs = dofmap.index_map_bs
        unrolled = (dofs[:, None] * bs + np.arange(bs)).reshape(-1)
        self._clamped = unrolled[unrolled < self.local]
        self.free = self.size - int(self.comm.allreduce(self._clamped.size))
        self._refuse_hinge()

        self.shear_modulus = material.young / (2.0 * (1.0 + material.poisson))
        self.first_lame = material.young * material.poisson / ((1.0 + material.poisson) * (1.0 - 2.0 * material.poisson))
        if geometry.plane == "stress":
            self.first_lame = 2.0 * self.first_lame * self.shear_modulus / (self.first_lame + 2.0 * self.shear_modulus)
        self._forms()

        self._frames()
        self.equilibrium = np.zeros(self.local)
        static = self.load_vectors @ np.where(self.signals.omega == 0.0, self.signals.amplitude, 0.0)
        self.mass = self.matrix(self.mass_form, 0.0)
        self.stiffness = self.matrix(self._tangent_form, 1.0)
        self.factor = Factorisation(self.stiffness, "fenicsrom_stiffness")
        self.loaded = bool(self.comm.allreduce(float(np.abs(static).sum())) > 0.0)
        if self.loaded:
            if scene.geometrically_nonlinear:
                self.equilibrium = self.static(static)
                self.tangent(self.equilibrium, self.stiffness)
                self.factor.update()
            else:
                self.equilibrium = self.factor.solve(static[:, None])[:, 0]

    # ------------------------------------------------------------------ forms

    def _forms(self) -> None:
        domain, d = self.mesh.domain, self.scene.geometry.dimension
        thickness = self.scene.geometry.thickness or 1.0
        self._dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        self._u = fem.Function(self.space)
        self._x, self._y = fem.Function(self.space), fem.Function(self.space)
        self._out = fem.Function(self.space)
        trial, test = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        lame, mu = self.first_lame * thickness, self.shear_modulus * thickness

        def stress(strain: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
            return lame * ufl.tr(strain) * ufl.Identity(d) + 2.0 * mu * strain

        gradient, identity = ufl.grad(self._u), ufl.Identity(d)
        f = identity + gradient
        strain = ufl.sym(gradient) + 0.5 * gradient.T * gradient
        s = stress(strain)
        dg, dv = ufl.grad(trial), ufl.grad(test)
        gx, gy = ufl.grad(self._x), ufl.grad(self._y)
        sx, sy = stress(ufl.sym(f.T * gx)), stress(ufl.sym(f.T * gy))
        sxy = stress(ufl.sym(gx.T * gy))
        self.mass_form = fem.form(self.scene.material.density * thickness * ufl.inner(trial, test) * self._dx)
        self._force_form = fem.form(ufl.inner(f * s, dv) * self._dx)
        self._weight = fem.Constant(domain, 1.0)
        self._tangent_form = fem.form(
            self._weight * ufl.inner(dg * s + f * stress(ufl.sym(f.T * dg)), dv) * self._dx
        )
        self._energy_form = fem.form(0.5 * ufl.inner(s, strain) * self._dx)
        self._derivative_form = fem.form(ufl.inner(gx * sy + gy * sx + f * sxy, dv) * self._dx)

    def matrix(self, form: fem.Form, diagonal: float) -> PETSc.Mat:
        """Assemble a form, with `diagonal` on the clamped rows."""
        matrix = fem.petsc.create_matrix(form)
        fem.petsc.assemble_matrix(matrix, form, self.conditions, diagonal)
        matrix.assemble()
        return matrix

    def _set(self, function: fem.Function, values: Array) -> None:
        function.x.array[: self.local] = values
        function.x.scatter_forward()

    def _vector(self, form: fem.Form) -> Array:
        self._out.x.array[:] = 0.0
        fem.assemble_vector(self._out.x.array, form)
        self._out.x.scatter_reverse(dolfinx.la.InsertMode.add)
        values = self._out.x.array[: self.local].copy()
        values[self._clamped] = 0.0
        return values

    def internal_force(self, u: Array) -> Array:
        """Internal force (local,) at a displacement (local,), N."""
        self._set(self._u, u)
        return self._vector(self._force_form)

    @property
    def rest_force(self) -> Array:
        """Internal force (local,) in the equilibrium, of the linear model in a geometrically linear scene, N."""
        if self.scene.geometrically_nonlinear:
            return self.internal_force(self.equilibrium)
        return multiply(self.stiffness, self.equilibrium)

    def tangent(self, u: Array, matrix: PETSc.Mat | None = None) -> PETSc.Mat:
        """Tangent stiffness at a displacement, N/m; into `matrix` where it is given."""
        self._set(self._u, u)
        if matrix is None:
            return self.matrix(self._tangent_form, 1.0)
        matrix.zeroEntries()
        fem.petsc.assemble_matrix(matrix, self._tangent_form, self.conditions, 1.0)
        matrix.assemble()
        return matrix

    def add_tangent(self, matrix: PETSc.Mat, u: Array, weight: float) -> None:
        """Add a multiple of the tangent at a displacement to a matrix."""
        self._set(self._u, u)
        self._weight.value = weight
        fem.petsc.assemble_matrix(matrix, self._tangent_form, self.conditions, 1.0)
        matrix.assemble()  # PETSc drops values added after the inserted diagonal of an unfinished assembly
        self._weight.value = 1.0

    def energy(self, u: Array) -> float:
        """Elastic energy at a displacement, J."""
        self._set(self._u, u)
        return float(self.comm.allreduce(fem.assemble_scalar(self._energy_form)))

    def tangent_derivative(self, x: Array, y: Array) -> Array:
        """K'[x] y at the equilibrium, (local,): the third derivative of the energy along x and y, from UFL, exact; N/m^2 m^2."""
        self._set(self._u, self.equilibrium)
        self._set(self._x, x)
        self._set(self._y, y)
        return self._vector(self._derivative_form)

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K'[x] y by the paper's central difference of the tangent, eq. (16); exact at any step for this material."""
        largest = self.comm.allreduce(float(np.max(np.abs(x), initial=0.0)), op=MPI.MAX)
        length = self._extent()
        h = 0.1 * length / largest  # a small step would lose digits to rounding
        plus = self.tangent_times(self.equilibrium + h * x, y)
        minus = self.tangent_times(self.equilibrium - h * x, y)
        difference = (plus - minus) / (2.0 * h)
        difference[self._clamped] = 0.0
        return difference

    def largest(self, block: Array) -> Array:
        """Largest displacement component of each column of a block (local, k), over all ranks."""
        mine = np.max(np.abs(block), axis=0, initial=0.0)
        return np.max(self.comm.allgather(mine), axis=0)

    def tangent_times(self, u: Array, block: Array) -> Array:
        """Tangent at a displacement times the columns of a block (local, k)."""
        if self._scratch is None:
            self._scratch = self.stiffness.duplicate()
        return multiply(self.tangent(u, self._scratch), block)

    def stiffness_times(self, block: Array) -> Array:
        """K times the columns of a block (local, k)."""
        return multiply(self.stiffness, block)

    def mass_times(self, block: Array) -> Array:
        """M times the columns of a block (local, k)."""
        return multiply(self.mass, block)

    def mass_inner(self, a: Array, b: Array) -> Array:
        """a^T M b over all ranks for blocks (local, k) and (local, l)."""
        return self.gram(a, multiply(self.mass, b))

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The lowest modes with respect to K or, with an inverse that holds coordinates, to K with those held."""
        return eigenmodes(self.stiffness, self.mass, inverse, count, "fenicsrom_modes")

    def translations(self) -> Array:
        """(local, d) unit translations along the axes."""
        d = self.scene.geometry.dimension
        return np.tile(np.eye(d), (self.local // d, 1))

    def field(self, values: Array) -> fem.Function:
        """A displacement field of these values (local,), its ghosts up to date."""
        function = fem.Function(self.space)
        self._set(function, values)
        return function

    def dot(self, a: Array, b: Array) -> float:
        """Inner product over all ranks."""
        return float(self.comm.allreduce(float(np.dot(a, b))))

    def gram(self, a: Array, b: Array) -> Array:
        """a^T b over all ranks for blocks (local, k) and (local, l)."""
        return np.asarray(self.comm.allreduce(a.T @ b))

    def _extent(self) -> float:
        low, high = self.mesh.bounds()
        return float(np.max(high - low))

    def _refuse_hinge(self) -> None:
        """Refuse supports of a single node, or in 3D of nodes on one line: the body could turn about them."""
        d = self.scene.geometry.dimension
        x = self.space.tabulate_dof_coordinates()[self._clamped[::d] // d, :d]
        low = self.mesh.bounds()[0][:d]
        y = np.column_stack([np.ones(len(x)), (x - low) / self._extent()])
        moments = self.comm.allreduce(y.T @ y)
        mean = moments[0, 1:] / moments[0, 0]
        spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(mean, mean))
        if spread[1] < 1e-12:
            what = "a single node" if spread[-1] < 1e-12 else "nodes on one line"
            raise SceneError(f"{self.scene.source}: the supports clamp {what}: must hold the body against turning about it")

    # ------------------------------------------------------------------ statics

    def static(self, load: Array, guess: Array | None = None) -> Array:
        """Nonlinear equilibrium under a load vector, by Newton with load steps.

        Args:
            load: (local,) N.
            guess: where to start, the undeformed state without it.

        Returns:
            (local,) displacement, m.

        Raises:
            ConvergenceError: the load step fell below `SMALLEST_LOAD_STEP`.
        """
        u = np.zeros(self.local) if guess is None else guess.copy()
        start = self.internal_force(u) if guess is not None else np.zeros(self.local)
        matrix = self.tangent(u)
        factor = Factorisation(matrix, "fenicsrom_static")
        reached, step = 0.0, 1.0
        while reached < 1.0:
            aim = min(1.0, reached + step)
            trial = self._newton(u, start + aim * (load - start), matrix, factor)
            if trial is None:
                step *= 0.5
                if step < SMALLEST_LOAD_STEP:
                    raise ConvergenceError(
                        f"static equilibrium: no convergence beyond {100.0 * reached:.4g} % of the load (smallest load step)", u
                    )
            else:
                u, reached, step = trial, aim, 2.0 * step
        return u

    def _newton(self, u: Array, load: Array, matrix: PETSc.Mat, factor: Factorisation) -> Array | None:
        u = u.copy()
        first, last = 0.0, np.inf
        for _ in range(STATIC_ITERATIONS):
            residual = self.internal_force(u) - load
            self.tangent(u, matrix)
            try:
                factor.update()
            except ConvergenceError:
                return None
            change = -factor.solve(residual[:, None])[:, 0]
            decrement = abs(self.dot(residual, change))
            first = first or decrement
            if not np.isfinite(decrement) or decrement > 1e6 * first:
                return None
            u += change
            if decrement <= STATIC_TOLERANCE**2 * max(first, abs(self.dot(load, u))):
                return u
            last = decrement
        return u if last <= 1e-6 * STATIC_TOLERANCE else None

    # ------------------------------------------------------------------ places

    def _frames(self) -> None:
        scene, d = self.scene, self.scene.geometry.dimension
        self.contact_frames = [frame(np.array(contact.normal)) for contact in scene.contacts]
        self.contact_positions = []
        rows = []
        for k, contact in enumerate(scene.contacts):
            at, position = self.place(contact.place, f"contacts[{k}]")
            rows.append(self.contact_frames[k] @ at)
            self.contact_positions.append(position)
        self.contact_rows = np.concatenate(rows) if rows else np.zeros((0, self.local))
        loads, self.load_positions = [], []
        for k, load in enumerate(scene.loads):
            at, position = self.place(load.place, f"loads[{k}]")
            loads.append(np.array(load.direction) @ at)
            self.load_positions.append(position)
        self.load_vectors = np.array(loads).T.copy() if loads else np.zeros((self.local, 0))
        self.signals = Signals(*(np.array(values, dtype=np.float64) for values in scene.signals))
        probe = scene.probe or (scene.contacts[0].place if scene.contacts else None) or scene.loads[0].place
        self.probe_rows, self.probe_position = self.place(probe, "probe")
        assert self.probe_rows.shape[0] == d

    def place(self, place: Place, key: str) -> tuple[Array, Array]:
        """Rows that give the displacement of a place; one that is asked for again is not sought, nor warned of, again.

        Args:
            place: a node, the node nearest to a point or to the centroid of a region, or the mean over the region:
                weighted by area on facets, by length on the edges of a node group, equally on nodes alone.
            key: of the scene, for the error.

        Returns:
            (d, local) rows, zero on clamped unknowns, and the position (3,) in m.

        Raises:
            SceneError: the region is missing or empty, the node is clamped, or no node is near the coordinates.
        """
        if place not in self._places:
            self._places[place] = self._find(place, key)
        return self._places[place]

    def _find(self, place: Place, key: str) -> tuple[Array, Array]:
        d = self.scene.geometry.dimension
        rows = np.zeros((d, self.local))
        name, wanted = ("nearest", place.nearest) if place.nearest is not None else ("node", place.node)
        near = np.inf
        if wanted is None:
            weights, position = self._mean(place, key) if self.mesh.has_facets(place) else self._mean_of_nodes(place)
            if place.at == "mean":
                for k in range(d):
                    rows[k, k::d] = weights
                rows[:, self._clamped] = 0.0
                return rows, position
        else:
            position = np.zeros(3)
            position[:d] = wanted
            near = 1e-3 * self._extent()
        x = self.space.tabulate_dof_coordinates()[: self.local // d]
        distance = np.linalg.norm(x - position, axis=1)
        best = int(np.argmin(distance)) if distance.size else -1
        mine = (round(float(distance[best]), 12), *x[best].round(12), self.comm.rank) if best >= 0 else (np.inf, 0, 0, 0, -1)
        chosen = min(self.comm.allgather(tuple(float(v) for v in mine)))
        if chosen[0] > near:
            nearest = [round(v, 6) for v in chosen[1 : 1 + d]]
            away = f"{self.scene.source}: {key}.{name} = {list(wanted or ())}: "
            if name == "node":
                raise SceneError(f"{away}no node lies there; the nearest is {nearest}, {chosen[0]:.3g} m away")
            self.warnings.append(f"{away}the nearest node is {nearest}, {chosen[0]:.3g} m away")
        clamped = False
        if int(chosen[-1]) == self.comm.rank:
            for k in range(d):
                rows[k, best * d + k] = 1.0
            clamped = bool(np.isin(best * d, self._clamped))
            rows[:, self._clamped] = 0.0
        if self.comm.allreduce(clamped, op=MPI.LOR):
            raise SceneError(f"{self.scene.source}: {key}: the node at {list(chosen[1 : 1 + d])} is clamped; choose a free one")
        return rows, np.array(chosen[1:4])

    def _mean(self, region: Region, key: str) -> tuple[Array, Array]:
        """Area-weighted mean over facets: weights (local / d,) of the nodes, and the centroid (3,)."""
        domain = self.mesh.domain
        ds = self.mesh.surface(region)
        scalar = fem.functionspace(domain, ("Lagrange", self.scene.geometry.degree))
        weights = fem.Function(scalar)
        fem.assemble_vector(weights.x.array, fem.form(ufl.TestFunction(scalar) * ds))
        weights.x.scatter_reverse(dolfinx.la.InsertMode.add)
        x = ufl.SpatialCoordinate(domain)
        one = fem.Constant(domain, 1.0)
        area = self.comm.allreduce(fem.assemble_scalar(fem.form(one * ds)))
        if not area > 0.0:
            raise SceneError(
                f"{self.scene.source}: {key}.group = {region.group!r}: the group has no area; name a group of facets"
            )
        position = np.zeros(3)
        for k in range(self.scene.geometry.dimension):
            position[k] = self.comm.allreduce(fem.assemble_scalar(fem.form(x[k] * ds))) / area
        local = scalar.dofmap.index_map.size_local
        return weights.x.array[:local] / area, position

    def _mean_of_nodes(self, region: Region) -> tuple[Array, Array]:
        """Mean over a node group, weighted by the length of its edges, equal without any: weights and centroid as above."""
        domain, degree = self.mesh.domain, self.scene.geometry.degree
        scalar = fem.functionspace(domain, ("Lagrange", degree))
        weights = fem.Function(scalar)
        local = scalar.dofmap.index_map.size_local
        x = scalar.tabulate_dof_coordinates()
        topology = domain.topology
        edges = self.mesh.entities(region).get(1, np.empty(0, dtype=np.int32))
        if self.comm.allreduce(edges.size):
            topology.create_connectivity(1, topology.dim)
            topology.create_connectivity(topology.dim, 1)
            share = np.array([0.5, 0.5] if degree == 1 else [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0])
            for edge in edges[edges < topology.index_map(1).size_local]:
                cell = topology.connectivity(1, topology.dim).links(edge)[0]
                side = int(np.flatnonzero(topology.connectivity(topology.dim, 1).links(cell) == edge)[0])
                nodes = scalar.dofmap.cell_dofs(cell)[scalar.dofmap.dof_layout.entity_closure_dofs(1, side)]
                weights.x.array[nodes] += share * np.linalg.norm(x[nodes[1]] - x[nodes[0]])
            weights.x.scatter_reverse(dolfinx.la.InsertMode.add)
        else:
            weights.x.array[self.mesh.nodes(region, scalar)] = 1.0
        mine = weights.x.array[:local]
        total = self.comm.allreduce(float(mine.sum()))
        return mine / total, np.asarray(self.comm.allreduce(mine @ x[:local])) / total

    # ------------------------------------------------------------------ tabulation

    def tabulate(self, fields: Array) -> Iterator[tuple[Array, Array]]:
        """Quadrature weights and gradients of the equilibrium and of some fields, in chunks of cells owned by this rank.

        Args:
            fields: (local, n).

        Yields:
            weights (k,), thickness included, in m^3, and gradients (k, 1 + n, d, d), that of the equilibrium first.
        """
        domain, d = self.mesh.domain, self.scene.geometry.dimension
        points, weights = basix.make_quadrature(domain.basix_cell(), QUADRATURE_DEGREE)
        gradient = fem.Expression(ufl.grad(self._x), points)
        volume = fem.Expression(abs(ufl.JacobianDeterminant(domain)), points)
        cells = np.arange(domain.topology.index_map(domain.topology.dim).size_local, dtype=np.int32)
        thickness = self.scene.geometry.thickness or 1.0
        n = fields.shape[1]
        columns = 1 + n + n * (n + 1) // 2
        chunk = max(1, int(CHUNK_BYTES / (8 * 2 * d * d * columns * weights.size)))
        for start in range(0, cells.size, chunk):
            part = cells[start : start + chunk]
            detj = np.asarray(volume.eval(domain, part)).reshape(part.size, weights.size)
            gradients = np.empty((part.size * weights.size, 1 + n, d, d))
            for k in range(1 + n):
                self._set(self._x, self.equilibrium if k == 0 else fields[:, k - 1])
                gradients[:, k] = np.asarray(gradient.eval(domain, part)).reshape(-1, d, d)
            yield (thickness * detj * weights).reshape(-1), gradients


def frame(normal: Array) -> Array:
    """The local frame of a unit normal: rows normal, tangents; (d, d), right-handed.

    The first tangent in 3D lies nearest to the first of the axes y, z, x that is least aligned with the normal, so that a
    wall beyond a blade's tip along x has the tangents y and z.
    """
    if normal.size == 2:
        return np.array([normal, [-normal[1], normal[0]]])
    order = [1, 2, 0]
    axis = order[int(np.argmin(np.round(np.abs(normal[order]), 12)))]
    tangent = np.eye(3)[axis] - normal[axis] * normal
    tangent /= np.linalg.norm(tangent)
    return np.array([normal, tangent, np.cross(normal, tangent)])
