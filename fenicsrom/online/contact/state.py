"""The state of the contact points, and scratch arrays of the contact problem."""

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.surfaces import Contacts

OPEN, SLIP, STICK = -1, 0, 1


class ContactState(NamedTuple):
    """The state of P contact points.

    Attributes:
        x: (P, d) displacement, m.
        trial_normal_force: (P,) y = N0 + k_n delta, the normal force before it is clamped at
            zero, N.
        normal: (P, d) normal force N n, N.
        friction: (P, d) friction force T, N.
        slider: (P, d) position w of the slider, m.
        state: (P,) OPEN, SLIP or STICK.
    """

    x: Annotated[Array, "P d"]
    trial_normal_force: Annotated[Array, "P"]
    normal: Annotated[Array, "P d"]
    friction: Annotated[Array, "P d"]
    slider: Annotated[Array, "P d"]
    state: Annotated[NDArray[np.int8], "P"]


class ContactScratch(NamedTuple):
    """Scratch arrays and results of the contact problem of one step.

    Attributes:
        known_force: (P, d) the contact forces that act on the body in x_free, N; by default none.
        mean_force: (P, d) mean contact force over the step, N.
        mean_friction: (P, d) the friction part of the mean force, N.
        mean_normal_force: (P,) the size of the normal part of the mean force, N.
        force_derivative: (P, d, d) derivative of the mean force by the end displacement, N/m.
        slider_motion: (P, d) motion of the slider relative to the surface, m.
        mode: (P,) OPEN, SLIP or STICK over the step.
        blending: (P,) weight in [0, 1] of the normal force at the end in the mean normal force.
        blended_step: (1,) the step to which these weights belong, s; NaN for none.
        guess: (P, d) displacement from which the next iteration starts, m.
        held_force: (P, d) forces of the Gauss-Seidel iteration, N.
        held_friction: (P, d) the friction part of the held forces, N.
        residual: (P, d) residual of the contact problem; then the update, m.
        force_change: (P, d) the mean force less the known one, or its change by the update, N.
        is_candidate: (P,) whether the step solves for a point.
        candidates: (P,) the points that the step solves for come first; by default all.
        directions: (m,) the rows of the candidates among the contact displacements, m = P d.
        touching: (P,) the places among the candidates of the points that touch come first.
        jacobian: (m, m) of the touching points.
        update: (m, 1) of the touching points, m.
        pivots: (m,) of the factorised Jacobian.
        space: d zeros; the compiler knows the length of a tuple and unrolls loops over it.
    """

    known_force: Annotated[Array, "P d"]
    mean_force: Annotated[Array, "P d"]
    mean_friction: Annotated[Array, "P d"]
    mean_normal_force: Annotated[Array, "P"]
    force_derivative: Annotated[Array, "P d d"]
    slider_motion: Annotated[Array, "P d"]
    mode: Annotated[NDArray[np.int8], "P"]
    blending: Annotated[Array, "P"]
    blended_step: Annotated[Array, "1"]
    guess: Annotated[Array, "P d"]
    held_force: Annotated[Array, "P d"]
    held_friction: Annotated[Array, "P d"]
    residual: Annotated[Array, "P d"]
    force_change: Annotated[Array, "P d"]
    is_candidate: Annotated[NDArray[np.bool_], "P"]
    candidates: Annotated[NDArray[np.int64], "P"]
    directions: Annotated[NDArray[np.int64], "m"]
    touching: Annotated[NDArray[np.int64], "P"]
    jacobian: Annotated[Array, "m m"]
    update: Annotated[Array, "m 1"]
    pivots: Annotated[NDArray[np.int64], "m"]
    space: tuple[int, ...]


class Interval(NamedTuple):
    """A time step, and how contact forces are averaged over it.

    Attributes:
        begin: s.
        end: s.
        start_weight: weight a of the forces at the start of the step.
        discrete_gradient: forces are averaged along the straight path of the point, instead of
            weighting the forces at the ends of the step.
    """

    begin: float
    end: float
    start_weight: float
    discrete_gradient: bool


class ContactStep(NamedTuple):
    """A time step of P contact points.

    Attributes:
        contacts: the parameters.
        interval: the step, and how forces are averaged over it.
        start: the state at its start.
        end: the state at its end.
        scratch: scratch arrays and results.
    """

    contacts: Contacts
    interval: Interval
    start: ContactState
    end: ContactState
    scratch: ContactScratch


def zero_contact_state(points: int, d: int) -> ContactState:
    """A `ContactState` of zeros."""
    return zeros(ContactState, P=points, d=d)


def contact_scratch(points: int, d: int) -> ContactScratch:
    """A `ContactScratch` for P points in d dimensions."""
    m = points * d
    numbers = {"candidates": np.arange(points), "directions": np.arange(m), "space": (0,) * d}
    found = zeros(ContactScratch, numbers, P=points, d=d, m=m)
    found.blended_step[:], found.is_candidate[:] = np.nan, True
    return found
