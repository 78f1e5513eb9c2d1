"""Tables as text: how a cell is formatted, and the table that the terminal shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


def cell_text(value: Any) -> str:
    """Format one cell: four digits for a float, a dash for None."""
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)


def numeric_columns(rows: Sequence[Sequence[Any]]) -> list[bool]:
    """Tell for each column whether all cells below the header are numbers or None."""
    numbers = (int, float, np.number, type(None))
    return [
        all(isinstance(value, numbers) and not isinstance(value, bool) for value in column[1:])
        and len(column) > 1
        for column in zip(*rows, strict=True)
    ]


def text_table(rows: Sequence[Sequence[Any]]) -> str:
    """Format a table for the terminal: the first row is the header, numbers are right-aligned."""
    cells = [[cell_text(value) for value in row] for row in rows]
    right = numeric_columns(rows)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(
            cell.rjust(width) if flag else cell.ljust(width)
            for cell, width, flag in zip(row, widths, right, strict=True)
        ).rstrip()
        for row in cells
    ]
    return "\n".join([lines[0], "  ".join("─" * width for width in widths), *lines[1:]])
