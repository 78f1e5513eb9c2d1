"""Text, CSV, JSON, PNG and `.npz` files; each appears complete or not at all."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.files import atomic_write
from fenicsrom.post.base.style import Figure

PICTURE_DPI = 130


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
    figure.set_dpi(PICTURE_DPI)
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
        figure.set_layout_engine("none")  # savefig would draw everything once more for the layout
    with atomic_write(path) as temporary:
        figure.savefig(temporary, format="png", dpi=PICTURE_DPI, pil_kwargs={"compress_level": 4})
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
