"""Ring-downs against closed forms: linear oscillator, backbone of a Duffing oscillator, Jenkins."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, loaded_duffing, refusal, unexplained

from fenicsrom.assess.curves.backbone import backbone, change_notes
from fenicsrom.assess.studies import ringdown as module
from fenicsrom.assess.studies.ringdown import check_ringdown, ringdown
from fenicsrom.cli import main
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.notes import DAMPING_RATIOS, FREQUENCIES
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel, save_model

DAMPING, STEPS = 0.04, 100


def oscillator(cubic: float, *overrides: str) -> StoredModel:
    """x'' + damping x' + x + cubic x^3 = force; the probe moves by 2 x."""
    settings = (
        "loads.0.force=1.0",
        f"material.mass_damping={DAMPING}",
        f"time.steps_per_period={STEPS}",
        "ringdown.periods=6",
    )
    scene = beam_scene(2, (*settings, *overrides), contacts=None, probe={"group": "tip"})
    model = loaded_duffing(scene.material.mass_damping, cubic, load_histories(scene), gain=2.0)
    return StoredModel(model, scene, "rubin", ("1V",), 9, np.array([0.5 / np.pi]), {})


def jenkins(force: float = 3.0, friction: float = 0.2) -> StoredModel:
    """x'' + x + friction force = force, with a friction spring of 1 N/m and a normal force of 1 N.

    The normal coordinate is so stiff that the normal force stays the preload.
    """
    settings = (
        f"loads.0.force={force}",
        "material.mass_damping=0.0",
        "contacts.0.preload=1.0",
        f"contacts.0.friction={friction}",
        "contacts.0.normal_stiffness=1.0",
        "contacts.0.tangential_stiffness=1.0",
        "time.steps_per_period=400",
        "ringdown.periods=12",
    )
    scene = beam_scene(2, settings, probe={"group": "tip"})
    stiffness, load = np.diag([1e9, 1.0]), load_histories(scene)
    model = linear_model(np.eye(2), stiffness, loads=[[0.0], [1.0]], load_histories=load, masters=2)
    return StoredModel(model, scene, "rubin", ("1S", "1V"), 9, np.array([0.5 / np.pi]), {})


def test_linear_decay_has_the_eigenvalue_of_its_time_steps() -> None:
    cut = ("ringdown.factor=0.5", "ringdown.smallest=0.5", "ringdown.periods=12")
    found = ringdown(oscillator(0.0, *cut))
    pole = complex(-0.5 * DAMPING, np.sqrt(1.0 - 0.25 * DAMPING**2))
    step = 2.0 * np.pi / STEPS
    pole = np.log((1.0 + 0.5 * step * pole) / (1.0 - 0.5 * step * pole)) / step
    assert len(found.periods) == 6 and not found.warnings  # 0.88 of the amplitude in each
    assert found.curve[1, 0] == pytest.approx(1.0, rel=1e-12)
    for one in found.periods:
        exact = 1e-5 if one.number == 1 else 1e-11  # the first one begins at rest, between steps
        assert one.frequency == pytest.approx(pole.imag / (2.0 * np.pi), rel=exact)
        assert one.damping_ratio == pytest.approx(-pole.real / abs(pole), rel=1e-8)
    lost = sum(one.damping_dissipation for one in found.periods)
    left = np.exp(-DAMPING * found.periods[-1].number * 2.0 * np.pi)
    assert lost == pytest.approx(0.5 * 0.5**2 * (1.0 - left), rel=2e-3)


def test_asymmetric_decay_has_the_damping_of_its_periods() -> None:
    """e^(-t/10) (cos t + 0.2 sin 2t) shrinks by e^(-pi/5) in each period, not so in its halves."""
    time = np.linspace(0.0, 40.0, 4001)
    moved = np.exp(-0.1 * time) * (np.cos(time) + 0.2 * np.sin(2.0 * time))
    motion: Any = SimpleNamespace(
        time=time, friction_dissipation=0.0 * time, damping_dissipation=0.0 * time
    )
    _, *periods = module.periods_of(motion, moved)  # the first one does not begin at a turn
    assert len(periods) > 3
    for one in periods:
        assert one.frequency == pytest.approx(0.5 / np.pi, rel=1e-9)
        assert one.damping_ratio == pytest.approx(0.1 / np.hypot(0.1, 1.0), rel=1e-8)


def test_loads_that_do_not_move_the_mode_have_no_decay() -> None:
    stored = jenkins()
    aside = stored.model._replace(loads=np.array([[1.0], [0.0]]))
    found = ringdown(replace(stored, model=aside))
    assert "do not move mode 1" in str(found.unfinished) and not found.periods


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ((0.0, 0.011, 0.1), [DAMPING_RATIOS]),
        ((0.0, 0.009, 0.1), []),
        ((0.06, 9e-5, 0.0), [FREQUENCIES]),
    ],
)
def test_change_above_its_limit_casts_doubt(
    changes: tuple[float, float, float], expected: list[str]
) -> None:
    found = change_notes("half the time step", "time.steps_per_period", *changes)
    assert [note.quantity for note in found] == expected


def test_half_the_time_step_reveals_the_error_of_the_frequency() -> None:
    change = ringdown(oscillator(0.0)).changes["half the time step"]
    assert change["frequency_relative"] == pytest.approx(
        0.75 * (2.0 * np.pi / STEPS) ** 2 / 12.0, rel=0.02
    )


def test_frequency_of_a_hardening_decay_is_that_of_the_nonlinear_mode() -> None:
    table = ("backbone.first=0.5", "backbone.last=3.5", "material.mass_damping=0.005")
    stored = oscillator(0.1, "loads.0.force=2.0", "ringdown.periods=12", *table)
    found, points = ringdown(stored), backbone(stored).points
    sizes, frequencies = zip(*((p.linear_amplitude, p.frequency) for p in points), strict=True)
    for one in found.periods:
        expected = np.interp(one.linear_amplitude, sizes, frequencies)
        assert one.frequency == pytest.approx(expected, rel=2e-4)
    assert found.periods[0].frequency > 1.05 * found.mode.omega / (2.0 * np.pi)


def test_friction_dissipates_as_a_jenkins_element() -> None:
    friction = 0.2
    found = ringdown(jenkins(friction=friction))
    assert found.curve[1, 0] == pytest.approx(
        -3.0 + friction, rel=1e-6
    )  # friction acts in the hold
    assert found.mode.omega == pytest.approx(np.sqrt(2.0), rel=1e-9)
    slips = [one for one in found.periods if one.linear_amplitude > 1.05 * friction]
    assert len(slips) >= 4
    for one in slips:  # 4 mu N (x - x_s) with x_s = mu N / k_t
        loss = 4.0 * friction * (one.linear_amplitude - friction)
        assert one.friction_dissipation == pytest.approx(loss, rel=1e-4)
    stuck = found.periods[-1]
    assert stuck.friction_dissipation == 0.0 and abs(stuck.damping_ratio) < 1e-12
    assert stuck.frequency == pytest.approx(np.sqrt(2.0) / (2.0 * np.pi), rel=1e-4)


def test_other_coordinates_judge_the_basis() -> None:
    """The model without its second coordinate is stiffer."""
    stored = jenkins()
    part = StoredModel(
        stored.model, stored.scene, "rubin", ("1S", "1V"), 9, np.array([0.5 / np.pi]), {}
    ).resized(("1V",))
    found = ringdown(part)
    assert "all coordinates of the model" in found.changes and found.size == 1


def run(model: Path, folder: Path, *more: str) -> int:
    """The exit code of `fenicsrom ringdown --from`."""
    return main(["ringdown", "--from", str(model), "--output", str(folder), *more])


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "reduced_model.npz"
    save_model(path, oscillator(0.1, "output.pictures=false"))
    return path


@pytest.mark.slow
def test_command_writes_files_that_are_explained(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(model, tmp_path / "out", "--set", "output.pictures=true") == 0
    with (tmp_path / "out" / "ringdown.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert unexplained(list(rows[0]), "ringdown.csv") == []
    written = json.loads((tmp_path / "out" / "ringdown.json").read_text())
    assert written["linear_frequency_Hz"] == pytest.approx(0.5 / np.pi)
    assert {"ringdown.png", "report.html"} <= {p.name for p in (tmp_path / "out").iterdir()}
    assert "frequency and damping ratio from" in capsys.readouterr().out


def test_interrupted_ringdown_resumes_from_its_decays(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    decay, calls = module._decay, []

    def once(job: tuple[StoredModel, float]) -> object:
        calls.append(job[1])
        if len(calls) == 2:
            raise KeyboardInterrupt
        return decay(job)

    monkeypatch.setattr(module, "_decay", once)
    assert run(model, tmp_path / "out") == 130
    assert "to continue: fenicsrom ringdown" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "ringdown.json").read_text())["interrupted"]
    assert run(model, tmp_path / "out", "--resume") == 0
    assert calls == [1.0, 2.0, 2.0]
    written = json.loads((tmp_path / "out" / "ringdown.json").read_text())
    assert "half the time step" in written["largest_changes"] and not written["interrupted"]


@pytest.mark.parametrize(
    ("override", "kind", "key"),
    [
        ("basis.elastic_force='projection'", ErrorKind.CONFLICT, "basis.elastic_force"),
        ("contacts.0.approach=[[0, 0], [1, 1e-3]]", ErrorKind.CONFLICT, "contacts[0].approach"),
    ],
)
def test_scene_that_is_driven_or_projected_is_refused(
    override: str, kind: ErrorKind, key: str
) -> None:
    with refusal(kind, key):
        check_ringdown(beam_scene(2, (override,)))


def test_scene_without_a_load_that_varies_is_refused() -> None:
    loads = [{"group": "load", "at": "centre", "direction": [0.0, 1.0], "force": 1.0}]
    with refusal(ErrorKind.MISSING, "loads"):
        check_ringdown(beam_scene(2, loads=loads, contacts=None, probe={"group": "tip"}))


def test_overdamped_decay_is_told() -> None:
    found = ringdown(oscillator(0.0, "material.mass_damping=30.0"))
    assert isinstance(found.unfinished, ConvergenceError) and not found.periods
