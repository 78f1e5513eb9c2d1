"""An output folder holds one run, and says which."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from support import refusal

import fenicsrom
from fenicsrom.errors import ErrorKind
from fenicsrom.post.base.origin import Origin, checksum, is_result, origin_table, read_record
from fenicsrom.post.curves.response_report import FOLDER
from fenicsrom.post.paraview.paraview import BLOCKS
from fenicsrom.scene import Scene, read_scene, scene_heading, scene_table
from fenicsrom.study import output_folder
from fenicsrom.study.curves import STATE
from fenicsrom.study.sweeps import MODELS, RUNS

DEMO = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
ORIGIN = Origin(("fenicsrom", "run", "a b.toml"), ("run",), ("x=1",))


def scene(*overrides: str) -> Scene:
    return read_scene(DEMO, overrides)


def run(folder: Path, wanted: Scene, *results: str, overwrite: bool = False) -> None:
    """Write some results into an output folder."""
    with output_folder(folder, wanted, None, ORIGIN, overwrite):
        for name in results:
            (folder / name).write_text(wanted.title)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


RECORDS = {"scene.toml", "provenance.json", "beam2d.geo"}


def test_folder_tells_what_was_run_and_how_to_repeat_it(tmp_path: Path) -> None:
    wanted = scene("loads.0.force=120", "time.tolerance=1e-3")
    run(tmp_path, wanted, "report.html")
    record = read_record(tmp_path)
    assert record is not None
    assert (record["state"], record["ranks"]) == ("complete", 1)
    assert record["command"] == "fenicsrom run 'a b.toml'" and record["overrides"] == ["x=1"]
    assert record["mesh"]["sha256"] == checksum(wanted.geometry.mesh)
    assert record["began"] <= record["ended"] and record["versions"]["numpy"]
    assert set(record["results"]) == {"report.html", "beam2d.geo"}
    again = read_scene(tmp_path / "scene.toml")
    assert again.geometry.mesh == (tmp_path / "beam2d.geo").resolve()
    table, copy = scene_table(wanted), scene_table(again)
    assert table["geometry"].pop("mesh") != copy["geometry"].pop("mesh")
    assert table == copy and scene_heading(again) == scene_heading(wanted)
    cells = [cell for row in origin_table(tmp_path) for cell in row]
    assert record["command"] in cells and "x=1" in cells


def test_same_scene_replaces_its_results(tmp_path: Path) -> None:
    run(tmp_path, scene(), "report.html", "sweep.csv")
    (tmp_path / "notes.txt").write_text("mine")
    run(tmp_path, scene(), "report.html")
    assert names(tmp_path) == RECORDS | {"report.html", "notes.txt"}


def test_another_scene_is_replaced_only_on_request(tmp_path: Path) -> None:
    run(tmp_path, scene(), "report.html", "sweep.csv")
    other = scene("loads.0.force=1.0")
    with refusal(ErrorKind.FILE, "--output", tmp_path.name):
        run(tmp_path, other, "report.html")
    assert names(tmp_path) == RECORDS | {"report.html", "sweep.csv"}
    assert (tmp_path / "report.html").read_text() == scene().title
    run(tmp_path, other, "report.html", overwrite=True)
    assert names(tmp_path) == RECORDS | {"report.html"}
    assert (tmp_path / "report.html").read_text() == other.title


def test_changed_mesh_file_is_another_run(tmp_path: Path) -> None:
    text = DEMO.read_text()
    (tmp_path / "a.toml").write_text(text)
    mesh = tmp_path / "beam2d.geo"
    mesh.write_bytes(scene().geometry.mesh.read_bytes())
    run(tmp_path / "out", read_scene(tmp_path / "a.toml"), "report.html")
    mesh.write_text(mesh.read_text() + "\n// finer\n")
    with refusal(ErrorKind.FILE, "--output", "out"):
        run(tmp_path / "out", read_scene(tmp_path / "a.toml"), "report.html")


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_run_without_results_keeps_those_of_its_scene(
    tmp_path: Path, error: type[BaseException]
) -> None:
    run(tmp_path, scene(), "report.html", "sweep.csv")
    with pytest.raises(error), output_folder(tmp_path, scene(), None, ORIGIN):
        raise error
    assert names(tmp_path) == RECORDS | {"report.html", "sweep.csv"}
    record = read_record(tmp_path)
    assert record is not None and record["state"] != "complete"
    assert set(record["results"]) == {"report.html", "sweep.csv", "beam2d.geo"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_run_without_results_leaves_no_record(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), output_folder(tmp_path / "new", scene(), None, ORIGIN):
        raise error
    assert not (tmp_path / "new").exists()
    run(tmp_path, scene(), "report.html")
    (tmp_path / "notes.txt").write_text("mine")
    other = scene("loads.0.force=1.0")
    with pytest.raises(error), output_folder(tmp_path, other, None, ORIGIN, True):
        raise error
    assert names(tmp_path) == {"notes.txt"}


def test_files_of_the_user_in_the_folder_are_never_results(tmp_path: Path) -> None:
    """Also if they appear or change while the run writes; a forced run of another scene too."""
    mine = {"notes.txt", "edited.toml", "data", "photo.png", "motion.txt", "my_report.html"}
    (tmp_path / "notes.txt").write_text("before")

    def change() -> None:
        for name in mine - {"data"}:
            (tmp_path / name).write_text("mine")
        (tmp_path / "data").mkdir(exist_ok=True)
        (tmp_path / "data" / "report.html").write_text("mine")

    for overrides in ((), ("loads.0.force=1.0",)):
        with output_folder(tmp_path, scene(*overrides), None, ORIGIN, True):
            change()
            (tmp_path / "report.html").write_text("")
        record = read_record(tmp_path)
        assert record is not None and set(record["results"]) == {"report.html", "beam2d.geo"}
    run(tmp_path, scene("loads.0.force=2.0"), "summary.json", overwrite=True)
    assert names(tmp_path) == RECORDS | mine | {"summary.json"}
    assert (tmp_path / "data" / "report.html").read_text() == "mine"


@pytest.mark.parametrize("place", ["results", "copy"])
def test_record_with_names_outside_the_folder_removes_nothing_there(
    tmp_path: Path, place: str
) -> None:
    folder, mine = tmp_path / "out", tmp_path / "mine"
    run(folder, scene(), "report.html")
    mine.write_text("mine")
    record = json.loads((folder / "provenance.json").read_text())
    record["results"].append("../mine")
    if place == "copy":
        record["mesh"] |= {"copy": "../mine", "sha256": checksum(mine)}
    (folder / "provenance.json").write_text(json.dumps(record))
    run(folder, scene("loads.0.force=1.0"), "report.html", overwrite=True)
    assert names(folder) == RECORDS | {"report.html"} and mine.read_text() == "mine"


def test_damaged_record_is_refused(tmp_path: Path) -> None:
    run(tmp_path, scene(), "report.html")
    path = tmp_path / "provenance.json"
    path.write_text("{")
    for overwrite in (False, True):
        with refusal(ErrorKind.FORMAT, "", "provenance.json"):
            run(tmp_path, scene(), "report.html", overwrite=overwrite)
    assert path.read_text() == "{"


WRITTEN = re.compile(r"[\w{}*]+\.(png|gif|html|csv|json|npz|pvd|vtu)")


def test_names_that_the_program_writes_are_all_listed() -> None:
    """Every name of a result in the code of `post`, `study` and `cli`, and of its folders."""
    package = Path(fenicsrom.__file__).parent
    # of the command inspect; the record itself; in the folder of the state; parts of the page
    elsewhere = {"mesh.png", "mesh.html", "provenance.json", "coordinates.json"}
    elsewhere |= {"page.html"}
    found = set()
    for room in ("post", "study", "cli"):
        for path in (package / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "Report":
                    found |= {
                        f"{ast.literal_eval(node.args[0])}.{kind}" for kind in ("csv", "json")
                    }
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found |= {node.value} if WRITTEN.fullmatch(node.value) else set()
    assert len(found) > 30
    assert {name for name in found - elsewhere if not is_result(name)} == set()
    folders = {FOLDER, STATE, BLOCKS, MODELS, RUNS, "motion", "contact_points", "surface_12"}
    assert all(map(is_result, folders | {"contact_1.png", "equilibria.csv", "equilibrium.vtu"}))
    assert is_result(".history.0123456789ab.npz") and is_result(".motion.0123456789ab")
    mine = {"notes.txt", "scene.toml", "my.png", "motion.avi", "contact_a.png", "runs.txt", "a.vtu"}
    assert not any(map(is_result, mine))


def test_interrupted_run_keeps_its_results_and_says_so(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path, scene(), None, ORIGIN):
        (tmp_path / "checkpoint.npz").write_text("state")
        raise KeyboardInterrupt
    record = read_record(tmp_path)
    assert record is not None and record["state"] == "interrupted"
    resumed = Origin(ORIGIN.command, resume=tmp_path / "checkpoint.npz")
    longer = scene("time.periods=200")
    with output_folder(tmp_path, longer, None, resumed):
        assert (tmp_path / "checkpoint.npz").read_text() == "state"
        (tmp_path / "report.html").write_text("")
    record = read_record(tmp_path)
    assert record is not None and {"checkpoint.npz", "report.html"} <= set(record["results"])
    assert record["resumed_from"]["file"] == str(tmp_path / "checkpoint.npz")


def test_sweep_resumes_only_in_a_folder_of_its_scene(tmp_path: Path) -> None:
    def resumed(*values: str) -> Origin:
        return Origin((), ("sweep", *values), resume=tmp_path / "runs", in_place=True)

    run(tmp_path, scene(), "report.html")
    with refusal(ErrorKind.FILE, "--output"), output_folder(tmp_path, scene(), None, resumed("a")):
        pass
    with output_folder(tmp_path, scene(), None, resumed("a"), True):
        (tmp_path / "runs").mkdir()
    with output_folder(tmp_path, scene(), None, resumed("a", "b")):
        assert (tmp_path / "runs").exists()
    other = scene("loads.0.force=1.0")
    with refusal(ErrorKind.FILE, "--output"), output_folder(tmp_path, other, None, resumed("a")):
        pass


def test_inputs_inside_the_folder_are_kept(tmp_path: Path) -> None:
    run(tmp_path, scene(), "reduced_model.npz", "report.html")
    model = Origin(ORIGIN.command, model=tmp_path / "reduced_model.npz")
    with output_folder(tmp_path, scene("loads.0.force=1.0"), None, model, True):
        (tmp_path / "report.html").write_text("")
    assert names(tmp_path) == {"scene.toml", "provenance.json", "report.html", "reduced_model.npz"}


@pytest.mark.parametrize("limit", [10, 1])
def test_model_is_copied_unless_it_is_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    model, folder = tmp_path / "model.npz", tmp_path / "out"
    model.write_text("model")
    monkeypatch.setattr("fenicsrom.post.base.origin.LARGEST_MODEL", limit)
    folder.mkdir()
    (folder / "reduced_model.npz").write_text("mine")
    checkpoint = tmp_path / "checkpoint.npz"
    origin = Origin((), model=model, resume=checkpoint)
    with output_folder(folder, scene(), None, origin, True):
        (folder / "report.html").write_text("")
    record = read_record(folder)
    assert record is not None
    name = "stored_reduced_model.npz" if limit == 10 else str(model)
    assert record["repeat"] == f"fenicsrom run scene.toml --from {name} --resume {checkpoint}"
    assert (folder / "reduced_model.npz").read_text() == "mine"
    assert (name in names(folder)) == (name in record["results"]) == (limit == 10)


def test_results_of_a_killed_run_are_replaced(tmp_path: Path) -> None:
    """Its record has no list of results; files of other kinds stay."""
    run(tmp_path, scene(), "report.html", "sweep.csv")
    record = json.loads((tmp_path / "provenance.json").read_text())
    (tmp_path / "provenance.json").write_text(
        json.dumps(record | {"state": "running", "results": None})
    )
    (tmp_path / "notes.txt").write_text("mine")
    run(tmp_path, scene("loads.0.force=1.0"), "report.html", overwrite=True)
    assert names(tmp_path) == RECORDS | {"report.html", "notes.txt"}


@pytest.mark.parametrize("name", ["scene.toml", "summary.json"])
def test_files_of_the_user_are_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with refusal(ErrorKind.FILE, "--output", tmp_path.name):
        run(tmp_path, scene(), "report.html")
    assert names(tmp_path) == {name}


HOLDER = """
import sys
from pathlib import Path
from fenicsrom.scene import read_scene
from fenicsrom.study import output_folder
with output_folder(Path(sys.argv[1]), read_scene(sys.argv[2])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
def test_second_run_in_a_folder_in_use_is_refused(tmp_path: Path) -> None:
    words = [sys.executable, "-c", HOLDER, str(tmp_path), str(DEMO)]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == "held\n"
        before = names(tmp_path)
        with refusal(ErrorKind.FILE, "--output", tmp_path.name):
            run(tmp_path, scene(), "report.html", overwrite=True)
        assert names(tmp_path) == before
        holder.kill()
        holder.wait()
    run(tmp_path, scene(), "report.html")  # the lock of a dead process holds nobody up
    assert (tmp_path / "report.html").exists()


def test_mesh_that_reads_other_files_is_named_and_not_copied(tmp_path: Path) -> None:
    mesh = tmp_path / "beam2d.geo"
    mesh.write_text('Include "sizes.geo";\n' + scene().geometry.mesh.read_text())
    (tmp_path / "a.toml").write_text(DEMO.read_text())
    run(tmp_path / "out", read_scene(tmp_path / "a.toml"), "report.html")
    record = read_record(tmp_path / "out")
    assert record is not None and record["mesh"]["copy"] is None
    assert "reads other files" in record["mesh"]["missing"]
    assert read_scene(tmp_path / "out" / "scene.toml").geometry.mesh == mesh.resolve()
