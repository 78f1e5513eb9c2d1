"""Campbell diagram: the natural frequencies of a turning body against its speed, and where engine
orders meet them.

At every speed the body is brought on to its equilibrium there, touching nothing, and the modes are
those of the tangent: K phi = omega^2 M phi. With the Coriolis force they are complex, with whirl of
either sense, and solve

    (K + i omega G - omega^2 M) phi = 0

The real modes reduce it to a dense problem in state space; K^-1 times the residuals of what it
finds is added to them until the frequencies stand still (`COMPLEX_TOLERANCE`). Modes are followed
from speed to speed by the shapes they have in common, MAC = |a^H M b|^2 / (a^H M a  b^H M b).
Engine order k excites k times a revolution; the speeds at which a mode answers are the roots of
f(Omega)^2 = (k Omega / 2 pi)^2, with f^2 a cubic spline of the speed (it is nearly linear in
Omega^2: Southwell). Modes that veer away from one another exchange their shapes: speeds close
together keep to the lines, wide ones to the shapes.
"""

from __future__ import annotations

import csv
import io
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.files import atomic_write
from fenicsrom.online.archive import provenance
from fenicsrom.post.html_page import html_report
from fenicsrom.post.style import COLOURS, new_figure, styled
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_figure, write_summary
from fenicsrom.reduction.basis import DEPENDENCE
from fenicsrom.reduction.modes import close_frequency_groups
from fenicsrom.reduction.projection import projected_gyroscopic
from fenicsrom.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fenicsrom.fem.solid import Solid

Shapes = NDArray[Any]  # real, or complex with the Coriolis force

SPARE = 4  # modes followed beyond those that are asked for, which they may cross
# relative distance of frequencies below which the shapes of modes are any combination of one
# another
DEGENERATE = 1e-4
LEAST_MAC = 0.5  # below which a mode is not taken for the one it was
COMPLEX_TOLERANCE = (
    1e-8  # change of the frequencies, relative, at which the space of complex modes is large enough
)
COMPLEX_ROUNDS = 12


@dataclass(frozen=True)
class Critical:
    """A speed at which an engine order meets a mode.

    Attributes:
        mode: number of the mode, from 1.
        order: excitations a revolution.
        speed_rpm: where.
        frequency_hz: of both.
    """

    mode: int
    order: int
    speed_rpm: float
    frequency_hz: float


@dataclass(eq=False)
class Campbell:
    """What was found.

    Attributes:
        scene: the scene.
        speeds_rpm: (s,) the speeds that were reached.
        squares: (s, m) omega^2 of each mode followed, rad^2/s^2; below zero where it is unstable.
        mac: (s, m) of each mode with itself at the speed before; 1 at the first.
        largest: (s,) largest displacement in the equilibrium, m.
        critical: where engine orders meet modes, by speed.
        change: largest relative change of a frequency in the last round of the complex modes; None
        without Coriolis force.
        unknowns: free unknowns of the mesh.
        seconds: run time.
        warnings: sentences for the user.
        unfinished: what stopped it, None if all speeds were reached.
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
    """The frequencies of a scene's body at the speeds its [campbell] table names.

    Args:
        scene: with a [rotation]; its speed counts only if no speeds are named.
        comm: MPI communicator.
        say: is told what happens, a line at a time.

    Returns:
        What was found; `unfinished` says what stopped it before the last speed.

    Raises:
        SceneError: no rotation, no speed, or more modes than unknowns.
        ConvergenceError, AccuracyError: nothing was found at all.
    """
    from fenicsrom.fem.mesh import build_mesh
    from fenicsrom.fem.solid import solid_of

    begin = clock.perf_counter()
    rotation, speeds = scene.rotation, speeds_rpm(scene)
    assert rotation is not None
    say("mesh ..")
    mesh = build_mesh(scene.geometry, comm)
    say("solid ..")
    solid = solid_of(replace(scene, rotation=replace(rotation, speed_rpm=float(speeds[0]))), mesh)
    count = scene.campbell.modes
    if count > solid.free:
        raise SceneError(
            f"{scene.source}: campbell.modes = {count}: must be at most {solid.free}, the number of free unknowns"
        )
    wanted = min(count + SPARE, solid.free)
    squares, mac, largest, changes = [], [], [], []
    shapes: Shapes | None = None
    unfinished: Exception | None = None
    for k, speed in enumerate(speeds):
        try:
            if k:
                solid.spin(np.pi / 30.0 * float(speed))
            values, vectors, change = modes_at_speed(solid, wanted)
        except (ConvergenceError, AccuracyError) as error:
            if not k:
                raise
            unfinished = type(error)(f"campbell: at {speed:g} rpm: {error}")
            break
        if shapes is None:
            common = np.ones(wanted)
        else:
            values, vectors, common = follow(solid, squares[-1], shapes, values, vectors)
        shapes = vectors
        squares.append(values)
        mac.append(common)
        largest.append(float(solid.largest(solid.equilibrium[:, None])[0]))
        changes.append(change)
        shown = ", ".join(f"{np.sqrt(max(v, 0.0)) / (2.0 * np.pi):.4g}" for v in values[:count])
        say(f"{speed:g} rpm: {shown} Hz")
    reached = speeds[: len(squares)]
    kept = np.array(squares)[:, :count]
    found = Campbell(
        scene,
        reached,
        kept,
        np.array(mac)[:, :count],
        np.array(largest),
        critical_speeds(reached, kept, scene),
        max(changes) if rotation.coriolis else None,
        solid.free,
        clock.perf_counter() - begin,
        list(solid.warnings),
        unfinished,
    )
    found.warnings += _doubts(found)
    return found


def speeds_rpm(scene: Scene) -> Array:
    """The speeds of a scene's Campbell diagram.

    Raises:
        SceneError: there is no rotation, or no speed.
    """
    if scene.rotation is None:
        raise SceneError(
            f"{scene.source}: rotation is missing: must be a table with the axis for a Campbell diagram"
        )
    if scene.campbell.speeds_rpm is not None:
        return np.array(scene.campbell.speeds_rpm)
    if not scene.rotation.speed_rpm > 0.0:
        missing = "must be speeds, as rotation.speed_rpm is not above 0"
        raise SceneError(f"{scene.source}: campbell.speeds_rpm is missing: {missing}")
    return np.linspace(0.0, scene.rotation.speed_rpm, 13)


def _doubts(found: Campbell) -> list[str]:
    """Sentences on modes that were lost or unstable."""
    doubts = []
    for mode in range(found.squares.shape[1]):
        lost = np.flatnonzero(found.mac[:, mode] < LEAST_MAC)
        if lost.size:
            k = int(lost[0])
            doubts.append(
                f"mode {mode + 1} was lost between {found.speeds_rpm[k - 1]:g} and {found.speeds_rpm[k]:g} rpm "
                f"(MAC {found.mac[k, mode]:.2f}): take speeds that are closer together"
            )
        unstable = np.flatnonzero(found.squares[:, mode] <= 0.0)
        if unstable.size:
            doubts.append(
                f"mode {mode + 1} has omega^2 <= 0 at {found.speeds_rpm[unstable[0]]:g} rpm: unstable"
            )
    return doubts


# ---------------------------------------------------------------------- modes


def modes_at_speed(solid: Solid, count: int) -> tuple[Array, Shapes, float]:
    """The lowest modes about the present equilibrium, complex if the scene asks for the Coriolis
    force.

    Args:
        solid: the body at speed.
        count: number of modes.

    Returns:
        omega^2 (count,), ascending, shapes (local, count) of unit modal mass, and the last relative
        change of the frequencies with the Coriolis force.

    Raises:
        ConvergenceError: the complex frequencies did not settle within `COMPLEX_ROUNDS`, or the
            equilibrium is unstable.
    """
    squares, normal = solid.eigenmodes(solid.factor, count)
    if solid.gyroscopic is None:
        return squares, normal, 0.0
    space = normal
    previous = np.sqrt(np.maximum(squares, 0.0))
    for _ in range(COMPLEX_ROUNDS):
        omega, z = _state_space_modes(solid, space, count)
        shapes = space @ z
        change = float(np.max(np.abs(omega - previous) / omega))
        if change <= COMPLEX_TOLERANCE or space.shape[1] >= solid.free:
            mass = _hermitian(solid, shapes, shapes)
            return omega**2, shapes / np.sqrt(np.diag(mass).real), change
        previous = omega
        new = [  # real and imaginary part of the residuals
            solid.stiffness_times(a)
            - omega**2 * solid.mass_times(a)
            - omega * solid.gyroscopic_times(b)
            for a, b in ((shapes.real, shapes.imag), (shapes.imag, -shapes.real))
        ]
        space = _extended(solid, space, solid.factor.solve(np.concatenate(new, axis=1)))
    raise ConvergenceError(
        f"complex modes: the frequencies still change by {change:.1e} after {COMPLEX_ROUNDS} rounds, more than "
        f"{COMPLEX_TOLERANCE:.0e}"
    )


def _state_space_modes(solid: Solid, space: Array, count: int) -> tuple[Array, Shapes]:
    """Frequencies (count,), rad/s, and coordinates (k, count) of the complex modes within a space
    (local, k), M-orthonormal.

    With K = L L^T the state (L^T q, dq/dt) obeys a skew matrix: times i it is Hermitian, its
    eigenvalues come in pairs +-omega.
    """
    k = space.shape[1]
    try:
        lower = np.linalg.cholesky(solid.inner(space, solid.stiffness_times(space)))
    except np.linalg.LinAlgError:
        raise ConvergenceError("complex modes: the equilibrium is unstable") from None
    skew = np.block([[np.zeros((k, k)), lower.T], [-lower, -projected_gyroscopic(solid, space)]])
    values, vectors = np.linalg.eigh(-1j * skew)
    return values[k : k + count], vectors[k:, k : k + count]


def _extended(solid: Solid, space: Array, vectors: Array) -> Array:
    """An M-orthonormal space with more vectors in it; those within it already are left out."""
    sizes = np.sqrt(np.diag(solid.mass_inner(vectors, vectors)))
    vectors = vectors[:, sizes > 0.0] / sizes[sizes > 0.0]
    for _ in range(2):  # the second pass removes what rounding left
        vectors = vectors - space @ solid.mass_inner(space, vectors)
    values, turn = np.linalg.eigh(solid.mass_inner(vectors, vectors))
    keep = values > DEPENDENCE**2
    added = vectors @ (turn[:, keep] / np.sqrt(values[keep]))
    added = added - space @ solid.mass_inner(space, added)
    lower = np.linalg.cholesky(solid.mass_inner(added, added))
    return np.concatenate([space, np.linalg.solve(lower, added.T).T], axis=1)


def _hermitian(solid: Solid, a: Shapes, b: Shapes) -> Shapes:
    """a^H M b of real or complex blocks (local, k) and (local, l)."""
    if not (np.iscomplexobj(a) or np.iscomplexobj(b)):
        return solid.mass_inner(a, b)
    parts = [np.concatenate([block.real, block.imag], axis=1) for block in (a, b)]
    k, n = a.shape[1], b.shape[1]
    inner = solid.mass_inner(*parts)
    return inner[:k, :n] + inner[k:, n:] + 1j * (inner[:k, n:] - inner[k:, :n])


# ---------------------------------------------------------------------- following


def follow(
    solid: Solid, before: Array, shapes: Shapes, squares: Array, vectors: Shapes
) -> tuple[Array, Shapes, Array]:
    """Put the modes of a speed in the order of those of the speed before.

    Args:
        solid: the body.
        before: (m,) omega^2 there.
        shapes: (local, m) their shapes, of unit modal mass.
        squares: (m,) omega^2 here, ascending.
        vectors: (local, m) their shapes, of unit modal mass.

    Returns:
        omega^2 and shapes in the order of `shapes`, and the MAC of each pair (m,).
    """
    common = _hermitian(solid, shapes, vectors)
    vectors = vectors @ facing(common, squares)  # first: these shapes are kept
    common = _hermitian(solid, shapes, vectors)
    common = facing(common.conj().T, before).conj().T @ common
    mac = np.abs(common) ** 2
    rows, columns = linear_sum_assignment(-mac)
    order = columns[np.argsort(rows)]
    return squares[order], vectors[:, order], np.minimum(mac[np.arange(order.size), order], 1.0)


def facing(common: Shapes, squares: Array) -> Shapes:
    """How to turn modes of one frequency among themselves to face others.

    Args:
        common: (k, m) inner products of the others with the modes.
        squares: (m,) omega^2 of the modes.

    Returns:
        (m, m) unitary: the modes times this are turned.
    """
    turn = np.eye(squares.size, dtype=common.dtype)
    omega = np.sqrt(np.abs(squares))
    order = np.argsort(squares)
    for part in close_frequency_groups(omega[order], DEGENERATE):
        group = order[part]
        if group.size > 1:
            rows = np.sort(np.argsort(-np.sum(np.abs(common[:, group]) ** 2, axis=1))[: group.size])
            u, _, vh = np.linalg.svd(common[np.ix_(rows, group)])
            turn[np.ix_(group, group)] = (u @ vh).conj().T
    return turn


def critical_speeds(speeds: Array, squares: Array, scene: Scene) -> list[Critical]:
    """Where the engine orders meet the modes, by interpolation between the speeds, in the order of
    the speeds.
    """
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


# ---------------------------------------------------------------------- files


def summary(found: Campbell) -> dict[str, Any]:
    """The contents of `campbell.json`."""
    rotation = found.scene.rotation
    assert rotation is not None
    return {
        "scene": found.scene.source,
        "dofs": found.unknowns,
        "coriolis": rotation.coriolis,
        "speeds_rpm": found.speeds_rpm,
        "frequencies_hz": found.frequencies_hz,
        "mac": found.mac,
        "largest_displacement_m": found.largest,
        "engine_orders": list(found.scene.campbell.engine_orders),
        "critical_speeds": [vars(item) for item in found.critical],
        "complex_change": found.change,
        "seconds": found.seconds,
        "unfinished": str(found.unfinished) if found.unfinished else None,
        "warnings": found.warnings,
        "provenance": provenance(),
    }


def frequency_table(found: Campbell) -> list[list[Any]]:
    """Frequencies against speed, the head first."""
    head = ["rpm", *(f"mode {k + 1} Hz" for k in range(found.squares.shape[1]))]
    rows = zip(found.speeds_rpm, found.frequencies_hz, strict=True)
    return [head, *([f"{speed:.6g}", *(f"{value:.5g}" for value in line)] for speed, line in rows)]


def critical_table(found: Campbell) -> list[list[Any]]:
    """The critical speeds, the head first."""
    rows = [
        [item.order, item.mode, f"{item.speed_rpm:.5g}", f"{item.frequency_hz:.5g}"]
        for item in found.critical
    ]
    return [["engine order", "mode", "rpm", "Hz"], *rows]


def sentences(found: Campbell) -> list[str]:
    """What was found, for the terminal and the report."""
    speeds, modes = found.speeds_rpm, found.squares.shape[1]
    orders = ", ".join(map(str, found.scene.campbell.engine_orders))
    lines = [
        f"{modes} modes at {speeds.size} speeds from {speeds[0]:g} to {speeds[-1]:g} rpm; the body gives way by up to "
        f"{1e3 * found.largest.max():.3g} mm.",
        f"Engine orders {orders} meet them at {len(found.critical)} speeds.",
    ]
    if speeds.size > 1:
        k, mode = np.unravel_index(np.argmin(found.mac), found.mac.shape)
        lines.append(
            f"Modes were followed by their shapes: the least alike from speed to speed is mode {mode + 1} at {speeds[k]:g} rpm, "
            f"MAC {found.mac[k, mode]:.2f}."
        )
    if found.change is not None:
        lines.append(
            f"With the Coriolis force; frequencies settled to {found.change:.1e} in the space of complex modes."
        )
    if found.unfinished:
        lines.append(f"It stopped there: {found.unfinished}")
    return lines


@styled
def figure(found: Campbell) -> Figure:
    """Frequencies by mode and engine-order lines against the speed, critical speeds marked."""
    drawn = new_figure(9.0, 5.6)
    axis = drawn.subplots()
    speeds, frequencies = found.speeds_rpm, found.frequencies_hz
    top = 1.08 * float(frequencies.max(initial=1.0))
    right = float(speeds[-1]) if speeds[-1] > 0.0 else 1.0
    for order in found.scene.campbell.engine_orders:
        end = min(right, 60.0 * top / order)
        axis.plot([0.0, end], [0.0, order * end / 60.0], color="#A6ABB0", linewidth=1.0, zorder=1)
        beside = end >= right
        axis.annotate(
            f"EO {order}",
            (end, order * end / 60.0),
            (3, 0) if beside else (0, 3),
            textcoords="offset points",
            fontsize=9,
            color="#5b636b",
            ha="left" if beside else "center",
            va="center" if beside else "bottom",
            annotation_clip=False,
        )
    for mode in range(frequencies.shape[1]):
        colour = COLOURS[mode % len(COLOURS)]
        style = ("-", "--", ":")[mode // len(COLOURS) % 3]
        look: dict[str, Any] = {"color": colour, "marker": "o", "markersize": 2.5, "zorder": 2}
        axis.plot(speeds, frequencies[:, mode], style, label=f"mode {mode + 1}", **look)
    for item in found.critical:
        axis.plot(
            item.speed_rpm,
            item.frequency_hz,
            "o",
            color="black",
            markerfacecolor="white",
            markersize=6,
            zorder=3,
        )
    axis.set(xlabel="speed, rpm", ylabel="frequency, Hz", xlim=(0.0, right), ylim=(0.0, top))
    drawn.legend(loc="outside upper center", ncols=min(frequencies.shape[1], 6))
    return drawn


def write(found: Campbell, folder: Path) -> list[Path]:
    """Write `campbell.csv`, `campbell.json`, `report.html` and `campbell.png`.

    Returns:
        The files, the one to open first at the head.

    Raises:
        OSError: a file cannot be written.
    """
    modes = found.squares.shape[1]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            "speed_rpm",
            *(f"mode_{k + 1}_hz" for k in range(modes)),
            *(f"mode_{k + 1}_mac" for k in range(modes)),
        ]
    )
    for row in np.column_stack([found.speeds_rpm, found.frequencies_hz, found.mac]):
        writer.writerow([repr(float(value)) for value in row])
    _write_text(folder / "campbell.csv", text.getvalue())
    write_summary(folder / "campbell.json", summary(found))
    pictures = []
    if found.scene.output.pictures:
        pictures = [write_figure(folder / "campbell.png", figure(found))]
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(found), *map("Warning: {}".format, found.warnings)])
    ]
    sections += [("Campbell diagram", [path]) for path in pictures]
    if found.critical:
        sections.append(("Critical speeds", [critical_table(found)]))
    sections.append(("Frequencies", [frequency_table(found)]))
    title = f"{found.scene.title or found.scene.source}: Campbell diagram"
    _write_text(folder / "report.html", html_report(title, sections))
    return [folder / "report.html", folder / "campbell.json", folder / "campbell.csv", *pictures]


def _write_text(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def terminal(found: Campbell) -> str:
    """The tables and the sentences, for the terminal."""
    tables = [
        text_table(frequency_table(found)),
        *([text_table(critical_table(found))] if found.critical else []),
    ]
    return "\n\n".join([*tables, "\n".join(sentences(found))])
