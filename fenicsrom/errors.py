"""The three ways the program says no."""

from __future__ import annotations

from typing import Any


class SceneError(ValueError):
    """The input is wrong: one sentence naming the file, the key, the value and what is allowed
    (exit code 2).
    """


class ConvergenceError(RuntimeError):
    """An iteration did not converge: says when and where, and keeps what was computed (exit code
    1).

    Attributes:
        partial: what was computed before the failure (a `Motion`, a list of equilibria, or None).
    """

    def __init__(self, message: str, partial: Any = None):
        """Store the sentence and the partial result."""
        super().__init__(message)
        self.partial = partial


class AccuracyError(RuntimeError):
    """A result failed its own check (a residual, an orthogonality, the energy ledger): it is not
    returned (exit code 1).

    Attributes:
        partial: what was computed, for inspection (a `Motion`), or None.
    """

    def __init__(self, message: str, partial: Any = None):
        """Store the sentence and the result that failed."""
        super().__init__(message)
        self.partial = partial
