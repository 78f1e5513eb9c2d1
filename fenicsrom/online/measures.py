"""Numbers that are read off a motion."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact_points import ContactPoints
from fenicsrom.online.motion import Motion
from fenicsrom.post.figures import _touches
from fenicsrom.post.style import STATES

# of the largest displacement: an amplitude below it is rest; steadiness is told no finer either
RESTS = 1e-6
# relative change of the amplitudes from period to period below which they are taken as settled
SETTLED = 1e-3


def out_of_reach(motion: Motion, points: ContactPoints) -> list[str]:
    """A sentence on the points of each contact that touch nothing during the whole motion, with the
    gap that is left there.
    """
    sentences = []
    for k in np.unique(points.contact):
        mine = np.flatnonzero(points.contact == k)
        open_ones = mine[~np.any(motion.force[:, mine, 0] > 0.0, axis=0)]
        if open_ones.size:
            least = float(motion.gap[:, open_ones].min())
            number = "1 point" if mine.size == 1 else f"{open_ones.size} of {mine.size} points"
            sentences.append(
                f"contacts[{k}]: {number} out of reach during the whole run, no nearer than {1e3 * least:.4g} mm"
            )
    return sentences


def amplitude(motion: Motion) -> Array:
    """Half of peak-to-peak over the last period, of each point and direction, (P d,), m."""
    return np.ptp(motion.displacement[motion.last_period()], axis=0).reshape(-1) / 2.0


def at_rest(motion: Motion) -> bool:
    """Whether a motion ends at rest: what still moves is `RESTS` of the displacement, or less."""
    return bool(
        np.linalg.norm(amplitude(motion))
        <= RESTS * np.max(np.abs(motion.displacement), initial=0.0)
    )


def has_settled(motion: Motion) -> bool:
    """Whether the amplitudes of a harmonic motion repeat: it is steady, or the last four agree to
    `SETTLED`.

    Axial waves that damping hardly reaches may ring on, too small for the amplitudes, and keep it
    from being steady.
    """
    if motion.steady or at_rest(motion):
        return True
    if motion.period is None:
        return False
    now, slack = amplitude(motion), 1e-9 * motion.period
    for back in range(1, 4):
        end = motion.time[-1] - back * motion.period
        then = motion.displacement[
            (motion.time <= end + slack) & (motion.time >= end - motion.period - slack)
        ]
        if motion.periods < back + 1 or then.size == 0:
            return False
        if np.linalg.norm(now - np.ptp(then, axis=0).reshape(-1) / 2.0) > SETTLED * np.linalg.norm(
            now
        ):
            return False
    return True


def is_unsteady(motion: Motion) -> bool:
    """Whether a motion should repeat and does not settle."""
    return motion.period is not None and not has_settled(motion)


def rms(motion: Motion, since: float = 0.0) -> Array:
    """Root mean square of a motion about its mean, of each point and direction, (P d,), m.

    Over the second half of a motion that should repeat, else over all from a time on, s.
    """
    late = motion.time >= (since if motion.period is None else 0.5 * motion.time[-1])
    time, x = motion.time[late], motion.displacement[late].reshape(np.count_nonzero(late), -1)
    length = max(time[-1] - time[0], 1e-300)
    mean = np.trapezoid(x, time, axis=0) / length
    return np.asarray(np.sqrt(np.trapezoid((x - mean) ** 2, time, axis=0) / length))


def difference(motion: Motion, other: Motion) -> float:
    """Relative difference of two motions: of the amplitudes if both have settled, else of the root
    mean squares.
    """
    if has_settled(motion) and has_settled(other):
        a, b = amplitude(motion), amplitude(other)
    else:
        a, b = rms(motion), rms(other)
    size = float(np.linalg.norm(b))
    return float(np.linalg.norm(a - b)) / size if size > 0.0 else float(np.linalg.norm(a) > 0.0)


def peak_normal_force(motion: Motion, since: float = 0.0) -> float:
    """Largest normal contact force, N, of all points over the last period, else from a time on, s;
    0 without contact.
    """
    part = motion.last_period() if motion.period is not None else motion.time >= since
    return float(motion.force[part, :, 0].max(initial=0.0))


# numbers


def amplitudes(motion: Motion) -> dict[str, Any]:
    """Half of peak-to-peak over the last period, at the first contact point.

    Args:
        motion: displacement in the contact frame; where there is no contact, at the probe in the
            global axes, and then the first axis counts as the normal direction.

    Returns:
        `{"normal": m, "tangential": [m, ...]}`, one tangential amplitude per tangent direction.
    """
    half = np.ptp(motion.displacement[motion.last_period(), 0], axis=0) / 2
    return {"normal": float(half[0]), "tangential": [float(value) for value in half[1:]]}


def contact_fractions(motion: Motion) -> dict[str, float]:
    """Shares of the last period spent open, in slip and in stick, averaged over the contact points.

    Instants are weighted by the time they stand for (trapezoidal rule), as steps may differ.

    Returns:
        `{"open": ..., "slip": ..., "stick": ...}`, which sum to 1; without contact all of it is
        open.
    """
    if not _touches(motion):
        return {"open": 1.0, "slip": 0.0, "stick": 0.0}
    return {name: float(shares.mean()) for name, shares in _shares(motion).items()}


def _shares(motion: Motion) -> dict[str, np.ndarray]:
    """Share of the last period that each point spends in each state, by its name: (P,)."""
    part = motion.last_period()
    weights = _weights(motion.time[part])
    return {name: weights @ (motion.state[part] == value) for value, (name, _) in STATES.items()}


def peak_total_normal_force(motion: Motion) -> float:
    """Largest sum of the normal contact forces of all points at one instant, N, over the last
    period; 0 without contact.
    """
    return float(motion.force[motion.last_period(), :, 0].sum(axis=1).max(initial=0.0))


def dissipated_per_period(motion: Motion) -> float:
    """Energy rubbed away by friction in the last period, J (over the whole motion if it has no
    period).
    """
    if motion.period is None:
        return float(motion.friction_dissipation[-1] - motion.friction_dissipation[0])
    return float(
        motion.friction_dissipation[-1]
        - np.interp(motion.time[-1] - motion.period, motion.time, motion.friction_dissipation)
    )


def point_summaries(motion: Motion) -> list[dict[str, Any]]:
    """What each contact point does over the last period (over the whole motion if it has no
    period).

    Returns:
        For each point `peak_normal_force_N`, `fraction` (as `contact_fractions`) and
        `dissipated_per_period_J`.
    """
    part = motion.last_period()
    friction_dissipation = (
        motion.point_friction_dissipation[part][-1] - motion.point_friction_dissipation[part][0]
    )
    peaks, shares = motion.force[part, :, 0].max(axis=0), _shares(motion)
    return [
        {
            "peak_normal_force_N": float(peaks[p]),
            "fraction": {name: float(share[p]) for name, share in shares.items()},
            "dissipated_per_period_J": float(friction_dissipation[p]),
        }
        for p in range(motion.force.shape[1])
    ]


def response_summary(motion: Motion) -> dict[str, Any]:
    """The entry of a motion in `summary.json`.

    Returns:
        `amplitude_m` (of the first contact point), `fraction`, `peak_normal_force_N` (of any
        point), `peak_total_normal_force_N` (of all together), `dissipated_per_period_J` (by
        friction), `energy_imbalance` (relative), `steady`, `periods`, `steps`, `newton_iterations`.
    """
    return {
        "amplitude_m": amplitudes(motion),
        "fraction": contact_fractions(motion),
        "peak_normal_force_N": peak_normal_force(motion),
        "peak_total_normal_force_N": peak_total_normal_force(motion),
        "dissipated_per_period_J": dissipated_per_period(motion),
        "energy_imbalance": float(motion.relative_imbalance),
        "steady": bool(motion.steady),
        "periods": int(motion.periods),
        "steps": int(motion.steps),
        "newton_iterations": int(motion.newton_iterations),
    }


def errors_percent(motion: Motion, reference: Motion) -> dict[str, float | None]:
    """Differences over the last period from a reference, in percent of the reference.

    Args:
        motion: the motion to judge.
        reference: usually of the full model.

    Returns:
        `{"amplitude_tangential": ..., "amplitude_normal": ..., "peak_normal_force": ...,
        "dissipated_per_period": ...}`; tangential amplitudes are compared as a vector. None where
        the reference does not move in that direction (less than 1e-9 of its whole amplitude), or
        has no such force or friction.
    """
    ours, theirs = amplitudes(motion), amplitudes(reference)
    pairs = list(itertools.zip_longest(ours["tangential"], theirs["tangential"], fillvalue=0.0))
    least = 1e-9 * math.hypot(theirs["normal"], *theirs["tangential"])

    def percent(difference: float, of: float, least: float = 0.0) -> float | None:
        return 100 * abs(difference) / of if of > least else None

    force, friction = peak_normal_force(reference), dissipated_per_period(reference)
    return {
        "amplitude_tangential": percent(
            math.hypot(*(a - b for a, b in pairs)), math.hypot(*theirs["tangential"]), least
        ),
        "amplitude_normal": percent(ours["normal"] - theirs["normal"], theirs["normal"], least),
        "peak_normal_force": percent(peak_normal_force(motion) - force, force),
        "dissipated_per_period": percent(dissipated_per_period(motion) - friction, friction),
    }


def _weights(time: np.ndarray) -> np.ndarray:
    """Share of the whole that each instant stands for by the trapezoidal rule, (ns,), sum 1."""
    if len(time) < 2:
        return np.ones(len(time))
    steps = np.diff(time)
    return (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / (2 * (time[-1] - time[0]))
