"""One time step: Newton's method, acceptance, and the energy ledger.

The functions that take a model are plain Python, for any model with the operations of a
`ReducedModel`, and are inlined into the compiled loop over the steps for a
`ReducedModel` itself. Arrays of contact points are written by functions that numba does not inline:
its removal of dead code does not follow an array through the unpacking of a tuple, and drops such
writes.

The loop over the steps of a time integration, plain and compiled.

`march` is plain Python. Uncompiled, it integrates any model with the operations of a
`ReducedModel`. `compiled_march` integrates a `ReducedModel` itself, whose methods are compiled into
it.

The longest adaptive step, and the times on which adaptive steps must land.

The controller of the step sees a load or a surface only at the ends of the steps. It must not jump
over what happens between them:

* A step is at most `LONGEST` tolerance^(1/3) of the shortest period of the loads and of the waves
  of surfaces. A step that uses up its tolerance for a motion of this period, at an error of
  (omega h)^3/12, is 0.08 tolerance^(1/3) of the period long. The longest step is thus 2.5 times as
  long, at most a fifth of the period, and follows the tolerance: a check with eight times the
  tolerance has twice the longest step, less than half a period. Two runs that sample a load alike
  would not see that they miss it.
* Steps land on the rows of tables and of approaching surfaces where the slope changes, and on the
  quarters of impacts: the run sees every crest.
"""

from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import depth, is_coated, wear
from fenicsrom.online.contact.law import commit_contact_state, contact_energy, implicit_blending
from fenicsrom.online.contact.problem import (
    add_candidates,
    choose_candidates,
    keep_open,
    solve_contact,
)
from fenicsrom.online.contact.state import OPEN, ContactStep, Interval
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.kernels.compilation import also_compiled, compiled, kernel, part
from fenicsrom.online.kernels.dense import combine, copy_to_points, copy_vector, subtract_contact
from fenicsrom.online.model.loads import LoadHistories, instants, quarter_period
from fenicsrom.online.step.state import (
    CONTACT,
    DAMPING_DISSIPATION,
    ELASTIC,
    ENERGY_SCALE,
    FRICTION_DISSIPATION,
    ITERATIONS,
    KINETIC,
    LAST_STEP,
    REJECTED,
    SIZE,
    STEP,
    STEPS,
    TIME,
    WORK,
)

NEWTON_TOLERANCE = 1e-14
CONTACT_TOLERANCE = 1e-12  # of a model with contact that keeps a factor: less is rounding
NEWTON_ROUNDING = 1e-13  # part of the energy; a smaller decrement that stops decreasing is rounding
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
def mass_coefficient(scheme, damping, h):  # type: ignore[no-untyped-def]
    """Coefficient of M dq in the balance of a step of size h, with the damping alpha."""
    damping = damping * (1.0 - scheme.alpha_f) * scheme.gamma / (scheme.beta * h)
    return (1.0 - scheme.alpha_m) / (scheme.beta * h * h) + damping


@also_compiled
def step_coefficients(scheme, damping, h):  # type: ignore[no-untyped-def]
    """The `StepCoefficients` of a step of size h with the damping alpha; both may be complex."""
    am, af, beta, gamma = scheme.alpha_m, scheme.alpha_f, scheme.beta, scheme.gamma
    velocity_v = (1.0 - af) * (1.0 - gamma / beta) + af
    velocity_a = (1.0 - af) * h * (1.0 - 0.5 * gamma / beta)
    return StepCoefficients(
        mass_coefficient(scheme, damping, h),
        -(1.0 - am) / (beta * h) + damping * velocity_v,
        am - (1.0 - am) * (0.5 / beta - 1.0) + damping * velocity_a,
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


@kernel
def write_known_force(scratch, contact):  # type: ignore[no-untyped-def]
    """Take the contact forces at the start of a step as known."""
    for p in range(contact.x.shape[0]):
        for k in range(contact.x.shape[1]):
            scratch.known_force[p, k] = contact.normal[p, k] + contact.friction[p, k]


@kernel
def write_force_change(scratch, candidates):  # type: ignore[no-untyped-def]
    """Write the mean forces of the candidates less the known ones; they are known from now on."""
    for p in candidates:
        for k in range(scratch.mean_force.shape[1]):
            scratch.force_change[p, k] = scratch.mean_force[p, k] - scratch.known_force[p, k]
            scratch.known_force[p, k] = scratch.mean_force[p, k]


@part
def contact_work(force, moved, candidates):  # type: ignore[no-untyped-def]
    """Work of forces (P, d) of the candidates on displacements (P d,), J."""
    d, work = force.shape[1], 0.0
    for p in candidates:
        for k in range(d):
            work += force[p, k] * moved[p * d + k]
    return work


@also_compiled
def has_converged(decrement, last, iteration, scale, tolerance, quadratic):  # type: ignore[no-untyped-def]
    """Whether the next decrement will be small, or this one is rounding.

    The last two decrements predict the next one: if Newton's method is exact, the error is squared
    in an iteration, otherwise it is multiplied by a rate. The decrement is the square of the error.
    A small decrement that stops decreasing is rounding.
    """
    coming = decrement
    if iteration > 1 and decrement < 1e-3 * last:
        ratio = decrement / last
        coming = decrement * ratio**2 if quadratic else decrement * ratio
    stays = decrement <= NEWTON_ROUNDING * scale and decrement > 0.1 * last
    return coming <= tolerance**2 * scale or stays


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
    coefficients = step_coefficients(scheme, scheme.damping, h)
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

    The body is solved with known contact forces, first those at the start of the step, and for
    their change: the response to a whole force of a piece that contact alone holds would cancel
    nearly all digits.

    Returns:
        Whether it converged, and the number of iterations.
    """
    trial, scratch, q0, d = state.trial, state.trial.scratch, state.q, state.contact.x.shape[1]
    first, last = 0.0, 0.0
    candidates, directions = scratch.candidates[:count], scratch.directions[: count * d]
    tolerance = NEWTON_TOLERANCE if scheme.quadratic or count == 0 else CONTACT_TOLERANCE
    write_known_force(scratch, state.contact)
    for iteration in range(1, NEWTON_ITERATIONS + 1):
        elastic, tangent = model.elastic_over_step(
            state.elastic_force, q0, trial.dq, scheme.start_weight, scheme.points, scheme.weights
        )
        write_residual(model, scheme, state, coefficients, elastic)
        if count > 0:
            model.add_contact_force(trial.residual, scratch.known_force)
        y, unit, compliance = model.solve_effective(
            coefficients.mass, coefficients.velocity_dq, tangent, trial.residual, directions
        )
        if count > 0:
            combine(trial.vector, 1.0, q0, 1.0, trial.dq, 1.0, y)
            copy_to_points(trial.free_displacement, model.contact_displacement(trial.vector))
            if not solve_contact(step, candidates, compliance, trial.free_displacement):
                return False, iteration
        write_force_change(scratch, candidates)
        subtract_contact(trial.change, y, unit, candidates, scratch.force_change)
        combine(trial.dq, 1.0, trial.dq, 1.0, trial.change)
        decrement = model.dot(trial.residual, trial.change)
        if count > 0:  # of the change itself: bolts leave large rounding errors in x
            moved = model.contact_change(trial.change)
            decrement += contact_work(scratch.force_change, moved, candidates)
        decrement = abs(decrement)
        if not np.isfinite(decrement):
            return False, iteration
        if iteration == 1:
            first = decrement
        scale = max(state.scalars[ENERGY_SCALE], first)
        if scheme.linear or has_converged(
            decrement, last, iteration, scale, tolerance, scheme.quadratic
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


STEP_SHARE = 0.01  # part of the tolerance that one adaptive step may use
SMALLEST_STEP = 1e-6  # smallest step as a part of the nominal step; a smaller step ends the run

DONE, FULL, FAILED = 0, 1, 2


@also_compiled
def write(model, contacts, state, record, row):  # type: ignore[no-untyped-def]
    """Write the state to a row of the record."""
    s = state.scalars
    record.time[row] = s[TIME]
    copy_vector(record.probe[row], model.probe_displacement(state.q))
    write_contact(contacts, state, record, row)
    for k in range(6):
        record.energies[row, k] = s[WORK + k]
    if record.turning.shape[1] > 0:
        model.write_momentum(s[TIME], state.q, state.v, record.turning[row])
    if record.coordinates.shape[1] > 0:
        n = state.q.size
        copy_vector(record.coordinates[row, :n], state.q)
        copy_vector(record.coordinates[row, n : 2 * n], state.v)
        copy_vector(record.coordinates[row, 2 * n :], state.a)


@kernel
def write_contact(contacts, state, record, row):  # type: ignore[no-untyped-def]
    """Write the contact points to a row of the record."""
    s, contact = state.scalars, state.contact
    points, d = contact.x.shape
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
    mass = mass_coefficient(scheme, scheme.damping, h)
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


LONGEST = 0.2
"""Longest step for a tolerance of 1, as a part of the shortest period."""

CORNER = 1e-9
"""Smaller changes of slope, relative to the largest slope, are rounding errors."""


def longest_step(load_histories: LoadHistories, contacts: Contacts, tolerance: float) -> float:
    """The longest adaptive step in s; infinite if nothing oscillates."""
    shortest = min(4.0 * quarter_period(load_histories), _wave_period(contacts))
    return float(LONGEST * np.cbrt(tolerance) * shortest)


def landings(
    load_histories: LoadHistories,
    contacts: Contacts,
    begin: float,
    end: float,
    adaptive: bool = True,
) -> Array:
    """Times in s, after `begin` and up to `end`, on which steps land; `end` is the last.

    Args:
        load_histories: the time factors of the loads.
        contacts: the parameters of the contacts.
        begin: s.
        end: s.
        adaptive: whether the steps are adaptive; other steps land on the corners of the speed only.
    """
    found = [load_histories.history[:, 0]]
    if adaptive:
        found.append(instants(load_histories, end))
        for _, _, low, high in load_histories.spans:
            found.append(_corners(*load_histories.table[low:high].T))
        found += [_corners(contacts.times, distance) for distance in contacts.approach]
    times = np.unique(np.concatenate(found))
    times = times[(times > begin) & (times < end)]
    # a landing closer to another one than the rounding of the march makes a step of no length
    apart = np.diff(times, append=end) > 1e-9 * (end - begin)
    return np.append(times[apart & (times - begin > 1e-9 * (end - begin))], end)


def _wave_period(contacts: Contacts) -> float:
    """The time in which the shortest wave of a surface passes a contact point, s."""
    orders = np.where(contacts.height != 0.0, contacts.order, 0.0).max(axis=1, initial=0.0)
    fastest = np.max(np.abs(contacts.history[:, 1]), initial=0.0)
    spins = np.abs(contacts.spin) + np.abs(contacts.turns) * fastest
    rate = np.max(orders * spins, initial=0.0)
    return 2.0 * np.pi / rate if rate > 0.0 else np.inf


def _corners(times: Array, values: Array) -> Array:
    """The times at which the slope of a table changes, its ends included if it is not constant."""
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
    change = np.abs(np.diff(slopes))
    return times[change > CORNER * np.max(np.abs(slopes))] if times.size else times
