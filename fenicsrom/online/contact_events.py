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
    bits = np.zeros(record.state.shape[1], dtype=np.int64)
    for bit, state in ((OPENS, OPEN), (SLIPS, SLIP), (STICKS, STICK)):
        bits |= bit * np.any(record.state == state, axis=0)
    negligible = ((bits & SLIPS) > 0) & (_slid(record, contacts) <= _least(record, contacts))
    return np.where(negligible, (bits & ~SLIPS) | STICKS, bits)


def _limit(record: Record, contacts: Contacts) -> Array:
    """Limit of friction (rows, P), N."""
    return np.asarray(contacts.friction * record.force[:, :, 0])


def _slid(record: Record, contacts: Contacts) -> Array:
    """Energy dissipated by friction at each point, divided by its largest limit (P,), m."""
    largest = np.maximum(np.max(_limit(record, contacts), axis=0, initial=0.0), SMALLEST)
    return np.asarray(np.max(record.friction_dissipation, axis=0, initial=0.0) / largest)


def _least(record: Record, contacts: Contacts) -> Array:
    """Slip (P,) that counts as slip, m; -1 without friction or without its spring."""
    largest = np.max(_limit(record, contacts), axis=0, initial=0.0)
    stiffness = np.maximum(contacts.tangential_stiffness, SMALLEST)
    rubs = (largest > 0.0) & (contacts.tangential_stiffness > 0.0)
    return np.where(rubs, NEGLIGIBLE * largest / stiffness, -1.0)


def extremes(record: Record, contacts: Contacts, bits: NDArray[np.int64]) -> Extremes:
    """The distances of the contact states from occurring, from the rows of a period.

    Args:
        record: the rows.
        contacts: parameters of the contact points.
        bits: (P,) the `state_bits` of the rows.
    """
    force = contacts.preload - contacts.normal_stiffness * record.gap
    friction = np.linalg.norm(record.force[:, :, 1:], axis=2)
    stiffness = np.maximum(contacts.tangential_stiffness, SMALLEST)
    spare = np.where(record.state == STICK, _limit(record, contacts) - friction, np.inf)
    margin = np.min(spare, axis=0, initial=np.inf) / stiffness
    slips = (bits & SLIPS) > 0
    return Extremes(
        _signed(np.max(force, axis=0, initial=-np.inf), (bits & (SLIPS | STICKS)) > 0),
        _signed(np.max(-force, axis=0, initial=-np.inf), (bits & OPENS) > 0),
        _signed(np.where(slips, _slid(record, contacts), -margin), slips),
    )


def _signed(values: Array, occurs: NDArray[np.bool_]) -> Array:
    """The values with the sign that says whether a state occurs."""
    return np.where(occurs, np.maximum(values, SMALLEST), np.minimum(values, -SMALLEST))
