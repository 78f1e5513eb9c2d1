"""Periodic motions and their curves against known orbits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import duffing, harmonic, linear_model, no_contacts, period_steps, rubbing_masses

from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.continuation import follow
from fenicsrom.online.curves.curve import Curve
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.periodic.shooting import (
    Shooting,
    frequency_family,
    periodic_motion,
    solve,
    start_variables,
)
from fenicsrom.online.run.march import integrate
from fenicsrom.scene import Time


def curve(**options: Any) -> Curve:
    """Frequency response of the Duffing oscillator from 0.05 to 0.4 Hz."""
    model, period = duffing(0.05, 1.0, 0.3, 2.0 * np.pi * 0.08)
    start = np.zeros(1), np.zeros(1), np.zeros((0, 2))
    problem = Problem(model, no_contacts(), period_steps(200), period)
    return follow(
        frequency_family(problem),
        periodic_motion(problem, start),
        1.0 / period,
        (0.05, 0.4),
        **options,
    )


@pytest.mark.slow
def test_points_of_a_curve_are_periodic_motions() -> None:
    found = curve()
    model, period = duffing(0.05, 1.0, 0.3, 2.0 * np.pi * 0.08)
    at = frequency_family(Problem(model, no_contacts(), period_steps(200), period))
    for point in found.points[::10]:
        alone = periodic_motion(at(point.parameter), point.z)
        np.testing.assert_allclose(alone.z, point.z, rtol=1e-6, atol=1e-8)


START = np.zeros(4), np.zeros(4), np.zeros((1, 2))


def test_rubbing_motion_repeats_and_m_periods_square_its_multipliers() -> None:
    model, contacts, period = rubbing_masses(0.4)
    one = periodic_motion(Problem(model, contacts, period_steps(100), period), START)
    assert one.residuals[-1] <= 1e-10
    assert set(np.unique(one.record.state)) == {-1, 0, 1}
    two = periodic_motion(Problem(model, contacts, period_steps(100), period), one.z, m=2)
    np.testing.assert_allclose(two.z, one.z, rtol=1e-8)
    largest = np.sort(np.abs(one.multipliers))[-4:] ** 2
    np.testing.assert_allclose(np.sort(np.abs(two.multipliers))[-4:], largest, rtol=1e-6)


def test_iteration_ends_before_a_small_step() -> None:
    model, contacts, period = rubbing_masses(0.4)
    shooting = Shooting(Problem(model, contacts, period_steps(100), period))
    s = shooting.scaled(start_variables(shooting, START))
    exact, near = solve(shooting, s), solve(shooting, s, step_tolerance=1e-3)
    assert len(near.residuals) < len(exact.residuals)
    apart = np.linalg.norm(shooting.scaled(near.z - exact.z))
    assert 1e-10 < apart / np.linalg.norm(shooting.scaled(exact.z)) <= 1e-3


def test_iteration_ends_after_the_largest_number() -> None:
    model, contacts, period = rubbing_masses(0.4)
    shooting = Shooting(Problem(model, contacts, period_steps(100), period))
    with pytest.raises(ConvergenceError, match="after 3 Newton iterations") as caught:
        solve(shooting, shooting.scaled(start_variables(shooting, START)), iterations=3)
    assert len(caught.value.partial) == 3


@pytest.mark.parametrize(("soft", "stiff", "found"), [(0.0, 1e-6, True), (1e-6, 0.0, False)])
def test_velocity_that_moves_a_stiff_mode_little_may_round(
    monkeypatch: pytest.MonkeyPatch, soft: float, stiff: float, found: bool
) -> None:
    """Frequencies of 1 and 1e5: an error of the velocity moves the stiff mode 1e5 times less."""
    model = linear_model(
        np.eye(2),
        np.diag([2.0, 1e10]),
        damping=0.01,
        loads=[[1.0], [1.0]],
        load_histories=harmonic(np.ones(1), np.array([1.0]), np.zeros(1)),
    )
    shooting = Shooting(Problem(model, no_contacts(), period_steps(100), 2.0 * np.pi))
    exact = shooting.scaled(solve(shooting, np.zeros(4)).z)
    random, march = np.random.default_rng(0), shooting.march
    noise = np.linalg.norm(exact) * np.array([0.0, 0.0, soft, stiff])

    def rounded(s: Any) -> Any:
        residual, *others = march(s) or pytest.fail()
        return residual + noise * random.uniform(-1.0, 1.0, residual.size), *others

    monkeypatch.setattr(shooting, "march", rounded)
    if not found:
        with pytest.raises(ConvergenceError):
            solve(shooting, np.zeros(4))
        return
    near = shooting.scaled(solve(shooting, np.zeros(4)).z)
    assert np.linalg.norm((near - exact)[:3]) <= 1e-9 * np.linalg.norm(exact)


def test_stable_points_of_a_curve_equal_the_marched_steady_state() -> None:
    model, contacts, period = rubbing_masses(0.4)
    problem = Problem(model, contacts, period_steps(100), period)
    start, at = periodic_motion(problem, START), frequency_family(problem)
    band = (0.8 / period, 1.2 / period)
    found = follow(at, start, 1.0 / period, band)
    stable = [point for point in found.points if point.stable]
    settings = Time.of(periods=400, steps_per_period=100, steady_tolerance=1e-11)
    for point in (stable[0], stable[len(stable) // 2], stable[-1]):
        marched = integrate(at(point.parameter)._replace(time=settings))
        assert marched.steady
        np.testing.assert_allclose(amplitude(marched), point.amplitude.ravel(), rtol=1e-6)


@pytest.mark.parametrize("name", ["discrete-gradient", "average-acceleration", "generalised-alpha"])
def test_stiff_model_without_contact_has_a_unique_motion(name: str) -> None:
    model = linear_model(
        np.eye(2),
        np.array([[2.0, -1.0], [-1.0, 1e10]]),
        damping=0.01,
        loads=[[1.0], [0.5]],
        load_histories=harmonic(np.ones(1), np.array([1.3]), np.zeros(1)),
    )
    start = np.zeros(2), np.zeros(2), np.zeros((0, 2))
    motion = periodic_motion(
        Problem(model, no_contacts(), period_steps(100, name), 2.0 * np.pi / 1.3), start
    )
    assert motion.free_sliders == 0
    assert len(motion.residuals) == 2  # the problem is linear


def test_resonance_without_damping_is_not_found() -> None:
    model = linear_model(
        np.eye(2),
        np.diag([1.0, 5.0]),
        loads=[[1.0], [0.0]],
        load_histories=harmonic(np.array([1.0]), np.array([1.0]), np.zeros(1)),
    )
    # the frequency of the scheme, not of the equation: tan(w h / 2) = h / 2
    steps = 50
    h = 2.0 * np.tan(np.pi / steps)
    model = model._replace(
        load_histories=harmonic(np.array([1.0]), np.array([2.0 * np.pi / (steps * h)]), np.zeros(1))
    )
    with pytest.raises(ConvergenceError) as caught:
        periodic_motion(
            Problem(model, no_contacts(), period_steps(steps), steps * h),
            (np.zeros(2), np.zeros(2), np.zeros((0, 2))),
        )
    assert caught.value.decrements == tuple(caught.value.partial) != ()


def test_length_of_a_high_mode_that_rings_is_its_amplitude() -> None:
    """Its free vibration keeps this length; a mode below the load counts by omega."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    model = linear_model(np.eye(2), turn @ np.diag([0.25, 400.0]) @ turn.T)
    found = Shooting(Problem(model, no_contacts(), period_steps(40), 2.0 * np.pi))
    for phase in (0.0, 0.4, 1.3):
        z = np.concatenate([turn[:, 1] * np.cos(phase), -20.0 * turn[:, 1] * np.sin(phase)])
        assert np.linalg.norm(found.weights @ found.scaled(z)) == pytest.approx(1.0, rel=1e-12)
    slow = np.concatenate([np.zeros(2), 0.5 * turn[:, 0]])
    assert np.linalg.norm(found.weights @ found.scaled(slow)) == pytest.approx(0.5, rel=1e-12)
