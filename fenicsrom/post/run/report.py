"""The report of a run: `report.html`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.stress.stress_peaks import Stresses
from fenicsrom.post.base.directions import direction_names, direction_note
from fenicsrom.post.base.html_page import Page
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.base.report import Report, Section
from fenicsrom.post.base.tables import table_of
from fenicsrom.post.run import stress_tables
from fenicsrom.post.run.mode_agreement import AGREEMENT_NOTE, agreement_rows
from fenicsrom.post.run.motion_table import (
    PERIODS_NOTE,
    has_period,
    open_sentence,
    points_note,
    response_note,
    response_rows,
)
from fenicsrom.post.run.pictures import motion_pictures
from fenicsrom.post.run.sentences import MULTIPLIER_NOTE, estimate_rows, run_sentences
from fenicsrom.post.run.summary import probe_motions, quantities, unjudged, write_numbers
from fenicsrom.records import Rerun, Study

TURN = "The body: choose a shape, turn it with the mouse"


class RunReport(Report):
    """The report of a run, whose numbers are in `summary.json` and `history.npz`."""

    def write_numbers(self, folder: Path) -> list[Path]:
        """Write the summary, the history, the checkpoint and the stresses."""
        return write_numbers(self.found, folder)


def report(found: Study | Rerun) -> Report:
    """The report of a run: tables and sentences, and the pictures of the motion."""
    motions, names = found.motions, direction_names(found.scene, found.points)
    errors: list[list[Any]] = []
    if found.errors:
        errors = estimate_rows(found.scene, found.errors, motions["reduced"], names)
    left_out_table = table_of({"stage": line.key, "reason": line} for line in found.left_out)
    periods = PERIODS_NOTE if has_period(motions) else None
    table = response_rows(motions, found.sizes, names, probe_motions(found))
    sections = [
        Section("Motions", [table, points_note(motions, found.scene), periods], top=True),
        Section("Estimated errors", [errors]),
        *(_of_study(found) if isinstance(found, Study) else ()),
        *_stresses(found.stresses),
        Section("Size of the basis", [_sizes(found.sized)], terminal=False),
        Section("Left out", [left_out_table], terminal=False),
    ]
    listed = motion_pictures(found)
    return RunReport(
        "summary",
        "",
        found,
        run_sentences(found),
        sections,
        (),
        {},
        listed,
        _notes(found),
        quantities=quantities(found),
        unjudged=unjudged(found),
    )


def write_run_report(
    found: Study | Rerun, pictures: Sequence[Drawn], folder: Path, pages: Sequence[Page] = ()
) -> Path:
    """Write `report.html` with pictures of a run, and with pages on which the body turns.

    Raises:
        OSError: the file cannot be written.
    """
    # the picture that answers the question of the run comes first
    ordered = sorted(pictures, key=lambda one: one.path.name != "motion.png")
    return report(found).write_page(folder, ordered, [(TURN, list(pages))] if pages else [])


def _stresses(stresses: Stresses | None) -> list[Section]:
    """The tables of the stresses and reactions."""
    if stresses is None:
        return []
    name = stress_tables.MEASURE_NAMES[stresses.measure]
    tables: list[Any] = [f"Von Mises and principal values of the {name}."]
    tables += [stress_tables.stress_rows(stresses.peaks), stress_tables.RECOVERY_NOTE]
    if stresses.modes:
        tables += [stress_tables.modal_rows(stresses.modes), stress_tables.MODAL_NOTE]
    reactions = [stress_tables.reaction_rows(stresses), stress_tables.reaction_note(stresses)]
    return [
        Section("Stresses", tables, terminal=False),
        Section("Reactions", reactions, terminal=False),
    ]


def _notes(found: Study | Rerun) -> list[str]:
    """Compose the notes on the results."""
    if not found.motions:
        return []
    reduced = found.motions.get("reduced")
    notes = [
        response_note(found.motions),
        direction_note(found.scene, found.points),
        open_sentence(found.motions),
        MULTIPLIER_NOTE if reduced is not None and reduced.search is not None else None,
    ]
    return [note for note in notes if note]


def _of_study(study: Study) -> Iterator[Section]:
    """The tables of the stages of a scene."""
    alone = not study.motions  # the command `modes`
    if study.modes is not None:
        hertz = enumerate(study.modes.frequencies_hz, 1)
        modes = table_of({"mode": f"{k}V", "frequency Hz": f"{f:.5g}"} for k, f in hertz)
        yield Section("Modes", [modes], terminal=alone)
    if study.contact_hz is not None:
        free, stuck = study.contact_hz.T
        contact = table_of(
            {"number": k, "without contact, Hz": f"{a:.5g}", "stuck, Hz": f"{b:.5g}"}
            for k, (a, b) in enumerate(zip(free, stuck, strict=True), 1)
        )
        yield Section("Frequencies with contact", [contact], terminal=alone)
    if study.agreement is not None:
        tables = [agreement_rows(study.agreement), AGREEMENT_NOTE]
        yield Section("Modes of the reduced and of the full model", tables, terminal=False)
    weights, kept = study.selection.weights, study.selection.derivatives
    selected = table_of(
        {"derivative": label, "weight": f"{weights[label]:.2e}", "kept": label in kept}
        for label in sorted(weights, key=lambda label: -weights[label])
    )
    made = study.derivatives
    combined = table_of(
        {
            "combination of derivatives": label,
            "displacement in the energy norm %": f"{100.0 * size:.2g}",
            "first basis": made is not None and label in made.labels,
        }
        for label, size in (made.sizes if made is not None else {}).items()
    )
    yield Section("Derivatives", [combined, selected], terminal=False)
    seconds = table_of(
        {"stage": stage, "s": f"{round(s, 3):.3g}"} for stage, s in study.seconds.items()
    )
    yield Section("Run time", [seconds], terminal=False)


def _sizes(found: Sized | None) -> list[list[Any]]:
    """The table of the models of several sizes."""
    if found is None or not found.stored.scene.output.pictures:
        return []
    return table_of(
        {
            "coordinates": each.size,
            "run time of the steps, s": f"{each.seconds:.2g}",
            "estimated error of the basis %": f"{100.0 * each.error:.2g}",
        }
        for each in found.sizes
    )
