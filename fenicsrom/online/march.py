"""Time integration: one statement of the algorithm, for every model.

A one-step scheme balances weighted means of the forces over a step h, with dq = q1 - q0:

    M [(1 - am) a1 + am a0] + alpha M [(1 - af) v1 + af v0] + f_mean(q0, q1) + B F_mean = (1 - af)
    p1 + af p0 a1 = dq/(beta h^2) - v0/(beta h) - (1/(2 beta) - 1) a0,    v1 = v0 + h ((1 - gamma)
    a0 + gamma a1)

average acceleration (am = af = 0) and generalised-alpha weigh the elastic and contact forces at the
ends of the step; the discrete gradient (am = af = 1/2, beta = 1/4, gamma = 1/2) takes the elastic
force averaged along the straight line from q0 to q1, int_0^1 f(q0 + s dq) ds by Gauss points that
are exact for the model, and the discrete gradient of the normal contact energy: work and energy
then balance exactly, whatever the step. Friction is that of `fenicsrom.contact`: it dissipates in
every step. Where the model turns, its gyroscopic forces Gamma v join those of damping.

Each Newton iteration solves the structure for the residual and for unit contact forces, and then
the contact problem exactly in the few contact coordinates (`fenicsrom.online.contact_problem.resolve`): the
iteration over the structure sees no kink. It stops when the Newton decrement |r . dq| to come falls
below `NEWTON_TOLERANCE` squared times the energy in the system, a test that means the same in any
units. A step that does not converge is halved.

`march` below is plain Python. Run as it stands, it integrates any object with the methods of
`Model`; compiled by numba, it integrates a `ReducedModel`, for which the same operations are the
compiled functions of `fenicsrom.reduced`.
"""

from __future__ import annotations

import copy
import time as clock
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import register_jitable
from scipy.interpolate import CubicSpline

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.compiled import compiled
from fenicsrom.online.contact_step import at_rest
from fenicsrom.online.energy import check_scheme
from fenicsrom.online.equilibrium import equilibrium
from fenicsrom.online.load_histories import instants, largest, quarter_period
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.online.operations import (
    borrowed,
    combine,
    contact_displacement,
    dot,
    elastic_over_step,
    gyroscopic_times,
    load,
    mass_times,
    probe_displacement,
    responses,
)
from fenicsrom.online.scheme import Control, Scheme, scheme
from fenicsrom.online.state import (
    ITERATIONS,
    LAST,
    REJECTED,
    SIZE,
    STEP,
    STEPS,
    TIME,
    WORK,
    Checkpoint,
    Record,
    State,
    no_record,
    no_state,
)
from fenicsrom.online.step import accept, attempt, extrapolate, inertia_of, measure
from fenicsrom.online.surfaces import Contacts, penetration

STEP_SHARE = 0.01  # of the tolerance that one adaptive step may spend
SMALLEST_STEP = 1e-6  # of the nominal step; smaller ones end the run

DONE, FULL, FAILED = 0, 1, 2


@register_jitable(inline="always")
def write(model, contacts, state, record, row):  # type: ignore[no-untyped-def]
    """Keep the state as a row of the record."""
    s = state.scalars
    record.time[row] = s[TIME]
    touch = state.touch
    points, d = touch.x.shape
    if points == 0:
        record.probe[row] = probe_displacement(model, state.q)
    for p in range(points):
        record.state[row, p] = touch.state[p]
        record.friction_dissipation[row, p] = state.friction_dissipation[p]
        record.gap[row, p] = -penetration(contacts, p, touch.x[p], s[TIME])
        # the frame of the point, turned the shortest way so that its first axis is the current
        # normal
        size = 0.0
        for k in range(d):
            size += touch.normal[p, k] ** 2
        size = np.sqrt(size)
        lean = touch.friction[p, 0] / (size + touch.normal[p, 0]) if size > 0.0 else 0.0
        record.force[row, p, 0] = max(touch.raw[p], 0.0)
        for k in range(d):
            record.displacement[row, p, k] = touch.x[p, k]
            record.mean_force[row, p, k] = state.trial.room.mean[p, k]
            if k > 0:
                record.force[row, p, k] = touch.friction[p, k] - lean * touch.normal[p, k]
    for k in range(6):
        record.energies[row, k] = s[WORK + k]
    if record.coordinates.shape[1] > 0:
        n = state.q.size
        record.coordinates[row, :n] = state.q
        record.coordinates[row, n : 2 * n] = state.v
        record.coordinates[row, 2 * n :] = state.a


def march(model, contacts, scheme, control, state, origin, end, record):  # type: ignore[no-untyped-def]
    """Advance the state from its time to `end`, keeping a row of the record for each accepted step.

    Args:
        model: what is integrated: a `Model`, or (compiled) a `ReducedModel`.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        control: how the step is chosen.
        state: where to start; holds the end on return.
        origin: where the grid of times starts, s.
        end: when to stop, s.
        record: room for the rows.

    Returns:
        (status, rows written): DONE, FULL (the record is: call again), or FAILED (the smallest step
        did not converge).
    """
    model, contacts, scheme = borrowed(model), borrowed(contacts), borrowed(scheme)
    state, record = borrowed(state), borrowed(record)
    s = state.scalars
    rows = 0
    slack = 1e-9 * control.grid
    while end - s[TIME] > slack:
        if rows == record.time.size:
            return FULL, rows
        goal = min(
            end, origin + control.grid * (np.floor((s[TIME] - origin) / control.grid + 1e-6) + 1.0)
        )
        h = min(s[STEP], goal - s[TIME])
        lands = goal - s[TIME] - h <= slack
        if lands:
            h = goal - s[TIME]
        elif control.tolerance > 0.0 and goal - s[TIME] < 2.0 * h:
            h = 0.5 * (goal - s[TIME])  # two equal steps instead of a full one and a sliver
        load_ahead = load(model, s[TIME] + h)
        converged, iterations = attempt(model, contacts, scheme, state, h, load_ahead)
        s[ITERATIONS] += iterations
        factor = 0.5
        if converged and control.tolerance > 0.0 and s[LAST] > 0.0:
            surprise = state.trial.change
            extrapolate(surprise, state, h)
            inertia = inertia_of(scheme, h)
            combine(surprise, -inertia, state.trial.dq, inertia, surprise)
            # vibration too fast for the step rings, but does not grow: filtered by (inertia M +
            # K)^-1 inertia M, the error of what the step resolves remains
            _, slope = elastic_over_step(
                model,
                state.start,
                state.q,
                state.trial.dq,
                scheme.start_weight,
                scheme.points,
                scheme.weights,
            )
            error, _, _ = responses(model, inertia, 0.0, slope, mass_times(model, surprise))
            size = max(s[SIZE], control.size)
            local = np.sqrt(dot(model, error, mass_times(model, error))) / 12.0
            ratio = local / (STEP_SHARE * control.tolerance * size) if size > 0.0 else 0.0
            converged = ratio <= 1.0
            factor = min(2.0, max(0.2, 0.9 / np.cbrt(max(ratio, 1e-12))))
            if converged and iterations > 8:
                factor = min(factor, 1.0)
        elif converged:
            factor = 2.0
        if converged:
            nominal = s[STEP]
            accept(model, contacts, scheme, state, h, load_ahead)
            if lands:
                s[TIME] = goal
            # a step cut short to land on the grid says nothing against the longer one
            s[STEP] = min(
                control.grid, max(factor * h, nominal if lands and factor >= 1.0 else 0.0)
            )
            write(model, contacts, state, record, rows)
            rows += 1
        else:
            s[REJECTED] += 1.0
            s[STEP] = factor * h
            if not s[STEP] > SMALLEST_STEP * control.grid:
                return FAILED, rows
    return DONE, rows


_compiled_march = compiled(march)


def initial_state(
    model: Any,
    contacts: Contacts,
    scheme: Scheme,
    dimension: int,
    q: Array,
    v: Array,
    sliders: Array | None = None,
) -> State:
    """The state at t = 0 with the acceleration that balances the forces; sliders rest where the
    points are, unless given.
    """
    x = contact_displacement(model, q).reshape(-1, dimension).copy()
    state = no_state(q.size, x.shape[0], dimension)
    at_rest(
        contacts, x, x.copy() if sliders is None else sliders, 0.0, state.touch, state.trial.room
    )
    zero, push = np.zeros_like(q), load(model, 0.0).copy()
    state.q[:], state.v[:], state.rate[:], state.load[:] = q, v, v, push
    measure(model, contacts, scheme, state)
    if not scheme.line:
        _, nothing = elastic_over_step(model, zero, q, zero, 0.0, np.ones(1), np.zeros(1))
        residual = state.start + scheme.damping * mass_times(model, v) - push
        if scheme.gyroscopic:
            residual += gyroscopic_times(model, v)
        y, unit, _ = responses(model, 1.0, 0.0, nothing, residual)
        state.a[:] = y - unit @ (state.touch.normal + state.touch.friction).reshape(-1)
        state.growth[:] = state.a
    return state


def static_size(model: Any, contacts: Contacts, dimension: int, q: Array) -> float:
    """Size in the mass norm of the linear static response to the largest loads and the preload: a
    scale for errors.
    """
    _, slope = elastic_over_step(
        model, np.zeros_like(q), q, np.zeros_like(q), 0.0, np.ones(1), np.ones(1)
    )
    push = np.abs(model.loads) @ largest(model.load_histories)
    y, unit, _ = responses(model, 0.0, 0.0, slope, -push)
    preload = np.zeros((contacts.preload.size, dimension))
    preload[:, 0] = contacts.preload
    y = np.abs(y) + np.abs(unit) @ preload.reshape(-1)
    return float(np.sqrt(dot(model, y, mass_times(model, y))))


def integrate(
    model: Any,
    contacts: Contacts,
    settings: Any,
    period: float | None,
    *,
    dimension: int,
    start: tuple[Array, ...] | None = None,
    resume: Checkpoint | None = None,
    keep_coordinates: bool = False,
    compiled: bool = True,
    progress: Callable[[float, float], None] | None = None,
    checkpoint: Callable[[Checkpoint], None] | None = None,
) -> Motion:
    """Integrate a model to its steady state, or to the given time.

    Args:
        model: a `ReducedModel` or any `Model`.
        contacts: parameters of the P contact points, in the order of the model's contact
        displacements.
        settings: a `fenicsrom.scene.schema.Time`: scheme, step or tolerance, periods, steady tolerance, or
        duration.
        period: of the loads, s; None runs for `settings.duration`.
        dimension: d, of space.
        start: displacement and velocity (n,), and sliders (P, d) if they are not at rest, at t = 0;
            at rest in the equilibrium under static loads and preload without it
            (`fenicsrom.statics`).
        resume: go on from where a run stood: what follows is what would have followed, bit for bit.
        keep_coordinates: keep the coordinates of the last period.
        compiled: False runs a `ReducedModel` in plain Python, the slow twin of the compiled loop.
        progress: called after each period with the fraction of the run done and the change since
        the last period.
        checkpoint: called after each period (or some thousand steps) with where the run stands;
            what it is given is overwritten afterwards.

    Returns:
        The motion, steady or at the end of the periods (`Motion.steady` says which); of a resumed
        run from the last period before.

    Raises:
        ConvergenceError: at the smallest step Newton did not converge; `partial` holds the motion
        up to there.
        AccuracyError: the energy balance is off (`fenicsrom.online.energy`); `partial` holds the
            motion.
    """
    plan = scheme(settings.scheme, model, settings.spectral_radius)
    advance = _compiled_march if compiled and isinstance(model, ReducedModel) else march
    horizon = float(period if period is not None else settings.duration)
    tolerance = settings.tolerance or 0.0
    step = (
        period / settings.steps_per_period
        if period is not None and not tolerance
        else settings.step
    )
    stops, grid = np.array([horizon]), horizon if tolerance else step
    if tolerance and period is None:  # steps that cannot miss a load
        stops, grid = (
            instants(model.load_histories, horizon),
            min(horizon, quarter_period(model.load_histories)),
        )
    nothing, buckled = np.zeros_like(load(model, 0.0)), 0
    if resume is not None:
        state, done, buckled = (
            copy.deepcopy(resume.state),
            resume.spans if period is not None else 0,
            resume.buckled,
        )
        control = Control(grid, tolerance, resume.size)
    else:
        if start is None:
            q, buckled = equilibrium(model, contacts, dimension)
            start = (q, nothing)
        state, done = initial_state(model, contacts, plan, dimension, *start), 0
        state.scalars[STEP] = 1e-4 * min(grid, stops[0]) if tolerance else step
        size = state.scalars[SIZE]
        if tolerance:
            size = max(size, static_size(model, contacts, dimension, start[0]))
        control = Control(grid, tolerance, size)
    s = state.scalars
    points, width, rows = state.touch.x.shape[0], 3 * state.q.size if keep_coordinates else 0, 4096
    if keep_coordinates and not tolerance:
        rows = min(rows, round(horizon / step) + 1)
    record = no_record(rows, points, dimension, width)
    write(model, contacts, state, record, 0)
    history = [_rows([record], [1])]
    if resume is not None:
        history = [
            resume.last._replace(
                coordinates=np.repeat(history[0].coordinates, resume.last.time.size, axis=0)
            )
        ]
    if advance is not march:  # compile outside of the clock: a call that finds nothing to do
        advance(model, contacts, plan, control, state, 0.0, 0.0, record)
    begin = clock.perf_counter()
    spans = settings.periods if period is not None else 1
    steady, status = False, DONE

    def stand(span: int) -> Checkpoint:
        return Checkpoint(state, history[-1], float(control.size), span, buckled)

    span = done
    for span in range(done + 1, spans + 1):
        q0, pieces, counts = state.q.copy(), [], []
        for stop in stops:
            status = FULL
            while status == FULL:
                origin, end = (span - 1) * horizon, (span - 1 + stop / horizon) * horizon
                status, count = advance(model, contacts, plan, control, state, origin, end, record)
                pieces.append(_copy(record, count))
                counts.append(count)
                if checkpoint is not None and period is None and count:
                    checkpoint(
                        Checkpoint(
                            state, _rows(pieces[-1:], [count]), float(control.size), 0, buckled
                        )
                    )
            if status == FAILED:
                break
        history[-1] = history[-1]._replace(
            coordinates=history[-1].coordinates[-1:]
        )  # one row: where this period starts
        history.append(_rows(pieces, counts))
        if status == FAILED or period is None:
            break
        change = _change(history[-2], history[-1], period)
        if (
            change <= settings.steady_tolerance
        ):  # where the points, or the probe, repeat: all the rest too?
            change = max(change, _norm(model, state.q - q0) / max(s[SIZE], 1e-300))
        if progress is not None:
            progress(span / spans, change)
        if checkpoint is not None:
            checkpoint(stand(span))
        if change <= settings.steady_tolerance:
            steady = True
            break
    seconds = clock.perf_counter() - begin
    motion = _motion(history, period, steady, s, seconds, stand(span))
    if status == FAILED or not np.all(np.isfinite(motion.kinetic)):
        names = {-1: "open", 0: "slip", 1: "stick"}
        where = (
            ", ".join(f"point {p + 1} {names[int(c)]}" for p, c in enumerate(state.touch.state))
            or "no contact"
        )
        raise ConvergenceError(
            f"time integration stopped at t = {s[TIME]:.6g} s: no convergence with the smallest step "
            f"{SMALLEST_STEP * control.grid:.3g} s ({where}; scheme {settings.scheme}); the motion up to there is kept",
            motion,
        )
    check_scheme(motion, settings.scheme)
    return motion


def end_of(motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates and velocity (n,) and sliders (P, d) at the end of a motion: a start for another
    run from t = 0.
    """
    assert motion.end is not None
    state = motion.end.state
    return state.q.copy(), state.v.copy(), state.touch.slider.copy()


def _norm(model: Any, vector: Array) -> float:
    return float(np.sqrt(dot(model, vector, mass_times(model, vector))))


def _copy(record: Record, count: int) -> Record:
    return Record._make(array[:count].copy() for array in record)


def _rows(pieces: list[Record], counts: list[int]) -> Record:
    """The rows written, joined."""
    return Record._make(
        np.concatenate([array[:count] for array, count in zip(arrays, counts, strict=True)])
        for arrays in zip(*pieces, strict=True)
    )


def _change(before: Record, after: Record, period: float) -> float:
    """Largest difference of the contact (or probe) displacement from a period ago, relative to the
    largest displacement.
    """
    was: Array = before.displacement.reshape(before.time.size, -1)
    now: Array = after.displacement.reshape(after.time.size, -1)
    if now.shape[1] == 0:
        was, now = before.probe, after.probe
    if before.time.size < 2:
        return np.inf
    if (
        now.shape == was.shape
        and np.max(np.abs(after.time - period - before.time)) <= 1e-9 * period
    ):
        there = was
    else:  # the steps of the two periods differ: a cubic spline is as exact as the motion
        there = CubicSpline(before.time, was)(
            np.clip(after.time - period, before.time[0], before.time[-1])
        )
    return float(np.max(np.abs(now - there)) / max(np.max(np.abs(now)), 1e-300))


def _motion(
    history: list[Record],
    period: float | None,
    steady: bool,
    s: Array,
    seconds: float,
    end: Checkpoint,
) -> Motion:
    last = [r.coordinates for r in history[-2:]]
    kept: list[Any] = [None] * 3
    if last[-1].size:
        kept = np.split(np.concatenate(last), 3, axis=1)
    whole = _rows(
        [r._replace(coordinates=r.coordinates[:0]) for r in history], [r.time.size for r in history]
    )
    work, damping_dissipation, friction_dissipation, kinetic, elastic, contact_energy = (
        whole.energies.T
    )
    return Motion(
        time=whole.time,
        period=period,
        displacement=whole.displacement if whole.displacement.shape[1] else whole.probe[:, None, :],
        force=whole.force,
        mean_force=whole.mean_force,
        gap=whole.gap,
        state=whole.state,
        kinetic=kinetic,
        elastic=elastic,
        contact_energy=contact_energy,
        work=work,
        damping_dissipation=damping_dissipation,
        friction_dissipation=friction_dissipation,
        point_friction_dissipation=whole.friction_dissipation,
        steady=steady,
        periods=end.spans if period is not None else 0,
        steps=int(s[STEPS]),
        rejected=int(s[REJECTED]),
        newton_iterations=int(s[ITERATIONS]),
        seconds=seconds,
        coordinates=kept[0],
        velocity=kept[1],
        acceleration=kept[2],
        coordinate_time=whole.time[-kept[0].shape[0] :] if kept[0] is not None else None,
        end=end,
        buckled=end.buckled,
    )
