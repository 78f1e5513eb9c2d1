"""Rules for the values of single keys: type, range and unit.

A rule takes a value of the file and the place of this value. It returns the value of the field, or
raises `SceneError`. A rule also describes itself as a JSON schema and in words.
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.words import counted

MOST_ROWS = 1_000_000  # largest number of rows of the table of a load
# Sizes of numbers in SI units: products of a few of them stay within the range of a float. Numbers
# that must be above 0 must be at least `SMALLEST`.
SMALLEST, LARGEST = 1e-30, 1e30


@dataclass(frozen=True)
class Where:
    """A place in a scene, for messages.

    Attributes:
        source: the file.
        key: the dotted key.
    """

    source: str
    key: str = ""

    def at(self, name: object) -> Where:
        """Give the place of an entry below this one: of a list (integer) or of a table (name)."""
        if isinstance(name, int):
            return replace(self, key=f"{self.key}[{name}]")
        return replace(self, key=f"{self.key}.{name}" if self.key else str(name))

    def refuse(self, value: object, allowed: str, kind: ErrorKind = ErrorKind.RANGE) -> SceneError:
        """Make the error that refuses a value here; the value `MISSING` has its own kind."""
        missing = value is MISSING
        what = "is missing" if missing else f"= {show(value)}"
        kind = ErrorKind.MISSING if missing else kind
        sentence = f"{self.source}: {self.key} {what}: {allowed}"
        return SceneError(sentence, kind=kind, key=self.key, source=self.source)


class Problem(NamedTuple):
    """A key that does not agree with the others.

    Attributes:
        key: the dotted key.
        allowed: what is allowed, in words.
        kind: the kind of the error; a missing value has its own kind.
        value: what the error shows, or `MISSING`; None for the value of the key.
    """

    key: str
    allowed: str
    kind: ErrorKind = ErrorKind.CONFLICT
    value: object = None


Problems = Iterator[Problem]


def show(value: object, width: int = 60) -> str:
    """Give a value as the scene file spells it, shortened to `width` characters."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except (ValueError, TypeError):  # huge integers, keys of other kinds
        text = f"({type(value).__name__})"
    return text if len(text) <= width else text[: width - 1] + "…"


@dataclass(frozen=True)
class Rule:
    """The rule of a key.

    Attributes:
        read: turns the value of the file into the value of the field, or raises `SceneError`.
        schema: the same rule as a JSON schema, as far as JSON schema can state it.
        allowed: the allowed values in words, for the reference of keys.
        unit: unit of the value, or "".
    """

    read: Callable[[Any, Where], Any]
    schema: Mapping[str, Any]
    allowed: str
    unit: str = ""

    def __call__(self, value: Any, where: Where) -> Any:
        """Read a value."""
        return self.read(value, where)


def is_number(value: object) -> bool:
    """Tell whether a value is a finite number that a float can hold, and not true or false."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def is_quantity(value: object) -> bool:
    """Tell whether a value is a number of a size that a computation can use."""
    return is_number(value) and abs(value) <= LARGEST  # type: ignore[arg-type]


def is_sequence(value: object) -> TypeGuard[Sequence[Any]]:
    """Tell whether a value is a list."""
    return isinstance(value, list | tuple)


def array(items: Mapping[str, Any], least: int = 0, most: int | None = None) -> dict[str, Any]:
    """Make the JSON schema of a list of `least` to `most` values."""
    longest = {} if most is None else {"maxItems": most}
    return {"type": "array", "items": items, "minItems": least, **longest}


def _unquoted(value: object) -> str:
    """Say that a number must not be a text."""
    return ", without quotes" if isinstance(value, str) else ""


def number(
    *,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    unit: str = "",
) -> Rule:
    """Make the rule of a finite number in a range; `above` and `below` exclude the bound."""
    names = (
        ("above", ">", "exclusiveMinimum", above),
        ("of at least", "≥", "minimum", least),
        ("below", "<", "exclusiveMaximum", below),
        ("of at most", "≤", "maximum", most),
    )
    bounds = [bound for bound in names if math.isfinite(bound[3])]
    limits = " and ".join(f"{word} {value:g}" for word, _, _, value in bounds)
    short = " and ".join(f"{sign} {value:g}" for _, sign, _, value in bounds)
    allowed = f"must be a finite number {limits}".rstrip()

    def read(value: Any, where: Where) -> float:
        if not isinstance(value, int | float) or isinstance(value, bool):
            raise where.refuse(value, f"{allowed}{_unquoted(value)}", ErrorKind.TYPE)
        if not (is_number(value) and above < value < below and least <= value <= most):
            raise where.refuse(value, allowed)
        if not is_quantity(value):
            raise where.refuse(value, f"{allowed}, of a size of at most {LARGEST:g}")
        if above == 0.0 and value < SMALLEST:
            raise where.refuse(value, f"{allowed}, of at least {SMALLEST:g}")
        return float(value)

    schema = {"type": "number"} | {name: value for _, _, name, value in bounds}
    return Rule(read, schema, f"number {short}".rstrip(), unit)


def integer(least: int, most: int, unit: str = "") -> Rule:
    """Make the rule of an integer in a range, bounds included."""
    allowed = f"must be an integer from {least} to {most}"

    def read(value: Any, where: Where) -> int:
        if not isinstance(value, int) or isinstance(value, bool):
            raise where.refuse(value, f"{allowed}{_unquoted(value)}", ErrorKind.TYPE)
        if not least <= value <= most:
            raise where.refuse(value, allowed)
        return int(value)

    schema = {"type": "integer", "minimum": least, "maximum": most}
    return Rule(read, schema, f"integer from {least} to {most}", unit)


def choice(*options: str | int) -> Rule:
    """Make the rule of a value that is one of the options."""
    words = " or ".join(show(option) for option in options)

    def read(value: Any, where: Where) -> Any:
        for option in options:
            if type(value) is type(option) and value == option:
                return option
        kinds = {type(option) for option in options}
        kind = ErrorKind.RANGE if type(value) in kinds else ErrorKind.TYPE
        raise where.refuse(value, f"must be {words}", kind)

    return Rule(read, {"enum": list(options)}, words)


def _plain(
    kind: type,
    words: str,
    schema: Mapping[str, Any],
    allowed: str = "",
    accepts: Callable[[Any], Any] = lambda value: True,
) -> Rule:
    """Make the rule of a value of a type that stays as it is, described in `words`."""

    def read(value: Any, where: Where) -> Any:
        if not isinstance(value, kind):
            raise where.refuse(value, f"must be {words}", ErrorKind.TYPE)
        if not accepts(value):
            raise where.refuse(value, f"must be {words}")
        return value

    return Rule(read, schema, allowed or words)


def text_like(pattern: str, words: str, allowed: str = "") -> Rule:
    """Make the rule of a text that matches a pattern."""
    schema = {"type": "string", "pattern": pattern}
    return _plain(str, words, schema, allowed, lambda value: re.fullmatch(pattern, value))


NAME_SCHEMA = {"type": "string", "pattern": r"\S"}
flag = _plain(bool, "true or false", {"type": "boolean"})
text = _plain(str, "a text in quotes", {"type": "string"}, "text")
name = _plain(str, "a name in quotes", NAME_SCHEMA, "name", str.strip)
mesh_change = text_like(
    r"^geometry\.[^=]+=.*$", 'KEY=VALUE with a key of [geometry], such as "geometry.degree=1"'
)

path = Rule(lambda value, where: Path(name(value, where)), NAME_SCHEMA, "path of a file")


def _read_vector(value: Any, where: Where) -> tuple[float, ...]:
    if not is_sequence(value) or len(value) not in (2, 3) or not all(map(is_number, value)):
        allowed = "must be a list of finite numbers, one for each dimension"
        raise where.refuse(value, allowed, ErrorKind.TYPE)
    return tuple(float(component) for component in value)


def _read_point(value: Any, where: Where) -> tuple[float, ...]:
    point = _read_vector(value, where)
    if not all(map(is_quantity, point)):
        raise where.refuse(value, f"numbers must have a size of at most {LARGEST:g}")
    return point


POINT_SCHEMA = array({"type": "number"}, 2, 3)
point = Rule(_read_point, POINT_SCHEMA, "point", "m")


def _read_box(value: Any, where: Where) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Give the lowest and the highest corner of a box, from any two opposite ones."""
    if not is_sequence(value) or len(value) != 2:
        allowed = "must be two opposite corners, [[x, y, z], [x, y, z]]"
        raise where.refuse(value, allowed, ErrorKind.TYPE)
    one, other = (_read_point(corner, where.at(index)) for index, corner in enumerate(value))
    if len(one) != len(other):
        raise where.refuse(value, "both corners must have the same number of coordinates")
    return tuple(map(min, one, other)), tuple(map(max, one, other))


box = Rule(_read_box, array(POINT_SCHEMA, 2, 2), "two opposite corners", "m")


def _read_direction(value: Any, where: Where) -> tuple[float, ...]:
    """Give a vector scaled to unit length; a unit vector stays the same bit for bit."""
    vector = _read_vector(value, where)
    largest = max(map(abs, vector))
    if largest == 0.0:
        raise where.refuse(value, "must have a length above zero")
    if abs(math.hypot(*vector) - 1.0) <= 1e-14:
        return vector
    scaled = [component / largest for component in vector]
    return tuple(component / math.hypot(*scaled) for component in scaled)


direction = Rule(_read_direction, POINT_SCHEMA, "vector")


PARAMETER = r"[A-Za-z_][A-Za-z_0-9]*"


def _read_parameters(value: Any, where: Where) -> dict[str, float]:
    """Give a table of numbers, whose names become variables of the .geo file."""
    if not isinstance(value, Mapping):
        raise where.refuse(value, "must be a table of numbers", ErrorKind.TYPE)
    for key, entry in value.items():
        if not re.fullmatch(PARAMETER, str(key)):
            allowed = "the name of a parameter must consist of letters, digits and underscores"
            raise where.at(key).refuse(entry, allowed)
    return {str(key): number()(entry, where.at(key)) for key, entry in value.items()}


parameters = Rule(
    _read_parameters,
    {
        "type": "object",
        "patternProperties": {f"^{PARAMETER}$": {"type": "number"}},
        "additionalProperties": False,
    },
    "table of numbers",
)


def _rows(
    value: Any, where: Where, names: Sequence[str], place: Callable[[int], Where] | None = None
) -> list[tuple[float, ...]]:
    """Read a list of rows of numbers with these names; `place` says where a row stands."""
    row_of = f"[{', '.join(names)}], finite numbers"
    if not is_sequence(value):
        raise where.refuse(value, f"must be a list of rows {row_of}", ErrorKind.TYPE)
    for index, row in enumerate(value):
        if not is_sequence(row) or len(row) != len(names) or not all(map(is_quantity, row)):
            raise (place or where.at)(index).refuse(row, f"must be {row_of}", ErrorKind.TYPE)
    return [tuple(map(float, row)) for row in value]


def _read_harmonics(value: Any, where: Where) -> tuple[tuple[int, float, float], ...]:
    rows = _rows(value, where, ("order", "amplitude", "phase"))
    if not rows:
        raise where.refuse(value, "must have at least one harmonic", ErrorKind.TYPE)
    orders = [integer(1, 1000)(row[0], where.at(k).at(0)) for k, row in enumerate(value)]
    for k, order in enumerate(orders):
        if order in orders[:k]:
            raise where.at(k).at(0).refuse(order, "must occur only once in the list")
    return tuple((n, *row[1:]) for n, row in zip(orders, rows, strict=True))


_HARMONIC = {"prefixItems": [integer(1, 1000).schema], **array({"type": "number"}, 3, 3)}
_HARMONICS = "list of [order, amplitude, phase], each order once"
harmonics = Rule(_read_harmonics, array(_HARMONIC, least=1), _HARMONICS, "–, –, rad")


def _read_series(value: Any, where: Where) -> Path | tuple[tuple[float, float], ...]:
    """Give a function of time: the path of a file that is read later, or its rows."""
    if isinstance(value, str):
        return Path(name(value, where))
    if not is_sequence(value):
        allowed = "must be the name of a file, or rows [time, factor]"
        raise where.refuse(value, allowed, ErrorKind.TYPE)
    return read_rows(value, where, where.at)


def read_rows(
    rows: Sequence[Any], where: Where, place: Callable[[int], Where]
) -> tuple[tuple[float, float], ...]:
    """Check the rows of a function of time; `place` gives the place of a row for messages."""
    if not 2 <= len(rows) <= MOST_ROWS:
        raise where.refuse(len(rows), f"the number of rows must be from 2 to {MOST_ROWS}")
    found = [(time, factor) for time, factor in _rows(rows, where, ("time", "factor"), place)]
    for index in range(1, len(found)):
        if not found[index][0] > found[index - 1][0]:
            before = f"{found[index - 1][0]:g}"
            allowed = f"times must increase from row to row, the previous one is {before}"
            raise place(index).refuse(found[index][0], allowed)
    return tuple(found)


series = Rule(
    _read_series,
    {"oneOf": [NAME_SCHEMA, array(array({"type": "number"}, 2, 2), 2, MOST_ROWS)]},
    "rows [time, factor] with increasing times, or the path of a text file with two columns",
    "s, –",
)


def either(one: Rule, other: Rule) -> Rule:
    """Make the rule of a value that one of two rules allows."""
    allowed = f"{one.allowed} or {other.allowed}"

    def read(value: Any, where: Where) -> Any:
        kinds = []
        for rule in (one, other):
            try:
                return rule(value, where)
            except SceneError as error:
                if error.key != where.key:  # an entry of a list
                    raise
                kinds.append(error.kind)
        kind = ErrorKind.RANGE if ErrorKind.RANGE in kinds else ErrorKind.TYPE
        hint = _unquoted(value) if isinstance(value, str) and value.isdecimal() else ""
        raise where.refuse(value, f"allowed: {allowed}{hint}", kind)

    return Rule(read, {"oneOf": [one.schema, other.schema]}, allowed, one.unit)


LABEL = r"^([1-9][0-9]{0,5})([VS])([1-9][0-9]{0,5})([VS])$"
_TWO_MODES = 'two modes such as "1V1V" or "1V2S"'
_label_as_given = text_like(
    LABEL, f"{_TWO_MODES}: a number from 1, then V (normal) or S (static)", _TWO_MODES
)


def _read_label(value: Any, where: Where) -> str:
    """Give the label of a modal derivative in one spelling: V before S, lower numbers first.

    The label 1S2V becomes 2V1S.
    """
    first, second = re.findall(r"([0-9]+)([VS])", _label_as_given(value, where))
    pair = sorted((first, second), key=lambda mode: ("VS".index(mode[1]), int(mode[0])))
    return "".join(count + kind for count, kind in pair)


BY_MOTION = ("principal", "mmi", "mmi-nls")
"""Selections of derivatives that need the motion of the linear structure."""

SELECTIONS = ("none", "all", *BY_MOTION)


def list_of(rule: Rule, least: int = 1, most: int | None = None, distinct: bool = True) -> Rule:
    """Make the rule of a list of `least` to `most` values, which differ if `distinct`."""
    count = f"at least {counted(least, 'value')}" if least else "values"
    allowed = f"list of {rule.allowed}"
    if most is not None:
        count = f"{least} values" if least == most else f"{least} to {most} values"
        allowed = f"list of {count}, each {rule.allowed}"

    def read(value: Any, where: Where) -> tuple[Any, ...]:
        if not is_sequence(value) or not least <= len(value) <= (most or len(value)):
            kind = ErrorKind.RANGE if most and is_sequence(value) else ErrorKind.TYPE
            raise where.refuse(value, f"must be a list of {count}", kind)
        values = tuple(rule(entry, where.at(index)) for index, entry in enumerate(value))
        for index, entry in enumerate(values if distinct else ()):
            if entry in values[:index]:
                raise where.at(index).refuse(value[index], "must occur only once in the list")
        return values

    schema = array(rule.schema, least, most) | ({"uniqueItems": True} if distinct else {})
    return Rule(read, schema, allowed, rule.unit)


masters = either(choice("all", "normal", "motion"), integer(1, 1000))
modes = either(choice("auto"), integer(0, 1000))
_label = replace(_label_as_given, read=_read_label)
derivatives = either(choice(*SELECTIONS), list_of(_label, least=0))


def rows_of(*names: str, unit: str, first: Mapping[str, Any] | None = None) -> Rule:
    """Make the rule of a list of rows of numbers; `first` is the schema of column 0.

    Only the schema states the range of the first column; `fenicsrom.scene.checks` checks it.
    """
    row = {} if first is None else {"prefixItems": [first]}
    row |= array({"type": "number"}, len(names), len(names))
    return Rule(
        lambda value, where: tuple(_rows(value, where, names)),
        array(row),
        f"list of [{', '.join(names)}]",
        unit,
    )


def order_problems(key: str, instants: list[float]) -> Problems:
    """Yield instants that do not increase."""
    if any(later <= sooner for sooner, later in pairwise(instants)):
        yield Problem(key, "times must increase", ErrorKind.RANGE, value=instants)
