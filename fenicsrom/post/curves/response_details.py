"""More figures of response curves: Floquet multipliers, harmonics and maps of contact states."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.response_results import Response, ResponseCurve
from fenicsrom.assess.curves.stability_search import lengths_along
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.post.base.style import (
    COLOURS,
    Axes,
    Figure,
    new_figure,
    new_panels,
    state_handles,
    state_map,
    styled,
)
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

FARTHEST = 2.5  # multipliers farther from the origin are drawn at the edge
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
        axis.set(title=curve_name(found, curve), xlabel="real part")
        axis.set_aspect("equal")
    limit = 1.15 * reach
    axes[0].set_xlim(-limit, limit)
    axes[0].set_ylim(-limit, limit)
    axes[0].set_ylabel("imaginary part")
    mapped, label = ScalarMappable(colours, "viridis"), parameter_label(found)
    bar: Any = drawn.colorbar(mapped, ax=axes, aspect=30, label=label)
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
    """The multipliers of all points of a curve, and the parameter of each."""
    values = np.concatenate([point.multipliers for point in curve.points])
    parameters = [np.full(point.multipliers.size, point.parameter) for point in curve.points]
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
    colours = [COLOURS[k] for k in drawable]
    for axis, curve in zip(axes, curves, strict=True):
        draw_curves(axis, found, [curve], lambda points: sizes(points)[drawable], colours)
        axis.set(yscale="log", title=curve_name(found, curve), xlabel=parameter_label(found))
    axes[0].set_ylim(FLOOR * highest.max(), 2.0 * highest.max())
    axes[0].set_ylabel(f"{direction_name(found)} harmonics, mm")
    names = [f"harmonic {k + 1}" for k in drawable]
    lines = [Line2D([], [], color=c, label=n) for c, n in zip(colours, names, strict=True)]
    handles = [*lines, *style_handles(found)]
    drawn.legend(handles=handles, loc="outside upper center", ncols=4)
    return drawn


POINTS = 3  # largest number of contact points that are drawn
TICKS = 6  # largest number of marks along a curve with folds
CLOSE = 0.1  # smallest distance of two marks, in parts of the map


def shown_points(found: Response) -> NDArray[np.int64]:
    """The contact points to draw, in their order; these have the most changes of state."""
    changes = np.zeros(found.contacts)
    for curve in found.curves:
        for point in curve.points:
            states = point.period_states
            changes += np.sum(states != np.roll(states, 1, axis=0), axis=0)
    chosen = np.argsort(-changes, kind="stable")[:POINTS]
    return np.sort(chosen)


def folds_back(curve: ResponseCurve) -> bool:
    """Whether the parameter turns back on any piece of a curve."""
    for piece in curve.pieces:
        steps = np.diff([point.parameter for point in piece.points])
        if np.any(steps > 0.0) and np.any(steps < 0.0):
            return True
    return False


def draw_map(axis: Axes, curve: ResponseCurve, contact: int, folded: bool) -> None:
    """Draw the map of one contact point along a curve; a gap between two pieces stays white.

    Args:
        axis: the axes.
        curve: the curve.
        contact: the contact point.
        folded: whether the abscissa is the length along the curve instead of the parameter.
    """
    parts = [piece for piece in curve.pieces if piece.points]
    pieces = [piece.points for piece in parts]
    places, begin = [], 0.0
    for points, along in zip(pieces, lengths_along(parts), strict=True):
        places.append(np.array([point.parameter for point in points]))
        if folded:
            places[-1] = begin + along
            begin = places[-1][-1]
        states = np.array([point.period_states[:, contact] for point in points]).T
        instants = (np.arange(len(states)) + 0.5) / len(states)
        axis.pcolormesh(places[-1], instants, states, **state_map())
    ends = np.concatenate(places)
    axis.set(xlim=(ends.min(), ends.max()), ylim=(0.0, 1.0))
    axis.grid(False)
    if folded:
        axis.set_xticks(*zip(*_marks(pieces, places, np.ptp(ends)), strict=True))


def _marks(
    pieces: Sequence[Sequence[CurvePoint]], places: Sequence[Array], width: float
) -> list[tuple[float, str]]:
    """Marks with the parameter along a curve: its ends and turns first, then places between."""
    wanted: list[tuple[float, float]] = []
    between: list[tuple[float, float]] = []
    for points, place in zip(pieces, places, strict=True):
        values = np.array([point.parameter for point in points])
        turns = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
        wanted += [(float(place[k]), values[k]) for k in (0, *turns, values.size - 1)]
        even = np.searchsorted(place, np.linspace(place[0], place[-1], 2 * TICKS))
        between += [(float(place[k]), values[k]) for k in np.minimum(even, values.size - 1)]
    kept: list[tuple[float, str]] = []
    for number, (place_, value) in enumerate(wanted + between):
        free = all(abs(place_ - other) > CLOSE * width for other, _ in kept)
        if free and (number < len(wanted) or len(kept) < TICKS):
            kept.append((place_, f"{value:.4g}"))
    return sorted(kept)


@styled
def contact_map(found: Response) -> Figure:
    """Draw the contact states: the period upwards, a row of maps for each contact point."""
    curves, contacts = shown_curves(found), shown_points(found)
    wide = max(4.6 if len(curves) == 1 else 3.2, 9.6 / max(len(curves), 2))
    drawn = new_figure(wide * len(curves) + 1.0, 2.3 * len(contacts) + 1.2)
    axes = drawn.subplots(len(contacts), len(curves), squeeze=False, sharey=True)
    for column, curve in enumerate(curves):
        folded = folds_back(curve)
        for row, contact in enumerate(contacts):
            axis = axes[row, column]
            draw_map(axis, curve, int(contact), folded)
            axis.tick_params(labelbottom=row == len(contacts) - 1)
            if column == 0:
                point = f"point {contact + 1}: " if found.contacts > 1 else ""
                axis.set_ylabel(f"{point}time / period")
        axes[0, column].set_title(curve_name(found, curve))
        label = parameter_label(found)
        axes[-1, column].set_xlabel(f"{label} (along the curve)" if folded else label)
    present = {int(state) for c in curves for p in c.points for state in np.unique(p.period_states)}
    handles = state_handles(present)
    drawn.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return drawn
