"""The forces of a varying speed of rotation in coordinates q, about the body at rest.

In the frame that turns with the body, a speed Omega(t) gives the forces

    - Omega G v - dOmega/dt (g + 1/2 G q) + Omega^2 (c + Q q),        E = G/2,                  (1)

on M a + .. = p: the Coriolis force, the Euler force, and the centrifugal force
(`fenicsrom.fem.body.rotation`), with the matrices of `fenicsrom.online.step.speed_range`. In a step
of length h they are, with the means of both ends of the step for the discrete gradient,

    - Omega_m G dq/h - (dOmega/h) (g + 1/2 G q_m) + (Omega^2)_m (c + Q q_m).                    (2)

The schemes that weight the ends take Omega and Omega^2 at the ends, weighted as the forces. The
Coriolis force does no work. The potential of a state is measured from that of the equilibrium
q_Omega at the present speed, which would hide the energy of a vibration:

    Pi(q, Omega) - Pi(q_Omega, Omega),    Pi = V(q) - Omega^2 J'/2,    J' = 2 c . q + q . Q q.  (3)

Its change with the speed is a work, and so is that of the Euler force. With the mean of J',

    W = - dq . (g + 1/2 G q_m) dOmega/h - J'_m d(Omega^2)/2 - d Pi(q_Omega, Omega)              (4)

balances each step exactly. The angular momentum about the axis is L = Omega (J0 + J') + v . (g +
1/2 G q), with the moment of inertia J0 of the body at rest.
"""

from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import NO_HISTORY, speed_at
from fenicsrom.online.kernels.compilation import kernel
from fenicsrom.online.model.polynomial import ElasticPolynomial, elastic_force


class Turning(NamedTuple):
    """The data of (1) in n coordinates; no history and no size for a body at a constant speed.

    Attributes:
        history: (r, 3) times, speeds and angles of the body
            (`online.contact.surfaces.speed_history`).
        centrifugal: (n,) c, kg m.
        softening: (n, n) Q, kg.
        coriolis: (n, n) G, kg.
        euler: (n,) g, kg m.
        inertia: J0, kg m^2.
        moments: (loads, 1 + n) moment of each unit load about the axis at q = 0, and its derivative
            by q, m.
        rest: (k, 3 + n) Omega^2, ascending, Pi(q_Omega, Omega) and its derivative by Omega^2, a
            cubic between two of them, and q_Omega. It is only a reference.
    """

    history: Array
    centrifugal: Array
    softening: Array
    coriolis: Array
    euler: Array
    inertia: float
    moments: Array
    rest: Array


def no_turning() -> Turning:
    """The data of a body at a constant speed."""
    nothing, none = np.zeros((0, 0)), np.zeros(0)
    return Turning(NO_HISTORY, none, nothing, nothing, none, 0.0, nothing, np.zeros((0, 3)))


def rest_row(turning: Turning, elastic: ElasticPolynomial, square: float, q: Array) -> Array:
    """A row (3 + n,) of `Turning.rest` for Omega^2 and the equilibrium q (n,) at this speed."""
    force, tangent = np.empty(q.size), np.empty((q.size, q.size))
    half = 0.5 * added_inertia(turning, q)
    energy = elastic_force(elastic, q, force, tangent) - square * half
    return np.concatenate([[square, energy, -half], q])


@kernel
def rest_energy(turning: Turning, omega: float) -> float:
    """Pi(q_Omega, Omega) by the table, J."""
    rest, square = turning.rest, omega * omega
    k = 1
    while k < rest.shape[0] - 1 and rest[k, 0] < square:
        k += 1
    if rest.shape[0] < 2:
        return 0.0
    length = rest[k, 0] - rest[k - 1, 0]
    x = (square - rest[k - 1, 0]) / length
    y = 1.0 - x
    return (
        (1.0 + 2.0 * x) * y * y * rest[k - 1, 1]
        + (1.0 + 2.0 * y) * x * x * rest[k, 1]
        + length * x * y * (y * rest[k - 1, 2] - x * rest[k, 2])
    )


@kernel
def write_speeds(turning: Turning, begin: float, end: float, speeds: Array) -> None:
    """Write the speeds at two times and the length of the step between them to speeds (3,)."""
    speeds[0] = speed_at(turning.history, begin)
    speeds[1] = speed_at(turning.history, end)
    speeds[2] = end - begin


@kernel
def add_turning(
    turning: Turning,
    speeds: Array,
    damping: Array,
    q0: Array,
    dq: Array,
    moved: float,
    weights: Array,
    force: Array,
    tangent: Array,
    velocity: Array,
) -> None:
    """Add the Euler and the centrifugal force of a step to its mean force and its derivative.

    Args:
        turning: the data.
        speeds: (3,) from `write_speeds`.
        damping: (n, n) D without the Coriolis force.
        q0: (n,).
        dq: (n,).
        moved: sum of w_g s_g of the scheme.
        weights: (g,) w_g.
        force: (n,) in and out.
        tangent: (n, n) in and out, derivative by dq.
        velocity: (n, n) out: D + Omega_m G.
    """
    n, total = q0.size, 0.0
    for g in range(weights.size):
        total += weights[g]
    share = moved / total if total > 0.0 else 0.0
    square = speeds[0] ** 2 + share * (speeds[1] ** 2 - speeds[0] ** 2)
    growth = (speeds[1] - speeds[0]) / speeds[2] if speeds[2] > 0.0 else 0.0
    omega = speeds[0] + moved * (speeds[1] - speeds[0])
    for i in range(n):
        value = growth * turning.euler[i] - square * total * turning.centrifugal[i]
        for j in range(n):
            turned = 0.5 * growth * turning.coriolis[i, j]
            softened = square * turning.softening[i, j]
            value += turned * (q0[j] + moved * dq[j]) - softened * (total * q0[j] + moved * dq[j])
            tangent[i, j] += moved * (turned - softened)
            velocity[i, j] = damping[i, j] + omega * turning.coriolis[i, j]
        force[i] += value


@kernel
def added_inertia(turning: Turning, q: Array) -> float:
    """J' at q (n,), kg m^2."""
    found = 0.0
    for i in range(q.size):
        value = 2.0 * turning.centrifugal[i]
        for j in range(q.size):
            value += turning.softening[i, j] * q[j]
        found += value * q[i]
    return found


@kernel
def add_turning_at_end(turning: Turning, omega: float, q: Array, force: Array) -> float:
    """Add the centrifugal force at q (n,) to a force (n,); returns what (3) adds to V, J."""
    for i in range(q.size):
        value = turning.centrifugal[i]
        for j in range(q.size):
            value += turning.softening[i, j] * q[j]
        force[i] -= omega * omega * value
    return -0.5 * omega * omega * added_inertia(turning, q) - rest_energy(turning, omega)


@kernel
def turning_work(turning: Turning, speeds: Array, q0: Array, dq: Array, q1: Array) -> float:
    """The work (4) of a step, J; q1 (n,) is scratch."""
    work, n = 0.0, q0.size
    for i in range(n):
        q1[i] = q0[i] + dq[i]
        value = turning.euler[i]
        for j in range(n):
            value += 0.5 * turning.coriolis[i, j] * (q0[j] + 0.5 * dq[j])
        work -= value * dq[i]
    growth = (speeds[1] - speeds[0]) / speeds[2]
    both = added_inertia(turning, q0) + added_inertia(turning, q1)
    known = rest_energy(turning, speeds[1]) - rest_energy(turning, speeds[0])
    return growth * work - 0.25 * both * (speeds[1] ** 2 - speeds[0] ** 2) - known


@kernel
def write_momentum(
    turning: Turning, omega: float, q: Array, v: Array, factors: Array, out: Array
) -> None:
    """Write L, J0 + J' and the moment of the loads with these factors (loads,) to out (3,)."""
    out[1] = turning.inertia + added_inertia(turning, q)
    out[0] = omega * out[1]
    out[2] = 0.0
    for i in range(q.size):
        value = turning.euler[i]
        for j in range(q.size):
            value += 0.5 * turning.coriolis[i, j] * q[j]
        out[0] += v[i] * value
    for k in range(factors.size):
        moment = turning.moments[k, 0]
        for i in range(q.size):
            moment += turning.moments[k, 1 + i] * q[i]
        out[2] += factors[k] * moment
