"""The report of a Campbell diagram: tables, picture and files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.assess.campbell import Campbell
from fenicsrom.online.archive import provenance
from fenicsrom.post.html_page import write_report
from fenicsrom.post.pictures import Picture, draw_pictures
from fenicsrom.post.style import COLOURS, new_figure, styled
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_rows, write_summary
from fenicsrom.scene import scene_heading

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    """Frequencies against speed; the first row is the header."""
    head = ["rpm", *(f"mode {k + 1} Hz" for k in range(found.squares.shape[1]))]
    rows = zip(found.speeds_rpm, found.frequencies_hz, strict=True)
    return [head, *([f"{speed:.6g}", *(f"{value:.5g}" for value in line)] for speed, line in rows)]


def critical_table(found: Campbell) -> list[list[Any]]:
    """The critical speeds; the first row is the header."""
    rows = [
        [item.order, item.mode, f"{item.speed_rpm:.5g}", f"{item.frequency_hz:.5g}"]
        for item in found.critical
    ]
    return [["engine order", "mode", "rpm", "Hz"], *rows]


def sentences(found: Campbell) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    speeds, modes = found.speeds_rpm, found.squares.shape[1]
    orders = ", ".join(map(str, found.scene.campbell.engine_orders))
    lines = [
        f"{modes} modes at {speeds.size} speeds from {speeds[0]:g} to {speeds[-1]:g} rpm; largest "
        f"displacement of the equilibrium {1e3 * found.largest.max():.3g} mm.",
        f"Engine orders {orders} have {len(found.critical)} critical speeds.",
    ]
    if speeds.size > 1:
        k, mode = np.unravel_index(np.argmin(found.mac), found.mac.shape)
        lines.append(
            f"Modes were tracked by their shapes; the smallest MAC from speed to speed is "
            f"{found.mac[k, mode]:.2f}, of mode {mode + 1} at {speeds[k]:g} rpm."
        )
    if found.change is not None:
        lines.append(
            "The Coriolis force is included; the last relative change of the complex frequencies "
            f"is {found.change:.1e}."
        )
    if found.unfinished:
        lines.append(f"The computation stopped: {found.unfinished}")
    return lines


@styled
def figure(found: Campbell) -> Figure:
    """Frequencies of the modes and lines of the engine orders against speed."""
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
        The files; the first one is the file to open.

    Raises:
        OSError: a file cannot be written.
    """
    numbers = np.column_stack([found.speeds_rpm, found.frequencies_hz, found.mac])
    modes = range(1, found.squares.shape[1] + 1)
    columns = ["speed_rpm", *(f"mode_{k}_hz" for k in modes), *(f"mode_{k}_mac" for k in modes)]
    rows = [dict(zip(columns, map(float, row), strict=True)) for row in numbers]
    write_rows(folder / "campbell.csv", rows)
    write_summary(folder / "campbell.json", summary(found))
    pictures = []
    if found.scene.output.pictures:
        diagram = Picture("Campbell diagram", "campbell.png", lambda: figure(found))
        pictures = draw_pictures([diagram], folder, found.warnings)
        write_summary(folder / "campbell.json", summary(found))
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(found), *map("Warning: {}".format, found.warnings)])
    ]
    sections += [(name, [path]) for name, path in pictures]
    if found.critical:
        sections.append(("Critical speeds", [critical_table(found)]))
    sections.append(("Frequencies", [frequency_table(found)]))
    title = f"{scene_heading(found.scene)}: Campbell diagram"
    write_report(folder / "report.html", title, sections)
    names = ("report.html", "campbell.json", "campbell.csv")
    return [*(folder / name for name in names), *(path for _, path in pictures)]


def terminal(found: Campbell) -> str:
    """The tables and the sentences, for the terminal."""
    tables = [
        text_table(frequency_table(found)),
        *([text_table(critical_table(found))] if found.critical else []),
    ]
    return "\n\n".join([*tables, "\n".join(sentences(found))])
