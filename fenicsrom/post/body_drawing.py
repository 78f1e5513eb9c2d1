"""Deformed bodies drawn by matplotlib: parallel projection, the triangles behind come first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.body_surface import Surface, normals
from fenicsrom.post.style import magnification, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Flags = NDArray[np.bool_]

SHAPE = 0.15
"""Largest displacement of a mode shape in a picture, relative to the size of the body."""

BROAD = 1.5
"""Ratio of the areas seen from two sides from which one of them is the broad side."""

MOST_SHAPES = 20
"""Largest number of shapes in one picture."""

TRIAD = 0.08
"""Length of the arrows of the axes, relative to the size of the body."""

GREY = "#D9DDE1"


@dataclass(frozen=True, eq=False)
class View:
    """A parallel projection that looks at the broad side of a body.

    Attributes:
        right, up, towards: (3,) unit vectors of the picture; `towards` points to the viewer.
        length: largest extent of the body, m.
    """

    right: Array
    up: Array
    towards: Array
    length: float

    def project(self, points: Array) -> Array:
        """(n, 2) places in the picture, m."""
        return points @ np.column_stack([self.right, self.up])


def view_of(surface: Surface) -> View:
    """Look at the broad side of a body; its longest axis lies across the picture.

    The broad side is the direction from which most of the surface is seen, perpendicular to the
    longest axis. A body along z stands upright.
    """
    extent = np.ptp(surface.points, axis=0)
    thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
    if surface.flat:
        x, y, z = np.eye(3)
        return View(x, y, z, float(extent.max()))
    corners = surface.points[surface.triangles]
    areas = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    plane = np.array([middle, thin])
    seen, turn = np.linalg.eigh(plane @ (areas.T @ (areas / sizes)) @ plane.T)
    broad = turn[:, 1] @ plane if seen[1] > BROAD * seen[0] else middle
    broad = broad * (-1.0 if np.cross(broad, along) @ [0.0, 0.6, 1.0] < 0.0 else 1.0)
    third = np.cross(broad, along)
    towards = 0.72 * broad + 0.15 * along + 0.66 * third
    up = along if along[2] else third
    towards = towards / np.linalg.norm(towards)
    up = up - (up @ towards) * towards
    up = up / np.linalg.norm(up)
    return View(np.asarray(np.cross(up, towards)), up, towards, float(extent.max()))


def draw_body(
    axis: Axes,
    surface: Surface,
    view: View,
    moved: Array | None = None,
    colours: Any = GREY,
) -> None:
    """Draw the triangles that face the viewer, with the edges of the body.

    Args:
        axis: where to draw.
        surface: the surface.
        view: the projection.
        moved: (n, 3) places of the points, m; those of the surface if not given.
        colours: one colour, or (k, 4) colours of the triangles.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgba

    points = surface.points if moved is None else moved
    direction = normals(points, surface.triangles)
    facing = direction @ view.towards
    seen = np.flatnonzero(facing > 0.0) if not surface.flat else np.arange(len(facing))
    depth = points[surface.triangles[seen]].mean(axis=1) @ view.towards
    seen = seen[np.argsort(depth, kind="stable")]
    paint = np.broadcast_to(
        to_rgba(colours) if isinstance(colours, str) else colours, (len(facing), 4)
    )
    paint = np.array(paint[seen])
    if not surface.flat:
        light = view.towards + 0.6 * view.up - 0.3 * view.right
        paint[:, :3] *= (0.78 + 0.22 * np.clip(direction[seen] @ light, 0.0, 1.0))[:, None]
    places = view.project(points)
    faces = PolyCollection(
        list(places[surface.triangles[seen]]),
        facecolors=paint,
        edgecolors=paint,
        linewidths=0.4,
        zorder=2,
    )
    axis.add_collection(faces)
    if surface.flat:
        front = np.ones(len(surface.edges), dtype=bool)
    else:
        front = np.any(facing[surface.sides] > 0.0, axis=1)
    lines = LineCollection(
        list(places[surface.edges[front]]), colors="#30363C", linewidths=0.5, zorder=2.5
    )
    axis.add_collection(lines)


def draw_outline(axis: Axes, surface: Surface, view: View) -> None:
    """Draw the edges of the undeformed body in grey, behind the body."""
    from matplotlib.collections import LineCollection

    places = view.project(surface.points)
    axis.add_collection(
        LineCollection(list(places[surface.edges]), colors="#A6ABB0", linewidths=0.8, zorder=1)
    )


def draw_triad(axis: Axes, view: View, low: Array, size: float) -> None:
    """Draw the global axes x, y, z as arrows of this size (m), right and above `low` (2,)."""
    arrows = size * view.project(np.eye(3))
    foot = low + 0.4 * size - np.minimum(arrows.min(axis=0), 0.0)
    for name, arrow in zip("xyz", arrows, strict=True):
        if np.linalg.norm(arrow) < 0.1 * size:
            continue  # seen from its end
        look = {"arrowstyle": "-|>", "color": "#30363C", "shrinkA": 0, "shrinkB": 0}
        start, end = ((float(x), float(y)) for x, y in (foot, foot + arrow))
        axis.annotate("", end, start, arrowprops=look, annotation_clip=False)
        x, y = foot + (1.0 + 0.25 * size / np.linalg.norm(arrow)) * arrow
        axis.text(x, y, name, fontsize=8, ha="center", va="center", color="#30363C")


def frame_of(places: Sequence[Array], spare: float) -> tuple[Array, Array]:
    """The lower left and the upper right corner of places (n, 2) with a margin, m."""
    low = np.min([place.min(axis=0) for place in places], axis=0) - spare
    high = np.max([place.max(axis=0) for place in places], axis=0) + spare
    return low, high


def _panel(axis: Axes, low: Array, high: Array) -> None:
    """Show this part of the picture without axes and to scale."""
    axis.set_axis_off()
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


def _triangle_colours(surface: Surface, sizes: Array) -> Array:
    """Colours (k, 4) of values (n,) from 0 to 1 at the points."""
    import matplotlib

    found = matplotlib.colormaps["viridis"](sizes[surface.triangles].mean(axis=1))
    return np.asarray(found, dtype=np.float64)


def _grid(count: int, aspect: float) -> tuple[int, int]:
    """Rows and columns of panels of this ratio of height and width."""
    columns = min(count, 2 if aspect < 0.25 else 3 if aspect < 1.0 else 5)
    return -(-count // columns), columns


@styled
def shape_figure(
    surface: Surface, fields: Mapping[str, Array], titles: Mapping[str, str]
) -> Figure:
    """Draw shapes as deformed bodies, coloured by their displacement, one panel each.

    The largest displacement is drawn as `SHAPE` of the size of the body. The undeformed body is
    grey. At most `MOST_SHAPES` shapes are drawn.

    Args:
        surface: the surface.
        fields: label -> displacement (n, 3).
        titles: label -> title of the panel.
    """
    view, labels = view_of(surface), list(fields)[:MOST_SHAPES]
    moved = {}
    for label in labels:
        largest = float(np.linalg.norm(fields[label], axis=1).max()) or 1.0
        moved[label] = surface.points + SHAPE * view.length / largest * fields[label]
    corner = frame_of([view.project(places) for places in (surface.points, *moved.values())], 0.0)
    spare = 0.03 * view.length
    low, high = corner[0] - [spare, 0.16 * view.length], corner[1] + spare
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    rows, columns = _grid(len(labels), aspect)
    wide = 9.6 / max(columns, 2)
    figure = new_figure(9.6, 0.8 + rows * (wide * aspect + 0.3))
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, label in zip(axes.flat, labels, strict=False):
        sizes = np.linalg.norm(fields[label], axis=1)
        draw_outline(axis, surface, view)
        colours = _triangle_colours(surface, sizes / (float(sizes.max()) or 1.0))
        draw_body(axis, surface, view, moved[label], colours)
        draw_triad(axis, view, low, TRIAD * view.length)
        _panel(axis, low, high)
        axis.set_title(titles[label])
    note = f" ({len(labels)} of {len(fields)} shapes)" if len(fields) > len(labels) else ""
    _colour_bar(figure, axes, 1.0, f"displacement / largest{note}")
    return figure


@styled
def deflection_figure(surface: Surface, displacement: Array, title: str) -> Figure:
    """Draw a displacement (n, 3) in m, magnified by a stated factor if it is small."""
    view = view_of(surface)
    sizes = np.linalg.norm(displacement, axis=1)
    largest = float(sizes.max())
    factor = magnification(largest, view.length)
    moved = surface.points + factor * displacement
    corner = frame_of([view.project(places) for places in (surface.points, moved)], 0.0)
    spare = 0.03 * view.length
    low, high = corner[0] - [spare, 0.16 * view.length], corner[1] + spare
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    wide = 8.0 * min(1.0, max(0.6, 1.0 / aspect))
    figure = new_figure(wide, wide * aspect + 1.3)
    axis = figure.subplots()
    draw_outline(axis, surface, view)
    draw_body(axis, surface, view, moved, _triangle_colours(surface, sizes / (largest or 1.0)))
    draw_triad(axis, view, low, TRIAD * view.length)
    _panel(axis, low, high)
    axis.set_title(title)
    scale = "drawn to scale" if factor == 1.0 else f"drawn × {factor:g}"
    _colour_bar(figure, axis, 1e3 * largest or 1.0, f"displacement, mm ({scale})")
    return figure


def _colour_bar(figure: Figure, axes: Any, largest: float, label: str) -> None:
    """Add the colour bar of displacements below all panels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar: Any = figure.colorbar(
        ScalarMappable(Normalize(0.0, largest), "viridis"),
        ax=axes,
        location="bottom",
        shrink=0.3 if np.size(axes) > 1 else 0.5,
        aspect=40,
        ticks=[0.0, 0.5 * largest, largest],
        format="{x:.3g}",
    )
    bar.set_label(label)
    bar.outline.set_visible(False)


@dataclass(frozen=True, eq=False)
class Marks:
    """What the picture of the set-up marks.

    Attributes:
        clamped: (n,) whether a point of the surface is clamped.
        loads: name -> place (3,), direction (3,) of a unit vector, and (n,) whether the load acts
            on a point of the surface.
        contacts: name -> places (P, 3) and normals (P, 3) into the wall.
        probe: (3,) the place where the motion is read, or None.
    """

    clamped: Flags
    loads: Mapping[str, tuple[Array, Array, Flags]]
    contacts: Mapping[str, tuple[Array, Array]]
    probe: Array | None


MARK_COLOURS = {"support": "#56585A", "load": "#D55E00", "contact": "#0072B2", "probe": "#009E73"}


@styled
def setup_figure(surface: Surface, marks: Marks, title: str) -> Figure:
    """Draw the undeformed body with its supports, loads, contacts and probe."""
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    view = view_of(surface)
    reach = 0.14 * view.length
    ends = [surface.points, *(p - reach * n for p, n, _ in (v for v in marks.loads.values()))]
    ends += [places + 0.5 * reach * out for places, out in marks.contacts.values()]
    corner = frame_of([view.project(np.atleast_2d(places)) for places in ends], 0.05 * view.length)
    low, high = corner[0] - [0.0, 0.13 * view.length], corner[1]
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    wide = 8.0 * min(1.0, max(0.6, 1.0 / aspect))
    figure = new_figure(wide, wide * aspect + 1.2)
    axis = figure.subplots()
    colours = np.tile(to_rgba(GREY), (len(surface.triangles), 1))
    held = marks.clamped[surface.triangles].all(axis=1)
    handles: list[Any] = []
    for _, _, on in marks.loads.values():
        if not surface.flat:
            colours[on[surface.triangles].all(axis=1)] = to_rgba("#F3C6A5")
    colours[held & (not surface.flat)] = to_rgba(MARK_COLOURS["support"])
    draw_body(axis, surface, view, None, colours)
    _draw_wires(axis, surface, view)
    _draw_regions(axis, surface, view.project(surface.points), marks)
    if marks.clamped.any():
        handles.append(Patch(color=MARK_COLOURS["support"], label="support"))
    handles += _draw_loads(axis, view, marks, reach)
    handles += _draw_contacts(axis, view, marks, 0.5 * reach)
    if marks.probe is not None:
        at = view.project(marks.probe[None])[0]
        look: dict[str, Any] = {
            "marker": "*",
            "linestyle": "none",
            "markersize": 11,
            "markeredgecolor": "white",
        }
        handles += axis.plot(*at, color=MARK_COLOURS["probe"], label="probe", zorder=6, **look)
    draw_triad(axis, view, low, TRIAD * view.length)
    _panel(axis, low, high)
    axis.set_title(title)
    figure.legend(handles=handles, loc="outside lower center", ncols=min(4, max(1, len(handles))))
    return figure


def _draw_wires(axis: Axes, surface: Surface, view: View) -> None:
    """Draw the edges of the cells that face the viewer."""
    from matplotlib.collections import LineCollection

    facing = normals(surface.points, surface.triangles) @ view.towards
    seen = surface.wires[(facing[surface.wire_sides] > 0.0) | surface.flat]
    places = view.project(surface.points)
    axis.add_collection(
        LineCollection(list(places[seen]), colors="#8c949b", linewidths=0.3, zorder=2.2)
    )


def _draw_regions(axis: Axes, surface: Surface, places: Array, marks: Marks) -> None:
    """Draw the edges of supports, and in the plane of loads, as thick lines."""
    from matplotlib.collections import LineCollection

    loaded = [on for _, _, on in marks.loads.values() if surface.flat]
    for on, colour, width in (
        *((on, "#F3A774", 3.0) for on in loaded),
        (marks.clamped, MARK_COLOURS["support"], 4.0),
    ):
        rim = surface.edges[on[surface.edges].all(axis=1)]
        axis.add_collection(
            LineCollection(list(places[rim]), colors=colour, linewidths=width, zorder=3)
        )
    drawn = surface.triangles[marks.clamped[surface.triangles].all(axis=1)]
    nodes = np.setdiff1d(np.flatnonzero(marks.clamped), [*rim.ravel(), *drawn.ravel()])
    axis.plot(*places[nodes].T, "s", color=MARK_COLOURS["support"], markersize=6, zorder=3)


def _draw_loads(axis: Axes, view: View, marks: Marks, reach: float) -> list[Any]:
    """Draw one arrow per load, which ends at the place of the load; return the legend."""
    from matplotlib.lines import Line2D

    handles = []
    for name, (place, direction, _) in marks.loads.items():
        end, start = view.project(np.array([place, place - reach * direction]))
        if np.linalg.norm(end - start) > 0.15 * reach:
            look: dict[str, Any] = {"arrowstyle": "-|>", "color": MARK_COLOURS["load"], "lw": 2.2}
            axis.annotate("", end, start, arrowprops=look | {"shrinkA": 0, "shrinkB": 0}, zorder=5)
        else:
            axis.plot(*end, "o", color=MARK_COLOURS["load"], markersize=9, zorder=5)
        arrow: dict[str, Any] = {"marker": r"$\rightarrow$", "markersize": 14, "linestyle": "none"}
        handles.append(Line2D([], [], color=MARK_COLOURS["load"], label=name, **arrow))
    return handles


def _draw_contacts(axis: Axes, view: View, marks: Marks, reach: float) -> list[Any]:
    """Draw the contact points with the normals into their walls; return the legend."""
    handles: list[Any] = []
    for name, (places, out) in marks.contacts.items():
        at, ends = view.project(places), view.project(places + reach * out)
        for begin, end in zip(at, ends, strict=True):
            axis.plot(*np.transpose([begin, end]), color=MARK_COLOURS["contact"], lw=1.0, zorder=4)
        look: dict[str, Any] = {
            "linestyle": "none",
            "markersize": 6,
            "markeredgecolor": "white",
            "zorder": 5,
        }
        handles += axis.plot(*at.T, marker="o", color=MARK_COLOURS["contact"], label=name, **look)
    return handles
