"""How well motions agree, and whether a reduced model pays: arithmetic without any model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.stats

from fenicsrom.arrays import Array
from fenicsrom.online.measures import errors_percent, interpolated, times_before_end
from fenicsrom.online.motion import Motion

PHASES = 2000  # points of the common grid on which two periods are compared


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Spearman's rank correlation; equal values share their mean rank.

    Returns:
        The correlation, None if one of the two does not vary.
    """
    ranks = np.array([scipy.stats.rankdata(values) for values in (first, second)])
    deviation = ranks - ranks.mean(axis=1, keepdims=True)
    size = np.sqrt(np.sum(deviation**2, axis=1))
    return float(deviation[0] @ deviation[1] / (size[0] * size[1])) if size.all() else None


def break_even(offline: float, online: float, full: float) -> int | None:
    """Number of runs after which the offline stage pays.

    It is the least n with offline + n online <= n full, in seconds.

    Returns:
        The number, None if the reduced model is no faster than the full one.
    """
    return max(1, int(np.ceil(offline / (full - online)))) if full > online else None


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the points that no other beats in both cost and error, the cheapest first."""
    front: list[int] = []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if not front or errors[k] < errors[front[-1]]:
            front.append(k)
    return front


def motion_errors(motion: Motion, reference: Motion) -> dict[str, float | None]:
    """Errors of the last period against that of a reference, percent.

    Returns:
        The errors of `fenicsrom.online.measures.errors_percent`; `history`: L2 norm of the
        difference of the displacements at equal phases, relative to the reference, of all points
        and directions; `state`: part of the period in another contact state. None where the
        reference has nothing to compare with.
    """
    shift, other = (on_phases(m, m.displacement) for m in (motion, reference))
    size = float(np.linalg.norm(other))
    return errors_percent(motion, reference) | {
        "history": 100.0 * float(np.linalg.norm(shift - other)) / size if size > 0.0 else None,
        "state": wrong_state(motion, reference) if reference.state.shape[1] else None,
    }


def on_phases(motion: Motion, values: Array) -> Array:
    """Values (ns, ...) at `PHASES` equal phases of the last period: (`PHASES`, columns).

    Without period the whole motion takes the place of the last period.
    """
    phases = 1.0 - np.arange(PHASES) / PHASES
    return interpolated(motion, values, times_before_end(motion, phases))


def wrong_state(motion: Motion, reference: Motion) -> float:
    """Part of the last period in another contact state than the reference, percent.

    It is averaged over the contact points. Between two steps the state is that of the nearest step.
    """
    phases = 1.0 - (np.arange(PHASES) + 0.5) / PHASES
    codes = []
    for m in (motion, reference):
        middles = 0.5 * (m.time[1:] + m.time[:-1])
        codes.append(m.state[np.searchsorted(middles, times_before_end(m, phases))])
    return float(100.0 * np.mean(codes[0] != codes[1]))
