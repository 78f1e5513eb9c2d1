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
points that may touch (`fenicsrom.online.contact.candidates`), and then the contact problem in full
in the few contact coordinates (`fenicsrom.online.contact.problem.solve_contact`): the iteration
over the structure meets no kink.
This iteration stops when the predicted Newton decrement |r . dq| falls below `NEWTON_TOLERANCE`
squared times the energy in the system, a test that does not depend on units. A step that does not
converge is halved.

The loop over the steps is in `fenicsrom.online.step.loop`, and the state before the first step in
`fenicsrom.online.run.march_setup`.
"""

from collections.abc import Callable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.online.contact.rings import worn_through
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.motion.energy import check_scheme
from fenicsrom.online.motion.measures import STATE_NAMES
from fenicsrom.online.motion.motion import Interrupted, Motion
from fenicsrom.online.periodic.shooting import Stopped
from fenicsrom.online.periodic.steady import attempt, change_of, continued, fractions_of, is_due
from fenicsrom.online.run.march_setup import (
    MarchRun,
    copied_rows,
    joined_rows,
    last_coordinates,
    mass_norm,
)
from fenicsrom.online.step.loop import (
    DONE,
    FAILED,
    FULL,
    SMALLEST_STEP,
    compiled_march,
    march,
    write,
)
from fenicsrom.online.step.scheme import scheme
from fenicsrom.online.step.state import ITERATIONS, REJECTED, SIZE, STEPS, TIME, Checkpoint, Record
from fenicsrom.progress import tell, working_time


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
    stop: Callable[[], bool] = lambda: False,
) -> Motion:
    """Integrate a model to its steady state, or to the given time.

    With `problem.time.steady` "newton", Newton's method ends the run of a compiled `ReducedModel`
    (`fenicsrom.online.periodic.steady`). It tries at once where the run begins with a given
    `start`.

    Args:
        problem: the problem.
        start: displacement and velocity (n,) at t = 0, and sliders (P, d) if they are not at the
            points; by default the run starts at rest in the equilibrium under static loads and
            preload (`fenicsrom.online.step.equilibrium`).
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
        stop: called at the same instants, and while Newton's method marches; the run ends when it
            returns True.

    Returns:
        The motion, steady or at the end of the periods (`Motion.steady` says which); the motion of
        a resumed run starts with the last period before it was resumed.

    Raises:
        ConvergenceError: Newton's method did not converge at the smallest step; `partial` holds the
            motion up to this step.
        AccuracyError: the energy balance is off (`online.motion.energy`); `partial` holds the
            motion.
        Interrupted: `stop` returned True; `partial` holds the motion so far.
    """
    problem = problem.with_own_wear(None if resume is None else resume.worn)
    plan = scheme(problem.time.scheme, problem.model, problem.time.spectral_radius)
    advance = compiled_march if compiled and isinstance(problem.model, ReducedModel) else march
    run = MarchRun(problem, plan, advance, start, resume, keep_coordinates)
    run.near, run.progress, run.keep, run.stop = near, progress, checkpoint, stop
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
        Stopped: `run.stop` returned True in Newton's method.
    """
    problem, settings, period = run.problem, run.problem.time, run.problem.period
    spans = settings.periods if period is not None else 1
    by_newton = run.advance is compiled_march and bool(settings.steady_tolerance)
    by_newton = by_newton and settings.steady == "newton"
    for span in range(run.done + 1, spans + 1):
        due = is_due(span - 1) or (try_at_start and span == 1)
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
        run.stopped = not run.steady and span < spans and run.stop()
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
    found = change_of(rows, run.problem.period, run.multiple)
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
            tell((run.state.scalars[TIME] / run.horizon - run.done) / (spans - run.done))
            if run.problem.period is None and count:
                run.keep(run.checkpoint(0, joined_rows(pieces[-1:], [count])))
                is_over = run.status == FAILED or (run.status == DONE and end == stops[-1])
                run.stopped = not is_over and run.stop()
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
        Stopped: `run.stop` returned True; nothing has changed.
    """
    if run.approaching() or run.wearing:
        return
    if run.search is not None and run.search.marched == done:
        return  # tried already
    problem, fractions = run.problem, None
    if problem.time.tolerance:
        fractions = fractions_of(run.history[-1], problem.period)
    begin, run.near = run.near or run.checkpoint(done), None
    found = attempt(problem, begin, done, run.search, fractions, run.stop)
    run.search = found.search
    if found.state is None:
        return
    run.search = found.search._replace(time=float(run.state.scalars[TIME]))
    run.state = continued(found.state, run.state)
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


def end_of(motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates and velocity (n,) and sliders (P, d) at the end of a motion."""
    assert motion.end is not None
    state = motion.end.state
    return state.q.copy(), state.v.copy(), state.contact.slider.copy()
