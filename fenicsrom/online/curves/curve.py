"""Points of a curve of periodic motions, and polynomials through them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.curves.contact_events import Extremes
from fenicsrom.online.periodic.shooting import judged

BIFURCATIONS = ("fold", "branch point", "period doubling", "torus", "non-smooth")
"""Kinds of special points where the stability changes; "non-smooth": the multipliers jump."""
CONTACT_CHANGES = ("touch", "lift-off", "slip")
CONTACT_EVENTS = tuple(f"{end} {what}" for what in CONTACT_CHANGES for end in ("first", "last"))
"""Kinds of special points where a contact state first or last occurs along a curve."""
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
"""The stability of a motion on which two time steps do not agree."""
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
        multipliers: (N,) Floquet multipliers, the largest first.
        verdict: "stable", or how the stability was lost: "fold" (a real multiplier above 1),
            "period doubling" or "torus".
        free_sliders: number of slider components that are not unique.
        states: (P,) bits of the contact states that occur: 1 open, 2 slip, 4 stick.
        residual: relative.
        marches: number of marched periods for this point, and how many of these with derivatives.
        extremes: contact quantities whose signs tell which contact states occur.
        kind: "" of an ordinary point, else one of `BIFURCATIONS` or `CONTACT_EVENTS`.
        contact: number of the contact point of an event of `CONTACT_EVENTS`, else -1.
        within: of a special point: width of its bracket in the parameter, in which other events may
            lie too.
        periods: number m of periods of the loads in one of the motion.
        alternation: (P d,) change of the contact displacement (of the probe without contact) from
            the start of the motion to the end of the first period of the loads, m; zero if m is 1.
        harmonics: (H, P, d) complex harmonics of the displacement, m, in phase with the load: see
            `fenicsrom.online.curves.curve_measures.harmonics`.
        period_states: (phases, P) contact states over the period.
        damping_dissipation: energy dissipated by damping in the period, J.
        turning: (K,) multipliers of lightly damped vibrations, one of each pair: see
            `fenicsrom.online.curves.turning_pairs`.
        turn_rates: (K,) derivatives of their angles by the logarithm of the period.
        period: of the motion, s.
        sense: of the tangent: 1, or -1 against `fenicsrom.online.curves.arc`'s null vector v.
        denied: the verdict of half the time step if this step finds another stability, or "".
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
    def known_stability(self) -> str:
        """The verdict, or `UNSURE` where half the time step denies it."""
        return UNSURE if self.denied else self.verdict

    @property
    def known_unstable(self) -> bool:
        """Whether the motion is unstable, and half the time step does not deny it."""
        return not self.stable and not self.denied

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


def hermite(ya: Array, yb: Array, ta: Array, tb: Array, length: float, share: float) -> Array:
    """Cubic through two points with their tangents; a share above 1 is beyond the second point."""
    t = share
    return np.asarray(
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * ya
        + t * t * (3.0 - 2.0 * t) * yb
        + length * (t * (1.0 - t) ** 2 * ta + t * t * (t - 1.0) * tb)
    )
