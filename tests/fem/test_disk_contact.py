"""Neighbouring sectors that touch move as those of the whole disk in finite elements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
from mpi4py import MPI

from fenicsrom import build_disk, build_solid, run, run_disk, simulate
from fenicsrom.assess.errors.verdicts import in_percent
from fenicsrom.assess.rotation.rotating_modes import modes_at_speed
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.fem.solid.wave import wave
from fenicsrom.fem.solid.whole_disk import as_sectors, whole_scene
from fenicsrom.online.motion.measures import contact_fractions, friction_dissipation_per_period
from fenicsrom.online.store.scene_changes import Trained
from fenicsrom.post.studies.disk_report import disk_report
from fenicsrom.post.studies.disk_run_report import contacts, sentences
from fenicsrom.study.analyses import nodal_diameters
from tests.disks import CYCLIC, PERIODS, N, extruded, pushes, scene_of, shrouded, spinning, wedged
from tests.fem.test_disk_run import marched_alone
from tests.support import refusal

pytestmark = pytest.mark.slow

MIDDLE = np.pi / N
ACROSS = np.array([[-np.sin(MIDDLE), np.cos(MIDDLE), 0.0]])
TIP = 14
"""A node at the end of the blade."""

PAIR = {"normal_stiffness": 1e10, "tangential_stiffness": 1e10, "friction": 0.1, "preload": 1e7}
SHROUD = {"group": "ahead", "against": "behind", "neighbour": True}
SLOW = spinning(2) | {"speed_rpm": 1e3}


def tables(points: Any, order: int = 2, force: float = 1e4, **more: Any) -> dict[str, Any]:
    """A load of an engine order at the tip; `more` are other tables."""
    given = {
        "loads": pushes(order, range(1), points[TIP : TIP + 1], ACROSS, force),
        "damping": {"stiffness": 2e-5},
        "basis": {"modes": 20},
        "time": PERIODS,
        "geometrically_nonlinear": False,
        "probe": {"nearest": points[TIP, :2].tolist()},
    }
    return given | more


def sector_scene(path: Path, mesh: Any, contacts: Any = (SHROUD,), **more: Any) -> Any:
    """The scene of one sector; `more` is that of `tables`."""
    points, cells, ends = mesh
    given = {"cyclic": CYCLIC, "rotation": SLOW, **tables(points, **more)}
    given["contacts"] = [{**PAIR, **one} for one in contacts]
    return scene_of(path, points, cells, ends=ends, **given)


def whole_body(scene: Any) -> tuple[Any, Any]:
    """The scene of the whole disk, and its body."""
    whole = whole_scene(scene)
    return whole, solid_of(whole, build_mesh(scene.geometry, MPI.COMM_SELF, scene.cyclic))


def compared(found: Any) -> tuple[float, float, Any]:
    """Errors of the contact displacements and forces against the whole disk, and its motion."""
    whole, body = whole_body(found.scene)
    points = found.disk.sector.model.points
    motion = as_sectors(simulate(full_model(body), whole), body, points, found.scene)
    errors = []
    for name in ("displacement", "force"):
        ours, wanted = (getattr(one, name) for one in (found.motion, motion))
        assert np.abs(ours[0] - wanted[0]).max() < 1e-12 * np.abs(wanted[0]).max()  # at rest
        wanted = wanted - wanted[0]
        errors.append(float(np.linalg.norm(ours - ours[0] - wanted) / np.linalg.norm(wanted)))
    assert found.motion.relative_imbalance < 1e-11
    return *errors, motion


@pytest.mark.parametrize("ends", [("ahead", "behind"), ("behind", "ahead")])
def test_rigid_motions_of_a_disk_move_no_contact(tmp_path: Path, ends: Any) -> None:
    """In space: a rotation and a translation along the axis, and one across it, a wave of h = 1."""
    points, cells, sets = extruded(shrouded((2e-6, 2e-6)))  # a gap moves with a rotation
    axis = {"axis": [0.0, 0.0, 1.0]}
    contact = PAIR | SHROUD | dict(zip(("group", "against"), ends, strict=True))
    more: dict[str, Any] = {"cyclic": CYCLIC | axis, "contacts": [contact]}
    more |= {"time": {"duration": 1.0, "step": 0.1}, "probe": {"nearest": [0.6, 0.3, 0.0]}}
    body = build_solid(scene_of(tmp_path, points, cells, ends=sets, **more), MPI.COMM_SELF)
    x = body.space.tabulate_dof_coordinates()
    lag = np.exp(2j * np.pi / N)
    for field, factor in (
        (np.cross([0.0, 0.0, 1.0], x), 1.0),
        (np.tile([0.0, 0.0, 1.0], (len(x), 1)), 1.0),
        (np.tile([1.0, 1j, 0.0], (len(x), 1)), lag),
    ):
        own, ahead = (rows @ field.ravel() for rows in (body.contact_rows, body.ahead_rows))
        assert np.abs(ahead).max() > 0.1
        assert np.abs(own + (factor - 1.0) * ahead).max() < 5e-6
    assert body.joint.springs.size == 27


@pytest.mark.parametrize("ends", [("ahead", "behind"), ("behind", "ahead")])
def test_shrouds_rub_and_lift_off_as_those_of_the_whole_disk(tmp_path: Path, ends: Any) -> None:
    """With either end as the first region; the interface vectors are those of the motion."""
    pairs = [SHROUD | dict(zip(("group", "against"), ends, strict=True))]
    given: dict[str, Any] = {"contacts": pairs, "force": 2e4}
    found = run(sector_scene(tmp_path, shrouded(), **given), MPI.COMM_SELF)
    moved, pushed, motion = compared(found)
    open_, slip = (np.mean(motion.state == state) for state in (-1, 0))
    assert open_ > 0.1 and slip > 0.2
    assert moved < 7e-7 and pushed < 2e-6
    assert found.disk.wave_error[1] < 1.2e-10
    told = found.errors["time step"].probe  # the error by which the run is judged
    assert f"probe of sector 0: {in_percent(told)} by the time step" in " ".join(sentences(found))
    np.testing.assert_allclose(
        found.motion.friction_dissipation[-1], motion.friction_dissipation[-1], rtol=1.5e-7
    )
    rows, parts = contacts(found), contact_fractions(found.motion)
    assert [row["sector"] for row in rows] == [*range(N)]
    assert np.mean([row["slip"] for row in rows]) == pytest.approx(parts["slip"])
    spent = friction_dissipation_per_period(found.motion)
    assert sum(row["loss"] for row in rows) == pytest.approx(spent)


def test_wedges_between_blades_rub_as_those_of_the_whole_disk(tmp_path: Path) -> None:
    """A damper that only contacts hold, one of them to the next sector, pressed by the rotation."""
    contacts = [
        {"group": "low", "against": "ahead", "preload": 0.0, "gap": 0.0},
        {"group": "high", "against": "behind", "preload": 0.0, "gap": 0.0, "neighbour": True},
    ]
    found = run(sector_scene(tmp_path, wedged(), contacts), MPI.COMM_SELF)
    moved, pushed, motion = compared(found)
    assert 0.1 < np.mean(motion.state == 0) < 0.9
    assert moved < 1e-5 and pushed < 2e-5


def test_shrouded_blades_swing_as_those_of_the_whole_disk(tmp_path: Path) -> None:
    """A nonlinear motion, of which the linear disk misses a quarter."""
    more = {"geometrically_nonlinear": True, "basis": {"modes": 6}, "force": 1e5}
    scene = sector_scene(tmp_path, shrouded(), **more)
    found, linear = (run(s) for s in (scene, replace(scene, geometrically_nonlinear=False)))
    moved, pushed, motion = compared(found)
    assert moved < 1e-3 and pushed < 1e-3 and 0.1 < np.mean(motion.state == 0)
    ours, straight = (one.motion.displacement for one in (found, linear))
    assert np.linalg.norm(straight - ours) > 0.1 * np.linalg.norm(ours - ours[0])


def test_order_of_all_sectors_moves_shrouds_as_those_of_one_sector(tmp_path: Path) -> None:
    """With a step that does not depend on how stiff a contact point alone is."""
    more = {"basis": {"modes": 20, "masters": "all"}}
    more["time"] = PERIODS | {"scheme": "average-acceleration"}
    scene = sector_scene(tmp_path, shrouded(), order=N, force=2e4, **more)
    whole = run(scene, MPI.COMM_SELF)
    found, wanted = whole.motion, marched_alone(build_disk(scene).sector, scene)
    assert 0.1 < np.mean(wanted.state == 0)
    assert "mm, and stand 37.5 mm apart" in " ".join(whole.warnings)  # in one sector
    error = np.abs(found.displacement - np.tile(wanted.displacement, (1, N, 1))).max()
    assert error < 4e-11 * np.abs(wanted.displacement).max()


def test_modes_with_stuck_and_open_shrouds_are_those_of_the_whole_disk(tmp_path: Path) -> None:
    scene = sector_scene(tmp_path, shrouded(), basis={"modes": 3})
    found = nodal_diameters(scene, MPI.COMM_SELF)
    body = whole_body(scene)[1]
    assert found.open_squares is not None
    for squares, times in (
        (found.squares[-1], body.held_times),
        (found.open_squares, body.stiffness_times),
    ):
        body.stiffness_times = times
        wanted = modes_at_speed(body, 12)[0]
        np.testing.assert_allclose(np.sort(squares)[:12], wanted, rtol=2.5e-10)


def test_modes_with_shrouds_that_carry_no_pressure_have_no_open_ones(tmp_path: Path) -> None:
    gap, cyclic = SHROUD | {"preload": 0.0, "gap": 1e-3}, CYCLIC | {"diameters": [1]}
    found = nodal_diameters(sector_scene(tmp_path, shrouded(), [gap], cyclic=cyclic))
    assert found.open_squares is None
    assert "None of 3 contact points" in " ".join(disk_report(found).sentences)


def test_shrouds_close_as_the_disk_slows_down(tmp_path: Path) -> None:
    """The blades move outwards at speed, away from one another."""
    scene = sector_scene(tmp_path, shrouded())
    body = build_solid(scene, MPI.COMM_SELF)
    for speed, closed in ((5e3, False), (1e3, True)):
        body.spin(speed * np.pi / 30.0)
        fresh = build_solid(scene.at_speed(speed), MPI.COMM_SELF)
        assert np.all((body.joint.springs > 0.0) == closed)
        np.testing.assert_array_equal(body.joint.springs > 0.0, fresh.joint.springs > 0.0)
        size = np.abs(fresh.equilibrium).max()
        np.testing.assert_allclose(body.equilibrium, fresh.equilibrium, rtol=0.0, atol=1e-13 * size)
        squares = []
        for one in (body, fresh):
            with wave(one, 1) as disk:
                squares.append(disk.eigenmodes(disk.factor, 2)[0])
        np.testing.assert_allclose(*squares, rtol=3e-11)


@pytest.mark.parametrize("reach", [{}, {"reach": 0.01}])
def test_neighbour_that_a_contact_lacks_is_named(tmp_path: Path, reach: dict[str, float]) -> None:
    scene = sector_scene(tmp_path, shrouded(), [SHROUD | {"neighbour": False} | reach])
    with refusal(ErrorKind.PLACE, key="contacts[0].against", names="neighbour = true"):
        build_solid(scene, MPI.COMM_SELF)


def test_neighbour_without_a_disk_or_a_region_is_refused(tmp_path: Path) -> None:
    with refusal(ErrorKind.CONFLICT, key="contacts[0].neighbour", names="with [cyclic]"):
        points, cells, ends = shrouded()
        load = {"nearest": [0.5, 0.3], "direction": [1.0, 0.0], "force": 1.0, "frequency": 1.0}
        scene_of(tmp_path, points, cells, ends=ends, loads=[load], contacts=[PAIR | SHROUD])
    wall = {"group": "ahead", "normal": [1.0, 0.0], "neighbour": True}
    with refusal(ErrorKind.CONFLICT, key="contacts[0].neighbour", names="with against"):
        sector_scene(tmp_path, shrouded(), [wall])


def test_slides_past_the_next_point_are_told_once(tmp_path: Path) -> None:
    given: dict[str, Any] = {
        "contacts": [SHROUD | {"friction": 0.01, "normal_stiffness": 1e12}],
        "basis": {"modes": 4, "masters": "all"},
        "time": {"periods": 1, "steps_per_period": 20},
        "output": {"pictures": False, "stresses": "none"},
    }
    found = run(sector_scene(tmp_path, shrouded(), force=6e5, **given), MPI.COMM_SELF)
    assert sum("slide by up to" in str(note) for note in found.warnings) == 1


def test_disk_that_moves_longer_than_in_its_training_has_a_note(tmp_path: Path) -> None:
    mesh = shrouded()
    load = {"nearest": mesh[0][TIP, :2].tolist(), "direction": ACROSS[0, :2].tolist()}
    given: dict[str, Any] = {
        "loads": [load | {"force": 1e3, "pulse": {"duration": 1e-4}}],
        "basis": {"modes": 4, "masters": "all"},
        "time": {"duration": 4e-4, "step": 2e-5},
        "output": {"pictures": False, "stresses": "none"},
    }
    disk = build_disk(sector_scene(tmp_path, mesh, **given))
    trained = Trained((1e3,), (0.1,), amplitude=1.0, duration=4e-4, dissipation=0.0)
    longer = replace(disk, trained=trained, file="disk.npz").with_overrides("time.duration=5e-4")
    found = run_disk(longer)
    assert any("the motion lasts 0.0005 s, and lasted 0.0004 s" in note for note in found.warnings)
