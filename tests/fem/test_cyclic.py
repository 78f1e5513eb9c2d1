"""Modes of a disk from one sector are those of the whole disk."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
from mpi4py import MPI

from fenicsrom import build_solid, campbell, make_scene, modes, run
from fenicsrom.assess.rotation.disk_modes import WaveMode, directions, wave_modes
from fenicsrom.assess.rotation.rotating_modes import have_passed_zero, modes_at_speed
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.fem.solid.wave import wave
from fenicsrom.post.studies.disk_report import disk_report, interference_figure
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis
from tests.disks import CYCLIC, STEEL, N, bladed, copied, hub, ring, scene_of, spinning
from tests.support import on_ranks, refusal


def squares_of(sector: Any, h: int, count: int) -> Any:
    """omega^2 (count,) of the waves of a sector with h nodal diameters."""
    with wave(sector, h) as body:
        return wave_modes(body, count)[0]


@pytest.mark.slow
@pytest.mark.parametrize("coriolis", [False, True])
@pytest.mark.parametrize("part", [ring, hub])
def test_waves_of_a_sector_are_the_modes_of_the_disk(
    tmp_path: Path, part: Any, coriolis: bool
) -> None:
    """Equilibrium at speed, softening, tension, nodes on the axis, in the plane and in space."""
    points, cells = part()
    d = 2 if part is ring else 3
    more = {"rotation": spinning(d, coriolis)}
    sector = build_solid(scene_of(tmp_path, points, cells, cyclic=CYCLIC, **more), MPI.COMM_SELF)
    whole = build_solid(scene_of(tmp_path, *copied(points, cells, N), **more), MPI.COMM_SELF)
    assert sector.largest(sector.equilibrium[:, None]) == pytest.approx(
        whole.largest(whole.equilibrium[:, None]), rel=1e-12
    )
    found = []
    for h in range(N // 2 + 1):
        ways = directions(sector, h)
        copies = 1 if coriolis or 2 * h in (0, N) else 2
        found += copies * squares_of(sector, h, 5 * ways).tolist()
    np.testing.assert_allclose(np.sort(found)[:12], modes_at_speed(whole, 18)[0][:12], rtol=1e-12)


def free(path: Path, *mesh: Any, **more: Any) -> Any:
    """The solid of a disk, or of a sector, without supports."""
    scene = scene_of(path, *mesh, supports=[], **more)
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), free=True)


@pytest.mark.parametrize("part", [bladed, hub])
def test_free_disk_has_the_rigid_motions_and_the_modes_of_the_whole_one(
    tmp_path: Path, part: Any
) -> None:
    """In the plane one rigid motion is alike in all sectors; two in space, and four across."""
    d, mesh = (2, bladed()) if part is bladed else (3, hub())
    axis = {} if d == 2 else {"axis": [0.0, 0.0, 1.0]}
    sector = free(tmp_path, *mesh, cyclic=CYCLIC | axis)
    whole = free(tmp_path, *copied(*mesh, N))
    found, rigid = [], 3 * (d - 1)
    for h in range(N // 2 + 1):
        found += (1 if 2 * h in (0, N) else 2) * squares_of(sector, h, 6).tolist()
    modes = component_modes(whole, Basis(modes=8), whole.rigid)
    assert sector.free_motions.shape[1] == modes.rigid == rigid
    squares = np.sort(found)[: rigid + 8]
    assert not squares[:rigid].any()
    np.testing.assert_allclose(squares[rigid:], modes.omega[rigid : rigid + 8] ** 2, rtol=1.2e-9)


def test_free_disk_that_turns_is_a_disk_on_soft_springs(tmp_path: Path) -> None:
    """In its frame it moves across the axis with the frequency of the rotation, a double root."""
    turning = {"rotation": spinning(2) | {"speed_rpm": 6000.0}}
    sector = free(tmp_path, *bladed(), cyclic=CYCLIC, **turning)
    springs = {"attachments": [{"group": "bore", "stiffness": 1.0}]}
    whole = free(tmp_path, *copied(*bladed(), N), **turning, **springs)
    waves = [squares_of(sector, h, 5 * directions(sector, h)) for h in range(N // 2 + 1)]
    assert waves[0][0] == 0.0
    speed = 6000.0 * np.pi / 30.0
    np.testing.assert_allclose(
        np.sort(np.abs(waves[1] / speed**2 - 1.0))[:2], 0.0, rtol=0.0, atol=2e-11
    )
    with wave(sector, 1) as body:  # whose rigid motions damping does not let grow
        squares, shapes, _ = wave_modes(body, 6)
        assert not have_passed_zero(body, squares, shapes)
    expected = modes_at_speed(whole, 14)[0]
    np.testing.assert_allclose(np.sort(np.concatenate(waves))[3:12], expected[3:12], rtol=1.5e-9)


def test_disk_may_be_held_at_places_that_do_not_hold_its_sector(tmp_path: Path) -> None:
    """A spring along x in each sector lets the disk turn, or hold it, by where it is."""
    for place, count in (([0.1, 0.0], 1), ([0.05, 0.0866], 0)):
        spring = {"nearest": place, "components": ["x"], "stiffness": 1e6}
        sector = free(tmp_path, *ring(), cyclic=CYCLIC, attachments=[spring])
        assert sector.free_motions.shape[1] == count


def test_free_disk_in_time_is_refused(tmp_path: Path) -> None:
    load = {"nearest": [0.2, 0.1], "direction": [1.0, 0.0], "force": 1.0, "frequency": 9.0}
    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC, supports=[], loads=[load])
    with refusal(ErrorKind.SUPPORT, key="supports"):
        run(scene)


UNEVEN = """
h = {size}; a = Pi / 3;
Point(1) = {{0.1, 0, 0, h}}; Point(2) = {{0.3, 0, 0, h}};
Point(3) = {{0.3 * Cos(a), 0.3 * Sin(a), 0, h}}; Point(4) = {{0.1 * Cos(a), 0.1 * Sin(a), 0, h}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Transfinite Curve {{1}} = {right}; Transfinite Curve {{3}} = {left};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
Physical Curve("right") = {{1}}; Physical Curve("left") = {{3}}; Physical Curve("bore") = {{4}};
Physical Surface("body") = {{1}};
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("left", "right", "says"), [(5, 9, "'right' follow 9"), (9, 5, "of 'left'")]
)
def test_uneven_cut_faces_are_almost_as_good_as_matching_ones(
    tmp_path: Path, left: int, right: int, says: str
) -> None:
    """The finer face follows the coarser one, so the disk is a little too stiff."""
    lowest = []
    for name, size, ends in (("fine", 0.012, (17, 17)), ("uneven", 0.03, (left, right))):
        text = UNEVEN.format(size=size, left=ends[0], right=ends[1])
        (tmp_path / f"{name}.geo").write_text(text)
        scene = make_scene(
            folder=tmp_path,
            geometry={"mesh": f"{name}.geo", "dimension": 2, "cells": "simplex", "thickness": 0.02},
            material=STEEL,
            supports=[{"group": "bore"}],
            cyclic=CYCLIC,
            probe={"nearest": [0.2, 0.1]},
        )
        solid = build_solid(scene, MPI.COMM_SELF)
        lowest.append(np.concatenate([squares_of(solid, h, 1) for h in range(4)]))
    assert says in solid.cut.sentence
    errors = np.sqrt(lowest[1] / lowest[0]) - 1.0
    assert np.all(errors > 0.0) and np.all(errors < 0.01)


ANNULUS = """
Point(1) = {{0, {inner}, 0}}; Point(2) = {{{thick}, {inner}, 0}};
Point(3) = {{{thick}, {outer}, 0}}; Point(4) = {{0, {outer}, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 1}};
Transfinite Curve {{1, 3}} = {cells[0]}; Transfinite Curve {{2, 4}} = {cells[1]};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
Transfinite Surface {{1}}; Recombine Surface {{1}};
out[] = Extrude {{{{1, 0, 0}}, {{0, 0, 0}}, Pi / 6}} {{
  Surface{{1}}; Layers{{{cells[2]}}}; Recombine;
}};
Physical Surface("right") = {{1}}; Physical Surface("left") = {{out[0]}};
Physical Surface("bore") = {{out[2]}}; Physical Volume("solid") = {{out[1]}};
"""


def annulus_hertz(path: Path, count: int, material: Any, **shape: Any) -> Any:
    """The lowest frequencies of 0, 1, .. nodal diameters of an annular plate, held at its bore."""
    (path / "annulus.geo").write_text(ANNULUS.format(**shape))
    scene = make_scene(
        folder=path,
        geometry={"mesh": "annulus.geo", "dimension": 3, "curved": True},
        material=material,
        supports=[{"group": "bore"}],
        cyclic={"sectors": 12, "left": "left", "right": "right", "axis": [1.0, 0.0, 0.0]},
        probe={"nearest": [0.0, shape["outer"], 0.0]},
    )
    solid = build_solid(scene, MPI.COMM_SELF)
    squares = [squares_of(solid, h, 1)[0] for h in range(count)]
    return np.sqrt(squares) / (2.0 * np.pi)


@pytest.mark.slow
def test_annular_plate_has_the_frequencies_of_plate_theory(tmp_path: Path) -> None:
    """f = λ² √(D / ρt) / 2πa², bore a / 10, ν = 1/3 (Leissa, 1969).

    Reference: annular plate from one of 12 sectors | Leissa (1969) | 95.164 to 334.249 Hz | agree |
    0.9 %
    """
    material = {"young": 200e9, "poisson": 1.0 / 3.0, "density": 7850.0}
    shape = {"inner": 0.03, "outer": 0.3, "thick": 0.01, "cells": (2, 17, 3)}
    found = annulus_hertz(tmp_path, 4, material, **shape)
    np.testing.assert_allclose(found, [115.744, 95.164, 150.289, 334.249], rtol=9e-3)


@pytest.mark.slow
def test_annular_plate_has_the_frequencies_of_calculix(tmp_path: Path) -> None:
    """Its example segdyn has 20 nodes in each cell; these have 27, with the same corners.

    Reference: thick annular plate from one sector | CalculiX, segdyn | 81.8374 to 1087.156 kHz |
    agree | 0.4 %
    """
    shape = {"inner": 1e-4, "outer": 1e-3, "thick": 1e-4, "cells": (3, 13, 4)}
    found = annulus_hertz(tmp_path, 7, STEEL, **shape)
    wanted = [104.4082, 81.83741, 136.3315, 302.0662, 521.1937, 784.5865, 1087.156]
    np.testing.assert_allclose(1e-3 * found, wanted, rtol=4e-3)


def test_left_and_right_may_be_exchanged(tmp_path: Path) -> None:
    points, cells = ring()
    squares = []
    for cyclic in (CYCLIC, CYCLIC | {"left": "right", "right": "left"}):
        scene = scene_of(tmp_path, points, cells, cyclic=cyclic, rotation=spinning(2))
        squares.append(squares_of(build_solid(scene, MPI.COMM_SELF), 1, 4))
    np.testing.assert_allclose(*squares, rtol=1e-12)


def test_engine_orders_excite_one_wave_each() -> None:
    """24 sectors: order 3 is the backward wave of 3 diameters, order 21 the forward one."""
    waves = [WaveMode(24, h, 1, way, 1) for h, way in ((3, -1), (3, 1), (0, 0), (12, 0))]
    met = {k: [j for j, wave in enumerate(waves) if wave.meets(k)] for k in (3, 21, 24, 27, 12, 5)}
    assert met == {3: [0], 21: [1], 24: [2], 27: [0], 12: [3], 5: []}
    assert [k for k in range(1, 50) if WaveMode(24, 3, 1, 0, 1).meets(k)] == [3, 21, 27, 45]


def test_sector_with_another_angle_is_refused(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC | {"sectors": 7})
    with refusal(ErrorKind.PLACE, key="cyclic.sectors", names="6 sectors"):
        build_solid(scene, MPI.COMM_SELF)


def test_angle_that_no_sector_has_gives_no_number_of_sectors(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC | {"point": [0.03, 0.0]})
    with refusal(ErrorKind.PLACE, key="cyclic.sectors", names="about the axis; look at"):
        build_solid(scene, MPI.COMM_SELF)


def test_load_on_a_cut_face_is_refused(tmp_path: Path) -> None:
    load = {"group": "left", "direction": [1.0, 0.0], "force": 1.0}
    with refusal(ErrorKind.CONFLICT, key="loads[0].group", names="cut face"):
        scene_of(tmp_path, *ring(), cyclic=CYCLIC, loads=[load])


def test_plane_sector_has_no_axis(tmp_path: Path) -> None:
    with refusal(ErrorKind.CONFLICT, key="cyclic.axis", names="only allowed in 3D"):
        scene_of(tmp_path, *ring(), cyclic=CYCLIC | {"axis": [1.0, 0.0, 0.0]})


def test_point_beside_the_axis_of_rotation_is_refused(tmp_path: Path) -> None:
    turning = spinning(2) | {"point": [0.3, 0.0]}
    with refusal(ErrorKind.CONFLICT, key="cyclic.point", names="axis of [rotation]"):
        scene_of(tmp_path, *ring(), cyclic=CYCLIC | {"point": [0.0, 0.0]}, rotation=turning)


@pytest.mark.parametrize(("moved", "failed"), [((0.05, 0.0), 1), ((0.0, -0.01), 2)])
def test_faces_that_are_no_turn_of_each_other_are_refused(
    tmp_path: Path, moved: tuple[float, float], failed: int
) -> None:
    """A node of the right face lies beyond the left one turned, or beside it."""
    points, cells = ring()
    at = (points[:, 0] > 0.29) & (np.abs(points[:, 1]) < 1e-9)
    points[at, :2] += moved
    scene = scene_of(tmp_path, points, cells, on_right=at, cyclic=CYCLIC)
    with refusal(ErrorKind.PLACE, key="cyclic.right", names=f"{failed} of 5 nodes"):
        build_solid(scene, MPI.COMM_SELF)


@pytest.mark.parametrize("held", [{"group": "bore", "components": ["x"]}, {"group": "right"}])
def test_supports_that_differ_from_sector_to_sector_are_refused(
    tmp_path: Path, held: dict[str, Any]
) -> None:
    supports = [held, {"group": "rim"}]
    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC, supports=supports)
    with refusal(ErrorKind.SUPPORT, key="supports", names="alike"):
        build_solid(scene, MPI.COMM_SELF)


@pytest.mark.parametrize("left_out", ["right", "left"])
def test_support_may_leave_out_nodes_of_a_following_face(tmp_path: Path, left_out: str) -> None:
    """As decks of CalculiX do: a node of the disk is held if one of its copies is held."""
    points, cells = ring()
    angle = {"right": 0.0, "left": 2.0 * np.pi / N}[left_out]
    beside = np.abs(np.arctan2(points[:, 1], points[:, 0]) - angle) > 1e-6
    ends = {"held": np.flatnonzero((np.hypot(*points.T[:2]) < 0.11) & beside)}
    more: Any = {"geometry": {"mesh": "disk.vtk", "dimension": 2, "degree": 1, "thickness": 0.02}}
    more |= {"ends": ends, "cyclic": CYCLIC}
    squares = []
    for group in ("bore", "held"):
        scene = scene_of(tmp_path, points, cells, supports=[{"group": group}], **more)
        squares.append(squares_of(build_solid(scene, MPI.COMM_SELF), 1, 4))
    np.testing.assert_allclose(*squares, rtol=1e-12)


def test_commands_without_sectors_refuse_one(tmp_path: Path) -> None:
    import fenicsrom

    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC)
    with refusal(ErrorKind.CONFLICT, key="cyclic", names="run, sweep, response, modes, campbell"):
        fenicsrom.build_model(scene)


def test_rollers_on_a_cut_face_are_refused(tmp_path: Path) -> None:
    held = [{"group": "bore"}, {"group": "right", "normal": [1.0, 1.0]}]
    scene = scene_of(tmp_path, *ring(), cyclic=CYCLIC, supports=held)
    with refusal(ErrorKind.SUPPORT, key="supports", names="alike"):
        build_solid(scene, MPI.COMM_SELF)


@pytest.mark.slow
def test_two_ranks_give_the_waves_of_one(tmp_path: Path) -> None:
    scene_of(tmp_path, *hub(), cyclic=CYCLIC | {"axis": [0.0, 0.0, 1.0]})  # writes the mesh
    (tmp_path / "disk.toml").write_text(
        '[geometry]\nmesh = "disk.vtk"\ndimension = 3\n[material]\nyoung = 2.1e11\n'
        'poisson = 0.3\ndensity = 7800.0\n[[supports]]\ngroup = "rim"\n[cyclic]\n'
        'sectors = 6\nleft = "left"\nright = "right"\naxis = [0, 0, 1]\n'
        "[rotation]\nspeed_rpm = 2e4\naxis = [0, 0, 1]\ncoriolis = true\n"
        "[output]\npictures = false\nparaview = false\n[basis]\nmodes = 3\n"
    )
    command = "-m", "fenicsrom", "modes", str(tmp_path / "disk.toml"), "--output"
    tables = []
    for ranks in (1, 2):
        on_ranks(ranks, *command, str(tmp_path / f"on{ranks}"))
        tables.append(
            np.genfromtxt(tmp_path / f"on{ranks}" / "modes.csv", delimiter=",", names=True)
        )
    assert len(tables[0]) > 12
    np.testing.assert_allclose(tables[1]["frequency_Hz"], tables[0]["frequency_Hz"], rtol=1e-12)


@pytest.mark.slow
def test_campbell_of_many_waves_takes_few_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of two nodal diameters and of speeds in between are those of the mesh.

    Waves in few coordinates that are not exact enough are not taken.
    """
    campbell_, waves_ = "fenicsrom.assess.rotation.campbell", "fenicsrom.fem.solid.reduced_waves"
    monkeypatch.setattr(f"{waves_}.sampled_diameters", lambda sectors: [0, 1, 3])
    table = {"speeds_rpm": [0.0, 5e3, 1e4, 15e3, 2e4], "modes": 3, "engine_orders": [2, 4]}
    more: Any = {"cyclic": CYCLIC, "rotation": spinning(2), "campbell": table}
    scene = scene_of(tmp_path, *bladed(), **more, output={"pictures": False})
    exact = campbell(scene, MPI.COMM_SELF)
    monkeypatch.setattr(f"{campbell_}.MANY_UNKNOWNS", 0)
    monkeypatch.setattr(f"{campbell_}.MANY_WAVES", 0)
    found = campbell(scene, MPI.COMM_SELF)
    assert any("0, 1, 3 nodal diameters" in note for note in found.warnings)
    assert found.labels == exact.labels and len(exact.critical) == 2
    np.testing.assert_allclose(found.squares, exact.squares, rtol=1e-5)
    assert not np.array_equal(found.squares, exact.squares)
    pairs = zip(found.critical, exact.critical, strict=True)
    assert max(abs(a.speed_rpm / b.speed_rpm - 1.0) for a, b in pairs) < 1e-5
    assert found.shapes is not None and exact.shapes is not None
    common = np.abs(np.sum(found.shapes.conj() * exact.shapes, axis=0))
    sizes = np.linalg.norm(found.shapes, axis=0) * np.linalg.norm(exact.shapes, axis=0)
    assert np.all(common > (1.0 - 1e-6) * sizes)
    monkeypatch.setattr(f"{campbell_}.WAVE_ERROR", 0.0)
    np.testing.assert_allclose(campbell(scene).squares, exact.squares, rtol=1e-9)


def test_interference_diagram_numbers_modes_by_their_frequencies() -> None:
    """Modes that crossed on the way to the speed of operation keep the names of their waves."""
    waves = [WaveMode(6, h, number, 0, 1) for h in (0, 1) for number in (1, 2)]
    hertz = np.array([[1.0, 2.0, 2.1, 1.1]])
    found: Any = SimpleNamespace(
        waves=waves, frequencies_hz=hertz, operating_squares=None, margins=None
    )
    (panel,) = interference_figure(found).panels
    assert [line.y for line in panel.items] == [[1.0, 1.1], [2.0, 2.1]]


def test_report_of_a_disk_names_its_waves(tmp_path: Path) -> None:
    scene = scene_of(
        tmp_path,
        *ring(),
        cyclic=CYCLIC,
        rotation=spinning(2),
        basis={"modes": 2},
        output={"pictures": False},
    )
    found = modes(scene, MPI.COMM_SELF, folder=tmp_path / "out")
    text = disk_report(found).text()
    assert found.labels[:3] == ["0: 1", "0: 2", "1: 1f"] and "with the rotation" in text
    assert (tmp_path / "out" / "disk.vtu").exists() and (tmp_path / "out" / "modes.csv").exists()
