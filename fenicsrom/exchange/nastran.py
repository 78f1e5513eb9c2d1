"""DMIG entries of Nastran: the matrices of a superelement in a bulk data file.

A header `DMIG name 0 form type ..` (form 1 square, 6 symmetric, 9 rectangular; type 1 and 2 real)
opens a matrix. Each further entry holds one column: its node and direction, a blank field, and
groups of four fields: node and direction of a row, the value, and nothing. Of a symmetric matrix
one triangle is given. Entries have fields of 8 or 16 characters, or fields between commas.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import refuse
from fenicsrom.exchange.matrix_set import INTERFACE, LARGEST_SIZE, Label, MatrixSet, matrix_set
from fenicsrom.files import atomic_write

SQUARE, SYMMETRIC, RECTANGULAR = 1, 6, 9
REAL_TYPES = (1, 2)
DOUBLE = 2
FIELD = 16
"""Characters of a wide field: eleven or twelve significant digits."""

LARGEST_COLUMNS = 10_000
"""Largest number of interface rows in a file."""
NO_EXPONENT_LETTER = re.compile(r"([0-9.])([+-][0-9]+)$")
Entries = dict[tuple[Label, Label], float]


def write_dmig(path: Path, matrices: Mapping[str, Array], size: int) -> None:
    """Write matrices in scalar points 1 to n as DMIG entries.

    Args:
        path: the file.
        matrices: by name: (n, n), or (n, k), whose columns are numbered from 1.
        size: n.

    Raises:
        OSError: the file cannot be written.
    """
    lines = [
        "$ Linear superelement in SI units; the scalar points are its coordinates.",
        "$ Case control: K2GG = KAAX, M2GG = MAAX, B2GG = BAAX",
        f"SPOINT  {1:8d}{'THRU':<8s}{size:8d}" if size > 1 else f"SPOINT  {1:8d}",
    ]
    for name, matrix in matrices.items():
        lines += _matrix_lines(name, matrix)
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")


def _matrix_lines(name: str, matrix: Array) -> Iterator[str]:
    """The entries of a matrix."""
    rows, columns = matrix.shape
    symmetric = rows == columns and np.array_equal(matrix, matrix.T)
    form = SYMMETRIC if symmetric else SQUARE
    if name == INTERFACE:
        form = RECTANGULAR
    last = f"{columns:8d}" if form == RECTANGULAR else ""
    yield f"DMIG    {name:<8s}{0:8d}{form:8d}{DOUBLE:8d}{0:8d}{'':16s}{last}".rstrip()
    for column in range(columns):
        first = column if symmetric else 0
        filled = first + np.flatnonzero(matrix[first:, column])
        if filled.size:
            yield f"DMIG*   {name:<16s}{column + 1:16d}{0:16d}"
        for row in filled:
            yield f"*       {row + 1:16d}{0:16d}{_number(float(matrix[row, column])):>16s}"


def _number(value: float) -> str:
    """A number with as many digits as a wide field takes."""
    for digits in range(15, 0, -1):
        mantissa, exponent = f"{value:.{digits}E}".split("E")
        text = f"{mantissa}D{int(exponent):+d}"
        if len(text) <= FIELD:
            return text
    raise ValueError(f"{value} does not fit into {FIELD} characters")


def read_dmig(path: Path) -> MatrixSet:
    """Read the matrices of a superelement.

    Raises:
        SceneError: the file cannot be read, or its DMIG entries are damaged or complex.
    """
    forms: dict[str, int] = {}
    entries: dict[str, Entries] = {}
    columns: dict[str, int] = {}
    for fields in _cards(path):
        try:
            _read_card(path, fields, forms, entries, columns)
        except (ValueError, IndexError):
            text = ", ".join(fields[:8])
            raise refuse(path, f"a DMIG entry is damaged: {text}") from None
    labels = _labels(forms, entries)
    if len(labels) > LARGEST_SIZE:
        reason = f"has {len(labels)} coordinates; at most {LARGEST_SIZE}"
        raise refuse(path, f"{reason}: reduce it first (Craig-Bampton)")
    place = {label: k for k, label in enumerate(labels)}
    matrices = {}
    for name, form in forms.items():
        width = columns[name] if form == RECTANGULAR else len(labels)
        matrix = np.zeros((len(labels), width))
        for (row, column), value in entries[name].items():
            if row not in place:
                raise refuse(path, f"{name}: no square matrix has the coordinate {row}")
            at = column[0] - 1 if form == RECTANGULAR else place[column]
            if not 0 <= at < width:
                raise refuse(path, f"{name}: column {column[0]} is above {width}")
            matrix[place[row], at] = value
            if form == SYMMETRIC:
                matrix[at, place[row]] = value
        matrices[name] = matrix
    return matrix_set(path, matrices, labels)


def _labels(forms: Mapping[str, int], entries: Mapping[str, Entries]) -> tuple[Label, ...]:
    """The coordinates of all square matrices, in ascending order."""
    found: set[Label] = set()
    for name, form in forms.items():
        if form != RECTANGULAR:
            found.update(label for pair in entries[name] for label in pair)
    return tuple(sorted(found))


def _read_card(
    path: Path,
    fields: list[str],
    forms: dict[str, int],
    entries: dict[str, Entries],
    columns: dict[str, int],
) -> None:
    """Read a DMIG entry: a header or a column."""
    name = fields[0].upper()
    if fields[1] == "0":
        forms[name], kind = int(fields[2]), int(fields[3])
        if kind not in REAL_TYPES:
            raise refuse(path, f"{name} is complex; only real matrices can be read")
        if forms[name] not in (SQUARE, SYMMETRIC, RECTANGULAR):
            raise refuse(path, f"{name} has the form {forms[name]}: must be 1, 6 or 9")
        entries[name] = {}
        columns[name] = int(fields[7]) if forms[name] == RECTANGULAR else 0
        if not 0 <= columns[name] <= LARGEST_COLUMNS:
            raise refuse(path, f"{name} has {columns[name]} columns")
        return
    if name not in forms:
        raise refuse(path, f"{name} has no header")
    column = (int(fields[1]), int(fields[2] or 0))
    for start in range(4, len(fields) - 2, 4):
        if fields[start]:
            row = (int(fields[start]), int(fields[start + 1] or 0))
            entries[name][row, column] = _value(fields[start + 2])


def _value(text: str) -> float:
    """A number of Nastran: the letter of the exponent may be D, or missing."""
    plain = text.upper().replace("D", "E")
    return float(plain if "E" in plain else NO_EXPONENT_LETTER.sub(r"\1E\2", plain))


def _cards(path: Path) -> Iterator[list[str]]:
    """The fields of each DMIG entry, continued lines included.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        text = path.read_text(encoding="latin-1")
    except OSError as error:
        raise refuse(path, f"cannot be read: {error.strerror}") from None
    current: list[str] | None = None
    for line in text.splitlines():
        line = line.partition("$")[0].rstrip()
        if not line:
            continue
        first, fields = _fields(line.expandtabs(8))
        if first in ("", "*", "+") or first[0] in "*+":
            if current is not None:
                current += fields
            continue
        if current is not None:
            yield current
        current = fields if first.rstrip("*").upper() == "DMIG" else None
    if current is not None:
        yield current


def _fields(line: str) -> tuple[str, list[str]]:
    """The first field of a line and the others, all of them: four wide or eight narrow ones."""
    if "," in line:
        first, *fields = (field.strip() for field in line.split(","))
        count = 4 if "*" in first else 8
        return first, (fields + [""] * count)[:count]
    first = line[:8].strip()
    width = FIELD if "*" in first else 8
    line = line.ljust(72)
    return first, [line[start : start + width].strip() for start in range(8, 72, width)]
