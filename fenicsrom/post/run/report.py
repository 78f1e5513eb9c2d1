"""The report of a run: `report.html`."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from fenicsrom.assess.errors.mode_agreement import ModeAgreement
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.stress.stress_peaks import Stresses
from fenicsrom.post.base.directions import direction_names, direction_note
from fenicsrom.post.base.html_page import Folded, Page, verdict_of, write_report
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.base.tables import table_of
from fenicsrom.post.run import sentences, stress_tables
from fenicsrom.post.run.mode_agreement import AGREEMENT_NOTE, agreement_rows, agreement_sentence
from fenicsrom.post.run.motion_table import open_sentence, points_note, response_note, response_rows
from fenicsrom.post.run.run_up import run_up_sentences
from fenicsrom.post.run.wear import wear_sentence
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import scene_heading

REPORT = "report.html"

Section = tuple[str, list[Any]]


def write_run_report(
    found: Study | Rerun, pictures: Sequence[Drawn], folder: Path, pages: Sequence[Page] = ()
) -> Path:
    """Write the report of a run with its pictures, and with pages on which the body turns.

    Raises:
        OSError: the file cannot be written.
    """
    # the picture that answers the question of the run comes first
    first = [one for one in pictures if one.path.name == "motion.png"] or [*pictures[:1]]
    left_out = (line.split(": ", 1) for line in found.left_out)
    sections: list[Section] = [
        ("Results", [*_results(found), *first]),
        ("The body: choose a shape, turn it with the mouse", list(pages)),
        *((one.heading, [one]) for one in pictures if one not in first),
        ("Contact points that do not touch", list(filter(None, [open_sentence(found.motions)]))),
        *_stresses(found.stresses),
        *_details(found),
        (Folded("Left out"), _pairs("stage", "reason", left_out)),
    ]
    verdict = verdict_of(found.warnings, found.failed and found.failed[1])
    filled = [section for section in sections if section[1]]
    heading = scene_heading(found.scene)
    return write_report(folder / REPORT, heading, filled, verdict, found.warnings)


def _details(found: Study | Rerun) -> list[Section]:
    """Compose the sections behind the pictures and stresses, and folded ones."""
    notes: Section = (Folded("Notes on the results"), _notes(found))
    if isinstance(found, Rerun):
        return [notes, (Folded("Basis"), _sizes(found.sized))]
    seconds = ((stage, f"{round(s, 3):.3g}") for stage, s in found.seconds.items())
    return [
        ("Modes of the reduced and of the full model", _agreement(found.agreement)),
        notes,
        (Folded("Basis"), _basis(found)),
        (Folded("Run time"), _pairs("stage", "s", seconds)),
    ]


def _stresses(stresses: Stresses | None) -> list[Section]:
    """Compose the tables of stresses and reactions, if there are any."""
    if stresses is None:
        return []
    name = stress_tables.MEASURE_NAMES[stresses.measure]
    tables: list[Any] = [f"Von Mises and principal values of the {name}."]
    tables += [stress_tables.stress_rows(stresses.peaks), stress_tables.RECOVERY_NOTE]
    if stresses.modes:
        tables += [stress_tables.modal_rows(stresses.modes), stress_tables.MODAL_NOTE]
    reactions = [stress_tables.reaction_rows(stresses), stress_tables.reaction_note(stresses)]
    return [("Stresses", tables), ("Reactions", reactions)]


def _agreement(found: ModeAgreement | None) -> list[Any]:
    """Compose the table of the modes of both models, if the models were compared."""
    if found is None:
        return []
    return [agreement_sentence(found), agreement_rows(found), AGREEMENT_NOTE]


def _results(found: Study | Rerun) -> list[Any]:
    """Compose the table of responses with the sentences on errors."""
    motions, names = found.motions, direction_names(found.scene, found.points)
    listed: list[Any] = []
    if motions:
        listed.append(response_rows(motions, found.sizes, names))
        listed.append(sentences.support_sentence(found))
    if isinstance(found, Study):
        listed += sentences.study_results(found)
    else:
        listed += run_up_sentences(found.run_up)
    listed += [wear_sentence(motion, found.scene, found.points) for motion in motions.values()]
    if found.errors:
        listed.append(sentences.estimate_rows(found.errors, motions["reduced"], names))
    if found.failed is not None:
        listed.append(sentences.unreliable_sentence(*found.failed))
    return [item for item in listed if item]


def _notes(found: Study | Rerun) -> list[str]:
    """Compose the notes on the results."""
    if not found.motions:
        return []
    reduced = found.motions.get("reduced")
    periodic = None if reduced is None else sentences.periodic_sentence(reduced)
    notes = [
        response_note(found.motions),
        points_note(found.motions, found.scene),
        direction_note(found.scene, found.points),
        periodic,
        sentences.MULTIPLIER_NOTE if periodic else None,
    ]
    return [note for note in notes if note]


def _basis(study: Study) -> list[Any]:
    """Compose the tables of modes and derivatives, and the size of the basis."""
    if study.modes is None:
        return []
    frequencies = enumerate(study.modes.frequencies_hz, 1)
    found: list[Any] = [
        table_of({"mode": f"{k}V", "frequency Hz": f"{f:.5g}"} for k, f in frequencies)
    ]
    found += [*sentences.basis_sentences(study), *_sizes(study.sized)]
    if study.derivatives is not None:
        found.append(
            table_of(
                {
                    "combination of derivatives": label,
                    "displacement in the energy norm %": f"{100.0 * size:.2g}",
                    "first basis": label in study.derivatives.labels,
                }
                for label, size in study.derivatives.sizes.items()
            )
        )
    weights, kept = study.selection.weights, study.selection.derivatives
    found.append(
        table_of(
            {"derivative": label, "weight": f"{weights[label]:.2e}", "kept": label in kept}
            for label in sorted(weights, key=lambda label: -weights[label])
        )
    )
    return list(filter(None, found))


def _sizes(found: Sized | None) -> list[Any]:
    """Compose the sentence on the size of the basis, and the error over the run time."""
    if found is None:
        return []
    rows = table_of(
        {
            "coordinates": each.size,
            "run time of the steps, s": f"{each.seconds:.2g}",
            "estimated error of the basis %": f"{100.0 * each.error:.2g}",
        }
        for each in (found.sizes if found.stored.scene.output.pictures else ())
    )
    return [sentences.size_sentence(found), *filter(None, [rows])]


def _pairs(first: str, second: str, pairs: Iterable[Sequence[str]]) -> list[Any]:
    """Compose a table of two columns; no table without rows."""
    return list(filter(None, [table_of({first: a, second: b} for a, b in pairs)]))
