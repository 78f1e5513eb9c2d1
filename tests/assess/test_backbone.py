"""The command `backbone` on a Duffing oscillator: curve, forced peaks, files and errors."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import beam_scene, first, heard, loaded_duffing, refusal, unexplained

from fenicsrom.assess.curves import backbone as module
from fenicsrom.assess.curves.backbone import backbone, check_backbone
from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import elastic_polynomial
from fenicsrom.online.model.subspace import nested_model
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel, save_model
from fenicsrom.post.curves.backbone_report import report, sentences
from fenicsrom.scene import Scene

DAMPING, CUBIC, FORCE, LAST = 0.02, 0.1, 0.02, 3.0
TABLE = ("backbone.first=0.1", f"backbone.last={LAST}", "backbone.load_factors=[0.5, 1.0]")


def scene_with(*overrides: str) -> Scene:
    """The scene of the oscillator; its mesh is never made."""
    settings = (
        f"loads.0.force={FORCE}",
        f"loads.0.frequency={0.5 / np.pi}",
        f"material.mass_damping={DAMPING}",
        "time.steps_per_period=100",
    )
    return beam_scene(2, (*settings, *TABLE, *overrides), contacts=None, probe={"group": "tip"})


def oscillator(*overrides: str) -> StoredModel:
    """x'' + damping x' + x + cubic x^3 = force sin t; the probe moves by 2 x."""
    scene = scene_with(*overrides)
    model = loaded_duffing(scene.material.mass_damping, CUBIC, load_histories(scene), gain=2.0)
    return StoredModel(model, scene, "rubin", ("1V",), 9, np.array([0.5 / np.pi]), {})


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "reduced_model.npz"
    save_model(path, oscillator())
    return path


def run(model: Path, folder: Path, *overrides: str) -> int:
    """The exit code of `fenicsrom backbone --from`."""
    sets = [word for override in overrides for word in ("--set", override)]
    return main(["backbone", "--from", str(model), "--output", str(folder), *sets])


@pytest.mark.slow
def test_curve_spans_the_amplitudes_of_the_probe() -> None:
    found = backbone(oscillator())
    assert found.reason == "end of the range" and found.direction == 0
    begin, end = found.points[0], found.points[-1]
    assert begin.linear_amplitude == pytest.approx(0.1, rel=1e-9)
    assert end.linear_amplitude == pytest.approx(LAST, rel=1e-9)
    # one coordinate: its crest is the modal coordinate
    assert end.amplitude[0] == pytest.approx(LAST, rel=1e-4)
    a = 0.5 * LAST
    assert 2.0 * np.pi * end.frequency == pytest.approx(np.sqrt(1 + 0.75 * CUBIC * a**2), rel=1e-3)
    assert 4.0 * np.pi * end.frequency * end.damping_ratio == pytest.approx(DAMPING, rel=1e-6)
    assert unexplained(report(found).rows[0], "backbone.csv") == []


@pytest.mark.slow
def test_half_the_time_step_reveals_the_error_of_the_frequency() -> None:
    found = backbone(oscillator("backbone.load_factors=[1.0]"))
    assert [error.point for error in found.step_errors] == [
        0,
        len(found.points) // 2,
        len(found.points) - 1,
    ]
    # a linear motion: tan(w h / 2) = h / 2 lowers the frequency by (2 pi / steps)^2 / 12
    expected = 0.75 * (2.0 * np.pi / 100) ** 2 / 12.0
    assert found.step_errors[0].frequency == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_forced_peaks_lie_on_the_backbone() -> None:
    found = backbone(oscillator())
    assert [peak.value for peak in found.peaks] == [0.5, 1.0] and not found.warnings
    assert all(peak.ends == ("fallen", "fallen") for peak in found.peaks)
    amplitudes = [point.amplitude[0] for point in found.points]
    for peak in found.peaks:
        free = np.interp(peak.amplitude, amplitudes, [point.frequency for point in found.points])
        assert peak.frequency == pytest.approx(free, rel=1e-3)
        omega = 2.0 * np.pi * peak.frequency
        assert peak.amplitude == pytest.approx(
            2.0 * peak.value * FORCE / (DAMPING * omega), rel=0.01
        )


@pytest.mark.slow
def test_peak_says_that_its_search_ended_early(monkeypatch: pytest.MonkeyPatch) -> None:
    """The amplitude does not fall to a thousandth within the range of the search."""
    monkeypatch.setattr("fenicsrom.online.curves.continuation.FALLEN", 1e-3)
    found = backbone(oscillator("backbone.load_factors=[1.0]"))
    assert found.peaks[0].ends == ("end of the range", "end of the range")
    assert len(found.warnings) == 1 and found.unfinished is None


def test_interrupt_keeps_the_points_that_are_done(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "REPORT_INTERVAL", 0.0)

    def stop(line: str) -> None:
        if line.startswith("  3 points"):
            raise KeyboardInterrupt

    with heard(stop):
        found = backbone(oscillator())
    assert found.interrupted and found.reason == "interrupted"
    assert len(found.points) == 3


@pytest.mark.slow
def test_command_writes_the_files_of_a_stored_model(
    model: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = tmp_path / "out"
    assert run(model, folder) == 0
    names = """
        report.html backbone.csv backbone.json backbone.png provenance.json reduced_model.npz
        scene.toml
    """.split()
    assert {path.name for path in folder.iterdir()} == set(names)
    summary = json.loads((folder / "backbone.json").read_text())
    with open(folder / "backbone.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == summary["points"]
    assert float(rows[-1]["frequency_Hz"]) == summary["last"]["frequency_Hz"]
    assert [peak["load_factor"] for peak in summary["peaks"]] == [0.5, 1.0]
    assert str(folder / "report.html") in capsys.readouterr().out


def test_mode_that_the_model_does_not_have_is_refused(model: Path, tmp_path: Path) -> None:
    with refusal(ErrorKind.RANGE, "backbone.mode"):
        backbone(oscillator("backbone.mode=2"))
    assert run(model, tmp_path / "out", "backbone.mode=2") == 2
    assert not (tmp_path / "out" / "backbone.json").exists()


def test_scene_without_table_or_without_motion_is_refused() -> None:
    scene = scene_with()
    for wrong, kind in (
        (replace(scene, backbone=None), ErrorKind.MISSING),
        (beam_scene(2, TABLE[:2], contacts=None, probe={"group": "tip"}, loads=None), None),
    ):
        with pytest.raises(SceneError) as caught:
            check_backbone(wrong)
        assert caught.value.key == "backbone"
        assert kind is None or caught.value.kind == kind


STRETCH = 1000.0


def slender(*overrides: str) -> StoredModel:
    """V = q1^2 / 2 + STRETCH (q2 + q1^2)^2 / 2, a beam that shortens as it bends: first q1."""
    scene = scene_with("backbone.first=1e-3", "backbone.last=0.05", *overrides)
    products = np.zeros((3, 6 + 15))
    products[0, 1], products[1, 2] = 1.0, np.sqrt(STRETCH)  # strains of q1 and q2
    products[1, 6] = 2.0 * np.sqrt(STRETCH)  # second strain of q1 q1
    stiffness = np.diag([0.0, 0.0, 5.0, 6.0, 7.0])
    elastic = elastic_polynomial(products.T @ products, 5)
    whole = reduced_model(
        np.eye(5),
        DAMPING,
        elastic._replace(stiffness=elastic.stiffness + stiffness),
        np.eye(5, 1),
        load_histories(scene),
        *first(0, 5),
        np.eye(2, 5)[[0, 0]] * [[1.0], [0.0]],
        np.zeros(2),
    )
    return StoredModel(
        nested_model(whole, [0]),
        scene,
        "rubin",
        ("1V",),
        9,
        np.array([0.5 / np.pi]),
        {},
        candidates=whole,
        further=("1D", "2V", "3V", "4V"),
    )


@pytest.mark.slow
def test_mode_takes_the_coordinates_that_its_largest_amplitude_needs() -> None:
    found = backbone(slender("backbone.load_factors=[]"))
    assert "1D" in found.labels and len(found.labels) == 3 and not found.warnings
    assert found.basis_error is not None and found.basis_error <= 1e-3
    assert 2.0 * np.pi * found.points[-1].frequency == pytest.approx(1.0, abs=0.01)
    assert any("differ by an estimated" in line for line in sentences(found))
    stiff = backbone(slender("backbone.load_factors=[]", "basis.size=1"))
    assert stiff.labels == ("1V",) and stiff.points[-1].frequency > 1.5 * found.points[-1].frequency
    assert stiff.basis_error is None or stiff.basis_error > 0.1
