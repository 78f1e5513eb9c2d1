"""The files, the figure and the sentences of an equilibrium path."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from support import beam_scene
from test_figures import illegible

from fenicsrom.assess.curves.equilibrium_path import Equilibrium, EquilibriumPath
from fenicsrom.cli import main
from fenicsrom.online.stress.stress import Deformation
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.curves.equilibrium_report import figure, report, summary

DEMO = Path(__file__).parents[2] / "demos" / "arch_snap.toml"
COARSE = ("--set", "geometry.parameters.elements_along=16")


@pytest.fixture
def found() -> EquilibriumPath:
    """A path with a limit point, a bifurcation and an end."""
    listed = [
        (0.0, 0.0, 0, ""),
        (0.8, -1e-3, 0, ""),
        (1.0, -2e-3, 1, "limit point"),
        (0.9, -3e-3, 1, ""),
        (0.7, -4e-3, 1, "bifurcation"),
        (0.6, -5e-3, 2, ""),
    ]
    push = {"group": "tip", "direction": [0.0, -1.0], "force": 1.0}
    path = EquilibriumPath(beam_scene(loads=[push], contacts=None), 100, reason="end of the range")
    for factor, along, negative, kind in listed:
        probe = np.array([0.1 * along, along])
        deformed = Deformation(1.0 + 50.0 * along, np.zeros(2), 1.0 + 50.0 * along, 1.1)
        free = np.zeros(0, np.int8), np.zeros((0, 2))
        given = factor, probe, abs(along), negative, 1e-12, deformed, *free
        path.points.append(Equilibrium(*given, kind=kind))
    return path


def test_figure_is_dashed_where_the_path_is_unstable(
    found: EquilibriumPath, tmp_path: Path
) -> None:
    drawn = figure_of(figure(found))
    drawn.savefig(tmp_path / "figure.png")
    assert not illegible(drawn)
    (axis,) = drawn.axes
    labels = ["stable", "unstable", "limit point", "bifurcation"]
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == labels
    stable, unstable, limit, crossed = axis.lines
    assert stable.get_linestyle() == "-" and unstable.get_linestyle() == "--"
    np.testing.assert_allclose(stable.get_xydata(), [(0.0, 0.0), (-1.0, 0.8), (-2.0, 1.0)])
    np.testing.assert_allclose(unstable.get_xdata(), [-2.0, -3.0, -4.0, -5.0])
    np.testing.assert_allclose(limit.get_xydata(), [(-2.0, 1.0)])
    np.testing.assert_allclose(crossed.get_xydata(), [(-4.0, 0.7)])


def test_summary_has_the_largest_load_factor_before_an_instability(found: EquilibriumPath) -> None:
    assert summary(found)["largest_stable_load_factor"] == 1.0
    kinds = [row["kind"] for row in report(found).rows]
    assert [kind for kind in kinds if kind] == ["limit point", "bifurcation"]


def test_summary_has_the_largest_strains_of_the_path(found: EquilibriumPath) -> None:
    written = summary(found)
    assert written["largest_compressive_strain"] == pytest.approx(0.25)
    assert written["largest_tensile_strain"] == pytest.approx(0.1)
    ratios = [row["smallest_volume_ratio"] for row in report(found).rows]
    assert ratios == pytest.approx([1.0, 0.95, 0.9, 0.85, 0.8, 0.75])


@pytest.mark.slow
def test_statics_command_writes_path_and_summary(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    folder = tmp_path / "out"
    assert main(["statics", str(DEMO), "--output", str(folder), *COARSE]) == 0
    listed = list(csv.DictReader((folder / "equilibria.csv").read_text().splitlines()))
    written = json.loads((folder / "equilibria.json").read_text())
    assert len(listed) == written["points"] and written["end"] == "end of the range"
    assert float(listed[0]["load_factor"]) == 0.0 and float(listed[-1]["load_factor"]) == 1.0
    kinds = [point["kind"] for point in written["special_points"]]
    assert kinds[0] == kinds[-1] == "limit point"
    drawn = {"equilibria.png", "setup.png", "report.html"}
    assert {path.name for path in folder.iterdir()} >= drawn
    fields = set(re.findall(r'Name="(\w+)"', (folder / "equilibria.vtu").read_text("latin-1")))
    assert fields >= {"limit_point_1_m", "end_m"}
    assert fields >= {"load_factor_of_limit_point_1_m", "load_factor_of_end_m"}


def test_statics_of_a_scene_without_static_loads_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    folder, scene = tmp_path / "out", DEMO.with_name("open_2d.toml")
    assert main(["statics", str(scene), "--output", str(folder)]) == 2
    assert "loads" in capsys.readouterr().err and not folder.exists()
