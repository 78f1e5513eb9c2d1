"""Damped nonlinear modes: free motions that a negative damping keeps at their amplitude.

The extended periodic motion concept (Krack 2015) adds the damping -2 zeta omega M to the equation
of motion without its dynamic loads; static loads, preload and rotation stay:

    M q'' + (C - 2 zeta omega M) q' + f(q) + B F(B^T q) = static loads.

The frequency omega and the damping ratio zeta are unknown. With the scaled variables s of
`fenicsrom.online.periodic.shooting`, s_0 their equilibrium and p = ln a, the unknowns are the shape
sigma of s = s_0 + a sigma, the logarithm tau of the period and zeta:

    (P(s; tau, zeta) - s) / a = 0,    row_v sigma = 0,    row_q sigma = 1.

The rows project on the linear mode: its modal coordinate is a and its modal velocity is zero at
the start of the period. The change of the damping is one of the mass-proportional damping, so that
the period map and its derivatives serve without change. A conservative system gives zeta = 0.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import contact_scratch, zero_contact_state
from fenicsrom.online.curves.arc import Values
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.kernels.numbers import STEP
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.pencil import state_matrix
from fenicsrom.online.periodic.shooting import Shooting
from fenicsrom.online.step.statics import equilibrium

OSCILLATES = 1e-6  # an eigenvalue whose imaginary part is below this part of its size does not


@dataclass(frozen=True, eq=False)
class LinearMode:
    """A mode of small motions about the equilibrium; the points that touch stick.

    Attributes:
        number: from 1 at the lowest frequency.
        omega: frequency, rad/s.
        damping_ratio: zeta.
        equilibrium: (n,) coordinates of the equilibrium.
        sliders: (P, d) sliders of the contact points there.
        shape: (n,) complex; u^T M u = 1 and real.
    """

    number: int
    omega: float
    damping_ratio: float
    equilibrium: Array
    sliders: Array
    shape: NDArray[np.complex128]


def without_dynamic_loads(model: ReducedModel) -> ReducedModel:
    """The model under its static loads only."""
    histories = model.load_histories
    sines, table = histories.sines.copy(), histories.table.copy()
    sines[sines[:, OMEGA] != 0.0, AMPLITUDE] = 0.0
    table[:, 1] = 0.0
    return model._replace(load_histories=histories._replace(sines=sines, table=table))


def linear_modes(problem: Problem) -> list[LinearMode]:
    """The linear modes about the equilibrium, the lowest frequency first.

    The mass-proportional damping leaves shapes and frequencies as they are.

    Args:
        problem: of a reduced model of n coordinates; the normal stiffness of the contact points
            that touch acts, and with friction the tangential one.

    Raises:
        ConvergenceError: no equilibrium was found.
    """
    model, n, d = problem.model, problem.model.size, problem.dimension
    q, _ = equilibrium(problem)
    x = model.contact_displacement(q).reshape(-1, d).copy()
    stiffness = _tangent(model, q) + _contact_stiffness(problem, x)
    values, vectors = np.linalg.eig(state_matrix(model.mass, model.velocity_matrix, stiffness))
    found: list[LinearMode] = []
    for k in np.argsort(values.imag):
        value, shape = complex(values[k]), vectors[:n, k]
        if value.imag <= OSCILLATES * abs(value):
            continue
        square = complex(shape @ model.mass @ shape)
        omega = abs(value)
        ratio = (0.5 * float(model.damping) - value.real) / omega
        found.append(LinearMode(len(found) + 1, omega, ratio, q, x, shape / np.sqrt(square)))
    return found


def _tangent(model: ReducedModel, q: Array) -> Array:
    """Tangent stiffness (n, n) at q."""
    zero, one = np.zeros_like(q), np.ones(1)
    return model.elastic_over_step(zero, q, zero, 0.0, one, one)[1].matrix.copy()


def _contact_stiffness(problem: Problem, x: Array) -> Array:
    """Stiffness (n, n) of the contact points that touch at x (P, d) and stick."""
    model, contacts, (count, d) = problem.model, problem.contacts, x.shape
    state, scratch = zero_contact_state(count, d), contact_scratch(count, d)
    at_rest(contacts, x, x.copy(), 0.0, state, scratch)
    found = np.zeros((model.size, model.size))
    for p in np.flatnonzero(state.trial_normal_force > 0.0):
        normal = state.normal[p] / np.linalg.norm(state.normal[p])
        across = np.outer(normal, normal)
        spring = contacts.normal_stiffness[p] * across
        if contacts.friction[p] > 0.0:
            spring = spring + contacts.tangential_stiffness[p] * (np.eye(d) - across)
        rows = model.contact_rows[p * d : (p + 1) * d]
        found += rows.T @ spring @ rows
    return found


class ModeContinuation(Continuation):
    """The motions of one nonlinear mode; the parameter is p = ln a, a in sqrt(kg) m.

    The unknowns s (N + 2,) are sigma, tau and zeta.
    """

    def __init__(self, problem: Problem, mode: LinearMode, first: float, last: float):
        """Make the problem.

        Args:
            problem: of a reduced model; surfaces are where their approach ends.
            mode: the linear mode in which the nonlinear one begins.
            first: smallest amplitude of the modal coordinate, sqrt(kg) m.
            last: largest.
        """
        model = without_dynamic_loads(problem.model)
        problem = problem._replace(model=model, period=2.0 * np.pi / mode.omega)
        shooting = Shooting(problem)
        unit = np.eye(shooting.map.size + 2)[0]
        super().__init__(shooting, lambda _: problem, np.log(first), np.log(last), unit)
        self.mode, self.problem = mode, problem
        zero, pmap = np.zeros(model.size), shooting.map
        self._rest = shooting.scaled(pmap.pack(mode.equilibrium, zero, zero, mode.sliders))
        direction = mode.shape.real.copy()
        self._rows = np.zeros((2, pmap.size))
        along = shooting.scaled(pmap.pack(direction, zero, zero, np.zeros_like(mode.sliders)))
        along /= np.linalg.norm(along)
        self._rows[0, model.size : 2 * model.size] = along[: model.size]
        self._rows[1] = along

    def linear_start(self) -> Array:
        """The unknowns s (N + 2,) of the linear mode."""
        mode, pmap = self.mode, self.shooting.map
        model, omega = self.problem.model, self.mode.omega
        shape, turned = mode.shape.real.copy(), -mode.shape.imag
        moved = (model.contact_rows @ shape).reshape(mode.sliders.shape)
        state = zero_contact_state(*mode.sliders.shape)
        scratch = contact_scratch(*mode.sliders.shape)
        at_rest(self.problem.contacts, mode.sliders, mode.sliders.copy(), 0.0, state, scratch)
        moved[state.trial_normal_force > 0.0] = 0.0  # the sliders of points that touch rest
        z = pmap.pack(shape, omega * turned, -(omega**2) * shape, moved)
        sigma = self.shooting.scaled(z)
        return np.concatenate([sigma / (self._rows[1] @ sigma), [0.0, mode.damping_ratio]])

    def start(self, z: Array, parameter: float, frequency: float, damping_ratio: float) -> Array:
        """The unknowns s (N + 2,) of variables z (N,) at a frequency, Hz; inverse of `unscaled`."""
        sigma = (self.shooting.scaled(z) - self._rest) / np.exp(parameter)
        tau = np.log(self.mode.omega / (2.0 * np.pi * frequency))
        return np.concatenate([sigma, [tau, damping_ratio]])

    def unscaled(self, s: Array, parameter: float) -> Array:
        """Variables z (N,) of unknowns s (N + 2,)."""
        return self.shooting.unscaled(self._rest + np.exp(parameter) * s[:-2])

    def problem_at(self, s: Array, parameter: float) -> Problem:
        """The data of a motion: its period, and the damping C - 2 zeta omega M."""
        return self._data_at(s[-2], s[-1])

    def _data_at(self, tau: Any, zeta: Any) -> Problem:
        """The data of a motion with these two unknowns, real or complex."""
        model, omega = self.problem.model, self.mode.omega * np.exp(-tau)
        damping = model.damping - 2.0 * zeta * omega
        return self.problem._replace(
            model=model._replace(damping=damping), period=2.0 * np.pi / omega
        )

    def _omega(self, s: Array) -> float:
        """Frequency, rad/s."""
        return float(self.mode.omega * np.exp(-s[-2]))

    def frequency(self, point: CurvePoint) -> float:
        """Frequency of a point, Hz."""
        return self._omega(point.s) / (2.0 * np.pi)

    def damping_ratio(self, point: CurvePoint) -> float:
        """Damping ratio of a point."""
        return float(point.s[-1])

    def values(self, s: Array, parameter: float, *, derive: bool) -> Values | None:
        """The equations (N + 2,) and their derivative; None if a step failed."""
        a, sigma, (tau, zeta) = float(np.exp(parameter)), s[:-2], s[-2:]
        start, problem = self._rest + a * sigma, self._data_at(tau, zeta)
        along_tau = problem._replace(varied=self._data_at(tau + 1j * STEP, zeta))
        found = self.shooting.march(start, along_tau, derive=derive)
        if found is None:
            return None
        residual, matrix, by_tau, end = found
        whole = np.append(residual / a, self._rows @ sigma - np.array([0.0, 1.0]))
        if not derive:
            return Values(whole, matrix, end)
        along_zeta = problem._replace(varied=self._data_at(tau, zeta + 1j * STEP))
        again = self.shooting.march(start, along_zeta)
        if again is None:
            return None
        n = sigma.size
        jacobian = np.zeros((n + 2, n + 3))
        jacobian[:n, :n] = matrix - np.eye(n)
        jacobian[:n, n] = by_tau / a
        jacobian[:n, n + 1] = again[2] / a
        jacobian[:n, n + 2] = jacobian[:n, :n] @ sigma - residual / a
        jacobian[n:, :n] = self._rows
        return Values(whole, jacobian, end)
