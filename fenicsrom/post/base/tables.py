"""Tables and quantities as text, in files and in the terminal, and the names of directions.

All tables, sentences and pictures have the same order: the axes, or the normal of the contact and
then its tangents.
"""

from __future__ import annotations

import csv
import io
import json
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.files import atomic_write
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import NEGLIGIBLE
from fenicsrom.post.base.style import DPI, Figure
from fenicsrom.scene import Scene


def write_text(path: str | Path, text: str) -> Path:
    """Write a text in UTF-8 and return its path.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")
    return Path(path)


def write_summary(path: str | Path, summary: Mapping[str, Any]) -> Path:
    """Write a mapping as JSON, its keys in the given order, and return the path.

    numpy numbers, numpy arrays and paths are allowed as values.

    Raises:
        AccuracyError: a number is NaN or infinite; the error names its key. Nothing is written.
        OSError: the file cannot be written.
    """
    text = json.dumps(_plain(summary, ""), indent=2, ensure_ascii=False, allow_nan=False)
    return write_text(path, text + "\n")


def write_rows(path: str | Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows as CSV and return the path.

    The header has the keys of all rows in the order of their first appearance; a cell without a
    value stays empty.

    Raises:
        OSError: the file cannot be written.
    """
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return write_text(path, text.getvalue())


def write_figure(path: str | Path, figure: Figure) -> Path:
    """Write a matplotlib figure as PNG and return its path.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=DPI, pil_kwargs={"compress_level": 4})
    return Path(path)


def write_arrays(path: str | Path, arrays: Mapping[str, Any]) -> Path:
    """Write arrays by name as a compressed `.npz` file and return its path.

    Raises:
        OSError: the file cannot be written.
    """
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)
    return Path(path)


def _plain(value: Any, where: str) -> Any:
    """Convert data to the types of JSON."""
    if isinstance(value, Mapping):
        return {
            str(key): _plain(item, f"{where}.{key}" if where else str(key))
            for key, item in value.items()
        }
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise AccuracyError(
            f"the summary was not written: {where} is {value}, not a finite number",
            kind=ErrorKind.NOT_FINITE,
            key=where,
        )
    return str(value) if isinstance(value, Path) else value


TERMINAL_WIDTH = 100  # characters of the widest line of a table
GAP = "  "  # between two columns


FACTORS = {"mm": 1e3, "µm": 1e6, "%": 100.0, "ms": 1e3, "MPa": 1e-6, "MPa/mm": 1e-9}
"""From units of SI to those of tables and pictures."""
LABEL = 18  # characters of a line of the label of an axis


@dataclass(frozen=True)
class Quantity:
    """What is told of each record of a result: declared once for files, tables, axes and sentences.

    Attributes:
        key: its name in CSV and JSON files, with the unit there; "" leaves it out of them.
        of: the attribute of a record, such as "motion.residual", or a function of it; by default
            the attribute named `key`. A record may be a mapping, too.
        head: its name and unit for people, such as "amplitude, mm"; "" leaves it out of tables.
        digits: significant digits for people.
    """

    key: str
    of: str | Callable[[Any], Any] = ""
    head: str = ""
    digits: int = 5

    @property
    def unit(self) -> str:
        """The unit for people, as `head` gives it; "" without one."""
        return self.head.partition(", ")[2]

    @property
    def factor(self) -> float:
        """From the unit in files, which is that of SI, to that for people."""
        unit = self.unit.split(" ")[0]
        return 1.0 if self.key.endswith((f"_{unit}", "_percent")) else FACTORS.get(unit, 1.0)

    def value(self, record: Any) -> Any:
        """What files have of a record; None in place of a number that is not finite."""
        if callable(self.of):
            value = self.of(record)
        elif isinstance(record, Mapping):
            value = record.get(self.of or self.key)
        else:
            value = attrgetter(self.of or self.key)(record)
        return None if isinstance(value, float) and not math.isfinite(value) else value

    def cell(self, record: Any) -> Any:
        """The entry of a record in a table: a number gets its digits, all else stays as it is."""
        value = self.value(record)
        if isinstance(value, float):
            return f"{self.factor * value:.{self.digits}g}"
        return value

    def text(self, record: Any) -> str:
        """The number of a record with its unit, for sentences."""
        return f"{self.cell(record)} {self.unit}".rstrip()

    def inside(self, part: str) -> Quantity:
        """The quantity of records that have an attribute with such a record."""
        return replace(self, of=lambda record: self.value(getattr(record, part)))

    def column(self, records: Iterable[Any]) -> Array:
        """The numbers of records as an axis shows them; nan where there is none."""
        return self.factor * np.array([self.value(one) for one in records], dtype=np.float64)

    @property
    def label(self) -> str:
        """The label of an axis; the unit stands beside a word."""
        return textwrap.fill(self.head.replace(", ", ",\N{NO-BREAK SPACE}"), LABEL)


def components(
    key: str, of: str | Callable[[Any], Any], names: Iterable[Any], head: str = "", digits: int = 5
) -> list[Quantity]:
    """A quantity for each component of a vector; key and head have {} in the place of its name."""
    whole = Quantity("", of)

    def component(k: int) -> Callable[[Any], Any]:
        return lambda record: float(whole.value(record)[k])

    return [
        Quantity(key.format(name), component(k), head.format(name), digits)
        for k, name in enumerate(names)
    ]


def rows_of(records: Iterable[Any], quantities: Iterable[Quantity]) -> list[dict[str, Any]]:
    """The rows of records in files."""
    kept = [quantity for quantity in quantities if quantity.key]
    return [{one.key: one.value(record) for one in kept} for record in records]


def table_of(records: Iterable[Any], quantities: Iterable[Quantity] = ()) -> list[list[Any]]:
    """The table of records for people; empty without records.

    Without quantities, each record is a row: a mapping whose keys are the heads.
    """
    shown = [quantity for quantity in quantities if quantity.head]
    rows = [{one.head: one.cell(record) for one in shown} or record for record in records]
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
    columns = [column[1:] for column in zip(*rows, strict=True)]
    return [bool(column) and all(map(_is_number, column)) for column in columns]


def _is_number(value: Any) -> bool:
    """Whether a cell is a number, as a text or not, or empty."""
    if isinstance(value, str):
        with suppress(ValueError):
            float(value)
            return True
    return isinstance(value, int | float | np.number | None) and not isinstance(value, bool)


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
    cells[0] = [head.replace(", ", " ") for head in cells[0]]  # the columns are narrow
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


ALIGNED = 1e-6  # largest components across an axis of a unit vector that is named by the axis


def plain_names(dimension: int, touching: bool) -> list[str]:
    """Name the directions of a motion whose contact frames are not known."""
    if not touching:
        return list("xyz"[:dimension])
    if dimension == 2:
        return ["normal", "tangential"]
    return ["normal", "tangential 1", "tangential 2"]


def direction_names(scene: Scene, points: ContactPoints) -> list[str]:
    """Name the directions of a motion: the axes of the probe, or those of the contact frames.

    A direction that is along the same axis at all points has the name of this axis, such as
    "tangential y".

    Args:
        scene: the scene.
        points: its contact points.
    """
    d = scene.geometry.dimension
    names = plain_names(d, bool(scene.contacts))
    if not scene.contacts:
        return names
    for k in range(d):
        rows = np.abs(points.frame[:, k])
        axis = int(np.argmax(rows[0]))
        if np.max(np.delete(rows, axis, axis=1)) <= ALIGNED:
            names[k] = f"{names[k].split()[0]} {'xyz'[axis]}"
    return names


def error_names(scene: Scene, points: ContactPoints) -> tuple[str, str]:
    """Name the first direction and all others together, as the errors of amplitudes are given."""
    first, *others = direction_names(scene, points)
    together = "tangential" if scene.contacts and len(others) > 1 else " and ".join(others)
    return first, together


def direction_note(scene: Scene, points: ContactPoints) -> str | None:
    """Give the vectors of the directions without an axis in their names; None if there are none."""
    names = direction_names(scene, points)
    plain = plain_names(len(names), bool(scene.contacts))
    told = [
        f"{name} ({', '.join(f'{value:.4g}' for value in np.round(points.frame[0, k], 6) + 0.0)})"
        for k, name in enumerate(names)
        if scene.contacts and name == plain[k]
    ]
    return f"Directions at the first contact point: {', '.join(told)}." if told else None


def millimetres(values: Sequence[float] | Array, digits: int = 5) -> list[str]:
    """Displacements in m as texts in mm; "0" for a displacement that is only rounding error."""
    largest = float(np.max(np.abs(values), initial=0.0))
    return [f"{1e3 * v:.{digits}g}" if abs(v) > NEGLIGIBLE * largest else "0" for v in values]


def place_text(position: Sequence[float] | Array) -> str:
    """A place as text, in m."""
    return f"({', '.join(f'{x + 0.0:.4g}' for x in np.round(position, 9))})"


def in_order(amplitude: Mapping[str, Any]) -> list[float]:
    """Amplitudes of `online.motion.measures.amplitudes`, in the order of the directions."""
    return [amplitude["normal"], *amplitude["tangential"]]


def named_millimetres(
    names: Sequence[str], values: Sequence[float] | Array, digits: int = 5
) -> str:
    """List displacements given in m, each with the name of its direction, in mm."""
    texts = millimetres(values, digits)
    return ", ".join(f"{name} {text} mm" for name, text in zip(names, texts, strict=False))
