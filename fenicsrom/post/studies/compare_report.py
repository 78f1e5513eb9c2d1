"""The files of a comparison: CSV, JSON, pictures and report."""

from __future__ import annotations

from typing import Any

from fenicsrom.assess.full.full_cache import machine
from fenicsrom.assess.studies.compare import REPEATS, Comparison
from fenicsrom.online.motion.measures import response_summary
from fenicsrom.post.base.directions import error_names
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.report import Report, Section
from fenicsrom.post.base.tables import table_of
from fenicsrom.post.studies import compare_figures
from fenicsrom.words import counted

SMALL = 9  # largest number of coordinates of a small basis
ERRORS = {
    "amplitude_normal": "normal amplitude",
    "amplitude_tangential": "tangential amplitude",
    "history": "time history",
    "peak_normal_force": "peak normal force",
    "friction_dissipation_per_period": "energy per period",
    "state": "wrong state",
}
VARIED = {"force": "elastic_force", "scheme": "scheme", "steps": "steps", "mesh": "mesh"}


def rows(comparison: Comparison) -> list[dict[str, Any]]:
    """Collect one flat row for each combination, for `comparison.csv`."""
    found = []
    for outcome in comparison.outcomes:
        c = outcome.combination
        row = {
            "mesh": c.mesh,
            "steps_per_period": c.steps,
            "method": c.method,
            "modes": c.modes,
            "derivatives": c.chosen,
            "elastic_force": c.elastic_force,
            "scheme": c.scheme,
            "asked_size": c.size,
            "size": len(outcome.labels) or None,
            "labels": " ".join(outcome.labels),
            **{f"offline_{stage}_s": seconds for stage, seconds in outcome.offline.items()},
            "offline_s": outcome.offline_seconds if outcome.offline else None,
            "online_s": outcome.online_seconds if outcome.online else None,
            "online_least_s": min(outcome.online, default=None),
            "online_most_s": max(outcome.online, default=None),
            "online_runs": len(outcome.online),
            "timed_periods": outcome.timed_periods,
            "steady": outcome.motion.steady if outcome.motion else None,
            "speed_up": comparison.speed_up(outcome),
            "break_even_runs": comparison.break_even(outcome),
            **{f"error_{name}_percent": outcome.errors.get(name) for name in ERRORS},
            "indicator": outcome.indicator,
            "residual": outcome.residual,
            "failure": outcome.failure,
        }
        found.append(row)
    return found


def summary(comparison: Comparison) -> dict[str, Any]:
    """Collect what `comparison.json` has of a comparison."""
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
    return ERRORS | {
        "amplitude_normal": f"{first} amplitude",
        "amplitude_tangential": f"{others} amplitude",
    }


def table(comparison: Comparison) -> list[list[Any]]:
    """Compose the table of the combinations."""
    varied = {
        head: name
        for head, name in VARIED.items()
        if len({getattr(o.combination, name) for o in comparison.outcomes}) > 1
    }
    lines = []
    for outcome in comparison.outcomes:
        c, online = outcome.combination, outcome.online
        line: dict[str, Any] = {"method": compare_figures.METHODS[c.method], "modes": c.modes}
        line |= {"derivatives": c.chosen}
        line |= {head: getattr(c, name) or None for head, name in varied.items()}
        line |= {"size": len(outcome.labels) or None}
        line |= {"offline s": round(outcome.offline_seconds, 3) if outcome.offline else None}
        line |= {"online ms": None, "±": None}
        if online:
            spread = 0.5 * (max(online) - min(online)) / outcome.online_seconds
            line["online ms"] = _rounded(1e3 * outcome.online_seconds)
            line["±"] = f"{100.0 * spread:.0f} %"
        if comparison.full is not None:
            line["speed-up"] = _rounded(comparison.speed_up(outcome))
            line["break-even"] = comparison.break_even(outcome)
            for name, head in error_heads(comparison).items():
                line[f"{head} %"] = _rounded(outcome.errors.get(name))
        lines.append(line | {"indicator": _rounded(outcome.indicator)})
    return table_of(lines)


def _rounded(value: float | None) -> float | int | None:
    """Round a number to three digits."""
    if value is None:
        return None
    rounded = float(f"{value:.3g}")
    return int(rounded) if rounded >= 100 else rounded


def sentences(comparison: Comparison) -> list[str]:
    """State the results of the comparison."""
    found = []
    amplitude = error_heads(comparison)["amplitude_tangential"]
    small = [o for o in compare_figures.rated(comparison) if len(o.labels) <= SMALL]
    if small:
        best = min(small, key=compare_figures.amplitude_error)
        found.append(
            f"The best basis of at most {SMALL} coordinates is {best.combination.name} with "
            f"{counted(len(best.labels), 'coordinate')}: its error of the {amplitude} is "
            f"{compare_figures.amplitude_error(best):.2g} %, it is "
            f"{comparison.speed_up(best):.0f} times as fast as the full model, and its offline "
            f"time pays off after {_runs(comparison.break_even(best))}."
        )
    ours, plain = comparison.rank_correlation("indicator"), comparison.rank_correlation("residual")
    if ours is not None and plain is not None:
        found.append(
            f"Rank correlation (Spearman) with the error of the {amplitude} over "
            f"{len(compare_figures.rated(comparison))} bases: {ours:.2f} for the residual in the "
            f"energy norm (the indicator), {plain:.2f} for the residual in the plain norm. "
            "The indicator needs no run of the full model."
        )
    unsteady = [
        o.combination.name
        for o in comparison.outcomes
        if o.motion and o.motion.period and not o.motion.steady
    ]
    if unsteady:
        found.append(
            "These motions did not become periodic, so their errors hold for the last period only: "
            f"{'; '.join(unsteady)}."
        )
    found += [
        f"{o.combination.name} has no motion: {o.failure}" for o in comparison.outcomes if o.failure
    ]
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


def pictures(comparison: Comparison) -> list[Picture]:
    """The pictures of a comparison with a full model."""
    if comparison.full is None or not compare_figures.rated(comparison):
        return []
    return [
        Picture(
            "Error against run time",
            "pareto.png",
            lambda: compare_figures.pareto_figure(comparison),
            "R is Rubin, CB is Craig–Bampton; then come the number of normal modes and, after the "
            "dot, the number of coordinates, after a slash the steps per period, and the value of "
            "a change of the mesh. The points on the line are the Pareto front: no other "
            "basis is both faster and more accurate.",
        ),
        Picture(
            "Error against the size of the basis",
            "size.png",
            lambda: compare_figures.size_figure(comparison),
        ),
        Picture(
            "Error against the residual",
            "indicator.png",
            lambda: compare_figures.indicator_figure(comparison),
            "The residual of the full equations at the reduced motion, in the energy norm, "
            "relative to the loads.",
        ),
    ]


def report(comparison: Comparison) -> Report:
    """The report of a comparison: `comparison.csv`, `comparison.json` and the pictures."""
    whole = table(comparison)
    return Report(
        "comparison",
        "error against run time",
        comparison,
        sentences(comparison) or ["There is no full model to compare with."],
        [
            Section("All combinations", [whole], keys=whole[0].index("size")),
            Section("Timing", timing_note(comparison), terminal=False),
        ],
        rows(comparison),
        summary(comparison),
        pictures(comparison),
    )
