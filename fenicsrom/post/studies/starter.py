"""The starter scene of `fenicsrom init`: a commented TOML file that runs at once."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np

from fenicsrom.fem.mesh.inspection import Group, Inspection
from fenicsrom.post.studies.mesh_report import scale_hint

CLAMPED = re.compile(r"root|fix|clamp|encastre|support|base|spc|mount|bolt|ground|hub", re.I)
"""Names of groups that are probably clamped."""

ON_PLANE = 1e-6
"""Facets at smaller distances from a plane, relative to the extent, lie on it."""


def starter_scene(found: Inspection, folder: Path) -> str:
    """Write a scene for a mesh.

    Args:
        found: a mesh that can be used.
        folder: folder of the scene, to which the path of the mesh is relative.
    """
    geometry, name = found.geometry, found.path.stem
    relative = os.path.relpath(found.path.resolve(), folder.resolve())
    lines = [
        f"# A first scene for {found.path.name}, with numbers to be replaced. Units are SI.",
        "#   fenicsrom modes SCENE   computes frequencies, mode shapes and pictures",
        "#   fenicsrom run SCENE     needs a load, see below",
        "# All keys: demos/keys.md of the program.",
        "",
        f"title = {_quoted(name)}",
        "",
        "[geometry]",
        f"mesh = {_quoted(relative)}",
        f"dimension = {geometry.dimension}",
        *_geometry_lines(found),
        "",
        "[material] # steel",
        "young = 2.1e11 # Pa",
        "poisson = 0.3",
        "density = 7850.0 # kg/m³",
        "mass_damping = 0.0 # 1/s: 2 ζ ω gives the damping ratio ζ at the frequency ω",
        "",
        *_support_lines(found),
        "",
        *_load_lines(found),
        "",
        "[basis]",
        "modes = 6",
        "",
    ]
    return "\n".join(lines)


def _geometry_lines(found: Inspection) -> list[str]:
    """Lines of [geometry] that depend on the file."""
    geometry, lines = found.geometry, []
    if geometry.dimension == 2:
        lines.append("thickness = 1.0 # m")
    if geometry.size is not None:
        lines.append(f"size = {geometry.size:g} # m, of the cells")
    if geometry.scale != 1.0:
        lines.append(f"scale = {geometry.scale:g} # m, the unit of the file")
    elif hint := scale_hint(found):
        lines.append(f"# scale = 1e-3 # {hint}")
    if any("of 6" in name or "of 8" in name or "of 10" in name for name in found.cells):
        lines.append("# curved = true # keeps the shape of quadratic cells")
    return lines


def _support_lines(found: Inspection) -> list[str]:
    """The table of one support, and the names of the other groups that could be a support."""
    assert found.boundary is not None
    most = len(found.boundary) // 2  # larger groups are probably the whole boundary
    facets = [group for group in found.groups if group.kind == "facets" and group.number <= most]
    likely = [group for group in facets if CLAMPED.search(group.name)]
    lines = ["[[supports]] # clamps a part of the boundary"]
    others = [group.name for group in facets]
    if likely:
        lines.append(f"group = {_quoted(likely[0].name)}")
        others.remove(likely[0].name)
    elif plane := _end_plane(found):
        point, normal = plane
        lines.append(f"plane = {{ point = {point}, normal = {normal} }} # an end of the body")
    elif facets:
        lines.append(f"group = {_quoted(others.pop(0))}")
    else:
        lines.append(f"box = {_end_box(found)} # an end of the body")
    if found.pieces > 1:
        lines.append(f"# the mesh has {found.pieces} pieces that share no node; clamp each of them")
    if others:
        lines.append(f"# other groups of facets: {', '.join(map(_quoted, others))}")
    return lines


def _end_plane(found: Inspection) -> tuple[list[float], list[float]] | None:
    """Point and normal of an end of the box on which whole facets lie, along its longest axis."""
    d, low, high = found.geometry.dimension, found.low, found.high
    for axis in np.argsort(-(high - low), kind="stable"):
        for end in (low[axis], high[axis]):
            if _facets_at(found, int(axis), float(end)):
                point = [0.0] * d
                point[axis] = float(f"{end:.12g}")
                return point, [float(k == axis) for k in range(d)]
    return None


def _facets_at(found: Inspection, axis: int, end: float) -> bool:
    """Whether a facet of the boundary lies on a plane normal to an axis."""
    assert found.points is not None and found.boundary is not None
    near = np.abs(found.points[:, axis] - end) <= ON_PLANE * found.extent
    corners = near[found.boundary]
    if found.geometry.dimension == 3:
        return bool(corners.all(axis=1).any())
    return bool((corners & np.roll(corners, 1, axis=1)).any())  # an edge of a cell


def _end_box(found: Inspection) -> list[list[float]]:
    """Corners of a box at the lower end of the longest axis, a tenth of the body long."""
    low, high = found.low.copy(), found.high.copy()
    axis = int(np.argmax(high - low))
    high[axis] = low[axis] + 0.1 * (high[axis] - low[axis])
    return [[float(f"{value:.6g}") for value in corner] for corner in (low, high)]


def _load_lines(found: Inspection) -> list[str]:
    """A load and a contact to be uncommented."""
    d = found.geometry.dimension
    thin = int(np.argmin(found.high - found.low))
    direction = [float(k == thin) for k in range(d)]
    place = _loaded(found)
    return [
        "# [[loads]] # a harmonic force",
        f"# {place}",
        f"# direction = {direction}",
        "# force = 1.0 # N",
        "# frequency = 10.0 # Hz, near one of the frequencies of `fenicsrom modes`",
        "",
        "# [[contacts]] # a point that rubs against a plane",
        f"# {place}",
        f"# normal = {direction} # into the plane",
        "# preload = 1.0 # N",
        "# normal_stiffness = 1e6 # N/m",
        "# tangential_stiffness = 1e6 # N/m",
        "# friction = 0.3",
    ]


def _loaded(found: Inspection) -> str:
    """The key of a place for a load: a group that is probably not clamped, or the far corner."""
    named: list[Group] = [
        group for group in found.groups if group.kind == "facets" and not CLAMPED.search(group.name)
    ]
    if named:
        return f"group = {_quoted(min(named, key=lambda group: group.number).name)}"
    return f"nearest = {[float(f'{value:.6g}') for value in found.high]}"


def _quoted(text: str) -> str:
    """A text as a TOML string."""
    return json.dumps(text, ensure_ascii=False)
