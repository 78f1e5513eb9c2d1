"""The report of a run: `report.html`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fenicsrom.assess.errors.mode_agreement import ModeAgreement
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.stress_peaks import Stresses
from fenicsrom.post.base.directions import direction_names, direction_note
from fenicsrom.post.base.html_page import Folded, Page, verdict_of, write_report
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.run.mode_agreement import AGREEMENT_NOTE, agreement_rows, agreement_sentence
from fenicsrom.post.run.motion_table import open_sentence, points_note, response_note, response_rows
from fenicsrom.post.run.run_up import run_up_sentences
from fenicsrom.post.run.sentences import (
    MULTIPLIER_NOTE,
    equilibrium_sentence,
    error_sentence,
    estimate_rows,
    periodic_sentence,
    size_sentence,
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
from fenicsrom.post.run.summary import errors_of
from fenicsrom.post.run.wear import wear_sentence
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene, scene_heading
from fenicsrom.words import counted

REPORT = "report.html"

Section = tuple[str, list[Any]]


def write_study_report(study: Study, folder: Path, pages: Sequence[Page] = ()) -> Path:
    """Write the report of a study with its pictures, and with pages on which its body turns.

    Raises:
        OSError: the file cannot be written.
    """
    first, others = _first_picture(study.pictures)
    results, notes = _results(study)
    sections = [
        ("Results", [*results, *first]),
        ("The body: choose a shape, turn it with the mouse", list(pages)),
        *((drawn.heading, [drawn]) for drawn in others),
        *_open_points(study.motions),
        *_stresses(study.stresses),
        ("Modes of the reduced and of the full model", _agreement(study.agreement)),
        (Folded("Notes on the results"), notes),
        (Folded("Basis"), _basis(study)),
        (Folded("Run time"), [_seconds(study)] if study.seconds else []),
        (Folded("Left out"), [_left_out(study.left_out)] if study.left_out else []),
    ]
    verdict = verdict_of(study.warnings, study.unfinished and study.unfinished[1])
    filled = [s for s in sections if s[1]]
    return write_report(
        folder / REPORT, scene_heading(study.scene), filled, verdict, study.warnings
    )


def write_rerun_report(found: Rerun, pictures: Sequence[Drawn], folder: Path) -> Path:
    """Write the report of a run of a stored model.

    Raises:
        OSError: the file cannot be written.
    """
    scene, motion = found.stored.scene, found.motion
    points = found.stored.model.points
    names = direction_names(scene, points)
    results: list[Any] = [response_rows({"reduced": motion}, {"reduced": found.stored.size}, names)]
    notes = [*_notes({"reduced": motion}, scene, points), *_periodic(motion)]
    if sentence := support_sentence(scene, points, {"reduced": motion}):
        results.append(sentence)
    if sentence := wear_sentence(motion, scene, points):
        results.append(sentence)
    results += run_up_sentences(found.run_up)
    if found.errors:
        results.append(estimate_rows(found.errors, motion, names))
    if found.unfinished:
        results.append(unreliable_sentence("reduced", found.unfinished))
    first, others = _first_picture(pictures)
    sections: list[Section] = [
        ("Results", [*results, *first]),
        *((drawn.heading, [drawn]) for drawn in others),
        *_open_points({"reduced": motion}),
        *_stresses(found.stresses),
        (Folded("Notes on the results"), notes),
        *([(Folded("Basis"), _sizes(found.sized))] if found.sized is not None else []),
        (Folded("Left out"), [_left_out(found.left_out)]),
    ]
    verdict = verdict_of(found.warnings, found.unfinished)
    return write_report(folder / REPORT, scene_heading(scene), sections, verdict, found.warnings)


def _first_picture(pictures: Sequence[Drawn]) -> tuple[list[Drawn], list[Drawn]]:
    """The picture that answers the question of the run, the motion, and the others."""
    first = [drawn for drawn in pictures if drawn.path.name == "motion.png"] or [*pictures[:1]]
    return first, [drawn for drawn in pictures if drawn not in first]


def _open_points(motions: Mapping[str, Motion]) -> list[Section]:
    """Compose the section on contact points without a picture, if there are any."""
    sentence = open_sentence(motions)
    return [("Contact points that do not touch", [sentence])] if sentence else []


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


def _results(study: Study) -> tuple[list[Any], list[str]]:
    """Compose the table of responses with the sentences on errors, and the notes on them."""
    found: list[Any] = []
    notes: list[str] = []
    names = direction_names(study.scene, study.solid.points)
    if study.motions:
        found.append(response_rows(study.motions, study.sizes, names))
        notes += _notes(study.motions, study.scene, study.solid.points)
    if "reduced" in study.motions:
        notes += _periodic(study.motions["reduced"])
    if study.motions and (
        sentence := support_sentence(study.scene, study.solid.points, study.motions)
    ):
        found.append(sentence)
    for motion in study.motions.values():
        if sentence := wear_sentence(motion, study.scene, study.solid.points):
            found.append(sentence)
    if study.deflection is not None:
        found.append(equilibrium_sentence(study.deflection))
    if study.mesh_check is not None and (said := study.mesh_check.sentence()):
        found.append(said)
    if errors := errors_of(study.motions):
        found.append(error_sentence(errors, study.scene, study.solid.points))
    if study.errors:
        found.append(estimate_rows(study.errors, study.motions["reduced"], names))
    if study.unfinished:
        found.append(unreliable_sentence(*study.unfinished))
    return found, notes


def _notes(motions: Mapping[str, Motion], scene: Scene, points: ContactPoints) -> list[str]:
    """Compose the notes below the table of responses."""
    notes = points_note(motions, scene), direction_note(scene, points)
    return [response_note(motions), *filter(None, notes)]


def _periodic(motion: Motion) -> list[str]:
    """Compose the paragraph on what Newton's method found, if it was tried."""
    sentence = periodic_sentence(motion)
    return [sentence, MULTIPLIER_NOTE] if sentence else []


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
    if study.sized is not None:
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


def _sizes(found: Sized) -> list[Any]:
    """Compose the sentence on the size of the basis, and the error over the run time."""
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
