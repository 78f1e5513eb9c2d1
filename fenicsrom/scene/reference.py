"""The reference of all keys of a scene, as Markdown tables.

`python3 -m fenicsrom.scene.reference demos/keys*.md` replaces the text between the markers in these
pages. A marker names the tables that its page shows.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, is_dataclass
from pathlib import Path
from typing import Any

from fenicsrom.files import atomic_write
from fenicsrom.scene.base.rules import show
from fenicsrom.scene.base.tables import keys, plain, table_kind
from fenicsrom.scene.json_schema import required_keys
from fenicsrom.scene.keys.schema import Scene

PART = re.compile(r"<!-- scene keys: begin (.+?) -->\n.*?<!-- scene keys: end -->", re.DOTALL)
TOP = "scene"  # stands for the top level of a scene file


def reference(names: Sequence[str]) -> str:
    """Give the Markdown tables of the keys in some tables of a scene file, inner tables included.

    Inner tables of one kind, such as the planes of all places, are shown once, under all their
    headings.
    """
    shown: dict[type, list[str]] = {}
    for name, heading, kind in _tables(TOP, "Top level", Scene):
        if name in names:
            shown.setdefault(kind, []).append(heading)
    return "\n\n".join(
        "\n".join(_section(", ".join(headings), kind)) for kind, headings in shown.items()
    )


def covered(page: str) -> list[str]:
    """Give the names of the tables whose keys a page shows."""
    return [name for part in PART.finditer(page) for name in part[1].split()]


def replaced(page: str) -> str:
    """Give a page with the current reference between its markers.

    Raises:
        ValueError: a marker is missing, or it names a table that no scene has.
    """
    known = [name for name, *_ in _tables(TOP, "", Scene)]
    names = covered(page)
    if not names or not {*names} <= {*known}:
        raise ValueError(
            "the page must contain the lines <!-- scene keys: begin TABLES --> and "
            f"<!-- scene keys: end -->, where TABLES are some of: {' '.join(dict.fromkeys(known))}"
        )

    def current(part: re.Match[str]) -> str:
        begin, end = part[0].split("\n")[0], part[0].split("\n")[-1]
        return f"{begin}\n\n{reference(part[1].split())}\n\n{end}"

    return PART.sub(current, page)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the reference into pages."""
    parser = argparse.ArgumentParser(prog="python3 -m fenicsrom.scene.reference")
    parser.add_argument("pages", metavar="PAGE", nargs="+", type=Path, help="page with markers")
    pages: list[Path] = parser.parse_args(arguments).pages
    for page in pages:
        text = replaced(page.read_text(encoding="utf-8"))
        with atomic_write(page) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _tables(name: str, heading: str, kind: type) -> Iterator[tuple[str, str, type]]:
    """Yield a table and the tables in it: name of the outermost table, heading and dataclass."""
    yield name, heading, kind
    path = "" if name == TOP else heading.strip("`[]") + "."
    for key, rule, _, _ in keys(kind):
        if (inner := table_kind(rule)) is not None:
            brackets = "`[[{}]]`" if rule.schema.get("type") == "array" else "`[{}]`"
            yield from _tables(key if name == TOP else name, brackets.format(path + key), inner)


def _section(heading: str, kind: type) -> Iterator[str]:
    yield f"## {heading}"
    yield ""
    yield "| key | allowed | default | unit | meaning |"
    yield "|---|---|---|---|---|"
    required = required_keys(kind)
    for key, rule, meaning, default in keys(kind):
        allowed = rule.allowed.replace("|", r"\|")
        given = "required" if key in required else _default(default)
        yield f"| `{key}` | {allowed} | {given} | {rule.unit} | {meaning} |"


def _default(value: Any) -> str:
    """Give a default as the scene file spells it; a table has its defaults in its own section."""
    if value is MISSING or value is None or value == () or value == {}:
        return "–"
    if is_dataclass(value):
        return "–"
    return f"`{show(plain(value))}`"


if __name__ == "__main__":
    main()
