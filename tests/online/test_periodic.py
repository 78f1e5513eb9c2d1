"""Periodic motions and their curves against known orbits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import first, linear_model, one_contact

from fenicsrom.errors import ConvergenceError
from fenicsrom.online.continuation import follow
from fenicsrom.online.curve import Curve
from fenicsrom.online.families import frequency_family
from fenicsrom.online.load_histories import harmonic
from fenicsrom.online.model import ReducedModel, reduced_model
from fenicsrom.online.periodic import PeriodicMotion, periodic_motion
from fenicsrom.online.polynomial import ElasticPolynomial
from fenicsrom.online.surfaces import no_contacts
from fenicsrom.scene import Time

Array = NDArray[np.float64]


def settings(steps: int, scheme: str = "discrete-gradient") -> Time:
    return Time.of(scheme=scheme, periods=1, steps_per_period=steps)


def duffing(damping: float, cubic: float, force: float, omega: float) -> tuple[ReducedModel, float]:
    """x'' + damping x' + x + cubic x^3 = force cos(omega t), and the period of the load."""
    elastic = ElasticPolynomial(
        np.zeros(1), np.ones((1, 1)), np.zeros((1, 1)), np.full((1, 1), 3.0 * cubic)
    )
    load = harmonic(np.array([force]), np.array([omega]), np.array([0.5 * np.pi]))
    model = reduced_model(
        np.ones((1, 1)),
        damping,
        elastic,
        np.ones((1, 1)),
        load,
        *first(0, 1),
        np.eye(2, 1),
        np.zeros(2),
    )
    return model, 2.0 * np.pi / omega


def orbit(x: float, v: float, steps: int, **options: Any) -> PeriodicMotion:
    """An orbit of the forced Duffing oscillator with three of them, near (x, v)."""
    model, period = duffing(0.05, 1.0, 0.3, 1.5)
    start = np.array([x]), np.array([v]), np.zeros((0, 2))
    return periodic_motion(model, no_contacts(), settings(steps, **options), period, start)


@pytest.mark.parametrize("scheme", ["discrete-gradient", "average-acceleration"])
@pytest.mark.parametrize(
    ("x", "v", "multiplier", "verdict"),
    [
        (1.30722027, 0.87306771, 0.52172701 + 0.73405696j, "stable"),
        (-0.24849689, 0.02338837, -0.29425625 + 0.85114743j, "stable"),
    ],
)
def test_duffing_orbits_converge_with_second_order(
    scheme: str, x: float, v: float, multiplier: complex, verdict: str
) -> None:
    coarse, middle, fine = (orbit(x, v, steps, scheme=scheme) for steps in (400, 800, 1600))
    found = [motion.multipliers[:2] for motion in (coarse, middle, fine)]
    found = [complex(values[np.argmax(values.imag)]) for values in found]
    assert 3.5 < abs(found[0] - multiplier) / abs(found[1] - multiplier) < 4.5
    limit = (4.0 * found[2] - found[1]) / 3.0
    assert abs(limit - multiplier) < 1e-6
    start = (4.0 * fine.z - middle.z)[:2] / 3.0
    np.testing.assert_allclose(start, [x, v], atol=1e-6)
    assert fine.verdict == verdict


def curve(**options: Any) -> Curve:
    """Frequency response of the Duffing oscillator from 0.05 to 0.4 Hz."""
    model, period = duffing(0.05, 1.0, 0.3, 2.0 * np.pi * 0.08)
    start = np.zeros(1), np.zeros(1), np.zeros((0, 2))
    motion = periodic_motion(model, no_contacts(), settings(200), period, start)
    return follow(
        model,
        no_contacts(),
        settings(200),
        frequency_family(model, no_contacts(), period),
        motion,
        1.0 / period,
        (0.05, 0.4),
        **options,
    )


def test_points_of_a_curve_are_periodic_motions() -> None:
    found = curve()
    model, period = duffing(0.05, 1.0, 0.3, 2.0 * np.pi * 0.08)
    at = frequency_family(model, no_contacts(), period)
    for point in found.points[::10]:
        problem = at(point.parameter)
        alone = periodic_motion(
            problem.model, no_contacts(), settings(200), problem.period, point.z
        )
        np.testing.assert_allclose(alone.z, point.z, rtol=1e-6, atol=1e-8)


def rubbing(preload: float, damping: float = 0.1) -> tuple[ReducedModel, Any, float]:
    """Two coupled masses, the first in front of a wall with friction."""
    load = harmonic(np.array([3.0]), np.array([1.3]), np.array([0.3]))
    model = linear_model(
        np.eye(4),
        np.diag([1.0, 2.0, 3.0, 4.0]) + 0.3 * np.ones((4, 4)),
        damping=damping,
        loads=np.array([[0.8], [1.2], [-0.5], [0.7]]),
        load_histories=load,
        masters=2,
    )
    contacts = one_contact(
        preload=preload, normal_stiffness=6.0, tangential_stiffness=5.0, friction=0.4
    )
    return model, contacts, 2.0 * np.pi / 1.3


START = np.zeros(4), np.zeros(4), np.zeros((1, 2))


def test_rubbing_motion_repeats_and_m_periods_square_its_multipliers() -> None:
    model, contacts, period = rubbing(0.4)
    one = periodic_motion(model, contacts, settings(100), period, START)
    assert one.residuals[-1] <= 1e-10
    assert set(np.unique(one.record.state)) == {-1, 0, 1}
    two = periodic_motion(model, contacts, settings(100), period, one.z, m=2)
    np.testing.assert_allclose(two.z, one.z, rtol=1e-8)
    largest = np.sort(np.abs(one.multipliers))[-4:] ** 2
    np.testing.assert_allclose(np.sort(np.abs(two.multipliers))[-4:], largest, rtol=1e-6)


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
    with pytest.raises(ConvergenceError):
        periodic_motion(
            model,
            no_contacts(),
            settings(steps),
            steps * h,
            (np.zeros(2), np.zeros(2), np.zeros((0, 2))),
        )
