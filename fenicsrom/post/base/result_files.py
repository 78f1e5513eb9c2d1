"""The files of a command that finds a curve: a table, a summary, a picture and a report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from fenicsrom.post.base.html_page import write_report
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.writers import write_rows, write_summary
from fenicsrom.post.run.pictures import draw_pictures
from fenicsrom.scene import Scene, scene_heading


def write_results(
    folder: Path,
    scene: Scene,
    picture: Picture,
    *,
    title: str,
    rows: Sequence[Mapping[str, Any]],
    summary: Callable[[], dict[str, Any]],
    sentences: Sequence[str],
    warnings: list[str],
    tables: Mapping[str, list[Any]],
    more: Sequence[Picture] = (),
) -> list[Path]:
    """Write `NAME.csv`, `NAME.json`, `NAME.png` and `report.html`; NAME is that of the picture.

    Args:
        folder: folder of the files.
        scene: the scene, which says whether pictures are drawn.
        picture: the picture of the curve.
        title: what the report shows, after the heading of the scene.
        rows: rows of the CSV file, which all have the same keys.
        summary: gives the content of the JSON file, with the warnings.
        sentences: what was found.
        warnings: a picture that cannot be drawn adds one.
        tables: tables of the report by their headings, each with its header as the first row;
            empty ones are left out.
        more: other pictures, drawn below the first one.

    Returns:
        The files, the one to open first at the head.

    Raises:
        OSError: a file cannot be written.
    """
    name = Path(picture.name).stem
    table, numbers, report = (folder / f for f in (f"{name}.csv", f"{name}.json", "report.html"))
    write_rows(table, rows)
    write_summary(numbers, summary())
    pictures = []
    if scene.output.pictures:
        pictures = draw_pictures([picture, *more], folder, warnings)
        write_summary(numbers, summary())
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences, *map("Warning: {}".format, warnings)]),
        *((heading, [path]) for heading, path in pictures),
        *((heading, [rows]) for heading, rows in tables.items() if rows),
    ]
    write_report(report, f"{scene_heading(scene)}: {title}", sections)
    return [report, numbers, table, *(path for _, path in pictures)]
