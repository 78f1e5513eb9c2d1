"""A page with a body that turns with the mouse, and a list of its shapes and motions.

The page needs no network: it holds the data and the library that draws them, k3d.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import magnification, scale_text
from fenicsrom.post.body.body_figures import SHAPE
from fenicsrom.post.body.body_view import NODE, PolyData, View, form_edges, frame_of
from fenicsrom.post.body.rendering import Part

MOST_TRIANGLES = 6000
"""Largest number of triangles of the body in a page."""

INK = 0x30363C
"""The colour of the edges of the body."""

MOST_SHAPES = 30
"""Largest number of shapes in a page."""

FINE, FINE_COLOUR = 2.0**-13, 2.0**-7
"""Rounding of places, relative to the size of the body, and of colours; both pack better then."""

UNPAINTED = -0.1
"""The value that has no colour."""

FIELD, BROAD = 20.0, 1.6
"""The angle that the camera sees from bottom to top, degrees, and how much wider the view is."""

CONTROLS = Path(__file__).with_name("turning_view.js").read_text(encoding="utf-8")
"""What the page adds to k3d: the list of shapes, and the animation by their times.

A shape swings between its frames as a cosine; a motion runs through them."""


NAMES = Path(__file__).with_name("named_view.js").read_text(encoding="utf-8")
"""What the page of named surfaces adds to k3d: the name of the surface under the pointer."""


@dataclass(frozen=True, eq=False)
class Shown:
    """One entry of the list.

    Attributes:
        name: its name.
        note: what the colours mean.
        moved: (k, n, 3) displacements of the points in its frames, as drawn, m.
        colours: (k, n) or (n,) values from 0 to 1, or `UNPAINTED`.
        loops: whether the frames are a motion, which repeats; otherwise the body swings between
            the two frames.
    """

    name: str
    note: str
    moved: Array
    colours: Array
    loops: bool = False


def swinging(name: str, displacement: Array, length: float) -> Shown:
    """A shape that swings to both sides, its largest displacement `body_figures.SHAPE` of `length`.

    Args:
        name: its name.
        displacement: (n, 3) of any size.
        length: of the body, m.
    """
    sizes = np.linalg.norm(displacement, axis=1)
    unit = displacement / (float(sizes.max()) or 1.0)
    note = "colour: displacement / largest of the shape"
    moved = SHAPE * length * np.array([unit, -unit])
    return Shown(name, note, moved, np.linalg.norm(unit, axis=1))


def loaded(name: str, displacement: Array, length: float) -> Shown:
    """A state (n, 3) that the body reaches from rest, magnified by a stated factor if it is small.

    Arguments as for `swinging`.
    """
    moved = running(name, 0.0, np.array([displacement, 0.0 * displacement]), length)
    return replace(moved, colours=moved.colours[0], loops=False)


def running(name: str, rest: Any, moved: Array, length: float) -> Shown:
    """A motion (k, n, 3) about a state of rest (n, 3), m, magnified as in `loaded`."""
    sizes = np.linalg.norm(moved, axis=2)
    largest = float(sizes.max()) or 1.0
    factor = magnification(largest, length)
    note = f"colour: 0 to {1e3 * largest:.4g} mm, {scale_text(factor)}"
    return Shown(name, note, rest + factor * moved, sizes / largest, loops=True)


def simplified(surface: PolyData) -> PolyData:
    """A surface of at most about `MOST_TRIANGLES` triangles on some of the points of another."""
    if surface.n_cells <= MOST_TRIANGLES:
        return surface
    return surface.decimate_pro(1.0 - MOST_TRIANGLES / surface.n_cells, preserve_topology=True)


def turning_page(plot: Any, entries: Sequence[Mapping[str, Any]]) -> str:
    """Compose the page, as HTML text, of what `turning_plot` gives."""
    return _page(plot, CONTROLS.replace("SHOWN", json.dumps(entries)))


def turning_widget(plot: Any, entries: Sequence[Mapping[str, Any]]) -> Any:
    """Compose a widget for notebooks, with the list above the plot."""
    import ipywidgets

    def choose(change: Mapping[str, Any]) -> None:
        plot.time = float(change["new"])

    found = ipywidgets.Dropdown(options=[(one["name"], one["first"]) for one in entries])
    found.observe(choose, "value")
    return ipywidgets.VBox([found, plot])


def turning_plot(
    surface: PolyData, shown: Sequence[Shown], symbols: Sequence[Part], view: View
) -> tuple[Any, list[dict[str, Any]]]:
    """Draw the body with k3d.

    Args:
        surface: the undeformed body.
        shown: the entries of the list.
        symbols: what marks supports, loads and contacts: triangles, or points.
        view: the first projection.

    Returns:
        The plot, and the name, the note and the times of each entry.
    """
    import k3d

    plot = _plot(surface, view)
    finest = 2.0 ** np.floor(np.log2(FINE * view.length))
    entries: list[dict[str, Any]] = []
    vertices: dict[str, Any] = {}
    colours: dict[str, Any] = {}
    for one in shown:
        entries.append({"name": one.name, "note": one.note, "first": len(vertices)})
        entries[-1] |= {"frames": len(one.moved), "loops": one.loops}
        paint = np.broadcast_to(one.colours, (len(one.moved), surface.n_points))
        for moved, values in zip(one.moved, paint, strict=True):
            time = str(float(len(vertices)))
            vertices[time] = _floats(np.rint((surface.points + moved) / finest) * finest)
            colours[time] = _floats(np.rint(values / FINE_COLOUR) * FINE_COLOUR)
    body = _mesh(
        surface, attribute=colours["0.0"], color_map=_palette(), color_range=[UNPAINTED, 1.0]
    )
    body.vertices, body.attribute = vertices, colours
    edges = form_edges(surface)
    row = np.argsort(surface.point_data[NODE])
    at = row[np.searchsorted(surface.point_data[NODE], edges.point_data[NODE], sorter=row)]
    form = _lines(edges)
    form.vertices = {time: places[at] for time, places in vertices.items()}
    plot += body
    plot += form
    for part in symbols:
        if part.mesh.n_faces:
            plot += _mesh(part.mesh.triangulate(), color=_colour(part))
        else:
            look = {"point_size": 0.012 * view.length, "color": _colour(part)}
            plot += k3d.points(_floats(part.mesh.points), **look)
    return plot, entries


def named_page(parts: Mapping[str, Part], view: View) -> str:
    """Compose a page with surfaces, and with the name of the one under the pointer.

    Args:
        parts: the surfaces, each in one colour, by their names.
        view: the first projection.

    Returns:
        The HTML text.
    """
    import pyvista

    plot = _plot(pyvista.merge([part.mesh for part in parts.values()]), view)
    for name, part in parts.items():
        body = _mesh(part.mesh.triangulate(), color=_colour(part), name=name)
        body.hover_callback = print  # the page answers; k3d wants to know that something does
        plot += body
        plot += _lines(part.mesh.extract_feature_edges(manifold_edges=False, feature_edges=False))
    plot.mode = "callback"
    return _page(plot, NAMES)


def _plot(surface: PolyData, view: View) -> Any:
    """A plot in k3d that looks at a surface."""
    import k3d

    plot = k3d.plot(grid_visible=False, colorbar_object_id=0, camera_auto_fit=False)
    plot.lighting, plot.camera_fov = 0.3, FIELD
    _, low, high = frame_of(view, [surface.points])
    wide, tall = high - low
    deep = surface.points @ view.towards
    away = 0.5 * max(tall, wide / BROAD) / np.tan(np.radians(0.5 * FIELD)) + float(np.ptp(deep))
    middle = np.array([*(0.5 * (low + high)), deep.mean()])
    centre = middle @ np.array([view.right, view.up, view.towards])
    plot.camera = [*(centre + away * view.towards), *centre, *view.up]
    return plot


def _page(plot: Any, script: str) -> str:
    """A page with a plot, and what the script adds to it."""
    plot.snapshot_type, plot.menu_visibility = "full", False
    return str(plot.get_snapshot(4, additional_js_code=script))


def _mesh(surface: PolyData, **look: Any) -> Any:
    """Triangles in k3d."""
    import k3d

    faces = np.array(surface.regular_faces, dtype=np.uint32)
    return k3d.mesh(_floats(surface.points), faces, flat_shading=True, side="double", **look)


def _lines(edges: PolyData) -> Any:
    """Edges in k3d."""
    import k3d

    pairs = np.array(edges.lines.reshape(-1, 3)[:, 1:], dtype=np.uint32)
    look = {"indices_type": "segment", "shader": "simple", "color": INK}
    return k3d.lines(_floats(edges.points), pairs, **look)


def _colour(part: Part) -> int:
    """The colour of a part, as k3d wants it."""
    return int(str(part.look["color"])[1:], 16)


def _palette() -> Any:
    """Grey for `UNPAINTED`, and the colours of the pictures from 0 to 1, as k3d wants them."""
    from matplotlib import colormaps

    levels = np.linspace(0.0, 1.0, 33)
    places = (levels - UNPAINTED) / (1.0 - UNPAINTED)
    grey = [[place, 0.85, 0.87, 0.88] for place in (0.0, 0.5 * places[0])]
    return _floats([*grey, *np.column_stack([places, colormaps["viridis"](levels)[:, :3]])]).ravel()


def _floats(values: Any) -> Any:
    """Values as k3d wants them."""
    return np.array(values, dtype=np.float32)
