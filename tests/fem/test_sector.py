"""Bodies that are one sector of a disk are seen, said, and not clamped at a cut face."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from disks import bladed, scene_of

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
import meshio
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.mesh.sector import Sector, find_sector
from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
from fenicsrom.formats.shapes import distinct, facets_of
from fenicsrom.notes import NoteKind
from fenicsrom.post.studies.starter import starter_scene
from fenicsrom.scene import parse_scene

QUADRILATERAL, HEXAHEDRON = 3, 5


def grid(n: tuple[int, int, int]) -> tuple[Any, Any]:
    """Places in a unit cube and hexahedra of a structured mesh."""
    number = np.arange((n[0] + 1) * (n[1] + 1) * (n[2] + 1)).reshape([k + 1 for k in n])
    places = np.stack(np.meshgrid(*(np.linspace(0, 1, k + 1) for k in n), indexing="ij"), -1)
    at = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    rows = [number[i : i + n[0], j : j + n[1], k : k + n[2]].ravel() for i, j, k in at]
    return places.reshape(-1, 3), np.stack(rows, axis=1)


def ring(degrees: float, inner: float = 0.06, across: int = 2) -> tuple[Any, Any]:
    """A part of a ring about z, 0.15 m wide at the outside and 20 mm thick."""
    at, cells = grid((3, across, 1))
    r, angle = inner + (0.15 - inner) * at[:, 0], np.radians(degrees) * at[:, 1]
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.02 * at[:, 2]]), cells


def bottom(points: Any, cells: Any) -> tuple[Any, Any]:
    """The lower sides of one layer of hexahedra, without double nodes."""
    at, place = np.unique((points * [1.0, 1.0, 0.0]).round(12), axis=0, return_inverse=True)
    return at, place.reshape(-1)[cells[:, :4]]


def found(points: Any, cells: Any) -> Sector | None:
    """The sector of a mesh of hexahedra, or of quadrilaterals."""
    kind = HEXAHEDRON if cells.shape[1] == 8 else QUADRILATERAL
    sides = facets_of(kind, cells)
    first, _, count = distinct(rows := sides.reshape(-1, sides.shape[-1]))
    alone = first[count == 1]
    inside = points[cells].mean(axis=1)[alone // sides.shape[1]]
    return find_sector(points, rows[alone], inside)


@pytest.mark.parametrize("number", [3, 24])
def test_sector_is_found_about_any_axis(number: int) -> None:
    points, cells = ring(360.0 / number)
    turn, move = Rotation.from_rotvec([0.4, -1.1, 0.3]), np.array([0.3, 0.1, -0.2])
    sector = found(turn.apply(points) + move, cells)
    assert sector is not None and sector.number == number
    assert abs(sector.axis @ turn.apply([0.0, 0.0, 1.0])) == pytest.approx(1.0)
    assert sector.distances(move) == pytest.approx(0.0, abs=1e-9)


SHIFTS = {  # of the angle of the cut faces, rad, over radius and height from 0 to 1
    "helical": lambda r, z: 0.2 * z,
    "spiral": lambda r, z: 0.2 * r**2,
    "twisted": lambda r, z: 0.2 * r * z,
    "kinked": lambda r, z: 0.4 * np.abs(r - 0.5),
}


@pytest.mark.parametrize("shift", SHIFTS.values(), ids=SHIFTS)
def test_sector_between_curved_or_kinked_cuts_is_found(shift: Any) -> None:
    number = 8
    at, cells = grid((8, 3, 4))
    r, angle = 0.06 + 0.09 * at[:, 0], 2.0 * np.pi / number * at[:, 1]
    angle += shift(at[:, 0], at[:, 2])
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.03 * at[:, 2]])
    sector = found(points[:, [2, 0, 1]], cells)
    assert sector is not None and sector.number == number
    assert abs(sector.axis[0]) == pytest.approx(1.0)
    assert sector.distances(np.zeros(3)) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("inner", "clockwise"), [(0.06, 0), (0.0, 0), (0.06, 2)])
def test_plane_sector_is_found(inner: float, clockwise: int) -> None:
    """Without a bore, the cut faces meet on the axis; some cells may go round the other way."""
    points, cells = bottom(*ring(15.0, inner))
    cells[:clockwise] = cells[:clockwise, ::-1]
    points[:, 0] += 0.1
    sector = found(points, cells)
    assert sector is not None and sector.number == 24
    assert sector.axis == pytest.approx([0.0, 0.0, 1.0])
    assert sector.point == pytest.approx([0.1, 0.0, 0.0], abs=1e-9)
    assert sector.are_cut(points).sum(axis=1).tolist() == [4, 4]


def turned(x: Any, y: Any, angle: Any, z: Any) -> Any:
    """Places (n, 3) of a bar along z, whose cross-sections are turned."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack([c * x - s * y, s * x + c * y, z])


def bars() -> dict[str, tuple[Any, Any]]:
    """Bodies that are no sector of a disk."""
    box, cells = grid((4, 2, 2))
    hexagon = np.array([(np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)) for k in range(6)])
    rows = [(0, 1, 2, 3), (0, 3, 4, 5)]
    prism = np.array([(*p, z) for z in (0.0, 3.0) for p in hexagon])
    wide = np.tan(np.radians(20.0)) * (1.0 + box[:, :1]) * (2.0 * box[:, 1:2] - 1.0)
    fine, bricks = grid((20, 4, 2))
    chord, across = 2.0 * fine[:, 1] - 1.0, (2.0 * fine[:, 2] - 1.0) * 0.2
    twist, thick = 0.8 * fine[:, 0], across * (1.05 - chord**2)
    plane, quads = bottom(*grid((4, 2, 1)))
    narrow = np.tan(np.radians(20.0)) * (1.0 + plane[:, :1]) * (2.0 * plane[:, 1:2] - 1.0)
    return {
        "twisted blade": (turned(chord, across, twist, 5.0 * fine[:, 0]), bricks),
        "twisted profile": (turned(chord, thick, twist, 5.0 * fine[:, 0]), bricks),
        "square bar": (box * [4.0, 1.0, 1.0], cells),
        "hexagonal bar": (prism, np.array([[*row, *(k + 6 for k in row)] for row in rows])),
        "no whole number": ring(33.0),
        "wall of a tube": ring(180.0),
        "rest of a disk": ring(300.0, across=12),
        "taper of 40 degrees": (np.hstack([1.0 + box[:, :1], wide, 0.1 * box[:, 2:]]), cells),
        "plane strip": (plane * [4.0, 1.0, 0.0], quads),
        "plane taper": (np.hstack([1.0 + plane[:, :1], narrow, plane[:, 2:]]), quads),
    }


@pytest.mark.parametrize("name", bars())
def test_other_bodies_are_no_sector(name: str) -> None:
    assert found(*bars()[name]) is None


def test_sector_without_a_bore_is_found() -> None:
    sector = found(*ring(30.0, inner=1e-7))
    assert sector is not None and sector.number == 12


@pytest.mark.parametrize(("number", "kind"), [(3, NoteKind.REMARK), (5, NoteKind.WARNING)])
def test_few_sectors_cast_no_doubt(number: int, kind: NoteKind) -> None:
    sector = found(*ring(360.0 / number))
    assert sector is not None and sector.note.kind is kind


def written(path: Path) -> Path:
    """A mesh file of one of 24 sectors with the groups left, right and bore."""
    points, cells = ring(15.0)
    angle, radius = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
    fields = {
        "right": angle < 1e-9,
        "left": angle > np.radians(15.0) - 1e-9,
        "bore": radius < 0.061,
    }
    data = {name: marks.astype(int) for name, marks in fields.items()}
    meshio.Mesh(points, [("hexahedron", cells)], point_data=data).write(path)
    return path


def test_inspection_names_the_sector_and_init_clamps_no_cut_face(tmp_path: Path) -> None:
    mesh = inspect(written(tmp_path / "sector.vtu"))
    assert any("one of 24 sectors" in warning for warning in mesh.warnings)
    text = starter_scene(mesh, tmp_path)
    assert tomllib.loads(text)["supports"] == [{"group": "bore"}]
    assert "fenicsrom modes,\n# campbell, run, sweep, compare and response:\n# [cyclic]" in text


PUSH = {"group": "right", "direction": [0.0, 0.0, 1.0], "force": 1.0}


def test_table_of_init_makes_a_plane_sector_the_disk(tmp_path: Path) -> None:
    """The bladed plane sector of 60°, with its table taken from behind the comment signs."""
    mesh = tmp_path / scene_of(tmp_path, *bladed()).geometry.mesh
    text = starter_scene(inspect(mesh), tmp_path)
    table = text[text.index("# [cyclic]") : text.index("[basis]")].replace("# ", "")
    scene = parse_scene(tomllib.loads(text.replace("# [cyclic]", table)), "scene", tmp_path)
    assert scene.cyclic is not None and scene.cyclic.sectors == 6
    assert solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED).cut is not None


@pytest.mark.parametrize(
    ("held", "loads", "is_warned"),
    [("bore", [], True), ("left", [], False), ("bore", [PUSH], False)],
)
def test_run_warns_of_a_sector_with_free_cut_faces(
    held: str, loads: list[Any], is_warned: bool, tmp_path: Path
) -> None:
    table = {
        "geometry": {"mesh": written(tmp_path / "sector.vtu").name, "dimension": 3},
        "material": {"young": 2e11, "poisson": 0.3, "density": 7800.0},
        "supports": [{"group": held}],
        "loads": loads,
    }
    scene = parse_scene(table, "scene", tmp_path, unloaded=True)
    body = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED)
    assert any("one of 24 sectors" in text for text in body.warnings) == is_warned
