"""The report of a sweep: one table, one picture, and the runs that failed with their sentences."""

from __future__ import annotations

from collections import Counter
from typing import Any

from fenicsrom.assess.studies.sweep_runs import DONE, DOUBTFUL, FAILED, Sweep
from fenicsrom.online.store.provenance import provenance
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.report import Report, Section
from fenicsrom.post.studies.sweep_columns import COLUMNS, key_labels
from fenicsrom.post.studies.sweep_figures import figure
from fenicsrom.scene.reading.units import column_name
from fenicsrom.words import counted

MOST_LINES = 20  # of a table in the terminal, without its head


def swept_keys(found: Sweep) -> list[str]:
    """The keys of all axes."""
    return [key for axis in found.axes for key in axis.keys]


def table(found: Sweep) -> list[list[Any]]:
    """The runs as a table, whose first row is the header."""
    keys = swept_keys(found)
    columns = [item for item in COLUMNS if any(row.get(item.key) is not None for row in found.rows)]
    labels = key_labels(found, tuple(keys), " ")
    head = ["run", *labels, *(column.head for column in columns), "steady", "outcome"]
    lines = []
    for row in found.rows:
        numbers = [
            None if row.get(column.key) is None else column.factor * row[column.key]
            for column in columns
        ]
        outcome = row.get("outcome", "not run")
        lines.append(
            [row["run"], *(row[key] for key in keys), *numbers, row.get("steady"), outcome]
        )
    return [head, *lines]


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
        lines.append("The sweep was interrupted; --resume continues it.")
    return lines


def remarks(found: Sweep) -> list[str]:
    """One sentence for each reason of doubtful and failed runs and each warning, with the runs."""
    reasons: dict[str, list[str]] = {}
    for row in sorted(found.with_outcome(FAILED, DOUBTFUL, DONE), key=_is_done):
        if "sentence" not in row:
            continue
        reasons.setdefault(row["sentence"], []).append(str(row["run"]))
    return [
        f"{'run' if len(runs) == 1 else 'runs'} {', '.join(runs)}: {sentence}"
        for sentence, runs in reasons.items()
    ]


def _is_done(row: dict[str, Any]) -> bool:
    """Whether a run is neither doubtful nor failed."""
    return bool(row["outcome"] == DONE)


def summary(found: Sweep) -> dict[str, Any]:
    """The contents of `sweep.json`."""
    return {
        "scene": found.scene.source,
        "axes": [{"keys": axis.keys, "values": axis.values} for axis in found.axes],
        "models": found.models,
        "reused": found.reused,
        "interrupted": found.interrupted,
        "seconds": found.seconds,
        "runs": found.rows,
        "provenance": provenance(),
    }


def report(found: Sweep) -> Report:
    """The report of a sweep: `sweep.csv`, `sweep.json` and `sweep.png`."""
    keys = swept_keys(found)
    names = {key: column_name(found.scene, key, given=True) for key in keys}
    drawn = found.with_outcome(DONE, DOUBTFUL)
    return Report(
        "sweep",
        "sweep",
        found.scene,
        sentences(found),
        [],
        [
            Section("Doubtful and failed runs, and warnings", remarks(found)),
            Section("Runs", [table(found)], keys=1 + len(keys), most=MOST_LINES),
        ],
        [{names.get(key, key): value for key, value in row.items()} for row in found.rows],
        lambda: summary(found),
        [Picture("Results", "sweep.png", lambda: figure(found))] if drawn else [],
        varied=keys,
    )
