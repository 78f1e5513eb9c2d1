"""The peak of a response curve over a second number, and where the peak is smallest.

Friction dampers have an optimal preload: with less the contacts slip and dissipate little, with
more they stick and dissipate nothing. The peaks begin at the largest amplitude of the probe on the
curve of the scene. From the peak of one value to that of the next, only the neighbourhood of the
peak is followed (`fenicsrom.online.curves.continuation.climb`). The smallest peak is located
between the values. If its whole curve over the frequency has a larger amplitude elsewhere, this
other peak is followed, too, and the smallest of the larger ones is sought again.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from fenicsrom.assess.curves.response_problem import family_of
from fenicsrom.assess.curves.results import Optimum, ResponseCurve, response_table
from fenicsrom.assess.curves.trust import Richer, RicherModel
from fenicsrom.online.curves.continuation import Continuation, ForcedPeak, climb, follow
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.periodic.shooting import FALLBACK_STEPS, Family, Shooting
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import ask, log
from fenicsrom.scene import Scene
from fenicsrom.scene.checks.curve_checks import keys_over, values_over
from fenicsrom.scene.reading.overrides import in_words

VALUES = 24
"""Values over the whole range, in equal ratios."""
DECADE = 10.0  # ratio of both ends of the range to the value of the scene, where no range is given
HALVINGS = 5  # times the way to the next value is halved where its peak is not found from the last
MOST = 4  # peaks of one curve that are followed
LOCATED = 5e-3  # relative width of the bracket of the smallest peak
SAME = 1e-9  # relative difference of values below which they are the same
LARGER = 1e-3  # relative difference by which another motion is larger than the peak


@dataclass(frozen=True, eq=False)
class Peaks:
    """Follows the peaks of a curve that has its points over a second number.

    Attributes:
        stored: the model under the scene of the curve.
        curve: the curve; its peaks may be there in part.
        richer: a model with a richer basis, or None.
    """

    stored: StoredModel
    curve: ResponseCurve
    richer: RicherModel | None

    def follow(self) -> None:
        """Add the peaks and the optimum to the curve."""
        curve, value = self.curve, own_value(self.stored)
        top = max((p for p in curve.points if p.periods == 1), key=height)
        while True:
            if curve.peaks:
                self._over_all_values(curve.peaks[-1])
                if curve.optimum is None:
                    log.info("  the smallest peak")
                    curve.optimum = self._optimum()
                if curve.optimum.larger is None or len(curve.peaks) == MOST:
                    return
                value, top = curve.optimum.peak.value, curve.optimum.larger
            found = self._peak(value, top)
            if found is None:
                return
            curve.peaks.append([found])
            curve.optimum = None

    def _over_all_values(self, peaks: list[ForcedPeak]) -> None:
        """Follow one peak over all values, from the value of its first one to both sides."""
        over = str(response_table(self.stored.scene).peak_over)
        values = np.geomspace(*peak_range(self.stored), VALUES)
        start = peaks[0].value
        for side in (values[values > start], values[values < start][::-1]):
            for value in map(float, side):
                if all(peak.value != value for peak in peaks):
                    peak = self._reached(value, _nearest(peaks, value), HALVINGS)
                    if peak is None:
                        break
                    peaks.append(peak)
                    log.info(
                        f"  {in_words(self.stored.scene, over, value)}: peak of the probe "
                        f"{1e3 * peak.amplitude:.5g} mm at {peak.frequency:.6g} Hz"
                    )

    def _family(self, value: float, richer: RicherModel | None = None) -> Family:
        """The problems at a value, of the model or of a richer one."""
        keys = keys_over(self.stored.scene, str(response_table(self.stored.scene).peak_over))
        stored = self.stored if richer is None else richer.stored
        return family_of(stored.with_values(dict.fromkeys(keys, value)))

    def _peak(
        self, value: float, near: CurvePoint, finer: int = 1, richer: RicherModel | None = None
    ) -> ForcedPeak | None:
        """The peak at a value, from a motion near it; None if it is not found.

        Args:
            value: the value.
            near: a motion, perhaps of another value.
            finer: factor on the number of time steps.
            richer: a model with a richer basis, whose peak is found instead.
        """
        table, time = response_table(self.stored.scene), self.stored.scene.time
        steps = finer * (time.steps_per_period or FALLBACK_STEPS)
        family = self._family(value, richer)
        problem = family(near.parameter)._replace(time=time.changed(steps_per_period=steps))
        shooting = Shooting(problem)
        z = near.z if richer is None else Richer(family, richer.transfer).start(near, shooting)
        s = shooting.scaled(z)
        path = Continuation(shooting, family, table.low, table.high, s)
        start = path.at_parameter(s, near.parameter)
        top, ends = (None, ()) if start is None else climb(path, start, height)
        if top is None:
            return None
        return ForcedPeak(value, top.parameter, height(top), top, (ends[0], ends[1]))

    def _reached(self, value: float, near: ForcedPeak, halvings: int) -> ForcedPeak | None:
        """The peak at a value from that at another one, if need be by way of values between."""
        ask()
        peak = self._peak(value, near.point)
        if peak is not None or not halvings:
            return peak
        middle = self._reached(float(np.sqrt(value * near.value)), near, halvings - 1)
        return None if middle is None else self._reached(value, middle, halvings - 1)

    def _optimum(self) -> Optimum:
        """The smallest peak, located between its neighbours, with its errors."""
        best = self._smallest()
        log.info("  checking the smallest peak with half the step and a richer basis")
        others = [self._peak(best.value, best.point, finer=2), None]
        if self.richer is not None:
            others[1] = self._peak(best.value, best.point, richer=self.richer)
        errors = [
            None if peak is None else abs(peak.amplitude / best.amplitude - 1.0) for peak in others
        ]
        found = Optimum(best, errors[0], errors[1], (best.value, best.value))
        worst = max((error for error in errors if error is not None), default=0.0)
        level = best.amplitude * (1.0 + worst) / max(1.0 - worst, 0.1)
        within = tuple(_crossing(largest_peaks(self.curve.peaks), best, level))
        return replace(found, within=within, larger=self._larger(best))

    def _smallest(self) -> ForcedPeak:
        """The smallest of the largest peaks, located between its neighbours."""
        from scipy.optimize import minimize_scalar  # slow to import

        peaks = largest_peaks(self.curve.peaks)
        k = min(range(len(peaks)), key=lambda k: peaks[k].amplitude)
        best = peaks[k]
        if not 0 < k < len(peaks) - 1:
            return best
        low, high = peaks[k - 1].value, peaks[k + 1].value
        near = [[peak for peak in one if low <= peak.value <= high] for one in self.curve.peaks]

        def size(logarithm: float) -> float:
            nonlocal best
            value = float(np.exp(logarithm))
            found = [self._reached(value, _nearest(one, value), HALVINGS) for one in near if one]
            top = max((p for p in found if p is not None), key=lambda p: p.amplitude, default=None)
            if top is None:
                return max(peak.amplitude for peak in peaks)
            best = min(best, top, key=lambda peak: peak.amplitude)
            return top.amplitude

        bounds = np.log(low), np.log(high)
        minimize_scalar(size, bounds=bounds, method="bounded", options={"xatol": LOCATED})
        return best

    def _larger(self, best: ForcedPeak) -> CurvePoint | None:
        """The largest motion on the whole curve of a peak; None if it is the peak."""
        table, family = response_table(self.stored.scene), self._family(best.value)
        points = [
            point
            for direction in (1.0, -1.0)
            for point in follow(
                family,
                best.point,
                best.frequency,
                (table.low, table.high),
                direction=direction,
                points=table.points,
                locate=False,
                progress=lambda point: ask(),
            ).points
        ]
        top = max(points, key=height, default=best.point)
        return top if height(top) > (1.0 + LARGER) * best.amplitude else None


def _nearest(peaks: list[ForcedPeak], value: float) -> ForcedPeak:
    """The peak whose value has the smallest ratio to a value."""
    return min(peaks, key=lambda peak: abs(np.log(peak.value / value)))


def largest_peaks(curves: list[list[ForcedPeak]]) -> list[ForcedPeak]:
    """The largest of the peaks at each value, in the order of the values.

    The first one of each list is left out: it has a value that the other lists lack.
    """
    largest: dict[float, ForcedPeak] = {}
    for peak in (peak for peaks in curves for peak in peaks[1:]):
        known = largest.get(peak.value, peak)
        largest[peak.value] = max(known, peak, key=lambda peak: peak.amplitude)
    return [largest[value] for value in sorted(largest)]


def own_value(stored: StoredModel) -> float:
    """The value of the scene, at which the peaks begin."""
    return values_over(stored.scene, str(response_table(stored.scene).peak_over))[0]


def peak_range(stored: StoredModel) -> tuple[float, float]:
    """The smallest and the largest value."""
    own, given = own_value(stored), response_table(stored.scene).peak_range
    return (own / DECADE, own * DECADE) if given is None else (given[0], given[1])


def height(point: CurvePoint) -> float:
    """The largest amplitude of the probe in any direction, m."""
    return float(point.probe_amplitude.max())


def _crossing(peaks: list[ForcedPeak], best: ForcedPeak, level: float) -> Iterator[float]:
    """Where the peaks pass a level below and above the smallest one; the end if they do not."""
    for side in (
        [peak for peak in reversed(peaks) if peak.value < best.value],
        [peak for peak in peaks if peak.value > best.value],
    ):
        before = best
        for peak in side:
            if peak.amplitude >= level:
                share = (level - before.amplitude) / (peak.amplitude - before.amplitude)
                yield float(before.value * (peak.value / before.value) ** share)
                break
            before = peak
        else:
            yield before.value


def incomplete_peaks(
    curve: ResponseCurve, over: str, ends: tuple[float, float], scene: Scene
) -> str:
    """Why the peaks of a curve do not give the optimum; "" if they do."""
    if curve.optimum is None:
        return (
            "the peaks were not followed: the largest amplitude of the probe is at an end of the "
            "range of the frequency; choose other response.first and response.last"
        )
    largest = largest_peaks(curve.peaks)
    reached = largest[0].value, largest[-1].value
    if max(np.abs(np.log(np.array(reached) / ends))) > SAME:
        return (
            f"the peak was followed between {in_words(scene, over, *reached)} only: beyond, it was "
            "lost or left the range of the frequency; choose another response.peak_range, or a "
            "wider range of the frequency"
        )
    if curve.optimum.larger is not None:
        larger = curve.optimum.larger
        return (
            f"at {in_words(scene, over, curve.optimum.peak.value)} the peak that was followed, at "
            f"{curve.optimum.peak.frequency:.6g} Hz, is not the largest: the amplitude of the "
            f"probe is {1e3 * height(larger):.5g} mm at {larger.parameter:.6g} Hz; the smallest "
            "peak of the whole range is another one"
        )
    return ""
