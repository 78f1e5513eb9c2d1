"""Signals of a motion: spectra, envelope, states once per period, and energy per period."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fenicsrom.arrays import Array
from fenicsrom.online.motion.measures import interpolated
from fenicsrom.online.motion.motion import Motion

SEGMENTS = 16
"""Number of separate segments of a spectrogram; they overlap by seven eighths."""

LEAST_SAMPLES = 64
"""A shorter motion has no spectrum worth drawing."""


def even_samples(time: Array, values: Array) -> tuple[Array, Array]:
    """Values (n,) at as many equally spaced times, by linear interpolation."""
    even = np.linspace(time[0], time[-1], time.size)
    return even, np.interp(even, time, values)


def spectrum(time: Array, values: Array) -> tuple[Array, Array]:
    """Amplitude spectrum of a signal about its mean, with a Hann window.

    Args:
        time: (n,) times, s; they need not be equally spaced.
        values: (n,) the signal.

    Returns:
        Frequencies, Hz, and amplitudes in the unit of the signal: a sine of amplitude a in the
        whole signal has a peak of height a.
    """
    even, signal = even_samples(time, values)
    amplitudes = _amplitudes(signal - signal.mean(), signal.size)
    return np.fft.rfftfreq(signal.size, even[1] - even[0]), amplitudes


def _amplitudes(signals: Array, samples: int) -> Array:
    """Amplitudes (..., f) of signals (..., n) with a Hann window, padded to so many samples."""
    window = np.hanning(signals.shape[-1] + 1)[:-1]
    return np.asarray(2.0 * np.abs(np.fft.rfft(window * signals, samples)) / window.sum())


def strongest_oscillation(frequencies: Array, amplitudes: Array) -> float:
    """The frequency of the highest peak of a spectrum, Hz; a drift has no peak.

    A spectrum without a peak gives the frequency of its largest amplitude.
    """
    before, here, after = amplitudes[:-2], amplitudes[1:-1], amplitudes[2:]
    peaks = 1 + np.flatnonzero((here > before) & (here >= after))
    candidates = peaks if len(peaks) else np.arange(len(amplitudes))
    return float(frequencies[candidates[np.argmax(amplitudes[candidates])]])


def moving_spectrum(time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Amplitude spectra of overlapping segments of a signal about its mean.

    Returns:
        Frequencies (f,), Hz, middles of the segments (s,), s, and amplitudes (f, s).
    """
    even, signal = even_samples(time, values)
    length, step = max(signal.size // SEGMENTS, 16), even[1] - even[0]
    first = np.arange(0, signal.size - length + 1, max(length // 8, 1))
    parts = sliding_window_view(signal - signal.mean(), length)[first]
    frequencies = np.fft.rfftfreq(4 * length, step)
    return frequencies, even[0] + (first + length / 2) * step, _amplitudes(parts, 4 * length).T


def envelope(time: Array, values: Array, width: float) -> tuple[Array, Array, Array]:
    """The smallest and the largest value of a signal in successive windows.

    Args:
        time: (n,) times, s.
        values: (n,) the signal.
        width: length of a window, s.

    Returns:
        The middles of the windows, s, and the smallest and largest values in each; windows
        without a sample are left out. A rest of less than half a window belongs to the last one.
    """
    last = max(round((time[-1] - time[0]) / width), 1) - 1
    number = np.minimum(np.floor((time - time[0]) / width).astype(np.int64), last)
    found, first = np.unique(number, return_index=True)
    low, high = (ufunc.reduceat(values, first) for ufunc in (np.minimum, np.maximum))
    return time[0] + (found + 0.5) * width, low, high


def stroboscopic_states(motion: Motion, point: int = 0) -> tuple[Array, Array]:
    """Displacements and velocities once per period of the loads: a Poincare section.

    The first half of the motion is left out as the transient.

    Args:
        motion: a motion with a period.
        point: number of the contact point.

    Returns:
        Displacements (k, d), m, and velocities (k, d), m/s, the earliest first.
    """
    assert motion.load_period is not None
    part = motion.parts[-1]
    time, x = motion.time[part], motion.displacement[part, point]
    count = int((time[-1] - max(time[0], 0.5 * motion.time[-1])) / motion.load_period + 1e-9)
    instants = time[-1] - motion.load_period * np.arange(count, -1, -1)
    both = np.hstack([x, np.gradient(x, time, axis=0)])
    found = np.column_stack([np.interp(instants, time, column) for column in both.T])
    displacement, velocity = np.hsplit(found, 2)
    return displacement, velocity


def energy_per_period(motion: Motion) -> dict[str, Array]:
    """Energies of each whole period of the loads, J.

    Returns:
        "work", "damping" and "friction" -> (periods,).
    """
    assert motion.load_period is not None
    count = int(motion.time[-1] / motion.load_period + 1e-6)
    instants: Array = motion.load_period * np.arange(count + 1, dtype=np.float64)
    sums = np.column_stack([motion.work, motion.damping_dissipation, motion.friction_dissipation])
    each = np.diff(interpolated(motion, sums, instants), axis=0)
    return dict(zip(("work", "damping", "friction"), each.T, strict=True))
