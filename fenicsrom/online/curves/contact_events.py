"""Which contact states occur in a period, and by how much they occur or are missed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.step.state import Record

OPENS, SLIPS, STICKS = 1, 2, 4  # bits of the contact states that occur
_BITS = np.zeros(3, dtype=np.int64)  # by the contact state, of which -1 is the last entry
_BITS[[OPEN, SLIP, STICK]] = OPENS, SLIPS, STICKS
_SHOWN = np.array([[SLIPS | STICKS], [OPENS], [SLIPS]])  # bits that count for each of `Extremes`
NEGLIGIBLE = 1e-7  # slip below this part of the stretch of the friction spring is round-off
SMALLEST = 1e-300  # an extreme of a state that occurs is at least this, so that it has a sign


class Extremes(NamedTuple):
    """How far each of P contact points is from states that do not occur in a period.

    Each number is positive if the state occurs, negative if not, and passes zero with a kink at
    most where the state first occurs along a curve.

    Attributes:
        touch: (P,) largest trial normal force N0 - k_n gap, N.
        lift_off: (P,) largest negative trial normal force, N.
        slip: (P,) with slip, the energy dissipated by friction divided by its largest limit;
            without slip, minus the shortest distance of the friction spring from its limit, m.
    """

    touch: Array
    lift_off: Array
    slip: Array


def occurrences(
    record: Record, contacts: Contacts, drift: Array | float = 0.0
) -> tuple[NDArray[np.int64], Extremes]:
    """Which contact states occur in the rows of a period, and how far the others are.

    Slip over less than `NEGLIGIBLE` of the largest stretch of the friction spring counts as stick,
    and so does slip in one sense only, by which a slider is dragged to its place.

    Args:
        record: the rows.
        contacts: parameters of the contact points.
        drift: (P,) distance from the slider at the start of the period to that at its end, m.

    Returns:
        Bits `OPENS`, `SLIPS` and `STICKS` (P,) of the states that occur, and the `Extremes`.
    """
    bits = np.bitwise_or.reduce(_BITS[record.state], axis=0)
    limit = contacts.friction * record.force[:, :, 0]
    largest = np.max(limit, axis=0)
    stiffness = np.maximum(contacts.tangential_stiffness, SMALLEST)
    slid = np.max(record.friction_dissipation, axis=0) / np.maximum(largest, SMALLEST)
    slid = np.maximum(slid - drift, 0.0)
    rubs = (largest > 0.0) & (contacts.tangential_stiffness > 0.0)
    sticks = rubs & (slid <= NEGLIGIBLE * largest / stiffness) & ((bits & SLIPS) > 0)
    bits = np.where(sticks, (bits & ~SLIPS) | STICKS, bits)
    spare = limit - np.sqrt(np.sum(record.force[:, :, 1:] ** 2, axis=2))
    margin = np.min(spare, axis=0, initial=np.inf, where=record.state == STICK) / stiffness
    force = contacts.preload - contacts.normal_stiffness * record.gap
    occurs = (bits & _SHOWN) > 0
    slip = np.where(occurs[2], slid, -margin)
    values = np.array([np.max(force, axis=0), -np.min(force, axis=0), slip])
    signed = np.where(occurs, np.maximum(values, SMALLEST), np.minimum(values, -SMALLEST))
    return bits, Extremes(*signed)
