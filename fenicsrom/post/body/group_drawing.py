"""The picture of a mesh with its groups coloured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import COLOURS, new_figure, styled
from fenicsrom.post.body.body_surface import is_flat
from fenicsrom.post.body.body_view import END_ON, View, frame_of, is_seen, view_of
from fenicsrom.post.body.rendering import ABOVE, GREY, Part, show
from fenicsrom.post.body.turning_view import named_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import PolyData

MORE_COLOURS = (*COLOURS[:-1], "#8C510A", "#542788", "#7FBC41", "#B2182B", "#35978F", "#F1B6DA")
"""Colours of the groups."""

LETTER = np.array([0.065, 0.08])
"""Width and height of the letters of a name, inches."""

MOST_LINES = 30000
"""Largest number of facets whose edges are drawn; those of more facets hide the colours."""

Ints = NDArray[np.int64]


@styled
def group_figure(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> Figure:
    """Draw a mesh, and its groups in the colours of the legend, with their names on the facets.

    A body in space is seen from in front and from behind. Groups after the last colour are grey.

    Args:
        points: (n, 3) corners, m.
        boundary: corners of the facets (in the plane: of the cells) of the body (k, corners).
        groups: name -> corners of facets (k, corners), or nodes (k,).
    """
    from matplotlib.patches import Patch
    from pyvista import PolyData

    def mesh_of(members: Ints) -> PolyData:
        """Facets, edges or nodes as a mesh."""
        if members.ndim == 1:
            return PolyData(points[members])
        if members.shape[1] == 2:
            return PolyData(points, lines=np.insert(members, 0, 2, axis=1).ravel())
        return PolyData.from_regular_faces(points, members)

    colours = dict(zip(groups, MORE_COLOURS, strict=False))
    lines = {"show_edges": len(boundary) <= MOST_LINES, "edge_color": "#5B636B"}
    body = mesh_of(boundary)
    surface = body.triangulate().clean()
    small_last = sorted(groups, key=lambda name: -len(groups[name]))

    def meshes_of(seen: View) -> dict[str, PolyData]:
        """The groups, small ones in front of large ones on the same faces."""
        step = 0.2 * ABOVE * seen.length / max(1.0, len(groups) / len(MORE_COLOURS)) * seen.towards
        return {
            name: mesh_of(groups[name]).translate(k * step) for k, name in enumerate(small_last, 1)
        }

    def parts_of(meshes: Mapping[str, PolyData]) -> list[Part]:
        """The body and its groups."""
        parts = [Part(body, {"color": GREY, **lines})]
        for name, mesh in meshes.items():
            look = {"color": colours.get(name, GREY), "line_width": 6.0, "point_size": 12.0}
            look |= {"line_width": 1.2, **lines} if mesh.n_faces else {}
            parts.append(Part(mesh, look, symbol=not mesh.n_faces))
        return parts

    view = view_of(surface, oblique=END_ON)
    views = [view, replace(view, right=-view.right, towards=-view.towards)]
    views = views[:1] if is_flat(points) else views
    columns = min(6, max(1, len(colours)))
    places = [seen.project(surface.points) for seen in views]
    extent = np.max([np.ptp(place, axis=0) for place in places], axis=0)
    wide = 9.0 / max(1.5, len(views))
    spare = 0.5 + 0.3 * -(-len(colours) // columns)
    figure = new_figure(wide * len(views), 1.2 * wide * extent[1] / extent[0] + spare)
    for axis, seen, place in zip(
        np.ravel(figure.subplots(1, len(views))), views, places, strict=True
    ):
        low, high = frame_of([place], 0.03 * view.length)
        low = low - [0.0, 0.13 * view.length]
        meshes = meshes_of(seen)
        show(axis, parts_of(meshes), seen, low, high, wide)
        letter = LETTER * (high[0] - low[0]) / wide
        for name, spot in _named_places(meshes, surface, seen, letter).items():
            box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none"}
            text = axis.text(spot[0], spot[1], name, fontsize=7, ha="center", va="center", bbox=box)
            text.set_in_layout(False)  # it lies inside the panel; measuring it takes time
    if groups:
        handles = [Patch(color=colour, label=name) for name, colour in colours.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure


def group_page(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> str:
    """A page that turns the body, and names the groups of the facet under the pointer.

    Arguments as for `group_figure`; a facet is in a group of nodes with all its corners.
    """
    from pyvista import PolyData

    colours = dict(zip(groups, MORE_COLOURS, strict=False))
    names = np.full(len(boundary), "", dtype=object)
    painted = np.full(len(boundary), GREY, dtype=object)
    for name in sorted(groups, key=lambda name: -len(groups[name])):
        inside = _inside(boundary, groups[name])
        names[inside] += np.where(names[inside] != "", ", ", "") + name
        painted[inside] = colours.get(name, GREY)
    parts = {}
    for name in dict.fromkeys(names):
        own = names == name
        mesh = PolyData.from_regular_faces(points, boundary[own]).clean()
        parts[name or "no group"] = Part(mesh, {"color": painted[own][0]})
    body = PolyData.from_regular_faces(points, boundary).triangulate().clean()
    return named_page(parts, view_of(body, oblique=END_ON))


def _inside(boundary: Ints, members: Ints) -> NDArray[np.bool_]:
    """Which facets (k, corners) of the boundary are in a group of facets, or of nodes (m,)."""
    if members.ndim == 1:
        return np.asarray(np.isin(boundary, members).all(axis=1))
    rows = np.sort(np.concatenate([boundary, members]), axis=1)
    numbers = np.unique(rows, axis=0, return_inverse=True)[1].ravel()
    return np.isin(numbers[: len(boundary)], numbers[len(boundary) :])


def _named_places(
    meshes: Mapping[str, PolyData], surface: PolyData, view: View, size: Array
) -> dict[str, Array]:
    """Where the names of groups of facets stand (2,): on the facet nearest to the middle, if seen.

    A name that would cover that of an earlier group is left out; `size` (2,) is that of a letter.
    """
    found: dict[str, Array] = {}
    for name, mesh in meshes.items():
        if not mesh.n_faces:
            continue
        centres = mesh.cell_centers().points
        place = centres[np.argmin(np.linalg.norm(centres - centres.mean(axis=0), axis=1))]
        at = view.project(place)
        near = (
            (np.abs(at - other) < size * [0.5 * len(name + text), 2.0]).all()
            for text, other in found.items()
        )
        if is_seen(surface, place, view) and not any(near):
            found[name] = at
    return found
