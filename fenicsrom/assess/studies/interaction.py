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

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.verdicts import CONTACT_ERROR
from fenicsrom.assess.jobs import Workers
from fenicsrom.assess.rotation.critical_speeds import FrequencyCurve
from fenicsrom.assess.studies.batch import Batch
from fenicsrom.assess.studies.map_line import UNSETTLED, Line, Place, steps_of
from fenicsrom.assess.studies.sweep_runs import digest_of, file_digest, model_of
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.notes import AMPLITUDES, PEAK_FORCE, WEAR, Note, NoteKind
from fenicsrom.online.contact.coating import Ring, rings_of
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.curve_checks import beside_speed
from fenicsrom.scene.keys.excitation import excited_orders
from fenicsrom.words import brief, counted

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
        before: the speed from which this one continues; None starts at rest on new layers.
    """

    model: Path
    scene: Scene
    speed_rpm: float
    checked: bool
    before: Line | None = None


def map_speeds(scene: Scene) -> Array:
    """The speeds of a map, rev/min.

    Raises:
        SceneError: there is no range of speeds or no contact, a number is out of its range, or a
            load or a step does not follow the speed.
    """
    table = scene.map

    def refusal(key: str, reason: str, kind: ErrorKind = ErrorKind.CONFLICT) -> SceneError:
        return refuse(scene.source, reason, kind, key)

    if scene.speeds_rpm is None:
        raise refusal("rotation.speeds_rpm", "missing: a map needs it", ErrorKind.MISSING)
    if all(contact.against for contact in scene.contacts):
        raise refusal("contacts", "a map needs a contact with a rigid surface", ErrorKind.MISSING)
    if scene.basis.masters == "motion":
        reason = 'must be "all" in a map: other speeds have other motions than the scene, which '
        raise refusal("basis.masters", f"{reason}would choose the interface vectors")
    if scene.rotation is not None and scene.rotation.history:
        reason = "not allowed in a map, whose speeds are constant; [] leaves it out"
        raise refusal("rotation.history", reason)
    for reason in beside_speed(scene):
        raise refusal("map", reason)
    for key in ("tolerance", "step"):
        if getattr(scene.time, key):
            raise refusal(f"time.{key}", "not allowed in a map: give time.steps_per_period")
    low, high = scene.speeds_rpm[0], scene.speeds_rpm[-1]
    speeds = np.array(table.speeds_rpm or np.linspace(max(low, high / 40.0), high, 40))
    for speed in speeds[(speeds <= 0.0) | (speeds < low) | (speeds > high)]:
        allowed = f"must be above 0 and from {low:g} to {high:g} rpm"
        raise Where(str(scene.source), "map.speeds_rpm").refuse(float(speed), allowed)
    if table.last > table.revolutions:
        allowed = f"must be at most map.revolutions = {table.revolutions}"
        raise Where(str(scene.source), "map.last").refuse(table.last, allowed)
    return speeds


def interaction_map(
    scene: Scene,
    model: Path,
    folder: Path,
    *,
    resume: bool = False,
    workers: Workers = 1,
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
        comm: MPI communicator.

    Raises:
        SceneError: as `map_speeds`.
        OSError: a file cannot be written.
    """
    begin = clock.perf_counter()
    speeds, table, origin = map_speeds(scene), scene.map, file_digest(model)
    content = digest_of(replace(scene, map=replace(table, speeds_rpm=None)), origin)
    rest, stored = table.start == "rest", model_of(model, origin)
    points, turning = stored.model.points, scene.at_speed(float(speeds[-1]))
    rings = rings_of(turning, points, contacts_of(turning, points))
    found = InteractionMap(scene, [], stored.size, steps_of(scene), excited_orders(scene), rings)
    batch = Batch("speed", folder, {"Line": Line}, resume, workers, comm)
    path = model.resolve()  # workers may run in other folders
    jobs = [_Job(path, scene, rpm, k % CHECKED == 0) for k, rpm in enumerate(map(float, speeds))]
    jobs = jobs[:: -1 if table.start == "down" else 1]

    order = [job.speed_rpm for job in jobs]

    def compute(numbers: Sequence[int], after: Any = None) -> dict[int, Any]:
        """The lines of some jobs, or their errors."""
        computed = batch.each(
            _line,
            [jobs[k] for k in numbers],
            lambda n, _: f"{order[numbers[n]]:g} rpm",
            [f"{content} {order[k * rest : k + 1]} {jobs[k].checked}" for k in numbers],
            [COST if jobs[k].checked else 1 for k in numbers],
            after,
        )
        return {numbers[n]: line for n, line in computed.items()}

    following = None if rest else lambda job, before: replace(job, before=before)
    done = compute(range(len(jobs)), following)
    found.reused = batch.reused
    lines = {k: line for k, line in done.items() if isinstance(line, Line)}
    top = max(lines, key=lambda k: lines[k].amplitude, default=None)
    if top is not None and not batch.interrupted and not lines[top].by_basis.size:
        before = None if rest else lines.get(top - 1)
        jobs[top] = replace(jobs[top], checked=True, before=before)
        done |= compute([top])
    found.unfinished = next((one for one in done.values() if isinstance(one, Exception)), None)
    found.warnings += _failures(jobs, done, ends=not rest and len(lines) + 1 < len(jobs))
    lines |= {k: line for k, line in done.items() if isinstance(line, Line)}
    found.lines = sorted(lines.values(), key=lambda line: line.speed_rpm)
    found.interrupted = batch.interrupted
    found.warnings += _warnings(found)
    found.seconds = clock.perf_counter() - begin
    return found


def _failures(jobs: Sequence[_Job], done: Mapping[int, Any], ends: bool) -> list[Note]:
    """Notes on the speeds that have an error, and on a map that ends at one of them."""
    errors = {jobs[k].speed_rpm: one for k, one in done.items() if isinstance(one, Exception)}
    texts = [f"{speed:g} rpm: {error}" for speed, error in errors.items()]
    if errors and ends:
        texts.append("The map ends there: no other speed has a start.")
    return [Note(NoteKind.FAILED, text) for text in texts]


def _line(job: _Job) -> Line:
    """The line of a job; errors as `Place.line`."""
    begin, stored = clock.process_time(), model_of(job.model, file_digest(job.model))
    place = Place(stored, job.scene.at_speed(job.speed_rpm))
    return replace(place.line(job.checked, job.before), seconds=clock.process_time() - begin)


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
