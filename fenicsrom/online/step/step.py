"""One time step: Newton's method, acceptance, and the energy ledger.

The functions that take a model are plain Python, for any model with the operations of a
`ReducedModel`, and are inlined into the compiled loop of `fenicsrom.online.step.loop` for a
`ReducedModel` itself. Arrays of contact points are written by functions that numba does not inline:
its removal of dead code does not follow an array through the unpacking of a tuple, and drops such
writes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenicsrom.online.contact.candidates import add_candidates, choose_candidates, keep_open
from fenicsrom.online.contact.coating import is_coated, wear
from fenicsrom.online.contact.law import commit_contact_state, contact_energy, implicit_blending
from fenicsrom.online.contact.problem import solve_contact
from fenicsrom.online.contact.state import ContactStep, Interval
from fenicsrom.online.kernels.compiled import also_compiled, kernel, part
from fenicsrom.online.kernels.dense import combine, copy_to_points, copy_vector, subtract_contact
from fenicsrom.online.step.state import (
    CONTACT,
    DAMPING_DISSIPATION,
    ELASTIC,
    ENERGY_SCALE,
    FRICTION_DISSIPATION,
    KINETIC,
    LAST_STEP,
    SIZE,
    STEPS,
    TIME,
    WORK,
)

NEWTON_TOLERANCE = 1e-14
NEWTON_ROUNDING = 1e-13  # part of the energy; a smaller decrement that stops decreasing is rounding
CONTACT_ROUNDING = 1e-14  # the same, relative to contact forces times displacements
NEWTON_ITERATIONS = 15
DIVERGENCE = 1e8  # growth of the decrement at which the iteration stops


class StepCoefficients(NamedTuple):
    """How the mean velocity and the forces of a step depend on dq, v0 and a0.

    Attributes:
        mass: coefficient of M dq in the forces of inertia and damping.
        inertia_v: coefficient of M v0 in these forces.
        inertia_a: coefficient of M a0 in these forces.
        velocity_dq: coefficient of dq in the mean velocity, and of D dq in the forces.
        velocity_v: coefficient of v0 in the mean velocity.
        velocity_a: coefficient of a0 in the mean velocity.
    """

    mass: float
    inertia_v: float
    inertia_a: float
    velocity_dq: float
    velocity_v: float
    velocity_a: float


@also_compiled
def mass_coefficient(scheme, h):  # type: ignore[no-untyped-def]
    """Coefficient of M dq in the balance of a step of size h."""
    damping = scheme.damping * (1.0 - scheme.alpha_f) * scheme.gamma / (scheme.beta * h)
    return (1.0 - scheme.alpha_m) / (scheme.beta * h * h) + damping


@also_compiled
def step_coefficients(scheme, h):  # type: ignore[no-untyped-def]
    """The `StepCoefficients` of a step of size h."""
    am, af, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    velocity_v = (1.0 - af) * (1.0 - gamma / beta) + af
    velocity_a = (1.0 - af) * h * (1.0 - 0.5 * gamma / beta)
    return StepCoefficients(
        mass_coefficient(scheme, h),
        -(1.0 - am) / (beta * h) + scheme.damping * velocity_v,
        am - (1.0 - am) * (0.5 / beta - 1.0) + scheme.damping * velocity_a,
        (1.0 - af) * gamma / (beta * h),
        velocity_v,
        velocity_a,
    )


@also_compiled
def extrapolate(out, state, h):  # type: ignore[no-untyped-def]
    """Write dq of a step of size h, extrapolated from the previous steps.

    The velocities of the scheme may oscillate from step to step; dq/h does not.
    """
    last = state.scalars[LAST_STEP]
    combine(out, h, state.mean_velocity, 0.5 * h * (h + last), state.mean_acceleration)


@also_compiled
def write_residual(model, scheme, state, coefficients, elastic):  # type: ignore[no-untyped-def]
    """Write the residual of the equations of motion without contact to the trial."""
    trial = state.trial
    combine(trial.vector, 1.0, trial.inertia_offset, coefficients.mass, trial.dq)
    inertia = model.mass_times(trial.vector)
    combine(trial.residual, 1.0, inertia, 1.0, elastic, -1.0, trial.external_force)
    if scheme.velocity_forces:
        combine(
            trial.vector,
            coefficients.velocity_dq,
            trial.dq,
            coefficients.velocity_v,
            state.v,
            coefficients.velocity_a,
            state.a,
        )
        combine(trial.residual, 1.0, trial.residual, 1.0, model.velocity_times(trial.vector))


@part
def contact_decrement(decrement, candidates, trial):  # type: ignore[no-untyped-def]
    """Newton's decrement with the work of the contact forces in the iteration added.

    Returns:
        Its absolute value, and the sum of the contact forces times the displacements, J.
    """
    d, x, mean, carried = len(trial.scratch.space), trial.contact.x, trial.scratch.mean_force, 0.0
    for p in candidates:
        size, far = 0.0, 0.0
        for k in range(d):
            decrement += mean[p, k] * (x[p, k] - trial.displacement_before[p, k])
            size += abs(mean[p, k])
            far = max(far, abs(x[p, k]))
        carried += size * far
    return abs(decrement), carried


@also_compiled
def has_converged(decrement, last, iteration, scale, carried, quadratic):  # type: ignore[no-untyped-def]
    """Whether the next decrement will be small, or this one is rounding.

    The last two decrements predict the next one: if Newton's method is exact, the error is squared
    in an iteration, otherwise it is multiplied by a rate. The decrement is the square of the error.
    A small decrement that stops decreasing is rounding.
    """
    coming = decrement
    if iteration > 1 and decrement < 1e-3 * last:
        ratio = decrement / last
        coming = decrement * ratio**2 if quadratic else decrement * ratio
    rounding = (
        decrement <= max(NEWTON_ROUNDING * scale, CONTACT_ROUNDING * carried)
        and decrement > 0.1 * last
    )
    return coming <= NEWTON_TOLERANCE**2 * scale or rounding


@also_compiled
def set_blending(model, contacts, scheme, state, h):  # type: ignore[no-untyped-def]
    """Write the weights of the implicit blending in steps of size h, if the last step was not."""
    scratch = state.trial.scratch
    if scheme.discrete_gradient and scratch.blending.size > 0 and scratch.blended_step[0] != h:
        model.write_normal_flexibility(h, scratch.blending)
        implicit_blending(contacts, scratch.blending)
        scratch.blended_step[0] = h


@also_compiled
def attempt(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Solve one step of size h from `state`, writing only to its trial.

    `set_blending` has written the weights of the implicit blending.

    The step is solved for the candidates among the contact points. It is solved again from its
    first guess where another point touches at its end.

    Returns:
        Whether it converged, and the number of iterations.
    """
    trial, af = state.trial, scheme.alpha_f
    interval = Interval(state.scalars[TIME], state.scalars[TIME] + h, af, scheme.discrete_gradient)
    step = ContactStep(contacts, interval, state.contact, trial.contact, trial.scratch)
    coefficients = step_coefficients(scheme, h)
    model.set_interval(interval.begin, interval.end)
    combine(trial.inertia_offset, coefficients.inertia_v, state.v, coefficients.inertia_a, state.a)
    combine(trial.external_force, 1.0 - af, load_ahead, af, state.load_vector)
    guess_step(model, state, h)
    count = choose_candidates(step, scheme.all_points)
    iterations = 0
    while True:
        converged, more = iterate(model, scheme, state, step, coefficients, count)
        iterations += more
        if not converged or count == trial.contact.x.shape[0]:
            return converged, iterations
        combine(trial.vector, 1.0, state.q, 1.0, trial.dq)
        copy_to_points(trial.free_displacement, model.contact_displacement(trial.vector))
        found = add_candidates(step, trial.free_displacement)
        if found == count:
            return True, iterations
        count = found
        guess_step(model, state, h)


@also_compiled
def guess_step(model, state, h):  # type: ignore[no-untyped-def]
    """Write the first guess of a step of size h and of the contact displacements at its end."""
    trial = state.trial
    extrapolate(trial.dq, state, h)
    combine(trial.vector, 1.0, state.q, 1.0, trial.dq)
    copy_to_points(trial.contact.x, model.contact_displacement(trial.vector))


@also_compiled
def iterate(model, scheme, state, step, coefficients, count):  # type: ignore[no-untyped-def]
    """Newton's method for a step from its first guess, with so many contact candidates.

    Returns:
        Whether it converged, and the number of iterations.
    """
    trial, scratch, q0, d = state.trial, state.trial.scratch, state.q, state.contact.x.shape[1]
    x, first, last = trial.contact.x, 0.0, 0.0
    candidates, directions = scratch.candidates[:count], scratch.directions[: count * d]
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        elastic, tangent = model.elastic_over_step(
            state.elastic_force, q0, trial.dq, scheme.start_weight, scheme.points, scheme.weights
        )
        write_residual(model, scheme, state, coefficients, elastic)
        y, unit, compliance = model.solve_effective(
            coefficients.mass, coefficients.velocity_dq, tangent, trial.residual, directions
        )
        if count > 0:
            copy_vector(trial.displacement_before, x)
            combine(trial.vector, 1.0, q0, 1.0, trial.dq, 1.0, y)
            copy_to_points(trial.free_displacement, model.contact_displacement(trial.vector))
            if not solve_contact(step, candidates, compliance, trial.free_displacement):
                return False, iteration
        subtract_contact(trial.change, y, unit, candidates, scratch.mean_force)
        combine(trial.dq, 1.0, trial.dq, 1.0, trial.change)
        decrement, carried = contact_decrement(
            model.dot(trial.residual, trial.change), candidates, trial
        )
        if not np.isfinite(decrement):
            return False, iteration
        if iteration == 1:
            first = decrement
        scale = max(state.scalars[ENERGY_SCALE], first)
        if scheme.linear or has_converged(
            decrement, last, iteration, scale, carried, scheme.quadratic
        ):
            return True, iteration
        if decrement > DIVERGENCE * first:
            return False, iteration
        last = decrement
    return False, NEWTON_ITERATIONS


@also_compiled
def accept(model, contacts, scheme, state, h, load_ahead):  # type: ignore[no-untyped-def]
    """Write a converged step into the state, with its entries in the energy ledger.

    Work and damping are integrated along the step by the trapezoidal rule.
    """
    beta, gamma = scheme.beta, scheme.gamma
    s, trial = state.scalars, state.trial
    dq, v1 = trial.dq, trial.change
    combine(
        v1,
        1.0 - gamma / beta,
        state.v,
        h * (1.0 - 0.5 * gamma / beta),
        state.a,
        gamma / (beta * h),
        dq,
    )
    s[WORK] += 0.5 * (model.dot(state.load_vector, dq) + model.dot(load_ahead, dq))
    s[WORK] += model.pressure_work(state.q, dq)
    combine(trial.vector, 1.0, state.v, 1.0, v1)
    s[DAMPING_DISSIPATION] += 0.5 * scheme.damping * model.dot(model.mass_times(trial.vector), dq)
    if scheme.velocity_forces:
        s[DAMPING_DISSIPATION] += 0.5 * model.dot(model.velocity_times(trial.vector), dq)
    interval = Interval(s[TIME], s[TIME] + h, scheme.alpha_f, scheme.discrete_gradient)
    accept_contact(contacts, interval, state)
    change = 2.0 / (h + s[LAST_STEP])
    combine(state.mean_acceleration, change / h, dq, -change, state.mean_velocity)
    combine(state.mean_velocity, 1.0 / h, dq, 0.0, state.mean_velocity)
    combine(state.q, 1.0, state.q, 1.0, dq)
    if not scheme.discrete_gradient:  # the discrete gradient does not use a
        combine(
            state.a, 1.0 / (beta * h * h), dq, -1.0 / (beta * h), state.v, 1.0 - 0.5 / beta, state.a
        )
    copy_vector(state.v, v1)
    copy_vector(state.load_vector, load_ahead)
    s[TIME] += h
    s[LAST_STEP] = h
    s[STEPS] += 1.0
    measure(model, contacts, state)


@kernel
def accept_contact(contacts, interval, state):  # type: ignore[no-untyped-def]
    """Write the contact points at the end of a step into the state, and their energies."""
    s, trial, contact, end = state.scalars, state.trial, state.contact, state.trial.contact
    step, d = ContactStep(contacts, interval, contact, end, trial.scratch), contact.x.shape[1]
    for p in range(contact.x.shape[0]):
        if trial.scratch.is_candidate[p]:
            dissipated, surface, impact = commit_contact_state(step, p)
            s[FRICTION_DISSIPATION] += dissipated
            state.friction_dissipation[p] += dissipated
            s[WORK] += surface
            s[DAMPING_DISSIPATION] += impact
            if is_coated(contacts, p):
                wear(contacts, interval, p, contact.x[p], end.x[p])
        else:
            keep_open(p, end, trial.scratch)
        contact.trial_normal_force[p] = end.trial_normal_force[p]
        contact.state[p] = end.state[p]
        for k in range(d):
            contact.x[p, k] = end.x[p, k]
            contact.normal[p, k] = end.normal[p, k]
            contact.friction[p, k] = end.friction[p, k]
            contact.slider[p, k] = end.slider[p, k]


@also_compiled
def measure(model, contacts, state):  # type: ignore[no-untyped-def]
    """Write the energies of the state, the scales of the run, and the elastic force."""
    s = state.scalars
    s[KINETIC] = 0.5 * model.dot(state.v, model.mass_times(state.v))
    model.set_interval(s[TIME], s[TIME])
    elastic, s[ELASTIC] = model.elastic_at(state.q)
    copy_vector(state.elastic_force, elastic)
    s[CONTACT] = contact_energy(contacts, state.contact)
    s[ENERGY_SCALE] = max(s[ENERGY_SCALE], s[KINETIC] + abs(s[ELASTIC]))
    s[SIZE] = max(s[SIZE], np.sqrt(model.dot(state.q, model.mass_times(state.q))))
