"""Deformed bodies drawn by matplotlib: parallel projection, the triangles behind come first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import new_figure
from fenicsrom.post.body.body_surface import Ints, Surface, normals
from fenicsrom.post.body.body_view import View

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.floating[Any]]

TRIAD = 0.08
"""Length of the arrows of the axes, relative to the size of the body."""

LABEL_MARGIN = 0.1
"""Margin below the label of a colour bar, inches."""

DARKEST = 0.78
"""Brightness of a face that gets no light."""

GREY = "#D9DDE1"
"""Colour of the undeformed body."""


def body_panel(view: View, low: Array, high: Array, spare: float) -> tuple[Figure, Axes]:
    """Make a figure with one panel for a body, with the triad of the axes in its lower left.

    Args:
        view: the projection.
        low: (2,) lower left corner of the part of the picture that is shown, m.
        high: (2,) its upper right corner, m.
        spare: height of title, legend and colour bar, inches.
    """
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    wide = 8.0 * min(1.0, max(0.6, 1.0 / aspect))
    figure = new_figure(wide, wide * aspect + spare)
    axis = figure.subplots()
    draw_triad(axis, view, low)
    show_part(axis, low, high)
    return figure, axis


def show_part(axis: Axes, low: Array, high: Array) -> None:
    """Show this part of the picture without axes and to scale."""
    axis.set_axis_off()
    axis.set(xticks=[], yticks=[])  # measuring hidden ticks takes time
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


def draw_body(
    axis: Axes,
    surface: Surface,
    view: View,
    moved: Array | None = None,
    colours: Any = GREY,
) -> list[Artist]:
    """Draw the triangles that face the viewer, with the edges of the body.

    Args:
        axis: where to draw.
        surface: the surface.
        view: the projection.
        moved: (n, 3) places of the points, m; those of the surface if not given.
        colours: one colour, or (k, 4) colours of the triangles.

    Returns:
        What is drawn.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    points = surface.points if moved is None else moved
    seen, light = _seen(surface, view, points)
    paint = np.broadcast_to(
        to_rgba(colours) if isinstance(colours, str) else colours, (len(surface.triangles), 4)
    )
    paint = np.array(paint[seen])
    paint[:, :3] *= light[:, None]
    places: Any = view.project(points)
    faces = PolyCollection(
        places[surface.triangles[seen]],
        facecolors=paint,
        edgecolors=paint,
        linewidths=0.4,
        zorder=2,
    )
    axis.add_collection(faces, autolim=False)
    return [faces, _draw_edges(axis, surface, view, points)]


def draw_smooth_body(
    axis: Axes, surface: Surface, view: View, moved: Array, colours: Array
) -> list[Artist]:
    """Draw the same with colours (n, 4) of the points, in a fifth of the time.

    The colours are interpolated, so that few triangles do. The edges of the triangles are not
    smoothed: this is for the frames of an animation.
    """
    from matplotlib.artist import Artist

    seen, light = _seen(surface, view, moved)
    corners = view.project(moved)[surface.triangles[seen]]
    paint = colours[surface.triangles[seen]]
    paint[:, :, :3] *= light[:, None, None]

    class Triangles(Artist):
        """The triangles, without an object for each of them."""

        def draw(self, renderer: Any) -> None:
            """Draw them in their order."""
            context = renderer.new_gc()
            self._set_gc_clip(context)  # type: ignore[attr-defined]
            renderer.draw_gouraud_triangles(context, corners, paint, self.get_transform())
            context.restore()

    faces = Triangles()
    axis.add_artist(faces)
    return [faces, _draw_edges(axis, surface, view, moved)]


def _seen(surface: Surface, view: View, points: Array) -> tuple[Ints, Array]:
    """The triangles that face the viewer, those in front last, and how bright each is (k,)."""
    direction = normals(points, surface.triangles)
    if surface.flat:
        return np.arange(len(direction)), np.ones(len(direction))
    seen = np.flatnonzero(direction @ view.towards > 0.0)
    depth = points[surface.triangles[seen]].mean(axis=1) @ view.towards
    seen = seen[np.argsort(depth, kind="stable")]
    light = view.towards + 0.6 * view.up - 0.3 * view.right
    return seen, DARKEST + (1.0 - DARKEST) * np.clip(direction[seen] @ light, 0.0, 1.0)


def _draw_edges(axis: Axes, surface: Surface, view: View, points: Array) -> Artist:
    """Draw the edges of the body that lie on a triangle that faces the viewer."""
    from matplotlib.collections import LineCollection

    front = np.ones(len(surface.edges), dtype=bool)
    if not surface.flat:
        facing = normals(points, surface.triangles) @ view.towards
        front = np.any(facing[surface.sides] > 0.0, axis=1)
    places: Any = view.project(points)
    lines = LineCollection(
        places[surface.edges[front]], colors="#30363C", linewidths=0.5, zorder=2.5
    )
    axis.add_collection(lines, autolim=False)
    return lines


def draw_outline(axis: Axes, surface: Surface, view: View) -> None:
    """Draw the edges of the undeformed body in grey, behind the body."""
    from matplotlib.collections import LineCollection

    places: Any = view.project(surface.points)
    axis.add_collection(
        LineCollection(places[surface.edges], colors="#A6ABB0", linewidths=0.8, zorder=1)
    )


def mark_places(axis: Axes, view: View, places: Array, colours: Sequence[str]) -> Artist:
    """Mark places (P, 3) with dots of these colours, in front of the body."""
    at = view.project(places)
    look: dict[str, Any] = {"s": 45, "linewidths": 1.0, "edgecolors": "black", "zorder": 6}
    return axis.scatter(at[:, 0], at[:, 1], c=list(colours), **look)


def draw_triad(axis: Axes, view: View, low: Array) -> None:
    """Draw the global axes x, y, z as arrows, right and above `low` (2,)."""
    size = TRIAD * view.length
    arrows = size * view.project(np.eye(3))
    foot = low + 0.4 * size - np.minimum(arrows.min(axis=0), 0.0)
    for name, arrow in zip("xyz", arrows, strict=True):
        if np.linalg.norm(arrow) < 0.1 * size:
            continue  # seen from its end
        look = {"arrowstyle": "-|>", "color": "#30363C", "shrinkA": 0, "shrinkB": 0}
        start, end = ((float(x), float(y)) for x, y in (foot, foot + arrow))
        line = axis.annotate("", end, start, arrowprops=look, annotation_clip=False)
        x, y = foot + (1.0 + 0.25 * size / np.linalg.norm(arrow)) * arrow
        text = axis.text(x, y, name, fontsize=8, ha="center", va="center", color="#30363C")
        for drawn in (line, text):
            drawn.set_in_layout(False)  # it lies inside the panel; measuring it takes time


def triangle_colours(surface: Surface, values: Floats, colours: str = "viridis") -> Array:
    """Colours (k, 4) of values (n,) from 0 to 1 at the points, by a colour map of this name."""
    import matplotlib

    found = matplotlib.colormaps[colours](values[surface.triangles].mean(axis=1))
    return np.asarray(found, dtype=np.float64)


def colour_bar(
    figure: Figure, axes: Any, largest: float, label: str, colours: str = "viridis"
) -> None:
    """Add the colour bar of values from 0 to the largest below all panels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar: Any = figure.colorbar(
        ScalarMappable(Normalize(0.0, largest), colours),
        ax=axes,
        location="bottom",
        shrink=0.3 if np.size(axes) > 1 else 0.5,
        aspect=40,
        ticks=[0.0, 0.5 * largest, largest],
        format="{x:.3g}",
    )
    bar.set_label(label)
    bar.outline.set_visible(False)
    # constrained layout cuts the label of a tall figure without this margin
    margin = LABEL_MARGIN / figure.get_figheight()
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, margin, 1.0, 1.0 - margin))
