"""TOML text, of any depth."""

from __future__ import annotations

import re
import tomllib
from typing import Any

DEEPEST = 100  # largest depth of nested tables: Python's TOML parser takes minutes for 100,000

_TEXTS_AND_COMMENTS = re.compile(
    r'"""(?:.|\n)*?"""|' r"'''(?:.|\n)*?'''|" r'"(?:\\.|[^"\\\n])*"|' r"'[^'\n]*'|" r"#[^\n]*"
)


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        ValueError: the text is not TOML, or its tables are nested more deeply than `DEEPEST`.
    """
    bare = _TEXTS_AND_COMMENTS.sub("", text)
    if any(piece.count(".") > DEEPEST for piece in re.split(r"[\n=,{]", bare)):
        raise ValueError("nested too deeply")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
