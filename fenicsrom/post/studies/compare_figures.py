"""Figures of a comparison: error against run time, size of the basis and indicator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.assess.errors.agreement import pareto_front
from fenicsrom.assess.studies.compare import Comparison, Outcome
from fenicsrom.post.base.directions import error_names
from fenicsrom.post.base.style import COLOURS, Axes, Figure, new_panels, styled

METHODS = {"rubin": "Rubin", "craig-bampton": "Craig–Bampton"}
SHORT = {"rubin": "R", "craig-bampton": "CB"}
DOT: dict[str, Any] = {"marker": "o", "linestyle": ""}
DOTS = {"rubin": DOT, "craig-bampton": DOT | {"marker": "s"}}
# large hollow squares: equal values of the other method stay visible
LINES: dict[str, dict[str, Any]] = {
    "rubin": {"marker": "o", "markersize": 4.5, "linestyle": "-"},
    "craig-bampton": {"marker": "s", "markersize": 9, "markerfacecolor": "none", "linestyle": "--"},
}
INK, FRONT = "#5b636b", "#9AA0A6"
LEGEND_WIDTH = 1.5  # inches of an entry
LEAST = 1e-6  # percent; smaller errors are drawn at this value
BESIDE = [(7, -4), (-7, -4), (0, 7), (0, -15)]  # places of a name beside its point, points
ABOVE = [(7, 4), (-7, 4), (7, -13), (-7, -13)]


def rated(comparison: Comparison) -> list[Outcome]:
    """The outcomes whose error of the amplitude is known."""
    return [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]


def amplitude_error(outcome: Outcome) -> float:
    """Error of the tangential amplitude of an outcome with a full model, percent."""
    error = outcome.errors["amplitude_tangential"]
    assert error is not None
    return error


def _drawn_errors(outcomes: Sequence[Outcome]) -> list[float]:
    """The errors of the amplitude as they are drawn on a logarithmic axis, percent."""
    return [max(amplitude_error(outcome), LEAST) for outcome in outcomes]


def _error_label(comparison: Comparison) -> str:
    """The label of an axis with the errors of the amplitude."""
    return f"error of the {error_names(comparison.scene, comparison.points)[1]} amplitude, %"


def _colours(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Give each way of selecting derivatives a colour."""
    names = list(dict.fromkeys(o.combination.chosen for o in outcomes))
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def _name(outcome: Outcome) -> str:
    """Name a point by method, number of modes and size."""
    c = outcome.combination
    steps = "" if c.steps is None else f"/{c.steps}"
    return f"{SHORT[c.method]}{c.modes}·{len(outcome.labels)}{steps}{c.mesh.partition('=')[2]}"


@styled
def pareto_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against online and total time, with the Pareto front."""
    outcomes, full = rated(comparison), comparison.full
    errors, colours = _drawn_errors(outcomes), _colours(outcomes)
    assert full is not None
    figure, axes = new_panels(10.5, 5.8, 1, 2, sharey=True)
    for axis, title, offline in zip(
        axes, ("online time", "offline and online time"), (False, True), strict=True
    ):
        costs = [o.online_seconds + offline * o.offline_seconds for o in outcomes]
        front = pareto_front(costs, errors)
        # a staircase: between two points of the front, the left one is the best available
        corners = np.array([(costs[k], errors[k]) for k in front])
        axis.plot(*corners.T, color=FRONT, linewidth=1.2, zorder=1, drawstyle="steps-post")
        for k, (outcome, cost, error) in enumerate(zip(outcomes, costs, errors, strict=True)):
            c = outcome.combination
            filled = c.elastic_force == "polynomial"
            axis.scatter(
                cost,
                error,
                s=52 if k in front else 26,
                marker=DOTS[c.method]["marker"],
                zorder=3,
                linewidths=1.3,
                edgecolors=colours[c.chosen],
                facecolors=colours[c.chosen] if filled else "white",
            )
        axis.axvline(full.seconds, color="#000000", linewidth=1.0, linestyle=":")
        axis.set(xscale="log", yscale="log", xlabel=f"{title}, s", title=title)
        _write_names(axis, outcomes, costs, front)
        axis.annotate(
            "full model",
            (full.seconds, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-4, -4),
            textcoords="offset points",
            rotation=90,
            ha="right",
            va="top",
            fontsize=8.5,
        )
    axes[0].set_ylabel(_error_label(comparison))
    more = {"Pareto front": {"color": FRONT}}
    if any(o.combination.elastic_force == "projection" for o in outcomes):
        more = {"projection": {"color": INK, "markerfacecolor": "white", **DOT}} | more
    _legend(figure, outcomes, DOT, DOTS, more)
    return figure


def _write_names(
    axis: Axes, outcomes: Sequence[Outcome], xs: Sequence[float], front: Sequence[int] = ()
) -> None:
    """Write names beside their points, the Pareto front first; skip a name if it does not fit."""
    from matplotlib.transforms import Bbox

    ys, colours = _drawn_errors(outcomes), _colours(outcomes)
    axis.margins(x=0.12, y=0.06)
    figure: Any = axis.get_figure()
    figure.canvas.draw()  # the places of the names depend on the layout
    places = axis.transData.transform(np.column_stack([xs, ys]))
    taken = [Bbox([place, place]).padded(5.0 * figure.dpi / 72.0) for place in places]
    for k in sorted(range(len(outcomes)), key=lambda k: k not in front):
        # the line of the front continues to the right, so its names stand above
        for dx, dy in ABOVE + BESIDE if k in front else BESIDE + ABOVE:
            text = axis.annotate(
                _name(outcomes[k]),
                (xs[k], ys[k]),
                (dx, dy),
                textcoords="offset points",
                fontsize=8,
                va="bottom",
                ha="right" if dx < 0 else "center" if dx == 0 else "left",
                fontweight="bold" if k in front else "normal",
                color=colours[outcomes[k].combination.chosen],
            )
            box = text.get_window_extent()
            inside = all(map(axis.bbox.contains, *box.corners().T))
            if inside and not box.count_overlaps(taken):
                taken.append(box)
                break
            text.remove()


def _legend(
    figure: Figure,
    outcomes: Sequence[Outcome],
    look: Mapping[str, Any],
    looks: Mapping[str, Mapping[str, Any]],
    more: Mapping[str, Mapping[str, Any]],
) -> None:
    """Draw the legend: colours for derivatives, looks for methods, and more entries by names."""
    from matplotlib.lines import Line2D

    entries = {name: {"color": c, **look} for name, c in _colours(outcomes).items()}
    methods = dict.fromkeys(o.combination.method for o in outcomes)
    entries |= {METHODS[method]: {"color": INK, **looks[method]} for method in methods}
    handles = [Line2D([], [], label=name, **of) for name, of in (entries | {**more}).items()]
    columns = int(figure.get_figwidth() / LEGEND_WIDTH)
    figure.legend(handles=handles, loc="outside upper right", ncols=min(len(handles), columns))


@styled
def size_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against the number of normal modes and the size.

    Figures 8, 9 and 14 of the paper have the same axes.
    """
    outcomes = rated(comparison)
    figure, axes = new_panels(10.5, 5.0, 1, 2, sharey=True)
    colours, first = _colours(outcomes), outcomes[0].combination
    lines: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        c = o.combination
        own = {name: getattr(c, name) for name in ("method", "modes", "derivatives", "size")}
        if replace(first, **own) == c:
            lines.setdefault((c.method, c.chosen), []).append(o)
    for (method, chosen), members in lines.items():
        free = [o for o in members if o.combination.size is None]
        for axis, shown, values in (
            (axes[0], free, lambda o: o.combination.modes),
            (axes[1], members, lambda o: len(o.labels)),
        ):
            ordered = sorted(shown, key=lambda o: (values(o), o.combination.modes))
            places = [values(o) for o in ordered], _drawn_errors(ordered)
            axis.plot(*places, color=colours[chosen], **LINES[method])
    for axis, name in zip(axes, ("normal modes", "coordinates"), strict=True):
        axis.set(yscale="log", xlabel=f"number of {name}")
        axis.xaxis.get_major_locator().set_params(integer=True)
    axes[0].set_ylabel(_error_label(comparison))
    _legend(figure, outcomes, {}, LINES, {})
    return figure


@styled
def indicator_figure(comparison: Comparison) -> Figure:
    """Draw the error of the amplitude against its indicator, one point for each basis."""
    outcomes = [o for o in rated(comparison) if o.indicator is not None]
    figure, (axis,) = new_panels(6.4, 5.0)
    colours, indicators = _colours(outcomes), [float(o.indicator or 0.0) for o in outcomes]
    for o, x, y in zip(outcomes, indicators, _drawn_errors(outcomes), strict=True):
        marker, colour = DOTS[o.combination.method]["marker"], colours[o.combination.chosen]
        axis.scatter(x, y, s=30, marker=marker, color=colour)
    correlation = comparison.rank_correlation()
    title = f"rank correlation {correlation:.2f}" if correlation is not None else ""
    axis.set(xscale="log", yscale="log", xlabel="indicator (no full run)", title=title)
    axis.set_ylabel(_error_label(comparison))
    _write_names(axis, outcomes, indicators)
    _legend(figure, outcomes, DOT, DOTS, {})
    return figure
