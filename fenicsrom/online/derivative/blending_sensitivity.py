"""Derivative of the weight of the implicit blending (`contact_step.implicit_blending`).

The weight b = r^2/(1 + r^2), r = k_n n^T G n, uses the G = B^T S^-1 B of the first guess of a step.
The march records it. The changes of weights below `BLENDING_RESOLVED` are neglected.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Contacts, gap_discrete_gradient
from fenicsrom.online.derivative.contact_sensitivity import BLENDING_RESOLVED, perturb
from fenicsrom.online.derivative.sensitivity import Drift, Sensitivity
from fenicsrom.online.derivative.step_sensitivity import share_of_step
from fenicsrom.online.kernels.compiled import kernel
from fenicsrom.online.kernels.complex_step import STEP
from fenicsrom.online.kernels.dense import (
    add_combined_rows,
    copy_vector,
    inner,
    lu_solve_transposed,
)
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.model.polynomial import write_tangent_changes
from fenicsrom.online.step.scheme import Scheme
from fenicsrom.online.step.step import step_coefficients


@kernel
def is_resolved(weights: Array) -> bool:
    """Whether the changes of any of the weights (rows, P) matter."""
    for row in range(weights.shape[0]):
        for p in range(weights.shape[1]):
            if weights[row, p] > BLENDING_RESOLVED:
                return True
    return False


@kernel
def solve_at_guess(
    model: ReducedModel, scheme: Scheme, s: Sensitivity, h: float, directions: NDArray[np.int64]
) -> None:
    """Write what the derivatives of the weights of a step of size h have in common.

    S^-1 B and G of its first guess go to the workspace of the model, and the derivatives of S by q0
    and by this guess to `s.tangent_changes`.
    """
    coefficients, q0, guess = step_coefficients(scheme, h), s.before[0], s.before[5]
    _, tangent = model.elastic_over_step(
        q0, q0, guess, scheme.start_weight, scheme.points, scheme.weights
    )
    model.solve_effective(coefficients.mass, coefficients.velocity_dq, tangent, q0, directions)
    if not scheme.linear:
        write_tangent_changes(model.elastic, model.work.columns, q0, guess, s.tangent_changes)


@kernel
def differentiate_blending(
    model: ReducedModel,
    contacts: Contacts,
    scheme: Scheme,
    drift: Drift,
    s: Sensitivity,
    p: int,
    place: int,
    behind: complex,
    by_mass: complex,
    by_velocity: complex,
) -> None:
    """Write the derivatives of the weight of point p to its row of s.blending, which holds zeros.

    The weight is above `BLENDING_RESOLVED`. The workspace of the model holds S^-1 B of the points
    that touch, and p is the one at `place`.

    With u = S^-1 B n and v = S^-T B n the flexibility changes by

        d(n^T G n) = dn^T B^T (u + v) - v^T dS u

    Without gyroscopic forces and follower pressures u = v. The change of the follower pressures is
    left out.
    """
    n, k = s.q.shape
    d = s.x0.shape[1]
    last, row, law = k - 1, p * d, s.law
    weight = s.weight[p]
    ratio = np.sqrt(weight / (1.0 - weight))
    by_flexibility = 2.0 * ratio / (1.0 + ratio**2) ** 2 * contacts.normal_stiffness[p]
    perturb(law.contacts, p, contacts, drift.contacts, STEP)
    for i in range(d):
        law.start.x[p, i] = s.x0[p, i]
    point = law.scratch.point
    x0, bend = law.start.x[p], point.gradient_derivative
    gap_discrete_gradient(law.contacts, p, x0, x0, behind, point.gradient, bend, point.work)
    u, v, direction = s.blending_vectors[0], s.blending_vectors[1], s.blending_vectors[2]
    for a in range(n):
        u[a], v[a] = 0.0, 0.0
        for i in range(d):
            u[a] += point.gradient[i].real * model.work.compliance.unit[a, place * d + i]
            v[a] += point.gradient[i].real * model.contact_rows[row + i, a]
    symmetric = not scheme.velocity_forces and model.pressure.numbers.shape[0] == 0
    if symmetric:
        copy_vector(v, u)  # type: ignore[no-untyped-call]
    else:
        lu_solve_transposed(model.work.factor, model.work.pivots, v)
    for a in range(n):
        direction[a] = 0.0
    for i in range(d):
        along = 0.0
        for a in range(n):
            along += model.contact_rows[row + i, a] * (u[a] + v[a])
        s.blending[p, last] += along * point.gradient[i].imag / STEP
        for j in range(d):
            for a in range(n):
                direction[a] += 2.0 * along * bend[i, j].real * model.contact_rows[row + j, a]
    product = 0.0
    for a in range(n):
        for b in range(n):
            product += by_mass.imag * v[a] * model.mass[a, b] * u[b]
            if scheme.velocity_forces:
                product += by_velocity.imag * v[a] * model.velocity_matrix[a, b] * u[b]
            if drift.force.shape[0] > 0:
                change = share_of_step(scheme) * drift.stiffness[a, b]
                if scheme.velocity_forces:
                    change += by_velocity.real * drift.velocity[a, b]
                product += STEP * v[a] * change * u[b]
    s.blending[p, last] -= product / STEP
    if not scheme.linear:
        subtract_elastic_change(model, s)
        add_combined_rows(s.blending_vectors[3:4], s.guess, s.blending[p : p + 1])
    add_combined_rows(s.blending_vectors[2:3], s.q, s.blending[p : p + 1])
    for c in range(k):
        s.blending[p, c] *= by_flexibility
    stiffness = drift.contacts.normal_stiffness[p] / contacts.normal_stiffness[p]
    s.blending[p, last] += 2.0 * ratio**2 / (1.0 + ratio**2) ** 2 * stiffness


@kernel
def subtract_elastic_change(model: ReducedModel, s: Sensitivity) -> None:
    """Subtract the elastic part of v^T dS u, by q0 and by the first guess of dq.

    The vectors are rows of `s.blending_vectors`: u, v, the factors of dq0, from which the part is
    subtracted, and those of the first guess, which are written.
    """
    u, v = s.blending_vectors[0], s.blending_vectors[1]
    by_start, by_guess = s.blending_vectors[2], s.blending_vectors[3]
    n, row, products = u.size, 0, model.work.products[0, 0]
    for i in range(n):
        for j in range(i, n):
            products[row] = u[i] * v[j] + u[j] * v[i]
            row += 1
    for i in range(n):
        by_start[i] -= inner(s.tangent_changes[0, i], products)
        by_guess[i] = -inner(s.tangent_changes[1, i], products)
