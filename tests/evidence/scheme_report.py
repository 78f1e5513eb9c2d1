"""Tables, sentences, picture and files of the errors of the time integration schemes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from figures import new_figure, styled
from scheme_errors import ASYMPTOTIC, PATH, REFERENCE, SCHEMES, SECOND, USUAL, Errors, Run, Series

from fenicsrom.errors import ErrorKind
from fenicsrom.online.motion.motion import ENERGY_ERROR
from fenicsrom.post.base.page import write_report
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import text_table, write_figure, write_rows, write_summary


def _words(scheme: str) -> str:
    return scheme.replace("-", " ") if scheme != "generalised-alpha" else scheme


def _cell(run: Run, measure: str) -> str | None:
    """An error in percent, with a star if the run has not settled, in brackets if it is refused."""
    error = getattr(run.errors, measure)
    if error is None:
        return None
    text = f"{100.0 * error:.2g}" + ("" if run.settled else "*")
    return f"({text})" if run.refused else text


def table(found: Sequence[Series], measure: str = "amplitude") -> list[list[Any]]:
    """An error in percent by case, scheme and steps per period; the first row is the header.

    The last columns hold the fitted orders of this error and of the path.
    """
    steps = list(dict.fromkeys(run.steps for s in found for run in s.runs if run.steps is not None))
    fitted = dict.fromkeys((measure, "path"))
    rows: list[list[Any]] = [
        ["case", "scheme", *map(str, steps), *(f"{name} order" for name in fitted)]
    ]
    for s in found:
        for scheme in SCHEMES if s.runs else ():
            orders = [s.order(scheme, name) for name in fitted]
            cells = [_cell(run, measure) for run in s.of(scheme)]
            rows.append(
                [
                    s.name,
                    _words(scheme),
                    *cells,
                    *(None if order is None else f"{order:.1f}" for order in orders),
                ]
            )
    return rows


def tolerances(found: Sequence[Series]) -> list[list[Any]]:
    """Error of the amplitude in percent and steps per period by tolerance, below a header row."""
    asked = list(
        dict.fromkeys(run.tolerance for s in found for run in s.runs if run.tolerance is not None)
    )
    rows: list[list[Any]] = [
        ["case", "scheme", *(f"{t:g}" for t in asked), *(f"steps at {t:g}" for t in asked)]
    ]
    for s in found:
        for scheme in SCHEMES if s.runs else ():
            runs = [run for run in s.runs if run.scheme == scheme and run.tolerance is not None]
            counts = [None if run.taken is None else round(run.taken) for run in runs]
            rows.append(
                [s.name, _words(scheme), *(_cell(run, "amplitude") for run in runs), *counts]
            )
    return rows


def sentences(found: Sequence[Series]) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    told = [f"{s.name}: {s.failure}" for s in found if s.failure]
    ran = [s for s in found if s.runs]
    if not ran:
        return told
    groups = [
        group for s in ran for group in zip(*(s.of(scheme) for scheme in SCHEMES), strict=True)
    ]
    told += [_about_scheme(groups, k) for k in range(len(SCHEMES))]
    return [*told, _about_orders(ran), *_about_references(ran), *_about_tolerances(ran)]


def _about_scheme(groups: Sequence[tuple[Run, ...]], k: int) -> str:
    """How often scheme k settles, is refused, and has the smallest error of the three."""
    runs = [group[k] for group in groups]
    usual = [run for run in runs if run.steps is not None and run.steps >= USUAL]
    returned = [run for run in runs if not run.refused]
    energy = [run for run in runs if run.kind is ErrorKind.ENERGY]
    nearest = [min(good, key=_size) for group in groups if (good := list(filter(_good, group)))]
    shared = [
        group for group in groups if all(_good(run) and run.errors.amplitude for run in group)
    ]
    mean = ""
    if shared:
        logarithms = sum(math.log(_size(group[k])) for group in shared)
        percent = 100.0 * math.exp(logarithms / len(shared))
        mean = (
            f", with a geometric mean error of {percent:.2g} % over the {len(shared)} groups in "
            "which all three settle"
        )
    ledger = max((run.imbalance or 0.0 for run in returned), default=0.0)
    return (
        f"{_words(SCHEMES[k]).capitalize()}: of {len(runs)} runs {sum(map(_good, runs))} settled, "
        f"{sum(not run.settled for run in returned)} did not, {len(runs) - len(returned)} were "
        f"refused ({len(energy)} for their energy, {sum(map(_loses, energy))} of which only lose "
        f"some); at {USUAL} steps per period or more {sum(map(_good, usual))} of {len(usual)} "
        f"settled. Nearest of the three {sum(run.scheme == SCHEMES[k] for run in nearest)} times"
        f"{mean}; energy imbalance of the accepted runs at most {ledger:.0e}."
    )


def _loses(run: Run) -> bool:
    """Whether a run that was refused for its energy only loses energy."""
    if run.imbalance is None or run.created is None:
        return False
    return run.created <= ENERGY_ERROR < run.imbalance


def _good(run: Run) -> bool:
    """Whether a run has settled and is not refused."""
    return bool(run.settled) and not run.refused


def _size(run: Run) -> float:
    return run.errors.amplitude if run.errors.amplitude is not None else math.inf


def _about_orders(found: Sequence[Series]) -> str:
    """How many fitted orders of the path are two, and which are lower."""
    orders = {(s.name, scheme): s.order(scheme, "path") for s in found for scheme in SCHEMES}
    known = {key: order for key, order in orders.items() if order is not None}
    low = {key: order for key, order in known.items() if order < SECOND}
    words = [
        f"{name} ({', '.join(f'{order:.2f}' for (of, _), order in low.items() if of == name)})"
        for name in dict.fromkeys(name for name, _ in low)
    ]
    return (
        f"Over the first {PATH} periods {len(known) - len(low)} of {len(known)} fits from "
        f"{ASYMPTOTIC} steps per period on are of second order ({SECOND:g} or more)"
        + (f"; lower orders: {'; '.join(words)}." if words else ".")
    )


def _about_references(found: Sequence[Series]) -> list[str]:
    """How well the references of the three schemes agree."""
    known = [(s.agreement.amplitude, s.name) for s in found if s.agreement.amplitude is not None]
    if not known:
        return []
    most, name = max(known)
    return [
        f"At {REFERENCE} steps per period the amplitudes of the three schemes agree to {most:.1e} "
        f"({name}) or better."
    ]


def _about_tolerances(found: Sequence[Series]) -> list[str]:
    """The errors for the requested tolerances, by scheme."""
    told = []
    for scheme in SCHEMES:
        runs = [
            run
            for s in found
            for run in s.runs
            if run.tolerance is not None and run.scheme == scheme
        ]
        got = [_size(run) / run.tolerance for run in runs if run.tolerance and _good(run)]
        if got:
            refused, kept = sum(bool(run.refused) for run in runs), sum(x <= 1.0 for x in got)
            told.append(
                f"Adaptive steps, {_words(scheme)}: of {len(runs)} runs {len(got)} settled, "
                f"{refused} were refused; the error of {kept} is within the tolerance, and at most "
                f"{max(got):.2g} times the tolerance."
            )
    return told


def rows(found: Sequence[Series]) -> list[dict[str, Any]]:
    """One flat row for each run: the columns of `schemes.csv`."""
    return [
        {
            "case": s.name,
            "scheme": run.scheme,
            "steps_per_period": run.steps,
            "tolerance": run.tolerance,
            "refused": run.refused,
            "settled": run.settled,
            "steady": run.steady,
            "periods": run.periods,
            **{f"{name}_error": error for name, error in run.errors._asdict().items()},
            "imbalance": run.imbalance,
            "created": run.created,
            "steps_taken_per_period": run.taken,
            "seconds": run.seconds,
        }
        for s in found
        for run in s.runs
    ]


def summary(found: Sequence[Series]) -> dict[str, Any]:
    """The contents of `schemes.json`."""
    return {
        "reference_steps_per_period": REFERENCE,
        "path_periods": PATH,
        "cases": [
            {
                "case": s.name,
                "failure": s.failure or None,
                "events": dict(s.events),
                "agreement": s.agreement._asdict(),
                "orders": {
                    scheme: {m: s.order(scheme, m) for m in Errors._fields} for scheme in SCHEMES
                }
                if s.runs
                else {},
            }
            for s in found
        ],
        "runs": rows(found),
    }


# ---------------------------------------------------------------------- the picture

MARKERS = ("o", "s", "^")
DRAWN = {"amplitude": "steady amplitude", "path": f"first {PATH} periods"}


@styled
def figure(found: Sequence[Series]) -> Any:
    """Error against steps per period: a panel for each case, a line for each scheme.

    The upper row shows the steady state, the lower row the path.
    """
    from matplotlib.lines import Line2D

    ran = [s for s in found if s.runs]
    made = new_figure(2.9 * len(ran) + 0.6, 6.0)
    axes = made.subplots(len(DRAWN), len(ran), sharex=True, sharey="row", squeeze=False)
    for k, s in enumerate(ran):
        for axis, (measure, words) in zip(axes[:, k], DRAWN.items(), strict=True):
            axis.set(xscale="log", yscale="log")
            for scheme, colour, marker in zip(SCHEMES, COLOURS, MARKERS, strict=False):
                _line(axis, s.of(scheme), measure, colour, marker)
            if k == 0:
                axis.set_ylabel(f"error, {words}")
        axes[0, k].set_title(s.name)
        axes[-1, k].set_xlabel("steps per period")
        counts = [run.steps for run in s.of(SCHEMES[0])]
        axes[-1, k].set_xticks(counts, [str(count) for count in counts], fontsize=8)
        axes[-1, k].minorticks_off()
    for axis in axes[:, 0]:
        _triangle(axis, min(run.steps for run in ran[0].runs if run.steps))
    keys = [
        Line2D([], [], color=colour, marker=marker, label=_words(scheme))
        for scheme, colour, marker in zip(SCHEMES, COLOURS, MARKERS, strict=False)
    ]
    keys += [
        Line2D(
            [],
            [],
            color="#5b636b",
            marker="o",
            markerfacecolor="white",
            linestyle="",
            label="not settled",
        ),
        Line2D(
            [],
            [],
            color="#5b636b",
            marker="x",
            linestyle="",
            label="refused (at the upper edge: no motion)",
        ),
    ]
    made.legend(handles=keys, loc="outside upper left", ncols=len(keys), fontsize=9)
    return made


def _line(axis: Any, runs: Sequence[Run], measure: str, colour: str, marker: str) -> None:
    known = [(run, error) for run in runs if (error := getattr(run.errors, measure))]
    axis.plot([run.steps for run, _ in known], [y for _, y in known], color=colour, zorder=3)
    for run, y in known:
        face = colour if run.settled else "white"
        if run.refused:
            axis.plot(run.steps, y, "x", color=colour, markersize=7, zorder=5)
        else:
            axis.plot(
                run.steps,
                y,
                color=colour,
                marker=marker,
                markersize=5,
                markerfacecolor=face,
                zorder=4,
            )
    lost = [run.steps for run in runs if run.refused and getattr(run.errors, measure) is None]
    place = 0.98 - 0.035 * MARKERS.index(
        marker
    )  # one below the other if several runs have no motion at the same steps
    axis.plot(
        lost,
        [place] * len(lost),
        "x",
        color=colour,
        markersize=7,
        transform=axis.get_xaxis_transform(),
    )


def _triangle(axis: Any, least: float) -> None:
    """Draw a triangle of slope two from the least number of steps to three times as many."""
    low, high = axis.get_ylim()
    high *= 5.0  # space for the marks of runs without a motion
    x0, x1 = least, 3.0 * least
    y1 = low * (high / low) ** 0.06
    y0 = y1 * (x1 / x0) ** 2
    axis.plot([x0, x1, x0, x0], [y0, y1, y1, y0], color="#5b636b", linewidth=1.0)
    axis.annotate(
        "2", (x0, math.sqrt(y0 * y1)), (3, 0), textcoords="offset points", fontsize=8, va="center"
    )
    axis.set_ylim(low, high)


# ---------------------------------------------------------------------- the files


HOW = (
    f"The reduced model by every scheme, compared with {REFERENCE} steps per period of the "
    "discrete gradient: error of the amplitudes in percent by steps per period. A dash: no motion. "
    "In brackets: the motion is refused. With a star (hollow in the picture): it has not settled. "
    "The "
    f"orders are fitted from {ASYMPTOTIC} steps per period on; the path is the first {PATH} "
    "periods. The amplitude is read at the largest step, which misses the peak by chance."
)


def write(found: Sequence[Series], folder: Path) -> list[Path]:
    """Write `schemes.json`, `report.html` and, if there are runs, `schemes.csv` and `schemes.png`.

    Returns:
        The files, the report first.

    Raises:
        OSError: a file cannot be written.
    """
    files = [folder / "report.html", folder / "schemes.json"]
    lines = rows(found)
    write_summary(files[1], summary(found))
    sections: list[tuple[str, list[Any]]] = [("Schemes", list(sentences(found)))]
    if lines:
        files += [folder / "schemes.csv", folder / "schemes.png"]
        write_rows(files[2], lines)
        write_figure(files[3], figure(found))
        sections[0][1].extend(_tables(found, files[3]))
        sections.append(("Every run of the schemes", [every_run(lines)]))
    write_report(files[0], "Errors of the time integration schemes", sections)
    return files


def _tables(found: Sequence[Series], picture: Path) -> list[Any]:
    """The tables and the picture of the report, with the sentences that explain them."""
    changes = "; ".join(
        f"{s.name}: " + ", ".join(f"{count} {kind}" for kind, count in s.events)
        for s in found
        if s.events
    )
    return [
        HOW,
        table(found),
        picture,
        "The same of the displacements at equal instants, over the last period and then over the "
        f"first {PATH} periods from rest. Changes of contact state in these: "
        f"{changes or 'none'}.",
        table(found, "cycle"),
        table(found, "path"),
        "Largest normal force:",
        table(found, "force"),
        "Adaptive steps, by the requested tolerance:",
        tolerances(found),
    ]


def every_run(lines: Sequence[dict[str, Any]]) -> list[list[Any]]:
    """All runs as a table; the first row is the header."""
    return [[key.replace("_", " ") for key in lines[0]], *(list(line.values()) for line in lines)]


def terminal(found: Sequence[Series]) -> str:
    """The table of the steady amplitudes and the sentences, for the terminal."""
    lines = table(found)
    head = (
        []
        if len(lines) == 1
        else ["Error of the amplitude in % by steps per period:", text_table(lines), ""]
    )
    return "\n".join([*head, *sentences(found)])
