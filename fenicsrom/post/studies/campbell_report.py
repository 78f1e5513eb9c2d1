"""The report of a Campbell diagram: tables, picture and files."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.campbell import Campbell
from fenicsrom.notes import CRITICAL, FREQUENCIES
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.style import COLOURS, Axes, Figure, new_panels, styled
from fenicsrom.post.base.tables import table_of
from fenicsrom.words import counted

SMOOTH = 201  # points of a curve between the computed frequencies
LEGEND_COLUMNS = 4
NAME_WIDTH, NAME_HEIGHT = 0.06, 0.035  # of the name of an engine order, relative to the axes


def summary(found: Campbell) -> dict[str, Any]:
    """What `campbell.json` has of a diagram."""
    rotation = found.scene.rotation
    assert rotation is not None
    return {
        "dofs": found.unknowns,
        "coriolis": rotation.coriolis,
        "speeds_rpm": found.speeds_rpm,
        "frequencies_hz": found.frequencies_hz,
        "mac": found.mac,
        "largest_displacement_m": found.largest,
        "mode_names": found.names,
        "engine_orders": list(found.scene.campbell.engine_orders),
        "critical_speeds": [vars(item) for item in found.critical],
        "operating_speed_rpm": rotation.speed_rpm if found.margins is not None else None,
        "margins": None if found.margins is None else _without_nan(found.margins),
        "complex_change": found.change,
    }


def _without_nan(margins: Array) -> list[list[float | None]]:
    """The margins, None where an engine order does not excite a mode."""
    return [[float(m) if np.isfinite(m) else None for m in row] for row in margins]


def five_digits(value: float) -> str:
    """A number with five significant digits; zeros at its end are kept."""
    return f"{value:#.5g}".rstrip(".")


def frequency_table(found: Campbell) -> list[list[Any]]:
    """Frequencies against speed; the first row is the header."""
    head = ["rpm", *(f"mode {label} Hz" for label in found.labels)]
    rows = zip(found.speeds_rpm, found.frequencies_hz, strict=True)
    return [head, *([f"{speed:.6g}", *(map(five_digits, line))] for speed, line in rows)]


def critical_table(found: Campbell) -> list[list[Any]]:
    """The critical speeds; empty if there are none."""
    return table_of(
        {
            "engine order": item.order,
            "mode": found.labels[item.mode - 1],
            "rpm": five_digits(item.speed_rpm),
            "Hz": five_digits(item.frequency_hz),
            "mode computed there Hz": item.computed_hz and five_digits(item.computed_hz),
            "difference %": None if item.difference is None else f"{100 * item.difference:.1e}",
        }
        for item in found.critical
    )


def margin_table(found: Campbell) -> list[list[Any]]:
    """The margins at the speed of operation, if known; the first row is the header."""
    if found.margins is None:
        return []
    assert found.operating_squares is not None
    orders = found.scene.campbell.engine_orders
    hertz = np.sqrt(np.maximum(found.operating_squares, 0.0)) / (2.0 * np.pi)
    rows = [
        [label, five_digits(value), *(f"{100 * margin:+.1f}" for margin in line)]
        for label, value, line in zip(found.labels, hertz, found.margins, strict=True)
    ]
    return [["mode", "Hz", *(f"EO {order} %" for order in orders)], *rows]


def sentences(found: Campbell) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    speeds, modes = found.speeds_rpm, found.squares.shape[1]
    orders = ", ".join(map(str, found.scene.campbell.engine_orders))
    lines = [
        f"{counted(modes, 'mode')} at {counted(speeds.size, 'speed')} from {speeds[0]:g} to "
        f"{speeds[-1]:g} rpm; largest displacement of the equilibrium "
        f"{1e3 * found.largest.max():.3g} mm.",
        f"{counted(len(found.critical), 'critical speed')} of the engine orders {orders}.",
    ]
    if found.names:
        lines.append(
            "Names by the motion of the tip at the first speed: F flap, E edge, T torsion, "
            "A axial, C chordwise bending."
        )
    margins = found.margins
    if margins is not None and np.isfinite(margins).any():
        mode, column = np.unravel_index(np.nanargmin(np.abs(margins)), margins.shape)
        rotation = found.scene.rotation
        assert rotation is not None
        lines.append(
            f"At {rotation.speed_rpm:g} rpm the smallest frequency margin is "
            f"{100 * margins[mode, column]:+.1f} %, of mode {found.labels[mode]} and engine order "
            f"{found.scene.campbell.engine_orders[column]}; margin = frequency / engine order - 1."
        )
    if speeds.size > 1:
        k, mode = np.unravel_index(np.argmin(found.mac), found.mac.shape)
        lines.append(
            f"Modes were tracked by their shapes; the smallest MAC from speed to speed is "
            f"{found.mac[k, mode]:.2f}, of mode {found.numbers[mode]} at {speeds[k]:g} rpm."
        )
    if found.change is not None:
        lines.append(
            "The Coriolis force is included; the last relative change of the complex frequencies "
            f"is {found.change:.1e}."
        )
    lines += filter(None, [found.mesh_check.sentence()])
    if found.unfinished:
        lines.append(f"The computation stopped: {found.unfinished}")
    return lines


@styled
def figure(found: Campbell) -> Figure:
    """Frequencies of the modes and lines of the engine orders against speed."""
    drawn, (axis,) = new_panels(9.0, 5.6)
    speeds, frequencies = found.speeds_rpm, found.frequencies_hz
    top = 1.08 * float(frequencies.max(initial=1.0))
    right = float(speeds[-1]) if speeds[-1] > 0.0 else 1.0
    draw_orders(axis, found, right, top)
    fine, curves = np.linspace(speeds[0], speeds[-1], SMOOTH), found.curves()
    for mode, label in enumerate(found.labels):
        colour = COLOURS[mode % len(COLOURS)]
        style = ("-", "--", ":")[mode // len(COLOURS) % 3]
        marks = axis.plot(speeds, frequencies[:, mode], "o", color=colour, markersize=3.0)
        named = marks
        if curves:
            hertz = np.sqrt(np.maximum(curves[mode].at(fine), 0.0))
            named = axis.plot(fine, hertz, style, color=colour)
        named[0].set_label(f"mode {label}")
    draw_critical(axis, found)
    if found.margins is not None and found.scene.rotation is not None:
        operating = found.scene.rotation.speed_rpm
        axis.axvline(operating, color="#555B61", linestyle="-.", linewidth=1.0, label="operation")
    axis.set(xlabel="speed, rpm", ylabel="frequency, Hz", xlim=(0.0, right), ylim=(0.0, top))
    drawn.legend(loc="outside upper center", ncols=LEGEND_COLUMNS)
    return drawn


def draw_critical(axis: Axes, found: Campbell) -> None:
    """Mark the critical speeds."""
    look: dict[str, Any] = {"linestyle": "none", "color": "black", "zorder": 3}
    for name, marker, confirmed in (
        ("critical speed", "o", True),
        ("critical speed, not confirmed", "x", False),
    ):
        chosen = [item for item in found.critical if item.confirmed is confirmed]
        if chosen:
            places = [item.speed_rpm for item in chosen], [item.frequency_hz for item in chosen]
            axis.plot(*places, marker, markerfacecolor="white", markersize=6, label=name, **look)


def draw_orders(axis: Axes, found: Campbell, right: float, top: float) -> None:
    """Draw the lines of the engine orders with their names at their ends.

    A name that would overlap the one before it is left out.
    """
    taken = (np.inf, np.inf)  # end of the last line with a name
    for order in sorted(found.scene.campbell.engine_orders):
        end = min(right, 60.0 * top / order)
        height = order * end / 60.0
        axis.plot([0.0, end], [0.0, height], color="#A6ABB0", linewidth=1.0, zorder=1)
        apart = abs(end - taken[0]) / right, abs(height - taken[1]) / top
        if apart[0] < NAME_WIDTH and apart[1] < NAME_HEIGHT:
            continue
        taken = end, height
        beside = end >= right
        axis.annotate(
            f"EO {order}",
            taken,
            (3, 0) if beside else (0, 3),
            textcoords="offset points",
            fontsize=9,
            color="#5b636b",
            ha="left" if beside else "center",
            va="center" if beside else "bottom",
            annotation_clip=False,
        )


def report(found: Campbell, more: Sequence[Picture] = ()) -> Report:
    """The report of a Campbell diagram: `campbell.csv`, `campbell.json` and `campbell.png`.

    Args:
        found: the diagram.
        more: other pictures.
    """
    numbers = np.column_stack([found.speeds_rpm, found.frequencies_hz, found.mac])
    modes = range(1, found.squares.shape[1] + 1)
    columns = ["speed_rpm", *(f"mode_{k}_hz" for k in modes), *(f"mode_{k}_mac" for k in modes)]
    return Report(
        "campbell",
        "Campbell diagram",
        found,
        sentences(found),
        [
            Section("Critical speeds", [critical_table(found)]),
            Section("Margins at the speed of operation", [margin_table(found)]),
            Section("Frequencies", [frequency_table(found)]),
        ],
        [dict(zip(columns, map(float, row), strict=True)) for row in numbers],
        summary(found),
        [Picture("Campbell diagram", "campbell.png", lambda: figure(found)), *more],
        quantities=[FREQUENCIES, CRITICAL],
    )
