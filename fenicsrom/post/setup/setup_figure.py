"""The picture of the set-up: the undeformed mesh with all that acts on it.

The axis of rotation and round walls are often much larger than the body: a second panel then shows
all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

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
from fenicsrom.post.body.rendering import body_panel, drawn_lines, painted, show
from fenicsrom.post.paraview.vtk_files import Grid
from fenicsrom.post.setup.setup_marks import Marks
from fenicsrom.post.setup.setup_symbols import (
    COLOURS,
    REACH,
    legend_handles,
    load_arrows,
    region_parts,
    surroundings,
    symbols,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pyvista import PolyData

OVERVIEW = 0.32
"""Width of the second panel, relative to the picture of the body."""


@styled
def setup_figure(grid: Grid, marks: Marks, title: str, view: View | None = None) -> Figure:
    """Draw the undeformed body with its supports, loads, attachments, contacts and probe.

    Several loads and contact points have numbers. The projection is that of `setup_view` by
    default.
    """
    surface = surface_of(grid)
    view = view or setup_view(surface, marks)
    edges, drawn = form_edges(surface), symbols(marks, grid.points, view)
    places = [view.project(mesh.points) for mesh in (surface, *(symbol.mesh for symbol in drawn))]
    low, high = frame_of(places, 0.05 * view.length)
    low = low - [0.0, 0.13 * view.length]
    body = [*region_parts(surface, edges, marks), drawn_lines(edges)]
    body += [drawn_lines(cell_edges(grid), "#8C949B", 1.0), *(symbol.part for symbol in drawn)]
    around = surroundings(marks, grid.points)

    handles = legend_handles(marks, drawn)
    columns = 2 if len(handles) > 3 else len(handles)
    rows = -(-len(handles) // max(columns, 1))
    figure, axis, wide = body_panel(view, low, high, 0.6 + 0.21 * (rows + title.count("\n")))
    show(axis, [*body, *around], view, low, high, wide)
    _write_numbers(axis, _numbers(marks, view), (high[0] - low[0]) / (72.0 * wide))
    reach = [view.project(part.mesh.points) for part in around]
    if any(np.any(seen < low) or np.any(seen > high) for seen in reach):
        low, high = frame_of([*places, *reach], 0.05 * view.length)
        figure.set_figwidth(figure.get_figwidth() * (1.0 + OVERVIEW))
        panel = axis.inset_axes((1.02, 0.0, OVERVIEW, 1.0))
        show(panel, [painted(surface), *around], view, low, high, OVERVIEW * wide)
    figure.suptitle(title, x=0.005, ha="left", fontsize=11)
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure


def setup_view(surface: PolyData, marks: Marks, moved: Array | None = None) -> View:
    """The projection of a body in its set-up and its motions.

    The viewer sees the side on which the loads act, and looks across the displacement `moved`
    (3,) if it is given.
    """
    sizes = areas(surface)
    loaded = [faces_on(surface, load.on[surface.point_data[NODE]]) for load in marks.loads]
    facing = np.sum([sizes[found].sum(axis=0) for found in loaded], axis=0) + np.zeros(3)
    return view_of(surface, facing, moved=moved)


class Number(NamedTuple):
    """A number beside a symbol.

    Attributes:
        text: the number.
        at: (2,) place of the symbol in the picture, m.
        way: (2,) direction from there in which there should be room.
        colour: of the text.
        needed: whether it is written where there is no room, too.
    """

    text: str
    at: Array
    way: Array
    colour: str
    needed: bool


def _numbers(marks: Marks, view: View) -> list[Number]:
    """The numbers of several loads and contact points, the most important ones first."""
    found = []
    if len(marks.loads) > 1:
        for number, start, end in load_arrows(marks.loads, REACH * view.length):
            (at,), (way,) = view.project(start[None]), view.project((start - end)[None])
            found.append(Number(str(number + 1), at, way, COLOURS["load"], True))
    if sum(len(mark.places) for mark in marks.contacts) > 1:
        for mark in marks.contacts:
            at, ways = view.project(mark.places), -view.project(mark.normals)
            for k in halving(len(at)):
                text = str(mark.first + k)
                found.append(Number(text, at[k], ways[k], COLOURS["contact"], False))
    return found


def halving(count: int) -> list[int]:
    """The numbers below `count`: the first, the last, and then those between known ones."""
    steps = [count - 1 or 1]
    while steps[-1] > 1:
        steps.append(-(-steps[-1] // 2))
    return list(dict.fromkeys(k for step in steps for k in range(0, count, step)))


def _write_numbers(axis: Axes, numbers: Sequence[Number], point: float) -> None:
    """Write numbers beside their symbols; one that would lie on an earlier one is left out.

    Args:
        axis: the panel.
        numbers: the numbers.
        point: length of a typographic point in the picture, m.
    """
    from matplotlib.patheffects import withStroke

    taken: list[tuple[Array, Array]] = []
    for text, at, way, colour, needed in numbers:
        half = point * np.array([3.0 * len(text) + 1.0, 5.0])
        size = float(np.linalg.norm(way))
        way = np.asarray(way / size) if size > 1e-9 else np.array([0.0, -1.0])
        across = np.array([-way[1], way[0]])
        steps = (across, -across, way, -way) if needed else (way,)
        places = [at + 11.0 * point * step for step in steps]
        free = [
            place
            for place in places
            if all(np.any(np.abs(place - other) > half + room) for other, room in taken)
        ]
        if not free and not needed:
            continue
        place = (free or places)[0]
        taken.append((place, half))
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "zorder": 7}
        look["path_effects"] = [withStroke(linewidth=2.5, foreground="white")]
        axis.text(place[0], place[1], text, color=colour, weight="bold", **look)
