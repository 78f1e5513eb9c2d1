"""The JSON schema of a scene, for editors that complete and check TOML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any

from fenicsrom.scene.base.tables import OneOf, entries, key_names, keys, plain
from fenicsrom.scene.checks.checks import REGION_KEYS
from fenicsrom.scene.keys.loads import WHOLE_BODY
from fenicsrom.scene.keys.schema import Scene


def json_schema() -> dict[str, Any]:
    """Give the JSON schema (draft 2020-12) of a scene file.

    The schema states every key with its type, range, unit, default and meaning. It also states
    which keys of a load and of [time] exclude each other, and that a place has exactly one key.
    Only `read_scene` checks the other relations between keys. Only `read_scene` distinguishes the
    integer 2 from the number 2.0, because JSON does not.
    """
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "fenicsrom scene",
        **_table(Scene),
    }


def _table(kind: type) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    for name, rule, description, default in keys(kind):
        unit = f" [{rule.unit}]" if rule.unit else ""
        entry = {**_resolved(rule.schema), "description": f"{description}{unit}".strip()}
        if default is not MISSING and default is not None:
            entry["default"] = plain(default)
        properties[name] = entry
    schema: dict[str, Any] = {
        "type": "object",
        "properties": properties,
        "additionalProperties": False,
    }
    required, alternatives = needed(kind)
    if places := _place_alternatives(kind):
        alternatives = [*alternatives, places]
    if required:
        schema["required"] = required
    if alternatives:
        schema["allOf"] = [{"anyOf": options} for options in alternatives]
    return schema


def _place_alternatives(kind: type) -> list[dict[str, Any]]:
    """Give the alternatives of a table with a place: one of its keys, or none."""
    names = key_names(kind)
    keys_of_place = [name for name in REGION_KEYS if name in names]
    if "group" not in keys_of_place:
        return []
    found: list[dict[str, Any]] = []
    for name in keys_of_place:
        others = [{"required": [other]} for other in keys_of_place if other != name]
        found.append({"required": [name], "not": {"anyOf": others}})
    every = [{"required": [name]} for name in keys_of_place]
    for tag in WHOLE_BODY:
        if tag in names:
            found.append({"required": [tag], "not": {"anyOf": every}})
    return found


def needed(kind: type) -> tuple[list[str], list[list[dict[str, Any]]]]:
    """Give the required keys of a table, and the required keys of each alternative."""
    required = [name for name, _, _, default in _own_keys(kind) if default is MISSING]
    alternatives: list[list[dict[str, Any]]] = []
    for entry, _ in entries(kind).values():
        if isinstance(entry, OneOf):
            every = {key: default for other in entry.kinds for key, _, _, default in keys(other)}
            alternatives.append([_alternative(each, every) for each in entry.every])
        elif isinstance(entry, type):
            inner, more = needed(entry)
            required += inner
            alternatives += more
    return required, alternatives


def _alternative(kind: type, every: Mapping[str, Any]) -> dict[str, Any]:
    """Give the keys that one alternative requires and excludes; `every` maps all keys to defaults.

    A number that is zero by default may be given as zero, as in `OneOf.chosen`.
    """
    conditions: dict[str, Any] = {}
    instead = {
        name: key_names(other) for name, (_, other) in entries(kind).items() if other is not None
    }
    required = [name for name, _, _, default in _own_keys(kind) if default is MISSING]
    always = [name for name in required if name not in instead]
    if always:
        conditions["required"] = always
    choices = [
        {"oneOf": [{"required": [option]} for option in (name, *others)]}
        for name, others in instead.items()
    ]
    if choices:
        conditions["allOf"] = choices
    excluded = [
        {"required": [name]}
        | ({"properties": {name: {"not": {"const": 0}}}} if every[name] == 0.0 else {})
        for name in sorted(every.keys() - set(key_names(kind)))
    ]
    if excluded:
        conditions["not"] = {"anyOf": excluded}
    return conditions


def _own_keys(kind: type) -> list[tuple[str, Any, str, Any]]:
    """Give the keys that are fields of a dataclass itself."""
    own = {
        name for name, (entry, _) in entries(kind).items() if not isinstance(entry, OneOf | type)
    }
    return [key for key in keys(kind) if key[0] in own]


def _resolved(schema: Any) -> Any:
    """Give a schema in which the schema of a table replaces each {"kind": dataclass}."""
    if isinstance(schema, Mapping):
        if isinstance(schema.get("kind"), type):
            return _table(schema["kind"])
        return {name: _resolved(entry) for name, entry in schema.items()}
    return [_resolved(entry) for entry in schema] if isinstance(schema, list) else schema
