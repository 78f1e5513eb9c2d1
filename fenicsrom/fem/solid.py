"""St Venant-Kirchhoff solid on dolfinx: mass, internal force, tangent and its directional
derivative, about an equilibrium.

Strain E = sym(grad u) + grad u^T grad u / 2, stress S = lambda tr(E) I + 2 mu E, virtual work int
(F S) : grad v, F = I + grad u. Plane stress is exact for this material with lambda* = 2 lambda mu /
(lambda + 2 mu). Vectors are numpy arrays of the unknowns owned by this rank, zero on the clamped
ones; clamped rows of the matrices are those of the identity in K, zero in M.

Of a scene with [rotation] everything is seen from the frame that turns with the body
(`fenicsrom.rotation`): the centrifugal potential is part of the energy, of the internal force and
of the tangent, and the equilibrium is the one at speed. It is found geometrically nonlinearly even
in a geometrically linear scene: without the tension in it a body would only soften. What is linear
then are the vibrations about it.
"""

from __future__ import annotations

from collections.abc import Iterator

import basix.ufl
import dolfinx.fem.petsc
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, SceneError
from fenicsrom.fem.linalg import Factorisation, Inverse, eigenmodes, multiply
from fenicsrom.fem.mesh import Mesh, unclamped_pieces
from fenicsrom.fem.rotation import RotatingFrame
from fenicsrom.online.contact_points import ContactPoints, no_points
from fenicsrom.online.load_histories import of_loads
from fenicsrom.online.surfaces import frame, surface_normal
from fenicsrom.scene import Load, Place, Region, Scene

# exact for the force and tangent of affine P2 simplices; on Q2 parallelepipeds exact for the linear
# stiffness, and to 1e-8 for the force at large displacements
QUADRATURE_DEGREE = 4
STATIC_TOLERANCE = 1e-9  # of Newton's decrement, relative to the work of the load, squared
STATIC_ITERATIONS = 25
SMALLEST_LOAD_STEP = 1e-4
# exact for tractions and pressures on quadratic cells of straight edges, and for the pressure on
# curved ones: the normal times the area of a curved quadratic quadrilateral is a cubic in each
# direction
LOAD_DEGREE = 6
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
        rotation: the rotating frame; None at rest.
        gyroscopic: G of the Coriolis force -G du/dt, skew, N s/m; None where it is not asked for.
        static_load: (local,) sum of the static loads, N.
        loaded: whether static loads or rotation deform the body.
        equilibrium: (local,) displacement under the static loads, at speed, m.
        contact_rows: (m, local) B^T: contact displacements in the local frames [normal, tangents],
        point by point.
        points: the contact points.
        probe_rows: (d, local) displacement of the probe in global axes.
        load_vectors: (local, loads) unit loads.
        signals: time factors of the loads.
        warnings: sentences for the user.
        gauss_points: points that integrate the elastic force exactly along a straight line: it is a
            cubic.
    """

    gauss_points = 2

    def __init__(self, mesh: Mesh, scene: Scene):
        """Form the matrices, find the equilibrium and factorise.

        Raises:
            SceneError: a group is missing, a piece of the body is unclamped, a place is clamped or
            outside.
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
            self.warnings.append(
                "linear elements lock in bending: frequencies may be several times too high (use degree 2)"
            )
        element = basix.ufl.element("Lagrange", domain.basix_cell(), geometry.degree, shape=(d,))
        self.space = fem.functionspace(domain, element)
        dofmap = self.space.dofmap
        self.local = dofmap.index_map.size_local * dofmap.index_map_bs
        self.size = dofmap.index_map.size_global * dofmap.index_map_bs

        dofs = np.unique(
            np.concatenate([mesh.nodes(support, self.space) for support in scene.supports])
        )
        pieces = unclamped_pieces(mesh, scene.supports)
        if pieces:
            named = ", ".join(
                support.group or "picked by coordinates" for support in scene.supports
            )
            some = (
                "1 connected piece of the mesh touches"
                if pieces == 1
                else f"{pieces} connected pieces of the mesh touch"
            )
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
        self.first_lame = (
            material.young
            * material.poisson
            / ((1.0 + material.poisson) * (1.0 - 2.0 * material.poisson))
        )
        if geometry.plane == "stress":
            self.first_lame = (
                2.0
                * self.first_lame
                * self.shear_modulus
                / (self.first_lame + 2.0 * self.shear_modulus)
            )
        self._forms()

        self._frames()
        self.equilibrium = np.zeros(self.local)
        self.static_load = self.load_vectors @ np.array(
            [load.size if load.static else 0.0 for load in scene.loads]
        )
        self.mass = self.matrix(self.mass_form, 0.0)
        self.stiffness = self.matrix(self._tangent_form, 1.0)
        self.factor = Factorisation(self.stiffness, "fenicsrom_stiffness")
        self.gyroscopic = self.rotation.gyroscopic() if self.rotation else None
        spinning = self.rotation is not None and self.rotation.square > 0.0
        self.loaded = spinning or bool(
            self.comm.allreduce(float(np.abs(self.static_load).sum())) > 0.0
        )
        if self.loaded:
            if scene.geometrically_nonlinear or spinning:
                self._rest_at(self.static(self.static_load))
            else:
                self.equilibrium = self.factor.solve(self.static_load[:, None])[:, 0]

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
        self.mass_form = fem.form(
            self.scene.material.density * thickness * ufl.inner(trial, test) * self._dx
        )
        self._force_form = fem.form(ufl.inner(f * s, dv) * self._dx)
        self._weight = fem.Constant(domain, 1.0)
        self._tangent_form = fem.form(
            self._weight * ufl.inner(dg * s + f * stress(ufl.sym(f.T * dg)), dv) * self._dx
        )
        self._energy_form = fem.form(0.5 * ufl.inner(s, strain) * self._dx)
        self._derivative_form = fem.form(ufl.inner(gx * sy + gy * sx + f * sxy, dv) * self._dx)
        self.rotation: RotatingFrame | None = None
        if self.scene.rotation is not None:
            density = self.scene.material.density * thickness
            self.rotation = RotatingFrame(
                self.scene.rotation,
                self.space,
                lambda form: density * form * self._dx,
                lambda form: self.matrix(fem.form(form), 0.0),
                lambda form: self._vector(fem.form(form)),
            )

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
        values = self._assembled(form)
        values[self._clamped] = 0.0
        return values

    def _assembled(self, form: fem.Form) -> Array:
        """A vector (local,), the clamped unknowns included."""
        self._out.x.array[:] = 0.0
        fem.assemble_vector(self._out.x.array, form)
        self._out.x.scatter_reverse(dolfinx.la.InsertMode.add)
        return self._out.x.array[: self.local].copy()

    def internal_force(self, u: Array) -> Array:
        """Internal force (local,) at a displacement (local,), less the centrifugal force there,
        N.
        """
        self._set(self._u, u)
        force = self._vector(self._force_form)
        return force if self.rotation is None else force - self.rotation.force(u)

    @property
    def rest_force(self) -> Array:
        """Internal force (local,) in the equilibrium, of the linear model in a geometrically linear
        scene, N.
        """
        if self.scene.geometrically_nonlinear or self.rotation is not None:
            return self.internal_force(self.equilibrium)
        return multiply(self.stiffness, self.equilibrium)

    def tangent(self, u: Array, matrix: PETSc.Mat | None = None) -> PETSc.Mat:
        """Tangent stiffness at a displacement, N/m; into `matrix` where it is given."""
        self._set(self._u, u)
        if matrix is None:
            matrix = self.matrix(self._tangent_form, 1.0)
        else:
            matrix.zeroEntries()
            fem.petsc.assemble_matrix(matrix, self._tangent_form, self.conditions, 1.0)
            matrix.assemble()
        if self.rotation is not None:
            self.rotation.soften(matrix, 1.0)
        return matrix

    def add_tangent(self, matrix: PETSc.Mat, u: Array, weight: float) -> None:
        """Add a multiple of the tangent at a displacement to a matrix."""
        self._set(self._u, u)
        self._weight.value = weight
        fem.petsc.assemble_matrix(matrix, self._tangent_form, self.conditions, 1.0)
        # PETSc drops values added after the inserted diagonal of an unfinished assembly
        matrix.assemble()
        self._weight.value = 1.0
        if self.rotation is not None:
            self.rotation.soften(matrix, weight)

    def energy(self, u: Array) -> float:
        """Elastic energy at a displacement, and the centrifugal potential above that of the
        undeformed body, J.
        """
        self._set(self._u, u)
        energy = float(self.comm.allreduce(fem.assemble_scalar(self._energy_form)))
        return energy if self.rotation is None else energy + self.rotation.energy(u)

    def tangent_derivative(self, x: Array, y: Array) -> Array:
        """K'[x] y at the equilibrium, (local,): the third derivative of the energy along x and y,
        from UFL, exact; N/m^2 m^2.
        """
        self._set(self._u, self.equilibrium)
        self._set(self._x, x)
        self._set(self._y, y)
        return self._vector(self._derivative_form)

    def tangent_difference(self, x: Array, y: Array) -> Array:
        """K'[x] y by the paper's central difference of the tangent, eq. (16); exact at any step for
        this material.
        """
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

    def gyroscopic_times(self, block: Array) -> Array:
        """G times the columns of a block (local, k); the scene must ask for the Coriolis force."""
        return multiply(self.gyroscopic, block)

    def mass_inner(self, a: Array, b: Array) -> Array:
        """a^T M b over all ranks for blocks (local, k) and (local, l)."""
        return self.inner(a, multiply(self.mass, b))

    def eigenmodes(self, inverse: Inverse, count: int) -> tuple[Array, Array]:
        """The lowest modes with respect to K or, with an inverse that holds coordinates, to K with
        those held.
        """
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

    def inner(self, a: Array, b: Array) -> Array:
        """a^T b over all ranks for blocks (local, k) and (local, l)."""
        return np.asarray(self.comm.allreduce(a.T @ b))

    def _extent(self) -> float:
        low, high = self.mesh.bounds()
        return float(np.max(high - low))

    def _refuse_hinge(self) -> None:
        """Refuse supports of a single node, or in 3D of nodes on one line: the body could turn
        about them.
        """
        d = self.scene.geometry.dimension
        x = self.space.tabulate_dof_coordinates()[self._clamped[::d] // d, :d]
        low = self.mesh.bounds()[0][:d]
        y = np.column_stack([np.ones(len(x)), (x - low) / self._extent()])
        moments = self.comm.allreduce(y.T @ y)
        mean = moments[0, 1:] / moments[0, 0]
        spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(mean, mean))
        if spread[1] < 1e-12:
            what = "a single node" if spread[-1] < 1e-12 else "nodes on one line"
            raise SceneError(
                f"{self.scene.source}: the supports clamp {what}: must hold the body against turning about it"
            )

    # ------------------------------------------------------------------ statics

    def static(self, load: Array, guess: Array | None = None) -> Array:
        """Nonlinear equilibrium under a load vector, by Newton with load steps, in Omega^2 too from
        the undeformed state.

        Args:
            load: (local,) N.
            guess: where to start, at this speed; the undeformed state at rest without it.

        Returns:
            (local,) displacement, m.

        Raises:
            ConvergenceError: the load step fell below `SMALLEST_LOAD_STEP`.
        """
        if guess is None:
            return self._follow(np.zeros(self.local), np.zeros(self.local), load, 0.0)
        return self._follow(
            guess, self.internal_force(guess), load, self.rotation.square if self.rotation else 0.0
        )

    def spin(self, omega: float) -> None:
        """Bring the body to another angular velocity in rad/s, on from the equilibrium it is in: K,
        G and factor follow.

        Raises:
            ConvergenceError: no equilibrium there.
        """
        assert self.rotation is not None
        square = self.rotation.square
        self.rotation.turn(omega)
        self._rest_at(self._follow(self.equilibrium, self.static_load, self.static_load, square))
        self.gyroscopic = self.rotation.gyroscopic()

    def _rest_at(self, equilibrium: Array) -> None:
        self.equilibrium = equilibrium
        self.tangent(equilibrium, self.stiffness)
        self.factor.update()

    def _follow(self, u: Array, start: Array, load: Array, square: float) -> Array:
        """The equilibria from the one u under a load `start` at Omega^2 = `square` to that under
        `load` at the speed set.
        """
        frame = self.rotation
        goal = frame.square if frame else 0.0
        matrix = self.tangent(u)
        factor = Factorisation(matrix, "fenicsrom_static")
        reached, step = 0.0, 1.0
        while reached < 1.0:
            aim = min(1.0, reached + step)
            if frame:
                frame.square = square + aim * (goal - square)
            trial = self._newton(u, start + aim * (load - start), matrix, factor)
            if trial is None:
                step *= 0.5
                if step < SMALLEST_LOAD_STEP:
                    what = "of the load"
                    if frame:
                        frame.square = goal
                        what += " and of the centrifugal force"
                    raise ConvergenceError(
                        f"static equilibrium: no convergence beyond {100.0 * reached:.4g} % {what} (smallest load step)",
                        u,
                    )
            else:
                u, reached, step = trial, aim, 2.0 * step
        return u

    def _newton(
        self, u: Array, load: Array, matrix: PETSc.Mat, factor: Factorisation
    ) -> Array | None:
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
            acting = load if self.rotation is None else load + self.rotation.force(u)
            if decrement <= STATIC_TOLERANCE**2 * max(first, abs(self.dot(acting, u))):
                return u
            last = decrement
        return u if last <= 1e-6 * STATIC_TOLERANCE else None

    # ------------------------------------------------------------------ places

    def _frames(self) -> None:
        scene, d = self.scene, self.scene.geometry.dimension
        rows, found = [], []
        for k, contact in enumerate(scene.contacts):
            for at, position, share in self._touching(contact.place, f"contacts[{k}]"):
                axes = frame(
                    surface_normal(contact, position[:d], f"{scene.source}: contacts[{k}]")
                )
                rows.append(axes @ at)
                found.append((k, share, position[:d], axes))
        self.contact_rows = np.concatenate(rows) if rows else np.zeros((0, self.local))
        self.points = (
            ContactPoints(*map(np.array, zip(*found, strict=True))) if found else no_points(d)
        )
        self.load_vectors = np.zeros((self.local, len(scene.loads)))
        for k, load in enumerate(scene.loads):
            self.load_vectors[:, k] = self.load_vector(load, f"loads[{k}]")
        self.load_vectors[self._clamped] = 0.0
        self.load_histories = of_loads(scene.loads)
        probe = (
            scene.probe
            or (scene.contacts[0].place if scene.contacts else None)
            or scene.loads[0].place
        )
        self.probe_rows, self.probe_position = self.place(probe, "probe")
        assert self.probe_rows.shape[0] == d

    def _touching(self, place: Place, key: str) -> list[tuple[Array, Array, float]]:
        """The points of a contact: rows (d, local) of the displacement, position (3,) and share of
        each.

        They are in the order of the coordinate in which they lie farthest apart, then of the next.
        """
        if place.at != "nodes":
            return [(*self.place(place, key), 1.0)]
        d = self.scene.geometry.dimension
        weights, _, measure = (
            self._mean(place, key) if self.mesh.has_facets(place) else self._mean_of_nodes(place)
        )
        x = self.space.tabulate_dof_coordinates()[: self.local // d]
        weights[self._clamped[::d] // d] = 0.0
        largest = self.comm.allreduce(float(np.max(weights, initial=0.0)), op=MPI.MAX)
        mine = [  # corners of quadratic triangles have no share
            (*x[node].round(12), float(weights[node]), self.comm.rank, int(node))
            for node in np.flatnonzero(weights > 1e-9 * largest)
        ]
        chosen = [point for points in self.comm.allgather(mine) for point in points]
        if not chosen:
            raise SceneError(
                f"{self.scene.source}: {key}: every node of it is clamped; choose free ones"
            )
        extent = np.ptp(np.array(chosen)[:, :3], axis=0).round(9)
        along = np.argsort(
            -extent, kind="stable"
        )  # neighbours on an edge follow one another, on any number of ranks
        chosen.sort(key=lambda point: (*(point[k] for k in along), point))
        found = []
        for *position, weight, rank, node in chosen:
            rows = np.zeros((d, self.local))
            if rank == self.comm.rank:
                rows[np.arange(d), int(node) * d + np.arange(d)] = 1.0
            found.append((rows, np.array(position), float(weight * measure)))
        return found

    def load_vector(self, load: Load, key: str) -> Array:
        """The load vector (local,) of a load of size 1, what acts on the clamped unknowns included
        but for a point force.

        The work of a traction is int t . v dA, of a pressure -int p n . v dA, of an acceleration
        int rho a . v dV, on the undeformed body; in two dimensions each times the thickness.

        Args:
            load: the load.
            key: of the scene, for the error.

        Raises:
            SceneError: as `place`; a pressure on facets within the body.
        """
        if load.kind == "force":
            return np.array(load.direction) @ self.place(load.place, key)[0]
        domain, thickness = self.mesh.domain, self.scene.geometry.thickness or 1.0
        test = ufl.TestFunction(self.space)
        if load.kind == "acceleration":
            density = self.scene.material.density * thickness
            direction = fem.Constant(domain, np.array(load.direction))
            return self._assembled(fem.form(density * ufl.dot(direction, test) * self._dx))
        surface = self.mesh.surface(load.place).reconstruct(
            metadata={"quadrature_degree": LOAD_DEGREE}
        )
        if load.kind == "traction":
            direction = fem.Constant(domain, np.array(load.direction))
            return self._assembled(fem.form(thickness * ufl.dot(direction, test) * surface))
        d = domain.topology.dim
        domain.topology.create_connectivity(d - 1, d)
        boundary = dolfinx.mesh.exterior_facet_indices(domain.topology)
        count = domain.topology.index_map(d - 1).size_local
        facets = self.mesh.facets(load.place)
        within = ~np.isin(facets[facets < count], boundary)
        if self.comm.allreduce(bool(np.any(within)), op=MPI.LOR):
            raise SceneError(
                f"{self.scene.source}: {key}.pressure = {load.size:g}: must act on the boundary, and some of "
                "these facets lie within the body"
            )
        return self._assembled(
            fem.form(-thickness * ufl.dot(ufl.FacetNormal(domain), test) * surface)
        )

    def place(self, place: Place, key: str) -> tuple[Array, Array]:
        """Rows that give the displacement of a place; one that is asked for again is not sought,
        nor warned of, again.

        Args:
            place: a node, the node nearest to a point or to the centroid of a region, or the mean
                over the region: weighted by area on facets, by length on the edges of a node group,
                equally on nodes alone.
            key: of the scene, for the error.

        Returns:
            (d, local) rows, zero on clamped unknowns, and the position (3,) in m.

        Raises:
            SceneError: the region is missing or empty, the node is clamped, or no node is near the
                coordinates.
        """
        if place not in self._places:
            self._places[place] = self._find(place, key)
        return self._places[place]

    def _find(self, place: Place, key: str) -> tuple[Array, Array]:
        d = self.scene.geometry.dimension
        rows = np.zeros((d, self.local))
        name, wanted = (
            ("nearest", place.nearest) if place.nearest is not None else ("node", place.node)
        )
        near = np.inf
        if wanted is None:
            weights, position, _ = (
                self._mean(place, key)
                if self.mesh.has_facets(place)
                else self._mean_of_nodes(place)
            )
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
        mine = (
            (round(float(distance[best]), 12), *x[best].round(12), self.comm.rank)
            if best >= 0
            else (np.inf, 0, 0, 0, -1)
        )
        chosen = min(self.comm.allgather(tuple(float(v) for v in mine)))
        if chosen[0] > near:
            nearest = [round(v, 6) for v in chosen[1 : 1 + d]]
            away = f"{self.scene.source}: {key}.{name} = {list(wanted or ())}: "
            if name == "node":
                raise SceneError(
                    f"{away}no node lies there; the nearest is {nearest}, {chosen[0]:.3g} m away"
                )
            self.warnings.append(f"{away}the nearest node is {nearest}, {chosen[0]:.3g} m away")
        clamped = False
        if int(chosen[-1]) == self.comm.rank:
            for k in range(d):
                rows[k, best * d + k] = 1.0
            clamped = bool(np.isin(best * d, self._clamped))
            rows[:, self._clamped] = 0.0
        if self.comm.allreduce(clamped, op=MPI.LOR):
            raise SceneError(
                f"{self.scene.source}: {key}: the node at {list(chosen[1 : 1 + d])} is clamped; choose a free one"
            )
        return rows, np.array(chosen[1:4])

    def _mean(self, region: Region, key: str) -> tuple[Array, Array, float]:
        """Area-weighted mean over facets: weights (local / d,) of the nodes, the centroid (3,) and
        the area, m^2.
        """
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
        return (
            weights.x.array[:local] / area,
            position,
            float(area * (self.scene.geometry.thickness or 1.0)),
        )

    def _mean_of_nodes(self, region: Region) -> tuple[Array, Array, float]:
        """The same over a node group, weighted by the length of its edges, equal without any: the
        last is length or number.
        """
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
                side = int(
                    np.flatnonzero(topology.connectivity(topology.dim, 1).links(cell) == edge)[0]
                )
                nodes = scalar.dofmap.cell_dofs(cell)[
                    scalar.dofmap.dof_layout.entity_closure_dofs(1, side)
                ]
                weights.x.array[nodes] += share * np.linalg.norm(x[nodes[1]] - x[nodes[0]])
            weights.x.scatter_reverse(dolfinx.la.InsertMode.add)
        else:
            weights.x.array[self.mesh.nodes(region, scalar)] = 1.0
        mine = weights.x.array[:local]
        total = self.comm.allreduce(float(mine.sum()))
        return mine / total, np.asarray(self.comm.allreduce(mine @ x[:local])) / total, float(total)

    # ------------------------------------------------------------------ tabulation

    def tabulate(self, fields: Array) -> Iterator[tuple[Array, Array]]:
        """Quadrature weights and gradients of the equilibrium and of some fields, in chunks of
        cells owned by this rank.

        Args:
            fields: (local, n).

        Yields:
            weights (k,), thickness included, in m^3, and gradients (k, 1 + n, d, d), that of the
            equilibrium first.
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
