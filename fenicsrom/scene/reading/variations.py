"""The axes of a sweep: lists and ranges of values of scene keys.

    loads.0.force=[50, 100, 150]       a list, as TOML writes it
    loads.0.frequency=3.0:3.4:21       21 values in equal steps, both ends included
    contacts.0.friction=0.01:1:5:log   5 values in equal ratios

The runs of a sweep are all combinations of the values of its axes. The keys of one axis change
together.
"""

from __future__ import annotations

import itertools
import json
import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene.base.rules import is_number, show

MOST_RUNS = 100_000
DIGITS = 12  # of the values of a range, so that 0.1 does not become 0.10000000000000001


@dataclass(frozen=True)
class Axis:
    """Keys of the scene that change together.

    Attributes:
        keys: their paths.
        values: for each position on the axis, one value of each key.
    """

    keys: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...]

    def overrides(self, position: int) -> list[str]:
        """The overrides of a position, one for each key."""
        return [
            f"{key}={json.dumps(value, ensure_ascii=False)}"
            for key, value in zip(self.keys, self.values[position], strict=True)
        ]


def make_axes(over: Sequence[str], together: Sequence[str] = ()) -> tuple[Axis, ...]:
    """Read the axes of a sweep.

    Args:
        over: texts KEY=VALUES, each of which is an axis.
        together: texts KEY=VALUES of keys that change together; they form one axis, the last one.

    Raises:
        SceneError: there is no axis, a text is not KEY=VALUES, a key occurs twice, the keys that
            change together have different numbers of values, or there are more than `MOST_RUNS`
            runs.
    """
    axes = [Axis((key,), tuple((value,) for value in values)) for key, values in map(_read, over)]
    if together:
        keys, lists = zip(*map(_read, together), strict=True)
        counts = {key: len(values) for key, values in zip(keys, lists, strict=True)}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{key} has {count}" for key, count in counts.items())
            raise _refuse("--zip", f"the keys need equally many values, but {listed}", keys[0])
        axes.append(Axis(tuple(keys), tuple(zip(*lists, strict=True))))
    if not axes:
        sentence = "sweep: give at least one axis, such as --over loads.0.force=50:150:11"
        raise SceneError(sentence, kind=ErrorKind.MISSING, key="--over")
    keys = [key for axis in axes for key in axis.keys]
    for key in keys:
        if keys.count(key) > 1:
            raise _refuse("--over", f"{key} is given twice", key)
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_RUNS:
        raise _refuse("--over", f"{count} runs are too many: at most {MOST_RUNS}", keys[0])
    return tuple(axes)


def combinations(axes: Sequence[Axis]) -> Iterator[tuple[int, ...]]:
    """The positions of all runs on the axes; the last axis changes fastest."""
    return itertools.product(*(range(len(axis.values)) for axis in axes))


def _read(text: str) -> tuple[str, list[Any]]:
    """Read the key and the values of `KEY=VALUES`."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not key or not equals:
        raise _refuse(text, "must be KEY=VALUES, where VALUES is a list or a range", key)
    if values.startswith("["):
        return key, _list(text, key, values)
    return key, _range(text, key, values)


def _list(text: str, key: str, values: str) -> list[Any]:
    """Read a list of numbers, texts, truth values, or lists of these."""
    try:
        table = tomllib.loads(f"values = {values}")
        found = table["values"] if len(table) == 1 else None
        json.dumps(found, allow_nan=False)
    except (ValueError, TypeError, RecursionError):
        found = None
    if not isinstance(found, list) or not found or any(isinstance(item, dict) for item in found):
        reason = "the list must hold values as TOML writes them, such as [50, 100] or ['a', 'b']"
        raise _refuse(text, reason, key)
    return found


def _range(text: str, key: str, values: str) -> list[float]:
    """Read a range FIRST:LAST:COUNT or FIRST:LAST:COUNT:log."""
    parts = [part.strip() for part in values.split(":")]
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(parts[2])
    except (ValueError, IndexError):
        first, last, count = math.nan, math.nan, 0
    spacing = parts[3] if len(parts) == 4 else "" if len(parts) == 3 else None
    if not (is_number(first) and math.isfinite(first) and math.isfinite(last)) or not (
        2 <= count <= MOST_RUNS and spacing in ("", "log")
    ):
        reason = "must be a list in brackets, or FIRST:LAST:COUNT or FIRST:LAST:COUNT:log with at "
        raise _refuse(text, reason + "least 2 values", key)
    if first == last:
        raise _refuse(text, "the ends of a range must differ", key)
    if spacing == "log" and not (first > 0.0 and last > 0.0):
        raise _refuse(text, "a range with equal ratios needs ends above 0", key)
    shares = [k / (count - 1) for k in range(count)]
    if spacing == "log":
        spaced = [first * (last / first) ** part for part in shares]
    else:
        spaced = [first + (last - first) * part for part in shares]
    return [float(f"{value:.{DIGITS}g}") for value in spaced]


def _refuse(text: str, reason: str, key: str) -> SceneError:
    """Make the error of an axis."""
    return SceneError(f"sweep: {show(text)}: {reason}", kind=ErrorKind.FORMAT, key=key)
