"""Figures of response curves: Floquet multipliers in the complex plane, and harmonics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.response_results import Response, ResponseCurve
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.post.base.style import COLOURS, new_panels, styled
from fenicsrom.post.curves.response_figures import (
    INK,
    curve_name,
    direction_name,
    draw_curves,
    largest_component,
    parameter_label,
    shown_curves,
    style_handles,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FARTHEST = 2.5  # multipliers farther from the origin are drawn at the edge
MOST = 6000  # largest number of multipliers in one picture
# thin and bright: seen on the dots that lie on it
CIRCLE: dict[str, Any] = {"color": "#E31A1C", "linewidth": 0.7, "zorder": 4}
FLOOR = 1e-5  # harmonics below this part of the largest are not drawn


@styled
def multiplier_figure(found: Response) -> Figure:
    """Draw the Floquet multipliers of some curves, coloured by the parameter."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    curves = shown_curves(found)
    places = [point.parameter for curve in curves for point in curve.points]
    colours = Normalize(min(places), max(places))
    columns = min(len(curves), 2)  # of the legend
    drawn, axes = new_panels(
        3.4 * len(curves) + 1.6, 4.9 - 0.3 * columns, 1, len(curves), sharey=True, sharex=True
    )
    reach = 1.0
    for axis, curve in zip(axes, curves, strict=True):
        reach = max(reach, _draw_multipliers(axis, curve, colours))
        axis.set_title(curve_name(found, curve))
        axis.set_xlabel("real part")
        axis.set_aspect("equal")
    limit = 1.15 * reach
    axes[0].set_xlim(-limit, limit)
    axes[0].set_ylim(-limit, limit)
    axes[0].set_ylabel("imaginary part")
    bar: Any = drawn.colorbar(ScalarMappable(colours, "viridis"), ax=axes, aspect=30)
    bar.set_label(parameter_label(found))
    bar.outline.set_visible(False)
    drawn.legend(*axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return drawn


def _draw_multipliers(axis: Axes, curve: ResponseCurve, colours: Any) -> float:
    """Draw the multipliers of a curve and the unit circle; give how far from 0 they reach."""
    values, parameters = multipliers_of(curve)
    size = np.abs(values)
    far = size > FARTHEST
    drawn = np.where(far, values / np.maximum(size, 1e-300) * FARTHEST, values)
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    axis.plot(np.cos(angle), np.sin(angle), label="unit circle: stable inside", **CIRCLE)
    look = {"cmap": "viridis", "norm": colours, "linewidths": 0.0, "zorder": 3}
    near = {"label": "Floquet multipliers, a colour for each motion", "s": 9, **look}
    axis.scatter(drawn[~far].real, drawn[~far].imag, c=parameters[~far], **near)
    if np.any(far):
        axis.scatter(drawn[far].real, drawn[far].imag, c=parameters[far], s=22, marker="D", **look)
        text = f"diamonds: farther out, up to {size.max():.3g}"
        axis.text(0.5, 0.01, text, transform=axis.transAxes, ha="center", fontsize=8, color=INK)
    return float(np.max(np.abs(drawn), initial=1.0))


def multipliers_of(curve: ResponseCurve) -> tuple[NDArray[np.complex128], Array]:
    """Multipliers of a curve, of at most `MOST` evenly chosen, and the parameter of each."""
    points = curve.points
    total = sum(point.multipliers.size for point in points)
    chosen = points[:: max(1, -(-total // MOST))]
    values = np.concatenate([point.multipliers for point in chosen])
    parameters = [np.full(point.multipliers.size, point.parameter) for point in chosen]
    return values, np.concatenate(parameters)


@styled
def harmonics_figure(found: Response) -> Figure:
    """Draw the amplitudes of the first harmonics along some curves."""
    from matplotlib.lines import Line2D

    curves = shown_curves(found)
    place, direction = largest_component(found)
    drawn, axes = new_panels(max(3.1 * len(curves), 6.4) + 0.8, 3.9, 1, len(curves), sharey=True)

    def sizes(points: list[CurvePoint]) -> Array:
        """Amplitudes (H, points) of the harmonics, mm."""
        return 1e3 * np.abs([point.harmonics[:, place, direction] for point in points]).T

    highest = np.max([sizes(curve.points).max(axis=1) for curve in curves], axis=0)
    drawable = np.flatnonzero(highest > FLOOR * highest.max())
    for axis, curve in zip(axes, curves, strict=True):
        draw_curves(
            axis,
            found,
            [curve],
            lambda points: sizes(points)[drawable],
            [COLOURS[k] for k in drawable],
        )
        axis.set_yscale("log")
        axis.set_title(curve_name(found, curve))
        axis.set_xlabel(parameter_label(found))
    axes[0].set_ylim(FLOOR * highest.max(), 2.0 * highest.max())
    axes[0].set_ylabel(f"{direction_name(found)} harmonics, mm")
    handles: list[Any] = [
        Line2D([], [], color=COLOURS[k], label=f"harmonic {k + 1}") for k in drawable
    ]
    handles += style_handles(found)
    drawn.legend(handles=handles, loc="outside upper center", ncols=4)
    return drawn
