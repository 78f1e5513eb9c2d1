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
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import MeshCheck, of_model, of_solid
from fenicsrom.assess.errors.plausibility import strain_warnings
from fenicsrom.assess.rotation.disk_modes import (
    WaveMode,
    counts,
    diameters_of,
    disk_modes,
    judged_diameters,
    lowest,
    waves_of,
)
from fenicsrom.assess.rotation.rotating_modes import (
    RangeBody,
    Shapes,
    TurningBody,
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
    from fenicsrom.fem.solid.disk import Disk
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
    met: NDArray[np.bool_] | None = None,
    names: Sequence[str] | None = None,
) -> tuple[list[Critical], list[str]]:
    """The critical speeds of all modes and engine orders, each confirmed by the modes there.

    Args:
        curves: the frequency of each mode.
        orders: the engine orders.
        solve: computes f^2 in Hz^2 and the MAC of a mode (from 0) at a speed in rev/min.
        met: (modes, orders) whether an order excites a mode; by default all do.
        names: names of the modes; by default their numbers.

    Returns:
        The critical speeds in ascending order, and a sentence for each one that failed.
    """
    found, notes = [], []
    for mode, curve in enumerate(curves):
        for k, order in enumerate(orders):
            for speed in curve.crossings(order) if met is None or met[mode, k] else ():
                item = Critical(mode + 1, order, float(speed), order * float(speed) / 60.0)
                where = f"engine order {order} and mode {names[mode] if names else mode + 1}"
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
        waves: which wave of a disk each mode is; () of a whole body.
        shapes: (local, m) complex amplitudes of these modes in the sector at the first speed.
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
    waves: tuple[WaveMode, ...] = ()
    shapes: NDArray[Any] | None = None
    files: list[Path] = field(default_factory=list)

    @property
    def frequencies_hz(self) -> Array:
        """(s, m) natural frequencies, zero where unstable, Hz."""
        return hertz(self.squares)

    @property
    def labels(self) -> list[str]:
        """One label per mode: its number, and its name if it has one."""
        names = [f" ({name})" for name in self.names] or [""] * self.squares.shape[1]
        return [f"{number}{name}" for number, name in zip(self.numbers, names, strict=True)]

    @property
    def numbers(self) -> list[str]:
        """The number of each mode; of a disk, its wave."""
        if self.waves:
            return [wave.label for wave in self.waves]
        return [str(k + 1) for k in range(self.squares.shape[1])]

    @property
    def margins(self) -> Array | None:
        """(m, orders) f / (k Omega / 60) - 1 of each mode and engine order at operating speed.

        It is NaN where the order does not excite the mode of a disk.
        """
        if self.operating_squares is None or self.scene.rotation is None:
            return None
        orders = self.scene.campbell.engine_orders
        lines = np.array(orders) * self.scene.rotation.speed_rpm / 60.0
        found = hertz(self.operating_squares)[:, None] / lines - 1.0
        return np.where(self.met(orders), found, np.nan)

    def met(self, orders: Sequence[int]) -> NDArray[np.bool_]:
        """(m, orders) whether each engine order excites each mode, as all do but those of disks."""
        if not self.waves:
            return np.ones((self.squares.shape[1], len(orders)), dtype=bool)
        return np.array([[wave.meets(order) for order in orders] for wave in self.waves])

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
    solid: Solid | None = None
    body: Any  # a solid, a `RangeBody` or a `Disk`
    if isinstance(given, Scene):
        solid = _solid_at(float(speeds[0]), scene, comm)
        body = solid if scene.cyclic is None else disk_of(solid, diameters_of(scene))
    else:
        body = range_body(given, speeds)
    most = body.whole.modes if isinstance(body, RangeBody) else body.free
    count = min(scene.campbell.modes or MODES, most)
    each = min(count + EXTRA_MODES, body.free)
    tracked = _Tracked(each, scene.at_speed(float(speeds.max())), solid)
    unfinished = tracked.follow_speeds(body, speeds)
    shown, names = np.arange(count), list[str]()
    at_first = scene if scene.rotation is None else scene.at_speed(float(speeds[0]))
    if solid is None:
        assert not isinstance(given, Scene)
        judged = of_model(given, float(speeds[0]))
    elif scene.cyclic is not None:
        shown = lowest(body, count, each)
        judged = _judged_disk(at_first, body, count, tracked.squares[0][shown])
    else:
        squares = tracked.squares[0][:count], lambda finer: modes_at_speed(finer, count)[0]
        judged = of_solid(at_first, solid, squares)
        names = tracked.names(solid, scene)[:count]
    reached = speeds[: len(tracked.squares)]
    found = Campbell(
        scene=scene,
        speeds_rpm=reached,
        squares=np.array(tracked.squares)[:, shown],
        mac=np.array(tracked.mac)[:, shown],
        largest=np.array(tracked.largest),
        names=names,
        change=max(tracked.changes) if scene.rotation and scene.rotation.coriolis else None,
        mesh_check=judged,
        unknowns=body.free if solid is None else solid.free,
        warnings=[*(body if solid is None else solid).warnings, *judged.warnings(scene)],
        unfinished=unfinished,
        body=solid,
    )
    if scene.cyclic is not None:
        shapes = tracked.shapes[-1][:, shown]
        found.waves = waves_of(body, shapes, count, _sense(scene, float(reached[-1])))
        found.shapes = body.displacements(shapes)
    found.warnings += _warnings(found)
    if tracked.passed is not None and scene.damped:
        text = (
            f"at {tracked.passed:g} rpm the body turns above a critical speed, where a mode has 0 "
            "Hz in the turning frame: damping that turns with the body makes this mode whirl"
        )
        found.warnings.append(Note(NoteKind.UNSTABLE, text))
    states = zip([f"at {speed:g} rpm" for speed in reached], tracked.deformations, strict=False)
    found.warnings += strain_warnings(list(states))
    _find_critical_speeds(found, body, tracked, shown)
    found.seconds = clock.perf_counter() - begin
    return found


def _judged_disk(scene: Scene, disk: Disk, count: int, squares: Array) -> MeshCheck:
    """Judge omega^2 (m,) of some nodal diameters of a disk by finer elements."""
    judged = judged_diameters(disk.diameters)
    numbers = counts(disk, count)
    kept = np.repeat(np.isin(disk.diameters, judged), numbers)
    pairs = [(h, n) for h, n in zip(disk.diameters, numbers, strict=True) if h in judged]
    labels = tuple(f"{k + 1} of {h} nodal diameters" for h, n in pairs for k in range(n))

    def finer_squares(finer: Solid) -> Array:
        found = disk_of(finer, judged)
        values = disk_modes(found, count)[0]
        found.destroy()
        return values

    return replace(of_solid(scene, disk.sector, (squares[kept], finer_squares)), labels=labels)


def _sense(scene: Scene, speed_rpm: float) -> float:
    """Above 0 if a disk turns about its axis, below 0 if against it; 0 without Coriolis force."""
    cyclic, rotation = scene.cyclic, scene.rotation
    if cyclic is None or rotation is None or not rotation.coriolis:
        return 0.0
    return speed_rpm * float(np.dot(cyclic.axis or (1.0,), rotation.axis or (1.0,)))


def _find_critical_speeds(
    found: Campbell, body: TurningBody, tracked: _Tracked, shown: NDArray[np.int64]
) -> None:
    """Find the critical speeds, and the frequencies at the speed of operation."""
    rotation = found.scene.rotation
    assert rotation is not None
    log.info("critical speeds ..")

    @cache
    def between(speed: float) -> tuple[Array, Array]:
        """omega^2 and MAC of the modes, in their order at the nearest speed of the diagram."""
        k = int(np.argmin(np.abs(found.speeds_rpm - speed)))
        if found.speeds_rpm[k] == speed:
            return tracked.squares[k], np.ones(tracked.squares[k].size)
        body.spin(np.pi / 30.0 * speed)
        values, vectors, _ = tracked.modes(body, tracked.count)
        values, _, mac = follow(body, tracked.squares[k], tracked.shapes[k], values, vectors)
        return values, mac

    def solve(mode: int, speed: float) -> tuple[float, float]:
        squares, mac = between(speed)
        return float(squares[shown[mode]]) / (2.0 * np.pi) ** 2, float(mac[shown[mode]])

    orders = found.scene.campbell.engine_orders
    met = found.met(orders)
    found.critical, notes = critical_speeds(found.curves(), orders, solve, met, found.numbers)
    found.warnings += [Note(NoteKind.UNCHECKED, text, quantity=CRITICAL) for text in notes]
    speed = rotation.speed_rpm
    if 0.0 < speed and found.speeds_rpm[0] <= speed <= found.speeds_rpm[-1]:
        try:
            squares, _ = between(speed)
            found.operating_squares = squares[shown]
        except (ConvergenceError, AccuracyError) as error:
            text = f"no margins at {speed:g} rpm: {error}"
            found.warnings.append(Note(NoteKind.FAILED, text, quantity=CRITICAL))


def _solid_at(speed_rpm: float, scene: Scene, comm: Any) -> Solid:
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

    def __init__(self, count: int, fastest: Scene, solid: Solid | None):
        """Begin without a speed.

        Args:
            count: number of modes, of a disk of each nodal diameter.
            fastest: the scene at the largest speed.
            solid: the solid of the scene, or None.
        """
        self.count, self.fastest, self.solid = count, fastest, solid
        self.modes: Callable[..., Any] = modes_at_speed if fastest.cyclic is None else disk_modes
        self.squares: list[Array] = []
        self.mac: list[Array] = []
        self.largest: list[float] = []
        self.deformations: list[Deformation] = []
        self.changes: list[float] = []
        self.shapes: list[Shapes] = []
        self.passed: float | None = None  # the first speed above a critical one, rev/min

    def add(self, body: TurningBody, speed_rpm: float) -> None:
        """Add the modes of the body at its present speed.

        Raises:
            ConvergenceError, AccuracyError: as in `modes_at_speed`.
        """
        values, vectors, change = self.modes(body, self.count)
        if self.passed is None and have_passed_zero(body, values, vectors):
            self.passed = speed_rpm
        common: Array = np.ones(values.size)
        if self.shapes:
            before = self.squares[-1], self.shapes[-1]
            values, vectors, common = follow(body, *before, values, vectors)
        self.shapes.append(vectors)
        self.squares.append(values)
        self.mac.append(common)
        self.largest.append(float(body.largest(body.equilibrium[:, None])[0]))
        if self.solid is not None:
            from fenicsrom.fem.body.stress_points import body_deformation

            found = body_deformation(self.solid, self.fastest, body.equilibrium)
            self.deformations.append(found)
        self.changes.append(change)

    def follow_speeds(self, body: TurningBody, speeds: Array) -> Exception | None:
        """Add the modes at all speeds; the body is at the first one.

        Args:
            body: the body.
            speeds: the speeds, rev/min.

        Returns:
            The error that stopped the computation after the first speed, if there was one.

        Raises:
            ConvergenceError, AccuracyError: the first speed failed.
        """
        begin = clock.perf_counter()
        for k, speed in enumerate(speeds):
            try:
                if k:
                    body.spin(np.pi / 30.0 * float(speed))
                self.add(body, float(speed))
            except (ConvergenceError, AccuracyError) as error:
                if not k:
                    raise
                return type(error)(f"campbell: at {speed:g} rpm: {error}", kind=error.kind)
            lowest = np.sort(hertz(self.squares[-1]))[:MODES]
            line = ", ".join(f"{value:.4g}" for value in lowest)
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


def disk_of(solid: Solid, diameters: Sequence[int]) -> Disk:
    """The waves of the disk of which a solid is one sector; errors as `Disk`."""
    from fenicsrom.fem.solid.disk import Disk

    return Disk(solid, diameters)


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
    for mode, name in enumerate(found.numbers):
        lost = np.flatnonzero(found.mac[:, mode] < LEAST_MAC)
        if lost.size:
            k = int(lost[0])
            text = (
                f"mode {name} was lost between {found.speeds_rpm[k - 1]:g} and "
                f"{found.speeds_rpm[k]:g} rpm (MAC {found.mac[k, mode]:.2f}): "
                "use speeds that are closer together"
            )
            warnings.append(Note(NoteKind.WARNING, text, quantity=FREQUENCIES))
        mac = found.mac[:, mode]
        for k in np.flatnonzero((mac >= LEAST_MAC) & (mac < DOUBTFUL_MAC)):
            text = (
                f"mode {name} may have been swapped with another mode between "
                f"{found.speeds_rpm[k - 1]:g} and {found.speeds_rpm[k]:g} rpm (MAC "
                f"{found.mac[k, mode]:.2f}): use speeds that are closer together to find out"
            )
            warnings.append(Note(NoteKind.WARNING, text, quantity=FREQUENCIES))
        unstable = np.flatnonzero(found.squares[:, mode] <= 0.0)
        if unstable.size:
            rotation = found.scene.rotation
            held = rotation is None or rotation.coriolis
            what = "the equilibrium is unstable"
            text = f"mode {name} has omega^2 <= 0 at {found.speeds_rpm[unstable[0]]:g} rpm: " + (
                what if held else f"without the Coriolis force, which may hold it, {what}"
            )
            warnings.append(Note(NoteKind.UNSTABLE, text))
    return warnings
