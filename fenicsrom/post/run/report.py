"""The report of a run, `report.html`, and its sentences."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.comparisons import of_model
from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.assess.errors.sizing import Sized
from fenicsrom.assess.errors.verdicts import CONTACT, contact_quantities, multiplicity_warnings
from fenicsrom.notes import Note, NoteKind, unpacked
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.stress.reactions import Stresses
from fenicsrom.post.base.page import Page, Report, Section
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.base.tables import (
    direction_names,
    direction_note,
    error_names,
    in_order,
    named_millimetres,
    table_of,
)
from fenicsrom.post.run import motion_figures, summary
from fenicsrom.post.run.figures import probe_motions, wear_sentence
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import refined, step_key
from fenicsrom.words import counted, enumerated, two_digits

MULTIPLIER_NOTE = (
    "A Floquet multiplier is the factor by which a small disturbance of the motion changes in one "
    "period; the motion is stable if all are below 1 in size. A largest multiplier just below 1, "
    "such as 0.9995, does not mean that the motion is nearly unstable: often it belongs to a fast "
    "vibration, such as a wave along the axis, that the time step does not resolve and that the "
    "time integration hardly damps."
)
REJECTED = {
    "stable": "; the marched motion was not seen to tend to it, so the march went on",
    "wears": "; it would wear an abradable layer in every period, so the march went on",
}
"""What a run says of a periodic motion that it did not take, by the verdict."""
AT_YIELD = (
    ". It presses an abradable layer just to its yield stress: the multipliers hold for motions "
    "that press it less"
)
ERROR_NAMES = {
    "peak_normal_force": "peak normal force",
    "friction_dissipation_per_period": "dissipation",
}
UNJUDGED = Note(
    NoteKind.UNCHECKED,
    "the stored model does not hold the vectors that its basis leaves out, so the error due to the "
    "basis is not estimated; run the scene again to store them",
)
UNJUDGED_MATRICES = Note(
    NoteKind.UNCHECKED,
    "the error due to the reduction of the superelement is not estimated: the program that wrote "
    "its matrices knows what they leave out",
)

FASTER = "use the full model (reference.full = true), or a smaller basis by a larger basis.accuracy"

UNCHECKED = Note(
    NoteKind.CUT_SHORT,
    "the run was interrupted before its motion was checked: the energy balance and the errors due "
    "to the time step and the basis are not known",
)
HALF_CHECKED = Note(
    NoteKind.CUT_SHORT,
    "the run was interrupted in the checks of its motion: the energy balance and the error due to "
    "the time step are checked, the error due to the basis is not known",
)


def unchecked_sentence(errors: Mapping[str, MotionErrors]) -> Note:
    """The warning of a run that was interrupted before or in its checks.

    Args:
        errors: the estimates that were found, as `Study.errors`; that of the time step comes first.
    """
    return HALF_CHECKED if errors else UNCHECKED


def error_sentence(errors: Mapping[str, float | None], scene: Scene, points: ContactPoints) -> str:
    """State the errors against the full model; with contact, also the errors of the contact."""
    first, others = error_names(scene, points)
    names = {
        "amplitude_normal": f"{first} amplitude",
        "amplitude_tangential": f"{others} amplitude",
        **(ERROR_NAMES if scene.contacts else {}),
    }
    stated = [(words, errors[name]) for name, words in names.items() if name in errors]
    parts = [f"{name} {value:.3g} %" for name, value in stated if value is not None]
    listed = ", ".join(parts) or "the full model has no motion to compare with"
    left = [name for name, value in stated if value is None]
    negligible = f" (zero or negligible: {', '.join(left)})" if left and parts else ""
    return f"Error of the reduced model against the full one: {listed}{negligible}."


def equilibrium_sentence(deflection: Array, scene: Scene) -> str:
    """State the displacement of the probe under the static loads."""
    components = named_millimetres("xyz", deflection, 6)
    without = ", without the contacts, which act in the motion"
    without *= bool(scene.contacts) and not scene.joined
    return f"Displacement of the probe in the static equilibrium{without}: {components}."


def support_sentence(run: Study | Rerun) -> str | None:
    """State the absolute amplitudes if the supports move; None otherwise."""
    found = summary.support_summary(run).get("support_motion", {})
    if not found:
        return None
    names = direction_names(run.scene, run.points)
    absolute = [
        f"{named_millimetres(names, in_order(numbers['absolute_amplitude_m']))} ({name})"
        for name, numbers in found.items()
    ]
    moved = next(iter(found.values()))["support_amplitude_m"]
    return (
        "Amplitudes in the table are relative to the supports. Amplitudes of the supports: "
        f"{named_millimetres('xyz', moved)}; absolute amplitudes: {'; '.join(absolute)}."
    )


def estimate_rows(
    scene: Scene, errors: Mapping[str, MotionErrors], motion: Motion, names: Sequence[str]
) -> list[list[Any]]:
    """Compose the table of the estimated errors of the reduced model; the first row is the header.

    Args:
        scene: the scene.
        errors: as `Study.errors`.
        motion: the motion of the reduced model.
        names: names of the directions.
    """
    what = "amplitude" if measures.has_settled(motion) else "root mean square displacement"
    found: list[list[Any]] = [
        ["estimated error of the reduced model", *(f"{name} %" for name in errors)],
        [f"{what}, all directions together", *_ranges(errors, lambda e: e.amplitude)],
    ]
    if any(e.shift for e in errors.values()):
        shifts = (_percent(e.shift) if e.shift else None for e in errors.values())
        found.append(["frequency of the resonance", *shifts])
    for k, name in enumerate(names):

        def one(e: MotionErrors, k: int = k) -> float:
            return e.directions[k]

        found.append([f"{what}, {name}", *_ranges(errors, one)])
    for quantity in contact_quantities(scene):
        found.append([quantity, *_ranges(errors, attrgetter(CONTACT[quantity]))])
    if any(e.history for e in errors.values()):
        found.append(["history of the probe", *_ranges(errors, attrgetter("history"))])
    return found


def resonance_sentence(errors: Mapping[str, MotionErrors]) -> str | None:
    """Say what the estimates near a resonance compare; None of other estimates."""
    near = {name: e.at_frequency for name, e in errors.items() if e.shift}
    if not near:
        return None
    known = [f"{100.0 * x:.2g} % by the {c}" for c, x in near.items() if np.isfinite(x)]
    change = f"would change by {enumerated(known)}" if known else "may be far off"
    return (
        "Near a resonance, the amplitudes are compared between motions of the same phase, at "
        "frequencies that differ by the error of the resonance. At the frequency of the loads the "
        f"amplitude {change}: read it together with the frequency."
    )


def free_sentence(errors: Mapping[str, MotionErrors]) -> str | None:
    """Say what a range of errors means; None if there is none."""
    if all(e.from_rest is None for e in errors.values()):
        return None
    return (
        "Points that stick all the time may stick elsewhere. The first error of a range is that "
        "with the same stuck positions, the second one that with those to which the run of the "
        "other model from rest leads."
    )


def _ranges(
    errors: Mapping[str, MotionErrors], value: Callable[[MotionErrors], float]
) -> list[str]:
    """An error by each cause in percent, as a range where there is one."""
    found = []
    for e in errors.values():
        ends = [value(e)] if e.from_rest is None else sorted((value(e), value(e.from_rest)))
        known = list(dict.fromkeys(_percent(end) for end in ends if np.isfinite(end)))
        more = " or more" if known and not np.isfinite(ends).all() else ""
        found.append((" to ".join(known) or "unknown") + more)
    return found


def _percent(value: float) -> str:
    """A relative error in percent, or "unknown"."""
    return f"{100.0 * value:.2g}" if np.isfinite(value) else "unknown"


def range_sentence(stored: StoredModel) -> str | None:
    """State the speeds of a model for a range of speeds and its errors between them; else None."""
    whole = stored.whole
    if whole is None:
        return None
    rpm = 30.0 / np.pi
    speeds, between = (
        ", ".join(f"{rpm * omega:.6g}" for omega in each)
        for each in (whole.speeds, whole.errors.speeds)
    )
    _, displacement, frequency, flexibility = np.max(whole.errors, axis=1)
    contact = f", the flexibility of the contact by {flexibility:.1e}" if whole.masters else ""
    return (
        f"Model for all speeds from {rpm * whole.speeds[0]:.6g} to {rpm * whole.speeds[-1]:.6g} "
        f"rpm: {whole.model.size} coordinates, joined from {speeds} rpm. At {between} rpm it "
        f"differs from the solid: the equilibrium by {displacement:.1e}, the frequencies by "
        f"{frequency:.1e}{contact}."
    )


def range_warnings(stored: StoredModel) -> list[Note]:
    """The notes on a model for a range of speeds, with one if its error is above the accuracy."""
    sentence, accuracy, found = range_sentence(stored), stored.scene.basis.accuracy, stored.notes
    if stored.whole is None or np.max(stored.whole.errors[1:]) <= accuracy:
        return unpacked(found)
    text = f"{sentence} This is above basis.accuracy = {accuracy:g}: add a speed between them"
    return [*unpacked(found), Note(NoteKind.ERROR, text, "rotation.speeds_rpm")]


def resumed_sentence(motion: Motion) -> str | None:
    """State at which time a motion was resumed; None if it started from rest."""
    if motion.time[0] == 0.0:
        return None
    return (
        f"Resumed run: the output starts at {motion.time[0]:.6g} s; "
        "the numbers of periods and steps include the first run."
    )


def periodic_sentence(motion: Motion) -> str | None:
    """State what Newton's method found of the periodic motion; None if it was not tried."""
    search = motion.search
    if search is None:
        return None
    tried = (
        f"after {counted(search.marched, 'marched period')} and "
        f"{counted(search.iterations, 'Newton iteration')} "
        f"(relative residual {search.residual:.1e})"
    )
    if search.verdict == "not found":
        after = "the march repeats, and is taken for it" if motion.steady else "the march went on"
        return f"Periodic motion: not found {tried}: {after}."
    found = measures.search_summary(search)
    several = f", {search.periods} periods of the loads long" if search.periods > 1 else ""
    end = REJECTED.get(search.verdict, "; the march went on")
    if search.accepted:
        end = AT_YIELD if search.at_yield else ""
    return (
        f"Periodic motion: {found['verdict']}{several}, largest Floquet multiplier "
        f"{found['largest_multiplier']:.6g}, found {tried}{end}."
    )


def basis_sentences(study: Study) -> list[str]:
    """State the coordinates of the basis, and what it leaves out."""
    basis, modes, dropped = study.basis, study.modes, study.dropped_modes
    if basis is None or modes is None:
        derivatives = () if study.derivatives is None else study.derivatives.labels
        return [f"Derivatives: {' '.join(derivatives)}."] if derivatives else []
    left = []
    if dropped:
        share = f"{study.scene.basis.threshold:g} of the largest"
        left = [f"Modes left out, with an amplitude below {share}: {' '.join(dropped)}."]
    if basis.dropped:
        left.append(f"Vectors left out, because others contain them: {' '.join(basis.dropped)}.")
    return [
        f"Basis: {basis.method}, {counted(basis.size, 'coordinate')}: {' '.join(basis.labels)}.",
        *left,
    ]


def speed_sentence(motions: Mapping[str, Motion]) -> str | None:
    """State the ratio of the run times of the full and the reduced model; None unless both ran."""
    if "full" not in motions or "reduced" not in motions:
        return None
    full, reduced = motions["full"].seconds, motions["reduced"].seconds
    said = (
        f"The motion of the reduced model took {two_digits(reduced)} s, that of the full model "
        f"{two_digits(full)} s"
    )
    if reduced < full:
        return f"{said}: {two_digits(full / max(reduced, 1e-9))} times as long."
    return f"{said}: the reduced model is slower than the solid; {FASTER}."


def step_sentence(reduced: float, full: float) -> Note | None:
    """State that a time step of the reduced model takes longer than one of the full model.

    Args:
        reduced: seconds of a time step of the reduced model.
        full: seconds of a time step of the full model.

    Returns:
        The note; None if the reduced model is faster.
    """
    if reduced < full:
        return None
    text = (
        f"a time step of the reduced model takes {reduced:.2g} s, one of the full model "
        f"{full:.2g} s: the reduced model is slower than the solid; {FASTER}"
    )
    return Note(NoteKind.REMARK, text, "basis")


def size_sentence(found: Sized) -> str:
    """State how many coordinates of the model a basis has, and why."""
    stored = found.stored
    known = stored.size + len(stored.further)
    basis, reached = stored.scene.basis, "is not reached" if found.warning else "is reached"
    why = f"basis.accuracy = {basis.accuracy:g} {reached}"
    if basis.size is not None:
        why = "basis.size asks for them"
    return (
        f"Size of the basis: {stored.size} of the {counted(known, 'coordinate')} of the model; "
        f"{why}."
    )


def study_results(study: Study) -> list[str]:
    """State the equilibrium, the error due to the mesh, and the error against the full model."""
    found = (
        [] if study.deflection is None else [equilibrium_sentence(study.deflection, study.scene)]
    )
    found += [] if study.mesh_check is None else [study.mesh_check.sentence()]
    if errors := summary.errors_of(study.motions):
        found.append(error_sentence(errors, study.scene, study.points))
    return found


def run_sentences(found: Study | Rerun) -> list[str]:
    """State the results of a run, below the table of responses."""
    reduced = found.motions.get("reduced")
    told: list[str | None] = []
    if reduced is not None:
        told += [resumed_sentence(reduced), periodic_sentence(reduced)]
        told += [resonance_sentence(found.errors), free_sentence(found.errors)]
        told.append(wear_sentence(reduced, found.scene, found.points))
    told.append(support_sentence(found))
    if isinstance(found, Study):
        told += [*study_results(found), *basis_sentences(found)]
        told += [] if found.agreement is None else [summary.agreement_sentence(found.agreement)]
        told.append(speed_sentence(found.motions))
    elif found.stored.whole is not None:
        told += [range_sentence(found.stored), of_model(found.stored).sentence()]
        told += motion_figures.run_up_sentences(found.run_up)
    told += [] if found.sized is None else [size_sentence(found.sized)]
    if reduced is not None:
        told += [f"{note.key}: {note}" for note in measures.out_of_reach(reduced, found.points)]
    return [sentence for sentence in told if sentence]


def motion_warnings(name: str, motion: Motion, scene: Scene) -> list[Note]:
    """Warn of what limits the meaning of a complete motion.

    Args:
        name: the model: "reduced", "full" or "beam".
        motion: its motion.
        scene: the scene of the run.
    """
    found = multiplicity_warnings(name, motion)
    end = float(motion.time[-1])
    for number, contact in enumerate(scene.contacts):
        if contact.approach and contact.approach[-1][0] > end * (1.0 + 1e-9):
            text = (
                f"contacts.{number}.approach: the {name} motion ends at {end:.6g} s, while the "
                f"surface still moves until {contact.approach[-1][0]:.6g} s"
            )
            found.append(Note(NoteKind.UNSETTLED, text, f"contacts.{number}.approach"))
    asked = scene.period is not None and scene.time.steady_tolerance
    if not motion.steady and asked and not measures.misses_motion(motion):  # the error says so
        text = unsteady_sentence(name, motion, scene)
        found.append(Note(NoteKind.UNSETTLED, text, "time.periods"))
    return found


def rerun_warnings(scene: Scene, given: Collection[str]) -> list[Note]:
    """Warn of the given keys or tables that have no effect on a run of a stored model."""
    asked = _without_effect(scene).values()
    keys = [key for key in asked if any(_is_in(key, name) or _is_in(name, key) for name in given)]
    if not keys:
        return []
    verb = "has" if len(keys) == 1 else "have"
    text = f"{', '.join(keys)} {verb} no effect on a run of a stored model"
    return [Note(NoteKind.REMARK, text, keys[0])]


def rerun_left_out(stored: StoredModel, motion: Motion) -> list[Note]:
    """State what a run of a stored model does not compute, and why."""
    body = "the reduced model is stored without its mesh"
    blind = f"{body}: motions that no coordinate of the file has do not show in the estimate"
    return [
        Note(NoteKind.LEFT_OUT, body, "offline stages, and files of the body"),
        *([Note(NoteKind.LEFT_OUT, blind, "residual")] if stored.candidates is not None else []),
        *(
            Note(NoteKind.LEFT_OUT, f"{key} has no effect on a run of a stored model", stage)
            for stage, key in _without_effect(stored.scene).items()
        ),
        *measures.out_of_reach(motion, stored.model.points),
    ]


def _without_effect(scene: Scene) -> dict[str, str]:
    """The stages that a run of a stored model leaves out, with the keys that ask for a stage."""
    asked = {
        ("full motion", "reference.full"): scene.reference.full,
        ("beam motion", "reference.beam"): scene.reference.beam,
        ("ParaView motion", "output.motion"): scene.output.motion,
        ("animation", "output.animation"): scene.output.animation,
    }
    return dict(pair for pair, on in asked.items() if on)


def _is_in(key: str, table: str) -> bool:
    """Whether a key is this key or in this table."""
    return f"{key}.".startswith(f"{table}.")


def unsteady_sentence(name: str, motion: Motion, scene: Scene) -> str:
    """Warn that a motion did not become periodic, and say what to try."""
    key = step_key(scene)
    remedies = [
        "increase time.periods",
        f"take shorter steps (time.{key} = {getattr(refined(scene).time, key):g})",
    ]
    if scene.time.scheme == "discrete-gradient":
        remedies.append(
            'use time.scheme = "generalised-alpha", which damps waves that the time step does not '
            "resolve"
        )
    remedy = f"{', '.join(remedies[:-1])} or {remedies[-1]}"
    return (
        f"the {name} model did not become periodic within {counted(motion.periods, 'period')}, so "
        f"its amplitudes are those of the last period only; {remedy}"
    )


TURN = "The body: choose a shape, turn it with the mouse"


class RunReport(Report):
    """The report of a run, whose numbers are in `summary.json` and `history.npz`."""

    def write_numbers(self, folder: Path) -> list[Path]:
        """Write the summary, the history, the checkpoint and the stresses."""
        return summary.write_numbers(self.found, folder)


def report(found: Study | Rerun) -> Report:
    """The report of a run: tables and sentences, and the pictures of the motion."""
    motions, names = found.motions, direction_names(found.scene, found.points)
    errors = None
    if found.errors:
        errors = estimate_rows(found.scene, found.errors, motions["reduced"], names)
    tried = {} if found.sized is None else found.sized.tried
    sizes = table_of(
        {"coordinates": size, "estimated error of the basis %": _percent(tried[size])}
        for size in sorted(tried)
    )
    left_out_table = table_of({"stage": line.key, "reason": line} for line in found.left_out)
    periods = motion_figures.PERIODS_NOTE if motion_figures.has_period(motions) else None
    table = motion_figures.response_rows(motions, found.sizes, names, probe_motions(found))
    sections = [
        Section(
            "Motions", [table, motion_figures.points_note(motions, found.scene), periods], top=True
        ),
        Section("Estimated errors", [errors]),
        *(_of_study(found) if isinstance(found, Study) else ()),
        *_stresses(found.stresses),
        Section("Size of the basis", [sizes], terminal=False),
        Section("Left out", [left_out_table], terminal=False),
    ]
    return RunReport(
        "summary",
        title="",
        found=found,
        sentences=run_sentences(found),
        sections=sections,
        rows=(),
        summary={},
        pictures=motion_figures.motion_pictures(found),
        notes=_notes(found),
        quantities=summary.quantities(found),
        unjudged=summary.unjudged(found),
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
    name = summary.MEASURE_NAMES[stresses.measure]
    peaks = [f"Largest {name}:", summary.stress_table(stresses.peaks)]
    modes = [summary.stress_table(stresses.modes), summary.MODAL_NOTE]
    reactions = [summary.reaction_rows(stresses), summary.reaction_note(stresses)]
    return [
        Section("Stresses", peaks),
        Section("Recovery of stresses", [summary.RECOVERY_NOTE], terminal=False),
        Section("Modal stresses", modes if stresses.modes else [], terminal=False),
        Section("Reactions", reactions, terminal=False),
    ]


def _notes(found: Study | Rerun) -> list[str]:
    """Compose the notes on the results."""
    if not found.motions:
        return []
    reduced = found.motions.get("reduced")
    notes = [
        motion_figures.response_note(found.motions),
        direction_note(found.scene, found.points),
        motion_figures.open_sentence(found.motions),
        MULTIPLIER_NOTE if reduced is not None and reduced.search is not None else None,
    ]
    return [note for note in notes if note]


def _of_study(study: Study) -> Iterator[Section]:
    """The tables of the stages of a scene."""
    alone = not study.motions  # the command `modes`
    if study.modes is not None:
        hertz = zip(study.modes.labels, study.modes.frequencies_hz, strict=False)
        modes = table_of(
            {"mode": label, "frequency Hz": "0 (rigid)" if label.endswith("R") else f"{f:.5g}"}
            for label, f in hertz
        )
        turning = study.scene.rotation is not None and study.scene.rotation.coriolis
        said = "These leave out the Coriolis force: see `fenicsrom campbell`." if turning else None
        yield Section("Modes", [modes, said], terminal=alone)
    if study.contact_hz is not None:
        free, stuck = study.contact_hz.T
        first = "closed points stuck" if study.scene.joined else "without contact"
        contact = table_of(
            {"number": k, f"{first}, Hz": f"{a:.5g}", "stuck, Hz": f"{b:.5g}"}
            for k, (a, b) in enumerate(zip(free, stuck, strict=True), 1)
        )
        yield Section("Frequencies with contact", [contact], terminal=alone)
    if study.agreement is not None:
        tables = [summary.agreement_rows(study.agreement), summary.AGREEMENT_NOTE]
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
