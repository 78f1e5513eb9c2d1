"""Words of sentences that depend on a number, and records in a few words."""

import html
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

MOST_ROWS = 9  # of a record in words, below its name
WIDTH = 74  # most characters of a value in words
FEW = 6  # most numbers of an array that is written out
T = TypeVar("T")


def counted(number: int, noun: str, plural: str = "") -> str:
    """Write a number and a noun; by default the plural of the noun has an s."""
    return f"{number} {noun if number == 1 else plural or f'{noun}s'}"


def are(number: int) -> str:
    """The verb of a sentence whose subject is a number of things."""
    return "is" if number == 1 else "are"


def enumerated(texts: Sequence[str]) -> str:
    """Join texts by commas, and the last one by "and"."""
    *first, last = texts or [""]
    return f"{', '.join(first)} and {last}" if first else last


def two_digits(number: float) -> str:
    """Write a positive number with two digits, or as a whole number: 0.031, 4.7, 104."""
    return f"{number:.2g}" if number < 99.5 else f"{number:.0f}"


def brief(*shown: str) -> Callable[[type[T]], type[T]]:
    """Give a record a `repr` of at most ten lines, and a table for notebooks.

    Args:
        shown: the attributes to show; by default the fields. Those that are None are left out.
    """

    def decorate(record: type[T]) -> type[T]:
        def rows(self: Any) -> list[tuple[str, str]]:
            names = shown or [field.name for field in fields(self)]
            values = {name: getattr(self, name) for name in names}
            words = {name: value_in_words(v) for name, v in values.items() if v is not None}
            found = [(name, value) for name, value in words.items() if value]
            if len(found) > MOST_ROWS:
                rest = ", ".join(name for name, _ in found[MOST_ROWS - 1 :])
                found = [*found[: MOST_ROWS - 1], ("...", _cut(rest))]
            return found

        def text(self: Any) -> str:
            lines = [f"  {name + ':':20} {value}" for name, value in rows(self)]
            return "\n".join([type(self).__name__, *lines])

        def table(self: Any) -> str:
            cells = (
                f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
                for name, value in rows(self)
            )
            return f"<table><caption>{type(self).__name__}</caption>{''.join(cells)}</table>"

        for name, function in (("__repr__", text), ("_repr_html_", table)):
            setattr(record, name, function)
        return record

    return decorate


def value_in_words(value: Any) -> str:
    """A value on one line: a short one as it is, of a long one its kind and its beginning."""
    if hasattr(value, "tolist"):  # numpy, which light commands do not import
        few = value.ndim == 1 and value.size <= FEW
        return value_in_words(value.tolist()) if few or not value.ndim else f"array {value.shape}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if hasattr(value, "_repr_html_"):
        name, *rows = repr(value).splitlines()
        return _cut(f"{name} ({' '.join(rows[:1]).strip()})")
    if isinstance(value, Mapping):
        return _listed(f"{key} = {value_in_words(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple) and not hasattr(value, "_fields"):
        first = f"{len(value)} of " if len(value) > 1 and not _is_short(value[0]) else ""
        return _cut(first + _listed(map(value_in_words, value[: 1 if first else WIDTH])))
    if is_dataclass(value):
        entries = ((field.name, getattr(value, field.name)) for field in fields(value))
        return f"({_listed(f'{k} = {value_in_words(v)}' for k, v in entries if v is not None)})"
    return type(value).__name__ if hasattr(value, "_fields") else _cut(str(value))


def _is_short(value: Any) -> bool:
    """Whether a value is a text, a number or a path."""
    return not (isinstance(value, Mapping | list | tuple) or is_dataclass(value))


def _listed(texts: Iterable[str]) -> str:
    """Texts as a list that is cut."""
    return _cut(", ".join(texts) or "none")


def _cut(text: str) -> str:
    """The beginning of a text, on one line."""
    line = " ".join(text.split())
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 3]}..."
