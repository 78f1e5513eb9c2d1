"""`fenicsrom stability`: the verdict on a run, the files and the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import beam_scene, oscillator, refusal

from fenicsrom.assess.errors import estimates, verdicts
from fenicsrom.assess.studies import stability
from fenicsrom.assess.studies.stability import Case, Finding, Verdict
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run import simulate
from fenicsrom.online.step.state import PeriodicSearch

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"


def examine(case: Case) -> Finding:
    pytest.importorskip("dolfinx")
    table, scene = stability.load(SCENE)
    return stability.examine(case, table, scene.source, DEMOS)


@pytest.mark.slow
def test_full_model_and_beam_are_judged() -> None:
    short = ("time.periods=12", "time.steps_per_period=50", "material.mass_damping=40")
    for model in ("full", "beam"):
        found = examine(Case("the scene", "short", short, model))
        assert found.verdict is Verdict.CONVERGED, found.why
        assert found.basis_estimate is None


@pytest.mark.parametrize(
    "name",
    [
        "open_2d",
        "slip_liftoff_2d",
        pytest.param("stick_slip_2d", marks=pytest.mark.slow),
        pytest.param("high_load_2d", marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_fifty_steps_per_period_are_within_two_percent(name: str) -> None:
    """Of the amplitude at 3200 steps, on the paper's four cases: measured 0.01, 0.02, 0.16 and 0.25
    %."""
    pytest.importorskip("dolfinx")
    table, scene = stability.load(DEMOS / f"{name}.toml")
    found = []
    for steps in (50, 3200):
        wanted = stability.scene_of(
            table, scene.source, DEMOS, (f"time.steps_per_period={steps}", "time.periods=120")
        )
        motion = simulate.simulate(stability.build(wanted, "reduced")[0], wanted)
        assert measures.has_settled(motion) and motion.relative_imbalance < 1e-10
        found.append(measures.amplitude(motion))
    assert np.linalg.norm(found[0] - found[1]) < 0.02 * np.linalg.norm(found[1])


@pytest.mark.slow
def test_forty_modes_agree_with_five() -> None:
    """The residual flexibility of forty modes is almost zero, so its condition grows; the condition
    of the basis does not."""
    pytest.importorskip("dolfinx")
    amplitudes, conditions, flexibilities = {}, {}, {}
    for count in (5, 40):
        scene = beam_scene(2, (f"basis.modes={count}", 'basis.derivatives="mmi"'))
        model, reduction, _ = stability.build(scene, "reduced")
        assert reduction is not None
        basis = reduction.basis
        amplitudes[count] = measures.amplitude(simulate.simulate(model, scene))
        conditions[count], flexibilities[count] = (
            basis.condition,
            reduction.modes.flexibility_condition,
        )
    assert amplitudes[40] == pytest.approx(amplitudes[5], rel=1e-4)
    assert conditions[40] < 1e8
    assert flexibilities[40] > flexibilities[5]


def test_motion_that_is_not_finite_is_unphysical() -> None:
    _, _, motion = oscillator()
    assert stability.unphysical(motion, "discrete-gradient") == ""
    broken = replace(motion, displacement=motion.displacement * np.nan)
    assert "finite" in stability.unphysical(broken, "discrete-gradient")


def test_friction_that_gives_energy_is_unphysical_for_the_discrete_gradient() -> None:
    _, _, motion = oscillator()
    gift = np.where(np.arange(motion.time.size) == 7, -1e-6, 0.0)
    gained = replace(motion, friction_dissipation=gift)
    assert "friction" in stability.unphysical(gained, "discrete-gradient")
    assert stability.unphysical(gained, "average-acceleration") == ""


def test_peak_force_without_estimate_is_called_unknown() -> None:
    _, _, motion = oscillator()
    numbers = {"error": 0.0, "estimate": 0.0, "force_estimate": 0.1}
    for found in (motion, replace(motion, period=None, steady=False)):  # a transient has no period
        assert stability.verdict_of(found, found, numbers) == (Verdict.CONVERGED, "")
    verdict, why = stability.verdict_of(motion, motion, numbers | {"force_estimate": np.inf})
    assert verdict is Verdict.CONVERGED and "peak force is unknown" in why


def test_verdict_of_a_case_under_every_kind_of_trouble(monkeypatch: pytest.MonkeyPatch) -> None:
    model, scene, motion = oscillator(80)
    runs = {80: motion, 40: oscillator(40)[2], 160: oscillator(160)[2]}
    monkeypatch.setattr(stability, "scene_of", lambda *_: scene)
    monkeypatch.setattr(stability, "build", lambda *_: (model, None, None))

    def verdict(**changed: Motion) -> Finding:
        found = runs | {int(name[1:]): run for name, run in changed.items()}
        for module in (stability, estimates):
            monkeypatch.setattr(
                module, "simulate", lambda _, s, **o: found[s.time.steps_per_period]
            )
        return stability.examine(Case("a", "b", ()), {}, "s", Path())

    def scaled(run: Motion, factor: float) -> Motion:
        return replace(run, displacement=factor * run.displacement)

    fading = np.exp(-motion.time / 50.0)[:, None, None]
    slow = replace(motion, steady=False, displacement=fading * motion.displacement)
    assert verdict().verdict is Verdict.CONVERGED
    assert verdict(n160=scaled(runs[160], 1.1)).verdict is Verdict.WRONG
    # near its resonance: the amplitude at the frequency of the loads does not refuse a run
    assert verdict(n40=scaled(runs[40], 1.1)).verdict is Verdict.CONVERGED
    monkeypatch.setattr(verdicts, "near_resonance", lambda errors, *_: errors)
    assert verdict(n40=scaled(runs[40], 1.1)).verdict is Verdict.REFUSED
    unsteady = {f"n{steps}": slow for steps in (80, 40, 160, 320, 640)}
    off = scaled(slow, 3.0)
    assert verdict(**unsteady).verdict is Verdict.UNSTEADY
    assert verdict(**unsteady | {"n640": off}).verdict is Verdict.WRONG
    assert verdict(**unsteady | {"n320": off}).verdict is Verdict.REFUSED
    assert verdict(**unsteady | {"n40": off}).verdict is Verdict.REFUSED
    assert verdict(n80=scaled(motion, np.nan)).verdict is Verdict.WRONG
    monkeypatch.setattr(stability, "build", lambda *_: 1 / 0)
    assert verdict().verdict is Verdict.WRONG
    refusal = SceneError("s.toml: what: must be otherwise")
    monkeypatch.setattr(stability, "build", lambda *_: (_ for _ in ()).throw(refusal))
    assert verdict().verdict is Verdict.REFUSED


def test_motion_that_does_not_repeat_is_told_with_what_newton_found() -> None:
    _, _, motion = oscillator(80)
    fading = np.exp(-motion.time / 50.0)[:, None, None]
    slow = replace(motion, steady=False, displacement=fading * motion.displacement)
    lost = PeriodicSearch(
        verdict="not found",
        tends=False,
        time=None,
        periods=1,
        marched=80,
        iterations=7,
        residual=0.3,
        multipliers=np.zeros(0, dtype=np.complex128),
        free_sliders=0,
    )
    torus = lost._replace(verdict="torus", multipliers=np.array([0.75 + 1j, 0.75 - 1j]))
    for search, text in (
        (lost, "Newton's method found no periodic motion"),
        (torus, "the periodic motion is unstable (torus, largest multiplier 1.25)"),
        (torus._replace(verdict="stable"), "a stable periodic motion exists (largest multiplier"),
    ):
        numbers = {"error": 0.0, "estimate": 0.0, "force_estimate": 0.0}
        found = replace(slow, search=search)
        verdict, why = stability.verdict_of(found, found, numbers)
        assert verdict is Verdict.UNSTEADY and text in why and "eighth" not in why
        assert (
            "; with an eighth of the step it settles"
            in stability.verdict_of(found, motion, numbers)[1]
        )


@pytest.mark.slow
def test_command_runs_chosen_axes_and_names_those_left_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two processes; exit code 1 as soon as one run is silently wrong."""
    pytest.importorskip("dolfinx")
    from fenicsrom.assess.studies import axes
    from fenicsrom.cli import main

    few = {"0": ("contacts.0.friction=0.0",), "at the clamp": ("contacts.0.group='root'",)}
    monkeypatch.setitem(axes.AXES, "friction", lambda scene, scales: few)
    out = str(tmp_path / "out")
    call = ["stability", str(SCENE), "--axis", "friction", "--axis", "gap", "--output", out]
    assert main(call) == 0
    told = capsys.readouterr().out
    assert "2 runs in" in told and "1 converged, 0 not steady, 1 refused, 0 silently wrong" in told
    assert f"{tmp_path / 'out' / 'report.html'}" in told
    assert "axis gap: left out: no contact has a gap" in told
    wrong = Finding(Case("friction", "0", ()), Verdict.WRONG, "a reason")
    monkeypatch.setattr(stability, "run_all", lambda *_: [wrong])
    assert main(call) == 1
    assert "silently wrong: friction, 0 (reduced): a reason" in capsys.readouterr().out


def test_unknown_axis_is_refused() -> None:
    with refusal(ErrorKind.UNKNOWN_KEY, "colour", names="scene, "):
        stability.stability(SCENE, (), ["colour"])


def test_static_scene_is_refused() -> None:
    with refusal(ErrorKind.MISSING, "loads"):
        stability.stability(DEMOS / "blade_pressed.toml", ())
