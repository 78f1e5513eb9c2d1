"""Branches at period doublings, motions connected through the load, closed curves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import first, harmonic, no_contacts

from fenicsrom.online.curves.continuation import (
    Continuation,
    _eigenvector,
    branch,
    lies_on,
    motions_through_load,
    passes_through,
)
from fenicsrom.online.curves.curve import Curve, CurvePoint
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.periodic.shooting import (
    Family,
    Shooting,
    family_of,
    force_family,
    frequency_family,
    solve,
)
from fenicsrom.scene import Time

Array = NDArray[np.float64]


def oscillator(
    damping: float, elastic: tuple[float, float, float], force: float, omega: float
) -> tuple[ReducedModel, float]:
    """x'' + damping x' + k x + a x^2 + c x^3 = force cos(omega t), elastic = (k, a, c); period."""
    k, a, c = elastic
    model = reduced_model(
        np.ones((1, 1)),
        damping,
        ElasticPolynomial(
            np.zeros(1), np.full((1, 1), k), np.full((1, 1), 2.0 * a), np.full((1, 1), 3.0 * c)
        ),
        np.ones((1, 1)),
        harmonic(np.array([force]), np.array([omega]), np.array([0.5 * np.pi])),
        *first(0, 1),
        np.eye(2, 1),
        np.zeros(2),
    )
    return model, 2.0 * np.pi / omega


def shooting(model: ReducedModel, period: float, m: int = 1, steps: int = 200) -> Shooting:
    settings = Time.of(scheme="discrete-gradient", periods=1, steps_per_period=steps)
    return Shooting(Problem(model, no_contacts(), settings, period), m)


def path_at(
    start: Array, family: Family, value: float, bounds: tuple[float, float], m: int = 1, **size: Any
) -> tuple[Continuation, CurvePoint]:
    """A continuation, and its point near (x, v) at a value of the parameter."""
    problem = family(value)
    equation = shooting(problem.model, problem.period, m, **size)
    s = equation.scaled(solve(equation, equation.scaled(start)).z)
    size = s if np.linalg.norm(s) > 0.1 else np.full(s.size, 0.1)
    path = Continuation(equation, family, *bounds, size)
    point = path.at_parameter(s, value)
    assert point is not None
    return path, point


# The oscillator of Duffing and Holmes, x'' + 0.3 x' - x + x^3 = F cos 1.2 t, in the well x = 1 + u:
# its motion doubles its period between F = 0.20 and 0.28, and again between 0.28 and 0.29.
HOLMES = (2.0, 3.0, 1.0)


def holmes() -> tuple[Family, Continuation, Curve]:
    """The motions in one well over the force."""
    model, period = oscillator(0.3, HOLMES, 1.0, 1.2)
    family = force_family(Problem(model, no_contacts(), None, period))
    path, start = path_at(np.zeros(2), family, 0.05, (0.05, 0.32))
    return family, path, path.run(start, 1.0, points=300, largest_step=0.03)


@pytest.fixture(scope="module")
def doubled() -> tuple[Family, CurvePoint, Curve]:
    """The first period doubling of the motions in one well, and its branch."""
    family, path, curve = holmes()
    point = next(point for point in curve.special if point.kind == "period doubling")
    problem = family(point.parameter)
    found = branch(path, point, shooting(problem.model, problem.period, 2))
    assert found is not None
    return (family, point, found[0].run(found[1], None, points=60, largest_step=0.03))


@pytest.mark.slow
def test_period_doubling_is_located_where_a_multiplier_is_minus_one(doubled: Any) -> None:
    """Reference: two period doublings of Duffing and Holmes | literature | F from 0.20 to 0.28, to
    0.29 | inside | the intervals
    """
    _, point, _ = doubled
    assert 0.20 < point.parameter < 0.28
    assert min(abs(point.multipliers + 1.0)) < 1e-4


def test_branch_of_a_period_doubling_has_motions_of_two_periods(doubled: Any) -> None:
    _, point, curve = doubled
    assert all(other.periods == 2 for other in curve.points)
    assert abs(curve.points[0].parameter - point.parameter) < 0.01
    assert all(np.linalg.norm(other.alternation) > 1e-3 for other in curve.points)
    second = [other for other in curve.special if other.kind == "period doubling"]
    assert second and 0.28 < second[0].parameter < 0.29


def test_branch_is_where_a_marched_motion_settles(doubled: Any) -> None:
    family, _, curve = doubled
    point = next(other for other in curve.points[2:] if other.stable)
    problem = family(point.parameter)
    equation = shooting(problem.model, problem.period, 2)
    s = 1.001 * point.s
    for _ in range(400):
        found = equation.march(s, derive=False)
        assert found is not None
        s = s + found[0]
    np.testing.assert_allclose(s, point.s, rtol=1e-6, atol=1e-6)
    alone = shooting(problem.model, problem.period).march(s, derive=False)
    assert alone is not None and np.linalg.norm(alone[0]) > 1e-2 * np.linalg.norm(s)


# ẍ + 0.05 ẋ + x + x³ = 0.3 cos 1.5t has three motions; the multipliers of the saddle
SADDLE = np.array([0.381762, 2.124463])
LOWER = np.array([-0.24849689, 0.02338837])


def through_load(steps: int) -> list[CurvePoint]:
    """The motions that are connected with the lower one through the load."""
    model, period = oscillator(0.05, (1.0, 0.0, 1.0), 0.3, 1.5)
    problem = frequency_family(Problem(model, no_contacts(), None, period))(1.0 / period)
    _, lower = path_at(LOWER, force_family(problem), 1.0, (0.01, 4.0), steps=steps)
    equation = shooting(problem.model, problem.period, steps=steps)
    return sorted(motions_through_load(equation, problem, lower.s), key=lambda p: p.amplitude.max())


@pytest.mark.parametrize(
    ("kind", "column"), [("period doubling", 1), ("branch point", 2), ("fold", 2)]
)
def test_branch_leaves_along_the_eigenvector_of_its_bifurcation(kind: str, column: int) -> None:
    """The eigenvector of the multiplier nearest to -1 or 1, whatever its size and sign are."""
    vectors = np.random.default_rng(3).normal(size=(4, 4))
    vectors /= np.linalg.norm(vectors, axis=0)
    values = np.diag([-0.9, -1.00001, 0.99999, 1.2])
    path: Any = SimpleNamespace(monodromy=lambda point: vectors @ values @ np.linalg.inv(vectors))
    found = _eigenvector(path, SimpleNamespace(kind=kind))  # type: ignore[arg-type]
    assert found is not None
    assert abs(found @ vectors[:, column]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_load_connects_the_three_duffing_motions() -> None:
    found = [through_load(steps) for steps in (200, 400, 800)]
    assert [len(motions) for motions in found] == [2, 2, 2]
    multipliers = [np.sort(motions[0].multipliers.real) for motions in found]
    limit = (4.0 * multipliers[2] - multipliers[1]) / 3.0
    np.testing.assert_allclose(limit, SADDLE, atol=1e-6)
    first_error, second_error = (abs(value[1] - SADDLE[1]) for value in multipliers[:2])
    assert 3.5 < first_error / second_error < 4.5
    upper = found[-1][1]
    assert upper.stable and upper.z[:2] == pytest.approx([1.30722027, 0.87306771], abs=1e-4)


@pytest.mark.slow
def test_saddle_is_reached_through_the_fold() -> None:
    limits = []
    for steps in (400, 800):
        model, period = oscillator(0.05, (1.0, 0.0, 1.0), 0.3, 1.0)
        family = frequency_family(Problem(model, no_contacts(), None, period))
        low, high, value = 0.1, 0.4, 1.5 / (2.0 * np.pi)
        path, start = path_at(np.array([0.4, 0.0]), family, low, (low, high), steps=steps)
        curve = path.run(start, 1.0, points=400)
        at = [
            (a, b)
            for a, b in zip(curve.points, curve.points[1:], strict=False)
            if (a.parameter - value) * (b.parameter - value) < 0.0
        ]
        assert len(at) == 3
        a, b = at[1]
        share = (value - a.parameter) / (b.parameter - a.parameter)
        point = path.at_parameter(a.s + share * (b.s - a.s), value)
        assert point is not None and point.verdict == "fold"
        limits.append(np.sort(point.multipliers.real))
    np.testing.assert_allclose((4.0 * limits[1] - limits[0]) / 3.0, SADDLE, atol=1e-6)


@pytest.mark.slow
def test_isolated_curve_closes() -> None:
    """Reference: ends of a closed isolated curve | closed form | 0.5 ± √0.02 | agree | 1e-4"""
    # over the force the upper motion and the saddle at omega = 1.5 join at a fold; a force that
    # is just above that fold in a window of the parameter makes them a closed curve
    model, period = oscillator(0.05, (1.0, 0.0, 1.0), 1.0, 1.5)
    by_force = force_family(Problem(model, no_contacts(), None, period))
    path, start = path_at(np.array([1.30722027, 0.87306771]), by_force, 0.3, (0.01, 0.4))
    down = path.run(start, -1.0, points=300, largest_step=0.03)
    fold = next(point for point in down.special if point.kind == "fold").parameter

    window = family_of(lambda p: by_force(fold + 0.02 - (p - 0.5) ** 2))
    near = min(down.points, key=lambda point: abs(point.parameter - fold - 0.02))
    path, start = path_at(near.z, window, 0.5, (0.0, 1.0))
    curve = path.run(start, 1.0, points=300, largest_step=0.03)
    assert curve.reason == "closed"
    ends = sorted(point.parameter for point in curve.special if point.kind == "fold")
    np.testing.assert_allclose(ends, 0.5 + np.sqrt(0.02) * np.array([-1.0, 1.0]), atol=1e-4)
    again, other = path_at(curve.points[7].z, window, curve.points[7].parameter, (0.0, 1.0))
    assert lies_on(again, curve, other) and passes_through(again, curve, other)
    _, lower = path_at(LOWER, window, 0.5, (0.0, 1.0))
    assert not lies_on(again, curve, lower) and not passes_through(again, curve, lower)
