"""The estimate of the error due to the basis, against models whose residuals are known."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import motions
import numpy as np
import pytest
from support import beam_scene, linear_model, loaded_duffing, oscillator

from fenicsrom.assess.errors import estimates, verdicts
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import pairs
from fenicsrom.online.motion.measures import amplitude, has_settled, is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.post.run.report import estimate_rows
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import with_time


def two_modes(kind: str) -> tuple[ReducedModel, ReducedModel, Scene]:
    """A model of the first of two modes, and the model of both; the load excites both."""
    times: dict[str, dict[str, Any]] = {
        "periodic": {"periods": 60},
        "transient": {"periods": 6, "steady": "march"},
    }
    scene = beam_scene(
        2,
        ("material.mass_damping=2.0", "geometrically_nonlinear=false"),
        contacts=None,
        probe={"group": "tip"},
        time=times[kind],
    )
    options: dict[str, Any] = {"damping": 2.0, "load_histories": load_histories(scene)}
    both = linear_model(np.eye(2), np.diag([900.0, 500.0]), loads=[[1.0], [0.2]], **options)
    both = both._replace(probe=np.array([[0.0, 0.0], [1.0, 1.0]]))
    one = linear_model(np.eye(1), np.eye(1) * 900.0, loads=[[1.0]], **options)
    return one._replace(probe=np.array([[0.0], [1.0]])), both, scene


@pytest.mark.parametrize("kind", ["periodic", "transient"])
def test_missing_mode_is_the_estimated_error(kind: str) -> None:
    """The model of both modes is exact, so the estimate is `BASIS_SAFETY` times the error."""
    one, both, scene = two_modes(kind)
    motion, exact = simulate(one, scene), simulate(both, scene)
    error = estimates.distances(motion, exact).amplitude
    found = estimates.basis_errors(motion, estimates.nested_motion(both, scene, motion))
    assert error > 0.3
    assert found.amplitude == pytest.approx(estimates.BASIS_SAFETY * error, rel=1e-3)
    assert found.directions[1] == found.largest and found.directions[0] == 0.0


def test_error_of_a_small_direction_is_seen() -> None:
    """The second direction has 6 % of the motion and is wrong by a quarter."""
    motion = two_directions(0.06)
    errors = estimates.distances(motion, scaled(motion, [1.0, 1.25]))
    assert errors.amplitude < 0.02 and errors.largest == pytest.approx(0.2, rel=1e-6)
    motion = two_directions(1e-4)
    errors = estimates.distances(motion, scaled(motion, [1.0, 2.0]))
    assert errors.largest == pytest.approx(1e-4 / estimates.SMALL_DIRECTION, rel=1e-3)


def two_directions(part: float) -> Motion:
    """A motion along two axes, the second of them a part of the first."""
    one, _, scene = two_modes("periodic")
    model = one._replace(probe=np.array([[1.0], [part]]))
    return simulate(model, scene)


def scaled(motion: Motion, factors: list[float]) -> Motion:
    """The motion with other sizes of its directions."""
    return replace(motion, displacement=motion.displacement * np.array(factors))


def double_well(force: float) -> tuple[ReducedModel, Scene]:
    """x'' + 0.3 x' - x + x^3 = force sin(1.2 t). A period of the motion near x = 1 doubles between
    the forces 0.265 and 0.27, by the Floquet multipliers of the motion of one period."""
    scene = beam_scene(
        2,
        (f"loads.0.frequency={0.6 / np.pi!r}", "loads.0.force=1.0", "material.mass_damping=0.3"),
        contacts=None,
        probe={"group": "tip"},
        time={"steps_per_period": 100, "periods": 300},
    )
    model = loaded_duffing(0.3, 1.0, load_histories(scene), linear=-1.0)
    return model._replace(loads=force * model.loads), scene


@pytest.mark.parametrize(
    ("force", "checked", "nearby", "multiple"),
    [(0.24, 0.245, True, 1), (0.20, 0.225, False, 1), (0.265, 0.272, False, 2)],
)
def test_check_takes_only_a_stable_motion_nearby_without_a_march(
    force: float, checked: float, nearby: bool, multiple: int
) -> None:
    """The second check is too far away, and nearby the third there is an unstable motion only."""
    model, scene = double_well(force)
    start = np.array([1.0]), np.array([0.0])
    motion = simulate(model, scene, start=start)
    assert motion.newton_from is not None and motion.period == scene.period
    check, _ = double_well(checked)
    found = estimates.check_motion(check, scene, motion)
    marched = simulate(check, scene, start=start)
    assert scene.period is not None and found.steady
    assert found.period == pytest.approx(multiple * scene.period)
    assert (found.search is None) == nearby
    np.testing.assert_allclose(amplitude(found), amplitude(marched), rtol=1e-5)


def test_check_of_another_model_takes_the_adaptive_steps_of_the_motion() -> None:
    model, scene = double_well(0.24)
    scene = with_time(scene, tolerance=1e-6)
    motion = simulate(model, scene, start=(np.array([1.0]), np.array([0.0])))
    check, _ = double_well(0.245)
    found = estimates.nested_motion(check, scene, motion)
    assert found is not None and found.search is None
    steps = motion.time[motion.last_period()]
    np.testing.assert_allclose(found.time, steps - steps[0], atol=1e-9)
    marched = simulate(check, scene, start=(np.array([1.0]), np.array([0.0])))
    np.testing.assert_allclose(amplitude(found), amplitude(marched), rtol=1e-4)


def test_check_of_a_surface_that_has_approached_takes_the_motion_nearby() -> None:
    """The surface moves by more than the amplitude; the check does not wait for it again."""
    scene = beam_scene(2, ("contacts.0.approach=[[0, 0], [1, 0.02]]", "material.mass_damping=8.0"))
    loads = {"loads": [[0.5], [1.0]], "load_histories": load_histories(scene), "masters": 2}
    model, check = (
        linear_model(np.eye(2), np.diag([k, 500.0]), damping=8.0, **loads) for k in (900.0, 905.0)
    )
    motion = simulate(model, scene)
    assert motion.newton_from is not None and motion.newton_from > 1.0
    found = estimates.nested_motion(check, scene, motion)
    assert found is not None and found.search is None
    np.testing.assert_allclose(amplitude(found), amplitude(simulate(check, scene)), rtol=1e-5)
    assert estimates.distances(motion, found).amplitude > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(("part", "error"), [(None, 0.6), (0.6, 0.6), (0.4, np.inf)])
def test_unsteady_motion_is_compared_with_a_quarter_of_the_step_unless_that_soon_settles(
    monkeypatch: pytest.MonkeyPatch, part: float | None, error: float
) -> None:
    """Twice the step differs by 20 % and a quarter of the step by 30 %, which settles never or
    after a part of the periods."""
    model, scene = double_well(0.35)
    motion = simulate(model, scene)
    steps = scene.time.steps_per_period
    assert is_unsteady(motion) and steps is not None

    def check(model: ReducedModel, other: Scene, motion: Motion) -> Motion:
        if (other.time.steps_per_period or 0) < steps:
            return replace(motion, displacement=1.2 * motion.displacement)
        assert other.time.steps_per_period == 4 * steps
        fine = replace(motion, displacement=0.7 * motion.displacement)
        if part is None:
            return fine
        return replace(fine, steady=True, periods=int(part * motion.periods))

    monkeypatch.setattr(estimates, "check_motion", check)
    assert estimates.step_errors(model, scene, motion).amplitude == pytest.approx(error)


@pytest.mark.parametrize(("periods", "checked"), [(110, 55), (80, 50), (30, 30)])
def test_motion_that_does_not_settle_is_checked_for_half_of_its_periods(
    periods: int, checked: int
) -> None:
    model, scene = double_well(0.35)
    scene = with_time(scene, periods=periods, steady="march")
    motion = simulate(model, scene)
    other = estimates.nested_motion(model, scene, motion)
    assert is_unsteady(motion) and motion.periods == periods
    assert other is not None and other.periods == checked
    assert estimates.distances(motion, other).amplitude < 1e-12


def test_rule_refuses_an_estimate_above_its_limit() -> None:
    """Also of a transient; a motion that does not settle has a wider limit."""
    one, both, scene = two_modes("periodic")
    motion = simulate(one, scene)
    errors: dict[str, estimates.MotionErrors] = {}
    with pytest.raises(AccuracyError) as refusal:
        verdicts.estimate_errors(one, both, scene, motion, errors)
    assert refusal.value.kind is ErrorKind.BASIS and set(errors) == {"time step", "basis"}
    verdicts.estimate_errors(one, None, scene, motion, {})
    between = 0.5 * (verdicts.BASIS_ERROR + verdicts.UNSETTLED_BASIS_ERROR)
    verdicts.check_error(scene, "basis", between, unsteady=True)
    with pytest.raises(AccuracyError):
        verdicts.check_error(scene, "basis", between)


@pytest.mark.parametrize(
    ("steps", "known"), [(6, False), (40, True)], ids=["a knock", "a slow pulse"]
)
def test_peak_force_of_a_stiff_contact_is_known_if_it_changes_slowly(
    steps: int, known: bool
) -> None:
    """A pulse of so many steps on a contact that the steps do not resolve."""

    def pulse(peak: float) -> Motion:
        angle = np.linspace(0.0, np.pi, steps + 1)
        force = peak * np.sin(angle)[:, None, None] * [[1.0, 0.0]]
        found = motions.motion(angle, 0.0 * force, force, np.ones((steps + 1, 1)), period=None)
        scratch = SimpleNamespace(blending=np.array([0.9]))
        state = SimpleNamespace(trial=SimpleNamespace(scratch=scratch))
        end: Any = SimpleNamespace(state=state)
        return replace(found, end=end)

    found = estimates._force_error(pulse(100.0), pulse(90.0))
    assert found == pytest.approx(0.2 if known else np.inf)


@pytest.mark.slow
def test_soft_candidate_of_little_energy_is_in_the_estimate() -> None:
    """A stiff candidate has a million times the energy of a soft one, which moves the probe."""
    scene = two_modes("periodic")[2]
    resonance = float(2.0 * np.pi / scene.period) ** 2
    options: dict[str, Any] = {"damping": 2.0, "load_histories": load_histories(scene)}
    loads = np.array([[1.0], [1e3], [1e-4]])
    plain = linear_model(np.eye(3), np.diag([900.0, 1e6, resonance]), loads=loads, **options)
    count = pairs(3)[0].size
    probe = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1e3]])
    both = reduced_model(
        plain.mass,
        plain.damping,
        plain.elastic._replace(quadratic=np.zeros((count, 3)), cubic=np.zeros((count, count))),
        plain.loads,
        plain.load_histories,
        plain.points,
        plain.contact_rows,
        plain.contact_offset,
        probe,
        plain.probe_offset,
    )
    one = linear_model(np.eye(1), np.eye(1) * 900.0, loads=[[1.0]], **options)
    one = one._replace(probe=probe[:, :1])
    motion = simulate(one, scene)
    error = estimates.distances(motion, simulate(both, scene)).amplitude
    found = estimates.basis_errors(motion, estimates.nested_motion(both, scene, motion))
    assert error > 0.1
    assert found.amplitude == pytest.approx(estimates.BASIS_SAFETY * error, rel=1e-3)


def test_settled_motion_is_compared_by_its_last_period() -> None:
    """The other motion starts at the end of this one and has waves of 1 %: it does not settle."""
    one, _, scene = two_modes("periodic")
    motion = simulate(one, scene)
    assert has_settled(motion) and motion.period is not None
    transient = np.where(motion.time < motion.time[-1] - motion.period, 3.0, 1.0)
    motion = replace(motion, displacement=motion.displacement * transient[:, None, None])
    late = motion.time >= motion.time[-1] - 5.5 * motion.period
    wave = 0.01 * np.sin(0.37 * 2.0 * np.pi * motion.time / motion.period)
    moved = motion.displacement * ((1.0 + wave) / transient)[:, None, None]
    fields = ("time", "force", "state")
    cut: dict[str, Any] = {name: getattr(motion, name)[late] for name in fields}
    other = replace(motion, steady=False, periods=5, displacement=moved[late], **cut)
    assert not has_settled(other)
    assert estimates.distances(motion, other).amplitude < 0.02


def test_errors_are_a_range_where_sliders_are_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """The other model's run from rest sticks elsewhere, with an amplitude 2 % larger."""
    model, scene, motion = oscillator()
    elsewhere = replace(motion, displacement=1.02 * motion.displacement)
    monkeypatch.setattr(estimates, "simulate", lambda *given, **options: elsewhere)
    nearby = estimates.basis_errors(motion, motion)
    search = SimpleNamespace(accepted=True, free_sliders=1)
    stuck: Any = replace(motion, search=search)
    found = estimates.with_range(nearby, 1.5, model, scene, stuck)
    assert found.amplitude == 0.0 and found.from_rest is not None
    assert found.from_rest.amplitude == pytest.approx(1.5 * (1.0 - 1.0 / 1.02))
    assert estimate_rows(scene, {"basis": found}, motion, ("x", "y"))[1][1] == "0 to 2.9"
    search.free_sliders = 0
    assert estimates.with_range(nearby, 1.5, model, scene, stuck) == nearby
