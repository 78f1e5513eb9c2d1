"""The interaction map: the motion of a blade that rubs its casing, over the speed of rotation.

Each speed is a line of the map (`assess.studies.map_line`).

Lobes that pass the blade n times per revolution excite it at the speeds k n Omega = omega_i(Omega),
with the frequencies omega_i of the free blade. Contact stiffens: with all points closed and
sliding, the frequencies are those of K + sum_p k_n (b_p - mu t_p) b_p^T, where b_p are the rows of
the normals and t_p those of the direction in which the surface slides. The resonance lies between
both speeds.

Every tenth speed and that of the largest amplitude are computed four times more: with twice the
coordinates, with half the step, with finer elements, and from another start, which may lead to
another motion. With layers that wear, half the step is used at each speed, and another start is
not: it has another history of wear.
"""

import hashlib
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.verdicts import CONTACT_ERROR
from fenicsrom.assess.jobs import Workers, run_jobs
from fenicsrom.assess.rotation.campbell import FrequencyCurve
from fenicsrom.assess.studies.map_line import UNSETTLED, Line, Place, steps_of
from fenicsrom.assess.studies.sweep_runs import digest_of, file_digest, model_of
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.notes import AMPLITUDES, PEAK_FORCE, WEAR, Note, NoteKind
from fenicsrom.online.contact.coating import Ring, rings_of
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.progress import log, time_left
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.curve_checks import beside_speed
from fenicsrom.scene.keys.excitation import excited_orders
from fenicsrom.words import brief, counted

FORMAT, EARLIER = "fenicsrom map 1", "fenicsrom map"
CHECKED = 10  # every so many speeds the errors are estimated
COST = 7  # of a speed whose errors are estimated, in others
FEW = 6  # most speeds that a note lists
LARGE = 0.05  # estimated error of a cell, relative to the largest of its line, that is marked


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
        rings: the rings of abradable layers.
        reused: number of speeds of an earlier map.
        seconds: run time.
        interrupted: whether the map was interrupted.
        warnings: notes for the user.
        unfinished: the error of a speed without a motion.
        files: the written files.
    """

    scene: Scene
    lines: list[Line]
    size: int
    steps: int
    excited: tuple[int, ...]
    rings: list[Ring] = field(default_factory=list)
    reused: int = 0
    seconds: float = 0.0
    interrupted: bool = False
    warnings: list[Note] = field(default_factory=list)
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
        stem: path of the file of the result, without its ending.
        before: the speed from which this one continues; None starts at rest on new layers.
    """

    model: Path
    scene: Scene
    speed_rpm: float
    checked: bool
    stem: Path
    before: Line | None = None

    @property
    def file(self) -> Path:
        """Keeps the result."""
        return self.stem.with_suffix(".checked.npz" if self.checked else ".npz")


def map_speeds(scene: Scene) -> Array:
    """The speeds of a map, rev/min.

    Raises:
        SceneError: there is no range of speeds or no contact, a number is out of its range, or a
            load or a step does not follow the speed.
    """
    table = scene.map

    def refuse(key: str, reason: str, kind: ErrorKind) -> SceneError:
        return SceneError(f"{scene.source}: {key}{reason}", kind=kind, key=key, source=scene.source)

    if scene.speeds_rpm is None:
        raise refuse("rotation.speeds_rpm", " is missing: a map needs it", ErrorKind.MISSING)
    if not scene.contacts:
        raise refuse("contacts", ": a map needs a contact", ErrorKind.MISSING)
    if scene.rotation is not None and scene.rotation.history:
        reason = ": not allowed in a map, whose speeds are constant; [] leaves it out"
        raise refuse("rotation.history", reason, ErrorKind.CONFLICT)
    for reason in beside_speed(scene):
        raise refuse("map", f": {reason}", ErrorKind.CONFLICT)
    for key in ("tolerance", "step"):
        if getattr(scene.time, key):
            reason = " is not allowed in a map: give time.steps_per_period"
            raise refuse(f"time.{key}", reason, ErrorKind.CONFLICT)
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
        SceneError: as `map_speeds`, or a file of an earlier map is damaged.
        OSError: a file cannot be written.
    """
    begin = clock.perf_counter()
    speeds, table, origin = map_speeds(scene), scene.map, file_digest(model)
    folder, model = folder.resolve(), model.resolve()
    plain = replace(scene, map=replace(table, speeds_rpm=None))
    jobs = []
    for k, speed in enumerate(map(float, speeds)):
        before = {"rest": speeds[:0], "up": speeds[:k], "down": speeds[k + 1 :]}[table.start]
        content = f"{digest_of(plain, origin)} {speed!r} {before.tolist()}"
        stem = folder / hashlib.sha256(content.encode()).hexdigest()[:16]
        jobs.append(_Job(model, scene, speed, k % CHECKED == 0, stem))
    if table.start == "down":
        jobs.reverse()
    stored = model_of(model, origin)
    points, turning = stored.model.points, scene.at_speed(float(speeds[-1]))
    rings = rings_of(turning, points, contacts_of(turning, points))
    found = InteractionMap(scene, [], stored.size, steps_of(scene), excited_orders(scene), rings)
    kept = {k: _kept(job) for k, job in enumerate(jobs) if resume}
    done = {k: line for k, line in kept.items() if line is not None}
    found.reused = len(done)

    def compute(waiting: list[int]) -> None:
        """Add the lines of some jobs to those that are done."""
        cost = {k: COST if job.checked else 1 for k, job in enumerate(jobs) if not kept.get(k)}
        for k, line in _computed(jobs, waiting, done, workers, stop, comm):
            if isinstance(line, Exception):
                found.unfinished = found.unfinished or line
                text = f"{jobs[k].speed_rpm:g} rpm: {line}"
                found.warnings.append(Note(NoteKind.FAILED, text))
                continue
            done[k] = line
            part = sum(cost.get(k, 0) for k in done) / max(sum(cost.values()), 1)
            left = time_left(clock.perf_counter() - begin, part)
            log.info(f"  {line.speed_rpm:g} rpm; {len(done)} of {len(jobs)} speeds, {left}")

    try:
        compute([k for k in range(len(jobs)) if k not in done])
        top = max(done, key=lambda k: done[k].amplitude, default=None)
        if top is not None and not done[top].by_basis.size:
            jobs[top] = replace(jobs[top], checked=True)
            compute([top])
    except KeyboardInterrupt:
        found.interrupted = True
    if found.unfinished and table.start != "rest" and len(done) + 1 < len(jobs):
        text = "The map ends there: no other speed has a start."
        found.warnings.append(Note(NoteKind.FAILED, text))
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
        job = replace(jobs[k], before=done.get(k - 1))
        for _, line in run_jobs(_compute, [job], tell, 1, stop):
            yield k, line
        if k not in done:
            return  # there is nothing from which the next speed could continue


def _compute(job: _Job, report: Callable[[float, str], None]) -> Line | Exception:
    """The line of a job, which is kept in its file; or the error that ended its motion."""
    begin = clock.process_time()
    stored = model_of(job.model, file_digest(job.model))

    def stop() -> bool:
        report(0.0, "")
        return False

    try:
        place = Place(stored, job.scene.at_speed(job.speed_rpm), stop)
        line = replace(place.line(job.checked, job.before), seconds=clock.process_time() - begin)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return error
    arrays = {entry.name: np.asarray(getattr(line, entry.name)) for entry in fields(Line)}
    write_archive(job.file, {"format": FORMAT}, arrays)
    return line


def _kept(job: _Job) -> Line | None:
    """The line that the file of a job keeps, with its checks if it has them; None without one.

    Raises:
        SceneError: the file is damaged, or of another version of the program.
    """
    for found in (replace(job, checked=True), job):
        if found.file.exists():
            return _read_line(found.file)
    return None


def check_kept(folder: Path) -> None:
    """Check that the files of an earlier map can be read.

    Raises:
        SceneError: a file is damaged, or of another version of the program.
    """
    for file in sorted(folder.glob("*.npz")):
        _read_line(file)


def _read_line(file: Path) -> Line:
    """Read the line of a speed; errors as `check_kept`."""
    try:
        with read_archive(file, "a speed of a map", FORMAT, EARLIER) as (_, arrays):
            return Line(**{key: x if x.ndim else x.item() for key, x in arrays.items()})
    except SceneError as error:
        reason = f"{error}; delete this file, and the map computes its speed again"
        raise SceneError(reason, kind=error.kind, source=error.source) from None


def _warnings(found: InteractionMap) -> list[Note]:
    """Notes on motions that did not settle, on large errors and on coexisting motions."""
    checked = [line for line in found.lines if line.errors.size]
    unsettled = [line for line in found.lines if line.verdict == UNSETTLED]
    wrong = [line for line in checked if line.errors.max() > LARGE]
    rough = [line for line in checked if not line.force_error <= CONTACT_ERROR]
    several = [line for line in checked if line.coexists]
    unsure = [line for line in checked if line.worn_errors.max(initial=0.0) > LARGE]
    above = f"have an estimated error above {100 * LARGE:g} % of the largest"
    said = []
    if unsettled:
        text = (
            f"{len(unsettled)} of {counted(len(found.lines), 'speed')}, {_rpm(unsettled)}: the "
            f"motion did not settle in map.revolutions = {found.scene.map.revolutions}, so its "
            "numbers are those of the last revolutions only: raise map.revolutions, or set "
            'map.steady = "newton".'
        )
        said.append(Note(NoteKind.UNSETTLED, text, "map.revolutions"))
    for lines, sentence, kind, quantity in (
        (wrong, f"cells {above} amplitude", NoteKind.ERROR, AMPLITUDES),
        (
            rough,
            f"the peak normal force has an estimated error above {100 * CONTACT_ERROR:g} %",
            NoteKind.ERROR,
            PEAK_FORCE,
        ),
        (unsure, f"worn depths {above} one", NoteKind.ERROR, WEAR),
        (several, "another start leads to another motion", NoteKind.SEVERAL, ""),
    ):
        if lines:
            text = f"{len(lines)} of {counted(len(checked), 'checked speed')}, {_rpm(lines)}: "
            said.append(Note(kind, f"{text}{sentence}.", quantity=quantity))
    return said


def _rpm(lines: list[Line]) -> str:
    """The speeds of some lines in words."""
    speeds = [f"{line.speed_rpm:g}" for line in lines]
    if len(speeds) > FEW:
        return f"{speeds[0]} to {speeds[-1]} rpm"
    return f"{', '.join(speeds)} rpm"
