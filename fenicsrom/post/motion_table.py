"""The table of the responses of the models, and the notes below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.measures import NEGLIGIBLE, has_contact, point_summaries, response_summary
from fenicsrom.online.motion import Motion
from fenicsrom.post.directions import direction_names
from fenicsrom.post.tables import text_table

if TYPE_CHECKING:
    from fenicsrom.scene import Scene

RESPONSE_HEAD = (
    "open %",
    "slip %",
    "stick %",
    "peak N",
    "J per period",
    "periods",
    "steady",
    "imbalance",
)
PERIODS_NOTE = "Periods: the number of periods of the loads from the start of the run to its end."
RESPONSE_NOTE = (
    "The size is the number of unknowns. Amplitudes are half of peak-to-peak over the last period "
    "of the motion. The imbalance is the largest error of the energy balance relative to the "
    f"largest energy of the motion. {PERIODS_NOTE}"
)


def millimetres(values: Sequence[float] | Array, digits: int = 5) -> list[str]:
    """Displacements given in m as texts in mm; 0 for one that is rounding beside the largest."""
    largest = float(np.max(np.abs(values), initial=0.0))
    return [f"{1e3 * v:.{digits}g}" if abs(v) > NEGLIGIBLE * largest else "0" for v in values]


def response_rows(
    motions: Mapping[str, Motion], sizes: Mapping[str, int], scene: Scene
) -> list[list[Any]]:
    """Compose the table of responses; the first row is the header.

    Without contact there are no fractions, no force and no dissipation by friction. The beam has no
    third direction.
    """
    names = direction_names(scene)
    directions = [f"{name} mm" for name in [*names[1:], names[0]]]
    rows: list[list[Any]] = [["model", "size", *directions, *RESPONSE_HEAD]]
    for name, motion in motions.items():
        r = response_summary(motion)
        size = r["amplitude_m"]
        *amplitude, normal = millimetres([*size["tangential"], size["normal"]])
        missing = [None] * (len(names) - 1 - len(amplitude))
        contact: list[str | None] = [
            *(f"{100.0 * r['fraction'][state]:.1f}" for state in ("open", "slip", "stick")),
            f"{r['peak_normal_force_N']:.5g}",
            f"{r['dissipated_per_period_J']:.5g}",
        ]
        rows.append(
            [
                name,
                sizes.get(name),
                *amplitude,
                *missing,
                normal,
                *(contact if motion.force.shape[1] else [None] * len(contact)),
                r["periods"],
                "yes" if r["steady"] else "no",
                f"{r['energy_imbalance']:.1e}",
            ]
        )
    return rows


def response_table(motions: Mapping[str, Motion], sizes: Mapping[str, int], scene: Scene) -> str:
    """Compose the table of responses with its notes for the terminal; empty without a motion."""
    if not motions:
        return ""
    notes = filter(None, [points_note(motions, scene), PERIODS_NOTE])
    return "\n".join([text_table(response_rows(motions, sizes, scene)), *notes])


def points_note(motions: Mapping[str, Motion], scene: Scene) -> str | None:
    """State to which contact points the numbers of the table belong; None if there is no choice."""
    touching = {name: motion for name, motion in motions.items() if has_contact(motion)}
    count = max((motion.state.shape[1] for motion in touching.values()), default=0)
    if count < 2 and (not touching or scene.probe is None):
        return None
    probe = ", not of the probe" if scene.probe is not None else ""
    if count < 2:
        return f"Amplitudes are those of the contact point{probe}."
    hardest = {}
    for name, motion in touching.items():
        peaks = [point["peak_normal_force_N"] for point in point_summaries(motion)]
        if len(peaks) > 1:
            hardest[name] = 1 + int(np.argmax(peaks))
    of = {f"{point}" for point in hardest.values()}
    peak = of.pop() if len(of) == 1 else ", ".join(f"{p} ({name})" for name, p in hardest.items())
    return (
        f"Amplitudes are those of contact point 1{probe}; open, slip and stick are means over "
        f"{count} points; the peak force is that of point {peak}."
    )
