"""Critical speeds of frequency curves known in closed form."""

import numpy as np
import pytest

from fenicsrom.assess.rotation.critical_speeds import (
    CONFIRMED,
    FrequencyCurve,
    confirm,
    critical_speeds,
)
from fenicsrom.errors import ConvergenceError

REST, GROWTH = 33.0, 1.9  # Hz and Southwell's coefficient: f^2 = REST^2 + GROWTH (Omega/60)^2


def southwell(speeds, stiffening=0.0):
    """f^2 of a blade; `stiffening` bends the line over Omega^2."""
    x = (np.asarray(speeds) / 60.0) ** 2
    return REST**2 + GROWTH * x + stiffening * x**2


def meeting(order):
    """The exact critical speed of the straight line, rev/min."""
    return 60.0 * REST / np.sqrt(order**2 - GROWTH)


def curve(speeds, squares, coriolis=False):
    return FrequencyCurve(np.array(speeds, float), np.asarray(squares), coriolis)


@pytest.mark.parametrize(
    "speeds", [[0.0, 3000.0], [0.0, 800.0, 3000.0], np.linspace(0.0, 3000.0, 9)]
)
@pytest.mark.parametrize("order", [2, 4, 6])
def test_crossing_of_southwell_curve_is_exact_from_two_speeds(speeds, order):
    (found,) = curve(speeds, southwell(speeds)).crossings(order)
    assert found == pytest.approx(meeting(order), rel=1e-12)


def test_crossing_of_an_oscillator_that_stiffens_with_the_speed_is_exact():
    """2Ω meets the frequency √(80² + 1.8 Ω²) rad/s of test B of the run-ups at 53.9360 rad/s.

    Reference: critical speed of an oscillator that stiffens with the speed | closed form |
    53.9360 rad/s | agrees | 5e-5 rad/s
    """
    speeds = np.array([40.0, 70.0])
    squares = (80.0**2 + 1.8 * speeds**2) / (2.0 * np.pi) ** 2
    (found,) = curve(30.0 / np.pi * speeds, squares).crossings(2)
    assert np.pi / 30.0 * found == pytest.approx(53.9360, abs=5e-5)


def test_engine_order_below_the_curve_has_no_crossing():
    assert not curve([0.0, 3000.0], southwell([0.0, 3000.0])).crossings(1).size


def test_whirling_frequency_is_exact_with_coriolis_force():
    """f = f0 - Omega/60 of a shaft is a line over the speed: order 1 meets it at f0/2."""
    speeds = np.array([0.0, 400.0, 1000.0])
    squares = (REST - speeds / 60.0) ** 2
    (found,) = curve(speeds, squares, coriolis=True).crossings(1)
    assert found == pytest.approx(30.0 * REST, rel=1e-12)


def test_coarse_curve_is_corrected_by_the_computed_frequencies():
    speeds, bend, order = [0.0, 3000.0], -2e-4, 3
    calls = []

    def solve(mode, speed):
        calls.append(speed)
        return float(southwell(speed, bend)), 1.0

    (found,), notes = critical_speeds([curve(speeds, southwell(speeds, bend))], [order], solve)
    linear = 1.0 * order**2 - GROWTH
    x = (linear - np.sqrt(linear**2 - 4.0 * bend * REST**2)) / (2.0 * bend)
    assert 1 < len(calls) <= 4 and not notes
    assert abs(calls[0] / (60.0 * np.sqrt(x)) - 1.0) > CONFIRMED  # the line alone is not enough
    assert found.speed_rpm == pytest.approx(60.0 * np.sqrt(x), rel=3 * CONFIRMED)
    assert found.confirmed and abs(found.difference) <= CONFIRMED
    assert found.computed_hz == pytest.approx(found.frequency_hz, rel=CONFIRMED)
    assert found.frequency_hz == pytest.approx(order * found.speed_rpm / 60.0, rel=1e-14)


def test_crossing_that_computed_frequencies_do_not_have_is_left_out():
    """The parabola dips below the engine order between two points; the frequencies do not."""

    def above(speed):
        x = (np.asarray(speed) / 60.0) ** 2
        return x + 50.0 + 400.0 * np.exp(-x / 200.0)

    speeds = np.array([0.0, 1000.0, 2000.0])
    found = curve(speeds, above(speeds))
    assert found.crossings(1).size == 2
    assert critical_speeds([found], [1], lambda mode, at: (float(above(at)), 1.0)) == ([], [])


@pytest.mark.parametrize("mac", [0.2, 0.9])
def test_lost_mode_is_not_confirmed(mac):
    speeds = [0.0, 3000.0]
    found, notes = critical_speeds(
        [curve(speeds, southwell(speeds))], [2], lambda mode, at: (float(southwell(at)), mac)
    )
    assert found[0].confirmed is (mac > 0.5) and found[0].mac == mac
    assert len(notes) == (mac < 0.5)


def test_failed_modes_leave_the_interpolated_speed():
    def solve(mode, speed):
        raise ConvergenceError("no modes")

    speeds = [0.0, 3000.0]
    (found,), notes = critical_speeds([curve(speeds, southwell(speeds))], [2], solve)
    assert found.speed_rpm == pytest.approx(meeting(2)) and found.computed_hz is None
    assert not found.confirmed and "no modes" in notes[0]
    with pytest.raises(ConvergenceError):
        confirm(curve(speeds, southwell(speeds)), found, lambda at: solve(0, at))
