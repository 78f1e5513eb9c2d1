"""How far off each time integration scheme is, by its steps: the evidence behind the default.

A model is run to its steady state by every scheme at every number of steps a period, and with every
tolerance. Each run is made as a user would make it, checked as `fenicsrom.online.doubt` does, and
compared with a run of `REFERENCE` steps of the discrete gradient, which those of the other schemes
confirm. Four relative errors are measured (`Errors`), and the order p of error = c h^p is fitted to
each over the steps that are short enough: second order is what every scheme has where the motion is
smooth, and what one that locates the events of the contact keeps.

A steady amplitude is read off at the steps: even of an exact motion the largest of them misses the
peak by up to (pi/steps)^2/2, by chance. So the fits that tell of the scheme are those of the
displacements at the same instants, over the last period (`cycle`) and over the first ones (`path`),
to which the steady state's own errors of phase do not add.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.verdicts import rejection_reason
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.files import atomic_write
from fenicsrom.online.measures import amplitude, difference, has_settled, peak_normal_force
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.post.style import COLOURS, new_figure, styled
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_rows
from fenicsrom.scene import Scene, parse_scene, scene_table

SCHEMES = ("discrete-gradient", "average-acceleration", "generalised-alpha")
STEPS = (25, 50, 100, 200, 400, 800)  # a period
TOLERANCES = (1e-2, 1e-3, 1e-4)
REFERENCE = 6400  # steps a period of what all is compared with
PATH = 4  # periods from rest, in which each of the paper's cases slips, and all but one lift off
ASYMPTOTIC = 100  # steps a period from which on the order is fitted
CLEAR = (
    3.0  # an error is fitted if it is this many times what the references of the schemes differ by
)
USUAL = 200  # steps a period, the default of a scene
SECOND = 1.8  # a fitted order below this is not called second order


class Errors(NamedTuple):
    """Relative errors of a motion; None where there is nothing to compare.

    Attributes:
        amplitude: of the amplitudes that a run prints; of the root mean squares, if it has not
        settled.
        cycle: of the displacements at the same instants of the last period, root mean square.
        force: of the largest normal force of the last period.
        path: of the displacements at the same instants of the first `PATH` periods, root mean
            square.
    """

    amplitude: float | None = None
    cycle: float | None = None
    force: float | None = None
    path: float | None = None


@dataclass(frozen=True)
class Run:
    """A motion by one scheme.

    Attributes:
        scheme: its name.
        steps: a period; None with a tolerance.
        tolerance: None with a number of steps.
        refused: why there is no result, or one not to be relied on; empty if there is one.
        errors: of the motion, if there is one.
        imbalance: of its energy ledger, relative.
        created: the part of it that is energy from nowhere; the other is lost.
        settled: whether its amplitudes repeat.
        steady: whether the motion repeats.
        periods: number of periods run.
        taken: mean number of steps a period.
        seconds: of the integration.
    """

    scheme: str
    steps: int | None
    tolerance: float | None
    refused: str = ""
    errors: Errors = field(default_factory=Errors)
    imbalance: float | None = None
    created: float | None = None
    settled: bool | None = None
    steady: bool | None = None
    periods: int | None = None
    taken: float | None = None
    seconds: float | None = None


@dataclass(frozen=True)
class Series:
    """All runs of a model.

    Attributes:
        name: of the case.
        runs: by schemes, steps and then tolerances.
        agreement: the largest errors of the other schemes at `REFERENCE` steps: what the errors are
        certain to.
        events: changes of contact state on the path, by kind.
        failure: why there are no runs; empty if there are.
    """

    name: str
    runs: tuple[Run, ...] = ()
    agreement: Errors = field(default_factory=Errors)
    events: tuple[tuple[str, int], ...] = ()
    failure: str = ""

    def of(self, scheme: str) -> list[Run]:
        """The runs of a scheme with a number of steps."""
        return [run for run in self.runs if run.scheme == scheme and run.steps is not None]

    def order(self, scheme: str, measure: str) -> float | None:
        """The fitted order of an error, `Errors.<measure>`; None where fewer than three runs tell
        of it.
        """
        least = CLEAR * (getattr(self.agreement, measure) or 0.0)
        points = [
            (run.steps, error)
            for run in self.of(scheme)
            if run.steps is not None
            and run.steps >= ASYMPTOTIC
            and (run.settled or measure == "path")
            if (error := getattr(run.errors, measure)) is not None and error > least
        ]
        return fitted_order(*zip(*points, strict=True)) if len(points) >= 3 else None


def fitted_order(steps: Sequence[float], errors: Sequence[float]) -> float:
    """The p of errors = c steps^-p, by least squares of the logarithms."""
    return -float(
        np.polyfit(np.log(np.asarray(steps, float)), np.log(np.asarray(errors, float)), 1)[0]
    )


# ---------------------------------------------------------------------- the runs


def series(
    name: str,
    model: Any,
    scene: Scene,
    steps: Sequence[int] = STEPS,
    tolerances: Sequence[float] = TOLERANCES,
    reference: int = REFERENCE,
) -> Series:
    """Run a model by every scheme.

    Args:
        name: of the case.
        model: the model, which does not depend on the time integration.
        scene: its scene; the scheme and the steps of its [time] table are replaced.
        steps: numbers of steps a period.
        tolerances: of adaptive steps.
        reference: number of steps a period to compare with.

    Returns:
        The runs; or, as the failure of the series, why none can be compared: the loads do not
        repeat, or the reference is refused.
    """
    instants = math.gcd(reference, *steps)
    try:
        exact = simulate(model, with_steps(scene, SCHEMES[0], reference))
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return Series(
            name, failure=f"{reference} steps a period, to compare with, are refused: {error}"
        )
    others = []
    for scheme in SCHEMES[1:]:
        with suppress(ConvergenceError, AccuracyError):
            others.append(
                errors_of(simulate(model, with_steps(scene, scheme, reference)), exact, instants)
            )
    agreement = Errors(
        *(
            max((e for e in column if e is not None), default=None)
            for column in zip(*others, strict=True)
        )
    )
    runs = [
        _run(model, with_steps(scene, scheme, count, tolerance), exact, instants)
        for count, tolerance in [*((n, None) for n in steps), *((None, t) for t in tolerances)]
        for scheme in SCHEMES
    ]
    runs.sort(key=lambda run: (run.steps is None, SCHEMES.index(run.scheme)))
    return Series(name, tuple(runs), agreement, events(exact))


def with_steps(
    scene: Scene, scheme: str, steps: int | None, tolerance: float | None = None
) -> Scene:
    """The scene with another scheme and another number of steps a period, or a tolerance.

    Raises:
        SceneError: the loads do not repeat, so that there is no period.
    """
    table = scene_table(scene)
    given = {"scheme": scheme, "steps_per_period": steps, "tolerance": tolerance}
    taken = {*given, "spectral_radius"} if scheme != scene.time.scheme else set(given)
    kept = {key: value for key, value in table["time"].items() if key not in taken}
    table["time"] = kept | {key: value for key, value in given.items() if value is not None}
    return parse_scene(table, scene.source, None)


def _run(model: Any, scene: Scene, exact: Motion, instants: int) -> Run:
    """A run of a scene, checked as a user's, and compared with the exact motion at so many instants
    a period.
    """
    time = scene.time
    begin = clock.perf_counter()
    try:
        motion = simulate(model, scene)
    except (ConvergenceError, AccuracyError) as error:
        return Run(
            time.scheme,
            time.steps_per_period,
            time.tolerance,
            str(error),
            seconds=clock.perf_counter() - begin,
        )
    return Run(
        time.scheme,
        time.steps_per_period,
        time.tolerance,
        str(rejection_reason(model, scene, motion) or ""),
        errors_of(motion, exact, None if time.tolerance is not None else instants),
        motion.relative_imbalance,
        _created(motion),
        has_settled(motion),
        motion.steady,
        motion.periods,
        motion.steps / motion.periods,
        motion.seconds,
    )


def _created(motion: Motion) -> float:
    """Largest energy from nowhere, relative as in `Motion.relative_imbalance`."""
    off = motion.imbalance
    most = float(np.max(np.abs(off)))
    return motion.relative_imbalance * max(float(np.max(off)), 0.0) / most if most > 0.0 else 0.0


def errors_of(motion: Motion, exact: Motion, instants: int | None) -> Errors:
    """The errors of a motion against one of many more steps.

    Args:
        motion: the motion.
        exact: what it is compared with.
        instants: number of instants a period at which both have a step; None if there are none.
    """
    cycle = path = None
    if instants is not None:
        first = min(PATH, motion.periods, exact.periods)
        path = _apart(_at(motion, 0, first, instants), _at(exact, 0, first, instants))
        if has_settled(motion) and has_settled(exact):
            ends = [_at(m, m.periods - 1, m.periods, instants) for m in (motion, exact)]
            cycle = _apart(*(end - end.mean(axis=0) for end in ends))
    peak = peak_normal_force(exact)
    force = abs(peak_normal_force(motion) / peak - 1.0) if peak > 0.0 else None
    return Errors(
        difference(motion, exact) if np.any(amplitude(exact)) else None, cycle, force, path
    )


def _at(motion: Motion, first: int, last: int, instants: int) -> Array:
    """Displacements (k, P d) at the instants of the periods from first to last, m."""
    assert motion.period is not None
    times = motion.period * np.arange(first * instants + 1, last * instants + 1) / instants
    columns = motion.displacement.reshape(motion.time.size, -1).T
    return np.array([np.interp(times, motion.time, column) for column in columns]).T


def _apart(values: Array, exact: Array) -> float | None:
    """Norm of the difference relative to that of the exact values."""
    size = float(np.linalg.norm(exact))
    return float(np.linalg.norm(values - exact)) / size if size > 0.0 else None


def events(motion: Motion) -> tuple[tuple[str, int], ...]:
    """How often contacts stick, slip, open and close on the path, those that happen."""
    state = motion.state[motion.time <= PATH * (motion.period or np.inf)]
    before, after = state[:-1], state[1:]
    kinds = {
        "changes from stick to slip": (before == 1) & (after == 0),
        "changes from slip to stick": (before == 0) & (after == 1),
        "openings": (before >= 0) & (after < 0),
        "closings": (before < 0) & (after >= 0),
    }
    return tuple((kind, int(np.sum(those))) for kind, those in kinds.items() if np.any(those))


# ---------------------------------------------------------------------- what was found


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
    """An error in percent by case, scheme and steps a period, and the fitted orders of it and of
    the path; the head first.
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
    """What adaptive steps come to: error of the amplitude in percent, and steps a period; the head
    first.
    """
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
    """What the runs show, for the terminal and the report."""
    told = [f"{s.name}: {s.failure}" for s in found if s.failure]
    ran = [s for s in found if s.runs]
    if not ran:
        return told
    groups = [
        group for s in ran for group in zip(*(s.of(scheme) for scheme in SCHEMES), strict=True)
    ]
    shared = [
        group
        for group in groups
        if all(run.settled and not run.refused and run.errors.amplitude for run in group)
    ]
    nearest = [
        min(good, key=_size).scheme
        for group in groups
        if (good := [run for run in group if _good(run)])
    ]
    for k, scheme in enumerate(SCHEMES):
        runs = [group[k] for group in groups]
        usual = [run for run in runs if run.steps is not None and run.steps >= USUAL]
        returned = [run for run in runs if not run.refused]
        energy = [
            run for run in runs if "energy" in run.refused
        ]  # the sentences of the other refusals have no such word
        lossy = sum("is lost" in run.refused for run in energy)
        mean = (
            math.exp(sum(math.log(_size(group[k])) for group in shared) / len(shared))
            if shared
            else None
        )
        told.append(
            f"{_words(scheme).capitalize()}: of {len(runs)} runs {sum(map(_good, runs))} settled, "
            f"{sum(not run.settled for run in returned)} did not, {len(runs) - len(returned)} were refused ({len(energy)} for "
            f"their energy, {lossy} of which only lose some); at {USUAL} steps a period or more {sum(map(_good, usual))} of "
            f"{len(usual)} settled. Nearest of the three {nearest.count(scheme)} times"
            + (
                f", off by {100.0 * mean:.2g} % in the geometric mean of {len(shared)} that all settle in"
                if mean
                else ""
            )
            + f"; ledger of what is not refused to {max((run.imbalance or 0.0 for run in returned), default=0.0):.0e}."
        )
    return [*told, _about_orders(ran), *_about_references(ran), *_about_tolerances(ran)]


def _good(run: Run) -> bool:
    """Whether a run has settled and is not refused."""
    return bool(run.settled) and not run.refused


def _size(run: Run) -> float:
    return run.errors.amplitude if run.errors.amplitude is not None else math.inf


def _about_orders(found: Sequence[Series]) -> str:
    """Of what order the path is, and where not of the second."""
    orders = {(s.name, scheme): s.order(scheme, "path") for s in found for scheme in SCHEMES}
    known = {key: order for key, order in orders.items() if order is not None}
    low = {key: order for key, order in known.items() if order < SECOND}
    words = [
        f"{name} ({', '.join(f'{low[name, scheme]:.2f}' for scheme in SCHEMES if (name, scheme) in low)})"
        for name in dict.fromkeys(name for name, _ in low)
    ]
    return (
        f"Over the first {PATH} periods {len(known) - len(low)} of {len(known)} fits from {ASYMPTOTIC} steps a period on are "
        f"of second order ({SECOND:g} or more)"
        + (f"; not so: {'; '.join(words)}." if words else ".")
    )


def _about_references(found: Sequence[Series]) -> list[str]:
    """To what the references agree."""
    known = [(s.agreement.amplitude, s.name) for s in found if s.agreement.amplitude is not None]
    if not known:
        return []
    most, name = max(known)
    return [
        f"At {REFERENCE} steps a period the amplitudes of the three agree to {most:.1e} ({name}) or better."
    ]


def _about_tolerances(found: Sequence[Series]) -> list[str]:
    """What was got for what was asked, by scheme."""
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
                f"Adaptive steps, {_words(scheme)}: of {len(runs)} runs {len(got)} settled, {refused} were refused; {kept} are "
                f"off by no more than the tolerance, {max(got):.2g} times it at most."
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
    """What `stability.json` says of the schemes."""
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
    """Error against steps a period, a panel for each case, a line for each scheme; above the steady
    state, below the path.
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
        axes[-1, k].set_xlabel("steps a period")
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
    )  # one below the other, where more have no motion at the same steps
    axis.plot(
        lost,
        [place] * len(lost),
        "x",
        color=colour,
        markersize=7,
        transform=axis.get_xaxis_transform(),
    )


def _triangle(axis: Any, least: float) -> None:
    """A triangle of slope two in the lower left corner, from the least number of steps to three
    times as many.
    """
    low, high = axis.get_ylim()
    high *= 5.0  # for the marks of runs without a motion
    x0, x1 = least, 3.0 * least
    y1 = low * (high / low) ** 0.06
    y0 = y1 * (x1 / x0) ** 2
    axis.plot([x0, x1, x0, x0], [y0, y1, y1, y0], color="#5b636b", linewidth=1.0)
    axis.annotate(
        "2", (x0, math.sqrt(y0 * y1)), (3, 0), textcoords="offset points", fontsize=8, va="center"
    )
    axis.set_ylim(low, high)


# ---------------------------------------------------------------------- the files


def write(found: Sequence[Series], folder: Path) -> tuple[list[Path], list[tuple[str, list[Any]]]]:
    """Write `schemes.csv` and, if there is anything to draw, `schemes.png`.

    Returns:
        The files, and the sections of the report: what the schemes come to, and every run.

    Raises:
        OSError: a file cannot be written.
    """
    lines = rows(found)
    if not lines:
        return [], [("Schemes", list(sentences(found)))]
    files = [folder / "schemes.csv", folder / "schemes.png"]
    write_rows(files[0], lines)
    with atomic_write(files[1]) as temporary:
        figure(found).savefig(temporary, format="png", dpi=130)
    how = (
        f"The reduced model by every scheme, against {REFERENCE} steps a period of the discrete gradient: error in percent of "
        "the amplitudes by steps a period; a dash where there is no motion, in brackets where a motion is refused, with a star "
        f"(in the picture hollow) where it has not settled; and the orders fitted from {ASYMPTOTIC} steps a period on, the "
        f"path being the first {PATH} periods. The amplitude is that of the largest step, which misses the peak by chance."
    )
    changes = "; ".join(
        f"{s.name}: " + ", ".join(f"{count} {kind}" for kind, count in s.events)
        for s in found
        if s.events
    )
    drawn = (
        f"The same of the displacements at the same instants, of the last period and then of the first {PATH} from rest. In "
        f"these the contacts change: {changes or 'nowhere'}."
    )
    short = (
        "Schemes",
        [
            *sentences(found),
            how,
            table(found),
            files[1],
            drawn,
            table(found, "cycle"),
            table(found, "path"),
            "Largest normal force:",
            table(found, "force"),
            "Adaptive steps, by the tolerance asked for:",
            tolerances(found),
        ],
    )
    return files, [short, ("Every run of the schemes", [every_run(lines)])]


def every_run(lines: Sequence[dict[str, Any]]) -> list[list[Any]]:
    """All runs as a table, the head first."""
    return [[key.replace("_", " ") for key in lines[0]], *(list(line.values()) for line in lines)]


def terminal(found: Sequence[Series]) -> str:
    """The table of the steady amplitudes and the sentences, for the terminal."""
    lines = table(found)
    head = (
        []
        if len(lines) == 1
        else ["Error of the amplitude in % by steps a period:", text_table(lines), ""]
    )
    return "\n".join([*head, *sentences(found)])
