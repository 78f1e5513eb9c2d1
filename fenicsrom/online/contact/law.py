"""The contact law of one point over a time step, and its state at the end of the step.

A point is described by its displacement x (d,) in its own frame. The first axis is the normal into
the surface at the place of the undeformed body; the others are tangents there. Forces act against
the motion: the residual of the equations of motion gains + B F. With the penetration delta(x, t) of
the surface, n = grad delta, P = I - n n^T / |n|^2 and the slider w, the point of the surface to
which the friction spring is attached,

    y = N0 + k_n delta                  trial normal force                                  (1)
    N = max(0, y)                       the normal force is N n                             (2)
    T = k_t P (x - w)                   stick, if |T| <= mu N: the slider rests             (3)
    T = mu N T/|T|                      slip, otherwise: w = x - T/k_t                      (4)
    T = 0, w = x                        open, if N = 0: the slider follows                  (5)

Surfaces are planes, cylinders and spheres, seen from inside (a casing) or from outside. They may
approach the body and turn about their axis; a cylinder may have waves. The normal is that of the
current position, however far the point slides.

Over a time step the schemes that weight the ends apply the law at the weighted point
x_a = a x0 + (1 - a) x1. The discrete gradient averages the forces along the straight path from x0
to x1, in closed form (`online.contact.friction`). It locates opening, closing and the change from
stick to slip inside the step. After this change the point slips, under the law at the middle of the
rest of the step. This is exact for a point that slides to and fro, and of second order for a point
that changes its direction as it slides.

At the end of the step the law (1)-(5) is applied once more (`commit_contact_state`). With the
discrete gradient, friction then dissipates in every step of any size. Let T be the mean force, T_s
the force at the middle of the slipping part, and dw the motion of the slider:

    T . dx - d(|T|^2 / 2 k_t) = T_s . dw + (what the law at the end takes from the spring) >= 0 (6)

The law is made of functions of a point: they return what they find, in the numbers of
`fenicsrom.online.kernels.numbers`. With the displacement x1 as `Dual` numbers, the force comes with
its derivative. Only `contact_force` and `commit_contact_state` write into arrays; a rejected step
leaves no trace in the state.
"""

from typing import NamedTuple

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import coated_end_force, coated_mean_force, depth, is_coated
from fenicsrom.online.contact.friction import (
    blended,
    friction,
    friction_limits,
    mean_of_positive,
    return_mapping,
)
from fenicsrom.online.contact.state import (
    OPEN,
    SLIP,
    ContactScratch,
    ContactState,
    ContactStep,
    Interval,
)
from fenicsrom.online.contact.surfaces import (
    PLANE,
    Contacts,
    advect_with_surface,
    gap_discrete_gradient,
    surface_turn,
)
from fenicsrom.online.kernels.compilation import compiled, kernel, part
from fenicsrom.online.kernels.numbers import (
    Dual,
    Number,
    Vector,
    constant,
    dot,
    minus,
    plus,
    positive,
    root,
    times,
    value,
    vector,
    write_vector,
)


class PointState(NamedTuple):
    """The state of one contact point; the fields are those of `ContactState`."""

    x: Vector
    trial: Number
    normal: Vector
    friction: Vector
    slider: Vector


class PointForce(NamedTuple):
    """The forces at one contact point over a step.

    Attributes:
        after: y1, N.
        size: mean normal force, N.
        normal: the mean normal force as a vector, N.
        friction: mean friction, N.
        moved: motion of the slider relative to the surface, m.
        mode: OPEN, SLIP or STICK.
    """

    after: Number
    size: Number
    normal: Vector
    friction: Vector
    moved: Vector
    mode: int


@part
def trial_normal_force(contacts: Contacts, p: int, x: Vector, time: Number) -> Number:
    """Equation (1) for point p at x, a vector or (d,), N."""
    return contacts.preload[p] + contacts.normal_stiffness[p] * depth(contacts, p, x, time)


@part
def force_over_step(
    contacts: Contacts, interval: Interval, p: int, start: PointState, after: Number, b: Number
) -> Number:
    """Mean normal force of point p over a step from its start to the trial force y1 `after`, N.

    `b` is the weight of the implicit blending.
    """
    if not interval.discrete_gradient:
        a = interval.start_weight
        return a * positive(start.trial) + (1.0 - a) * positive(after)
    if not is_coated(contacts, p):
        return blended(start.trial, after, b)
    mean = coated_mean_force(contacts, interval, p, start.x, after)
    return mean + b * (positive(coated_end_force(contacts, interval, p, after)) - mean)


@kernel
def implicit_blending(contacts: Contacts, blending: Array) -> None:
    """Write the blending weight b of each point: the weight of its end force in the mean force.

    Where the step is long for the contact, r = k_n G > 1 with the flexibility G of the body at rest
    for such steps, the contact spring would oscillate from step to step instead of transmitting an
    impact, and the limit of friction would oscillate with it. The weight b = r^2/(1 + r^2) prevents
    this. It is of fourth order in the step, so it does not affect a contact that the step resolves.

    Args:
        contacts: the parameters.
        blending: (P,) in: G of each point along its normal, m/N; out: b.
    """
    for p in range(blending.size):
        ratio = contacts.normal_stiffness[p] * blending[p]
        blending[p] = ratio**2 / (1.0 + ratio**2)


@part
def tangential(contacts: Contacts, p: int, n: Vector, e: Vector) -> Vector:
    """The part P e of a vector at point p in the tangent plane of a normal n."""
    if contacts.kind[p] == PLANE:
        return constant(e[0], 0.0), e[1], e[2]
    return minus(e, times(dot(n, e) / dot(n, n), n))


@part
def lifted_vector(x: Number, u: Vector) -> Vector:
    """A vector that does not depend on x, of numbers of the kind of x."""
    return constant(x, u[0]), constant(x, u[1]), constant(x, u[2])


@kernel
def point_force(
    contacts: Contacts, interval: Interval, p: int, start: PointState, x1: Vector, b: Number
) -> PointForce:
    """The law of point p over a step from its start to x1; b as in `force_over_step`."""
    a, theta, line = interval.start_weight, 1.0 - interval.start_weight, interval.discrete_gradient
    begin, end = interval.begin, interval.end
    after = trial_normal_force(contacts, p, x1, end)
    force = force_over_step(contacts, interval, p, start, after, b)
    if not value(force) > 0.0:
        none = lifted_vector(force, (0.0, 0.0, 0.0))
        return PointForce(after, force, none, none, none, OPEN)
    x0 = lifted_vector(x1[0], start.x)
    if line:
        n = gap_discrete_gradient(contacts, p, x0, x1, 0.5 * (begin + end))
        normal = times(force, n)
    else:
        n = gap_discrete_gradient(contacts, p, x1, x1, end)
        normal = plus(times(a, start.normal), times(theta * positive(after), n))
    reach = 1.0 if line else theta
    slider = lifted_vector(x1[0], start.slider)
    ahead = advect_with_surface(contacts, p, begin, begin + reach * (end - begin), slider)
    e0, e1 = minus(x0, slider), minus(plus(x0, times(reach, minus(x1, x0))), ahead)
    if contacts.kind[p] != PLANE:  # the tangent plane is that of the weighted point
        middle = plus(times(a, x0), times(theta, x1))
        n = gap_discrete_gradient(contacts, p, middle, middle, a * begin + theta * end)
    e0, e1 = tangential(contacts, p, n, e0), tangential(contacts, p, n, e1)
    limit = contacts.friction[p] * force
    fraction, first, last = constant(limit, 1.0), limit, limit
    if line:
        fraction, first, last = friction_limits(contacts.friction[p], start.trial, after, force, b)
    stiffness = contacts.tangential_stiffness[p]
    mean, moved, mode = friction(stiffness, first, last, fraction, e0, e1, theta, line)
    return PointForce(after, force, normal, mean, moved, mode)


@part
def start_of(state: ContactState, p: int) -> PointState:
    """The state of point p."""
    return PointState(
        vector(state.x[p]),
        state.trial_normal_force[p],
        vector(state.normal[p]),
        vector(state.friction[p]),
        vector(state.slider[p]),
    )


@part
def write_values(out: Array, u: Vector) -> None:
    """Write the values of a vector of duals into an array (d,)."""
    write_vector(out, (u[0].v, u[1].v, u[2].v))


@kernel
def contact_force(step: ContactStep, p: int) -> bool:
    """Write the mean force of point p over a step to end.x[p], and its derivative, to `scratch`.

    Returns:
        False if the point does not touch during the step.
    """
    scratch, x = step.scratch, vector(step.end.x[p])
    x1 = Dual(x[0], 1.0, 0.0, 0.0), Dual(x[1], 0.0, 1.0, 0.0), Dual(x[2], 0.0, 0.0, 1.0)
    start, b = start_of(step.start, p), scratch.blending[p]
    found = point_force(step.contacts, step.interval, p, start, x1, b)
    step.end.trial_normal_force[p] = found.after.v
    scratch.mean_normal_force[p], scratch.mode[p] = found.size.v, found.mode
    whole, by = plus(found.normal, found.friction), scratch.force_derivative[p]
    write_values(scratch.mean_force[p], whole)
    write_values(scratch.mean_friction[p], found.friction)
    write_values(scratch.slider_motion[p], found.moved)
    write_vector(by[0], (whole[0].a, whole[0].b, whole[0].c))
    write_vector(by[1], (whole[1].a, whole[1].b, whole[1].c))
    if by.shape[0] > 2:
        write_vector(by[2], (whole[2].a, whole[2].b, whole[2].c))
    return found.mode != OPEN


class PointEnd(NamedTuple):
    """The state of one contact point at the end of a step, and the energies of the step.

    Attributes:
        state: the state.
        mode: OPEN, SLIP or STICK.
        dissipated: energy dissipated by friction, J.
        surface: work of the moving surface on body and springs (of a coated surface, all work of
            its normal force), J.
        impact: energy of impacts that the step does not resolve (`implicit_blending`), J.
    """

    state: PointState
    mode: int
    dissipated: Number
    surface: Number
    impact: Number


@kernel
def end_of_step(
    contacts: Contacts, interval: Interval, p: int, start: PointState, x1: Vector, mean: PointForce
) -> PointEnd:
    """Point p at the end x1 of a step, where the law is applied once more."""
    begin, end, line = interval.begin, interval.end, interval.discrete_gradient
    kn, kt = contacts.normal_stiffness[p], contacts.tangential_stiffness[p]
    coated, trial = line and is_coated(contacts, p), mean.after
    if coated:
        trial = coated_end_force(contacts, interval, p, trial)
    pressed = positive(trial)
    n = gap_discrete_gradient(contacts, p, x1, x1, end)
    # the slider moves to the end of the step, where the law is applied
    slider = plus(advect_with_surface(contacts, p, begin, end, start.slider), mean.moved)
    stretch = tangential(contacts, p, n, minus(x1, slider))
    force, mode = return_mapping(kt, contacts.friction[p] * pressed, stretch)
    dissipated, surface, part_kept = friction_energies(
        contacts, interval, p, start, x1, mean.friction, force
    )
    force = times(part_kept, force)
    if mode == SLIP or contacts.kind[p] != PLANE:
        slider = minus(x1, times(1.0 / kt, force))
    if mode == SLIP or mean.mode == SLIP:
        mode = SLIP
    if value(pressed) == 0.0:
        mode = OPEN
    change = trial - start.trial
    turned = surface_turn(contacts, p, begin, end)
    if coated or contacts.times.size > 0 or (contacts.order.size > 0 and turned != 0.0):
        if not coated:
            surface = surface + mean.size * change / kn
        surface = surface - dot(mean.normal, minus(x1, start.x))
    impact = constant(change, 0.0)
    if line and not coated:
        impact = (mean.size - mean_of_positive(start.trial, trial)) * change / kn
    state = PointState(x1, trial, times(pressed, n), force, slider)
    return PointEnd(state, mode, dissipated, surface, impact)


@part
def friction_energies(
    contacts: Contacts,
    interval: Interval,
    p: int,
    start: PointState,
    x1: Vector,
    mean: Vector,
    force: Vector,
) -> tuple[Number, Number, Number]:
    """Energy dissipated by friction in a step (6), and work of the moving surface, J.

    On a curved surface the tangent plane turns in the step, and the friction spring could gain
    energy. The friction at the end is therefore reduced until the spring holds no more energy than
    it was given: the third number is the part of the force that remains.

    Args:
        contacts: the parameters.
        interval: the step.
        p: the point.
        start: its state at the start.
        x1: its displacement at the end, m.
        mean: the mean friction of the step, N.
        force: the friction at its end, N.
    """
    kt, line = contacts.tangential_stiffness[p], interval.discrete_gradient
    advected = advect_with_surface(contacts, p, interval.begin, interval.end, start.x)
    # the schemes that weight the ends compute work by the trapezoidal rule
    acting = mean if line else times(0.5, plus(start.friction, force))
    available = dot(acting, minus(x1, advected)) + 0.5 / kt * dot(start.friction, start.friction)
    stored, kept = 0.5 / kt * dot(force, force), constant(available, 1.0)
    surface = -1.0 * dot(acting, minus(advected, start.x))
    most = positive(available)
    if line and contacts.kind[p] != PLANE and value(stored) > value(most):
        kept, stored = root(most / stored), most
    return available - stored, surface, kept


@kernel
def commit_contact_state(step: ContactStep, p: int) -> tuple[float, float, float]:
    """Write the state of point p at the end of a step; `contact_force` has found its mean force.

    Returns:
        `dissipated`, `surface` and `impact` of `PointEnd`, J.
    """
    scratch, end = step.scratch, step.end
    rubbed = vector(scratch.mean_friction[p])
    mean = PointForce(
        end.trial_normal_force[p],
        scratch.mean_normal_force[p],
        minus(vector(scratch.mean_force[p]), rubbed),
        rubbed,
        vector(scratch.slider_motion[p]),
        scratch.mode[p],
    )
    start, x1 = start_of(step.start, p), vector(end.x[p])
    found = end_of_step(step.contacts, step.interval, p, start, x1, mean)
    end.trial_normal_force[p], end.state[p] = found.state.trial, found.mode
    write_vector(end.normal[p], found.state.normal)
    write_vector(end.friction[p], found.state.friction)
    write_vector(end.slider[p], found.state.slider)
    return found.dissipated, found.surface, found.impact


@kernel
def contact_energy(contacts: Contacts, here: ContactState) -> float:
    """Energy in the contact springs, sum of N^2/(2 k_n) + |T|^2/(2 k_t) over the points, J.

    The normal springs of coated points belong to the layer: their work is that of the surface.
    """
    total = 0.0
    for p in range(here.x.shape[0]):
        if not is_coated(contacts, p):
            pressed = positive(here.trial_normal_force[p])
            total += 0.5 * pressed**2 / contacts.normal_stiffness[p]
        for k in range(here.x.shape[1]):
            total += 0.5 * here.friction[p, k] ** 2 / contacts.tangential_stiffness[p]
    return total


@compiled
def forces_at(step: ContactStep, x: Array) -> None:
    """Write the forces of points at x (P, d), and their derivatives, to `scratch`."""
    for p in range(x.shape[0]):
        for k in range(x.shape[1]):
            step.end.x[p, k] = x[p, k]
        contact_force(step, p)


@compiled
def commit_all(step: ContactStep) -> float:
    """Write the state of all points at the end of a step; returns what friction dissipates, J."""
    spent = 0.0
    for p in range(step.end.x.shape[0]):
        spent += commit_contact_state(step, p)[0]
    return spent


@compiled
def at_rest(
    contacts: Contacts,
    x: Array,
    slider: Array,
    time: float,
    here: ContactState,
    scratch: ContactScratch,
) -> None:
    """Write the state of points at x (P, d) with sliders (P, d): a step of zero length."""
    step = ContactStep(contacts, Interval(time, time, 0.0, False), here, here, scratch)
    for p in range(x.shape[0]):
        for k in range(x.shape[1]):
            here.x[p, k], here.slider[p, k], here.friction[p, k] = x[p, k], slider[p, k], 0.0
        contact_force(step, p)
        commit_contact_state(step, p)
