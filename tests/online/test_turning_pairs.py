"""Unstable stretches of a curve that are much shorter than its steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support import excited_stiffness, harmonic, linear_model, no_contacts, period_steps

from fenicsrom.online.curves import continuation
from fenicsrom.online.curves.continuation import follow
from fenicsrom.online.curves.curve import Curve, CurvePoint
from fenicsrom.online.curves.events import _Planes, outside, turning_pairs, unseen_points
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import Shooting, frequency_family, periodic_motion

FORCE, DAMPING, TONGUE = 0.03, 1e-4, 1e-4
LOW, HIGH = 0.9 / (2.0 * np.pi), 1.1 / (2.0 * np.pi)


def response(coupling: float, direction: float = 1.0) -> Curve:
    """The motions without y over the frequency, with the default steps."""
    load = harmonic(np.array([FORCE]), np.array([2.0 * np.pi * LOW]), np.zeros(1))
    model = excited_stiffness(DAMPING, coupling, load)
    family = frequency_family(Problem(model, no_contacts(), period_steps(200), 1.0 / LOW))
    value = LOW if direction > 0.0 else HIGH
    rest = np.zeros(2), np.zeros(2), np.zeros((0, 2))
    motion = periodic_motion(family(value), rest)
    return follow(family, motion, value, (LOW, HIGH), direction=direction)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_instability_tongue_much_shorter_than_a_step_is_found(direction: float) -> None:
    """With x = A sin(W t) and e = c A^2 / 8, y grows while (W - 1 - 2 e)^2 < e^2 - (d / 2)^2.

    That is the first order of Mathieu's equation (Nayfeh and Mook 1979, chapter 5).

    Reference: short unstable stretch: width; centre | Mathieu's equation | closed form | agree | 1
    %; 2e-6
    """
    amplitude = FORCE / 3.0
    curve = response(8.0 * TONGUE / amplitude**2, direction)
    assert curve.reason == "end of the range"
    assert [point.kind for point in curve.special] == ["branch point", "branch point"]
    ends = np.sort([2.0 * np.pi * point.parameter for point in curve.special])
    half = np.sqrt(TONGUE**2 - (0.5 * DAMPING) ** 2)
    assert np.ptp(ends) == pytest.approx(2.0 * half, rel=0.01)
    step = 2.0 * np.pi / 200.0  # the midpoint rule makes the frequency 1 lower by step^2 / 12
    assert np.mean(ends) == pytest.approx(1.0 + 2.0 * TONGUE - step**2 / 12.0, abs=0.02 * TONGUE)
    unstable = [point for point in curve.points if outside(point)]
    assert [ends[0] < 2.0 * np.pi * point.parameter < ends[1] for point in unstable] == [True]
    parameters = [direction * point.parameter for point in curve.points]
    assert parameters == sorted(parameters)


def test_pair_that_meets_on_the_real_axis_without_excitation_changes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    curve = response(0.0)
    assert curve.reason == "end of the range"
    assert curve.special == []
    assert all(point.stable for point in curve.points)
    senses = [np.sign(point.turning.imag) for point in curve.points]
    assert not np.array_equal(senses[0], senses[-1])
    monkeypatch.setattr(continuation.events, "unseen_points", lambda path, a, b: [])
    plain = response(0.0)
    assert len(plain.points) == len(curve.points)
    for one, other in zip(plain.points, curve.points, strict=True):
        np.testing.assert_array_equal(one.z, other.z)
        assert one.parameter == other.parameter


@dataclass
class Trials:
    """A path that counts the places that are sought, and finds no point."""

    calls: int = 0

    def place(self, point: CurvePoint) -> NDArray[np.float64]:
        return np.append(point.s, point.parameter)

    def direction(self, point: CurvePoint) -> NDArray[np.float64]:
        return point.tangent / np.linalg.norm(point.tangent)

    def correct(
        self, y: NDArray[np.float64], along: NDArray[np.float64], *, exact: bool = False
    ) -> None:
        self.calls += 1


def turning_points(size: float) -> list[CurvePoint]:
    """Two neighbours between which a pair turns from an angle of 0.02 to one of -0.03."""
    given = zip(response(0.0).points, (0.02, -0.03), np.exp([0.05, 0.0]), strict=False)
    return [
        replace(point, turning=size * np.exp([1j * angle]), turn_rates=np.ones(1), period=period)
        for point, angle, period in given
    ]


@pytest.mark.parametrize(("size", "sought"), [(0.94, False), (0.96, True), (0.99, True)])
def test_pair_that_turns_too_little_to_miss_a_stretch_is_not_sought(
    size: float, sought: bool
) -> None:
    """The pair turns by 0.05 from one point to the other; a stretch between needs -2 log(size)."""
    path = Trials()
    assert unseen_points(path, *turning_points(size)) == []
    assert (path.calls > 0) == sought


@pytest.mark.parametrize("coupling", [0.4, 1.6])
def test_stretch_is_excluded_or_found_by_few_points_at_each_crossing(
    coupling: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The excitation e of the tongue is 0.4 or 1.6 times the damping -log r."""
    sought, point = [], _Planes.point
    monkeypatch.setattr(
        _Planes, "point", lambda *given, **exact: sought.append(1) or point(*given, **exact)
    )
    amplitude = FORCE / 3.0
    curve = response(coupling * 0.5 * DAMPING * 8.0 / amplitude**2)
    assert len(curve.special) == (2 if coupling > 1.0 else 0)
    assert coupling > 1.0 or len(sought) <= 5  # x meets itself on the real axis too


@pytest.mark.parametrize("scheme", ["discrete-gradient", "average-acceleration"])
def test_rates_of_turning_pairs_match_differences_at_any_frequency(scheme: str) -> None:
    frequencies, steps, period = np.array([0.7, 9.3, 60.0, 700.0]), 50, 2.0
    model = linear_model(np.eye(4), np.diag(frequencies**2), damping=0.01, masters=0)

    def pairs(factor: float) -> tuple[np.ndarray, np.ndarray]:
        shooting = Shooting(
            Problem(model, no_contacts(), period_steps(steps, scheme), factor * period)
        )
        marched = shooting.march(np.zeros(shooting.map.size))
        assert marched is not None
        found = turning_pairs(*np.linalg.eig(marched[1]), 4, shooting.omega, factor * period, steps)
        return tuple(part[np.argsort(found[1])] for part in found[:2])  # type: ignore[return-value]

    change = 1e-5
    (low, _), (middle, rates), (high, _) = pairs(1.0 - change), pairs(1.0), pairs(1.0 + change)
    step = frequencies * period / steps
    angles = np.exp(2j * steps * np.arctan(0.5 * step))
    exact = frequencies * period / (1.0 + 0.25 * step**2)
    np.testing.assert_allclose(rates, np.sort(exact), rtol=1e-3)
    np.testing.assert_allclose(np.angle(high / low) / (2.0 * change), rates, rtol=1e-3)
    np.testing.assert_allclose(middle / np.abs(middle), angles[np.argsort(exact)], atol=1e-3)
