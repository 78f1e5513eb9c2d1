"""A disk of reduced sectors moves as the whole disk in finite elements."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy.spatial import cKDTree

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
pytest.importorskip("pyvista")
import pyvista
from mpi4py import MPI

from fenicsrom import (
    build_disk,
    build_solid,
    campbell,
    load_disk,
    load_model,
    make_scene,
    run,
    run_disk,
    simulate,
    sweep,
)
from fenicsrom.assess.errors.estimates import MotionErrors, distances
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.solid.wave import wave
from fenicsrom.notes import NoteKind
from fenicsrom.online.model import kept_factor
from fenicsrom.online.model.cyclic_matrix import CyclicMatrix
from fenicsrom.online.model.disk_model import Sector, disk_model, disk_scene
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.scene_changes import changed_scene, shares_model
from fenicsrom.online.stress.stress import von_mises
from fenicsrom.post.base.origin import RESULTS
from fenicsrom.post.paraview.disk_motion import moved_disk
from fenicsrom.post.studies.disk_run_report import figure, report
from fenicsrom.progress import asking
from tests.disks import (
    CYCLIC,
    PERIODS,
    STEEL,
    N,
    bladed,
    copied,
    hub,
    pushes,
    ring,
    scene_of,
    spinning,
    turned,
)
from tests.support import assert_tangent, refusal

pytestmark = pytest.mark.slow

DEMOS = Path(__file__).parents[2] / "demos"
RIM = np.array([[0.15 * np.sqrt(3.0), 0.15, 0.0]])
ALONG, ACROSS = np.array([[[0.8, 0.6, 0.0]], [[-0.5, 0.5 * np.sqrt(3.0), 0.0]]])


AMPLIFIED = [
    (0.0005, 1.18, 1.24),
    (0.001, 1.32, 1.43),
    (0.002, 1.47, 1.65),
    (0.005, 1.70, 1.81),
    (0.01, 1.74, 1.88),
    (0.02, 1.54, 1.63),
    (0.05, 1.35, 1.44),
]
"""Deviation of the stiffness, and the mean and largest amplification of six disks."""


def tables(
    order: int,
    sectors: range,
    at: tuple[Any, Any, Any] = (RIM, ALONG, ACROSS),
    force: float = 1e3,
    preload: float = 4.0,
    stiffness: float = 1e7,
) -> dict[str, Any]:
    """Loads of an engine order, and walls with friction, at a place of some sectors.

    `at` holds the place, the direction of the load and the normal of the wall of sector 0.
    """
    walls, (place, along, across) = [], at
    for j in sectors:
        where, normal = (turned(x, j)[0, :2].tolist() for x in (place, across))
        wall = {"nearest": where, "normal": normal, "preload": preload, "friction": 0.3}
        walls.append({**wall, "normal_stiffness": stiffness, "tangential_stiffness": stiffness})
    return {
        "loads": pushes(order, sectors, place, along, force),
        "contacts": walls,
        "damping": {"stiffness": 5e-6},
        "basis": {"modes": 20},
        "time": PERIODS,
        "geometrically_nonlinear": False,
    }


def sector_scene(path: Path, order: int, **more: Any) -> Any:
    """The scene of one sector."""
    given = {"cyclic": CYCLIC, "rotation": spinning(2), **tables(order, range(1))}
    return scene_of(path, *ring(), **(given | more))


def moved(scene: Any) -> Motion:
    """The motion of the tuned disk, unjudged."""
    disk, whole = build_disk(scene), disk_scene(scene)
    return simulate(disk_model(disk.sector, whole, np.zeros(N)), whole)


def test_disk_of_sectors_rubs_as_the_whole_disk(tmp_path: Path) -> None:
    """Order 2 with the Coriolis force: the sign of the lag and of the neighbour counts.

    Contact rows without the coordinates y′ of the next sector would be 13 % off, and the energy
    would balance all the same.
    """
    found = run(sector_scene(tmp_path, 2), MPI.COMM_SELF)
    more = tables(2, range(N))
    whole = scene_of(tmp_path, *copied(*ring(), N), rotation=spinning(2), **more)
    motion = simulate(full_model(build_solid(whole, MPI.COMM_SELF)), whole)
    assert 0.5 < np.mean(motion.state == 0) < 0.9  # slip
    last = motion.last_period()
    rubbed, wanted = ((m.displacement - m.displacement[0])[last] for m in (found.motion, motion))
    assert np.linalg.norm(rubbed - wanted) < 1e-5 * np.linalg.norm(wanted)
    assert found.errors["time step"].amplitude < 5e-3
    few = run(sector_scene(tmp_path, 2, basis={"modes": 0}), MPI.COMM_SELF)
    estimate, true = few.errors["basis"], distances(few.motion, motion)
    for name in ("amplitude", "peak_force"):
        assert 1.0 < getattr(estimate, name) / getattr(true, name) < 2.0
    assert found.motion.relative_imbalance < 1e-14 and found.disk.wave_error[1] < 8e-6
    # diameter 2 and, by friction, its odd multiples only
    assert found.shares[2] > 0.98 and found.shares[[1, 3]].max() < 1e-10


def test_stresses_and_displacements_of_sectors_are_those_of_the_whole_disk(tmp_path: Path) -> None:
    """The file for ParaView at the last instant, its contents beside the full model."""
    folder = tmp_path / "out"
    output = {"stresses": "cauchy", "motion": True, "pictures": False}
    more = {"loads": tables(2, range(1))["loads"], "contacts": [], "damping": {"stiffness": 5e-6}}
    more |= {"probe": {"nearest": RIM[0, :2].tolist()}, "output": output, "basis": {"modes": 24}}
    found = run(sector_scene(tmp_path, 2, **more), MPI.COMM_SELF, folder=folder)
    assert all(
        any(file.match(name) for name in RESULTS) for file in found.files if file.parent == folder
    )
    given = tables(2, range(N)) | {"contacts": [], "probe": more["probe"]}
    whole = scene_of(tmp_path, *copied(*ring(), N), rotation=spinning(2), **given)
    body = build_solid(whole, MPI.COMM_SELF)
    motion = simulate(full_model(body), whole, keep_coordinates=True)
    table = stress_table(body, whole, body.equilibrium + motion.coordinates[-1], np.zeros((0, 0)))
    wanted = von_mises(table.stress(np.zeros(0), "cauchy"))
    assert found.motion.coordinates is not None and found.disk.table is not None
    q = found.model.sector_coordinates(found.motion.coordinates[-1:])[:, 0]
    stress = von_mises(found.disk.table.stress(q, "cauchy"))
    np.testing.assert_allclose(
        np.sort(stress.ravel()), np.sort(wanted), rtol=0.0, atol=6e-6 * wanted.max()
    )
    last = pyvista.read(sorted((folder / "motion").glob("*.vtu"))[-1])
    near = cKDTree(table.vertex_position).query(last.points[:, :2])
    moved, size = table.vertex_displacement[0], abs(table.vertex_displacement[0]).max()
    assert near[0].max() < 1e-6
    np.testing.assert_allclose(
        last["displacement_m"][:, :2], moved[near[1]], rtol=0.0, atol=1e-7 * size
    )
    rows = np.genfromtxt(folder / "stresses.csv", delimiter=",", names=True, dtype=None)
    assert len(rows) == N + 1 and rows["von_mises_Pa"].max() >= last["von_mises_Pa"].max() * 0.999
    named = found.disk.with_overrides({"output.sectors": [4]})
    again = run_disk(named, folder=tmp_path / "one")
    assert [peak.state for peak in again.peaks_of_stress] == ["equilibrium", "sector 4"]
    few = pyvista.read(sorted((tmp_path / "one" / "motion").glob("*.vtu"))[-1])
    assert few.n_cells == last.n_cells // N and set(few["sector"]) == {4}
    vars(again)["displacement"] = np.zeros_like(again.displacement)
    again.displacement[[3, 7], [4, 0], 0] = 1.0, 2.0  # sector 0 is not shown
    q = found.model.sector_coordinates(again.motion.coordinates[3:4])[4]
    shown = np.linalg.norm(moved_disk(again, "moved")["moved"], axis=1).max()
    own = found.disk.table.displacement(q)[0]
    assert shown == pytest.approx(np.linalg.norm(own, axis=1).max())
    with refusal(ErrorKind.RANGE, key="output.sectors", names="below 6"):
        found.disk.with_overrides({"output.sectors": [6]})


def test_sector_of_two_different_blades_moves_as_the_whole_disk(tmp_path: Path) -> None:
    """Alternating blades: three sectors of two, whose loads have phases of their own."""
    points, cells = copied(*ring(), 2)
    angle, radius = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
    points[(angle > 1.1) & (angle < 2.0) & (abs(radius - 0.2) < 0.01)] *= 1.2  # the second one
    cyclic, ends = CYCLIC | {"sectors": N // 2}, {"left": np.flatnonzero(angle > 2.0)}
    given = tables(1, range(2)) | {"basis": {"modes": 40}, "cyclic": cyclic}
    one = scene_of(tmp_path, points, cells, ends=ends, rotation=spinning(2), **given)
    disk = build_disk(one)
    model = disk_model(disk.sector, disk_scene(one), np.zeros(N // 2))
    found = simulate(model, disk_scene(one))
    every = np.concatenate([turned(points, 2 * j) for j in range(N // 2)])
    _, first6, of = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    points6 = every[first6]
    cells6 = np.concatenate([of[cells + j * len(points)] for j in range(N // 2)])
    more = {"rotation": spinning(2), **tables(1, range(N))}
    whole = scene_of(tmp_path, points6, cells6, **more)
    motion = simulate(full_model(build_solid(whole, MPI.COMM_SELF)), whole)
    rubbed, wanted = (m.displacement - m.displacement[0] for m in (found, motion))
    assert np.linalg.norm(rubbed - wanted) < 1e-3 * np.linalg.norm(wanted)
    first, second = (np.ptp(wanted[:, k::2], axis=0).max() for k in (0, 1))
    assert abs(first / second - 1.0) > 0.02  # the blades differ


def test_blades_swing_and_rub_as_those_of_the_whole_disk(tmp_path: Path) -> None:
    """Nonlinear motion of 40 mm, 13 % of the length of a blade: the linear disk is 100 % off."""
    points, cells = bladed()
    middle = np.pi / N
    tip, radial = points[-1:], np.array([[np.cos(middle), np.sin(middle), 0.0]])
    across = np.array([[-radial[0, 1], radial[0, 0], 0.0]])

    def scene(points: Any, cells: Any, sectors: range, **more: Any) -> Any:
        given = tables(2, sectors, (tip, across, radial), 1e4, 300.0, 1e4)
        given |= {"geometrically_nonlinear": True, "basis": {"modes": 6}}
        given |= {"damping": {"stiffness": 2e-5}, "rotation": spinning(2) | {"speed_rpm": 5e3}}
        return scene_of(tmp_path, points, cells, **(given | more))

    one = scene(points, cells, range(1), cyclic=CYCLIC)
    found, linear = map(moved, (one, replace(one, geometrically_nonlinear=False)))
    whole = scene(*copied(points, cells, N), range(N))
    motion = simulate(full_model(build_solid(whole, MPI.COMM_SELF)), whole)
    swung, straight, wanted = (m.displacement - m.displacement[0] for m in (found, linear, motion))
    assert abs(wanted).max() > 0.039 and 0.3 < np.mean(motion.state == 0) < 0.9
    size = np.linalg.norm(wanted)
    assert np.linalg.norm(swung - wanted) < 1e-3 * size < 1.2e-3 * np.linalg.norm(straight - wanted)
    assert found.relative_imbalance < 1e-11


def test_disk_moves_as_by_newton_in_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few steps make a factor; it may serve several steps."""
    points, cells = bladed()
    radial, across = np.array([[[0.75**0.5, 0.5, 0.0]], [[-0.5, 0.75**0.5, 0.0]]])
    given = tables(2, range(1), (points[-1:], across, radial), 1e4, 30.0, 1e4)
    given |= {"geometrically_nonlinear": True, "basis": {"modes": 3}, "cyclic": CYCLIC}
    scene = scene_of(tmp_path, points, cells, **(given | {"rotation": spinning(2)}))
    sector, whole, count = build_disk(scene).sector, disk_scene(scene), 0
    eliminate = CyclicMatrix.inverse

    def counted(self: CyclicMatrix) -> Any:
        nonlocal count
        count += 1
        return eliminate(self)

    def simulated() -> tuple[Motion, int]:
        nonlocal count
        count = 0
        return simulate(disk_model(sector, whole, np.zeros(N)), whole), count

    monkeypatch.setattr(CyclicMatrix, "inverse", counted)
    motion, few = simulated()
    for name in ("MORE", "PATIENCE"):
        monkeypatch.setattr(kept_factor, name, -99)  # every iteration makes its own factor
    reference, many = simulated()
    moved = reference.displacement - reference.displacement[0]
    np.testing.assert_allclose(
        motion.displacement, reference.displacement, rtol=0.0, atol=1e-11 * abs(moved).max()
    )
    assert few < many / 3


def marched_alone(sector: Sector, scene: Any) -> Any:
    """The motion of a sector whose faces move alike, by the compiled loop."""
    model = sector.model
    p = sector.of_disk(1, model.mass[None]).of_sectors(np.eye(model.size - sector.shapes))[0]
    none = np.zeros((0, 0))
    elastic = ElasticPolynomial(
        p.T @ model.elastic.force, p.T @ model.elastic.stiffness @ p, none, none
    )
    one = reduced_model(
        p.T @ model.mass @ p,
        model.damping,
        elastic,
        p.T @ model.loads,
        model.load_histories,
        model.points,
        model.contact_rows @ p,
        model.contact_offset,
        model.probe @ p,
        model.probe_offset,
        p.T @ model.velocity_matrix @ p,
    )
    return simulate(one, scene)


def test_order_of_all_sectors_moves_them_as_one(tmp_path: Path) -> None:
    """Order N: the disk is the sector whose faces move alike."""
    scene = sector_scene(tmp_path, N)
    sector, whole = build_disk(scene).sector, disk_scene(scene)
    found = simulate(disk_model(sector, whole, np.zeros(N)), whole).displacement
    wanted = marched_alone(sector, scene).displacement
    np.testing.assert_allclose(
        found, np.repeat(wanted, N, 1), rtol=0.0, atol=1e-11 * abs(wanted).max()
    )


LEAN, BLADES = 0.5, 24


def bladed_disk(modes: int) -> Any:
    """The scene of a sector of 24 leaning blades, pressed at the tip."""
    sizes = {"tip": 0.35, "width": 0.015, "size": 0.016, "stagger": float(np.degrees(LEAN))}
    mesh = {"mesh": "sector.geo", "dimension": 3, "cells": "simplex", "curved": True}
    along = [np.sin(LEAN), 0.0, np.cos(LEAN)]
    return make_scene(
        folder=DEMOS,
        geometry=mesh | {"parameters": sizes},
        material=STEEL,
        supports=[{"group": "bore"}],
        cyclic=CYCLIC | {"sectors": BLADES, "axis": [1.0, 0.0, 0.0]},
        loads=[{"group": "tip", "direction": along, "force": 1.0, "frequency": 147.0}],
        geometrically_nonlinear=False,
        basis={"modes": modes},
    )


def test_waves_of_few_diameters_give_the_frequencies_of_all() -> None:
    """Three waves of 0, 1, 2 and 12 diameters: as in an independent program, on another mesh.

    Its errors are 8e-6 in the first two modes of all diameters, and 1e-3 in the first five.
    """
    scene = bladed_disk(20)
    body, errors = build_solid(scene, MPI.COMM_SELF), []
    sector = build_disk(scene, comm=MPI.COMM_SELF).sector
    for h in range(BLADES // 2 + 1):
        with wave(body, h) as exact:
            copies = 2 if exact.double else 1
            squares = exact.eigenmodes(exact.factor, 5 * copies)[0][::copies]
        wanted = np.sqrt(squares) / (2.0 * np.pi)
        errors.append(sector.wave_frequencies(h, BLADES)[:5] / wanted - 1.0)
    found = np.array(errors)
    assert -1e-9 < found.min() and 0.5 < found[:, :2].max() / 8e-6 < 2.0
    assert 0.5 < found.max() / 1e-3 < 2.0


def test_mistuned_blades_are_amplified_as_in_an_independent_disk() -> None:
    """24 blades, order 1, six disks of each deviation.

    The numbers are those of an independent program on another mesh of this disk.
    """
    count, damping, scene = BLADES, 5e-4, bladed_disk(8)
    found, whole = build_disk(scene, comm=MPI.COMM_SELF), disk_scene(scene)
    between, error = found.wave_error
    assert between == 7 and error < 1e-4  # not among those of the faces

    def largest(delta: Any) -> float:
        disk = disk_model(found.sector, whole, delta)
        stiffness = disk.elastic(np.zeros(disk.mass.shape[0]))[1].toarray()
        squares, modes = scipy.linalg.eigh(
            stiffness, disk.mass.toarray(), subset_by_index=[0, 2 * count - 1]
        )
        moved = disk.loads.T @ modes
        push = moved.T @ np.exp(-2j * np.pi * np.arange(count) / count)
        omega = np.linspace(0.97, 1.03, 5001) * np.sqrt(np.median(squares[:count]))
        poles = squares[:, None] - omega**2 + 2j * damping * np.sqrt(squares)[:, None] * omega
        return float(np.abs(moved @ (push[:, None] / poles)).max())

    draws = [np.random.default_rng(seed).standard_normal(count) for seed in range(6)]
    tuned = largest(np.zeros(count))
    for deviation, mean, most in AMPLIFIED:
        amplified = np.array([largest(deviation * draw) for draw in draws]) / tuned
        assert amplified.mean() == pytest.approx(mean, rel=5e-3)
        assert amplified.max() == pytest.approx(most, rel=5e-3)


def test_mistuned_run_reports_amplification_and_shares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal changes of all sectors scale the stiffness; other ones excite other diameters."""
    more = {"rotation": spinning(2, False), "contacts": [], "probe": {"nearest": [0.26, 0.15]}}
    alike = run(sector_scene(tmp_path, 1, cyclic=CYCLIC | {"mistuning": N * [0.25]}, **more))
    assert alike.amplification == pytest.approx(1.0 / 1.25, rel=0.05)
    assert alike.shares[1] == pytest.approx(1.0)
    random = CYCLIC | {"mistuning": {"deviation": 0.05, "seed": 1}}
    scene = sector_scene(tmp_path, 1, cyclic=random, output={"pictures": False}, **more)
    scene = replace(scene, time=scene.time.changed(steady_tolerance=1e-9))
    found = run(scene, folder=tmp_path / "out")
    told = json.loads((tmp_path / "out" / "disk.json").read_text())
    assert told["amplification"] == found.amplification > 1.0
    (waves,) = figure(found).panels[-1].items  # a row of the map for each sector
    np.testing.assert_allclose(np.ptp(waves.values, axis=1), 2e3 * found.peaks, rtol=1e-12)
    large, unknown = MotionErrors(0.1, 0.1, (0.05, 0.2)), MotionErrors(np.inf, np.inf, (0.01,))
    assert "20 % by the basis" in " ".join(
        report(replace(found, errors={"basis": large})).sentences
    )
    written = report(replace(found, errors={"time step": unknown}))
    assert json.loads(json.dumps(written.summary["estimated_error_percent"], allow_nan=False))
    assert "inf" not in " ".join(written.sentences)
    assert 1e-5 < sum(told["shares_of_diameters"][2:]) < 0.1
    table = np.genfromtxt(tmp_path / "out" / "disk.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["mistuning"], found.mistuning)
    np.testing.assert_allclose(table["amplitude_m"], found.peaks)
    assert all(any(file.match(name) for name in RESULTS) for file in found.files)
    assert "does not repeat after 2 periods" in " ".join(found.warnings)
    disk = build_disk(scene)
    with asking(lambda: True):
        stopped = run_disk(disk)
    assert stopped.interrupted and stopped.motion.periods == 1 and stopped.tuned is None

    def interrupt() -> bool:
        raise KeyboardInterrupt

    with asking(interrupt):
        cut = run_disk(disk)
    assert cut.interrupted and cut.motion.periods == 1 and not cut.errors
    np.testing.assert_array_equal(cut.displacement, stopped.displacement[1:])
    monkeypatch.setattr("fenicsrom.online.motion.motion.ENERGY_ERROR", 0.0)
    monkeypatch.setattr("fenicsrom.assess.rotation.disk_run.WAVE_ERROR", 0.0)
    failed = run(scene)
    assert "energy ledger" in str(failed.unfinished) and failed.tuned is None
    assert "raise basis.modes" in " ".join(failed.warnings)


@pytest.mark.parametrize(
    ("kind", "key", "more", "said"),
    [
        (ErrorKind.RANGE, "damping.ratios", {"damping": {"ratios": 0.01, "modes": 90}}, "90"),
        (
            ErrorKind.CONFLICT,
            "output.animation",
            {"output": {"animation": True}},
            "in a run of a disk",
        ),
        (ErrorKind.MISSING, "loads", {"loads": [], "contacts": [], "time": {}}, "no load varies"),
    ],
)
def test_run_of_a_disk_refuses_what_it_cannot_do(
    tmp_path: Path, kind: ErrorKind, key: str, more: dict[str, Any], said: str
) -> None:
    with refusal(kind, key=key, names=said):
        run(sector_scene(tmp_path, 1, **more))


def test_ratios_damp_the_families_of_waves(tmp_path: Path) -> None:
    """One ratio for all families: C M⁻¹ C = 4 ζ² K; the march balances its energy."""
    more = {"rotation": spinning(2, False), "damping": {"ratios": 0.01, "modes": 3}}
    scene = sector_scene(tmp_path, 1, **more)
    stored = build_disk(replace(scene, damping=replace(scene.damping, ratios=())))
    with refusal(ErrorKind.RANGE, key="damping.ratios", names="90"):
        stored.with_overrides({"damping.ratios": 0.01, "damping.modes": 90})
    sector, whole = stored.with_scene(scene).sector, disk_scene(scene)
    few = simulate(disk_model(sector, whole, np.zeros(N)), whole)
    assert few.relative_imbalance < 1e-10 and few.damping_dissipation[-1] > 0.0
    every = (0.01,) * (sector.model.size - sector.shapes)
    whole = replace(whole, damping=replace(whole.damping, ratios=every))
    disk = disk_model(sector, whole, np.zeros(N))
    damping, stiffness = disk.velocity_matrix.toarray(), disk.elastic(0.0 * disk.load(0.0))[1]
    found = damping @ np.linalg.solve(disk.mass.toarray(), damping)
    wanted = 4e-4 * stiffness.toarray()
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-14 * np.abs(wanted).max())
    z = np.random.default_rng(1).standard_normal(len(damping))
    np.testing.assert_allclose(
        disk.velocity_matrix @ z, damping @ z, rtol=0.0, atol=1e-14 * abs(damping).max()
    )


def test_damping_by_stiffness_changes_with_it_and_coriolis_forces_do_not(tmp_path: Path) -> None:
    scene = sector_scene(tmp_path, 1)
    sector = build_disk(scene).sector
    tuned, mistuned = (
        disk_model(sector, disk_scene(scene), delta).velocity_matrix.toarray()
        for delta in (np.zeros(N), np.full(N, 0.25))
    )
    assert np.abs(tuned - tuned.T).max() > 1e3  # N s/m, by the Coriolis force
    np.testing.assert_allclose(mistuned - mistuned.T, tuned - tuned.T, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(
        mistuned + mistuned.T, 1.25 * (tuned + tuned.T), rtol=0.0, atol=1e-10
    )


def test_forces_of_a_mistuned_disk_are_the_slopes_of_its_energy(tmp_path: Path) -> None:
    """In large motions, at an instant and over a step."""
    scene = sector_scene(tmp_path, 1, geometrically_nonlinear=True, basis={"modes": 1})
    disk = disk_model(build_disk(scene).sector, disk_scene(scene), 0.1 * np.arange(N))
    q0, dq = 0.3 * np.random.default_rng(0).standard_normal((2, len(disk.loads)))

    def over_step(x: Any, points: Any = (0.2, 0.8), weights: Any = (0.6, 0.4)) -> tuple[Any, Any]:
        given = np.array(points), np.array(weights)
        force, tangent = disk.elastic_over_step(0.0 * q0, q0, x, 0.0, *given)
        return force, tangent.matrix.toarray()

    assert_tangent(lambda q: disk.elastic_at(q)[1], lambda q: disk.elastic_at(q)[0], q0)
    force, matrix = over_step(dq, [1.0], [1.0])
    np.testing.assert_allclose(
        force, disk.elastic_at(q0 + dq)[0], rtol=0.0, atol=1e-12 * abs(force).max()
    )
    assert_tangent(lambda x: over_step(x)[0], lambda x: over_step(x)[1], dq)
    linear = over_step(-q0, [1.0], [1.0])[1]
    assert abs(matrix - linear).max() > 0.1 * abs(linear).max()


def test_stored_disk_moves_as_that_of_a_new_sector(tmp_path: Path) -> None:
    """Other loads, friction and mistuning need no mesh; other nodal diameters are told."""
    scene, folder = sector_scene(tmp_path, 1, output={"pictures": False}), tmp_path / "out"
    run(scene, MPI.COMM_SELF, folder=folder)
    (tmp_path / "disk.vtk").rename(tmp_path / "kept.vtk")
    changes = {"loads.0.force": 2e3, "contacts.0.friction": 0.1, "contacts.0.preload": 2.0}
    changes |= {"cyclic.mistuning": {"deviation": 0.01}}
    disk = load_disk(folder / "reduced_model.npz")
    found = run_disk(disk.with_overrides(changes), folder=tmp_path / "again")
    assert found.warnings == disk.warnings and (tmp_path / "again" / "disk.csv").exists()
    more = {"loads": [tables(1, range(1), force=2e3)["loads"][0]]}
    more["contacts"] = [tables(1, range(1), preload=2.0)["contacts"][0] | {"friction": 0.1}]
    more["cyclic"] = CYCLIC | {"mistuning": {"deviation": 0.01}}
    scene = sector_scene(tmp_path, 1, **more)
    sector, whole = build_disk(scene).sector, disk_scene(scene)
    wanted = simulate(disk_model(sector, whole, found.mistuning), whole).displacement
    np.testing.assert_allclose(
        found.motion.displacement, wanted, rtol=0.0, atol=1e-9 * abs(wanted).max()
    )
    for key, value in (("cyclic.sectors", 7), ("rotation.speed_rpm", 1e3)):
        with refusal(ErrorKind.MISMATCH, key=key.split(".")[0], names="cannot change"):
            disk.with_overrides({key: value})
    with refusal(ErrorKind.CONFLICT, key="cyclic", names="load_disk"):
        load_model(folder / "reduced_model.npz")
    with refusal(ErrorKind.CONFLICT, key="cyclic", names="not allowed in fenicsrom campbell"):
        campbell(disk)


def test_sweep_of_a_disk_gives_the_runs_of_its_values(tmp_path: Path) -> None:
    """Friction and seeds share one sector, and so do engine orders of the same waves."""
    scene = sector_scene(tmp_path, 1, cyclic=CYCLIC | {"mistuning": {"deviation": 0.01}})
    scene = replace(scene, time=scene.time.changed(periods=1))
    over = {"contacts.0.friction": [0.1, 0.3], "cyclic.mistuning.seed": [1]}
    found = sweep(scene, over, folder=tmp_path / "sweep")
    assert found.models == 1 and [row["outcome"] for row in found.rows] == 2 * ["done"]
    one = run(changed_scene(scene, {"contacts.0.friction": 0.3, "cyclic.mistuning.seed": 1}))
    last = found.rows[-1]
    assert last["largest_amplitude_m"] == pytest.approx(one.peaks.max(), rel=1e-9)
    assert last["amplification"] == pytest.approx(one.amplification, rel=1e-9)
    assert last["basis_error"] == pytest.approx(one.errors["basis"].amplitude, rel=1e-3)
    stored = load_disk(next((tmp_path / "sweep" / "models").glob("*.npz")))
    (again,) = sweep(stored, {"contacts.0.friction": [0.1]}).rows
    assert again["largest_amplitude_m"] == found.rows[0]["largest_amplitude_m"]
    shared = [
        shares_model(scene, changed_scene(scene, {key: value}))
        for key, value in (
            ("loads.0.engine_order", 7),  # of six sectors: the same waves
            ("loads.0.engine_order", 2),
            ("rotation.speed_rpm", 1e4),
        )
    ]
    assert shared == [True, False, False]


def test_stored_disk_tells_loads_for_which_it_was_not_made(tmp_path: Path) -> None:
    disk = replace(build_disk(sector_scene(tmp_path, 1)), diameters=(0, 1, 3))
    known = len(disk.warnings)
    faster = disk.with_overrides({"loads.0.engine_order": 2})
    kinds = [note.kind for note in faster.warnings[known:]]
    assert kinds == [NoteKind.UNCHECKED, NoteKind.BASIS]


def test_motion_larger_than_the_sector_is_implausible(tmp_path: Path) -> None:
    pushed = tables(2, range(1), force=1e12, stiffness=1.0)
    found = run(sector_scene(tmp_path, 2, **pushed, output={"pictures": False}), MPI.COMM_SELF)
    assert any("the body is 0.2598 m long" in str(warning) for warning in found.warnings)


def test_wall_beside_the_axis_is_refused(tmp_path: Path) -> None:
    surface = {"kind": "cylinder", "point": [1e-3, 0.0], "radius": 0.31}
    wall = {"nearest": [0.26, 0.15], "surface": surface, "friction": 0.3}
    wall |= {"normal_stiffness": 1e7, "tangential_stiffness": 1e7}
    with refusal(ErrorKind.CONFLICT, "contacts[0].surface.point", names="axis of the disk"):
        sector_scene(tmp_path, 1, contacts=[wall])


def test_mistuning_of_another_number_of_sectors_is_refused(tmp_path: Path) -> None:
    with refusal(ErrorKind.RANGE, key="cyclic.mistuning", names="each of the 6 sectors, not 2"):
        sector_scene(tmp_path, 1, cyclic=CYCLIC | {"mistuning": [0.1, 0.2]})


def test_sector_with_nodes_on_the_axis_is_refused_in_time(tmp_path: Path) -> None:
    axis = {"axis": [0.0, 0.0, 1.0]}
    load = {"nearest": [0.1, 0.05, 0.05], "direction": [0.0, 0.0, 1.0], "force": 1.0}
    scene = scene_of(
        tmp_path,
        *hub(),
        cyclic=CYCLIC | axis,
        loads=[load | {"frequency": 1.0}],
        geometrically_nonlinear=False,
    )
    with refusal(ErrorKind.PLACE, key="cyclic.left", names="bore"):
        run(scene)


def test_cut_faces_that_supports_hold_everywhere_are_refused_in_time(tmp_path: Path) -> None:
    held = [{"group": CYCLIC["left"]}, {"group": CYCLIC["right"]}]
    with refusal(ErrorKind.PLACE, key="cyclic.left", names="held everywhere by supports"):
        run(sector_scene(tmp_path, 1, supports=held))
