"""The picture of a mesh with its groups coloured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import COLOURS, styled
from fenicsrom.post.body.body_drawing import GREY, body_panel
from fenicsrom.post.body.body_view import END_ON, View, frame_of, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MORE_COLOURS = (*COLOURS[:-1], "#8C510A", "#542788", "#7FBC41", "#B2182B", "#35978F", "#F1B6DA")
"""Colours of the groups."""

MOST_LINES = 30000
"""Largest number of facets whose edges are drawn; those of more facets hide the colours."""

Ints = NDArray[np.int64]


@styled
def group_figure(points: Array, boundary: Ints, groups: Mapping[str, Ints]) -> Figure:
    """Draw a mesh, and its groups in the colours of the legend.

    The boundary is seen through, so that groups behind the body and inside it show as well.

    Args:
        points: (n, 3) corners, m.
        boundary: corners of the facets (in the plane: of the cells) of the body (k, corners).
        groups: name -> corners of facets (k, corners), or nodes (k,).
    """
    from matplotlib.patches import Patch

    used = np.unique(boundary)
    fan = boundary[:, [[0, k, k + 1] for k in range(1, boundary.shape[1] - 1)]].reshape(-1, 3)
    view = view_of(points[used], np.searchsorted(used, fan), oblique=END_ON)
    low, high = frame_of([view.project(points[used])], 0.03 * view.length)
    rows = -(-len(groups) // _columns(groups))
    figure, axis = body_panel(view, low - [0.0, 0.13 * view.length], high, 0.3 + 0.3 * rows)
    places = view.project(points)
    lines = 0.4 if len(boundary) <= MOST_LINES else 0.0
    _fill(axis, places, _behind_first(points, boundary, view), GREY, 0.45, lines)
    colours = dict(zip(groups, MORE_COLOURS, strict=False))
    for name in sorted(groups, key=lambda name: _in_front(points, groups[name], view)):
        members, colour = groups[name], colours[name]
        if members.ndim == 1:
            axis.plot(*places[members].T, "o", color=colour, markersize=6, zorder=3)
        elif members.shape[1] == 2:
            _draw_lines(axis, places[members], colour)
        else:
            lines = 0.6 if len(members) <= MOST_LINES else 0.0
            _fill(axis, places, _behind_first(points, members, view), colour, 0.85, lines)
    if groups:
        handles = [Patch(color=colour, label=name) for name, colour in colours.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=_columns(groups))
    return figure


def _columns(groups: Mapping[str, Ints]) -> int:
    """Columns of the legend."""
    return min(6, max(1, len(groups)))


def _in_front(points: Array, members: Ints, view: View) -> tuple[float, float]:
    """The order of groups: small ones in front of large ones, then those near the viewer."""
    depth = float((points[members.ravel()] @ view.towards).mean())
    return -float(np.rint(np.log2(len(members)))), depth


def _behind_first(points: Array, facets: Ints, view: View) -> Ints:
    """Sort facets (k, corners) so that those in front come last."""
    return facets[np.argsort(points[facets].mean(axis=1) @ view.towards, kind="stable")]


def _fill(axis: Axes, places: Any, facets: Ints, colour: str, opacity: float, width: float) -> None:
    """Draw facets (k, corners) in one colour, with their edges in this width."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    look: dict[str, Any] = {
        "facecolors": to_rgba(colour, opacity),
        "linewidths": width,
        "zorder": 3,
    }
    axis.add_collection(
        PolyCollection(places[facets], edgecolors=to_rgba("#5b636b", 0.7), **look), autolim=False
    )


def _draw_lines(axis: Axes, lines: Any, colour: str) -> None:
    """Draw thick lines (k, 2, 2)."""
    from matplotlib.collections import LineCollection

    axis.add_collection(
        LineCollection(lines, colors=colour, linewidths=3.0, zorder=3), autolim=False
    )
