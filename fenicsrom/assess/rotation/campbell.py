"""Campbell diagram: natural frequencies of a rotating body against speed, with engine orders.

At every speed the body moves to its equilibrium without contact, and the modes are those of the
tangent stiffness (`assess.rotation.rotating_modes`). The modes are tracked from speed to speed by
the modal assurance criterion, MAC = |a^H M b|^2 / (a^H M a  b^H M b).

Modes that veer exchange their shapes. With closely spaced speeds a tracked mode follows the curve
of its frequency; with widely spaced speeds it keeps its shape. `assess.rotation.critical_speeds`
finds the speeds at which engine orders meet the modes, and `assess.rotation.mode_names` names the
modes by their shapes at the first speed.

Speeds at which engine orders meet the modes of a rotating body.

Engine order k excites k times per revolution. A critical speed Omega is a root of

    f(Omega)^2 - (k Omega / 60)^2 = 0,   Omega in rev/min.

Without the Coriolis force f^2 is nearly linear in Omega^2 (Southwell), so a cubic spline of f^2
over Omega^2 needs few speeds. Through two speeds the spline is a line, through three speeds a
parabola. With the Coriolis force f^2 has a part that is odd in Omega, and the spline is over Omega.
The square of the engine order is a polynomial in both variables and is subtracted exactly. Every
root is then confirmed by the modes at its speed, which correct it where the spline is too coarse.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import MeshCheck, of_model, of_solid
from fenicsrom.assess.errors.plausibility import strain_warnings
from fenicsrom.assess.rotation.rotating_modes import (
    RangeBody,
    Shapes,
    follow,
    have_passed_zero,
    mode_names,
    modes_at_speed,
    range_body,
)
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.notes import CRITICAL, FREQUENCIES, Note, NoteKind
from fenicsrom.online.stress.stress import Deformation
from fenicsrom.progress import log, time_left
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import brief

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.online.store.archive import StoredModel


CONFIRMED = 1e-4
"""Relative difference of frequency and engine order at which a critical speed is confirmed.

It is far below the scatter of real blades, and a spline through a usual number of speeds reaches
it at once."""

SOLUTIONS = 4
"""Largest number of speeds at which the modes are computed for one critical speed."""

LEAST_MAC = 0.5
"""A mode with a smaller MAC counts as lost."""


@dataclass(frozen=True)
class Critical:
    """A speed at which an engine order meets a mode.

    Attributes:
        mode: number of the mode, from 1.
        order: excitations per revolution.
        speed_rpm: the critical speed.
        frequency_hz: frequency of the engine order at this speed.
        computed_hz: frequency of the mode that was computed at this speed; None if this failed.
        difference: computed_hz / frequency_hz - 1; None if the computation failed.
        mac: MAC of the computed mode with the mode at the nearest speed of the diagram; None
            if the computation failed.
    """

    mode: int
    order: int
    speed_rpm: float
    frequency_hz: float
    computed_hz: float | None = None
    difference: float | None = None
    mac: float | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the mode was found at this speed with the frequency of the engine order."""
        if self.difference is None or self.mac is None:
            return False
        return abs(self.difference) <= CONFIRMED and self.mac >= LEAST_MAC


@dataclass(frozen=True, eq=False)
class FrequencyCurve:
    """The squared frequency of one mode against the speed.

    Attributes:
        speeds: (s,) speeds, at least two, ascending, rev/min.
        squares: (s,) f^2, Hz^2; negative where the mode is unstable.
        coriolis: whether the spline is over Omega instead of Omega^2.
    """

    speeds: Array
    squares: Array
    coriolis: bool

    def at(self, speeds: Array) -> Array:
        """f^2 (k,) at speeds (k,), Hz^2."""
        return np.asarray(CubicSpline(self._variable, self.squares)(self._of(speeds)))

    def with_sample(self, speed: float, square: float) -> FrequencyCurve:
        """The curve through one more point; a speed that is known already takes the new value."""
        others = self.speeds != speed
        speeds = np.append(self.speeds[others], speed)
        squares = np.append(self.squares[others], square)
        order = np.argsort(speeds)
        return replace(self, speeds=speeds[order], squares=squares[order])

    def crossings(self, order: int) -> Array:
        """The speeds above 0 and within the curve where an engine order meets it, ascending."""
        spline, slope = CubicSpline(self._variable, self.squares), (order / 60.0) ** 2
        left = spline.x[:-1]
        powers = spline.c.copy()  # (k Omega/60)^2 about the left end of each piece is subtracted
        if self.coriolis:
            powers[-3] -= slope
            powers[-2] -= 2.0 * slope * left
            powers[-1] -= slope * left**2
        else:
            powers[-2] -= slope
            powers[-1] -= slope * left
        roots = PPoly(powers, spline.x).roots(extrapolate=False)
        roots = roots[np.isfinite(roots) & (roots > 0.0)]
        # a root where two pieces meet is found in both
        return np.unique(np.round(roots if self.coriolis else np.sqrt(roots), 9))

    @property
    def _variable(self) -> Array:
        return self._of(self.speeds)

    def _of(self, speeds: Array) -> Array:
        return speeds if self.coriolis else speeds**2


def critical_speeds(
    curves: Sequence[FrequencyCurve],
    orders: Sequence[int],
    solve: Callable[[int, float], tuple[float, float]],
) -> tuple[list[Critical], list[str]]:
    """The critical speeds of all modes and engine orders, each confirmed by the modes there.

    Args:
        curves: the frequency of each mode.
        orders: the engine orders.
        solve: computes f^2 in Hz^2 and the MAC of a mode (from 0) at a speed in rev/min.

    Returns:
        The critical speeds in ascending order, and a sentence for each one that failed.
    """
    found, notes = [], []
    for mode, curve in enumerate(curves):
        for order in orders:
            for speed in curve.crossings(order):
                item = Critical(mode + 1, order, float(speed), order * float(speed) / 60.0)
                where = f"engine order {order} and mode {mode + 1}"
                try:
                    confirmed = confirm(curve, item, partial(solve, mode))
                except (ConvergenceError, AccuracyError) as error:
                    notes.append(f"{where} at {speed:.5g} rpm: interpolated only: {error}")
                    confirmed = item
                if confirmed is None:
                    continue
                found.append(confirmed)
                if confirmed.difference is not None and not confirmed.confirmed:
                    notes.append(
                        f"{where} at {confirmed.speed_rpm:.5g} rpm: not confirmed, the frequency "
                        f"there differs by {100 * confirmed.difference:.2g} % (MAC "
                        f"{confirmed.mac:.2f}); use speeds that are closer together"
                    )
    return sorted(found, key=lambda item: (item.speed_rpm, item.mode, item.order)), notes


def confirm(
    curve: FrequencyCurve, item: Critical, solve: Callable[[float], tuple[float, float]]
) -> Critical | None:
    """Compute the frequency at a critical speed, and correct the speed until both agree.

    Every computed frequency joins the points of the spline.

    Args:
        curve: the frequency of the mode.
        item: the critical speed of the spline.
        solve: computes f^2 in Hz^2 and the MAC of the mode at a speed in rev/min.

    Returns:
        The critical speed, the one with the smallest difference if none was confirmed; None if the
        computed frequencies show that there is no critical speed.

    Raises:
        ConvergenceError, AccuracyError: the first computation failed.
    """
    best: Critical | None = None
    for _ in range(SOLUTIONS):
        square, mac = solve(item.speed_rpm)
        computed = float(np.sqrt(max(square, 0.0)))
        difference = computed / item.frequency_hz - 1.0
        item = replace(item, computed_hz=computed, difference=difference, mac=mac)
        if item.confirmed or mac < LEAST_MAC:
            return item
        if best is None or best.difference is None or abs(difference) < abs(best.difference):
            best = item
        curve = curve.with_sample(item.speed_rpm, square)
        speeds = curve.crossings(item.order)
        if not speeds.size:
            return None
        speed = float(speeds[np.argmin(np.abs(speeds - item.speed_rpm))])
        item = replace(item, speed_rpm=speed, frequency_hz=item.order * speed / 60.0)
    return best


MODES = 6  # number of modes, unless the scene gives it
DOUBTFUL_MAC = 0.6  # a mode that keeps less of its shape may have been swapped with another one
EXTRA_MODES = 4  # additional modes to track, because they may cross the requested modes


@brief()
@dataclass(eq=False, repr=False, kw_only=True)
class Campbell:
    """The frequencies of a body at several speeds.

    Attributes:
        scene: the scene.
        speeds_rpm: (s,) the speeds that were reached.
        squares: (s, m) omega^2 of each mode, rad^2/s^2; negative where the mode is unstable.
        mac: (s, m) MAC of each mode with itself at the previous speed; 1 at the first.
        largest: (s,) largest displacement in the equilibrium, m; with a model for a range of
            speeds, that of its contact points and its probe.
        names: names of the modes, such as 1F; empty if the body does not point away from its axis,
            and with a model for a range of speeds.
        critical: the critical speeds, in ascending order.
        operating_squares: (m,) omega^2 at the speed of [rotation], rad^2/s^2; None if this speed
            is not within the diagram, or its modes were not found.
        change: largest relative change of a frequency in the last round of the complex modes; None
            without Coriolis force.
        mesh_check: estimated errors of the frequencies at the first speed due to the mesh.
        unknowns: free unknowns of the mesh, or coordinates of a model for a range of speeds.
        seconds: run time.
        warnings: notes for the user.
        unfinished: the error that stopped the computation; None if all speeds were reached.
        body: the solid; None with a model for a range of speeds.
        files: the written files, the one to open first at the head.
    """

    scene: Scene
    speeds_rpm: Array
    squares: Array
    mac: Array
    largest: Array
    names: list[str]
    critical: list[Critical] = field(default_factory=list)
    operating_squares: Array | None = None
    change: float | None
    mesh_check: MeshCheck
    unknowns: int
    seconds: float = 0.0
    warnings: list[Note]
    unfinished: Exception | None
    body: Solid | None
    files: list[Path] = field(default_factory=list)

    @property
    def frequencies_hz(self) -> Array:
        """(s, m) natural frequencies, zero where unstable, Hz."""
        return hertz(self.squares)

    @property
    def labels(self) -> list[str]:
        """One label per mode: its number, and its name if it has one."""
        count = self.squares.shape[1]
        names = [f" ({name})" for name in self.names] or [""] * count
        return [f"{k + 1}{name}" for k, name in zip(range(count), names, strict=True)]

    @property
    def margins(self) -> Array | None:
        """(m, orders) f / (k Omega / 60) - 1 of each mode and engine order at operating speed."""
        if self.operating_squares is None or self.scene.rotation is None:
            return None
        orders = np.array(self.scene.campbell.engine_orders)
        lines = orders * self.scene.rotation.speed_rpm / 60.0
        return hertz(self.operating_squares)[:, None] / lines - 1.0

    def curves(self) -> list[FrequencyCurve]:
        """The curve of each mode; none for a single speed."""
        if self.speeds_rpm.size < 2:
            return []
        coriolis = self.scene.rotation is not None and self.scene.rotation.coriolis
        squares = self.squares / (2.0 * np.pi) ** 2
        return [FrequencyCurve(self.speeds_rpm, column, coriolis) for column in squares.T]


def hertz(squares: Array) -> Array:
    """Frequencies of omega^2, zero where unstable, Hz."""
    return np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)


def campbell(given: Scene | StoredModel, comm: Any = None) -> Campbell:
    """Compute the frequencies of a scene's body at the speeds of its [campbell] table.

    Args:
        given: a scene with [rotation], whose `rotation.speed_rpm` is used only if [campbell] has no
            speeds; or a stored model for a range of speeds, which needs no mesh.
        comm: MPI communicator of the solid.

    Returns:
        The frequencies; `unfinished` holds an error that stopped the computation before the last
        speed.

    Raises:
        SceneError: no rotation, no speed, or more modes than unknowns; or the model is for one
            speed, or for another range.
        ConvergenceError, AccuracyError: the first speed failed.
    """
    begin = clock.perf_counter()
    scene = given if isinstance(given, Scene) else given.scene
    speeds = speeds_rpm(scene)
    solid: Solid | RangeBody
    if isinstance(given, Scene):
        solid = _solid_at(float(speeds[0]), scene, comm)
    else:
        solid = range_body(given, speeds)
    most = solid.whole.modes if isinstance(solid, RangeBody) else solid.free
    count = min(scene.campbell.modes or MODES, most)
    tracked = _Tracked(min(count + EXTRA_MODES, solid.free), scene.at_speed(float(speeds.max())))
    unfinished = tracked.follow_speeds(solid, speeds, count)
    body, names = None, list[str]()
    if isinstance(solid, RangeBody):
        assert not isinstance(given, Scene)
        judged = of_model(given, float(speeds[0]))
    else:
        squares = tracked.squares[0][:count], lambda finer: modes_at_speed(finer, count)[0]
        judged = of_solid(scene.at_speed(float(speeds[0])), solid, squares)
        body, names = solid, tracked.names(solid, scene)[:count]
    reached = speeds[: len(tracked.squares)]
    found = Campbell(
        scene=scene,
        speeds_rpm=reached,
        squares=np.array(tracked.squares)[:, :count],
        mac=np.array(tracked.mac)[:, :count],
        largest=np.array(tracked.largest),
        names=names,
        change=max(tracked.changes) if scene.rotation and scene.rotation.coriolis else None,
        mesh_check=judged,
        unknowns=solid.free,
        warnings=[*solid.warnings, *judged.warnings(scene)],
        unfinished=unfinished,
        body=body,
    )
    found.warnings += _warnings(found)
    if tracked.passed is not None and scene.damped:
        text = (
            f"at {tracked.passed:g} rpm the body turns above a critical speed, where a mode has 0 "
            "Hz in the turning frame: damping that turns with the body makes this mode whirl"
        )
        found.warnings.append(Note(NoteKind.UNSTABLE, text))
    states = zip([f"at {speed:g} rpm" for speed in reached], tracked.deformations, strict=False)
    found.warnings += strain_warnings(list(states))
    _find_critical_speeds(found, solid, tracked)
    found.seconds = clock.perf_counter() - begin
    return found


def _find_critical_speeds(found: Campbell, solid: Solid | RangeBody, tracked: _Tracked) -> None:
    """Find the critical speeds, and the frequencies at the speed of operation."""
    rotation = found.scene.rotation
    assert rotation is not None
    log.info("critical speeds ..")

    @cache
    def between(speed: float) -> tuple[Array, Array]:
        """omega^2 and MAC of the modes, in their order at the nearest speed of the diagram."""
        k = int(np.argmin(np.abs(found.speeds_rpm - speed)))
        if found.speeds_rpm[k] == speed:
            return tracked.squares[k], np.ones(tracked.count)
        solid.spin(np.pi / 30.0 * speed)
        values, vectors, _ = modes_at_speed(solid, tracked.count)
        values, _, mac = follow(solid, tracked.squares[k], tracked.shapes[k], values, vectors)
        return values, mac

    def solve(mode: int, speed: float) -> tuple[float, float]:
        squares, mac = between(speed)
        return float(squares[mode]) / (2.0 * np.pi) ** 2, float(mac[mode])

    orders = found.scene.campbell.engine_orders
    found.critical, notes = critical_speeds(found.curves(), orders, solve)
    found.warnings += [Note(NoteKind.UNCHECKED, text, quantity=CRITICAL) for text in notes]
    speed = rotation.speed_rpm
    if 0.0 < speed and found.speeds_rpm[0] <= speed <= found.speeds_rpm[-1]:
        try:
            squares, _ = between(speed)
            found.operating_squares = squares[: found.squares.shape[1]]
        except (ConvergenceError, AccuracyError) as error:
            text = f"no margins at {speed:g} rpm: {error}"
            found.warnings.append(Note(NoteKind.FAILED, text, quantity=CRITICAL))


def _solid_at(speed_rpm: float, scene: Scene, comm: Any) -> Any:
    """Make the mesh and the solid about its equilibrium at this speed.

    Raises:
        SceneError: the scene cannot be used, or asks for more modes than the mesh has unknowns.
        ConvergenceError: there is no equilibrium.
    """
    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.solid import solid_of

    log.info("mesh ..")
    mesh = build_mesh(scene.geometry, comm)
    log.info("solid ..")
    solid = solid_of(scene.at_speed(speed_rpm), mesh)
    asked = scene.campbell.modes
    if asked is not None and asked > solid.free:
        allowed = f"must be at most {solid.free}, the number of free unknowns"
        raise Where(scene.source, "campbell.modes").refuse(asked, allowed)
    return solid


class _Tracked:
    """The modes of a body at successive speeds, in the order of the modes at the first speed."""

    def __init__(self, count: int, fastest: Scene):
        self.count, self.fastest = count, fastest
        self.squares: list[Array] = []
        self.mac: list[Array] = []
        self.largest: list[float] = []
        self.deformations: list[Deformation] = []
        self.changes: list[float] = []
        self.shapes: list[Shapes] = []
        self.passed: float | None = None  # the first speed above a critical one, rev/min

    def add(self, solid: Solid | RangeBody, speed_rpm: float) -> None:
        """Add the modes of the body at its present speed.

        Raises:
            ConvergenceError, AccuracyError: as in `modes_at_speed`.
        """
        values, vectors, change = modes_at_speed(solid, self.count)
        if self.passed is None and have_passed_zero(solid, values, vectors):
            self.passed = speed_rpm
        common: Array = np.ones(self.count)
        if self.shapes:
            before = self.squares[-1], self.shapes[-1]
            values, vectors, common = follow(solid, *before, values, vectors)
        self.shapes.append(vectors)
        self.squares.append(values)
        self.mac.append(common)
        self.largest.append(float(solid.largest(solid.equilibrium[:, None])[0]))
        if not isinstance(solid, RangeBody):
            from fenicsrom.fem.body.stress_points import body_deformation

            found = body_deformation(solid, self.fastest, solid.equilibrium)
            self.deformations.append(found)
        self.changes.append(change)

    def follow_speeds(
        self, solid: Solid | RangeBody, speeds: Array, shown: int
    ) -> Exception | None:
        """Add the modes at all speeds; the body is at the first one.

        Args:
            solid: the body.
            speeds: the speeds, rev/min.
            shown: number of frequencies in the line on each speed.

        Returns:
            The error that stopped the computation after the first speed, if there was one.

        Raises:
            ConvergenceError, AccuracyError: the first speed failed.
        """
        begin = clock.perf_counter()
        for k, speed in enumerate(speeds):
            try:
                if k:
                    solid.spin(np.pi / 30.0 * float(speed))
                self.add(solid, float(speed))
            except (ConvergenceError, AccuracyError) as error:
                if not k:
                    raise
                return type(error)(f"campbell: at {speed:g} rpm: {error}", kind=error.kind)
            line = ", ".join(f"{value:.4g}" for value in hertz(self.squares[-1][:shown]))
            left = time_left(clock.perf_counter() - begin, (k + 1) / speeds.size)
            log.info(f"{speed:g} rpm: {line} Hz; speed {k + 1} of {speeds.size}, {left}")
        return None

    def names(self, solid: Solid, scene: Scene) -> list[str]:
        """The names of the modes by their shapes at the first speed. Collective."""
        rotation = scene.rotation
        assert rotation is not None and rotation.point is not None
        d = solid.dimension
        axis = np.array(rotation.axis if rotation.axis is not None else (0.0, 0.0, 1.0))
        point = np.pad(np.array(rotation.point), (0, 3 - d))
        nodes = solid.space.tabulate_dof_coordinates()[: solid.local // d, :d]
        shapes = self.shapes[0].reshape(len(nodes), d, self.count)
        return mode_names(nodes, shapes, axis, point, solid.comm)


def speeds_rpm(scene: Scene) -> Array:
    """The speeds of a scene's Campbell diagram.

    Raises:
        SceneError: there is no rotation, or no speed.
    """
    if scene.rotation is None:
        reason = "a Campbell diagram needs a [rotation] table"
        raise Where(scene.source, "rotation").refuse(MISSING, reason)
    if scene.campbell.speeds_rpm is not None:
        return np.array(scene.campbell.speeds_rpm, dtype=np.float64)
    if scene.rotation.speeds_rpm is not None:
        first, *_, last = scene.rotation.speeds_rpm
        return np.linspace(first, last, 13, dtype=np.float64)
    if not scene.rotation.speed_rpm > 0.0:
        reason = "rotation.speed_rpm is not above 0, so the speeds must be given"
        raise Where(scene.source, "campbell.speeds_rpm").refuse(MISSING, reason)
    return np.linspace(0.0, scene.rotation.speed_rpm, 13, dtype=np.float64)


def _warnings(found: Campbell) -> list[Note]:
    """One sentence for each mode that was lost, may be confused with another, or is unstable."""
    warnings = []
    for mode in range(found.squares.shape[1]):
        lost = np.flatnonzero(found.mac[:, mode] < LEAST_MAC)
        if lost.size:
            k = int(lost[0])
            text = (
                f"mode {mode + 1} was lost between {found.speeds_rpm[k - 1]:g} and "
                f"{found.speeds_rpm[k]:g} rpm (MAC {found.mac[k, mode]:.2f}): "
                "use speeds that are closer together"
            )
            warnings.append(Note(NoteKind.WARNING, text, quantity=FREQUENCIES))
        mac = found.mac[:, mode]
        for k in np.flatnonzero((mac >= LEAST_MAC) & (mac < DOUBTFUL_MAC)):
            text = (
                f"mode {mode + 1} may have been swapped with another mode between "
                f"{found.speeds_rpm[k - 1]:g} and {found.speeds_rpm[k]:g} rpm (MAC "
                f"{found.mac[k, mode]:.2f}): use speeds that are closer together to find out"
            )
            warnings.append(Note(NoteKind.WARNING, text, quantity=FREQUENCIES))
        unstable = np.flatnonzero(found.squares[:, mode] <= 0.0)
        if unstable.size:
            rotation = found.scene.rotation
            held = rotation is None or rotation.coriolis
            what = "the equilibrium is unstable"
            text = (
                f"mode {mode + 1} has omega^2 <= 0 at {found.speeds_rpm[unstable[0]]:g} rpm: "
                + (what if held else f"without the Coriolis force, which may hold it, {what}")
            )
            warnings.append(Note(NoteKind.UNSTABLE, text))
    return warnings
