"""The state of a time integration before its first step, and while it runs."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.turning import times_of_angles
from fenicsrom.online.model.loads import largest
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.steady import periods_of
from fenicsrom.online.step.equilibrium import equilibrium
from fenicsrom.online.step.loop import DONE, write
from fenicsrom.online.step.scheme import Control, Scheme
from fenicsrom.online.step.state import (
    SIZE,
    STEP,
    TIME,
    Checkpoint,
    PeriodicSearch,
    Record,
    State,
    no_record,
    no_state,
)
from fenicsrom.online.step.step import measure
from fenicsrom.online.step.step_limits import landings, longest_step
from fenicsrom.progress import listening


def copied_rows(record: Record, count: int) -> Record:
    """The first rows of a record, copied."""
    return Record._make(array[:count].copy() for array in record)


def joined_rows(pieces: list[Record], counts: list[int]) -> Record:
    """The first rows of several records, joined."""
    return Record._make(
        np.concatenate([array[:count] for array, count in zip(arrays, counts, strict=True)])
        for arrays in zip(*pieces, strict=True)
    )


def last_coordinates(history: list[Record]) -> Array:
    """The coordinates (k, 3 n) of the last spans, and those at the end of the span before."""
    found: list[Array] = []
    for rows in reversed(history):
        found.insert(0, rows.coordinates)
        if rows.coordinates.shape[0] < rows.time.size:
            break
    return np.concatenate(found)


ROWS = 4096  # of a record


def initial_state(
    problem: Problem, scheme: Scheme, q: Array, v: Array, sliders: Array | None = None
) -> State:
    """The state at t = 0, with the acceleration that balances the forces.

    Args:
        problem: the problem.
        scheme: the weights of the scheme.
        q: (n,) displacement.
        v: (n,) velocity.
        sliders: (P, d) positions of the sliders; those of the points if None.
    """
    model, contacts, dimension = problem.model, problem.contacts, problem.dimension
    x = model.contact_displacement(q).reshape(-1, dimension).copy()
    state = no_state(q.size, x.shape[0], dimension)
    sliders = x.copy() if sliders is None else sliders
    at_rest(contacts, x, sliders, 0.0, state.contact, state.trial.scratch)
    zero, force = np.zeros_like(q), model.load(0.0).copy()
    state.q[:], state.v[:], state.mean_velocity[:], state.load_vector[:] = q, v, v, force
    measure(model, contacts, state)
    if not scheme.discrete_gradient:
        _, nothing = model.elastic_over_step(zero, q, zero, 0.0, np.ones(1), np.zeros(1))
        residual = state.elastic_force + scheme.damping * model.mass_times(v) - force
        if scheme.velocity_forces:
            residual += model.velocity_times(v)
        directions = state.trial.scratch.directions
        y, unit, _ = model.solve_effective(1.0, 0.0, nothing, residual, directions)
        state.a[:] = y - unit @ (state.contact.normal + state.contact.friction).reshape(-1)
        state.mean_acceleration[:] = state.a
    return state


def static_size(problem: Problem, q: Array) -> float:
    """A scale for errors: size in the mass norm of the linear response to the largest loads.

    The loads include the preload of the contacts.
    """
    model, contacts = problem.model, problem.contacts
    zero, one = np.zeros_like(q), np.ones(1)
    _, tangent = model.elastic_over_step(zero, q, zero, 0.0, one, one)
    force = np.abs(model.loads) @ largest(model.load_histories)
    preload = np.zeros((contacts.preload.size, problem.dimension))
    y, unit, _ = model.solve_effective(0.0, 0.0, tangent, -force, np.arange(preload.size))
    preload[:, 0] = contacts.preload
    return mass_norm(model, np.abs(y) + np.abs(unit) @ preload.reshape(-1))


def mass_norm(model: Any, vector: Array) -> float:
    """Size of a vector (n,) in the mass norm."""
    return float(np.sqrt(model.dot(vector, model.mass_times(vector))))


class MarchRun:
    """A time integration under way.

    Attributes:
        problem: the problem.
        plan: the weights of the scheme.
        advance: `march`, plain or compiled.
        horizon: length of a span: the period, or the whole duration, s.
        control: how the step is chosen.
        state: the last accepted state.
        record: rows for `advance`.
        done: periods that a resumed run had completed before.
        buckled: as in `Motion`.
        history: the rows of each span; the first entry is the initial state.
        seconds: run time so far, compilation excluded.
        search: what Newton's method found; None before its first attempt.
        reference: rows of the period before the start, of a run that starts in a periodic motion.
        near: start of the first attempt of Newton's method, as `integrate`.
        wearing: whether a layer was worn in the last span.
        span: number of the last span that began.
        status: of the last call of `advance`.
        steady: whether the motion is steady.
        stopped: whether `stop` ended the run.
        progress: as `integrate`.
        keep: `checkpoint` of `integrate`.
        stop: as `integrate`.
    """

    progress: Callable[[float, float], None]
    keep: Callable[[Checkpoint], None]
    stop: Callable[[], bool]

    def __init__(
        self,
        problem: Problem,
        plan: Scheme,
        advance: Callable[..., tuple[int, int]],
        start: tuple[Array, ...] | None,
        resume: Checkpoint | None,
        keep_coordinates: bool,
    ):
        """Set up the run before its first step; arguments as those of `integrate`."""
        model, contacts, settings, period = problem[:4]
        self.problem, self.plan, self.advance = problem, plan, advance
        self.horizon = float(period if period is not None else settings.duration)
        tolerance = settings.tolerance or 0.0
        step = settings.step
        if period is not None and not tolerance:
            step = period / settings.steps_per_period
        grid, history = step, model.load_histories.history
        times: Array = np.zeros(0)
        if settings.steps_per_revolution:
            angle = 2.0 * np.pi / settings.steps_per_revolution
            times = times_of_angles(history, angle, self.horizon)
            grid = step = float(np.max(np.diff(times, prepend=0.0, append=self.horizon)))
        if tolerance:  # adaptive steps must not miss a load or a surface
            longest = longest_step(model.load_histories, contacts, tolerance)
            grid = self.horizon / np.ceil(max(self.horizon / longest, 1.0))
        self.done, self.buckled = 0, 0
        self.search: PeriodicSearch | None = None
        if resume is not None:
            self.state, size = copy.deepcopy(resume.state), resume.size
            self.buckled, self.search = resume.buckled, resume.search
            self.done = resume.spans if period is not None else 0
        else:
            if start is None:
                with listening(None):  # its progress is no progress of the steps
                    q, self.buckled = equilibrium(problem)
                start = (q, np.zeros_like(q))
            self.state = initial_state(problem, plan, *start)
            self.state.scalars[STEP] = step
            if tolerance:
                first = landings(model.load_histories, contacts, 0.0, self.horizon)[0]
                self.state.scalars[STEP] = 1e-4 * min(grid, first)
            size = self.state.scalars[SIZE]
            if tolerance:
                size = max(size, static_size(problem, start[0]))
        rows, width = ROWS, 3 * self.state.q.size if keep_coordinates else 0
        if keep_coordinates and not tolerance:
            rows = min(rows, round(self.horizon / step) + 1)
        sizes = rows, self.state.contact.x.shape[0], problem.dimension, width
        self.record = no_record(*sizes, varies=history.size > 0)
        write(model, contacts, self.state, self.record, 0)
        begin = joined_rows([self.record], [1])
        if resume is not None:
            coordinates = np.repeat(begin.coordinates, resume.last.time.size, axis=0)
            begin = resume.last._replace(coordinates=coordinates)
        self.control, self.history = Control(grid, tolerance, size, times), [begin]
        self.reference: Record | None = None
        self.near: tuple[Array, ...] | None = None
        self.wearing = resume is not None and resume.wearing
        self.seconds, self.span, self.status = 0.0, self.done, DONE
        self.steady = self.stopped = False

    @property
    def found(self) -> bool:
        """Whether Newton's method has replaced the marched motion by the periodic one."""
        return self.search is not None and self.search.time is not None

    def approaching(self, before: float = 0.0) -> bool:
        """Whether a rigid surface still approached so many seconds ago."""
        times, slack = self.problem.contacts.times, 1e-9 * self.horizon
        return times.size > 1 and self.state.scalars[TIME] - before < times[-1] - slack

    @property
    def multiple(self) -> int:
        """Number of periods of the loads in one of the motion, as far as it is known."""
        return self.search.periods if self.search is not None and self.found else 1

    def stops(self, span: int) -> Array:
        """The times in s on which the steps of a span land, the last at its end."""
        begin, end = (span - 1) * self.horizon, span * self.horizon
        histories, adaptive = self.problem.model.load_histories, self.control.tolerance > 0.0
        return landings(histories, self.problem.contacts, begin, end, adaptive)

    def checkpoint(self, span: int, last: Record | None = None) -> Checkpoint:
        """The checkpoint of the run after a span."""
        if last is None:
            last = self.history[-1]
            if self.multiple > 1:
                last = periods_of(self.history, self.problem.period, self.multiple)
        return Checkpoint(
            self.state,
            last,
            float(self.control.size),
            span,
            self.buckled,
            self.search,
            self.problem.contacts.coating.worn if self.problem.contacts.coating.worn.size else None,
            self.wearing,
        )
