"""Marches that wear a casing: an independent integration, checkpoints, rejected steps, Newton."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import linear_model, one_contact

from fenicsrom.errors import ConvergenceError
from fenicsrom.online.contact.coating import Ring, coated
from fenicsrom.online.contact.surfaces import CYLINDER
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.measures import worn_under_points
from fenicsrom.online.motion.motion import Motion, energy_errors
from fenicsrom.online.periodic.period_map import PeriodMap
from fenicsrom.online.run.march import MarchRun, end_of, integrate
from fenicsrom.online.step.state import scheme
from fenicsrom.online.step.step import accept, attempt, compiled_march, set_blending
from fenicsrom.scene import Abradable, Time

Array = NDArray[np.float64]

FAR = 300.0
"""Radius of the casing in m: its curvature has no effect."""
LAYER = Abradable(thickness=5e-3, modulus=0.5e9, yield_stress=1e6, hardening=0.05e9, area=30e-6)


def rubbing(rpm: float, cells: int = 360, lobe: float = 0.15e-3, **time: Any) -> Problem:
    """Two modes of a blade whose tip rubs an oval casing with an abradable layer."""
    omega = rpm * np.pi / 30.0
    squares = (2.0 * np.pi * np.array([100.0, 410.0])) ** 2 + np.array([1.8, 2.5]) * omega**2
    model = linear_model(np.eye(2), np.diag(squares), damping=6.0, masters=2)
    model = model._replace(contact_rows=np.array([[0.5, 2.0], [3.0, -1.0]]))
    flat = one_contact(2, normal_stiffness=1e20, tangential_stiffness=1e8, friction=0.15)
    closing = 10.0 * 2.0 * np.pi / omega
    contacts = flat._replace(
        kind=np.array([CYLINDER]),
        axes=np.eye(2)[None],
        centre=np.array([[-FAR, 0.0]]),
        radius=np.array([FAR + 0.2e-3]),
        spin=np.array([-omega]),
        times=np.array([0.0, closing]),
        approach=np.array([[0.0, 0.1e-3]]),
        order=np.array([2.0]),
        height=np.array([[lobe]]),
        phase=np.array([[-np.pi]]),
    )
    ring = Ring(0, (0,), 0, cells, 0.0, FAR, 0.0, 1.0, LAYER)
    given = {"periods": 40, "steps_per_period": 720, "steady_tolerance": 0.0} | time
    settings = Time.of(scheme="discrete-gradient", **given)
    return Problem(
        model, coated(contacts, [ring], np.array([LAYER.area])), settings, 2.0 * np.pi / omega
    )


def worn_of(motion: Motion) -> Array:
    assert motion.end is not None and motion.end.worn is not None
    return motion.end.worn


def half_ranges(motion: Motion, steps: int = 720) -> Array:
    """Half of the range of the radial displacement in each revolution, m."""
    radial = motion.displacement[1:, 0, 0].reshape(-1, steps)
    return np.asarray(0.5 * np.ptp(radial, axis=1))


@pytest.mark.parametrize(
    ("rpm", "depth", "area", "peak", "half_range", "within"),
    [
        (5500.0, 30.50e-6, 29.55e-6, 39.15, 30.07e-6, 5e-3),
        (7500.0, 99.2e-6, 158.6e-6, 59.76, 76.3e-6, 3e-2),
    ],
)
def test_wear_and_vibration_of_a_blade_match_an_explicit_integration(
    rpm: float, depth: float, area: float, peak: float, half_range: float, within: float
) -> None:
    """Reference: blade wears an oval casing, 5500 and 7500 rpm: depth, force, amplitude | another
    program | 30.50, 99.2 µm; 39.15, 59.76 N; 30.07, 76.3 µm | agree | 0.5 %; 3 %
    """
    motion = integrate(rubbing(rpm))
    worn = worn_of(motion)
    assert np.max(worn) == pytest.approx(depth, rel=within)
    assert np.sum(worn) * 2.0 * np.pi / worn.size == pytest.approx(area, rel=within)
    assert np.max(motion.force[:, 0, 0]) == pytest.approx(peak, rel=within)
    assert np.max(half_ranges(motion)) == pytest.approx(half_range, rel=within)
    found = energy_errors(motion)
    assert max(found.created, found.lost) <= 1e-9 * (found.energy + found.work)


@pytest.mark.slow
def test_wear_at_5500_rpm_ends_in_a_motion_that_repeats() -> None:
    """No wear after revolution 28; then Newton's method finds the motion of 25.01 um."""
    motion = integrate(rubbing(5500.0, periods=60, steady_tolerance=1e-6))
    assert motion.steady
    assert motion.search is not None and motion.search.accepted
    assert motion.search.marched == 40
    assert half_ranges(motion)[-1] == pytest.approx(25.01e-6, rel=5e-3)
    assert abs(motion.search.multipliers[0]) < 1.0
    marched = integrate(rubbing(5500.0, periods=300))
    np.testing.assert_array_equal(worn_of(motion), worn_of(marched))
    assert half_ranges(marched)[-1] == pytest.approx(half_ranges(motion)[-1], rel=1e-3)
    before = integrate(rubbing(5500.0, periods=28))
    np.testing.assert_allclose(worn_of(before), worn_of(marched), rtol=0.0, atol=1e-10)
    assert np.max(worn_of(marched) - worn_of(integrate(rubbing(5500.0, periods=20)))) > 1e-8


def test_worn_depth_over_time_is_that_of_the_ring_where_the_point_is() -> None:
    """After the last wear, each second step of a revolution ends at a node."""
    problem = rubbing(5500.0, periods=32)
    motion = integrate(problem)
    found = worn_under_points(motion, problem.contacts)
    assert found.shape == (32 * 720 + 1, 1) and not found[0].any()
    np.testing.assert_allclose(found[-719::2, 0], np.roll(worn_of(motion), -1), atol=1e-16)
    np.testing.assert_allclose(found[-720:], found[-1440:-720], rtol=0.0, atol=1e-16)
    early = found[8 * 720 + 1 : 9 * 720 + 1]
    assert np.all(early <= found[-720:] + 1e-16) and early.max() < 0.9 * found[-720:].max()


@pytest.mark.parametrize("rpm", [2000.0, 7500.0])
def test_wear_ends_the_contact(rpm: float) -> None:
    motion = integrate(rubbing(rpm, periods=60))
    assert motion.force[:, 0, 0].max() > 1.0
    assert not motion.force[-720:, 0, 0].any()


def test_wear_of_a_resumed_run_is_that_of_the_whole_run() -> None:
    whole = integrate(rubbing(5500.0, periods=14))
    kept: list[Any] = []
    first = integrate(rubbing(5500.0, periods=9))
    kept.append(first.end)
    rest = integrate(rubbing(5500.0, periods=14), resume=first.end)
    np.testing.assert_array_equal(worn_of(rest), worn_of(whole))
    assert np.max(worn_of(rest)) > 1.2 * np.max(worn_of(first))
    np.testing.assert_array_equal(rest.force[-720:], whole.force[-720:])


def test_motion_of_newtons_method_that_would_wear_the_layer_is_no_periodic_motion() -> None:
    """On the new layer, the elastic motion exceeds the yield stress."""
    problem = rubbing(5500.0, periods=1, steady_tolerance=1e-6).settled()
    motion = integrate(problem, start=(np.zeros(2), np.zeros(2)))
    assert motion.search is not None
    assert motion.search.residual < 1e-10
    assert motion.search.verdict == "wears"
    assert not motion.search.accepted and motion.newton_from is None
    assert motion.end is not None and motion.end.wearing


def test_monodromy_matrix_over_a_worn_casing_matches_differences() -> None:
    """The layer stays as it is worn; the blade touches it in parts of the revolution."""
    problem = rubbing(5500.0, cells=40).settled().with_yield(np.inf)
    problem = problem.with_own_wear(np.random.default_rng(4).uniform(0.0, 40e-6, 40))
    plan = scheme("discrete-gradient", problem.model, 0.8)
    period_map = PeriodMap(problem, plan, np.linspace(0.0, 1.0, 181))
    z = np.zeros(period_map.size)
    for _ in range(3):
        z = period_map(problem, z, derive=False)[1].z
    _, found = period_map(problem, z)
    touches = np.any(found.record.mean_force[:, 0] != 0.0, axis=1)
    assert 0.05 < np.mean(touches) < 0.95
    steps = np.array([1e-9, 1e-9, 1e-6, 1e-6, *np.full(z.size - 4, 1e-9)])
    columns = []
    for change in np.diag(steps):
        ends = [period_map(problem, z + sign * change, derive=False)[1].z for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / 2.0)
    differences = np.array(columns).T / steps[:, None]
    scaled = found.matrix * steps / steps[:, None]
    np.testing.assert_allclose(scaled, differences, rtol=0.0, atol=1e-5 * np.abs(differences).max())


def test_motion_that_presses_just_to_the_yield_stress_is_flagged() -> None:
    """The yield stress is lowered to what the periodic motion needs at the nodes."""
    problem = rubbing(5500.0, periods=60, steady_tolerance=1e-6)
    motion = integrate(problem)
    assert motion.search is not None and motion.search.accepted and not motion.search.at_yield
    settled = problem.settled().with_own_wear(worn_of(motion))
    coating, start = settled.contacts.coating, end_of(motion)
    force = motion.force[-719::2, 0, 0]  # at the nodes 1 to 360
    needed = float(np.max(force - coating.hardening[0] * np.roll(coating.worn, -1)))
    assert 0.5 < needed / coating.yield_force[0] < 1.0 - 1e-5
    for above, verdict, at_yield in ((1e-7, "stable", True), (-1e-5, "wears", False)):
        weaker = settled.with_yield(needed / coating.yield_force[0] * (1.0 + above))
        found = integrate(
            weaker._replace(time=replace(weaker.time, span=replace(weaker.time.span, periods=1))),
            start=start,
        )
        assert found.search is not None
        assert (found.search.verdict, found.search.at_yield) == (verdict, at_yield)


def test_rejected_step_leaves_no_trace_in_the_layer() -> None:
    """A step that is tried and not accepted does not wear, and is the same when tried again."""
    problem = rubbing(7500.0, periods=10)
    plan = scheme("discrete-gradient", problem.model, 0.8)
    end = integrate(problem).end
    assert end is not None
    run = MarchRun(problem.with_own_wear(end.worn), plan, compiled_march, None, end, False)
    model, contacts, begin = problem.model, run.problem.contacts, 10.0 * problem.period
    later = worn_of(integrate(rubbing(7500.0, periods=11)))
    deepest = int(np.argmax(later - end.worn))  # there are two steps between nodes
    here = begin + (2.0 * deepest - 6.0) * run.control.grid
    run.advance(model, contacts, plan, run.control, run.state, begin, here, run.record)
    h, worn = 10.0 * run.control.grid, contacts.coating.worn.copy()
    load, tried = model.load(0.0), []
    set_blending(model, contacts, plan, run.state, h)
    for _ in range(2):
        assert attempt(model, contacts, plan, run.state, h, load)[0]
        tried.append(run.state.trial.dq.copy())
        np.testing.assert_array_equal(contacts.coating.worn, worn)
    np.testing.assert_array_equal(*tried)
    accept(model, contacts, plan, run.state, h, load)
    assert np.max(contacts.coating.worn - worn) > 1e-8


def test_run_leaves_the_layer_of_its_problem_as_it_is() -> None:
    problem = rubbing(5500.0, periods=8)
    integrate(problem)
    assert not problem.contacts.coating.worn.any()


def test_layer_of_a_thin_coating_is_worn_through() -> None:
    problem = rubbing(4250.0, periods=40)
    coating = problem.contacts.coating
    thin = coating._replace(thickness=np.array([20e-6]))
    problem = problem._replace(contacts=problem.contacts._replace(coating=thin))
    with pytest.raises(ConvergenceError) as raised:
        integrate(problem)
    assert 0 < raised.value.partial.periods < 40
    assert np.max(worn_of(raised.value.partial)) >= 20e-6


def test_compiled_wear_equals_that_of_python() -> None:
    problem = rubbing(5500.0, cells=90, periods=12, steps_per_period=90)
    compiled, plain = integrate(problem), integrate(problem, compiled=False)
    np.testing.assert_allclose(worn_of(compiled), worn_of(plain), rtol=1e-9)
    assert np.max(worn_of(plain)) > 1e-6
