"""The report of a ring-down: sentences, table, picture and files."""

import numpy as np

from fenicsrom.assess.studies.ringdown import Ringdown
from fenicsrom.notes import AMPLITUDES, DAMPING_RATIOS, FREQUENCIES
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Line, Panel, Plot
from fenicsrom.post.base.tables import Quantity, rows_of, table_of
from fenicsrom.post.curves.backbone_report import DAMPING, FREQUENCY, LINEAR
from fenicsrom.words import counted

SHOWN = 12  # most periods of the table in the terminal and on the page
TOLD = (
    *(Quantity("period", "number", "period"), LINEAR, FREQUENCY, DAMPING),
    Quantity("friction_dissipation_per_period_J", "friction_dissipation", "friction dissipates, J"),
    Quantity("damping_dissipation_per_period_J", "damping_dissipation", "damping dissipates, J"),
)


def sentences(found: Ringdown) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    first, last = (
        f"{FREQUENCY.text(one)} and {DAMPING.text(one)} at {LINEAR.text(one)}"
        for one in (found.periods[0], found.periods[-1])
    )
    lines = [
        f"{counted(len(found.periods), 'period')} in {found.seconds:.1f} s: frequency and damping "
        f"ratio from {first} to {last} of linear amplitude."
    ]
    lines += [
        f"With {name}, the frequency changes by at most {100.0 * one['frequency_relative']:.2g} % "
        f"and the damping ratio by at most {100.0 * one['damping_ratio']:.2g} percentage points."
        for name, one in found.changes.items()
    ]
    return lines + list(filter(None, [found.mesh_check.sentence()]))


def report(found: Ringdown) -> Report:
    """The report of a ring-down: `ringdown.csv`, `ringdown.json` and `ringdown.png`."""
    periods = found.periods
    shown = periods[:: 1 + len(periods) // SHOWN]
    summary = {
        "mode": found.scene.ringdown.mode,
        "linear_frequency_Hz": found.mode.omega / (2.0 * np.pi),
        "linear_damping_ratio": found.mode.damping_ratio,
        "probe_direction": "xyz"[found.direction],
        "coordinates": found.size,
        "steps_per_period": found.steps,
        "largest_changes": found.changes,
    }
    drawn = Picture("Ring-down", "ringdown.png", lambda: figure(found), CAPTION, "ringdown.csv")
    return Report(
        "ringdown",
        title=f"ring-down of mode {found.scene.ringdown.mode}",
        found=found,
        sentences=sentences(found),
        sections=[Section("Periods", [table_of(shown, TOLD)])],
        rows=rows_of(periods, TOLD),
        summary=summary,
        pictures=[drawn],
        quantities=[FREQUENCIES, DAMPING_RATIOS, AMPLITUDES],
    )


CAPTION = "The decay, and the frequency and damping of its periods over their amplitude."


def figure(found: Ringdown) -> Plot:
    """The decay, and frequency and damping ratio over the amplitude."""
    (time, displacement), periods = found.curve, found.periods
    label = f"probe along {'xyz'[found.direction]}\nin the mode, mm"
    panels = [Panel([Line(time, 1e3 * displacement, linewidth=0.8)], "time, s", label)]
    damping = 1.1 * np.append(DAMPING.column(periods), 0.0)
    ends = (None, None), (float(damping.min()), float(damping.max()))
    for quantity, ylim in zip((FREQUENCY, DAMPING), ends, strict=True):
        curve = Line(LINEAR.column(periods), quantity.column(periods), marker=".")
        panels.append(Panel([curve], LINEAR.head, quantity.label, ylim=ylim))
    return Plot(panels, 8.4, 8.8)
