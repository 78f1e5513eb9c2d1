"""The report of `fenicsrom stability`: table, picture and files."""

import textwrap
from typing import Any

import numpy as np

from fenicsrom.assess.studies.stability import NEGLIGIBLE, Finding, Matrix, Verdict
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Bars, Item, Panel, Plot, Text
from fenicsrom.post.base.tables import Quantity, rows_of, table_of
from fenicsrom.words import counted

COLOURS = {
    Verdict.CONVERGED: "#B7E1CD",
    Verdict.UNSTEADY: "#CFE2F3",
    Verdict.REFUSED: "#FCE8B2",
    Verdict.WRONG: "#E06666",
}
HOW = (
    "A run counts as converged if its amplitudes settle and its error is at most its estimate. The "
    "error is the difference from the run with half the step; the estimate comes from the run with "
    f"twice the step. Differences below {NEGLIGIBLE:g} count as zero. Errors are relative to the "
    "amplitude. Basis error: difference from a basis with more modes and all derivatives, or, of "
    "random variants, from the full model. Force error: difference of the largest normal force "
    "from the run with half the step. Ledger: imbalance of the energies."
)


QUANTITIES = [
    Quantity("verdict", "verdict.value", "verdict"),
    Quantity("model", "case.model", "model"),
    Quantity("axis", "case.axis", "axis"),
    Quantity("value", "case.value", "value"),
    Quantity("overrides", lambda finding: " ".join(finding.case.overrides)),
    Quantity("amplitude", head="amplitude, mm", digits=4),
    *(
        Quantity(key, head=key.replace("_", " "), digits=2)
        for key in ("estimate", "error", "basis_estimate", "basis_error", "force_error")
    ),
    Quantity("imbalance", head="ledger", digits=2),
    Quantity("periods", head="periods"),
    Quantity("why", head="why"),
    *map(Quantity, ("steady", "seconds", "force_estimate", "buckled")),
]


def sentences(matrix: Matrix) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    counts = ", ".join(f"{matrix.count(verdict)} {verdict}" for verdict in Verdict)
    found = [f"{counted(len(matrix.findings), 'run')} in {matrix.seconds:.0f} s: {counts}."]
    errors = sorted(
        f.error for f in matrix.findings if f.verdict is Verdict.CONVERGED and f.error is not None
    )
    if errors:
        found.append(
            "Difference of the converged runs from the runs with half the step: "
            f"{errors[len(errors) // 2]:.1e} "
            f"of the amplitude in the median, {errors[-1]:.1e} at most."
        )
    return found + [
        f"silently wrong: {f.case.axis}, {f.case.value} ({f.case.model}): {f.why}"
        for f in matrix.findings
        if f.verdict is Verdict.WRONG
    ]


def figure(matrix: Matrix) -> Plot:
    """The verdicts: one line of tiles for each axis and model."""
    lines: dict[str, list[Finding]] = {}
    for finding in matrix.findings:
        model = finding.case.model
        name = finding.case.axis + ("" if model == "reduced" else f", {model} model")
        lines.setdefault(name, []).append(finding)
    widest = max(map(len, lines.values()), default=1)
    tiles: dict[Verdict, list[tuple[int, int]]] = {verdict: [] for verdict in COLOURS}
    items: list[Item] = []
    for y, findings in enumerate(lines.values()):
        for x, finding in enumerate(findings):
            tiles[finding.verdict].append((x, -y))
            words = "\n".join(textwrap.wrap(finding.case.value, 19)[:2])
            look: dict[str, Any] = {"ha": "center", "fontsize": 5.5, "color": "black"}
            items.append(Text(x, -y, words, **look))
    for verdict, places in tiles.items():
        across, up = np.array(places, dtype=float).reshape(-1, 2).T
        sides = across - 0.48, across + 0.48, up - 0.46, up + 0.46
        name = f"{verdict} ({matrix.count(verdict)})"
        items.append(Bars(*sides, COLOURS[verdict], label=name))
    axes: dict[str, Any] = {
        "yticks": {-float(k): name for k, name in enumerate(lines)},
        "xticks": {0.0: ""},
    }
    panel = Panel(items, **axes, tight="xy", plain=True)
    return Plot([panel], max(3.0 + 1.15 * widest, 7.0), 0.6 + 0.42 * max(len(lines), 1))


def report(matrix: Matrix) -> Report:
    """The report of a matrix: `stability.csv`, `stability.json` and `stability.png`."""
    rows = rows_of(matrix.findings, QUANTITIES)
    tables = {
        verdict: table_of([f for f in matrix.findings if f.verdict is verdict], QUANTITIES)
        for verdict in (Verdict.WRONG, Verdict.REFUSED, Verdict.UNSTEADY, Verdict.CONVERGED)
    }
    sections = [
        *(
            Section(verdict.capitalize(), [found], terminal=False)
            for verdict, found in tables.items()
        ),
        Section("Left out", matrix.left_out),
    ]
    verdicts = {verdict.value: matrix.count(verdict) for verdict in Verdict}
    numbers = {"verdicts": verdicts, "left_out": matrix.left_out, "runs": rows}
    caption, name = "A tile for each run: what it varies, and its verdict.", "stability"
    drawn = [Picture("Verdicts", f"{name}.png", lambda: figure(matrix), caption, f"{name}.csv")]
    said = sentences(matrix)
    return Report("stability", name, matrix, said, sections, rows, numbers, drawn, [HOW])
