"""The results of response curves: sentences and tables for people, rows and numbers for files.

The peaks of response curves over a second number: sentences, table, rows and picture.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.peaks import largest_peaks
from fenicsrom.assess.curves.results import (
    FullPoint,
    Response,
    ResponseCurve,
    curve_title,
    is_wide,
    joined_titles,
    judged_multiplier,
)
from fenicsrom.assess.errors.verdicts import in_percent
from fenicsrom.online.curves.continuation import ForcedPeak
from fenicsrom.online.curves.curve import COMPLETE, CurvePoint
from fenicsrom.post.base.style import Figure, new_panels, styled
from fenicsrom.post.base.tables import named, table_of
from fenicsrom.post.curves.backbone_report import WIDE
from fenicsrom.post.curves.response_figures import (
    colour_of,
    contact_columns,
    curve_name,
    direction_name,
    directions,
    family,
    key_label,
    largest_component,
    largest_direction,
    largest_point,
    parameter_label,
)
from fenicsrom.scene.reading.overrides import column_name, in_words, unit_of
from fenicsrom.words import counted


def optimum_sentences(found: Response, curve: ResponseCurve) -> list[str]:
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


def _each(found: Response) -> list[tuple[ResponseCurve, ForcedPeak, bool]]:
    """The largest peaks by their values, each with its curve and whether it is the optimum."""
    return [
        (curve, peak, curve.optimum is not None and peak is curve.optimum.peak)
        for curve in found.curves
        for peak in _with_optimum(curve)
    ]


def _with_optimum(curve: ResponseCurve) -> list[ForcedPeak]:
    """The largest peaks of a curve with the optimum, in the order of their values."""
    peaks = {peak.value: peak for peak in largest_peaks(curve.peaks)}
    if curve.optimum is not None:
        peaks[curve.optimum.peak.value] = curve.optimum.peak
    return [peaks[value] for value in sorted(peaks)]


def peak_table(found: Response) -> list[list[Any]]:
    """A row for each peak; empty without `peak_over`."""
    return table_of(
        family(found, curve)
        | {
            key_label(found, str(found.table.peak_over)): f"{peak.value:.5g}",
            "frequency, Hz": f"{peak.frequency:.6g}",
            "amplitude of the probe, mm": f"{1e3 * peak.amplitude:.5g}",
            "stability": peak.point.verdict,
            "": "smallest" if smallest else "",
        }
        for curve, peak, smallest in _each(found)
    )


def peak_rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response_peaks.csv`."""
    families = found.table.families
    return [
        ({} if families is None else {column_name(found.scene, families.key): curve.value})
        | _peak_row(found, peak)
        | {"smallest": smallest}
        for curve, peak, smallest in _each(found)
    ]


def _peak_row(found: Response, peak: ForcedPeak) -> dict[str, Any]:
    return {
        column_name(found.scene, str(found.table.peak_over)): peak.value,
        "frequency_Hz": peak.frequency,
        "probe_amplitude_m": peak.amplitude,
        "largest_contact_amplitude_m": float(peak.point.amplitude.max()),
        "friction_dissipation_per_period_J": peak.point.friction_dissipation,
        "stability": peak.point.verdict,
    }


def optimum_summary(found: Response, curve: ResponseCurve) -> dict[str, Any] | None:
    """The smallest peak of a curve for `response.json`."""
    best = curve.optimum
    if best is None:
        return None
    return {
        **_peak_row(found, best.peak),
        "step_error": best.step_error,
        "basis_error": best.basis_error,
        "within": best.within,
    }


@styled
def peak_figure(found: Response) -> Figure:
    """Draw amplitude and frequency of the largest peaks, and thin those that were followed."""
    drawn, (upper, lower) = new_panels(8.4, 6.0, 2, sharex=True)
    for curve in found.curves:
        colour = colour_of(found, curve)
        others = [sorted(one, key=lambda peak: peak.value) for one in curve.peaks]
        for peaks, width in [*((one, 0.6) for one in others), (_with_optimum(curve), 1.8)]:
            values = [peak.value for peak in peaks]
            look = {"color": colour, "linewidth": width}
            upper.plot(values, [1e3 * peak.amplitude for peak in peaks], **look)
            lower.plot(values, [peak.frequency for peak in peaks], **look)
        if curve.optimum is not None:
            best, look = curve.optimum.peak, {"color": colour, "label": curve_name(found, curve)}
            upper.plot(best.value, 1e3 * best.amplitude, "D", **look)
            lower.plot(best.value, best.frequency, "D", **look)
    sizes = [peak.amplitude for _, peak, _ in _each(found)]
    if max(sizes) > WIDE * min(sizes):
        upper.set_yscale("log")
    else:
        upper.set_ylim(bottom=0.0)
    upper.set_ylabel("largest amplitude of the probe, mm")
    lower.set_ylabel("frequency, Hz")
    lower.set(xscale="log", xlabel=key_label(found, str(found.table.peak_over)))
    if found.table.families is not None:
        upper.legend()
    drawn.align_ylabels([upper, lower])
    return drawn


def varied_keys(found: Response) -> list[str]:
    """The keys of the scene that change along and between the curves."""
    table = found.table
    loads = [f"loads.{k}.frequency" for k in range(len(found.scene.loads))]
    along = loads if table.parameter == "frequency" else [table.parameter]
    return along if table.families is None else [*along, table.families.key]


def _millimetres(found: Response, amplitude: Array, digits: int = 5) -> str:
    """The largest of amplitudes (P, d) in the direction of the largest motion, as text in mm."""
    return f"{1e3 * float(amplitude[:, largest_direction(found)].max()):.{digits}g}"


def _percent(error: float | None) -> str:
    """A relative error as text in percent."""
    return "unknown" if error is None else f"{100.0 * error:.2g}"


def result_table(found: Response) -> list[list[Any]]:
    """The largest amplitude of each curve, where it is, and how far it can be trusted."""
    return table_of(
        family(found, curve)
        | {
            f"largest {direction_name(found)} amplitude, mm": (
                f"{_millimetres(found, top.amplitude)}{_so_far(curve)}"
            ),
            f"at {parameter_label(found)}": f"{top.parameter:.6g}",
            "stability": top.known_stability,
            "change by half the time step, %": _percent(curve.step_error),
            "change by a richer basis, %": _percent(curve.basis_error),
            "unstable points": sum(point.known_unstable for point in curve.points),
        }
        for curve in found.curves
        for top in [largest_point(found, curve)]
    )


def sentences(found: Response) -> list[str]:
    """The results in sentences, for the terminal and the report; equal ones of curves are one."""
    name = direction_name(found)
    titles: dict[str, list[str]] = {}
    for curve in found.curves:
        top, points = largest_point(found, curve), curve.points
        lines = [
            f"{counted(len(points), 'point')} in {curve.seconds:.1f} s; largest {name} "
            f"amplitude{_so_far(curve)} {_millimetres(found, top.amplitude)} mm at "
            f"{in_words(found.scene, found.table.parameter, top.parameter)}, {_verdict(top)}."
        ]
        if unstable := [point for point in points if point.known_unstable]:
            lines.append(_unstable_sentence(found, unstable))
        if unsure := [point for point in points if point.denied]:
            lines.append(
                f"Stability not known: {counted(len(unsure), 'point')}, "
                f"{_places(found, unsure)}: half the time step finds another one; increase "
                "time.steps_per_period."
            )
        lines += _changes(curve)
        free = sum(point.free_sliders > 0 for point in points)
        if free:
            lines.append(
                f"At {counted(free, 'point')}, a contact point sticks all the time: the "
                "position of its slider is not unique."
            )
        lines += optimum_sentences(found, curve)
        lines += [f"The curve is incomplete: {reason}." for reason in _gaps(curve)]
        for line in lines:
            titles.setdefault(line, []).append(curve_title(found.scene, curve.value))
    said = [f"{joined_titles(found, begins)}{line}" for line, begins in titles.items()]
    return [*said, *filter(None, [found.mesh_check.sentence()])]


def _gaps(curve: ResponseCurve) -> list[str]:
    """The reasons why parts of a curve are not complete."""
    return sorted({piece.reason or "interrupted" for piece in curve.pieces} - set(COMPLETE))


def _so_far(curve: ResponseCurve) -> str:
    """What follows the largest amplitude of an incomplete curve; "" of a complete one."""
    return " so far" if _gaps(curve) else ""


def _unstable_sentence(found: Response, points: list[CurvePoint]) -> str:
    """The sentence on the unstable points of a curve: where they are, and how unstable."""
    size = max(abs(judged_multiplier(point)) for point in points)
    where = _places(found, points)
    return f"Unstable points: {len(points)}, {where} (largest multiplier {size:.5g})."


def _places(found: Response, points: Sequence[CurvePoint]) -> str:
    """Where points of a curve are, in words."""
    values = [point.parameter for point in points]
    ends = sorted({min(values), max(values)})
    place = in_words(found.scene, found.table.parameter, *ends)
    return f"{'at' if len(ends) == 1 else 'between'} {place}"


def _changes(curve: ResponseCurve) -> list[str]:
    """Sentences on the known changes by half the time step and by a richer basis."""
    lines = []
    for name, what in (("step_error", "Half the time step"), ("basis_error", "A richer basis")):
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
        lines.append(f"{what} changes this amplitude by {in_percent(here)}{more}.")
    return lines


def _verdict(point: CurvePoint) -> str:
    """The stability of a point in words."""
    if point.denied:
        return "stability not known"
    return "stable" if point.stable else f"unstable ({point.verdict})"


def event_table(found: Response) -> list[list[Any]]:
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
        if is_wide(found, point):
            by_step = [point.within]
        return f"{max(by_basis, *by_step):.1g}" if by_step else None

    return table_of(
        family(found, curve)
        | {
            "event": f"{point.kind}{f', contact point {point.contact + 1}' * (point.contact >= 0)}",
            parameter_label(found): f"{point.parameter:.7g}",
            f"{direction_name(found)} amplitude, mm": _millimetres(found, point.amplitude),
            uncertain: shift(point),
        }
        for curve in found.curves
        for point in curve.special
    )


def full_table(found: Response) -> list[list[Any]]:
    """A row for each motion of the full model; empty without `full`."""
    name = f"{direction_name(found)} amplitude, mm"
    return table_of(
        family(found, curve)
        | {
            parameter_label(found): f"{point.parameter:.6g}",
            name: _millimetres(found, point.reduced_amplitude, 7),
            "full model, mm": _millimetres(found, point.amplitude, 7),
            "difference, %": _percent(point.error),
            "full periods": point.periods,
            "run time, s": f"{point.seconds:.3g}",
        }
        for curve in found.curves
        for point in curve.full
    )


def run_table(found: Response) -> list[list[Any]]:
    """The points, the marched periods and the run time of each curve."""
    return table_of(
        family(found, curve)
        | {
            "points": len(curve.points),
            "unstable": sum(point.known_unstable for point in curve.points),
            "marched periods": curve.marches[0],
            "with derivatives": curve.marches[1],
            "run time, s": curve.seconds,
            "ms per marched period": 1e3 * curve.seconds / max(curve.marches[0], 1),
        }
        for curve in found.curves
    )


def trust_table(found: Response) -> list[list[Any]]:
    """The estimated errors at the selected points of all curves; empty without such points."""

    def percent(error: float | None) -> float | str:
        return "unknown" if error is None else 100.0 * error

    return table_of(
        family(found, curve)
        | {
            "point": check.where,
            parameter_label(found): f"{check.point.parameter:.7g}",
            "of the": check.quantity,
            "change by half the time step, %": percent(check.step_error),
            "change by a richer basis, %": percent(check.basis_error) if check.compared else None,
            "stability": check.point.verdict if check.quantity == "amplitude" else None,
            "with half the step": check.finer_verdict,
            "with the richer basis": (check.richer_verdict or "unknown")
            if check.compared
            else None,
        }
        for curve in found.curves
        for check in curve.checks
    )


def rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response.csv`: every point and event in the order along its curve."""
    families, component = found.table.families, largest_component(found)
    return [
        ({} if families is None else {column_name(found.scene, families.key): curve.value})
        | {"piece": number}
        | _row(found, point, component)
        for curve in found.curves
        for number, piece in enumerate(curve.pieces, 1)
        for point in piece.in_order()
    ]


def _row(found: Response, point: CurvePoint, component: tuple[int, int]) -> dict[str, Any]:
    """One point as a row. Of several contact points, amplitudes and force are the largest.

    Harmonics and phase are those of the contact point and direction of `component`; the harmonics
    are multiples of the lowest frequency of the loads.
    """
    multiplier = judged_multiplier(point)
    main = point.harmonics[:, component[0], component[1]]
    return {
        column_name(found.scene, found.table.parameter): point.parameter,
        **named("amplitude_{}_m", directions(found), point.amplitude.max(axis=0)),
        **named("probe_amplitude_{}_m", "xyz", point.probe_amplitude),
        "phase_deg": float(np.degrees(np.angle(main[0]))),
        **{f"harmonic_{k}_m": float(abs(value)) for k, value in enumerate(main, 1)},
        **(contact_columns(point) if found.contacts else {}),
        "damping_dissipation_per_period_J": point.damping_dissipation,
        "stability": point.known_stability,
        "event": point.kind,
        "contact_point": None if point.contact < 0 else point.contact + 1,
        "periods": point.periods,
        "largest_multiplier": abs(multiplier),
        "multiplier_real": multiplier.real,
        "multiplier_imaginary": multiplier.imag,
        "free_sliders": point.free_sliders,
        "residual": point.residual,
        "marched_periods": point.marches[0],
        "marched_periods_with_derivatives": point.marches[1],
    }


def summary(found: Response) -> dict[str, Any]:
    """What `response.json` has of the curves."""
    table = found.table
    return {
        "parameter": table.parameter,
        "first": table.first,
        "last": table.last,
        "family": table.families.key if table.families else None,
        "coordinates": found.size,
        "steps_per_period": found.steps,
        "curves": [_curve_summary(found, curve) for curve in found.curves],
    }


def _curve_summary(found: Response, curve: ResponseCurve) -> dict[str, Any]:
    """The part of `response.json` about one curve."""
    component = largest_component(found)
    return {
        "value": curve.value,
        "points": len(curve.points),
        "ends": [piece.reason for piece in curve.pieces],
        "largest": _row(found, largest_point(found, curve), component),
        "events": [_row(found, point, component) for point in curve.special],
        "pieces": [
            {"origin": piece.origin, "periods": piece.periods, "points": len(piece.points)}
            for piece in curve.pieces
        ],
        "checks": [
            {
                "where": check.where,
                found.table.parameter: check.point.parameter,
                "quantity": check.quantity,
                "step_error": check.step_error,
                "basis_error": check.basis_error,
                "stability": check.point.verdict,
                "compared_with_a_richer_basis": check.compared,
                "stability_with_half_the_step": check.finer_verdict,
                "stability_with_a_richer_basis": check.richer_verdict,
            }
            for check in curve.checks
        ],
        "marched_periods": curve.marches[0],
        "marched_periods_with_derivatives": curve.marches[1],
        "seconds": curve.seconds,
        "optimum": optimum_summary(found, curve),
        "full_model": [_full_row(found, point) for point in curve.full],
    }


def _full_row(found: Response, point: FullPoint) -> dict[str, Any]:
    """One row that compares a motion of the full model with that of the reduced model."""
    names = directions(found)
    return {
        found.table.parameter: point.parameter,
        **named("full_amplitude_{}_m", names, point.amplitude.max(axis=0)),
        **named("reduced_amplitude_{}_m", names, point.reduced_amplitude.max(axis=0)),
        "relative_error": point.error,
        "stability_of_the_reduced_motion": point.verdict,
        "full_periods": point.periods,
        "full_periods_with_derivatives": point.derived,
        "residual": point.residual,
        "seconds": point.seconds,
    }


def full_rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response_full.csv`: the motions of the full model."""
    families = found.table.families
    return [
        ({} if families is None else {families.key: curve.value}) | _full_row(found, point)
        for curve in found.curves
        for point in curve.full
    ]
