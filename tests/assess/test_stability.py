"""The quick part of the matrix of extremes, and that the verdicts can tell."""

import csv
import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import beam_scene, linear_model, oscillator, scene_of

from fenicsrom.assess import estimates, stability, verdicts
from fenicsrom.assess.stability import (
    AXES,
    CONVERGED,
    REFUSED,
    UNSTEADY,
    WRONG,
    Case,
    Finding,
    Matrix,
)
from fenicsrom.errors import AccuracyError, SceneError
from fenicsrom.online import measures, simulate
from fenicsrom.online.motion import Motion

DEMOS = Path(__file__).parents[2] / "demos"
SCENE = DEMOS / "slip_liftoff_2d.toml"


def examine(case: Case) -> Finding:
    table, scene = stability.load(SCENE)
    return stability.examine(case, table, scene.source, DEMOS)


QUICK = [
    ("the scene", "slip and lift-off", CONVERGED),
    ("the scene", "high load", CONVERGED),
    ("the scene", "500 N, 20 N", CONVERGED),
    ("contact stiffness", "100000 N/m", CONVERGED),
    ("friction", "10", CONVERGED),
    ("preload", "0 N", CONVERGED),
    ("preload beyond buckling", "5400 N, no friction", CONVERGED),
    ("preload through buckling", "0.99 times the buckling load", CONVERGED),
    ("preload through buckling", "1.01 times the buckling load", CONVERGED),
    ("curved surface", "casing of 2.54 m", CONVERGED),
    ("speed", "600 rpm", CONVERGED),
    ("load", "2 times", CONVERGED),
    ("damping", "41.2 1/s", CONVERGED),
    ("steps per period", "100", CONVERGED),
    ("Poisson's ratio", "0.499, plane stress", CONVERGED),
    ("Young's modulus", "1000 Pa", REFUSED),
    ("contact direction", "at the clamp", REFUSED),
    ("too few derivatives", "none", REFUSED),
    ("scheme", "average-acceleration, 20 steps, slip and lift-off", REFUSED),
]


@pytest.mark.parametrize(("axis", "value", "verdict"), QUICK)
def test_quick_part_of_the_matrix(axis: str, value: str, verdict: str) -> None:
    pytest.importorskip("dolfinx")
    found = examine(Case(axis, value, AXES[axis][value]))
    assert found.verdict == verdict, found.why
    if verdict == REFUSED:
        assert found.why.split(":")[0] in ("SceneError", "ConvergenceError", "AccuracyError")
    else:
        assert (
            found.estimate is not None and found.error is not None and found.imbalance is not None
        )
        assert found.error <= max(stability.FLOOR, found.estimate) and found.imbalance < 1e-9


def test_units_do_not_matter() -> None:
    pytest.importorskip("dolfinx")
    found = examine(Case("units", "mm, t, s", stability.in_units(1e-3, 1e3, 1.0), scale=1e-3))
    assert found.verdict == CONVERGED, found.why
    wrong = replace(found.case, scale=2e-3)
    assert examine(wrong).verdict == WRONG


@pytest.mark.slow
def test_the_full_model_and_the_beam_are_judged_too() -> None:
    pytest.importorskip("dolfinx")
    short = ("time.periods=12", "time.steps_per_period=50", "material.mass_damping=40")
    for model in ("full", "beam"):
        found = examine(Case("the scene", "short", short, model))
        assert found.verdict == CONVERGED, found.why
        assert found.basis_estimate is None


@pytest.mark.parametrize("name", ["open_2d", "slip_liftoff_2d", "stick_slip_2d", "high_load_2d"])
def test_fifty_steps_a_period_are_within_two_percent(name: str) -> None:
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
def test_the_full_model_converges_where_average_acceleration_fails() -> None:
    """500 N, 20 N, friction 0.2 at 3.25 Hz by the default settings; average acceleration fails at
    200 steps a period."""
    pytest.importorskip("dolfinx")
    found = examine(Case("the scene", "500 N, 20 N", stability.CRITICAL, "full"))
    assert found.verdict == CONVERGED and found.error is not None and found.error < 1e-3, found.why


def test_the_peak_force_has_an_estimate_of_its_own() -> None:
    """Where the step resolves the contact; else it is unknown, and said to be."""
    pytest.importorskip("dolfinx")
    soft = examine(
        Case(
            "impact",
            "soft",
            (*stability.WALL, "contacts.0.gap=0.1", "contacts.0.normal_stiffness=1e4"),
        )
    )
    assert soft.force_error is not None and soft.force_estimate is not None
    assert 0.0 < soft.force_error < soft.force_estimate < 0.2
    stiff = examine(
        Case(
            "impact",
            "stiff",
            (*stability.WALL, "contacts.0.gap=0.15", "contacts.0.normal_stiffness=1e8"),
        )
    )
    assert stiff.force_estimate == np.inf
    if stiff.verdict == CONVERGED:
        assert "peak force is unknown" in stiff.why


def test_a_step_in_which_friction_gives_energy_is_seen() -> None:
    _, _, motion = oscillator()
    assert (
        stability.unbounded(
            replace(
                motion,
                friction_dissipation=np.linspace(0.0, 1.0, motion.time.size),
                work=motion.work + 1.0,
            )
        )
        == ""
    )
    gift = np.where(np.arange(motion.time.size) == 7, -1e-6, 0.0)
    assert "friction gave" in stability.unbounded(replace(motion, friction_dissipation=gift))


@pytest.mark.parametrize("shift", stability.SHIFTS)
def test_a_distorted_mesh_is_refused_once_its_cells_turn_over(tmp_path: Path, shift: float) -> None:
    pytest.importorskip("dolfinx")
    path = stability.zigzag_mesh(tmp_path / "zigzag.msh", shift)
    found = examine(
        Case("mesh", "", (f"geometry={{mesh={str(path)!r}, dimension=2, thickness=0.0254}}",))
    )
    assert found.verdict == (REFUSED if shift > 0.5 else CONVERGED), found.why
    assert "inverted" in found.why if shift > 0.5 else True


def test_forty_modes_are_as_good_as_five() -> None:
    """The residual flexibility of forty modes is nearly nothing: its condition grows, that of the
    basis does not."""
    pytest.importorskip("dolfinx")
    amplitudes, conditions, flexibilities = {}, {}, {}
    for count in (5, 40):
        scene = beam_scene(2, (f"basis.modes={count}",))
        model, study = stability.build(scene, "reduced")
        assert study is not None
        basis = stability_basis(study)
        amplitudes[count] = measures.amplitude(simulate.simulate(model, scene))
        conditions[count], flexibilities[count] = basis.condition, study.modes.flexibility_condition
    assert amplitudes[40] == pytest.approx(amplitudes[5], rel=1e-4)
    assert conditions[40] < 1e8
    assert flexibilities[40] > flexibilities[5]


def stability_basis(study):  # type: ignore[no-untyped-def]
    from fenicsrom.reduction.stages import enrich

    return enrich(study.solid, study.modes, study.selection, study.derivatives)


# ------------------------------------------------------------------ what the checks see


def test_the_estimate_covers_the_error() -> None:
    """The exact amplitude of the oscillator is known; the estimate is six times the error, more or
    less."""
    omega = 2.0 * np.pi
    exact = [f / abs(complex(k - omega**2, 0.5 * omega)) for f, k in ((1.0, 60.0), (0.3, 30.0))]
    for steps in (20, 40, 80):
        model, scene, motion = oscillator(steps)
        error = float(np.linalg.norm(measures.amplitude(motion) - exact) / np.linalg.norm(exact))
        estimate = estimates.step_errors(model, scene, motion).amplitude
        assert error < estimate < 15.0 * error


def struck(step: float, touching: bool) -> tuple[object, object, Motion]:
    """The oscillator struck once, before a wall that it meets, or in the open; its motion decays
    within the run."""
    hit = {
        "group": "tip",
        "direction": [1.0, 0.0],
        "force": 1.0,
        "pulse": {"start": 0.1, "duration": 0.8},
    }
    wall = {
        "group": "tip",
        "at": "centre",
        "normal": [1.0, 0.0],
        "preload": 0.0,
        "gap": 2e-3,
        "friction": 0.3,
        "normal_stiffness": 40.0,
        "tangential_stiffness": 20.0,
    }
    scene = beam_scene(
        2,
        ("material.mass_damping=2.0",),
        loads=[hit],
        contacts=[wall] if touching else None,
        probe={"group": "tip"},
        geometrically_nonlinear=False,
        time={"duration": 3.0, "step": step},
    )
    model = linear_model(
        np.eye(2),
        np.diag([60.0, 30.0]),
        damping=2.0,
        loads=[[1.0], [0.3]],
        load_histories=simulate.load_histories(scene),
        masters=2 if touching else 0,
    )
    return model, scene, simulate.simulate(model, scene)


@pytest.mark.parametrize("touching", [False, True])
def test_the_estimate_of_a_run_of_a_duration_covers_its_error(touching: bool) -> None:
    model, scene, exact = struck(1e-4, touching)
    assert measures.is_unsteady(exact) is False and not measures.has_settled(exact)
    for step in (0.02, 0.01, 0.005):
        model, scene, motion = struck(step, touching)
        found = estimates.step_errors(model, scene, motion)
        size = np.linalg.norm(measures.rms(exact))
        error = float(np.linalg.norm(measures.rms(motion) - measures.rms(exact)) / size)
        assert error < found.amplitude < 30.0 * error
        force, right = measures.peak_normal_force(motion), measures.peak_normal_force(exact)
        assert (force > 0.0) == touching and abs(force - right) <= max(
            found.peak_force, 0.02
        ) * force
        assert found.peak_force < 0.1
    model, scene, motion = struck(0.2, touching)
    with pytest.raises(
        AccuracyError,
        match=r"time\.step = 0\.2: the steps are too long: twice the step gives an error",
    ):
        verdicts.check_time_error(
            scene,
            estimates.step_errors(model, scene, motion).amplitude,
            measures.is_unsteady(motion),
        )
    doubt = verdicts.rejection_reason(model, scene, motion)
    assert doubt is not None and "the steps are too long" in str(doubt)


def test_a_resumed_run_is_judged_by_what_it_recorded() -> None:
    model, scene, motion = struck(0.01, True)
    late = motion.time >= 1.5
    names = ("time", "displacement", "force")
    resumed = replace(motion, **{name: getattr(motion, name)[late] for name in names})
    assert 0.0 < measures.peak_normal_force(resumed) < 0.5 * measures.peak_normal_force(motion)
    whole, part = (
        estimates.step_errors(model, scene, motion),
        estimates.step_errors(model, scene, resumed),
    )
    assert part.peak_force < 0.1 and part.amplitude < 10.0 * whole.amplitude


def test_what_rests_has_no_error_but_that_of_where() -> None:
    """Six steps are too few for an amplitude, but not for one of 1e-9 of the displacement."""
    from fenicsrom.assess.estimates import basis_error

    model, scene, moving = oscillator(6, force=1e-8)
    assert estimates.step_errors(
        model, scene, moving
    ).amplitude > verdicts.TIME_ERROR and not measures.at_rest(moving)
    bent = model._replace(probe_offset=np.ones(2))  # type: ignore[attr-defined]
    motion = simulate.simulate(bent, scene)
    assert measures.at_rest(motion) and measures.has_settled(replace(motion, steady=False))
    assert estimates.step_errors(bent, scene, motion) == (0.0, 0.0)
    elsewhere = bent._replace(probe_offset=np.full(2, 1.25))
    assert basis_error(elsewhere, scene, motion) == 0.0
    assert basis_error(elsewhere, scene, replace(motion, buckled=1)) == pytest.approx(0.2)
    assert basis_error(model._replace(loads=2.0 * model.loads), scene, moving) == pytest.approx(
        0.5, rel=1e-3
    )  # type: ignore


@pytest.mark.parametrize("tolerance", [0.9, 0.999])
def test_a_tolerance_so_large_that_the_next_is_no_larger_is_refused(tolerance: float) -> None:
    """Off by an eighth, it once was taken as exact: what it was compared with had the same
    tolerance."""
    model, scene, _ = oscillator()
    scene = replace(scene, time=replace(scene.time, steps_per_period=None, tolerance=tolerance))
    assert (
        estimates.step_errors(model, scene, simulate.simulate(model, scene)).amplitude
        > verdicts.UNSETTLED_ERROR
    )


def test_a_single_step_has_an_unknown_error(monkeypatch: pytest.MonkeyPatch) -> None:
    model, scene, motion = oscillator()
    once = replace(
        scene.time,
        steps_per_period=None,
        periods=None,
        steady_tolerance=None,
        duration=1.0,
        step=1.0,
    )
    single = replace(scene, time=once)
    assert estimates.step_errors(model, single, replace(motion, period=None)) == (np.inf, np.inf)
    still = replace(motion, period=None, displacement=np.ones_like(motion.displacement))
    monkeypatch.setattr(estimates, "simulate", lambda *_: still)
    assert estimates.step_errors(model, single, still) == (0.0, 0.0)


def test_long_steps_are_refused_by_name() -> None:
    model, scene, motion = oscillator(6)
    with pytest.raises(AccuracyError, match="steps_per_period = 6: the steps are too long"):
        verdicts.check_time_error(scene, estimates.step_errors(model, scene, motion).amplitude)
    assert verdicts.recommended_step(scene, 0.1).time.steps_per_period == 12
    verdicts.check_time_error(scene, 0.9 * verdicts.TIME_ERROR)
    with pytest.raises(AccuracyError, match="no motion that settles"):
        verdicts.check_time_error(scene, float("inf"))


@pytest.mark.parametrize("steps", [6, 10, 14])
def test_the_steps_that_are_advised_are_enough(steps: int) -> None:
    model, scene, motion = oscillator(steps)
    with pytest.raises(
        AccuracyError, match=r"a richer basis is no help, steps_per_period = \d+ is likely enough$"
    ) as refusal:
        verdicts.check_time_error(scene, estimates.step_errors(model, scene, motion).amplitude)
    advised = int(str(refusal.value).split(" = ")[-1].split()[0])
    assert advised % steps == 0 and advised <= 64 * steps
    verdicts.check_time_error(scene, estimates.step_errors(*oscillator(advised)).amplitude)


def test_shorter_steps_are_advised_in_the_key_that_was_given() -> None:
    _, scene, _ = oscillator(8)
    for key, value, advised in (("tolerance", 0.032, 0.0005), ("step", 0.1, 0.025)):
        time = replace(scene.time, steps_per_period=None, **{key: value})
        with pytest.raises(
            AccuracyError,
            match=rf'{key} = {advised:g} is likely enough; or time.scheme = "generalised-alpha"',
        ):
            verdicts.check_time_error(replace(scene, time=time), float("inf"))


def test_energy_from_nowhere_is_refused() -> None:
    _, _, motion = oscillator()
    verdicts.check_energy(motion)
    ramp, most = (
        np.linspace(0.0, 1.0, motion.time.size),
        float(np.max(motion.kinetic + motion.elastic)),
    )
    for share, refused in ((0.9e-2, False), (1.1e-2, True)):
        with pytest.raises(AccuracyError, match="comes from nowhere") if refused else nullcontext():
            verdicts.check_energy(
                replace(
                    motion, damping_dissipation=motion.damping_dissipation + share * most * ramp
                )
            )
    # to lose some is to damp more: it is held against what the loads do
    most += float(np.max(motion.work))
    for share, refused in ((0.9e-2, False), (1.1e-2, True)):
        with (
            pytest.raises(AccuracyError, match="the work of the loads is lost")
            if refused
            else nullcontext()
        ):
            verdicts.check_energy(
                replace(
                    motion, damping_dissipation=motion.damping_dissipation - share * most * ramp
                )
            )
    gift = (
        np.where(np.arange(motion.time.size) % 2 == 1, -0.1, 0.0) * motion.damping_dissipation[-1]
    )
    with pytest.raises(AccuracyError, match="friction gives energy"):
        verdicts.check_energy(replace(motion, friction_dissipation=gift, work=motion.work + gift))
    with pytest.raises(
        AccuracyError, match="friction gives energy"
    ):  # what was damped before the first record is no excuse
        verdicts.check_energy(
            replace(
                motion,
                friction_dissipation=gift,
                work=motion.work + gift,
                damping_dissipation=motion.damping_dissipation
                + 1e5 * motion.damping_dissipation[-1],
            )
        )


def test_only_what_repeats_is_settled() -> None:
    _, _, motion = oscillator()
    assert motion.steady and measures.has_settled(motion)
    assert measures.has_settled(replace(motion, steady=False))
    growing = motion.displacement * (1.0 + 0.01 * motion.time / motion.period)[:, None, None]
    assert not measures.has_settled(replace(motion, steady=False, displacement=growing))
    assert not measures.has_settled(replace(motion, steady=False, period=None))


def test_an_unbounded_motion_is_seen() -> None:
    _, _, motion = oscillator()
    assert stability.unbounded(motion) == ""
    assert "finite" in stability.unbounded(
        replace(motion, displacement=motion.displacement * np.nan)
    )
    growing = motion.kinetic * np.linspace(1.0, 2.0, motion.time.size)
    assert "created" in stability.unbounded(replace(motion, kinetic=growing))


def test_the_verdicts(monkeypatch: pytest.MonkeyPatch) -> None:
    """One case under every kind of trouble."""
    model, scene, motion = oscillator(80)
    runs = {80: motion, 40: oscillator(40)[2], 160: oscillator(160)[2]}
    monkeypatch.setattr(stability, "scene_of", lambda *_: scene)
    monkeypatch.setattr(stability, "build", lambda *_: (model, None))

    def verdict(**changed: Motion) -> Finding:
        found = runs | {int(name[1:]): run for name, run in changed.items()}
        for module in (stability, estimates):
            monkeypatch.setattr(module, "simulate", lambda _, s: found[s.time.steps_per_period])
        return stability.examine(Case("a", "b", ()), {}, "s", Path())

    def scaled(run: Motion, factor: float) -> Motion:
        return replace(run, displacement=factor * run.displacement)

    fading = np.exp(-motion.time / 50.0)[:, None, None]
    slow = replace(motion, steady=False, displacement=fading * motion.displacement)
    assert verdict().verdict == CONVERGED
    assert verdict(n160=scaled(runs[160], 1.1)).verdict == WRONG
    assert verdict(n40=scaled(runs[40], 1.1)).verdict == REFUSED
    assert verdict(n80=slow, n40=slow, n160=slow).verdict == UNSTEADY
    assert verdict(n80=slow, n40=slow, n160=scaled(slow, 3.0)).verdict == WRONG
    assert verdict(n80=slow, n40=scaled(slow, 3.0)).verdict == REFUSED
    assert verdict(n80=scaled(motion, np.nan)).verdict == WRONG
    monkeypatch.setattr(stability, "build", lambda *_: 1 / 0)
    assert verdict().verdict == WRONG
    refusal = SceneError("s.toml: what: must be otherwise")
    monkeypatch.setattr(stability, "build", lambda *_: (_ for _ in ()).throw(refusal))
    assert verdict().verdict == REFUSED


def test_the_matrix_is_large_and_its_names_exist(tmp_path: Path) -> None:
    wanted = list(stability.cases(tmp_path))
    assert sum(case.model == "reduced" for case in wanted) >= 100
    assert all(sum(case.model == model for case in wanted) >= 12 for model in ("full", "beam"))
    assert len({(case.axis, case.value, case.model) for case in wanted}) == len(wanted)
    named = {(axis, value) for axis, values in stability.RICHER_AXES.items() for value in values}
    assert named == {(case.axis, case.value) for case in wanted if case.richer}


def test_the_files(tmp_path: Path) -> None:
    _, scene = stability.load(SCENE)
    cases = [
        Case("load", f"{k} times <&>", ("x=1",), model)
        for k, model in enumerate(("reduced", "reduced", "full"))
    ]
    findings = [
        Finding(cases[0], CONVERGED, "", 0.1, 1e-3, None, 1e-4, None, 1e-4, 1e-12, True, 20, 1.0),
        Finding(cases[1], WRONG, "off by 1", 0.2, float("inf"), None, 1.0),
        Finding(cases[2], REFUSED, "SceneError: no"),
    ]
    matrix = Matrix(scene, findings, 3.0)
    files = stability.write(matrix, tmp_path)
    assert [path.name for path in files] == [
        "report.html",
        "stability.json",
        "stability.csv",
        "stability.png",
    ]
    found = json.loads(files[1].read_text())
    assert found["verdicts"] == {CONVERGED: 1, UNSTEADY: 0, REFUSED: 1, WRONG: 1}
    assert [run["verdict"] for run in found["runs"]] == [CONVERGED, WRONG, REFUSED]
    assert found["runs"][1]["estimate"] is None
    rows = list(csv.DictReader(files[2].read_text(encoding="utf-8").splitlines()))
    assert [row["why"] for row in rows] == ["", "off by 1", "SceneError: no"]
    assert files[3].read_bytes().startswith(b"\x89PNG")
    page = files[0].read_text()
    assert "times &lt;&amp;&gt;" in page and "Silently wrong" in page and "data:image/png" in page
    assert (
        stability.sentences(matrix)[0]
        == "3 runs in 3 s: 1 converged, 0 not steady, 1 refused, 1 silently wrong."
    )


def test_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two processes; exit code 1 as soon as one run is silently wrong."""
    pytest.importorskip("dolfinx")
    from fenicsrom.cli import main

    names = [("friction", "10"), ("contact direction", "at the clamp")]
    few = [Case(axis, value, AXES[axis][value]) for axis, value in names]
    monkeypatch.setattr(stability, "cases", lambda folder: iter(few))
    monkeypatch.setattr(stability, "STUDIED", {})
    assert main(["stability", "--output", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "2 runs in" in told and "1 converged, 0 not steady, 1 refused, 0 silently wrong" in told
    assert f"{tmp_path / 'out' / 'report.html'}" in told
    monkeypatch.setattr(stability, "run_all", lambda *_: [Finding(few[0], WRONG, "a reason")])
    assert main(["stability", str(SCENE), "--output", str(tmp_path / "out")]) == 1
    assert "silently wrong: friction, 10 (reduced): a reason" in capsys.readouterr().out
