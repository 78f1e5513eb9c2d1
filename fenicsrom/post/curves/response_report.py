"""The files of response curves: numbers, motions, pictures and the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fenicsrom.assess.curves.response_results import Response
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.chart import Detail
from fenicsrom.post.base.optional import missing_module
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.report import Report, Section
from fenicsrom.post.curves.peak_tables import peak_figure, peak_rows, peak_table
from fenicsrom.post.curves.response_details import contact_map, harmonics_figure, multiplier_figure
from fenicsrom.post.curves.response_figures import figure
from fenicsrom.post.curves.response_motion import (
    clicked_motions,
    marked_motions,
    write_motion_arrays,
    write_motion_fields,
)
from fenicsrom.post.curves.response_rows import full_rows, rows, summary
from fenicsrom.post.curves.response_tables import (
    event_table,
    full_table,
    joined_warnings,
    result_table,
    run_table,
    sentences,
    trust_table,
    varied_keys,
)
from fenicsrom.post.run.sentences import MULTIPLIER_NOTE

if TYPE_CHECKING:
    from fenicsrom.records import Study

CHECKS_NOTE = (
    "Each row compares one motion of a curve: that of the largest amplitude, a fold, the first and "
    "the last point, points evenly between them, and points near instability, where a multiplier "
    "of the richer basis is close to the unit circle or changes fast. The changes are relative to "
    "the amplitude, at the same value of the parameter; at a fold, to the value of the parameter."
)
"""What the table of estimated errors holds."""
PEAKS = "Peaks over a second number"


def report(found: Response, clicked: Sequence[Detail] = ()) -> Report:
    """The report of response curves: `response.csv`, `response.json` and the pictures.

    Where points of the full model were computed, `response_full.csv` has their numbers, and
    `response_peaks.csv` those of the peaks over `peak_over`.

    Args:
        found: the curves.
        clicked: what a click on a point of the curves shows.
    """
    found.warnings[:] = joined_warnings(found)
    keys = 1 if found.table.families is None else 2
    peaks = peak_table(found)
    more = {"response_full.csv": full_rows(found), "response_peaks.csv": peak_rows(found)}
    states = Picture(
        "Contact states over the period", "contact_map.png", lambda: contact_map(found)
    )
    return Report(
        "response",
        "response curves",
        found.scene,
        sentences(found),
        found.warnings,
        [
            Section("Results", [result_table(found)], terminal=False, top=True),
            Section("Special points", [event_table(found)], keys=keys),
            Section(PEAKS, [peaks], keys=keys, terminal=False),
            Section("Full model", [full_table(found)], keys=keys),
            Section("Estimated errors", [trust_table(found), CHECKS_NOTE], terminal=False),
            Section("Effort", [run_table(found)], terminal=False),
        ],
        rows(found),
        lambda: summary(found),
        [
            Picture("Response curves", "response.png", lambda: figure(found, clicked)),
            *([Picture(PEAKS, "peaks.png", lambda: peak_figure(found))] if peaks else []),
            *([states] if found.contacts else []),
            Picture(
                "Floquet multipliers",
                "multipliers.png",
                lambda: multiplier_figure(found),
                MULTIPLIER_NOTE,
            ),
            Picture("Harmonics", "harmonics.png", lambda: harmonics_figure(found)),
        ],
        varied=varied_keys(found),
        failure=found.unfinished,
        more_rows={name: listed for name, listed in more.items() if listed},
    )


def write(
    found: Response, stored: StoredModel, folder: Path, study: Study | None = None
) -> list[Path]:
    """Write the numbers, then the motions, the pictures and the report.

    With a study, all ranks must call this: each writes its part of the ParaView files.

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
    if first:
        report(found).write_numbers(folder)
    motions = marked_motions(found, stored)
    files = [write_motion_arrays(motions, folder)] if first else []
    if study is not None and found.scene.output.motion:
        files += write_motion_fields(study, motions, folder)
    if not first:
        return []
    shown = found.scene.output.pictures and not missing_module("bokeh")
    clicked = clicked_motions(found, stored, motions) if shown else []
    return [*report(found, clicked).write(folder), *files]
