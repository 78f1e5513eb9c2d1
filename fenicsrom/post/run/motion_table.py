"""The table of the responses of the models, and the notes on the contact points in it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fenicsrom.online.motion.measures import has_contact, point_summaries, response_summary
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.directions import in_order, millimetres
from fenicsrom.post.base.tables import table_of
from fenicsrom.scene import Scene

FEW_POINTS = 4  # largest number of contact points that have one picture each
PERIODS_NOTE = "Periods: the number of periods of the loads from the start of the run to its end."
SIZE_NOTE = "The size is the number of unknowns. Amplitudes are half of peak-to-peak over"
IMBALANCE_NOTE = (
    "The imbalance is the largest error of the energy balance relative to the largest energy of "
    "the motion."
)


def has_period(motions: Mapping[str, Motion]) -> bool:
    """Whether the motions have a period, which all models of a scene share."""
    return any(motion.period is not None for motion in motions.values())


def response_note(motions: Mapping[str, Motion]) -> str:
    """Explain the columns of `response_rows`."""
    if not has_period(motions):
        return f"{SIZE_NOTE} the whole motion. {IMBALANCE_NOTE}"
    return f"{SIZE_NOTE} the last period of the motion. {IMBALANCE_NOTE}"


def response_rows(
    motions: Mapping[str, Motion],
    sizes: Mapping[str, int],
    names: Sequence[str],
    probes: Mapping[str, Motion],
) -> list[list[Any]]:
    """Compose the table of responses; the first row is the header.

    Without contact there are no fractions, no force and no dissipation by friction. Without a
    period of the loads, nothing is counted in periods, and nothing becomes steady. The beam has no
    third direction.

    Args:
        motions: model name -> motion.
        sizes: model name -> number of unknowns.
        names: names of the directions.
        probes: model name -> motion of the probe, where it stands beside contact points.
    """
    repeats = has_period(motions)
    work = "J per period" if repeats else "J"
    rows = []
    for name, motion in motions.items():
        found = response_summary(motion)
        amplitudes = millimetres(in_order(found["amplitude_m"]))
        row = {"model": name, "size": sizes.get(name)}
        row |= {f"{direction} mm": None for direction in names}
        row |= {f"{direction} mm": a for direction, a in zip(names, amplitudes, strict=False)}
        if name in probes:
            moved = in_order(response_summary(probes[name])["amplitude_m"])
            texts = zip("xyz", millimetres(moved), strict=False)
            row |= {f"probe {axis} mm": text for axis, text in texts}
        contact = {
            **{f"{state} %": f"{100.0 * part:.1f}" for state, part in found["fraction"].items()},
            "peak N": f"{found['peak_normal_force_N']:.5g}",
            work: f"{found['friction_dissipation_per_period_J']:.5g}",
        }
        row |= contact if motion.force.shape[1] else dict.fromkeys(contact)
        if repeats:
            row |= {"periods": found["periods"], "steady": "yes" if found["steady"] else "no"}
        rows.append(row | {"imbalance": f"{found['energy_imbalance']:.1e}"})
    return table_of(rows)


def points_note(motions: Mapping[str, Motion], scene: Scene) -> str | None:
    """State to which contact points the numbers of the table belong; None if there is no choice."""
    touching = {name: motion for name, motion in motions.items() if has_contact(motion)}
    count = max((motion.state.shape[1] for motion in touching.values()), default=0)
    if not touching or (count < 2 and scene.probe is None):
        return None
    probe = " and of the probe" if scene.probe is not None else ""
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


def touching_points(motions: Mapping[str, Motion]) -> list[int]:
    """The numbers of the contact points that some motion presses in its last period."""
    pressed = [np.any(m.force[m.last_period(), :, 0] > 0.0, axis=0) for m in motions.values()]
    return sorted({int(point) for points in pressed for point in np.flatnonzero(points)})


def open_sentence(motions: Mapping[str, Motion]) -> str | None:
    """Name the contact points without a picture, which do not touch; None if all have a picture."""
    count = max((motion.force.shape[1] for motion in motions.values()), default=0)
    touching = touching_points(motions)
    if len(touching) == count or (touching and count > FEW_POINTS):
        return None
    listed = ", ".join(str(point + 1) for point in range(count) if point not in touching)
    which = (
        f"Contact points {listed} do"
        if count - len(touching) > 1
        else f"Contact point {listed} does"
    )
    return f"{which} not touch in the last period: there is no picture of the contact."
