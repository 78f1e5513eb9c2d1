"""Harmonics and contact states of a motion, which a point of a response curve keeps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.online.contact.state import SLIP, STICK
from fenicsrom.online.curves.contact_events import SLIPS
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA, PHASE, LoadHistories
from fenicsrom.online.step.state import Record

HARMONICS = 5  # number of harmonics that a point keeps
PHASES = 200  # instants of the period at which a point keeps the contact states


def load_harmonic(histories: LoadHistories, period: float) -> tuple[int, complex]:
    """The lowest harmonic of the loads: its order in their period, and exp(i phase).

    With phase = 0 the load is a cosine. Of several loads with this harmonic the first counts. Loads
    given by tables have the order 1 and the phase 0.
    """
    sines = histories.sines
    varying = sines[(sines[:, OMEGA] > 0.0) & (sines[:, AMPLITUDE] != 0.0)]
    if not varying.size:
        return 1, 1.0 + 0.0j
    lowest = varying[np.argmin(varying[:, OMEGA])]
    order = max(round(lowest[OMEGA] * period / (2.0 * np.pi)), 1)
    phase = lowest[PHASE] - 0.5 * np.pi + (np.pi if lowest[AMPLITUDE] < 0.0 else 0.0)
    return order, complex(np.exp(1j * phase))


def harmonics(record: Record, histories: LoadHistories, period: float) -> NDArray[np.complex128]:
    """Harmonics of the displacement at the multiples of the lowest frequency of the loads.

    Args:
        record: rows of one or several periods that repeat, without their start.
        histories: time factors of the loads.
        period: period of the loads, s.

    Returns:
        (`HARMONICS`, P, d) complex amplitudes c_k of the contact displacement, or (.., 1, d) of the
        probe, m: the harmonic is Re(c_k exp(i k theta)), where the load is cos(theta).
    """
    order, unit = load_harmonic(histories, period)
    displacement = record.displacement
    if displacement.shape[1] == 0:
        displacement = record.probe[:, None, :]
    time, length = record.time, record.time[-1]
    ahead = np.append(time[1:], time[0] + length)
    behind = np.append(time[-1] - length, time[:-1])
    weights = (ahead - behind) / length  # twice those of the trapezoidal rule
    wave = np.exp(-2j * np.pi * order / period * time) / unit
    waves = np.cumprod([wave] * HARMONICS, axis=0)
    found = waves @ (weights[:, None] * displacement.reshape(time.size, -1))
    return np.asarray(found.reshape(HARMONICS, *displacement.shape[1:]), dtype=np.complex128)


def states_over_period(record: Record, bits: NDArray[np.int64]) -> NDArray[np.int8]:
    """Contact states (`PHASES`, P) in the middle of equal parts of the recorded time.

    Args:
        record: the rows.
        bits: (P,) which states occur, of `fenicsrom.online.curves.contact_events.occurrences`; the
            slip of a point that counts as sticking is stick here too.
    """
    instants = record.time[-1] * (np.arange(PHASES) + 0.5) / PHASES
    found = record.state[record.time.searchsorted(instants)]
    return np.where((found == SLIP) & ((bits & SLIPS) == 0), np.int8(STICK), found)
