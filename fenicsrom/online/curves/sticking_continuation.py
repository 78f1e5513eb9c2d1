"""A continuation through the begin of slip, where the curve has a kink."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.free_sliders import STAYS, solve_with_free_sliders
from fenicsrom.online.periodic.shooting import RANK


class StickingContinuation(Continuation):
    """A continuation in which a slider that sticks during the whole period stays in place.

    The derivative jumps where slip begins, so that a small residual may grow in a correction.
    """

    may_grow = 1e-4

    def _solve(self, jacobian: Array, right: Array, stuck: bool) -> Array:
        """Solve the bordered system; arguments as `Continuation._solve`."""
        try:
            found, free = solve_with_free_sliders(jacobian, right, self.shooting.sliders)
            is_small = np.linalg.norm(found) < max(float(np.linalg.norm(right)), 1e-300) / RANK
            if is_small and (free > 0 or not stuck):
                return found
        except np.linalg.LinAlgError:
            pass
        return super()._solve(jacobian, right, stuck)

    def _tangent(self, jacobian: Array, stuck: bool) -> tuple[Array, int]:
        """The unit tangent of the curve, and the number of free slider components."""
        right = np.append(np.zeros(len(jacobian) - 1), 1.0)
        found = self._solve(jacobian, right, stuck)
        sliders = jacobian[self.shooting.sliders]
        free = int(np.sum(np.max(np.abs(sliders), axis=1, initial=0.0) <= STAYS))
        return found / np.linalg.norm(found), free
