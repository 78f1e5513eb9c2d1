"""The operations that the time stepping asks of a model."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.compliance import Compliance
from fenicsrom.online.model.loads import LoadHistories


class Model(Protocol):
    """A model of n coordinates (the rows on this rank) and m contact displacements."""

    linear: bool
    velocity_forces: bool
    exact_newton: bool  # solve_effective solves with S itself, not with one of an earlier state
    gauss_points: int
    loads: Array  # (n, loads) unit loads
    load_histories: LoadHistories  # their time factors

    def set_at_rest(self) -> None:
        """Let only the static follower pressures act in the operations that follow."""

    def set_interval(self, begin: float, end: float) -> None:
        """Set the start and the end of the step, in s: the factors of the follower pressures."""

    def pressure_work(self, q0: Array, dq: Array) -> float:
        """Work of the follower pressures, without their constant part, over a step.

        A model that turns at a varying speed adds the work of this change.
        """

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Any]:
        """Mean force over a step and its derivative by dq.

        The force is start_weight*start + sum_g w_g f(q0 + s_g dq), follower pressures included
        but for their constant part, which belongs to the load vector. The model chooses the type of
        the derivative.
        """

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force, with the follower pressures at the end of the step, and energy at q."""

    def solve_effective(
        self,
        mass_coefficient: float,
        velocity_coefficient: float,
        tangent: Any,
        residual: Array,
        directions: NDArray[np.int64],
    ) -> tuple[Array, Array, Compliance]:
        """Solve S [y, Z] = [-residual, B]; returns y (n,), Z (n, r) and B^T Z (r, r).

        B are the given ones of the contact displacements.
        S = mass_coefficient M + velocity_coefficient D + tangent, the last as returned by
        `elastic_over_step`.
        """

    def write_normal_flexibility(self, h: float, out: Array) -> None:
        """Write the flexibility of each contact point along its normal for a step at rest, m/N.

        It is b^T S^-1 b with S = 2 M/h^2 + K/2, which has no gyroscopic nor viscous forces, and
        the row b of the normal displacement. K is the stiffness at rest without follower pressures.

        Args:
            h: size of the step, s.
            out: (P,) out.
        """

    def negative_directions(self, tangent: Any) -> int:
        """Number of negative eigenvalues of a tangent as returned by `elastic_over_step`."""

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""

    def mass_times(self, v: Array) -> Array:
        """M v."""

    def velocity_times(self, v: Array) -> Array:
        """D v, of a model with `velocity_forces`."""

    def dot(self, a: Array, b: Array) -> float:
        """Inner product over all ranks."""

    def load(self, time: float) -> Array:
        """Load vector at a time."""

    def write_momentum(self, time: float, q: Array, v: Array, out: Array) -> None:
        """Write angular momentum, moment of inertia and moment of the loads, at a varying speed."""
