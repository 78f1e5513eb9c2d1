"""Signals known in closed form."""

import numpy as np
import pytest
from motions import PERIOD, jenkins, motion

from fenicsrom.assess.errors import signals


def test_spectrum_shows_amplitude_and_frequency_of_sines():
    """Uneven times, a mean, 40 Hz of size 3 and 90 Hz of size 0.5."""
    parts = np.linspace(0.0, 1.0, 4001)
    time = 2.0 * (parts + 1e-4 * np.sin(40.0 * parts))
    x = 7.0 + 3.0 * np.sin(2 * np.pi * 40.0 * time) + 0.5 * np.cos(2 * np.pi * 90.0 * time)
    hertz, size = signals.spectrum(time, x)
    for frequency, amplitude in ((40.0, 3.0), (90.0, 0.5)):
        near = np.abs(hertz - frequency) < 5.0
        assert size[near].max() == pytest.approx(amplitude, rel=0.02)
        assert hertz[near][np.argmax(size[near])] == pytest.approx(frequency, abs=0.5)
    assert size[0] < 1e-3


def test_spectrogram_follows_a_sweep():
    time = np.linspace(0.0, 4.0, 8001)
    x = 2.0 * np.sin(2 * np.pi * (20.0 * time + 10.0 * time**2))  # 20 Hz to 100 Hz
    hertz, middle, size = signals.moving_spectrum(time, x)
    found = hertz[np.argmax(size, axis=0)]
    np.testing.assert_allclose(found, 20.0 + 20.0 * middle, atol=4.0)
    assert size.max() == pytest.approx(2.0, rel=0.1)


def test_strongest_oscillation_is_not_the_drift():
    time = np.linspace(0.0, 3.0, 3001)
    x = np.where(time > 0.5, 5.0, 0.0) + 0.3 * np.exp(-time) * np.sin(2.0 * np.pi * 8.0 * time)
    hertz, size = signals.spectrum(time, x)
    assert hertz[np.argmax(size)] < 1.0
    assert signals.strongest_oscillation(hertz, size) == pytest.approx(8.0, abs=0.4)
    assert signals.strongest_oscillation(hertz[:3], np.array([3.0, 2.0, 1.0])) == hertz[0]


def test_envelope_follows_a_decay():
    time = np.linspace(0.0, 2.0, 5001)
    x = np.exp(-time) * np.cos(2 * np.pi * 50.0 * time)
    middle, low, high = signals.envelope(time, x, 0.04)
    inside = slice(1, -1)
    np.testing.assert_allclose(high[inside], np.exp(-middle[inside]), rtol=0.03)
    np.testing.assert_allclose(low[inside], -np.exp(-middle[inside]), rtol=0.03)
    assert low.min() == x.min() and high.max() == x.max()
    assert middle.size == 50  # the last sample begins no window


def test_stroboscopic_states_of_periodic_motion_are_one_point():
    found = jenkins(periods=8)
    displacement, velocity = signals.stroboscopic_states(found)
    assert displacement.shape == velocity.shape == (5, 2)
    np.testing.assert_allclose(displacement, displacement[:1] + np.zeros((5, 2)), atol=1e-8)
    speed = 2 * np.pi / PERIOD * 8e-3  # u_t passes through zero
    np.testing.assert_allclose(velocity[:, 1], speed, rtol=1e-2)


def test_section_of_doubled_period_alternates():
    time = np.linspace(0.0, 12 * PERIOD, 12 * 200 + 1)
    x = np.zeros((time.size, 1, 2))
    x[:, 0, 0] = np.cos(np.pi * time / PERIOD)
    displacement, _ = signals.stroboscopic_states(motion(time, x))
    np.testing.assert_allclose(displacement[:, 0], [1, -1, 1, -1, 1, -1, 1], atol=1e-9)


def test_energies_of_periods_add_up_to_those_of_the_motion():
    found = jenkins(periods=5)
    each = signals.energy_per_period(found)
    assert {values.size for values in each.values()} == {5}
    assert each["friction"].sum() == pytest.approx(found.friction_dissipation[-1])
    np.testing.assert_allclose(each["damping"], PERIOD * (1.0 - 1e-3 / found.time[-1]), rtol=1e-9)
    np.testing.assert_allclose(each["work"] - each["friction"], PERIOD, rtol=1e-9)
    assert each["friction"][1:] == pytest.approx(each["friction"][1], rel=1e-6)
