"""The time factors of the loads, plain and compiled, for every model.

The factor of a load is the sum of its sines and its table. A sine acts in a window of time, and its
frequency may ramp:

    s(t) = amplitude sin(phase + theta(t - start))    for start <= t <= end, else 0
    theta(x) = omega x                                without a ramp
    theta'(x) = omega + slope x                       for x <= ramp, of a linear ramp
    theta'(x) = omega exp(growth x)                   for x <= ramp, of a logarithmic one
    theta'(x) = constant                              for x > ramp

In an engine order of a body whose speed varies, the angle of the body takes the place of the time:
omega is then the order, and start and end are angles. A static load is a sine of frequency zero at
its crest. Several harmonics are several sines. A swept
sine ramps to its last frequency and stays there. An impact is half a period in its window. A table
is interpolated linearly and keeps its first and last value outside of its times.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.turning import NO_HISTORY, angle_at
from fenicsrom.online.kernels.compiled import compiled, kernel
from fenicsrom.scene import Harmonic, Harmonics, Load, Pulse, Static, Table
from fenicsrom.scene.keys.loads import OrderFrequency

# the columns of a sine
AMPLITUDE, OMEGA, PHASE, START, END, RAMP, SLOPE, GROWTH, TURNS = range(9)


class LoadHistories(NamedTuple):
    """The time factors of some loads.

    Attributes:
        sines: (s, 9) amplitude (in the unit of the load), omega (rad/s), phase (rad), start and end
            of the window (s), length of the ramp (s), slope (rad/s^2), growth (1/s), and 1 of an
            engine order of the history, else 0; load after load.
        table: (r, 2) times in s, ascending within a load, and factors (in the unit of the load);
            load after load.
        spans: (loads, 4) for each load, its first sine and the one after its last, and its first
            row of the table and the one after its last.
        history: (k, 3) times, speeds and angles of the body (`online.contact.turning`); none at a
            constant speed.
    """

    sines: Array
    table: Array
    spans: NDArray[np.int64]
    history: Array = NO_HISTORY


def harmonic(amplitude: ArrayLike, omega: ArrayLike, phase: ArrayLike) -> LoadHistories:
    """One sine for each load, amplitude sin(omega t + phase); (loads,) N, rad/s, rad."""
    columns = np.broadcast_arrays(*np.atleast_1d(amplitude, omega, phase))
    return _joined([([_sine(*map(float, row))], []) for row in zip(*columns, strict=True)])


def of_loads(loads: Sequence[Load], history: Array = NO_HISTORY) -> LoadHistories:
    """The time factors of a scene's loads, in their units (N, Pa, m/s^2).

    Args:
        loads: the loads.
        history: as in `LoadHistories`; the engine orders follow it.
    """
    found = _joined([_parts(load) for load in loads])
    if history.size:
        for load, (first, last, _, _) in zip(loads, _spans(found), strict=True):
            if isinstance(load.frequency, OrderFrequency):
                by_turn = load.frequency.order / (2.0 * math.pi * load.frequency)
                found.sines[first:last, OMEGA] *= by_turn
                found.sines[first:last, TURNS] = 1.0
    return found._replace(history=history)


def _sine(
    amplitude: float,
    omega: float,
    phase: float,
    *,
    start: float = 0.0,
    end: float = math.inf,
    ramp: float = 0.0,
    slope: float = 0.0,
    growth: float = 0.0,
) -> list[float]:
    """One row of `LoadHistories.sines`."""
    return [amplitude, omega, phase, start, end, ramp, slope, growth, 0.0]


def _parts(load: Load) -> tuple[list[list[float]], list[tuple[float, float]]]:
    """Sines and rows of the table of a load."""
    size, history = load.size, load.history
    if isinstance(history, Table):
        return [], [(time, size * factor) for time, factor in history.rows]
    if isinstance(history, Pulse):
        begin, length = history.pulse.start, history.pulse.duration
        return [_sine(size, math.pi / length, 0.0, start=begin, end=begin + length)], []
    if isinstance(history, Static):
        return [_sine(size, 0.0, 0.5 * math.pi)], []
    omega = 2.0 * math.pi * history.frequency
    if isinstance(history, Harmonics):
        terms = history.harmonics
        return [_sine(size * factor, order * omega, phase) for order, factor, phase in terms], []
    if isinstance(history, Harmonic):
        return [_sine(size, omega, history.phase)], []
    ramp, last = history.sweep.duration, 2.0 * math.pi * history.sweep.to
    if history.sweep.kind == "linear":
        return [_sine(size, omega, history.phase, ramp=ramp, slope=(last - omega) / ramp)], []
    growth = (math.log(last) - math.log(omega)) / ramp
    return [_sine(size, omega, history.phase, ramp=ramp, growth=growth)], []


def _joined(
    parts: Sequence[tuple[Sequence[Sequence[float]], Sequence[tuple[float, float]]]],
) -> LoadHistories:
    lengths = [(len(sines), len(rows)) for sines, rows in parts]
    counts = np.array(lengths, dtype=np.int64).reshape(-1, 2)
    ends = np.cumsum(counts, axis=0)
    spans = np.stack([ends - counts, ends], axis=2).reshape(-1, 4)
    sines = np.array([sine for found, _ in parts for sine in found], dtype=np.float64)
    table = np.array([row for _, rows in parts for row in rows], dtype=np.float64)
    return LoadHistories(sines.reshape(-1, 9), table.reshape(-1, 2), spans)


def _spans(load_histories: LoadHistories) -> list[tuple[int, ...]]:
    return [tuple(int(entry) for entry in row) for row in load_histories.spans]


@kernel
def write_factors(load_histories: LoadHistories, time: float, out: Array) -> None:
    """Write the factors of the loads at a time in s into out (loads,)."""
    sines, table, spans = load_histories.sines, load_histories.table, load_histories.spans
    for k in range(out.size):
        value = 0.0
        for i in range(spans[k, 0], spans[k, 1]):
            x = time - sines[i, START]
            if sines[i, TURNS] > 0.0:
                x = angle_at(load_histories.history, time)
            if x < 0.0 or time > sines[i, END]:
                continue
            angle, omega = sines[i, PHASE], sines[i, OMEGA]
            if sines[i, RAMP] > 0.0:
                y, growth = min(x, sines[i, RAMP]), sines[i, GROWTH]
                angle += 0.5 * sines[i, SLOPE] * y * y + omega * (
                    y if growth == 0.0 else np.expm1(growth * y) / growth
                )
                omega = (omega + sines[i, SLOPE] * y) * np.exp(growth * y)
                x -= y
            value += sines[i, AMPLITUDE] * np.sin(omega * x + angle)
        low, high = spans[k, 2], spans[k, 3] - 1
        if high >= low:
            while high - low > 1:
                middle = (low + high) // 2
                if table[middle, 0] <= time:
                    low = middle
                else:
                    high = middle
            share = (time - table[low, 0]) / (table[high, 0] - table[low, 0])
            share = min(max(share, 0.0), 1.0)
            value += (1.0 - share) * table[low, 1] + share * table[high, 1]
        out[k] = value


@compiled
def factors(load_histories: LoadHistories, time: float) -> Array:
    """The factors (loads,) at a time in s, in the units of the loads."""
    out = np.empty(load_histories.spans.shape[0])
    write_factors(load_histories, time, out)
    return out


def static_factors(load_histories: LoadHistories) -> Array:
    """The factors (loads,) of the loads that are constant in time; zero for the other ones."""
    found = np.zeros(load_histories.spans.shape[0])
    for k, (first, last, low, high) in enumerate(_spans(load_histories)):
        sines = load_histories.sines[first:last]
        if low == high and not np.any(sines[:, OMEGA]):
            found[k] = np.sum(sines[:, AMPLITUDE] * np.sin(sines[:, PHASE]))
    return found


def largest(load_histories: LoadHistories) -> Array:
    """A bound (loads,) of the absolute factors, attained by a load of one sine and by a table."""
    found = np.zeros(load_histories.spans.shape[0])
    for k, (first, last, low, high) in enumerate(_spans(load_histories)):
        found[k] = np.sum(np.abs(load_histories.sines[first:last, AMPLITUDE]))
        found[k] += np.max(np.abs(load_histories.table[low:high, 1]), initial=0.0)
    return found


def quarter_period(load_histories: LoadHistories) -> float:
    """A quarter of the shortest period, in s, of the sines that do not end; infinite without any.

    Adaptive steps of at most this length cannot sample a load at its zeros alone.
    """
    sines = load_histories.sines[np.isinf(load_histories.sines[:, END])]
    omega = sines[:, OMEGA].copy()
    omega[sines[:, TURNS] > 0.0] *= np.max(load_histories.history[:, 1], initial=0.0)
    ends = (omega + sines[:, SLOPE] * sines[:, RAMP]) * np.exp(sines[:, GROWTH] * sines[:, RAMP])
    fastest = float(np.max(np.maximum(omega, ends), initial=0.0))
    return 0.5 * math.pi / fastest if fastest > 0.0 else math.inf


def instants(load_histories: LoadHistories, end: float) -> Array:
    """Times in s after 0 on which adaptive steps must land, so as not to miss an event of a load.

    They are the quarters of every window, the ends of a table and the times at which its slope
    changes sign, and `end` as the last one.
    """
    found = [np.array([end])]
    for sine in load_histories.sines[np.isfinite(load_histories.sines[:, END])]:
        found.append(np.linspace(sine[START], sine[END], 5))
    for _, _, low, high in _spans(load_histories):
        time, value = load_histories.table[low:high].T
        way = np.sign(np.diff(value))
        found.append(time[1:-1][way[1:] != way[:-1]])
        found.append(time[[0, -1]] if time.size else time)
    times = np.unique(np.concatenate(found))
    return times[(times > 0.0) & (times <= end)]
