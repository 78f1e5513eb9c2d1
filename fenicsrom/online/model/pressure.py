"""Follower pressures in the coordinates q of a basis: forces that depend on the displacement.

A pressure p on the current area along the current normal does the virtual work

    v . P(u) = p g(u) . v = -p int cof(F) N . v dA,    F = I + grad u,                        (1)

on the facets of the undeformed body with the outer normal N. The cofactors of F are polynomials of
degree 2 (1 in 2D) of the displacement, so that with u = u0 + R q

    R^T g(u) = g0 + G q + 1/2 H q q                                                           (2)

is exact. g0 is the load vector at the equilibrium. The other two parts belong to no energy if the
loaded surface has a free edge: G and H are symmetric in their last two indices only. Their work is
counted as work of the loads. Within a time step h(t), the size times the time factor, is linear:
the integral of (2) along the straight line from q0 to q1 is then a polynomial of degree 3 of the
position in the step, which two Gauss points integrate exactly.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compiled import kernel
from fenicsrom.online.model.loads import LoadHistories, write_factors
from fenicsrom.online.model.workspace import Workspace

_HALF = 0.5 / np.sqrt(3.0)
GAUSS = (0.5 - _HALF, 0.5 + _HALF)
"""Points in [0, 1] of equal weights that integrate the work of a step exactly."""


class PressurePolynomial(NamedTuple):
    """Coefficients (2) of k pressures in n coordinates, without g0; k = 0 without any.

    Attributes:
        numbers: (k,) the number of each pressure among the loads, whose factor it has.
        linear: (k, n, n) G, N/m per Pa.
        quadratic: (k, c, n, n) H, the derivative of G by q_c; c = n in 3D and 0 in 2D.
    """

    numbers: NDArray[np.int64]
    linear: Array
    quadratic: Array


def no_pressure(n: int) -> PressurePolynomial:
    """The polynomial of a model of n coordinates without follower pressures."""
    linear, quadratic = np.zeros((0, n, n)), np.zeros((0, 0, n, n))
    return PressurePolynomial(np.zeros(0, dtype=np.int64), linear, quadratic)


def unit_tangent(pressure: PressurePolynomial, k: int, q: Array) -> Array:
    """G + H q (n, n) of pressure k at q (n,)."""
    quadratic = pressure.quadratic[k]
    return np.asarray(pressure.linear[k] + np.tensordot(q[: len(quadratic)], quadratic, 1))


@kernel
def write_pressure_factors(
    pressure: PressurePolynomial,
    histories: LoadHistories,
    begin: float,
    end: float,
    work: Workspace,
) -> None:
    """Write the factors of the pressures at two times to the rows of work.pressure_factors."""
    for row in range(2):
        write_factors(histories, begin if row == 0 else end, work.factors)
        for k in range(pressure.numbers.size):
            work.pressure_factors[row, k] = work.factors[pressure.numbers[k]]


@kernel
def write_pressure(
    pressure: PressurePolynomial, k: int, q: Array, force: Array, tangent: Array
) -> None:
    """Write G q + 1/2 H q q (n,) and G + H q (n, n) of pressure k at q (n,)."""
    linear, quadratic = pressure.linear[k], pressure.quadratic[k]
    n = q.size
    for i in range(n):
        for j in range(n):
            tangent[i, j] = linear[i, j]
    for c in range(quadratic.shape[0]):
        factor = q[c]
        for i in range(n):
            for j in range(n):
                tangent[i, j] += factor * quadratic[c, i, j]
    for i in range(n):
        value = 0.0
        for j in range(n):
            value += 0.5 * (linear[i, j] + tangent[i, j]) * q[j]
        force[i] = value


@kernel
def subtract_pressure(
    pressure: PressurePolynomial,
    work: Workspace,
    q0: Array,
    dq: Array,
    points: Array,
    weights: Array,
) -> None:
    """Subtract the mean force of a step and its derivative from work.force and work.tangent.

    The factors in work.pressure_factors are linear along the step.
    """
    n, factors = q0.size, work.pressure_factors
    q, force, tangent = work.pressure_vectors[0], work.pressure_vectors[1], work.pressure_tangent
    for g in range(points.size):
        s, weight = points[g], weights[g]
        for i in range(n):
            q[i] = q0[i] + s * dq[i]
        for k in range(pressure.numbers.size):
            factor = weight * ((1.0 - s) * factors[0, k] + s * factors[1, k])
            if factor == 0.0:
                continue
            write_pressure(pressure, k, q, force, tangent)
            for i in range(n):
                work.force[i] -= factor * force[i]
                for j in range(n):
                    work.tangent[i, j] -= factor * s * tangent[i, j]


@kernel
def subtract_pressure_at_end(pressure: PressurePolynomial, work: Workspace, q: Array) -> None:
    """Subtract the force at q at the end of a step from work.force."""
    force, tangent = work.pressure_vectors[1], work.pressure_tangent
    for k in range(pressure.numbers.size):
        write_pressure(pressure, k, q, force, tangent)
        for i in range(q.size):
            work.force[i] -= work.pressure_factors[1, k] * force[i]


@kernel
def work_of_pressure(pressure: PressurePolynomial, work: Workspace, q0: Array, dq: Array) -> float:
    """The work, in J, of (2) without g0 along the straight line from q0 to q0 + dq."""
    n, factors, found = q0.size, work.pressure_factors, 0.0
    q, force, tangent = work.pressure_vectors[0], work.pressure_vectors[1], work.pressure_tangent
    for g in range(2):
        s = GAUSS[g]
        for i in range(n):
            q[i] = q0[i] + s * dq[i]
        for k in range(pressure.numbers.size):
            factor = 0.5 * ((1.0 - s) * factors[0, k] + s * factors[1, k])
            write_pressure(pressure, k, q, force, tangent)
            for i in range(n):
                found += factor * force[i] * dq[i]
    return found
