"""The full model: all unknowns of the mesh, for the time integration."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.linalg import Factorisation, multiply, negative_eigenvalues
from fenicsrom.fem.solid import Solid
from fenicsrom.online.load_histories import factors
from fenicsrom.online.scheme import Scheme
from fenicsrom.reduction.beam import BeamStructure
from fenicsrom.reduction.protocols import Structure


def full_model(body: Structure) -> Any:
    """The full model of a structure, for the time integration."""
    if isinstance(body, BeamStructure):
        return body.full_model()

    return FullModel(body)


Slope = list[tuple[float, Array]]

_SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN


class FullModel:
    """The full model of a solid: a `fenicsrom.online.operations.Model` of q = u − u₀.

    Vectors hold the unknowns that this rank owns.
    """

    def __init__(self, solid: Solid):
        """Take the forms and matrices of the solid; geometrically linear if its scene is."""
        self._solid = solid
        self.linear = not solid.geometrically_nonlinear
        self.gauss_points = 1 if self.linear else 2
        self.damping = solid.mass_damping
        self.loads, self.load_histories, self.points = (
            solid.load_vectors,
            solid.load_histories,
            solid.points,
        )
        self.velocity_forces = solid.gyroscopic is not None
        self._rows = solid.contact_rows
        self._offset = solid.comm.allreduce(self._rows @ solid.equilibrium)
        self._columns = self._rows.T.copy()
        self._probe_offset = solid.comm.allreduce(solid.probe_rows @ solid.equilibrium)
        self._energy = 0.0 if self.linear else solid.energy(solid.equilibrium)
        self._start = solid.rest_force if self.linear else np.zeros(0)
        # M with ones on the clamped rows, where every vector is zero, so that it can be factorised
        self._mass = solid.matrix(solid.mass_form, 1.0)
        self._effective = solid.stiffness.copy()
        self._factor: Factorisation | None = None
        self._key: tuple[float, float, float] | None = None

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Slope]:
        """Mean force over a step, and the states and weights of its tangent.

        The tangent itself is assembled when it is needed.
        """
        mean = start_weight * start
        slope: Slope = []
        for point, weight in zip(points, weights, strict=True):
            q = q0 + point * dq
            if weight != 0.0:
                mean = mean + weight * self._force(q)
            slope.append((weight * point, q))
        return mean, slope

    def _force(self, q: Array) -> Array:
        if self.linear:
            return self._start + multiply(self._solid.stiffness, q)
        return self._solid.internal_force(self._solid.equilibrium + q)

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (local,) and energy above that of the equilibrium."""
        force = self._force(q)
        if self.linear:
            return force, 0.5 * self.dot(q, force + self._start)
        return force, self._solid.energy(self._solid.equilibrium + q) - self._energy

    def solve_effective(
        self,
        mass_coefficient: float,
        velocity_coefficient: float,
        tangent: Slope,
        residual: Array,
    ) -> tuple[Array, Array, Array]:
        """Solve S [y, Z] = [-residual, B] with S of `fenicsrom.online.operations.Model`."""
        key = (mass_coefficient, velocity_coefficient, sum(weight for weight, _ in tangent))
        if not (self.linear and key == self._key):
            self._assemble(mass_coefficient, velocity_coefficient, tangent)
            try:
                if self._factor is None:
                    self._factor = Factorisation(
                        self._effective, "fenicsrom_step", symmetric=not self.velocity_forces
                    )
                else:
                    self._factor.update()
            except ConvergenceError:  # the step is refused, as for the compiled model
                self._key = None
                bad = np.full((residual.size, 1 + self._rows.shape[0]), np.nan)
                return bad[:, 0], bad[:, 1:], np.full((self._rows.shape[0],) * 2, np.nan)
            self._key = key
        assert self._factor is not None
        block = self._factor.solve(np.concatenate([-residual[:, None], self._columns], axis=1))
        y, unit = block[:, 0].copy(), block[:, 1:].copy()
        return y, unit, np.asarray(self._solid.comm.allreduce(self._rows @ unit))

    @property
    def local(self) -> int:
        """Number of unknowns that this rank owns."""
        return int(self._solid.local)

    def contact_change(self, block: Array) -> Array:
        """Changes of the contact displacement (m, k) by changes (local, k) of q."""
        return np.asarray(self._solid.comm.allreduce(self._rows @ block))

    def mass_block(self, block: Array) -> Array:
        """M times a block (local, k)."""
        return multiply(self._solid.mass, block)

    def elastic_by_start(self, q0: Array, dq: Array, scheme: Scheme, block: Array) -> Array:
        """Derivative of the mean elastic force of a step by its start q0, times a block."""
        points = [(scheme.start_weight, 0.0), *zip(scheme.weights, scheme.points, strict=True)]
        found = np.zeros_like(block)
        for weight, point in points:
            if weight == 0.0:
                continue
            if self.linear:
                found += weight * multiply(self._solid.stiffness, block)
            else:
                u = self._solid.equilibrium + q0 + point * dq
                found += weight * self._solid.tangent_times(u, block)
        return found

    def solve_with_contact(self, block: Array, force: Array, by_end: Array) -> Array:
        """Solve (S + B F' B^T) X = -(block + B force) with S of the last `solve_effective`.

        Args:
            block: (local, k).
            force: (m, k) changes of the contact forces.
            by_end: (m, m) F', derivative of the contact forces by the end of the step, N/m.
        """
        assert self._factor is not None
        m, k = force.shape
        right = np.concatenate([-(block + self._columns @ force), self._columns], axis=1)
        found = self._factor.solve(right)
        free, unit = found[:, :k], found[:, k:]
        seen = self.contact_change(found)
        small = np.eye(m) + by_end @ seen[:, k:]
        return np.asarray(free - unit @ np.linalg.solve(small, by_end @ seen[:, :k]))

    def negative_directions(self, slope: Slope) -> int:
        """Number of negative eigenvalues of a stiffness as `elastic_over_step` gives it."""
        self._assemble(0.0, 0.0, slope)
        self._key = None
        return negative_eigenvalues(self._effective)

    def _assemble(self, inertia: float, drag: float, slope: Slope) -> None:
        self._effective.zeroEntries()
        for weight, q in slope:
            if weight == 0.0:
                continue
            if self.linear:
                self._effective.axpy(weight, self._solid.stiffness, structure=_SAME)
            else:
                self._solid.add_tangent(self._effective, self._solid.equilibrium + q, weight)
        self._effective.axpy(inertia, self._mass, structure=_SAME)
        if self.velocity_forces and drag != 0.0:
            self._effective.axpy(
                drag, self._solid.gyroscopic, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
            )

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return np.asarray(self._offset + self._solid.comm.allreduce(self._rows @ q))

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""
        return np.asarray(
            self._probe_offset + self._solid.comm.allreduce(self._solid.probe_rows @ q)
        )

    def mass_times(self, v: Array) -> Array:
        """M v."""
        return multiply(self._solid.mass, v)

    def velocity_times(self, v: Array) -> Array:
        """Gamma v."""
        return self._solid.gyroscopic_times(v)

    def dot(self, a: Array, b: Array) -> float:
        """Inner product over all ranks."""
        return self._solid.dot(a, b)

    def load(self, time: float) -> Array:
        """Load vector at a time."""
        return self.loads @ factors(self.load_histories, time)
