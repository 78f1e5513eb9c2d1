"""One page for several output folders: results, curves over each other, differences of scenes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from fenicsrom.cli import main
from fenicsrom.notes import verdict_of
from fenicsrom.online.motion.motion import HISTORY_ARRAYS
from fenicsrom.post.base.page import told
from fenicsrom.post.studies.folders_report import curves_figure, differences, outcome


@pytest.fixture
def folders(tmp_path: Path) -> list[Path]:
    """A response curve of two forces with an unstable part, a backbone and a run."""
    found = [tmp_path / name for name in ("curve", "mode", "motion")]
    for folder, force in zip(found, (25, 50, 25), strict=True):
        folder.mkdir()
        (folder / "scene.toml").write_text(f'title = "a"\n[[loads]]\nforce = {force}\n')
    rows = ["loads.0.force_N,piece,frequency_Hz,amplitude_x_m,amplitude_y_m,stability"]
    rows += [f"25,1,{f},0.0,{f}e-3,stable" for f in (1.0, 2.0)]
    rows += [f"50,1,{f},0.0,{2 * f}e-3,{'un' * (f > 1.5)}stable" for f in (1.0, 2.0, 3.0)]
    (found[0] / "response.csv").write_text("\n".join(rows) + "\n")
    summary = {"parameter": "frequency", "family": "loads.0.force"}
    summary |= told(verdict_of(["coarse mesh"]), ["coarse mesh"])
    (found[0] / "response.json").write_text(json.dumps(summary))
    mode = "linear_amplitude_m,frequency_Hz,amplitude_x_m\n1e-3,1.5,1e-3\n2e-3,1.4,2e-3\n"
    (found[1] / "backbone.csv").write_text(mode)
    (found[1] / "backbone.json").write_text(json.dumps(told(verdict_of([]), [])))
    motion = {"amplitude_m": {"normal": 0.001, "tangential": [0.004]}, "peak_normal_force_N": 7.0}
    summary = {"response": {"reduced": motion}, **told(verdict_of([]), [])}
    (found[2] / "summary.json").write_text(json.dumps(summary))
    moved = np.array([[[0.0, 0.0]], [[0.001, 0.004]]])
    arrays = {f"reduced_{key}": np.zeros(2) for key in HISTORY_ARRAYS}
    arrays |= {"reduced_time": np.array([0.0, 1.0]), "reduced_displacement": moved}
    np.savez(found[2] / "history.npz", **arrays)
    return found


def test_page_has_results_differences_and_curves(
    folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "page"
    assert main(["report", *map(str, folders), "--output", str(output)]) == 0
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["curve", "force", "=", "50", "6", "3", "–"] in printed
    assert ["mode", "backbone", "2", "1.4", "–"] in printed
    assert ["motion", "reduced", "model", "4", "–", "7"] in printed
    page = (output / "report.html").read_text()
    assert "Doubtful: curve: coarse mesh." in page and "Figure 2." in page
    assert {path.name for path in output.iterdir()} == {"report.html", "response.png", "motion.png"}


def test_page_refuses_what_one_of_its_runs_refused(folders: list[Path], tmp_path: Path) -> None:
    found = json.loads((folders[2] / "summary.json").read_text())
    found |= told(verdict_of([], "the steps are too long"), [])
    (folders[2] / "summary.json").write_text(json.dumps(found))
    output = tmp_path / "page"
    assert main(["report", *map(str, folders), "--output", str(output)]) == 0
    page = (output / "report.html").read_text()
    assert "Refused: motion: the steps are too long" in page


def test_differences_are_the_keys_with_other_values(folders: list[Path]) -> None:
    found = [outcome(folder, folder.name) for folder in folders]
    assert differences(found) == [
        ["key", "curve", "mode", "motion"],
        ["loads.0.force", "25", "50", "25"],
    ]


def test_curves_lie_over_each_other_and_unstable_parts_are_dashed(folders: list[Path]) -> None:
    found = [outcome(folder, folder.name) for folder in folders[:2]]
    (panel,) = curves_figure(found, "frequency_Hz").panels
    assert panel.xlabel == "frequency, Hz"
    drawn = [(line.linestyle, line.x, line.y) for line in panel.items]
    expected = [
        ("-", [1.0, 2.0], [1.0, 2.0]),
        ("-", [1.0, 2.0], [2.0, 4.0]),
        ("--", [2.0, 3.0], [4.0, 6.0]),
        (":", [1.5, 1.4], [1.0, 2.0]),
    ]
    assert [style for style, *_ in drawn] == [style for style, *_ in expected]
    for one, other in zip(drawn, expected, strict=True):
        np.testing.assert_allclose(one[1:], other[1:])


def test_folder_without_results_and_folder_of_another_command_are_refused(
    folders: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path / "nothing")]) == 2
    assert "must be the output folder of run, response, backbone" in capsys.readouterr().err
    assert main(["report", str(folders[0]), "--output", str(folders[1])]) == 2
    assert "the folder holds the results of a command" in capsys.readouterr().err
    (folders[1] / "backbone.json").write_text("{")
    assert main(["report", str(folders[1]), "--output", str(tmp_path / "page")]) == 2
    assert "cannot be read" in capsys.readouterr().err
