"""Response curves of a Duffing oscillator: folds, stability, families, files and errors."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, first, heard, linear_model, loaded_duffing, refusal

from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.response_problem import check_response, family_of
from fenicsrom.assess.curves.results import Response, judged_multiplier
from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel, save_model
from fenicsrom.post.curves.response_figures import stretches
from fenicsrom.scene import Scene, parse_scene, scene_table

DAMPING, CUBIC, FORCE = 0.02, 0.1, 0.02
LOW, HIGH = 0.9 / (2.0 * np.pi), 1.2 / (2.0 * np.pi)


def scene_with(*overrides: str) -> Scene:
    """The scene of the oscillator; its mesh is never made."""
    settings = (
        f"loads.0.force={FORCE}",
        f"loads.0.frequency={LOW}",
        f"material.mass_damping={DAMPING}",
        "time.steps_per_period=100",
        f"response.first={LOW}",
        f"response.last={HIGH}",
    )
    return beam_scene(2, (*settings, *overrides), contacts=None, probe={"group": "tip"})


def oscillator(*overrides: str) -> StoredModel:
    """x'' + damping x' + x + cubic x^3 = force sin(omega t), moving along x."""
    scene = scene_with(*overrides)
    model = loaded_duffing(scene.material.mass_damping, CUBIC, load_histories(scene))
    return StoredModel(model, scene, "rubin", ("1V",), 9, np.array([1.0 / (2.0 * np.pi)]), {})


def fold_frequencies() -> NDArray[np.float64]:
    """The folds of the first harmonic: extremes of the frequency over the amplitude a.

    ((K - omega^2)^2 + (damping omega)^2) a^2 = force^2 with K = 1 + 3/4 cubic a^2; the upper
    branch omega(a) folds at its maximum and, at a smaller amplitude, at its minimum.
    """
    a = np.linspace(0.05, 1.2, 400_001)
    k = 1.0 + 0.75 * CUBIC * a**2
    inside = 0.25 * DAMPING**4 - k * DAMPING**2 + (FORCE / a) ** 2
    upper = np.sqrt(k - 0.5 * DAMPING**2 + np.sqrt(np.where(inside >= 0.0, inside, np.nan)))
    slope = np.diff(upper)
    turns = np.flatnonzero(slope[:-1] * slope[1:] < 0.0) + 1
    return np.sort(upper[turns]) / (2.0 * np.pi)


@pytest.fixture(scope="module")
def found() -> Response:
    return response(oscillator())


@pytest.mark.slow
def test_duffing_folds_are_where_the_first_harmonic_has_them(found: Response) -> None:
    (curve,) = found.curves
    folds = sorted(point.parameter for point in curve.special)
    assert [point.kind for point in curve.special] == ["fold", "fold"]
    np.testing.assert_allclose(folds, fold_frequencies(), rtol=1e-3)
    assert [piece.reason for piece in curve.pieces] == ["end of the range"]
    assert curve.points[0].parameter == pytest.approx(LOW, rel=1e-12)
    assert curve.points[-1].parameter == pytest.approx(HIGH, rel=1e-12)


def test_curve_is_unstable_between_its_folds_only(found: Response) -> None:
    (curve,) = found.curves
    (piece,) = curve.pieces
    assert [stable for stable, _ in stretches(piece.in_order())] == [True, False, True]
    low, high = sorted(point.parameter for point in curve.special)
    for point in curve.points:
        assert point.stable == (abs(judged_multiplier(point)) <= 1.0 + 1e-8)
        assert point.stable or low < point.parameter < high


def test_peak_amplitude_follows_the_backbone(found: Response) -> None:
    # at the peak force = damping omega a; the third harmonic adds to the crest
    top = max(found.curves[0].points, key=lambda point: point.amplitude.max())
    omega = 2.0 * np.pi * top.parameter
    a = FORCE / (DAMPING * omega)
    assert omega == pytest.approx(np.sqrt(1.0 + 0.75 * CUBIC * a**2), rel=1e-3)
    third = 0.25 * CUBIC * a**3 / (9.0 * omega**2 - 1.0)
    assert float(top.amplitude.max()) == pytest.approx(a + third, rel=5e-4)
    assert found.curves[0].step_error is not None and found.curves[0].step_error < 1e-3


def test_force_curve_with_families_passes_the_same_motions(found: Response) -> None:
    (point,) = [p for p in found.curves[0].points[:1]]
    stored = oscillator(
        'response.parameter="loads.0.force"',
        f"response.first={0.5 * FORCE}",
        f"response.last={FORCE}",
        f'response.families={{key="material.mass_damping", values=[{DAMPING}, {2 * DAMPING}]}}',
    )
    both = response(stored)
    assert [curve.value for curve in both.curves] == [DAMPING, 2 * DAMPING]
    same, damped = (curve.points[-1] for curve in both.curves)
    assert same.parameter == pytest.approx(FORCE, rel=1e-12)
    np.testing.assert_allclose(same.amplitude, point.amplitude, rtol=1e-6)
    assert damped.amplitude.max() < 0.999 * same.amplitude.max()


def test_curve_over_the_frequency_of_an_engine_order_says_that_the_speed_stays() -> None:
    turning = (
        "loads.0={group='load', direction=[0.0, 1.0], force=1e-3, engine_order=1}",
        f"rotation={{speed_rpm={60.0 * LOW}}}",
        f"response.last={1.01 * LOW}",
    )
    (warning,) = response(oscillator(*turning)).warnings
    assert "engine order" in warning and f"{60.0 * LOW:g} rpm" in warning


@pytest.mark.slow
def test_lightly_damped_mode_at_a_harmonic_is_named_with_the_stiffness_damping_that_it_lacks() -> (
    None
):
    """Modes of 1 and 5 rad/s: the second has the ratio 0.005 with 2 (0.005) / 5 s."""
    scene = scene_with("material.mass_damping=0.005")
    model = linear_model(
        np.eye(2), np.diag([1.0, 25.0]), damping=0.005, loads=np.ones((2, 1)), masters=0
    )._replace(load_histories=load_histories(scene))
    (warning,) = response(
        StoredModel(model, scene, "rubin", tuple("ab"), 9, np.ones(1), {})
    ).warnings
    assert "mode 2 at 0.79577 Hz has a damping ratio of 0.0005 (harmonic 5)" in warning
    assert "damping.stiffness = 0.002 " in warning


def test_curve_on_which_nothing_excites_the_body_is_refused() -> None:
    with refusal(ErrorKind.RANGE, "loads[0].force"):
        check_response(scene_with("loads.0.force=0.0"))
    with refusal(ErrorKind.RANGE, "loads[0].force"):
        check_response(scene_with('response.families={key="loads.0.force", values=[0.02, 0.0]}'))
    along = ('response.parameter="loads.0.force"', "response.first=0.001", "response.last=0.02")
    check_response(scene_with("loads.0.force=0.0", *along))
    still = {"direction": [0.0, 1.0], "frequency": LOW, "support_acceleration": 0.0}
    both = "loads[0].force = 0 and loads[1].support_acceleration = 0: nothing excites"
    with refusal(ErrorKind.RANGE, "loads[0].force", names=both):
        check_response(unforced(still))


def unforced(load: dict[str, Any], **more: Any) -> Scene:
    """A scene with a force of zero, another load and other tables."""
    table = scene_table(scene_with("loads.0.force=0.0")) | more
    return parse_scene(table | {"loads": [*table["loads"], load]}, "test", None)


VARYING: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
    ({"support_acceleration": 1.0, "frequency": LOW}, {}),
    ({"support_displacement": 1e-3, "frequency": LOW, "harmonics": [[2, 1.0, 0.0]]}, {}),
    ({"acceleration": 9.81, "engine_order": 1}, {"rotation": {"speed_rpm": 60.0 * LOW}}),
)


@pytest.mark.parametrize(("load", "more"), VARYING)
def test_curve_without_a_force_is_allowed_where_something_else_varies(
    load: dict[str, Any], more: dict[str, Any]
) -> None:
    check_response(unforced(load | {"direction": [0.0, 1.0]}, **more))


def test_curve_of_loads_that_do_not_repeat_is_refused() -> None:
    spin = 2.0 * np.pi * LOW
    turning = {"kind": "cylinder", "point": [0.0, 0.0], "radius": 2.0, "spin": spin}
    wavy = turning | {"waves": [[1, 1e-3, 0.0]]}
    stiff = {"normal_stiffness": 1.0, "tangential_stiffness": 1.0, "friction": 0.1}
    contact = {"group": "tip", "surface": wavy} | stiff
    table = scene_table(scene_with()) | {"contacts": [contact]}
    still = {"group": "load", "direction": [0.0, 1.0], "force": 0.0}
    check_response(parse_scene(table | {"loads": [still | {"frequency": LOW}]}, "test", None))
    table["time"] = {"duration": 10.0, "step": 0.05}
    for loads in ([], [still]):
        with refusal(ErrorKind.CONFLICT, "response.parameter", names="loads repeat"):
            parse_scene(table | {"loads": loads}, "test", None)


def test_interrupt_keeps_the_part_that_is_done() -> None:
    from fenicsrom.assess.curves import pieces as module

    lines: list[str] = []

    def stop(line: str) -> None:
        lines.append(line)
        if "2 points" in line:
            raise KeyboardInterrupt

    patch = pytest.MonkeyPatch()
    with patch.context() as context, heard(stop):
        context.setattr(module, "REPORT_INTERVAL", 0.0)
        found = response(oscillator())
    assert found.interrupted
    (curve,) = found.curves
    assert len(curve.points) == 2
    assert curve.pieces[0].reason == "interrupted"


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("frequency", 3.5),
        ("loads.0.force", 70.0),
        ("material.mass_damping", 2.0),
        ("contacts.1.preload", 30.0),
        ("contacts.1.gap", 1e-3),
        ("contacts.1.normal_stiffness", 3e4),
        ("contacts.1.tangential_stiffness", 3e4),
        ("contacts.1.friction", 0.1),
    ],
)
def test_family_gives_the_problem_of_the_changed_scene(parameter: str, value: float) -> None:
    place = {"group": "tip", "normal_stiffness": 1e4, "tangential_stiffness": 2e4, "friction": 0.3}
    wall = place | {"normal": [1.0, 0.0], "preload": 5.0}
    round_one = place | {"surface": {"kind": "cylinder", "point": [0.0, 0.0]}, "gap": 2e-3}
    table = {"parameter": parameter, "first": 0.5 * value, "last": value}
    other = wall | {"friction": 0.2} if parameter == "contacts.1.preload" else round_one
    scene = beam_scene(2, contacts=[wall, other], response=table)
    points = first(4, 4)[0]._replace(
        tributary_area=np.array([1.0, 0.25]), position=np.array([[2.0, 0.0], [2.0, 0.1]])
    )
    model = linear_model(np.eye(4), np.eye(4), loads=np.ones((4, 1)), masters=4)._replace(
        points=points, load_histories=load_histories(scene)
    )
    stored = StoredModel(model, scene, "rubin", tuple("abcd"), 9, np.ones(1), {})
    key = "loads.0.frequency" if parameter == "frequency" else parameter
    wanted = stored.with_overrides([f"{key}={value}"])
    problem = family_of(stored)(value)
    assert problem.period == pytest.approx(wanted.scene.period, rel=1e-14)
    assert problem.model.damping == wanted.model.damping or parameter != "material.mass_damping"
    np.testing.assert_allclose(
        problem.model.load_histories.sines, wanted.model.load_histories.sines, rtol=1e-14
    )
    for found, right in zip(
        leaves(problem.contacts), leaves(contacts_of(wanted.scene, points)), strict=True
    ):
        np.testing.assert_allclose(found, right, rtol=1e-14)


def leaves(value: Any) -> list[Any]:
    """The arrays of a record and of the records in it."""
    return (
        [leaf for item in value for leaf in leaves(item)] if isinstance(value, tuple) else [value]
    )


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "reduced_model.npz"
    save_model(path, oscillator())
    return path


def run(model: Path, folder: Path, *overrides: str) -> int:
    """The exit code of `fenicsrom response --from`."""
    sets = [word for override in overrides for word in ("--set", override)]
    return main(["response", "--from", str(model), "--output", str(folder), *sets])


@pytest.mark.slow
def test_command_writes_the_files_of_a_stored_model(
    model: Path, tmp_path: Path, capsys: Any
) -> None:
    assert run(model, tmp_path / "out") == 0
    folder = tmp_path / "out"
    names = """
        harmonics.png motions.npz multipliers.png provenance.json reduced_model.npz report.html
        response.csv response.json response.png response_state scene.toml
    """.split()
    assert {path.name for path in folder.iterdir()} == set(names)
    summary = json.loads((folder / "response.json").read_text())
    (curve,) = summary["curves"]
    assert [item["event"] for item in curve["events"]] == ["fold", "fold"]
    with open(folder / "response.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == curve["points"] + 2
    assert {row["stability"] for row in rows} == {"stable", "fold"}
    printed = capsys.readouterr().out
    assert str(folder / "report.html") in printed


@pytest.mark.parametrize(
    "override",
    [
        'response.families={key="geometry.thickness", values=[0.1]}',
        'response.parameter="material.young"',
    ],
)
def test_command_refuses_what_a_reduced_model_cannot_change(
    model: Path, tmp_path: Path, override: str
) -> None:
    assert run(model, tmp_path / "out", override) == 2
    assert not (tmp_path / "out" / "response.json").exists()


@pytest.mark.parametrize(
    ("key", "kind"),
    [
        ("frequency", ErrorKind.CONFLICT),
        ("contacts.0.preload", ErrorKind.RANGE),
        ("geometry.thickness", ErrorKind.MISMATCH),
    ],
)
def test_second_number_that_cannot_be_used_is_refused_by_its_own_key(
    key: str, kind: ErrorKind
) -> None:
    scene = scene_with(f'response.families={{key="{key}", values=[0.1]}}')
    with refusal(kind, "response.families.key"):
        check_response(scene)


def test_second_number_with_a_bad_value_is_refused_by_the_key_of_the_values() -> None:
    scene = scene_with('response.families={key="material.mass_damping", values=[1.0, -2.0]}')
    said = "response.families.values: material.mass_damping = -2: must be"
    with refusal(ErrorKind.RANGE, "response.families.values", names=said):
        check_response(scene)


@pytest.mark.parametrize(
    ("contact", "parameter", "last"), [("gap=2e-3", "preload", 15.0), ("preload=15.0", "gap", 2e-3)]
)
def test_curve_over_preload_with_gap_is_refused_as_its_scenes_are(
    contact: str, parameter: str, last: float
) -> None:
    scene = scene_with(
        "contacts=[{group='tip', normal=[1, 0], normal_stiffness=1e5, tangential_stiffness=1e5, "
        f"friction=0.1, {contact}}}]",
        f"response={{parameter='contacts.0.{parameter}', first=0.0, last={last}}}",
    )
    with refusal(ErrorKind.CONFLICT, "response.last"):
        check_response(scene)


@pytest.mark.slow
def test_lost_curve_says_where_and_exits_1(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from fenicsrom.online.curves.continuation import Continuation

    true = Continuation.values

    def lost(path: Any, s: Any, parameter: float, **options: Any) -> Any:
        missing = 1.1 * LOW < parameter < 1.15 * LOW
        return None if missing else true(path, s, parameter, **options)

    monkeypatch.setattr(Continuation, "values", lost)
    assert run(model, tmp_path / "out") == 1
    summary = json.loads((tmp_path / "out" / "response.json").read_text())
    assert summary["curves"][0]["points"] > 2
    assert re.search(r"ends at frequency = [0-9. and]+ Hz: no next point", summary["unfinished"])
    assert "no next point" in capsys.readouterr().err


@pytest.mark.slow
def test_curve_out_of_points_says_what_to_do_and_exits_1(model: Path, tmp_path: Path) -> None:
    assert run(model, tmp_path / "out", "response.points=20") == 1
    summary = json.loads((tmp_path / "out" / "response.json").read_text())
    assert summary["curves"][0]["ends"] == ["number of points"]
    assert "response.points" in summary["unfinished"]
    with open(tmp_path / "out" / "response.csv") as file:
        assert len(list(csv.DictReader(file))) >= 20


@pytest.mark.slow
def test_range_from_above_gives_the_same_curve(found: Response) -> None:
    down = response(oscillator(f"response.first={HIGH}", f"response.last={LOW}"))
    (curve,), (other,) = found.curves, down.curves
    assert other.points[0].parameter == pytest.approx(HIGH, rel=1e-12)
    assert other.pieces[0].reason == "end of the range" and len(other.pieces) == 1
    folds, others = ([p.parameter for p in c.special] for c in (curve, other))
    np.testing.assert_allclose(others[::-1], folds, rtol=1e-6)
    tops = [max(float(p.amplitude.max()) for p in c.points) for c in (curve, other)]
    assert tops[0] == pytest.approx(tops[1], rel=1e-6)


def test_start_without_a_motion_exits_1(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fenicsrom.assess.curves import response_problem as module
    from fenicsrom.errors import ConvergenceError

    def lost(*arguments: Any, **options: Any) -> None:
        raise ConvergenceError("no periodic motion")

    monkeypatch.setattr(module.shooting, "periodic_motion", lost)
    assert run(model, tmp_path / "out") == 1
    assert not (tmp_path / "out" / "response.json").exists()
