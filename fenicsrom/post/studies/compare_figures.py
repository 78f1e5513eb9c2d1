"""Figures of a comparison: error against run time, size of the basis and indicator."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.assess.errors.agreement import pareto_front
from fenicsrom.assess.studies.compare import Comparison, Outcome
from fenicsrom.post.base.directions import error_names
from fenicsrom.post.base.style import COLOURS, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {"rubin": "o", "craig-bampton": "s"}
METHODS = {"rubin": "Rubin", "craig-bampton": "Craig–Bampton"}
# large hollow squares: equal values of the other method stay visible
LINE_LOOKS: dict[str, dict[str, Any]] = {
    "rubin": {"marker": "o", "markersize": 4.5, "linestyle": "-"},
    "craig-bampton": {
        "marker": "s",
        "markersize": 9,
        "markerfacecolor": "none",
        "linestyle": "--",
    },
}
SHORT = {"rubin": "R", "craig-bampton": "CB"}
LEAST = 1e-6  # percent; smaller errors are drawn at this value


def amplitude_error(outcome: Outcome) -> float:
    """Error of the tangential amplitude of an outcome with a full model, percent."""
    error = outcome.errors["amplitude_tangential"]
    assert error is not None
    return error


def _error_label(comparison: Comparison) -> str:
    """The label of an axis with the errors of the amplitude."""
    return f"error of the {error_names(comparison.scene, comparison.points)[1]} amplitude, %"


def _colours(outcomes: list[Outcome]) -> dict[str, str]:
    """Give each way of selecting derivatives a colour."""
    names = list(dict.fromkeys(o.combination.chosen for o in outcomes))
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def _point(outcome: Outcome) -> str:
    """Label a point by method, number of modes and size."""
    c = outcome.combination
    steps = "" if c.steps is None else f"/{c.steps}"
    return f"{SHORT[c.method]}{c.modes}·{len(outcome.labels)}{steps}{c.mesh.partition('=')[2]}"


@styled
def pareto_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against online and total time, with the Pareto front."""
    outcomes = [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]
    figure = new_figure(10.5, 5.8)
    axes = figure.subplots(1, 2, sharey=True)
    colours = _colours(outcomes)
    errors = [max(amplitude_error(o), LEAST) for o in outcomes]
    assert comparison.full is not None
    for axis, title, offline in zip(
        axes, ("online time", "offline and online time"), (False, True), strict=True
    ):
        costs = [o.online_seconds + offline * o.offline_seconds for o in outcomes]
        front = pareto_front(costs, errors)
        steps = [(costs[k], errors[k]) for k in front]
        # a staircase: between two points of the front, the left one is the best available
        xs = [x for k, (x, _) in enumerate(steps) for x in ([x, x] if k else [x])]
        ys = [y for k, (_, y) in enumerate(steps) for y in ([steps[k - 1][1], y] if k else [y])]
        axis.plot(xs, ys, color="#9AA0A6", linewidth=1.2, zorder=1)
        for k, (outcome, cost, error) in enumerate(zip(outcomes, costs, errors, strict=True)):
            c = outcome.combination
            filled = c.elastic_force == "polynomial"
            axis.scatter(
                cost,
                error,
                s=52 if k in front else 26,
                marker=MARKERS[c.method],
                zorder=3,
                linewidths=1.3,
                edgecolors=colours[c.chosen],
                facecolors=colours[c.chosen] if filled else "white",
            )
        axis.axvline(comparison.full.seconds, color="#000000", linewidth=1.0, linestyle=":")
        axis.set(xscale="log", yscale="log", xlabel=f"{title}, s", title=f"{title}")
        _annotate(
            axis,
            [_point(o) for o in outcomes],
            [colours[o.combination.chosen] for o in outcomes],
            costs,
            errors,
            front,
        )
        axis.annotate(
            "full model",
            (comparison.full.seconds, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-4, -4),
            textcoords="offset points",
            rotation=90,
            ha="right",
            va="top",
            fontsize=8.5,
        )
    axes[0].set_ylabel(_error_label(comparison))
    _key(figure, outcomes, colours)
    return figure


def _annotate(
    axis: Axes,
    names: list[str],
    colours: list[str],
    xs: list[float],
    ys: list[float],
    front: list[int],
) -> None:
    """Write names beside their points, the Pareto front first; skip a name if it does not fit."""
    from matplotlib.figure import Figure

    axis.margins(x=0.12, y=0.06)
    axis.autoscale_view()
    figure = axis.get_figure()
    assert isinstance(figure, Figure)
    size = figure.get_size_inches() * figure.dpi
    # draw once, because the places of the names depend on the final layout
    figure.canvas.draw()
    places = axis.transData.transform(np.column_stack([xs, ys]))
    unit = figure.dpi / 72.0
    taken = [(x - 5 * unit, y - 5 * unit, x + 5 * unit, y + 5 * unit) for x, y in places]
    left, bottom, right, top = axis.bbox.extents
    for k in [*front, *(k for k in range(len(names)) if k not in front)]:
        bold = k in front
        width, height = 4.6 * unit * len(names[k]) * (1.08 if bold else 1.0), 8.5 * unit
        x, y = places[k]
        beside, above = (
            [(7, -4), (-7, -4), (0, 7), (0, -15)],
            [(7, 4), (-7, 4), (7, -13), (-7, -13)],
        )
        # the line of the front continues to the right, so its names stand above
        for dx, dy in above + beside if bold else beside + above:
            start = x + dx * unit - (width if dx < 0 else 0.5 * width if dx == 0 else 0.0)
            box = (start, y + dy * unit, start + width, y + dy * unit + height)
            inside = (
                left <= box[0]
                and box[2] <= right
                and bottom <= box[1]
                and box[3] <= min(top, size[1])
            )
            if inside and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                axis.annotate(
                    names[k],
                    (xs[k], ys[k]),
                    (dx, dy),
                    textcoords="offset points",
                    fontsize=8,
                    va="bottom",
                    ha="right" if dx < 0 else "center" if dx == 0 else "left",
                    fontweight="bold" if bold else "normal",
                    color=colours[k],
                )
                break


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Tell whether two boxes (left, bottom, right, top) overlap."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _key(figure: Figure, outcomes: list[Outcome], colours: dict[str, str]) -> None:
    """Draw the legend: colours for derivatives, markers for methods, hollow for projection."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker="o", linestyle="", label=name)
        for name, colour in colours.items()
    ]
    for method in dict.fromkeys(o.combination.method for o in outcomes):
        handles.append(
            Line2D(
                [], [], color="#5b636b", marker=MARKERS[method], linestyle="", label=METHODS[method]
            )
        )
    if any(o.combination.elastic_force == "projection" for o in outcomes):
        handles.append(
            Line2D(
                [],
                [],
                color="#5b636b",
                marker="o",
                markerfacecolor="white",
                linestyle="",
                label="projection",
            )
        )
    handles.append(Line2D([], [], color="#9AA0A6", label="Pareto front"))
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))


@styled
def size_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against the number of normal modes and the size.

    Figures 8, 9 and 14 of the paper have the same axes.
    """
    outcomes = [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]
    figure = new_figure(10.5, 5.0)
    axes = figure.subplots(1, 2, sharey=True)
    colours = _colours(outcomes)
    first = outcomes[0].combination
    lines: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        c = o.combination
        if (
            replace(first, method=c.method, modes=c.modes, derivatives=c.derivatives, size=c.size)
            == c
        ):
            lines.setdefault((o.combination.method, o.combination.chosen), []).append(o)
    for (method, chosen), members in lines.items():
        style = {"color": colours[chosen], **LINE_LOOKS[method]}
        free = [o for o in members if o.combination.size is None]
        for axis, shown, values in (
            (axes[0], free, lambda o: o.combination.modes),
            (axes[1], members, lambda o: len(o.labels)),
        ):
            ordered = sorted(shown, key=lambda o: (values(o), o.combination.modes))
            axis.plot(
                [values(o) for o in ordered],
                [max(amplitude_error(o), LEAST) for o in ordered],
                **style,
            )
    for axis, name in zip(axes, ("normal modes", "coordinates"), strict=True):
        axis.set(yscale="log", xlabel=f"number of {name}")
        axis.xaxis.get_major_locator().set_params(integer=True)
    axes[0].set_ylabel(_error_label(comparison))
    _key_of_lines(figure, lines, colours)
    return figure


def _key_of_lines(
    figure: Figure, lines: dict[tuple[str, str], list[Outcome]], colours: dict[str, str]
) -> None:
    """Draw the legend: colours for derivatives, line styles for methods."""
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, label=name) for name, colour in colours.items()]
    for method in dict.fromkeys(method for method, _ in lines):
        handles.append(Line2D([], [], color="#5b636b", label=METHODS[method], **LINE_LOOKS[method]))
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))


@styled
def indicator_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against its indicator, one point for each basis."""
    outcomes = [
        o
        for o in comparison.outcomes
        if o.errors.get("amplitude_tangential") is not None and o.indicator is not None
    ]
    figure = new_figure(6.4, 5.0)
    axis = figure.subplots()
    colours = _colours(outcomes)
    xs, ys = (
        [float(o.indicator or 0.0) for o in outcomes],
        [max(amplitude_error(o), LEAST) for o in outcomes],
    )
    for o, x, y in zip(outcomes, xs, ys, strict=True):
        axis.scatter(
            x, y, s=30, marker=MARKERS[o.combination.method], color=colours[o.combination.chosen]
        )
    correlation = comparison.rank_correlation()
    title = f"rank correlation {correlation:.2f}" if correlation is not None else ""
    axis.set(
        xscale="log",
        yscale="log",
        xlabel="indicator (no full run)",
        ylabel=_error_label(comparison),
        title=title,
    )
    _annotate(
        axis,
        [_point(o) for o in outcomes],
        [colours[o.combination.chosen] for o in outcomes],
        xs,
        ys,
        [],
    )
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=colour, marker="o", linestyle="", label=name)
        for name, colour in colours.items()
    ]
    axis.legend(handles=handles, loc="lower right")
    return figure
