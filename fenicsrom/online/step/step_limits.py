"""The longest adaptive step, and the times on which adaptive steps must land.

The controller of the step sees a load or a surface only at the ends of the steps. It must not jump
over what happens between them:

* A step is at most `LONGEST` tolerance^(1/3) of the shortest period of the loads and of the waves
  of surfaces. A step that uses up its tolerance for a motion of this period, at an error of
  (omega h)^3/12, is 0.08 tolerance^(1/3) of the period long. The longest step is thus 2.5 times as
  long, at most a fifth of the period, and follows the tolerance: a check with eight times the
  tolerance has twice the longest step, less than half a period. Two runs that sample a load alike
  would not see that they miss it.
* Steps land on the rows of tables and of approaching surfaces where the slope changes, and on the
  quarters of impacts: the run sees every crest.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.loads import LoadHistories, instants, quarter_period

LONGEST = 0.2
"""Longest step for a tolerance of 1, as a part of the shortest period."""

CORNER = 1e-9
"""Smaller changes of slope, relative to the largest slope, are rounding errors."""


def longest_step(load_histories: LoadHistories, contacts: Contacts, tolerance: float) -> float:
    """The longest adaptive step in s; infinite if nothing oscillates."""
    shortest = min(4.0 * quarter_period(load_histories), _wave_period(contacts))
    return float(LONGEST * np.cbrt(tolerance) * shortest)


def landings(
    load_histories: LoadHistories,
    contacts: Contacts,
    begin: float,
    end: float,
    adaptive: bool = True,
) -> Array:
    """Times in s, after `begin` and up to `end`, on which steps land; `end` is the last.

    Args:
        load_histories: the time factors of the loads.
        contacts: the parameters of the contacts.
        begin: s.
        end: s.
        adaptive: whether the steps are adaptive; other steps land on the corners of the speed only.
    """
    found = [load_histories.history[:, 0]]
    if adaptive:
        found.append(instants(load_histories, end))
        for _, _, low, high in load_histories.spans:
            found.append(_corners(*load_histories.table[low:high].T))
        found += [_corners(contacts.times, distance) for distance in contacts.approach]
    times = np.unique(np.concatenate(found))
    times = times[(times > begin) & (times < end)]
    # a landing closer to another one than the rounding of the march makes a step of no length
    apart = np.diff(times, append=end) > 1e-9 * (end - begin)
    return np.append(times[apart & (times - begin > 1e-9 * (end - begin))], end)


def _wave_period(contacts: Contacts) -> float:
    """The time in which the shortest wave of a surface passes a contact point, s."""
    orders = np.where(contacts.height != 0.0, contacts.order, 0.0).max(axis=1, initial=0.0)
    fastest = np.max(np.abs(contacts.history[:, 1]), initial=0.0)
    spins = np.abs(contacts.spin) + np.abs(contacts.turns) * fastest
    rate = np.max(orders * spins, initial=0.0)
    return 2.0 * np.pi / rate if rate > 0.0 else np.inf


def _corners(times: Array, values: Array) -> Array:
    """The times at which the slope of a table changes, its ends included if it is not constant."""
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
    change = np.abs(np.diff(slopes))
    return times[change > CORNER * np.max(np.abs(slopes))] if times.size else times
