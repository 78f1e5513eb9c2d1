"""Harmonics and contact states that points of a curve keep, and how records are packed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
from support import harmonic

from fenicsrom.online.curves.curve import (
    HARMONICS,
    OPENS,
    PHASES,
    SLIPS,
    STICKS,
    harmonics,
    load_harmonic,
    states_over_period,
)
from fenicsrom.online.periodic.steady import periods_of
from fenicsrom.online.step.state import Record, joined_rows, no_record
from fenicsrom.online.store.store import pack, unpack

PERIOD = 0.5


def record_of(time: Any, values: Any) -> Record:
    """Rows of a displacement of one contact point in 2D."""
    record = no_record(time.size, 1, 2)
    record.time[:] = time
    record.displacement[:, 0, :] = values
    return record


@pytest.mark.parametrize("periods", [1, 2])
def test_harmonics_have_amplitude_and_phase_against_the_load(periods: int) -> None:
    # load F sin(omega t + 0.3); the first harmonic lags by 0.5, the third by 0.2 of its own
    omega = 2.0 * np.pi / PERIOD
    time = np.linspace(0.0, periods * PERIOD, 100 * periods + 1)[1:]
    first = 2.0 * np.sin(omega * time + 0.3 - 0.5)
    theta = omega * time + 0.3 - 0.5 * np.pi
    third = 0.1 * np.cos(3.0 * theta - 0.2)
    record = record_of(time, np.stack([first, 5.0 + third], axis=1))
    found = harmonics(record, harmonic(7.0, omega, 0.3), PERIOD)
    assert found.shape == (HARMONICS, 1, 2)
    np.testing.assert_allclose(found[:, 0, 0], [2.0 * np.exp(-0.5j), 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found[:, 0, 1], [0, 0, 0.1 * np.exp(-0.2j), 0, 0], atol=1e-12)


def test_harmonics_of_unequal_steps_converge_with_the_square_of_the_step() -> None:
    omega = 2.0 * np.pi / PERIOD

    def error(steps: int) -> float:
        phase = np.arange(1, steps + 1) / steps
        time = PERIOD * (phase + 0.1 / (2.0 * np.pi) * np.sin(2.0 * np.pi * phase))
        record = record_of(time, np.tile(np.sin(omega * time)[:, None], 2))
        found = harmonics(record, harmonic(1.0, omega, 0.0), PERIOD)
        return float(abs(found[0, 0, 0] - 1.0))

    assert 0.0 < error(100) < 1e-2
    assert error(100) / error(200) == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("back", [0, 1, 2])
def test_last_periods_of_a_history_are_those_of_its_joined_rows(back: int) -> None:
    """The history has an entry for each period; the slow twin has one entry with all rows."""
    entries = [record_of(k + np.linspace(0.0, 1.0, 5)[1:], float(k)) for k in range(8)]
    whole = joined_rows(entries, [entry.time.size for entry in entries])
    found, slow = (periods_of(rows, 1.0, 2, back) for rows in (entries, [whole]))
    np.testing.assert_array_equal(found.time, slow.time)
    np.testing.assert_array_equal(found.displacement, slow.displacement)
    assert found.time.size == 8 and found.time[-1] == 8.0 - back


def test_load_harmonic_is_the_lowest_varying_sine() -> None:
    omega = 2.0 * np.pi / PERIOD
    histories = harmonic([5.0, 0.0, -1.0, 2.0], [0.0, omega, 2 * omega, 3 * omega], [0, 0, 0.4, 1])
    order, unit = load_harmonic(histories, PERIOD)
    assert order == 2
    assert unit == pytest.approx(np.exp(1j * (0.4 + 0.5 * np.pi)))


def test_states_are_those_of_the_step_that_covers_each_phase() -> None:
    record = record_of(np.array([0.1, 0.4, 0.5]), 0.0)
    record.state[:, 0] = [-1, 1, 0]
    states = states_over_period(record, np.array([OPENS | SLIPS | STICKS]))
    assert states.shape == (PHASES, 1) and states.dtype == np.int8
    counts = {state: int(np.sum(states == state)) for state in (-1, 0, 1)}
    assert counts == {-1: PHASES // 5, 1: 3 * PHASES // 5, 0: PHASES // 5}
    assert list(states[[0, -1], 0]) == [-1, 0]
    negligible = states_over_period(record, np.array([OPENS | STICKS]))
    np.testing.assert_array_equal(negligible, np.where(states == 0, 1, states))


class Pair(NamedTuple):
    """A named tuple to pack."""

    first: Any
    second: Any


@dataclass
class Thing:
    """A dataclass to pack."""

    name: str
    values: Any
    parts: Any = None


def test_packed_records_are_the_same_bit_for_bit() -> None:
    rng = np.random.default_rng(1)
    inner = Thing("inner", rng.normal(size=(3, 2)) + 1j * rng.normal(size=(3, 2)))
    thing = Thing(
        "outer",
        rng.normal(size=5),
        [
            inner,
            (1, 0.1 + 0.2, None, True, 2.0 - 3.0j),
            Pair(rng.normal(size=(2, 2)), np.arange(3)),
            np.arange(4),
        ],
    )
    tree, arrays = pack(thing)
    assert all(array.ndim == 1 for array in arrays.values())
    classes = {"Thing": Thing, "Pair": Pair}
    found = unpack(tree, arrays, classes)
    assert found.name == "outer" and found.parts[1] == thing.parts[1]
    for one, other in (
        (found.values, thing.values),
        (found.parts[0].values, inner.values),
        (found.parts[2].first, thing.parts[2].first),
        (found.parts[2].second, thing.parts[2].second),
        (found.parts[3], thing.parts[3]),
    ):
        assert one.dtype == other.dtype and one.shape == other.shape
        assert one.tobytes() == other.tobytes()
