"""The end of a run: Newton's method finds the periodic motion to which a march tends.

A run marches a few periods, and then tries Newton's method on the period map from the state that
the march has reached (`fenicsrom.online.periodic.shooting`). The motion that it finds replaces the
marched one if three conditions hold:

1. its relative residual is at most `fenicsrom.online.periodic.shooting.TOLERANCE`;
2. it is stable: no Floquet multiplier lies outside the unit circle;
3. the marched motion tends to it (`fenicsrom.online.periodic.tendency`).

Otherwise the march goes on, and Newton's method tries again after twice as many periods. Where the
motion of one period is not accepted, the state may repeat after m = 2, 3, .. periods: then the
motion of m periods is sought. An attempt depends on the state alone, so a resumed run equals the
uninterrupted one.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.shooting import (
    PeriodicMotion,
    Shooting,
    judged,
    solve,
    start_variables,
)
from fenicsrom.online.periodic.tendency import MarchedPath
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
    stop: Callable[[], bool] | None = None,
) -> Attempt:
    """Try Newton's method from a marched state.

    Args:
        problem: of a reduced model; its surfaces no longer approach.
        start: the marched `Checkpoint` at the start of a period.
        marched: periods marched so far.
        before: the record of the attempts before.
        fractions: instants in [0, 1] of a period on which the steps land; equal steps if not given.
        stop: asked before each period; the attempt ends when it returns True.

    Raises:
        Stopped: `stop` returned True.
    """
    search = _Search(problem.settled(), start, fractions, stop)
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
    stop: Callable[[], bool] | None = None

    def shooting(self, m: int) -> tuple[Shooting, Array]:
        """The equation of a motion of m periods, and the marched state in its variables."""
        grid = self.fractions
        if grid is not None:
            grid = np.append(0.0, (np.arange(m)[:, None] + grid[1:]).ravel())
        found = Shooting(self.problem, m, grid)
        found.stop = self.stop
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
        if self._wears(shooting, motion):
            search = search._replace(verdict="wears")
        elif self._wears(shooting, motion, NEAR_YIELD):
            search = search._replace(at_yield=True)
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
