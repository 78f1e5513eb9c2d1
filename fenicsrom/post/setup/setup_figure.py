"""The picture of the set-up: the undeformed mesh with all that acts on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import styled
from fenicsrom.post.body.body_drawing import GREY, body_panel, draw_body
from fenicsrom.post.body.body_surface import Surface, areas, normals
from fenicsrom.post.body.body_view import View, frame_of, view_of
from fenicsrom.post.setup.setup_marks import CLAMPED, Marks
from fenicsrom.post.setup.setup_surroundings import (
    draw_numbers,
    draw_overview,
    draw_surroundings,
    surroundings,
)
from fenicsrom.post.setup.setup_symbols import (
    REGION_COLOURS,
    attachment_symbols,
    bars,
    draw_arrows,
    draw_attachments,
    draw_bars,
    draw_contacts,
    draw_probe,
    legend_handles,
    load_arrows,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REACH = 0.14
"""Length of the arrow of a load, relative to the size of the body."""

LETTERS = 11.0
"""Letters of a legend in an inch."""

SYMBOL = 7
"""Width of a symbol in the legend with its margins, in letters."""

MOST_COLUMNS = 4
"""Largest number of columns of the legend."""


@styled
def setup_figure(surface: Surface, marks: Marks, title: str, view: View | None = None) -> Figure:
    """Draw the undeformed body with its supports, loads, attachments, contacts and probe.

    Several loads have numbers. The projection is that of `setup_view` by default.
    """
    view = view or setup_view(surface, marks)
    reach = REACH * view.length
    arrows = load_arrows(marks.loads, view, reach)
    held = [bars(mark, surface, view, 0.3 * reach) for mark in marks.supports]
    walls = [view.project(each.places + 0.5 * reach * each.normals) for each in marks.contacts]
    shafts = [np.array([arrow.start, 0.5 * (arrow.start + arrow.end)]) for arrow in arrows]
    bar_ends = [lines[:, 1] for lines in held]
    taken = np.concatenate([np.zeros((0, 2)), *shafts, *walls, *bar_ends])
    symbols = attachment_symbols(marks.attachments, view, 0.6 * reach, taken)
    drawn = [line for symbol in symbols for line in symbol.lines]
    every = np.concatenate([view.project(surface.points), taken, *drawn])
    low, high = frame_of([every], 0.05 * view.length)

    figure, axis = body_panel(
        view, low - [0.0, 0.13 * view.length], high, 0.6 + 0.2 * title.count("\n")
    )
    draw_body(axis, surface, view, None, _face_colours(surface, marks))
    _draw_wires(axis, surface, view)
    _draw_regions(axis, surface, view.project(surface.points), marks)
    for lines in held:
        draw_bars(axis, lines)
    draw_attachments(axis, symbols)
    draw_contacts(axis, view, marks.contacts, 0.5 * reach)
    draw_numbers(axis, view, marks.contacts)
    around = surroundings(marks, surface.points)
    draw_surroundings(axis, view, marks, around)
    draw_overview(figure, axis, surface, view, marks, around)
    occupied = np.concatenate([taken, *drawn])
    draw_arrows(axis, arrows, reach, len(marks.loads) > 1, occupied)
    if marks.probe is not None:
        draw_probe(axis, view, marks.probe)
    figure.suptitle(title, x=0.005, ha="left", fontsize=11)
    _add_legend(figure, legend_handles(marks))
    return figure


def setup_view(surface: Surface, marks: Marks, moved: Array | None = None) -> View:
    """The projection of the body in all pictures of a report.

    The viewer sees the side on which the loads act, and looks across the displacement `moved`
    (3,) if it is given.
    """
    return view_of(surface.points, surface.triangles, _loaded_side(surface, marks), moved=moved)


def _loaded_side(surface: Surface, marks: Marks) -> Array:
    """(3,) mean normal of the loaded parts of the surface, times their area."""
    sizes = areas(surface.points, surface.triangles)
    loaded = [load.on[surface.triangles].all(axis=1) for load in marks.loads]
    return np.sum([sizes[found].sum(axis=0) for found in loaded], axis=0) + np.zeros(3)


def _painted(marks: Marks) -> list[tuple[str, Any]]:
    """The regions in the order in which they are painted: colour, and flags of the points."""
    held = sorted(marks.supports, key=lambda mark: mark.label == CLAMPED)
    return [
        *((REGION_COLOURS["loaded"], load.on) for load in marks.loads),
        *(
            (REGION_COLOURS["clamped" if mark.label == CLAMPED else "held"], mark.on)
            for mark in held
        ),
    ]


def _face_colours(surface: Surface, marks: Marks) -> Array:
    """Colours (k, 4) of the triangles; those of a plane body show no region."""
    from matplotlib.colors import to_rgba

    colours = np.tile(to_rgba(GREY), (len(surface.triangles), 1))
    for colour, on in _painted(marks) if not surface.flat else []:
        colours[on[surface.triangles].all(axis=1)] = to_rgba(colour)
    return colours


def _draw_wires(axis: Axes, surface: Surface, view: View) -> None:
    """Draw the edges of the cells that face the viewer."""
    from matplotlib.collections import LineCollection

    facing = normals(surface.points, surface.triangles) @ view.towards
    seen = surface.wires[(facing[surface.wire_sides] > 0.0) | surface.flat]
    places: Any = view.project(surface.points)
    axis.add_collection(LineCollection(places[seen], colors="#8c949b", linewidths=0.3, zorder=2.2))


def _draw_regions(axis: Axes, surface: Surface, places: Any, marks: Marks) -> None:
    """Draw regions of a plane body as thick lines; in space the edges and nodes of supports."""
    from matplotlib.collections import LineCollection

    every = np.concatenate([surface.edges, surface.wires]) if surface.flat else surface.edges
    painted = _painted(marks) if surface.flat else _painted(marks)[len(marks.loads) :]
    for colour, on in painted:
        lines = every[on[every].all(axis=1)]
        width = 5.0 if colour == REGION_COLOURS["loaded"] else 4.0
        axis.add_collection(
            LineCollection(places[lines], colors=colour, linewidths=width, zorder=3)
        )
        faces = surface.triangles[on[surface.triangles].all(axis=1)]
        alone = np.setdiff1d(np.flatnonzero(on), [*lines.ravel(), *faces.ravel()])
        axis.plot(*places[alone].T, "s", color=colour, markersize=6, zorder=3)


def _add_legend(figure: Figure, handles: Sequence[Any]) -> None:
    """Add the legend below the picture, in as many columns as fit, and make room for its rows."""
    if not handles:
        return
    width, height = figure.get_size_inches()
    sizes = [len(handle.get_label()) + SYMBOL for handle in handles]
    columns = next(
        n
        for n in range(min(MOST_COLUMNS, len(handles)), 0, -1)
        if n == 1 or _letters(sizes, n) <= LETTERS * width
    )
    rows = -(-len(handles) // columns)
    figure.set_size_inches(width, height + 0.21 * rows)
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)


def _letters(sizes: Sequence[int], columns: int) -> int:
    """Width of a legend that is filled column by column, in letters."""
    return sum(int(part.max()) for part in np.array_split(np.array(sizes), columns))
