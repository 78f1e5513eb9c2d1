"""The report of a Campbell diagram: tables, picture and files."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.campbell import Campbell
from fenicsrom.notes import CRITICAL, FREQUENCIES
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS, EDGE
from fenicsrom.post.base.tables import Quantity, components, rows_of, table_of
from fenicsrom.words import counted

SMOOTH = 201  # points of a curve between the computed frequencies
NAME_WIDTH, NAME_HEIGHT = 0.06, 0.035  # of the name of an engine order, relative to the axes


def summary(found: Campbell) -> dict[str, Any]:
    """What `campbell.json` has of a diagram."""
    rotation = found.scene.rotation
    assert rotation is not None
    return {
        "dofs": found.unknowns,
        "coriolis": rotation.coriolis,
        "speeds_rpm": found.speeds_rpm,
        "frequencies_Hz": found.frequencies_hz,
        "mac": found.mac,
        "largest_displacement_m": found.largest,
        "mode_names": found.names,
        "engine_orders": list(found.scene.campbell.engine_orders),
        "critical_speeds": rows_of(found.critical, critical_quantities(found)),
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


def quantities(found: Campbell) -> list[Quantity]:
    """What is told of each speed, by its number."""
    modes = range(1, found.squares.shape[1] + 1)
    hertz = components("mode_{}_Hz", lambda k: found.frequencies_hz[k], modes)
    return [
        Quantity("speed_rpm", lambda k: float(found.speeds_rpm[k]), "speed, rpm", 6),
        *(
            replace(one, head=f"mode {label}, Hz")
            for one, label in zip(hertz, found.labels, strict=True)
        ),
        *components("mode_{}_mac", lambda k: found.mac[k], modes),
    ]


def critical_quantities(found: Campbell) -> list[Quantity]:
    """What is told of each critical speed."""
    return [
        *(Quantity("mode"), Quantity("order", head="engine order")),
        Quantity("", lambda one: found.labels[one.mode - 1], "mode"),
        Quantity("speed_rpm", head="speed, rpm"),
        Quantity("frequency_Hz", "frequency_hz", "frequency, Hz"),
        Quantity("computed_Hz", "computed_hz", "frequency computed there, Hz"),
        *(Quantity("difference", head="difference, %", digits=2), Quantity("mac")),
    ]


def margin_table(found: Campbell) -> list[list[Any]]:
    """The margins at the speed of operation, if known; the first row is the header."""
    margins = found.margins
    if margins is None or found.operating_squares is None:
        return []
    hertz = np.sqrt(np.maximum(found.operating_squares, 0.0)) / (2.0 * np.pi)
    orders = found.scene.campbell.engine_orders
    shown = [
        Quantity("", lambda k: found.labels[k], "mode"),
        Quantity("", lambda k: float(hertz[k]), "frequency, Hz"),
        *components("", lambda k: margins[k], orders, "EO {}, %", 3),
    ]
    return table_of(range(len(found.labels)), shown)


def sentences(found: Campbell) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    speeds, modes = found.speeds_rpm, found.squares.shape[1]
    orders = ", ".join(map(str, found.scene.campbell.engine_orders))
    at = f"{speeds[0]:g} rpm"
    if speeds.size > 1:
        at = f"{speeds.size} speeds from {speeds[0]:g} to {speeds[-1]:g} rpm"
    lines = [
        f"{counted(modes, 'mode')} at {at}; largest displacement of the equilibrium "
        f"{1e3 * found.largest.max():.3g} mm."
    ]
    if speeds.size > 1:
        critical = counted(len(found.critical), "critical speed")
        lines.append(f"{critical} of the engine orders {orders}.")
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


def figure(found: Campbell) -> Plot:
    """Frequencies of the modes and lines of the engine orders against speed."""
    speeds, frequencies = found.speeds_rpm, found.frequencies_hz
    top = 1.08 * float(frequencies.max(initial=1.0))
    right = float(speeds[-1]) if speeds[-1] > 0.0 else 1.0
    items = order_lines(found, right, top)
    fine, curves = np.linspace(speeds[0], speeds[-1], SMOOTH), found.curves()
    for mode, label in enumerate(found.labels):
        look: dict[str, Any] = {"color": COLOURS[mode % len(COLOURS)], "label": f"mode {label}"}
        style = ("-", "--", ":")[mode // len(COLOURS) % 3]
        if curves:
            hertz = np.sqrt(np.maximum(curves[mode].at(fine), 0.0))
            items.append(Line(fine, hertz, style, **look))
        items.append(Line(speeds, frequencies[:, mode], "", marker="o", markersize=3.0, **look))
    items += critical_marks(found)
    if found.margins is not None and found.scene.rotation is not None:
        operating = np.full(2, found.scene.rotation.speed_rpm)
        items.append(Line(operating, None, "-.", EDGE, 1.0, label="operation"))
    ends: Any = {"xlim": (0.0, right), "ylim": (0.0, top)}
    return Plot([Panel(items, "speed, rpm", "frequency, Hz", **ends)], 9.0, 5.8)


def critical_marks(found: Campbell) -> list[Item]:
    """The marks of the critical speeds."""
    items: list[Item] = []
    for name, marker, confirmed in (
        ("critical speed", "o", True),
        ("critical speed, not confirmed", "x", False),
    ):
        if chosen := [item for item in found.critical if item.confirmed is confirmed]:
            places = [item.speed_rpm for item in chosen], [item.frequency_hz for item in chosen]
            look: dict[str, Any] = {
                "marker": marker,
                "markersize": 6.0,
                "hollow": True,
                "zorder": 3.0,
            }
            items.append(Line(*places, "", "black", label=name, **look))
    return items


def order_lines(found: Campbell, right: float, top: float) -> list[Item]:
    """The lines of the engine orders with their names at their ends.

    A name that would overlap the one before it is left out.
    """
    taken = (np.inf, np.inf)  # end of the last line with a name
    items: list[Item] = []
    for order in sorted(found.scene.campbell.engine_orders):
        end = min(right, 60.0 * top / order)
        height = order * end / 60.0
        items.append(Line([0.0, end], [0.0, height], "-", "#A6ABB0", 1.0, zorder=1.0))
        apart = abs(end - taken[0]) / right, abs(height - taken[1]) / top
        if apart[0] < NAME_WIDTH and apart[1] < NAME_HEIGHT:
            continue
        taken = end, height
        x, y = end / right, height / top
        beside: dict[str, Any] = {"shift": (3.0, 0.0)}
        above: dict[str, Any] = {"shift": (0.0, 3.0), "ha": "center", "va": "bottom"}
        look = beside if end >= right else above
        items.append(Text(x * (1.0 + 1e-6), y, f"EO {order}", "xy", **look))
    return items


def report(found: Campbell, more: Sequence[Picture] = ()) -> Report:
    """The report of a Campbell diagram: `campbell.csv`, `campbell.json` and `campbell.png`.

    Args:
        found: the diagram.
        more: other pictures.
    """
    shown, criticals = quantities(found), critical_quantities(found)
    speeds = range(found.speeds_rpm.size)
    sections = [
        Section("Critical speeds", [table_of(found.critical, criticals)], keys=2),
        Section("Margins at the speed of operation", [margin_table(found)]),
        Section("Frequencies", [table_of(speeds, shown)]),
    ]
    title = "Campbell diagram"
    drawn = Picture(title, "campbell.png", lambda: figure(found), CAPTION, "campbell.csv")
    return Report(
        "campbell",
        title=title,
        found=found,
        sentences=sentences(found),
        sections=sections,
        rows=rows_of(speeds, shown),
        summary=summary(found),
        pictures=[drawn, *more],
        quantities=[FREQUENCIES, CRITICAL],
    )


CAPTION = (
    "Natural frequencies over the speed. Where an engine order crosses a frequency, the mode can "
    "resonate."
)
