"""Campbell diagram: natural frequencies of a rotating body against speed, with engine orders.

At every speed the body moves to its equilibrium without contact, and the modes are those of the
tangent stiffness (`fenicsrom.assess.rotating_modes`). They are tracked from speed to speed by their
modal assurance criterion, MAC = |a^H M b|^2 / (a^H M a  b^H M b).

Engine order k excites k times per revolution. A critical speed Omega is a root of
f(Omega)^2 = (k Omega / 2 pi)^2, where f^2 is a cubic spline of the speed (Southwell: f^2 is nearly
linear in Omega^2). Modes that veer exchange their shapes. With closely spaced speeds a tracked mode
follows the curve of its frequency; with widely spaced speeds it keeps its shape.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from fenicsrom.arrays import Array
from fenicsrom.assess.rotating_modes import Shapes, follow, modes_at_speed
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.progress import time_left
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from fenicsrom.fem.solid import Solid

EXTRA_MODES = 4  # additional modes to track, because they may cross the requested modes
LEAST_MAC = 0.5  # a mode with a smaller MAC counts as lost


@dataclass(frozen=True)
class Critical:
    """A speed at which an engine order meets a mode.

    Attributes:
        mode: number of the mode, from 1.
        order: excitations per revolution.
        speed_rpm: the critical speed.
        frequency_hz: common frequency of the mode and of the engine order at this speed.
    """

    mode: int
    order: int
    speed_rpm: float
    frequency_hz: float


@dataclass(eq=False)
class Campbell:
    """The frequencies of a body at several speeds.

    Attributes:
        scene: the scene.
        speeds_rpm: (s,) the speeds that were reached.
        squares: (s, m) omega^2 of each mode, rad^2/s^2; negative where the mode is unstable.
        mac: (s, m) MAC of each mode with itself at the previous speed; 1 at the first.
        largest: (s,) largest displacement in the equilibrium, m.
        critical: the critical speeds, in ascending order.
        change: largest relative change of a frequency in the last round of the complex modes; None
            without Coriolis force.
        unknowns: free unknowns of the mesh.
        seconds: run time.
        warnings: sentences for the user.
        unfinished: the error that stopped the computation; None if all speeds were reached.
    """

    scene: Scene
    speeds_rpm: Array
    squares: Array
    mac: Array
    largest: Array
    critical: list[Critical]
    change: float | None
    unknowns: int
    seconds: float
    warnings: list[str] = field(default_factory=list)
    unfinished: Exception | None = None

    @property
    def frequencies_hz(self) -> Array:
        """(s, m) natural frequencies, zero where unstable, Hz."""
        return np.sqrt(np.maximum(self.squares, 0.0)) / (2.0 * np.pi)


def campbell(scene: Scene, comm: Any, say: Callable[[str], None]) -> Campbell:
    """Compute the frequencies of a scene's body at the speeds of its [campbell] table.

    Args:
        scene: a scene with [rotation]; `rotation.speed_rpm` is used only if [campbell] has no
            speeds.
        comm: MPI communicator.
        say: called with one line of progress at a time.

    Returns:
        The frequencies; `unfinished` holds an error that stopped the computation before the last
        speed.

    Raises:
        SceneError: no rotation, no speed, or more modes than unknowns.
        ConvergenceError, AccuracyError: the first speed failed.
    """
    begin = clock.perf_counter()
    speeds, count = speeds_rpm(scene), scene.campbell.modes
    solid = _solid_at(float(speeds[0]), scene, comm, say)
    tracked = _Tracked(min(count + EXTRA_MODES, solid.free))
    unfinished: Exception | None = None
    for k, speed in enumerate(speeds):
        try:
            if k:
                solid.spin(np.pi / 30.0 * float(speed))
            tracked.add(solid)
        except (ConvergenceError, AccuracyError) as error:
            if not k:
                raise
            unfinished = type(error)(f"campbell: at {speed:g} rpm: {error}", kind=error.kind)
            break
        squares = tracked.squares[-1][:count]
        shown = ", ".join(f"{np.sqrt(max(v, 0.0)) / (2.0 * np.pi):.4g}" for v in squares)
        left = time_left(clock.perf_counter() - begin, (k + 1) / speeds.size)
        say(f"{speed:g} rpm: {shown} Hz; speed {k + 1} of {speeds.size}, {left}")
    reached = speeds[: len(tracked.squares)]
    kept = np.array(tracked.squares)[:, :count]
    found = Campbell(
        scene,
        reached,
        kept,
        np.array(tracked.mac)[:, :count],
        np.array(tracked.largest),
        critical_speeds(reached, kept, scene),
        max(tracked.changes) if scene.rotation and scene.rotation.coriolis else None,
        solid.free,
        clock.perf_counter() - begin,
        list(solid.warnings),
        unfinished,
    )
    found.warnings += _warnings(found)
    return found


def _solid_at(speed_rpm: float, scene: Scene, comm: Any, say: Callable[[str], None]) -> Any:
    """Make the mesh and the solid about its equilibrium at this speed.

    Raises:
        SceneError: the scene cannot be used, or asks for more modes than the mesh has unknowns.
        ConvergenceError: there is no equilibrium.
    """
    from fenicsrom.fem.mesh import build_mesh
    from fenicsrom.fem.solid import solid_of

    assert scene.rotation is not None
    say("mesh ..")
    mesh = build_mesh(scene.geometry, comm)
    say("solid ..")
    solid = solid_of(replace(scene, rotation=replace(scene.rotation, speed_rpm=speed_rpm)), mesh)
    if scene.campbell.modes > solid.free:
        raise SceneError(
            f"{scene.source}: campbell.modes = {scene.campbell.modes}: must be at most "
            f"{solid.free}, the number of free unknowns",
            kind=ErrorKind.RANGE,
            key="campbell.modes",
            source=scene.source,
        )
    return solid


class _Tracked:
    """The modes of a body at successive speeds, in the order of the modes at the first speed."""

    def __init__(self, count: int):
        self.count = count
        self.squares: list[Array] = []
        self.mac: list[Array] = []
        self.largest: list[float] = []
        self.changes: list[float] = []
        self._shapes: Shapes | None = None

    def add(self, solid: Solid) -> None:
        """Add the modes of the body at its present speed.

        Raises:
            ConvergenceError, AccuracyError: as in `modes_at_speed`.
        """
        values, vectors, change = modes_at_speed(solid, self.count)
        if self._shapes is None:
            common: Array = np.ones(self.count)
        else:
            values, vectors, common = follow(solid, self.squares[-1], self._shapes, values, vectors)
        self._shapes = vectors
        self.squares.append(values)
        self.mac.append(common)
        self.largest.append(float(solid.largest(solid.equilibrium[:, None])[0]))
        self.changes.append(change)


def speeds_rpm(scene: Scene) -> Array:
    """The speeds of a scene's Campbell diagram.

    Raises:
        SceneError: there is no rotation, or no speed.
    """
    if scene.rotation is None:
        raise SceneError(
            f"{scene.source}: rotation is missing: a Campbell diagram needs a [rotation] table",
            kind=ErrorKind.MISSING,
            key="rotation",
            source=scene.source,
        )
    if scene.campbell.speeds_rpm is not None:
        return np.array(scene.campbell.speeds_rpm, dtype=np.float64)
    if not scene.rotation.speed_rpm > 0.0:
        raise SceneError(
            f"{scene.source}: campbell.speeds_rpm is missing: rotation.speed_rpm is not above 0, "
            "so the speeds must be given",
            kind=ErrorKind.MISSING,
            key="campbell.speeds_rpm",
            source=scene.source,
        )
    return np.linspace(0.0, scene.rotation.speed_rpm, 13, dtype=np.float64)


def _warnings(found: Campbell) -> list[str]:
    """One sentence for each mode that was lost, and one for each unstable mode."""
    warnings = []
    for mode in range(found.squares.shape[1]):
        lost = np.flatnonzero(found.mac[:, mode] < LEAST_MAC)
        if lost.size:
            k = int(lost[0])
            warnings.append(
                f"mode {mode + 1} was lost between {found.speeds_rpm[k - 1]:g} and "
                f"{found.speeds_rpm[k]:g} rpm (MAC {found.mac[k, mode]:.2f}): "
                "use speeds that are closer together"
            )
        unstable = np.flatnonzero(found.squares[:, mode] <= 0.0)
        if unstable.size:
            warnings.append(
                f"mode {mode + 1} has omega^2 <= 0 at {found.speeds_rpm[unstable[0]]:g} rpm: "
                "the equilibrium is unstable"
            )
    return warnings


# ---------------------------------------------------------------------- modes


def critical_speeds(speeds: Array, squares: Array, scene: Scene) -> list[Critical]:
    """The critical speeds, interpolated between the speeds, in ascending order."""
    if speeds.size < 2:
        return []
    found = []
    for mode in range(squares.shape[1]):
        for order in scene.campbell.engine_orders:
            difference = squares[:, mode] / (2.0 * np.pi) ** 2 - (order * speeds / 60.0) ** 2
            roots = CubicSpline(speeds, difference).roots(extrapolate=False)
            roots = np.unique(np.round(roots[np.isfinite(roots) & (roots > 0.0)], 9))
            found += [
                Critical(mode + 1, order, float(root), order * float(root) / 60.0) for root in roots
            ]
    return sorted(found, key=lambda item: (item.speed_rpm, item.mode, item.order))
