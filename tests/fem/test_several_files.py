"""Bodies of several files: their groups, their units, and what is kept of the files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI
from support import refusal
from test_cad import step_file
from test_deck_physics import PLACES

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.store.scene_changes import changed_key, changed_scene
from fenicsrom.online.store.store import mesh_digest
from fenicsrom.post.base.origin import Origin, python_origin, read_record, write_origin
from fenicsrom.scene import Scene, parse_scene, read_scene
from fenicsrom.study.output_folder import output_folder


def cube(folder: Path, name: str, at: float) -> Path:
    """A deck of a cube of 1 mm with the facets `low` and `high` across x, which begins at x."""
    nodes = "".join(f"{k}, {at + x}, {y}, {z}\n" for k, (x, y, z) in enumerate(PLACES, 1))
    cells = "*ELEMENT, TYPE=C3D8, ELSET=cube\n1, 1,2,3,4,5,6,7,8\n"
    sides = "*SURFACE, NAME=low\n1, S6\n*SURFACE, NAME=high\n1, S4\n"
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(f"*NODE\n{nodes}{cells}{sides}")
    return folder / name


def joined(folder: Path, *also: str, **more: Any) -> Scene:
    """A bar of three cubes in mm, which ties join; a pressure pulls it."""
    units = {"length": "mm", "mass": "t", "time": "s"}
    table = {
        "units": units,
        "geometry": {"mesh": "a.inp", "also": list(also), "dimension": 3, "degree": 1, **more},
        "material": {"young": 2.1e5, "poisson": 0.0, "density": 7.8e-9},
        "materials": [{"group": "b", "young": 1e5, "poisson": 0.0, "density": 7.8e-9}],
        "supports": [{"group": "low"}],
        "ties": [{"group": "b.low", "against": "high"}, {"group": "c.1", "against": "b.high"}],
        "loads": [{"group": "c.2", "pressure": -10.0}],
        "probe": {"group": "c.2"},
        "time": {"duration": 1.0, "step": 0.1},
    }
    return parse_scene(table, "scene", folder, unloaded=True)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with two decks and a .step file of cubes in a row."""
    cube(tmp_path, "a.inp", 0.0)
    cube(tmp_path, "b.inp", 1.0)
    step_file(tmp_path / "c.step", lambda occ: occ.addBox(2, 0, 0, 1, 1, 1))
    return tmp_path


@pytest.mark.slow
def test_bodies_of_three_files_move_as_one_bar(folder: Path) -> None:
    """Reference: a bar of three tied bodies, of two decks and a CAD file | closed form |
    0.1952 µm | 0.03 % | 0.2 %"""
    scene = joined(folder, "b.inp", "c.step", size=1.0)
    mesh = build_mesh(scene.geometry, MPI.COMM_WORLD)
    assert {"low", "b.low", "c.1"} < mesh.facet_groups.keys()
    assert {"cube", "b.cube", "b", "c"} < mesh.cell_groups.keys()
    body = solid_of(scene, mesh)
    moved = np.asarray(body.probe_rows @ body.equilibrium)[0]
    assert moved == pytest.approx(1e-3 * 10.0 * (2.0 / 2.1e5 + 1.0 / 1e5), rel=2e-3)


def test_folder_of_results_keeps_all_files(folder: Path) -> None:
    scene, out = joined(folder, "b.inp", "c.step", size=1.0), folder / "out"
    out.mkdir()
    write_origin(out, scene, python_origin(), 1, [])
    record = read_record(out)
    assert record is not None and {"a.inp", "b.inp", "c.step"} <= set(record["results"])
    again = read_scene(out / "scene.toml")
    assert [file.parent for file in again.geometry.files] == 3 * [out.resolve()]
    assert changed_key(scene, again) is None
    assert changed_key(scene, changed_scene(scene, "ties.1.against='high'")) == "ties"
    digest = mesh_digest(scene.geometry.files)
    assert digest == mesh_digest(again.geometry.files)
    cube(folder, "b.inp", 1.5)
    assert digest != mesh_digest(scene.geometry.files)


def test_motion_of_a_stored_model_of_several_files_is_made_again_in_its_folder(
    folder: Path,
) -> None:
    scene, model = joined(folder, "b.inp"), folder / "model.npz"
    model.touch()
    for _ in range(2):  # the second time it replaces its own results
        with output_folder(folder / "out", scene, origin=Origin((), ("run",), model=model)):
            (folder / "out" / "history.npz").touch()


def test_files_that_cannot_be_told_apart_are_refused(folder: Path) -> None:
    cube(folder / "other", "a.inp", 3.0)
    with refusal(ErrorKind.CONFLICT, "geometry.also[0]", "scene", names="different names"):
        joined(folder, "other/a.inp")
    (folder / "b.geo").write_text("")
    with refusal(ErrorKind.CONFLICT, "geometry.also[0]", "scene"):
        joined(folder, "b.geo")
    with refusal(ErrorKind.FILE, "geometry.also[0]", "scene"):
        joined(folder, "absent.inp")
    (folder / "cube.inp").write_text((folder / "b.inp").read_text())
    scene = joined(folder, "cube.inp")  # the cells of a.inp have this name
    with refusal(ErrorKind.MESH, "geometry.also", "cube.inp", names="cube"):
        build_mesh(scene.geometry, MPI.COMM_WORLD)
