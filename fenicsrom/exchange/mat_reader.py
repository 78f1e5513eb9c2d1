"""Read the real matrices of a MATLAB file of version 5 to 7.

scipy's reader crashes on some damaged files. This reader takes dense and sparse real matrices of
two dimensions and ignores everything else. After a header of 128 bytes, a file is a sequence of
elements: type and length (4 bytes each, or 2 each if the length is at most 4), data, and zeros up
to a multiple of 8 bytes. Elements of type 15 hold a compressed element. A matrix (type 14) consists
of elements itself: flags with the class, dimensions, name and numbers; a sparse one has the rows
and the starts of the columns before the numbers.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.words import counted

HEADER = 128
MATRIX, COMPRESSED = 14, 15
SPARSE, NUMERIC = 5, range(6, 16)
COMPLEX = 0x800
LARGEST = 2**28
"""Largest length in bytes of a decompressed element."""

NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
"""Types of numbers by the type of an element."""


def mat_matrices(data: bytes) -> dict[str, Array]:
    """The real matrices of a file, by name.

    Raises:
        ValueError: the data are damaged, or of another version.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128], "")
    if not order or len(data) < HEADER:
        raise ValueError("no file of MATLAB, version 5 to 7")
    found: dict[str, Array] = {}
    for kind, content in _elements(data[HEADER:], order):
        if kind == COMPRESSED:
            for inner, matrix in _elements(_decompressed(content), order):
                if inner == MATRIX:
                    found |= _matrix(matrix, order)
        elif kind == MATRIX:
            found |= _matrix(content, order)
    return found


def _decompressed(content: bytes) -> bytes:
    """The data of a compressed element.

    Raises:
        ValueError: the bytes are damaged, or too long.
    """
    stream = zlib.decompressobj()
    try:
        data = stream.decompress(content, LARGEST)
    except zlib.error as error:
        raise ValueError(str(error)) from None
    if not stream.eof:
        raise ValueError("a compressed element is too long or ends early")
    return data


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """The types and data of the elements in a sequence.

    Raises:
        ValueError: an element ends early.
    """
    place = 0
    while place + 8 <= len(data):
        first, length = (int(v) for v in np.frombuffer(data, f"{order}u4", 2, place))
        if first >> 16:  # a short element
            kind, length, start, end = first & 0xFFFF, first >> 16, place + 4, place + 8
        else:
            kind, start = first, place + 8
            end = start + length + (-length % 8 if kind != COMPRESSED else 0)
        if start + length > len(data):
            raise ValueError("an element ends early")
        yield kind, data[start : start + length]
        place = end


def _matrix(content: bytes, order: str) -> dict[str, Array]:
    """The name and the matrix; nothing if the matrix is not real or has not two dimensions.

    Raises:
        ValueError: its parts do not fit together.
    """
    parts = list(_elements(content, order))
    if len(parts) < 3 or len(parts[0][1]) < 4:
        return {}
    flags = int(np.frombuffer(parts[0][1], f"{order}u4", 1)[0])
    kind, name = flags & 0xFF, parts[2][1].decode("latin-1")
    shape = _numbers(parts[1], order).astype(np.int64)
    if kind not in (SPARSE, *NUMERIC) or flags & COMPLEX or shape.size != 2:
        return {}
    rows, columns = (int(v) for v in shape)
    if rows < 0 or columns < 0 or 8 * rows * columns > LARGEST:
        raise ValueError(f"{name} has {counted(rows, 'row')} and {counted(columns, 'column')}")
    values = [_numbers(part, order) for part in parts[3:]]
    if kind != SPARSE:
        if len(values) != 1:
            raise ValueError(f"{name} has no numbers")
        return {name: values[0].reshape((rows, columns), order="F")}
    if len(values) != 3:
        raise ValueError(f"{name} has no numbers")
    row, starts = (v.astype(np.int64) for v in values[:2])
    counts = np.diff(starts)
    if starts.size != columns + 1 or np.any(counts < 0) or starts[0] != 0:
        raise ValueError(f"{name} has damaged columns")
    count = int(starts[-1])
    if min(row.size, values[2].size) < count or np.any((row[:count] < 0) | (row[:count] >= rows)):
        raise ValueError(f"{name} has damaged rows")
    matrix = np.zeros((rows, columns))
    matrix[row[:count], np.repeat(np.arange(columns), counts)] = values[2][:count]
    return {name: matrix}


def _numbers(element: tuple[int, bytes], order: str) -> Array:
    """The numbers of an element as float64.

    Raises:
        ValueError: the element does not hold numbers.
    """
    kind, content = element
    if kind not in NUMBERS:
        raise ValueError(f"type {kind} in place of numbers")
    return np.asarray(np.frombuffer(content, order + NUMBERS[kind]), dtype=np.float64)
