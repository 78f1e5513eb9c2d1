"""The bulk data of a Nastran file: its entries in small, large and free field format."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from fenicsrom.errors import refuse
from fenicsrom.formats.collector import included, read_lines


@dataclass(frozen=True)
class Card:
    """An entry of the bulk data.

    Attributes:
        name: its name in capitals, without an asterisk.
        fields: its data fields; field 2 of the entry is number 0. Fields are 8 to a line (4 to a
            line in large field format), with "" for blank ones.
    """

    name: str
    fields: list[str] = field(default_factory=list)

    def text(self, index: int) -> str:
        """A field, or "" behind the last one."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, index: int, default: int = 0) -> int:
        """A field as an integer, or a default if it is blank."""
        text = self.text(index)
        return int(text) if text else default

    def real(self, index: int, default: float = 0.0) -> float:
        """A field as a real number, which may lack the E: 1.5-3 is 0.0015."""
        text = re.sub("[dD]", "E", self.text(index))
        return float(re.sub(r"(?<=[0-9.])([+-])", r"E\1", text)) if text else default


def read_cards(path: Path, whole: bool = True) -> list[Card]:
    """Read the entries of the bulk data of a file and of the files that it includes.

    Args:
        path: the file.
        whole: whether the file must end with ENDDATA; a file of matrices need not.

    Raises:
        SceneError: the file does not end with ENDDATA, a continuation belongs to no entry, or an
            included file is not there.
    """
    lines = _bulk_lines(path, 0)
    if whole and not any(re.match(r"ENDDATA", line.strip(), flags=re.I) for line in lines):
        raise refuse(path, "the file does not end with ENDDATA; it may be truncated")
    cards: list[Card] = []
    mark = ""
    for line in lines:
        if re.match(r"ENDDATA", line.strip(), flags=re.I):
            break
        name, data, own, following = _split(path, line)
        if own is not None:
            if not cards or (own and mark and own != mark):
                reason = "the line continues no entry above it; continuations must follow in order"
                raise refuse(path, f"{line.strip()!r}: {reason}")
            cards[-1].fields.extend(data)
        else:
            cards.append(Card(name, data))
        mark = following
    return cards


def _bulk_lines(path: Path, depth: int) -> list[str]:
    """The lines of the bulk data, without comments and empty lines, included files in place."""
    found: list[str] = []
    lines = [line.partition("$")[0].rstrip().expandtabs(8) for line in read_lines(path)]
    begin = [k for k, line in enumerate(lines) if re.match(r"\s*BEGIN +(BULK|SUPER)", line, re.I)]
    start = begin[0] + 1 if begin else 0
    if len(begin) > 1:
        raise refuse(path, f"{lines[begin[1]].strip()!r}: superelements are not supported")
    index = 0
    while index < len(lines):
        line = lines[index]
        match = re.match(r"\s*INCLUDE\b\s*(.*)", line, flags=re.I)
        if match and index >= start:
            name = match[1]
            while name.count("'") == 1 and index + 1 < len(lines):  # a name on several lines
                index += 1
                name += lines[index].strip()
            found += _bulk_lines(included(path, name, "INCLUDE", depth), depth + 1)
        elif index >= start and line.strip():
            found.append(line)
        index += 1
    return found


def _split(path: Path, line: str) -> tuple[str, list[str], str | None, str]:
    """Split a line of bulk data.

    Returns:
        The name of the entry; its data fields; the mark by which the line continues an entry, or
        None; and the mark of the line that continues this line.
    """
    if "," in line:
        words = [word.strip() for word in line.split(",")]
        head = words[0]
        long = "*" in head
        width = 4 if long else 8
        if head[:1].isdigit():  # some programs leave out the empty first field
            return "", words, "", ""
        data, following = words[1 : 1 + width], "".join(words[1 + width : 2 + width])
        if any(words[2 + width :]):
            raise refuse(path, f"{line.strip()!r}: more than {2 + width} fields on a line")
    else:
        head = line[:8].strip()
        long = "*" in head
        size, width = (16, 4) if long else (8, 8)
        data = [line[8 + k * size : 8 + (k + 1) * size].strip() for k in range(width)]
        following = line[72:80]  # its first column says nothing
    if head.startswith("="):
        raise refuse(path, f"{line.strip()!r}: replication of entries is not supported")
    data += [""] * (width - len(data))
    if not head or head[0] in "+*":
        return "", data, head[1:].strip(), following[1:].strip()
    # meshio writes CTETRA_ and CHEXA_ for the quadratic elements
    return head.strip("*_ ").upper(), data, None, following[1:].strip()
