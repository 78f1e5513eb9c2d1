"""The report of the modes of a disk: tables, interference diagram, shapes and files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.campbell import Campbell, hertz
from fenicsrom.assess.rotation.disk_modes import LETTERS
from fenicsrom.files import atomic_write
from fenicsrom.notes import CRITICAL, FREQUENCIES
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import table_of
from fenicsrom.post.body.body_figures import shape_figure
from fenicsrom.post.body.body_view import faces_on, gathered_grid, surface_of
from fenicsrom.post.paraview.vtk import Attached, Grid, write_vtu
from fenicsrom.post.studies.campbell_report import (
    critical_marks,
    critical_quantities,
    five_digits,
    order_lines,
    sentences,
    summary,
)
from fenicsrom.words import counted

if TYPE_CHECKING:
    from pyvista import PolyData

NEAR = 0.3
"""Margins up to this size stand in the table."""

LOOKS = {0: ("-", "o", ""), 1: ("-", "^", ", forward"), -1: ("--", "v", ", backward")}
"""Style, mark and name of the lines of modes that run either way."""

CLOSE = 0.1
"""Margins up to this size are written into the interference diagram."""

SHAPES = 5
"""Number of shapes in the picture."""

CUT, CUTS = "cut", (1.0, 2.0)
"""The point array with the marks of the cut faces, and these marks."""

SEAM = 1e-6
"""Points of neighbouring sectors are one point if their distance, relative to the disk, is less."""

TRIANGLE = 5
"""VTK's number of a triangle."""

WRITTEN = 2
"""Number of modes of each nodal diameter in the ParaView file."""


def wave_table(found: Campbell, values: Array, state: str = "") -> list[list[Any]]:
    """Frequencies (w,) of the waves by nodal diameter; the heads name the state of contacts."""
    rows: dict[int, list[Any]] = {wave.diameter: [wave.diameter] for wave in found.waves}
    for k in np.argsort(values, kind="stable"):
        wave = found.waves[k]
        way = "" if state else LETTERS[wave.direction]
        rows[wave.diameter].append(f"{five_digits(values[k])} {way}".rstrip())
    most = max(map(len, rows.values()))
    head = ["nodal diameter", *(f"{state}mode {k + 1} Hz" for k in range(most - 1))]
    return [head, *(row + [""] * (most - len(row)) for row in rows.values())]


def margin_table(found: Campbell) -> list[list[Any]]:
    """The smallest margins at the speed of operation, up to `NEAR`."""
    if found.margins is None or found.operating_squares is None:
        return []
    values, orders = hertz(found.operating_squares), found.scene.campbell.engine_orders
    sizes = np.abs(found.margins)
    near = [
        divmod(int(at), len(orders))
        for at in np.argsort(sizes, axis=None)
        if sizes.flat[at] <= NEAR
    ]
    return table_of(
        {
            "mode": found.labels[mode],
            "Hz": five_digits(values[mode]),
            "engine order": orders[k],
            "margin %": f"{100.0 * found.margins[mode, k]:+.1f}",
        }
        for mode, k in near
    )


def rows_of(found: Campbell) -> Iterator[dict[str, Any]]:
    """The rows of the CSV file: one for each speed and mode."""
    for (s, mode), value in np.ndenumerate(found.frequencies_hz):
        wave = found.waves[mode]
        yield {
            "speed_rpm": float(found.speeds_rpm[s]),
            "nodal_diameter": wave.diameter,
            "mode": wave.number,
            "direction": wave.direction,
            "frequency_Hz": float(value),
            "mac": float(found.mac[s, mode]),
        }


def interference_figure(found: Campbell) -> Plot:
    """Frequencies over the nodal diameter, with the engine orders at the speed of operation.

    The modes of each diameter are numbered in ascending order at this speed.
    """
    values = found.frequencies_hz[-1]
    if found.operating_squares is not None:
        values = hertz(found.operating_squares)
    ways = sorted({wave.direction for wave in found.waves if wave.direction}) or [0]
    items: list[Item] = []
    for number in range(max(wave.number for wave in found.waves)):
        for way in ways:
            own = [(h, rows[number]) for h, rows in _ranked(found, values, way) if rows[number:]]
            style, marker, word = LOOKS[way]
            look: dict[str, Any] = {"marker": marker, "markersize": 4.0}
            look |= {"color": COLOURS[number % len(COLOURS)], "label": f"mode {number + 1}{word}"}
            items.append(Line([h for h, _ in own], [f for _, f in own], style, **look))
    top = 1.08 * float(values.max(initial=1.0))
    if found.margins is not None:
        items += _folded_line(found, found.margins, top)
    marks = {float(h): f"{h}" for h in _diameters(found)}
    labels = "nodal diameter", "frequency, Hz"
    return Plot([Panel(items, *labels, ylim=(0.0, top), xticks=marks)], 8.0, 5.4)


def _ranked(found: Campbell, values: Array, way: int) -> Iterator[tuple[int, list[float]]]:
    """Each nodal diameter with the ascending frequencies (w,) of its waves that run one way."""
    for h in _diameters(found):
        both = zip(found.waves, values, strict=True)
        yield h, sorted(f for w, f in both if w.diameter == h and w.direction in (0, way))


def _folded_line(found: Campbell, margins: Array, top: float) -> list[Item]:
    """The line k Ω over the nodal diameter that engine order k excites, with the margins on it."""
    rotation, n = found.scene.rotation, found.waves[0].sectors
    assert rotation is not None
    turn = rotation.speed_rpm / 60.0
    orders = np.arange(int(top / turn) + 2)
    corners = np.unique([0, *orders[np.isin(orders % n, (0, n // 2, -(-n // 2)))], orders[-1]])
    fold = np.minimum(corners % n, -corners % n)
    name = "engine orders (margin)"
    items: list[Item] = [Line(fold, corners * turn, "-", "#A6ABB0", 1.0, label=name, zorder=1.0)]
    for k, order in enumerate(found.scene.campbell.engine_orders):
        h = min(order % n, -order % n)
        if order * turn > top or h not in _diameters(found):
            continue
        look: dict[str, Any] = {"marker": "s", "markersize": 4.0, "zorder": 3.0}
        items.append(Line([h], [order * turn], "", "black", **look))
        close = margins[np.abs(margins[:, k]) <= CLOSE, k]
        text = str(order)
        if close.size:
            text += f" ({100.0 * close[np.argmin(np.abs(close))]:+.1f} %)"
        items.append(Text(h, order * turn, text, shift=(5.0, 0.0), color="black"))
    return items


def speed_figure(found: Campbell) -> Plot:
    """Frequencies against speed, coloured by the nodal diameter, with the critical speeds."""
    top = 1.08 * float(found.frequencies_hz.max(initial=1.0))
    right = float(found.speeds_rpm[-1]) or 1.0
    items = order_lines(found, right, top)
    for k, h in enumerate(_diameters(found)):
        look: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)]}
        look |= {"label": counted(h, "nodal diameter"), "linewidth": 1.0 + k // len(COLOURS)}
        look |= {"zorder": 2.0 - 0.1 * (k // len(COLOURS))}  # thick lines below thin ones
        own = [j for j, wave in enumerate(found.waves) if wave.diameter == h]
        for j in sorted(own, key=lambda j: -found.waves[j].direction):  # the legend shows the first
            style = "--" if found.waves[j].direction < 0 else "-"
            items.append(Line(found.speeds_rpm, found.frequencies_hz[:, j], style, **look))
    if any(wave.direction < 0 for wave in found.waves):
        items.append(Line(linestyle="--", color="#5F6368", label="against the rotation"))
    items += critical_marks(found)
    ends: Any = {"xlim": (0.0, right), "ylim": (0.0, top)}
    return Plot([Panel(items, "speed, rpm", "frequency, Hz", **ends)], 9.0, 5.8)


def whole_disk(found: Campbell, modes: Sequence[int]) -> PolyData | None:
    """The surface of the disk with the displacements of some modes by their labels. Collective.

    Each is that of the instant at which a node of the first sector moves most.

    Returns:
        The surface; None on ranks other than the first.
    """
    import pyvista

    body, waves = found.body, found.waves
    assert body is not None and body.cut is not None and found.shapes is not None
    fields = {CUT: body.field(np.repeat(body.cut.marks, body.dimension))}
    for mode in modes:
        shape = found.shapes[:, mode]
        peaks = body.comm.allgather(complex(max(shape, key=abs, default=0.0)))
        shape = shape / max(peaks, key=abs)
        for part in ("real", "imag"):
            fields[f"{mode} {part}"] = body.field(np.ascontiguousarray(getattr(shape, part)))
    gathered = gathered_grid(body.space, fields)
    if gathered is None:
        return None
    surface = surface_of(*gathered)
    outside = ~np.any([faces_on(surface, surface.point_data[CUT][:, 0] == k) for k in CUTS], axis=0)
    triangles, count = surface.regular_faces[outside], surface.n_points
    copies = range(waves[0].sectors)
    turns = [body.cut.rotation(2.0 * np.pi / len(copies) * j) for j in copies]
    points = np.concatenate([body.cut.turned(surface.points, turn) for turn in turns])
    whole = pyvista.PolyData.from_regular_faces(
        points, np.concatenate([triangles + j * count for j in copies])
    )
    for mode in modes:
        real, imaginary = (surface.point_data[f"{mode} {part}"] for part in ("real", "imag"))
        step = 2j * np.pi * waves[mode].lag * waves[mode].diameter / len(copies)
        parts = [(np.exp(step * j) * (real + 1j * imaginary)).real @ turns[j].T for j in copies]
        whole.point_data[found.labels[mode]] = np.concatenate(parts)
    return whole.clean(tolerance=SEAM)


def write_disk(found: Campbell, folder: Path) -> list[Path]:
    """Write `disk.vtu`: the lowest modes of each nodal diameter on the disk. Collective.

    Raises:
        OSError: the file cannot be written.
    """
    values = found.frequencies_hz[-1]
    modes = [k for k, wave in enumerate(found.waves) if wave.number <= WRITTEN]
    disk = whole_disk(found, modes)
    if disk is None:
        return []
    arrays: dict[str, Any] = {
        f"{found.labels[mode]} {values[mode]:.5g} Hz": np.float32(
            disk.point_data[found.labels[mode]]
        )
        for mode in modes
    }
    with atomic_write(folder / "disk.vtu") as temporary:
        write_vtu(temporary, Grid(disk.points, disk.regular_faces, TRIANGLE), Attached(arrays))
    return [folder / "disk.vtu"]


def shape_picture(found: Campbell) -> list[Picture]:
    """The picture of the lowest mode of some nodal diameters on the disk. Collective."""
    values, of = found.frequencies_hz[-1], [wave.diameter for wave in found.waves]
    lowest = [of.index(h) for h in _diameters(found)[:SHAPES]]
    disk = whole_disk(found, lowest)
    if disk is None:
        return []
    titles = {found.labels[mode]: f"{found.labels[mode]}  {values[mode]:.5g} Hz" for mode in lowest}
    return [Picture("Shapes", "shapes.png", lambda: shape_figure(disk, titles), in_space=True)]


def disk_report(found: Campbell, more: Sequence[Picture] = ()) -> Report:
    """The report of the modes of a disk: `modes.csv`, `.json` and pictures, or `campbell`'s.

    Args:
        found: the modes, at one speed or at several.
        more: other pictures.
    """
    several = found.speeds_rpm.size > 1
    lines = [
        f"The mesh is {found.body.cut.sentence}." if found.body and found.body.cut else "",
        *sentences(found),
    ]
    if found.body and (rigid := found.body.free_motions.shape[1]):
        lines.append(
            f"Nothing holds the disk: it has {counted(rigid, 'rigid motion')} of 0 or 1 nodal "
            "diameters, with 0 Hz at rest. As it turns, those across the axis have the frequency "
            "of the rotation."
        )
    if found.body and found.body.joint:
        pressing = found.body.pressing
        points = f"{counted(pressing.size, 'contact point')} in a sector"
        lines.append(
            f"Of {points}, {pressing.sum()} press in the equilibrium. These stick in the modes."
            if pressing.any()
            else f"None of {points} presses in the equilibrium: the modes are those without "
            "contact. A preload or a static load may press them together."
        )
    if any(wave.direction for wave in found.waves):
        lines.append("f: the wave runs with the rotation, b: against it, seen from the disk.")
    diagram = Picture(
        "Interference diagram", "interference.png", lambda: interference_figure(found)
    )
    over_speed = Picture("Campbell diagram", "campbell.png", lambda: speed_figure(found))
    opened = None if found.open_squares is None else hertz(found.open_squares)
    facts = summary(found) | {
        "sectors": found.waves[0].sectors,
        "frequencies_without_contact_between_sectors_Hz": opened,
        "nodal_diameters": [wave.diameter for wave in found.waves],
        "mode_numbers": [wave.number for wave in found.waves],
        "directions": [wave.direction for wave in found.waves],
    }
    by_diameter = wave_table(found, found.frequencies_hz[-1])
    open_table = [] if opened is None else wave_table(found, opened, "open, ")
    at_one_speed = Report(
        "modes",
        "Modes of a disk",
        found,
        [line for line in lines if line],
        [
            Section("Frequencies by nodal diameter", [by_diameter]),
            Section("Frequencies with open contacts between sectors", [open_table]),
            Section(
                "Critical speeds", [table_of(found.critical, critical_quantities(found))], keys=2
            ),
            Section("Smallest margins at the speed of operation", [margin_table(found)]),
        ],
        list(rows_of(found)),
        facts,
        [*([over_speed] if several else []), diagram, *more],
        quantities=[FREQUENCIES, CRITICAL],
    )
    title = "Campbell diagram of a disk"
    return replace(at_one_speed, name="campbell", title=title) if several else at_one_speed


def _diameters(found: Campbell) -> list[int]:
    """The nodal diameters, each once."""
    return list(dict.fromkeys(wave.diameter for wave in found.waves))
