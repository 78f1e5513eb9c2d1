"""The report of a run: `report.html`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fenicsrom.assess.errors.mode_agreement import ModeAgreement
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.stress.stress_peaks import Stresses
from fenicsrom.post.base.directions import direction_names, direction_note
from fenicsrom.post.base.html_page import Folded, Page, verdict_of, write_report
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.run.mode_agreement import AGREEMENT_NOTE, agreement_rows, agreement_sentence
from fenicsrom.post.run.motion_table import open_sentence, points_note, response_note, response_rows
from fenicsrom.post.run.run_up import run_up_sentences
from fenicsrom.post.run.sentences import (
    MULTIPLIER_NOTE,
    estimate_rows,
    periodic_sentence,
    size_sentence,
    study_results,
    support_sentence,
    unreliable_sentence,
)
from fenicsrom.post.run.stress_tables import (
    MEASURE_NAMES,
    MODAL_NOTE,
    RECOVERY_NOTE,
    modal_rows,
    reaction_note,
    reaction_rows,
    stress_rows,
)
from fenicsrom.post.run.wear import wear_sentence
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import scene_heading
from fenicsrom.words import counted

REPORT = "report.html"

Section = tuple[str, list[Any]]


def write_run_report(
    found: Study | Rerun, pictures: Sequence[Drawn], folder: Path, pages: Sequence[Page] = ()
) -> Path:
    """Write the report of a run with its pictures, and with pages on which the body turns.

    Raises:
        OSError: the file cannot be written.
    """
    first, others = _first_picture(pictures)
    sections: list[Section] = [
        ("Results", [*_results(found), *first]),
        ("The body: choose a shape, turn it with the mouse", list(pages)),
        *((drawn.heading, [drawn]) for drawn in others),
        ("Contact points that do not touch", list(filter(None, [open_sentence(found.motions)]))),
        *_stresses(found.stresses),
        *_details(found),
        (Folded("Left out"), [_left_out(found.left_out)] if found.left_out else []),
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
    return [
        ("Modes of the reduced and of the full model", _agreement(found.agreement)),
        notes,
        (Folded("Basis"), _basis(found)),
        (Folded("Run time"), [_seconds(found)] if found.seconds else []),
    ]


def _first_picture(pictures: Sequence[Drawn]) -> tuple[list[Drawn], list[Drawn]]:
    """The picture that answers the question of the run, the motion, and the others."""
    first = [drawn for drawn in pictures if drawn.path.name == "motion.png"] or [*pictures[:1]]
    return first, [drawn for drawn in pictures if drawn not in first]


def _stresses(stresses: Stresses | None) -> list[Section]:
    """Compose the tables of stresses and reactions, if there are any."""
    if stresses is None:
        return []
    name = MEASURE_NAMES[stresses.measure]
    tables: list[Any] = [f"Von Mises and principal values of the {name}."]
    tables += [stress_rows(stresses.peaks), RECOVERY_NOTE]
    if stresses.modes:
        tables += [modal_rows(stresses.modes), MODAL_NOTE]
    return [
        ("Stresses", tables),
        ("Reactions", [reaction_rows(stresses), reaction_note(stresses)]),
    ]


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
        listed.append(support_sentence(found.scene, found.points, motions))
    if isinstance(found, Study):
        listed += study_results(found)
    else:
        listed += run_up_sentences(found.run_up)
    listed += [wear_sentence(motion, found.scene, found.points) for motion in motions.values()]
    if found.errors:
        listed.append(estimate_rows(found.errors, motions["reduced"], names))
    if found.failed is not None:
        listed.append(unreliable_sentence(*found.failed))
    return [item for item in listed if item]


def _notes(found: Study | Rerun) -> list[str]:
    """Compose the notes on the results."""
    if not found.motions:
        return []
    periodic = periodic_sentence(found.motions["reduced"]) if "reduced" in found.motions else None
    notes = [
        response_note(found.motions),
        points_note(found.motions, found.scene),
        direction_note(found.scene, found.points),
        periodic,
        MULTIPLIER_NOTE if periodic else None,
    ]
    return [note for note in notes if note]


def _basis(study: Study) -> list[Any]:
    """Compose the tables of modes and derivatives, and the size of the basis."""
    modes, basis = study.modes, study.basis
    if modes is None:
        return []
    frequencies = [[f"{k + 1}V", f"{f:.5g}"] for k, f in enumerate(modes.frequencies_hz)]
    found: list[Any] = [[["mode", "frequency Hz"], *frequencies]]
    if basis is not None:
        found.append(
            f"{basis.method}, {counted(basis.size, 'coordinate')}: {', '.join(basis.labels)}. "
            f"Condition number of the scaled reduced mass: {basis.condition:.3g}; of the scaled "
            f"residual flexibility: {modes.flexibility_condition:.3g}."
        )
        if basis.dropped:
            dropped = ", ".join(f"{k} ({v:.0e})" for k, v in basis.dropped.items())
            found.append(f"Dropped because they depend on other vectors: {dropped}")
    found += _sizes(study.sized)
    if study.derivatives is not None and study.derivatives.sizes:
        first = set(study.derivatives.labels)
        found.append(
            [
                ["combination of derivatives", "displacement in the energy norm %", "first basis"],
                *(
                    [label, f"{100.0 * size:.2g}", "yes" if label in first else "no"]
                    for label, size in study.derivatives.sizes.items()
                ),
            ]
        )
    if study.selection.weights:
        order = sorted(study.selection.weights.items(), key=lambda item: -item[1])
        kept = set(study.selection.derivatives)
        rows = [[k, f"{w:.2e}", "yes" if k in kept else "no"] for k, w in order]
        found.append([["derivative", "weight", "kept"], *rows])
    return found


def _sizes(found: Sized | None) -> list[Any]:
    """Compose the sentence on the size of the basis, and the error over the run time."""
    if found is None:
        return []
    rows = [
        [each.size, f"{each.seconds:.2g}", f"{100.0 * each.error:.2g}"]
        for each in (found.sizes if found.stored.scene.output.pictures else ())
    ]
    head = ["coordinates", "run time of the steps, s", "estimated error of the basis %"]
    return [size_sentence(found), *([[head, *rows]] if rows else [])]


def _seconds(study: Study) -> list[list[str]]:
    """Compose the table of run times."""
    return [["stage", "s"], *[[stage, f"{round(s, 3):.3g}"] for stage, s in study.seconds.items()]]


def _left_out(lines: Sequence[str]) -> list[list[str]]:
    """Compose the table of what was not computed."""
    return [["stage", "reason"], *[line.split(": ", 1) for line in lines]]
