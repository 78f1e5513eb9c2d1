"""One line of an interaction map: the motion of a body at one speed of rotation.

A model of this speed (`fenicsrom.online.step.speed_range`) marches some revolutions with equal
steps. The motion along the normals of the contact points in the last revolutions gives amplitudes
over the engine orders j / m, with m revolutions, where a motion that repeats has lines only and any
other one is weighted by Hann's window,

    A_k = (2 / sum_i w_i) |sum_i w_i x_i exp(-2 pi i k s_i)|,    s_i in revolutions.          (1)

With `map.steady = "newton"` the march ends where Newton's method finds the stable periodic motion
to which it tends (`fenicsrom.online.periodic.steady`). A map that goes up or down then continues
the branches of stable motions: Newton's method starts at the motion of the speed before. With
"march", Newton's method is tried at the end of a march that does not repeat: what the time steps
hardly damp rings for thousands of revolutions, and looks like a torus.

A speed that continues from another one takes the worn layers with it, and its surfaces have
approached. Each speed with layers that wear is computed with half the step, too: wear adds up what
small differences of the motion do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.plausibility import closed_stiffness
from fenicsrom.online.contact.points import paired
from fenicsrom.online.contact.surfaces import CYLINDER, Contacts, penetration
from fenicsrom.online.model.model import Problem
from fenicsrom.online.model.pencil import roots
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of, integrate
from fenicsrom.scene import Scene
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.store.archive import StoredModel

APART = 0.1  # smallest difference of the amplitudes of motions that count as two
REPEATS = 2e-3  # a motion repeats if a later revolution differs by less, relative to its range
SETTLED = 0.05  # largest change of the root mean square between the halves of the revolutions
DECAYS = 0.9  # change from revolution to revolution, of the halves, below which it decays
LINES, BINS = 12, 2  # a torus has its energy in so many lines, each of so many bins to each side
REST = 0.01  # largest part of the energy of a torus that is not in its lines
AWAY = 3.0  # the other start is so many times as far from the surface as the motion
ENERGY = 1e3  # largest energy of the other start, relative to the kinetic energy of the motion
TINY = 1e-300
HALVINGS = 10  # so often is another start halved that is not possible
ROUNDING = 1e-9  # smaller motions, relative to the distance from the axis of rotation, are none
STEADY = 1e-4  # relative change of a period in which a motion repeats, with Newton's method
LATE = 4  # revolutions in which Newton's method tries to end a march that does not repeat
STEPS = 300  # steps per revolution where the scene gives none
PERIOD, TORUS, OTHER, UNSETTLED = "period", "torus", "not periodic", "not settled"
WEARING = "still wearing"


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
        clearance: part of the gap that body and surface consume, above 1 with contact, counted
            to the worn surface; nan without a gap.
        verdict: "period", "torus", "not periodic", "not settled", or "still wearing" if a layer was
            worn in the last revolution.
        period: revolutions in which the motion repeats; 0 if it does not.
        free_hz: (v,) natural frequencies without contact, Hz.
        closed_hz: (v,) with all points closed and sliding, Hz.
        by_basis: (k,) differences of the amplitudes with twice the coordinates; (0,) unchecked.
        by_step: (k,) differences with half the step; (0,) unchecked.
        by_mesh: (k,) differences with finer elements; (0,) unchecked, or unknown.
        worn: (nodes,) worn depth of abradable layers at the end, m; (0,) without layers.
        worn_by_step: (nodes,) difference of the worn depth with half the step, m.
        other: amplitude of the motion from the other start, m; nan unchecked, not settled, or
            without a possible start.
        resolved: the smallest amplitude that is no rounding, m.
        seconds: CPU time.
        force_error: estimated error of the largest normal force by the step and the basis, relative
            to this force; nan unchecked.
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
    by_mesh: Array
    worn: Array
    worn_by_step: Array
    other: float
    resolved: float
    seconds: float
    end: Array
    force_error: float = np.nan

    @property
    def largest(self) -> float:
        """The amplitude that errors are relative to: the largest one, or the smallest resolved."""
        return max(float(self.amplitudes.max(initial=0.0)), self.resolved)

    def error(self, cause: str) -> float:
        """The largest of the errors by "basis", "step" or "mesh", relative; nan unchecked."""
        found: Array = getattr(self, f"by_{cause}")
        return float(found.max()) / self.largest if found.size else np.nan

    @property
    def errors(self) -> Array:
        """(k,) estimated errors relative to the largest amplitude of the line; (0,) unchecked."""
        known = [found for found in (self.by_basis, self.by_step, self.by_mesh) if found.size]
        return np.asarray(sum(known, np.zeros(known[0].size if known else 0)) / self.largest)

    @property
    def worn_errors(self) -> Array:
        """(nodes,) estimated errors of the worn depth by the step, relative to the largest one."""
        return np.asarray(self.worn_by_step / max(float(self.worn.max(initial=0.0)), 1e-300))

    @property
    def motion(self) -> str:
        """The verdict with the period."""
        return f"period {self.period}" if self.period else self.verdict

    @property
    def coexists(self) -> bool:
        """Whether another start leads to another motion."""
        sizes = self.other, self.amplitude
        least = max(APART * max(sizes), self.resolved)
        return self.verdict != UNSETTLED and abs(sizes[0] - sizes[1]) > least


class Place:
    """A model at one speed, its contacts with their clearance, and its revolution."""

    def __init__(self, stored: StoredModel, scene: Scene):
        """Make the model of a scene at its speed."""
        assert scene.rotation is not None
        self.scene, self.table = scene, scene.map
        self.stored = stored.with_scene(scene)
        self.speed_rpm = scene.rotation.speed_rpm
        self.revolution = 60.0 / self.speed_rpm
        self.contacts = Problem.of(self.stored.model, self.scene).contacts
        self.walls = np.flatnonzero(~paired(scene, self.stored.model.points))
        if self.table.clearance == "at speed":
            self.contacts = self.contacts._replace(radius=self._radii())
        arms = self.stored.model.points.position - np.array(scene.rotation.point)
        self.resolved = ROUNDING * float(np.linalg.norm(arms, axis=1).max())

    def _radii(self) -> Array:
        """Radii (P,) with which each contact has its gap at speed instead of at rest, m."""
        plain = self.contacts._replace(order=np.zeros(0), times=np.zeros(0))
        moved = self.stored.model.contact_offset.reshape(plain.side.size, -1)
        number, shift = self.stored.model.points.contact, np.zeros(plain.side.size)
        for contact in np.unique(number[self.walls]):
            mine = np.flatnonzero(number == contact)
            depths = [
                max(penetration(plain, int(p), x[p], 0.0) for p in mine)
                for x in (moved, np.zeros_like(moved))
            ]
            shift[mine] = depths[0] - depths[1]
        return np.asarray(plain.radius + plain.side * shift)

    def line(self, checked: bool, before: Line | None) -> Line:
        """The line of this speed; see `Line`.

        Args:
            checked: whether the error by the basis is estimated and another motion is sought.
            before: the line from which this one continues; None starts at rest on new layers.
        """
        model, steps, nothing = self.stored.model, steps_of(self.scene), np.zeros(0)
        motion = self.march(model, steps, before, self._given(self.stored, before))
        radial = self.radial(motion, steps)
        verdict, period = verdict_of(motion, radial, steps, self.resolved)
        late = self._late(motion, radial, steps)
        line = Line(
            speed_rpm=self.speed_rpm,
            amplitudes=self.spectrum(radial, steps, period),
            amplitude=half_range(radial),
            peak_force=self._peak_force(motion, late),
            contact=float(np.mean(np.any(motion.state[late][:, self.walls] >= 0, axis=1))),
            clearance=self._clearance(motion.gap[late]),
            verdict=verdict,
            period=period,
            free_hz=self.frequencies(self._stiffness()),
            closed_hz=self.frequencies(self._stiffness() + self._contact_stiffness()),
            by_basis=nothing,
            by_step=nothing,
            by_mesh=nothing,
            worn=worn_by(motion),
            worn_by_step=nothing,
            other=np.nan,
            resolved=self.resolved,
            seconds=0.0,
            end=self._end(motion),
        )
        return self._compared(line, checked, before, float(motion.kinetic[late].max()))

    def _compared(self, line: Line, checked: bool, before: Line | None, energy: float) -> Line:
        """A line with its estimated errors, and with the amplitude from another start.

        Args:
            line: the line.
            checked: as `line`.
            before: as `line`.
            energy: largest kinetic energy of its motion, J.
        """
        steps, wears, stored = steps_of(self.scene), self.scene.wears, self.stored
        if self.table.steady == "newton" and not wears:
            before = line  # to compare motions of one branch
        start = self._given(stored, before)

        forces = []

        def spectrum(motion: Motion, count: int) -> Array:
            values = self.radial(motion, count)
            forces.append(self._peak_force(motion, self._late(motion, values, count)))
            period = min(line.period, values.shape[0] // count)
            return np.abs(self.spectrum(values, count, period) - line.amplitudes)

        if checked or wears:
            finer = self.march(stored.model, 2 * steps, before, start)
            worn_by_step = np.abs(worn_by(finer) - line.worn)
            line = replace(line, by_step=spectrum(finer, 2 * steps), worn_by_step=worn_by_step)
        if checked:
            more = stored.resized(min(2 * stored.size, stored.size + len(stored.further)))
            larger = self.march(more.model, steps, before, self._given(more, before))
            line = replace(line, by_basis=spectrum(larger, steps))
        if checked and (meshes := stored.meshes) is not None:
            _, model, numbers = meshes
            begin = start and tuple(np.where(np.array(numbers) >= 0, x[numbers], 0) for x in start)
            line = replace(line, by_mesh=spectrum(self.march(model, steps, before, begin), steps))
        apart = sum(abs(force - line.peak_force) for force in forces)
        line = replace(line, force_error=apart / max(line.peak_force, TINY))
        if not checked or wears:  # what another start wears is another history
            return line
        contacts = self._problem(stored.model, steps, before).contacts
        if (away := self._away(contacts, line, energy)) is not None:
            second = self.march(stored.model, steps, before, away)
            other = self.radial(second, steps)
            if verdict_of(second, other, steps, self.resolved)[0] != UNSETTLED:
                line = replace(line, other=half_range(other))
        return line

    def _late(self, motion: Motion, radial: Array, steps: int) -> NDArray[np.bool_]:
        """(ns,) whether a step belongs to the revolutions of the radial motion (m N, P)."""
        since = motion.time[-1] - (radial.shape[0] / steps) * self.revolution
        return np.asarray(motion.time > since)

    def _peak_force(self, motion: Motion, late: NDArray[np.bool_]) -> float:
        """The largest normal force of rigid surfaces in some steps (ns,), N."""
        return float(motion.force[late][:, self.walls, 0].max())

    def march(
        self, model: ReducedModel, steps: int, before: Line | None, start: tuple[Array, ...] | None
    ) -> Motion:
        """The motion of a model at this speed until it is steady, or over all revolutions.

        A march that does not repeat gives the periodic motion to which it tends, if there is one.

        Args:
            model: the model.
            steps: steps per revolution.
            before: the line from which it continues, with its layers.
            start: displacement and velocity (n,); None starts at rest.
        """
        problem = self._problem(model, steps, before)
        motion = integrate(problem, start=start)
        verdict, period = verdict_of(motion, self.radial(motion, steps), steps, self.resolved)
        if self.table.steady == "newton" or (verdict not in (TORUS, OTHER) and period < 2):
            return motion
        time = problem.time.changed(periods=LATE, steady="newton", steady_tolerance=STEADY)
        assert motion.end is not None
        problem = problem.settled().with_own_wear(motion.end.worn)._replace(time=time)
        exact = integrate(problem, start=end_of(motion))
        return exact if exact.steady else motion

    def _problem(self, model: ReducedModel, steps: int, before: Line | None) -> Problem:
        """What a march of a model computes; arguments as `march`."""
        time = self.scene.time.changed(
            periods=self.table.revolutions,
            steady=self.table.steady,
            steady_tolerance=STEADY if self.table.steady == "newton" else 0.0,
            steps_per_period=steps,
        )
        problem = Problem(model, self.contacts, time, self.revolution)
        return problem if before is None else problem.settled().with_own_wear(before.worn)

    def radial(self, motion: Motion, steps: int) -> Array:
        """The motion (m N, P) of the points at walls along their normals at equal instants, m.

        It is that of the last revolutions, or of one period if the motion is steady.
        """
        assert motion.period is not None
        count = round(motion.period / self.revolution) if motion.steady else self.table.last
        instants = motion.time[-1] - self.revolution / steps * np.arange(count * steps)[::-1]
        places = np.searchsorted(motion.time, instants - 0.1 * self.revolution / steps)
        return np.asarray(motion.displacement[places][:, self.walls, 0])

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

    def frequencies(self, stiffness: Array) -> Array:
        """The natural frequencies (v,) of the normal modes, zero where they do not swing, Hz."""
        model, n = self.stored.model, stiffness.shape[0]
        velocity = model.velocity_matrix
        found = roots(model.mass, 0.5 * (velocity - velocity.T), stiffness)
        swings = np.sort(found.imag)[n:]  # one of each pair
        return np.asarray(swings[: self.stored.frequencies_hz.size] / (2.0 * np.pi))

    def _stiffness(self) -> Array:
        """(n, n) K at the equilibrium, in which the closed points of bodies that touch stick."""
        return closed_stiffness(self.stored.model, self.scene)

    def _contact_stiffness(self) -> Array:
        """(n, n) sum_p k_n (b_p - mu t_p) b_p^T of the module docstring."""
        model, contacts = self.stored.model, self.contacts
        rows = model.contact_rows.reshape(contacts.side.size, -1, model.mass.shape[0])
        found = np.zeros_like(model.mass)
        for p in self.walls:
            row = rows[p]
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
        given = np.array([contact.gap or 0.0 for contact in self.scene.contacts])
        given, gaps = given[self.stored.model.points.contact[self.walls]], gaps[:, self.walls]
        if not np.any(given > 0.0):
            return float("nan")
        nearest = float(gaps[:, given > 0.0].min())
        return 1.0 - nearest / float(given[given > 0.0].min())

    def _away(self, contacts: Contacts, line: Line, energy: float) -> tuple[Array, Array] | None:
        """Another possible start: at rest in the first mode, away from the surface; or None.

        Along the normals it is `AWAY` times as large as the motion, but it has at most `ENERGY`
        times the energy: the first mode of a straight blade moves its tip along the surface, and
        away from it by rounding only. A start is possible if no point is deeper in its surface than
        in the equilibrium, and if it keeps this limit of the energy as a nonlinear body: one that
        is bent or squeezed too far has much more.

        Args:
            contacts: the contacts at the start of the march.
            line: the motion.
            energy: its largest kinetic energy, J.
        """
        model, allowed = self.stored.model, ENERGY * energy
        squares, shapes = scipy.linalg.eigh(self._stiffness(), model.mass)
        stable, rest = np.flatnonzero(squares > 0.0), np.zeros(squares.size)
        if not stable.size:
            return None
        shape = shapes[:, stable[0]] * np.sqrt(2.0 * allowed / squares[stable[0]])
        moved = (model.contact_rows @ shape).reshape(contacts.side.size, -1)[self.walls, 0]
        far = moved[np.argmax(np.abs(moved))]
        shape *= -np.copysign(min(1.0, AWAY * line.amplitude / max(abs(far), TINY)), far)
        least = np.maximum(self._depths(contacts, rest), 0.0)
        for part in 0.5 ** np.arange(HALVINGS):
            for q in (part * shape, -part * shape):
                fits = np.all(self._depths(contacts, q) <= least)
                stored = model.elastic_at(q)[1] - model.elastic.force @ q
                if fits and stored <= (1.0 + ROUNDING) * allowed:
                    return q, rest
        return None

    def _depths(self, contacts: Contacts, q: Array) -> Array:
        """Depth (P,) of each point at a wall in its surface at the start of a march, m."""
        x = self.stored.model.contact_displacement(q).reshape(contacts.side.size, -1)
        return np.array([penetration(contacts, int(p), x[p], 0.0) for p in self.walls])

    def _given(self, stored: StoredModel, before: Line | None) -> tuple[Array, Array] | None:
        """The end of a line in the coordinates of a model at this speed; None without a line."""
        if before is None:
            return None
        start = before.end
        q0, z = self._vectors(stored)
        mass = self.stored.whole.model.mass  # type: ignore[union-attr]
        q, v = np.linalg.solve(z.T @ mass @ z, z.T @ mass @ np.array([start[0] - q0, start[1]]).T).T
        return q, v

    def _end(self, motion: Motion) -> Array:
        """The end of a motion in the coordinates of the range model; empty if nothing needs it."""
        if self.table.start == "rest" and self.table.steady == "march":
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


def worn_by(motion: Motion) -> Array:
    """(nodes,) worn depth of abradable layers at the end of a motion, m; (0,) without layers."""
    assert motion.end is not None
    return np.zeros(0) if motion.end.worn is None else motion.end.worn.copy()


def half_range(radial: Array) -> float:
    """Half of the largest range of a column (m, P)."""
    return float(np.ptp(radial, axis=0).max() / 2.0)


def verdict_of(motion: Motion, radial: Array, steps: int, resolved: float) -> tuple[str, int]:
    """The verdict on a motion, and its period; see `Line`."""
    assert motion.end is not None
    if motion.end.wearing:
        return WEARING, 0
    if motion.steady:
        return PERIOD, radial.shape[0] // steps
    return verdict_of_last(radial, steps, resolved)


def verdict_of_last(radial: Array, steps: int, resolved: float) -> tuple[str, int]:
    """The verdict on the last revolutions (m N, P), of N steps each, and their period."""
    count = radial.shape[0] // steps
    size = float(np.ptp(radial, axis=0).max())
    if size <= resolved:
        return PERIOD, 1  # at rest
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
    return scene.time.steps_per_period or scene.time.steps_per_revolution or STEPS
