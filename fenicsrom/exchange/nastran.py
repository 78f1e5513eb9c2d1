"""DMIG entries of Nastran: the matrices of a superelement in a bulk data file.

A header `DMIG name 0 form type ..` (form 1 square, 6 symmetric, 9 rectangular; type 1 and 2 real)
opens a matrix. Each further entry holds one column: its node and direction, a blank field, and
groups of four fields: node and direction of a row, the value, and nothing. Of a symmetric matrix
one triangle is given. Entries have fields of 8 or 16 characters, or fields between commas.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import refuse
from fenicsrom.exchange.matrix_set import INTERFACE, Label, MatrixSet, check_size, dense, matrix_set
from fenicsrom.files import atomic_write
from fenicsrom.formats.nastran_cards import Card, read_cards

SQUARE, SYMMETRIC, RECTANGULAR = 1, 6, 9
REAL_TYPES = (1, 2)
DOUBLE = 2
FIELD = 16
"""Characters of a wide field: eleven or twelve significant digits."""

LARGEST_COLUMNS = 10_000
"""Largest number of interface rows in a file."""


class _Matrix(NamedTuple):
    """A matrix of a file: its form, its number of columns if it is rectangular, its entries."""

    form: int
    columns: int
    entries: dict[tuple[Label, Label], float]


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
    found: dict[str, _Matrix] = {}
    for card in read_cards(path, whole=False):
        if card.name == "DMIG":
            _read_card(path, card, found)
    square = {name: given for name, given in found.items() if given.form != RECTANGULAR}
    pairs = [pair for given in square.values() for pair in given.entries]
    labels = tuple(sorted({label for pair in pairs for label in pair}))
    check_size(path, len(labels))
    place = {label: k for k, label in enumerate(labels)}
    matrices = {
        name: dense(given.entries, labels, given.form == SYMMETRIC)
        for name, given in square.items()
    }
    for name in found.keys() - square.keys():
        columns = found[name].columns
        matrices[name] = np.zeros((len(labels), columns))
        for (row, (column, _)), value in found[name].entries.items():
            if row not in place:
                raise refuse(path, f"{name}: no square matrix has the coordinate {row}")
            if not 0 < column <= columns:
                raise refuse(path, f"{name}: column {column} is above {columns}")
            matrices[name][place[row], column - 1] = value
    return matrix_set(path, matrices, labels)


def _read_card(path: Path, card: Card, found: dict[str, _Matrix]) -> None:
    """Read a DMIG entry: a header or a column."""
    name = card.text(0).upper()
    if card.text(1) == "0":
        form, kind = card.integer(2), card.integer(3)
        if kind not in REAL_TYPES:
            raise refuse(path, f"{name} is complex; only real matrices can be read")
        if form not in (SQUARE, SYMMETRIC, RECTANGULAR):
            raise refuse(path, f"{name} has the form {form}: must be 1, 6 or 9")
        columns = card.integer(7) if form == RECTANGULAR else 0
        if not 0 <= columns <= LARGEST_COLUMNS:
            raise refuse(path, f"{name} has {columns} columns")
        found[name] = _Matrix(form, columns, {})
        return
    if name not in found:
        raise refuse(path, f"{name} has no header")
    column = (card.integer(1), card.integer(2))
    for start in range(4, len(card.fields) - 2, 4):
        if card.text(start):
            row = (card.integer(start), card.integer(start + 1))
            found[name].entries[row, column] = card.real(start + 2)
