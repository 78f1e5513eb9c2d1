"""The report of a sweep: one table, one picture, and the runs that failed with their sentences."""

import itertools
from collections import Counter
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.verdicts import contact_quantities
from fenicsrom.assess.studies.sweep_runs import DONE, DOUBTFUL, FAILED, Sweep
from fenicsrom.notes import AMPLITUDES
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Map, Panel, Plot
from fenicsrom.post.base.style import line_styles
from fenicsrom.post.base.tables import Quantity, table_of
from fenicsrom.scene.reading.overrides import column_name, given_unit_of
from fenicsrom.words import counted

COLUMNS = (
    *(
        Quantity(f"amplitude_{name}_m", head=f"{name} amplitude, mm", digits=4)
        for name in ("normal", "tangential", *"xyz")
    ),
    *(
        Quantity(f"probe_amplitude_{axis}_m", head=f"probe amplitude in {axis}, mm", digits=4)
        for axis in "xyz"
    ),
    Quantity("largest_amplitude_m", head="largest amplitude of a sector, mm", digits=4),
    Quantity("amplification", head="amplification", digits=4),
    Quantity("nodal_diameter", head="nodal diameter"),
    Quantity("peak_normal_force_N", head="peak normal force, N", digits=4),
    Quantity("largest_multiplier", head="largest Floquet multiplier", digits=4),
)
"""The numbers of a run for people; those with a unit have a picture."""

MOST_LINES = 20  # of a table in the terminal, without its head


def swept_keys(found: Sweep) -> list[str]:
    """The keys of all axes."""
    return [key for axis in found.axes for key in axis.keys]


def table(found: Sweep) -> list[list[Any]]:
    """The runs as a table."""
    keys = swept_keys(found)
    labels, names = zip(keys, key_labels(found, tuple(keys)), strict=True), column_names(found)
    return table_of(
        found.rows,
        [
            Quantity("run", head="run"),
            *(Quantity(names[key], key, label) for key, label in labels),
            *COLUMNS,
            Quantity("steady", head="steady"),
            Quantity("outcome", lambda row: row.get("outcome", "not run"), "outcome"),
        ],
    )


def column_names(found: Sweep) -> dict[str, str]:
    """The columns of the swept keys in `sweep.csv`."""
    return {key: column_name(found.scene, key, given=True) for key in swept_keys(found)}


def sentences(found: Sweep) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    counts = Counter(row.get("outcome", "not run") for row in found.rows)
    listed = ", ".join(f"{count} {name}" for name, count in counts.items())
    lines = [f"{counted(len(found.rows), 'run')} in {found.seconds:.1f} s: {listed}."]
    if found.models > 1:
        lines.append(f"The runs needed {found.models} reduced models.")
    if found.reused:
        lines.append(
            f"The results of {counted(found.reused, 'run')} are those of an earlier sweep."
        )
    if found.interrupted:
        lines.append("The sweep was interrupted.")
    return lines


def remarks(found: Sweep) -> list[str]:
    """One sentence for each reason of doubtful and failed runs and each warning, with the runs."""
    reasons: dict[str, list[str]] = {}
    listed = found.with_outcome(FAILED, DOUBTFUL, DONE)
    for row in sorted(listed, key=lambda row: bool(row["outcome"] == DONE)):
        if "sentence" in row:
            reasons.setdefault(row["sentence"], []).append(str(row["run"]))
    return [
        f"{'run' if len(runs) == 1 else 'runs'} {', '.join(runs)}: {sentence}"
        for sentence, runs in reasons.items()
    ]


def summary(found: Sweep) -> dict[str, Any]:
    """What `sweep.json` has of a sweep."""
    return {
        "axes": [{"keys": axis.keys, "values": axis.values} for axis in found.axes],
        "models": found.models,
        "reused": found.reused,
        "runs": found.rows,
    }


def report(found: Sweep) -> Report:
    """The report of a sweep: `sweep.csv`, `sweep.json` and `sweep.png`."""
    keys, names = swept_keys(found), column_names(found)
    sections = [
        Section("Doubtful and failed runs, and warnings", remarks(found)),
        Section("Runs", [table(found)], keys=1 + len(keys), most=MOST_LINES),
    ]
    rows = [
        {names.get(key, key): value for key, value in row.items() if key != "notes"}
        for row in found.rows
    ]
    drawn = Picture("Results", "sweep.png", lambda: figure(found), CAPTION, "sweep.csv")
    return Report(
        "sweep",
        title="sweep",
        found=found,
        sentences=sentences(found),
        sections=sections,
        rows=rows,
        summary=summary(found),
        pictures=[drawn] if found.with_outcome(DONE, DOUBTFUL) else [],
        varied=keys,
        quantities=[AMPLITUDES, *contact_quantities(found.scene)],
    )


def key_labels(found: Sweep, keys: tuple[str, ...], join: str = ", ") -> list[str]:
    """Keys with their units."""
    units = [given_unit_of(found.scene, key) for key in keys]
    return [f"{key}{join}{unit}" if unit else key for key, unit in zip(keys, units, strict=True)]


MOST_CURVES = 8  # more curves are drawn as a map
CAPTION = "One point for each run of the sweep."


def figure(found: Sweep) -> Plot:
    """The amplitudes and the largest normal force of all runs.

    The first axis is the abscissa. There is a curve for each combination of the others, or a map
    where there are two axes and more than `MOST_CURVES` curves. Runs that have not settled or did
    not pass a check are drawn hollow; runs without a motion are missing.
    """
    usable = found.with_outcome(DONE, DOUBTFUL)
    drawn = [item for item in COLUMNS if item.unit and any(item.key in row for row in usable)]
    shape = tuple(len(axis.values) for axis in found.axes)
    panels = []
    for column in drawn:
        numbers = column.column(found.rows).reshape(shape)
        if len(shape) == 2 and shape[1] > MOST_CURVES:
            panels.append(_map(found, numbers, column.label))
        else:
            panels.append(_curves(found, numbers, column.label))
    others = tuple(key for axis in found.axes[1:] for key in axis.keys)
    title = ", ".join(map(_short, key_labels(found, others, " in ")))
    height = 3.1 * max(len(panels), 1)
    across = " and ".join(_labels(found, 0))
    return Plot(panels or [Panel(())], 7.4, height, share="x", xlabel=across, title=title)


def _labels(found: Sweep, axis: int) -> list[str]:
    """The keys of an axis with their units."""
    return key_labels(found, found.axes[axis].keys)


def _places(found: Sweep, axis: int) -> tuple[Array, list[str] | None]:
    """The places of the values of an axis, and their names where they are not numbers."""
    values = [position[0] for position in found.axes[axis].values]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.float64), None
    return np.arange(len(values), dtype=np.float64), [str(value) for value in values]


def _curves(found: Sweep, numbers: Array, label: str) -> Panel:
    """A curve over the first axis for each combination of values of the other axes."""
    x, names = _places(found, 0)
    order = np.argsort(x)
    solid = np.array([row.get("outcome") == DONE and bool(row["settled"]) for row in found.rows])
    solid = solid.reshape(numbers.shape)
    others = list(itertools.product(*(range(count) for count in numbers.shape[1:])))[:MOST_CURVES]
    columns = numbers.reshape(x.size, -1).T, solid.reshape(x.size, -1).T
    labels = [
        ", ".join(
            f"{value:g}" if isinstance(value, float) else str(value)
            for axis, k in zip(found.axes[1:], other, strict=True)
            for value in axis.values[k]
        )
        for other in others
    ]
    styles = line_styles(labels)
    items: list[Item] = []
    for name, y, filled in zip(labels, *columns, strict=False):
        look = styles[name]
        items.append(Line(x[order], y[order], label=name, **look))
        for full in (True, False):
            part = filled == full
            dots: dict[str, Any] = {"marker": "o", "markersize": 4.0, "hollow": not full}
            items.append(Line(x[part], y[part], "", look["color"], label=name, **dots))
    even = names is None and x.size > 2 and x.min() > 0.0 and np.ptp(np.diff(np.log(x))) < 1e-6
    log = "x" if even else ""
    return Panel(items, ylabel=label, log=log, xticks=_ticks(x, names))


def _map(found: Sweep, numbers: Array, label: str) -> Panel:
    """The values over two axes as colours."""
    (x, x_names), (y, y_names) = _places(found, 0), _places(found, 1)
    rows, columns = np.argsort(y), np.argsort(x)
    shade = Map(x[columns], y[rows], numbers.T[np.ix_(rows, columns)], bar=label)
    marks: dict[str, Any] = {"xticks": _ticks(x, x_names), "yticks": _ticks(y, y_names)}
    return Panel([shade], ylabel=" and ".join(_labels(found, 1)), tight="xy", **marks)


def _ticks(places: Array, names: list[str] | None) -> dict[float, str]:
    """The marks of an axis whose values are no numbers."""
    return {} if names is None else dict(zip(map(float, places), names, strict=True))


def _short(key: str) -> str:
    """The last part of the path of a key."""
    return key.rpartition(".")[2]
