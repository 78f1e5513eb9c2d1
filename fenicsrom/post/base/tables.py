"""Tables as text: how a cell is formatted, and the table that the terminal shows."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np

TERMINAL_WIDTH = 100  # characters of the widest line of a table
GAP = "  "  # between two columns


def table_of(rows: Iterable[Mapping[str, Any]]) -> list[list[Any]]:
    """The table of rows with the same keys, which are its header; empty without rows."""
    rows = list(rows)
    return [list(rows[0]), *(list(row.values()) for row in rows)] if rows else []


def named(pattern: str, names: Iterable[str], values: Iterable[float]) -> dict[str, float]:
    """Values by a pattern such as "amplitude_{}_m" with their names."""
    pairs = zip(names, map(float, values), strict=False)
    return {pattern.format(name): value for name, value in pairs}


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


def filled_columns(rows: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """Leave out the columns without content, but not the first one; the first row is the header."""
    kept = [
        k == 0 or any(value is not None and value != "" for value in column[1:])
        for k, column in enumerate(zip(*rows, strict=True))
    ]
    return [[value for value, keep in zip(row, kept, strict=True) if keep] for row in rows]


def text_table(rows: Sequence[Sequence[Any]], keys: int = 1) -> str:
    """Format a table for the terminal, at most `TERMINAL_WIDTH` characters wide.

    Numbers are right-aligned, and columns without content are left out. The header takes several
    lines if the table is too wide otherwise. If this is not enough, the columns are distributed
    over several tables of about the same width, which all begin with the first columns.

    Args:
        rows: the table; the first row is the header.
        keys: number of the columns that tell the rows apart.
    """
    rows = filled_columns(rows)
    cells = [[cell_text(value) for value in row] for row in rows]
    right = numeric_columns(rows)
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    if _total(widths) > TERMINAL_WIDTH:
        widths = [
            max(*map(len, column[1:]), *map(len, column[0].split()), 1) if len(column) > 1 else wide
            for column, wide in zip(zip(*cells, strict=True), widths, strict=True)
        ]
    groups = _balanced_groups(widths, min(keys, len(widths)))
    return "\n\n".join(_block(cells, widths, right, group) for group in groups)


def _balanced_groups(widths: Sequence[int], keys: int) -> list[list[int]]:
    """The columns of each table: as few tables as fit, the widest one as narrow as possible."""
    fewest = len(_groups(widths, keys, TERMINAL_WIDTH))
    limits = range(1, TERMINAL_WIDTH + 1)
    return next(g for g in (_groups(widths, keys, most) for most in limits) if len(g) == fewest)


def _groups(widths: Sequence[int], keys: int, most: int) -> list[list[int]]:
    """The columns of tables that are filled one after the other, up to a width if that can be.

    Args:
        widths: widths of the columns.
        keys: number of the first columns, which every table has.
        most: largest width of a table of more than one other column.
    """
    groups = [list(range(keys))]
    for k in range(keys, len(widths)):
        used = [widths[j] for j in groups[-1]]
        if len(groups[-1]) > keys and _total([*used, widths[k]]) > most:
            groups.append(list(range(keys)))
        groups[-1].append(k)
    return groups


def _total(widths: Sequence[int]) -> int:
    """Width of a table with columns of these widths."""
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _block(
    cells: Sequence[Sequence[str]], widths: Sequence[int], right: Sequence[bool], group: list[int]
) -> str:
    """Some columns of a table."""
    heads = [textwrap.wrap(cells[0][k], widths[k])[::-1] or [""] for k in group]
    lines = [*zip_longest(*heads, fillvalue="")][::-1]  # heads end in the same line
    body = [[row[k] for k in group] for row in cells[1:]]
    shown = [
        GAP.join(
            cell.rjust(widths[k]) if right[k] else cell.ljust(widths[k])
            for cell, k in zip(line, group, strict=True)
        ).rstrip()
        for line in [*lines, *body]
    ]
    rule = GAP.join("─" * widths[k] for k in group)
    return "\n".join([*shown[: len(lines)], rule, *shown[len(lines) :]])
