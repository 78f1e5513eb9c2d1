"""Figures of deformed bodies: shapes, static deflection and stresses."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import magnification, new_figure, scale_text, styled
from fenicsrom.post.body.body_surface import areas, form_edges
from fenicsrom.post.body.body_view import View, face_on, frame_of, largest_of, view_at, view_of
from fenicsrom.post.body.rendering import colour_bar, coloured, drawn_lines, show

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pyvista import PolyData

SHAPE = 0.15
"""Largest displacement of a mode shape in a picture, relative to the size of the body."""

MOST_SHAPES = 12
"""Largest number of shapes in one picture."""

NO_SCALE = "shapes have no scale: each is drawn with the same largest displacement"
"""What the picture of shapes says of their size."""

NODAL = "white: nodal lines"
"""What it says of the lines on which the displacement towards the viewer is zero."""

OUTLINE = "#A6ABB0"
"""Colour of the edges of the undeformed body."""

SIZE = "size"
"""The point array that gives a surface its colours."""

STEEP = 0.1
"""Least slope of a shape at its nodal lines, relative to its largest displacement and the body."""

TOWARDS = 0.7
"""Part of the squares of a shape along the line of sight from which its nodal lines are drawn."""


@styled
def shape_figure(
    surface: PolyData,
    titles: Mapping[str, str],
    modes: Collection[str] = (),
    view: View | None = None,
) -> Figure:
    """Draw shapes as deformed bodies, coloured by their displacement, one panel each.

    The largest displacement is drawn as `SHAPE` of the size of the body. The edges of the
    undeformed body are grey. At most `MOST_SHAPES` shapes are drawn. A plate is seen face-on.

    Args:
        surface: the surface, with the displacements (n, 3) as point arrays.
        titles: name of the displacement -> title of its panel.
        modes: names of those that get nodal lines, if they move towards the viewer.
        view: the projection of other bodies; by default the first shape is seen from its side.
    """
    labels = list(titles)[:MOST_SHAPES]
    fields = {label: np.asarray(surface.point_data[label]) for label in labels}
    view = face_on(surface) or view or view_of(surface, moved=largest_of(fields[labels[0]]))
    factors = {
        label: SHAPE * view.length / (_largest(field) or 1.0) for label, field in fields.items()
    }
    nodal = {
        label: line
        for label in labels
        if label in modes and (line := _nodal_lines(surface, fields[label], view)).n_points
    }
    figure, axes = _panels(surface, factors, view, nodal=nodal)
    for axis, label in zip(axes, labels, strict=False):
        axis.set_title(titles[label])
    few = f" ({len(labels)} of {len(titles)} shapes)" if len(titles) > len(labels) else ""
    about = f"displacement / largest of the shape{few}{f'; {NODAL}' * bool(nodal)}\n{NO_SCALE}"
    colour_bar(figure, figure.axes, 1.0, about)
    return figure


def _panels(
    surface: PolyData,
    factors: Mapping[str, float],
    view: View,
    colours: str = "viridis",
    nodal: Mapping[str, PolyData] = MappingProxyType({}),
) -> tuple[Figure, Sequence[Axes]]:
    """Draw deformed bodies, coloured from 0 to their largest value, in panels of one figure.

    Args:
        surface: the surface; its colours are those of the point array `SIZE`, or else of the size
            of the displacement.
        factors: the point array of each displacement (n, 3) -> its factor.
        view: the projection.
        colours: name of the colour map.
        nodal: lines on the undeformed surface that move with it.
    """
    edges = form_edges(surface)
    rest = drawn_lines(edges.translate(-2.0 * view.length * view.towards), OUTLINE)
    bodies = [surface.warp_by_vector(label, factor=factor) for label, factor in factors.items()]
    low, high = shown_part(view, [surface.points, *(body.points for body in bodies)])
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    columns = min(len(bodies), 2 if aspect < 0.25 else 3 if aspect < 1.0 else 5)
    rows = -(-len(bodies) // columns)
    wide = 9.6 / columns if columns > 1 else 8.0 * min(1.0, max(0.6, 1.0 / aspect))
    figure = new_figure(wide * columns, 1.0 + rows * (wide * aspect + 0.3))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, body, (label, factor) in zip(axes, bodies, factors.items(), strict=False):
        if SIZE not in body.point_data:
            body.point_data[SIZE] = np.linalg.norm(surface.point_data[label], axis=1)
        largest = float(body.point_data[SIZE].max()) or 1.0
        parts = [coloured(body, SIZE, largest, colours), rest]
        parts.append(drawn_lines(edges.warp_by_vector(label, factor=factor)))
        if label in nodal:
            moved = nodal[label].warp_by_vector(label, factor=factor)
            parts.append(drawn_lines(moved, "white", 3.5))
        show(axis, parts, view, low, high, wide)
    return figure, list(axes)


def _largest(displacement: Array) -> float:
    """The length of the largest of displacements (n, 3)."""
    return float(np.linalg.norm(displacement, axis=1).max())


def _nodal_lines(surface: PolyData, displacement: Array, view: View) -> PolyData:
    """The lines of zero displacement towards the viewer, if most of the motion goes there."""
    from pyvista import PolyData

    across = displacement @ view.towards
    if not np.any(across) or np.sum(across**2) < TOWARDS * np.sum(displacement**2):
        return PolyData()
    corners = across[surface.regular_faces]
    size = np.sqrt(2.0 * np.linalg.norm(areas(surface), axis=1))
    steep = np.ptp(corners, axis=1) * view.length >= STEEP * np.abs(across).max() * size
    found = surface.copy()
    found.point_data["across"] = across
    return found.remove_cells(~steep).contour([0.0], scalars="across")


def shown_part(view: View, places: Sequence[Array]) -> tuple[Array, Array]:
    """Corners (2,) of the part of a picture with places (n, 3), and the triad below, m."""
    low, high = frame_of([view.project(found) for found in places], 0.0)
    spare = 0.03 * view.length
    return low - [spare, 0.16 * view.length], high + spare


@styled
def deflection_figure(
    surface: PolyData, label: str, title: str, view: View | None = None
) -> Figure:
    """Draw a displacement in m, magnified by a stated factor if it is small.

    Args:
        surface: the surface.
        label: the point array of the displacement (n, 3).
        title: title of the figure.
        view: the projection; by default the displacement is seen from its side.
    """
    displacement = np.asarray(surface.point_data[label])
    view = view or view_of(surface, moved=largest_of(displacement))
    factor = magnification(_largest(displacement), view.length)
    figure, (axis,) = _panels(surface, {label: factor}, view)
    axis.set_title(title)
    about = f"displacement, mm ({scale_text(factor)})"
    colour_bar(figure, axis, 1e3 * _largest(displacement) or 1.0, about)
    return figure


@styled
def stress_figure(surface: PolyData, label: str, title: str) -> Figure:
    """Draw the von Mises stress on a deformed body and mark its largest value.

    The viewer sees the place of the largest stress. If no projection shows it, the mark is hollow
    and the title says so.

    Args:
        surface: the surface, with the stress (n,) as its point array `SIZE`, Pa.
        label: the point array of the displacement (n, 3); it is magnified by a stated factor if it
            is small, m.
        title: title of the figure.
    """
    stress, displacement = surface.point_data[SIZE], np.asarray(surface.point_data[label])
    worst = int(np.argmax(stress))
    view, seen = view_at(surface, worst)
    factor = magnification(_largest(displacement), view.length)
    figure, (axis,) = _panels(surface, {label: factor}, view, "turbo")
    at = view.project(surface.points[worst] + factor * displacement[worst])
    colour = "white" if seen else "none"
    axis.plot(*at, "o", color=colour, markersize=6.5, markeredgecolor="black", zorder=6)
    axis.set_title(title if seen else f"{title}, hidden by the body")
    about = f"von Mises stress, MPa (displacements {scale_text(factor)})"
    colour_bar(figure, axis, 1e-6 * float(stress[worst]) or 1.0, about, "turbo")
    return figure
