"""Response curves: the periodic motions of a reduced model over a parameter of its scene.

A curve starts at the first value of the range, where a few periods are marched and Newton's method
finds the periodic motion (`fenicsrom.online.periodic`). It is followed through its folds to the
last value (`fenicsrom.online.continuation`). A curve that ends before is followed from the last
value too, so that both sides of a gap are known.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.branches import Piece, follow_branches, follow_isolated
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.online.archive import StoredModel
from fenicsrom.online.branching import walk
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
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.online.periodic import (
    FALLBACK_STEPS,
    PeriodicMotion,
    Shooting,
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

START_PERIODS = (5, 20, 80, 320)  # marched before Newton's method tries to start a curve
LARGEST_STEP = 0.03  # along a curve, in parts of the range and of the size of the motion
GROWTH = 2.0  # of the motion after which its steps are measured by its new size
REPORT_INTERVAL = 2.0  # shortest time between two lines of progress, s


@dataclass(eq=False)
class ResponseCurve:
    """The periodic motions over the parameter, at one value of the second number.

    Attributes:
        value: of the second number of the scene; None without families.
        pieces: the connected parts, that from the first value of the range first.
        step_error: relative change of the largest amplitude with half the time step; None if that
            motion was not found.
        marches: marched periods: all, and those with their derivatives.
        seconds: run time.
    """

    value: float | None
    pieces: list[Piece] = field(default_factory=list)
    step_error: float | None = None
    marches: tuple[int, int] = (0, 0)
    seconds: float = 0.0

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


def response(stored: StoredModel, say: Callable[[str], None]) -> Response:
    """Compute the response curves of a reduced model under its scene.

    Args:
        stored: the model; its scene has a table [response].
        say: receives the progress, one line at a time; it may raise KeyboardInterrupt.

    Returns:
        The curves. After an interrupt they end where they were, and `interrupted` is set; if a
        curve was not found, the others are there and `unfinished` holds the error.

    Raises:
        SceneError: see `check_response`.
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
    families = table.families
    values: Sequence[float | None] = families.values if families else (None,)
    for value in values:
        curve = ResponseCurve(value)
        found.curves.append(curve)
        key = "" if families is None else f"{families.key} = {value:g}: "
        current = (
            stored if families is None else stored.with_overrides([f"{families.key}={value!r}"])
        )
        try:
            _follow(current, curve, _prefixed(say, key))
        except (ConvergenceError, AccuracyError) as error:
            found.warnings.append(f"{key}{error}")
            found.unfinished = found.unfinished or error
        except KeyboardInterrupt:
            found.interrupted = True
            break
    found.curves = [curve for curve in found.curves if curve.points]
    found.seconds = clock.perf_counter() - begin
    return found


def _prefixed(say: Callable[[str], None], prefix: str) -> Callable[[str], None]:
    """Make a callback that says each line with a prefix."""
    return lambda line: say(f"{prefix}{line}")


def _follow(stored: StoredModel, curve: ResponseCurve, say: Callable[[str], None]) -> None:
    """Compute the pieces of one curve.

    Raises:
        ConvergenceError, AccuracyError: no motion was found at either end of the range.
    """
    begin, table = clock.perf_counter(), response_table(stored.scene)
    family = family_of(stored)
    error: ConvergenceError | AccuracyError | None = None
    try:
        for value, direction in ((table.first, 1.0), (table.last, -1.0)):
            try:
                start = start_motion(stored, family, value, say)
            except (ConvergenceError, AccuracyError) as problem:
                error = problem
                continue
            piece = Piece()
            curve.pieces.append(piece)
            _follow_piece(stored, family, start, value, direction, piece, say)
            reached = abs(piece.points[-1].parameter - table.last) <= 1e-9 * table.last
            if reached or piece.reason == "number of points":
                break
        if not curve.points and error is not None:
            raise error
        _follow_more(stored, family, curve, say)
        curve.step_error = _step_error(stored, family, curve)
    finally:
        marches = np.array([point.marches for point in curve.points + curve.special])
        total = marches.reshape(-1, 2).sum(axis=0)
        curve.marches = int(total[0]), int(total[1])
        curve.seconds = clock.perf_counter() - begin


def _follow_piece(
    stored: StoredModel,
    family: Family,
    start: PeriodicMotion,
    value: float,
    direction: float,
    piece: Piece,
    say: Callable[[str], None],
) -> None:
    """Follow one piece from a motion; arguments as `fenicsrom.online.continuation.follow`.

    Raises:
        ConvergenceError: the first point was not found.
    """
    table = response_table(stored.scene)
    path, begin = _first_point(stored, family, start, value)
    follow_piece(path, begin, direction, piece, table, say)


def _continuation(
    stored: StoredModel, family: Family, z: Array, periods: int = 1
) -> tuple[Continuation, Array]:
    """The continuation of motions like that with variables z (N,), and its scaled variables."""
    table = response_table(stored.scene)
    problem = family(table.last)
    shooting = Shooting(problem.model, problem.contacts, stored.scene.time, problem.period, periods)
    s = shooting.scaled(z)
    size = float(np.linalg.norm(s))
    return Continuation(shooting, family, table.first, table.last, size), s


def _first_point(
    stored: StoredModel, family: Family, start: PeriodicMotion, value: float
) -> tuple[Continuation, CurvePoint]:
    """The continuation from a motion, and its point.

    Raises:
        ConvergenceError: the point was not found.
    """
    path, s = _continuation(stored, family, start.z)
    begin = path.at_parameter(s, value)
    if begin is None:
        name = response_table(stored.scene).parameter
        raise ConvergenceError(f"the motion at {name} = {value:g} was lost")
    return path, begin


def follow_piece(
    path: Continuation,
    begin: CurvePoint,
    direction: float | None,
    piece: Piece,
    table: ResponseTable,
    say: Callable[[str], None],
) -> None:
    """Follow one piece from its first point; arguments as `fenicsrom.online.branching.walk`."""
    report = _reporter(table, piece, say)
    piece.reason = "interrupted"
    walk(
        path,
        begin,
        direction,
        piece,
        points=table.points,
        largest_step=LARGEST_STEP,
        progress=lambda point: report(),
    )
    say(f"{len(piece.points)} points, {piece.reason}")


def _follow_more(
    stored: StoredModel, family: Family, curve: ResponseCurve, say: Callable[[str], None]
) -> None:
    """Follow the branches and the isolated curves that the scene asks for.

    Raises:
        ConvergenceError, AccuracyError: no motion was found where isolated curves are sought.
    """
    table = response_table(stored.scene)

    def path_of(motion: CurvePoint, periods: int) -> Continuation:
        return _continuation(stored, family, motion.z, periods)[0]

    def follow(
        path: Continuation, begin: CurvePoint, direction: float | None, origin: str, periods: int
    ) -> None:
        piece = Piece(origin=origin, periods=periods)
        curve.pieces.append(piece)
        follow_piece(path, begin, direction, piece, table, say)

    def start(value: float) -> CurvePoint:
        return _first_point(stored, family, start_motion(stored, family, value, say), value)[1]

    follow_branches(curve.pieces, path_of, follow, table.parameter, table.branches)
    follow_isolated(curve.pieces, path_of, follow, start, table.isolated)


def _reporter(table: ResponseTable, piece: Piece, say: Callable[[str], None]) -> Callable[[], None]:
    """Make a function that says where a piece stands, at most every `REPORT_INTERVAL`."""
    last = clock.perf_counter()

    def report() -> None:
        nonlocal last
        if clock.perf_counter() - last > REPORT_INTERVAL:
            last, point = clock.perf_counter(), piece.points[-1]
            say(
                f"{len(piece.points)} points, {table.parameter} = {point.parameter:.5g}, amplitude "
                f"{1e3 * float(point.amplitude.max()):.4g} mm, {point.verdict}"
            )

    return report


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
    key = response_table(scene).parameter
    motion: Motion | None = None
    reason = ""
    for periods in START_PERIODS:
        say(f"start at {key} = {value:g}: {periods} periods, then Newton's method")
        try:
            motion = _marched(stored, problem.model, problem, periods, motion)
            return periodic_motion(
                problem.model, problem.contacts, scene.time, problem.period, motion.end
            )
        except ConvergenceError as error:
            reason = str(error)
            if motion is None:
                break
    raise ConvergenceError(
        f"response: at {key} = {value:g} no periodic motion was found: {reason}",
        kind=ErrorKind.CONVERGENCE,
    )


def _marched(
    stored: StoredModel, model: ReducedModel, problem: Any, periods: int, before: Motion | None
) -> Motion:
    """The motion after so many periods, continued from an earlier one."""
    scene = stored.scene
    radius = scene.time.spectral_radius
    settings = Time.of(
        scheme=scene.time.scheme,
        periods=periods,
        steady_tolerance=0.0,
        steps_per_period=scene.time.steps_per_period or FALLBACK_STEPS,
        **({} if radius is None else {"spectral_radius": radius}),
    )
    return integrate(
        model,
        problem.contacts,
        settings,
        problem.period,
        dimension=scene.geometry.dimension,
        resume=before.end if before is not None else None,
    )


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
    found = point.multipliers
    judged = np.delete(found, np.argsort(np.abs(found - 1.0))[: point.free_sliders])
    return complex(judged[0]) if judged.size else 0j
