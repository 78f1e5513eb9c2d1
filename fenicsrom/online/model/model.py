"""The reduced model in coordinates q, its problem, and the equations of a Newton iteration."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.problem import Compliance, compliance_of, form_delassus, is_formed
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.kernels.compilation import compile_methods, kernel
from fenicsrom.online.kernels.dense import (
    add_combined_rows,
    add_times,
    inner,
    lu_factor,
    lu_solve,
    negative_eigenvalues,
    write_times,
)
from fenicsrom.online.model.bolts import Bolts, no_bolts
from fenicsrom.online.model.loads import (
    LoadHistories,
    PressurePolynomial,
    no_pressure,
    static_factors,
    subtract_pressure,
    subtract_pressure_at_end,
    unit_tangent,
    work_of_pressure,
    write_factors,
    write_pressure_factors,
)
from fenicsrom.online.model.polynomial import (
    ElasticPolynomial,
    Workspace,
    elastic_force_with,
    elastic_mean,
)
from fenicsrom.online.model.turning import (
    Turning,
    add_turning,
    add_turning_at_end,
    no_turning,
    turning_work,
    write_momentum,
    write_speeds,
)

WEAR_ROUNDING = 1e-9
"""Growth of a worn depth, relative to the largest one, that is rounding."""


class Problem(NamedTuple):
    """A model under its loads, its damping and its contacts, and how its motion is computed.

    Attributes:
        model: a `online.model.model.ReducedModel`, or any model with its operations.
        contacts: parameters of the P contact points, in the order of the model's contact
            displacements.
        time: a `fenicsrom.scene.Time`: scheme, step or tolerance, periods, steady tolerance and way
            to the steady state, or duration.
        period: period of the loads, s; None runs for `time.duration`.
        varied: the same problem at p + i h, h = `online.kernels.numbers.STEP`, where p is the
            parameter of a family of problems: the imaginary parts of its numbers are h times their
            derivatives by p. None of a problem by itself.
        rest: (n,) coordinates of a state near which the model moves, from which the variables of a
            periodic motion are measured; None of q = 0.
    """

    model: Any
    contacts: Contacts
    time: Any
    period: Any
    varied: Any = None
    rest: Any = None

    @classmethod
    def of(cls, model: Any, scene: Any) -> Problem:
        """The problem of a model that has the loads and the damping of a scene.

        Raises:
            SceneError: as `contacts_of`.
        """
        return cls(model, contacts_of(scene, model.points), scene.time, scene.period)

    @property
    def dimension(self) -> int:
        """The dimension of space d."""
        return int(self.contacts.centre.shape[1])

    def settled(self) -> Problem:
        """The problem after all surfaces have approached the body."""
        contacts = self.contacts
        if contacts.times.size == 0:
            return self
        last = np.ascontiguousarray(contacts.approach[:, -1:])
        moved = contacts._replace(times=contacts.times[-1:].copy(), approach=last)
        return self._replace(contacts=moved)

    def with_own_wear(self, worn: Array | None = None) -> Problem:
        """The problem with its own copy of the worn depths, or of others (nodes,), in m.

        A march changes them.
        """
        coating = self.contacts.coating
        coating = coating._replace(worn=(coating.worn if worn is None else worn).copy())
        return self._replace(contacts=self.contacts._replace(coating=coating))

    def with_yield(self, factor: float) -> Problem:
        """The problem with layers of so many times the yield stress; infinitely many: elastic."""
        coating = self.contacts.coating
        coated = coating.cells > 0
        strength = np.where(coated, coating.yield_force, 1.0) * factor
        coating = coating._replace(yield_force=np.where(coated, strength, 0.0))
        return self._replace(contacts=self.contacts._replace(coating=coating))

    def has_worn_since(self, worn: Array) -> bool:
        """Whether a layer was worn since its depths were `worn` (nodes,), beyond rounding."""
        now = self.contacts.coating.worn
        return bool(np.any(now - worn > WEAR_ROUNDING * np.max(now, initial=0.0)))


@kernel
def factorise_effective(
    mass: Array,
    velocity_matrix: Array,
    linear: bool,
    mass_coefficient: float,
    velocity_coefficient: float,
    tangent: Array,
    tangent_coefficient: float,
    work: Workspace,
) -> None:
    """Write the factors of S of `ReducedModel.solve_effective`, unless a linear model has them."""
    n, factor, key = mass.shape[0], work.factor, work.key
    if (
        linear
        and key[0] == mass_coefficient
        and key[1] == velocity_coefficient
        and key[2] == tangent_coefficient
    ):
        return
    for i in range(n):
        for j in range(n):
            factor[i, j] = mass_coefficient * mass[i, j] + tangent[i, j]
    if velocity_coefficient != 0.0 and velocity_matrix.shape[0] > 0:
        for i in range(n):
            for j in range(n):
                factor[i, j] += velocity_coefficient * velocity_matrix[i, j]
    key[0] = mass_coefficient if lu_factor(factor, work.pivots, n) else np.nan
    key[1] = velocity_coefficient
    key[2] = tangent_coefficient


@kernel
def write_effective_solution(
    rows: Array, directions: NDArray[np.int64], d: int, residual: Array, work: Workspace
) -> None:
    """Write the solutions of `ReducedModel.solve_effective` to `compliance`, y behind Z."""
    n, r, compliance = residual.size, directions.size, work.compliance
    unit, delassus = compliance.unit, compliance.delassus
    for i in range(n):
        unit[i, r] = -residual[i]
        for j in range(r):
            unit[i, j] = rows[directions[j], i]
    if np.isnan(work.key[0]):
        unit[:] = np.nan
    else:
        lu_solve(work.factor, work.pivots, unit, n, 1 + r)
    if is_formed(compliance, r):
        form_delassus(rows, compliance, directions)
        return
    for i in range(r):  # only the block of the point
        first = i - i % d
        for j in range(first, first + d):
            delassus[i, j] = 0.0
            for k in range(n):
                delassus[i, j] += rows[directions[i], k] * unit[k, j]


@kernel
def write_normal_flexibility(
    mass: Array, stiffness: Array, rows: Array, h: float, work: Workspace, out: Array
) -> None:
    """Write b^T S^-1 b of each contact point; see `ReducedModel.write_normal_flexibility`."""
    n, points, factor, unit = mass.shape[0], out.size, work.factor, work.compliance.unit
    d = rows.shape[0] // points
    for i in range(n):
        for j in range(n):
            factor[i, j] = 2.0 / h**2 * mass[i, j] + 0.5 * stiffness[i, j]
        for p in range(points):
            unit[i, p] = rows[p * d, i]
    work.key[0] = np.nan  # it is not the factor of a step
    if not lu_factor(factor, work.pivots, n):
        unit[:] = np.nan
    else:
        lu_solve(factor, work.pivots, unit, n, points)
    for p in range(points):
        out[p] = 0.0
        for i in range(n):
            out[p] += rows[p * d, i] * unit[i, p]


class Tangent(NamedTuple):
    """The derivative of the mean elastic force of a step by dq.

    Attributes:
        matrix: (n, n), N/m.
        coefficient: sum of w_g s_g, the factor of the stiffness in `matrix` for a linear model.
    """

    matrix: Array
    coefficient: float


class ReducedModel(NamedTuple):
    """Everything the online stage needs of n coordinates and m contact displacements.

    Attributes:
        mass: (n, n), kg.
        damping: alpha in C = alpha M, 1/s.
        elastic: coefficients of the elastic force.
        loads: (n, loads), unit loads projected on the basis.
        load_histories: time factors of the loads.
        points: the contact points.
        contact_rows: (m, n) B^T R, contact displacements by coordinates; m = 0 without contact.
        contact_offset: (m,) contact displacement at q = 0 (the equilibrium), m.
        probe: (d, n) rows that give the displacement of the probe, in global axes.
        probe_offset: (d,) displacement of the probe at q = 0, m.
        velocity_matrix: (n, n) D of the forces D v besides alpha M v, kg/s: gyroscopic matrix and
            viscous damping; (0, 0) of a model without.
        pressure: coefficients of the follower pressures; their forces are part of those that
            `elastic_over_step` and `elastic_at` give.
        turning: the forces of a varying speed; their sum is part of the same forces.
        bolts: the bolts, whose forces are part of `elastic`.
        work: arrays for the results.
    """

    mass: Array
    damping: float
    elastic: ElasticPolynomial
    loads: Array
    load_histories: LoadHistories
    points: ContactPoints
    contact_rows: Array
    contact_offset: Array
    probe: Array
    probe_offset: Array
    velocity_matrix: Array
    pressure: PressurePolynomial
    turning: Turning
    bolts: Bolts
    work: Workspace

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.mass.shape[0]

    @property
    def linear(self) -> bool:
        """Whether the elastic force is linear."""
        return self.elastic.cubic.shape[0] == 0

    @property
    def exact_newton(self) -> bool:
        """`solve_effective` solves with S itself."""
        return True

    @property
    def velocity_forces(self) -> bool:
        """Whether there are forces D v."""
        return self.velocity_matrix.shape[0] > 0

    @property
    def gauss_points(self) -> int:
        """Gauss points that integrate a force along a step exactly: 2 if cubic, 1 if linear."""
        return 1 if self.linear else 2

    def rest_stiffness(self) -> Array:
        """The tangent (n, n) at q = 0 with the static follower pressures, N/m."""
        factors, found = static_factors(self.load_histories), self.elastic.stiffness.copy()
        for k, number in enumerate(self.pressure.numbers):
            found -= factors[number] * unit_tangent(self.pressure, k, np.zeros(self.size))
        return found

    def damping_matrix(self) -> Array:
        """The matrix alpha M + D (n, n), kg/s."""
        found = self.damping * self.mass
        return found + self.velocity_matrix if self.velocity_forces else found

    def set_at_rest(self) -> None:
        """Let only the static follower pressures act in the operations that follow."""
        factors = static_factors(self.load_histories)
        self.work.pressure_factors[:] = factors[self.pressure.numbers]
        if self.turning.history.shape[0] > 0:
            write_speeds(self.turning, 0.0, 0.0, self.work.speeds)

    # The operations that the time stepping asks of any model; here compiled code calls them too.

    def set_interval(self, begin: float, end: float) -> None:
        """Set the start and the end of the step, in s, for the operations that follow."""
        if self.pressure.numbers.shape[0] > 0:
            write_pressure_factors(self.pressure, self.load_histories, begin, end, self.work)
        if self.turning.history.shape[0] > 0:
            write_speeds(self.turning, begin, end, self.work.speeds)

    def pressure_work(self, q0: Array, dq: Array) -> float:
        """Work of the follower pressures, without their constant part, over a step, J.

        That of a varying speed is added.
        """
        found = 0.0
        if self.pressure.numbers.shape[0] > 0:
            found += work_of_pressure(self.pressure, self.work, q0, dq)
        if self.turning.history.shape[0] > 0:
            found += turning_work(self.turning, self.work.speeds, q0, dq, self.work.points[0])
        return found

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Tangent]:
        """Mean elastic force over a step and its derivative by dq."""
        coefficient = elastic_mean(
            self.elastic, self.work, start, q0, dq, start_weight, points, weights
        )
        if self.pressure.numbers.shape[0] > 0:
            subtract_pressure(self.pressure, self.work, q0, dq, points, weights)
        if self.turning.history.shape[0] > 0:
            add_turning(
                self.turning,
                self.work.speeds,
                self.velocity_matrix,
                q0,
                dq,
                coefficient,
                weights,
                self.work.force,
                self.work.tangent,
                self.work.velocity,
            )
        return self.work.force, Tangent(self.work.tangent, coefficient)

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy at q."""
        work = self.work
        energy = elastic_force_with(
            self.elastic, work.columns, work.points, work.products, q, work.force, work.tangent
        )
        if self.pressure.numbers.shape[0] > 0:
            subtract_pressure_at_end(self.pressure, self.work, q)
        if self.turning.history.shape[0] > 0:
            energy += add_turning_at_end(self.turning, self.work.speeds[1], q, self.work.force)
        return self.work.force, energy

    def solve_effective(
        self,
        mass_coefficient: float,
        velocity_coefficient: float,
        tangent: Tangent,
        residual: Array,
        directions: NDArray[np.int64],
    ) -> tuple[Array, Array, Compliance]:
        """Solve S [y, Z] = [-residual, B] for the r given contact directions B.

        S = mass_coefficient M + velocity_coefficient D + tangent. A linear model keeps its
        factor while the three coefficients are the same. A singular S gives NaN.

        Returns:
            y (n,), Z (n, r) and the `Compliance` B^T Z.
        """
        work, unit = self.work, self.work.compliance.unit
        factorise_effective(
            self.mass,
            work.velocity if self.turning.history.shape[0] > 0 else self.velocity_matrix,
            self.elastic.cubic.shape[0] == 0 and self.turning.history.shape[0] == 0,
            mass_coefficient,
            velocity_coefficient,
            tangent.matrix,
            tangent.coefficient,
            work,
        )
        d = self.points.frame.shape[2]
        write_effective_solution(self.contact_rows, directions, d, residual, work)
        return unit[:, directions.size], unit[:, : directions.size], work.compliance

    def write_normal_flexibility(self, h: float, out: Array) -> None:
        """Write the flexibility (P,) of the contact points along their normals for a step at rest.

        The solutions S^-1 b stay in the first columns of `work.compliance.unit`.
        """
        write_normal_flexibility(
            self.mass, self.elastic.stiffness, self.contact_rows, h, self.work, out
        )

    def negative_directions(self, tangent: Tangent) -> int:
        """Number of negative eigenvalues of a stiffness as `elastic_over_step` gives it."""
        return negative_eigenvalues(tangent.matrix)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,) at q, m."""
        work = self.work
        add_times(self.contact_offset, self.contact_rows, work.contact_columns, q, work.contact)
        return work.contact

    def contact_change(self, dq: Array) -> Array:
        """Change of the contact displacement (m,) by dq, m."""
        work = self.work
        work.contact[:] = 0.0
        add_times(work.contact, self.contact_rows, work.contact_columns, dq, work.contact)
        return work.contact

    def add_contact_force(self, out: Array, force: Array) -> None:
        """Add the contact forces (P, d) on the coordinates to out (n,), N."""
        add_combined_rows(force.reshape(1, -1), self.contact_rows, out.reshape(1, -1))

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe at q, m."""
        moved = np.empty(self.probe.shape[0])
        write_times(self.probe, q, moved)
        return self.probe_offset + moved

    def mass_times(self, v: Array) -> Array:
        """M v (n,)."""
        write_times(self.mass, v, self.work.mass_product)
        return self.work.mass_product

    def velocity_times(self, v: Array) -> Array:
        """D v (n,), with the mean Coriolis force of the step at a varying speed."""
        velocity = self.velocity_matrix
        if self.turning.history.shape[0] > 0:
            velocity = self.work.velocity
        write_times(velocity, v, self.work.velocity_product)
        return self.work.velocity_product

    def dot(self, a: Array, b: Array) -> float:
        """Inner product of two vectors (n,)."""
        return inner(a, b)

    def load(self, time: float) -> Array:
        """Load vector (n,) at a time, N."""
        write_factors(self.load_histories, time, self.work.factors)
        write_times(self.loads, self.work.factors, self.work.load_vector)
        return self.work.load_vector

    def write_momentum(self, time: float, q: Array, v: Array, out: Array) -> None:
        """Write angular momentum, moment of inertia and moment of the loads at a time to out."""
        write_factors(self.load_histories, time, self.work.factors)
        omega = self.work.speeds[1]
        write_momentum(self.turning, omega, q, v, self.work.factors, out)


def reduced_model(
    mass: Array,
    damping: float,
    elastic: ElasticPolynomial,
    loads: Array,
    load_histories: LoadHistories,
    points: ContactPoints,
    contact_rows: Array,
    contact_offset: Array,
    probe: Array,
    probe_offset: Array,
    velocity_matrix: Array | None = None,
    pressure: PressurePolynomial | None = None,
    turning: Turning | None = None,
    bolts: Bolts | None = None,
) -> ReducedModel:
    """A `ReducedModel` with its workspace; arguments as its attributes.

    Raises:
        ValueError: the probe has not one row (n,) for each direction of space.
    """
    n, d = mass.shape[0], points.frame.shape[2]
    if probe.shape != (d, n):
        raise ValueError(f"the probe has the shape {probe.shape}, not {d, n}")
    velocity_matrix = np.zeros((0, 0)) if velocity_matrix is None else velocity_matrix
    pressure = no_pressure(n) if pressure is None else pressure
    turning = no_turning() if turning is None else turning
    bolts = no_bolts(d, 1 + n) if bolts is None else bolts
    elastic, contact_rows = _tidy(elastic), np.ascontiguousarray(contact_rows, np.float64)
    return ReducedModel(
        mass=np.ascontiguousarray(mass, np.float64),
        damping=float(damping),
        elastic=elastic,
        loads=np.ascontiguousarray(loads, np.float64),
        load_histories=load_histories,
        points=_tidy(points, "contact"),
        contact_rows=contact_rows,
        contact_offset=np.ascontiguousarray(contact_offset, np.float64),
        probe=np.ascontiguousarray(probe, np.float64),
        probe_offset=np.ascontiguousarray(probe_offset, np.float64),
        velocity_matrix=np.ascontiguousarray(velocity_matrix, np.float64),
        pressure=_tidy(pressure, "numbers"),
        turning=_tidy(turning)._replace(inertia=float(turning.inertia)),
        bolts=_tidy(bolts),
        work=_workspace(elastic, loads, contact_rows, velocity_matrix, pressure),
    )


def _workspace(
    elastic: ElasticPolynomial,
    loads: Array,
    contact_rows: Array,
    velocity_matrix: Array,
    pressure: PressurePolynomial,
) -> Workspace:
    """The scratch arrays of a model; arguments as its attributes."""
    n, m, pressures = elastic.force.size, contact_rows.shape[0], pressure.numbers.size
    fields = {
        "columns": np.ascontiguousarray(elastic.quadratic.T),
        "key": np.full(3, np.nan),
        "compliance": compliance_of(contact_rows),
        "contact_columns": np.ascontiguousarray(contact_rows.T),
    }
    sizes = {"p": elastic.cubic.shape[0], "loads": loads.shape[1], "D": velocity_matrix.shape[0]}
    sizes |= {"n": n, "m": m, "k": pressures, "pressed": n if pressures else 0}
    return zeros(Workspace, fields, **sizes)


def _tidy(values: Any, integers: str = "") -> Any:
    """A named tuple with its arrays in C order, of float64 but for the one of integers."""
    return values._make(
        np.ascontiguousarray(array, np.int64 if name == integers else np.float64)
        for name, array in values._asdict().items()
    )


OPERATIONS = (
    *("set_interval", "pressure_work", "elastic_over_step", "elastic_at", "solve_effective"),
    *("write_normal_flexibility", "contact_displacement", "contact_change", "add_contact_force"),
    "probe_displacement",
    *("mass_times", "velocity_times", "dot", "load", "write_momentum"),
)
"""The methods that compiled code calls."""

compile_methods(ReducedModel, OPERATIONS)
