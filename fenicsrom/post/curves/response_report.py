"""The files of response curves: numbers, motions, pictures and the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.assess.curves.response_results import Response
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.html_page import write_report
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.writers import write_rows, write_summary
from fenicsrom.post.curves.contact_map import contact_map
from fenicsrom.post.curves.response_details import harmonics_figure, multiplier_figure
from fenicsrom.post.curves.response_figures import figure
from fenicsrom.post.curves.response_motion import (
    marked_motions,
    write_motion_arrays,
    write_motion_fields,
)
from fenicsrom.post.curves.response_rows import full_rows, rows, summary
from fenicsrom.post.curves.response_tables import (
    event_table,
    full_table,
    run_table,
    sentences,
    trust_table,
    varied_keys,
)
from fenicsrom.post.run.pictures import draw_pictures
from fenicsrom.post.run.sentences import MULTIPLIER_NOTE
from fenicsrom.scene import scene_heading

if TYPE_CHECKING:
    from fenicsrom.post.base.record import Study

MULTIPLIERS = "multipliers.png"

CHECKS_NOTE = (
    "Each row compares one motion of a curve: that of the largest amplitude, a fold, the first and "
    "the last point, points evenly between them, and points near instability, where a multiplier "
    "of the richer basis is close to the unit circle or changes fast. The changes are relative to "
    "the amplitude, at the same value of the parameter; at a fold, to the value of the parameter."
)
"""What the table of estimated errors holds."""


def write_numbers(found: Response, folder: Path) -> list[Path]:
    """Write `response.json` and `response.csv`, and `response_full.csv` of the full model.

    Raises:
        OSError: a file cannot be written.
    """
    files = [
        write_summary(folder / "response.json", summary(found)),
        write_rows(folder / "response.csv", rows(found)),
    ]
    if full := full_rows(found):
        files.append(write_rows(folder / "response_full.csv", full))
    return files


def _pictures(found: Response) -> list[Picture]:
    """The pictures of response curves."""
    contact = Picture(
        "Contact states over the period", "contact_map.png", lambda: contact_map(found)
    )
    return [
        Picture("Response curves", "response.png", lambda: figure(found)),
        *([contact] if found.contacts else []),
        Picture("Floquet multipliers", MULTIPLIERS, lambda: multiplier_figure(found)),
        Picture("Harmonics", "harmonics.png", lambda: harmonics_figure(found)),
    ]


def write_pictures(found: Response, folder: Path) -> list[tuple[str, Path]]:
    """Draw the pictures; one that fails becomes a warning. Give their headings and files.

    Raises:
        OSError: a file cannot be written.
    """
    listed = _pictures(found) if found.scene.output.pictures else []
    return draw_pictures(listed, folder, found.warnings)


def write_page(found: Response, pictures: list[tuple[str, Path]], folder: Path) -> Path:
    """Write `report.html`.

    Raises:
        OSError: the file cannot be written.
    """
    table, full = event_table(found), full_table(found)
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(found), *map("Warning: {}".format, found.warnings)]),
        *(
            (heading, [path, *([MULTIPLIER_NOTE] if path.name == MULTIPLIERS else [])])
            for heading, path in pictures
        ),
        *([("Special points", [table])] if table else []),
        *([("Full model", [full])] if full else []),
        ("Estimated errors", [trust_table(found), CHECKS_NOTE]),
        ("Effort", [run_table(found)]),
    ]
    title = f"{scene_heading(found.scene, varied_keys(found))}: response curves"
    return write_report(folder / "report.html", title, sections)


def write(
    found: Response, stored: StoredModel, folder: Path, study: Study | None = None
) -> list[Path]:
    """Write the numbers, then the motions, the pictures and the report.

    Collective if a study is given, for the ParaView files of the motions.

    Args:
        found: the curves.
        stored: their model.
        folder: folder of the files.
        study: the record of the offline stages, with the basis; None of a stored model.

    Returns:
        The files, the one to open first at the head; none on other ranks than the first.

    Raises:
        OSError: a file cannot be written.
    """
    first = study is None or study.solid.comm.rank == 0
    files = write_numbers(found, folder) if first else []
    motions = marked_motions(found, stored)
    if first:
        files.append(write_motion_arrays(motions, folder))
    if study is not None and found.scene.output.motion:
        files += write_motion_fields(study, motions, folder)
    if not first:
        return []
    warnings = len(found.warnings)
    pictures = write_pictures(found, folder)
    if len(found.warnings) > warnings:
        write_summary(folder / "response.json", summary(found))
    return [write_page(found, pictures, folder), *files, *(path for _, path in pictures)]
