"""One line of an interaction map: the motion of a body at one speed of rotation.

A model of this speed (`fenicsrom.online.step.speed_range`) marches some revolutions with equal
steps. The motion along the normals of the contact points in the last revolutions gives amplitudes
over the engine orders j / m, with m revolutions, where a motion that repeats has lines only and any
other one is weighted by Hann's window,

    A_k = (2 / sum_i w_i) |sum_i w_i x_i exp(-2 pi i k s_i)|,    s_i in revolutions.          (1)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import CYLINDER, penetration
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of, integrate
from fenicsrom.scene import Scene
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.online.store.archive import StoredModel

APART = 0.1  # smallest difference of the amplitudes of motions that count as two
REPEATS = 2e-3  # a motion repeats if a later revolution differs by less, relative to its range
SETTLED = 0.05  # largest change of the root mean square between the halves of the revolutions
DECAYS = 0.9  # change from revolution to revolution, of the halves, below which it decays
LINES, BINS = 12, 2  # a torus has its energy in so many lines, each of so many bins to each side
REST = 0.01  # largest part of the energy of a torus that is not in its lines
AWAY = 3.0  # the other start is so many times the amplitude away from the surface
STEPS = 300  # steps per revolution where the scene gives none
PERIOD, TORUS, OTHER, UNSETTLED = "period", "torus", "not periodic", "not settled"


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class Line:
    """What a map shows at one speed.

    Attributes:
        speed_rpm: the speed.
        amplitudes: (k,) of the radial motion at the engine orders, the largest of all points, m.
        amplitude: half of the largest radial range of a point, m.
        peak_force: largest normal force of a point, N.
        contact: part of the time in which a point touches.
        clearance: part of the gap that body and surface consume, above 1 with contact; nan without
            a gap.
        verdict: "period", "torus", "not periodic" or "not settled".
        period: revolutions in which the motion repeats; 0 if it does not.
        free_hz: (v,) natural frequencies without contact, Hz.
        closed_hz: (v,) with all points closed and sliding, Hz.
        by_basis: (k,) differences of the amplitudes with twice the coordinates; (0,) unchecked.
        by_step: (k,) differences with half the step; (0,) unchecked.
        other: amplitude of the motion from the other start, m; nan unchecked or not settled.
        seconds: CPU time.
        end: (2, n) displacement and velocity at the end in the coordinates of the range model.
    """

    speed_rpm: float
    amplitudes: Array
    amplitude: float
    peak_force: float
    contact: float
    clearance: float
    verdict: str
    period: int
    free_hz: Array
    closed_hz: Array
    by_basis: Array
    by_step: Array
    other: float
    seconds: float
    end: Array

    @property
    def errors(self) -> Array:
        """(k,) estimated errors relative to the largest amplitude of the line; (0,) unchecked."""
        largest = max(float(self.amplitudes.max(initial=0.0)), 1e-300)
        return np.asarray((self.by_basis + self.by_step) / largest)

    @property
    def coexists(self) -> bool:
        """Whether another start leads to another motion."""
        sizes = self.other, self.amplitude
        return self.verdict != UNSETTLED and abs(sizes[0] - sizes[1]) > APART * max(sizes)


class Place:
    """A model at one speed, its contacts with their clearance, and its revolution."""

    def __init__(self, stored: StoredModel, scene: Scene, stop: Callable[[], bool]):
        """Make the model of a scene at its speed."""
        assert scene.rotation is not None
        self.scene, self.table, self.stop = scene, scene.map, stop
        self.stored = stored.with_scene(scene)
        self.speed_rpm = scene.rotation.speed_rpm
        self.revolution = 60.0 / self.speed_rpm
        self.contacts = Problem.of(self.stored.model, self.scene).contacts
        if self.table.clearance == "at speed":
            self.contacts = self.contacts._replace(radius=self._radii())

    def _radii(self) -> Array:
        """Radii (P,) with which each contact has its gap at speed instead of at rest, m."""
        plain = self.contacts._replace(order=np.zeros(0), times=np.zeros(0))
        moved = self.stored.model.contact_offset.reshape(plain.side.size, -1)
        number, shift = self.stored.model.points.contact, np.zeros(plain.side.size)
        for contact in np.unique(number):
            mine = np.flatnonzero(number == contact)
            depths = [
                max(penetration(plain, int(p), x[p], 0.0) for p in mine)
                for x in (moved, np.zeros_like(moved))
            ]
            shift[mine] = depths[0] - depths[1]
        return np.asarray(plain.radius + plain.side * shift)

    def line(self, checked: bool, start: Array | None) -> Line:
        """The line of this speed; see `Line`.

        Args:
            checked: whether errors are estimated, and another motion is sought.
            start: (2, n) displacement and velocity in the coordinates of the range model; None is
                rest.
        """
        model, steps, nothing = self.stored.model, steps_of(self.scene), np.zeros(0)
        motion = self.march(self.stored, steps, self._given(self.stored, start))
        radial = self.last(motion.displacement[:, :, 0], steps)
        verdict, period = verdict_of(radial, steps)
        amplitudes = self.spectrum(radial, steps, period)
        late = slice(-1 - radial.shape[0], None)
        line = Line(
            self.speed_rpm,
            amplitudes,
            half_range(radial),
            float(motion.force[late, :, 0].max()),
            float(np.mean(np.any(motion.state[late] >= 0, axis=1))),
            self._clearance(motion.gap[late]),
            verdict,
            period,
            self.frequencies(model.mass, model.elastic.stiffness),
            self.frequencies(model.mass, model.elastic.stiffness + self._contact_stiffness()),
            nothing,
            nothing,
            np.nan,
            0.0,
            self._end(motion),
        )
        if not checked:
            return line
        size = min(2 * self.stored.size, self.stored.size + len(self.stored.further))
        others = []
        for stored, count in ((self.stored.resized(size), steps), (self.stored, 2 * steps)):
            finer = self.march(stored, count, self._given(stored, start))
            there = self.last(finer.displacement[:, :, 0], count)
            others.append(np.abs(self.spectrum(there, count, period) - amplitudes))
        second = self.march(self.stored, steps, self._away(line.amplitude))
        other = self.last(second.displacement[:, :, 0], steps)
        settled = verdict_of(other, steps)[0] != UNSETTLED
        return replace(
            line,
            by_basis=others[0],
            by_step=others[1],
            other=half_range(other) if settled else np.nan,
        )

    def march(self, stored: StoredModel, steps: int, start: tuple[Array, ...] | None) -> Motion:
        """The motion of a model at this speed over the revolutions of the map."""
        time = self.scene.time.changed(
            periods=self.table.revolutions,
            steady="march",
            steady_tolerance=0.0,
            steps_per_period=steps,
        )
        problem = Problem(stored.model, self.contacts, time, self.revolution)
        return integrate(problem, start=start, stop=self.stop)

    def last(self, values: Array, steps: int) -> Array:
        """Values (m N, P) at the instants of the last revolutions, without the first instant."""
        return values[-self.table.last * steps :]

    def spectrum(self, radial: Array, steps: int, period: int) -> Array:
        """Amplitudes (k,) at the engine orders j / m, the largest of all points; equation (1).

        Args:
            radial: (m N, P) the motion, m.
            steps: N.
            period: revolutions in which the motion repeats; 0 takes Hann's window.
        """
        last, top = self.table.last, self.table.orders
        found = np.zeros((top * last + 1, radial.shape[1]))
        if period:
            lines = np.fft.rfft(radial[-period * steps :], axis=0)
            lines *= 2.0 / (period * steps)
            count = min(top * period + 1, lines.shape[0])
            places = np.round(np.arange(count) * last / period).astype(int)
            np.maximum.at(found, places, np.abs(lines[:count]))
        else:
            window = np.hanning(radial.shape[0] + 1)[:-1, None]
            lines = np.fft.rfft(window * (radial - radial.mean(axis=0)), axis=0)
            count = min(found.shape[0], lines.shape[0])
            found[:count] = 2.0 / window.sum() * np.abs(lines[:count])
        found[0] = 0.0  # the mean is no motion
        return np.asarray(found.max(axis=1))

    def frequencies(self, mass: Array, stiffness: Array) -> Array:
        """The natural frequencies (v,) of the normal modes, zero where unstable, Hz."""
        squares = np.sort(scipy.linalg.eigvals(stiffness, mass).real)
        count = self.stored.frequencies_hz.size
        return np.asarray(np.sqrt(np.maximum(squares[:count], 0.0)) / (2.0 * np.pi))

    def _contact_stiffness(self) -> Array:
        """(n, n) sum_p k_n (b_p - mu t_p) b_p^T of the module docstring."""
        model, contacts = self.stored.model, self.contacts
        rows = model.contact_rows.reshape(contacts.side.size, -1, model.mass.shape[0])
        found = np.zeros_like(model.mass)
        for p, row in enumerate(rows):
            pushed = row[0]
            if contacts.kind[p] == CYLINDER and contacts.spin[p]:
                first, second = contacts.axes[p, :2]
                outward = -np.array([first @ contacts.centre[p], second @ contacts.centre[p]])
                outward /= np.linalg.norm(outward)
                sliding = outward[0] * second - outward[1] * first
                friction = contacts.friction[p] * np.sign(contacts.spin[p])
                pushed = pushed - friction * sliding @ row
            found += contacts.normal_stiffness[p] * np.outer(pushed, row[0])
        return found

    def _clearance(self, gaps: Array) -> float:
        """The part of the smallest gap of the scene that is consumed; nan without a gap."""
        given = np.array([contact.gap for contact in self.scene.contacts])
        given = given[self.stored.model.points.contact]
        if not np.any(given > 0.0):
            return float("nan")
        nearest = float(gaps[:, given > 0.0].min())
        return 1.0 - nearest / float(given[given > 0.0].min())

    def _away(self, amplitude: float) -> tuple[Array, Array]:
        """Another start: at rest in the first mode, away from the surface."""
        model, count = self.stored.model, self.contacts.side.size
        shape = scipy.linalg.eigh(model.elastic.stiffness, model.mass, subset_by_index=(0, 0))[1]
        moved = (model.contact_rows @ shape[:, 0]).reshape(count, -1)[:, 0]
        far = moved[np.argmax(np.abs(moved))]
        return -AWAY * amplitude / far * shape[:, 0], np.zeros(shape.shape[0])

    def _given(self, stored: StoredModel, start: Array | None) -> tuple[Array, Array] | None:
        """A start in the coordinates of the range model, in those of a model at this speed."""
        if start is None:
            return None
        q0, z = self._vectors(stored)
        mass = self.stored.whole.model.mass  # type: ignore[union-attr]
        q, v = np.linalg.solve(z.T @ mass @ z, z.T @ mass @ np.array([start[0] - q0, start[1]]).T).T
        return q, v

    def _end(self, motion: Motion) -> Array:
        """The end of a motion in the coordinates of the range model; empty for starts at rest."""
        if self.table.start == "rest":
            return np.zeros((2, 0))
        q0, z = self._vectors(self.stored)
        q, v, *_ = end_of(motion)
        return np.array([q0 + z @ q, z @ v])

    def _vectors(self, stored: StoredModel) -> tuple[Array, Array]:
        """The equilibrium (n,) and the coordinates (n, k) of a model in the range model."""
        whole, scene = stored.whole, self.scene
        assert whole is not None and scene.rotation is not None
        modes = isinstance(scene.basis.masters, int)
        q0, named = whole.vectors(scene.rotation.omega, modes, scene.geometrically_nonlinear)
        return q0, np.column_stack([named[label] for label in stored.labels])


def half_range(radial: Array) -> float:
    """Half of the largest range of a column (m, P)."""
    return float(np.ptp(radial, axis=0).max() / 2.0)


def verdict_of(radial: Array, steps: int) -> tuple[str, int]:
    """The verdict on a motion (m N, P) of m revolutions of N steps, and its period; see `Line`."""
    count = radial.shape[0] // steps
    size = max(float(np.ptp(radial, axis=0).max()), 1e-300)
    for period in range(1, count // 2 + 1):
        late, before = radial[period * steps :], radial[: -period * steps]
        if np.abs(late - before).max() <= REPEATS * size:
            return PERIOD, period
    half = count // 2 * steps
    point = radial[:, np.argmax(np.ptp(radial, axis=0))]
    sizes = point[:half].std(), point[-half:].std()
    changes = point[steps:] - point[:-steps]
    decay = changes[-half:].std() / changes[:half].std()
    if abs(sizes[0] - sizes[1]) > SETTLED * max(sizes) or decay < DECAYS:
        return UNSETTLED, 0
    window = np.hanning(point.size + 1)[:-1]
    energy = np.abs(np.fft.rfft(window * (point - point.mean()))) ** 2
    whole = energy.sum()
    for _ in range(LINES):
        top = int(np.argmax(energy))
        energy[max(top - BINS, 0) : top + BINS + 1] = 0.0
    return (TORUS if energy.sum() <= REST * whole else OTHER), 0


def steps_of(scene: Scene) -> int:
    """Steps per revolution of a map."""
    return scene.time.steps_per_period or STEPS
