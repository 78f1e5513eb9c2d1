"""The tuned wave of a disk by harmonic balance of one sector is the motion of the marched disk."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
import pyvista
from mpi4py import MPI

from fenicsrom import build_disk, load_disk, response, simulate
from fenicsrom.assess.curves import balance_walk
from fenicsrom.errors import ErrorKind
from fenicsrom.online.curves.balance_curve import BalanceCurve, first_motion
from fenicsrom.online.curves.curve import STICKS, CurvePoint, half_range
from fenicsrom.online.model.disk_model import disk_model, disk_scene, lag_of
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.balance import Balance
from fenicsrom.online.periodic.shooting import frequency_family
from fenicsrom.online.store.scene_changes import Trained
from fenicsrom.post.base.origin import RESULTS
from tests.disks import CYCLIC, N, bladed, scene_of, shrouded, spinning
from tests.fem.test_disk_contact import sector_scene as touching
from tests.fem.test_disk_contact import whole_body
from tests.fem.test_disk_run import tables
from tests.support import refusal

pytestmark = pytest.mark.slow


def blades(path: Path, order: int, hertz: float, force: float = 2e3, **more: Any) -> Any:
    """The sector of a bladed disk whose tip rubs a wall, loaded by an engine order."""
    points, cells = bladed()
    middle = np.pi / N
    radial = np.array([[np.cos(middle), np.sin(middle), 0.0]])
    across = np.array([[-radial[0, 1], radial[0, 0], 0.0]])
    given = tables(order, range(1), (points[-1:], across, radial), force, 100.0, 1e5)
    given |= {"damping": {"stiffness": 3e-4}, "basis": {"modes": 4}, "cyclic": CYCLIC}
    given |= {"rotation": spinning(2) | {"speed_rpm": 60.0 * hertz / order}}
    return scene_of(path, points, cells, **(given | more))


def balanced(sector: Any, scene: Any, sense: float = 1.0) -> CurvePoint:
    """The motion of the sector in the wave, or in one of the other sense."""
    problem = Problem.of(sector.model, scene).settled()
    balance = Balance(problem, 21, sector, sense * lag_of(scene), 4, scene.damping.modal)
    s, f = balance.linear(problem), 1.0 / problem.period
    assert s is not None
    path = BalanceCurve(balance, frequency_family(problem), 0.5 * f, 2.0 * f, s)
    found = first_motion(path, s, f)
    assert found is not None
    return found


def marched(sector: Any, scene: Any, steps: int) -> tuple[Any, Any]:
    """Amplitudes (N, d) of the first point of each sector, and the friction loss of one, J."""
    time = {"steps_per_period": steps, "periods": 80, "steady_tolerance": 1e-6}
    scene = replace(scene, time=scene.time.changed(**time))
    whole = disk_scene(scene)
    motion = simulate(disk_model(sector, whole, np.zeros(N)), whole)
    assert motion.steady
    last = motion.last_period()
    moved = motion.displacement[last][1:]
    time = motion.time[last][1:] - motion.time[last][0]
    lost = motion.point_friction_dissipation[last].sum(axis=1)
    points = moved.shape[1] // N
    amplitudes = [half_range(time, moved[:, j * points]) for j in range(N)]
    return np.array(amplitudes), (lost[-1] - lost[0]) / N


@pytest.mark.parametrize(("order", "damping"), [(2, {"stiffness": 3e-4}), (5, {"ratios": 0.15})])
def test_wave_with_friction_is_that_of_the_marched_disk(
    tmp_path: Path, order: int, damping: dict[str, float]
) -> None:
    """Below the resonance of the blades: the difference falls with the square of the step.

    Order 5 is a forward wave of one nodal diameter. The Coriolis force tells the sense of a wave.
    """
    scene = blades(tmp_path, order, 170.0, damping=damping)
    sector = build_disk(scene).sector
    found, motions = balanced(sector, scene), []
    for count in (48, 96):
        amplitudes, lost = marched(sector, scene, count)
        assert np.ptp(amplitudes, axis=0).max() < 3e-7 * amplitudes.max()
        motions.append(np.append(amplitudes[0], lost))
    wanted = np.append(found.amplitude[0], found.friction_dissipation)
    far, near = (motion[:2] / wanted[:2] - 1.0 for motion in motions)
    assert np.all((far / near > 3.7) & (far / near < 4.3)) and near.min() > 3e-4
    limit = (4.0 * motions[1] - motions[0]) / 3.0
    np.testing.assert_allclose(limit[:2], wanted[:2], rtol=2e-5)
    assert limit[2] == pytest.approx(wanted[2], rel=1e-3)
    assert found.states[0] & 6 == 6  # slips and sticks
    other = balanced(sector, scene, -1.0).amplitude
    assert abs(other / found.amplitude - 1.0).max() > 5e-5


def test_wave_of_blades_that_touch_is_that_of_the_marched_disk(tmp_path: Path) -> None:
    """Shrouds rub on those of the next sector, which moves by the lag of the wave.

    The error of a step depends on where in it the points begin to stick and to slip, so that it
    falls with the square of the step on average only: 4e-3, 1.4e-3, 2.2e-4 for 48, 96, 192 steps.
    """
    scene = touching(tmp_path, shrouded(), order=2, damping={"stiffness": 2e-3})
    sector = build_disk(scene).sector
    found, moved = balanced(sector, scene), marched(sector, scene, 192)[0][0]
    assert abs(moved - found.amplitude[0]).max() < 2.5e-4 * moved.max()
    assert np.all(found.states & 2)  # all slip


def test_large_waves_are_those_of_the_marched_disk(tmp_path: Path) -> None:
    """At 6 % of the length of the blades, where a linear disk would move twice as far."""
    scene = blades(tmp_path, 2, 170.0, 1e4, geometrically_nonlinear=True)
    sector = build_disk(scene).sector
    found = balanced(sector, scene)
    linear = balanced(
        sector._replace(interior=sector.interior._replace(cubic=np.zeros((0, 0)))), scene
    )
    motions = [marched(sector, scene, count)[0][0] for count in (36, 72)]
    assert found.amplitude.max() > 0.015
    limit = (4.0 * motions[1] - motions[0]) / 3.0
    assert abs(limit - found.amplitude[0]).max() < 1.6e-4 * limit.max()
    assert np.all(linear.amplitude > 2.0 * found.amplitude)


def linear_wave(sector: Any, scene: Any) -> tuple[Any, Any]:
    """The disk, whose points stick where they touch at rest, and its coordinates in the wave."""
    disk, omega = disk_model(sector, disk_scene(scene), np.zeros(N)), 2.0 * np.pi / scene.period
    mass, damping, rows = disk.mass.toarray(), disk.velocity_matrix.toarray(), disk.contact_rows
    stiffness = disk.elastic(np.zeros(len(mass)))[1].toarray()
    stiffness = stiffness + rows.T @ (np.tile(sector.springs, N)[:, None] * rows)
    push = scene.loads[0].size * disk.loads @ np.exp(1j * lag_of(scene) * np.arange(N))
    return disk, np.linalg.solve(stiffness + 1j * omega * damping - omega**2 * mass, push)


@pytest.mark.parametrize("damping", [{"stiffness": 3e-4}, {"ratios": [0.02, 0.005]}])
def test_linear_wave_without_contact_is_that_of_the_matrices_of_the_disk(
    tmp_path: Path, damping: dict[str, Any]
) -> None:
    """Rows of the probe without the coordinates y′ of the next sector would be 7 % off."""
    more = {"contacts": [], "probe": {"nearest": [0.26, 0.15]}, "damping": damping}
    scene = blades(tmp_path, 2, 170.0, **more)
    sector = build_disk(scene).sector
    disk, q = linear_wave(sector, scene)
    moved = np.abs(disk.probes @ q).reshape(N, -1)
    found = balanced(sector, scene)
    np.testing.assert_allclose(found.amplitude, moved[:1], rtol=1e-10)
    lost = np.pi * 2.0 * np.pi / scene.period * (q.conj() @ disk.velocity_matrix.toarray() @ q) / N
    assert found.damping_dissipation == pytest.approx(lost.real, rel=1e-9)


@pytest.mark.parametrize("order", [2, 4])
def test_wave_at_speed_is_that_of_the_whole_disk_in_finite_elements(
    tmp_path: Path, order: int
) -> None:
    """Backward and forward waves, with stress stiffening, Coriolis force and damping."""
    tip = bladed()[0][-1, :2].tolist()
    scene = blades(tmp_path, order, 170.0, contacts=[], probe={"nearest": tip}, basis={"modes": 20})
    found = balanced(build_disk(scene).sector, scene)
    body = whole_body(scene)[1]
    free, one = np.setdiff1d(np.arange(body.local), body.clamped), np.eye(body.local)
    stiffness, mass, coriolis, damping = (
        times(one)[np.ix_(free, free)]
        for times in (
            body.stiffness_times,
            body.mass_times,
            body.gyroscopic_times,
            body.viscous.times,
        )
    )
    omega = 2.0 * np.pi / scene.period
    push = scene.loads[0].size * body.load_vectors[free] @ np.exp(1j * lag_of(scene) * np.arange(N))
    u = np.linalg.solve(stiffness + 1j * omega * (coriolis + damping) - omega**2 * mass, push)
    moved = np.abs(body.probe_rows[:, free] @ u)
    np.testing.assert_allclose(found.amplitude[0], moved, rtol=1e-5)


def test_wave_of_shrouds_that_stick_is_that_of_the_matrices_of_the_disk(tmp_path: Path) -> None:
    """The contact rows of a sector have a part of the next one, which moves by the lag."""
    scene = touching(tmp_path, shrouded(), force=1.0)
    sector = build_disk(scene).sector
    disk, q = linear_wave(sector, scene)
    found = balanced(sector, scene)
    assert np.all(found.states == STICKS)
    moved = np.abs(disk.contact_rows @ q).reshape(N, -1, 2)
    np.testing.assert_allclose(found.amplitude, moved[0], rtol=1.5e-10)


def test_response_of_a_disk_writes_its_wave(tmp_path: Path) -> None:
    """And a stored disk the same curve; its points have no verdict."""
    table = {"first": 150.0, "last": 230.0}
    output = {"pictures": False, "motion": True, "stresses": "none"}
    scene = blades(tmp_path, 5, 170.0, response=table, output=output)
    found = response(scene, MPI.COMM_SELF, folder=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "response.json").read_text())
    assert (told["nodal_diameters"], told["direction"]) == (1, "forward")
    curve = told["curves"][0]
    assert curve["largest"]["stability"] == "not judged" and curve["harmonics"] >= 7
    assert max(check["step_error"] for check in curve["checks"]) < 2e-4
    assert max(check["basis_error"] for check in curve["checks"]) < 2e-5
    written = [file for file in found.files if file.parent == tmp_path / "out"]
    assert all(any(file.match(name) for name in RESULTS) for file in written)
    with np.load(tmp_path / "out" / "motions.npz") as motions:
        moved = motions["largest_displacement"][:, 0, 1]
    top = curve["largest"]["amplitude_tangential_m"]
    assert np.ptp(moved) / 2.0 == pytest.approx(top, rel=1.5e-4)
    stored = load_disk(tmp_path / "out" / "reduced_model.npz")
    (shown, *_) = sorted((tmp_path / "out/motions/largest/motion").glob("*.vtu"))
    disk = pyvista.read(shown)
    pairs = cKDTree(disk.points).query_pairs(1e-6, output_type="ndarray")
    there, here = disk["displacement_m"][pairs].swapaxes(0, 1)
    assert len(pairs) >= 2 * N  # cut faces of neighbours lie on each other
    np.testing.assert_allclose(
        there, here, rtol=0.0, atol=1e-6 * np.abs(disk["displacement_m"]).max()
    )
    trained = Trained((1e3,), (0.1,), amplitude=1.0, duration=0.0, dissipation=0.0)
    again = response(replace(stored, trained=trained))
    assert any("loads.0.force is 2000, and was 1000" in note for note in again.warnings)
    tops = [max(float(p.amplitude.max()) for p in r.curves[0].points) for r in (found, again)]
    assert tops[0] == pytest.approx(tops[1], rel=1e-9)


def test_wave_that_the_balance_cannot_find_is_refused(tmp_path: Path) -> None:
    table = {"first": 150.0, "last": 230.0}
    scene = blades(tmp_path, 2, 170.0, response=table, cyclic=CYCLIC | {"mistuning": N * [0.1]})
    with refusal(ErrorKind.CONFLICT, key="cyclic.mistuning", names="tuned"):
        response(scene)
    over_speed = {"parameter": "rotation.speed_rpm", "first": 4000.0, "last": 6000.0}
    with refusal(ErrorKind.CONFLICT, key="response.parameter", names="range of frequency"):
        blades(tmp_path, 2, 170.0, response=over_speed)


def test_wave_that_is_not_found_ends_with_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(balance_walk, "first_motion", lambda *given: None)
    scene = blades(tmp_path, 2, 170.0, response={"first": 150.0, "last": 230.0})
    found = response(scene, MPI.COMM_SELF)
    assert "response.first" in str(found.unfinished) and "preload" in str(found.unfinished)
