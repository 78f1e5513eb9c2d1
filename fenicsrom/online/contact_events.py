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


def state_bits(record: Record) -> NDArray[np.int64]:
    """Bits `OPENS`, `SLIPS` and `STICKS` (P,) of the contact states that occur in the rows."""
    bits = np.zeros(record.state.shape[1], dtype=np.int64)
    for bit, state in ((OPENS, OPEN), (SLIPS, SLIP), (STICKS, STICK)):
        bits |= bit * np.any(record.state == state, axis=0)
    return bits


def extremes(record: Record, contacts: Contacts) -> Extremes:
    """The distances of the contact states from occurring, from the rows of a period."""
    bits = state_bits(record)
    force = contacts.preload - contacts.normal_stiffness * record.gap
    limit = contacts.friction * record.force[:, :, 0]
    friction = np.linalg.norm(record.force[:, :, 1:], axis=2)
    stiffness = np.maximum(contacts.tangential_stiffness, SMALLEST)
    sticks = record.state == STICK
    margin = np.min(np.where(sticks, limit - friction, np.inf), axis=0, initial=np.inf) / stiffness
    largest = np.maximum(np.max(limit, axis=0, initial=0.0), SMALLEST)
    slid = np.max(record.friction_dissipation, axis=0, initial=0.0) / largest
    return Extremes(
        _signed(np.max(force, axis=0, initial=-np.inf), (bits & (SLIPS | STICKS)) > 0),
        _signed(np.max(-force, axis=0, initial=-np.inf), (bits & OPENS) > 0),
        _signed(np.where((bits & SLIPS) > 0, slid, -margin), (bits & SLIPS) > 0),
    )


def _signed(values: Array, occurs: NDArray[np.bool_]) -> Array:
    """The values with the sign that says whether a state occurs."""
    return np.where(occurs, np.maximum(values, SMALLEST), np.minimum(values, -SMALLEST))
