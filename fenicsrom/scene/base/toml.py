"""TOML text: parsed, of any depth, and written."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        ValueError: the text is not TOML, or its tables are nested too deeply.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


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
