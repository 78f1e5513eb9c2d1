"""Whether a march tends to a periodic motion.

Let z be a state of the march, P the period map, z* the periodic motion, d = z - z* and A the
monodromy matrix. The march tends to the motion if it stays near the linear motion about it,

    |P^k(z) - z* - A^k d| <= NEAR |A^k d|,   k = 1, 2, .., K                                    (1)

in the scaled norm of `fenicsrom.online.periodic.shooting.Shooting`, or if |d| is below `CLOSE` of
the motion. The first states of a march may be too far from z*, so (1) is tried from each of them.

The march ends after a number of periods, which is doubled while it comes nearer to z* at a part
`APPROACH` of the rate of the largest multiplier: from afar, where (1) does not hold yet, contacts
that open and close may keep the motion large for hundreds of periods.

K periods show whether the slow motions are linear: each part of d with a multiplier mu must have
turned `TURNS` times about the periodic motion, or must have decayed to `DECAYED` of itself. One
period would not be enough: a lightly damped motion changes so little in a period that any d
passes. What (1) misses grows at most with k^2, so k < K periods are enough where it misses only
NEAR (k/K)^2. A system with several stable motions thus ends in the same one as the march.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.periodic.shooting import (
    STABLE_WITHIN,
    PeriodicMotion,
    Shooting,
    largest_multiplier,
)

# Part of |A^k d| that (1) may miss. The linear map A then describes the march to 30 %: z is in the
# region where the periodic motion attracts, not only near the border to another motion.
NEAR = 0.3
CLOSE = 1e-6  # |d| relative to the motion, below which rounding decides about (1)
# Around another motion, or around none, the frequency depends on the amplitude and the phase: the
# march leaves the linear motion within a turn or two. A part that does not turn must decay.
TURNS = 2.0
DECAYED = 0.1
SIGNIFICANT = 0.01  # parts of d below this part of |d| do not count
APPROACH = 0.1  # a motion that does not settle would have to come as near by chance
# Change of the state in a period, relative to the state, below which Newton's method starts: where
# the contacts still change from period to period, it needs many iterations.
CALM = 1e-2


class MarchedPath:
    """The states that a march reaches, each a period of the sought motion after the one before.

    Attributes:
        shooting: the equation of this motion.
        states: scaled variables after 0, 1, 2, .. periods, as far as they were marched.
    """

    def __init__(self, shooting: Shooting, s: Array):
        """Start at the scaled variables s."""
        self.shooting, self.states = shooting, [s]

    def reaches(self, k: int) -> bool:
        """March to the state after k periods; return whether no step failed."""
        while len(self.states) <= k:
            found = self.shooting.march(self.states[-1], derive=False)
            if found is None:
                return False
            self.states.append(self.states[-1] + found[0])
        return True

    def calm_state(self, periods: int) -> Array:
        """The first state that changed by at most `CALM` in a period, or that after `periods`.

        Where a step fails, it is the last state before.
        """
        for k in range(1, periods + 1):
            if not self.reaches(k):
                break
            change = np.linalg.norm(self.states[k] - self.states[k - 1])
            if change <= CALM * np.linalg.norm(self.states[k]):
                return self.states[k]
        return self.states[-1]

    def distances(self, motion: PeriodicMotion) -> Array:
        """Distances of the states from a motion, relative to it."""
        found = self.shooting.scaled(motion.z)
        return np.linalg.norm(np.array(self.states) - found, axis=1) / np.linalg.norm(found)

    def comes_nearer(self, motion: PeriodicMotion) -> bool:
        """Whether a motion is stable, and the later half of the states nearer to it.

        The median distance must have fallen at `APPROACH` of the rate of the largest multiplier.
        """
        earlier, later = np.array_split(self.distances(motion), 2)
        rate = abs(largest_multiplier(motion.multipliers, motion.free_sliders))
        return motion.stable and bool(
            np.median(later) <= rate ** (APPROACH * earlier.size) * np.median(earlier)
        )

    def tends_to(self, motion: PeriodicMotion, periods: int, longest: int = 0) -> bool:
        """Whether the path tends to a motion by (1).

        Args:
            motion: the motion.
            periods: number of its periods within which (1) must be shown. The number is doubled
                while the path comes nearer to the motion.
            longest: largest number of periods; by default it is not doubled.
        """
        found = self.shooting.scaled(motion.z)
        size = float(np.linalg.norm(found))
        matrix = self.shooting.scaled_matrix(motion.end.matrix)
        horizon_of = horizon_by_distance(matrix)
        # A^k d, k and K of the states from which (1) may still hold
        linear: Array = np.zeros((found.size, 0))
        ages: Array = np.zeros(0)
        horizons: Array = np.zeros(0)
        for k in range(max(periods, longest)):
            if k == periods:
                if not self.comes_nearer(motion):
                    return False
                periods *= 2
            d = self.states[k] - found
            if float(np.linalg.norm(d)) <= CLOSE * size:
                return True
            if not self.reaches(k + 1):
                return False
            linear = matrix @ np.column_stack([linear, d])
            ages = np.append(ages, 0.0) + 1.0
            horizons = np.append(horizons, horizon_of(d))
            off = (self.states[k + 1] - found)[:, None] - linear
            miss = np.linalg.norm(off, axis=0) / np.linalg.norm(linear, axis=0)
            if np.any(miss <= NEAR * np.minimum(1.0, ages / horizons) ** 2):
                return True
            near = miss <= NEAR
            linear, ages, horizons = linear[:, near], ages[near], horizons[near]
        return False


def horizon_by_distance(matrix: Array) -> Callable[[Array], int]:
    """The number K of periods in (1) by the distance d (N,), for a monodromy matrix (N, N).

    d is split into eigenvectors of the matrix. A part with the multiplier mu turns by arg(mu) and
    shrinks to |mu| in a period. A multiplier 1, that of a slider that is not unique, needs nothing.
    """
    multipliers, vectors = np.linalg.eig(matrix)
    inverse = np.linalg.pinv(vectors, rcond=multipliers.size * np.finfo(float).eps)
    with np.errstate(divide="ignore"):
        turns = TURNS * 2.0 * np.pi / np.abs(np.angle(multipliers))
        decay = np.log(DECAYED) / np.log(np.minimum(np.abs(multipliers), 1.0 - 1e-12))
    periods = np.minimum(turns, np.maximum(decay, 1.0))
    periods[np.abs(multipliers - 1.0) <= STABLE_WITHIN] = 1.0

    def horizon(d: Array) -> int:
        parts = np.abs(inverse @ d)
        return int(np.ceil(np.max(periods[parts > SIGNIFICANT * np.linalg.norm(d)], initial=1.0)))

    return horizon
