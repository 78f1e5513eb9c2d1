"""Titles that follow the values of the scene.

A title may hold keys in braces, such as `{loads.0.frequency}`; the heading shows their values.
If the title does not hold the key of an override, the key is appended to the title in this form.
The heading of a report therefore names every changed value, also after a second change.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import fields
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from fenicsrom.scene.base.tables import plain, value_at
from fenicsrom.scene.base.toml import toml_value
from fenicsrom.scene.reading.overrides import Overrides, names_of, override_texts
from fenicsrom.scene.reading.units import as_given

if TYPE_CHECKING:
    from fenicsrom.scene.keys.schema import Scene

KEY_IN_BRACES = re.compile(r"\{([A-Za-z_][\w.]*)\}")
# changes of these keys do not change the motion of a scene
WITHOUT_EFFECT = ("title", "output", "reference", "response", "backbone")
LONGEST = 40  # longest text of one value in a heading


def titled(table: Mapping[str, Any], overrides: Overrides, source: str) -> dict[str, Any]:
    """Give the table of a scene with a title that holds the keys of some overrides.

    Args:
        table: the plain data of a scene, the overrides included.
        overrides: as `override_table` takes them.
        source: name of the scene file, the title of a scene that has none.
    """
    title = table.get("title", "")
    if not isinstance(title, str):
        return dict(table)
    for override in override_texts(overrides):
        path = names_of(override.partition("=")[0])
        if path[0] not in WITHOUT_EFFECT and f"{{{'.'.join(path)}}}" not in title:
            name = ".".join(path)
            title = f"{title or PurePath(source).stem}, {name} = {{{name}}}"
    return {**table, "title": title} if title else dict(table)


def scene_heading(scene: Scene, varied: Collection[str] = ()) -> str:
    """Give the title of a scene with the values of the keys that stand in braces.

    A part of the title between commas is left out if it names a key that the scene does not have,
    such as the preload of a removed contact, or a key that varies. Braces around anything else
    stay as they are. The heading of a scene without a title is the name of its file.

    Args:
        scene: the scene.
        varied: keys that have several values in the results, as in a sweep.
    """
    hidden = {".".join(names_of(key)) for key in varied}
    table = plain(scene)
    tables = {field.name for field in fields(scene)}

    def is_missing(name: str) -> bool:
        return name in hidden or (name.split(".")[0] in tables and value_at(table, name) is None)

    def shown(match: re.Match[str]) -> str:
        value = as_given(scene, match[1], value_at(table, match[1]))
        return match[0] if value is None else _short(value)

    parts = scene.title.split(", ")
    kept = [part for part in parts if not any(map(is_missing, KEY_IN_BRACES.findall(part)))]
    return KEY_IN_BRACES.sub(shown, ", ".join(kept)) or scene.source


def _short(value: Any) -> str:
    """A value in a heading: numbers without trailing zeros, text without quotes."""
    if isinstance(value, str):
        return value
    text = f"{value:.10g}" if isinstance(value, float) else toml_value(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}.."
