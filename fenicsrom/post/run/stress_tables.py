"""Stresses and reactions as rows, sentences and files."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.stress.deformation import extremes
from fenicsrom.online.stress.reactions import Reactions
from fenicsrom.online.stress.stress_peaks import Peak, Stresses
from fenicsrom.post.base.tables import named, table_of
from fenicsrom.post.base.writers import write_rows

STRESSES = "stresses.csv"
MODAL_STRESSES = "modal_stresses.csv"
REACTIONS = "reactions.csv"

MEASURE_NAMES = {
    "second-piola-kirchhoff": "second Piola-Kirchhoff stress",
    "cauchy": "Cauchy stress",
}
RECOVERY_NOTE = (
    "Stresses at the vertices are extrapolated from the Gauss points of each cell, and averaged "
    "over the cells that meet there. The largest value at a Gauss point is not extrapolated: where "
    "the two differ much, the mesh is too coarse, or a corner or a point force makes the stress "
    "singular. Places are those in the undeformed body."
)
MODAL_NOTE = (
    "Modal stresses are the derivatives of the second Piola-Kirchhoff stress about the "
    "equilibrium, for a largest displacement of 1 mm of a vertex."
)
MPA = 1e-6
ROUNDING = 1e-9  # smaller forces relative to the others come from the tolerance of the equilibrium
PER_MM = 1e-3


def peak_record(peak: Peak) -> dict[str, Any]:
    """The numbers of a peak by name, with units."""
    modal = peak.frequency is not None
    unit = "Pa_per_m" if modal else "Pa"
    return {
        "state": peak.state,
        **({"frequency_Hz": peak.frequency} if modal else {"time_s": peak.time}),
        f"von_mises_{unit}": peak.von_mises,
        **named("{}_m", "xyz", peak.position),
        **named(f"principal_{{}}_{unit}", "123", peak.principal),
        f"gauss_von_mises_{unit}": peak.point_von_mises,
        **named("gauss_{}_m", "xyz", peak.point_position),
    }


def stress_summary(stresses: Stresses) -> dict[str, Any]:
    """The entries `stresses` and `reactions` of `summary.json`."""
    found: dict[str, Any] = {
        "stresses": {
            "measure": stresses.measure,
            "smallest_volume_ratio": extremes(stresses.deformations).volume_ratio,
            "largest": [peak_record(peak) for peak in stresses.peaks],
            "modes": [peak_record(peak) for peak in stresses.modes],
        },
        "reactions": {"equilibrium": reaction_record(stresses.reactions, 0)},
    }
    moving = stresses.motion_reactions
    if moving is not None:
        found["reactions"]["largest_force"] = reaction_record(moving, _largest(moving))
        found["reactions"]["mismatch"] = moving.mismatch
    return found


def reaction_record(reactions: Reactions, row: int) -> dict[str, Any]:
    """The reactions at one instant by name, with units."""
    places = dict(zip(reactions.supports, reactions.values[row], strict=True))
    places["by_momentum"] = reactions.by_momentum[row]
    parts = {name: named("{}", reactions.components, found) for name, found in places.items()}
    return {"time_s": float(reactions.time[row]), **parts}


def write_stresses(stresses: Stresses, folder: Path) -> list[Path]:
    """Write the tables of stresses and reactions as CSV.

    Raises:
        OSError: a file cannot be written.
    """
    files = [write_rows(folder / STRESSES, [peak_record(peak) for peak in stresses.peaks])]
    if stresses.modes:
        rows = [peak_record(peak) for peak in stresses.modes]
        files.append(write_rows(folder / MODAL_STRESSES, rows))
    return [*files, write_rows(folder / REACTIONS, _reaction_rows(stresses))]


def _reaction_rows(stresses: Stresses) -> list[dict[str, Any]]:
    """One row for the equilibrium, and one row for each instant of the last period."""
    moving = stresses.motion_reactions
    listed = [("equilibrium", reaction_record(stresses.reactions, 0) | {"time_s": None})]
    if moving is not None:
        listed += [("motion", reaction_record(moving, k)) for k in range(moving.time.size)]
    return [
        {"state": state, "time_s": record.pop("time_s")}
        | {f"{name}_{key}": v for name, found in record.items() for key, v in found.items()}
        for state, record in listed
    ]


def stress_rows(peaks: Sequence[Peak]) -> list[list[Any]]:
    """The table of the largest stresses for the report, in MPa."""
    return table_of(
        {
            "state": peak.state,
            "t s": None if peak.time is None else f"{peak.time:.6g}",
            "von Mises MPa": MPA * peak.von_mises,
            "at m": place_text(peak.position),
            "principal MPa": ", ".join(f"{MPA * value:.4g}" for value in peak.principal),
            "at a Gauss point MPa": MPA * peak.point_von_mises,
        }
        for peak in peaks
    )


def modal_rows(peaks: Sequence[Peak]) -> list[list[Any]]:
    """The table of the modal stresses for the report, in MPa per mm of largest displacement."""
    return table_of(
        {
            "mode": peak.state,
            "Hz": f"{peak.frequency:.5g}",
            "von Mises MPa/mm": MPA * PER_MM * peak.von_mises,
            "at m": place_text(peak.position),
            "at a Gauss point MPa/mm": MPA * PER_MM * peak.point_von_mises,
        }
        for peak in peaks
    )


def reaction_rows(stresses: Stresses) -> list[list[Any]]:
    """The table of the reactions for the report: the equilibrium and the largest force."""
    first = stresses.reactions
    names = [name.split("_") for name in first.components]
    heads = [f"{kind[0].upper()}{axis} {unit}" for kind, axis, unit in names]
    rows: list[list[Any]] = [["state", "t s", "support", *heads]]
    listed = [("equilibrium", first, 0)]
    moving = stresses.motion_reactions
    if moving is not None:
        listed.append(("largest force", moving, _largest(moving)))
    for state, reactions, row in listed:
        time = None if state == "equilibrium" else f"{reactions.time[row]:.6g}"
        for k, name in enumerate(reactions.supports):
            rows.append([state, time, name, *_without_rounding(reactions.values[row, k])])
        total = _without_rounding(reactions.by_momentum[row])
        rest = [None] * (len(first.components) - len(total))
        rows.append([state, time, "by momentum", *total, *rest])
    return rows


def reaction_note(stresses: Stresses) -> str:
    """Say what the reactions are, and how well the stresses agree with the momentum."""
    text = (
        "Reactions are the forces F of a support on the body, and the moments M about the centroid "
        "of its nodes, from the stresses in the cells at the support, inertia and loads. The "
        "forces by momentum are those that the motion of the whole body needs."
    )
    if stresses.motion_reactions is None:
        return text
    return (
        f"{text} During the last period the two differ by at most "
        f"{100.0 * stresses.motion_reactions.mismatch:.2g} % of the largest change of the force: "
        "what the basis does not resolve at the support. Trust the forces by momentum."
    )


def stress_sentences(stresses: Stresses) -> list[str]:
    """State the largest stress and the reactions in the terminal."""
    found = []
    for peak in stresses.peaks[:2]:
        if peak.von_mises == 0.0:
            continue  # the equilibrium without static loads
        when = "" if peak.time is None else f", t = {peak.time:.6g} s"
        found.append(
            f"Von Mises stress ({MEASURE_NAMES[stresses.measure]}), {peak.state}: "
            f"{MPA * peak.von_mises:.4g} MPa at {place_text(peak.position)} m{when}; "
            f"{MPA * peak.point_von_mises:.4g} MPa at a Gauss point."
        )
    return found


def place_text(position: Array) -> str:
    """A place as text, in m."""
    return f"({', '.join(f'{x + 0.0:.4g}' for x in np.round(position, 9))})"


def _without_rounding(values: Array) -> list[str]:
    """The numbers of a row as text; numbers below `ROUNDING` of the largest number are zero."""
    small = np.abs(values) < ROUNDING * np.abs(values).max(initial=0.0)
    return [f"{value:.6g}" for value in np.where(small, 0.0, values)]


def _largest(reactions: Reactions) -> int:
    """The instant of the largest sum of the forces by momentum."""
    return int(np.argmax(np.linalg.norm(reactions.by_momentum, axis=1)))
