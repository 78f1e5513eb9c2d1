"""A key of a scene that does not agree with the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from fenicsrom.errors import ErrorKind


class Problem(NamedTuple):
    """A key that does not agree with the others.

    Attributes:
        key: the dotted key.
        value: its value, or `MISSING`.
        allowed: what is allowed, in words.
        kind: the kind of the error; a missing value has its own kind.
    """

    key: str
    value: object
    allowed: str
    kind: ErrorKind = ErrorKind.CONFLICT


Problems = Iterator[Problem]
