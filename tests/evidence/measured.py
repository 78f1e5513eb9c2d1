"""Frequencies and damping that others measured, beside those of this program before any fit.

    python3 tests/evidence/measured.py

prints the tables of tests/README.md. The panel is a curved fan blade, clamped at one curved edge
(Olson and Lindberg, J. Sound Vib. 19, 1971). The beam is a slim Brake-Reuss beam, free at both
ends: two bars, whose ends overlap between three bolts (Chen et al., Mech. Syst. Signal Process.
166, 2022, 108401). Nothing is tuned to the measurements: the constants below are dimensions and
materials of the sources, or assumptions that say so.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import meshio
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

import fenicsrom
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, parse_scene

Array = NDArray[np.float64]

PANEL = [86.6, 135.5, 258.9, 350.6, 395.2, 531.1, 743.2]
"""Measured frequencies of the panel, Hz."""

BEAM = [80.47, 297.66, 580.66, 845.7, 1526.8, 1764.8], [221.7]
"""Measured frequencies of the beam in Hz, which bend it across and along the lap.

221.7 Hz is printed by the source. The others are the peaks of its record of a hammer blow across
the lap (github.com/mattiacenedese/BRBtesting, HammerImpact.mat).
"""

LENGTH, WIDTH, HEIGHT, LAP = 0.72, 0.0254, 0.0127, 0.12
"""Of the beam, m."""

BOLTS, WASHER = (-0.03, 0.0, 0.03), 0.01746
"""Places of the bolts along the lap, and outer diameter of their washers, m."""

BOLT_FORCE = 12249.0
"""Tension of each bolt in N, an assumption: that of a published model of a beam twice as thick.

Surfaces without gaps close in the same places under any tension: it changes no linear frequency.
"""

BOLT_MASS = 0.022
"""Mass of a bolt of 5/16 in with nut and washers in kg, by its size, less the steel of its hole."""

JOINT = {"stiffness": 2e13, "friction": 0.3, "bolt": BOLT_FORCE}
"""Assumptions: the normal stiffness of the contact in N/m3, a penalty, with half of it along the
faces; its friction; and the tension of each bolt in N.
"""

OTHERS: list[dict[str, float]] = [{}, {"bolt": 6000.0}, {"stiffness": 2e12}, {"friction": 0.6}]
"""What the damping is computed for: `JOINT`, and other values in place of one of it."""

DAMPING = [
    (0.020, 80.37, 0.149),
    (0.079, 80.19, 0.195),
    (0.158, 80.14, 0.302),
    (0.236, 80.39, 0.455),
    (0.315, 80.53, 0.634),
]
"""Measured at the drive in the first mode: amplitude, mm, frequency, Hz, damping ratio, %."""

STEPS = 50
"""Time steps in a period."""

DRIVE = 0.0762
"""Distance of the drive from an end, m."""

ONE_WAY = 0.9
"""A mode bends the beam one way if the motion along this axis has this part of its mass."""


def frequencies(table: dict[str, Any], folder: Path, count: int) -> tuple[Array, Array]:
    """The lowest elastic frequencies (count,) of a scene in Hz, and the mass along each axis."""
    scene = parse_scene(table, "measured", folder, unloaded=True)
    body = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), free=True)
    found = component_modes(body, Basis(modes=count, masters=4))
    modes = found.normal
    along = [modes * axis[:, None] for axis in body.translations().T]
    shares = [np.diag(body.mass_inner(part, part)) for part in along]
    return found.frequencies_hz, np.array(shares).T


def panel(cells: int) -> Array:
    """Frequencies of the panel in Hz, of one layer of `cells` x `cells` quadratic hexahedra."""
    geometry = {"mesh": "panel.geo", "dimension": 3, "parameters": {"cells": cells}}
    table = {
        "geometry": geometry,
        "material": {"young": 206.84e9, "poisson": 0.3, "density": 7747.7},
        "geometrically_nonlinear": False,
        "supports": [{"group": "root"}],
        "probe": {"nearest": [0.0, 0.6096, 0.3048]},
    }
    return frequencies(table, Path(__file__).parent, len(PANEL))[0]


def box(x: Array, y: Array, z: Array) -> tuple[Array, Any]:
    """Points and hexahedra of a grid."""
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(len(x), len(y), len(z))
    a, b = number[:-1, :-1], number[1:, :-1]
    c, d = number[1:, 1:], number[:-1, 1:]
    sides = [part[:, :, k] for k in (slice(None, -1), slice(1, None)) for part in (a, b, c, d)]
    return points, np.stack([side.ravel() for side in sides], axis=1)


def bars(refine: int, lap: bool) -> tuple[Array, Any, Array]:
    """Points, hexahedra and body (0 or 1) of each point of the bars; all in one if not `lap`."""
    edges = np.concatenate([[place - WASHER / 2, place, place + WASHER / 2] for place in BOLTS])
    inner = divided(np.concatenate([[-LAP / 2], edges, [LAP / 2]]), refine)
    arm = np.linspace(LAP / 2, LENGTH / 2, 9)
    left, right = np.sort(-arm), arm
    below, above = (np.array(y) for y in ([-HEIGHT / 2, 0.0], [0.0, HEIGHT / 2]))
    z = np.array([-WIDTH / 2, -0.4 * WASHER, 0.0, 0.4 * WASHER, WIDTH / 2])
    z = divided(z, max(1, refine // 2))
    parts = [
        [(left, below), (left, above), (inner, below)],
        [(right, below), (right, above), (inner, above)],
    ]
    parts = parts if lap else [[*parts[0], *parts[1]]]
    return merged([[(x, y, z) for x, y in part] for part in parts])


def merged(bodies: Any) -> tuple[Array, Any, Array]:
    """Points, hexahedra and body of each point of bodies, each of grids (x, y, z) that touch."""
    points, cells, body = [], [], []
    for k, boxes in enumerate(bodies):
        found = [box(*grid) for grid in boxes]
        sizes = np.cumsum([0, *(len(x) for x, _ in found)])
        every = np.concatenate([x for x, _ in found]).round(9)
        own, of = np.unique(every, axis=0, return_inverse=True)
        first = sum(map(len, points))
        cells += [first + of.ravel()[n + c] for n, (_, c) in zip(sizes, found, strict=False)]
        points.append(own)
        body.append(np.full(len(own), k))
    return np.concatenate(points), np.concatenate(cells), np.concatenate(body)


def divided(x: Array, parts: int) -> Array:
    """A grid with each interval divided."""
    steps = np.arange(parts) / parts
    return np.append((x[:-1, None] + np.diff(x)[:, None] * steps).ravel(), x[-1])


def scene_of(folder: Path, refine: int, lap: bool = True, **joint: float) -> dict[str, Any]:
    """The scene of the beam, whose mesh is written to a folder.

    Args:
        folder: the folder.
        refine: cells of the lap along the beam, relative to the coarsest mesh.
        lap: False makes the beam of one piece, without bolts.
        joint: other values than those of `JOINT`.
    """
    points, cells, body = bars(refine, lap)
    x, y, z = points.T
    near = np.abs(x) < LAP / 2 + 1e-9
    sets = {"upper": near & (y == 0.0) & (body == 1), "lower": near & (y == 0.0) & (body == 0)}
    sets["end"] = x == x.min()
    for k, place in enumerate(BOLTS):
        washer = (np.abs(x - place) < WASHER / 2 + 1e-9) & (np.abs(z) < 0.4 * WASHER + 1e-9)
        sets |= {f"head{k}": washer & (y == y.max()), f"nut{k}": washer & (y == y.min())}
    data = {name: at.astype(int) for name, at in sets.items()}
    ends = [f"{name}{k}" for name in ("head", "nut") for k in range(len(BOLTS))]
    table: dict[str, Any] = {
        "geometry": {"mesh": "beam.vtk", "dimension": 3},
        "material": {"young": 200e9, "poisson": 0.29, "density": 7800.0},
        "geometrically_nonlinear": False,
        "supports": [],
        "probe": {"group": "end"},
    }
    if lap:
        given = JOINT | joint
        stiffness, friction = given["stiffness"], given["friction"]
        springs = {"normal_stiffness": stiffness, "tangential_stiffness": 0.5 * stiffness}
        pair = {"group": "upper", "against": "lower", "friction": friction, "gap": 0.0}
        table["contacts"] = [pair | springs]
        table["bolts"] = [
            {"head": f"head{k}", "nut": f"nut{k}", "force": given["bolt"]} for k in range(3)
        ]
        table["attachments"] = [{"group": end, "mass": BOLT_MASS / 2} for end in ends]
    meshio.Mesh(points, [("hexahedron", cells)], point_data=data).write(folder / "beam.vtk")
    return table


def beam(refine: int, lap: bool = True, **joint: float) -> tuple[Array, Array]:
    """Frequencies of the beam in Hz that bend it across and along the lap; see `scene_of`."""
    with TemporaryDirectory() as folder:
        table = scene_of(Path(folder), refine, lap, **joint)
        found, shares = frequencies(table, Path(folder), 11)
    return found[shares[:, 1] > ONE_WAY], found[shares[:, 2] > ONE_WAY]


def damping(refine: int, **joint: float) -> Array:
    """Frequency (Hz) and damping ratio (%) of the first mode at the amplitudes of `DAMPING`."""
    amplitudes = 1e-3 * np.array(DAMPING)[:, 0]
    with TemporaryDirectory() as folder:
        drive = {"nearest": [DRIVE - LENGTH / 2, 0.0, 0.0]}
        load = {**drive, "direction": [0.0, 1.0, 0.0], "force": 1.0, "frequency": 80.0}
        table = scene_of(Path(folder), refine, **joint) | {"probe": drive, "loads": [load]}
        table["time"] = {"steps_per_period": STEPS}
        table["backbone"] = {"first": 0.5 * amplitudes[0], "last": 1.1 * amplitudes[-1]}
        found = fenicsrom.backbone(parse_scene(table, "measured", Path(folder)))
    moved = [point.amplitude[1] for point in found.points]
    curves = [(point.frequency, 100.0 * point.damping_ratio) for point in found.points]
    return np.array([np.interp(amplitudes, moved, curve) for curve in zip(*curves, strict=True)]).T


def printed(measured: list[float], ours: Array, *more: Array) -> None:
    """Print the rows of a table: measured, ours, the difference in percent, and more columns."""
    for k, value in enumerate(measured):
        others = "".join(f" {column[k]:.4g} |" for column in more)
        print(f"| {value:.4g} | {ours[k]:.4g} | {100.0 * (ours[k] / value - 1.0):+.1f} % |{others}")


def main() -> None:
    """Print the tables."""
    print("panel")
    printed(PANEL, panel(24))
    ours, whole = beam(4), beam(2, lap=False)
    soft, stiff = beam(2, stiffness=2e12), beam(2, stiffness=2e14)
    print("beam: of the lap, of one piece, and of soft and stiff contact on a coarser mesh")
    for measured, *columns in zip(BEAM, ours, whole, soft, stiff, strict=True):
        printed(measured, *columns)
    print("beam: damping in % and frequency in Hz over the amplitude at the drive")
    amplitudes, hertz, ratios = np.transpose(DAMPING)
    found = [damping(2, **other) for other in OTHERS]
    for name, values in (("mm", amplitudes), ("measured, %", ratios), ("measured, Hz", hertz)):
        print(f"| {name} | {' | '.join(map(str, values))} |")
    for other, values in zip(OTHERS, found, strict=True):
        for column, digits in ((1, 2), (0, 1)):
            numbers = [f"{value:.{digits}f}" for value in values[:, column]]
            print(f"| {other or 'nominal'} | {' | '.join(numbers)} |")


if __name__ == "__main__":
    main()
