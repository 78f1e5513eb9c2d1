"""Bodies that touch at speed, and under pressures that follow them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
import meshio
from mpi4py import MPI
from scipy.optimize import brentq

import fenicsrom as fr
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.contact.points import trial_forces
from tests.boxes import stacked
from tests.support import assert_tangent, random_directions, refusal

STEEL = {"young": 210e9, "poisson": 0.3, "density": 7800.0}
THICKNESS = 0.02
BLOW = {"group": "tip", "direction": [1.0, 0.0], "force": 2e3, "pulse": {"duration": 1e-3}}
QUIET = {"pictures": False, "paraview": False}


def half_width(y: Any) -> Any:
    """Half of the width of the blade at the radius y, m: a dovetail up to y = 0.22."""
    return np.interp(y, [0.20, 0.22], [0.02, 0.01])


def dovetail(path: Path, blade: tuple[int, int, int] = (2, 3, 4), jaw: int = 2) -> Path:
    """Write the mesh of a blade along y and of the two jaws of its slot, which share no node.

    The blade has these cells across, along its root and along the rest; the jaws more than it.
    """
    points, cells, sets = np.zeros((0, 2)), [], {}

    def add(x: Any) -> Any:
        nonlocal points
        at = len(points) + np.arange(x.shape[0] * x.shape[1]).reshape(x.shape[:2])
        box = [at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]]
        cells.append(np.stack(box, axis=2).reshape(-1, 4))
        points = np.concatenate([points, x.reshape(-1, 2)])
        return at

    across, root, rest = blade
    y = np.append(np.linspace(0.20, 0.22, root + 1), np.linspace(0.22, 0.32, rest + 1)[1:])
    s = np.linspace(-1.0, 1.0, across + 1)[:, None]
    at = add(np.stack([s * half_width(y), y + 0.0 * s], axis=2))
    sets |= {"left flank": at[0, : root + 1], "right flank": at[-1, : root + 1], "tip": at[:, -1]}
    y, t = np.linspace(0.20, 0.22, jaw + 1), np.linspace(0.0, 1.0, jaw)[:, None]
    ends = []
    for side, name in ((-1.0, "left"), (1.0, "right")):
        x = side * (half_width(y) + t * (0.04 - half_width(y)))
        at = add(np.stack([x, y + 0.0 * t], axis=2)[:: int(side)])[:: int(side)]
        sets[f"{name} slot"] = at[0]
        ends.append(at[-1])
    sets["disk"] = np.concatenate(ends)
    marks = {name: np.isin(np.arange(len(points)), on).astype(int) for name, on in sets.items()}
    file = meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))), [("quad", np.concatenate(cells))], point_data=marks
    )
    file.write(path)
    return path


def blade(path: Path, speed: float, more: Any = (), **tables: Any) -> Any:
    """The scene of the blade in its slot at a speed in rev/min."""
    law = {"normal_stiffness": 1e14, "tangential_stiffness": 5e13, "friction": 0.3}
    table: dict[str, Any] = {
        "geometry": {"mesh": str(path), "dimension": 2, "thickness": THICKNESS},
        "material": STEEL,
        "supports": [{"group": "disk"}],
        "rotation": {"speed_rpm": speed, **dict(more)},
        "contacts": [
            {"group": f"{side} flank", "against": f"{side} slot", **law}
            for side in ("left", "right")
        ],
        "probe": {"group": "tip"},
        "output": QUIET,
    }
    return fr.parse_scene(table | tables, "blade.toml", None, unloaded="loads" not in tables)


def solid(scene: Any) -> Any:
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF))


def hertz(body: Any) -> Any:
    return np.sqrt(body.eigenmodes(body.factor, 4)[0]) / (2.0 * np.pi)


def test_flanks_of_a_blade_root_carry_its_centrifugal_force(tmp_path: Path) -> None:
    """At 3000 rev/min, Ω² ∫ ρ y dV of the undeformed blade.

    Reference: force on the flanks of a blade root at speed | closed form | 10243.86 N | 1e-4 | 3e-4
    """
    body = solid(blade(dovetail(tmp_path / "blade.vtu"), 3000.0))
    normal = np.maximum(trial_forces(body._contacts, body.contact_rows @ body.equilibrium), 0.0)
    x, up = normal @ body.points.frame[:, 0]
    y = np.linspace(0.20, 0.32, 12001)
    moment = np.trapezoid(2.0 * half_width(y) * y, y)
    square = (3000.0 * np.pi / 30.0) ** 2
    assert up == pytest.approx(7800.0 * THICKNESS * square * moment, rel=3e-4)
    assert abs(x) < 1e-9 * up
    displaced = body.rotation.centrifugal_force(body.equilibrium)[1::2]
    on_blade = (
        np.abs(body.space.tabulate_dof_coordinates()[:, 0])
        <= half_width(body.space.tabulate_dof_coordinates()[:, 1]) + 1e-12
    )
    slots = [body.mesh.nodes(f"{side} slot", body.space) for side in ("left", "right")]
    on_blade[np.concatenate(slots)] = False
    assert up == pytest.approx(displaced[on_blade].sum(), rel=1e-9)


@pytest.mark.slow
def test_diagram_of_a_blade_in_its_slot_holds_the_modes_at_each_speed(tmp_path: Path) -> None:
    speeds = [2000.0, 10_000.0]
    mesh = dovetail(tmp_path / "blade.vtu")
    found = fr.campbell(blade(mesh, speeds[0], campbell={"speeds_rpm": speeds}))
    expected = [hertz(solid(blade(mesh, speed))) for speed in speeds]
    np.testing.assert_allclose(found.frequencies_hz[:, :4], expected, rtol=1e-9)
    assert found.frequencies_hz[1, 0] > 1.01 * found.frequencies_hz[0, 0]


@pytest.mark.slow
def test_reduced_motion_of_a_blade_in_its_slot_is_that_of_the_full_model(tmp_path: Path) -> None:
    scene = blade(
        dovetail(tmp_path / "blade.vtu"),
        5000.0,
        {"coriolis": True},
        loads=[BLOW],
        time={"duration": 1e-3, "step": 2e-5},
        reference={"full": True},
    )
    motions = fr.run(scene).motions
    reduced, full = motions["reduced"], motions["full"]
    assert np.abs(reduced.probe - full.probe).max() < 7e-4 * np.abs(full.probe).max()
    assert reduced.friction_dissipation[-1] == pytest.approx(
        full.friction_dissipation[-1], rel=7e-3
    )
    assert reduced.friction_dissipation[-1] > 0.01


def test_model_for_a_range_of_speeds_takes_no_bodies_that_touch(tmp_path: Path) -> None:
    mesh = dovetail(tmp_path / "blade.vtu")
    with refusal(ErrorKind.CONFLICT, "rotation.speeds_rpm"):
        blade(mesh, 3000.0, {"speeds_rpm": [2000.0, 4000.0]})


def test_pressure_that_follows_passes_between_bodies(tmp_path: Path) -> None:
    """λ E (λ² − 1)/2 = −p √(1 − ν (λ² − 1)) of the stretch λ along the pressure p.

    Reference: follower pressure of 2 GPa on two blocks that touch | closed form | stretch 0.99031 |
    agree | 1e-9
    """
    pressure, stiffness = 2e9, 1e16
    law = {"normal_stiffness": stiffness, "tangential_stiffness": 1e13, "friction": 0.3}
    sides = [("x", "0 low x"), ("x", "1 low x"), ("y", "0 low y")]
    scene = fr.parse_scene(
        {
            "geometry": {
                **{"mesh": str(stacked(tmp_path / "blocks.vtu", 2, 5, 5)), "dimension": 2},
                "thickness": 1.0,
            },
            "material": STEEL,
            "supports": [{"group": group, "components": [axis]} for axis, group in sides],
            "contacts": [{"group": "1 low y", "against": "0 high y", **law}],
            "loads": [{"group": "1 high y", "pressure": pressure, "follower": True}],
        },
        "pressed.toml",
        None,
        unloaded=True,
    )

    def across(stretch: float) -> float:
        return float(np.sqrt(1.0 - 0.3 * (stretch**2 - 1.0)))

    def residual(stretch: float) -> float:
        return stretch * 210e9 * (stretch**2 - 1.0) / 2.0 + pressure * across(stretch)

    stretch = brentq(residual, 0.9, 1.0, xtol=1e-14)
    body = solid(scene)
    top = body.mesh.nodes("1 high y", body.space)
    found = body.equilibrium.reshape(-1, 2)[top, 1]
    expected = 0.1 * (stretch - 1.0) - pressure * across(stretch) / stiffness
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    u, directions = random_directions(body)
    rest = np.zeros(body.local)
    assert_tangent(
        lambda s: body.residual(u + s @ directions, rest) - body.joint.force(u + s @ directions),
        lambda s: body.tangent_times(u + s @ directions, directions.T),
        np.zeros(3),
        step=0.5,
        tolerance=1e-9,
    )


def test_small_pressure_that_follows_couples_no_modes_of_bodies_that_touch(tmp_path: Path) -> None:
    """The upper block is held by its contact alone, which the coupled modes must have too."""
    law = {"normal_stiffness": 1e13, "tangential_stiffness": 5e12, "friction": 0.3}
    mesh = str(stacked(tmp_path / "blocks.vtu", 2, 2, 3))
    scene = fr.parse_scene(
        {
            "geometry": {"mesh": mesh, "dimension": 2, "thickness": 0.01},
            "material": STEEL,
            "supports": [{"group": "0 low y"}],
            "contacts": [{"group": "1 low y", "against": "0 high y", **law}],
            "loads": [{"group": "1 high y", "pressure": 1e6, "follower": True}],
        },
        "pressed.toml",
        None,
        unloaded=True,
    )
    assert not solid(scene).warnings
