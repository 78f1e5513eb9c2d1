"""The keywords of an Abaqus or CalculiX file, with their parameters and data lines."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from fenicsrom.formats.text import included, read_lines


@dataclass(frozen=True)
class Keyword:
    """A keyword with its data.

    Attributes:
        name: its name in capitals, such as "NODE".
        parameters: parameters by their name in capitals; "" for one without a value.
        lines: the data lines, without comments and empty lines.
    """

    name: str
    parameters: dict[str, str]
    lines: list[str] = field(default_factory=list)


def read_keywords(path: Path, depth: int = 0) -> list[Keyword]:
    """Read the keywords of a file and of the files that it includes.

    Raises:
        SceneError: a file that it includes is not there.
    """
    found: list[Keyword] = []
    lines = _lines(path)[::-1]
    while lines:
        line = lines.pop()
        if not line.startswith("*"):
            if found:
                found[-1].lines.append(line)
            continue
        while line.endswith(",") and lines and lines[-1][0].isalpha():
            line += lines.pop()
        keyword = _keyword(line)
        if keyword.name == "INCLUDE":
            name = keyword.parameters.get("INPUT", "")
            found += read_keywords(included(path, name, "*INCLUDE", depth), depth + 1)
            continue
        found.append(keyword)
        if "INPUT" in keyword.parameters:
            name = keyword.parameters["INPUT"]
            other = included(path, name, f"*{keyword.name}, INPUT =", depth)
            keyword.lines.extend(_lines(other))
    return found


def _lines(path: Path) -> list[str]:
    """The lines of a file without comments and empty lines."""
    return [line for line in map(str.strip, read_lines(path)) if line and line[:2] != "**"]


def _keyword(line: str) -> Keyword:
    """Parse a keyword line."""
    name, *rest = re.findall(r'(?:[^,"]|"[^"]*")+', line[1:]) or [""]
    parameters = {}
    for part in rest:
        key, _, value = part.partition("=")
        if key.strip():
            parameters[key.strip().upper()] = unquoted(value)
    return Keyword(" ".join(name.upper().split()), parameters)


def unquoted(text: str) -> str:
    """A name without the blanks and quotes around it."""
    return text.strip().strip('"')


def fields(line: str) -> list[str]:
    """The fields of a data line without quotes; a comma at the end counts for nothing."""
    found = [unquoted(field) for field in line.split(",")]
    while found and not found[-1]:
        found.pop()
    return found
