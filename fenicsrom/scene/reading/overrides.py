"""Overrides of single keys of a scene, such as `loads.0.force=200`."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from typing import Any

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene.base.rules import show
from fenicsrom.scene.base.tables import plain, without_alternatives
from fenicsrom.scene.base.toml import parse_toml, toml_value
from fenicsrom.scene.keys.loads import Load
from fenicsrom.scene.keys.times import Time

Overrides = str | Sequence[str] | Mapping[str, Any]
"""Changes of a scene: one or several texts KEY=VALUE, or the new values by their keys."""

DEEPEST = 20  # names in the path of a key
# tables whose keys exclude each other, by the first name and the number of names before the key
ALTERNATIVES: dict[tuple[str, int], type] = {("time", 1): Time, ("loads", 2): Load}


def override_texts(overrides: Overrides) -> list[str]:
    """Write overrides as texts KEY=VALUE, with the values as TOML writes them.

    Raises:
        SceneError: TOML has no such value.
    """
    if not isinstance(overrides, Mapping):
        return [overrides] if isinstance(overrides, str) else list(overrides)
    try:
        return [f"{key}={toml_value(plain(value))}" for key, value in overrides.items()]
    except TypeError as error:
        sentence = f"overrides {show(overrides)}: {error}"
        raise SceneError(sentence, kind=ErrorKind.TYPE) from None


def override_table(table: Mapping[str, Any], overrides: Overrides, source: str) -> dict[str, Any]:
    """Give a copy of the table of a scene with some of its values replaced.

    Missing tables on the path of a key are made; entries of lists must exist. A new key of [time]
    or of a load removes the keys that it excludes: `time.tolerance=1e-4` removes
    `steps_per_period`, and `loads.0.pulse={duration=0.01}` removes `frequency`.

    Args:
        table: the plain data of a scene.
        overrides: one or several texts KEY=VALUE, with the value as TOML writes it, or the new
            values by their keys.
        source: name of the table in messages.

    Returns:
        The new table, not yet checked.

    Raises:
        SceneError: an override has no `=`, its value is not TOML, or its path leads nowhere.
    """
    changed = dict(table)
    for override in override_texts(overrides):
        names, value = parsed_override(override, source)
        branch: Any = changed
        for depth, name in enumerate(names):
            numbered = re.fullmatch(r"[0-9]{1,6}", name)
            if isinstance(branch, list) and numbered and int(name) < len(branch):
                step: Any = int(name)
            elif isinstance(branch, dict):
                step = name
            else:
                reason = f"{'.'.join(names[:depth])} {_no_entry(branch, name)}"
                raise _refuse(override, source, reason)
            if depth == len(names) - 1:
                if (kind := ALTERNATIVES.get((names[0], depth))) and isinstance(branch, dict):
                    kept = without_alternatives(kind, branch, name)
                    branch.clear()
                    branch |= kept
                branch[step] = value
            else:  # copy only the tables on the way to the key
                inner = branch.get(step, {}) if isinstance(branch, dict) else branch[step]
                branch[step] = copy.copy(inner)
                branch = branch[step]
    return changed


def names_of(key: str) -> list[str]:
    """The names on the path of a key; an entry of a list is `loads.0` or `loads[0]`."""
    return [name.strip() for name in key.replace("[", ".").replace("]", "").split(".")]


def parsed_override(override: str, source: str) -> tuple[list[str], Any]:
    """Give the names on the path of an override, and its value.

    Raises:
        SceneError: the override has no `=`, or its value is not TOML.
    """
    path, equals, text = override.partition("=")
    names = names_of(path)
    if not equals or not all(names) or len(names) > DEEPEST:
        raise _refuse(override, source, "must be KEY=VALUE, such as loads.0.force=200")
    try:
        value = parse_toml(f"value = {text}")
    except ValueError:
        value = {}
    if list(value) != ["value"]:
        reason = "the value must be written as in TOML, text in quotes"
        raise _refuse(override, source, reason)
    return names, value["value"]


def _refuse(override: str, source: str, reason: str) -> SceneError:
    sentence = f"{source}: override {show(override)}: {reason}"
    key = override.partition("=")[0].strip()
    return SceneError(sentence, kind=ErrorKind.FORMAT, key=key, source=source)


def _no_entry(branch: Any, name: str) -> str:
    """Say why a table, a list or a value of a scene has no such entry."""
    if not isinstance(branch, list):
        return "is not a table"
    if not branch:
        return f"is empty: it has no entry {name}"
    last = len(branch) - 1
    numbers = f"entries are numbered from 0 to {last}" if last else "the only entry is 0"
    return f"has no entry {name}: {numbers}"
