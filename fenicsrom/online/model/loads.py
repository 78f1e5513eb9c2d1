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

Follower pressures in the coordinates q of a basis: forces that depend on the displacement.

A pressure p on the current area along the current normal does the virtual work

    v . P(u) = p g(u) . v = -p int cof(F) N . v dA,    F = I + grad u,                        (1)

on the facets of the undeformed body with the outer normal N. The cofactors of F are polynomials of
degree 2 (1 in 2D) of the displacement, so that with u = u0 + R q

    R^T g(u) = g0 + G q + 1/2 H q q                                                           (2)

is exact. g0 is the load vector at the equilibrium. The other two parts belong to no energy if the
loaded surface has a free edge: G and H are symmetric in their last two indices only. Their work is
counted as work of the loads. Within a time step h(t), the size times the time factor, is linear:
the integral of (2) along the straight line from q0 to q1 is then a polynomial of degree 3 of the
position in the step, which two Gauss points integrate exactly.

Supports that move together. The displacement of a body is relative to its supports.

With the absolute displacement u + r a(t), where r is the unit translation along a, the equation of
motion of the relative displacement u is

    M ü + C u̇ + f(u) = p - M r a″(t).    (3)

It is exact: strains and stresses depend on u only. Damping acts on the velocity relative to the
supports, and everything that the body touches (springs to the ground, rigid surfaces) moves with
the supports. The load vector is -M r, and the time factor is a″.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.surfaces import NO_HISTORY, angle_at, row_before
from fenicsrom.online.kernels.compilation import compiled, kernel
from fenicsrom.online.model.polynomial import Workspace
from fenicsrom.scene import Harmonic, Harmonics, Load, Pulse, Scene, Static, Sweep, Table
from fenicsrom.scene.keys.excitation import shortest_period
from fenicsrom.scene.keys.loads import OrderFrequency, SupportDisplacement

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
        history: (k, 3) times, speeds and angles of the body; none at a constant speed
            (`online.contact.surfaces.speed_history`).
    """

    sines: Array
    table: Array
    spans: NDArray[np.int64]
    history: Array = NO_HISTORY


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
            if sines[i, TURNS].real > 0.0:
                x = angle_at(load_histories.history, time)
            if x.real < 0.0 or time.real > sines[i, END].real:
                continue
            angle, omega = sines[i, PHASE], sines[i, OMEGA]
            if sines[i, RAMP].real > 0.0:
                y, growth = x, sines[i, GROWTH]
                if x.real > sines[i, RAMP].real:
                    y = sines[i, RAMP] + 0.0 * x
                angle += 0.5 * sines[i, SLOPE] * y * y + omega * (
                    y if growth.real == 0.0 else np.expm1(growth * y) / growth
                )
                omega = (omega + sines[i, SLOPE] * y) * np.exp(growth * y)
                x -= y
            value += sines[i, AMPLITUDE] * np.sin(omega * x + angle)
        low, high = spans[k, 2], spans[k, 3] - 1
        if high >= low:
            low += row_before(table[low:high], time)
            high = low + 1
            share = (time - table[low, 0]) / (table[high, 0] - table[low, 0])
            if not 0.0 < share.real < 1.0:
                share = (1.0 if share.real > 0.5 else 0.0) + 0.0 * time
            value += (1.0 - share) * table[low, 1] + share * table[high, 1]
        out[k] = value


@compiled
def factors(load_histories: LoadHistories, time: float) -> Array:
    """The factors (loads,) at a time in s, in the units of the loads."""
    out = np.empty(load_histories.spans.shape[0])
    write_factors(load_histories, time, out)
    return out


@compiled
def factors_along(load_histories: LoadHistories, times: Array) -> Array:
    """The factors (T, loads) at times (T,) in s, in the units of the loads."""
    out = np.empty((times.size, load_histories.spans.shape[0]))
    for row in range(times.size):
        write_factors(load_histories, times[row], out[row])
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


_HALF = 0.5 / np.sqrt(3.0)
GAUSS = (0.5 - _HALF, 0.5 + _HALF)
"""Points in [0, 1] of equal weights that integrate the work of a step exactly."""


class PressurePolynomial(NamedTuple):
    """Coefficients (2) of k pressures in n coordinates, without g0; k = 0 without any.

    Attributes:
        numbers: (k,) the number of each pressure among the loads, whose factor it has.
        linear: (k, n, n) G, N/m per Pa.
        quadratic: (k, c, n, n) H, the derivative of G by q_c; c = n in 3D and 0 in 2D.
    """

    numbers: Annotated[NDArray[np.int64], "k"]
    linear: Annotated[Array, "k n n"]
    quadratic: Annotated[Array, "k c n n"]


def no_pressure(n: int) -> PressurePolynomial:
    """The polynomial of a model of n coordinates without follower pressures."""
    return zeros(PressurePolynomial, k=0, c=0, n=n)


def unit_tangent(pressure: PressurePolynomial, k: int, q: Array) -> Array:
    """G + H q (n, n) of pressure k at q (n,)."""
    quadratic = pressure.quadratic[k]
    return np.asarray(pressure.linear[k] + np.tensordot(q[: len(quadratic)], quadratic, 1))


@kernel
def write_pressure_factors(
    pressure: PressurePolynomial,
    histories: LoadHistories,
    begin: float,
    end: float,
    work: Workspace,
) -> None:
    """Write the factors of the pressures at two times to the rows of work.pressure_factors."""
    for row in range(2):
        write_factors(histories, begin if row == 0 else end, work.factors)
        for k in range(pressure.numbers.size):
            work.pressure_factors[row, k] = work.factors[pressure.numbers[k]]


@kernel
def write_pressure(
    pressure: PressurePolynomial, k: int, q: Array, force: Array, tangent: Array
) -> None:
    """Write G q + 1/2 H q q (n,) and G + H q (n, n) of pressure k at q (n,)."""
    linear, quadratic = pressure.linear[k], pressure.quadratic[k]
    n = q.size
    for i in range(n):
        for j in range(n):
            tangent[i, j] = linear[i, j]
    for c in range(quadratic.shape[0]):
        factor = q[c]
        for i in range(n):
            for j in range(n):
                tangent[i, j] += factor * quadratic[c, i, j]
    for i in range(n):
        value = 0.0
        for j in range(n):
            value += 0.5 * (linear[i, j] + tangent[i, j]) * q[j]
        force[i] = value


@kernel
def subtract_pressure(
    pressure: PressurePolynomial,
    work: Workspace,
    q0: Array,
    dq: Array,
    points: Array,
    weights: Array,
) -> None:
    """Subtract the mean force of a step and its derivative from work.force and work.tangent.

    The factors in work.pressure_factors are linear along the step.
    """
    n, factors = q0.size, work.pressure_factors
    q, force, tangent = work.pressure_vectors[0], work.pressure_vectors[1], work.pressure_tangent
    for g in range(points.size):
        s, weight = points[g], weights[g]
        for i in range(n):
            q[i] = q0[i] + s * dq[i]
        for k in range(pressure.numbers.size):
            factor = weight * ((1.0 - s) * factors[0, k] + s * factors[1, k])
            if factor == 0.0:
                continue
            write_pressure(pressure, k, q, force, tangent)
            for i in range(n):
                work.force[i] -= factor * force[i]
                for j in range(n):
                    work.tangent[i, j] -= factor * s * tangent[i, j]


@kernel
def subtract_pressure_at_end(pressure: PressurePolynomial, work: Workspace, q: Array) -> None:
    """Subtract the force at q at the end of a step from work.force."""
    force, tangent = work.pressure_vectors[1], work.pressure_tangent
    for k in range(pressure.numbers.size):
        write_pressure(pressure, k, q, force, tangent)
        for i in range(q.size):
            work.force[i] -= work.pressure_factors[1, k] * force[i]


@kernel
def work_of_pressure(pressure: PressurePolynomial, work: Workspace, q0: Array, dq: Array) -> float:
    """The work, in J, of (2) without g0 along the straight line from q0 to q0 + dq."""
    n, factors, found = q0.size, work.pressure_factors, 0.0
    q, force, tangent = work.pressure_vectors[0], work.pressure_vectors[1], work.pressure_tangent
    for g in range(2):
        s = GAUSS[g]
        for i in range(n):
            q[i] = q0[i] + s * dq[i]
        for k in range(pressure.numbers.size):
            factor = 0.5 * ((1.0 - s) * factors[0, k] + s * factors[1, k])
            write_pressure(pressure, k, q, force, tangent)
            for i in range(n):
                found += factor * force[i] * dq[i]
    return found


QUADRATURE_POINTS = 5
"""Gauss points of an interval: they integrate a tenth of a period to 1e-13 of the amplitude."""

INTERVALS = 10
"""Fewest intervals of the integration in the shortest period of a load."""


def histories_of(loads: Sequence[Load], history: Array = NO_HISTORY) -> LoadHistories:
    """The time factors of loads; that of a motion of the supports is its acceleration, m/s².

    Args:
        loads: the loads.
        history: (k, 3) of the speed of rotation (`online.contact.surfaces.speed_history`).
    """
    return of_loads([load.by_acceleration() for load in loads], history)


def support_displacement(loads: Sequence[Load], time: Array, dimension: int) -> Array:
    """The displacement of the supports (k, d), m.

    A motion that is given by a periodic acceleration has no drift: its displacement is periodic
    about zero. Any other motion starts at rest at t = 0.

    Args:
        loads: loads; those that do not move the supports do not count.
        time: (k,) ascending, s.
        dimension: d.
    """
    found = np.zeros((time.size, dimension))
    for load in loads:
        if load.moves_supports:
            found += np.outer(_travel(load, time), np.array(load.direction))
    return found


def moves_supports(scene: Scene) -> bool:
    """Whether a load of the scene moves the supports."""
    return any(load.moves_supports for load in scene.loads)


def displacement_sines(loads: Sequence[Load]) -> NDArray[np.bool_]:
    """Which sines (s,) of the load histories belong to a given displacement of the supports.

    The amplitudes of these sines are accelerations, which grow with the square of the frequency.
    """
    spans = histories_of(loads).spans
    given = [isinstance(load.action, SupportDisplacement) for load in loads]
    return np.repeat(np.array(given, dtype=bool), spans[:, 1] - spans[:, 0])


def _travel(load: Load, time: Array) -> Array:
    """The displacement (k,) of the supports by one load, m."""
    size, history = load.size, load.history
    if isinstance(history, Harmonic | Harmonics):
        terms = [(1, 1.0, history.phase)] if isinstance(history, Harmonic) else history.harmonics
        omega = 2.0 * math.pi * history.frequency
        found = np.zeros_like(time)
        for order, part, phase in terms:
            wave = size * part * np.sin(order * omega * time + phase)
            given = isinstance(load.action, SupportDisplacement)
            found += wave if given else -wave / (order * omega) ** 2
        return found
    return _integrated_twice(load, time)


def _integrated_twice(load: Load, time: Array) -> Array:
    """The displacement (k,) of an acceleration that starts at rest at t = 0, m."""
    histories, end = of_loads([load]), float(time[-1])
    count = math.ceil(INTERVALS * end / shortest_period(load)) + 1
    kinks = np.array(_kinks(load))
    grid = np.unique(np.concatenate([[0.0], time, np.linspace(0.0, end, count + 1), kinks]))
    grid = grid[(grid >= 0.0) & (grid <= end)]
    lengths = np.diff(grid)
    points, doubled = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    nodes, weights = 0.5 * (points + 1.0), 0.5 * doubled  # of the interval from 0 to 1
    instants = grid[:-1, None] + lengths[:, None] * nodes
    values = np.array([factors(histories, t)[0] for t in instants.ravel()]).reshape(instants.shape)
    gained = lengths * (values @ weights)
    velocity = np.concatenate([[0.0], np.cumsum(gained)])
    moved = lengths * velocity[:-1] + lengths**2 * (values @ (weights * (1.0 - nodes)))
    return np.interp(time, grid, np.concatenate([[0.0], np.cumsum(moved)]))


def _kinks(load: Load) -> list[float]:
    """The times at which the history of a load is not smooth, s."""
    match load.history:
        case Table() as history:
            return [row[0] for row in history.rows]
        case Pulse(pulse=pulse):
            return [pulse.start, pulse.start + pulse.duration]
        case Sweep(sweep=sweep):
            return [sweep.duration]
    return []
