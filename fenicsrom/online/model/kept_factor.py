"""Whether the factor of an earlier state of a model still serves the iteration of a time step."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from fenicsrom.arrays import Array

MORE = 1
"""A factor is kept for the next step if it took at most so many iterations more than when new.

The tangent moves with the motion.
"""

PATIENCE = 8
"""Iterations of a step, of at most fifteen, before each one makes its own factor."""

SAME_COEFFICIENT = 1e-10
"""Relative difference of coefficients that is rounding: steps of equal size differ by 1e-12."""


def same_coefficients(ours: Iterable[float], theirs: Iterable[float]) -> bool:
    """Whether the coefficients of two matrices are the same, up to rounding."""
    pairs = zip(ours, theirs, strict=True)
    return all(abs(a - b) <= SAME_COEFFICIENT * abs(b) for a, b in pairs)


class KeptFactor:
    """The iteration of a time step: how fast its changes become smaller.

    Attributes:
        iteration: its number, from 1.
        was_long: whether the last step needed more iterations than that which made the factor.
        is_slow: whether the last change is too large after the one before.
        renewals: number of factorisations in this step.
    """

    def __init__(self, dot: Callable[[Array, Array], float], contraction: float):
        """Take the inner product of two vectors, of all ranks.

        Args:
            dot: the inner product.
            contraction: largest ratio of two changes in a time step with one factor.
        """
        self._dot, self._contraction = dot, contraction
        self._start: Array | None = None
        self._dq: Array = np.zeros(0)
        self._change = np.inf
        self.iteration, self.renewals, self._least = 0, 0, 0
        self.was_long, self.is_slow = False, False

    def note(self, q0: Array, dq: Array) -> None:
        """Note the iterate dq (local,) of a step that starts at q0 (local,)."""
        if self._start is None or self._distance(q0, self._start) != 0.0:
            if self.renewals:
                self._least = self.iteration
            self._start, self.was_long = q0.copy(), self.iteration > self._least + MORE
            self.iteration, self.renewals = 0, 0
            self._change = change = np.inf
        else:
            change = self._distance(dq, self._dq)
        self.iteration += 1
        self.is_slow = not change <= self._contraction * self._change
        self._dq, self._change = dq.copy(), change

    def renew(self) -> None:
        """Note that this iteration makes a factor."""
        self.renewals += 1

    def _distance(self, a: Array, b: Array) -> float:
        return float(np.sqrt(self._dot(a - b, a - b)))

    @property
    def needs_factor(self) -> bool:
        """Whether the iteration is too slow with the factor of an earlier state."""
        if self.iteration == 1:
            return self.was_long
        return self.is_slow or self.iteration > PATIENCE
