"""Tables of a scene as dataclasses, which this module reads, writes as TOML, and describes.

A field is a key if its type is `Annotated` with

* a `Rule`: the key has the name of the field;
* a dataclass: the keys of that dataclass belong to the same table (a place in a load);
* `OneOf`: one of several dataclasses, chosen by the keys that are given, in the same table.

A second entry of the annotation, a dataclass, holds keys that may replace this key.
A field without a default is required.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.scene.base.rules import Problems, Rule, Where, array, is_number, is_sequence

T = TypeVar("T")


class OneOf:
    """Several dataclasses, of which a table describes one; the first key that is a tag chooses.

    Attributes:
        tags: for each key that chooses a dataclass, this dataclass; earlier keys come first.
        otherwise: the dataclass if none of these keys is given; None if one key is required.
    """

    def __init__(self, otherwise: type | None = None, **tags: type):
        """Store the alternatives."""
        self.tags, self.otherwise = tags, otherwise

    @classmethod
    def by_keys(cls, otherwise: type, *kinds: type) -> OneOf:
        """Alternatives each of which any of its keys chooses."""
        return cls(otherwise, **{key: kind for kind in kinds for key in key_names(kind)})

    @property
    def kinds(self) -> list[type]:
        """The alternatives, each once."""
        return list(dict.fromkeys(self.tags.values()))

    @property
    def every(self) -> list[type]:
        """The alternatives, with the one that no key chooses."""
        return [*self.kinds, *([self.otherwise] if self.otherwise else [])]

    def chosen(self, table: Mapping[str, Any], where: Where) -> type:
        """Give the alternative that a table describes.

        Raises:
            SceneError: no key selects an alternative, or a key belongs only to another alternative.
        """
        tag = next((tag for tag in self.tags if tag in table), None)
        kind = self.otherwise if tag is None else self.tags[tag]
        if kind is None:
            first, *others = self.tags
            choices = f"one of {', '.join([first, *others[:-1]])} and {others[-1]}"
            raise where.at(first).refuse(MISSING, f"{choices} must be given")
        allowed = key_names(kind)  # a default of zero changes nothing: old files have phase = 0
        for other in self.kinds:
            for key, _, _, default in keys(other):
                if key in table and key not in allowed and not _is_zero(table[key], default):
                    listed = f"; allowed here: {', '.join(allowed)}" if allowed else ""
                    other_key = f"with {tag}" if tag else f"without {' or '.join(self.tags)}"
                    sentence = f"not allowed {other_key}{listed}"
                    raise where.at(key).refuse(table[key], sentence, ErrorKind.CONFLICT)
        return kind


def _is_zero(value: Any, default: Any) -> bool:
    """Whether a value is the number zero, and the default of its key."""
    return is_number(value) and value == default == 0.0


@functools.cache
def entries(kind: Any) -> dict[str, tuple[Any, type | None]]:
    """For each field that is a key, give its annotation and the keys that may replace it."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        name: (hint.__metadata__[0], (*hint.__metadata__[1:], None)[0])
        for name, hint in hints.items()
        if hasattr(hint, "__metadata__")
    }


@functools.cache
def descriptions(kind: Any) -> dict[str, str]:
    """Give the description of each field: the section Attributes of the docstring."""
    text = inspect.getdoc(kind) or ""
    section = text.partition("Attributes:\n")[2]
    found: dict[str, str] = {}
    for line in section.splitlines():
        if match := re.match(r"    (\w+): (.*)", line):
            last = match[1]
            found[last] = match[2]
        elif line.strip():
            found[last] += " " + line.strip()
    for base in kind.__mro__[1:-1]:
        found = descriptions(base) | found
    return found


def keys(kind: type) -> Iterator[tuple[str, Rule, str, Any]]:
    """Give name, rule, description and default (or `MISSING`) of each key of a table."""
    defaults = {item.name: item for item in fields(kind)}
    for name, (entry, instead) in entries(kind).items():
        if isinstance(entry, OneOf):
            seen: dict[str, tuple[str, Rule, str, Any]] = {}
            for each in entry.every:
                for key in keys(each):
                    seen.setdefault(key[0], key)
            yield from seen.values()
        elif isinstance(entry, type):
            yield from keys(entry)
        else:
            item = defaults[name]
            default = item.default
            if item.default_factory is not MISSING:
                default = item.default_factory()
            yield name, entry, descriptions(kind).get(name, ""), default
            if instead is not None:
                yield from keys(instead)


@functools.cache
def key_names(kind: Any) -> list[str]:
    """Give the names of the keys of a table."""
    return [name for name, *_ in keys(kind)]


def build(kind: type[T], table: Mapping[str, Any], where: Where) -> T:
    """Make the dataclass that a table describes; keys of other dataclasses in it are ignored.

    Raises:
        SceneError: a required key is missing, or a value is not allowed.
    """
    values: dict[str, Any] = {}
    any_kind: Any = kind
    items = fields(any_kind)
    required = {item.name for item in items if item.default is item.default_factory is MISSING}
    for name, (entry, _) in entries(any_kind).items():
        if isinstance(entry, OneOf):
            values[name] = build(entry.chosen(table, where), table, where)
        elif isinstance(entry, type):
            values[name] = build(entry, table, where)
        elif name in table or name in required:
            values[name] = entry(table.get(name, MISSING), where.at(name))
    return kind(**values)


def read_table(kind: type[T], value: Any, where: Where) -> T:
    """Make the dataclass that a table describes.

    Raises:
        SceneError: the value is not a table, a key is unknown or missing, or a value is not
            allowed.
    """
    if not isinstance(value, Mapping):
        raise where.refuse(value, "must be a table", ErrorKind.TYPE)
    any_kind: Any = kind
    known = key_names(any_kind)
    for name, entry in value.items():
        if name not in known:
            near = difflib.get_close_matches(str(name)[:100], known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"allowed here: {', '.join(known)}"
            raise where.at(name).refuse(entry, f"unknown key; {hint}", ErrorKind.UNKNOWN_KEY)
    return build(kind, value, where)


def table_kind(rule: Rule) -> type | None:
    """Give the dataclass of a rule of tables; None for other rules."""
    schemas = [rule.schema, rule.schema.get("items", {}), *rule.schema.get("oneOf", [])]
    found = (schema.get("kind") for schema in schemas)
    return next((kind for kind in found if isinstance(kind, type) and is_dataclass(kind)), None)


def table_of(kind: type) -> Rule:
    """Make the rule of a table."""
    return Rule(lambda value, where: read_table(kind, value, where), {"kind": kind}, "table")


def tables_of(kind: type, least: int = 0) -> Rule:
    """Make the rule of a list of tables."""

    def read(value: Any, where: Where) -> tuple[Any, ...]:
        if not is_sequence(value) or len(value) < least:
            count = "at least one table" if least else "tables"
            allowed = f"must be a list of {count}, each headed [[{where.key}]]"
            raise where.refuse(value, allowed, ErrorKind.TYPE)
        return tuple(read_table(kind, entry, where.at(index)) for index, entry in enumerate(value))

    return Rule(read, array({"kind": kind}, least), "list of tables")


def plain(value: Any) -> Any:
    """Turn the values that rules made, and numbers and arrays of numpy, into plain data.

    A field of a dataclass that is None is left out.
    """
    if hasattr(value, "tolist"):  # without an import of numpy, which light commands do not need
        return value.tolist()
    if is_dataclass(value) and not isinstance(value, type):
        table: dict[str, Any] = {}
        for name, (rule, _) in entries(type(value)).items():
            entry = getattr(value, name)
            if not isinstance(rule, Rule):
                table |= plain(entry)
            elif entry is not None:
                table[name] = plain(entry)
        return table
    if is_sequence(value):
        return [plain(entry) for entry in value]
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    return value.as_posix() if isinstance(value, Path) else value


def value_at(table: Any, key: str) -> Any:
    """The value of a key such as loads.0.force in plain data; None if there is none."""
    for name in re.findall(r"[^.\[\]]+", key):
        if isinstance(table, Mapping):
            table = table.get(name)
        elif isinstance(table, list) and name.isdecimal() and int(name) < len(table):
            table = table[int(name)]
        else:
            return None
    return table


def require_none(problems: Problems, table: Any, where: Where) -> None:
    """Raise the error of the first problem of a table, whose place is given.

    The error shows the value of the key, unless it is a table or a list of tables.
    """
    for key, allowed, kind, value in problems:
        value = value_at(plain(table), key) if value is None else value
        if any(isinstance(each, Mapping) for each in (value if is_sequence(value) else [value])):
            raise refuse(where.source, allowed, kind, where.at(key).key)
        raise where.at(key).refuse(MISSING if value is None else value, allowed, kind)


def from_keys(kind: type[T], given: Mapping[str, Any]) -> T:
    """Make a dataclass from its keys, as in a scene file; keys that are None are left out."""
    table = {name: plain(value) for name, value in given.items() if value is not None}
    return read_table(kind, table, Where(kind.__name__))


def without_alternatives(kind: type, table: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Give a table of this kind without the keys that the key `name` excludes."""
    for entry, _ in entries(kind).values():
        for each in entry.kinds if isinstance(entry, OneOf) else ():
            for key, (_, instead) in entries(each).items():
                same = {key, *key_names(instead)} if instead else {key}
                if name in same:  # keys that replace one another
                    table = {given: v for given, v in table.items() if given not in same - {name}}
        if isinstance(entry, OneOf) and name in entry.tags:
            present = next((kind for tag, kind in entry.tags.items() if tag in table), None)
            if present is not None and name in key_names(present):
                continue
            kept = key_names(entry.tags[name])
            excluded = {key for other in entry.kinds for key in key_names(other)} - {*kept}
            return {key: value for key, value in table.items() if key not in excluded}
    return dict(table)


def changed(value: T, changes: Mapping[str, Any]) -> T:
    """Give a dataclass with other values of some keys; excluded alternatives are removed."""
    table: dict[str, Any] = plain(value)
    for name in changes:
        table = without_alternatives(type(value), table, name)
    return from_keys(type(value), {**table, **changes})


BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(table: Mapping[str, Any]) -> str:
    """Write the plain data of a scene as TOML.

    Args:
        table: the data, as `scene_table` gives it: texts, numbers, truth values, lists and tables.

    Returns:
        Text that a TOML parser turns into the same data. Tables within tables stand on one line.
    """
    lines = [f"{_key(name)} = {toml_value(v)}" for name, v in table.items() if not _is_block(v)]
    for name, value in table.items():
        if not _is_block(value):
            continue
        head = f"[{_key(name)}]" if isinstance(value, Mapping) else f"[[{_key(name)}]]"
        for entry in [value] if isinstance(value, Mapping) else value:
            lines += ["", head, *(f"{_key(key)} = {toml_value(v)}" for key, v in entry.items())]
    return "\n".join(lines) + "\n"


def toml_value(value: Any) -> str:
    """Write one value on one line, as TOML does.

    Raises:
        TypeError: TOML has no such value.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        entries = ", ".join(f"{_key(name)} = {toml_value(v)}" for name, v in value.items())
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _is_block(value: Any) -> bool:
    """Whether a value of the top level stands below a heading: a table or a list of tables."""
    if isinstance(value, Mapping):
        return True
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(name: str) -> str:
    """Write a key, in quotes where TOML needs them."""
    return name if BARE_KEY.fullmatch(name) else toml_value(name)
