"""The interaction map: the motion of a blade that rubs its casing, over the speed of rotation.

At each speed a model of this speed (`fenicsrom.online.step.speed_range`) marches some revolutions
with equal steps. The motion along the normals of the contact points in the last revolutions gives a
line of the map: its amplitudes over the engine orders j / m, with m revolutions, where a motion
that repeats has lines only and any other one is weighted by Hann's window,

    A_k = (2 / sum_i w_i) |sum_i w_i x_i exp(-2 pi i k s_i)|,    s_i in revolutions.          (1)

Lobes that pass the blade n times per revolution excite it at the speeds k n Omega = omega_i(Omega),
with the frequencies omega_i of the free blade. Contact stiffens: with all points closed and
sliding, the frequencies are those of K + sum_p k_n (b_p - mu t_p) b_p^T, where b_p are the rows of
the normals and t_p those of the direction in which the surface slides. The resonance lies between
both speeds.

Every tenth speed is computed three times more: with twice the coordinates, with half the step, and
from another start, which may lead to another motion.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.assess.jobs import Workers, run_jobs
from fenicsrom.assess.rotation.critical_speeds import FrequencyCurve
from fenicsrom.assess.studies.sweep_runs import digest_of, file_digest, model_of
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.files import atomic_write
from fenicsrom.online.contact.surfaces import CYLINDER, penetration
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import end_of, integrate
from fenicsrom.progress import log, time_left
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.loads import OrderFrequency
from fenicsrom.words import brief, counted

if TYPE_CHECKING:
    from fenicsrom.online.store.archive import StoredModel

CHECKED = 10  # every so many speeds the errors are estimated
LARGE = 0.05  # estimated error of a cell, relative to the largest of its line, that is marked
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


@brief()
@dataclass(eq=False, repr=False)
class InteractionMap:
    """The map of a scene.

    Attributes:
        scene: the scene.
        lines: the speeds that were computed, ascending.
        size: number of coordinates of the models at one speed.
        steps: time steps per revolution.
        excited: engine orders that loads excite, and multiples of the orders of waves.
        reused: number of speeds of an earlier map.
        seconds: run time.
        interrupted: whether the map was interrupted.
        warnings: sentences for the user.
        unfinished: the error of a speed without a motion.
        files: the written files.
    """

    scene: Scene
    lines: list[Line]
    size: int
    steps: int
    excited: tuple[int, ...]
    reused: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)
    unfinished: Exception | None = None
    files: list[Path] = field(default_factory=list)

    @property
    def speeds_rpm(self) -> Array:
        """(s,) the speeds."""
        return self.column("speed_rpm")

    @property
    def orders(self) -> Array:
        """(k,) the engine orders."""
        table = self.scene.map
        return np.arange(table.orders * table.last + 1) / table.last

    @property
    def amplitudes(self) -> Array:
        """(s, k) amplitudes over speeds and engine orders, m."""
        return np.array([line.amplitudes for line in self.lines])

    def column(self, name: str) -> Array:
        """(s, ..) one attribute of all lines."""
        return np.array([getattr(line, name) for line in self.lines])

    def onsets(self) -> list[tuple[int, int, float | None, float | None]]:
        """Mode, engine order, and the speeds where they meet, free and closed, rev/min."""
        if len(self.lines) < 2:
            return []
        rotation = self.scene.rotation
        coriolis = rotation is not None and rotation.coriolis

        def crossing(frequencies: Array, order: int) -> float | None:
            curve = FrequencyCurve(self.speeds_rpm, frequencies**2, coriolis)
            found = curve.crossings(order)
            return float(found[0]) if found.size else None

        found = []
        free, closed = self.column("free_hz"), self.column("closed_hz")
        for mode in range(free.shape[1]):
            for order in reversed(self.excited):
                pair = crossing(free[:, mode], order), crossing(closed[:, mode], order)
                if pair != (None, None):
                    found.append((mode + 1, order, *pair))
        return found


@dataclass(frozen=True)
class _Job:
    """One speed.

    Attributes:
        model: file of the model for a range of speeds.
        scene: the scene.
        speed_rpm: the speed.
        checked: whether errors are estimated.
        file: keeps the result.
        start: (2, n) displacement and velocity in the coordinates of the range model; None is rest.
    """

    model: Path
    scene: Scene
    speed_rpm: float
    checked: bool
    file: Path
    start: Array | None = None


def map_speeds(scene: Scene) -> Array:
    """The speeds of a map, rev/min.

    Raises:
        SceneError: there is no range of speeds or no contact, or a number is out of its range.
    """
    table = scene.map

    def refuse(key: str, reason: str, kind: ErrorKind) -> SceneError:
        return SceneError(f"{scene.source}: {key}{reason}", kind=kind, key=key, source=scene.source)

    if scene.speeds_rpm is None:
        raise refuse("rotation.speeds_rpm", " is missing: a map needs it", ErrorKind.MISSING)
    if not scene.contacts:
        raise refuse("contacts", ": a map needs a contact", ErrorKind.MISSING)
    low, high = scene.speeds_rpm[0], scene.speeds_rpm[-1]
    speeds = np.array(table.speeds_rpm or np.linspace(max(low, high / 40.0), high, 40))
    for speed in speeds[(speeds <= 0.0) | (speeds < low) | (speeds > high)]:
        allowed = f" = {speed:g}: must be above 0 and from {low:g} to {high:g} rpm"
        raise refuse("map.speeds_rpm", allowed, ErrorKind.RANGE)
    if table.last > table.revolutions:
        allowed = f" = {table.last}: must be at most map.revolutions = {table.revolutions}"
        raise refuse("map.last", allowed, ErrorKind.RANGE)
    return speeds


def interaction_map(
    scene: Scene,
    model: Path,
    folder: Path,
    *,
    resume: bool = False,
    workers: Workers = 1,
    stop: Callable[[], bool] = lambda: False,
    comm: Any = None,
) -> InteractionMap:
    """Compute the map of a model for a range of speeds.

    Args:
        scene: the scene, with a table [map].
        model: file of the model.
        folder: keeps the speeds that are done.
        resume: whether to take what an earlier map has kept there.
        workers: compute the speeds, see `fenicsrom.assess.jobs`; a map that goes "up" or "down"
            continues from speed to speed and needs one process.
        stop: asked often; the map ends when it returns True.
        comm: MPI communicator.

    Raises:
        SceneError: as `map_speeds`.
        OSError: a file cannot be written.
    """
    begin = clock.perf_counter()
    speeds, table, origin = map_speeds(scene), scene.map, file_digest(model)
    folder, model = folder.resolve(), model.resolve()
    plain = replace(scene, map=replace(table, speeds_rpm=None))
    jobs = []
    for k, speed in enumerate(map(float, speeds)):
        before = {"rest": speeds[:0], "up": speeds[:k], "down": speeds[k + 1 :]}[table.start]
        checked = k % CHECKED == 0
        content = f"{digest_of(plain, origin)} {speed!r} {checked} {before.tolist()}"
        digest = hashlib.sha256(content.encode())
        file = folder / f"{digest.hexdigest()[:16]}.npz"
        jobs.append(_Job(model, scene, speed, checked, file))
    if table.start == "down":
        jobs.reverse()
    found = InteractionMap(scene, [], model_of(model, origin).size, _steps(scene), _excited(scene))
    kept = {k: _kept(job.file) for k, job in enumerate(jobs) if resume}
    done = {k: line for k, line in kept.items() if line is not None}
    found.reused = len(done)
    waiting = [k for k in range(len(jobs)) if k not in done]
    try:
        for k, line in _computed(jobs, waiting, done, workers, stop, comm):
            if isinstance(line, Exception):
                found.unfinished = found.unfinished or line
                found.warnings.append(f"{jobs[k].speed_rpm:g} rpm: {line}")
                continue
            done[k] = line
            left = time_left(clock.perf_counter() - begin, len(done) / len(jobs))
            log.info(f"  {line.speed_rpm:g} rpm; {len(done)} of {len(jobs)} speeds, {left}")
    except KeyboardInterrupt:
        found.interrupted = True
    found.lines = sorted(done.values(), key=lambda line: line.speed_rpm)
    found.warnings += _warnings(found)
    found.seconds = clock.perf_counter() - begin
    return found


def _computed(
    jobs: list[_Job],
    waiting: list[int],
    done: dict[int, Line],
    workers: Workers,
    stop: Callable[[], bool],
    comm: Any,
) -> Iterator[tuple[int, Any]]:
    """Number and result of each job that waits; with `start` "up" or "down" one after another."""

    def tell(number: int, fraction: float, line: str) -> None:
        """The lines of progress are written where the results arrive."""

    if jobs[0].scene.map.start == "rest":
        chosen = [jobs[k] for k in waiting]
        for number, line in run_jobs(_compute, chosen, tell, workers, stop, comm):
            yield waiting[number], line
        return
    for k in waiting:
        before = done.get(k - 1)
        job = jobs[k] if before is None else replace(jobs[k], start=before.end)
        for _, line in run_jobs(_compute, [job], tell, 1, stop):
            yield k, line


def _compute(job: _Job, report: Callable[[float, str], None]) -> Line | Exception:
    """The line of a job, which is kept in its file; or the error that ended its motion."""
    begin = clock.process_time()
    stored = model_of(job.model, file_digest(job.model))

    def stop() -> bool:
        report(0.0, "")
        return False

    try:
        place = _Place(stored, job.scene.at_speed(job.speed_rpm), stop)
        line = replace(place.line(job), seconds=clock.process_time() - begin)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return error
    with atomic_write(job.file) as temporary, temporary.open("wb") as file:
        np.savez(file, **{entry.name: getattr(line, entry.name) for entry in fields(Line)})
    return line


def _kept(path: Path) -> Line | None:
    """The line that a file keeps; None if there is none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {entry.name: file[entry.name] for entry in fields(Line)}
    except (OSError, ValueError, KeyError):
        return None
    return Line(**{key: value if value.ndim else value.item() for key, value in arrays.items()})


class _Place:
    """A model at one speed, its contacts with their clearance, and its revolution."""

    def __init__(self, stored: StoredModel, scene: Scene, stop: Callable[[], bool]):
        """Make the model of a scene at its speed."""
        assert scene.rotation is not None
        self.scene, self.table, self.stop = scene, scene.map, stop
        self.stored = stored.with_scene(scene)
        self.revolution = 60.0 / scene.rotation.speed_rpm
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

    def line(self, job: _Job) -> Line:
        """The line of a job at this speed; see `Line`."""
        model, steps, nothing = self.stored.model, _steps(self.scene), np.zeros(0)
        motion = self.march(self.stored, steps, self._given(self.stored, job.start))
        radial = self.last(motion.displacement[:, :, 0], steps)
        verdict, period = verdict_of(radial, steps)
        amplitudes = self.spectrum(radial, steps, period)
        late = slice(-1 - radial.shape[0], None)
        line = Line(
            job.speed_rpm,
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
        if not job.checked:
            return line
        size = min(2 * self.stored.size, self.stored.size + len(self.stored.further))
        others = []
        for stored, count in ((self.stored.resized(size), steps), (self.stored, 2 * steps)):
            finer = self.march(stored, count, self._given(stored, job.start))
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


def _steps(scene: Scene) -> int:
    """Steps per revolution."""
    return scene.time.steps_per_period or STEPS


def _excited(scene: Scene) -> tuple[int, ...]:
    """The engine orders of loads, and the multiples of the orders of waves, up to the highest."""
    top = scene.map.orders
    found = {
        multiple
        for contact in scene.contacts
        if contact.surface is not None
        for order, height, _ in contact.surface.waves
        if height
        for multiple in range(int(order), top + 1, int(order))
    }
    for load in scene.loads:
        if isinstance(load.frequency, OrderFrequency):
            terms = getattr(load.history, "harmonics", ((1, 1.0, 0.0),))
            found |= {load.frequency.order * order for order, part, _ in terms if part}
    return tuple(sorted(order for order in found if order <= top))


def _warnings(found: InteractionMap) -> list[str]:
    """Sentences on large errors and coexisting motions."""
    checked = [line for line in found.lines if line.errors.size]
    wrong = [line for line in checked if line.errors.max() > LARGE]
    several = [line for line in checked if line.coexists]
    said = []
    for lines, sentence in (
        (wrong, f"cells have an estimated error above {100 * LARGE:g} % of the largest amplitude"),
        (several, "another start leads to another motion"),
    ):
        if lines:
            speeds = ", ".join(f"{line.speed_rpm:g}" for line in lines)
            said.append(
                f"{counted(len(lines), 'speed')} of the {len(checked)} checked ones, {speeds} rpm: "
                f"{sentence}."
            )
    return said
