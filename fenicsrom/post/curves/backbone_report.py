"""The report of a damped nonlinear mode: sentences, tables and files."""

from typing import Any

import numpy as np

from fenicsrom.assess.curves.backbone import Backbone, ModePoint
from fenicsrom.assess.errors.verdicts import in_percent
from fenicsrom.notes import AMPLITUDES, DAMPING_RATIOS, FREQUENCIES, PEAKS
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS
from fenicsrom.post.base.tables import Quantity, components, rows_of, table_of
from fenicsrom.post.curves.response_figures import CONTACT, PEAK
from fenicsrom.words import counted

AMPLITUDES_NOTE = (
    "The linear amplitude is that of the probe in a motion of the linear mode with the same modal "
    "coordinate; backbone.first and backbone.last are linear amplitudes. The amplitude of the "
    "probe is half of peak-to-peak of the nonlinear motion, in which other modes take part."
)


LINEAR = Quantity("linear_amplitude_m", "linear_amplitude", "linear amplitude, mm", 4)
FREQUENCY = Quantity("frequency_Hz", "frequency", "frequency, Hz", 7)
DAMPING = Quantity("damping_ratio", head="damping ratio, %", digits=4)
PEAKS_OVER = (
    Quantity("load_factor", "value", "load factor"),
    *PEAK,
    Quantity("residual", "point.residual"),
)


def quantities(found: Backbone) -> list[Quantity]:
    """What is told of each point."""
    return [
        *(LINEAR, Quantity("modal_amplitude_sqrtkg_m", "modal_amplitude"), FREQUENCY, DAMPING),
        *components("amplitude_{}_m", "amplitude", "xyz"[: found.scene.geometry.dimension]),
        *(one.inside("motion") for one in CONTACT if found.contacts),
        Quantity("residual", "motion.residual"),
    ]


def summary(found: Backbone) -> dict[str, Any]:
    """What `backbone.json` has of a nonlinear mode."""
    shown, told = quantities(found), (found.points[0], found.points[-1], _most_damped(found))
    errors = [
        Quantity("point", lambda error: error.point + 1),
        Quantity(LINEAR.key, lambda error: LINEAR.value(found.points[error.point])),
        *(Quantity("frequency_relative", "frequency"), Quantity("damping_ratio")),
    ]
    return {
        "mode": found.table.mode,
        "linear_frequency_Hz": found.mode.omega / (2.0 * np.pi),
        "linear_damping_ratio": found.mode.damping_ratio,
        "probe_direction": "xyz"[found.direction],
        "coordinates": found.size,
        "labels": list(found.labels),
        "basis_error": found.basis_error,
        "steps_per_period": found.steps,
        "points": len(found.points),
        "end": found.reason,
        **dict(zip(("first", "last", "largest_damping"), rows_of(told, shown), strict=True)),
        "step_errors": rows_of(found.step_errors, errors),
        "peaks": rows_of(found.peaks, PEAKS_OVER),
    }


def _most_damped(found: Backbone) -> ModePoint:
    """The point with the largest damping ratio."""
    return max(found.points, key=lambda point: point.damping_ratio)


def sentences(found: Backbone) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    first, last, top = found.points[0], found.points[-1], _most_damped(found)
    lines = [
        f"{counted(len(found.points), 'point')} in {found.seconds:.1f} s: from "
        f"{_words(found, first)} to {_words(found, last)}."
    ]
    if top.damping_ratio > NO_DAMPING:
        lines.append(f"Largest damping ratio {DAMPING.text(top)}, at {_words(found, top)}.")
    if found.basis_error is not None:
        lines.append(
            "With all coordinates that the model holds, frequency and amplitude of the largest "
            f"motion differ by an estimated {in_percent(found.basis_error)} from those of its "
            f"{counted(found.size, 'coordinate')}."
        )
    if found.step_errors:
        frequency = max(abs(error.frequency) for error in found.step_errors)
        damping = max(abs(error.damping_ratio) for error in found.step_errors)
        lines.append(
            f"Half the time step changes the frequency by at most {100.0 * frequency:.2g} % and "
            f"the damping ratio by at most {100.0 * damping:.2g} percentage points, at "
            f"{counted(len(found.step_errors), 'point')}."
        )
    lines += filter(None, [found.mesh_check.sentence()])
    if found.reason != "end of the range":
        lines.append(f"The curve is incomplete: {found.reason}.")
    return lines


def _words(found: Backbone, point: ModePoint) -> str:
    """Frequency and amplitude of a point."""
    amplitude = 1e3 * float(point.amplitude[found.direction])
    return (
        f"{FREQUENCY.text(point)} (probe {amplitude:.4g} mm along {'xyz'[found.direction]}, linear "
        f"amplitude {LINEAR.text(point)})"
    )


def report(found: Backbone) -> Report:
    """The report of a nonlinear mode: `backbone.csv`, `backbone.json` and `backbone.png`."""
    drawn = Picture("Nonlinear mode", "backbone.png", lambda: figure(found), CAPTION, NUMBERS)
    return Report(
        "backbone",
        title=f"nonlinear mode {found.table.mode}",
        found=found,
        sentences=sentences(found),
        sections=[Section("Peaks of the forced response", [table_of(found.peaks, PEAKS_OVER)])],
        rows=rows_of(found.points, quantities(found)),
        summary=summary(found),
        pictures=[drawn],
        notes=[AMPLITUDES_NOTE],
        quantities=[FREQUENCIES, DAMPING_RATIOS, AMPLITUDES, *([PEAKS] if found.peaks else [])],
    )


NUMBERS, CAPTION = "backbone.csv", "Frequency and damping of the mode over its amplitude."
WIDE = 20.0  # a range of amplitudes with this ratio of its ends needs a logarithmic axis
NO_DAMPING = 1e-9  # a largest damping ratio below this is rounding


def figure(found: Backbone) -> Plot:
    """Frequency and damping ratio of the mode, and the peaks of the forced response."""
    amplitude = 1e3 * np.array([point.amplitude[found.direction] for point in found.points])
    frequency, damping = FREQUENCY.column(found.points), DAMPING.column(found.points)
    items: list[Item] = [Line(amplitude, frequency, label="nonlinear mode")]
    peaks = [(1e3 * peak.amplitude, peak.frequency) for peak in found.peaks]
    if peaks:
        look: dict[str, Any] = {"color": COLOURS[1], "marker": "o", "hollow": True}
        look["label"] = "peak of the forced response (× load factor)"
        x, y = zip(*peaks, strict=True)
        items.append(Line(x, y, "--", linewidth=1.0, **look))
        for k, (peak, place) in enumerate(zip(found.peaks, peaks, strict=True)):
            shift = (18.0, 4.0 + 10.0 * ((len(peaks) - 1 - k) % 4))  # the next one is lower
            leader: dict[str, Any] = {"leader": True, "color": COLOURS[1], "fontsize": 8.0}
            items.append(Text(*place, f"× {peak.value:g}", shift=shift, **leader))
    shown = damping if np.max(np.abs(damping)) > 100.0 * NO_DAMPING else np.zeros_like(damping)
    top = float(np.max(shown))
    ends: Any = (0.0, 1.1 * top if top > 0.0 else 1.0) if np.min(shown) >= 0.0 else (None, None)
    reached = [*amplitude, *(size for size, _ in peaks)]
    log = "x" if max(reached) > WIDE * min(reached) else ""
    across = f"amplitude of the probe along {'xyz'[found.direction]}, mm"
    panels = [
        Panel(items, "", FREQUENCY.label, log=log),
        Panel([Line(amplitude, shown)], across, DAMPING.label, log=log, ylim=ends),
    ]
    return Plot(panels, 8.4, 6.6, share="x")
