"""OUTPUT4 files of Nastran as text: dense matrices of real numbers, written and read.

A matrix begins with the record (2I8, 2I8, A8, format): columns, rows (negative for the sparse form
"bigmat"), form (1 square, 2 rectangular, 6 symmetric), type (1 and 2 real) and name. The format,
such as 1P,3E23.16, gives the numbers in a line and their width. Each column that is not zero has a
record (3I8) of its number, its first row and its count of numbers, and then the numbers. A column
with a number above the last one ends the matrix. In a sparse matrix the first row is 0, and strings
of consecutive rows follow, each behind a record of its length and its first row.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import refuse
from fenicsrom.exchange.matrix_set import LARGEST_SIZE, MatrixSet, matrix_set
from fenicsrom.files import atomic_write
from fenicsrom.formats.collector import content_of
from fenicsrom.words import counted

FORMAT = re.compile(r"(?:1P,)?(\d+)[ED](\d+)\.\d+")
DIGITS = 16  # digits behind the point: 17 significant digits keep every float64
WIDTH = DIGITS + 7
PER_LINE = 80 // WIDTH
LEAST = 1e-99  # a smaller number has an exponent of three digits, for which there is no room
DOUBLE = 2
SQUARE, RECTANGULAR, SYMMETRIC = 1, 2, 6
LONGEST_STRING = 65536  # a string header of the sparse form holds row + 65536 (length + 1)


def write_op4(path: Path, matrices: Mapping[str, Array]) -> None:
    """Write dense matrices to a text file.

    Raises:
        OSError: the file cannot be written.
    """
    lines: list[str] = []
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        square = SYMMETRIC if rows == columns and np.array_equal(matrix, matrix.T) else SQUARE
        form = square if rows == columns else RECTANGULAR
        header = f"{columns:8d}{rows:8d}{form:8d}{DOUBLE:8d}{name:<8s}"
        lines.append(f"{header}1P,{PER_LINE}E{WIDTH}.{DIGITS}")
        for column in range(columns):
            filled = np.flatnonzero(matrix[:, column])
            if filled.size:
                first, last = int(filled[0]), int(filled[-1])
                lines += _column(column + 1, first + 1, matrix[first : last + 1, column])
        lines += _column(columns + 1, 1, np.ones(1))
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii")


def _column(number: int, row: int, values: Array) -> Iterator[str]:
    """The lines of the numbers of a column from a row on."""
    yield f"{number:8d}{row:8d}{values.size:8d}"
    values = np.where(np.abs(values) < LEAST, 0.0, values)
    for start in range(0, values.size, PER_LINE):
        yield "".join(f"{v:{WIDTH}.{DIGITS}E}" for v in values[start : start + PER_LINE])


def read_op4(path: Path) -> MatrixSet:
    """Read the matrices of a superelement.

    Raises:
        SceneError: the file cannot be read, or is not a text file of real matrices.
    """
    return matrix_set(path, op4_matrices(path))


def op4_matrices(path: Path) -> dict[str, Array]:
    """All matrices of a text file, by name.

    Raises:
        SceneError: the file cannot be read, or is not a text file of real matrices.
    """
    data = content_of(path)
    if b"\0" in data[:100]:
        reason = "is a binary OUTPUT4 file; write it as text, with FORM=FORMATTED"
        raise refuse(path, reason)
    lines = iter(data.decode("ascii", errors="replace").splitlines())
    found: dict[str, Array] = {}
    for line in lines:
        if line.strip():
            name, matrix = _read_matrix(path, line, lines)
            found[name] = matrix
    return found


def _read_matrix(path: Path, header: str, lines: Iterator[str]) -> tuple[str, Array]:
    """Read a matrix behind its header."""
    columns, rows, kind = int(header[:8]), int(header[8:16]), int(header[24:32])
    name, words = header[32:40].strip(), FORMAT.match(header[40:].strip().upper())
    if kind not in (1, DOUBLE):
        raise refuse(path, f"matrix {name} is complex; only real matrices can be read")
    if not 0 <= columns <= LARGEST_SIZE or not 0 <= abs(rows) <= LARGEST_SIZE:
        reason = f"matrix {name} has {counted(abs(rows), 'row')} and {counted(columns, 'column')}"
        raise refuse(path, f"{reason}; at most {LARGEST_SIZE}: reduce it first (Craig-Bampton)")
    width = int(words[2]) if words else 16
    matrix = np.zeros((abs(rows), columns))
    while True:
        line = next(lines)
        column, row, count = int(line[:8]), int(line[8:16]), int(line[16:24])
        if column > columns:
            _numbers(lines, count, width)
            return name, matrix
        if row > 0:
            _store(matrix, column, row, _numbers(lines, count, width))
            continue
        while count > 0:
            line = next(lines)
            if rows < 0:
                words_there, row = int(line[:8]) - 1, int(line[8:16])
                count -= words_there + 2
            else:
                words_there, row = divmod(int(line), LONGEST_STRING)
                words_there -= 1
                count -= words_there + 1
            _store(matrix, column, row, _numbers(lines, words_there // kind, width))


def _store(matrix: Array, column: int, row: int, values: list[float]) -> None:
    """Store the numbers of a column from a row on.

    Raises:
        IndexError: the numbers do not fit into the matrix.
    """
    if column < 1 or row < 1 or row - 1 + len(values) > matrix.shape[0]:
        raise IndexError(f"column {column}, row {row} does not exist")
    matrix[row - 1 : row - 1 + len(values), column - 1] = values


def _numbers(lines: Iterator[str], count: int, width: int) -> list[float]:
    """Read numbers of a width."""
    found: list[float] = []
    while len(found) < count:
        line = next(lines).upper().replace("D", "E").rstrip()
        texts = [line[start : start + width] for start in range(0, len(line), width)]
        if not texts:
            raise ValueError("a line of numbers is empty")
        found += [float(text) for text in texts]
    return found[:count]
