"""Meshes and scenes of small disks, whole or as one sector."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from scipy.spatial.transform import Rotation

from fenicsrom import make_scene

N = 6
CYCLIC = {"sectors": N, "left": "left", "right": "right"}
SLIT = 1e-4
"""Angle between the end of a shroud and the cut face, rad."""
PERIODS = {"steps_per_period": 40, "periods": 2, "steady_tolerance": 0.0}
"""Two marched periods."""
STEEL = {"young": 2.1e11, "poisson": 0.3, "density": 7800.0}


def turned(points: Any, j: float) -> Any:
    """Points in space after j sectors."""
    return Rotation.from_rotvec([0.0, 0.0, 2.0 * np.pi * j / N]).apply(points)


def copied(points: Any, cells: Any, copies: int) -> tuple[Any, Any]:
    """Some neighbouring sectors with common nodes."""
    every = np.concatenate([turned(points, j) for j in range(copies)])
    _, first, of = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    return every[first], np.concatenate([of[cells + j * len(points)] for j in range(copies)])


def ring() -> tuple[Any, Any]:
    """A plane sector of quadrilaterals, r = 0.1 to 0.3 m."""
    angle, radius = np.linspace(0.0, 2.0 * np.pi / N, 3), np.linspace(0.1, 0.3, 3)
    at = np.array([(x * np.cos(a), x * np.sin(a), 0.0) for a in angle for x in radius])
    number = np.arange(len(at)).reshape(3, -1)
    cells = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    return at, np.stack([part.ravel() for part in cells], axis=1)


def bladed() -> tuple[Any, Any]:
    """The ring with a blade of 0.3 m, 21 mm thick, on each sector."""
    half, middle = np.radians(2.0), np.pi / N
    angle, radius = [0.0, middle - half, middle + half, 2.0 * middle], [0.1, 0.3]
    at = [(x * np.cos(a), x * np.sin(a), 0.0) for a in angle for x in radius]
    root, along = np.array([at[3], at[5]]), np.array([np.cos(middle), np.sin(middle), 0.0])
    for x in np.linspace(0.0, 0.3, 5)[1:]:
        at += [*(root + x * along)]
    cells = [(2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2) for k in range(3)]
    edges = [(3, 5), *((8 + 2 * k, 9 + 2 * k) for k in range(4))]
    cells += [(*inner[::-1], *outer) for inner, outer in pairwise(edges)]
    return np.array(at), np.array(cells)


def shrouded(gaps: tuple[float, float] = (SLIT, SLIT)) -> tuple[Any, Any, dict[str, Any]]:
    """The bladed ring with a shroud from each tip to the neighbours', and the sets of its ends.

    `gaps` are the angles from its lower and upper corners to the cut faces, rad.
    """
    points, cells = bladed()
    middle, found, rows, ends = np.pi / N, [*points], [*cells], {}
    for name, side, inner in (("ahead", 1.0, (13, 15)), ("behind", -1.0, (12, 14))):
        radii = np.linalg.norm(points[[*inner]], axis=1)
        for part in (0.5, 1.0):
            outer = len(found), len(found) + 1
            angles = [middle + side * part * (middle - gap) for gap in gaps]
            found += [polar(*place) for place in zip(radii, angles, strict=True)]
            quad = (*inner, *outer[::-1])
            rows.append(quad if side > 0.0 else quad[::-1])
            inner = outer
        ends[name] = np.array(inner)
    return np.array(found), np.array(rows), ends


def wedged() -> tuple[Any, Any, dict[str, Any]]:
    """The shrouded disk with a wedge between neighbours, which the rotation presses on both."""
    gaps = 0.08, 0.04
    points, cells, ends = shrouded(gaps)
    radii, first = np.linalg.norm(points[[*ends["ahead"]]], axis=1), len(points)
    wedge = [
        polar(radius, 2.0 * np.pi / N + side * (gap - SLIT))
        for side in (-1.0, 1.0)
        for radius, gap in zip(radii, gaps, strict=True)
    ]
    sides = {"low": np.array([first, first + 1]), "high": np.array([first + 2, first + 3])}
    more = (first, first + 1, first + 3, first + 2)
    return np.append(points, wedge, 0), np.append(cells, [more], 0), ends | sides


def extruded(mesh: tuple[Any, Any, dict[str, Any]]) -> tuple[Any, Any, dict[str, Any]]:
    """A plane mesh as hexahedra of 20 mm."""
    points, cells, ends = mesh
    n = len(points)
    both = np.concatenate([points, points + np.array([0.0, 0.0, 0.02])])
    sets = {name: np.append(nodes, nodes + n) for name, nodes in ends.items()}
    return both, np.concatenate([cells, cells + n], axis=1), sets


def polar(radius: float, angle: float) -> Any:
    """A place in the plane."""
    return radius * np.array([np.cos(angle), np.sin(angle), 0.0])


def hub() -> tuple[Any, Any]:
    """A sector of a hexagonal plate as three tetrahedra, with nodes on the axis."""
    flat = np.array([(0.0, 0.0), (0.3, 0.0), (0.15, 0.15 * np.sqrt(3.0))])
    points = np.array([(*x, z) for z in (0.0, 0.05) for x in flat])
    return points, np.array([(0, 1, 2, 5), (0, 4, 1, 5), (0, 3, 4, 5)])


def scene_of(
    path: Path, points: Any, cells: Any, on_right: Any = False, ends: Any = None, **more: Any
) -> Any:
    """The scene of a mesh with the node sets left, right, bore, rim, and those of `ends`."""
    d = 2 if cells.shape[1] == 4 and not points[:, 2].any() else 3
    angle = np.arctan2(points[:, 1], points[:, 0]) % (2.0 * np.pi)
    radius = np.hypot(points[:, 0], points[:, 1])
    on_axis = radius < 1e-9
    sets = {
        "right": (np.abs(angle) < 1e-6) | on_axis | on_right,
        "left": (np.abs(angle - 2.0 * np.pi / N) < 1e-6) | on_axis,
        "bore": radius < 0.11,
        "rim": radius > 0.29,
    }
    sets |= {name: np.isin(np.arange(len(points)), nodes) for name, nodes in (ends or {}).items()}
    kind = "quad" if d == 2 else {4: "tetra", 8: "hexahedron"}[cells.shape[1]]
    data = {name: marks.astype(int) for name, marks in sets.items()}
    meshio.Mesh(points, [(kind, cells)], point_data=data).write(path / "disk.vtk")
    thick = {"thickness": 0.02} if d == 2 else {}
    tables: dict[str, Any] = {
        "geometry": {"mesh": "disk.vtk", "dimension": d, "degree": 2, **thick},
        "material": STEEL,
        "supports": [{"group": "rim" if kind == "tetra" else "bore"}],
        "probe": {"nearest": [0.2, 0.1] if d == 2 else [0.0, 0.0, 0.05]},
    }
    return make_scene(folder=path, **(tables | more))


def pushes(order: int, sectors: range, place: Any, along: Any, force: float) -> list[Any]:
    """Loads of an engine order at a place (1, 3) of some sectors, along directions that turn."""
    return [
        {
            **{"nearest": turned(place, j)[0, :2].tolist(), "force": force},
            **{"direction": turned(along, j)[0, :2].tolist(), "engine_order": order},
            "phase": 2.0 * np.pi * order * j / N,
        }
        for j in sectors
    ]


def spinning(d: int, coriolis: bool = True) -> dict[str, Any]:
    """The table of a rotation about z."""
    axis = {"axis": [0.0, 0.0, 1.0]} if d == 3 else {}
    return {"speed_rpm": 20_000.0, "coriolis": coriolis, **axis}
