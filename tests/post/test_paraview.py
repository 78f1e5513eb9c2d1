"""The ParaView files of a run with stresses, opened again together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STOCKY, beam_scene

pytest.importorskip("dolfinx")
pyvista = pytest.importorskip("pyvista")

from fenicsrom import study  # noqa: E402
from fenicsrom.online.motion.motion import read_history  # noqa: E402
from fenicsrom.online.store.archive import load_model  # noqa: E402
from fenicsrom.online.stress.stress import von_mises  # noqa: E402
from fenicsrom.post.paraview.paraview import (  # noqa: E402
    frame_rows,
)

KINDS = {"2D": (2, ()), "3D": (3, ("geometry.parameters.width=0.15", "geometry.cells='simplex'"))}
SMALL = (
    *STOCKY,
    "basis.modes=2",
    "basis.derivatives=['1V1V']",
    "time.periods=1",
    "loads.0.force=2e4",
    "output.pictures=false",
    "output.motion=true",
    "output.stresses='cauchy'",
    "contacts.0.approach=[[0.0, 0.0], [1.0, 1e-3]]",
    "title='beam under {loads.0.force} N'",
)


SINGLE = 2.0**-23  # relative rounding of single precision


@pytest.fixture(scope="module", params=KINDS)
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A small run with stresses, and its folder."""
    dimension, overrides = KINDS[request.param]
    push = {"group": "tip", "direction": [0.0, 1.0, 0.0][:dimension], "force": 1e4}
    shake = {"group": "load", "at": "centre", "force": 1e4, "frequency": 30.0}
    shake["direction"] = [0.0, 1.0, 0.0][:dimension]
    scene = beam_scene(dimension, (*SMALL, *overrides), loads=[shake, push])
    folder = tmp_path_factory.mktemp("run")
    return study.run(scene, folder=folder), folder


def opened(folder: Path, row: int = -1) -> Any:
    """All blocks of a run at one instant."""
    reader = pyvista.get_reader(folder / "results.pvd")
    reader.set_active_time_value(reader.time_values[row])
    return reader.time_values, reader.read()[0]


@pytest.mark.slow
def test_one_file_opens_every_block_of_the_run(run: Any) -> None:
    found, folder = run
    times, blocks = opened(folder)
    motion = found.motions["reduced"]
    np.testing.assert_allclose(times, motion.time[frame_rows(motion)])
    names = """
        motion contact_points surface_1 groups normal_modes static_modes derivatives equilibrium
    """.split()
    assert set(blocks.keys()) == set(names)
    assert all(block.n_cells > 0 for block in blocks)
    listed = {Path(path) for path in found.files}
    assert {folder / "results.pvd", folder / "look.py", folder / "groups.vtu"} <= listed


@pytest.mark.slow
def test_names_of_arrays_give_units_and_frequencies(run: Any) -> None:
    found, folder = run
    _, blocks = opened(folder)
    modes = blocks["normal_modes"].point_data.keys()
    for k, frequency in enumerate(found.modes.frequencies_hz):
        assert f"{k + 1}V_{frequency:.5g}_Hz_per_sqrt_kg" in modes
        assert f"{k + 1}V_von_mises_Pa_per_m_sqrt_kg" in modes
    assert "1S_m_per_N" in blocks["static_modes"].point_data
    assert "displacement_m" in blocks["equilibrium"].point_data
    assert {"gap_m", "normal_force_N"} <= set(blocks["contact_points"].point_data.keys())
    texts = blocks["normal_modes"].field_data
    assert "modal mass 1 kg" in texts["normalisation"][0]
    assert "2.07e+11 Pa" in texts["material"][0]
    assert texts["title"][0] == "beam under 20000 N"


def test_stresses_in_the_files_equal_those_of_the_stored_model(run: Any) -> None:
    found, folder = run
    stored = load_model(folder / "reduced_model.npz")
    assert stored.recovery is not None
    table = stored.recovery.stress
    motion = found.motions["reduced"]
    for row in (0, 15, -1):
        _, blocks = opened(folder, row)
        grid = blocks["motion"]
        q = motion.coordinates[frame_rows(motion)[row] - motion.time.size]
        stress = table.stress(q, "cauchy")
        close = {"atol": 1e-10 * np.abs(stress).max(), "rtol": SINGLE}
        cells = table.in_cells(stress)
        np.testing.assert_allclose(grid.cell_data["stress_Pa"], cells, **close)
        np.testing.assert_allclose(grid.cell_data["von_mises_Pa"], von_mises(cells), **close)
        vertices = table.at_vertices(stress)
        d = table.vertex_position.shape[1]
        near = [
            int(np.argmin(np.abs(grid.points[:, :d] - place).max(axis=1)))
            for place in table.vertex_position
        ]
        np.testing.assert_allclose(grid.point_data["stress_Pa"][near], vertices, **close)
        # at all nodes, the largest value is that of a vertex
        assert grid.point_data["von_mises_Pa"].max() == pytest.approx(von_mises(vertices).max())
    modes = blocks["normal_modes"]
    assert modes.point_data["1V_von_mises_Pa_per_m_sqrt_kg"].max() > 0.0


def test_groups_are_faces_of_the_body(run: Any) -> None:
    found, folder = run
    _, blocks = opened(folder)
    groups, dimension = blocks["groups"], found.scene.geometry.dimension
    size = "Length" if dimension == 2 else "Area"
    sizes = np.abs(groups.compute_cell_sizes().cell_data[size])
    for name in ("root", "tip"):
        flags = groups.cell_data[f"group_{name}"]
        expected = 0.2 if dimension == 2 else 0.2 * 0.15
        assert sizes[flags == 1].sum() == pytest.approx(expected)
    assert set(blocks["motion"].cell_data["group_solid"]) == {1}


def test_summary_and_tables_give_largest_stress_and_reactions(run: Any) -> None:
    found, folder = run
    text = json.loads((folder / "summary.json").read_text())
    states = [row["state"] for row in text["stresses"]["largest"]]
    assert states[:3] == ["equilibrium", "largest of the last period", "largest displacement"]
    assert states[3:] == ["largest contact force"]
    largest = text["stresses"]["largest"][1]
    assert largest["von_mises_Pa"] == max(
        row["von_mises_Pa"] for row in text["stresses"]["largest"][1:]
    )
    rest = text["reactions"]["equilibrium"]
    assert rest["root"]["force_y_N"] == pytest.approx(-1e4, rel=1e-8)
    assert rest["by_momentum"]["force_y_N"] == pytest.approx(-1e4, rel=1e-8)
    rows = (folder / "stresses.csv").read_text().splitlines()
    assert len(rows) == 1 + len(states) and "von_mises_Pa" in rows[0]
    rows = (folder / "reactions.csv").read_text().splitlines()
    assert len(rows) == 1 + 1 + found.motions["reduced"].coordinate_time.size - 1
    page = (folder / "report.html").read_text()
    assert "von Mises, MPa" in page and "Reactions" in page


def test_stored_model_gives_the_same_stresses_without_its_mesh(run: Any, tmp_path: Path) -> None:
    _, folder = run
    stored = load_model(folder / "reduced_model.npz")
    study.rerun(stored, tmp_path)
    for name in ("stresses.csv", "reactions.csv", "modal_stresses.csv"):
        assert (tmp_path / name).read_text() == (folder / name).read_text()
    assert set(read_history(tmp_path / "history.npz")) == {"reduced"}


def test_model_without_stresses_warns_when_they_are_asked_for(tmp_path: Path) -> None:
    scene = beam_scene(
        2,
        (*SMALL, "output.stresses='none'", "geometrically_nonlinear=false", "output.motion=false"),
    )
    stored = study.build_model(scene)
    assert stored.recovery is None
    wanted = stored.with_overrides("output.stresses='cauchy'")
    found = study.rerun(wanted, tmp_path)
    assert found.stresses is None
    assert any("output.stresses" in warning for warning in found.warnings)


def test_files_of_moving_supports_hold_relative_and_absolute_motion(tmp_path: Path) -> None:
    """In ParaView, in the history and in the summary."""
    shaken = {"direction": [0.6, 0.8], "support_displacement": 0.02, "frequency": 60.0}
    scene = beam_scene(
        2,
        (
            *STOCKY,
            "time.periods=1",
            "time.steps_per_period=40",
            "time.steady_tolerance=0.0",
            "output.pictures=false",
            "output.motion=true",
        ),
        loads=[shaken],
        contacts=None,
        probe={"nearest": [1.0, 0.0]},
        geometrically_nonlinear=False,
    )
    found = study.run(scene, folder=tmp_path)
    times, motion = pyvista.get_reader(tmp_path / "motion/motion.pvd"), found.motions["reduced"]
    times.set_active_time_value(times.time_values[13])
    body = times.read()[0]
    wave = 0.02 * np.sin(2.0 * np.pi * 60.0 * times.time_values[13])
    relative, absolute = body["displacement_m"], body["absolute_displacement_m"]
    np.testing.assert_allclose(
        absolute - relative, np.tile([0.6 * wave, 0.8 * wave, 0.0], (len(relative), 1)), atol=1e-14
    )
    with np.load(tmp_path / "history.npz") as history:
        moved = history["reduced_support_displacement"]
        total = history["reduced_absolute_displacement"]
    np.testing.assert_allclose(total[:, 0], motion.displacement[:, 0] + moved)
    row = int(np.argmin(np.abs(motion.time - times.time_values[13])))
    at_probe = np.argmin(np.linalg.norm(body.points - [1.0, 0.0, 0.0], axis=1))
    np.testing.assert_allclose(absolute[at_probe, :2], total[row, 0], atol=1e-12)
    summary = json.loads((tmp_path / "summary.json").read_text())["support_motion"]["reduced"]
    np.testing.assert_allclose(summary["support_amplitude_m"], [0.012, 0.016], rtol=1e-12)
    half = np.ptp(total[:, 0], axis=0) / 2.0
    assert summary["absolute_amplitude_m"]["tangential"] == pytest.approx([half[1]])
    assert "absolute amplitudes" in (tmp_path / "report.html").read_text()
