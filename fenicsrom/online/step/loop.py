"""The loop over the steps of a time integration, plain and compiled.

`march` is plain Python. Uncompiled, it integrates any model with the operations of a
`ReducedModel`. `compiled_march` integrates a `ReducedModel` itself, whose methods are compiled into
it.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.online.contact.coating import depth
from fenicsrom.online.contact.state import OPEN
from fenicsrom.online.kernels.compiled import also_compiled, compiled, part
from fenicsrom.online.kernels.dense import combine, copy_vector
from fenicsrom.online.step.state import ITERATIONS, LAST_STEP, REJECTED, SIZE, STEP, TIME, WORK
from fenicsrom.online.step.step import (
    accept,
    attempt,
    extrapolate,
    mass_coefficient,
    set_blending,
)

STEP_SHARE = 0.01  # part of the tolerance that one adaptive step may use
SMALLEST_STEP = 1e-6  # smallest step as a part of the nominal step; a smaller step ends the run

DONE, FULL, FAILED = 0, 1, 2


@also_compiled
def write(model, contacts, state, record, row):  # type: ignore[no-untyped-def]
    """Write the state to a row of the record."""
    s = state.scalars
    record.time[row] = s[TIME]
    contact = state.contact
    points, d = contact.x.shape
    copy_vector(record.probe[row], model.probe_displacement(state.q))
    for p in range(points):
        record.state[row, p] = contact.state[p]
        record.friction_dissipation[row, p] = state.friction_dissipation[p]
        record.blending[row, p] = state.trial.scratch.blending[p]
        record.gap[row, p] = -depth(contacts, p, contact.x[p], s[TIME])
        # in the frame of the point, turned the shortest way so that its first axis is the current
        # normal
        tilt = 0.0
        if contact.state[p] != OPEN:
            size = 0.0
            for k in range(d):
                size += contact.normal[p, k] ** 2
            tilt = contact.friction[p, 0] / (np.sqrt(size) + contact.normal[p, 0])
        record.force[row, p, 0] = max(contact.trial_normal_force[p], 0.0)
        for k in range(d):
            record.displacement[row, p, k] = contact.x[p, k]
            record.mean_force[row, p, k] = state.trial.scratch.mean_force[p, k]
            if k > 0:
                record.force[row, p, k] = contact.friction[p, k] - tilt * contact.normal[p, k]
    for k in range(6):
        record.energies[row, k] = s[WORK + k]
    if record.turning.shape[1] > 0:
        model.write_momentum(s[TIME], state.q, state.v, record.turning[row])
    if record.coordinates.shape[1] > 0:
        n = state.q.size
        copy_vector(record.coordinates[row, :n], state.q)
        copy_vector(record.coordinates[row, n : 2 * n], state.v)
        copy_vector(record.coordinates[row, 2 * n :], state.a)


@part
def next_time(times, after):  # type: ignore[no-untyped-def]
    """The first of some ascending times after a time; infinite if there is none."""
    low, high = 0, times.size
    while low < high:
        middle = (low + high) // 2
        if times[middle] > after:
            high = middle
        else:
            low = middle + 1
    return times[low] if low < times.size else np.inf


@also_compiled
def error_ratio(model, scheme, control, state, h):  # type: ignore[no-untyped-def]
    """Estimated local error of a converged step, relative to the allowed error.

    The distance from the extrapolation contains vibrations too fast for the step, which oscillate
    and do not grow. The filter (c M + K)^-1 c M, c the mass coefficient, removes these vibrations;
    the error of the resolved motion remains.
    """
    surprise = state.trial.change
    extrapolate(surprise, state, h)
    mass = mass_coefficient(scheme, h)
    combine(surprise, -mass, state.trial.dq, mass, surprise)
    _, tangent = model.elastic_over_step(
        state.elastic_force,
        state.q,
        state.trial.dq,
        scheme.start_weight,
        scheme.points,
        scheme.weights,
    )
    none = state.trial.scratch.directions[:0]
    error, _, _ = model.solve_effective(mass, 0.0, tangent, model.mass_times(surprise), none)
    size = max(state.scalars[SIZE], control.size)
    local = np.sqrt(model.dot(error, model.mass_times(error))) / 12.0
    return local / (STEP_SHARE * control.tolerance * size) if size > 0.0 else 0.0


def march(model, contacts, scheme, control, state, origin, end, record):  # type: ignore[no-untyped-def]
    """Advance the state from its time to `end`, with a row of the record for each accepted step.

    Args:
        model: a `Model`, or (compiled) a `ReducedModel`.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        control: how the step is chosen.
        state: in: where to start; out: where it ended.
        origin: where the grid of times starts, s.
        end: when to stop, s.
        record: out: the rows.

    Returns:
        (status, rows written): DONE, FULL (of rows: call again), or FAILED (the smallest step did
        not converge).
    """
    s = state.scalars
    state.trial.scratch.blended_step[0] = np.nan  # model, contacts or resumed run may be others
    rows = 0
    slack = 1e-9 * control.grid
    while end - s[TIME] > slack:
        if rows == record.time.size:
            return FULL, rows
        goal = min(
            end, origin + control.grid * (np.floor((s[TIME] - origin) / control.grid + 1e-6) + 1.0)
        )
        if control.times.size > 0:
            goal = min(end, next_time(control.times, s[TIME] + slack))
        h = min(s[STEP], goal - s[TIME])
        lands = goal - s[TIME] - h <= slack
        if lands:
            h = goal - s[TIME]
        elif control.tolerance > 0.0 and goal - s[TIME] < 2.0 * h:
            h = 0.5 * (goal - s[TIME])  # two equal steps instead of a full one and a very short one
        whole = abs(h - control.grid) <= slack  # the steps of a grid differ by rounding
        set_blending(model, contacts, scheme, state, control.grid if whole else h)
        load_ahead = model.load(s[TIME] + h)
        converged, iterations = attempt(model, contacts, scheme, state, h, load_ahead)
        s[ITERATIONS] += iterations
        factor = 0.5
        if converged and control.tolerance > 0.0 and s[LAST_STEP] > 0.0:
            ratio = error_ratio(model, scheme, control, state, h)
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
            # after a step shortened to land on the grid, the longer step is tried again
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


compiled_march = compiled(march)
