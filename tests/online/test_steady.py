"""Runs that end with Newton's method: they give the steady state of the march, and say when not."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, duffing, no_contacts, oscillator, rubbing_masses

from fenicsrom.assess.errors.estimates import check_motion, step_errors
from fenicsrom.assess.errors.verdicts import check_settled, free_slider_sentence
from fenicsrom.errors import AccuracyError
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.measures import (
    amplitude,
    friction_dissipation_per_period,
    response_summary,
)
from fenicsrom.online.motion.motion import Interrupted, Motion, check_energy
from fenicsrom.online.periodic import steady
from fenicsrom.online.periodic.steady import _Search, fractions_of, horizon_by_distance
from fenicsrom.online.run.march import integrate
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.store import load_start, save_checkpoint
from fenicsrom.post.run.report import periodic_sentence
from fenicsrom.progress import asking
from fenicsrom.scene import Time
from fenicsrom.scene.reading.reading import coarser, with_time

Array = NDArray[np.float64]


def run(model: ReducedModel, period: float, contacts: Any = None, **options: Any) -> Motion:
    """A run of at most 400 periods of 100 steps; options of `Time` and of `integrate`."""
    names = {"start", "resume", "checkpoint", "keep_coordinates"}
    given = {name: options.pop(name) for name in names & options.keys()}
    time = Time.of(
        **({"periods": 400, "steps_per_period": 100, "steady_tolerance": 1e-5} | options)
    )
    if time.scheme == "generalised-alpha":
        time = time.changed(spectral_radius=0.8)
    contacts = no_contacts() if contacts is None else contacts
    return integrate(Problem(model, contacts, time, period), **given)


def last(motion: Motion) -> Array:
    """The displacements of the last period."""
    return np.asarray(motion.displacement[motion.last_period()])


def at(x: float, v: float) -> tuple[Array, Array]:
    return np.array([x]), np.array([v])


@pytest.mark.parametrize(
    "scheme", ["discrete-gradient", "average-acceleration", "generalised-alpha"]
)
def test_rubbing_motion_equals_that_of_a_long_march(scheme: str) -> None:
    model, contacts, period = rubbing_masses()
    long = run(
        model, period, contacts, scheme=scheme, steady="march", steady_tolerance=1e-13, periods=600
    )
    motion = run(model, period, contacts, scheme=scheme)
    assert long.search is None and motion.search is not None and motion.search.accepted
    assert motion.steady and motion.periods == motion.search.marched + 2
    assert motion.search.residual <= 1e-10 and abs(motion.search.multipliers[0]) < 1.0
    size = float(np.abs(last(long)).max())
    np.testing.assert_allclose(last(motion), last(long), atol=1e-6 * size)
    energy = friction_dissipation_per_period(long)
    assert friction_dissipation_per_period(motion) == pytest.approx(energy, rel=1e-6)
    part = motion.last_period()
    now, before = motion.mean_force[part][1:], long.mean_force[long.last_period()][1:]
    np.testing.assert_allclose(now, before, atol=1e-5 * float(np.abs(before).max()))


@pytest.mark.parametrize("steady", ["newton", "march"])
def test_motion_is_not_steady_before_the_surface_has_arrived(steady: str) -> None:
    """Out of reach of the surface the motion repeats; later the surface comes and is touched."""
    model, contacts, period = rubbing_masses()
    late = 60.0 * period
    away = contacts._replace(
        times=np.array([0.0, late, late + period]), approach=np.array([[-100.0, -100.0, 0.0]])
    )
    motion = run(model, period, away, steady=steady)
    there = run(model, period, contacts, steady=steady)
    assert motion.steady and motion.time[-1] > late + period
    assert motion.force[motion.last_period()].max() > 0.0
    np.testing.assert_allclose(amplitude(motion), amplitude(there), rtol=1e-4)


def test_march_is_kept_where_it_is_asked_for() -> None:
    model, contacts, period = rubbing_masses()
    marched = run(model, period, contacts, steady="march", periods=30)
    all_periods = run(model, period, contacts, steady_tolerance=0.0, periods=marched.periods)
    assert marched.search is None and all_periods.search is None
    np.testing.assert_array_equal(marched.displacement, all_periods.displacement)
    np.testing.assert_array_equal(marched.imbalance, all_periods.imbalance)


@pytest.mark.parametrize("start", [(0.0, 0.0), (2.0, -1.0), (-1.0, 1.5)])
def test_branch_is_that_of_the_march(start: tuple[float, float]) -> None:
    """A Duffing oscillator with two stable orbits, of amplitudes 1.41 and 0.249."""
    model, period = duffing(0.05, 1.0, 0.3, 1.5)
    options = {"start": at(*start), "steps_per_period": 200}
    marched = run(model, period, steady="march", steady_tolerance=1e-9, **options)
    motion = run(model, period, **options)
    assert marched.steady and motion.steady and motion.periods < marched.periods
    np.testing.assert_allclose(amplitude(motion), amplitude(marched), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-3, 0.3])
def test_slow_decay_is_not_taken_for_the_steady_state(tolerance: float) -> None:
    """At resonance the march repeats to 1e-3 while a quarter of the amplitude is still missing; to
    0.3 it repeats before the first attempt."""
    model, period = duffing(1e-3, 0.0, 1e-3, 1.0)
    marched = run(model, period, steady="march", steady_tolerance=tolerance, periods=9000)
    long = run(model, period, steady="march", steady_tolerance=1e-10, periods=9000)
    motion = run(model, period, steady_tolerance=tolerance, periods=9000)
    assert marched.steady and long.steady and motion.steady and motion.periods < 10
    assert tolerance < 0.1 or marched.periods < 5
    assert amplitude(marched)[0] < 0.9 * amplitude(long)[0]
    np.testing.assert_allclose(amplitude(motion), amplitude(long), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("force", [4.4e-3, 14.6e-3])
def test_march_that_comes_nearer_for_long_ends_in_its_motion(force: float) -> None:
    """The frequency depends on the amplitude: 160 periods show too little of the slow decay."""
    model, period = duffing(0.002, 0.1, force, 1.005 if force < 0.01 else 1.02)
    motion = run(model, period, periods=100)
    marched = run(model, period, periods=4000, steady="march", steady_tolerance=1e-13)
    assert motion.steady and motion.newton_from is not None
    np.testing.assert_allclose(amplitude(motion), amplitude(marched), rtol=1e-6)


@pytest.mark.slow
def test_march_on_its_way_is_refused_with_the_periods_that_it_needs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(steady, "LONGEST_LOOK_AHEAD", 1)
    model, period = duffing(0.002, 0.1, 14.6e-3, 1.02)
    motion = run(model, period, periods=100)
    scene: Any = SimpleNamespace(time=Time.of(steady_tolerance=1e-5))
    with pytest.raises(AccuracyError) as caught:
        check_settled(scene, motion)
    assert caught.value.key == "time.periods"
    needed = int(str(caught.value).rsplit("time.periods = ", 1)[1])
    assert response_summary(motion)["periodic_motion"]["relative_distance"] > 0.01
    marched = run(model, period, periods=needed, steady="march", steady_tolerance=1e-13)
    early = run(model, period, periods=needed // 2, steady="march", steady_tolerance=1e-13)
    long = run(model, period, periods=6000, steady="march", steady_tolerance=1e-13)
    np.testing.assert_allclose(amplitude(marched), amplitude(long), rtol=3e-5)
    assert np.max(np.abs(amplitude(early) - amplitude(long))) > 1e-4 * np.max(amplitude(long))
    check_settled(scene, replace(motion, steady=True))
    check_settled(scene, long)


def test_march_that_stays_away_from_a_stable_motion_is_refused() -> None:
    """The oscillator with two wells: beside the motion of one period there is a chaotic one."""
    model, period = duffing(0.15, 1.0, 0.27, 1.0, linear=-1.0)
    motion = run(model, period, start=at(0.3, 0.6), periods=45)
    assert not motion.steady and motion.search is not None
    assert response_summary(motion)["periodic_motion"]["verdict"] == "not reached"
    scene: Any = SimpleNamespace(time=Time.of(steady_tolerance=1e-5))
    with pytest.raises(AccuracyError, match="was not seen to come nearer") as caught:
        check_settled(scene, motion)
    assert caught.value.key == "time.periods"
    asked = run(model, period, start=at(0.3, 0.6), periods=45, steady_tolerance=0.0)
    np.testing.assert_array_equal(asked.displacement, motion.displacement)
    check_settled(scene, asked)


def test_march_that_repeats_without_tending_to_the_motion_tries_seldom(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried = []

    def tends(problem: Any, path: Any, motion: Any, marched: int) -> bool:
        tried.append(marched)
        return False

    monkeypatch.setattr(_Search, "_tends", tends)
    model, period = duffing(0.05, 0.0, 0.1, 0.8)
    motion = run(model, period, periods=90, steady_tolerance=0.5)
    assert not motion.steady and motion.periods == 90
    assert tried == [5, 10, 20, 40, 80, 90]


@pytest.mark.slow
@pytest.mark.parametrize(("force", "multiple"), [(0.28, 2), (0.37, 5)])
def test_subharmonic_motion_is_found(force: float, multiple: int) -> None:
    """The oscillator with two wells, whose motions at these forces are known to repeat so."""
    model, period = duffing(0.3, 1.0, force, 1.2, linear=-1.0)
    motion = run(model, period, start=at(1.0, 0.0), periods=900)
    assert motion.steady and motion.search is not None and motion.search.accepted
    assert motion.search.periods == multiple
    assert motion.period == pytest.approx(multiple * period)
    assert motion.load_period == pytest.approx(period)
    rows = last(motion)
    assert rows.shape[0] == 100 * multiple + 1
    np.testing.assert_allclose(rows[-1], rows[0], atol=1e-8)
    if multiple > 1:
        assert np.abs(rows[100] - rows[0]).max() > 1e-3
    marched = run(model, period, start=at(1.0, 0.0), steady_tolerance=0.0, periods=900)
    marched = replace(marched, period=motion.period)
    np.testing.assert_allclose(amplitude(motion), amplitude(marched), rtol=1e-4)


def test_horizon_is_that_of_two_turns_or_of_the_decay_to_a_tenth() -> None:
    def horizon(size: float, angle: float) -> int:
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return horizon_by_distance(size * turn)(np.array([1.0, 0.0]))

    assert horizon(1.0, 0.1) == horizon(1.0 + 1e-9, 0.1) == 126  # 4 pi / 0.1 = 125.7
    assert horizon(0.9, 0.1) == horizon(0.9, 0.0) == 22  # 0.9^21.9 = 0.1
    assert horizon(0.9, 1.0) == 13
    assert horizon(0.01, 1.0) == horizon(1.0, 0.0) == 1


def test_motion_of_one_period_is_no_subharmonic_motion() -> None:
    model, contacts, period = rubbing_masses()
    marched = run(model, period, contacts, steady="march", periods=8, steady_tolerance=1e-9)
    settings = Time.of(periods=9, steps_per_period=100)
    problem = _Search(Problem(model, contacts, settings, period), marched.end, None)
    one, two = problem.attempt(1, 8, 0).search, problem.attempt(2, 8, 0).search
    assert one.verdict == two.verdict == "stable"
    assert one.accepted and not two.accepted


def test_steps_of_the_last_period_become_those_of_the_map() -> None:
    model, contacts, period = rubbing_masses()
    time = {"steps_per_period": None, "tolerance": 1e-4, "steady": "march", "periods": 4}
    motion = run(model, period, contacts, **time)
    assert motion.end is not None
    rows = motion.end.last
    found = fractions_of(rows, period)
    assert found is not None and found[0] == 0.0 and found[-1] == 1.0 and np.ptp(np.diff(found)) > 0
    np.testing.assert_allclose(found[1:-1] * period + 3.0 * period, rows.time[:-1], rtol=1e-12)
    problem = Problem(model, contacts, Time.of(**time), period)
    grid = _Search(problem, motion.end, found).shooting(2)[0].map
    np.testing.assert_allclose(grid.fractions, [*found, *(1.0 + found[1:])])


@pytest.mark.slow
def test_chaotic_motion_is_marched_to_the_end_and_told() -> None:
    model, period = duffing(0.3, 1.0, 0.5, 1.2, linear=-1.0)
    motion = run(model, period, start=at(1.0, 0.0), periods=90)
    assert not motion.steady and motion.periods == 90 and motion.newton_from is None
    assert motion.search is not None and not motion.search.accepted
    told = response_summary(motion)["periodic_motion"]["verdict"]
    assert told == "not found" or told == "not reached" or told.startswith("unstable")
    assert "the march went on" in str(periodic_sentence(motion))
    search = motion.search._replace(verdict="not found")
    believed = str(periodic_sentence(replace(motion, steady=True, search=search)))
    assert "not found" in believed and "went on" not in believed


def test_sliders_that_are_not_unique_are_told() -> None:
    model, contacts, period = rubbing_masses(preload=60.0, friction=9.0)
    motion = run(model, period, contacts)
    assert motion.steady and np.all(motion.state[motion.last_period()] == 1)
    assert motion.search is not None and motion.search.free_sliders == 1
    assert free_slider_sentence("reduced", motion) is not None
    marched = run(model, period, contacts, steady="march", steady_tolerance=1e-12)
    np.testing.assert_allclose(amplitude(motion), amplitude(marched), rtol=1e-6)
    slides = run(*[rubbing_masses()[k] for k in (0, 2, 1)])
    assert free_slider_sentence("reduced", slides) is None


def test_energy_balances_on_both_sides_of_the_jump() -> None:
    model, contacts, period = rubbing_masses()
    motion = run(model, period, contacts, keep_coordinates=True)
    assert motion.newton_from == pytest.approx(5 * period)
    assert np.all(np.diff(motion.time) > 0.0)
    transient, periodic = motion.parts
    assert motion.time[periodic.start] == motion.newton_from
    assert transient == slice(0, 500) and periodic == slice(500, motion.time.size)
    stored = motion.kinetic + motion.elastic + motion.contact_energy
    assert motion.relative_imbalance < 1e-10
    check_energy(motion)
    jump = stored[500] - stored[499] - (motion.work - motion.damping_dissipation)[500]
    jump += (motion.work - motion.damping_dissipation)[499]
    assert abs(jump) > 1e-4  # the state does jump
    for sums in (motion.damping_dissipation, motion.friction_dissipation):
        assert np.all(np.diff(sums) >= -1e-12)
    np.testing.assert_allclose(
        motion.point_friction_dissipation.sum(axis=1), motion.friction_dissipation, rtol=1e-12
    )
    assert motion.coordinates is not None and motion.coordinate_time is not None
    np.testing.assert_array_equal(motion.coordinate_time, motion.time[motion.last_period()])
    x = motion.coordinates @ model.contact_rows.T
    np.testing.assert_allclose(x, last(motion)[:, 0], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_adaptive_steps_end_in_the_motion_of_a_long_march(tolerance: float) -> None:
    model, contacts, period = rubbing_masses()
    time = {"steps_per_period": None, "tolerance": tolerance, "steady_tolerance": tolerance}
    motion = run(model, period, contacts, **time)
    long = run(model, period, contacts, **time | {"steady_tolerance": 0.0, "periods": 200})
    assert motion.steady and motion.newton_from is not None
    np.testing.assert_allclose(amplitude(motion), amplitude(long), rtol=3.0 * tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("after", [3, 6])
@pytest.mark.parametrize("case", ["rubbing", "subharmonic"])
def test_resumed_run_equals_the_whole_run(case: str, after: int, tmp_path: Path) -> None:
    if case == "rubbing":
        model, contacts, period = rubbing_masses()
        options: dict[str, Any] = {}
    else:
        model, period = duffing(0.3, 1.0, 0.28, 1.2, linear=-1.0)
        contacts = no_contacts()
        options = {"start": at(1.0, 0.0)}
    whole = run(model, period, contacts, **options)
    assert whole.search is not None and whole.newton_from is not None
    after += 0 if case == "rubbing" else whole.search.marched - 5
    kept: list[Any] = []
    scene = beam_scene(2, (f"loads.0.frequency={1.0 / period!r}",))
    path = tmp_path / "checkpoint.npz"

    def keep(here: Any) -> None:
        kept.append(here)
        if len(kept) == after:
            save_checkpoint(path, model, scene, here)

    with pytest.raises(Interrupted), asking(lambda: len(kept) == after):
        run(model, period, contacts, checkpoint=keep, **options)
    options.pop("start", None)
    motion = run(model, period, contacts, resume=load_start(path, model, scene), **options)
    assert motion.steady and motion.periods == whole.periods and motion.period == whole.period
    rows = motion.time.size
    for name in ("time", "displacement", "kinetic", "work", "friction_dissipation"):
        np.testing.assert_array_equal(getattr(motion, name), getattr(whole, name)[-rows:])
    assert motion.search is not None
    for name, value in whole.search._asdict().items():
        np.testing.assert_array_equal(getattr(motion.search, name), value, err_msg=name)


@pytest.mark.parametrize(("tolerance", "checkpoints"), [(1e-5, 5), (0.9, 1)])
def test_run_stops_during_newtons_method_and_resumes_to_the_same_motion(
    tolerance: float, checkpoints: int
) -> None:
    """In an attempt after five periods; or after the second one, which seems to repeat."""
    model, contacts, period = rubbing_masses()
    whole = run(model, period, contacts, steady_tolerance=tolerance)
    asked: list[int] = []
    kept: list[Any] = []

    def stop() -> bool:
        """Ask for the end before the third march of Newton's method."""
        asked.append(len(kept))
        return asked.count(len(kept)) == 4

    keep = {"checkpoint": lambda end: kept.append(copy.deepcopy(end))}
    with pytest.raises(Interrupted) as caught, asking(stop):
        run(model, period, contacts, steady_tolerance=tolerance, **keep)
    assert len(kept) == checkpoints and not caught.value.partial.steady
    resumed = run(model, period, contacts, steady_tolerance=tolerance, resume=kept[-1])
    assert whole.newton_from is not None and resumed.newton_from == whole.newton_from
    np.testing.assert_array_equal(last(resumed), last(whole))


def test_summary_gives_residual_multipliers_and_verdict() -> None:
    model, contacts, period = rubbing_masses()
    told = response_summary(run(model, period, contacts))["periodic_motion"]
    assert told["verdict"] == "stable" and told["relative_residual"] <= 1e-10
    assert told["marched_periods"] == 5 and told["load_periods"] == 1
    assert told["from_s"] == pytest.approx(5 * period) and told["free_sliders"] == 0
    largest = max(np.hypot(*pair) for pair in told["floquet_multipliers"])
    assert told["largest_multiplier"] == pytest.approx(largest) and largest < 1.0


def test_check_starts_from_the_periodic_motion() -> None:
    model, scene, _ = oscillator()
    found, marched = (with_time(scene, steady=way) for way in ("newton", "march"))
    motion = simulate(model, found)
    other = check_motion(model, coarser(found), motion)
    assert other.steady and other.time[0] == 0.0 and other.time[-1] == motion.period
    long = simulate(model, coarser(with_time(marched, steady_tolerance=1e-11)))
    np.testing.assert_allclose(amplitude(other), amplitude(long), rtol=1e-8)
    whole = check_motion(model, coarser(marched), simulate(model, marched))
    assert whole.search is None and whole.periods > 3
    fine = with_time(marched, steady_tolerance=1e-9)
    errors, others = (
        step_errors(model, found, motion),
        step_errors(model, fine, simulate(model, fine)),
    )
    assert errors.amplitude == pytest.approx(others.amplitude, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("damping", "cubic", "omega"), [(0.02, 0.01, 1.05), (0.02, 0.1, 1.05)])
def test_lightly_damped_march_ends_in_its_own_one_of_two_motions(
    damping: float, cubic: float, omega: float
) -> None:
    force = damping * np.sqrt(80.0 * damping / (3.0 * cubic))
    model, period = duffing(damping, cubic, force, omega)
    found = run(model, period, periods=20_000)
    marched = run(
        model, period, periods=round(8.0 / damping), steady="march", steady_tolerance=1e-13
    )
    assert found.steady and found.newton_from is not None
    np.testing.assert_allclose(amplitude(found), amplitude(marched), rtol=1e-6)
