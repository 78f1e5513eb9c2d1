"""The figure of response curves: amplitude, largest Floquet multiplier and peak normal force."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.branches import Piece
from fenicsrom.assess.response import Response, judged_multiplier
from fenicsrom.online.curve import CurvePoint
from fenicsrom.post.style import COLOURS, new_figure, styled
from fenicsrom.scene import parameter_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {
    "fold": "o",
    "branch point": "p",
    "period doubling": "s",
    "torus": "D",
    "non-smooth": "X",
    "first touch": "v",
    "last touch": "v",
    "first lift-off": "^",
    "last lift-off": "^",
    "first slip": ">",
    "last slip": ">",
}
UNITS = {
    "frequency": "Hz",
    "force": "N",
    "traction": "Pa",
    "pressure": "Pa",
    "acceleration": "m/s²",
    "mass_damping": "1/s",
    "gap": "m",
    "friction": "",
    "preload": "N",
    "normal_stiffness": "N/m",
    "tangential_stiffness": "N/m",
}
FLAT = 3.0  # a multiplier above this needs a logarithmic axis
INK = "#555B61"


def directions(found: Response) -> list[str]:
    """The names of the directions in which amplitudes are given."""
    if not found.contacts:
        return list("xyz"[: found.dimension])
    if found.dimension == 2:
        return ["normal", "tangential"]
    return ["normal", "tangential 1", "tangential 2"]


def largest_direction(found: Response) -> int:
    """The direction with the largest amplitude on any curve."""
    points = [point for curve in found.curves for point in curve.points]
    return int(np.argmax(np.max([point.amplitude.max(axis=0) for point in points], axis=0)))


def parameter_label(found: Response) -> str:
    """The parameter with its unit; without for a region of nodes, whose unit depends on it."""
    key = found.table.parameter
    table, index, name = parameter_of(key)
    per_node = table == "contacts" and found.scene.contacts[index].place.at == "nodes"
    unit = "" if per_node and name not in ("gap", "friction") else UNITS[name]
    return f"{key}, {unit}" if unit else key


def in_order(piece: Piece) -> list[CurvePoint]:
    """The points of a piece, with its bifurcations where the curve passes them."""
    points = list(piece.points)
    if not points:
        return points
    size = max(float(np.linalg.norm(point.s)) for point in points) or 1.0
    width = max(abs(points[-1].parameter - points[0].parameter), abs(points[0].parameter))

    def place(point: CurvePoint) -> Array:
        return np.append(point.s / size, point.parameter / width)

    for special in piece.special:
        places = np.array([place(point) for point in points])
        ways = np.linalg.norm(places - place(special), axis=1)
        detours = ways[:-1] + ways[1:] - np.linalg.norm(np.diff(places, axis=0), axis=1)
        points.insert(int(np.argmin(detours)) + 1 if detours.size else 0, special)
    return points


@styled
def figure(found: Response) -> Figure:
    """Draw the curves: stable parts solid, unstable parts dashed, bifurcations marked."""
    direction = largest_direction(found)
    quantities: list[tuple[str, Callable[[CurvePoint], float]]] = [
        (
            f"{directions(found)[direction]} amplitude, mm",
            lambda point: 1e3 * float(point.amplitude[:, direction].max()),
        ),
        ("largest multiplier", lambda point: abs(judged_multiplier(point))),
    ]
    if found.contacts:
        quantities.append(("peak normal force, N", lambda point: float(point.peak_force.max())))
    heights = [2.4, *(1.0 for _ in quantities[1:])]
    drawn = new_figure(8.4, 2.2 * sum(heights))
    axes = drawn.subplots(len(quantities), sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    for axis, (label, value) in zip(axes, quantities, strict=True):
        _draw(axis, found, value)
        axis.set_ylabel(label)
    axes[0].set_ylim(bottom=0.0)
    axes[1].axhline(1.0, color=INK, linewidth=0.8, zorder=1)
    multipliers = [
        abs(judged_multiplier(point)) for curve in found.curves for point in curve.points
    ]
    if max(multipliers) > FLAT:
        axes[1].set_yscale("log")
    axes[-1].set_xlabel(parameter_label(found))
    drawn.align_ylabels(axes)
    handles = _legend(found)
    if handles:
        drawn.legend(handles=handles, loc="outside upper center", ncols=min(len(handles), 5))
    return drawn


def _draw(axis: Axes, found: Response, value: Callable[[CurvePoint], float]) -> None:
    """Draw one quantity of all curves."""
    for k, curve in enumerate(found.curves):
        colour = COLOURS[k % len(COLOURS)]
        for piece in curve.pieces:
            for stable, part in stretches(in_order(piece)):
                axis.plot(
                    [point.parameter for point in part],
                    [value(point) for point in part],
                    linestyle="-" if stable else (0, (4, 2)),
                    color=colour,
                    zorder=3 if stable else 2,
                )
            for point in piece.special:
                axis.plot(
                    point.parameter,
                    value(point),
                    MARKERS[point.kind],
                    color=colour,
                    markerfacecolor="white",
                    markersize=5,
                    zorder=4,
                )


def stretches(points: list[CurvePoint]) -> list[tuple[bool, list[CurvePoint]]]:
    """Split a curve into stable and unstable stretches, which share a bifurcation between them."""
    found: list[tuple[bool, list[CurvePoint]]] = []
    for before, after in pairwise(points):
        stable = all(point.stable for point in (before, after) if not point.kind)
        if found and found[-1][0] == stable:
            found[-1][1].append(after)
        else:
            found.append((stable, [before, after]))
    return found


def _legend(found: Response) -> list[Any]:
    """The entries of the legend: a line for each curve, the styles and the marks that occur."""
    from matplotlib.lines import Line2D

    handles = []
    families = found.table.families
    if families is not None:
        for k, curve in enumerate(found.curves):
            label = f"{families.key.rsplit('.', 1)[-1]} = {curve.value:g}"
            handles.append(Line2D([], [], color=COLOURS[k % len(COLOURS)], label=label))
    parts = [
        stable
        for curve in found.curves
        for piece in curve.pieces
        for stable, _ in stretches(in_order(piece))
    ]
    for stable, word, style in ((True, "stable", "-"), (False, "unstable", (0, (4, 2)))):
        if stable in parts and False in parts:
            handles.append(Line2D([], [], color=INK, linestyle=style, label=word))
    kinds = {point.kind for curve in found.curves for point in curve.special}
    for kind, marker in MARKERS.items():
        if kind in kinds:
            look: dict[str, Any] = {
                "linestyle": "",
                "color": INK,
                "markerfacecolor": "white",
                "markersize": 5,
            }
            handles.append(Line2D([], [], marker=marker, label=kind, **look))
    return handles
