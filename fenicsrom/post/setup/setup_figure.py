"""The picture of the set-up: the undeformed mesh with all that acts on it.

The axis of rotation and round walls are often much larger than the body. The picture shows the part
of them that lies near the body. A second panel shows all of them.
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
from fenicsrom.post.body.rendering import Part, body_panel, drawn_lines, painted, show
from fenicsrom.post.paraview.vtk_files import Grid
from fenicsrom.post.setup.setup_marks import Marks, RotationMark
from fenicsrom.post.setup.setup_symbols import (
    MARK_COLOURS,
    NEAR,
    REACH,
    legend_handles,
    load_arrows,
    region_parts,
    rotation_parts,
    symbol_parts,
    wall_part,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pyvista import PolyData

LETTERS = 11.0
"""Letters of a legend in an inch."""

SYMBOL = 7
"""Width of a symbol in the legend with its margins, in letters."""

MOST_COLUMNS = 4
"""Largest number of columns of the legend."""

SPARE = 0.15
"""Length of the axis of rotation beyond what it passes, relative to the extent along it."""

TURN = 0.035
"""Radius of the arrow around the axis of rotation, relative to the size of the picture."""

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
    symbols = symbol_parts(marks, grid.points, view)
    places = [view.project(part.mesh.points) for part in symbols]
    low, high = frame_of([view.project(surface.points), *places], 0.05 * view.length)
    low = low - [0.0, 0.13 * view.length]
    edges = form_edges(surface)
    body = [*region_parts(surface, edges, marks), drawn_lines(edges)]
    parts = [*body, drawn_lines(cell_edges(grid), "#8C949B", 1.0), *symbols]
    walls = [part for mark in marks.contacts for part in wall_part(mark, NEAR * view.length)]

    figure, axis, wide = body_panel(view, low, high, 0.6 + 0.2 * title.count("\n"))
    turning = _turning(marks, surface, view, low, high)
    show(axis, [*parts, *walls, *turning], view, low, high, wide)
    _write_numbers(axis, _numbers(marks, view), (high[0] - low[0]) / (72.0 * wide))
    _draw_overview(figure, axis, surface, view, marks)
    figure.suptitle(title, x=0.005, ha="left", fontsize=11)
    _add_legend(figure, legend_handles(marks))
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
            found.append(Number(str(number + 1), at, way, MARK_COLOURS["load"], True))
    if sum(len(mark.places) for mark in marks.contacts) > 1:
        for mark in marks.contacts:
            at, ways = view.project(mark.places), -view.project(mark.normals)
            for k in halving(len(at)):
                text = str(mark.first + k)
                found.append(Number(text, at[k], ways[k], MARK_COLOURS["contact"], False))
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
        steps = (way, across, -across, -way) if needed else (way,)
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


def axis_ends(rotation: RotationMark, places: Array) -> Array:
    """The ends (2, 3) of the drawn part of the axis of rotation, beside places (n, 3)."""
    along = (places - rotation.point) @ rotation.axis
    spare = SPARE * float(np.ptp(places, axis=0).max())
    return np.asarray(
        rotation.point + np.outer([along.min() - spare, along.max() + spare], rotation.axis)
    )


def _turning(marks: Marks, surface: PolyData, view: View, low: Array, high: Array) -> list[Part]:
    """The axis of rotation in a picture with these corners; none of a body that does not turn."""
    if marks.rotation is None:
        return []
    walls = [mark.wall.points for mark in marks.contacts if mark.wall is not None]

    def shown(places: Array) -> Any:
        seen = view.project(places)
        return np.all((low < seen) & (seen < high), axis=1)

    ends = axis_ends(marks.rotation, np.concatenate([surface.points, *walls]))
    return rotation_parts(marks.rotation, ends, TURN * float(np.max(high - low)), shown)


def _draw_overview(figure: Figure, axis: Axes, surface: PolyData, view: View, marks: Marks) -> None:
    """Draw the whole surroundings beside the picture of the body, if they reach beyond it."""
    around = [part for mark in marks.contacts for part in wall_part(mark)]
    every = [surface.points, *(part.mesh.points for part in around)]
    if marks.rotation is not None:
        every.append(axis_ends(marks.rotation, np.concatenate(every)))
    low, high = frame_of([view.project(places) for places in every], 0.0)
    shown = np.transpose([axis.get_xlim(), axis.get_ylim()])
    if np.all(low >= shown[0]) and np.all(high <= shown[1]):
        return
    spare = 2.0 * TURN * float(np.max(high - low))
    low, high = low - spare, high + spare
    width, height = figure.get_size_inches()
    figure.set_size_inches(width * (1.0 + OVERVIEW), height)
    panel = axis.inset_axes((1.02, 0.0, OVERVIEW, 1.0))
    parts = [painted(surface), *around, *_turning(marks, surface, view, low, high)]
    show(panel, parts, view, low, high, OVERVIEW * width)


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
