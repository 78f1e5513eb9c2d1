"""A model of dense matrices with an elastic force given as a function."""

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.compliance import Compliance, given_compliance
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.kernels.symmetric import negative_eigenvalues
from fenicsrom.online.model.loads import LoadHistories, factors
from fenicsrom.online.model.model import Tangent


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
    exact_newton = True

    def __post_init__(self) -> None:
        """Begin without a factor."""
        self.velocity_forces = self.velocity_matrix.size > 0
        if not self.velocity_forces:
            self.velocity_matrix = np.zeros_like(self.mass)
        self._factor: tuple[Array, NDArray[np.int32]] | None = None
        self._key: tuple[float, float, float] | None = None

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
        mean, matrix, coefficient = start_weight * start, np.zeros_like(self.mass), 0.0
        for point, weight in zip(points, weights, strict=True):
            force, tangent = self.elastic(q0 + point * dq)
            mean = mean + weight * force
            matrix += weight * point * tangent
            coefficient += weight * point
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
        from scipy.linalg import lu_factor, lu_solve  # slow to import, and few runs need it

        key = mass_coefficient, velocity_coefficient, tangent.coefficient
        if not (self.linear and key == self._key):
            effective = mass_coefficient * self.mass + tangent.matrix
            if self.velocity_forces:
                effective += velocity_coefficient * self.velocity_matrix
            self._factor = (
                lu_factor(effective, check_finite=False) if np.all(np.isfinite(effective)) else None
            )
            self._key = key
        rows = self.contact_rows[directions]
        block = np.concatenate([-residual[:, None], rows.T], axis=1)
        if self._factor is None or np.any(np.diag(self._factor[0]) == 0.0):
            block[:] = np.nan
        else:
            block = lu_solve(self._factor, block, check_finite=False)
        return block[:, 0].copy(), block[:, 1:].copy(), given_compliance(rows @ block[:, 1:])

    def write_normal_flexibility(self, h: float, out: Array) -> None:
        """Write the flexibility (P,) of the contact points, as `ReducedModel`."""
        effective = 2.0 / h**2 * self.mass + 0.5 * self.elastic(np.zeros(len(self.mass)))[1]
        normals = self.contact_rows[:: len(self.contact_rows) // out.size]
        out[:] = np.sum(normals.T * np.linalg.solve(effective, normals.T), axis=0)

    def negative_directions(self, tangent: Tangent) -> int:
        """Number of negative eigenvalues of a stiffness."""
        return negative_eigenvalues(tangent.matrix)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return self.contact_offset + self.contact_rows @ q

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
