"""TOML text: nested tables are refused at once, and dots in texts and comments do not count."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.scene import override_table, read_scene
from fenicsrom.scene.base.toml import parse_toml

MANY = 100_000
DEEP = {
    "dotted key": "a" + ".a" * MANY + " = 1",
    "quoted names": '"a"' + '."\\""' * MANY + " = 1",
    "header": "[a" + ".a" * MANY + "]",
    "inline table": "x = {a" + ".a" * MANY + " = 1}",
    "tables in tables": "a = " + "{a = " * MANY + "1" + "}" * MANY,
    "lists in lists": "a = " + "[" * MANY + "]" * MANY,
}


@pytest.mark.parametrize("text", DEEP.values(), ids=DEEP)
def test_deep_text_is_refused_at_once(tmp_path: Path, text: str) -> None:
    path = tmp_path / "deep.toml"
    path.write_text(text)
    begin = time.monotonic()
    with refusal(ErrorKind.FORMAT, file="deep.toml", names="nested too deeply"):
        read_scene(path)
    assert time.monotonic() - begin < 5.0


def test_deep_override_is_refused_at_once() -> None:
    begin = time.monotonic()
    with refusal(ErrorKind.FORMAT, "title"):
        override_table({}, "title={a" + ".a" * MANY + "=1}", "scene")
    assert time.monotonic() - begin < 5.0


def test_dots_of_texts_and_comments_do_not_count() -> None:
    dots = "." * 200
    text = f'# {dots}\na = "{dots}" # it\'s {dots}\nb = """\n{dots}\n"""\nc = \'{dots}\'\n'
    assert parse_toml(text) == {"a": dots, "b": dots + "\n", "c": dots}
