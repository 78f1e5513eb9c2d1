"""Speeds at which engine orders meet the modes of a rotating body.

Engine order k excites k times per revolution. A critical speed Omega is a root of

    f(Omega)^2 - (k Omega / 60)^2 = 0,   Omega in rev/min.

Without the Coriolis force f^2 is nearly linear in Omega^2 (Southwell), so a cubic spline of f^2
over Omega^2 needs few speeds. Through two speeds the spline is a line, through three speeds a
parabola. With the Coriolis force f^2 has a part that is odd in Omega, and the spline is over Omega.
The square of the engine order is a polynomial in both variables and is subtracted exactly. Every
root is then confirmed by the modes at its speed, which correct it where the spline is too coarse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError

CONFIRMED = 1e-4
"""Relative difference of frequency and engine order at which a critical speed is confirmed.

It is far below the scatter of real blades, and a spline through a usual number of speeds reaches
it at once."""

SOLUTIONS = 4
"""Largest number of speeds at which the modes are computed for one critical speed."""

LEAST_MAC = 0.5
"""A mode with a smaller MAC counts as lost."""


@dataclass(frozen=True)
class Critical:
    """A speed at which an engine order meets a mode.

    Attributes:
        mode: number of the mode, from 1.
        order: excitations per revolution.
        speed_rpm: the critical speed.
        frequency_hz: frequency of the engine order at this speed.
        computed_hz: frequency of the mode that was computed at this speed; None if this failed.
        difference: computed_hz / frequency_hz - 1; None if the computation failed.
        mac: MAC of the computed mode with the mode at the nearest speed of the diagram; None
            if the computation failed.
    """

    mode: int
    order: int
    speed_rpm: float
    frequency_hz: float
    computed_hz: float | None = None
    difference: float | None = None
    mac: float | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the mode was found at this speed with the frequency of the engine order."""
        if self.difference is None or self.mac is None:
            return False
        return abs(self.difference) <= CONFIRMED and self.mac >= LEAST_MAC


@dataclass(frozen=True, eq=False)
class FrequencyCurve:
    """The squared frequency of one mode against the speed.

    Attributes:
        speeds: (s,) speeds, at least two, ascending, rev/min.
        squares: (s,) f^2, Hz^2; negative where the mode is unstable.
        coriolis: whether the spline is over Omega instead of Omega^2.
    """

    speeds: Array
    squares: Array
    coriolis: bool

    def at(self, speeds: Array) -> Array:
        """f^2 (k,) at speeds (k,), Hz^2."""
        from scipy.interpolate import CubicSpline  # slow to import

        return np.asarray(CubicSpline(self._variable, self.squares)(self._of(speeds)))

    def with_sample(self, speed: float, square: float) -> FrequencyCurve:
        """The curve through one more point; a speed that is known already takes the new value."""
        others = self.speeds != speed
        speeds = np.append(self.speeds[others], speed)
        squares = np.append(self.squares[others], square)
        order = np.argsort(speeds)
        return replace(self, speeds=speeds[order], squares=squares[order])

    def crossings(self, order: int) -> Array:
        """The speeds above 0 and within the curve where an engine order meets it, ascending."""
        from scipy.interpolate import CubicSpline, PPoly  # slow to import

        spline, slope = CubicSpline(self._variable, self.squares), (order / 60.0) ** 2
        left = spline.x[:-1]
        powers = spline.c.copy()  # (k Omega/60)^2 about the left end of each piece is subtracted
        if self.coriolis:
            powers[-3] -= slope
            powers[-2] -= 2.0 * slope * left
            powers[-1] -= slope * left**2
        else:
            powers[-2] -= slope
            powers[-1] -= slope * left
        roots = PPoly(powers, spline.x).roots(extrapolate=False)
        roots = roots[np.isfinite(roots) & (roots > 0.0)]
        # a root where two pieces meet is found in both
        return np.unique(np.round(roots if self.coriolis else np.sqrt(roots), 9))

    @property
    def _variable(self) -> Array:
        return self._of(self.speeds)

    def _of(self, speeds: Array) -> Array:
        return speeds if self.coriolis else speeds**2


def critical_speeds(
    curves: Sequence[FrequencyCurve],
    orders: Sequence[int],
    solve: Callable[[int, float], tuple[float, float]],
    met: NDArray[np.bool_] | None = None,
    names: Sequence[str] | None = None,
) -> tuple[list[Critical], list[str]]:
    """The critical speeds of all modes and engine orders, each confirmed by the modes there.

    Args:
        curves: the frequency of each mode.
        orders: the engine orders.
        solve: computes f^2 in Hz^2 and the MAC of a mode (from 0) at a speed in rev/min.
        met: (modes, orders) whether an order excites a mode; by default all do.
        names: names of the modes; by default their numbers.

    Returns:
        The critical speeds in ascending order, and a sentence for each one that failed.
    """
    found, notes = [], []
    for mode, curve in enumerate(curves):
        for k, order in enumerate(orders):
            for speed in curve.crossings(order) if met is None or met[mode, k] else ():
                item = Critical(mode + 1, order, float(speed), order * float(speed) / 60.0)
                where = f"engine order {order} and mode {names[mode] if names else mode + 1}"
                try:
                    confirmed = confirm(curve, item, partial(solve, mode))
                except (ConvergenceError, AccuracyError) as error:
                    notes.append(f"{where} at {speed:.5g} rpm: interpolated only: {error}")
                    confirmed = item
                if confirmed is None:
                    continue
                found.append(confirmed)
                if confirmed.difference is not None and not confirmed.confirmed:
                    notes.append(
                        f"{where} at {confirmed.speed_rpm:.5g} rpm: not confirmed, the frequency "
                        f"there differs by {100 * confirmed.difference:.2g} % (MAC "
                        f"{confirmed.mac:.2f}); use speeds that are closer together"
                    )
    return sorted(found, key=lambda item: (item.speed_rpm, item.mode, item.order)), notes


def confirm(
    curve: FrequencyCurve, item: Critical, solve: Callable[[float], tuple[float, float]]
) -> Critical | None:
    """Compute the frequency at a critical speed, and correct the speed until both agree.

    Every computed frequency joins the points of the spline.

    Args:
        curve: the frequency of the mode.
        item: the critical speed of the spline.
        solve: computes f^2 in Hz^2 and the MAC of the mode at a speed in rev/min.

    Returns:
        The critical speed, the one with the smallest difference if none was confirmed; None if the
        computed frequencies show that there is no critical speed.

    Raises:
        ConvergenceError, AccuracyError: the first computation failed.
    """
    best: Critical | None = None
    for _ in range(SOLUTIONS):
        square, mac = solve(item.speed_rpm)
        computed = float(np.sqrt(max(square, 0.0)))
        difference = computed / item.frequency_hz - 1.0
        item = replace(item, computed_hz=computed, difference=difference, mac=mac)
        if item.confirmed or mac < LEAST_MAC:
            return item
        if best is None or best.difference is None or abs(difference) < abs(best.difference):
            best = item
        curve = curve.with_sample(item.speed_rpm, square)
        speeds = curve.crossings(item.order)
        if not speeds.size:
            return None
        speed = float(speeds[np.argmin(np.abs(speeds - item.speed_rpm))])
        item = replace(item, speed_rpm=speed, frequency_hz=item.order * speed / 60.0)
    return best
