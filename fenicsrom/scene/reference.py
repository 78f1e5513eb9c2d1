"""The reference of all keys of a scene, as Markdown tables.

`python3 -m fenicsrom.scene.reference --write demos/README.md` replaces the text between the two
markers in that file.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, is_dataclass
from pathlib import Path
from typing import Any

from fenicsrom.files import atomic_write
from fenicsrom.scene.json_schema import needed
from fenicsrom.scene.rules import show
from fenicsrom.scene.schema import Scene
from fenicsrom.scene.tables import keys, plain, table_kind

BEGIN = "<!-- scene keys: begin -->"
END = "<!-- scene keys: end -->"


def reference() -> str:
    """Give the Markdown tables of all keys, one for each table of a scene file."""
    return "\n\n".join("\n".join(_section(*table)) for table in _tables("", Scene))


def replaced(page: str) -> str:
    """Give a page with the current reference between its markers.

    Raises:
        ValueError: a marker is missing.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page must contain the lines {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{reference()}\n\n{END}{after}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the reference, or write it into a page."""
    parser = argparse.ArgumentParser(prog="python3 -m fenicsrom.scene.reference")
    parser.add_argument("--write", metavar="PAGE", type=Path, help="page with the two markers")
    page: Path | None = parser.parse_args(arguments).write
    if page is None:
        print(reference())
    else:
        text = replaced(page.read_text(encoding="utf-8"))
        with atomic_write(page) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _tables(name: str, kind: type) -> Iterator[tuple[str, type]]:
    """Yield a table with the heading of its section, then the tables in it."""
    yield name, kind
    for key, rule, _, _ in keys(kind):
        if (inner := table_kind(rule)) is not None:
            brackets = "[[{}]]" if rule.schema.get("type") == "array" else "[{}]"
            path = f"{name.strip('[]')}.{key}".strip(".")
            yield from _tables(brackets.format(path), inner)


def _section(name: str, kind: type) -> Iterator[str]:
    yield f"### `{name}`" if name else "### Top level"
    yield ""
    yield "| key | allowed | default | unit | meaning |"
    yield "|---|---|---|---|---|"
    required = needed(kind)[0]
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
