"""The files of a comparison: CSV, JSON, report and pictures."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.assess.agreement import pareto_front
from fenicsrom.assess.compare import Comparison, Outcome
from fenicsrom.assess.full_cache import machine
from fenicsrom.files import atomic_write
from fenicsrom.online.archive import provenance
from fenicsrom.online.measures import response_summary
from fenicsrom.post.html_page import html_report
from fenicsrom.post.style import COLOURS, new_figure, styled
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ERRORS = {
    "amplitude_tangential": "tip amplitude",
    "amplitude_normal": "axial amplitude",
    "history": "time history",
    "peak_normal_force": "peak normal force",
    "dissipated_per_period": "energy per period",
    "state": "wrong state",
}
MARKERS = {"rubin": "o", "craig-bampton": "s"}
METHODS = {"rubin": "Rubin", "craig-bampton": "Craig–Bampton"}
SHORT = {"rubin": "R", "craig-bampton": "CB"}
LEAST = 1e-6  # percent: smaller errors are drawn here


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """One flat row for each combination: the columns of `comparison.csv`."""
    found = []
    for outcome in comparison.outcomes:
        c = outcome.combination
        row: dict[str, Any] = {
            "method": c.method,
            "modes": c.modes,
            "derivatives": c.chosen,
            "elastic_force": c.elastic_force,
            "scheme": c.scheme,
            "size": len(outcome.labels) or None,
            "labels": " ".join(outcome.labels),
        }
        row |= {f"offline_{stage}_s": seconds for stage, seconds in outcome.offline.items()}
        row |= {
            "offline_s": outcome.offline_seconds if outcome.offline else None,
            "online_s": outcome.online_seconds if outcome.online else None,
            "online_least_s": min(outcome.online, default=None),
            "online_most_s": max(outcome.online, default=None),
            "online_runs": len(outcome.online),
            "timed_periods": outcome.timed_periods,
            "steady": outcome.motion.steady if outcome.motion else None,
            "speed_up": comparison.speed_up(outcome),
            "break_even_runs": comparison.break_even(outcome),
        }
        row |= {f"error_{name}_percent": outcome.errors.get(name) for name in ERRORS}
        row |= {
            "indicator": outcome.indicator,
            "residual": outcome.residual,
            "failure": outcome.failure,
        }
        found.append(row)
    return found


def summary(comparison: Comparison) -> dict[str, Any]:
    """The contents of `comparison.json`."""
    combinations = []
    for outcome, row in zip(comparison.outcomes, rows(comparison), strict=True):
        entry = {
            key: value
            for key, value in row.items()
            if not key.startswith(("offline_", "online_", "error_", "labels"))
        }
        entry["labels"] = list(outcome.labels)
        entry["offline_seconds"] = outcome.offline
        entry["online_seconds"] = list(outcome.online)
        entry["online_median_seconds"] = row["online_s"]
        entry["error_percent"] = outcome.errors
        entry["response"] = response_summary(outcome.motion) if outcome.motion else None
        combinations.append(entry)
    full = comparison.full
    return {
        "scene": comparison.scene.source,
        "dofs": comparison.unknowns,
        "full": {"seconds": full.seconds, **comparison.full_run, "response": response_summary(full)}
        if full
        else None,
        "rank_correlation": {
            "indicator": comparison.rank_correlation("indicator"),
            "residual": comparison.rank_correlation("residual"),
        },
        "compilation_seconds": comparison.compilation,
        "combinations": combinations,
        "machine": machine(),
        "warnings": comparison.warnings,
        "provenance": provenance(),
    }


def table(comparison: Comparison) -> list[list[Any]]:
    """The table of the terminal and the report, its head first."""
    several = {
        "force": len({o.combination.elastic_force for o in comparison.outcomes}) > 1,
        "scheme": len({o.combination.scheme for o in comparison.outcomes}) > 1,
    }
    full = comparison.full is not None
    head = [
        "method",
        "modes",
        "derivatives",
        *(name for name, varies in several.items() if varies),
        "size",
        "offline s",
        "online ms",
        "±",
    ]
    head += ["speed-up", "break-even", *(f"{name} %" for name in ERRORS.values())] if full else []
    found: list[list[Any]] = [[*head, "indicator"]]
    for outcome in comparison.outcomes:
        c = outcome.combination
        line: list[Any] = [METHODS[c.method], c.modes, c.chosen]
        line += [c.elastic_force] if several["force"] else []
        line += [c.scheme] if several["scheme"] else []
        line += [
            len(outcome.labels) or None,
            round(outcome.offline_seconds, 3) if outcome.offline else None,
        ]
        if outcome.online:
            spread = 0.5 * (max(outcome.online) - min(outcome.online))
            line += [
                _three(1e3 * outcome.online_seconds),
                f"{100.0 * spread / outcome.online_seconds:.0f} %",
            ]
        else:
            line += [None, None]
        if full:
            speed = comparison.speed_up(outcome)
            line += [_three(speed), comparison.break_even(outcome)]
            line += [_three(outcome.errors.get(name)) for name in ERRORS]
        found.append([*line, _three(outcome.indicator)])
    return found


def _three(value: float | None) -> float | int | None:
    """A number of three digits."""
    if value is None:
        return None
    rounded = float(f"{value:.3g}")
    return int(rounded) if rounded >= 100 else rounded


def sentences(comparison: Comparison) -> list[str]:
    """What the comparison shows, for the terminal and the report."""
    found = []
    rated = [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]
    small = [o for o in rated if len(o.labels) <= 9]
    if small:
        best = min(small, key=_error)
        found.append(
            f"The best basis of at most 9 coordinates is {best.combination.name}: {len(best.labels)} coordinates, "
            f"{_error(best):.2g} % off in the tip amplitude, {comparison.speed_up(best):.0f} times as fast as the full "
            f"model; its offline stage has paid for itself after {_runs(comparison.break_even(best))}."
        )
    ours, plain = comparison.rank_correlation("indicator"), comparison.rank_correlation("residual")
    if ours is not None and plain is not None:
        found.append(
            f"Rank correlation (Spearman) with the error of the tip amplitude over {len(rated)} bases: {ours:.2f} for "
            f"the residual in the energy norm (the indicator), {plain:.2f} in the plain norm. The indicator needs no "
            "full run."
        )
    restless = [
        o.combination.name
        for o in comparison.outcomes
        if o.motion and o.motion.period and not o.motion.steady
    ]
    if restless:
        found.append(
            f"These motions did not repeat within {comparison.scene.time.periods} periods, so that their errors are "
            f"those of one period among others: {'; '.join(restless)}."
        )
    found += [
        f"{o.combination.name}: no motion: {o.failure}" for o in comparison.outcomes if o.failure
    ]
    return found


def _error(outcome: Outcome) -> float:
    """Error of the tip amplitude, percent."""
    error = outcome.errors["amplitude_tangential"]
    assert error is not None
    return error


def _runs(count: int | None) -> str:
    return "no number of runs" if count is None else "1 run" if count == 1 else f"{count} runs"


def timing_note(comparison: Comparison) -> list[str]:
    """How the seconds were measured, and on what."""
    here = machine()
    repeats, short = (
        comparison.scene.compare.repeats,
        {o.timed_periods for o in comparison.outcomes} - {None},
    )
    found = [
        f"Online seconds are the median of {repeats} runs; ± is half of their range. Offline seconds are those of the "
        f"stages a basis needs, as if it were made alone. Compiled code and caches were warm: what compiling and "
        f"warming up took, {comparison.compilation:.2g} s, is in none of them.",
        f"Measured on {here['processor']}, {here['cores']} cores, {here['system']}, "
        f"OMP_NUM_THREADS = {here['OMP_NUM_THREADS']}.",
    ]
    if short:
        found.append(
            f"Runs of more than a second were timed over {min(short)} periods, in proportion to their steps."
        )
    if comparison.full:
        run = comparison.full_run
        where = "taken from the cache; it ran" if run["cached"] else "ran"
        found.append(
            f"The full model, {comparison.unknowns} unknowns, {where} once, {run['date']}, on "
            f"{run['machine']['processor']}, {run['ranks']} rank(s): {comparison.full.seconds:.3g} s for "
            f"{comparison.full.steps} steps."
        )
    return found


# ---------------------------------------------------------------------- figures


def _colours(outcomes: list[Outcome]) -> dict[str, str]:
    """A colour for each way of choosing derivatives."""
    names = list(dict.fromkeys(o.combination.chosen for o in outcomes))
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def _point(outcome: Outcome) -> str:
    """The label of a point: method, modes and size."""
    return f"{SHORT[outcome.combination.method]}{outcome.combination.modes}·{len(outcome.labels)}"


@styled
def pareto_figure(comparison: Comparison) -> Figure:
    """Error of the tip amplitude against online and total time, with the Pareto front."""
    outcomes = [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]
    figure = new_figure(10.5, 5.8)
    axes = figure.subplots(1, 2, sharey=True)
    colours = _colours(outcomes)
    errors = [max(_error(o), LEAST) for o in outcomes]
    assert comparison.full is not None
    for axis, title, offline in zip(
        axes, ("online time", "offline and online time"), (False, True), strict=True
    ):
        costs = [o.online_seconds + offline * o.offline_seconds for o in outcomes]
        front = pareto_front(costs, errors)
        steps = [(costs[k], errors[k]) for k in front]
        # a staircase: between two points of the front nothing is cheaper and better than the left
        # one
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
    axes[0].set_ylabel("error of the tip amplitude, %")
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
    """Write the names beside their points, those of the front first; a name with no room is left
    out.
    """
    import numpy as np

    axis.margins(x=0.12, y=0.06)
    axis.autoscale_view()
    size = axis.figure.get_size_inches() * axis.figure.dpi
    figure = axis.figure
    # fixes the layout, which the places of the names depend on
    figure.canvas.draw()  # type: ignore[attr-defined]
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
        for dx, dy in (
            above + beside if bold else beside + above
        ):  # the line of the front goes on to the right
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
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def _key(figure: Figure, outcomes: list[Outcome], colours: dict[str, str]) -> None:
    """The legend: colours are ways of choosing derivatives, markers are methods, hollow ones
    intrusive projection.
    """
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
    """Error of the tip amplitude against the number of normal modes and the size (the paper's figs.
    8, 9 and 14).
    """
    outcomes = [o for o in comparison.outcomes if o.errors.get("amplitude_tangential") is not None]
    figure = new_figure(10.5, 5.0)
    axes = figure.subplots(1, 2, sharey=True)
    colours = _colours(outcomes)
    first = outcomes[0].combination
    lines: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        if (o.combination.elastic_force, o.combination.scheme) == (
            first.elastic_force,
            first.scheme,
        ):
            lines.setdefault((o.combination.method, o.combination.chosen), []).append(o)
    for (method, chosen), members in lines.items():
        style: dict[str, Any] = {
            "color": colours[chosen],
            "marker": MARKERS[method],
            "markersize": 5,
            "linestyle": "-" if method == "rubin" else "--",
        }
        for axis, values in (
            (axes[0], lambda o: o.combination.modes),
            (axes[1], lambda o: len(o.labels)),
        ):
            ordered = sorted(members, key=lambda o: (values(o), o.combination.modes))
            axis.plot(
                [values(o) for o in ordered], [max(_error(o), LEAST) for o in ordered], **style
            )
    for axis, name in zip(axes, ("normal modes", "coordinates"), strict=True):
        axis.set(yscale="log", xlabel=f"number of {name}")
        axis.xaxis.get_major_locator().set_params(integer=True)
    axes[0].set_ylabel("error of the tip amplitude, %")
    _key_of_lines(figure, lines, colours)
    return figure


def _key_of_lines(
    figure: Figure, lines: dict[tuple[str, str], list[Outcome]], colours: dict[str, str]
) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=colour, label=name) for name, colour in colours.items()]
    for method in dict.fromkeys(method for method, _ in lines):
        style = "-" if method == "rubin" else "--"
        handles.append(
            Line2D(
                [],
                [],
                color="#5b636b",
                marker=MARKERS[method],
                linestyle=style,
                label=METHODS[method],
            )
        )
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))


@styled
def indicator_figure(comparison: Comparison) -> Figure:
    """The indicator against the error it stands for, one point for each basis."""
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
        [max(_error(o), LEAST) for o in outcomes],
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
        ylabel="error of the tip amplitude, %",
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


# ---------------------------------------------------------------------- files


PICTURES = (
    (
        "pareto",
        "Error against run time",
        "R is Rubin, CB is Craig–Bampton, then the number of normal modes and, after the dot, of coordinates. The "
        "points on the line are the Pareto front: none is both faster and more accurate.",
        pareto_figure,
    ),
    ("size", "Error against the size of the basis", "", size_figure),
    (
        "indicator",
        "Error against the residual",
        "The residual of the full equations at the reduced motion, in the energy norm, relative to the loads.",
        indicator_figure,
    ),
)


def write_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Write `comparison.csv`, `comparison.json`, `report.html` and the pictures.

    Returns:
        The files, the one to open first at the head.

    Raises:
        OSError: a file cannot be written.
    """
    lines = rows(comparison)
    columns = list(dict.fromkeys(key for line in lines for key in line))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    _write(folder / "comparison.csv", text.getvalue())
    write_summary(folder / "comparison.json", summary(comparison))
    pictures: list[tuple[str, str, Path]] = []
    if comparison.full is not None and any(
        o.errors.get("amplitude_tangential") is not None for o in comparison.outcomes
    ):
        for name, heading, words, draw in PICTURES:
            with atomic_write(folder / f"{name}.png") as temporary:
                draw(comparison).savefig(temporary, format="png", dpi=130)
            pictures.append((heading, words, folder / f"{name}.png"))
    found: list[tuple[str, list[Any]]] = [
        ("What was found", sentences(comparison) or ["No full model was asked for."])
    ]
    found += [(heading, [path, words] if words else [path]) for heading, words, path in pictures]
    found.append(("All combinations", [table(comparison), *comparison.warnings]))
    found.append(("How it was timed", timing_note(comparison)))
    title = f"{comparison.scene.title or comparison.scene.source}: error against run time"
    _write(folder / "report.html", html_report(title, found))
    return [
        folder / "report.html",
        folder / "comparison.csv",
        folder / "comparison.json",
        *(path for *_, path in pictures),
    ]


def _write(path: Path, text: str) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def terminal(comparison: Comparison) -> str:
    """The table and the sentences, for the terminal."""
    return "\n".join([text_table(table(comparison)), "", *sentences(comparison)])
