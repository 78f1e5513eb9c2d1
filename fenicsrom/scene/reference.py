"""The reference of all keys of a scene, as Markdown tables.

`python3 -m fenicsrom.scene.reference demos/keys*.md` replaces the text between the markers in these
pages. A marker names the tables that its page shows.
"""

import argparse
import re
from collections.abc import Iterator, Sequence
from dataclasses import MISSING
from pathlib import Path
from typing import Any, NamedTuple

from fenicsrom.files import atomic_write
from fenicsrom.scene.base.rules import show
from fenicsrom.scene.base.tables import keys, plain, table_kind
from fenicsrom.scene.json_schema import required_keys
from fenicsrom.scene.keys.schema import Scene

PART = re.compile(r"<!-- scene keys: begin (.+?) -->\n.*?<!-- scene keys: end -->", re.DOTALL)
TOP = "scene"  # stands for the top level of a scene file
TABLES = ("table", "list of tables")  # what a key allows that has a section of its own


class _Table(NamedTuple):
    """A table of a scene file: its outermost table, its heading, what it is, and its dataclass."""

    name: str
    heading: str
    meaning: str
    kind: type


def reference(names: Sequence[str], rows: dict[str, str] | None = None) -> str:
    """Give the Markdown tables of the keys in some tables of a scene file, inner tables included.

    Inner tables of one kind, such as the planes of all places, are shown once, under all their
    headings. A key that an earlier table has in the same sense is only named.

    Args:
        names: names of the outermost tables.
        rows: the headings under which rows were shown before, here and on earlier pages.
    """
    rows = {} if rows is None else rows
    shown: dict[type, list[_Table]] = {}
    for table in _tables(_Table(TOP, "Top level", "", Scene)):
        if table.name in names:
            shown.setdefault(table.kind, []).append(table)
    return "\n\n".join("\n".join(_section(tables, rows)) for tables in shown.values())


def covered(page: str) -> list[str]:
    """Give the names of the tables whose keys a page shows."""
    return [name for part in PART.finditer(page) for name in part[1].split()]


def replaced(page: str, rows: dict[str, str]) -> str:
    """Give a page with the current reference between its markers.

    Args:
        page: the text of the page.
        rows: the headings under which rows were shown on earlier pages; the rows of this one join.

    Raises:
        ValueError: a marker is missing, or it names a table that no scene has.
    """
    known = [table.name for table in _tables(_Table(TOP, "", "", Scene))]
    names = covered(page)
    if not names or not {*names} <= {*known}:
        raise ValueError(
            "the page must contain the lines <!-- scene keys: begin TABLES --> and "
            f"<!-- scene keys: end -->, where TABLES are some of: {' '.join(dict.fromkeys(known))}"
        )

    def current(part: re.Match[str]) -> str:
        begin, end = part[0].split("\n")[0], part[0].split("\n")[-1]
        return f"{begin}\n\n{reference(part[1].split(), rows)}\n\n{end}"

    return PART.sub(current, page)


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the reference into pages."""
    parser = argparse.ArgumentParser(prog="python3 -m fenicsrom.scene.reference")
    parser.add_argument("pages", metavar="PAGE", nargs="+", type=Path, help="page with markers")
    pages: list[Path] = parser.parse_args(arguments).pages
    rows: dict[str, str] = {}
    for page in pages:
        text = replaced(page.read_text(encoding="utf-8"), rows)
        with atomic_write(page) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _tables(table: _Table) -> Iterator[_Table]:
    """Yield a table and the tables in it."""
    yield table
    top = table.name == TOP
    path = "" if top else table.heading.strip("`[]") + "."
    required = required_keys(table.kind)
    for key, rule, meaning, _ in keys(table.kind):
        if (inner := table_kind(rule)) is not None and rule.allowed in TABLES:
            brackets = "`[[{}]]`" if rule.schema.get("type") == "array" else "`[{}]`"
            meaning = meaning[:1].upper() + meaning[1:] + " Required." * (key in required)
            name = key if top else table.name
            yield from _tables(_Table(name, brackets.format(path + key), meaning, inner))


def _section(tables: Sequence[_Table], shown: dict[str, str]) -> Iterator[str]:
    """Yield the lines of tables of one kind, and add their rows to those that were `shown`."""
    yield f"## {', '.join(table.heading for table in tables)}"
    kind, heading = tables[0].kind, tables[0].heading
    if tables[0].meaning:
        yield f"\n{tables[0].meaning}"
    required = required_keys(kind)
    rows, again = list[str](), dict[str, list[str]]()
    for key, rule, meaning, default in keys(kind):
        if rule.allowed in TABLES:
            continue  # it has a section
        allowed = rule.allowed.replace("|", r"\|") + (f" ({rule.unit})" if rule.unit else "")
        name = f"`{key}`, required" if key in required else f"`{key}{_default(default)}`"
        row = f"| {name} | {allowed} | {meaning} |"
        if (first := shown.setdefault(row, heading)) == heading:
            rows.append(row)
        else:
            again.setdefault(first, []).append(f"`{key}`")
    if rows:
        yield "\n| key | allowed | meaning |\n|---|---|---|"
        yield from rows
    for first, names in again.items():
        yield f"\n{', '.join(names)}: as in {first}."


def _default(value: Any) -> str:
    """Give a default as the scene file spells it; empty if there is none."""
    if value is MISSING or value is None or value == () or value == {}:
        return ""
    return f" = {show(plain(value))}"


if __name__ == "__main__":
    main()
