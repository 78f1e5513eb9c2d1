"""Bodies that touch at speed, and under pressures that follow them."""

from __future__ import annotations

from dataclasses import replace
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
from fenicsrom.assess.curves.response_problem import family_of, of_curves, start_motion
from fenicsrom.assess.rotation.run_up import run_up
from fenicsrom.assess.studies.interaction import map_speeds
from fenicsrom.assess.studies.map_line import Place
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid import finer
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.contact.points import trial_forces
from fenicsrom.reduction.training import beyond
from fenicsrom.scene import scene_table
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
    normal = np.maximum(trial_forces(body.contacts, body.contact_rows @ body.equilibrium), 0.0)
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


RANGE = {"speeds_rpm": [2000.0, 10_000.0], "coriolis": True}
MODEL = {"basis": {"modes": 3, "masters": "all"}, "output": QUIET | {"stresses": "none"}}
SHORT = {"duration": 1e-3, "step": 2e-5}


def omega(rpm: float) -> float:
    return rpm * np.pi / 30.0


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, fr.StoredModel]:
    """The mesh of a coarse blade, and its model for a range of speeds."""
    mesh = dovetail(tmp_path_factory.mktemp("root") / "blade.vtu", (1, 2, 2))
    scene = blade(mesh, 5000.0, RANGE, loads=[BLOW], time=SHORT, **MODEL)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finer, "LARGEST", 0)
        return mesh, fr.build_model(scene)


@pytest.mark.parametrize("rpm", [2000.0, 7000.0])
def test_joined_model_of_a_blade_root_is_the_solid_at_each_speed(root: Any, rpm: float) -> None:
    mesh, stored = root
    whole, body = stored.whole, solid(blade(mesh, rpm, {"coriolis": True}))
    q = whole.equilibrium(omega(rpm))
    x = whole.model.contact_offset + whole.model.contact_rows @ q
    at = [
        trial_forces(body.contacts, x),
        trial_forces(body.contacts, body.contact_rows @ body.equilibrium),
    ]
    found, expected = (force.clip(0.0) for force in at)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * expected.max())
    squares = np.sqrt(whole.squares(omega(rpm))) / (2.0 * np.pi)
    np.testing.assert_allclose(squares, hertz(body)[:3], rtol=1e-9)
    assert max(map(float, np.ravel(whole.errors[1:]))) < 1e-6


@pytest.mark.slow
def test_reduced_motions_of_a_blade_in_its_slot_are_those_of_the_full_model(root: Any) -> None:
    mesh, stored = root
    reference = {"full": True}
    scene = blade(mesh, 5000.0, {"coriolis": True}, loads=[BLOW], time=SHORT, reference=reference)
    motions = fr.run(scene).motions
    full = motions["full"]
    spent = full.friction_dissipation[-1]
    for reduced, error in ((motions["reduced"], 7e-4), (stored.simulate(), 3e-3)):
        assert np.abs(reduced.probe - full.probe).max() < error * np.abs(full.probe).max()
        assert reduced.friction_dissipation[-1] == pytest.approx(spent, rel=4e-3)
    assert spent > 5e-3


def test_joined_model_of_a_blade_root_keeps_its_contacts_in_its_file(
    root: Any, tmp_path: Path
) -> None:
    _, stored = root
    fr.save_model(tmp_path / "model.npz", stored)
    speed = "rotation.speed_rpm=8000.0"
    one, other = (
        model.with_overrides(speed).model.contact_offset
        for model in (stored, fr.load_model(tmp_path / "model.npz"))
    )
    np.testing.assert_array_equal(one, other)
    with refusal(ErrorKind.MISMATCH, "contacts[0].normal_stiffness"):
        stored.with_overrides({"contacts.0.normal_stiffness": 2e14})


def test_flanks_of_a_blade_root_carry_its_force_while_it_speeds_up(root: Any) -> None:
    """Ω² ∫ ρ y dV of the undeformed blade in the mean of 5 ms, and the energy of the whole run.

    Reference: force on the flanks of a blade root from 2000 to 10,000 rev/min | closed form |
    Ω² ∫ ρ y dV | 3e-3 | 5e-3
    """
    changes = {"rotation.history": [[0.0, 2000.0], [0.1, 10_000.0]], "loads.0.force": 1.0}
    stored = root[1].with_overrides(changes | {"time.duration": 0.1, "time.step": 1e-4})
    motion = stored.simulate()
    y = np.linspace(0.20, 0.32, 12001)
    moment = 7800.0 * THICKNESS * np.trapezoid(2.0 * half_width(y) * y, y)
    carried = np.einsum("spk,pk->s", motion.force, stored.model.points.frame[:, :, 1])
    speed = omega(2000.0 + 80_000.0 * motion.time)
    of_ten_vibrations = (carried / (speed**2 * moment))[1:].reshape(20, 50).mean(axis=1)
    assert np.abs(of_ten_vibrations - 1.0).max() < 5e-3
    shaft = run_up(stored, motion)
    assert shaft is not None
    assert abs(shaft.balance) < 1e-8 * shaft.shaft_work
    assert shaft.contact_work == 0.0


@pytest.mark.slow
def test_interface_vectors_of_a_blade_root_note_another_speed(
    root: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, _ = root
    monkeypatch.setattr(finer, "LARGEST", 0)
    basis = {"modes": 3}
    scene = blade(mesh, 8000.0, RANGE, loads=[BLOW], time=SHORT, **MODEL | {"basis": basis})
    stored = fr.build_model(scene)
    motion = stored.simulate()
    spent = motion.friction_dissipation[-1]
    assert stored.trained is not None
    assert stored.trained.dissipation == pytest.approx(spent, rel=2e-2)
    assert not beyond(stored.trained, scene, 0.0)
    other = stored.with_overrides("rotation.speed_rpm=4000.0")
    (note,) = beyond(other.trained, other.scene, 0.0)
    assert "rotation.speed_rpm is 4000.0, and was 8000.0" in str(note)


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


@pytest.mark.slow
def test_curve_over_the_speed_of_a_blade_root_holds_the_motions_of_each_speed(root: Any) -> None:
    mesh, _ = root
    load = {"group": "tip", "direction": [1.0, 0.0], "force": 2e3, "engine_order": 6}
    curve = {"parameter": "rotation.speed_rpm", "first": 8000.0, "last": 8500.0}
    tables = MODEL | {"material": STEEL | {"mass_damping": 300.0}}
    time = {"periods": 60, "steps_per_period": 60}
    scene = blade(mesh, 8000.0, RANGE, loads=[load], time=time, response=curve, **tables)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finer, "LARGEST", 0)
        stored = fr.build_model(scene)
    over = of_curves(stored)
    motion = start_motion(over, family_of(over), 8500.0)
    alone = stored.with_overrides("rotation.speed_rpm=8500.0").simulate()
    last = alone.last_period()
    expected = 0.5 * np.ptp(alone.probe[last], axis=0)
    found = 0.5 * np.ptp(motion.record.probe, axis=0)
    assert alone.steady
    assert np.linalg.norm(found - expected) < 2e-3 * np.linalg.norm(expected)


@pytest.mark.slow
def test_map_of_a_blade_root_and_its_casing_shows_the_casing(root: Any) -> None:
    mesh, _ = root
    surface = {"kind": "cylinder", "point": [0.0, 0.0], "waves": [[2, 1.5e-4, np.pi]]}
    law = {"normal_stiffness": 1e11, "tangential_stiffness": 1e11, "friction": 0.15}
    wall = {"group": "tip", "at": "nodes", "surface": surface, "gap": 1.8e-4, **law}
    scene = blade(mesh, 8000.0)
    flanks = scene_table(scene)["contacts"]
    scene = blade(
        mesh,
        8000.0,
        {"speeds_rpm": [6000.0, 14_000.0]},
        contacts=[*flanks, wall],
        time={"steps_per_period": 100},
        map={"speeds_rpm": [7000.0, 7100.0], "revolutions": 3, "last": 2},
        **MODEL | {"material": STEEL | {"mass_damping": 300.0}},
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(finer, "LARGEST", 0)
        place = Place(fr.build_model(scene), scene.at_speed(7000.0))
    line = place.line(False, None)
    alone = hertz(solid(blade(mesh, 7000.0, contacts=[*flanks, wall | {"gap": 1.0}])))
    np.testing.assert_allclose(line.free_hz, alone[:3], rtol=1e-6)
    assert line.closed_hz[0] > line.free_hz[0]
    assert 0.0 < line.contact < 1.0  # the flanks are closed all the time
    assert line.clearance > 1.0
    with refusal(ErrorKind.CONFLICT, "basis.masters"):
        map_speeds(replace(scene, basis=replace(scene.basis, masters="motion")))
