"""The wear of an interaction map: its numbers and its picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.studies.interaction import LARGE, InteractionMap
from fenicsrom.assess.studies.map_line import Line
from fenicsrom.online.motion.wear import Wear, lobes_of, worn_profile
from fenicsrom.post.base.style import COLOURS, Figure, new_panels, styled


def wear_row(found: InteractionMap, line: Line) -> dict[str, Any]:
    """The wear of a line in `map.csv`; empty without abradable layers."""
    rings = [Wear(ring, ring.depth(line.worn), 0.0) for ring in found.rings]
    if not rings:
        return {}
    return {
        "worn_depth_m": float(line.worn.max()),
        "worn_depth_error": float(line.worn_errors.max()),
        "worn_area_m_rad": max(ring.area for ring in rings),
        "worn_volume_m3": sum(ring.volume for ring in rings),
        "worn_lobes": lobes_of(worn_profile(found.rings, line.worn)[1]) or None,
    }


def wear_sentence(found: InteractionMap) -> str:
    """State the largest worn depth."""
    line = max(found.lines, key=lambda line: float(line.worn.max()))
    if not line.worn.any():
        return "Abradable layer: not worn at any speed."
    first = "each speed" if found.scene.map.start == "rest" else "the first speed"
    return (
        f"Abradable layer: worn by at most {1e6 * line.worn.max():.4g} µm at {line.speed_rpm:g} "
        f"rpm, with an estimated error of {100 * line.worn_errors.max():.2g} % by the step; "
        f"{first} begins with a new layer."
    )


def profiles(found: InteractionMap, name: str) -> tuple[Array, Array]:
    """Angles (c,) in rad, and the largest of "worn" or "worn_errors" of all rings (s, c) there."""
    pairs = [worn_profile(found.rings, getattr(line, name)) for line in found.lines]
    return pairs[0][0], np.array([depth for _, depth in pairs])


def profile_rows(found: InteractionMap) -> list[dict[str, Any]]:
    """The rows of `map_wear.csv`: the worn depth at each angle, with a column for each speed."""
    angle, depth = profiles(found, "worn")
    names = ["angle_deg", *(f"{line.speed_rpm:g}_rpm_m" for line in found.lines)]
    table = np.column_stack([np.degrees(angle), depth.T])
    return [dict(zip(names, row, strict=True)) for row in table]


@styled
def wear_figure(found: InteractionMap, edges: Array) -> Figure:
    """Worn depth over speed and angle, the largest depth, and the number of lobes.

    Args:
        found: the map.
        edges: (s + 1,) the edges of the speeds, rev/min.
    """
    speeds, (angle, depth) = found.speeds_rpm, profiles(found, "worn")
    errors = found.column("worn_errors").max(axis=1)
    drawn, (shade, line, lobes) = new_panels(9.0, 7.0, 3, sharex=True, height_ratios=[3, 1.4, 1])
    sides = np.degrees(np.append(angle, 2.0 * np.pi) - 0.5 * angle[1])
    wrong = profiles(found, "worn_errors")[1] > LARGE
    mesh = shade.pcolormesh(
        edges, sides, np.where(wrong, np.nan, 1e6 * depth).T, cmap="viridis", rasterized=True
    )
    mesh.cmap.set_bad("#D9DDE1")
    drawn.colorbar(mesh, ax=shade, label="worn depth, µm")
    shade.set(ylabel="angle, degrees", ylim=sides[[0, -1]], yticks=np.arange(0.0, 361.0, 90.0))
    shade.grid(False)
    if wrong.any():
        shade.set_title(f"grey: estimated error above {100 * LARGE:g} % of the largest depth")
    largest = 1e6 * found.column("worn").max(axis=1)
    line.errorbar(speeds, largest, largest * errors, fmt=".-", color=COLOURS[0], capsize=2)
    line.set(ylabel="largest, µm")
    line.set_ylim(0.0, 1.1 * np.max(largest * (1.0 + errors)))
    counts = [wear_row(found, one)["worn_lobes"] or np.nan for one in found.lines]
    lobes.plot(speeds, counts, ".", color=COLOURS[0])
    most = np.nanmax(counts, initial=1.0)
    lobes.set(xlabel="speed, rpm", ylabel="lobes", xlim=speeds[[0, -1]], ylim=(0.0, most + 1.0))
    lobes.yaxis.get_major_locator().set_params(integer=True)
    lobes.ticklabel_format(axis="x", style="plain")
    return drawn
