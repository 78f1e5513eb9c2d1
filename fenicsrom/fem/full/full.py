"""The full model: all unknowns of the mesh, for the time integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.base.linalg import Factorisation, add_entries, multiply, negative_eigenvalues
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.online.contact.problem import Compliance, given_compliance
from fenicsrom.online.model.kept_factor import KeptFactor, same_coefficients
from fenicsrom.online.model.loads import GAUSS, factors
from fenicsrom.online.step.state import Scheme
from fenicsrom.reduction.beam import BeamStructure
from fenicsrom.reduction.protocols import Structure


def full_model(body: Structure) -> Any:
    """The full model of a structure, for the time integration."""
    if isinstance(body, BeamStructure):
        return body.full_model()
    return FullModel(body)


Slope = list[tuple[float, Array, Array]]
"""Weights, states (local,) and factors (k,) of the follower pressures of tangents."""

_SAME = PETSc.Mat.Structure.SAME_NONZERO_PATTERN
_SUBSET = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN


CONTRACTION = 0.25
"""Of the iteration with a kept factor. A factorisation takes as long as ten iterations or more."""


@dataclass(frozen=True, eq=False)
class _Effective:
    """The matrix S = mass M + velocity D + the sum of weights times tangents.

    Attributes:
        mass: coefficient of M.
        velocity: coefficient of D, the gyroscopic matrix and the viscous damping.
        states: weights, states and factors of the tangents.
    """

    mass: float
    velocity: float
    states: Slope

    @property
    def lever(self) -> float:
        """The sum of the weights of the tangents."""
        return sum(weight for weight, _, _ in self.states)

    def mean_state(self) -> tuple[float, Array, Array]:
        """The sum of the weights, and the mean state (local,) and factors (k,)."""
        mean = sum(weight * q for weight, q, _ in self.states)
        factors = sum(weight * factors for weight, _, factors in self.states)
        whole = self.lever or 1.0
        return self.lever, np.asarray(mean) / whole, np.asarray(factors) / whole

    def has_coefficients_of(self, other: _Effective) -> bool:
        """Whether the coefficients of another matrix are the same, up to rounding."""
        ours, theirs = ((each.mass, each.velocity, each.lever) for each in (self, other))
        return same_coefficients(ours, theirs)


class FullModel:
    """The full model of a solid: it has the operations of a `ReducedModel` for q = u − u₀.

    Vectors hold the unknowns that this rank owns.
    """

    exact_newton = False

    def __init__(self, solid: Solid):
        """Take the forms and matrices of the solid; geometrically linear if its scene is."""
        self._solid = solid
        self.linear = not solid.geometrically_nonlinear
        self.gauss_points = 1 if self.linear else 2
        self._pressures = solid.pressures
        # factors of the pressures at the start and at the end of the step
        self._factors = np.zeros((2, solid.pressures.numbers.size))
        self.damping = solid.mass_damping
        self.loads, self.load_histories = solid.load_vectors, solid.load_histories
        self.points = solid.points
        self._viscous = solid.viscous
        self.velocity_forces = solid.gyroscopic is not None or self._viscous.acts
        self._rows = solid.contact_rows
        self._offset = solid.comm.allreduce(self._rows @ solid.equilibrium)
        self._probe_offset = solid.comm.allreduce(solid.probe_rows @ solid.equilibrium)
        self._energy = 0.0 if self.linear else solid.energy(solid.equilibrium)
        self._start = solid.rest_force if self.linear else np.zeros(0)
        # M with ones on the clamped rows, where every vector is zero, so that it can be factorised
        self._mass = solid.mass_matrix(1.0)
        self._effective = solid.stiffness.copy()
        self._factor: Factorisation | None = None
        self._made: _Effective | None = None  # what the factor was made for
        self._wanted: _Effective | None = None  # the last S that was asked for
        self._is_exact = False
        self._unit = np.zeros((solid.local, 0))
        self._delassus = np.zeros((self._rows.shape[0],) * 2)
        self._kept = KeptFactor(solid.dot, CONTRACTION)

    def set_at_rest(self) -> None:
        """Let only the static follower pressures act in the operations that follow."""
        self._factors[:] = self._pressures.static

    def set_interval(self, begin: float, end: float) -> None:
        """Set the start and the end of the step, in s: the factors of the follower pressures."""
        for row, time in enumerate((begin, end)):
            self._factors[row] = factors(self.load_histories, time)[self._pressures.numbers]

    def pressure_work(self, q0: Array, dq: Array) -> float:
        """Work of the follower pressures, without their constant part, over a step, J."""
        mean = sum(0.5 * self._pressure_force(q0 + s * dq, self._factors_at(s)) for s in GAUSS)
        return self.dot(np.asarray(mean), dq)

    def _factors_at(self, point: float) -> Array:
        """The factors (k,) of the follower pressures at a point of the step, from 0 to 1."""
        return np.asarray((1.0 - point) * self._factors[0] + point * self._factors[1])

    def _pressure_force(self, q: Array, factors: Array) -> Array:
        """The follower pressures (local,) at q without their constant part, N."""
        numbers = self._pressures.numbers
        forces = self._pressures.unit_forces(self._solid.equilibrium + q) - self.loads[:, numbers]
        return np.asarray(forces @ factors)

    def elastic_over_step(
        self, start: Array, q0: Array, dq: Array, start_weight: float, points: Array, weights: Array
    ) -> tuple[Array, Slope]:
        """Mean force over a step, and the states and weights of its tangent.

        The tangent itself is assembled when it is needed.
        """
        self._kept.note(q0, dq)
        mean = start_weight * start
        slope: Slope = []
        for point, weight in zip(points, weights, strict=True):
            q, pressing = q0 + point * dq, self._factors_at(point)
            if weight != 0.0:
                mean = mean + weight * self._force(q, pressing)
            slope.append((weight * point, q, pressing))
        return mean, slope

    def _force(self, q: Array, factors: Array) -> Array:
        if self.linear:
            return self._start + multiply(self._solid.stiffness, q)
        force = self._solid.internal_force(self._solid.equilibrium + q)
        return force - self._pressure_force(q, factors)

    def elastic_at(self, q: Array) -> tuple[Array, float]:
        """Elastic force (local,) and energy above that of the equilibrium."""
        force = self._force(q, self._factors[1])
        if self.linear:
            return force, 0.5 * self.dot(q, force + self._start)
        return force, self._solid.energy(self._solid.equilibrium + q) - self._energy

    def solve_effective(
        self,
        mass_coefficient: float,
        velocity_coefficient: float,
        tangent: Slope,
        residual: Array,
        directions: NDArray[np.int64],
    ) -> tuple[Array, Array, Compliance]:
        """Solve S [y, Z] = [-residual, B] with S of `ReducedModel.solve_effective`.

        In a time step, S of an earlier state serves as long as few iterations need it.
        """
        wanted = _Effective(mass_coefficient, velocity_coefficient, tangent)
        kept = self._kept
        keeps = self.linear or (mass_coefficient > 0.0 and not kept.needs_factor)
        if not (keeps and self._made is not None and wanted.has_coefficients_of(self._made)):
            first = kept.iteration == 1 or mass_coefficient <= 0.0
            exact = self.linear or first or kept.renewals > 0
            if not self._factorise(wanted, exact):  # the step is refused, as for the compiled model
                bad = np.full((residual.size, 1 + self._rows.shape[0]), np.nan)
                nothing = np.full((self._rows.shape[0],) * 2, np.nan)
                return bad[:, 0], bad[:, 1:], given_compliance(nothing)
            kept.renew()
        assert self._factor is not None
        self._wanted = wanted
        y = self._solve(-residual[:, None])[:, 0]
        every = directions.size == self._delassus.shape[0]
        chosen = slice(None) if every else directions
        return y, self._unit[:, chosen], given_compliance(self._delassus[chosen][:, chosen])

    def write_normal_flexibility(self, h: float, out: Array) -> None:
        """Write the flexibility (P,) of the contact points along their normals for a step at rest.

        The factor is kept for the steps that follow.
        """
        still = np.zeros(self.local), np.zeros(self._pressures.numbers.size)
        found = self._factorise(_Effective(2.0 / h**2, 0.0, [(0.5, *still)]), True)
        out[:] = np.diag(self._delassus)[:: len(self._delassus) // out.size] if found else np.nan

    def _factorise(self, wanted: _Effective, exact: bool) -> bool:
        """Factorise S, and solve for the contact directions; False if S is singular.

        Args:
            wanted: the coefficients and states of S.
            exact: whether to take the tangents at all states; otherwise the tangent at the mean
                state.
        """
        self._made = None
        self._assemble(wanted, exact)
        try:
            if self._factor is None:
                symmetric = self._solid.gyroscopic is None and not self._pressures.numbers.size
                self._factor = Factorisation(self._effective, "fenicsrom_step", symmetric)
            else:
                self._factor.update()
        except ConvergenceError:
            return False
        self._made, self._is_exact = wanted, exact
        self._add_modal_damping(wanted.velocity)
        self._unit = self._solve(self._rows.T.toarray())
        self._delassus = np.asarray(self._solid.comm.allreduce(self._rows @ self._unit))
        return True

    def _add_modal_damping(self, weight: float) -> None:
        """Prepare the solution with S = A + weight U U^T from the factor of A.

        U are the few vectors of the modal damping; the formula is that of Sherman, Morrison and
        Woodbury.
        """
        self._modal = np.zeros((self.local, 0))
        if weight == 0.0 or not self._viscous.modal.shape[1]:
            return
        assert self._factor is not None
        self._modal = self._viscous.modal
        self._modal_unit = self._factor.solve(self._modal)
        inner = self._solid.inner(self._modal, self._modal_unit)
        self._modal_inverse = np.linalg.inv(np.eye(len(inner)) / weight + inner)

    def _solve(self, block: Array) -> Array:
        """S^-1 times a block (local, k), with the factor of the last S."""
        assert self._factor is not None
        found = self._factor.solve(block)
        if self._modal.shape[1]:
            inner = self._solid.inner(self._modal, found)
            found -= self._modal_unit @ (self._modal_inverse @ inner)
        return np.asarray(found)

    @property
    def local(self) -> int:
        """Number of unknowns that this rank owns."""
        return int(self._solid.local)

    def contact_change(self, block: Array) -> Array:
        """Changes of the contact displacement (m, k) by changes (local, k) of q."""
        return np.asarray(self._solid.comm.allreduce(self._rows @ block))

    def add_contact_force(self, out: Array, force: Array) -> None:
        """Add the contact forces (P, d) to forces out (local,), N."""
        out += self._rows.T @ force.ravel()

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
                found += weight * self._tangent_times(u, self._factors_at(point), block)
        return found

    def _tangent_times(self, u: Array, factors: Array, block: Array) -> Array:
        """The tangent at u (local,) with factors (k,) of the follower pressures, times a block."""
        found = self._solid.tangent_times(u, block)
        return found - self._pressures.tangent_times(u, block, factors - self._pressures.static)

    def solve_with_contact(self, block: Array, force: Array, by_end: Array) -> Array:
        """Solve (S + B F' B^T) X = -(block + B force) with S of the last `solve_effective`.

        Args:
            block: (local, k).
            force: (m, k) changes of the contact forces.
            by_end: (m, m) F', derivative of the contact forces by the end of the step, N/m.
        """
        assert self._factor is not None and self._wanted is not None
        if not (self._is_exact and self._made is self._wanted):
            self._factorise(self._wanted, True)
        free = self._solve(-(block + self._rows.T @ force))
        small = np.eye(force.shape[0]) + by_end @ self._delassus
        jump = np.linalg.solve(small, by_end @ self.contact_change(free))
        return np.asarray(free - self._unit @ jump)

    def negative_directions(self, slope: Slope) -> int:
        """Number of negative eigenvalues of a stiffness as `elastic_over_step` gives it."""
        self._assemble(_Effective(0.0, 0.0, slope), True, symmetric=True)
        self._made = None
        return negative_eigenvalues(self._effective)

    def _assemble(self, wanted: _Effective, exact: bool, *, symmetric: bool = False) -> None:
        """Assemble S, or its symmetric part; with the tangent at the mean state if not `exact`."""
        self._effective.zeroEntries()
        if self.linear:
            self._effective.axpy(wanted.lever, self._solid.stiffness, structure=_SAME)
        else:
            states = wanted.states if exact else [wanted.mean_state()]
            for weight, q, pressing in states:
                if weight != 0.0:
                    u = self._solid.equilibrium + q
                    self._solid.add_tangent(self._effective, u, weight)
                    factors = weight * pressing
                    self._pressures.add_tangent(self._effective, u, factors, symmetric=symmetric)
        self._effective.axpy(wanted.mass, self._mass, structure=_SUBSET)
        if self._viscous.stiffness > 0.0:
            weight = wanted.velocity * self._viscous.stiffness
            self._effective.axpy(weight, self._solid.strain_stiffness, structure=_SAME)
        add_entries(self._effective, wanted.velocity * self._solid.dashpots)
        if self._solid.gyroscopic is not None and wanted.velocity != 0.0:
            self._effective.axpy(wanted.velocity, self._solid.gyroscopic, structure=_SUBSET)

    def contact_displacement(self, q: Array) -> Array:
        """Contact displacement (m,)."""
        return np.asarray(self._offset + self._solid.comm.allreduce(self._rows @ q))

    def probe_displacement(self, q: Array) -> Array:
        """Displacement (d,) of the probe."""
        moved = self._solid.comm.allreduce(self._solid.probe_rows @ q)
        return np.asarray(self._probe_offset + moved)

    def mass_times(self, v: Array) -> Array:
        """M times v (local,) or a block (local, k)."""
        return multiply(self._solid.mass, v)

    def velocity_times(self, v: Array) -> Array:
        """D v."""
        found = np.zeros_like(v)
        if self._solid.gyroscopic is not None:
            found += self._solid.gyroscopic_times(v)
        if self._viscous.acts:
            block = v.reshape(len(v), -1)
            found += self._viscous.times(block).reshape(v.shape)
        return found

    def dot(self, a: Array, b: Array) -> float:
        """Inner product over all ranks."""
        return self._solid.dot(a, b)

    def load(self, time: float) -> Array:
        """Load vector at a time."""
        return self.loads @ factors(self.load_histories, time)
