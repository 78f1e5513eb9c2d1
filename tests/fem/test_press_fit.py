"""Rings that are pressed into one another, against a closed form and another program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

pytest.importorskip("dolfinx")
from numpy.typing import NDArray

import fenicsrom as fr
from fenicsrom.fem.solid.solid import Solid
from tests.boxes import rings
from tests.fem.test_pairs import STEEL, forces, scene_of, solid

Array = NDArray[np.float64]

CORNERS = np.array([(x, y, z) for z in (0, 2) for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))])
ENDS = [
    (0, 1),
    (1, 2),
    (2, 3),
    (3, 0),
    (4, 5),
    (5, 6),
    (6, 7),
    (7, 4),
    *((k, k + 4) for k in range(4)),
]
MOVED, HELD = 5e-6, 1e20
"""Displacement of the edges, m, and the stiffness of the springs that move them, N/m³."""


def test_interference_presses_rings_as_lame_says(tmp_path: Path) -> None:
    """p = δ/(R/E ((c² + R²)/(c² − R²) + (R² + a²)/(R² − a²)) + 1/k) in a quarter of two rings.

    Reference: press fit of two rings: pressure | closed form | 11.32 MPa | agrees | 0.2 %
    """
    a, radius, c, k, squeezed = 1.0, 1.5, 2.0, 1e13, 5e-4
    parts = (a, radius, 6, 30), (radius, c, 6, 40)
    held = [{"group": "right", "components": ["y"]}, {"group": "left", "components": ["x"]}]
    pair = {"group": "0 high", "against": "1 low", "gap": -squeezed, "normal_stiffness": k}
    mesh = rings(tmp_path / "quarter.vtu", *parts, angle=0.5 * np.pi)
    load = [{"group": "1 high", "pressure": 1.0, "frequency": 1.0}]
    body = solid(scene_of(mesh, 2, pair, degree=2, supports=held, loads=load))
    both = (c**2 + radius**2) / (c**2 - radius**2) + (radius**2 + a**2) / (radius**2 - a**2)
    expected = squeezed / (radius / STEEL["young"] * both + 1.0 / k)
    area = 0.5 * np.pi * radius
    assert forces(body).sum() / area == pytest.approx(expected, rel=2e-3)


def test_ring_that_friction_alone_keeps_from_turning_is_pressed_on(tmp_path: Path) -> None:
    """Facets that do not match give a tiny moment, which soft springs have to hold."""
    mesh = rings(tmp_path / "rings.vtu", (0.05, 0.075, 2, 12), (0.075, 0.1, 2, 17))
    pair = {"group": "1 low", "against": "0 high", "gap": -1e-5, "normal_stiffness": 1e14}
    load = [{"group": "1 high", "force": 1.0, "direction": [1.0, 0.0], "frequency": 1.0}]
    more = {"supports": [{"group": "0 low"}], "loads": load, "geometrically_nonlinear": True}
    bodies = [
        solid(scene_of(mesh, 2, pair | {"tangential_stiffness": k}, **more)) for k in (1e11, 1e14)
    ]
    np.testing.assert_allclose(*map(forces, bodies), rtol=1e-9)


def ring_mesh(path: Path, radii: list[tuple[float, float]], around: int, across: int) -> Path:
    """Rings of 0.1 mm, of one layer of quadratic hexahedra, with groups of their edges."""
    places = [*CORNERS, *((CORNERS[a] + CORNERS[b]) // 2 for a, b in ENDS)]
    points, cells, groups = np.zeros((0, 3)), [], {}
    for number, (low, high) in enumerate(radii):
        size = (2 * across + 1, 2 * around, 3)
        i, j, k = (one.ravel() for one in np.indices(size))
        r, angle = low + (high - low) * i / (2 * across), np.pi * j / around
        x = np.stack([r * np.cos(angle), r * np.sin(angle), 0.05e-3 * k], axis=1)
        used = (i % 2 + j % 2 + k % 2) < 2
        at = np.cumsum(used).reshape(size) - 1 + len(points)
        first = np.stack(np.meshgrid(2 * np.arange(across), 2 * np.arange(around)), axis=-1)
        for p, q in first.reshape(-1, 2):
            cells.append([at[p + s, (q + t) % (2 * around), z] for s, t, z in places])
        for name, where in (("low", 0), ("high", 2 * across)):
            groups[f"{number} {name}"] = at[where][used.reshape(size)[where]]
        points = np.concatenate([points, x[used]])
    marks = {n: np.isin(np.arange(len(points)), on).astype(int) for n, on in groups.items()}
    meshio.Mesh(points, [("hexahedron20", np.array(cells))], point_data=marks).write(path)
    return path


def one_wave(body: Solid, count: int = 24) -> Array:
    """The natural frequencies of nodal diameter 1 and of one phase, 1,000 cycles/s."""
    squares, modes = body.eigenmodes(body.factor, count)
    x = body.space.tabulate_dof_coordinates()[: body.local // 3]
    angle = np.arctan2(x[:, 1], x[:, 0])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    circles, number = np.unique(np.hypot(x[:, 0], x[:, 1]).round(8), return_inverse=True)
    found = []
    for square, mode in zip(squares, modes.T, strict=True):
        u = mode.reshape(-1, 3).copy()
        u[:, :2] = np.einsum("abn,nb->na", turn, u[:, :2])
        waves = np.zeros((circles.size, 3), dtype=complex)
        np.add.at(waves, number, np.exp(1j * angle)[:, None] * u)
        share = np.sum(np.abs(waves) ** 2 / np.bincount(number)[:, None]) / np.sum(u**2)
        if share > 0.3:
            found.append(1e-3 * float(np.sqrt(square)) / (2.0 * np.pi))
    return np.array(found[::2])


def moved_rings(mesh: Path, last: int, moved: float, **more: Any) -> fr.Scene:
    """Rings whose inner and outer edges move into them; the outermost one has the number `last`."""
    edges = "0 low", f"{last} high"
    spring = {"components": ["x", "y"], "stiffness_per_area": HELD}
    return fr.make_scene(
        geometrically_nonlinear=moved > 0.0,
        geometry={"mesh": str(mesh), "dimension": 3},
        material={"young": 2.1e11, "poisson": 0.3, "density": 7800.0},
        supports=[{"group": edge, "components": ["z"]} for edge in edges],
        attachments=[{"group": edge, **spring} for edge in edges],
        loads=[{"group": edge, "pressure": HELD * moved} for edge in edges if moved],
        probe={"group": "0 high"},
        time={"duration": 1e-6, "step": 1e-7},
        **more,
    )


@pytest.mark.slow
def test_pressed_rings_have_the_frequencies_of_the_ladder_of_calculix(tmp_path: Path) -> None:
    """Nodal diameter 1 of rings of 1 to 1.5 and 1.5 to 2 mm, which are 0.1 mm thick.

    CalculiX moves the inner and outer edge by 5 µm towards the rings; here stiff springs and
    pressures k u do so. Compared are the rings apart, at rest, and pressed with a contact that
    sticks, which is 2e-5 below one ring of both. The third frequencies are not compared.

    Reference: pressed rings: 1,000 cycles/s | CalculiX | apart 329.41, 381.53; stuck
    442.27, 1238.4 | 329.19, 381.63; 444.12, 1249.0 on 48 x 16 cells | 3 % on 24 x 8 cells
    """
    pair = [(1e-3, 1.5e-3), (1.5e-3, 2e-3)]
    two = ring_mesh(tmp_path / "two.vtu", pair, 24, 4)
    one = ring_mesh(tmp_path / "one.vtu", [(1e-3, 2e-3)], 24, 8)
    apart = one_wave(solid(moved_rings(two, 1, 0.0)))
    law = {"normal_stiffness": 1e19, "tangential_stiffness": 1e19, "friction": 0.3}
    contact = [{"group": "0 high", "against": "1 low", **law}]
    stuck = one_wave(solid(moved_rings(two, 1, MOVED, contacts=contact)))
    whole = one_wave(solid(moved_rings(one, 0, MOVED)))
    assert apart[:2] == pytest.approx([329.4148, 381.5293], rel=0.02)
    assert stuck[:2] == pytest.approx([442.2699, 1238.410], rel=0.03)
    assert stuck[:2] == pytest.approx(whole[:2], rel=1e-4)
