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

Functions read the last accepted state and write into arrays of the caller: a rejected step leaves
no trace.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import (
    coated_end_force,
    coated_mean_force,
    depth,
    is_coated,
)
from fenicsrom.online.contact.friction import (
    blended_normal_force,
    friction_force,
    mean_normal_force,
    positive,
    project_on_tangent_plane,
    return_mapping,
)
from fenicsrom.online.contact.state import (
    OPEN,
    SLIP,
    STICK,
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


@part
def trial_normal_force(contacts: Contacts, p: int, x: Array, time: float) -> float:
    """Equation (1) for point p at x (d,), N."""
    return contacts.preload[p] + contacts.normal_stiffness[p] * depth(contacts, p, x, time)


@part
def force_over_step(step: ContactStep, p: int, after: float) -> tuple[float, float]:
    """Mean normal force of point p over a step of the discrete gradient, blended with the end's.

    Args:
        step: the step.
        p: the point.
        after: y1, N.

    Returns:
        The force in N, and its derivative by `after`.
    """
    contacts, interval, blending = step.contacts, step.interval, step.scratch.blending[p]
    if not is_coated(contacts, p):
        return blended_normal_force(step.start.trial_normal_force[p], after, blending)
    mean, mean_by_end = coated_mean_force(contacts, interval, p, step.start.x[p], after)
    end, end_by_end = coated_end_force(contacts, interval, p, after)
    if not end > 0.0:
        end, end_by_end = 0.0 * end, 0.0 * end
    return mean + blending * (end - mean), mean_by_end + blending * (end_by_end - mean_by_end)


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


@kernel
def _add_normal_force(step: ContactStep, p: int, force: float, force_by_end: float) -> None:
    """Write the mean normal force of point p as a vector, its derivative, and `point.gradient`."""
    contacts, start, end = step.contacts, step.start, step.end
    interval, scratch = step.interval, step.scratch
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    kn, x1, d = contacts.normal_stiffness[p], end.x[p], len(scratch.space)
    point, mean, derivative = scratch.point, scratch.mean_force[p], scratch.force_derivative[p]
    gradient, bend = point.gradient, point.gradient_derivative
    if contacts.kind[p] == PLANE:
        for k in range(d):
            gradient[k] = 0.0
        gradient[0] = 1.0
        mean[0] = force
        derivative[0, 0] = force_by_end * kn
        return
    gap_discrete_gradient(contacts, p, x1, x1, interval.end, gradient, bend, point.work)
    if interval.discrete_gradient:
        n, n_derivative = point.mean_normal, point.mean_normal_derivative
        middle = 0.5 * (interval.begin + interval.end)
        gap_discrete_gradient(contacts, p, start.x[p], x1, middle, n, n_derivative, point.work)
        for k in range(d):
            mean[k] = force * n[k]
            for j in range(d):
                derivative[k, j] = (
                    force_by_end * kn * n[k] * gradient[j] + force * n_derivative[k, j]
                )
        return
    pressed = positive(end.trial_normal_force[p])
    for k in range(d):
        mean[k] = a * start.normal[p, k] + theta * pressed * gradient[k]
        for j in range(d):
            derivative[k, j] = (
                force_by_end * kn * gradient[k] * gradient[j] + theta * pressed * 2.0 * bend[k, j]
            )


@kernel
def _tangential_stretch(step: ContactStep, p: int) -> None:
    """Write the unit normal of point p and its tangential stretch at both ends, with derivatives.

    For the discrete gradient, the end is the end of the step; otherwise it is the weighted point.
    The tangent plane is taken at the weighted point.
    """
    contacts, interval, start = step.contacts, step.interval, step.start
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    x0, x1, d, point = start.x[p], step.end.x[p], len(step.scratch.space), step.scratch.point
    n, bend, work = point.normal, point.normal_derivative, point.work
    e0, e0_derivative = point.start_stretch, point.start_stretch_derivative
    e1, e1_derivative = point.end_stretch, point.end_stretch_derivative
    reach = 1.0 if interval.discrete_gradient else theta
    until = interval.begin + reach * (interval.end - interval.begin)
    advect_with_surface(contacts, p, interval.begin, until, start.slider[p], point.place)
    for k in range(d):
        n[k] = point.gradient[k]
        e0[k] = x0[k] - start.slider[p, k]
        e1[k] = x0[k] + reach * (x1[k] - x0[k]) - point.place[k]
    if contacts.kind[p] == PLANE:
        e0[0], e1[0] = 0.0, 0.0
        for k in range(d):
            for j in range(d):
                e0_derivative[k, j] = 0.0
                e1_derivative[k, j] = reach if k == j and k > 0 else 0.0
        return
    middle = point.place
    for k in range(d):
        middle[k] = a * x0[k] + theta * x1[k]
    time = a * interval.begin + theta * interval.end
    gap_discrete_gradient(contacts, p, middle, middle, time, n, bend, work)
    size = 0.0
    for k in range(d):
        size += n[k] ** 2
    size = np.sqrt(size)
    for k in range(d):
        n[k] /= size
    for j in range(d):
        work[j] = 0.0
        for i in range(d):
            work[j] += 2.0 * n[i] * bend[i, j]
    for k in range(d):
        for j in range(d):
            bend[k, j] = theta * (2.0 * bend[k, j] - n[k] * work[j]) / size
    project_on_tangent_plane(n, bend, 0.0, e0, e0_derivative, work)
    project_on_tangent_plane(n, bend, reach, e1, e1_derivative, work)


@kernel
def contact_force(step: ContactStep, p: int, derive: bool) -> bool:
    """Mean force of point p over a step to end.x[p], its derivative and its parts, in `scratch`.

    Without `derive`, the derivative lacks the friction.

    Returns:
        False if the point does not touch during the step.
    """
    contacts, interval, scratch = step.contacts, step.interval, step.scratch
    a, theta = interval.start_weight, 1.0 - interval.start_weight
    d = len(scratch.space)
    before = step.start.trial_normal_force[p]
    after = trial_normal_force(contacts, p, step.end.x[p], interval.end)
    step.end.trial_normal_force[p] = after
    if interval.discrete_gradient:
        force, force_by_end = force_over_step(step, p, after)
    else:
        force = a * positive(before) + theta * positive(after)
        force_by_end = theta if after > 0.0 else 0.0
    scratch.mean_normal_force[p] = force
    for k in range(d):
        scratch.mean_force[p, k] = 0.0
        scratch.mean_friction[p, k] = 0.0
        scratch.slider_motion[p, k] = 0.0
        for j in range(d):
            scratch.force_derivative[p, k, j] = 0.0
    if not force > 0.0:
        scratch.mode[p] = OPEN
        return False
    _add_normal_force(step, p, force, force_by_end)
    _tangential_stretch(step, p)
    for k in range(d):  # from the gradient of the penetration to the gradient of `after`
        scratch.point.gradient[k] *= contacts.normal_stiffness[p]
    friction_force(step, p, after, force, force_by_end, derive)
    for k in range(d):
        scratch.mean_force[p, k] += scratch.mean_friction[p, k]
    return True


@kernel
def commit_contact_state(step: ContactStep, p: int) -> tuple[float, float, float]:
    """Write the state of point p at the end of a step; `contact_force` has found its mean force.

    Returns:
        The energy dissipated by friction, the work of the moving surface on body and springs (of a
        coated surface, all work of its normal force), and the energy of impacts that the step does
        not resolve (`implicit_blending`), J.
    """
    contacts, start, end = step.contacts, step.start, step.end
    interval, scratch = step.interval, step.scratch
    kt, d = contacts.tangential_stiffness[p], len(scratch.space)
    x1, slider, force, point = end.x[p], end.slider[p], end.friction[p], scratch.point
    n, stretch, bend, work = point.normal, point.slip_stretch, point.normal_derivative, point.work
    coated = interval.discrete_gradient and is_coated(contacts, p)
    if coated:
        force_at_end, _ = coated_end_force(contacts, interval, p, end.trial_normal_force[p])
        end.trial_normal_force[p] = force_at_end
    pressed = positive(end.trial_normal_force[p])
    gap_discrete_gradient(contacts, p, x1, x1, interval.end, n, bend, work)
    size = 0.0
    for k in range(d):
        size += n[k] ** 2
    size = np.sqrt(size)
    for k in range(d):
        end.normal[p, k] = pressed * n[k]
        n[k] /= size
    # the slider moves to the end of the step, where the law is applied
    advect_with_surface(contacts, p, interval.begin, interval.end, start.slider[p], slider)
    for k in range(d):
        slider[k] += scratch.slider_motion[p, k]
        stretch[k] = x1[k] - slider[k]
    mode, _ = return_mapping(kt, contacts.friction[p] * pressed, n, stretch, force)
    slips = mode == SLIP or scratch.mode[p] == SLIP
    end.state[p] = OPEN if pressed == 0.0 else SLIP if slips else STICK
    dissipated, surface = _friction_energies(step, p)
    if mode == SLIP or contacts.kind[p] != PLANE:
        for k in range(d):
            slider[k] = x1[k] - force[k] / kt
    change = end.trial_normal_force[p] - start.trial_normal_force[p]
    normal = scratch.mean_normal_force[p]
    turned = surface_turn(contacts, p, interval.begin, interval.end)
    moves = contacts.times.size > 0 or (contacts.order.size > 0 and turned != 0.0)
    if moves or coated:
        if not coated:
            surface += normal * change / contacts.normal_stiffness[p]
        for k in range(d):
            surface -= (scratch.mean_force[p, k] - scratch.mean_friction[p, k]) * (
                x1[k] - start.x[p, k]
            )
    impact = 0.0
    if interval.discrete_gradient and not coated:
        mean, _ = mean_normal_force(start.trial_normal_force[p], end.trial_normal_force[p])
        impact = (normal - mean) * change / contacts.normal_stiffness[p]
    return dissipated, surface, impact


@kernel
def _friction_energies(step: ContactStep, p: int) -> tuple[float, float]:
    """Energy dissipated by friction in a step (6), and work of the moving surface.

    On a curved surface the tangent plane turns in the step, and the friction spring could gain
    energy. The friction at the end is therefore reduced until the spring holds no more energy than
    it was given.
    """
    contacts, start, end = step.contacts, step.start, step.end
    interval, scratch = step.interval, step.scratch
    kt, d = contacts.tangential_stiffness[p], len(scratch.space)
    x0, x1, force, advected = start.x[p], end.x[p], end.friction[p], scratch.point.place
    advect_with_surface(contacts, p, interval.begin, interval.end, x0, advected)
    available, stored, surface = 0.0, 0.0, 0.0
    for k in range(d):  # the schemes that weight the ends compute work by the trapezoidal rule
        mean = (
            scratch.mean_friction[p, k]
            if interval.discrete_gradient
            else 0.5 * (start.friction[p, k] + force[k])
        )
        available += mean * (x1[k] - advected[k]) + 0.5 * start.friction[p, k] ** 2 / kt
        stored += 0.5 * force[k] ** 2 / kt
        surface -= mean * (advected[k] - x0[k])
    if interval.discrete_gradient and contacts.kind[p] != PLANE and stored > available:
        factor = np.sqrt(positive(available) / stored)
        for k in range(d):
            force[k] *= factor
        stored = positive(available)
    return available - stored, surface


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
        contact_force(step, p, True)
        commit_contact_state(step, p)
