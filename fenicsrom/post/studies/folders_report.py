"""Several output folders on one page: results, curves over each other, differences of scenes."""

import csv
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.notes import TRUSTED, VERDICTS, Note, Verdict
from fenicsrom.online.motion.motion import read_history
from fenicsrom.post.base.origin import SCENE_FILE
from fenicsrom.post.base.page import write_report
from fenicsrom.post.base.picture import Picture, draw_pictures
from fenicsrom.post.base.plot import Item, Line, Panel, Plot
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import in_order, table_of, text_table

FILES = {"run": "summary.json", "response": "response.json", "backbone": "backbone.json"}
"""The kinds of results, and the file that tells them."""


@dataclass(frozen=True)
class Outcome:
    """The results in an output folder.

    Attributes:
        name: what the folder is called on the page.
        kind: one of `FILES`.
        folder: the folder.
        scene: key of the scene -> value.
        summary: the contents of the JSON file.
        rows: the rows of the CSV file; none of a run.
    """

    name: str
    kind: str
    folder: Path
    scene: Mapping[str, Any]
    summary: Mapping[str, Any]
    rows: Sequence[Mapping[str, str]]

    @property
    def verdict(self) -> Verdict:
        """The verdict on the results."""
        return Verdict(**self.summary["verdict"])


def outcome(folder: Path, name: str) -> Outcome:
    """Read the results in an output folder.

    Raises:
        SceneError: the folder holds no run, response curve or backbone, or a file is damaged.
    """
    kind = next((kind for kind, file in FILES.items() if (folder / file).is_file()), None)
    if kind is None or not (folder / SCENE_FILE).is_file():
        needed = f"{SCENE_FILE} with {', '.join(FILES.values())}"
        reason = f"must be the output folder of {', '.join(FILES)}; it has no {needed}"
        raise refuse(folder, reason, ErrorKind.FILE)
    try:
        summary = json.loads((folder / FILES[kind]).read_text("utf-8"))
        scene = dict(_flat(tomllib.loads((folder / SCENE_FILE).read_text("utf-8"))))
        table = folder / f"{kind}.csv"
        text = table.read_text("utf-8") if kind != "run" else ""
    except (ValueError, OSError) as error:
        raise refuse(folder, f"the results cannot be read: {error}") from None
    if "verdict" not in summary:
        reason = f"{FILES[kind]} has no verdict: an earlier version wrote it; run the scene again"
        raise refuse(folder, reason, ErrorKind.MISMATCH)
    rows = list(csv.DictReader(text.splitlines()))
    return Outcome(name, kind, folder, scene, summary, rows)


def _flat(table: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The values of a scene with their keys, such as `loads.0.force`."""
    if isinstance(table, dict):
        for name, value in table.items():
            yield from _flat(value, f"{key}.{name}" if key else name)
    elif isinstance(table, list) and any(isinstance(value, dict) for value in table):
        for k, value in enumerate(table):
            yield from _flat(value, f"{key}.{k}")
    else:
        yield key, table


def write(folders: Sequence[Path], output: Path) -> tuple[str, list[Path]]:
    """Write `report.html` of several output folders with its pictures.

    Returns:
        The table of results, and the files.

    Raises:
        SceneError: a folder holds no results.
        OSError: a file cannot be written.
    """
    unique = len({folder.name for folder in folders}) == len(folders)
    found = [outcome(folder, folder.name if unique else str(folder)) for folder in folders]
    output.mkdir(parents=True, exist_ok=True)
    warnings = [f"{one.name}: {line}" for one in found for line in one.summary.get("warnings", ())]
    undrawn: list[Note] = []
    drawn = draw_pictures(_pictures(found), output, undrawn)
    results, differing = results_table(found), differences(found)
    sections: list[tuple[str, list[Any]]] = [
        ("Results", [results, *drawn[:1]]),
        ("Differences of the scenes", [differing if len(differing) > 1 else "None."]),
        *((picture.heading, [picture]) for picture in drawn[1:]),
    ]
    title = f"Comparison of {', '.join(one.name for one in found)}"
    page = write_report(
        output / "report.html", title, sections, _verdict(found), [*warnings, *undrawn]
    )
    return text_table(results, 2), [page, *(picture.path for picture in drawn)]


def _verdict(found: Sequence[Outcome]) -> Verdict:
    """The worst verdict of the folders."""
    worst = max(found, key=lambda one: VERDICTS.index(one.verdict.kind))
    if worst.verdict.kind == TRUSTED:
        return worst.verdict
    each = {one.name: one.verdict.text for one in found}
    return Verdict(worst.verdict.kind, f"{worst.name}: {worst.verdict.reason}", each)


def results_table(found: Sequence[Outcome]) -> list[list[Any]]:
    """A row for each motion, curve and backbone: its largest amplitude, and where it occurs."""
    rows = []
    for one in found:
        motions = one.summary.get("response", {}) if one.kind == "run" else {}
        for model, motion in motions.items():
            size = max(in_order(motion["amplitude_m"]))
            rows.append(_result(one, f"{model} model", size, motion))
        for name, lines in _curves(one):
            top = max(lines, key=_amplitude)
            rows.append(_result(one, name, _amplitude(top), top))
    return table_of(rows)


def _result(one: Outcome, what: str, amplitude: float, numbers: Mapping[str, Any]) -> Any:
    """A row with the amplitude, m, and other numbers of a motion."""

    def number(key: str) -> float | None:
        return float(numbers[key]) if numbers.get(key) not in (None, "") else None

    return {
        "folder": one.name,
        "what": what,
        "largest amplitude mm": 1e3 * amplitude,
        "at Hz": number("frequency_Hz"),
        "peak normal force N": number("peak_normal_force_N"),
        "friction J per period": number("friction_dissipation_per_period_J"),
    }


def differences(found: Sequence[Outcome]) -> list[list[Any]]:
    """The keys of the scenes whose values differ, after a row of heads."""
    keys = dict.fromkeys(key for one in found for key in one.scene)
    rows = [["key", *(one.name for one in found)]]
    for key in keys:
        values = [one.scene.get(key) for one in found]
        if any(value != values[0] for value in values):
            rows.append([key, *("–" if value is None else str(value) for value in values)])
    return rows


def _amplitude(row: Mapping[str, str]) -> float:
    """The largest amplitude of a point, m."""
    return max(float(v) for k, v in row.items() if k.startswith("amplitude_") and v)


def _curves(one: Outcome) -> Iterator[tuple[str, list[Mapping[str, str]]]]:
    """The name and the rows of each response curve, or those of the backbone."""
    key = one.summary.get("family")
    if not one.rows:
        return
    column = next((name for name in one.rows[0] if key and name.startswith(key)), None)
    if key is None or column is None:
        yield one.kind, list(one.rows)
        return
    for value, rows in groupby(one.rows, key=lambda row: row[column]):
        yield f"{key.rsplit('.', 1)[-1]} = {float(value):g}", list(rows)


def _pictures(found: Sequence[Outcome]) -> list[Picture]:
    """The pictures: response curves and backbones over the parameter, and the motions of runs."""
    curves: dict[str, list[Outcome]] = {}
    for one in found:
        if one.rows:
            curves.setdefault(_parameter(one), []).append(one)
    pictures = [
        Picture(
            f"Amplitude over {_label(parameter).partition(',')[0]}",
            f"response{k or ''}.png",
            partial(curves_figure, chosen, parameter),
            "Response curves and backbones over each other. Unstable parts are dashed, backbones "
            "are dotted.",
        )
        for k, (parameter, chosen) in enumerate(curves.items())
    ]
    runs = [one for one in found if (one.folder / "history.npz").is_file()]
    if runs:
        pictures.append(
            Picture(
                "Motion",
                "motion.png",
                lambda: motions_figure(runs),
                "The recorded motion of each run, at the contact point or probe and in the "
                "direction that moves most. Where Newton's method finds the motion that repeats, "
                "the record jumps to it.",
            )
        )
    return pictures


def _parameter(one: Outcome) -> str:
    """The column of the parameter of curves."""
    key = "frequency" if one.kind == "backbone" else str(one.summary["parameter"])
    return next(name for name in one.rows[0] if name.startswith(key))


def _label(column: str) -> str:
    """The name of a column and its unit, such as `frequency_Hz`, as the label of an axis."""
    name, _, unit = column.rpartition("_")
    return f"{name}, {unit}" if name else column


def curves_figure(found: Sequence[Outcome], parameter: str) -> Plot:
    """Response curves and backbones with the same parameter over each other."""
    items: list[Item] = []
    named = [(one, *curve) for one in found for curve in _curves(one)]
    for k, (one, name, rows) in enumerate(named):
        label, color = f"{one.name}, {name}", COLOURS[k % len(COLOURS)]
        for _, piece in groupby(rows, key=lambda row: row.get("piece")):
            points = list(piece)
            x = np.array([float(row[parameter]) for row in points])
            y = np.array([1e3 * _amplitude(row) for row in points])
            stable = np.array([row.get("stability", "stable") == "stable" for row in points])
            cuts = np.flatnonzero(np.diff(stable.astype(int))) + 1
            for part in np.split(np.arange(x.size), cuts):
                style = ":" if one.kind == "backbone" else "-" if stable[part[0]] else "--"
                shown = slice(part[0], part[-1] + 2)
                items.append(Line(x[shown], y[shown], style, color, label=label))
    labels = _label(parameter), "largest amplitude, mm"
    return Plot([Panel(items, *labels, ylim=(0.0, None))], 8.4, 5.0)


def motions_figure(found: Sequence[Outcome]) -> Plot:
    """The reduced motions of runs over the time, at the point that moves most."""
    items: list[Item] = []
    for one, color in zip(found, COLOURS * len(found), strict=False):
        motion = read_history(one.folder / "history.npz")["reduced"]
        time, moved = motion.time, motion.displacement.reshape(motion.time.size, -1)
        most = moved[:, int(np.argmax(np.ptp(moved, axis=0)))]
        items.append(Line(time, 1e3 * most, color=color, label=one.name))
    return Plot([Panel(items, "time, s", "displacement, mm")], 8.4, 4.0)
