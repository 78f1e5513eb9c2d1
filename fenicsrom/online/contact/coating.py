"""Abradable layers on rigid surfaces: the body crushes them, and they remember where.

A layer has the height h, Young's modulus E, the yield stress sigma_Y, the hardening modulus K and
the viscosity eta. A point of the body with the contact area A presses it to the depth d below its
new surface. The layer is worn by w = h eps_p, with the plastic strain eps_p, so that w is its only
state. In series with the contact spring k_n (`normal_stiffness` of a coated point is k),

    k = 1/(1/k_n + h/(E A)),    y = k (d - w),    F(w) = A (sigma_Y + K w/h)                    (1)
    N = max(y, 0) - c max(y - F, 0),    c = k/(k + A K/h + A eta/(h dt))                        (2)
    w += max(y - F, 0) c/k                                                                      (3)

over a step dt (Legrand, Batailly and Pierre 2012, Journal of Computational and Nonlinear Dynamics
7, 011010). (3) is a projection: (2) gives the same force before and after it.

A surface that turns has a ring of nodes, between which w is linear, at each position along the axis
where there are contact points. In a step a point sweeps the ring from one angle to another, while
its depth d goes linearly from d0 to d1. Its normal force is the mean of (2) over this arc. Between
two nodes both terms of (2) are positive parts of linear functions, whose mean is a closed form
(`fenicsrom.online.contact.friction.mean_normal_force`). For a surface at rest, w is a number of the
point, and the same formula is the discrete gradient of the energy. The angle of a point on its ring
is that of its place on the undeformed body: its displacement along the surface is neglected.

A step reads w. Only the acceptance of the step changes w, at each node in the arc, by (3).
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.friction import mean_normal_force, positive
from fenicsrom.online.contact.state import Interval
from fenicsrom.online.contact.surfaces import Contacts, penetration, surface_turn
from fenicsrom.online.kernels.compiled import kernel, part

SHIFT = 1.234567e-6
"""The arc whose nodes a step wears is shifted by so many cells, so that its ends are not on nodes:
rounding then lets no node fall between two steps, or be worn in both."""


@part
def is_coated(contacts: Contacts, p: int) -> bool:
    """Whether point p presses an abradable layer."""
    return contacts.coating.worn.size > 0 and contacts.coating.cells[p] > 0


@part
def ring_place(contacts: Contacts, p: int, time: float) -> float:
    """Where point p is on its ring at a time, in cells: the nodes are at the integers."""
    angle = contacts.coating.angle[p] - surface_turn(contacts, p, 0.0, time)
    return angle * contacts.coating.cells[p] / (2.0 * np.pi)


@part
def worn_depth(contacts: Contacts, p: int, place: float) -> float:
    """The worn depth w at a place of the ring of point p, m."""
    coating, below = contacts.coating, int(np.floor(place.real))
    first, cells = coating.first[p], coating.cells[p]
    here, ahead = coating.worn[first + below % cells], coating.worn[first + (below + 1) % cells]
    return here + (place - below) * (ahead - here)


@part
def depth(contacts: Contacts, p: int, x: Array, time: float) -> float:
    """Depth of point p at x (d,) in its surface, which may be worn; negative outside of it, m."""
    found = penetration(contacts, p, x, time)
    if is_coated(contacts, p):
        found -= worn_depth(contacts, p, ring_place(contacts, p, time))
    return found


@part
def softening(contacts: Contacts, interval: Interval, p: int) -> float:
    """The factor c of (2)."""
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    viscous = coating.viscosity[p] / (interval.end - interval.begin)
    return k / (k + coating.hardening[p] + viscous)


@part
def force_beyond_yield(contacts: Contacts, p: int, y: float, worn: float) -> float:
    """Y - F(w), N."""
    return y - contacts.coating.yield_force[p] - contacts.coating.hardening[p] * worn


@part
def coated_end_force(
    contacts: Contacts, interval: Interval, p: int, after: float
) -> tuple[float, float]:
    """The force y - c max(y - F, 0) of (2) at the end of a step, negative if the point is open.

    Args:
        contacts: the parameters.
        interval: the step.
        p: the point.
        after: y at the end, N.

    Returns:
        The force in N, and its derivative by `after`.
    """
    worn = worn_depth(contacts, p, ring_place(contacts, p, interval.end))
    beyond = force_beyond_yield(contacts, p, after, worn)
    c = softening(contacts, interval, p)
    if beyond > 0.0:
        return after - c * beyond, 1.0 - c
    return after, 1.0 + 0.0 * c


@kernel
def coated_mean_force(
    contacts: Contacts, interval: Interval, p: int, x0: Array, after: float
) -> tuple[float, float]:
    """Mean normal force of point p over a step that starts at x0 (d,): (2) along the arc.

    Args:
        contacts: the parameters.
        interval: the step.
        p: the point.
        x0: (d,) displacement at the start, m.
        after: y at the end of the step, N.

    Returns:
        The mean force in N, and its derivative by `after`.
    """
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    c, first, cells = softening(contacts, interval, p), coating.first[p], coating.cells[p]
    behind = ring_place(contacts, p, interval.begin)
    ahead = ring_place(contacts, p, interval.end)
    w, last = worn_depth(contacts, p, behind), worn_depth(contacts, p, ahead)
    virgin0 = contacts.preload[p] + k * penetration(contacts, p, x0, interval.begin)
    virgin1 = after + k * last
    way = 1 if ahead.real >= behind.real else -1
    node = int(np.floor(behind.real)) + 1 if way > 0 else int(np.ceil(behind.real)) - 1
    s, y, mean, by_end = 0.0 * behind, virgin0 - k * w, 0.0 * virgin0, 0.0 * virgin0
    while s.real < 1.0:  # from node to node; s is the part of the step that is done
        s1, w1 = 1.0 + 0.0 * behind, last
        if way * (ahead.real - node) > 0.0:
            s1, w1 = (node - behind) / (ahead - behind), coating.worn[first + node % cells]
        y1 = virgin0 + s1 * (virgin1 - virgin0) - k * w1
        beyond = force_beyond_yield(contacts, p, y, w)
        beyond1 = force_beyond_yield(contacts, p, y1, w1)
        elastic, elastic_by_1 = mean_normal_force(y, y1)
        plastic, plastic_by_1 = mean_normal_force(beyond, beyond1)
        _, elastic_by_0 = mean_normal_force(y1, y)
        _, plastic_by_0 = mean_normal_force(beyond1, beyond)
        mean += (s1 - s) * (elastic - c * plastic)
        by_0, by_1 = elastic_by_0 - c * plastic_by_0, elastic_by_1 - c * plastic_by_1
        by_end += (s1 - s) * (s * by_0 + s1 * by_1)
        s, y, w, node = s1, y1, w1, node + way
    return mean, by_end


@kernel
def wear(contacts: Contacts, interval: Interval, p: int, x0: Array, x1: Array) -> None:
    """Wear the layer in the arc of an accepted step of point p from x0 to x1 (d,): equation (3)."""
    coating, k = contacts.coating, contacts.normal_stiffness[p]
    first, cells = coating.first[p], coating.cells[p]
    behind = ring_place(contacts, p, interval.begin)
    ahead = ring_place(contacts, p, interval.end)
    virgin0 = contacts.preload[p] + k * penetration(contacts, p, x0, interval.begin)
    virgin1 = contacts.preload[p] + k * penetration(contacts, p, x1, interval.end)
    by_force = softening(contacts, interval, p) / k
    low, high = 0, 0
    if ahead > behind:
        low, high = int(np.floor(behind + SHIFT)) + 1, int(np.floor(ahead + SHIFT))
    elif ahead < behind:
        low, high = int(np.ceil(ahead - SHIFT)), int(np.ceil(behind - SHIFT)) - 1
    for node in range(low, high + 1):
        share = 1.0
        if ahead != behind:
            share = min(max((node - behind) / (ahead - behind), 0.0), 1.0)
        at, y = first + node % cells, virgin0 + share * (virgin1 - virgin0)
        beyond = force_beyond_yield(contacts, p, y - k * coating.worn[at], coating.worn[at])
        coating.worn[at] += by_force * positive(beyond)
