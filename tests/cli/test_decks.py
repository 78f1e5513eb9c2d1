"""Decks of pre-processors in `inspect` and `init`: what they promise can be run."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("gmsh")
from fenicsrom.cli import main
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.notes import note_of
from fenicsrom.post.studies import mesh_report
from fenicsrom.post.studies.starter import starter_scene
from fenicsrom.scene import Scene, parse_scene, read_scene

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def nastran(path: Path, bulk: str, size: float = 1.0, head: str = "SPC = 1\nLOAD = 1\n") -> Path:
    """A bar of four cubes along x; the grids 1 to 4 are at x = 0, and 17 to 20 at the other end."""
    grids = "".join(
        f"GRID,{4 * k + n},,{k * size!r},{y * size!r},{z * size!r}\n"
        for k in range(5)
        for n, (y, z) in enumerate(CORNERS, 1)
    )
    cells = "".join(
        f"CHEXA,{k // 4 + 1},1,{','.join(str(k + n) for n in range(1, 7))},+\n+,{k + 7},{k + 8}\n"
        for k in range(0, 16, 4)
    )
    text = f"SOL 101\nCEND\n{head}BEGIN BULK\n{grids}{cells}PSOLID,1,1\n{bulk}ENDDATA\n"
    path.write_text(text)
    return path


def starter(path: Path) -> Scene:
    """The starter scene of a deck, without loads in time."""
    table = tomllib.loads(starter_scene(inspect(path), path.parent))
    return parse_scene(table, "a.toml", path.parent, unloaded=True)


def test_deck_in_kilopascals_gives_si_units(tmp_path: Path) -> None:
    bulk = "MAT1,1,2.1+8,,0.3,7.85-6\nSPC1,1,123,1,2,3,4\nFORCE,1,17,,2.5+4,0.,0.,1.\n"
    path = nastran(tmp_path / "a.bdf", bulk, size=50.0)
    scene = starter(path)
    assert (scene.material.young, scene.material.density) == (2.1e11, 7850.0)
    assert scene.geometry.scale == 1e-3 and scene.loads[0].size == pytest.approx(25.0)
    assert "mm, kg, s" in mesh_report.scale_hint(inspect(path))


@pytest.mark.parametrize(
    ("young", "density", "size", "said"),
    [
        ("2.1+11", "7850.", 50.0, "--scale 0.001"),
        ("2.1+5", "", 0.1, "mm,g,ms"),
        ("1.", "1.", 0.1, "no usual system"),
        ("2.1+11", "7850.", 0.1, ""),
    ],
)
def test_doubtful_units_are_said(
    tmp_path: Path, young: str, density: str, size: float, said: str
) -> None:
    path = nastran(tmp_path / "a.bdf", f"MAT1,1,{young},,0.3,{density}\nSPC1,1,123,1\n", size)
    hint = mesh_report.scale_hint(inspect(path))
    assert said in hint and bool(hint) == bool(said)


STEEL = "MAT1,1,2.1+11,,0.3,7850.\n"


@pytest.mark.parametrize(
    ("bulk", "names"),
    [
        ("MAT9,1,1.+9,0.,0.,0.,0.,0.,1.+9\nSPC1,1,123,1,2,3,4\n", "material.young"),
        (f"{STEEL}SPC1,1,123,1\n", "supports"),
        (f"{STEEL}SPC1,1,123,1,2,3,4\nSPC1,1,3,17\n", "contacts[0]"),
    ],
)
def test_starter_scene_that_cannot_run_is_not_recommended(
    tmp_path: Path, bulk: str, names: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    path = nastran(tmp_path / "a.bdf", bulk)
    task = ["--template", "stop", "--tip", "SPC 1 z"] if names == "contacts[0]" else []
    assert main(["init", str(path), *task]) == 2
    said = capsys.readouterr()
    assert names in said.err and "a.toml" in said.err
    assert "Now run" not in said.out and (tmp_path / "a.toml").exists()


def test_starter_scene_of_a_support_through_a_rigid_element_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    rigid = "GRID,90,,-1.,.5,.5\nRBE2,9,90,123456,1,2,3,4\nSPC1,1,123456,90\n"
    path = nastran(tmp_path / "a.bdf", f"{rigid}FORCE,1,17,,10.,0.,0.,1.\nFORCE,1,1,,9.,0.,0.,1.\n")
    doubts = [note for note in inspect(path).warnings if note_of(note).kind.doubts]
    assert doubts == []  # the set of the support has grid 90 alone
    scene_file = tmp_path / "scenes" / "a.toml"  # the folder does not exist yet
    assert main(["init", str(path), "--output", str(scene_file)]) == 0
    said = capsys.readouterr().out
    assert "Now run" in said and "steel" in said and "1 force at held nodes" in said
    scene = read_scene(scene_file)
    assert [support.group for support in scene.supports] == ["RBE2 9"] and len(scene.loads) == 2
    assert main(["plan", str(scene_file)]) == 0


@pytest.mark.parametrize(
    "support",
    [
        "SPC1,1,123,90\n",
        "RBE2,9,90,123456,1,2\nSPC1,1,123,90\n",
        "RBE3,9,,90,123,1.,123,1,2\nSPC1,1,123,90\n",
        "SPC,1,1,123,.1\n",
    ],
)
def test_support_that_is_not_taken_is_said_beside_the_guess(tmp_path: Path, support: str) -> None:
    bulk = f"{STEEL}GRID,90,,0.,.5,.5\n{support}"
    found = inspect(nastran(tmp_path / "a.bdf", bulk))
    assert "a guess" in starter_scene(found, tmp_path)
    assert "support" not in "\n".join(mesh_report.lines(found, None)).partition("not taken")[0]


def test_shells_in_space_are_refused_as_shells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grids = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,1.,1.,1.\nGRID,4,,0.,1.,1.\n"
    path = tmp_path / "a.bdf"
    path.write_text(f"BEGIN BULK\n{grids}CQUAD4,1,1,1,2,3,4\nPSHELL,1,1,.01\n{STEEL}ENDDATA\n")
    assert main(["init", str(path)]) == 2
    assert "shells are not supported" in capsys.readouterr().err


def test_plane_deck_brings_thickness_point_and_direction(tmp_path: Path) -> None:
    nodes = "*NODE\n1,0.,0.\n2,1.,0.\n3,1.,1.\n4,0.,1.\n*ELEMENT, TYPE=CPE4, ELSET=E\n1,1,2,3,4\n"
    text = nodes + "*SOLID SECTION, ELSET=E, MATERIAL=m\n0.25,\n*MATERIAL, NAME=M\n*ELASTIC\n"
    text += "2e11, 0.3\n*DENSITY\n7800.,\n*BOUNDARY\n1, 1, 3\n4, 1, 2\n*STEP\n*STATIC\n*CLOAD\n"
    path = tmp_path / "a.inp"
    path.write_text(text + "3, 2, -8.\n*END STEP\n")
    scene = starter(path)
    assert scene.geometry.thickness == 0.25 and scene.geometry.plane == "strain"
    (load,) = scene.loads
    assert load.place.node == (1.0, 1.0) and load.direction == (0.0, -1.0) and load.size == 8.0
