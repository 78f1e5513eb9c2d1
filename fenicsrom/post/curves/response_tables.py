"""The results of response curves and their peaks: sentences, tables, rows and numbers for files."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves import results
from fenicsrom.assess.curves.peaks import largest_peaks
from fenicsrom.assess.curves.trust import Check
from fenicsrom.assess.errors.verdicts import in_percent
from fenicsrom.online.curves.continuation import ForcedPeak
from fenicsrom.online.curves.curve import COMPLETE, HARMONICS, CurvePoint
from fenicsrom.online.model.disk_model import wave_of
from fenicsrom.post.base.plot import Item, Line, Panel, Plot
from fenicsrom.post.base.tables import Quantity, components, rows_of, table_of
from fenicsrom.post.curves.backbone_report import WIDE
from fenicsrom.post.curves.response_figures import (
    CONTACT,
    PEAK,
    colour_of,
    curve_name,
    direction_name,
    directions,
    key_label,
    largest_component,
    largest_direction,
    largest_point,
)
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.curve_checks import uses_balance
from fenicsrom.scene.reading.overrides import column_name, in_words, unit_of
from fenicsrom.words import counted


class Told(NamedTuple):
    """What a row of a table tells of.

    Attributes:
        curve: the curve.
        item: a point of it, or another part.
        piece: number of the piece.
    """

    curve: results.ResponseCurve
    item: Any
    piece: int = 0


def each(
    found: results.Response,
    items: Callable[[results.ResponseCurve], Iterable[Any]],
    quantities: Iterable[Quantity],
) -> tuple[list[Told], list[Quantity]]:
    """The items of all curves, and their quantities after the second number of the curves."""
    families, told = found.table.families, [one.inside("item") for one in quantities]
    if families is not None:
        told.insert(0, scene_number(found, families.key, "curve.value"))
    return [Told(curve, one) for curve in found.curves for one in items(curve)], told


def scene_number(found: results.Response, key: str, of: str, digits: int = 7) -> Quantity:
    """A number of the scene, as an attribute."""
    return Quantity(column_name(found.scene, key), of, key_label(found, key), digits)


def parameter(found: results.Response, of: str = "parameter", digits: int = 7) -> Quantity:
    """The parameter of the curves, as an attribute."""
    return scene_number(found, found.table.parameter, of, digits)


def optimum_sentences(found: results.Response, curve: results.ResponseCurve) -> list[str]:
    """The sentences on the smallest peak of a curve over the second number, and its errors."""
    best, over, scene = curve.optimum, found.table.peak_over, found.scene
    listed = largest_peaks(curve.peaks)
    if best is None or over is None:
        count = counted(len(listed), "value")
        incomplete = f"The peaks over {over} are incomplete: {count} so far, and no optimum."
        return [incomplete] if over is not None and found.interrupted else []
    peak = best.peak
    ends = in_words(scene, over, listed[0].value, listed[-1].value)
    where = f"{over} = {peak.value:.4g} {unit_of(scene, over)}".rstrip()
    lines = [
        f"Peak over {ends} ({counted(len(listed), 'value')}): the smallest is at {where}, where "
        f"the amplitude of the probe is {1e3 * peak.amplitude:.5g} mm at {peak.frequency:.6g} Hz, "
        f"{peak.point.verdict}."
    ]
    if peak.value in (listed[0].value, listed[-1].value):
        lines.append("The peak is smallest at an end of response.peak_range; widen this range.")
    changes = [
        f"{what} changes it by {in_percent(error)}"
        for what, error in (
            ("half the time step", best.step_error),
            ("a richer basis", best.basis_error),
        )
        if error is not None
    ]
    if changes:
        between = " and ".join(f"{value:.4g}" for value in best.within)
        lines.append(
            f"Of this peak, {' and '.join(changes)}; with such errors the optimum lies between "
            f"{between} {unit_of(scene, over)}".rstrip()
            + "."
        )
    return lines


def _with_optimum(curve: results.ResponseCurve) -> list[ForcedPeak]:
    """The largest peaks of a curve with the optimum, in the order of their values."""
    peaks = {peak.value: peak for peak in largest_peaks(curve.peaks)}
    if curve.optimum is not None:
        peaks[curve.optimum.peak.value] = curve.optimum.peak
    return [peaks[value] for value in sorted(peaks)]


def peaks_of(found: results.Response) -> tuple[list[Told], list[Quantity]]:
    """The largest peaks of all curves over the second number; none without `peak_over`."""
    best = [curve.optimum.peak for curve in found.curves if curve.optimum is not None]
    smallest = Quantity("smallest", lambda peak: any(peak is one for one in best), "smallest")
    return each(found, _with_optimum, [*peak_quantities(found), smallest])


def peak_quantities(found: results.Response) -> list[Quantity]:
    """What is told of a peak."""
    return [
        scene_number(found, str(found.table.peak_over), "value", 5),
        *PEAK,
        Quantity("largest_contact_amplitude_m", lambda peak: float(peak.point.amplitude.max())),
        Quantity("friction_dissipation_per_period_J", "point.friction_dissipation"),
    ]


def optimum_summary(found: results.Response, curve: results.ResponseCurve) -> dict[str, Any] | None:
    """The smallest peak of a curve for `response.json`."""
    if curve.optimum is None:
        return None
    errors = map(Quantity, ("step_error", "basis_error", "within"))
    told = [*(one.inside("peak") for one in peak_quantities(found)), *errors]
    return rows_of([curve.optimum], told)[0]


def peak_figure(found: results.Response) -> Plot:
    """Amplitude and frequency of the largest peaks, and thin those that were followed."""
    upper: list[Item] = []
    lower: list[Item] = []

    def add(peaks: Sequence[ForcedPeak], **look: Any) -> None:
        values = [peak.value for peak in peaks]
        upper.append(Line(values, [1e3 * peak.amplitude for peak in peaks], **look))
        lower.append(Line(values, [peak.frequency for peak in peaks], **look))

    for curve in found.curves:
        look: dict[str, Any] = {"color": colour_of(found, curve), "label": curve_name(found, curve)}
        for peaks in curve.peaks:
            add(sorted(peaks, key=lambda peak: peak.value), linewidth=0.6, **look)
        add(_with_optimum(curve), linewidth=1.8, **look)
        if curve.optimum is not None:
            add([curve.optimum.peak], linestyle="", marker="D", **look)
    sizes = [peak.amplitude for curve in found.curves for peak in _with_optimum(curve)]
    wide = max(sizes) > WIDE * min(sizes)
    amplitude = "largest amplitude of the probe, mm"
    panels = [
        Panel(upper, "", amplitude, log="xy" if wide else "x", ylim=(None if wide else 0.0, None)),
        Panel(lower, key_label(found, str(found.table.peak_over)), "frequency, Hz", log="x"),
    ]
    return Plot(panels, 8.4, 6.0, share="x")


def varied_keys(found: results.Response) -> list[str]:
    """The keys of the scene that change along and between the curves."""
    table = found.table
    loads = [f"loads.{k}.frequency" for k in range(len(found.scene.loads))]
    along = loads if table.parameter == "frequency" else [table.parameter]
    return along if table.families is None else [*along, table.families.key]


def _millimetres(found: results.Response, amplitude: Array, digits: int = 5) -> str:
    """The largest of amplitudes (P, d) in the direction of the largest motion, as text in mm."""
    return f"{1e3 * float(amplitude[:, largest_direction(found)].max()):.{digits}g}"


def _known(name: str) -> Callable[[Any], Any]:
    """What gives an error, or "unknown"."""
    return lambda of: "unknown" if (error := getattr(of, name)) is None else error


BY_STEP, BY_BASIS = "change by half the time step, %", "change by a richer basis, %"
MORE = "Half as many harmonics again"
BY_HARMONICS = "change by more harmonics, %"


def by_step(found: results.Response) -> str:
    """The head of the change that finer time steps, or more harmonics, make."""
    return BY_HARMONICS if uses_balance(found.scene) else BY_STEP


def result_table(found: results.Response) -> list[list[Any]]:
    """The largest amplitude of each curve, where it is, and how far it can be trusted."""

    def top(curve: results.ResponseCurve) -> CurvePoint:
        return largest_point(found, curve)

    amplitude, at = f"largest {direction_name(found)} amplitude, mm", parameter(found, digits=6)
    shown = [
        Quantity("", lambda c: f"{_millimetres(found, top(c).amplitude)}{_so_far(c)}", amplitude),
        replace(at, of=lambda curve: top(curve).parameter, head=f"at {at.head}"),
        Quantity("", lambda curve: top(curve).known_stability, "stability"),
        Quantity("", _known("step_error"), by_step(found), 2),
        Quantity("", _known("basis_error"), BY_BASIS, 2),
        Quantity("", lambda c: sum(p.known_unstable for p in c.points), "unstable points"),
    ]
    return table_of(*each(found, lambda curve: [curve], shown))


def sentences(found: results.Response) -> list[str]:
    """The results in sentences, for the terminal and the report; equal ones of curves are one."""
    name = direction_name(found)
    titles: dict[str, list[str]] = {}
    for curve in found.curves:
        top, points = largest_point(found, curve), curve.points
        lines = [
            f"{counted(len(points), 'point')}{_harmonics(curve)} in {curve.seconds:.1f} s; largest "
            f"{name} amplitude{_so_far(curve)} {_millimetres(found, top.amplitude)} mm at "
            f"{in_words(found.scene, found.table.parameter, top.parameter)}, {_verdict(top)}."
        ]
        if unstable := [point for point in points if point.known_unstable]:
            lines.append(_unstable_sentence(found, unstable))
        lines += _changes(curve)
        free = sum(point.free_sliders > 0 for point in points)
        if free:
            lines.append(
                f"At {counted(free, 'point')}, a contact point sticks all the time: the "
                "position of its slider is not unique."
            )
        lines += optimum_sentences(found, curve)
        lines += [f"The curve is incomplete: {reason}." for reason in _gaps(curve)]
        if found.scene.cyclic is not None and found.contacts:
            lost = f"{top.friction_dissipation:.4g} J per period"
            lines.append(f"Friction dissipates {lost} there, in each sector.")
        for line in lines:
            titles.setdefault(line, []).append(results.curve_title(found.scene, curve.value))
    said = [f"{results.joined_titles(found, begins)}{line}" for line, begins in titles.items()]
    if found.scene.cyclic is not None:
        return [*said, _wave_sentence(found.scene)]
    return [*said, *filter(None, [found.mesh_check.sentence()])]


def _gaps(curve: results.ResponseCurve) -> list[str]:
    """The reasons why parts of a curve are not complete."""
    return sorted({piece.reason or "interrupted" for piece in curve.pieces} - set(COMPLETE))


def _wave_sentence(scene: Scene) -> str:
    """The wave of a tuned disk in words."""
    h, way = wave_of(scene)
    ways = {"forward": "with the rotation", "backward": "against the rotation"}
    text = f"All sectors move alike, in a wave with {counted(h, 'nodal diameter')}"
    return f"{text} that runs {ways[way]} in the turning frame." if way else f"{text} that stands."


def _harmonics(curve: results.ResponseCurve) -> str:
    """The number of harmonics of a curve in words; "" of shooting."""
    return f" with {counted(curve.harmonics, 'harmonic')}" if curve.harmonics else ""


def _so_far(curve: results.ResponseCurve) -> str:
    """What follows the largest amplitude of an incomplete curve; "" of a complete one."""
    return " so far" if _gaps(curve) else ""


def _unstable_sentence(found: results.Response, points: list[CurvePoint]) -> str:
    """The sentence on the unstable points of a curve: where they are, and how unstable."""
    size = max(abs(results.judged_multiplier(point)) for point in points)
    where = _places(found, points)
    return f"Unstable points: {len(points)}, {where} (largest multiplier {size:.5g})."


def _places(found: results.Response, points: Sequence[CurvePoint]) -> str:
    """Where points of a curve are, in words."""
    values = [point.parameter for point in points]
    ends = sorted({min(values), max(values)})
    place = in_words(found.scene, found.table.parameter, *ends)
    return f"{'at' if len(ends) == 1 else 'between'} {place}"


def _changes(curve: results.ResponseCurve) -> list[str]:
    """Sentences on the known changes by half the step, or more harmonics, and a richer basis."""
    lines = []
    step = MORE if curve.harmonics else "Half the time step"
    for name, what in (("step_error", step), ("basis_error", "A richer basis")):
        here: float | None = getattr(curve, name)
        if here is None:
            continue
        elsewhere = [
            error
            for check in curve.checks
            if check.quantity == "amplitude" and (error := getattr(check, name)) is not None
        ]
        most = max(elsewhere, default=here)
        more = f", and other amplitudes by at most {in_percent(most)}" if most > here else ""
        change = "change" if what == MORE else "changes"
        lines.append(f"{what} {change} this amplitude by {in_percent(here)}{more}.")
    return lines


def _verdict(point: CurvePoint) -> str:
    """The stability of a point in words."""
    if not point.known:
        return "stability not known" if point.denied else "stability not judged"
    return "stable" if point.stable else f"unstable ({point.verdict})"


def event_table(found: results.Response) -> list[list[Any]]:
    """The bifurcations and contact events of all curves; empty if there are none.

    The last column is how far half the time step or a richer basis moves a bifurcation, or the
    width of the bracket of an event that was not located.
    """
    unit = unit_of(found.scene, found.table.parameter)
    uncertain = f"uncertain by{f', {unit}' if unit else ''}"
    moved = {
        (check.where, check.point.parameter): [
            (error or 0.0) * abs(check.point.parameter)
            for error in (check.basis_error, check.step_error)
        ]
        for curve in found.curves
        for check in curve.checks
        if check.quantity == "parameter" and {check.step_error, check.basis_error} != {None}
    }

    def shift(point: CurvePoint) -> str | None:
        """How uncertain the place of an event is."""
        by_basis, *by_step = moved.get((point.kind, point.parameter), [0.0])
        if results.is_wide(found, point):
            by_step = [point.within]
        return f"{max(by_basis, *by_step):.1g}" if by_step else None

    def event(point: CurvePoint) -> str:
        at = f", contact point {point.contact + 1}" if point.contact >= 0 else ""
        return f"{point.kind}{at}"

    name = f"{direction_name(found)} amplitude, mm"
    shown = [
        Quantity("", event, "event"),
        parameter(found),
        Quantity("", lambda point: _millimetres(found, point.amplitude), name),
        Quantity("", shift, uncertain),
    ]
    return table_of(*each(found, lambda curve: curve.special, shown))


def full_quantities(found: results.Response) -> list[Quantity]:
    """What is told of a motion of the full model beside that of the reduced model."""
    names, shown = directions(found), f"{direction_name(found)} amplitude, mm"
    return [
        parameter(found, digits=6),
        Quantity("", lambda p: _millimetres(found, p.reduced_amplitude, 7), shown),
        Quantity("", lambda p: _millimetres(found, p.amplitude, 7), "full model, mm"),
        *components("full_amplitude_{}_m", lambda p: p.amplitude.max(axis=0), names),
        *components("reduced_amplitude_{}_m", lambda p: p.reduced_amplitude.max(axis=0), names),
        Quantity("relative_error", "error", "difference, %", 2),
        Quantity("stability_of_the_reduced_motion", "verdict"),
        Quantity("full_periods", "periods", "full periods"),
        *(Quantity("full_periods_with_derivatives", "derived"), Quantity("residual")),
        Quantity("seconds", head="run time, s", digits=3),
    ]


def run_table(found: results.Response) -> list[list[Any]]:
    """The points, the marched periods and the run time of each curve."""
    by_balance = uses_balance(found.scene)
    marched = "evaluations" if by_balance else "marched periods"
    article = "an evaluation" if by_balance else "a marched period"
    shown = [
        Quantity("", lambda curve: len(curve.points), "points"),
        Quantity("", lambda curve: sum(p.known_unstable for p in curve.points), "unstable"),
        Quantity("", lambda curve: curve.marches[0], marched),
        Quantity("", lambda curve: curve.marches[1], "with derivatives"),
        Quantity("seconds", head="run time, s", digits=4),
        Quantity("", lambda c: c.seconds / max(c.marches[0], 1), f"time of {article}, ms", 4),
    ]
    return table_of(*each(found, lambda curve: [curve], shown))


def check_quantities(found: results.Response) -> list[Quantity]:
    """What is told of a point at which errors are estimated."""

    def of_basis(check: Check, known: Any) -> Any:
        return (known or "unknown") if check.compared else None

    return [
        Quantity("where", head="point"),
        parameter(found, "point.parameter"),
        Quantity("quantity", head="of the"),
        *(Quantity("step_error"), Quantity("basis_error")),
        Quantity("", _known("step_error"), by_step(found), 4),
        Quantity("", lambda check: of_basis(check, check.basis_error), BY_BASIS, 4),
        Quantity("stability", "point.known_stability", "stability"),
        Quantity("compared_with_a_richer_basis", "compared"),
        Quantity("stability_with_half_the_step", "finer_verdict", "with half the step"),
        Quantity("stability_with_a_richer_basis", "richer_verdict"),
        Quantity("", lambda check: of_basis(check, check.richer_verdict), "with the richer basis"),
    ]


def rows(found: results.Response) -> list[dict[str, Any]]:
    """The rows of `response.csv`: every point and event in the order along its curve."""
    numbered = [
        Told(curve, point, number)
        for curve in found.curves
        for number, piece in enumerate(curve.pieces, 1)
        for point in piece.in_order()
    ]
    _, told = each(found, lambda curve: (), quantities(found))
    return rows_of(numbered, [*told, Quantity("piece")])


def quantities(found: results.Response) -> list[Quantity]:
    """What is told of a point. Of several contact points, amplitudes and force are the largest.

    Harmonics and phase are those of the contact point and direction of the largest amplitude; the
    harmonics are multiples of the lowest frequency of the loads.
    """
    place, direction = largest_component(found)
    probe = "xyz"[: found.curves[0].points[0].probe_amplitude.size]

    def main(point: CurvePoint) -> Any:
        return point.harmonics[:, place, direction]

    def multiplier(part: Callable[[complex], float]) -> Callable[[CurvePoint], float | None]:
        return lambda p: float(part(results.judged_multiplier(p))) if p.multipliers.size else None

    return [
        parameter(found),
        *components("amplitude_{}_m", lambda p: p.amplitude.max(axis=0), directions(found)),
        *components("probe_amplitude_{}_m", "probe_amplitude", probe),
        Quantity("phase_deg", lambda point: float(np.degrees(np.angle(main(point)[0])))),
        *components("harmonic_{}_m", lambda point: np.abs(main(point)), range(1, HARMONICS + 1)),
        *(CONTACT if found.contacts else ()),
        Quantity("damping_dissipation_per_period_J", "damping_dissipation"),
        *(Quantity("stability", "known_stability"), Quantity("event", "kind")),
        Quantity("contact_point", lambda p: None if p.contact < 0 else p.contact + 1),
        Quantity("periods"),
        Quantity("largest_multiplier", multiplier(abs)),
        Quantity("multiplier_real", multiplier(np.real)),
        Quantity("multiplier_imaginary", multiplier(np.imag)),
        *map(Quantity, ("free_sliders", "residual")),
        Quantity("marched_periods", lambda point: point.marches[0]),
        Quantity("marched_periods_with_derivatives", lambda point: point.marches[1]),
    ]


def summary(found: results.Response) -> dict[str, Any]:
    """What `response.json` has of the curves."""
    table = found.table
    waves: dict[str, Any] = {}
    if found.scene.cyclic is not None:
        waves = dict(zip(("nodal_diameters", "direction"), wave_of(found.scene), strict=True))
    return {
        "parameter": table.parameter,
        "first": table.first,
        "last": table.last,
        "family": table.families.key if table.families else None,
        "coordinates": found.size,
        "steps_per_period": found.steps,
        **waves,
        "curves": [_curve_summary(found, curve) for curve in found.curves],
    }


def _curve_summary(found: results.Response, curve: results.ResponseCurve) -> dict[str, Any]:
    """The part of `response.json` about one curve."""
    told = quantities(found)
    return {
        "value": curve.value,
        "points": len(curve.points),
        "harmonics": curve.harmonics or None,
        "ends": [piece.reason for piece in curve.pieces],
        "largest": rows_of([largest_point(found, curve)], told)[0],
        "events": rows_of(curve.special, told),
        "pieces": [
            {"origin": piece.origin, "periods": piece.periods, "points": len(piece.points)}
            for piece in curve.pieces
        ],
        "checks": rows_of(curve.checks, check_quantities(found)),
        "marched_periods": curve.marches[0],
        "marched_periods_with_derivatives": curve.marches[1],
        "seconds": curve.seconds,
        "optimum": optimum_summary(found, curve),
        "full_model": rows_of(curve.full, full_quantities(found)),
    }
