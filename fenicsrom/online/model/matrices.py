"""The arrays of a reduced model as full numpy arrays, for another program.

The equation of motion of the n coordinates q, without contact forces, is

    M q'' + (C + Gamma) q' + f(q) = L s(t)                                           (1)
    f_i(q) = f0_i + K_ij q_j + 1/2 A_ijk q_j q_k + 1/6 B_ijkl q_j q_k q_l            (2)

with K, A and B symmetric in all their indices: they are the second, third and fourth derivatives
of the elastic energy at q = 0, the equilibrium under the static loads. The displacement of the
contact points in their local frames [normal, tangents] is

    x(q) = x0 + B_c q                                                                (3)

A contact force F (m,) in the same frames acts against the displacement (its normal component is
positive when the body presses on the surface): subtract B_c^T F from the right side of (1).
"""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.problem import Compliance, given_compliance
from fenicsrom.online.kernels.dense import negative_eigenvalues
from fenicsrom.online.model.kept_factor import same_coefficients
from fenicsrom.online.model.loads import LoadHistories, factors
from fenicsrom.online.model.model import ReducedModel, Tangent
from fenicsrom.online.model.polynomial import ElasticPolynomial, pair_numbers, pairs
from fenicsrom.words import brief

UNITS: Mapping[str, str] = {
    "mass": "kg",
    "damping": "kg/s",
    "gyroscopic": "kg/s",
    "force": "N",
    "stiffness": "N/m",
    "quadratic": "N/m^2",
    "cubic": "N/m^3",
    "loads": "N per unit of the load",
    "contact_rows": "1",
    "contact_offset": "m",
    "probe_rows": "1",
    "probe_offset": "m",
}
"""The unit of each array of `ModelArrays`, for coordinates in m."""


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class ModelArrays:
    """The arrays of equations (1) to (3): n coordinates, m contact displacements.

    The units are in `UNITS`. Every array is a copy, in C order, of float64.

    Attributes:
        mass: (n, n) M, symmetric, positive definite.
        damping: (n, n) C, symmetric: alpha M and the viscous damping.
        gyroscopic: (n, n) Gamma, skew; zero without Coriolis forces.
        force: (n,) f0, which the static loads balance.
        stiffness: (n, n) K, symmetric, the tangent at q = 0.
        quadratic: (n, n, n) A, symmetric in all indices; zero for a linear model.
        cubic: (n, n, n, n) B, symmetric in all indices; zero for a linear model.
        loads: (n, k) L, a column for each load of the scene, static loads included.
        contact_rows: (m, n) B_c; the rows of a contact point follow one another.
        contact_offset: (m,) x0.
        probe_rows: (d, n) rows that give the displacement of the probe in global axes.
        probe_offset: (d,) displacement of the probe at q = 0.
    """

    mass: Array
    damping: Array
    gyroscopic: Array
    force: Array
    stiffness: Array
    quadratic: Array
    cubic: Array
    loads: Array
    contact_rows: Array
    contact_offset: Array
    probe_rows: Array
    probe_offset: Array

    def elastic_force(self, q: Array) -> Array:
        """The elastic force (n,) at q (n,), equation (2), in N."""
        linear = self.force + self.stiffness @ q
        return linear + 0.5 * (self.quadratic @ q @ q) + (self.cubic @ q @ q @ q) / 6.0

    def tangent(self, q: Array) -> Array:
        """The derivative (n, n) of the elastic force by q at q (n,), in N/m."""
        return self.stiffness + self.quadratic @ q + 0.5 * (self.cubic @ q @ q)

    def contact_displacement(self, q: Array) -> Array:
        """The displacement (m,) of the contact points at q (n,), equation (3), in m."""
        return self.contact_offset + self.contact_rows @ q

    def asdict(self) -> dict[str, Array]:
        """The arrays by name, for `numpy.savez` or `scipy.io.savemat`."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}


def model_arrays(given: Any, source: str = "") -> ModelArrays:
    """Expand a reduced model to full symmetric arrays; B takes 8 n^4 bytes.

    Args:
        given: the reduced model, or the stored model that holds it.
        source: name of the scene file, for messages.

    Raises:
        SceneError: a follower pressure acts on the model, for which equation (1) has no term.
        TypeError: the argument is no model.

    Example:
        >>> import fenicsrom as fr
        >>> arrays = fr.model_arrays(fr.load_model("out/beam.npz"))
        >>> arrays.mass.shape, arrays.loads.shape, arrays.contact_rows.shape
        ((9, 9), (9, 1), (2, 9))
        >>> float(arrays.damping[0, 0] / arrays.mass[0, 0])  # the key superelement.mass_damping
        5.0
    """
    model = getattr(given, "model", given)
    if not isinstance(model, ReducedModel):
        raise TypeError(
            f"model_arrays: {type(given).__name__}: must be a StoredModel, such as load_model or "
            "build_model returns, or its ReducedModel"
        )
    if model.pressure.numbers.size:
        key = f"loads[{int(model.pressure.numbers[0])}].follower"
        raise SceneError(
            f"{source}{': ' if source else ''}{key} = true: not allowed in a model for another "
            "program, whose arrays describe conservative forces only",
            kind=ErrorKind.CONFLICT,
            key=key,
            source=source,
        )
    n = model.size
    quadratic, cubic = full_tensors(model.elastic)
    velocity = model.velocity_matrix if model.velocity_forces else np.zeros((n, n))
    return ModelArrays(
        mass=model.mass.copy(),
        damping=model.damping * model.mass + 0.5 * (velocity + velocity.T),
        gyroscopic=0.5 * (velocity - velocity.T),
        force=model.elastic.force.copy(),
        stiffness=model.elastic.stiffness.copy(),
        quadratic=quadratic,
        cubic=cubic,
        loads=model.loads.copy(),
        contact_rows=model.contact_rows.copy(),
        contact_offset=model.contact_offset.copy(),
        probe_rows=model.probe.copy(),
        probe_offset=model.probe_offset.copy(),
    )


def full_tensors(elastic: ElasticPolynomial) -> tuple[Array, Array]:
    """Expand the paired coefficients to A (n, n, n) and B (n, n, n, n); zero for a linear model."""
    n = elastic.stiffness.shape[0]
    if elastic.cubic.shape[0] == 0:
        return np.zeros((n, n, n)), np.zeros((n, n, n, n))
    (first, second), pair = pairs(n), pair_numbers(n)
    # the program stores B / 2 with the columns k < l doubled
    both = elastic.cubic * np.where(first == second, 2.0, 1.0)
    return elastic.quadratic[pair], both[pair[:, :, None, None], pair[None, None, :, :]]


@dataclass(eq=False)
class DenseModel:
    """A model of n coordinates with dense matrices and an elastic force given as a function.

    It has the operations of a `ReducedModel`. Two models use it: the 1D beam, and the projection of
    the full elastic force, which is the paper's method and checks the polynomial.

    Attributes:
        mass: (n, n), kg.
        damping: alpha in C = alpha M, 1/s.
        elastic: q -> force (n,) and tangent (n, n).
        energy: q -> elastic energy, J.
        loads: (n, loads) unit loads.
        load_histories: their time factors.
        points: the contact points.
        contact_rows: (m, n) B^T.
        contact_offset: (m,) contact displacement at q = 0.
        probe: (d, n) rows of the probe's displacement.
        probe_offset: (d,) its displacement at q = 0.
        velocity_matrix: (n, n) D; given as (0, 0) without such forces.
        linear: the tangent is constant.
        gauss_points: points that integrate the force along a step exactly, or to rounding.
    """

    mass: Array
    damping: float
    elastic: Callable[[Array], tuple[Array, Array]]
    energy: Callable[[Array], float]
    loads: Array
    load_histories: LoadHistories
    points: ContactPoints
    contact_rows: Array
    contact_offset: Array
    probe: Array
    probe_offset: Array
    velocity_matrix: Array = field(default_factory=lambda: np.zeros((0, 0)))
    _: KW_ONLY
    linear: bool
    gauss_points: int
    exact_newton = True  # otherwise a step keeps S, and solves for all contact points

    def __post_init__(self) -> None:
        """Begin without a factor."""
        self.velocity_forces = self.velocity_matrix.size > 0
        if not self.velocity_forces:
            self.velocity_matrix = 0.0 * self.mass
        self._rows: Any = self.contact_rows  # sparse where a row reaches few coordinates
        self._inverse: Callable[[Array], Array] | None = None
        self._key: tuple[float, float, float] | None = None
        self._response: tuple[Array, Compliance] | None = None  # Z and BᵀZ of a kept factor

    def set_at_rest(self) -> None:
        """Do nothing: this model has no follower pressure."""

    def set_interval(self, begin: float, end: float) -> None:
        """Do nothing: this model has no follower pressure."""

    def pressure_work(self, q0: Array, dq: Array) -> float:
        """Zero: this model has no follower pressure."""
        return 0.0

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Tangent]:
        """Mean force over a step and its derivative by dq."""
        mean, coefficient = start_weight * start, 0.0
        matrix: Any = 0.0
        for point, weight in zip(points, weights, strict=True):
            force, tangent = self.elastic(q0 + point * dq)
            mean = mean + weight * force
            coefficient += weight * point
            matrix = tangent if self.linear else matrix + weight * point * tangent
        if self.linear:
            matrix = coefficient * matrix
        return mean, Tangent(matrix, float(coefficient))

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (n,) and energy."""
        return self.elastic(q)[0], self.energy(q)

    def solve_effective(
        self,
        mass_coefficient: float,
        velocity_coefficient: float,
        tangent: Tangent,
        residual: Array,
        directions: NDArray[np.int64],
    ) -> tuple[Array, Array, Compliance]:
        """Solve S [y, Z] = [-residual, B], as `ReducedModel.solve_effective`."""
        key = mass_coefficient, velocity_coefficient, tangent.coefficient
        same = self._key is not None and same_coefficients(key, self._key)
        if not (same and self.keeps_factor(mass_coefficient)):
            effective = mass_coefficient * self.mass + tangent.matrix
            if self.velocity_forces:
                effective = effective + velocity_coefficient * self.velocity_matrix
            self._inverse, self._key, self._response = self.inverse(effective), key, None
        assert self._inverse is not None
        if not self.linear and self.exact_newton:
            solved = self._inverse(
                np.concatenate([self.contact_rows[directions], -residual[None]]).T
            )
            unit = solved[:, :-1]
            return solved[:, -1], unit, given_compliance(self._rows[directions] @ unit)
        if self._response is None:
            unit = self._inverse(self.contact_rows.T)
            self._response = unit, given_compliance(self._rows @ unit)
        y, (unit, compliance) = self._inverse(-residual), self._response
        if directions.size < unit.shape[1]:
            of_some = compliance.delassus[np.ix_(directions, directions)]
            unit, compliance = unit[:, directions], given_compliance(of_some)
        return y, unit, compliance

    def keeps_factor(self, mass_coefficient: float) -> bool:
        """Whether S of the last call serves again, with the same coefficients."""
        return self.linear

    def inverse(self, matrix: Any) -> Callable[[Array], Array]:
        """The inverse of a matrix (n, n) times a block (n, k); NaN if the matrix is singular."""
        from scipy.linalg import lu_factor, lu_solve  # slow to import, and few runs need it

        if np.all(np.isfinite(matrix)):
            factor = lu_factor(matrix, check_finite=False)
            if np.all(np.diag(factor[0]) != 0.0):
                return lambda block: np.asarray(lu_solve(factor, block, check_finite=False))
        return lambda block: np.full(block.shape, np.nan)

    def write_normal_flexibility(self, h: float, out: Array) -> None:
        """Write the flexibility (P,) of the contact points, as `ReducedModel`."""
        effective = 2.0 / h**2 * self.mass + 0.5 * self.elastic(np.zeros(self.mass.shape[0]))[1]
        normals = self.contact_rows[:: len(self.contact_rows) // out.size]
        out[:] = np.sum(normals.T * self.inverse(effective)(normals.T), axis=0)

    def negative_directions(self, tangent: Tangent) -> int:
        """Number of negative eigenvalues of a stiffness."""
        return negative_eigenvalues(tangent.matrix)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return self.contact_offset + self._rows @ q

    def contact_change(self, dq: Array) -> Array:
        """Change of the contact displacement (m,) by dq (n,)."""
        return np.asarray(self._rows @ dq)

    def add_contact_force(self, out: Array, force: Array) -> None:
        """Add the contact forces (P, d) on the coordinates to out (n,), N."""
        out += self._rows.T @ force.ravel()

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""
        return self.probe_offset + self.probe @ q

    def mass_times(self, v: Array) -> Array:
        """M v."""
        return self.mass @ v

    def velocity_times(self, v: Array) -> Array:
        """D v."""
        return self.velocity_matrix @ v

    def dot(self, a: Array, b: Array) -> float:
        """Inner product."""
        return float(a @ b)

    def load(self, time: float) -> Array:
        """Load vector at a time."""
        return self.loads @ factors(self.load_histories, time)
