"""The state of the contact points, and scratch arrays of the contact problem."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array


class ContactState(NamedTuple):
    """The state of P contact points.

    Attributes:
        x: (P, d) displacement, m.
        raw: (P,) y of the module docstring: the normal force before it is clamped at zero, N.
        normal: (P, d) normal force N n, N.
        friction: (P, d) T, N.
        slider: (P, d) w, m.
        state: (P,) OPEN, SLIP or STICK.
    """

    x: Array
    raw: Array
    normal: Array
    friction: Array
    slider: Array
    state: NDArray[np.int8]


class ContactScratch(NamedTuple):
    """Room to work in, and what is found of a step.

    Attributes:
        mean: (P, d) mean force, N.
        rubbing: (P, d) the friction in it, N.
        slip: (P, d) how far the slider goes over the surface, m.
        push: (P,) the normal force in it, N.
        motion: (P,) OPEN, SLIP or STICK.
        slopes: (P, d, d) derivative of the mean force by the displacement at the end, N/m.
        lean: (P,) how far the mean normal force leans to that of the end of the step, in [0, 1].
        space: d zeros: how many is known when this is compiled, and loops over it are unrolled.
    """

    mean: Array
    rubbing: Array
    slip: Array
    push: Array
    motion: NDArray[np.int8]
    slopes: Array
    lean: Array
    guess: Array
    held: Array
    held_rubbing: Array
    residual: Array
    product: Array
    touching: NDArray[np.int64]
    jacobian: Array
    update: Array
    pivots: NDArray[np.int64]
    vectors: Array
    matrices: Array
    space: tuple[int, ...]


class Interval(NamedTuple):
    """A time step.

    Attributes:
        begin: s.
        end: s.
        start_weight: a of the module docstring.
        line: the normal force is its mean along the straight way (discrete gradient) in place of
            the weighted ends.
    """

    begin: float
    end: float
    start_weight: float
    line: bool


def zero_contact_state(points: int, d: int) -> ContactState:
    """A `ContactState` of zeros."""
    return ContactState(
        np.zeros((points, d)),
        np.zeros(points),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros(points, dtype=np.int8),
    )


def contact_scratch(points: int, d: int) -> ContactScratch:
    """A `ContactScratch` for P points in d dimensions."""
    m = points * d
    return ContactScratch(
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros(points),
        np.zeros(points, dtype=np.int8),
        np.zeros((points, d, d)),
        np.zeros(points),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros((points, d)),
        np.zeros(points, dtype=np.int64),
        np.zeros((m, m)),
        np.zeros((m, 1)),
        np.zeros(m, dtype=np.int64),
        np.zeros((9, d)),
        np.zeros((4, d, d)),
        (0,) * d,
    )


OPEN, SLIP, STICK = -1, 0, 1
