"""The wear of abradable layers: its numbers, sentence, table and picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.motion.wear import Wear, wear_of
from fenicsrom.post.base.style import Figure, new_panels, styled
from fenicsrom.post.base.writers import write_rows
from fenicsrom.scene import Scene

WEAR = "wear.csv"
FEW_RINGS = 4  # rings that have a line each; more rings are a map


def wear_summary(
    motions: Mapping[str, Motion], scene: Scene, points: ContactPoints
) -> dict[str, Any]:
    """The entry `wear` of `summary.json`; empty without abradable layers.

    Returns:
        For each model `largest_depth_m`, `worn_area_m_rad` (the largest integral of the depth over
        the angle of all rings), `worn_volume_m3`, `plastic_work_J`, `mean_torque_Nm` (the plastic
        work over the angle of rotation), and `wears_at_end` (whether a layer was worn in the last
        period).
    """
    found = {}
    for name, motion in motions.items():
        rings = wear_of(motion, scene, points)
        if rings and motion.end is not None:
            found[name] = {
                "largest_depth_m": max(float(np.max(one.depth)) for one in rings),
                "worn_area_m_rad": max(one.area for one in rings),
                "worn_volume_m3": sum(one.volume for one in rings),
                "plastic_work_J": sum(one.plastic_work for one in rings),
                "mean_torque_Nm": sum(one.mean_torque for one in rings),
                "wears_at_end": motion.end.wearing,
            }
    return {"wear": found} if found else {}


def wear_sentence(motion: Motion, scene: Scene, points: ContactPoints) -> str | None:
    """State what a motion wore; None without abradable layers."""
    found = wear_summary({"": motion}, scene, points)
    if not found:
        return None
    numbers = found["wear"][""]
    if not numbers["largest_depth_m"]:
        return "Abradable layer: not worn."
    torque, ends = numbers["mean_torque_Nm"], ""
    if motion.period is not None:
        wears = numbers["wears_at_end"]
        ends = "; still wearing at the end" if wears else "; no wear in the last period"
    return (
        f"Abradable layer: worn by at most {1e6 * numbers['largest_depth_m']:.4g} µm, "
        f"{1e9 * numbers['worn_volume_m3']:.4g} mm³ in all; plastic work "
        f"{numbers['plastic_work_J']:.4g} J"
        + (f", a mean torque of {torque:.4g} N m on the shaft" if torque else "")
        + f"{ends}."
    )


def write_wear(
    folder: Path, motions: Mapping[str, Motion], scene: Scene, points: ContactPoints
) -> list[Path]:
    """Write the worn depth of the reduced model at each node, if there is any.

    Raises:
        OSError: the file cannot be written.
    """
    rings = wear_of(motions["reduced"], scene, points) if "reduced" in motions else []
    rows = [
        {
            "ring": k + 1,
            "contact": one.ring.contact + 1,
            "position_m": one.ring.position,
            "angle_deg": np.degrees(angle),
            "depth_m": depth,
        }
        for k, one in enumerate(rings)
        for angle, depth in zip(one.ring.angle, one.depth, strict=True)
    ]
    return [write_rows(folder / WEAR, rows)] if rows else []


@styled
def plot_wear(found: Sequence[Wear]) -> Figure:
    """Draw the worn depth over the angle: a line for each of a few worn rings, or a map of many."""
    figure, (axis,) = new_panels(8.6, 3.6)
    worn = [one for one in found if np.any(one.depth)] or list(found[:1])
    worn = sorted(worn, key=lambda one: one.ring.position)
    if len(worn) <= FEW_RINGS:
        for one in worn:
            label = f"at {1e3 * one.ring.position:.4g} mm along the axis"
            degrees = np.append(np.degrees(one.ring.angle), 360.0)
            axis.plot(degrees, 1e6 * np.append(one.depth, one.depth[0]), label=label)
        axis.set(ylabel="worn depth, µm")
        axis.set_ylim(bottom=0.0)
        if len(worn) > 1:
            figure.legend(loc="outside upper right", ncols=len(worn))
    else:
        alike = [one for one in worn if one.ring.angle.size == worn[0].ring.angle.size]
        along = [1e3 * one.ring.position for one in alike]
        depth = 1e6 * np.array([one.depth for one in alike])
        degrees = np.degrees(alike[0].ring.angle)
        mesh = axis.pcolormesh(degrees, along, depth, cmap="viridis", shading="nearest")
        axis.set(ylabel="position along the axis, mm")
        axis.grid(visible=False)
        figure.colorbar(mesh, ax=axis, pad=0.01, label="worn depth, µm")
    axis.set(xlabel="angle around the axis, degrees", xlim=(0.0, 360.0))
    axis.set_xticks(np.arange(0.0, 361.0, 45.0))
    return figure


@styled
def plot_wear_over_time(time: Array, worn: Array, points: Sequence[int]) -> Figure:
    """Draw the worn depth (ns, P) before some points over the time (ns,), s."""
    figure, (axis,) = new_panels(8.6, 3.6)
    for p in points:
        axis.plot(time, 1e6 * worn[:, p], linewidth=1.0)
        axis.annotate(f"{p + 1}", (time[-1], 1e6 * worn[-1, p]), fontsize="x-small", va="center")
    axis.set(xlabel="time, s", ylabel="worn depth before each point, µm")
    axis.set_ylim(bottom=0.0)
    return figure
