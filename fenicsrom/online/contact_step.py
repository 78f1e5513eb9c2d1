"""Friction between points of the structure and rigid surfaces: one statement of the law, for every
model.

A point is described by its displacement x (d,) in its own frame, whose first axis is the normal
into the surface at the place of the undeformed body, the others tangents there. The forces below
act against the motion: the residual of the equations of motion gains + B F. With the penetration
delta(x, t) of the surface, n = grad delta, P = I - n n^T / |n|^2 and the slider w, a point of the
surface that friction pulls the body towards,

    y = N0 + k_n delta                         N = max(0, y)                the normal force is N n
    T = k_t P (x - w)                          if |T| <= mu N               stick, the slider rests
    on the surface T = mu N T/|T|                             otherwise                    slip, the
    slider is dragged: w = x - T/k_t T = 0, w = x                               if N = 0
    open, the slider follows

Surfaces are planes, cylinders and spheres, seen from inside (a casing) or outside, that may close
in on the body and turn about their axis; a cylinder may have waves. The normal is that of the
current position, however far the point slides.

Over a time step the forces are weighted means of those at its ends, or (the discrete gradient)
means along the straight way of the point, as the scheme asks. Along the way every change of state
is located within the step, in closed form: opening and closing, and, with the limit of friction
that goes with the normal force, where stick turns to slip (`rub`). What is left of the step slips
under the law at its middle: exact for a point that slides to and fro, of second order for one that
turns as it slides. Where the contact is too stiff for the step, the mean normal force leans to that
at the end, which takes energy from what would ring (`lean_to_the_end`); when a touch begins leans
with it (`touch_lasts`). The weighted schemes apply the law at the weighted point x_w = a x0 + (1 -
a) x1, from which the slider moves on to the end, w1 = w0 + (w_w - w0)/(1 - a).

At the end the law is applied once more. In the discrete gradient friction so dissipates in every
step, whatever its size: with the mean force T and, in the slipping part, T_s at its middle and the
way dw of the slider,

    T . dx - d(|T|^2 / 2 k_t) = T_s . dw + (what the law at the ends takes from the spring) >= 0

Everything is pure: it reads the last accepted state and writes into arrays of the caller; a
rejected step leaves no trace.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import compiled, part
from fenicsrom.online.contact_state import OPEN, SLIP, STICK, ContactScratch, ContactState, Interval
from fenicsrom.online.friction import (
    into_the_plane,
    leaning_normal_force,
    mean_normal_force,
    return_mapping,
    rub,
)
from fenicsrom.online.surfaces import PLANE, Contacts, carry, direction, penetration


@part
def lean_to_the_end(
    contacts: Contacts,
    interval: Interval,
    compliance: Array,
    here: ContactState,
    room: ContactScratch,
) -> None:
    """Say how far the mean normal force of each point is to lean to the end of the step:
    `room.lean`.

    Where the step is long for the contact, s = k_n n^T G n > 1, its spring would ring from step to
    step instead of passing on an impact, and with it the limit of friction. The lean s^2/(1 + s^2)
    stops that; it is of the fourth order in the step, and so leaves a contact that the step
    resolves as it is.

    Args:
        contacts: the parameters.
        interval: the step.
        compliance: (m, m) G, contact displacement at the end of the step by mean contact force,
        m/N.
        here: the state at the start of the step.
        room: its `lean` is written.
    """
    d = here.x.shape[1]
    n = room.vectors[0]
    for p in range(here.x.shape[0]):
        room.lean[p] = 0.0
        if not interval.line:
            continue
        give = compliance[p * d, p * d]
        if contacts.kind[p] != PLANE:
            direction(
                contacts,
                p,
                here.x[p],
                here.x[p],
                interval.begin,
                n,
                room.matrices[0],
                room.vectors[1],
            )
            give = 0.0
            for k in range(d):
                for j in range(d):
                    give += n[k] * compliance[p * d + k, p * d + j] * n[j]
        ratio = contacts.normal_stiffness[p] * give
        room.lean[p] = ratio**2 / (1.0 + ratio**2)


@part
def over_step(
    contacts: Contacts,
    interval: Interval,
    p: int,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
) -> bool:
    """The mean force of point p over a step to end.x[p], its slope and its parts, into `room`;
    False if it does not touch.
    """
    a = interval.start_weight
    theta = 1.0 - a
    kn = contacts.normal_stiffness[p]
    x0, x1, mean, slope = start.x[p], end.x[p], room.mean[p], room.slopes[p]
    d = len(room.space)
    before = start.raw[p]
    after = contacts.preload[p] + kn * penetration(contacts, p, x1, interval.end)
    end.raw[p] = after
    if interval.line:
        push, by_after = leaning_normal_force(before, after, room.lean[p])
    else:
        push = a * max(before, 0.0) + theta * max(after, 0.0)
        by_after = theta if after > 0.0 else 0.0
    room.push[p] = push
    for k in range(d):
        mean[k] = 0.0
        room.rubbing[p, k] = 0.0
        room.slip[p, k] = 0.0
        for j in range(d):
            slope[k, j] = 0.0
    if not push > 0.0:
        room.motion[p] = OPEN
        return False
    flat = contacts.kind[p] == PLANE
    n, steepest, there = room.vectors[0], room.vectors[1], room.vectors[5]
    bend, spare = room.matrices[0], room.matrices[1]
    if flat:
        for k in range(d):
            steepest[k] = 0.0
        steepest[0] = 1.0
        mean[0] = push
        slope[0, 0] = by_after * kn
    else:
        direction(contacts, p, x1, x1, interval.end, steepest, bend, there)
        if interval.line:
            direction(contacts, p, x0, x1, 0.5 * (interval.begin + interval.end), n, spare, there)
            for k in range(d):
                mean[k] = push * n[k]
                for j in range(d):
                    slope[k, j] = by_after * kn * n[k] * steepest[j] + push * spare[k, j]
        else:
            for k in range(d):
                mean[k] = a * start.normal[p, k] + theta * max(after, 0.0) * steepest[k]
                for j in range(d):
                    slope[k, j] = (
                        by_after * kn * steepest[k] * steepest[j]
                        + theta * max(after, 0.0) * 2.0 * bend[k, j]
                    )
    # friction: the way of the stretch in the tangent plane, from the start of the step to its end
    # or the weighted point
    reach = 1.0 if interval.line else theta
    begin, finish, by_begin, by_finish = (
        room.vectors[2],
        room.vectors[3],
        room.matrices[2],
        room.matrices[3],
    )
    carry(contacts, p, reach * (interval.end - interval.begin), start.slider[p], finish)
    for k in range(d):
        n[k] = steepest[k]
        begin[k] = x0[k] - start.slider[p, k]
        finish[k] = x0[k] + reach * (x1[k] - x0[k]) - finish[k]
    if flat:
        begin[0], finish[0] = 0.0, 0.0
        for k in range(d):
            for j in range(d):
                by_begin[k, j] = 0.0
                by_finish[k, j] = reach if k == j and k > 0 else 0.0
    else:
        middle = room.vectors[4]
        for k in range(d):
            middle[k] = a * x0[k] + theta * x1[k]
        direction(
            contacts, p, middle, middle, a * interval.begin + theta * interval.end, n, bend, there
        )
        size = 0.0
        for k in range(d):
            size += n[k] ** 2
        size = np.sqrt(size)
        for k in range(d):
            n[k] /= size
        for j in range(d):
            there[j] = 0.0
            for i in range(d):
                there[j] += 2.0 * n[i] * bend[i, j]
        for k in range(d):  # bend: the derivative of the unit normal by x1
            for j in range(d):
                bend[k, j] = theta * (2.0 * bend[k, j] - n[k] * there[j]) / size
        into_the_plane(n, bend, 0.0, begin, by_begin, there)
        into_the_plane(n, bend, reach, finish, by_finish, there)
    for k in range(d):
        steepest[k] *= kn  # the derivative of `after`
    rub(contacts, interval, p, before, after, push, by_after, room)
    for k in range(d):
        mean[k] += room.rubbing[p, k]
    return True


@part
def settle(
    contacts: Contacts,
    interval: Interval,
    p: int,
    start: ContactState,
    end: ContactState,
    room: ContactScratch,
) -> tuple[float, float, float]:
    """The state of point p at the end of a step whose mean force `over_step` has found.

    Returns:
        The energy that friction dissipates, the work that the motion of the surface does on body
        and springs, and the energy of impacts that the step does not resolve (`lean_to_the_end`),
        J.
    """
    kt = contacts.tangential_stiffness[p]
    x0, x1, slider, force, normal = (
        start.x[p],
        end.x[p],
        end.slider[p],
        end.friction[p],
        end.normal[p],
    )
    d = len(room.space)
    length = interval.end - interval.begin
    mean, rubbing, push = room.mean[p], room.rubbing[p], room.push[p]
    n, stretch, there, carried = room.vectors[0], room.vectors[1], room.vectors[2], room.vectors[3]
    pressed = max(end.raw[p], 0.0)
    size = 1.0
    if contacts.kind[p] == PLANE:
        for k in range(d):
            n[k] = 0.0
        n[0] = 1.0
    else:
        direction(contacts, p, x1, x1, interval.end, n, room.matrices[0], there)
        size = 0.0
        for k in range(d):
            size += n[k] ** 2
        size = np.sqrt(size)
    for k in range(d):
        normal[k] = pressed * n[k]
        n[k] /= size
    # the slider moves on to the end of the step, and the law is applied there
    carry(contacts, p, length, start.slider[p], slider)
    for k in range(d):
        slider[k] += room.slip[p, k]
        stretch[k] = x1[k] - slider[k]
    motion, _ = return_mapping(kt, contacts.friction[p] * pressed, n, stretch, force)
    slips = motion == SLIP or room.motion[p] == SLIP
    end.state[p] = OPEN if pressed == 0.0 else SLIP if slips else STICK
    # energies
    carry(contacts, p, length, x0, carried)
    available, stored, surface = 0.0, 0.0, 0.0
    for k in range(
        d
    ):  # the schemes that balance forces at weighted ends do work by the trapezoidal rule
        rub = rubbing[k] if interval.line else 0.5 * (start.friction[p, k] + force[k])
        available += rub * (x1[k] - carried[k]) + 0.5 * start.friction[p, k] ** 2 / kt
        stored += 0.5 * force[k] ** 2 / kt
        surface -= rub * (carried[k] - x0[k])
    if interval.line and contacts.kind[p] != PLANE and stored > available:
        # the tangent plane has turned: the spring keeps what it was given
        factor = np.sqrt(max(available, 0.0) / stored)
        for k in range(d):
            force[k] *= factor
        stored = max(available, 0.0)
    if motion == SLIP or contacts.kind[p] != PLANE:
        for k in range(d):
            slider[k] = x1[k] - force[k] / kt
    if contacts.times.size > 0 or (contacts.order.size > 0 and contacts.spin[p] != 0.0):
        surface += push * (end.raw[p] - start.raw[p]) / contacts.normal_stiffness[p]
        for k in range(d):
            surface -= (mean[k] - rubbing[k]) * (x1[k] - x0[k])
    lost = 0.0
    if interval.line:
        mean_push, _ = mean_normal_force(start.raw[p], end.raw[p])
        lost = (push - mean_push) * (end.raw[p] - start.raw[p]) / contacts.normal_stiffness[p]
    return available - stored, surface, lost


@part
def contact_energy(contacts: Contacts, here: ContactState) -> float:
    """Energy in the contact springs, sum of N^2/(2 k_n) + |T|^2/(2 k_t) over the points, J."""
    total = 0.0
    for p in range(here.x.shape[0]):
        total += 0.5 * max(here.raw[p], 0.0) ** 2 / contacts.normal_stiffness[p]
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
    room: ContactScratch,
) -> None:
    """Write the state of points at x (P, d) with sliders (P, d) into `here`: the law at a given
    displacement.

    A step of no length that ends where it starts.
    """
    here.x[:] = x
    here.slider[:] = slider
    here.friction[:] = 0.0
    interval = Interval(time, time, 0.0, False)
    for p in range(x.shape[0]):
        over_step(contacts, interval, p, here, here, room)
        settle(contacts, interval, p, here, here, room)
