"""The commands inspect and init, and modes of a scene without loads."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import refusal

from fenicsrom.errors import ErrorKind, SceneError

pytest.importorskip("gmsh")
from fenicsrom.assess.studies.first_mode import FirstMode
from fenicsrom.cli import main
from fenicsrom.cli.commands import make_parser
from fenicsrom.cli.output import output_path
from fenicsrom.fem.mesh.inspection import inspect
from fenicsrom.post.studies import mesh_report
from fenicsrom.post.studies.starter import outer_normal, starter_scene, units_of
from fenicsrom.scene import Support, parse_scene, read_scene
from fenicsrom.scene.reading.reading import shared_meshes

BAR = """*NODE
{nodes}*ELEMENT, TYPE=C3D8, ELSET=bar
{cells}*ELEMENT, TYPE=MASS
100, 1
*MATERIAL, NAME=steel
*TIE, NAME=glue
"""


def bar(path: Path, number: int = 3, size: float = 0.1, sets: str = "") -> Path:
    """A bar of cubes along z."""
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    places = [(x, y, z) for z in range(number + 1) for x, y in corners]
    nodes = "".join(
        f"{k}, {x * size}, {y * size}, {z * size}\n" for k, (x, y, z) in enumerate(places, 1)
    )
    rows = [range(4 * k + 1, 4 * k + 9) for k in range(number)]
    cells = "".join(f"{k}, {', '.join(map(str, row))}\n" for k, row in enumerate(rows, 1))
    path.write_text(BAR.format(nodes=nodes, cells=cells) + sets)
    return path


def test_inspection_gives_cells_box_volume_groups_and_what_is_not_read(tmp_path: Path) -> None:
    sets = "*NSET, NSET=bar\n1, 2, 3, 4\n*NSET, NSET=corner\n13\n*SURFACE, NAME=side\nbar, S3\n"
    found = inspect(bar(tmp_path / "bar.inp", sets=sets))
    assert found.cells == {"hexahedra": 3} and found.nodes == 16 and found.pieces == 1
    assert found.volume == pytest.approx(3e-3, rel=1e-12)
    assert found.low.tolist() == [0, 0, 0] and found.high == pytest.approx((0.1, 0.1, 0.3))
    groups = {(group.name, group.kind): (group.number, group.size) for group in found.groups}
    assert groups["bar", "cells"] == (3, pytest.approx(3e-3))
    assert groups["bar", "facets"] == (1, pytest.approx(1e-2))
    assert groups["side", "facets"] == (3, pytest.approx(3e-2))
    assert groups["bar", "nodes"] == (4, None) and groups["corner", "nodes"] == (1, None)
    (warning,) = found.warnings
    assert "not read: *TIE" in warning
    text = "\n".join(mesh_report.lines(found, 1000.0))
    assert "0.003 m³" in text and "3 kg" in text and not mesh_report.scale_hint(found)


def test_body_of_150_m_draws_a_hint(tmp_path: Path) -> None:
    path = bar(tmp_path / "bar.inp", size=50.0)
    assert "mm, t, s" in mesh_report.scale_hint(inspect(path))
    scaled = inspect(path, scale=1e-3)
    assert not mesh_report.scale_hint(scaled) and scaled.extent == pytest.approx(0.15)


def test_inspection_of_curved_cells_and_of_a_plane_mesh() -> None:
    found = inspect(shared_meshes() / "beam2d.geo")
    assert found.geometry.thickness == 1.0  # m
    assert found.geometry.dimension == 2 and found.volume == pytest.approx(2.54 * 0.0254)
    assert "metre of thickness" in "\n".join(mesh_report.lines(found, 1.0))


PLATE = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 0.3, 0.2};
Physical Surface("solid") = {1};
Physical Curve("root") = {4};
Mesh.MeshSizeMax = 0.05;
"""


def test_plane_part_of_triangles_is_drawn_and_its_starter_scene_names_the_cells(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "plate.geo"
    path.write_text(PLATE)
    assert main(["inspect", str(path), "--output", str(tmp_path / "out")]) == 0
    assert "was not drawn" not in capsys.readouterr().err
    assert (tmp_path / "out" / "mesh.png").stat().st_size > 1000
    assert tomllib.loads(starter_scene(inspect(path), tmp_path))["geometry"]["cells"] == "simplex"


def test_mesh_that_cannot_be_used_is_described_and_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bar(tmp_path / "bar.inp")
    path.write_text(path.read_text().replace("1, 1, 2, 3, 4,", "1, 2, 1, 3, 4,"))
    assert main(["inspect", str(path), "--output", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "3 hexahedra" in said.out and "bar.inp" in said.err


@pytest.mark.parametrize(("option", "text"), [("density", "inf"), ("scale", "-1"), ("size", "nan")])
def test_option_that_is_no_positive_number_is_refused(
    tmp_path: Path, option: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bar(tmp_path / "bar.inp")
    assert main(["inspect", str(path), f"--{option}={text}", "--output", str(tmp_path)]) == 2
    assert f"--{option} {text}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("sets", "key", "value"),
    [
        ("*NSET, NSET=a\n13,14,15,16\n*NSET, NSET=my root\n1,2,3,4\n", "group", "my root"),
        ("", "plane", {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}),
    ],
)
def test_starter_scene_clamps_a_likely_part(
    tmp_path: Path, sets: str, key: str, value: object
) -> None:
    path = bar(tmp_path / "bar.inp", sets=sets)
    table = tomllib.loads(starter_scene(inspect(path), tmp_path))
    assert table["supports"] == [{key: value}] and table["geometry"]["mesh"] == "bar.inp"
    assert parse_scene(table, "s.toml", tmp_path, unloaded=True).probe is None
    with refusal(ErrorKind.MISSING, key="probe"):
        parse_scene(table, "s.toml", tmp_path)


def test_existing_scene_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bar(tmp_path / "bar.inp")
    monkeypatch.chdir(tmp_path)
    assert main(["init", str(path)]) == 0 and (tmp_path / "bar.toml").exists()
    (tmp_path / "bar.toml").write_text("mine")
    assert main(["init", str(path)]) == 2 and (tmp_path / "bar.toml").read_text() == "mine"
    assert "bar.toml" in capsys.readouterr().err


SQUARES = """*NODE
1, 0, 0
2, 1, 0
3, 2, 0
4, 0, 1
5, 1, 1
6, 2, 1
*ELEMENT, TYPE=CPS4
1, 1, 2, 5, 4
2, 2, 3, 6, 5
"""


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_starter_scene_of_a_mesh_without_groups_runs(dimension: int, tmp_path: Path) -> None:
    path = bar(tmp_path / "bar.inp")
    path.write_text(SQUARES if dimension == 2 else path.read_text().replace(", ELSET=bar", ""))
    scene, out = tmp_path / "bar.toml", tmp_path / "out"
    assert main(["init", str(path)]) == 0
    settings = ["--set=time.periods=1", "--set=output.pictures=false", f"--output={out}"]
    assert main(["run", str(scene), *settings]) == 0
    assert (out / "summary.json").exists() and (out / "results.pvd").exists()
    assert not (out / "groups.vtu").exists()


@pytest.mark.parametrize("suffix", [".msh", ".inp"])
def test_mesh_in_place_of_a_scene_is_refused_with_a_hint(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"part{suffix}"
    path.write_text("a mesh")
    with pytest.raises(SceneError, match=f"fenicsrom init {path}"):
        read_scene(path)


def test_commands_have_folders_of_their_own() -> None:
    parser = make_parser()

    def folder(*words: str) -> str:
        return str(output_path(parser.parse_args(words)))

    assert folder("run", "a/fan.toml") == "out/fan"
    assert folder("modes", "a/fan.toml") == "out/fan_modes"
    assert folder("modes", "out/fan_modes/scene.toml") == "out/fan_modes"
    assert folder("response", "--from", "out/fan/reduced_model.npz") == "out/reduced_model_response"


@pytest.mark.slow
def test_campbell_needs_no_load(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("dolfinx")
    scene = tmp_path / "a.toml"
    text = starter_scene(inspect(bar(tmp_path / "bar.inp")), tmp_path)
    turning = "[rotation]\nspeed_rpm = 1000\naxis = [1, 0, 0]\n[campbell]\nmodes = 2\n"
    scene.write_text(text + turning + "speeds_rpm = [0, 1000]\n")
    assert main(["campbell", str(scene), "--output", str(tmp_path / "out")]) == 0


DECK = """*MATERIAL, NAME=Titanium
*ELASTIC
1.1e5, 0.31
*DENSITY
4.43e-9
*BOUNDARY
low, 1, 3
"""


@pytest.mark.slow
@pytest.mark.parametrize("template", ["response", "stop", "rub", "damper", "statics"])
def test_starter_scene_of_a_deck_runs(
    tmp_path: Path, template: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the material and the supports of the deck, in its units, beside the deck."""
    pytest.importorskip("dolfinx")
    sets = "*NSET, NSET=low\n1,2,3,4\n*NSET, NSET=high\n65,66,67,68\n" + DECK
    path = bar(tmp_path / "bar.inp", number=16, size=10.0, sets=sets)
    assert main(["init", str(path), "--template", template, "--tip", "high"]) == 0
    scene = read_scene(tmp_path / "bar.toml")
    assert (scene.material.young, scene.material.density) == (1.1e11, 4430.0)
    assert scene.supports == (Support(group="low"),) and scene.geometry.scale == 1e-3
    assert scene.damping.ratios == 0.01
    if template == "rub":
        assert scene.rotation is not None and scene.rotation.axis != (0.0, 0.0, 1.0)
        assert not scene.loads and scene.period == pytest.approx(60.0 / scene.rotation.speed_rpm)
    elif scene.contacts:
        normal = np.array(scene.contacts[0].normal)
        assert abs(normal[2]) == pytest.approx(1.0) or template == "damper"
    command = "statics" if template == "statics" else "run"
    quick = ["--set", "output.pictures=false", "--set", "output.paraview=false"]
    code = main([command, str(tmp_path / "bar.toml"), "--output", str(tmp_path / "out"), *quick])
    assert code == 0
    assert ("axis of rotation is a guess" in "".join(capsys.readouterr())) == (template == "rub")
    if template == "rub":
        with np.load(tmp_path / "out" / "history.npz") as history:
            assert history["reduced_force"].max() > 0.0


def test_groups_for_root_and_tip_are_taken(tmp_path: Path) -> None:
    sets = "*NSET, NSET=a\n1,2,3,4\n*NSET, NSET=b\n13,14,15,16\n"
    found = inspect(bar(tmp_path / "bar.inp", sets=sets))
    table = tomllib.loads(starter_scene(found, tmp_path, root="b"))
    assert table["supports"] == [{"group": "b"}]
    with refusal(ErrorKind.PLACE, "root", "bar.inp"):
        starter_scene(found, tmp_path, root="c")
    group = next(group for group in found.groups if (group.name, group.kind) == ("b", "facets"))
    assert outer_normal(found, group) == pytest.approx([0.0, 0.0, 1.0])


def test_starter_scene_of_statics_takes_the_loads_of_the_deck_alone(tmp_path: Path) -> None:
    step = "*STEP\n*STATIC\n*CLOAD\n13, 1, 5.\n*END STEP\n"
    found = inspect(bar(tmp_path / "bar.inp", sets=f"{DECK.replace('low', '1')}{step}"))
    mode = FirstMode(100.0, (0.0, 0.0, 0.3), (1.0, 0.0, 0.0), 1e5, 0.3)
    scene = starter_scene(found, tmp_path, template="statics", mode=mode)
    assert [load["force"] for load in tomllib.loads(scene)["loads"]] == [5.0]
    step = step.replace("*CLOAD\n13, 1, 5.", "*DLOAD\n, GRAV, 9., 0., 0., -1.")
    found = inspect(bar(tmp_path / "bar.inp", sets=f"{DECK.replace('low', '1')}{step}"))
    table = tomllib.loads(starter_scene(found, tmp_path, template="statics", mode=mode))
    assert len(table["loads"]) == 1 and table["probe"] == {"nearest": [0.0, 0.0, 300.0]}
    bare = inspect(bar(tmp_path / "bar.inp"))
    scene = starter_scene(bare, tmp_path, template="statics", mode=mode)
    assert len(tomllib.loads(scene)["loads"]) == 1


@pytest.mark.parametrize(
    ("tip", "per"), [("face", "per mm² of facets"), ("edge", "per node, on a curve in 3D per mm")]
)
def test_contact_of_a_starter_scene_says_the_units_of_its_nodes(
    tmp_path: Path, tip: str, per: str
) -> None:
    sets = "*NSET, NSET=face\n13,14,15,16\n*NSET, NSET=edge\n13,14\n"
    found = inspect(bar(tmp_path / "bar.inp", sets=sets))
    mode = FirstMode(100.0, (0.0, 0.0, 0.3), (1.0, 0.0, 0.0), 1e5, 0.3)
    units = units_of(found, "mm,t,s")
    text = starter_scene(found, tmp_path, units=units, tip=tip, template="damper", mode=mode)
    (line,) = [line for line in text.splitlines() if 'at = "nodes"' in line]
    assert per in line and "# N/mm" in text


@pytest.mark.parametrize(
    ("given", "names"), [("mm,t,s", "mm, t, s, N, MPa"), ("m,kg,s", "m, kg, s, N, Pa")]
)
def test_units_of_a_starter_scene_are_given(tmp_path: Path, given: str, names: str) -> None:
    found = inspect(bar(tmp_path / "bar.inp"))
    units, _ = units_of(found, given)
    assert units.names == names
    with refusal(ErrorKind.RANGE, "units"):
        units_of(found, "inch,t,s")
    with refusal(ErrorKind.RANGE, "units", "part.geo", "in m"):
        units_of(replace(found, path=Path("part.geo")), "mm,t,s")
