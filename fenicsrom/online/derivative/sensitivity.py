"""The arrays that carry derivatives through the steps of a period."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.derivative.contact_sensitivity import (
    PARAMETERS,
    LawDerivative,
    law_derivative,
)
from fenicsrom.online.kernels.complex_step import as_complex
from fenicsrom.online.model.loads import LoadHistories


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
