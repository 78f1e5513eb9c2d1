"""Response curves: the periodic motions of a reduced model over a parameter of its scene.

A curve starts at the first value of the range, where a few periods are marched and Newton's method
finds the periodic motion (`fenicsrom.online.periodic`). It is followed through its folds to the
last value (`fenicsrom.online.continuation`). A curve that ends before is followed from the last
value too, so that both sides of a gap are known.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curve_progress import CurveProgress, CurveWalk, Stand
from fenicsrom.assess.processes import run_jobs
from fenicsrom.assess.response_files import CurveFile, KeptCurve, curve_file, forget
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.online.archive import StoredModel
from fenicsrom.online.contact_points import contacts_of
from fenicsrom.online.continuation import Continuation
from fenicsrom.online.curve import CurvePoint
from fenicsrom.online.families import (
    Family,
    contact_family,
    damping_family,
    force_family,
    frequency_family,
)
from fenicsrom.online.march import integrate
from fenicsrom.online.periodic import (
    FALLBACK_STEPS,
    PeriodicMotion,
    Shooting,
    largest_multiplier,
    periodic_motion,
    settled_contacts,
)
from fenicsrom.online.scene_changes import changed_key
from fenicsrom.scene import Response as ResponseTable
from fenicsrom.scene import (
    Scene,
    Time,
    override_table,
    parameter_of,
    parse_scene,
    scene_table,
)

START_PERIODS = 320  # largest number to march before a curve starts
LARGEST_STEP = 0.03  # along a curve, in parts of the range and of the size of the motion
GROWTH = 2.0  # of the motion after which its steps are measured by its new size


@dataclass(eq=False)
class Piece:
    """A connected part of a curve.

    Attributes:
        points: in their order along the curve.
        special: the located folds, period doublings and torus bifurcations.
        reason: why it ends: "end of the range", "number of points", "no convergence" or
            "interrupted".
        direction: 1.0 of a piece from the first value of the range, -1.0 of one from the last.
    """

    points: list[CurvePoint] = field(default_factory=list)
    special: list[CurvePoint] = field(default_factory=list)
    reason: str = ""
    direction: float = 1.0


@dataclass(frozen=True, eq=False)
class FullPoint:
    """The periodic motion of the full model at one value of the parameter.

    Attributes:
        parameter: its value.
        amplitude: (P, d) of the full model, as `CurvePoint.amplitude`, m.
        reduced_amplitude: (P, d) of the reduced model there, m.
        verdict: of the reduced motion: "stable", "fold", "period doubling" or "torus".
        periods: number of periods of the full model that were marched.
        derived: number of them that carried derivatives.
        residual: relative.
        seconds: run time.
    """

    parameter: float
    amplitude: Array
    reduced_amplitude: Array
    verdict: str
    periods: int
    derived: int
    residual: float
    seconds: float

    @property
    def error(self) -> float:
        """Error of the reduced amplitudes, relative to the largest amplitude: that of the basis."""
        size = float(self.amplitude.max())
        change = float(np.max(np.abs(self.reduced_amplitude - self.amplitude)))
        return change / size if size else 0.0


@dataclass(eq=False)
class ResponseCurve:
    """The periodic motions over the parameter, at one value of the second number.

    Attributes:
        value: of the second number of the scene; None without families.
        pieces: the connected parts, that from the first value of the range first.
        step_error: relative change of the largest amplitude with half the time step; None if that
            motion was not found.
        marches: marched periods: all, and those with their derivatives.
        seconds: run time, without that of the full model.
        full: the motions of the full model at some values of the parameter.
    """

    value: float | None
    pieces: list[Piece] = field(default_factory=list)
    step_error: float | None = None
    marches: tuple[int, int] = (0, 0)
    seconds: float = 0.0
    full: list[FullPoint] = field(default_factory=list)

    @property
    def points(self) -> list[CurvePoint]:
        """The points of all pieces."""
        return [point for piece in self.pieces for point in piece.points]

    @property
    def special(self) -> list[CurvePoint]:
        """The bifurcations of all pieces."""
        return [point for piece in self.pieces for point in piece.special]


@dataclass(eq=False)
class Response:
    """The response curves of a scene.

    Attributes:
        scene: the scene.
        size: number of coordinates of the reduced model.
        dimension: of space.
        contacts: number of contact points.
        steps: time steps of a period.
        curves: one for each value of the second number, or one.
        seconds: run time.
        warnings: sentences for the user.
        unfinished: the error of the first curve that was not found, or None.
        interrupted: whether the run was asked to stop; the last curve is then incomplete.
        files: the written files.
    """

    scene: Scene
    size: int
    dimension: int
    contacts: int
    steps: int
    curves: list[ResponseCurve] = field(default_factory=list)
    seconds: float = 0.0
    warnings: list[str] = field(default_factory=list)
    unfinished: ConvergenceError | AccuracyError | None = None
    interrupted: bool = False
    files: list[Path] = field(default_factory=list)

    @property
    def table(self) -> ResponseTable:
        """The table [response] of the scene."""
        return response_table(self.scene)


def response_table(scene: Scene) -> ResponseTable:
    """The table [response] of a scene.

    Raises:
        SceneError: the scene has none.
    """
    if scene.response is None:
        raise SceneError(
            f"{scene.source}: response is missing: must be a table with first and last",
            kind=ErrorKind.MISSING,
            key="response",
            source=scene.source,
        )
    return scene.response


def check_response(scene: Scene) -> None:
    """Check before the offline stage that the curves of a scene can be computed.

    Raises:
        SceneError: there is no table [response], the model would not be an exact polynomial, or
            the second number belongs to the offline stage.
    """
    table = response_table(scene)
    if scene.basis.elastic_force == "projection":
        raise SceneError(
            f'{scene.source}: basis.elastic_force = "projection": must be "polynomial" for '
            "response curves",
            kind=ErrorKind.CONFLICT,
            key="basis.elastic_force",
            source=scene.source,
        )
    for value in table.families.values if table.families else ():
        assert table.families is not None
        override = [f"{table.families.key}={value!r}"]
        changed = parse_scene(
            override_table(scene_table(scene), override, scene.source), scene.source, None
        )
        if (key := changed_key(scene, changed)) is not None:
            raise SceneError(
                f"{scene.source}: response.families.key = {table.families.key!r}: {key} cannot "
                "change on a reduced model",
                kind=ErrorKind.MISMATCH,
                key="response.families.key",
                source=scene.source,
            )


CLASSES = {kind.__name__: kind for kind in (ResponseCurve, Piece, CurvePoint, Stand)}
"""The dataclasses of which a kept curve consists."""


@dataclass(frozen=True)
class _Job:
    """One curve to compute, in this process or in another.

    Attributes:
        stored: the model under the scene of all curves.
        value: of the second number; None without families.
        state: the file that keeps the curve; None keeps nothing.
        kept: what an earlier run kept of it, or None.
    """

    stored: StoredModel
    value: float | None
    state: CurveFile | None
    kept: KeptCurve | None


def response(
    stored: StoredModel,
    say: Callable[[str], None],
    *,
    state: Path | None = None,
    resume: Path | None = None,
    workers: int = 1,
    stop: Callable[[], bool] = lambda: False,
) -> Response:
    """Compute the response curves of a reduced model under its scene.

    Args:
        stored: the model; its scene has a table [response].
        say: receives the progress, one line at a time; it may raise KeyboardInterrupt.
        state: folder of the files that keep what is done of each curve; None keeps nothing.
        resume: such a folder of an earlier run, from which the curves continue.
        workers: largest number of processes that compute curves at the same time. With several,
            the calling script must be importable: put its code under `if __name__ == "__main__"`.
        stop: asked at each point; the run ends when it returns True.

    Returns:
        The curves. After an interrupt they end where they were, and `interrupted` is set; if a
        curve was not found, the others are there and `unfinished` holds the error.

    Raises:
        SceneError: see `check_response`, or `resume` does not belong to this model and scene.
        OSError: a file of `state` cannot be written.
    """
    begin = clock.perf_counter()
    scene = stored.scene
    check_response(scene)
    table = response_table(scene)
    found = Response(
        scene,
        stored.size,
        scene.geometry.dimension,
        stored.model.points.contact.size,
        scene.time.steps_per_period or FALLBACK_STEPS,
    )
    if scene.time.tolerance is not None:
        found.warnings.append(
            f"The curves use {FALLBACK_STEPS} steps per period: a periodic motion needs a fixed "
            "step, and the scene asks for an adaptive one."
        )
    values: Sequence[float | None] = table.families.values if table.families else (None,)
    jobs = [
        _Job(
            stored,
            value,
            curve_file(state, stored, number) if state is not None else None,
            curve_file(resume, stored, number).load(CLASSES) if resume is not None else None,
        )
        for number, value in enumerate(values, 1)
    ]
    if state is not None and (resume is None or resume.resolve() != state.resolve()):
        forget(state)
    progress = CurveProgress([_name(table, value) for value in values], say)
    try:
        for number, outcome in enumerate(run_jobs(_compute, jobs, progress, workers, stop)):
            if isinstance(outcome, ConvergenceError):
                outcome = _Outcome(ResponseCurve(values[number]), outcome)
            found.curves.append(outcome.curve)
            progress.finished(number)
            if outcome.error is not None:
                found.warnings.append(f"{_name(table, values[number])}{outcome.error}")
                found.unfinished = found.unfinished or outcome.error
            if outcome.interrupted:
                found.interrupted = True
                if workers <= 1:
                    break
    except KeyboardInterrupt:
        found.interrupted = True
    found.curves = [curve for curve in found.curves if curve.points]
    found.seconds = clock.perf_counter() - begin
    return found


def _name(table: ResponseTable, value: float | None) -> str:
    """The beginning of a sentence about a curve."""
    return "" if table.families is None else f"{table.families.key} = {value:g}: "


@dataclass
class _Outcome:
    """A curve as far as it was computed, and why it ended before."""

    curve: ResponseCurve
    error: ConvergenceError | AccuracyError | None = None
    interrupted: bool = False


def _compute(job: _Job, report: Callable[[float, str], None]) -> _Outcome:
    """Compute the curve of a job; `report` may raise KeyboardInterrupt."""
    stored, families = job.stored, response_table(job.stored.scene).families
    if families is not None:
        stored = stored.with_overrides([f"{families.key}={job.value!r}"])
    curve = job.kept.curve if job.kept is not None else ResponseCurve(job.value)
    outcome = _Outcome(curve)
    if job.kept is not None and job.kept.done:
        if job.state is not None:
            job.state.save(curve, None, done=True)
        return outcome
    walk = CurveWalk(curve, response_table(stored.scene), report, job.state)
    walk.stand = job.kept.stand if job.kept is not None else None
    try:
        _follow(stored, curve, walk)
        walk.save(done=True)
    except (ConvergenceError, AccuracyError) as error:
        outcome.error = error
        walk.save()
    except KeyboardInterrupt:
        outcome.interrupted = True
        walk.save()
    return outcome


class _Kept(Continuation):
    """A continuation that keeps what it finds in a `Piece`, in case of an interrupt."""

    piece: Piece

    def _locate(self, a: CurvePoint, b: CurvePoint, tangent: Array) -> list[CurvePoint]:
        """The bifurcations between two points, also kept."""
        found = super()._locate(a, b, tangent)
        self.piece.special.extend(found)
        return found


def _follow(stored: StoredModel, curve: ResponseCurve, walk: CurveWalk) -> None:
    """Compute the pieces of one curve, from where it stands.

    Raises:
        ConvergenceError, AccuracyError: no motion was found at either end of the range.
    """
    begin, table = clock.perf_counter(), response_table(stored.scene)
    family = family_of(stored)
    error: ConvergenceError | AccuracyError | None = None
    try:
        for value, direction in ((table.first, 1.0), (table.last, -1.0)):
            earlier = [piece for piece in curve.pieces if piece.direction == direction]
            start: PeriodicMotion | None = None
            if not earlier:
                try:
                    start = start_motion(stored, family, value, walk)
                except (ConvergenceError, AccuracyError) as problem:
                    error = problem
                    continue
                curve.pieces.append(Piece(direction=direction))
            piece = earlier[0] if earlier else curve.pieces[-1]
            if start is not None or walk.stand is not None:
                _follow_piece(stored, family, start, value, piece, walk)
            reached = abs(piece.points[-1].parameter - table.last) <= 1e-9 * table.last
            if reached or piece.reason == "number of points":
                break
        if not curve.points and error is not None:
            raise error
        curve.step_error = _step_error(stored, family, curve)
    finally:
        marches = np.array([point.marches for point in curve.points + curve.special])
        total = marches.reshape(-1, 2).sum(axis=0)
        curve.marches = int(total[0]), int(total[1])
        curve.seconds += clock.perf_counter() - begin


class _Grown(Exception):
    """The motion is much larger than where the continuation began."""


def _follow_piece(
    stored: StoredModel,
    family: Family,
    start: PeriodicMotion | None,
    value: float,
    piece: Piece,
    walk: CurveWalk,
) -> None:
    """Follow one piece from a motion, or on from where it stands.

    The step along the curve is relative to the size of the motion at the start of the piece. When
    the motion has grown by the factor `GROWTH`, a new piece begins with the present size.

    Args:
        stored: the model.
        family: problems by the parameter.
        start: the first motion; None continues from `walk.stand`.
        value: parameter at the first motion.
        piece: the piece.
        walk: reports and keeps what is done.

    Raises:
        ConvergenceError: the first point was not found.
    """
    table, problem = response_table(stored.scene), family(value)
    shooting = Shooting(problem.model, problem.contacts, stored.scene.time, problem.period)
    piece.reason = "interrupted"
    path = _Kept(shooting, family, table.first, table.last, 1.0)
    path.piece = piece
    if start is not None:
        _begin_piece(path, start, value, piece, walk)

    def keep(point: CurvePoint) -> None:
        piece.points.append(point)
        if float(np.linalg.norm(point.s)) > GROWTH * path.size:
            begin, direction = _rescaled(path, point)
            walk.passed(path, begin, len(piece.points) - 1, direction)
            raise _Grown
        assert walk.stand is not None
        walk.passed(path, walk.stand.begin, walk.stand.since, walk.stand.direction)

    while True:
        stand = walk.stand
        assert stand is not None
        path.size, shooting.guess = stand.size, stand.guess
        *earlier, last = stand.trail(piece)
        try:
            found = path.run(
                last,
                stand.direction,
                step=stand.step,
                largest_step=LARGEST_STEP,
                points=table.points - len(piece.points) + len(earlier) + 1,
                progress=keep,
                earlier=earlier,
            )
            break
        except _Grown:
            continue
    end = found.points[-1]
    if end is not last and end is not piece.points[-1]:  # at the end of the range: not reported
        piece.points.append(end)
    piece.reason, walk.stand = found.reason, None
    walk(f"{len(piece.points)} points, {piece.reason}")


def _begin_piece(
    path: Continuation, start: PeriodicMotion, value: float, piece: Piece, walk: CurveWalk
) -> None:
    """Find the first point of a piece; arguments and errors as `_follow_piece`."""
    s = path.shooting.scaled(start.z)
    path.size = float(np.linalg.norm(s))
    begin = path.at_parameter(s, value)
    if begin is None:
        raise ConvergenceError(f"the motion at {walk.table.parameter} = {value:g} was lost")
    piece.points.append(begin)
    walk.passed(path, begin, 0, piece.direction)


def _rescaled(path: Continuation, last: CurvePoint) -> tuple[CurvePoint, float]:
    """Set the size to that of the last point; the point with its new tangent, and its direction."""
    tangent = last.tangent.copy()
    size = float(np.linalg.norm(last.s))
    tangent[:-1] *= path.size / size
    path.size = size
    tangent /= np.linalg.norm(tangent)
    return replace(last, tangent=tangent), float(np.sign(tangent[-1]) or 1.0)


def family_of(stored: StoredModel) -> Family:
    """The periodic problems of a stored model by the parameter of its [response] table.

    Raises:
        SceneError: the scene has no table [response].
    """
    scene, model = stored.scene, stored.model
    key, period = response_table(scene).parameter, float(scene.period or 0.0)
    contacts = settled_contacts(contacts_of(scene, model.points))
    table, index, name = parameter_of(key)
    if table == "":
        return frequency_family(model, contacts, period, spin=bool(np.any(contacts.height)))
    if table == "material":
        return damping_family(model, contacts, period)
    if table == "loads":  # a load of size 1 times the parameter
        return force_family(stored.with_overrides([f"{key}=1.0"]).model, contacts, period, index)
    mine = (model.points.contact == index).astype(float)
    if name == "gap":  # the parameter is added to a gap of zero
        scene = stored.with_overrides([f"{key}=0.0"]).scene
        contacts = settled_contacts(contacts_of(scene, model.points))
    elif name != "friction":  # numbers of a node are those of a unit of its area
        mine = mine * model.points.tributary_area
    return contact_family(model, contacts, period, name, mine)


def start_motion(
    stored: StoredModel, family: Family, value: float, say: Callable[[str], None]
) -> PeriodicMotion:
    """The periodic motion at a value of the parameter: a march from rest, then Newton's method.

    Raises:
        ConvergenceError, AccuracyError: no motion was found; the error names the value.
    """
    scene, problem = stored.scene, family(value)
    key, radius = response_table(scene).parameter, scene.time.spectral_radius
    say(f"start at {key} = {value:g}: a march, then Newton's method")
    settings = Time.of(
        scheme=scene.time.scheme,
        periods=START_PERIODS,
        steps_per_period=scene.time.steps_per_period or FALLBACK_STEPS,
        steady_tolerance=1e-5,
        **({} if radius is None else {"spectral_radius": radius}),
    )
    try:
        motion = integrate(
            problem.model,
            problem.contacts,
            settings,
            problem.period,
            dimension=scene.geometry.dimension,
        )
        return periodic_motion(
            problem.model, problem.contacts, scene.time, problem.period, motion.end
        )
    except ConvergenceError as error:
        raise ConvergenceError(
            f"response: at {key} = {value:g} no periodic motion was found: {error}",
            kind=ErrorKind.CONVERGENCE,
        ) from error


def _step_error(stored: StoredModel, family: Family, curve: ResponseCurve) -> float | None:
    """Relative change of the largest amplitude of a curve with half the time step."""
    largest = max(curve.points, key=lambda point: float(point.amplitude.max()))
    time, problem = stored.scene.time, family(largest.parameter)
    finer = time.changed(steps_per_period=2 * (time.steps_per_period or FALLBACK_STEPS))
    try:
        motion = periodic_motion(
            problem.model, problem.contacts, finer, problem.period, largest.z, tolerance=1e-8
        )
    except ConvergenceError:
        return None
    size = float(largest.amplitude.max())
    return float(np.max(np.abs(motion.amplitude - largest.amplitude))) / size if size else None


def judged_multiplier(point: CurvePoint) -> complex:
    """The largest Floquet multiplier without those of sliders that are not unique."""
    return largest_multiplier(point.multipliers, point.free_sliders)
