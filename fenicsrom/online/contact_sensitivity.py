"""Derivative of the contact law over a step, by complex steps through the law itself.

Over a step from x0 to x1 the law gives the mean force F of a point and its slider w1 at the end,
as functions of (x0, x1, w0, blending, parameter). What else the law reads of the start of the step
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
from fenicsrom.online.contact_step import (
    commit_contact_state,
    contact_force,
    trial_normal_force,
)
from fenicsrom.online.friction import positive
from fenicsrom.online.surfaces import PLANE, Contacts, gap_discrete_gradient

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

    The columns of the derivatives are [x0 (d), x1 (d), w0 (d), blending, parameter].

    Attributes:
        contacts: the parameters with the imaginary parts of the perturbation.
        start: the state of the points at the start of the step.
        end: the state at its end.
        scratch: scratch arrays.
        force: (P, d, 3 d + 2) derivative of the mean force.
        slider: (P, d, 3 d + 2) derivative of the slider at the end.
    """

    contacts: Contacts
    start: ContactState
    end: ContactState
    scratch: ContactScratch
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
    contacts: Contacts, p: int, time: complex, here: ContactState, scratch: ContactScratch
) -> None:
    """Write what follows from the displacement and the slider of point p: N n, T = k_t P (x - w).

    Nothing is projected on the limit of friction: the slider is that of an accepted state.
    """
    d = len(scratch.space)
    x, slider, n = here.x[p], here.slider[p], scratch.point.normal
    trial = trial_normal_force(contacts, p, x, time)
    here.trial_normal_force[p] = trial
    pressed, size = positive(trial), 1.0 + 0.0 * trial
    if contacts.kind[p] == PLANE:
        for k in range(d):
            n[k] = 0.0
        n[0] = 1.0
    else:
        gap_discrete_gradient(
            contacts, p, x, x, time, n, scratch.point.normal_derivative, scratch.point.work
        )
        size = n[0] * n[0]
        for k in range(1, d):
            size += n[k] * n[k]
        size = np.sqrt(size)
    for k in range(d):
        here.normal[p, k] = pressed * n[k]
        n[k] /= size
    across = n[0] * (x[0] - slider[0])
    for k in range(1, d):
        across += n[k] * (x[k] - slider[k])
    for k in range(d):
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
    discrete_gradient: bool,
    p: int,
    x0: Array,
    x1: Array,
    w0: Array,
    blending: float,
    follows: bool,
) -> None:
    """Write the derivatives of the law of point p over a step into law.force and law.slider.

    A slider that follows the point has no derivative of its own: the law has a kink at w0 = x0.
    The derivatives by x0 are then taken with w0 = x0, and those by w0 are zero.

    Args:
        law: the arrays.
        contacts: the parameters.
        drift: their derivative by the parameter of the motion.
        begin: start of the step in s; its imaginary part is `STEP` times the derivative by the
            parameter.
        end: end of the step, likewise.
        start_weight: a of the scheme.
        discrete_gradient: see `fenicsrom.online.contact_state.Interval`.
        p: the point.
        x0: (d,) displacement at the start, m.
        x1: (d,) displacement at the end, m.
        w0: (d,) slider at the start, m.
        blending: weight of the normal force at the end of the step.
        follows: whether the slider follows the point at the start: open, or without friction.
    """
    d = x0.size
    start, finish, scratch = law.start, law.end, law.scratch
    perturb(law.contacts, p, contacts, drift, 0.0)
    interval = Interval(
        complex(begin.real, 0.0), complex(end.real, 0.0), start_weight, discrete_gradient
    )
    for c in range(3 * d + 2):
        if follows and 2 * d <= c < 3 * d:
            for k in range(d):
                law.force[p, k, c] = 0.0
                law.slider[p, k, c] = 0.0
            continue
        if c == 3 * d + 1:
            perturb(law.contacts, p, contacts, drift, STEP)
            interval = Interval(begin, end, start_weight, discrete_gradient)
        for k in range(d):
            start.x[p, k] = complex(x0[k], STEP if c == k else 0.0)
            finish.x[p, k] = complex(x1[k], STEP if c == d + k else 0.0)
            moved = (c == 2 * d + k and not follows) or (c == k and follows)
            start.slider[p, k] = complex(w0[k], STEP if moved else 0.0)
        scratch.blending[p] = complex(blending, STEP if c == 3 * d else 0.0)
        state_of(law.contacts, p, interval.begin, start, scratch)
        contact_force(law.contacts, interval, p, start, finish, scratch)
        commit_contact_state(law.contacts, interval, p, start, finish, scratch)
        for k in range(d):
            law.force[p, k, c] = scratch.mean_force[p, k].imag / STEP
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
    here, scratch = law.end, law.scratch
    for c in range(2 * d + 1):
        perturb(law.contacts, p, contacts, drift, STEP if c == 2 * d else 0.0)
        for k in range(d):
            here.x[p, k] = complex(x[k], STEP if c == k else 0.0)
            here.slider[p, k] = complex(w[k], STEP if c == d + k else 0.0)
            here.friction[p, k] = 0.0
        scratch.blending[p] = 0.0
        interval = Interval(0j, 0j, 0.0, False)
        contact_force(law.contacts, interval, p, here, here, scratch)
        commit_contact_state(law.contacts, interval, p, here, here, scratch)
        column = 3 * d + 1 if c == 2 * d else c
        for k in range(d):
            law.slider[p, k, column] = here.slider[p, k].imag / STEP
