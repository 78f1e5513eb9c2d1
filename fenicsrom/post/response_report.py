"""The report of response curves: sentences, tables and files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.assess.response_results import FullPoint, Response, ResponseCurve, judged_multiplier
from fenicsrom.online.archive import StoredModel, provenance
from fenicsrom.online.curve import COMPLETE, CurvePoint
from fenicsrom.online.measures import STATE_NAMES
from fenicsrom.post.contact_map import contact_map
from fenicsrom.post.html_page import write_report
from fenicsrom.post.pictures import not_drawn
from fenicsrom.post.response_details import harmonics_figure, multiplier_figure
from fenicsrom.post.response_figures import (
    directions,
    figure,
    in_order,
    largest_component,
    largest_direction,
    parameter_label,
    unit_of,
)
from fenicsrom.post.response_motion import (
    largest_point,
    marked_motions,
    write_motion_arrays,
    write_motion_fields,
)
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_figure, write_rows, write_summary
from fenicsrom.scene.rules import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fenicsrom.post.record import Study


def rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response.csv`: every point and bifurcation in the order along its curve."""
    families, component = found.table.families, largest_component(found)
    return [
        ({} if families is None else {with_unit(found, families.key): curve.value})
        | {"piece": number}
        | _row(found, point, component)
        for curve in found.curves
        for number, piece in enumerate(curve.pieces, 1)
        for point in in_order(piece)
    ]


def _row(found: Response, point: CurvePoint, component: tuple[int, int]) -> dict[str, Any]:
    """One point as a row: amplitudes and force are the largest of all contact points.

    Harmonics and phase are those of the contact point and direction of `component`; the harmonics
    are multiples of the lowest frequency of the loads.
    """
    multiplier = judged_multiplier(point)
    main = point.harmonics[:, component[0], component[1]]
    amplitudes = zip(directions(found), point.amplitude.max(axis=0), strict=True)
    contact = {
        "peak_normal_force_N": float(point.peak_force.max(initial=0.0)),
        "friction_dissipation_per_period_J": point.friction_dissipation,
        "contact_states": " ".join(_states(point)),
    }
    return {
        with_unit(found, found.table.parameter): point.parameter,
        **{f"amplitude_{name.replace(' ', '_')}_m": float(a) for name, a in amplitudes},
        "phase_deg": float(np.degrees(np.angle(main[0]))),
        **{f"harmonic_{k}_m": float(abs(value)) for k, value in enumerate(main, 1)},
        **(contact if found.contacts else {}),
        "damping_dissipation_per_period_J": point.damping_dissipation,
        "stability": point.verdict,
        "bifurcation": point.kind,
        "contact_point": None if point.contact < 0 else point.contact,
        "periods": point.periods,
        "multiplier_size": abs(multiplier),
        "multiplier_real": multiplier.real,
        "multiplier_imaginary": multiplier.imag,
        "free_sliders": point.free_sliders,
        "residual": point.residual,
        "marched_periods": point.marches[0],
        "marched_periods_with_derivatives": point.marches[1],
    }


def with_unit(found: Response, key: str) -> str:
    """The name of a column: a key of the scene with its unit."""
    unit = unit_of(found, key).replace("²", "2")
    return f"{key}_{unit}" if unit else key


def _states(point: CurvePoint) -> list[str]:
    """The contact states that occur in the period at any point."""
    bits = int(np.bitwise_or.reduce(point.states, initial=0))
    return [name for bit, name in enumerate(STATE_NAMES.values()) if bits >> bit & 1]


def summary(found: Response) -> dict[str, Any]:
    """The contents of `response.json`."""
    table = found.table
    return {
        "scene": found.scene.source,
        "parameter": table.parameter,
        "first": table.first,
        "last": table.last,
        "family": table.families.key if table.families else None,
        "coordinates": found.size,
        "steps_per_period": found.steps,
        "curves": [_curve_summary(found, curve) for curve in found.curves],
        "seconds": found.seconds,
        "interrupted": found.interrupted,
        "unfinished": str(found.unfinished) if found.unfinished else None,
        "warnings": found.warnings,
        "provenance": provenance(),
    }


def _curve_summary(found: Response, curve: ResponseCurve) -> dict[str, Any]:
    """The part of `response.json` about one curve."""
    component = largest_component(found)
    return {
        "value": curve.value,
        "points": len(curve.points),
        "ends": [piece.reason for piece in curve.pieces],
        "largest": _row(found, largest_point(found, curve), component),
        "bifurcations": [_row(found, point, component) for point in curve.special],
        "pieces": [
            {"origin": piece.origin, "periods": piece.periods, "points": len(piece.points)}
            for piece in curve.pieces
        ],
        "checks": [
            {
                "where": check.where,
                found.table.parameter: check.point.parameter,
                "quantity": check.quantity,
                "step_error": check.step_error,
                "basis_error": check.basis_error,
            }
            for check in curve.checks
        ],
        "marched_periods": curve.marches[0],
        "marched_periods_with_derivatives": curve.marches[1],
        "seconds": curve.seconds,
        "full_model": [_full_row(found, point) for point in curve.full],
    }


def _full_row(found: Response, point: FullPoint) -> dict[str, Any]:
    """A motion of the full model beside that of the reduced model."""
    amplitudes = {
        f"{model}_amplitude_{name.replace(' ', '_')}_m": float(a)
        for model, values in (("full", point.amplitude), ("reduced", point.reduced_amplitude))
        for name, a in zip(directions(found), values.max(axis=0), strict=True)
    }
    return {
        found.table.parameter: point.parameter,
        **amplitudes,
        "relative_error": point.error,
        "stability_of_the_reduced_motion": point.verdict,
        "full_periods": point.periods,
        "full_periods_with_derivatives": point.derived,
        "residual": point.residual,
        "seconds": point.seconds,
    }


def sentences(found: Response) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    families, name = found.table.families, directions(found)[largest_direction(found)]
    lines = []
    for curve in found.curves:
        top, points = largest_point(found, curve), curve.points
        amplitude = 1e3 * float(top.amplitude[:, largest_direction(found)].max())
        begin = "" if families is None else f"{families.key} = {curve.value:g}: "
        unstable = sum(not point.stable for point in points)
        lines.append(
            f"{begin}{counted(len(points), 'point')} in {curve.seconds:.1f} s; largest {name} "
            f"amplitude {amplitude:.5g} mm at {found.table.parameter} = {top.parameter:.6g}, "
            f"{_verdict(top)}."
        )
        lines += [f"{begin}{unstable} points are unstable."] if unstable else []
        if curve.step_error is not None:
            lines.append(
                f"{begin}Half the time step changes this amplitude by "
                f"{100.0 * curve.step_error:.2g} %."
            )
        if curve.basis_error is not None:
            lines.append(
                f"{begin}A richer basis changes this amplitude by "
                f"{100.0 * curve.basis_error:.2g} %."
            )
        free = sum(point.free_sliders > 0 for point in points)
        if free:
            lines.append(
                f"{begin}{free} points have a contact point that sticks all the time: the position "
                "of its slider is not unique."
            )
        ends = {piece.reason for piece in curve.pieces} - set(COMPLETE)
        lines += [f"{begin}The curve is incomplete: {reason}." for reason in sorted(ends)]
    return lines


def _verdict(point: CurvePoint) -> str:
    """The stability of a point in words."""
    return "stable" if point.stable else f"unstable ({point.verdict})"


def bifurcation_table(found: Response) -> list[list[Any]]:
    """The bifurcations of all curves, the head first; empty without any."""
    direction, families = largest_direction(found), found.table.families
    first = [] if families is None else [families.key]
    head = [*first, "bifurcation", parameter_label(found)]
    head += [f"{directions(found)[direction]} amplitude, mm"]
    listed = [
        [
            *([] if families is None else [curve.value]),
            point.kind if point.contact < 0 else f"{point.kind}, contact point {point.contact}",
            f"{point.parameter:.7g}",
            f"{1e3 * float(point.amplitude[:, direction].max()):.5g}",
        ]
        for curve in found.curves
        for point in curve.special
    ]
    return [head, *listed] if listed else []


def full_rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response_full.csv`: the motions of the full model."""
    families = found.table.families
    return [
        ({} if families is None else {families.key: curve.value}) | _full_row(found, point)
        for curve in found.curves
        for point in curve.full
    ]


def full_table(found: Response) -> list[list[Any]]:
    """The full model beside the reduced one, the head first; empty if it was not asked for."""
    direction, families = largest_direction(found), found.table.families
    first = [] if families is None else [families.key]
    head = [*first, parameter_label(found)]
    head += [f"{directions(found)[direction]} amplitude, mm", "full model, mm", "difference, %"]
    head += ["full periods", "run time, s"]
    listed = [
        [
            *([] if families is None else [curve.value]),
            f"{point.parameter:.6g}",
            f"{1e3 * float(point.reduced_amplitude[:, direction].max()):.7g}",
            f"{1e3 * float(point.amplitude[:, direction].max()):.7g}",
            f"{100.0 * point.error:.2g}",
            point.periods,
            f"{point.seconds:.3g}",
        ]
        for curve in found.curves
        for point in curve.full
    ]
    return [head, *listed] if listed else []


def run_table(found: Response) -> list[list[Any]]:
    """The points, the marched periods and the run time of each curve, the head first."""
    families = found.table.families
    head = ["points", "unstable", "marched periods", "with derivatives", "run time, s"]
    head += ["ms per marched period"]
    lines = []
    for curve in found.curves:
        marched, derived = curve.marches
        unstable = sum(not point.stable for point in curve.points)
        line: list[Any] = [len(curve.points), unstable, marched, derived, curve.seconds]
        line.append(1e3 * curve.seconds / marched if marched else None)
        lines.append([*([] if families is None else [curve.value]), *line])
    return [[*([] if families is None else [with_unit(found, families.key)]), *head], *lines]


def trust_table(found: Response) -> list[list[Any]]:
    """The estimated errors at the selected points of all curves, the head first."""
    families = found.table.families

    def percent(error: float | None) -> float | None:
        return None if error is None else 100.0 * error

    head = ["point", parameter_label(found), "of the"]
    head += ["change by half the time step, %", "change by a richer basis, %"]
    lines = [
        [
            *([] if families is None else [curve.value]),
            check.where,
            f"{check.point.parameter:.7g}",
            check.quantity,
            percent(check.step_error),
            percent(check.basis_error),
        ]
        for curve in found.curves
        for check in curve.checks
    ]
    return [[*([] if families is None else [with_unit(found, families.key)]), *head], *lines]


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


def _pictures(found: Response) -> dict[str, tuple[str, Callable[[Response], Figure]]]:
    """The headings and drawing functions of the pictures by their files."""
    listed: dict[str, tuple[str, Callable[[Response], Figure]]] = {
        "response.png": ("Response curves", figure),
        "contact_map.png": ("Contact states over the period", contact_map),
        "multipliers.png": ("Floquet multipliers", multiplier_figure),
        "harmonics.png": ("Harmonics", harmonics_figure),
    }
    if not found.contacts:
        del listed["contact_map.png"]
    return listed


def write_pictures(found: Response, folder: Path) -> list[tuple[str, Path]]:
    """Draw the pictures; one that fails becomes a warning. Give their headings and files.

    Raises:
        OSError: a file cannot be written.
    """
    listed = _pictures(found) if found.scene.output.pictures else {}
    if sentence := not_drawn(list(listed)):
        found.warnings.append(sentence)
        return []
    written = []
    for name, (heading, draw) in listed.items():
        try:
            drawn = draw(found)
        except Exception as error:  # the numbers are written: a picture must not end the run
            found.warnings.append(f"{name} was not drawn: {type(error).__name__}: {error}")
            continue
        written.append((heading, write_figure(folder / name, drawn)))
    return written


def write_page(found: Response, pictures: list[tuple[str, Path]], folder: Path) -> Path:
    """Write `report.html`.

    Raises:
        OSError: the file cannot be written.
    """
    table, full = bifurcation_table(found), full_table(found)
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(found), *map("Warning: {}".format, found.warnings)]),
        *((heading, [path]) for heading, path in pictures),
        *([("Special points", [table])] if table else []),
        *([("Full model", [full])] if full else []),
        ("Estimated errors", [trust_table(found)]),
        ("Effort", [run_table(found)]),
    ]
    title = f"{found.scene.title or found.scene.source}: response curves"
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


def terminal(found: Response) -> str:
    """The tables of bifurcations and of the full model and the sentences, for the terminal."""
    tables = [table for table in (bifurcation_table(found), full_table(found)) if table]
    parts = [*map(text_table, tables), "\n".join(sentences(found))]
    return "\n\n".join(parts)
