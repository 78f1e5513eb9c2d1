"""Periodic motions by harmonic balance: of one body, or of one sector of a disk in a wave.

With H harmonics of the period T = 2 pi/omega the coordinates are q(t) = Re sum q_k e^{i k omega t},
k = 0 .. H, and the equations of motion become, for each k,

    Z_k q_k + N_k^H F_k = p_k,    Z_k = P_k^H (K + i k omega D - k^2 omega^2 M) P_k.       (1)

In a wave all sectors of a disk move alike, one after the other: q_{j+1}(t) = q_j(t + phi/omega).
The following face of a sector is a face of its neighbour, so that its harmonic k is that of its own
face times e^{i k phi} or e^{-i k phi}: P_k gives all coordinates from those without this face. Of a
body that stands alone, P_k = 1. The rows of contacts between sectors have a part that moves with
the next sector, e^{i k phi} times as this one.

F(t) are the forces of the contacts and the nonlinear part of the elastic forces. They act on few
displacements xi = N q: those of the contact points, and the coordinates with nonlinear forces. So
the linear part is solved first (Cameron and Griffin, J. Appl. Mech. 56, 1989), and what remains is

    xi_k + N_k Z_k^-1 N_k^H F_k(xi) = N_k Z_k^-1 p_k,    N_k = N P_k.                      (2)

F_k comes from F(t) at equal instants: the polynomial of the body, and the law of the contacts along
the whole period (`fenicsrom.online.periodic.orbit`). The derivatives of (2) by xi are exact for
these instants, those by a parameter are differences of (2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compilation import compiled
from fenicsrom.online.model.disk_model import Complex, Sector
from fenicsrom.online.model.loads import OMEGA, factors_along
from fenicsrom.online.model.model import Problem
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force
from fenicsrom.online.periodic.orbit import Orbit, periodic_orbit
from fenicsrom.online.step.state import DAMPING_DISSIPATION, WORK, Record, no_record

INSTANTS = 256
"""Fewest steps of a period, along whose chords contact forces are off by about 4e-5."""


@compiled
def forces_along(polynomial: ElasticPolynomial, q: Array, force: Array, tangent: Array) -> None:
    """Write the elastic forces (T, e) and tangents (T, e, e) at the instants of a motion (T, e)."""
    for row in range(q.shape[0]):
        elastic_force(polynomial, q[row], force[row], tangent[row])


def waves_of(harmonics: int, instants: int, first: float = 0.0) -> Array:
    """Values (T, 2 H + 1) of 1, cos, sin, cos 2, .. at the instants k + `first` of T."""
    angle = 2.0 * np.pi * (np.arange(instants)[:, None] + first) / instants
    orders = np.arange(1, harmonics + 1)
    pairs = np.stack([np.cos(orders * angle), np.sin(orders * angle)], axis=2)
    return np.concatenate([np.ones((instants, 1)), pairs.reshape(instants, -1)], axis=1)


def step_weights(harmonics: int, instants: int) -> Array:
    """The matrix (2 H + 1, T) that turns means over steps into coefficients.

    The mean of a harmonic k over the chord of a step is cos(k pi/T) times its value in the middle,
    so that the force of a spring is exact.
    """
    orders = np.repeat(np.arange(harmonics + 1), 2)[1:]
    found = waves_of(harmonics, instants, 0.5) / np.cos(np.pi * orders / instants)
    return np.asarray(np.where(orders[:, None], 2.0, 1.0) / instants * found.T)


def phasors(coefficients: Array) -> Complex:
    """The harmonics (H + 1, ..) of coefficients (2 H + 1, ..) of 1, cos, sin, cos 2, .. ."""
    first = coefficients[:1].astype(complex)
    return np.concatenate([first, coefficients[1::2] - 1j * coefficients[2::2]])


def coefficients(found: Complex) -> Array:
    """The inverse of `phasors`."""
    parts = np.stack([found.real, -found.imag], axis=1)
    return np.asarray(parts.reshape(-1, *found.shape[1:])[np.r_[0, 2 : 2 * len(found)]])


@dataclass(frozen=True, eq=False)
class Balanced:
    """The equations (2) at one place.

    Attributes:
        problem: the problem.
        moved: (2 H + 1, r) coefficients of xi.
        acting: (2 H + 1, r) those of F.
        given: (H + 1, n') Z_k^-1 p_k.
        unit: (H + 1, n', r) Z_k^-1 N_k^H.
        orbits: the contact points.
        residual: (2 H + 1, r).
        slopes: ((2 H + 1) r, (2 H + 1) r) the derivative of the residual, in their order; (0, 0) if
            it was not asked for.
    """

    problem: Problem
    moved: Array
    acting: Array
    given: Complex
    unit: Complex
    orbits: list[Orbit]
    residual: Array
    slopes: Array


class Balance:
    """The equations (2) of the problems of one body, or of one sector.

    Attributes:
        harmonics: H.
        scale: (r,) by which xi is multiplied, so that its norm has one unit: the square root of the
            mass that each of these displacements feels.
    """

    def __init__(
        self,
        problem: Problem,
        harmonics: int,
        sector: Sector | None = None,
        lag: float = 0.0,
        finer: int = 1,
        ratios: tuple[float, ...] = (),
    ):
        """Prepare what all problems of a family share.

        Args:
            problem: of a reduced model; its values may change from call to call.
            harmonics: H, raised to the highest harmonic of the loads.
            sector: the sector whose linear model that of the problem is; None of a whole body.
            lag: phi, by which the motion of the next sector is ahead, rad.
            finer: factor on the number of instants.
            ratios: damping ratios of the families of waves of a disk.
        """
        model, self.sector = problem.model, sector
        sines = model.load_histories.sines
        omega = 2.0 * np.pi / problem.period
        self.harmonics = max(harmonics, round(np.max(sines[:, OMEGA], initial=0.0) / omega))
        elastic: ElasticPolynomial = model.elastic if sector is None else sector.interior
        self._polynomial = elastic._replace(
            force=np.zeros_like(elastic.force), stiffness=np.zeros_like(elastic.stiffness)
        )
        self._nonlinear = elastic.force.size if elastic.cubic.size else 0
        n, points = model.size, problem.contacts.preload.size
        rows = np.concatenate([np.eye(n)[: self._nonlinear], model.contact_rows])
        rows = rows if len(rows) else np.eye(n)[:1]  # a linear body: a coordinate without a force
        whole = sector is None and len(rows) > n
        self.rows = np.eye(n) if whole else rows
        held = slice(self._nonlinear, self._nonlinear + len(model.contact_rows))
        touching = model.contact_rows if whole else np.eye(len(rows))[held]
        self._touching = touching.reshape(points, problem.dimension, len(self.rows))
        self._joined = np.eye(n, dtype=complex)[None]
        self._through = self.rows @ self._joined
        if sector is not None:
            angles = lag * np.arange(self.harmonics + 1)
            self._joined, pairs = sector.in_waves(angles)
            self._through = self.rows @ self._joined
            self._through[:, held] = pairs
        self._modal: Complex = np.zeros((1, self._joined.shape[2], 0), dtype=complex)
        if sector is not None and any(ratios):
            self._modal = np.array(sector.wave_damping(angles, ratios), dtype=complex)
        feels = np.sum(self.rows * np.linalg.solve(model.mass, self.rows.T).T, axis=1)
        self.scale = 1.0 / np.sqrt(np.maximum(feels, 1e-300))
        self.instants = finer * max(8 * self.harmonics, INSTANTS)
        self._waves = waves_of(self.harmonics, self.instants)
        self._samples = waves_of(self.harmonics, self._count)
        self._weights = self._samples.T * (2.0 / self._count)
        self._weights[0] *= 0.5
        self._means = step_weights(self.harmonics, self.instants)

    @property
    def _count(self) -> int:
        """The fewest instants by which the harmonics of a cubic force are exact, and more."""
        return 4 * self.harmonics + 2

    @property
    def shape(self) -> tuple[int, int]:
        """The shape (2 H + 1, r) of the unknowns."""
        return 2 * self.harmonics + 1, len(self.rows)

    def scaled(self, moved: Array) -> Array:
        """Variables s ((2 H + 1) r,) of coefficients (2 H + 1, r)."""
        return np.asarray((moved * self.scale).ravel())

    def from_other(self, other: Balance, s: Array) -> Array:
        """Variables s of those of a balance with another number of harmonics."""
        found, known = np.zeros(self.shape), s.reshape(other.shape)
        count = min(len(found), len(known))
        found[:count] = known[:count]
        return found.ravel()

    def linear(self, problem: Problem) -> Array | None:
        """Variables s of small motions, whose points stick if they touch; None at a pole."""
        found = self.at(problem, np.zeros(self.shape).ravel(), derive=True)
        if found is None:
            return None
        moved = np.linalg.solve(found.slopes, -found.residual.ravel())
        return self.scaled(np.asarray(moved, dtype=np.float64).reshape(self.shape))

    def at(self, problem: Problem, s: Array, *, derive: bool) -> Balanced | None:
        """The equations at variables s; None if they could not be evaluated."""
        moved = s.reshape(self.shape) / self.scale
        found = self._forces(problem, moved, derive=derive)
        return None if found is None else self._closed(problem, moved, *found)

    def near(self, problem: Problem, s: Array, known: Balanced) -> Array | None:
        """The residual of another problem at variables s, of which those of one are known."""
        here, there = known.problem.contacts, problem.contacts
        if self._touching.size and (here is not there or here.spin.any()):
            found = self.at(problem, s, derive=False)
        else:
            none = np.zeros((0, 0, 0, 0))
            found = self._closed(problem, known.moved, known.acting, known.orbits, none)
        return None if found is None else found.residual

    def _closed(
        self, problem: Problem, moved: Array, acting: Array, orbits: list[Orbit], slopes: Array
    ) -> Balanced | None:
        """The equations with given forces and their derivatives."""
        try:
            given, unit = self._solved(problem)
        except np.linalg.LinAlgError:
            return None
        flexible = self._through @ unit
        answer = flexible @ phasors(acting)[:, :, None] - self._through @ given[:, :, None]
        residual = moved + coefficients(answer[:, :, 0])
        if slopes.size:
            size = moved.size
            by = coefficients(flexible @ phasors(slopes.reshape(*self.shape, size)))
            slopes = np.eye(size) + by.reshape(size, size)
        if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
            return None
        return Balanced(problem, moved, acting, given, unit, orbits, residual, slopes)

    def _solved(self, problem: Problem) -> tuple[Complex, Complex]:
        """Z_k^-1 p_k (H + 1, n') and Z_k^-1 N_k^H (H + 1, n', r)."""
        model = problem.model
        times = problem.period / self._count * np.arange(self._count)
        push = phasors(self._weights @ factors_along(model.load_histories, times)) @ model.loads.T
        push[0] -= model.elastic.force
        speeds = 2j * np.pi / problem.period * np.arange(self.harmonics + 1)[:, None, None]
        dynamic = model.elastic.stiffness + speeds * model.damping_matrix() + speeds**2 * model.mass
        joined, through = (np.conj(a.swapaxes(1, 2)) for a in (self._joined, self._through))
        pushed = joined @ push[:, :, None]
        through = np.broadcast_to(through, (len(push), *through.shape[1:]))
        right = np.concatenate([pushed, through], axis=2)
        damped = speeds * (self._modal @ self._modal.conj().swapaxes(1, 2))
        solved = np.linalg.solve(joined @ dynamic @ self._joined + damped, right)
        return solved[:, :, 0], solved[:, :, 1:]

    def _forces(
        self, problem: Problem, moved: Array, *, derive: bool
    ) -> tuple[Array, list[Orbit], Array] | None:
        """The coefficients of F (2 H + 1, r), the contact, and dF/dxi (2 H + 1, r, 2 H + 1, r)."""
        (count, r), e, waves, model = self.shape, self._nonlinear, self._waves, problem.model
        acting = np.zeros((count, r))
        slopes = np.zeros((count, r, count, r) if derive else (0, 0, 0, 0))
        if e:
            q = self._samples @ moved[:, :e]
            force, tangent = np.empty(q.shape), np.empty((len(q), e, e))
            forces_along(self._polynomial, q, force, tangent)
            acting[:, :e] = self._weights @ force
            if derive:
                along = tangent[:, :, None, :] * self._samples[:, None, :, None]
                by = self._weights @ along.reshape(len(q), -1)
                slopes[:, :e, :, :e] = by.reshape(count, e, count, e)
        orbits = []
        offset = model.contact_offset.reshape(self._touching.shape[:2])
        for p, rows in enumerate(self._touching):
            path = offset[p] + waves @ (moved @ rows.T)
            given = waves if derive else waves[:, :0]
            orbit = periodic_orbit(problem.contacts, p, path, given, problem.period, offset[p])
            if orbit is None:
                return None
            orbits.append(orbit)
            acting += self._means @ orbit.mean @ rows
            if derive:
                at = np.flatnonzero(rows.any(axis=0))
                by = self._means @ orbit.slopes.reshape(len(waves), -1)
                by = by.reshape(count, len(rows), len(rows), count)
                part = np.einsum("ai,cabe,bj->ciej", rows[:, at], by, rows[:, at])
                every = np.arange(count)
                slopes[np.ix_(every, at, every, at)] += part
        return acting, orbits, slopes

    def _own(self, found: Balanced) -> Complex:
        """The harmonics (H + 1, n', 1) of the coordinates without the following face."""
        return found.given[:, :, None] - found.unit @ phasors(found.acting)[:, :, None]

    def coordinates(self, found: Balanced) -> Array:
        """The coefficients (2 H + 1, n) of all coordinates."""
        return coefficients((self._joined @ self._own(found))[:, :, 0])

    def record(self, found: Balanced) -> Record:
        """The period of a motion, at equal instants after its start."""
        problem, model, q = found.problem, found.problem.model, phasors(self.coordinates(found))
        rates = 2j * np.pi / problem.period * np.arange(self.harmonics + 1)[:, None]
        points, d = self._touching.shape[:2]
        count, waves = self.instants, np.roll(self._waves, -1, axis=0)
        state = [waves @ coefficients(part) for part in (q, rates * q, rates**2 * q)]
        rows = no_record(count, points, d, 3 * model.size)
        rows.time[:] = problem.period * np.arange(1, count + 1) / count
        rows.coordinates[:] = np.concatenate(state, axis=1)
        rows.probe[:] = model.probe_offset + state[0] @ model.probe.T
        contacts = problem.contacts
        offset = model.contact_offset.reshape(points, d)
        for p, orbit in enumerate(found.orbits):
            rows.displacement[:, p] = offset[p] + waves @ (found.moved @ self._touching[p].T)
            rows.force[:, p], rows.mean_force[:, p] = orbit.force, orbit.mean
            rows.gap[:, p] = (contacts.preload[p] - orbit.trial) / contacts.normal_stiffness[p]
            rows.friction_dissipation[:, p] = np.cumsum(orbit.dissipated)
            rows.state[:, p] = orbit.state
        rows.energies[:] = np.nan
        power = np.einsum("ti,ij,tj->t", state[1], model.damping_matrix(), state[1])
        modal = rates[:, :, None] * (self._modal.conj().swapaxes(1, 2) @ self._own(found))
        power += 0.5 * np.sum(np.abs(modal) ** 2)  # of waves, the mean over the sectors
        lost = power * problem.period / count
        rows.energies[:, DAMPING_DISSIPATION - WORK] = np.cumsum(lost)
        return rows
