"""One time step: Newton's method, acceptance, and the energy ledger."""

from __future__ import annotations

import numpy as np
from numba.extending import register_jitable

from fenicsrom.online.contact_problem import resolve
from fenicsrom.online.contact_state import Interval
from fenicsrom.online.contact_step import contact_energy, lean_to_the_end, settle
from fenicsrom.online.operations import (
    answer,
    combine,
    contact_displacement,
    dot,
    elastic_at,
    elastic_over_step,
    gyroscopic_times,
    keep,
    mass_times,
    put,
    responses,
)
from fenicsrom.online.state import (
    CONTACT,
    DAMPED,
    ELASTIC,
    KINETIC,
    LAST,
    RUBBED,
    SCALE,
    SIZE,
    STEPS,
    TIME,
    WORK,
)

NEWTON_TOLERANCE = 1e-14
NEWTON_ROUNDING = (
    1e-13  # a decrement below this part of the energy that no longer falls is rounding
)
CONTACT_ROUNDING = (
    1e-14  # the same, of the contact forces times the displacements from the undeformed body
)
NEWTON_ITERATIONS = 15


@register_jitable(inline="always")
def extrapolate(out, state, h):  # type: ignore[no-untyped-def]
    """Write dq of a step of size h as the steps before foretell it: the velocities of the scheme
    may ring, dq/h does not.
    """
    combine(out, h, state.rate, 0.5 * h * (h + state.scalars[LAST]), state.growth)


@register_jitable(inline="always")
def inertia_of(scheme, h):  # type: ignore[no-untyped-def]
    """Factor of M dq in the balance of a step of size h."""
    kept = scheme.damping * (1.0 - scheme.alpha_f) * scheme.gamma / (scheme.beta * h)
    return (1.0 - scheme.alpha_m) / (scheme.beta * h * h) + kept


@register_jitable(inline="always")
def attempt(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Solve one step of size h from `state`, writing only to its trial; returns (converged,
    iterations).
    """
    am, af, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    trial, room = state.trial, state.trial.room
    points, d = trial.free.shape
    dq, residual, change, total, x = (
        trial.dq,
        trial.residual,
        trial.change,
        trial.total,
        trial.touch.x,
    )
    q0, v0, a0 = state.q, state.v, state.a
    interval = Interval(state.scalars[TIME], state.scalars[TIME] + h, af, scheme.line)
    # the mean velocity over the step is drag dq + drag_v v0 + drag_a a0, the mean acceleration
    # likewise: M times `rest` is what does not depend on dq in the forces of inertia and damping,
    # and `inertia` the factor of M dq in them
    drag = (1.0 - af) * gamma / (beta * h)
    drag_v = (1.0 - af) * (1.0 - gamma / beta) + af
    drag_a = (1.0 - af) * h * (1.0 - 0.5 * gamma / beta)
    from_v = -(1.0 - am) / (beta * h) + scheme.damping * drag_v
    from_a = am - (1.0 - am) * (0.5 / beta - 1.0) + scheme.damping * drag_a
    combine(trial.rest, from_v, v0, from_a, a0)
    inertia = inertia_of(scheme, h)
    combine(trial.push, 1.0 - af, load_ahead, af, state.load)
    extrapolate(dq, state, h)
    combine(total, 1.0, q0, 1.0, dq)
    put(x, contact_displacement(model, total))
    first, last = 0.0, 0.0
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        elastic, slope = elastic_over_step(
            model, state.start, q0, dq, scheme.start_weight, scheme.points, scheme.weights
        )
        combine(total, 1.0, trial.rest, inertia, dq)
        combine(residual, 1.0, mass_times(model, total), 1.0, elastic, -1.0, trial.push)
        if scheme.gyroscopic:
            combine(total, drag, dq, drag_v, v0, drag_a, a0)
            combine(residual, 1.0, residual, 1.0, gyroscopic_times(model, total))
        y, unit, compliance = responses(model, inertia, drag, slope, residual)
        for p in range(points):
            for k in range(d):
                trial.before[p, k] = x[p, k]
        combine(total, 1.0, q0, 1.0, dq, 1.0, y)
        put(trial.free, contact_displacement(model, total))
        if iteration == 1:
            lean_to_the_end(contacts, interval, compliance, state.touch, room)
        if points > 0 and not resolve(
            contacts, interval, compliance, trial.free, state.touch, trial.touch, room
        ):
            return False, iteration
        answer(change, y, unit, room.mean)
        combine(dq, 1.0, dq, 1.0, change)
        decrement, carried = dot(model, residual, change), 0.0
        for p in range(points):
            size, far = 0.0, 0.0
            for k in range(d):
                decrement += room.mean[p, k] * (x[p, k] - trial.before[p, k])
                size += abs(room.mean[p, k])
                far = max(far, abs(x[p, k]))
            carried += size * far
        decrement = abs(decrement)
        if not np.isfinite(decrement):
            return False, iteration
        if iteration == 1:
            first = decrement
        scale = max(state.scalars[SCALE], first)
        # what the next decrement will be, Newton's convergence being quadratic; a small one that no
        # longer falls is rounding
        coming = (
            decrement * (decrement / last) ** 2
            if iteration > 1 and decrement < 1e-3 * last
            else decrement
        )
        rounding = (
            decrement <= max(NEWTON_ROUNDING * scale, CONTACT_ROUNDING * carried)
            and decrement > 0.1 * last
        )
        if scheme.linear or coming <= NEWTON_TOLERANCE**2 * scale or rounding:
            return True, iteration
        if decrement > 1e8 * first:
            return False, iteration
        last = decrement
    return False, NEWTON_ITERATIONS


@register_jitable(inline="always")
def accept(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Write a converged step into the state, with its entries in the energy ledger (trapezoidal
    along the step).
    """
    beta, gamma = scheme.beta, scheme.gamma
    s, trial = state.scalars, state.trial
    dq, v1, total = trial.dq, trial.change, trial.total
    combine(
        v1,
        1.0 - gamma / beta,
        state.v,
        h * (1.0 - 0.5 * gamma / beta),
        state.a,
        gamma / (beta * h),
        dq,
    )
    s[WORK] += 0.5 * (dot(model, state.load, dq) + dot(model, load_ahead, dq))
    combine(total, 1.0, state.v, 1.0, v1)
    s[DAMPED] += 0.5 * scheme.damping * dot(model, mass_times(model, total), dq)
    interval = Interval(s[TIME], s[TIME] + h, scheme.alpha_f, scheme.line)
    for p in range(trial.free.shape[0]):
        dissipated, surface, lost = settle(
            contacts, interval, p, state.touch, trial.touch, trial.room
        )
        s[RUBBED] += dissipated
        state.friction_dissipation[p] += dissipated
        s[WORK] += surface
        s[DAMPED] += lost
    change = 2.0 / (h + s[LAST])
    combine(state.growth, change / h, dq, -change, state.rate)
    combine(state.rate, 1.0 / h, dq, 0.0, state.rate)
    combine(state.q, 1.0, state.q, 1.0, dq)
    if not scheme.line:  # it cancels from the discrete gradient, where it would only carry rounding
        combine(
            state.a, 1.0 / (beta * h * h), dq, -1.0 / (beta * h), state.v, 1.0 - 0.5 / beta, state.a
        )
    keep(state.v, v1)
    keep(state.load, load_ahead)
    for p in range(trial.free.shape[0]):
        state.touch.raw[p] = trial.touch.raw[p]
        state.touch.state[p] = trial.touch.state[p]
        for k in range(trial.free.shape[1]):
            state.touch.x[p, k] = trial.touch.x[p, k]
            state.touch.normal[p, k] = trial.touch.normal[p, k]
            state.touch.friction[p, k] = trial.touch.friction[p, k]
            state.touch.slider[p, k] = trial.touch.slider[p, k]
    s[TIME] += h
    s[LAST] = h
    s[STEPS] += 1.0
    measure(model, contacts, scheme, state)


@register_jitable(inline="always")
def measure(model, contacts, scheme, state):  # type: ignore[no-untyped-def]
    """Energies of the state, the scales of the run, and the elastic force the next step starts
    from.
    """
    s = state.scalars
    s[KINETIC] = 0.5 * dot(model, state.v, mass_times(model, state.v))
    elastic, s[ELASTIC] = elastic_at(model, state.q)
    keep(state.start, elastic)
    s[CONTACT] = contact_energy(contacts, state.touch)
    s[SCALE] = max(s[SCALE], s[KINETIC] + abs(s[ELASTIC]))
    s[SIZE] = max(s[SIZE], np.sqrt(dot(model, state.q, mass_times(model, state.q))))
