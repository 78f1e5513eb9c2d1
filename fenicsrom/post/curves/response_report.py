"""The files of response curves: numbers, motions, pictures and the report."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.response_results import Response, ResponseCurve, curve_title
from fenicsrom.errors import ConvergenceError
from fenicsrom.notes import (
    AMPLITUDES,
    DISSIPATION,
    EVENTS,
    PEAK_FORCE,
    PEAKS,
    STABILITY,
    Note,
    NoteKind,
)
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.periodic_record import recorded_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.chart import Detail
from fenicsrom.post.base.optional import missing_module
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.report import Report, Section
from fenicsrom.post.base.writers import write_arrays
from fenicsrom.post.curves import response_tables
from fenicsrom.post.curves.peak_tables import peak_figure, peak_rows, peak_table
from fenicsrom.post.curves.response_details import contact_map, harmonics_figure, multiplier_figure
from fenicsrom.post.curves.response_figures import (
    figure,
    height_of,
    largest_component,
    largest_point,
    state_names,
)
from fenicsrom.post.paraview.fields import write_last_period
from fenicsrom.post.run.sentences import MULTIPLIER_NOTE
from fenicsrom.records import Study
from fenicsrom.scene.reading.units import in_words

CHECKS_NOTE = (
    "Each row compares one motion of a curve: that of the largest amplitude, the first and the "
    "last point, bifurcations, points evenly between them, and points near instability, where a "
    "multiplier of the richer basis is close to the unit circle or changes fast. The changes are "
    "relative to the amplitude, at the same value of the parameter; at a bifurcation they are how "
    "far it moves, relative to the value of the parameter."
)
"""What the table of estimated errors holds."""
PEAKS_HEADING = "Peaks over a second number"


def report(found: Response, clicked: Sequence[Detail] = ()) -> Report:
    """The report of response curves: `response.csv`, `response.json` and the pictures.

    Where points of the full model were computed, `response_full.csv` has their numbers, and
    `response_peaks.csv` those of the peaks over `peak_over`.

    Args:
        found: the curves.
        clicked: what a click on a point of the curves shows.
    """
    keys = 1 if found.table.families is None else 2
    peaks = peak_table(found)
    more = {
        "response_full.csv": response_tables.full_rows(found),
        "response_peaks.csv": peak_rows(found),
    }
    states = Picture(
        "Contact states over the period", "contact_map.png", lambda: contact_map(found)
    )
    return Report(
        "response",
        "response curves",
        found,
        response_tables.sentences(found),
        [
            Section("Results", [response_tables.result_table(found)], terminal=False, top=True),
            Section("Special points", [response_tables.event_table(found)], keys=keys),
            Section(PEAKS_HEADING, [peaks], keys=keys, terminal=False),
            Section("Full model", [response_tables.full_table(found)], keys=keys),
            Section(
                "Estimated errors",
                [response_tables.trust_table(found), CHECKS_NOTE],
                terminal=False,
            ),
            Section("Effort", [response_tables.run_table(found)], terminal=False),
        ],
        response_tables.rows(found),
        response_tables.summary(found),
        [Picture("Response curves", "response.png", lambda: figure(found, clicked))]
        if found.interrupted
        else [
            Picture("Response curves", "response.png", lambda: figure(found, clicked)),
            *([Picture(PEAKS_HEADING, "peaks.png", lambda: peak_figure(found))] if peaks else []),
            *([states] if found.contacts else []),
            Picture(
                "Floquet multipliers",
                "multipliers.png",
                lambda: multiplier_figure(found),
                MULTIPLIER_NOTE,
            ),
            Picture("Harmonics", "harmonics.png", lambda: harmonics_figure(found)),
        ],
        varied=response_tables.varied_keys(found),
        more_rows={name: listed for name, listed in more.items() if listed},
        quantities=[
            *(AMPLITUDES, STABILITY),
            *([EVENTS] if found.contacts else []),
            *([PEAKS] if peaks else []),
        ],
        unjudged=[PEAK_FORCE, DISSIPATION] if found.contacts else [],
    )


def write(
    found: Response, stored: StoredModel, folder: Path, study: Study | None = None
) -> list[Path]:
    """Write the numbers, then the motions, the pictures and the report.

    An interrupted run has no motions and only the picture of the curves, because it must end soon.
    With a study, all ranks must call this: each writes its part of the ParaView files.

    Args:
        found: the curves.
        stored: their model.
        folder: folder of the files.
        study: the record of the offline stages, with the basis; None of a stored model.

    Returns:
        The files, the one to open first at the head; none on other ranks than the first.

    Raises:
        OSError: a file cannot be written.
    """
    first = study is None or study.solid.comm.rank == 0
    if first:
        report(found).write_numbers(folder)
    if found.interrupted:
        return report(found).write(folder) if first else []
    motions = marked_motions(found, stored)
    files = [write_motion_arrays(motions, folder)] if first else []
    if study is not None and found.scene.output.motion:
        files += write_motion_fields(study, motions, folder)
    if not first:
        return []
    shown = found.scene.output.pictures and not missing_module("bokeh")
    clicked = clicked_motions(found, stored, motions) if shown else []
    return [*report(found, clicked).write(folder), *files]


ARCHIVE = "motions.npz"
MOST_CLICKED = 32  # motions that a click on a response curve shows
MOST_SAMPLES = 150  # of a motion that a click shows
FOLDER = "motions"


class MarkedMotion(NamedTuple):
    """The periodic motion at a marked point.

    Attributes:
        parameter: parameter of the curve.
        motion: one period.
        contacts: parameters of the contact points.
    """

    parameter: float
    motion: Motion
    contacts: Contacts


def marked_points(found: Response) -> dict[str, tuple[ResponseCurve, CurvePoint]]:
    """The bifurcations and the largest amplitude of each curve, by names for files."""
    marked = {}
    for number, curve in enumerate(found.curves, 1):
        prefix = f"curve_{number}_" if len(found.curves) > 1 else ""
        marked[f"{prefix}largest"] = (curve, largest_point(found, curve))
        for kind in BIFURCATIONS:
            mine = [point for point in curve.special if point.kind == kind]
            for k, point in enumerate(mine, 1):
                marked[f"{prefix}{kind.replace(' ', '_').replace('-', '_')}_{k}"] = (curve, point)
    return marked


def marked_motions(found: Response, stored: StoredModel) -> dict[str, MarkedMotion]:
    """The periodic motions at the marked points; a motion that is lost becomes a warning."""
    motions = {}
    for name, (curve, point) in marked_points(found).items():
        try:
            motions[name] = _motion(found, stored, curve, point)
        except ConvergenceError as error:
            text = f"the motion {name} was not written: {error}"
            found.warnings.append(Note(NoteKind.NOT_DRAWN, text, name))
    return motions


def _motion(
    found: Response, stored: StoredModel, curve: ResponseCurve, point: CurvePoint
) -> MarkedMotion:
    """The periodic motion at a point.

    Raises:
        ConvergenceError: the motion is lost.
    """
    families = found.table.families
    if families is not None:
        stored = stored.with_values({families.key: curve.value})
    problem = family_of(stored)(point.parameter)
    motion = recorded_motion(problem, point.z, point.periods)
    return MarkedMotion(point.parameter, motion, problem.contacts)


def clicked_motions(
    found: Response, stored: StoredModel, known: dict[str, MarkedMotion]
) -> list[Detail]:
    """What a click shows: the known motions at marked points, and others evenly along each curve.

    A motion that is lost is left out.
    """
    details = []
    for name, (curve, point) in marked_points(found).items():
        if name in known:
            details.append(_detail(found, curve, point, known[name].motion))
    each = max(0, MOST_CLICKED - len(details)) // len(found.curves)
    for curve in found.curves:
        for point in curve.points[:: max(1, -(-len(curve.points) // max(1, each)))][:each]:
            with suppress(ConvergenceError):
                motion = _motion(found, stored, curve, point).motion
                details.append(_detail(found, curve, point, motion))
    return details


def _detail(found: Response, curve: ResponseCurve, point: CurvePoint, motion: Motion) -> Detail:
    """What a click on a point shows: a period of its motion at the contact point."""
    where = in_words(found.scene, found.table.parameter, point.parameter)
    states = f", {', '.join(state_names(point))}" if found.contacts else ""
    begin = f"The motion at {curve_title(found.scene, curve.value)}{where}"
    title = f"{begin}: {point.known_stability}{states}"
    place, direction = largest_component(found)
    some = slice(None, None, max(1, motion.time.size // MOST_SAMPLES))
    moved = 1e3 * motion.displacement[some, place]
    lines = [(motion.time[some] - motion.time[0], moved[:, direction])]
    if found.contacts:
        lines.append((moved[:, 1], motion.force[some, place, 1]))
    return Detail(title, (point.parameter, height_of(found)(point)), lines)


def write_motion_arrays(motions: dict[str, MarkedMotion], folder: Path) -> Path:
    """Write the motions as the arrays `NAME_time`, `NAME_coordinates` and so on.

    Raises:
        OSError: the file cannot be written.
    """
    kept = ("time", "coordinates", "velocity", "displacement", "force", "gap", "state")
    arrays: dict[str, Any] = {}
    for name, (parameter, motion, _) in motions.items():
        arrays[f"{name}_parameter"] = parameter
        arrays |= {f"{name}_{attribute}": getattr(motion, attribute) for attribute in kept}
    return write_arrays(folder / ARCHIVE, arrays)


def write_motion_fields(study: Study, motions: dict[str, MarkedMotion], folder: Path) -> list[Path]:
    """Write the motions for ParaView, one folder each. Collective.

    Raises:
        OSError: a file cannot be written.
    """
    files = []
    for name, (_, motion, contacts) in motions.items():
        one = replace(study, motions={"reduced": motion})
        files += write_last_period(one, folder / FOLDER / name, contacts)
    return files
