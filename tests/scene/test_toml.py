"""TOML text: tables that are nested too deeply are refused at once."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.scene import read_scene

MANY = 100_000
DEEP = {
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
