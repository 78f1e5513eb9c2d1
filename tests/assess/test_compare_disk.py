"""Disks of reduced sectors against the whole disk in finite elements."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
from mpi4py import MPI

from fenicsrom import build_solid, compare, simulate
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.full.full import full_model
from fenicsrom.post.studies.compare_report import sentences
from fenicsrom.progress import asking
from tests.disks import (
    CYCLIC,
    PERIODS,
    STEEL,
    N,
    copied,
    extruded,
    ring,
    scene_of,
    shrouded,
    spinning,
)
from tests.fem.test_disk_run import sector_scene, tables
from tests.support import refusal

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every full model runs."""
    monkeypatch.setattr("fenicsrom.online.store.store.cache_folder", lambda: None)


def test_comparison_has_the_whole_disk_beside_disks_of_sectors(tmp_path: Path) -> None:
    """Walls with friction; the whole disk of the program moves as one that is made by hand."""
    folder, chosen = tmp_path / "out", {"modes": [0, 20], "steps": [40]}
    found = compare(sector_scene(tmp_path, 2, compare=chosen), MPI.COMM_SELF, folder=folder)
    more = tables(2, range(N))
    whole = scene_of(tmp_path, *copied(*ring(), N), rotation=spinning(2), **more)
    wanted = simulate(full_model(build_solid(whole, MPI.COMM_SELF)), whole)
    assert found.full is not None
    ours, size = found.full.displacement, np.abs(wanted.displacement).max()
    np.testing.assert_allclose(ours, wanted.displacement, rtol=0.0, atol=1e-10 * size)
    few, many = found.outcomes
    assert many.errors["history"] < 1e-3 and 0.1 < few.error < 0.5  # percent
    assert many.error < 2e-3 and many.errors["state"] == 0.0
    assert (len(few.labels), len(many.labels)) == (10, 30)
    told = json.loads((folder / "comparison.json").read_text())
    assert told["dofs"] == found.unknowns == 192
    said = " ".join(sentences(found))
    assert "disk of reduced sectors is rubin, 20V" in said and "30 coordinates of a sector" in said
    names = {file.name for file in found.files}
    assert {"pareto.png", "size.png"} < names and "indicator.png" not in names


def test_materials_of_the_whole_disk_turn_and_are_mistuned(tmp_path: Path) -> None:
    """An orthotropic ring at rest, under forces beside a node that are alike in all sectors."""
    (load,) = tables(0, range(1))["loads"]
    del load["engine_order"]
    load["nearest"] = [1.01 * x for x in load["nearest"]]
    given = tables(0, range(1)) | {
        "material": STEEL | {"young": [2e11, 1e11], "poisson": [0.3, 0.3], "shear": 5e10},
        "cyclic": CYCLIC | {"mistuning": [0.3, -0.2, 0.1, 0.0, 0.05, -0.1]},
        "compare": {"modes": [0, 20]},
        "loads": [load | {"frequency": 900.0}],
    }
    found = compare(scene_of(tmp_path, *ring(), **given), MPI.COMM_SELF)
    few, many = found.outcomes
    assert many.errors["history"] < 1e-3 < few.errors["history"]  # percent
    (noted,) = (note for note in found.warnings if "raise basis.modes" in note)
    assert noted.startswith(few.combination.name)
    keys = [note.key for note in found.warnings if "the nearest node" in note]
    assert sorted(keys) == ["loads[0]", "probe"]


def test_interrupted_comparison_keeps_the_disks_that_are_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[Any] = []
    where = "fenicsrom.assess.studies.compare_disk.errors_against"
    monkeypatch.setattr(where, lambda *given: done.append(given) or {})
    scene = sector_scene(tmp_path, 2, compare={"modes": [1, 2]})
    with asking(lambda: bool(done)):
        found = compare(scene, MPI.COMM_SELF)
    assert found.interrupted and len(found.outcomes) == 1
    assert "interrupted" in " ".join(sentences(found))
    with pytest.raises(KeyboardInterrupt), asking(lambda: True):
        compare(scene, MPI.COMM_SELF)


def test_frames_of_a_disk_in_space_turn_with_its_sectors(tmp_path: Path) -> None:
    """The nodes of the tips rub along a round casing, under a load on a group."""
    points, cells, ends = extruded(shrouded())
    n = len(points) // 2
    middle = np.pi / N
    along = [-np.sin(middle), np.cos(middle), 0.3]
    casing = {"kind": "cylinder", "point": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0]}
    wall = {"group": "tip", "at": "nodes", "surface": casing, "preload": 100.0, "friction": 0.3}
    wall |= {"normal_stiffness": 1e6, "tangential_stiffness": 1e6}
    load = {"group": "tip", "direction": along, "force": 2e4, "engine_order": 2}
    scene = scene_of(
        tmp_path,
        points,
        cells,
        ends=ends | {"tip": np.array([14, 15, 14 + n, 15 + n])},
        cyclic=CYCLIC | {"axis": [0.0, 0.0, 1.0]},
        rotation=spinning(3) | {"speed_rpm": 1e3},
        loads=[load],
        contacts=[wall],
        damping={"stiffness": 2e-5},
        time=PERIODS,
        geometrically_nonlinear=False,
        probe={"group": "tip"},
        compare={"modes": [20]},
    )
    (found,) = compare(scene, MPI.COMM_SELF).outcomes
    assert found.errors["history"] < 1e-3 and found.error < 1e-3  # percent


def test_boxes_and_planes_are_picked_in_every_sector_of_the_whole_disk(tmp_path: Path) -> None:
    """The same places as groups: the bore, and the rim after and before its middle."""
    given = tables(2, range(1))
    (load,), (wall,) = given["loads"], given["contacts"]
    del load["nearest"], wall["nearest"]
    rim = {"point": [0.3, 0.0], "normal": [np.cos(np.pi / 12), np.sin(np.pi / 12)]}
    found = []
    for support, pushed, rubbed in (
        ({"group": "bore"}, {"group": "after"}, {"group": "before"}),
        (
            {"box": [[0.0, 0.0], [0.11, 0.11]]},
            {"box": [[0.149, 0.149], [0.26, 0.26]]},
            {"plane": rim},
        ),
    ):
        more = given | {
            "supports": [support],
            "loads": [load | pushed],
            "contacts": [wall | rubbed],
        }
        ends = {"before": np.array([2, 5]), "after": np.array([5, 8])}
        more |= {"cyclic": CYCLIC, "rotation": spinning(2), "compare": {"modes": [24]}}
        compared = compare(scene_of(tmp_path, *ring(), ends=ends, **more), MPI.COMM_SELF)
        assert compared.outcomes[0].error < 1e-6 and compared.full is not None  # percent
        found.append(compared.full.displacement)
    np.testing.assert_allclose(*found, rtol=0.0, atol=1e-9 * np.abs(found[0]).max())


def test_damping_ratios_are_those_of_the_waves_of_the_whole_disk(tmp_path: Path) -> None:
    """The three lowest families, in the Coriolis force."""
    damping = {"damping": {"ratios": [0.1, 0.3, 0.05]}}
    found = compare(sector_scene(tmp_path, 2, compare={"modes": [24]}, **damping), MPI.COMM_SELF)
    assert found.outcomes[0].error < 1e-6  # percent


@pytest.mark.parametrize(
    ("kind", "key", "more"),
    [
        (ErrorKind.CONFLICT, "compare.derivatives", {"compare": {"derivatives": ["all"]}}),
        (ErrorKind.CONFLICT, "compare.full", {"compare": {"full": False}}),
        (
            ErrorKind.CONFLICT,
            "attachments[0].components",
            {"attachments": [{"group": "rim", "stiffness": 1.0, "components": ["x"]}]},
        ),
    ],
)
def test_what_the_whole_disk_cannot_have_is_refused(
    tmp_path: Path, kind: ErrorKind, key: str, more: dict[str, Any]
) -> None:
    with refusal(kind, key=key):
        compare(sector_scene(tmp_path, 2, **more), MPI.COMM_SELF)


def test_cut_faces_that_do_not_match_are_refused(tmp_path: Path) -> None:
    """A node of the left face lies aside by a hundredth of the face."""
    points, cells = ring()
    points[7] *= 1.01
    scene = scene_of(
        tmp_path, points, cells, cyclic=CYCLIC, rotation=spinning(2), **tables(2, range(1))
    )
    with refusal(ErrorKind.MESH, key="cyclic.left", names="mesh both cut faces alike"):
        compare(scene, MPI.COMM_SELF)
