"""The errors of the program: one class for each exit path, and a kind that code can check.

A message is one printable line for the user. Code never reads the message: it checks the class,
`kind`, `key` and `source`.
"""

import logging
import traceback
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Any


class ErrorKind(Enum):
    """What an error is about."""

    # wrong input (SceneError)
    INPUT = "wrong input that no other kind describes"
    MISSING = "a required key is missing"
    UNKNOWN_KEY = "a key that does not exist"
    TYPE = "a value of the wrong type"
    RANGE = "a value of the right type that is not allowed"
    CONFLICT = "a key that another key excludes, or keys that contradict each other"
    FILE = "a file that does not exist or cannot be read"
    FORMAT = "a file with damaged or unsupported content"
    MISMATCH = "files that do not belong together"
    MESH = "a mesh that cannot be used"
    PLACE = "a group, node or region that the mesh lacks, or that cannot be used there"
    SUPPORT = "supports that do not hold the body"
    DEPENDENCY = "an optional Python module that is not installed"
    # failed computations (ConvergenceError, AccuracyError)
    CONVERGENCE = "an iteration that did not converge"
    INSTABILITY = "an equilibrium that is unstable"
    ACCURACY = "a result that failed its own check"
    ENERGY = "a motion that does not balance its energy"
    TIME_STEP = "a motion with a time step that is too long"
    BASIS = "a basis that is too small or lost its structure"
    NOT_FINITE = "a result that is not a finite number"
    MEMORY = "a computation that needs more memory than there is"
    DEFECT = "an error of the program"


def printable(text: str) -> str:
    """Escape every character of a text that a terminal would interpret."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class SceneError(ValueError):
    """The input is wrong (exit code 2).

    The message is one sentence that names the file, the key, the value and what is allowed.

    Attributes:
        kind: what is wrong.
        key: the dotted key of the scene that the error is about, such as "loads[0].force", or "".
        source: the file that the error is about, as the message names it, or "".

    Example:
        >>> import fenicsrom as fr
        >>> try:
        ...     fr.read_scene("demos/slip_liftoff_2d.toml", "contacts.0.friction=-0.5")
        ... except fr.SceneError as error:
        ...     print(error.kind.name, error.key)
        RANGE contacts[0].friction
    """

    def __init__(
        self, message: str, *, kind: ErrorKind = ErrorKind.INPUT, key: str = "", source: str = ""
    ):
        """Store the sentence, the kind, the key and the source."""
        super().__init__(printable(message))
        self.kind = kind
        self.key = key
        self.source = source


def refuse(
    source: object, reason: str, kind: ErrorKind = ErrorKind.FORMAT, key: str = ""
) -> SceneError:
    """Make the error of a file, or of a key in it: "file: reason" or "file: key: reason"."""
    sentence = f"{source}: {key}: {reason}" if key else f"{source}: {reason}"
    return SceneError(sentence, kind=kind, key=key, source=str(source))


class _Failure(RuntimeError):
    """A failed computation (exit code 1). The message says when and where.

    Attributes:
        partial: what was computed, for inspection (a `Motion`, a list of equilibria), or None.
        kind: what failed.
        key: the dotted key of the scene to change, such as "time.steps_per_period", or "".
        quantity: of `fenicsrom.notes`, the one that lacks a result or fails; "" if all do.
        decrements: of each iteration of the last attempt of Newton's method: the decrement
            `|residual · change|` in J, or the relative residual of a periodic motion. Empty if
            another method failed.
    """

    kind: ErrorKind

    def __init__(
        self,
        message: str,
        partial: Any = None,
        *,
        kind: ErrorKind | None = None,
        key: str = "",
        quantity: str = "",
        decrements: Sequence[float] = (),
    ):
        """Store the sentence, the partial result and the decrements."""
        super().__init__(message)
        self.partial, self.kind, self.key = partial, kind or self.kind, key
        self.quantity, self.decrements = quantity, tuple(decrements)


class ConvergenceError(_Failure):
    """An iteration did not converge."""

    kind = ErrorKind.CONVERGENCE


class AccuracyError(_Failure):
    """A result failed its own check and is not returned.

    The checks are a residual, an orthogonality, the energy balance and the estimated errors.
    """

    kind = ErrorKind.ACCURACY


def job_error(error: Exception) -> ConvergenceError | AccuracyError:
    """The error of one computation of several, by the exception that ended this computation.

    The sentence of an unexpected exception says where it was raised; the log has its traceback at
    the level DEBUG.
    """
    if isinstance(error, ConvergenceError | AccuracyError):
        return error
    if isinstance(error, SceneError | OSError):
        return ConvergenceError(printable(str(error)))
    logging.getLogger("fenicsrom").debug("one of several computations failed", exc_info=error)
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    what = printable(f"{type(error).__name__}: {error}")
    return ConvergenceError(
        f"an error of the program ended this computation: {what}{where}; please report it",
        kind=ErrorKind.DEFECT,
    )
