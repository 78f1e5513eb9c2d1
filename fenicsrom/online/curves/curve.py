"""Points of a curve of periodic motions: amplitudes, harmonics, states, polynomials through them.

The largest sample of a period jumps as the crest moves between the samples. A parabola through the
largest sample and its neighbours gives a smooth amplitude, with an error of fourth order in the
step.

`bracketed` finds where a function of the points along a curve changes its sign.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.loads import AMPLITUDE, OMEGA, PHASE, LoadHistories
from fenicsrom.online.periodic.shooting import judged
from fenicsrom.online.step.state import Record


def half_range(time: Array, values: Array) -> Array:
    """Half of peak-to-peak (d,) of a periodic motion.

    Args:
        time: (rows,) ascending instants after the start of the period, the last at its end, s.
        values: (rows, d).
    """
    return np.array([0.5 * (_crest(time, column) + _crest(time, -column)) for column in values.T])


def _crest(time: Array, values: Array) -> float:
    """Largest value of the parabola through the largest sample and its neighbours."""
    rows = values.size
    k = int(np.argmax(values))
    near = np.array([k - 1, k, k + 1])
    y = values[near % rows]
    t = time[near % rows] + time[-1] * (near // rows)
    if rows < 3:
        return float(y[1])
    before, after = np.diff(y) / np.diff(t)
    curvature = (after - before) / (t[2] - t[0])
    slope = before + curvature * (t[1] - t[0])
    return float(y[1] - (0.25 * slope**2 / curvature if curvature < 0.0 else 0.0))


OPENS, SLIPS, STICKS = 1, 2, 4  # bits of the contact states that occur
_BITS = np.zeros(3, dtype=np.int64)  # by the contact state, of which -1 is the last entry
_BITS[[OPEN, SLIP, STICK]] = OPENS, SLIPS, STICKS
_SHOWN = np.array([[SLIPS | STICKS], [OPENS], [SLIPS]])  # bits that count for each of `Extremes`
NEGLIGIBLE = 1e-7  # slip below this part of the stretch of the friction spring is round-off
SMALLEST = 1e-300  # an extreme of a state that occurs is at least this, so that it has a sign


class Extremes(NamedTuple):
    """How far each of P contact points is from states that do not occur in a period.

    Each number is positive if the state occurs, negative if not, and passes zero with a kink at
    most where the state first occurs along a curve.

    Attributes:
        touch: (P,) largest trial normal force N0 - k_n gap, N.
        lift_off: (P,) largest negative trial normal force, N.
        slip: (P,) with slip, the energy dissipated by friction divided by its largest limit;
            without slip, minus the shortest distance of the friction spring from its limit, m.
    """

    touch: Array
    lift_off: Array
    slip: Array


def occurrences(
    record: Record, contacts: Contacts, drift: Array | float = 0.0
) -> tuple[NDArray[np.int64], Extremes]:
    """Which contact states occur in the rows of a period, and how far the others are.

    Slip over less than `NEGLIGIBLE` of the largest stretch of the friction spring counts as stick,
    and so does slip in one sense only, by which a slider is dragged to its place.

    Args:
        record: the rows.
        contacts: parameters of the contact points.
        drift: (P,) distance from the slider at the start of the period to that at its end, m.

    Returns:
        Bits `OPENS`, `SLIPS` and `STICKS` (P,) of the states that occur, and the `Extremes`.
    """
    bits = np.bitwise_or.reduce(_BITS[record.state], axis=0)
    limit = contacts.friction * record.force[:, :, 0]
    largest = np.max(limit, axis=0)
    stiffness = np.maximum(contacts.tangential_stiffness, SMALLEST)
    slid = np.max(record.friction_dissipation, axis=0) / np.maximum(largest, SMALLEST)
    slid = np.maximum(slid - drift, 0.0)
    rubs = (largest > 0.0) & (contacts.tangential_stiffness > 0.0)
    sticks = rubs & (slid <= NEGLIGIBLE * largest / stiffness) & ((bits & SLIPS) > 0)
    bits = np.where(sticks, (bits & ~SLIPS) | STICKS, bits)
    spare = limit - np.sqrt(np.sum(record.force[:, :, 1:] ** 2, axis=2))
    margin = np.min(spare, axis=0, initial=np.inf, where=record.state == STICK) / stiffness
    force = contacts.preload - contacts.normal_stiffness * record.gap
    occurs = (bits & _SHOWN) > 0
    slip = np.where(occurs[2], slid, -margin)
    values = np.array([np.max(force, axis=0), -np.min(force, axis=0), slip])
    signed = np.where(occurs, np.maximum(values, SMALLEST), np.minimum(values, -SMALLEST))
    return bits, Extremes(*signed)


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
    displacement, time, length = record.observed, record.time, record.time[-1]
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
        bits: (P,) which states occur, of `fenicsrom.online.curves.curve.occurrences`; the
            slip of a point that counts as sticking is stick here too.
    """
    instants = record.time[-1] * (np.arange(PHASES) + 0.5) / PHASES
    found = record.state[record.time.searchsorted(instants)]
    return np.where((found == SLIP) & ((bits & SLIPS) == 0), np.int8(STICK), found)


BIFURCATIONS = ("fold", "branch point", "period doubling", "torus", "non-smooth")
"""Kinds of special points where the stability changes; "non-smooth": the multipliers jump."""
CONTACT_CHANGES = ("touch", "lift-off", "slip")
"""Changes that a contact point makes first or last along a curve, such as "first touch"."""
LOST = "no convergence"
"""Reason for which a curve ends where no next point was found."""
OUT_OF_POINTS = "number of points"
"""Reason of the end of a curve: it has the largest number of points that it may have."""
END = "end of the range"
"""Reason for which a curve ends at a bound of its parameter."""
BACK = "back at the start of the range"
"""Reason for which a curve ends that comes back to the value of the parameter where it began."""
REPEATS = "repeats itself"
"""Reason for which a curve ends that passes its own points again, but not its first one."""
UNSURE = "unsure"
"""The stability of a motion on which time steps do not agree."""
UNJUDGED = "not judged"
"""The verdict on a motion whose stability was not asked for."""
SLACK = 1e-9
"""Relative difference of two values of the parameter that are the same."""
COMPLETE = (END, BACK, "closed", "end of the branch")
"""Reasons for which a curve ends where it is complete."""


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A periodic motion on a curve.

    Attributes:
        parameter: p.
        z: (N,) variables at the start of the period.
        s: (N,) scaled variables.
        tangent: (N + 1,) direction of the curve in (s, p).
        amplitude: (P, d) half of peak-to-peak of the contact displacement, or (1, d) of the probe
            without contact, m.
        probe_amplitude: (d,) half of peak-to-peak of the displacement of the probe, m.
        peak_force: (P,) largest normal force, N.
        friction_dissipation: energy dissipated by friction in the period, J.
        multipliers: (N,) Floquet multipliers, the largest first; none where they were not found.
        verdict: "stable", or how the stability was lost: "fold" (a real multiplier above 1),
            "period doubling" or "torus"; `UNJUDGED` where it was not asked for.
        free_sliders: number of slider components that are not unique.
        states: (P,) bits of the contact states that occur: 1 open, 2 slip, 4 stick.
        residual: relative.
        marches: number of marched periods for this point, and how many of these with derivatives.
        extremes: contact quantities whose signs tell which contact states occur.
        kind: "" of an ordinary point, else one of `BIFURCATIONS`, or "first" or "last"
            and one of `CONTACT_CHANGES`.
        contact: number of the contact point of an event of `CONTACT_CHANGES`, else -1.
        within: of a special point: width of its bracket in the parameter, in which other events may
            lie too.
        periods: number m of periods of the loads in one of the motion.
        alternation: (P d,) change of the contact displacement (of the probe without contact) from
            the start of the motion to the end of the first period of the loads, m; zero if m is 1.
        harmonics: (H, P, d) complex harmonics of the displacement, m, in phase with the load: see
            `fenicsrom.online.curves.curve.harmonics`.
        period_states: (phases, P) contact states over the period.
        damping_dissipation: energy dissipated by damping in the period, J.
        turning: (K,) multipliers of lightly damped vibrations, one of each pair: see
            `fenicsrom.online.curves.events`.
        turn_rates: (K,) derivatives of their angles by the logarithm of the period.
        period: of the motion, s.
        sense: of the tangent: 1, or -1 against `fenicsrom.online.curves.arc`'s null vector v.
        denied: the verdict of finer time steps where the stability is not known, or "".
    """

    parameter: float
    z: Array
    s: Array
    tangent: Array
    amplitude: Array
    peak_force: Array
    friction_dissipation: float
    multipliers: NDArray[np.complex128]
    verdict: str
    free_sliders: int
    states: NDArray[np.int64]
    residual: float
    marches: tuple[int, int]
    extremes: Extremes
    kind: str = ""
    contact: int = -1
    within: float = 0.0
    periods: int = 1
    alternation: Array = field(default_factory=lambda: np.zeros(0))
    harmonics: NDArray[np.complex128] = field(default_factory=lambda: np.zeros((0, 0, 0), complex))
    period_states: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    damping_dissipation: float = 0.0
    turning: NDArray[np.complex128] = field(default_factory=lambda: np.zeros(0, complex))
    turn_rates: Array = field(default_factory=lambda: np.zeros(0))
    period: float = np.nan
    sense: float = 1.0
    probe_amplitude: Array = field(default_factory=lambda: np.zeros(0))
    denied: str = ""

    @property
    def stable(self) -> bool:
        """Whether the motion is stable."""
        return self.verdict == "stable"

    @property
    def known(self) -> bool:
        """Whether the stability was judged, and finer time steps do not deny it."""
        return self.verdict != UNJUDGED and not self.denied

    @property
    def known_stability(self) -> str:
        """The verdict, or `UNSURE` where finer time steps deny it."""
        return UNSURE if self.denied else self.verdict

    @property
    def known_unstable(self) -> bool:
        """Whether the motion is known to be unstable."""
        return self.known and not self.stable

    @property
    def judged(self) -> NDArray[np.complex128]:
        """The multipliers that decide on the stability, the largest first."""
        return judged(self.multipliers, self.free_sliders)


@dataclass(eq=False)
class Curve:
    """Periodic motions along a parameter.

    Attributes:
        points: in the order in which they were found.
        special: located bifurcations and contact events.
        reason: why the continuation ended: `END`, `BACK`, `OUT_OF_POINTS`, `LOST`, `REPEATS`,
            "closed" (the curve returned to its first point), "end of the branch" (a motion of
            several periods became one of fewer) or "interrupted".
    """

    points: list[CurvePoint] = field(default_factory=list)
    special: list[CurvePoint] = field(default_factory=list)
    reason: str = ""

    def crossings(self, value: float) -> Iterator[tuple[CurvePoint, CurvePoint, Array]]:
        """Neighbours between which the parameter has a value, and s (N,) there by interpolation."""
        for a, b in pairwise(self.points):
            low, high = sorted((a.parameter, b.parameter))
            slack = SLACK * max(abs(low), abs(high))
            if low - slack <= value <= high + slack:
                share = (value - a.parameter) / ((b.parameter - a.parameter) or 1.0)
                yield a, b, a.s + share * (b.s - a.s)


def norm(vector: Array) -> float:
    """Euclidean norm of a vector, as `numpy.linalg.norm` in a quarter of its time."""
    return math.sqrt(vector @ vector)


@dataclass(eq=False)
class Piece(Curve):
    """A connected part of a curve.

    Attributes:
        points: in their order along the curve.
        special: the located bifurcations and contact events.
        reason: why it ends: as in `Curve`.
        origin: where it comes from: "march", or the kind and the parameter of the bifurcation at
            which it leaves another piece, or "isolated".
        periods: number of periods of the loads in one of the motion.
        direction: 1.0 of a piece that starts at the first value of the range, -1.0 of a piece that
            starts at the last value.
    """

    origin: str = "march"
    periods: int = 1
    direction: float = 1.0

    def in_order(self) -> list[CurvePoint]:
        """The points, with the special points where the curve passes them."""
        points = list(self.points)
        if not points:
            return points
        size = max(float(np.linalg.norm(point.s)) for point in points) or 1.0
        width = max(abs(points[-1].parameter - points[0].parameter), abs(points[0].parameter))

        def place(point: CurvePoint) -> Array:
            return np.append(point.s / size, point.parameter / width)

        for special in self.special:
            places = np.array([place(point) for point in points])
            ways = np.linalg.norm(places - place(special), axis=1)
            detours = ways[:-1] + ways[1:] - np.linalg.norm(np.diff(places, axis=0), axis=1)
            points.insert(int(np.argmin(detours)) + 1 if detours.size else 0, special)
        return points


def hermite(ya: Array, yb: Array, ta: Array, tb: Array, length: float, share: float) -> Array:
    """Cubic through two points with their tangents; a share above 1 is beyond the second point."""
    t = share
    return np.asarray(
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * ya
        + t * t * (3.0 - 2.0 * t) * yb
        + length * (t * (1.0 - t) ** 2 * ta + t * t * (t - 1.0) * tb)
    )


EVALUATIONS = 60
"""Bisection alone needs about 20."""

Point = TypeVar("Point")


class Bracket(NamedTuple, Generic[Point]):
    """Two points of a curve between which a function changes its sign.

    Attributes:
        before: the point that comes first.
        after: the other one.
        values: values of the function at both.
    """

    before: Point
    after: Point
    values: tuple[float, float]

    @property
    def nearest(self) -> Point:
        """The point at which the function is nearer to zero."""
        return self.before if abs(self.values[0]) <= abs(self.values[1]) else self.after


def bracketed(
    between: Callable[[list[Point], list[float], float], Point | None],
    test: Callable[[Point], float],
    a: Point,
    b: Point,
    length: float,
    narrow: float,
    lost: float = 0.0,
) -> Bracket[Point] | None:
    """Bracket the change of sign of a function between two points of a curve.

    The secant method keeps a distance from the ends of the bracket, so that both ends come near.
    The value at an end that stays twice is halved (Illinois), and a bracket that three evaluations
    did not halve is bisected. If the next evaluation does not halve it either, it is bisected twice
    as often before the secant method is tried again: a function that jumps needs bisections only.

    Args:
        between: gives the point of the curve at a distance from a, between two points at two
            distances; None if it is not found.
        test: the function; its signs at a and b differ. It may jump.
        a: a point.
        b: the next point.
        length: its distance from a.
        narrow: width of the final bracket.
        lost: width of a bracket that is returned as it is if it did not become narrow.

    Returns:
        The bracket; None if it is wider than both widths.
    """
    points, values, weights = [a, b], [test(a), test(b)], [1.0, 1.0]
    ends, slow, width, moved = [0.0, length], 0, length, -1
    often, left = 1, 0  # bisections of the next series, and of the present one
    for _ in range(EVALUATIONS):
        if ends[1] - ends[0] <= narrow:
            break
        low, high = (value * weight for value, weight in zip(values, weights, strict=True))
        if slow >= 3 and not left:
            left, often = often, 2 * often
        bisects = left > 0 or low == high
        if bisects:
            arc = 0.5 * (ends[0] + ends[1])
        else:
            near = 0.45 * narrow
            arc = ends[0] + (ends[1] - ends[0]) * low / (low - high)
            arc = min(max(arc, ends[0] + near), ends[1] - near)
        point = between(points, ends, arc)
        if point is None:
            break
        value = test(point)
        side = 1 if value * np.sign(values[1]) > 0.0 else 0
        points[side], values[side], ends[side] = point, value, arc
        weights[side] = 1.0
        if side == moved:
            weights[1 - side] *= 0.5
        moved = side
        left, slow = max(left - bisects, 0), slow + (not bisects)
        if ends[1] - ends[0] <= 0.5 * width:
            width = ends[1] - ends[0]
            slow = 2 if bisects else 0
    if ends[1] - ends[0] > max(narrow, lost):
        return None
    return Bracket(points[0], points[1], (values[0], values[1]))
