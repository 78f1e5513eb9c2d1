"""Derivative of the contact law over a step, by complex steps through the law itself.

Only a point that sticks to a plane has a closed form, which most steps of most motions need.

Over a step from x0 to x1 the law gives the mean force F of a point and its slider w1 at the end,
as functions of (x0, x1, w0, parameter). What else the law reads of the start of the step
follows from these: the trial normal force, the normal force and the friction k_t P (x0 - w0).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.coating import is_coated
from fenicsrom.online.contact.friction import positive
from fenicsrom.online.contact.law import commit_contact_state, contact_force, trial_normal_force
from fenicsrom.online.contact.state import (
    STICK,
    ContactScratch,
    ContactState,
    ContactStep,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import PLANE, Contacts, gap_discrete_gradient
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.dense import STEP, as_complex
from fenicsrom.online.model.loads import LoadHistories

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


class ComplexInterval(NamedTuple):
    """An `Interval`; the imaginary parts of its times are `STEP` times their derivatives."""

    begin: complex
    end: complex
    start_weight: float
    discrete_gradient: bool


class LawDerivative(NamedTuple):
    """Complex arrays in which the law is evaluated, and its derivatives.

    The columns of the derivatives are [x0 (d), x1 (d), w0 (d), parameter].

    Attributes:
        contacts: the parameters with the imaginary parts of the perturbation.
        start: the state of the points at the start of the step.
        end: the state at its end.
        scratch: scratch arrays.
        force: (P, d, 3 d + 1) derivative of the mean force.
        slider: (P, d, 3 d + 1) derivative of the slider at the end.
    """

    contacts: Contacts
    start: ContactState
    end: ContactState
    scratch: ContactScratch
    force: Array
    slider: Array


def law_derivative(contacts: Contacts, points: int, d: int) -> LawDerivative:
    """Arrays for P points in d dimensions.

    `scratch.space` is an array, so that one compilation serves all dimensions.
    """
    return LawDerivative(
        as_complex(contacts, PARAMETERS),
        as_complex(zero_contact_state(points, d)),
        as_complex(zero_contact_state(points, d)),
        as_complex(contact_scratch(points, d))._replace(space=np.zeros(d, dtype=np.int64)),
        np.zeros((points, d, 3 * d + 1)),
        np.zeros((points, d, 3 * d + 1)),
    )


@kernel
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


@kernel
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


@part
def is_constant(contacts: Contacts, drift: Contacts, p: int) -> bool:
    """Whether the law of point p does not depend on the parameter: nor data, nor the surface."""
    found = contacts.times.size == 0 and contacts.spin[p] == 0.0 and drift.spin[p] == 0.0
    found = found and drift.preload[p] == 0.0 and drift.friction[p] == 0.0
    found = found and drift.normal_stiffness[p] == 0.0 and drift.tangential_stiffness[p] == 0.0
    found = found and drift.radius[p] == 0.0
    for k in range(contacts.order.size):
        found = found and drift.height[p, k] == 0.0 and drift.phase[p, k] == 0.0
    return found


@part
def sticks(law: LawDerivative, contacts: Contacts, p: int) -> bool:
    """Whether point p, at which the law was evaluated, sticks to a plane during the whole step."""
    start, end, scratch = law.start, law.end, law.scratch
    found = contacts.kind[p] == PLANE and not is_coated(contacts, p)
    found = found and start.trial_normal_force[p] > 0.0 and end.trial_normal_force[p] > 0.0
    found = found and scratch.mode[p] == STICK and end.state[p] == STICK
    for k in range(len(scratch.space)):
        found = found and scratch.slider_motion[p, k].real == 0.0
    return found


@kernel
def write_sticking(
    law: LawDerivative, contacts: Contacts, p: int, start_weight: float, blending: complex
) -> None:
    """Write the derivatives of a point that sticks to a plane: springs between x and w0."""
    d, force, start, end = len(law.scratch.space), law.force[p], law.start, law.end
    share, stiffness = start_weight * (1.0 - blending.real), contacts.normal_stiffness[p]
    change = end.trial_normal_force[p].real - start.trial_normal_force[p].real
    force[0, 3 * d] = (1.0 - start_weight) * change * blending.imag / STEP
    for k in range(d):
        force[k, k], force[k, d + k] = share * stiffness, (1.0 - share) * stiffness
        if k > 0:
            force[k, 2 * d + k], law.slider[p, k, 2 * d + k] = -stiffness, 1.0
        share, stiffness = start_weight, contacts.tangential_stiffness[p]


@kernel
def differentiate_along(
    law: LawDerivative,
    step: ComplexInterval,
    p: int,
    c: int,
    x0: Array,
    x1: Array,
    w0: Array,
    blending: complex,
    follows: bool,
) -> None:
    """Write column c of law.force and law.slider; arguments as `differentiate_law`."""
    d, start, finish, scratch = x0.size, law.start, law.end, law.scratch
    for k in range(d):
        start.x[p, k] = complex(x0[k], STEP if c == k else 0.0)
        finish.x[p, k] = complex(x1[k], STEP if c == d + k else 0.0)
        moved = c == k if follows else c == 2 * d + k
        start.slider[p, k] = complex(w0[k], STEP if moved else 0.0)
    scratch.blending[p] = complex(blending.real, blending.imag if c == 3 * d else 0.0)
    state_of(law.contacts, p, step.begin, start, scratch)
    whole = ContactStep(law.contacts, step, start, finish, scratch)
    contact_force(whole, p, False)
    commit_contact_state(whole, p)
    for k in range(d):
        law.force[p, k, c] = scratch.mean_force[p, k].imag / STEP
        law.slider[p, k, c] = finish.slider[p, k].imag / STEP


@kernel
def differentiate_law(
    law: LawDerivative,
    contacts: Contacts,
    drift: Contacts,
    step: ComplexInterval,
    p: int,
    x0: Array,
    x1: Array,
    w0: Array,
    blending: complex,
    follows: bool,
) -> bool:
    """Write the derivatives of the law of point p over a step into law.force and law.slider.

    A slider that follows the point has no derivative of its own: the law has a kink at w0 = x0.
    The derivatives by x0 are then taken with w0 = x0, and those by w0 are zero. Before a plane, the
    normal component of the slider has no effect, and the law does not see a shift of x0, x1 and w0
    along the plane: the derivatives by w0 follow from those by x0 and x1.

    A step of zero length, begin = end = 0 with a = 0, is the state that `at_rest` accepts: its
    derivative by x is the sum of those by x0 and x1.

    Args:
        law: the arrays; the real part of `law.end.slider` is the slider at the end.
        contacts: the parameters.
        drift: their derivative by the parameter of the motion.
        step: the step.
        p: the point.
        x0: (d,) displacement at the start, m.
        x1: (d,) displacement at the end, m.
        w0: (d,) slider at the start, m.
        blending: weight of the normal force at the end of the step; its imaginary part is `STEP`
            times its derivative by the parameter.
        follows: whether the slider follows the point at the start: open, or without friction.

    Returns:
        Whether the point sticks to a plane during the whole step: its slider rests.
    """
    d, force, slider = x0.size, law.force[p], law.slider[p]
    a, is_plane = step.start_weight, contacts.kind[p] == PLANE
    for k in range(d):
        for c in range(3 * d + 1):
            force[k, c], slider[k, c] = 0.0, 0.0
    perturb(law.contacts, p, contacts, drift, 0.0)
    begin, end = complex(step.begin.real, 0.0), complex(step.end.real, 0.0)
    interval = ComplexInterval(begin, end, a, step.discrete_gradient)
    differentiate_along(law, interval, p, 0, x0, x1, w0, blending, follows)
    rests = sticks(law, contacts, p)
    if rests:
        write_sticking(law, contacts, p, a, blending)
    else:
        for c in range(1, 2 * d if is_plane or follows else 3 * d):
            differentiate_along(law, interval, p, c, x0, x1, w0, blending, follows)
        if is_plane and not follows:
            for j in range(1, d):
                for k in range(d):
                    force[k, 2 * d + j] = -force[k, j] - force[k, d + j]
                    slider[k, 2 * d + j] = -slider[k, j] - slider[k, d + j]
                slider[j, 2 * d + j] += 1.0
    if not is_constant(contacts, drift, p) or (blending.imag != 0.0 and not rests):
        perturb(law.contacts, p, contacts, drift, STEP)
        differentiate_along(law, step, p, 3 * d, x0, x1, w0, blending, follows)
    return rests


class Drift(NamedTuple):
    """Derivatives of the data of a motion by its parameter.

    Attributes:
        contacts: of the parameters of the contacts.
        sines: (s, 9) of the sines of the load histories.
        damping: of the mass-proportional damping alpha, 1/s.
        period: of the period relative to the period: every time of the motion t changes by t times
            it.
        force: (n,) of the elastic force at q = 0; no size if the elastic force stays as it is.
        stiffness: (n, n) of its tangent, which is the same at all q; no size likewise.
        velocity: (n, n) of D; no size if D stays as it is.
        rest: (n,) of `Problem.rest`; no size likewise.
    """

    contacts: Contacts
    sines: Array
    damping: float
    period: float
    force: Array
    stiffness: Array
    velocity: Array
    rest: Array


class Sensitivity(NamedTuple):
    """Derivatives of the state by the k columns: start values of the period, then the parameter.

    Attributes:
        q: (n, k) of the coordinates.
        v: (n, k) of the velocities.
        a: (n, k) of the accelerations.
        w: (m, k) of the sliders of the points that touch.
        dq: (n, k) of the step; before it is solved for, the right-hand side.
        law_rows: (d, 2 n + k) of a force or a slider of one point: by q0, by dq, and the rest.
        contact: (n, 2 n + k) the same of the contact forces on all coordinates.
        combined: (n, k) sum of velocities and accelerations to be multiplied by a matrix.
        before: (3, n) at the start of the step: q, v, a.
        step: (n,) dq of the step.
        x0: (P, d) contact displacements at the start of the step.
        x1: (P, d) contact displacements at its end.
        w0: (P, d) sliders at its start.
        normal_force: (P,) at its start, N.
        is_open: (P,) whether a point is open during the whole step.
        rests: (P,) whether its slider rests, as it sticks to a plane during the whole step.
        blending: (P,) derivatives of the weights of the implicit blending by the parameter.
        load_derivative: (2, n) of the load vector by the parameter, at both ends of the step.
        factors: (loads,) complex time factors of the loads.
        pressure_factors: (2, loads) the same at both ends of the step.
        histories: complex load histories.
        by_start: (n, n) derivative of the mean elastic force by q0.
        by_step: (n, n) by dq; then the matrix S of the step.
        tangents: (2, n, n) at points of the step.
        shares: (2, 2) weights of the tangents at two points, for `by_start` and `by_step`.
        vectors: (2, n) scratch.
        pivots: (n,)
        law: derivative of the contact law.
    """

    q: Array
    v: Array
    a: Array
    w: Array
    dq: Array
    law_rows: Array
    contact: Array
    combined: Array
    before: Array
    step: Array
    x0: Array
    x1: Array
    w0: Array
    normal_force: Array
    is_open: NDArray[np.bool_]
    rests: NDArray[np.bool_]
    blending: Array
    load_derivative: Array
    factors: Array
    pressure_factors: Array
    histories: LoadHistories
    by_start: Array
    by_step: Array
    tangents: Array
    shares: Array
    vectors: Array
    pivots: NDArray[np.int64]
    law: LawDerivative


def no_drift(contacts: Contacts, histories: LoadHistories) -> Drift:
    """The derivatives of the data by a parameter on which nothing depends."""
    nothing = {name: np.zeros_like(getattr(contacts, name)) for name in PARAMETERS}
    none, empty = np.zeros(0), np.zeros((0, 0))
    sines = np.zeros_like(histories.sines)
    return Drift(contacts._replace(**nothing), sines, 0.0, 0.0, none, empty, empty, none)


def no_sensitivity(
    n: int, columns: int, contacts: Contacts, histories: LoadHistories, dimension: int
) -> Sensitivity:
    """A `Sensitivity` of zeros.

    Args:
        n: number of coordinates.
        columns: k.
        contacts: parameters of P contact points.
        histories: of the loads.
        dimension: d, of space.
    """
    points = contacts.preload.size
    state, point = (n, columns), (points, dimension)
    return Sensitivity(
        q=np.zeros(state),
        v=np.zeros(state),
        a=np.zeros(state),
        w=np.zeros((points * dimension, columns)),
        dq=np.zeros(state),
        law_rows=np.zeros((dimension, 2 * n + columns)),
        contact=np.zeros((n, 2 * n + columns)),
        combined=np.zeros(state),
        before=np.zeros((3, n)),
        step=np.zeros(n),
        x0=np.zeros(point),
        x1=np.zeros(point),
        w0=np.zeros(point),
        normal_force=np.zeros(points),
        is_open=np.zeros(points, dtype=np.bool_),
        rests=np.zeros(points, dtype=np.bool_),
        blending=np.zeros(points),
        load_derivative=np.zeros((2, n)),
        factors=np.zeros(histories.spans.shape[0], dtype=np.complex128),
        pressure_factors=np.zeros((2, histories.spans.shape[0]), dtype=np.complex128),
        histories=as_complex(histories, ("sines",)),
        by_start=np.zeros((n, n)),
        by_step=np.zeros((n, n)),
        tangents=np.zeros((2, n, n)),
        shares=np.zeros((2, 2)),
        vectors=np.zeros((2, n)),
        pivots=np.zeros(n, dtype=np.int64),
        law=law_derivative(contacts, points, dimension),
    )
