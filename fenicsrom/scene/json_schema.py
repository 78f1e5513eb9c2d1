"""The JSON schema of a scene, for editors that complete and check TOML."""

from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any

from fenicsrom.scene.base.tables import entries, keys, plain
from fenicsrom.scene.keys.schema import Scene


def json_schema() -> dict[str, Any]:
    """Give the JSON schema (draft 2020-12) of a scene file.

    The schema states every key with its type, range, unit, default and meaning. Only `read_scene`
    checks which keys exclude each other, and distinguishes the integer 2 from the number 2.0.
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
    if required := required_keys(kind):
        schema["required"] = required
    return schema


def required_keys(kind: type) -> list[str]:
    """Give the keys that every table of a kind has; alternatives have more."""
    own = entries(kind)
    found = [name for name, *_, default in keys(kind) if name in own and default is MISSING]
    inner = [entry for entry, _ in own.values() if isinstance(entry, type)]
    return found + [name for each in inner for name in required_keys(each)]


def _resolved(schema: Any) -> Any:
    """Give a schema in which the schema of a table replaces each {"kind": dataclass}."""
    if isinstance(schema, Mapping):
        if isinstance(schema.get("kind"), type):
            return _table(schema["kind"])
        return {name: _resolved(entry) for name, entry in schema.items()}
    return [_resolved(entry) for entry in schema] if isinstance(schema, list) else schema
