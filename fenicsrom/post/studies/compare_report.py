"""The report of a comparison: tables, sentences, and pictures of error, run time and size."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fenicsrom.assess.errors.agreement import pareto_front
from fenicsrom.assess.full.full_motions import machine
from fenicsrom.assess.studies.compare import REPEATS, Comparison, Outcome
from fenicsrom.online.motion.measures import response_summary
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import Quantity, error_names, rows_of, table_of
from fenicsrom.words import counted

METHODS = {"rubin": "Rubin", "craig-bampton": "Craig–Bampton"}
SHORT = {"rubin": "R", "craig-bampton": "CB"}
# large hollow squares: equal values of the other method stay visible
LINES: dict[str, dict[str, Any]] = {
    "rubin": {"marker": "o", "markersize": 4.5, "linestyle": "-"},
    "craig-bampton": {"marker": "s", "markersize": 9.0, "hollow": True, "linestyle": "--"},
}
DOT: dict[str, Any] = {"marker": "o", "linestyle": ""}
DOTS = {method: DOT | {"marker": look["marker"]} for method, look in LINES.items()}
INK, FRONT = "#5b636b", "#9AA0A6"
LEAST = 1e-6  # percent; smaller errors are drawn at this value
SMALL = 9  # largest number of coordinates of a small basis
NUMBERS = "comparison.csv"
FRONT_NOTE = (
    "R is Rubin, CB is Craig–Bampton; then come the number of normal modes and, after the dot, the "
    "number of coordinates, after a slash the steps per period, and the value of a change of the "
    "mesh. The named points on the line are the Pareto front: no other basis is both faster and "
    "more accurate."
)
SIZE_NOTE = "Lines join the bases of one method with one choice of derivatives."
RESIDUAL_NOTE = (
    "The residual of the full equations at the reduced motion, in the energy norm, relative to the "
    "loads."
)
ESTIMATE_NOTE = "The estimates are those of a run, for the errors due to the basis."
ERRORS = {
    "amplitude_normal": "normal amplitude",
    "amplitude_tangential": "tangential amplitude",
    "history": "time history",
    "peak_normal_force": "peak normal force",
    "friction_dissipation_per_period": "energy per period",
    "state": "wrong state",
}
OF_JOINTS = {"probe": "probe", "friction_dissipation": "friction energy"}
ESTIMATED = [("probe", "probe"), ("friction_dissipation", "dissipation")]


def quantities(comparison: Comparison) -> list[Quantity]:
    """What is told of each combination; a table shows choices that all share in no column."""
    outcomes = comparison.outcomes

    def choice(key: str, name: str, head: str) -> Quantity:
        varied = len({getattr(outcome.combination, name) for outcome in outcomes}) > 1
        return Quantity(key, f"combination.{name}", head if varied else "")

    def spread(outcome: Outcome) -> float | None:
        online = outcome.online
        return 0.5 * (max(online) - min(online)) / outcome.online_seconds if online else None

    def entry(of: str, name: str) -> Callable[[Outcome], float | None]:
        return lambda outcome: getattr(outcome, of).get(name)

    def estimate(name: str) -> Callable[[Outcome], float | None]:
        return lambda o: None if o.estimated is None else 100.0 * getattr(o.estimated, name)

    stages = dict.fromkeys(stage for outcome in outcomes for stage in outcome.offline)
    return [
        *(Quantity(name, f"combination.{name}", name) for name in ("method", "modes")),
        Quantity("derivatives", "combination.chosen", "derivatives"),
        choice("elastic_force", "elastic_force", "force"),
        choice("scheme", "scheme", "scheme"),
        choice("steps_per_period", "steps", "steps"),
        choice("mesh", "mesh", "mesh"),
        Quantity("asked_size", "combination.size"),
        Quantity("size", lambda outcome: len(outcome.labels) or None, "size"),
        Quantity("labels", lambda outcome: " ".join(outcome.labels)),
        *(Quantity(f"offline_{s}_s", entry("offline", s)) for s in stages),
        Quantity("offline_s", lambda o: o.offline_seconds if o.offline else None, "offline, s", 3),
        Quantity("online_s", "online_seconds", "online, ms", 3),
        Quantity("", spread, "±, %", 2),
        Quantity("online_least_s", lambda outcome: min(outcome.online, default=None)),
        Quantity("online_most_s", lambda outcome: max(outcome.online, default=None)),
        Quantity("online_runs", lambda outcome: len(outcome.online)),
        Quantity("timed_periods"),
        Quantity("steady", lambda outcome: outcome.motion and outcome.motion.steady),
        Quantity("speed_up", comparison.speed_up, "speed-up", 3),
        Quantity("break_even_runs", comparison.break_even, "break-even"),
        *(
            Quantity(f"error_{name}_percent", entry("errors", name), f"{head}, %", 3)
            for name, head in error_heads(comparison).items()
        ),
        *(
            Quantity(f"estimated_{name}_percent", estimate(of), f"{OF_JOINTS[name]} estimate, %", 3)
            for name, of in ESTIMATED
            if comparison.scene.joined
        ),
        Quantity("indicator", head="indicator", digits=3),
        *map(Quantity, ("residual", "failure")),
    ]


def summary(comparison: Comparison) -> dict[str, Any]:
    """Collect what `comparison.json` has of a comparison."""
    combinations, rows = [], rows_of(comparison.outcomes, quantities(comparison))
    for outcome, row in zip(comparison.outcomes, rows, strict=True):
        listed = ("offline_", "online_", "error_", "labels")
        combinations.append(
            {key: value for key, value in row.items() if not key.startswith(listed)}
            | {
                "labels": list(outcome.labels),
                "offline_seconds": outcome.offline,
                "online_seconds": list(outcome.online),
                "online_median_seconds": row["online_s"],
                "error_percent": outcome.errors,
                "response": response_summary(outcome.motion) if outcome.motion else None,
            }
        )
    full = comparison.full
    return {
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
    }


def error_heads(comparison: Comparison) -> dict[str, str]:
    """The names of the errors; the errors of the amplitudes name the directions as `run` does."""
    first, others = error_names(comparison.scene, comparison.points)
    if comparison.scene.joined:
        return ERRORS | OF_JOINTS
    return ERRORS | {
        "amplitude_normal": f"{first} amplitude",
        "amplitude_tangential": f"{others} amplitude",
    }


def sentences(comparison: Comparison) -> list[str]:
    """State the results of the comparison."""
    found = []
    amplitude = _error_name(comparison)
    disk = comparison.scene.cyclic is not None
    small = [o for o in rated(comparison) if disk or len(o.labels) <= SMALL]
    if small:
        best = min(small, key=amplitude_error)
        size = counted(len(best.labels), "coordinate")
        what = f"best basis of at most {SMALL} coordinates"
        if disk:
            what, size = "nearest disk of reduced sectors", f"{size} of a sector"
        found.append(
            f"The {what} is {best.combination.name} with {size}: its error of the {amplitude} is "
            f"{amplitude_error(best):.2g} %, it is "
            f"{comparison.speed_up(best):.0f} times as fast as the full model, and its offline "
            f"time pays off after {_runs(comparison.break_even(best))}."
        )
    ours, plain = comparison.rank_correlation("indicator"), comparison.rank_correlation("residual")
    if ours is not None and plain is not None:
        found.append(
            f"Rank correlation (Spearman) with the error of the {amplitude} over "
            f"{len(rated(comparison))} bases: {ours:.2f} for the residual in the "
            f"energy norm (the indicator), {plain:.2f} for the residual in the plain norm. "
            "The indicator needs no run of the full model."
        )
    found += [
        f"{o.combination.name} has no motion: {o.failure}" for o in comparison.outcomes if o.failure
    ]
    if comparison.interrupted:
        found.append("The comparison was interrupted: the other combinations are missing.")
    return found


def _runs(count: int | None) -> str:
    """Format a number of runs."""
    return "no number of runs" if count is None else counted(count, "run")


def timing_note(comparison: Comparison) -> list[str]:
    """State how the run times were measured, and on which machine."""
    here = machine()
    short = {o.timed_periods for o in comparison.outcomes if o.timed_periods is not None}
    found = [
        f"Online seconds are the median of {counted(REPEATS, 'run')}; ± is half of their "
        "range. Offline seconds are the sum of the stages that a basis needs. Compilation and "
        f"warm-up took {comparison.compilation:.2g} s and are not included.",
        f"Measured on {here['processor']}, {counted(here['cores'], 'core')}, {here['system']}, "
        f"OMP_NUM_THREADS = {here['OMP_NUM_THREADS']}.",
    ]
    if short:
        found.append(
            f"Runs of more than a second were timed over {counted(min(short), 'period')} and "
            "scaled by their number of steps."
        )
    if comparison.full:
        run = comparison.full_run
        where = "was read from the cache; it ran" if run["cached"] else "ran"
        found.append(
            f"The full model, {comparison.unknowns} unknowns, {where} once, {run['date']}, on "
            f"{run['machine']['processor']}, {counted(run['ranks'], 'rank')}: "
            f"{comparison.full.seconds:.3g} s for {comparison.full.steps} steps."
        )
    return found


def rated(comparison: Comparison) -> list[Outcome]:
    """The outcomes whose error of the amplitude is known."""
    return [o for o in comparison.outcomes if o.error is not None]


def amplitude_error(outcome: Outcome) -> float:
    """Error of the amplitude of an outcome with a full model, percent."""
    assert outcome.error is not None
    return outcome.error


def _drawn_errors(outcomes: Sequence[Outcome]) -> list[float]:
    """The errors of the amplitude as they are drawn on a logarithmic axis, percent."""
    return [max(amplitude_error(outcome), LEAST) for outcome in outcomes]


def _error_label(comparison: Comparison) -> str:
    """The label of an axis with the errors of the amplitude."""
    return f"error of the {_error_name(comparison)}, %"


def _error_name(comparison: Comparison) -> str:
    """The name of the error by which combinations are compared."""
    if comparison.scene.joined:
        return "amplitude of the probe"
    return error_heads(comparison)["amplitude_tangential"]


def _colours(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Give each way of selecting derivatives a colour."""
    names = list(dict.fromkeys(o.combination.chosen for o in outcomes))
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}


def _name(outcome: Outcome) -> str:
    """Name a point by method, number of modes and size."""
    c = outcome.combination
    steps = "" if c.steps is None else f"/{c.steps}"
    return f"{SHORT[c.method]}{c.modes}·{len(outcome.labels)}{steps}{c.mesh.partition('=')[2]}"


def pareto_figure(comparison: Comparison) -> Plot:
    """The error of the amplitude against online and total time, with the Pareto front."""
    outcomes, full = rated(comparison), comparison.full
    errors = _drawn_errors(outcomes)
    assert full is not None
    panels: list[Panel] = []
    for title, offline in (("online time", False), ("offline and online time", True)):
        costs = [o.online_seconds + offline * o.offline_seconds for o in outcomes]
        front = pareto_front(costs, errors)
        # a staircase: between two points of the front, the left one is the best available
        x, y = np.repeat([(costs[k], errors[k]) for k in front], 2, axis=0).T
        lines = [
            Line(x[1:], y[:-1], "-", FRONT, 1.2, label="Pareto front", zorder=1.0),
            Line(np.full(2, full.seconds), None, ":", "#000000", 1.0, label="full model"),
        ]
        items = [*lines, *_points(outcomes, costs, front)]
        up = "" if panels else _error_label(comparison)
        panels.append(Panel(items, f"{title}, s", up, title, log="xy"))
    samples = _samples(outcomes, DOT, DOTS)
    if any(o.combination.elastic_force == "projection" for o in outcomes):
        samples.append(Line(label="projection", color=INK, hollow=True, **DOT))
    return Plot(panels, 10.5, 6.2, 2, share="y", legend=[*samples, *lines])


def _points(outcomes: Sequence[Outcome], xs: Sequence[float], named: Sequence[int]) -> list[Item]:
    """A point for each basis, and the names of some; a chart has the names of all."""
    ys, colours = _drawn_errors(outcomes), _colours(outcomes)
    items: list[Item] = []
    for k, outcome in enumerate(outcomes):
        c = outcome.combination
        look: dict[str, Any] = {"markersize": 7.0 if k in named else 5.0, **DOTS[c.method]}
        look |= {"label": c.chosen, "also": (METHODS[c.method], c.elastic_force)}
        look |= {"color": colours[c.chosen], "hollow": c.elastic_force == "projection"}
        items.append(Line([xs[k]], [ys[k]], notes=[_name(outcome)], **look))
        if k in named:
            items.append(Text(xs[k], ys[k], _name(outcome), shift=(6.0, 5.0), fontsize=8.0))
    return items


def _samples(
    outcomes: Sequence[Outcome], look: Mapping[str, Any], looks: Mapping[str, Mapping[str, Any]]
) -> list[Line]:
    """The samples of the legend: colours for derivatives, looks for methods."""
    methods = dict.fromkeys(o.combination.method for o in outcomes)
    return [
        *(Line(color=color, label=name, **look) for name, color in _colours(outcomes).items()),
        *(Line(color=INK, label=METHODS[method], **looks[method]) for method in methods),
    ]


def size_figure(comparison: Comparison) -> Plot:
    """The error of the amplitude against the number of normal modes and the size.

    Figures 8, 9 and 14 of the paper have the same axes.
    """
    outcomes = rated(comparison)
    colours, first = _colours(outcomes), outcomes[0].combination
    lines: dict[tuple[str, str], list[Outcome]] = {}
    for o in outcomes:
        c = o.combination
        own = {name: getattr(c, name) for name in ("method", "modes", "derivatives", "size")}
        if replace(first, **own) == c:
            lines.setdefault((c.method, c.chosen), []).append(o)
    by_modes: list[Item] = []
    by_size: list[Item] = []
    for (method, chosen), members in lines.items():
        free = [o for o in members if o.combination.size is None]
        look: dict[str, Any] = {"label": chosen, "also": (METHODS[method],), **LINES[method]}
        for items, shown, values in (
            (by_modes, free, lambda o: o.combination.modes),
            (by_size, members, lambda o: len(o.labels)),
        ):
            ordered = sorted(shown, key=lambda o: (values(o), o.combination.modes))
            places = [values(o) for o in ordered], _drawn_errors(ordered)
            items.append(Line(*places, color=colours[chosen], **look))
    axes: dict[str, Any] = {"log": "y", "whole": "x"}
    panels = [
        Panel(by_modes, "number of normal modes", _error_label(comparison), **axes),
        Panel(by_size, "number of coordinates", **axes),
    ]
    return Plot(panels, 10.5, 5.2, 2, share="y", legend=_samples(outcomes, {}, LINES))


def indicator_figure(comparison: Comparison) -> Plot:
    """The error of the amplitude against its indicator, one point for each basis."""
    outcomes = [o for o in rated(comparison) if o.indicator is not None]
    indicators = [float(o.indicator or 0.0) for o in outcomes]
    correlation = comparison.rank_correlation()
    title = f"rank correlation {correlation:.2f}" if correlation is not None else ""
    labels = "indicator (no full run)", _error_label(comparison), title
    panel = Panel(_points(outcomes, indicators, ()), *labels, log="xy")
    return Plot([panel], 6.4, 5.2, legend=_samples(outcomes, DOT, DOTS))


def estimate_figure(comparison: Comparison) -> Plot:
    """The errors that a run estimates against the true ones, one point for each basis."""
    outcomes = [o for o in rated(comparison) if o.estimated is not None]
    panels = []
    for name, of in ESTIMATED:
        true = [max(o.errors[name] or 0.0, LEAST) for o in outcomes]
        found = [max(100.0 * getattr(o.estimated, of), LEAST) for o in outcomes]
        ends = [min(*true, *found), max(*true, *found)]
        named = [_name(outcome) for outcome in outcomes]
        items: list[Item] = [
            Line(ends, ends, "-", FRONT, label="estimate = error"),
            Line(true, found, color=COLOURS[0], notes=named, label="basis", **DOT),
        ]
        panels.append(Panel(items, f"error of the {OF_JOINTS[name]}, %", "estimate, %", log="xy"))
    return Plot(panels, 10.5, 5.2, 2)


def pictures(comparison: Comparison) -> list[Picture]:
    """The pictures of a comparison with a full model."""
    if comparison.full is None or not rated(comparison):
        return []
    return [
        Picture(heading, f"{name}.png", partial(draw, comparison), said, NUMBERS)
        for heading, name, draw, said in (
            ("Error against run time", "pareto", pareto_figure, FRONT_NOTE),
            ("Error against the size of the basis", "size", size_figure, SIZE_NOTE),
            ("Error against the residual", "indicator", indicator_figure, RESIDUAL_NOTE),
            ("Estimated against true error", "estimate", estimate_figure, ESTIMATE_NOTE),
        )
        if name != "estimate" or comparison.scene.joined
        if name != "indicator" or comparison.scene.cyclic is None
    ]


def report(comparison: Comparison) -> Report:
    """The report of a comparison: `comparison.csv`, `comparison.json` and the pictures."""
    outcomes, shown = comparison.outcomes, quantities(comparison)
    whole = table_of(outcomes, shown)
    sections = [
        Section("All combinations", [whole], keys=whole[0].index("size")),
        Section("Timing", timing_note(comparison), terminal=False),
    ]
    return Report(
        "comparison",
        title="error against run time",
        found=comparison,
        sentences=sentences(comparison) or ["There is no full model to compare with."],
        sections=sections,
        rows=rows_of(outcomes, shown),
        summary=summary(comparison),
        pictures=pictures(comparison),
    )
