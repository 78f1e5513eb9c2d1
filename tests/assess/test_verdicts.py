"""The error estimates and the verdicts of a motion, against motions whose errors are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, oscillator

from fenicsrom.assess.errors import estimates, verdicts
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.notes import AMPLITUDES, PEAK_FORCE, TRUSTED, verdict_of
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run import simulate
from fenicsrom.post.run.report import estimate_rows
from fenicsrom.records import Study
from fenicsrom.study import check


def test_estimate_covers_the_error_of_the_exact_oscillator() -> None:
    """The exact amplitude is known; the estimate is about six times the error."""
    omega = 2.0 * np.pi
    exact = [f / abs(complex(k - omega**2, 0.5 * omega)) for f, k in ((1.0, 60.0), (0.3, 30.0))]
    for steps in (20, 40, 80):
        model, scene, motion = oscillator(steps)
        error = float(np.linalg.norm(measures.amplitude(motion) - exact) / np.linalg.norm(exact))
        estimate = estimates.step_errors(model, scene, motion).amplitude
        assert error < estimate < 15.0 * error


def struck(step: float, touching: bool) -> tuple[object, object, Motion]:
    """The oscillator after a single impulse, with or without a wall that it hits; its motion decays
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
        time={"duration": 3.0, "step": 0.01},
    )
    scene = replace(scene, time=scene.time.changed(step=step))  # longer than a file allows, too
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
def test_estimate_of_a_transient_covers_its_error(touching: bool) -> None:
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
    estimate = estimates.step_errors(model, scene, motion).amplitude
    with pytest.raises(AccuracyError) as refusal:
        verdicts.check_error(scene, "time step", estimate, measures.is_unsteady(motion))
    assert (refusal.value.kind, refusal.value.key) == (ErrorKind.TIME_STEP, "time.step")


def test_resumed_run_is_judged_by_its_own_record() -> None:
    model, scene, motion = struck(0.01, True)
    late = motion.time >= 1.5
    names = ("time", "displacement", "force", "friction_dissipation", "probe")
    resumed = replace(motion, **{name: getattr(motion, name)[late] for name in names})
    assert 0.0 < measures.peak_normal_force(resumed) < 0.5 * measures.peak_normal_force(motion)
    whole, part = (
        estimates.step_errors(model, scene, motion),
        estimates.step_errors(model, scene, resumed),
    )
    assert part.peak_force < 0.1 and part.amplitude < 10.0 * whole.amplitude


@pytest.mark.parametrize(
    ("force", "said"),
    [
        ((0.17, 0.13), "17 % by the time step and 13 % by the mesh (at"),
        ((np.inf, 0.01), "force by the time step could not be estimated (at"),
        ((0.17, np.inf), "17 % by the time step, and that by the mesh could not be estimated (at"),
    ],
)
def test_large_error_of_the_peak_force_casts_doubt_on_it_alone(
    force: tuple[float, float], said: str
) -> None:
    _, scene, motion = struck(0.01, True)
    step, mesh = (estimates.MotionErrors(0.02, size, (0.02, 0.03)) for size in force)
    (note,) = verdicts.error_notes(scene, {"time step": step, "mesh": mesh}, motion)
    assert said in note and note.quantity == PEAK_FORCE
    judged = verdict_of([note], quantities=[AMPLITUDES, *verdicts.contact_quantities(scene)])
    assert judged.kind == "doubtful" and judged.quantities[AMPLITUDES] == TRUSTED
    assert judged.quantities[PEAK_FORCE] == note
    assert verdicts.error_notes(scene, {"mesh": step._replace(peak_force=0.1)}, motion) == []


@pytest.mark.parametrize(
    ("errors", "said"),
    [((0.001, 0.02), "0.1 to 2"), ((0.001, np.inf), "0.1 or more"), ((np.inf, np.inf), "unknown")],
)
def test_range_of_errors_has_no_unknown_end(errors: tuple[float, float], said: str) -> None:
    same, rest = (estimates.MotionErrors(size, 0.0, (size, 0.0)) for size in errors)
    _, scene, motion = struck(0.01, True)
    table = estimate_rows(scene, {"basis": same._replace(from_rest=rest)}, motion, ("x", "y"))
    assert table[1][1] == said


def test_amplitude_that_a_shifted_resonance_changes_is_doubtful() -> None:
    _, scene, motion = struck(0.01, True)
    shifted = estimates.MotionErrors(0.01, 0.0, (0.01, 0.01), shift=0.01, at_frequency=1.5)
    (note,) = verdicts.error_notes(scene, {"mesh": shifted}, motion)
    assert note.quantity == AMPLITUDES and "150 %" in note
    assert verdicts.error_notes(scene, {"mesh": shifted._replace(at_frequency=0.05)}, motion) == []


def test_estimates_of_probe_and_dissipation_follow_the_motions() -> None:
    """The other motion has 10 % more of both; the estimate is twice the difference."""
    *_, motion = struck(0.01, True)
    spent = np.linspace(0.0, 1.0, motion.time.size)
    motion = replace(motion, friction_dissipation=spent)
    assert motion.probe is not None
    other = replace(motion, friction_dissipation=1.1 * spent, probe=1.1 * motion.probe)
    nothing = estimates.MotionErrors(0.0, 0.0, (0.0, 0.0))
    found = estimates.with_further(nothing, motion, other, 2.0)
    assert found.worn == 0.0
    assert (found.probe, found.dissipation, found.history) == pytest.approx((0.2, 0.2, 0.2))


def test_history_of_the_probe_sees_the_phase_that_its_amplitudes_hide() -> None:
    """The other motion is half a period late: the estimate is twice the difference of 2."""
    *_, motion = struck(0.01, True)
    assert motion.probe is not None
    once = replace(motion, probe=motion.probe - motion.probe.mean(axis=0))
    nothing = estimates.MotionErrors(0.0, 0.0, (0.0, 0.0))
    found = estimates.with_further(nothing, once, replace(once, probe=-once.probe), 2.0)
    assert found.history == pytest.approx(4.0) and found.probe == pytest.approx(0.0, abs=1e-12)


def test_motion_at_rest_has_no_error_but_that_of_its_position() -> None:
    """Six steps per period give a wrong amplitude, but the error is small for an amplitude of 1e-9
    of the displacement."""
    model, scene, moving = oscillator(6, force=1e-8)
    assert estimates.step_errors(
        model, scene, moving
    ).amplitude > verdicts.TIME_ERROR and not measures.at_rest(moving)
    bent = model._replace(probe_offset=np.ones(2))  # type: ignore[attr-defined]
    motion = simulate.simulate(bent, scene)
    assert measures.at_rest(motion) and measures.has_settled(replace(motion, steady=False))
    assert estimates.step_errors(bent, scene, motion)[:3] == (0.0, 0.0, (0.0, 0.0))
    elsewhere = simulate.simulate(bent._replace(probe_offset=np.full(2, 1.25)), scene)
    assert estimates.distances(motion, elsewhere)[:3] == (0.0, 0.0, (0.0, 0.0))
    moved = estimates.distances(replace(motion, buckled=1), elsewhere)
    assert moved.amplitude == pytest.approx(0.2)
    twice = simulate.simulate(model._replace(loads=2.0 * model.loads), scene)  # type: ignore
    assert estimates.distances(moving, twice).amplitude == pytest.approx(0.5, rel=1e-3)


def test_estimate_of_a_huge_tolerance_exceeds_every_limit() -> None:
    """The amplitude is wrong by a tenth, and the motion settles.

    A comparison with a run of the same tolerance would not show this error.
    """
    model, scene, exact = oscillator(400)
    scene = replace(scene, time=scene.time.changed(tolerance=0.999))
    motion = simulate.simulate(model, scene)
    size = measures.amplitude(exact)
    error = np.linalg.norm(measures.amplitude(motion) - size) / np.linalg.norm(size)
    assert measures.has_settled(motion) and error > 0.05
    assert estimates.step_errors(model, scene, motion).amplitude > max(
        verdicts.UNSETTLED_ERROR, 5.0 * error
    )


def test_single_step_has_an_unknown_error(monkeypatch: pytest.MonkeyPatch) -> None:
    model, scene, motion = oscillator()
    single = replace(scene, time=scene.time.changed(duration=1.0, step=1.0))
    unknown = estimates.step_errors(model, single, replace(motion, period=None))
    assert unknown[:3] == (np.inf, np.inf, (np.inf, np.inf)) and unknown.largest == np.inf
    still = replace(motion, period=None, displacement=np.ones_like(motion.displacement))
    monkeypatch.setattr(estimates, "simulate", lambda *_, **__: still)
    assert estimates.step_errors(model, single, still)[:3] == (0.0, 0.0, (0.0, 0.0))


def test_long_steps_are_refused_with_their_key() -> None:
    model, scene, motion = oscillator(6)
    with pytest.raises(AccuracyError, match="steps_per_period = 6: ") as refusal:
        verdicts.check_error(
            scene, "time step", estimates.step_errors(model, scene, motion).amplitude
        )
    assert (refusal.value.kind, refusal.value.key) == (ErrorKind.TIME_STEP, "time.steps_per_period")
    assert verdicts.recommended_step(scene, 0.1).time.steps_per_period == 12
    verdicts.check_error(scene, "time step", 0.9 * verdicts.TIME_ERROR)
    with pytest.raises(AccuracyError, match="a motion that does not settle"):
        verdicts.check_error(scene, "time step", float("inf"))


def test_recommended_steps_pass_the_check() -> None:
    model, scene, motion = oscillator(10)
    with pytest.raises(AccuracyError, match=r"try steps_per_period = \d+$") as refusal:
        verdicts.check_error(
            scene, "time step", estimates.step_errors(model, scene, motion).amplitude
        )
    advised = int(str(refusal.value).split(" = ")[-1].split()[0])
    assert advised % 10 == 0 and advised <= 640
    verdicts.check_error(scene, "time step", estimates.step_errors(*oscillator(advised)).amplitude)


def test_recommended_step_uses_the_key_of_the_scene() -> None:
    _, scene, _ = oscillator(8)
    for key, value, advised in (("tolerance", 0.032, 0.0005), ("step", 0.1, 0.025)):
        time = scene.time.changed(**{key: value, "duration": 10.0})
        with pytest.raises(
            AccuracyError,
            match=rf'try {key} = {advised:g}; or try time.scheme = "generalised-alpha"',
        ):
            verdicts.check_error(replace(scene, time=time), "time step", float("inf"))


def test_only_periodic_motion_has_settled() -> None:
    _, _, motion = oscillator()
    assert motion.steady and measures.has_settled(motion)
    assert measures.has_settled(replace(motion, steady=False))
    growing = motion.displacement * (1.0 + 0.01 * motion.time / motion.period)[:, None, None]
    assert not measures.has_settled(replace(motion, steady=False, displacement=growing))
    assert not measures.has_settled(replace(motion, steady=False, period=None))


def test_basis_error_above_five_percent_is_refused() -> None:
    scene = beam_scene(2)
    verdicts.check_error(scene, "basis", 0.049)
    for estimate in (0.051, np.inf):
        with pytest.raises(AccuracyError) as caught:
            verdicts.check_error(scene, "basis", estimate)
        assert (caught.value.kind, caught.value.key) == (ErrorKind.BASIS, "basis")


def test_mesh_error_above_ten_percent_is_refused_with_the_cheapest_remedy() -> None:
    scene = beam_scene(2)
    verdicts.check_error(scene, "mesh", 0.099)
    verdicts.check_error(scene, "mesh", 0.24, unsteady=True)
    linear = replace(scene, geometry=replace(scene.geometry, degree=1))
    for estimate in (0.101, np.inf):
        with pytest.raises(AccuracyError) as caught:
            verdicts.check_error(scene, "mesh", estimate)
        assert (caught.value.kind, caught.value.key) == (ErrorKind.MESH, "geometry")
        assert "times smaller" in str(caught.value)
        assert "geometry.degree = 2" in verdicts.finer_mesh(linear, estimate)
    assert "4 times" in verdicts.finer_mesh(scene, 10.0)
    assert "2 times" in verdicts.finer_mesh(scene, 0.4)
    solid = replace(scene, geometry=replace(scene.geometry, size=0.1))
    assert verdicts.finer_mesh(solid, 0.4) == "make geometry.size 2 times smaller"


def test_distance_of_periods_counts_where_amplitudes_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """The motion of twice the step has the same amplitude with the opposite sign."""
    model, scene, motion = oscillator()
    mirror = replace(motion, displacement=-motion.displacement)
    monkeypatch.setattr(estimates, "check_motion", lambda *_: mirror)
    found = estimates.step_errors(model, scene, motion)
    assert found.amplitude == pytest.approx(2.0 / 3.0, rel=1e-6)


@pytest.mark.parametrize(("peak", "order"), [(0.9, 2), (0.5, 1)])
def test_distance_of_periods_counts_whole_where_the_peak_force_is_unresolved(
    peak: float, order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scheme of order p misses 1 / (2^p - 1) of the distance from the run of twice the step."""
    model, scene, motion = oscillator()
    touching = replace(motion, force=np.ones((motion.time.size, 1, 2)))
    other = replace(motion, displacement=-motion.displacement, force=peak * touching.force)
    monkeypatch.setattr(estimates, "check_motion", lambda *_: other)
    found = estimates.step_errors(model, scene, touching)
    assert found.peak_force == pytest.approx(2.0 * (1.0 - peak))
    assert found.amplitude == pytest.approx(2.0 / (2**order - 1), rel=1e-6)


@pytest.mark.parametrize(("closed", "error"), [(0.0, 0.2), (0.5, 0.0)])
def test_peak_force_of_impacts_is_compared_with_a_third_run(
    closed: float, error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run of twice the step agrees by chance; the run of four times the step does not. A
    contact that stays closed needs no third run."""
    model, scene, motion = oscillator()
    force = np.full((motion.time.size, 1, 2), 1.0)
    force[::2] = closed
    touching = replace(motion, force=force)
    steps = scene.time.stepping.steps_per_period

    def check(model: Any, other: Any, motion: Any) -> Any:
        longest = 4 * other.time.stepping.steps_per_period == steps
        return replace(touching, force=1.2 * force) if longest else touching

    monkeypatch.setattr(estimates, "check_motion", check)
    assert estimates.step_errors(model, scene, touching).peak_force == pytest.approx(error)


@pytest.mark.parametrize("settles", [True, False])
def test_unresolved_contact_has_an_estimate_only_if_shorter_steps_do_the_same(
    settles: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether the motion settles must not depend on the step, in both directions.

    A motion that settles is compared with half the step, another one with a quarter.
    """
    model, scene, steady = oscillator()
    growth = (1.0 + 0.05 * steady.time / steady.period)[:, None, None]
    unsteady = replace(steady, steady=False, displacement=growth * steady.displacement)
    early = replace(steady, periods=unsteady.periods // 2)
    motion, contrary = (steady, unsteady) if settles else (unsteady, early)
    assert measures.has_settled(motion) is settles
    monkeypatch.setattr(estimates, "_force_error", lambda *_: np.inf)
    shorter = scene.time.steps_per_period * (2 if settles else 4)

    def estimate(fine: Motion) -> float:
        monkeypatch.setattr(
            estimates,
            "check_motion",
            lambda _, s, *__: fine if s.time.steps_per_period == shorter else motion,
        )
        return estimates.step_errors(model, scene, motion).amplitude

    assert estimate(motion) == 0.0 and estimate(contrary) == np.inf
    with pytest.raises(AccuracyError) as refusal:
        verdicts.check_error(scene, "time step", np.inf, unsteady=not settles)
    assert ("motion that settles" in str(refusal.value)) is not settles


def test_full_model_that_gains_energy_is_refused() -> None:
    model, scene, motion = oscillator()
    growing = motion.kinetic * np.linspace(1.0, 1.5, motion.time.size)
    wrong = replace(motion, kinetic=growing)
    for motions, name in (
        ({"reduced": motion}, None),
        ({"reduced": motion, "full": wrong}, "full"),
        ({"reduced": wrong, "full": motion}, "reduced"),
    ):
        comm = SimpleNamespace(bcast=lambda value: value)
        solid = SimpleNamespace(warnings=[], comm=comm)
        record = Study(scene, solid=solid, model=model, motions=motions)
        check(record)
        assert (record.unfinished and record.unfinished[0]) == name
        if record.unfinished:
            assert getattr(record.unfinished[1], "kind", None) is ErrorKind.ENERGY


def test_unsettled_motion_has_its_own_limit() -> None:
    scene = beam_scene(2)
    verdicts.check_error(scene, "time step", 0.49, unsteady=True)
    with pytest.raises(AccuracyError, match="50 % is accepted for a motion that does not settle"):
        verdicts.check_error(scene, "time step", 0.51, unsteady=True)
