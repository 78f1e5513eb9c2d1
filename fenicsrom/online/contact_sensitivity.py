"""Derivative of the contact law over a step, by complex steps through the law itself.

Over a step from x0 to x1 the law gives the mean force F of a point and its slider w1 at the end,
as functions of (x0, x1, w0, lean, parameter). What else the law reads of the start of the step
follows from these: the trial normal force, the normal force and the friction k_t P (x0 - w0).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import kernel, part
from fenicsrom.online.complex_step import STEP, as_complex
from fenicsrom.online.contact_state import (
    ContactScratch,
    ContactState,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact_step import over_step, settle
from fenicsrom.online.surfaces import PLANE, Contacts, direction, penetration

# the parameters of the contacts by which a motion can be differentiated
PARAMETERS = (
    "preload",
    "normal_stiffness",
    "tangential_stiffness",
    "friction",
    "radius",
    "spin",
    "approach",
    "height",
    "phase",
)


class LawDerivative(NamedTuple):
    """Complex arrays in which the law is evaluated, and its derivatives.

    The columns of the derivatives are [x0 (d), x1 (d), w0 (d), lean, parameter].

    Attributes:
        contacts: the parameters with the imaginary parts of the perturbation.
        start: the state of the points at the start of the step.
        end: the state at its end.
        room: scratch arrays.
        force: (P, d, 3 d + 2) derivative of the mean force.
        slider: (P, d, 3 d + 2) derivative of the slider at the end.
    """

    contacts: Contacts
    start: ContactState
    end: ContactState
    room: ContactScratch
    force: Array
    slider: Array


def law_derivative(contacts: Contacts, points: int, d: int) -> LawDerivative:
    """Arrays for P points in d dimensions."""
    return LawDerivative(
        as_complex(contacts, PARAMETERS),
        as_complex(zero_contact_state(points, d)),
        as_complex(zero_contact_state(points, d)),
        as_complex(contact_scratch(points, d)),
        np.zeros((points, d, 3 * d + 2)),
        np.zeros((points, d, 3 * d + 2)),
    )


@part
def perturb(contacts: Contacts, p: int, base: Contacts, drift: Contacts, size: float) -> None:
    """Set the parameters of point p to base + i size drift."""
    contacts.preload[p] = complex(base.preload[p], size * drift.preload[p])
    contacts.normal_stiffness[p] = complex(
        base.normal_stiffness[p], size * drift.normal_stiffness[p]
    )
    contacts.tangential_stiffness[p] = complex(
        base.tangential_stiffness[p], size * drift.tangential_stiffness[p]
    )
    contacts.friction[p] = complex(base.friction[p], size * drift.friction[p])
    contacts.radius[p] = complex(base.radius[p], size * drift.radius[p])
    contacts.spin[p] = complex(base.spin[p], size * drift.spin[p])
    for k in range(base.times.size):
        contacts.approach[p, k] = complex(base.approach[p, k], size * drift.approach[p, k])
    for k in range(base.order.size):
        contacts.height[p, k] = complex(base.height[p, k], size * drift.height[p, k])
        contacts.phase[p, k] = complex(base.phase[p, k], size * drift.phase[p, k])


@part
def state_of(
    contacts: Contacts, p: int, time: complex, here: ContactState, room: ContactScratch
) -> None:
    """Write what follows from the displacement and the slider of point p: N n, T = k_t P (x - w).

    Nothing is projected on the limit of friction: the slider is that of an accepted state.
    """
    d = len(room.space)
    x, slider, n = here.x[p], here.slider[p], room.vectors[0]
    trial = contacts.preload[p] + contacts.normal_stiffness[p] * penetration(contacts, p, x, time)
    here.raw[p] = trial
    if contacts.kind[p] == PLANE:
        for k in range(d):
            n[k] = 0.0
        n[0] = 1.0
    else:
        direction(contacts, p, x, x, time, n, room.matrices[0], room.vectors[1])
        size = n[0] * n[0]
        for k in range(1, d):
            size += n[k] * n[k]
        size = np.sqrt(size)
        for k in range(d):
            n[k] /= size
    across = n[0] * (x[0] - slider[0])
    for k in range(1, d):
        across += n[k] * (x[k] - slider[k])
    pressed = max(trial, 0.0)
    for k in range(d):
        here.normal[p, k] = pressed * n[k]
        here.friction[p, k] = contacts.tangential_stiffness[p] * (x[k] - slider[k] - across * n[k])
        if not trial > 0.0:
            here.friction[p, k] = 0.0


@kernel
def differentiate_law(
    law: LawDerivative,
    contacts: Contacts,
    drift: Contacts,
    begin: complex,
    end: complex,
    start_weight: float,
    line: bool,
    p: int,
    x0: Array,
    x1: Array,
    w0: Array,
    lean: float,
) -> None:
    """Write the derivatives of the law of point p over a step into law.force and law.slider.

    Args:
        law: the arrays.
        contacts: the parameters.
        drift: their derivative by the parameter of the motion.
        begin: start of the step in s; its imaginary part is `STEP` times the derivative by the
            parameter.
        end: end of the step, likewise.
        start_weight: a of the scheme.
        line: see `fenicsrom.online.contact_state.Interval`.
        p: the point.
        x0: (d,) displacement at the start, m.
        x1: (d,) displacement at the end, m.
        w0: (d,) slider at the start, m.
        lean: of the normal force to the end of the step.
    """
    d = x0.size
    start, finish, room = law.start, law.end, law.room
    perturb(law.contacts, p, contacts, drift, 0.0)
    interval = Interval(complex(begin.real, 0.0), complex(end.real, 0.0), start_weight, line)
    for c in range(3 * d + 2):
        if c == 3 * d + 1:
            perturb(law.contacts, p, contacts, drift, STEP)
            interval = Interval(begin, end, start_weight, line)
        for k in range(d):
            start.x[p, k] = complex(x0[k], STEP if c == k else 0.0)
            finish.x[p, k] = complex(x1[k], STEP if c == d + k else 0.0)
            start.slider[p, k] = complex(w0[k], STEP if c == 2 * d + k else 0.0)
        room.lean[p] = complex(lean, STEP if c == 3 * d else 0.0)
        state_of(law.contacts, p, interval.begin, start, room)
        over_step(law.contacts, interval, p, start, finish, room)
        settle(law.contacts, interval, p, start, finish, room)
        for k in range(d):
            law.force[p, k, c] = room.mean[p, k].imag / STEP
            law.slider[p, k, c] = finish.slider[p, k].imag / STEP


@kernel
def differentiate_rest(
    law: LawDerivative,
    contacts: Contacts,
    drift: Contacts,
    p: int,
    x: Array,
    w: Array,
) -> None:
    """Write the derivative of the slider that `at_rest` accepts at x into law.slider.

    Its columns are [x (d), w (d), 0 .., parameter].
    """
    d = x.size
    here, room = law.end, law.room
    for c in range(2 * d + 1):
        perturb(law.contacts, p, contacts, drift, STEP if c == 2 * d else 0.0)
        for k in range(d):
            here.x[p, k] = complex(x[k], STEP if c == k else 0.0)
            here.slider[p, k] = complex(w[k], STEP if c == d + k else 0.0)
            here.friction[p, k] = 0.0
        room.lean[p] = 0.0
        interval = Interval(0j, 0j, 0.0, False)
        over_step(law.contacts, interval, p, here, here, room)
        settle(law.contacts, interval, p, here, here, room)
        column = 3 * d + 1 if c == 2 * d else c
        for k in range(d):
            law.slider[p, k, column] = here.slider[p, k].imag / STEP
