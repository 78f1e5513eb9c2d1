"""Derivative of the contact law over a step, by complex steps through the law itself.

Only a point that sticks to a plane has a closed form, which most steps of most motions need.

Over a step from x0 to x1 the law gives the mean force F of a point and its slider w1 at the end,
as functions of (x0, x1, w0, parameter). What else the law reads of the start of the step
follows from these: the trial normal force, the normal force and the friction k_t P (x0 - w0).
"""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.coating import is_coated
from fenicsrom.online.contact.law import (
    PointState,
    end_of_step,
    point_force,
    tangential,
    trial_normal_force,
)
from fenicsrom.online.contact.state import STICK, Interval
from fenicsrom.online.contact.surfaces import PLANE, Contacts, gap_discrete_gradient
from fenicsrom.online.kernels.compilation import kernel, part
from fenicsrom.online.kernels.numbers import (
    STEP,
    Number,
    Vector,
    as_complex,
    minus,
    plus,
    positive,
    times,
    value,
    vector,
    write_vector,
)


class ContactData(NamedTuple):
    """The parameters of P contact points as complex numbers.

    Attributes:
        still: the parameters, whose imaginary parts are zero.
        moved: the same, with `STEP` times their derivatives by the parameter of the motion.
        varies: (P,) whether the law of a point depends on the parameter.
    """

    still: Contacts
    moved: Contacts
    varies: NDArray[np.bool_]


def contact_data(contacts: Contacts, moved: Contacts, *, retimed: bool = False) -> ContactData:
    """The `ContactData` of contacts, and of the contacts at p + i `STEP`.

    Args:
        contacts: the parameters.
        moved: the same; its arrays may be complex.
        retimed: whether the times of the motion depend on the parameter.
    """
    still, other = as_complex(contacts), as_complex(moved)
    varies = np.zeros(contacts.preload.size, dtype=np.bool_)
    arrays = [*other[:-1], *other.coating[:-1]]
    for array in arrays:
        if array.shape[0] == varies.size:
            varies |= (np.imag(array) != 0.0).any(axis=tuple(range(1, array.ndim)))
    varies |= any(np.imag(array).any() for array in (other.times, other.order, other.history))
    if retimed:
        varies |= bool(contacts.times.size + contacts.history.size) | (contacts.spin != 0.0)
        varies |= contacts.coating.cells > 0
    return ContactData(still, other, varies)


class LawDerivative(NamedTuple):
    """Derivatives of the contact law of P points over a step.

    The columns of the derivatives are [x0 (d), x1 (d), w0 (d), parameter].

    Attributes:
        force: (P, d, 3 d + 1) derivative of the mean force.
        slider: (P, d, 3 d + 1) derivative of the slider at the end.
        end: (P, d) the slider at the end, m.
    """

    force: Annotated[Array, "P d columns"]
    slider: Annotated[Array, "P d columns"]
    end: Annotated[Array, "P d"]


def law_derivative(points: int, d: int) -> LawDerivative:
    """Arrays for P points in d dimensions."""
    return zeros(LawDerivative, P=points, d=d, columns=3 * d + 1)


@part
def state_of(contacts: Contacts, p: int, x: Vector, slider: Vector, time: Number) -> PointState:
    """The state that follows from displacement and slider of point p: N n, T = k_t P (x - w).

    Nothing is projected on the limit of friction: the slider is that of an accepted state.
    """
    trial = trial_normal_force(contacts, p, x, time)
    n = gap_discrete_gradient(contacts, p, x, x, time)
    stiffness = contacts.tangential_stiffness[p] * (1.0 if value(trial) > 0.0 else 0.0)
    friction = times(stiffness, tangential(contacts, p, n, minus(x, slider)))
    return PointState(x, trial, times(positive(trial), n), friction, slider)


@kernel
def write_sticking(
    law: LawDerivative,
    contacts: Contacts,
    p: int,
    start_weight: float,
    blending: complex,
    change: float,
) -> None:
    """Write the derivatives of a point that sticks to a plane: springs between x and w0.

    `change` is that of its trial normal force in the step, N.
    """
    d, force = law.force.shape[1], law.force[p]
    share, stiffness = start_weight * (1.0 - blending.real), contacts.normal_stiffness[p].real
    force[0, 3 * d] = (1.0 - start_weight) * change * blending.imag / STEP
    for k in range(d):
        force[k, k], force[k, d + k] = share * stiffness, (1.0 - share) * stiffness
        if k > 0:
            force[k, 2 * d + k], law.slider[p, k, 2 * d + k] = -stiffness, 1.0
        share, stiffness = start_weight, contacts.tangential_stiffness[p].real


@part
def perturbed(u: Array, shift: bool, k: int) -> Vector:
    """A vector of an array (d,), whose component k has the derivative 1 if `shift` is set."""
    x, h = vector(u), STEP if shift else 0.0
    return (
        complex(x[0], h if k == 0 else 0.0),
        complex(x[1], h if k == 1 else 0.0),
        complex(x[2], h if k == 2 else 0.0),
    )


@part
def write_derivative(u: Vector, out: Array, c: int) -> None:
    """Write the derivative of a complex vector to column c of an array (d, ..)."""
    write_vector(out[:, c], (u[0].imag / STEP, u[1].imag / STEP, u[2].imag / STEP))


@kernel
def differentiate_along(
    law: LawDerivative,
    contacts: Contacts,
    step: Interval,
    p: int,
    c: int,
    x0: Array,
    x1: Array,
    w0: Array,
    blending: complex,
    follows: bool,
) -> tuple[bool, float]:
    """Write column c of law.force and law.slider; arguments as `differentiate_law`.

    Returns:
        Whether the point sticks to a plane during the whole step, and the change of its trial
        normal force, N.
    """
    d = x0.size
    group, k = c // d, c % d
    here, there = perturbed(x0, group == 0, k), perturbed(x1, group == 1, k)
    slider = perturbed(w0, group == (0 if follows else 2), k)
    start = state_of(contacts, p, here, slider, step.begin)
    b = complex(blending.real, blending.imag if group == 3 else 0.0)
    found = point_force(contacts, step, p, start, there, b)
    end = end_of_step(contacts, step, p, start, there, found)
    write_derivative(plus(found.normal, found.friction), law.force[p], c)
    write_derivative(end.state.slider, law.slider[p], c)
    last = end.state.slider
    write_vector(law.end[p], (last[0].real, last[1].real, last[2].real))
    rests = contacts.kind[p] == PLANE and not is_coated(contacts, p)
    rests = rests and start.trial.real > 0.0 and end.state.trial.real > 0.0
    rests = rests and found.mode == STICK and end.mode == STICK
    moved = abs(found.moved[0].real) + abs(found.moved[1].real) + abs(found.moved[2].real)
    return rests and moved == 0.0, end.state.trial.real - start.trial.real


@kernel
def differentiate_law(
    law: LawDerivative,
    data: ContactData,
    step: Interval,
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
        law: the arrays.
        data: the parameters of the contacts.
        step: the step; its times are complex, with `STEP` times their derivatives by the parameter.
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
    d, force, slider, still = x0.size, law.force[p], law.slider[p], data.still
    a, is_plane = step.start_weight, still.kind[p] == PLANE
    for k in range(d):
        for c in range(3 * d + 1):
            force[k, c], slider[k, c] = 0.0, 0.0
    begin, end = complex(step.begin.real, 0.0), complex(step.end.real, 0.0)
    at = Interval(begin, end, a, step.discrete_gradient)
    rests, change = differentiate_along(law, still, at, p, 0, x0, x1, w0, blending, follows)
    if rests:
        write_sticking(law, still, p, a, blending, change)
    else:
        for c in range(1, 2 * d if is_plane or follows else 3 * d):
            differentiate_along(law, still, at, p, c, x0, x1, w0, blending, follows)
        if is_plane and not follows:
            for j in range(1, d):
                for k in range(d):
                    force[k, 2 * d + j] = -force[k, j] - force[k, d + j]
                    slider[k, 2 * d + j] = -slider[k, j] - slider[k, d + j]
                slider[j, 2 * d + j] += 1.0
    if data.varies[p] or (blending.imag != 0.0 and not rests):
        differentiate_along(law, data.moved, step, p, 3 * d, x0, x1, w0, blending, follows)
    return rests


REST: Any = Interval(0j, 0j, 0.0, False)
"""The step of zero length in which the points are at rest."""
