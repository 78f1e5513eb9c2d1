"""The end of a run: Newton's method finds the periodic motion to which a march tends.

A run marches a few periods, and then tries Newton's method on the period map from the state that
the march has reached (`fenicsrom.online.periodic.shooting`). The motion that it finds replaces the
marched one if three conditions hold:

1. its relative residual is at most `fenicsrom.online.periodic.shooting.TOLERANCE`;
2. it is stable: no Floquet multiplier lies outside the unit circle;
3. the marched motion tends to it.

Otherwise the march goes on, and Newton's method tries again after twice as many periods. Where the
motion of one period is not accepted, the state may repeat after m = 2, 3, .. periods: then the
motion of m periods is sought. An attempt depends on the state alone, so a resumed run equals the
uninterrupted one.

Whether a march tends to a periodic motion.

Let z be a state of the march, P the period map, z* the periodic motion, d = z - z* and A the
monodromy matrix. The march tends to the motion if it stays near the linear motion about it,

    |P^k(z) - z* - A^k d| <= NEAR |A^k d|,   k = 1, 2, .., K                                    (1)

in the scaled norm of `fenicsrom.online.periodic.shooting.Shooting`, or if |d| is below `CLOSE` of
the motion. The first states of a march may be too far from z*, so (1) is tried from each of them.

The march ends after a number of periods, which is doubled while it comes nearer to z* at a part
`APPROACH` of the rate of the largest multiplier: from afar, where (1) does not hold yet, contacts
that open and close may keep the motion large for hundreds of periods.

K periods show whether the slow motions are linear: each part of d with a multiplier mu must have
turned `TURNS` times about the periodic motion, or must have decayed to `DECAYED` of itself. One
period would not be enough: a lightly damped motion changes so little in a period that any d
passes. What (1) misses grows at most with k^2, so k < K periods are enough where it misses only
NEAR (k/K)^2. A system with several stable motions thus ends in the same one as the march.
"""

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import (
    STABLE_WITHIN,
    PeriodicMotion,
    Shooting,
    judged,
    largest_multiplier,
    solve,
    start_variables,
)
from fenicsrom.online.step.state import (
    DAMPING_DISSIPATION,
    ENERGY_SCALE,
    FRICTION_DISSIPATION,
    ITERATIONS,
    REJECTED,
    SIZE,
    STEP,
    STEPS,
    TIME,
    WORK,
    PeriodicSearch,
    Record,
    State,
)
from fenicsrom.progress import log, working_time

# Part of |A^k d| that (1) may miss. The linear map A then describes the march to 30 %: z is in the
# region where the periodic motion attracts, not only near the border to another motion.
NEAR = 0.3
CLOSE = 1e-6  # |d| relative to the motion, below which rounding decides about (1)
# Around another motion, or around none, the frequency depends on the amplitude and the phase: the
# march leaves the linear motion within a turn or two. A part that does not turn must decay.
TURNS = 2.0
DECAYED = 0.1
SIGNIFICANT = 0.01  # parts of d below this part of |d| do not count
APPROACH = 0.1  # a motion that does not settle would have to come as near by chance
# Change of the state in a period, relative to the state, below which Newton's method starts: where
# the contacts still change from period to period, it needs many iterations.
CALM = 1e-2

TOLD = 5.0
"""Time after which a long march is told again, s."""


class MarchedPath:
    """The states that a march reaches, each a period of the sought motion after the one before.

    Attributes:
        shooting: the equation of this motion.
        states: scaled variables after 0, 1, 2, .. periods, as far as they were marched.
    """

    def __init__(self, shooting: Shooting, s: Array):
        """Start at the scaled variables s."""
        self.shooting, self.states = shooting, [s]

    def reaches(self, k: int) -> bool:
        """March to the state after k periods; return whether no step failed."""
        while len(self.states) <= k:
            found = self.shooting.march(self.states[-1], derive=False)
            if found is None:
                return False
            self.states.append(self.states[-1] + found[0])
        return True

    def calm_state(self, periods: int) -> Array:
        """The first state that changed by at most `CALM` in a period, or that after `periods`.

        Where a step fails, it is the last state before.
        """
        for k in range(1, periods + 1):
            if not self.reaches(k):
                break
            change = np.linalg.norm(self.states[k] - self.states[k - 1])
            if change <= CALM * np.linalg.norm(self.states[k]):
                return self.states[k]
        return self.states[-1]

    def distances(self, motion: PeriodicMotion) -> Array:
        """Distances of the states from a motion, relative to it."""
        found = self.shooting.scaled(motion.z)
        return np.linalg.norm(np.array(self.states) - found, axis=1) / np.linalg.norm(found)

    def comes_nearer(self, motion: PeriodicMotion) -> bool:
        """Whether a motion is stable, and the later half of the states nearer to it.

        The median distance must have fallen at `APPROACH` of the rate of the largest multiplier.
        """
        earlier, later = np.array_split(self.distances(motion), 2)
        rate = abs(largest_multiplier(motion.multipliers, motion.free_sliders))
        return motion.stable and bool(
            np.median(later) <= rate ** (APPROACH * earlier.size) * np.median(earlier)
        )

    def tends_to(self, motion: PeriodicMotion, periods: int, longest: int = 0) -> bool:
        """Whether the path tends to a motion by (1).

        Args:
            motion: the motion.
            periods: number of its periods within which (1) must be shown. The number is doubled
                while the path comes nearer to the motion.
            longest: largest number of periods; by default it is not doubled.
        """
        found = self.shooting.scaled(motion.z)
        size = float(np.linalg.norm(found))
        matrix = self.shooting.scaled_matrix(motion.end.matrix)
        horizon_of = horizon_by_distance(matrix)
        # A^k d, k and K of the states from which (1) may still hold
        linear: Array = np.zeros((found.size, 0))
        ages: Array = np.zeros(0)
        horizons: Array = np.zeros(0)
        told = working_time()
        for k in range(max(periods, longest)):
            if working_time() - told > TOLD:
                told, most = working_time(), max(periods, longest)
                away = np.linalg.norm(self.states[k] - found) / size
                log.info(f"  period {k} of at most {most}, {away:.2g} from the periodic motion ..")
            if k == periods:
                if not self.comes_nearer(motion):
                    return False
                periods *= 2
            d = self.states[k] - found
            if float(np.linalg.norm(d)) <= CLOSE * size:
                return True
            if not self.reaches(k + 1):
                return False
            linear = matrix @ np.column_stack([linear, d])
            ages = np.append(ages, 0.0) + 1.0
            horizons = np.append(horizons, horizon_of(d))
            off = (self.states[k + 1] - found)[:, None] - linear
            miss = np.linalg.norm(off, axis=0) / np.linalg.norm(linear, axis=0)
            if np.any(miss <= NEAR * np.minimum(1.0, ages / horizons) ** 2):
                return True
            near = miss <= NEAR
            linear, ages, horizons = linear[:, near], ages[near], horizons[near]
        return False


def horizon_by_distance(matrix: Array) -> Callable[[Array], int]:
    """The number K of periods in (1) by the distance d (N,), for a monodromy matrix (N, N).

    d is split into eigenvectors of the matrix. A part with the multiplier mu turns by arg(mu) and
    shrinks to |mu| in a period. A multiplier 1, that of a slider that is not unique, needs nothing.
    """
    multipliers, vectors = np.linalg.eig(matrix)
    inverse = np.linalg.pinv(vectors, rcond=multipliers.size * np.finfo(float).eps)
    with np.errstate(divide="ignore"):
        turns = TURNS * 2.0 * np.pi / np.abs(np.angle(multipliers))
        decay = np.log(DECAYED) / np.log(np.minimum(np.abs(multipliers), 1.0 - 1e-12))
    periods = np.minimum(turns, np.maximum(decay, 1.0))
    periods[np.abs(multipliers - 1.0) <= STABLE_WITHIN] = 1.0

    def horizon(d: Array) -> int:
        parts = np.abs(inverse @ d)
        return int(np.ceil(np.max(periods[parts > SIGNIFICANT * np.linalg.norm(d)], initial=1.0)))

    return horizon


FIRST_ATTEMPT = 5  # marched periods before the first attempt; each further attempt doubles them
LARGEST_MULTIPLE = 8  # periods of the loads in one of a subharmonic motion that is looked for
RECURRENCE = 0.2  # |P^m(z) - z| relative to |P(z) - z|, below which the state repeats after m
GENUINE = 1e-6  # relative |P(z*) - z*| above which a motion of m periods is not one of 1 period
LOOK_AHEAD = 160  # least number of periods in which (1) must be shown
LOOK_AHEAD_PART = 2  # or so many times the periods that were marched, if they are more
LONGEST_LOOK_AHEAD = 16  # times these periods, while the march comes nearer to the motion
NEAR_YIELD = 1e-6  # part of the yield stress that a motion at yield lacks at most
KEPT_MULTIPLIERS = 6  # in the record, without those of free sliders


@dataclass(frozen=True, eq=False)
class Attempt:
    """What an attempt found.

    Attributes:
        search: the record for the user.
        state: the state of the periodic motion at the start of a period, if it was accepted. Time,
            step and sums are those of the map: `continued` sets them.
        record: rows of the period that the map ended with, likewise.
    """

    search: PeriodicSearch
    state: State | None = None
    record: Record | None = None


def is_due(periods: int) -> bool:
    """Whether a march tries Newton's method after so many periods: 5, 10, 20, 40, ..."""
    ratio = periods // FIRST_ATTEMPT
    return periods > 0 and periods % FIRST_ATTEMPT == 0 and ratio & (ratio - 1) == 0


def attempt(
    problem: Problem,
    start: Any,
    marched: int,
    before: PeriodicSearch | None = None,
    fractions: Array | None = None,
) -> Attempt:
    """Try Newton's method from a marched state.

    Args:
        problem: of a reduced model; its surfaces no longer approach.
        start: the marched `Checkpoint` at the start of a period.
        marched: periods marched so far.
        before: the record of the attempts before.
        fractions: instants in [0, 1] of a period on which the steps land; equal steps if not given.

    Raises:
        Stopped: the work was asked to stop.
    """
    search = _Search(problem.settled(), start, fractions)
    iterations = before.iterations if before is not None else 0
    best: Attempt | None = None
    multiples = [1]
    while multiples:
        m = multiples.pop(0)
        found = search.attempt(m, marched, iterations)
        iterations = found.search.iterations
        if best is None or found.search.accepted:
            best = found
        if found.search.accepted:
            break
        if m == 1:
            multiples = search.recurrences()
        if found.search.verdict == "period doubling" and 2 * m <= LARGEST_MULTIPLE:
            multiples = [2 * m, *(k for k in multiples if k != 2 * m)]
    assert best is not None
    return replace(best, search=best.search._replace(iterations=iterations))


@dataclass(frozen=True, eq=False)
class _Search:
    """The attempts from one marched state; attributes as the arguments of `attempt`."""

    problem: Problem
    start: Any
    fractions: Array | None

    def shooting(self, m: int) -> tuple[Shooting, Array]:
        """The equation of a motion of m periods, and the marched state in its variables."""
        grid = self.fractions
        if grid is not None:
            grid = np.append(0.0, (np.arange(m)[:, None] + grid[1:]).ravel())
        found = Shooting(self.problem, m, grid)
        return found, found.scaled(start_variables(found, self.start))

    @cached_property
    def path(self) -> MarchedPath:
        """The march from the marched state, period by period."""
        return MarchedPath(*self.shooting(1))

    def recurrences(self) -> list[int]:
        """The first number of periods after which the state nearly repeats, if there is one."""
        if not self.path.reaches(LARGEST_MULTIPLE):
            return []
        states = self.path.states
        gaps = [float(np.linalg.norm(s - states[0])) for s in states[1 : LARGEST_MULTIPLE + 1]]
        repeats = (m for m in range(2, len(gaps) + 1) if gaps[m - 1] <= RECURRENCE * gaps[0])
        return list(itertools.islice(repeats, 1))

    def attempt(self, m: int, marched: int, iterations: int) -> Attempt:
        """Look for a motion of m periods."""
        path = self.path if m == 1 else MarchedPath(*self.shooting(m))
        shooting, s = path.shooting, path.calm_state(LARGEST_MULTIPLE if m == 1 else 0)
        search = PeriodicSearch(
            verdict="not found",
            tends=False,
            time=None,
            periods=m,
            marched=marched,
            iterations=iterations + 1,
            residual=np.inf,
            multipliers=np.zeros(0, dtype=np.complex128),
            free_sliders=0,
        )
        ahead = shooting.march(s)
        if ahead is None:
            return Attempt(search)
        if s is path.states[-1]:
            path.states.append(s + ahead[0])
        try:
            motion = solve(shooting, s, found=ahead)
        except ConvergenceError as error:
            residuals = error.partial
            count = iterations + len(residuals)
            return Attempt(search._replace(iterations=count, residual=residuals[-1]))
        state = copy.deepcopy(shooting.map.state)
        search = search._replace(
            verdict=motion.verdict,
            tends=self._tends(path, motion, marched),
            iterations=iterations + len(motion.residuals),
            residual=float(motion.residuals[-1]),
            multipliers=judged(motion.multipliers, motion.free_sliders)[:KEPT_MULTIPLIERS],
            free_sliders=motion.free_sliders,
        )
        if not search.tends and path.comes_nearer(motion):
            search = search._replace(away=float(path.distances(motion)[0]))
        if self._wears(shooting, motion, NEAR_YIELD):
            worn = self._wears(shooting, motion)
            verdict = "wears" if worn else search.verdict
            search = search._replace(verdict=verdict, at_yield=not worn)
        return Attempt(search, state, motion.record) if search.accepted else Attempt(search)

    def _tends(self, path: MarchedPath, motion: PeriodicMotion, marched: int) -> bool:
        """Whether the march along a path tends to a motion, which lasts the periods of the path."""
        m = path.shooting.m
        if m > 1 and not self._lasts_several_periods(path.shooting.scaled(motion.z)):
            return False
        periods = max(LOOK_AHEAD, LOOK_AHEAD_PART * marched) // m
        return path.tends_to(motion, periods, LONGEST_LOOK_AHEAD * periods)

    def _wears(self, shooting: Shooting, motion: PeriodicMotion, weaker: float = 0.0) -> bool:
        """Whether a motion, found with layers that stay as they are, would wear them.

        What does not wear a weaker layer does not wear the layer either.

        Args:
            shooting: the equation of the motion.
            motion: the motion.
            weaker: part by which the yield stress is reduced.
        """
        problem = self.problem.with_own_wear().with_yield(1.0 - weaker)
        worn = problem.contacts.coating.worn.copy()
        if worn.size:
            shooting.map(problem, motion.z, derive=False)
        return problem.has_worn_since(worn)

    def _lasts_several_periods(self, s: Array) -> bool:
        """Whether a motion of several periods does not repeat after one already."""
        one, _ = self.shooting(1)
        ahead = one.march(s, derive=False)
        return ahead is not None and bool(np.linalg.norm(ahead[0]) > GENUINE * np.linalg.norm(s))


def continued(state: State, marched: State) -> State:
    """The periodic state in place of the marched one: its time, step and sums go on.

    Args:
        state: as `Attempt.state`; it is changed.
        marched: the last state of the march.
    """
    for k in (TIME, STEP, WORK, DAMPING_DISSIPATION, FRICTION_DISSIPATION):
        state.scalars[k] = marched.scalars[k]
    for k in (STEPS, REJECTED, ITERATIONS):
        state.scalars[k] = marched.scalars[k]
    for k in (SIZE, ENERGY_SCALE):
        state.scalars[k] = max(state.scalars[k], marched.scalars[k])
    state.friction_dissipation[:] = marched.friction_dissipation
    return state


def fractions_of(rows: Record, period: float) -> Array | None:
    """The instants in [0, 1] of the last period on which its steps landed; None without steps."""
    if rows.time.size < 2:
        return None
    inside = rows.time[:-1] - (rows.time[-1] - period)
    inside = inside[inside > 1e-9 * period] / period
    return np.concatenate([[0.0], inside, [1.0]])


def periods_of(history: Sequence[Record], period: float, count: int, back: int = 0) -> Record:
    """The rows of the `count` periods that ended `back` periods before the end of a history."""
    history = history[-(count + back + 1) :]
    rows = Record._make(
        np.concatenate(arrays)
        for arrays in zip(
            *(r._replace(coordinates=r.coordinates[:0]) for r in history), strict=True
        )
    )
    end = rows.time[-1] - back * period
    slack = 1e-9 * period
    part = (rows.time > end - count * period + slack) & (rows.time <= end + slack)
    return Record._make(
        array[part] if name != "coordinates" else array for name, array in rows._asdict().items()
    )


def change_of(history: Sequence[Record], period: float, multiple: int = 1) -> float:
    """Change of the contact (or probe) displacement from a period ago, relative to the largest.

    Args:
        history: the rows of each period of the loads; the first entry may hold several.
        period: period of the loads, s.
        multiple: number of periods of the loads in one of the motion.
    """
    before, after = history[-2], history[-1]
    if multiple > 1:
        after = periods_of(history, period, multiple)
        before = periods_of(history, period, multiple, back=multiple)
        period *= multiple
    if before.time.size < 2 or before.time[0] > after.time[0] - 0.5 * period:
        return np.inf  # less than a whole period is known
    was: Array = before.displacement.reshape(before.time.size, -1)
    now: Array = after.displacement.reshape(after.time.size, -1)
    if now.shape[1] == 0:
        was, now = before.probe, after.probe
    if (
        now.shape == was.shape
        and np.max(np.abs(after.time - period - before.time)) <= 1e-9 * period
    ):
        there = was
    else:  # other steps in the two periods: a cubic spline is accurate enough
        from scipy.interpolate import CubicSpline  # slow to import

        there = CubicSpline(before.time, was)(
            np.clip(after.time - period, before.time[0], before.time[-1])
        )
    return float(np.max(np.abs(now - there)) / max(np.max(np.abs(now)), 1e-300))
