"""Which contact states occur in a period, and by how much they occur or are missed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact_state import OPEN, SLIP, STICK
from fenicsrom.online.state import Record
from fenicsrom.online.surfaces import Contacts

OPENS, SLIPS, STICKS = 1, 2, 4  # bits of the contact states that occur
_BITS = np.zeros(3, dtype=np.int64)  # by the contact state, of which -1 is the last entry
_BITS[[OPEN, SLIP, STICK]] = OPENS, SLIPS, STICKS
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


def state_bits(record: Record, contacts: Contacts) -> NDArray[np.int64]:
    """Bits `OPENS`, `SLIPS` and `STICKS` (P,) of the contact states that occur in the rows.

    Slip over less than `NEGLIGIBLE` of the largest stretch of the friction spring counts as stick.
    """
    bits = np.bitwise_or.reduce(_BITS[record.state], axis=0)
    largest = _largest_limit(record, contacts)
    rubs = (largest > 0.0) & (contacts.tangential_stiffness > 0.0)
    least = np.where(rubs, NEGLIGIBLE * largest / _stiffness(contacts), -1.0)
    negligible = ((bits & SLIPS) > 0) & (_slid(record, largest) <= least)
    return np.where(negligible, (bits & ~SLIPS) | STICKS, bits)


def _largest_limit(record: Record, contacts: Contacts) -> Array:
    """Largest limit of friction (P,), N."""
    return np.asarray(contacts.friction * np.max(record.force[:, :, 0], axis=0, initial=0.0))


def _stiffness(contacts: Contacts) -> Array:
    """Stiffness of the friction springs (P,), N/m; not zero."""
    return np.maximum(contacts.tangential_stiffness, SMALLEST)


def _slid(record: Record, largest: Array) -> Array:
    """Energy dissipated by friction at each point, divided by its largest limit (P,), m."""
    dissipated = np.max(record.friction_dissipation, axis=0, initial=0.0)
    return np.asarray(dissipated / np.maximum(largest, SMALLEST))


def extremes(record: Record, contacts: Contacts, bits: NDArray[np.int64]) -> Extremes:
    """The distances of the contact states from occurring, from the rows of a period.

    Args:
        record: the rows.
        contacts: parameters of the contact points.
        bits: (P,) the `state_bits` of the rows.
    """
    gap = np.min(record.gap, axis=0), np.max(record.gap, axis=0)
    most, least = (contacts.preload - contacts.normal_stiffness * value for value in gap)
    friction = np.sqrt(np.sum(record.force[:, :, 1:] ** 2, axis=2))
    spare = contacts.friction * record.force[:, :, 0] - friction
    margin = np.min(spare, axis=0, initial=np.inf, where=record.state == STICK)
    slid = _slid(record, _largest_limit(record, contacts))
    slips = (bits & SLIPS) > 0
    return Extremes(
        _signed(most, (bits & (SLIPS | STICKS)) > 0),
        _signed(-least, (bits & OPENS) > 0),
        _signed(np.where(slips, slid, -margin / _stiffness(contacts)), slips),
    )


def _signed(values: Array, occurs: NDArray[np.bool_]) -> Array:
    """The values with the sign that says whether a state occurs."""
    return np.where(occurs, np.maximum(values, SMALLEST), np.minimum(values, -SMALLEST))
