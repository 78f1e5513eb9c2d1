"""Derivatives carried over the recorded steps of a period.

The march records the accepted steps. The sliders, which the derivative of a step needs too, follow
from the contact law. No type depends on the dimension of space, so one compilation serves all
models.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.candidates import list_candidates
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.derivative.contact_sensitivity import ComplexInterval, differentiate_law
from fenicsrom.online.derivative.sensitivity import Drift, Sensitivity
from fenicsrom.online.derivative.step_sensitivity import (
    add_contact,
    add_structure,
    advance_derivatives,
    advance_slider,
    differentiate_blending,
    let_slider_follow,
    solve_step,
    write_load_derivative,
)
from fenicsrom.online.kernels.compiled import kernel
from fenicsrom.online.kernels.complex_step import STEP
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.step.scheme import Scheme
from fenicsrom.online.step.state import Record

REST = ComplexInterval(0j, 0j, 0.0, False)
"""The step of zero length in which the points are at rest."""
SAME_STEP = 1e-9  # relative difference of two steps of one size, which is rounding


@kernel
def start_derivatives(
    model: ReducedModel, s: Sensitivity, memory: NDArray[np.int64], with_a: bool
) -> None:
    """Set the derivatives at the start of the period.

    Args:
        model: the model.
        s: in: the derivative of the law of the points at rest; out: the derivatives.
        memory: slider components that are variables of the period.
        with_a: whether the accelerations are variables.
    """
    n, k = s.q.shape
    points, d = s.x0.shape
    first = 3 * n if with_a else 2 * n
    for c in range(k):
        for i in range(n):
            s.q[i, c] = 1.0 if c == i else 0.0
            s.v[i, c] = 1.0 if c == n + i else 0.0
            s.a[i, c] = 1.0 if with_a and c == 2 * n + i else 0.0
            s.dq[i, c] = 0.0
        for r in range(points * d):
            s.w[r, c] = 0.0
    for c in range(memory.size):
        s.w[memory[c], first + c] = 1.0
    for p in range(points):
        advance_slider(model, s, p)
    write_load_derivative(model, s, 0j, s.load_derivative[1])


@kernel
def begin_step(record: Record, row: int, s: Sensitivity) -> int:
    """Write the step of a row of the record into s.

    Returns:
        The number of points that touch in it; they are the candidates of `s.law.scratch`.
    """
    for i in range(s.step.size):
        s.step[i] = record.coordinates[row, i] - s.before[0, i]
    for p in range(s.is_open.size):
        s.is_open[p] = True
        for i in range(s.x1.shape[1]):
            s.x1[p, i] = record.displacement[row, p, i]
            if record.mean_force[row, p, i] != 0.0:
                s.is_open[p] = False
        s.law.scratch.is_candidate[p] = not s.is_open[p]
    return list_candidates(s.law.scratch)


@kernel
def end_step(record: Record, row: int, s: Sensitivity) -> None:
    """Write the end of the step of a row of the record as the start of the next one."""
    n = s.step.size
    for i in range(n):
        for k in range(3):
            s.before[k, i] = record.coordinates[row, k * n + i]
    for p in range(s.is_open.size):
        s.normal_force[p] = record.force[row, p, 0]
        for i in range(s.x0.shape[1]):
            s.x0[p, i] = s.x1[p, i]
            s.w0[p, i] = s.x1[p, i] if s.is_open[p] else s.law.end.slider[p, i].real


@kernel
def carry_derivatives(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    record: Record,
    first: int,
    last: int,
    rows: int,
    rest: ComplexInterval,
    sliders: Array,
    memory: NDArray[np.int64],
    s: Sensitivity,
) -> bool:
    """Carry the derivatives in s over some of the steps of a recorded period.

    The steps from 0 to `rows` make the period. They may be split among several calls, so that a
    caller can be interrupted.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        scheme: the weights of the scheme.
        drift: derivatives of the data by the parameter.
        record: of the accepted steps, with coordinates, from time 0.
        first: number of the first step to carry the derivatives over.
        last: number of the step before which this call ends.
        rows: number of the steps of the period.
        rest: `REST`, as an argument because numba compiles the contact law once more for constants.
        sliders: (P, d) the variables of the period, m.
        memory: which components of them are variables.
        s: in: `before`, `x0`, `w0` and `normal_force` at the start, or what the last call left;
            out: the derivatives.

    Returns:
        False if the matrix of a step is singular.
    """
    law, points, by, blended = s.law, s.is_open.size, drift.contacts, 0.0
    if first == 0:
        for p in range(points):
            x, w = s.x0[p], sliders[p]
            differentiate_law(law, contacts, by, rest, p, x, x, w, 0j, rest.discrete_gradient)
        start_derivatives(model, s, memory, not scheme.discrete_gradient)
    begin = record.time[first - 1] if first > 0 else 0.0
    for row in range(first, last):
        h = record.time[row] - begin
        times = complex(1.0, STEP * drift.period)
        behind, ahead, moved = begin * times, record.time[row] * times, h * times
        step = ComplexInterval(behind, ahead, scheme.alpha_f, scheme.discrete_gradient)
        if scheme.discrete_gradient and points > 0 and abs(h - blended) > SAME_STEP * h:
            differentiate_blending(model, contacts, drift, h, s)
            blended = h
        touching = law.scratch.candidates[: begin_step(record, row, s)]
        add_structure(model, scheme, drift, moved, behind, ahead, s)
        for p in touching:
            follows = not s.normal_force[p] > 0.0 or contacts.friction[p] == 0.0
            x0, x1, w0 = s.x0[p], s.x1[p], s.w0[p]
            weight = complex(record.blending[row, p], STEP * s.blending[p])
            s.rests[p] = differentiate_law(law, contacts, by, step, p, x0, x1, w0, weight, follows)
            add_contact(model, s, p)
        if not solve_step(s):
            return False
        for p in touching:
            if not s.rests[p]:
                advance_slider(model, s, p)
        advance_derivatives(scheme, moved, s)
        end_step(record, row, s)
        begin = record.time[row]
    for p in range(points):
        if last == rows and s.is_open[p]:
            let_slider_follow(model, s, p)
    return True
