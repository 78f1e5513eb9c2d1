"""Time integration: one statement of the algorithm, for every model.

A one-step scheme balances weighted means of the forces over a step h, with dq = q1 - q0:

    M [(1 - am) a1 + am a0] + alpha M [(1 - af) v1 + af v0] + f_mean(q0, q1) + B F_mean
        = (1 - af) p1 + af p0                                                                   (1)
    a1 = dq/(beta h^2) - v0/(beta h) - (1/(2 beta) - 1) a0                                      (2)
    v1 = v0 + h ((1 - gamma) a0 + gamma a1)                                                     (3)

Average acceleration (am = af = 0) and generalised-alpha (Chung and Hulbert 1993) weight the elastic
and contact forces at the ends of the step. The discrete gradient (am = af = 1/2, beta = 1/4,
gamma = 1/2; Simo and Tarnow 1992, Gonzalez 1996) takes the elastic force averaged along the
straight line from q0 to q1, int_0^1 f(q0 + s dq) ds, by Gauss points that are exact for the model.
It takes the discrete gradient of the normal contact energy as the normal force. Work and energy
then balance exactly, whatever the step. The friction law is that of
`fenicsrom.online.contact.law`: it dissipates in every step. The forces D v, gyroscopic
and viscous, join those of the mass-proportional damping.

Each Newton iteration solves the structure for the residual and for unit contact forces at the
points that may touch (`fenicsrom.online.contact.problem`), and then the contact problem in full
in the few contact coordinates (`fenicsrom.online.contact.problem.solve_contact`): the iteration
over the structure meets no kink.
This iteration stops when the predicted Newton decrement |r . dq| falls below `NEWTON_TOLERANCE`
squared times the energy in the system, a test that does not depend on units. A step that does not
converge is halved.

The loop over the steps is in `fenicsrom.online.step.step`.
"""

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.online.contact.coating import worn_through
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.surfaces import times_of_angles
from fenicsrom.online.model.loads import largest
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.measures import STATE_NAMES
from fenicsrom.online.motion.motion import RESTING, Interrupted, Motion, check_scheme
from fenicsrom.online.periodic import steady
from fenicsrom.online.step.state import (
    CONTACT,
    ENERGY_SCALE,
    ITERATIONS,
    REJECTED,
    SIZE,
    STEP,
    STEPS,
    TIME,
    Checkpoint,
    Control,
    PeriodicSearch,
    Record,
    Scheme,
    State,
    copied_rows,
    joined_rows,
    no_record,
    no_state,
    scheme,
)
from fenicsrom.online.step.statics import equilibrium, mass_norm
from fenicsrom.online.step.step import (
    DONE,
    FAILED,
    FULL,
    SMALLEST_STEP,
    compiled_march,
    landings,
    longest_step,
    march,
    measure,
    write,
)
from fenicsrom.progress import Stopped, is_stopped, listening, tell, working_time


class Instant(NamedTuple):
    """Where a run is after a step. The arrays belong to the caller.

    Attributes:
        time: s.
        coordinates: (n,) q of a reduced model, or the unknowns of a full one on this rank.
        velocity: (n,) their velocity.
        displacement: (P, d) of the contact points, m.
        probe: (d,) displacement of the probe, m.
        force: (P, d) contact forces, normal and tangential, N.
        state: (P,) of the contact points: -1 open, 0 slip, 1 stick.
    """

    time: float
    coordinates: Array
    velocity: Array
    displacement: Array
    probe: Array
    force: Array
    state: NDArray[np.int8]


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
    resting = RESTING * state.scalars[CONTACT]
    state.scalars[ENERGY_SCALE] = max(state.scalars[ENERGY_SCALE], resting)
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
        stopped: whether the run was asked to stop.
        progress: as `integrate`.
        keep: `checkpoint` of `integrate`.
        look: as `integrate`.
    """

    look: Callable[[Instant], None] | None = None
    progress: Callable[[float, float], None]
    keep: Callable[[Checkpoint], None]

    def __init__(
        self,
        problem: Problem,
        plan: Scheme,
        advance: Callable[..., tuple[int, int]],
        start: tuple[Array, ...] | None,
        resume: Checkpoint | None,
        keep_coordinates: bool,
        most_rows: int = ROWS,
    ):
        """Set up the run before its first step; arguments as those of `integrate`.

        `advance` returns after each `most_rows` steps.
        """
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
        rows, width = most_rows, 3 * self.state.q.size if keep_coordinates else 0
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

    def instant(self) -> Instant:
        """Where the run is, of which the record has one row."""
        row, state = self.record, self.state
        seen = [rows[0].copy() for rows in (row.displacement, row.probe, row.force, row.state)]
        return Instant(float(row.time[0]), state.q.copy(), state.v.copy(), *seen)

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
                last = steady.periods_of(self.history, self.problem.period, self.multiple)
        worn = self.problem.contacts.coating.worn
        return Checkpoint(
            state=self.state,
            last=last,
            size=float(self.control.size),
            spans=span,
            buckled=self.buckled,
            search=self.search,
            worn=worn if worn.size else None,
            wearing=self.wearing,
        )


def integrate(
    problem: Problem,
    *,
    start: tuple[Array, ...] | None = None,
    near: tuple[Array, ...] | None = None,
    resume: Checkpoint | None = None,
    keep_coordinates: bool = False,
    compiled: bool = True,
    progress: Callable[[float, float], None] = lambda fraction, change: None,
    checkpoint: Callable[[Checkpoint], None] = lambda checkpoint: None,
    look: Callable[[Instant], None] | None = None,
) -> Motion:
    """Integrate a model to its steady state, or to the given time.

    It asks after each period, or without a period after each `ROWS` steps, and while Newton's
    method marches, whether to stop (`fenicsrom.progress.asking`).

    With `problem.time.steady` "newton", Newton's method ends the run of a compiled `ReducedModel`
    (`fenicsrom.online.periodic.steady`). It tries at once where the run begins with a given
    `start`.

    Args:
        problem: the problem.
        start: displacement and velocity (n,) at t = 0, and sliders (P, d) if they are not at the
            points; by default the run starts at rest in the equilibrium under static loads and
            preload (`fenicsrom.online.step.statics`).
        near: displacement, velocity and sliders at the start of a period of a motion that is known
            to be near the periodic one: the first attempt of Newton's method starts there instead
            of where the march is.
        resume: continue from this checkpoint; the result equals that of an uninterrupted run, bit
            for bit.
        keep_coordinates: whether to keep the coordinates of the last period.
        compiled: False runs a `ReducedModel` in plain Python, the slow twin of the compiled loop.
        progress: called after each period with the completed fraction of the run and the change
            since the last period.
        checkpoint: called with a checkpoint after each period, or without a period after each
            `ROWS` steps. Its arrays are overwritten afterwards.
        look: called after each step. The last period of a motion of Newton's method is marched;
            the periods before it, which Newton's method saves, are not seen.

    Returns:
        The motion, steady or at the end of the periods (`Motion.steady` says which); the motion of
        a resumed run starts with the last period before it was resumed.

    Raises:
        ConvergenceError: Newton's method did not converge at the smallest step; `partial` holds the
            motion up to this step.
        AccuracyError: the energy balance is off (`online.motion.motion`); `partial` holds the
            motion.
        Interrupted: the work was asked to stop; `partial` holds the motion so far.
    """
    problem = problem.with_own_wear(None if resume is None else resume.worn)
    plan = scheme(problem.time.scheme, problem.model, problem.time.spectral_radius)
    advance = compiled_march if compiled and isinstance(problem.model, ReducedModel) else march
    run = MarchRun(problem, plan, advance, start, resume, keep_coordinates, 1 if look else ROWS)
    run.near, run.progress, run.keep, run.look = near, progress, checkpoint, look
    if advance is not march:  # load before the clock starts, by a call without a step
        advance(problem.model, problem.contacts, plan, run.control, run.state, 0.0, 0.0, run.record)
    begin = working_time()
    try:
        _march_spans(run, start is not None)
    except Stopped:
        run.steady, run.stopped = False, True
    run.seconds = working_time() - begin
    motion = _motion(run)
    _require_convergence(run, motion)
    _require_layer(run, motion)
    if run.stopped:
        raise Interrupted(motion)
    check_scheme(motion, problem.time.scheme)
    return motion


def _march_spans(run: MarchRun, try_at_start: bool) -> None:
    """Run span after span until the motion is steady, fails or is stopped.

    Raises:
        Stopped: the work was asked to stop in Newton's method.
    """
    problem, settings, period = run.problem, run.problem.time, run.problem.period
    spans = settings.periods if period is not None else 1
    by_newton = run.advance is compiled_march and bool(settings.steady_tolerance)
    by_newton = by_newton and settings.steady == "newton"
    for span in range(run.done + 1, spans + 1):
        due = steady.is_due(span - 1) or (try_at_start and span == 1)
        if by_newton and not run.found and due:
            _try_newton(run, span - 1)
        q0, worn, run.span = run.state.q.copy(), problem.contacts.coating.worn.copy(), span
        _run_span(run, spans)
        run.wearing = problem.has_worn_since(worn)
        if run.status == FAILED or period is None or worn_through(problem.contacts):
            return
        change = _change(run, q0)
        changes = run.approaching(period) or run.wearing
        run.steady = change <= settings.steady_tolerance and not changes
        if run.steady and by_newton and not run.found:
            run.steady = _confirm(run, last=span == spans)
        run.progress(span / spans, change)
        run.keep(run.checkpoint(span))
        run.stopped = not run.steady and span < spans and is_stopped()
        if run.steady or run.stopped:
            return


def _change(run: MarchRun, q0: Array) -> float:
    """The relative change of the motion since the period before.

    Args:
        run: the run.
        q0: (n,) coordinates a period ago.
    """
    before = run.history[-2] if run.reference is None else run.reference
    rows = [*run.history[:-2], before, run.history[-1]]
    found = steady.change_of(rows, run.problem.period, run.multiple)
    run.reference = None
    if found <= run.problem.time.steady_tolerance and run.multiple == 1:
        # the contact points repeat; check the whole state too
        size = max(run.state.scalars[SIZE], 1e-300)
        found = max(found, mass_norm(run.problem.model, run.state.q - q0) / size)
    return found


def _run_span(run: MarchRun, spans: int) -> None:
    """Run one of so many periods, or the whole duration, and append its rows to the history."""
    model, contacts = run.problem.model, run.problem.contacts
    pieces: list[Record] = []
    counts: list[int] = []
    origin = (run.span - 1) * run.horizon
    stops = run.stops(run.span)
    for end in stops:
        run.status = FULL
        while run.status == FULL and not run.stopped:
            run.status, count = run.advance(
                model, contacts, run.plan, run.control, run.state, origin, end, run.record
            )
            pieces.append(copied_rows(run.record, count))
            counts.append(count)
            if run.look is not None and count:
                run.look(run.instant())
            tell((run.state.scalars[TIME] / run.horizon - run.done) / (spans - run.done))
            if run.problem.period is None and count:
                run.keep(run.checkpoint(0, joined_rows(pieces[-1:], [count])))
                is_over = run.status == FAILED or (run.status == DONE and end == stops[-1])
                run.stopped = not is_over and is_stopped()
        if run.status == FAILED or run.stopped:
            break
    # of the span before the last period, only the coordinates at its end are needed
    k = max(len(run.history) - run.multiple, 0)
    run.history[k] = run.history[k]._replace(coordinates=run.history[k].coordinates[-1:])
    run.history.append(pieces[0] if len(pieces) == 1 else joined_rows(pieces, counts))


def _require_convergence(run: MarchRun, motion: Motion) -> None:
    """Raise ConvergenceError if the smallest step did not converge."""
    if run.status != FAILED and np.all(np.isfinite(motion.kinetic)):
        return
    found = enumerate(run.state.contact.state)
    states = [f"point {p + 1} {STATE_NAMES[int(state)]}" for p, state in found]
    raise ConvergenceError(
        f"time integration stopped at t = {run.state.scalars[TIME]:.6g} s: no convergence with the "
        f"smallest step {SMALLEST_STEP * run.control.grid:.3g} s "
        f"({', '.join(states) or 'no contact'}; scheme {run.problem.time.scheme})",
        motion,
    )


def _require_layer(run: MarchRun, motion: Motion) -> None:
    """Raise ConvergenceError if an abradable layer is worn to its ground."""
    if worn_through(run.problem.contacts):
        raise ConvergenceError(
            "time integration stopped: an abradable layer is worn through by "
            f"t = {run.state.scalars[TIME]:.6g} s; what is below it is not part of the scene",
            motion,
            kind=ErrorKind.INSTABILITY,
        )


def _try_newton(run: MarchRun, done: int) -> None:
    """Try Newton's method after so many periods; an accepted motion replaces the marched one.

    The last row of the record becomes that of the periodic motion.

    Raises:
        Stopped: the work was asked to stop; nothing has changed.
    """
    if run.approaching() or run.wearing:
        return
    if run.search is not None and run.search.marched == done:
        return  # tried already
    problem, fractions = run.problem, None
    if problem.time.tolerance:
        fractions = steady.fractions_of(run.history[-1], problem.period)
    begin, run.near = run.near or run.checkpoint(done), None
    found = steady.attempt(problem, begin, done, run.search, fractions)
    run.search = found.search
    if found.state is None:
        return
    run.search = found.search._replace(time=float(run.state.scalars[TIME]))
    run.state = steady.continued(found.state, run.state)
    write(problem.model, problem.contacts, run.state, run.record, 0)
    last = run.history[-1]
    run.history[-1] = joined_rows([last, run.record], [last.time.size - 1, 1])
    if done == 0 and found.record is not None and found.search.periods == 1:
        run.reference = found.record._replace(time=found.record.time - problem.period)


def _confirm(run: MarchRun, *, last: bool) -> bool:
    """Whether a march that repeats is steady.

    A motion that decays slowly seems to repeat, and so does an unstable one at first. Newton's
    method decides; the march is believed where it finds no motion, or after the last period. Where
    it found a motion to which the march did not tend, the next attempt is the one that is due: each
    looks ahead over many periods, and one in every period would cost the square of their number.
    """
    if run.search is not None and run.search.verdict != "not found" and not last:
        return False
    kept = run.state, run.history[-1]
    _try_newton(run, run.span)
    if run.found and last:
        assert run.search is not None
        (run.state, run.history[-1]), run.search = kept, run.search._replace(time=None)
        return True
    return run.search is None or run.search.verdict == "not found"


def _motion(run: MarchRun) -> Motion:
    """The motion of a run that ended."""
    history, s, period = run.history, run.state.scalars, run.problem.period
    kept = last_coordinates(history) if history[-1].coordinates.size else np.zeros((0, 0))
    whole = joined_rows(
        [r._replace(coordinates=r.coordinates[:0]) for r in history], [r.time.size for r in history]
    )
    end = run.checkpoint(run.span)
    return Motion.of_rows(
        whole,
        kept,
        period=None if period is None else period * run.multiple,
        newton_from=None if run.search is None else run.search.time,
        steady=run.steady,
        periods=end.spans if period is not None else 0,
        steps=int(s[STEPS]),
        rejected=int(s[REJECTED]),
        newton_iterations=int(s[ITERATIONS]),
        seconds=run.seconds,
        end=end,
        buckled=end.buckled,
        search=run.search,
    )


def motion_of(kept: Checkpoint, period: float | None) -> Motion:
    """The motion of the last period that a checkpoint holds, of a run that was interrupted.

    Args:
        kept: the checkpoint of a run that keeps its coordinates.
        period: the period of the loads, s; None without one.
    """
    s = kept.state.scalars
    return Motion.of_rows(
        kept.last,
        kept.last.coordinates,
        period=period,
        newton_from=None,
        steady=False,
        periods=kept.spans,
        steps=int(s[STEPS]),
        rejected=int(s[REJECTED]),
        newton_iterations=int(s[ITERATIONS]),
        seconds=0.0,
        end=kept,
        buckled=kept.buckled,
        search=kept.search,
    )


def end_of(motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates and velocity (n,) and sliders (P, d) at the end of a motion."""
    assert motion.end is not None
    state = motion.end.state
    return state.q.copy(), state.v.copy(), state.contact.slider.copy()
