"""The rows that a time integration records: copied, joined, and the last coordinates."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.step.state import Record


def copied_rows(record: Record, count: int) -> Record:
    """The first rows of a record, copied."""
    return Record._make(array[:count].copy() for array in record)


def joined_rows(pieces: list[Record], counts: list[int]) -> Record:
    """The first rows of several records, joined."""
    return Record._make(
        np.concatenate([array[:count] for array, count in zip(arrays, counts, strict=True)])
        for arrays in zip(*pieces, strict=True)
    )


def last_coordinates(history: list[Record]) -> Array:
    """The coordinates (k, 3 n) of the last spans, and those at the end of the span before."""
    found: list[Array] = []
    for rows in reversed(history):
        found.insert(0, rows.coordinates)
        if rows.coordinates.shape[0] < rows.time.size:
            break
    return np.concatenate(found)
