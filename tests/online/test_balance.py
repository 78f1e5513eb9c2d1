"""Periodic motions by harmonic balance: against other sources, other methods, and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import (
    assert_tangent,
    duffing,
    harmonic,
    linear_model,
    no_contacts,
    one_contact,
    period_steps,
)

from fenicsrom.online.curves.balance_curve import BalanceCurve
from fenicsrom.online.curves.curve import UNJUDGED, CurvePoint
from fenicsrom.online.model.model import Problem
from fenicsrom.online.model.polynomial import count, paired_cubic
from fenicsrom.online.periodic.balance import Balance, coefficients, phasors
from fenicsrom.online.periodic.shooting import (
    contact_family,
    damping_family,
    force_family,
    frequency_family,
    periodic_motion,
)

Array = NDArray[np.float64]
LOW, HIGH = 0.5 / (2.0 * np.pi), 2.5 / (2.0 * np.pi)


def curve_of(problem: Problem, harmonics: int, family: Any = None) -> BalanceCurve:
    """The motions of a problem over its frequency or another parameter."""
    balance = Balance(problem, harmonics)
    chosen = family or frequency_family(problem)
    return BalanceCurve(balance, chosen, LOW, HIGH, small(balance, problem))


def small(balance: Balance, problem: Problem) -> Array:
    """The variables of the linear motion."""
    found = balance.linear(problem)
    assert found is not None
    return found


def at(path: BalanceCurve, problem: Problem) -> CurvePoint:
    """The motion at the frequency of a problem."""
    found = path.at_parameter(small(path.balance, problem), 1.0 / problem.period)
    assert isinstance(found, CurvePoint)
    return found


@pytest.mark.slow
def test_duffing_curve_folds_and_passes_the_three_known_orbits() -> None:
    """The orbits of `test_periodic_references`, here without a time step."""
    model, period = duffing(0.05, 1.0, 0.3, 1.5)
    problem = Problem(model, no_contacts(), period_steps(100), period)
    path = curve_of(problem, 11)
    low = path.family(LOW)
    start = path.at_parameter(small(path.balance, low), LOW)
    curve = path.run(start, 1.0)
    assert [point.kind for point in curve.special] == ["fold", "fold"]
    assert all(point.verdict == UNJUDGED and not point.known for point in curve.points)
    found = [path.at_parameter(s, 1.0 / period) for _, _, s in curve.crossings(1.0 / period)]
    wanted = [(1.3721947959, 0.0394233432), (1.1426581, 0.0215927), (0.2487814011, 2.009248e-4)]
    for point, (first, third) in zip(found, wanted, strict=True):
        sizes = np.abs(point.harmonics[[0, 2], 0, 0])
        np.testing.assert_allclose(sizes, [first, third], rtol=0.0, atol=6e-8)
        assert point.damping_dissipation == pytest.approx(
            np.pi * 0.05 * 1.5 * (first**2 + 9.0 * third**2), rel=3e-5
        )
    np.testing.assert_allclose(found[0].z, [1.30722027, 0.87306771], rtol=0.0, atol=5e-8)


def rubbing(stiffness: float, harmonics: int, **contact: Any) -> tuple[Problem, BalanceCurve]:
    """An oscillator whose second coordinate rubs; the first one is as good as fixed."""
    model = linear_model(
        np.diag([1e9, 1.0]),
        np.diag([1.4e9, 1.0]),
        damping=0.05,
        loads=[[0.0], [1.0]],
        load_histories=harmonic(1.0, 1.5, 0.5 * np.pi),
        masters=2,
    )
    given = {"preload": 1.0, "friction": 0.3, "tangential_stiffness": stiffness} | contact
    problem = Problem(model, one_contact(**given), period_steps(200), 2.0 * np.pi / 1.5)
    return problem, curve_of(problem, harmonics)


def test_contact_that_sticks_is_its_spring() -> None:
    """Exactly, whatever the harmonics: the chords of the steps are weighed so."""
    problem, path = rubbing(0.7, 3, friction=1e3)
    found = at(path, problem)
    answer = 1.0 / abs(1.7 - 1.5**2 + 0.05j * 1.5)
    assert abs(found.harmonics[0, 0, 1]) == pytest.approx(answer, rel=1e-12)
    assert found.free_sliders == 1 and found.friction_dissipation == pytest.approx(0.0, abs=1e-15)


def test_friction_is_that_of_short_time_steps() -> None:
    """The motion sticks and slips twice in a period; its loss is the work of the load."""
    problem, path = rubbing(3.0, 31)
    found = at(path, problem)
    shot = []
    for steps in (400, 800):
        start = np.zeros(2), np.array([0.0, 1.0]), np.zeros((1, 2))
        motion = periodic_motion(problem._replace(time=period_steps(steps)), start)
        shot.append([motion.amplitude[0, 1], motion.friction_dissipation])
    limit = (4.0 * np.array(shot[1]) - shot[0]) / 3.0
    np.testing.assert_allclose(
        [found.amplitude[0, 1], found.friction_dissipation], limit, rtol=2e-4
    )
    work = np.pi * abs(found.harmonics[0, 0, 1].imag)
    assert found.friction_dissipation + found.damping_dissipation == pytest.approx(work, rel=2e-4)


def test_period_of_a_motion_is_that_of_time_steps() -> None:
    """A point that lifts off, slips and sticks, beside a constant elastic force."""
    model = linear_model(
        np.eye(2),
        np.diag([1.0, 1.2]),
        damping=0.1,
        loads=[[1.0], [0.6]],
        load_histories=harmonic(1.0, 1.5, 0.5 * np.pi),
        masters=2,
    )
    model = model._replace(elastic=model.elastic._replace(force=np.array([0.1, -0.2])))
    contacts = one_contact(preload=0.3, friction=0.5)
    problem = Problem(model, contacts, period_steps(256), 2.0 * np.pi / 1.5)
    path = curve_of(problem, 31)
    found = path.balance.at(problem, at(path, problem).s, derive=False)
    assert found is not None
    ours = path.balance.record(found)
    shot = periodic_motion(problem, (np.zeros(2), np.zeros(2), np.zeros((1, 2)))).record
    assert {*shot.state.ravel()} == {-1, 0, 1}
    np.testing.assert_array_equal(ours.state, shot.state)
    np.testing.assert_allclose(ours.coordinates[:, :4], shot.coordinates[:, :4], atol=1.5e-3)
    for name in ("time", "displacement", "probe", "force", "mean_force", "gap"):
        np.testing.assert_allclose(getattr(ours, name), getattr(shot, name), atol=1.5e-3)
    lost, wanted = (record.friction_dissipation for record in (ours, shot))
    np.testing.assert_allclose(lost, wanted, atol=1e-4)


def two_points() -> tuple[Problem, Array]:
    """A nonlinear body of five coordinates with two points that rub and lift off, and variables."""
    rng, n = np.random.default_rng(3), 5
    model = linear_model(
        np.eye(n) + 0.1 * np.ones((n, n)),
        np.diag(np.arange(1.0, n + 1.0)),
        damping=0.1,
        loads=np.ones((n, 1)),
        load_histories=harmonic(1.0, 1.5, 0.3),
        masters=4,
    )
    cubic = paired_cubic(rng.standard_normal(count(n)), n)
    model = model._replace(
        elastic=model.elastic._replace(quadratic=np.zeros((len(cubic), n)), cubic=cubic),
        velocity_matrix=np.diag(np.ones(n - 1), 1) - np.diag(np.ones(n - 1), -1),
    )
    contacts = one_contact(preload=[0.2, 0.1], friction=[0.5, 0.2])
    problem = Problem(model, contacts, period_steps(100), 2.0 * np.pi / 1.5)
    return problem, 0.3 * rng.standard_normal(7 * n)


def test_derivatives_by_the_harmonics_match_differences() -> None:
    problem, s = two_points()
    balance = Balance(problem, 3)

    def residual(at: Array) -> Any:
        found = balance.at(problem, at, derive=False)
        assert found is not None
        return balance.scaled(found.residual)

    found = balance.at(problem, s, derive=True)
    assert found is not None and {*np.concatenate([o.state for o in found.orbits])} == {-1, 0, 1}
    scale = np.tile(balance.scale, 7)
    slopes = scale[:, None] * found.slopes / scale
    assert_tangent(residual, lambda x: slopes, s, step=1e-6, tolerance=1e-6)


@pytest.mark.parametrize("name", ["frequency", "force", "damping", "preload"])
def test_derivatives_by_the_parameter_match_differences(name: str) -> None:
    """Forces that do not depend on the parameter are not found again."""
    problem, s = two_points()
    family: Any = {
        "frequency": frequency_family(problem),
        "force": force_family(problem),
        "damping": damping_family(problem),
        "preload": contact_family(problem, "preload"),
    }[name]
    path = curve_of(problem, 3, family)
    value = path.values(s, 0.3, derive=True)
    assert value is not None

    def residual(p: Array) -> Any:
        found = path.values(s, float(p[0]), derive=False)
        assert found is not None
        return found.residual

    assert_tangent(
        residual, lambda p: value.jacobian[:, -1:], np.array([0.3]), step=1e-6, tolerance=1e-6
    )


def test_coefficients_and_phasors_are_inverse() -> None:
    given = np.random.default_rng(0).standard_normal((7, 2))
    np.testing.assert_array_equal(coefficients(phasors(given)), given)
    waves = phasors(given)
    angle = 0.7
    value = (waves * np.exp(1j * angle * np.arange(4))[:, None]).sum(axis=0).real
    direct = given[0] + sum(
        given[2 * k - 1] * np.cos(k * angle) + given[2 * k] * np.sin(k * angle) for k in (1, 2, 3)
    )
    np.testing.assert_allclose(value, direct)


def test_mode_without_damping_in_resonance_has_no_linear_motion() -> None:
    model, period = duffing(0.0, 1.0, 0.3, 1.0)
    problem = Problem(model, no_contacts(), period_steps(100), period)
    assert Balance(problem, 1).linear(problem) is None
