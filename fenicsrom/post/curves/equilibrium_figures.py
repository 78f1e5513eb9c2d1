"""The figure of an equilibrium path: load factor against the displacement of the probe."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from fenicsrom.assess.curves.equilibrium_path import Equilibrium, EquilibriumPath
from fenicsrom.post.base.style import COLOURS, new_panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {"limit point": ("o", COLOURS[1]), "bifurcation": ("D", COLOURS[2])}


@styled
def figure(found: EquilibriumPath) -> Figure:
    """Draw the path, solid where it is stable and dashed where it is not, with special points."""
    drawn, (axes,) = new_panels(7.4, 5.0)
    draw_path(axes, found)
    axes.set_xlabel(f"displacement of the probe along {'xyz'[found.direction]}, mm")
    axes.set_ylabel("load factor")
    if len(axes.get_legend_handles_labels()[0]) > 1:
        axes.legend(loc="best")
    return drawn


def draw_path(axes: Axes, found: EquilibriumPath) -> None:
    """Draw the path and its special points into axes."""
    axis = found.direction
    for stable, part in _parts(found.points):
        axes.plot(
            [1e3 * point.probe[axis] for point in part],
            [point.load_factor for point in part],
            color=COLOURS[0],
            linestyle="-" if stable else (0, (4, 2.5)),
            label=_once(axes, "stable" if stable else "unstable"),
        )
    for kind, (marker, colour) in MARKERS.items():
        special = [point for point in found.special if point.kind == kind]
        if special:
            axes.plot(
                [1e3 * point.probe[axis] for point in special],
                [point.load_factor for point in special],
                marker,
                color=colour,
                markerfacecolor="white",
                markersize=6,
                label=kind,
            )


def _once(axes: Axes, label: str) -> str:
    """A label that the legend shows once."""
    return f"_{label}" if label in axes.get_legend_handles_labels()[1] else label


def _parts(points: list[Equilibrium]) -> list[tuple[bool, list[Equilibrium]]]:
    """Connected parts of the path, each with one stability.

    A special point belongs to both parts beside it. The ordinary points of a part give its
    stability.
    """
    found: list[tuple[bool, list[Equilibrium]]] = []
    for a, b in pairwise(points):
        sides = [point.negative_pivots == 0 for point in (a, b) if not point.kind]
        stable = all(sides) if sides else False
        if found and found[-1][0] == stable:
            found[-1][1].append(b)
        else:
            found.append((stable, [a, b]))
    return found
