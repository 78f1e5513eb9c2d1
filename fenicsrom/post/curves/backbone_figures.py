"""The figure of a damped nonlinear mode: frequency and damping ratio against amplitude."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.assess.curves.backbone import Backbone
from fenicsrom.post.base.style import COLOURS, new_panels, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDE = 20.0  # a range of amplitudes with this ratio of its ends needs a logarithmic axis
NO_DAMPING = 1e-9  # a largest damping ratio below this is rounding


@styled
def figure(found: Backbone) -> Figure:
    """Draw frequency and damping ratio of the mode, and the peaks of the forced response."""
    amplitude = 1e3 * np.array([point.amplitude[found.direction] for point in found.points])
    frequency = [point.frequency for point in found.points]
    damping = np.array([point.damping_ratio for point in found.points])
    drawn, (upper, lower) = new_panels(8.4, 6.6, 2, sharex=True)
    upper.plot(amplitude, frequency, color=COLOURS[0], label="nonlinear mode")
    if found.peaks:
        peaks = [(1e3 * peak.amplitude, peak.frequency) for peak in found.peaks]
        upper.plot(
            *zip(*peaks, strict=True),
            "o--",
            color=COLOURS[1],
            markerfacecolor="white",
            markersize=5,
            linewidth=1.0,
            label="peak of the forced response (× load factor)",
        )
        for k, (peak, place) in enumerate(zip(found.peaks, peaks, strict=True)):
            upper.annotate(
                f"× {peak.value:g}",
                place,
                xytext=(18, 4 + 10 * ((len(peaks) - 1 - k) % 4)),  # the next one is lower
                arrowprops={"arrowstyle": "-", "color": COLOURS[1], "linewidth": 0.5},
                textcoords="offset points",
                fontsize=8,
                color=COLOURS[1],
            )
        upper.legend(loc="best")
    upper.set_ylabel("frequency, Hz")
    shown = damping if np.max(np.abs(damping)) > NO_DAMPING else np.zeros_like(damping)
    lower.plot(amplitude, 100.0 * shown, color=COLOURS[0])
    if np.min(shown) >= 0.0:
        top = 100.0 * float(np.max(shown))
        lower.set_ylim(0.0, 1.1 * top if top > 0.0 else 1.0)
    lower.set_ylabel("damping ratio, %")
    axis = "xyz"[found.direction]
    lower.set_xlabel(f"amplitude of the probe along {axis}, mm")
    reached = [*amplitude, *(1e3 * peak.amplitude for peak in found.peaks)]
    if max(reached) > WIDE * min(reached):
        lower.set_xscale("log")
    drawn.align_ylabels([upper, lower])
    return drawn
