"""The files of response curves: numbers, motions, pictures of all details, and the report."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom import notes
from fenicsrom.arrays import Array
from fenicsrom.assess.curves.balance_walk import balanced_motion
from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.results import Reduced, Response, ResponseCurve, curve_title
from fenicsrom.assess.curves.stability_search import lengths_along
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import recorded_motion
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Detail, Dots, Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS, missing_module
from fenicsrom.post.base.tables import rows_of, table_of, write_arrays
from fenicsrom.post.curves import response_figures, response_tables
from fenicsrom.post.curves.response_tables import peak_figure
from fenicsrom.post.paraview.disk_motion import write_wave
from fenicsrom.post.paraview.paraview import write_last_period
from fenicsrom.post.run.motion_figures import state_map, state_samples
from fenicsrom.post.run.report import MULTIPLIER_NOTE
from fenicsrom.records import Study
from fenicsrom.scene.reading.overrides import in_words

FARTHEST = 2.5  # multipliers farther from the origin are drawn at the edge
# thin and bright: seen on the dots that lie on it
CIRCLE: dict[str, Any] = {"color": "#E31A1C", "linewidth": 0.7, "zorder": 4.0}
FLOOR = 1e-5  # harmonics below this part of the largest are not drawn


def multiplier_figure(found: Response) -> Plot:
    """The Floquet multipliers of some curves, coloured by the parameter."""
    curves = response_figures.shown_curves(found)
    places = [point.parameter for curve in curves for point in curve.points]
    shades: dict[str, Any] = {"vmin": min(places), "vmax": max(places)}
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    name = "unit circle: stable inside"
    circle = Line(np.cos(angle), np.sin(angle), label=name, **CIRCLE)
    sizes = [np.abs(multipliers_of(curve)[0]).max() for curve in curves]
    reach = 1.15 * min(max(1.0, *sizes), FARTHEST)
    panels = []
    for curve in curves:
        values, parameters = multipliers_of(curve)
        size = np.abs(values)
        far = size > FARTHEST
        drawn = np.where(far, values / np.maximum(size, 1e-300) * FARTHEST, values)
        shades["bar"] = response_figures.parameter_label(found) if curve is curves[-1] else ""
        label = "Floquet multipliers, a colour for each motion"
        near = drawn[~far].real, drawn[~far].imag, parameters[~far]
        items: list[Item] = [circle, Dots(*near, markersize=3.0, label=label, **shades)]
        if np.any(far):
            outer = drawn[far].real, drawn[far].imag, parameters[far]
            items.append(Dots(*outer, marker="D", markersize=4.7, **shades | {"bar": ""}))
            text = f"diamonds: farther out, up to {size.max():.3g}"
            items.append(Text(0.5, 0.03, text, "xy", ha="center", fontsize=8.0))
        ends = (-reach, reach)
        title = response_figures.curve_name(found, curve)
        panels.append(Panel(items, title=title, xlim=ends, ylim=ends, square=True))
    labels: dict[str, Any] = {"xlabel": "real part", "ylabel": "imaginary part"}
    return Plot(panels, 3.2 * len(curves) + 1.8, 0.0, len(curves), share="xy", **labels)


def multipliers_of(curve: ResponseCurve) -> tuple[NDArray[np.complex128], Array]:
    """The multipliers of all points of a curve, and the parameter of each."""
    values = np.concatenate([point.multipliers for point in curve.points])
    parameters = [np.full(point.multipliers.size, point.parameter) for point in curve.points]
    return values, np.concatenate(parameters)


def harmonics_figure(found: Response) -> Plot:
    """The amplitudes of the first harmonics along some curves."""
    curves = response_figures.shown_curves(found)
    place, direction = response_figures.largest_component(found)

    def sizes(points: list[CurvePoint]) -> Array:
        """Amplitudes (H, points) of the harmonics, mm."""
        return 1e3 * np.abs([point.harmonics[:, place, direction] for point in points]).T

    highest = np.max([sizes(curve.points).max(axis=1) for curve in curves], axis=0)
    drawable = np.flatnonzero(highest > FLOOR * highest.max())
    names = {f"harmonic {k + 1}": COLOURS[k] for k in drawable}
    ends: Any = (FLOOR * highest.max(), 2.0 * highest.max())
    panels = []
    for curve in curves:
        items = response_figures.curve_items(
            found, [curve], lambda points: sizes(points)[drawable], names
        )
        panels.append(
            Panel(items, title=response_figures.curve_name(found, curve), log="y", ylim=ends)
        )
    samples = [Line(color=color, label=name) for name, color in names.items()]
    width = max(3.1 * len(curves), 6.4) + 0.8
    legend = [*samples, *response_figures.style_samples(found)]
    look: dict[str, Any] = {
        "share": "y",
        "xlabel": response_figures.parameter_label(found),
        "legend": legend,
    }
    ylabel = f"{response_figures.direction_name(found)} harmonics, mm"
    return Plot(panels, width, 4.2, len(curves), ylabel=ylabel, **look)


POINTS = 3  # largest number of contact points that are drawn
TICKS = 6  # largest number of marks along a curve with folds
CLOSE = 0.1  # smallest distance of two marks, in parts of the map


def shown_points(found: Response) -> NDArray[np.int64]:
    """The contact points to draw, in their order; these have the most changes of state."""
    changes = np.zeros(found.contacts)
    for curve in found.curves:
        for point in curve.points:
            states = point.period_states
            changes += np.sum(states != np.roll(states, 1, axis=0), axis=0)
    chosen = np.argsort(-changes, kind="stable")[:POINTS]
    return np.sort(chosen)


def folds_back(curve: ResponseCurve) -> bool:
    """Whether the parameter turns back on any piece of a curve."""
    for piece in curve.pieces:
        steps = np.diff([point.parameter for point in piece.points])
        if np.any(steps > 0.0) and np.any(steps < 0.0):
            return True
    return False


def map_panel(curve: ResponseCurve, contact: int, folded: bool, **look: Any) -> Panel:
    """The map of one contact point along a curve; a gap between two pieces stays white.

    Args:
        curve: the curve.
        contact: the contact point.
        folded: whether the abscissa is the length along the curve instead of the parameter.
        look: texts of the panel.
    """
    parts = [piece for piece in curve.pieces if piece.points]
    pieces = [piece.points for piece in parts]
    places, items, begin = [], list[Item](), 0.0
    for points, along in zip(pieces, lengths_along(parts), strict=True):
        places.append(np.array([point.parameter for point in points]))
        if folded:
            places[-1] = begin + along
            begin = places[-1][-1]
        states = np.array([point.period_states[:, contact] for point in points]).T
        instants = (np.arange(len(states)) + 0.5) / len(states)
        items.append(state_map(places[-1], instants, states))
    ends = np.concatenate(places)
    marks = dict(_marks(pieces, places, float(np.ptp(ends)))) if folded else {}
    limits: Any = {"xlim": (ends.min(), ends.max()), "ylim": (0.0, 1.0)}
    return Panel(items, **look, **limits, xticks=marks)


def _marks(
    pieces: Sequence[Sequence[CurvePoint]], places: Sequence[Array], width: float
) -> list[tuple[float, str]]:
    """Marks with the parameter along a curve: its ends and turns first, then places between."""
    wanted: list[tuple[float, float]] = []
    between: list[tuple[float, float]] = []
    for points, place in zip(pieces, places, strict=True):
        values = np.array([point.parameter for point in points])
        turns = np.flatnonzero(np.diff(np.sign(np.diff(values))) != 0) + 1
        wanted += [(float(place[k]), values[k]) for k in (0, *turns, values.size - 1)]
        even = np.searchsorted(place, np.linspace(place[0], place[-1], 2 * TICKS))
        between += [(float(place[k]), values[k]) for k in np.minimum(even, values.size - 1)]
    kept: list[tuple[float, str]] = []
    for number, (place_, value) in enumerate(wanted + between):
        free = all(abs(place_ - other) > CLOSE * width for other, _ in kept)
        if free and (number < len(wanted) or len(kept) < TICKS):
            kept.append((place_, f"{value:.4g}"))
    return sorted(kept)


def contact_map(found: Response) -> Plot:
    """The contact states: the period upwards, a row of maps for each contact point."""
    curves, contacts = response_figures.shown_curves(found), shown_points(found)
    wide = max(4.6 if len(curves) == 1 else 3.2, 9.6 / max(len(curves), 2))
    label, panels = response_figures.parameter_label(found), []
    for contact in contacts:
        for curve in curves:
            look, folded = dict[str, str](), folds_back(curve)
            if curve is curves[0]:
                point = f"point {contact + 1}: " if found.contacts > 1 else ""
                look["ylabel"] = f"{point}time / period"
            if contact == contacts[0]:
                look["title"] = response_figures.curve_name(found, curve)
            if contact == contacts[-1]:
                look["xlabel"] = f"{label} (along the curve)" if folded else label
            panels.append(map_panel(curve, int(contact), folded, **look))
    states = np.concatenate([point.period_states.ravel() for c in curves for point in c.points])
    size = wide * len(curves) + 1.0, 2.3 * len(contacts) + 1.2
    return Plot(panels, *size, len(curves), share="y", legend=state_samples(states))


CHECKS_NOTE = (
    "Each row compares one motion of a curve: that of the largest amplitude, the first and the "
    "last point, bifurcations, points evenly between them, and points near instability, where a "
    "multiplier of the richer basis is close to the unit circle or changes fast. The changes are "
    "relative to the amplitude, at the same value of the parameter; at a bifurcation they are how "
    "far it moves, relative to the value of the parameter."
)
"""What the table of estimated errors holds."""
PEAKS_HEADING = "Peaks over a second number"
NUMBERS = "response.csv"
CURVES_NOTE = (
    "Amplitude, phase and energies over the parameter. Stable parts are solid, unstable ones "
    "dashed."
)
PEAKS_NOTE = (
    "The largest amplitude of the probe over the frequency, and its frequency, over a second "
    "number. Thin lines are the peaks that were followed; the diamond marks the smallest."
)
STATES_NOTE = "The state of contact over the period, along the curve."
HARMONICS_NOTE = "Amplitudes of the harmonics along the curve."


def report(found: Response, clicked: Sequence[Detail] = ()) -> Report:
    """The report of response curves: `response.csv`, `response.json` and the pictures.

    Where points of the full model were computed, `response_full.csv` has their numbers, and
    `response_peaks.csv` those of the peaks over `peak_over`.

    Args:
        found: the curves.
        clicked: what a click on a point of the curves shows.
    """
    keys, waves = 1 if found.table.families is None else 2, found.scene.cyclic is not None
    each, peaks = partial(response_tables.each, found), response_tables.peaks_of(found)
    full = each(lambda curve: curve.full, response_tables.full_quantities(found))
    checks = each(lambda curve: curve.checks, response_tables.check_quantities(found))
    more = {"response_full.csv": rows_of(*full), "response_peaks.csv": rows_of(*peaks)}
    draw = partial(response_figures.figure, found, clicked)
    pictures = [Picture("Response curves", "response.png", draw, CURVES_NOTE, NUMBERS)]
    pictures += [] if found.interrupted else _more_pictures(found, bool(peaks[0]))
    sections = [
        Section("Results", [response_tables.result_table(found)], terminal=False, top=True),
        Section("Special points", [response_tables.event_table(found)], keys=keys),
        Section(PEAKS_HEADING, [table_of(*peaks)], keys=keys, terminal=False),
        Section("Full model", [table_of(*full)], keys=keys),
        Section("Estimated errors", [table_of(*checks), CHECKS_NOTE], terminal=False),
        Section("Effort", [response_tables.run_table(found)], terminal=False),
    ]
    return Report(
        "response",
        title="response curves",
        found=found,
        sentences=response_tables.sentences(found),
        sections=sections,
        rows=response_tables.rows(found),
        summary=response_tables.summary(found),
        pictures=pictures,
        varied=response_tables.varied_keys(found),
        more_rows={name: listed for name, listed in more.items() if listed},
        quantities=[
            notes.AMPLITUDES,
            *([] if waves else [notes.STABILITY]),
            *([notes.EVENTS] if found.contacts else []),
            *([notes.PEAKS] if peaks[0] else []),
        ],
        unjudged=[
            *([notes.STABILITY] if waves else []),
            *([notes.PEAK_FORCE, notes.DISSIPATION] if found.contacts else []),
        ],
    )


def _more_pictures(found: Response, peaks: bool) -> list[Picture]:
    """The pictures besides that of the curves."""
    states, files = "Contact states over the period", {"peaks": "response_peaks.csv"}
    known = any(point.multipliers.size for curve in found.curves for point in curve.points)
    listed = [
        (peaks, PEAKS_HEADING, "peaks", peak_figure, PEAKS_NOTE),
        (found.contacts, states, "contact_map", contact_map, STATES_NOTE),
        (known, "Floquet multipliers", "multipliers", multiplier_figure, MULTIPLIER_NOTE),
        (True, "Harmonics", "harmonics", harmonics_figure, HARMONICS_NOTE),
    ]
    return [
        Picture(heading, f"{name}.png", partial(draw, found), said, files.get(name, NUMBERS))
        for shown, heading, name, draw, said in listed
        if shown
    ]


def write(found: Response, stored: Reduced, folder: Path, study: Study | None = None) -> list[Path]:
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
    if isinstance(stored, StoredDisk) and found.scene.output.motion:
        for name, (_, motion, _) in motions.items():
            files += write_wave(stored, motion, folder / FOLDER / name)
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
        marked[f"{prefix}largest"] = (curve, response_figures.largest_point(found, curve))
        for kind in BIFURCATIONS:
            mine = [point for point in curve.special if point.kind == kind]
            for k, point in enumerate(mine, 1):
                marked[f"{prefix}{kind.replace(' ', '_').replace('-', '_')}_{k}"] = (curve, point)
    return marked


def marked_motions(found: Response, stored: Reduced) -> dict[str, MarkedMotion]:
    """The periodic motions at the marked points; a motion that is lost becomes a warning."""
    motions = {}
    for name, (curve, point) in marked_points(found).items():
        try:
            motions[name] = _motion(found, stored, curve, point)
        except ConvergenceError as error:
            text = f"the motion {name} was not written: {error}"
            found.warnings.append(notes.Note(notes.NoteKind.NOT_DRAWN, text, name))
    return motions


def _motion(
    found: Response, stored: Reduced, curve: ResponseCurve, point: CurvePoint
) -> MarkedMotion:
    """The periodic motion at a point.

    Raises:
        ConvergenceError: the motion is lost.
    """
    families = found.table.families
    if families is not None:
        stored = stored.with_values({families.key: curve.value})
    problem = family_of(stored)(point.parameter)
    if curve.harmonics:
        motion = balanced_motion(stored, point)
    else:
        motion = recorded_motion(problem, point.z, point.periods)
    return MarkedMotion(point.parameter, motion, problem.contacts)


def clicked_motions(
    found: Response, stored: Reduced, known: dict[str, MarkedMotion]
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
    states = f", {', '.join(response_figures.state_names(point))}" if found.contacts else ""
    begin = f"The motion at {curve_title(found.scene, curve.value)}{where}"
    title = f"{begin}: {point.known_stability}{states}"
    place, direction = response_figures.largest_component(found)
    some = slice(None, None, max(1, motion.time.size // MOST_SAMPLES))
    moved = 1e3 * motion.displacement[some, place]
    lines = [(motion.time[some] - motion.time[0], moved[:, direction])]
    if found.contacts:
        lines.append((moved[:, 1], motion.force[some, place, 1]))
    return Detail(title, (point.parameter, response_figures.height_of(found)(point)), lines)


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
