"""Campbell diagram: natural frequencies of a rotating body against speed, with engine orders.

At every speed the body moves to its equilibrium without contact, and the modes are those of the
tangent stiffness (`assess.rotation.rotating_modes`). The modes are tracked from speed to speed by
the modal assurance criterion, MAC = |a^H M b|^2 / (a^H M a  b^H M b).

Modes that veer exchange their shapes. With closely spaced speeds a tracked mode follows the curve
of its frequency; with widely spaced speeds it keeps its shape. `assess.rotation.critical_speeds`
finds the speeds at which engine orders meet the modes, and `assess.rotation.rotating_modes` names
the modes by their shapes at the first speed. The modes of a disk are those of several waves, each
of which is a body of its own at every speed (`assess.rotation.disk_modes`).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import MISSING, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import MeshCheck, of_model, of_solid
from fenicsrom.assess.errors.plausibility import strain_warnings
from fenicsrom.assess.rotation.critical_speeds import (
    LEAST_MAC,
    Critical,
    FrequencyCurve,
    critical_speeds,
)
from fenicsrom.assess.rotation.disk_modes import (
    WaveMode,
    directions,
    wave_modes,
    waves_of,
)
from fenicsrom.assess.rotation.rotating_modes import (
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
    from fenicsrom.fem.solid.reduced_waves import ReducedWaves
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.online.store.archive import StoredModel


JUDGED = 3  # nodal diameters whose frequencies finer elements judge: first, middle and last
MANY_WAVES, MANY_UNKNOWNS = 40, 5000
"""From so many pairs of a nodal diameter and a speed, and unknowns, few coordinates save time."""
WAVE_ERROR = 1e-4  # largest accepted error of the frequencies of these waves
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
        shapes: (local, m) complex amplitudes of these modes in the sector at the last speed.
        open_squares: (m,) omega^2 by nodal diameter, as `waves`, at the last speed without the
            contacts between sectors; None without such contacts that press.
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
    open_squares: Array | None = None
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
    tracked = _tracked(given, scene, speeds, comm)
    unfinished = tracked.follow_speeds(speeds)
    solid = tracked.solid
    if isinstance(given, Scene):
        judged = _judged(scene.at_speed(float(speeds[0])), tracked)
    else:
        judged = of_model(given, float(speeds[0]))
    reached = speeds[: len(tracked.largest)]
    found = Campbell(
        scene=scene,
        speeds_rpm=reached,
        squares=tracked.shown("squares"),
        mac=tracked.shown("mac"),
        largest=np.array(tracked.largest),
        names=[] if solid is None or scene.cyclic else tracked.names(solid, scene),
        change=max(tracked.changes) if scene.rotation and scene.rotation.coriolis else None,
        mesh_check=judged,
        unknowns=tracked.turning.free,
        warnings=[*tracked.turning.warnings, *judged.warnings(scene)],
        unfinished=unfinished,
        body=solid,
    )
    if solid is not None and scene.cyclic is not None:
        last = [part.shapes[reached.size - 1][:, : part.shown] for part in tracked.parts]
        pairs = list(zip(scene.cyclic.waves, last, strict=True))
        turning: Any = solid.cut if tracked.turning is solid else tracked.turning
        moved = turning.displacements
        found.waves, found.shapes = waves_of(solid, pairs, _sense(scene, reached[-1]), moved)
        if unfinished is None and np.any(solid.pressing & solid.between):
            released = [part.solved(solid, stuck=False) for part in tracked.parts]
            found.open_squares = np.concatenate(released)
    found.warnings += [*_warnings(found), *tracked.warnings(scene, reached)]
    _find_critical_speeds(found, tracked)
    found.seconds = clock.perf_counter() - begin
    return found


def _tracked(given: Scene | StoredModel, scene: Scene, speeds: Array, comm: Any) -> _Tracked:
    """The body at its first speed, before its modes are computed; errors as `campbell`."""
    fastest, asked = scene.at_speed(float(speeds.max())), scene.campbell.modes or MODES
    if not isinstance(given, Scene):
        body = range_body(given, speeds)
        return _Tracked([_Part(nullcontext, modes_at_speed, min(asked, body.whole.modes))], body)
    solid = _solid_at(float(speeds[0]), scene, comm)
    if scene.cyclic is None:
        return _Tracked([_Part(nullcontext, modes_at_speed, asked)], solid, solid, fastest)
    parts = [
        _Part(
            partial(_wave, h=h),
            wave_modes,
            asked * directions(solid, h),
            f" of {h} nodal diameters",
        )
        for h in scene.cyclic.waves
    ]
    return _Tracked(parts, _reduced(solid, fastest, asked, speeds) or solid, solid, fastest)


def _wave(body: Any, h: int, **more: Any) -> AbstractContextManager[TurningBody]:
    """The wave of a solid or of `ReducedWaves` with h nodal diameters."""
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.fem.solid.wave import wave

    return wave(body, h, **more) if isinstance(body, Solid) else body.wave(h)


def _reduced(solid: Solid, scene: Scene, asked: int, speeds: Array) -> ReducedWaves | None:
    """The waves of a disk in few coordinates, where they save time and are exact enough.

    Args:
        solid: the sector at the first speed.
        scene: its scene.
        asked: number of modes of each nodal diameter and direction.
        speeds: the speeds (s,), rev/min.

    Returns:
        The waves at the first speed, whose error a note of the solid tells; None without them.
    """
    from fenicsrom.fem.solid.reduced_waves import ReducedWaves, sampled_diameters

    cyclic, cut = scene.cyclic, solid.cut
    assert cyclic is not None and cut is not None
    between = sorted(set(cyclic.waves) - set(sampled_diameters(cyclic.sectors)))
    few = len(speeds) * len(cyclic.waves) < MANY_WAVES or len(speeds) < 3 or not between
    free = solid.free_motions.shape[1] > 0
    if few or solid.free < MANY_UNKNOWNS or solid.joined or free or cut.meet():
        return None
    log.info("waves of a few nodal diameters at a few speeds ..")
    found = ReducedWaves(solid, scene, asked, speeds)
    h, speed = between[len(between) // 2], float(speeds[-1])
    found.spin(np.pi / 30.0 * speed)
    squares = []
    for body in (found, solid):
        with _wave(body, h) as one:
            squares.append(wave_modes(one, asked * directions(solid, h))[0])
    error = float(np.max(np.abs(squares[0] / squares[1] - 1.0))) / 2.0
    exact = error <= WAVE_ERROR
    (found if exact else solid).spin(np.pi / 30.0 * float(speeds[0]))
    if not exact:
        return None
    known = ", ".join(map(str, found.diameters))
    text = f"the waves of {known} nodal diameters at 3 speeds give all others; the frequencies of "
    text += f"{h} nodal diameters at {speed:g} rpm are off by {error:.1g}"
    solid.warnings.append(Note(NoteKind.REMARK, text, quantity=FREQUENCIES))
    return found


def _judged(scene: Scene, tracked: _Tracked) -> MeshCheck:
    """Judge the frequencies at the first speed, of some waves of a disk, by finer elements."""
    assert tracked.solid is not None
    last = len(tracked.parts) - 1
    places = np.unique(np.linspace(0, last, min(JUDGED, last + 1)).round().astype(int))
    parts = [tracked.parts[k] for k in places]

    def finer_squares(finer: Solid) -> Array:
        return np.concatenate([part.solved(finer) for part in parts])

    squares = np.concatenate([part.squares[0][: part.shown] for part in parts])
    labels = tuple(f"{k + 1}{part.name}" for part in parts for k in range(part.shown))
    found = of_solid(scene, tracked.solid, (squares, finer_squares))
    return found if scene.cyclic is None else replace(found, labels=labels)


def _sense(scene: Scene, speed_rpm: float) -> float:
    """Above 0 if a disk turns about its axis, below 0 if against it; 0 without Coriolis force."""
    cyclic, rotation = scene.cyclic, scene.rotation
    if cyclic is None or rotation is None or not rotation.coriolis:
        return 0.0
    along = float(np.dot(cyclic.axis or (1.0,), rotation.axis or (1.0,)))
    return -along if speed_rpm < 0.0 else along


def _find_critical_speeds(found: Campbell, tracked: _Tracked) -> None:
    """Find the critical speeds, and the frequencies at the speed of operation."""
    rotation = found.scene.rotation
    assert rotation is not None
    log.info("critical speeds ..")
    places = [(part, k) for part in tracked.parts for k in range(part.shown)]

    @cache
    def between(part: _Part, speed: float) -> tuple[Array, Array]:
        """omega^2 and MAC of the modes, in their order at the nearest speed of the diagram."""
        k = int(np.argmin(np.abs(found.speeds_rpm - speed)))
        if found.speeds_rpm[k] == speed:
            return part.squares[k], np.ones(part.squares[k].size)
        tracked.turning.spin(np.pi / 30.0 * speed)
        return part.near(tracked.turning, k)

    def solve(mode: int, speed: float) -> tuple[float, float]:
        part, k = places[mode]
        squares, mac = between(part, speed)
        return float(squares[k]) / (2.0 * np.pi) ** 2, float(mac[k])

    orders = found.scene.campbell.engine_orders
    met = found.met(orders)
    found.critical, notes = critical_speeds(found.curves(), orders, solve, met, found.numbers)
    found.warnings += [Note(NoteKind.UNCHECKED, text, quantity=CRITICAL) for text in notes]
    speed = rotation.speed_rpm
    if 0.0 < speed and found.speeds_rpm[0] <= speed <= found.speeds_rpm[-1]:
        try:
            found.operating_squares = np.concatenate(
                [between(part, speed)[0][: part.shown] for part in tracked.parts]
            )
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
    solid = solid_of(scene.at_speed(speed_rpm), mesh, free=True)
    asked = scene.campbell.modes
    if asked is not None and asked > solid.free:
        allowed = f"must be at most {solid.free}, the number of free unknowns"
        raise Where(scene.source, "campbell.modes").refuse(asked, allowed)
    return solid


@dataclass(eq=False)
class _Part:
    """The modes of a body, or of one wave of a disk, in their order at the first speed.

    Attributes:
        of: gives the body whose modes these are, of a solid or of a `RangeBody`.
        modes: finds its lowest modes, as `modes_at_speed`.
        shown: number of modes that are shown; some more are tracked.
        name: what stands behind the number of a mode.
        squares: at each speed, omega^2 (m,), rad^2/s^2.
        mac: at each speed, the MAC (m,) of each mode with itself at the previous speed.
        shapes: at each speed, the shapes (own, m).
    """

    of: Callable[..., AbstractContextManager[TurningBody]]
    modes: Callable[[TurningBody, int], tuple[Array, Shapes, float]]
    shown: int
    name: str = ""
    squares: list[Array] = field(default_factory=list)
    mac: list[Array] = field(default_factory=list)
    shapes: list[Shapes] = field(default_factory=list)

    def solved(self, turning: Any, **more: Any) -> Array:
        """omega^2 (m,) of the modes that are shown, of another solid or body at the same speed."""
        with self.of(turning, **more) as body:
            return self.modes(body, self.shown)[0]

    def add(self, turning: Any) -> tuple[float, bool]:
        """Add the modes at the present speed; errors as `modes_at_speed`.

        Returns:
            The last relative change of complex frequencies, and whether a mode has passed zero.
        """
        with self.of(turning) as body:
            known = self.squares[0].size if self.squares else self.shown + EXTRA_MODES
            values, vectors, change = self.modes(body, min(known, body.free))
            passed = have_passed_zero(body, values, vectors)
            mac: Array = np.ones(values.size)
            if self.squares:
                before = self.squares[-1], self.shapes[-1]
                values, vectors, mac = follow(body, *before, values, vectors)
        self.shown = min(self.shown, values.size)
        self.squares.append(values)
        self.mac.append(mac)
        self.shapes.append(vectors)
        return change, passed

    def near(self, turning: Any, k: int) -> tuple[Array, Array]:
        """omega^2 (m,) at the present speed, and the MAC (m,) with the modes at the speed k."""
        with self.of(turning) as body:
            values, vectors, _ = self.modes(body, self.squares[k].size)
            values, _, mac = follow(body, self.squares[k], self.shapes[k], values, vectors)
        return values, mac


class _Tracked:
    """The modes of a body at successive speeds."""

    def __init__(
        self,
        parts: list[_Part],
        turning: Any,
        solid: Solid | None = None,
        fastest: Scene | None = None,
    ):
        """Begin without a speed.

        Args:
            parts: one part, or the waves of a disk.
            turning: what turns: a solid or a `RangeBody`.
            solid: the solid, or None.
            fastest: the scene of the solid at the largest speed.
        """
        self.parts, self.turning, self.solid, self._fastest = parts, turning, solid, fastest
        self.largest: list[float] = []
        self.deformations: list[Deformation] = []
        self.changes: list[float] = []
        self.passed: float | None = None  # the first speed above a critical one, rev/min

    def shown(self, name: str) -> Array:
        """The "squares" or the "mac" (speeds, m) of the modes that are shown."""
        columns = [np.array(getattr(part, name))[:, : part.shown] for part in self.parts]
        return np.concatenate([column[: len(self.largest)] for column in columns], axis=1)

    def follow_speeds(self, speeds: Array) -> Exception | None:
        """Add the modes at all speeds; the body is at the first one.

        Args:
            speeds: the speeds, rev/min.

        Returns:
            The error that stopped the computation after the first speed, if there was one.

        Raises:
            ConvergenceError, AccuracyError: the first speed failed.
        """
        begin = clock.perf_counter()
        for k, speed in enumerate(map(float, speeds)):
            try:
                if k:
                    self.turning.spin(np.pi / 30.0 * speed)
                added = [part.add(self.turning) for part in self.parts]
            except (ConvergenceError, AccuracyError) as error:
                if not k:
                    raise
                return type(error)(f"campbell: at {speed:g} rpm: {error}", kind=error.kind)
            self.changes.append(max(change for change, _ in added))
            if self.passed is None and any(passed for _, passed in added):
                self.passed = speed
            self._add_equilibrium()
            every = np.concatenate([part.squares[-1][: part.shown] for part in self.parts])
            line = ", ".join(f"{value:.4g}" for value in np.sort(hertz(every))[:MODES])
            left = time_left(clock.perf_counter() - begin, (k + 1) / speeds.size)
            log.info(f"{speed:g} rpm: {line} Hz; speed {k + 1} of {speeds.size}, {left}")
        return None

    def _add_equilibrium(self) -> None:
        u = self.turning.equilibrium
        self.largest.append(float(self.turning.largest(u[:, None])[0]))
        if self.solid is not None and self._fastest is not None:
            from fenicsrom.fem.body.stress_points import body_deformation

            self.deformations.append(body_deformation(self.solid, self._fastest, u))

    def warnings(self, scene: Scene, speeds: Array) -> list[Note]:
        """What the equilibria and the modes at the speeds that were reached give reason to say."""
        states = zip([f"at {speed:g} rpm" for speed in speeds], self.deformations, strict=False)
        found = strain_warnings(list(states))
        if self.passed is not None and scene.damped:
            text = (
                f"at {self.passed:g} rpm the body turns above a critical speed, where a mode has 0 "
                "Hz in the turning frame: damping that turns with the body makes this mode whirl"
            )
            found.insert(0, Note(NoteKind.UNSTABLE, text))
        return found

    def names(self, solid: Solid, scene: Scene) -> list[str]:
        """The names of the modes by their shapes at the first speed. Collective."""
        rotation, (part,) = scene.rotation, self.parts
        assert rotation is not None and rotation.point is not None
        d = solid.dimension
        axis = np.array(rotation.axis if rotation.axis is not None else (0.0, 0.0, 1.0))
        point = np.pad(np.array(rotation.point), (0, 3 - d))
        nodes = solid.space.tabulate_dof_coordinates()[: solid.local // d, :d]
        shapes = part.shapes[0].reshape(len(nodes), d, -1)
        return mode_names(nodes, shapes, axis, point, solid.comm)[: part.shown]


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
        unstable = np.flatnonzero(found.squares[:, mode] < 0.0)  # rigid motions have 0
        if unstable.size:
            rotation = found.scene.rotation
            held = rotation is None or rotation.coriolis
            what = "the equilibrium is unstable"
            text = f"mode {name} has omega^2 < 0 at {found.speeds_rpm[unstable[0]]:g} rpm: " + (
                what if held else f"without the Coriolis force, which may hold it, {what}"
            )
            warnings.append(Note(NoteKind.UNSTABLE, text))
    return warnings
