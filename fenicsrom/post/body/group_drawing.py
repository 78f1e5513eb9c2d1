"""The picture of a mesh with its groups coloured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import COLOURS, styled
from fenicsrom.post.body.body_view import END_ON, frame_of, view_of
from fenicsrom.post.body.rendering import GREY, Part, body_panel, show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MORE_COLOURS = (*COLOURS[:-1], "#8C510A", "#542788", "#7FBC41", "#B2182B", "#35978F", "#F1B6DA")
"""Colours of the groups."""

MOST_LINES = 30000
"""Largest number of facets whose edges are drawn; those of more facets hide the colours."""

Ints = NDArray[np.int64]


@styled
def group_figure(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> Figure:
    """Draw a mesh, and its groups in the colours of the legend.

    Groups behind the body and inside it are pale.

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
    parts = [Part(body, {"color": GREY, **lines})]
    for name in sorted(groups, key=lambda name: -groups[name].shape[0]):
        look = {"color": colours[name], "line_width": 5.0, "point_size": 12.0, **lines}
        parts.append(Part(mesh_of(groups[name]), look, symbol=True))
    surface = body.triangulate().clean()
    view = view_of(surface, oblique=END_ON)
    low, high = frame_of([view.project(surface.points)], 0.03 * view.length)
    low = low - [0.0, 0.13 * view.length]
    columns = min(6, max(1, len(groups)))
    figure, axis, wide = body_panel(view, low, high, 0.3 + 0.3 * -(-len(groups) // columns))
    show(axis, parts, view, low, high, wide)
    if groups:
        handles = [Patch(color=colour, label=name) for name, colour in colours.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure
