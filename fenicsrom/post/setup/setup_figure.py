"""The picture of the set-up: the undeformed mesh with all that acts on it.

The axis of rotation and round walls are often much larger than the body: a second panel then shows
all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import styled
from fenicsrom.post.body.body_surface import (
    NODE,
    areas,
    cell_edges,
    faces_on,
    form_edges,
    surface_of,
)
from fenicsrom.post.body.body_view import View, frame_of, view_of
from fenicsrom.post.body.rendering import body_figure, drawn_lines, painted, show, write_names
from fenicsrom.post.paraview.vtk_files import Grid
from fenicsrom.post.setup.setup_marks import CLAMPED, Mark
from fenicsrom.post.setup.setup_symbols import (
    COLOURS,
    LOADED,
    REACH,
    load_tips,
    region_parts,
    surroundings,
    symbols,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import PolyData

OVERVIEW = 0.32
"""Width of the second panel, relative to the picture of the body."""


@styled
def setup_figure(grid: Grid, marks: Sequence[Mark], title: str, view: View | None = None) -> Figure:
    """Draw the undeformed body with its supports, loads, attachments, contacts and probe.

    Several loads and contact points have numbers. The projection is that of `setup_view` by
    default.
    """
    surface = surface_of(grid)
    view = view or setup_view(surface, marks)
    drawn = symbols(marks, grid.points, view.length)
    places = [surface.points, *(part.mesh.points for part in drawn)]
    low, high = frame_of(view, places)
    body = [*region_parts(surface, marks), drawn_lines(form_edges(surface))]
    body += [drawn_lines(cell_edges(grid), "#8C949B", 1.0), *drawn]
    around = surroundings(marks, grid.points)

    handles = _legend_handles(marks)
    columns = 2 if len(handles) > 3 else len(handles)
    rows = -(-len(handles) // max(columns, 1))
    spare = 0.6 + 0.21 * (rows + title.count("\n"))
    figure, axis, wide = body_figure([*body, *around], view, low, high, spare)
    write_names(axis, _numbers(marks, view, (high[0] - low[0]) / (72.0 * wide)), wide)
    reach = [part.mesh.points for part in around]
    if any(np.any((seen < low) | (seen > high)) for seen in map(view.project, reach)):
        far = replace(view, length=float(np.ptp(np.concatenate(reach), axis=0).max()))
        layout: Any = figure.get_layout_engine()
        layout.set(rect=(0.0, 0.0, 1.0 / (1.04 + OVERVIEW), 1.0))  # it does not know the panel
        figure.set_figwidth(figure.get_figwidth() * (1.04 + OVERVIEW))
        panel = axis.inset_axes((1.02, 0.0, OVERVIEW, 1.0))
        show(
            panel,
            [painted(surface), *around],
            far,
            *frame_of(far, [*places, *reach]),
            OVERVIEW * wide,
        )
    figure.suptitle(title, x=0.005, ha="left", fontsize=11)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure


def setup_view(surface: PolyData, marks: Sequence[Mark], moved: Array | None = None) -> View:
    """The projection of a body in its set-up and its motions.

    The viewer sees the side on which the loads act, and looks across the displacement `moved`
    (3,) if it is given.
    """
    sizes, facing = areas(surface), np.zeros(3)
    for load in (mark for mark in marks if mark.kind == "load" and mark.on.any()):
        facing += sizes[faces_on(surface, load.on[surface.point_data[NODE]])].sum(axis=0)
    return view_of(surface, facing, moved=moved)


def _legend_handles(marks: Sequence[Mark]) -> list[Any]:
    """The entries of the legend: the loaded regions, each label once, and round walls."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    for mark in {mark.label: mark for mark in marks}.values():
        look: dict[str, Any] = {"color": COLOURS[mark.kind], "label": mark.label}
        if mark.label == CLAMPED:
            handles.append(Patch(**look))
            continue
        look |= {"marker": mark.marker, "markersize": 13.0 if "$" in mark.marker else 7.0}
        handles.append(Line2D([], [], linestyle="none", **look))
    if any(mark.kind == "load" and mark.on.any() for mark in marks):
        handles.append(Patch(color=LOADED, label="loaded region"))
    if any(mark.wall is not None for mark in marks):
        handles.append(Patch(color=COLOURS["contact"], alpha=0.35, label="round wall"))
    return handles


def _numbers(marks: Sequence[Mark], view: View, point: float) -> Iterator[tuple[str, Array, str]]:
    """The numbers of several loads and contact points, with their places and colours.

    The argument `point` is the length of a typographic point in the picture, m.
    """
    loads = [mark for mark in marks if mark.kind == "load"]
    contacts = [mark for mark in marks if mark.kind == "contact"]
    reach = REACH * view.length
    rows = [
        ("load", number, tip - reach * way, -way)
        for number, (load, tips) in enumerate(zip(loads, load_tips(loads, reach), strict=True), 1)
        for way in load.ways
        for tip in tips
        if len(loads) > 1
    ]
    points = [pair for mark in contacts for pair in zip(mark.places, -mark.ways, strict=True)]
    found = [("contact", number, *pair) for number, pair in enumerate(points, 1) if points[1:]]
    for kind, number, place, step in rows + found[-1:] + found[:-1]:
        at, way = view.project(place), view.project(step)
        size = float(np.linalg.norm(way))
        away = way / size if size > 1e-9 else np.array([0.0, -1.0])
        yield str(number), at + 11.0 * point * away, COLOURS[kind]
