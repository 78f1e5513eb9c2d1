"""True errors of motions against a reference, and measures over several errors and costs."""

from collections.abc import Sequence

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.motion.measures import errors_percent, interpolated, times_before_end
from fenicsrom.online.motion.motion import Motion

GRID_PHASES = 2000  # points of the common grid on which two periods are compared


def motion_errors(motion: Motion, reference: Motion) -> dict[str, float | None]:
    """Errors of the last period against the last period of a reference, percent.

    Returns:
        The errors of `online.motion.measures.errors_percent`, and two more. `history` compares
        the displacements of all points and directions at equal phases: `history` is the L2 norm of
        their difference, relative to the reference. `state` is the part of the period in which
        the contact state differs. An error is None if the reference value is zero or missing; of
        another number of contact points, on another mesh, so are these two.
    """
    if motion.displacement.shape[1:] != reference.displacement.shape[1:]:
        return errors_percent(motion, reference) | {"history": None, "state": None}
    shift, other = (on_phases(m, m.displacement) for m in (motion, reference))
    size = float(np.linalg.norm(other))
    return errors_percent(motion, reference) | {
        "history": 100.0 * float(np.linalg.norm(shift - other)) / size if size > 0.0 else None,
        "state": wrong_state(motion, reference) if reference.state.shape[1] else None,
    }


def on_phases(motion: Motion, values: Array) -> Array:
    """Values (ns, ...) at equal phases of the last period: (`GRID_PHASES`, columns).

    A motion without a period is taken as a whole.
    """
    phases = 1.0 - np.arange(GRID_PHASES) / GRID_PHASES
    return interpolated(motion, values, times_before_end(motion, phases))


def wrong_state(motion: Motion, reference: Motion) -> float:
    """Part of the last period in which the contact state differs from the reference, percent.

    The part is averaged over the contact points. Between two steps, the nearest step gives the
    state.
    """
    phases = 1.0 - (np.arange(GRID_PHASES) + 0.5) / GRID_PHASES
    codes = []
    for m in (motion, reference):
        middles = 0.5 * (m.time[1:] + m.time[:-1])
        codes.append(m.state[np.searchsorted(middles, times_before_end(m, phases))])
    return float(100.0 * np.mean(codes[0] != codes[1]))


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> float | None:
    """Spearman's rank correlation; equal values share their mean rank.

    Returns:
        The correlation; None if all values of one list are equal.
    """
    if not (np.ptp(first) and np.ptp(second)):
        return None
    from scipy.stats import spearmanr  # takes a second to import

    return float(spearmanr(first, second).statistic)


def break_even(offline: float, online: float, full: float) -> int | None:
    """Number of runs after which the offline stage has saved time.

    This number is the least n with offline + n online <= n full, in seconds.

    Returns:
        The number; None if the reduced model is no faster than the full model.
    """
    return max(1, int(np.ceil(offline / (full - online)))) if full > online else None


def pareto_front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Indices of the points that no other point beats in both cost and error, cheapest first."""
    front: list[int] = []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if not front or errors[k] < errors[front[-1]]:
            front.append(k)
    return front
