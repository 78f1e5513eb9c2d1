"""The peaks of response curves over a second number: sentences, table, rows and picture."""

from typing import Any

from fenicsrom.assess.curves.peaks import largest_peaks
from fenicsrom.assess.curves.response_results import Response, ResponseCurve
from fenicsrom.assess.errors.verdicts import in_percent
from fenicsrom.online.curves.forced_peak import ForcedPeak
from fenicsrom.post.base.style import Figure, new_panels, styled
from fenicsrom.post.base.tables import table_of
from fenicsrom.post.curves.backbone_report import WIDE
from fenicsrom.post.curves.response_figures import colour_of, curve_name, family, key_label
from fenicsrom.scene.reading.units import column_name, in_words, unit_of
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
        | _row(found, peak)
        | {"smallest": smallest}
        for curve, peak, smallest in _each(found)
    ]


def _row(found: Response, peak: ForcedPeak) -> dict[str, Any]:
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
        **_row(found, best.peak),
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
