"""Figures of deformed bodies: shapes, static deflection and stresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import magnification, new_figure, scale_text, styled
from fenicsrom.post.body.body_drawing import (
    body_panel,
    colour_bar,
    draw_body,
    draw_outline,
    draw_triad,
    mark_places,
    show_part,
    triangle_colours,
)
from fenicsrom.post.body.body_surface import Surface, normals
from fenicsrom.post.body.body_view import View, frame_of, largest_of, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHAPE = 0.15
"""Largest displacement of a mode shape in a picture, relative to the size of the body."""

MOST_SHAPES = 20
"""Largest number of shapes in one picture."""

NO_SCALE = "shapes have no scale: each is drawn with the same largest displacement"
"""What the picture of shapes says of their size."""


def _grid(count: int, aspect: float) -> tuple[int, int]:
    """Rows and columns of panels of this ratio of height and width."""
    columns = min(count, 2 if aspect < 0.25 else 3 if aspect < 1.0 else 5)
    return -(-count // columns), columns


@styled
def shape_figure(
    surface: Surface,
    fields: Mapping[str, Array],
    titles: Mapping[str, str],
    view: View | None = None,
) -> Figure:
    """Draw shapes as deformed bodies, coloured by their displacement, one panel each.

    The largest displacement is drawn as `SHAPE` of the size of the body. The undeformed body is
    grey. At most `MOST_SHAPES` shapes are drawn.

    Args:
        surface: the surface.
        fields: label -> displacement (n, 3).
        titles: label -> title of the panel.
        view: the projection; by default the first shape is seen from its side.
    """
    labels, places = list(fields)[:MOST_SHAPES], {}
    view = view or _view_across(surface, fields[labels[0]])
    for label in labels:
        largest = float(np.linalg.norm(fields[label], axis=1).max()) or 1.0
        places[label] = surface.points + SHAPE * view.length / largest * fields[label]
    low, high = shown_part(view, [surface.points, *places.values()])
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    rows, columns = _grid(len(labels), aspect)
    wide = 9.6 / max(columns, 2)
    figure = new_figure(9.6, 1.0 + rows * (wide * aspect + 0.3))
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, label in zip(axes.flat, labels, strict=False):
        sizes = np.linalg.norm(fields[label], axis=1)
        draw_outline(axis, surface, view)
        colours = triangle_colours(surface, sizes / (float(sizes.max()) or 1.0))
        draw_body(axis, surface, view, places[label], colours)
        draw_triad(axis, view, low)
        show_part(axis, low, high)
        axis.set_title(titles[label])
    note = f" ({len(labels)} of {len(fields)} shapes)" if len(fields) > len(labels) else ""
    colour_bar(figure, axes, 1.0, f"displacement / largest of the shape{note}\n{NO_SCALE}")
    return figure


def shown_part(view: View, places: Sequence[Array]) -> tuple[Array, Array]:
    """Corners (2,) of the part of a picture with places (n, 3), and the triad below, m."""
    low, high = frame_of([view.project(found) for found in places], 0.0)
    spare = 0.03 * view.length
    return low - [spare, 0.16 * view.length], high + spare


@styled
def deflection_figure(
    surface: Surface, displacement: Array, title: str, view: View | None = None
) -> Figure:
    """Draw a displacement (n, 3) in m, magnified by a stated factor if it is small.

    By default it is seen from its side.
    """
    view = view or _view_across(surface, displacement)
    sizes = np.linalg.norm(displacement, axis=1)
    largest = float(sizes.max())
    colours = triangle_colours(surface, sizes / (largest or 1.0))
    figure, axis, factor = _deflected(surface, view, displacement, colours)
    axis.set_title(title)
    colour_bar(figure, axis, 1e3 * largest or 1.0, f"displacement, mm ({scale_text(factor)})")
    return figure


def _view_across(surface: Surface, displacement: Array) -> View:
    """A projection that looks across the largest of displacements (n, 3)."""
    return view_of(surface.points, surface.triangles, moved=largest_of(displacement))


@styled
def stress_figure(
    surface: Surface, displacement: Array, stress: Array, title: str, view: View | None = None
) -> Figure:
    """Draw the von Mises stress on a deformed body and mark its largest value.

    By default the viewer sees the place of the largest stress, if it is on the boundary. In a given
    projection it may lie on the far side; the title then says so, and the mark is hollow.

    Args:
        surface: the surface.
        displacement: (n, 3) m; it is magnified by a stated factor if it is small.
        stress: (n,) Pa.
        title: title of the figure.
        view: the projection.
    """
    worst = int(np.argmax(stress))
    peak = float(stress[worst]) or 1.0
    around = np.any(surface.triangles == worst, axis=1)
    faces = normals(surface.points, surface.triangles[around])
    if view is None:
        most = largest_of(displacement)
        view = view_of(surface.points, surface.triangles, faces.sum(axis=0), moved=most)
    far = bool(len(faces) and np.all(faces @ view.towards < 0.0))
    title = f"{title}, on the far side" if far else title
    colours = triangle_colours(surface, stress / peak, "turbo")
    figure, axis, factor = _deflected(surface, view, displacement, colours)
    place = surface.points[[worst]] + factor * displacement[[worst]]
    mark_places(axis, view, place, ["none" if far else "white"])
    axis.set_title(title)
    label = f"von Mises stress, MPa (displacements {scale_text(factor)})"
    colour_bar(figure, axis, 1e-6 * peak, label, "turbo")
    return figure


def _deflected(
    surface: Surface, view: View, displacement: Array, colours: Array
) -> tuple[Figure, Axes, float]:
    """Draw a deflected body; return figure, panel and the factor of the displacements."""
    factor = magnification(float(np.linalg.norm(displacement, axis=1).max()), view.length)
    moved = surface.points + factor * displacement
    figure, axis = body_panel(view, *shown_part(view, [surface.points, moved]), 1.3)
    draw_outline(axis, surface, view)
    draw_body(axis, surface, view, moved, colours)
    return figure, axis, factor
