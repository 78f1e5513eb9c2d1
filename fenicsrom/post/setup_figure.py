"""The picture of the set-up: the mesh with its supports, loads, contacts and probe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.body_drawing import GREY, body_panel, draw_body
from fenicsrom.post.body_surface import Ints, Surface, areas, normals
from fenicsrom.post.body_view import View, frame_of, view_of
from fenicsrom.post.style import styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Flags = NDArray[np.bool_]


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

    def at(self, kept: Ints) -> Marks:
        """The marks on the points of a surface that has only these points of the whole one."""
        loads = {name: (place, way, on[kept]) for name, (place, way, on) in self.loads.items()}
        return replace(self, clamped=self.clamped[kept], loads=loads)


MARK_COLOURS = {"support": "#56585A", "load": "#D55E00", "contact": "#0072B2", "probe": "#009E73"}


@styled
def setup_figure(surface: Surface, marks: Marks, title: str) -> Figure:
    """Draw the undeformed body with its supports, loads, contacts and probe.

    The viewer sees the side on which the loads act.
    """
    from matplotlib.colors import to_rgba
    from matplotlib.patches import Patch

    view = view_of(surface.points, surface.triangles, _loaded_side(surface, marks))
    reach = 0.14 * view.length
    ends = [surface.points, *(p - reach * n for p, n, _ in (v for v in marks.loads.values()))]
    ends += [places + 0.5 * reach * out for places, out in marks.contacts.values()]
    corner = frame_of([view.project(np.atleast_2d(places)) for places in ends], 0.05 * view.length)
    low, high = corner[0] - [0.0, 0.13 * view.length], corner[1]
    figure, axis = body_panel(view, low, high, 1.2)
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
    axis.set_title(title)
    figure.legend(handles=handles, loc="outside lower center", ncols=min(4, max(1, len(handles))))
    return figure


def _loaded_side(surface: Surface, marks: Marks) -> Array:
    """(3,) mean normal of the loaded parts of the surface, times their area."""
    sizes = areas(surface.points, surface.triangles)
    loaded = [on[surface.triangles].all(axis=1) for _, _, on in marks.loads.values()]
    return np.sum([sizes[found].sum(axis=0) for found in loaded], axis=0) + np.zeros(3)


def _draw_wires(axis: Axes, surface: Surface, view: View) -> None:
    """Draw the edges of the cells that face the viewer."""
    from matplotlib.collections import LineCollection

    facing = normals(surface.points, surface.triangles) @ view.towards
    seen = surface.wires[(facing[surface.wire_sides] > 0.0) | surface.flat]
    places: Any = view.project(surface.points)
    axis.add_collection(LineCollection(places[seen], colors="#8c949b", linewidths=0.3, zorder=2.2))


def _draw_regions(axis: Axes, surface: Surface, places: Any, marks: Marks) -> None:
    """Draw the edges of supports, and in the plane of loads, as thick lines."""
    from matplotlib.collections import LineCollection

    loaded = [on for _, _, on in marks.loads.values() if surface.flat]
    for on, colour, width in (
        *((on, "#F3A774", 3.0) for on in loaded),
        (marks.clamped, MARK_COLOURS["support"], 4.0),
    ):
        rim = surface.edges[on[surface.edges].all(axis=1)]
        axis.add_collection(LineCollection(places[rim], colors=colour, linewidths=width, zorder=3))
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
