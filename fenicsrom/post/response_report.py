"""The report of response curves: sentences, tables and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.response import Response, ResponseCurve, judged_multiplier
from fenicsrom.online.archive import provenance
from fenicsrom.online.curve import CurvePoint
from fenicsrom.online.measures import STATE_NAMES
from fenicsrom.post.html_page import write_report
from fenicsrom.post.response_figures import (
    directions,
    figure,
    in_order,
    largest_direction,
    parameter_label,
)
from fenicsrom.post.tables import text_table
from fenicsrom.post.writers import write_figure, write_rows, write_summary


def rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response.csv`: every point and bifurcation in the order along its curve."""
    families = found.table.families
    return [
        ({} if families is None else {families.key: curve.value})
        | {"piece": number}
        | _row(found, point)
        for curve in found.curves
        for number, piece in enumerate(curve.pieces, 1)
        for point in in_order(piece)
    ]


def _row(found: Response, point: CurvePoint) -> dict[str, Any]:
    """One point as a row: amplitudes and force are the largest of all contact points."""
    multiplier = judged_multiplier(point)
    amplitudes = zip(directions(found), point.amplitude.max(axis=0), strict=True)
    contact = {
        "peak_normal_force_N": float(point.peak_force.max(initial=0.0)),
        "dissipated_per_period_J": point.friction_dissipation,
        "contact_states": " ".join(_states(point)),
    }
    return {
        found.table.parameter: point.parameter,
        **{f"amplitude_{name.replace(' ', '_')}_m": float(a) for name, a in amplitudes},
        **(contact if found.contacts else {}),
        "stability": point.verdict,
        "bifurcation": point.kind,
        "multiplier_size": abs(multiplier),
        "multiplier_real": multiplier.real,
        "multiplier_imaginary": multiplier.imag,
        "residual": point.residual,
    }


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
    return {
        "value": curve.value,
        "points": len(curve.points),
        "ends": [piece.reason for piece in curve.pieces],
        "largest": _row(found, _largest(found, curve)),
        "bifurcations": [_row(found, point) for point in curve.special],
        "step_error": curve.step_error,
        "marched_periods": curve.marches[0],
        "marched_periods_with_derivatives": curve.marches[1],
        "seconds": curve.seconds,
    }


def _largest(found: Response, curve: ResponseCurve) -> CurvePoint:
    """The point of the largest amplitude of a curve."""
    direction = largest_direction(found)
    return max(curve.points, key=lambda point: float(point.amplitude[:, direction].max()))


def sentences(found: Response) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    families, name = found.table.families, directions(found)[largest_direction(found)]
    lines = []
    for curve in found.curves:
        top, points = _largest(found, curve), curve.points
        amplitude = 1e3 * float(top.amplitude[:, largest_direction(found)].max())
        begin = "" if families is None else f"{families.key} = {curve.value:g}: "
        unstable = sum(not point.stable for point in points)
        lines.append(
            f"{begin}{len(points)} points in {curve.seconds:.1f} s; largest {name} amplitude "
            f"{amplitude:.5g} mm at {found.table.parameter} = {top.parameter:.6g}, {_verdict(top)}."
        )
        lines += [f"{begin}{unstable} points are unstable."] if unstable else []
        if curve.step_error is not None:
            lines.append(
                f"{begin}Half the time step changes this amplitude by "
                f"{100.0 * curve.step_error:.2g} %."
            )
        ends = {piece.reason for piece in curve.pieces} - {"end of the range"}
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
            point.kind,
            f"{point.parameter:.7g}",
            f"{1e3 * float(point.amplitude[:, direction].max()):.5g}",
        ]
        for curve in found.curves
        for point in curve.special
    ]
    return [head, *listed] if listed else []


def write(found: Response, folder: Path) -> list[Path]:
    """Write `response.csv`, `response.json`, `response.png` and `report.html`.

    Returns:
        The files, the one to open first at the head.

    Raises:
        OSError: a file cannot be written.
    """
    write_rows(folder / "response.csv", rows(found))
    write_summary(folder / "response.json", summary(found))
    pictures = []
    if found.scene.output.pictures:
        pictures = [write_figure(folder / "response.png", figure(found))]
    table = bifurcation_table(found)
    sections: list[tuple[str, list[Any]]] = [
        ("What was found", [*sentences(found), *map("Warning: {}".format, found.warnings)]),
        *(("Response curves", [path]) for path in pictures),
        *([("Bifurcations", [table])] if table else []),
    ]
    title = f"{found.scene.title or found.scene.source}: response curves"
    write_report(folder / "report.html", title, sections)
    return [folder / "report.html", folder / "response.json", folder / "response.csv", *pictures]


def terminal(found: Response) -> str:
    """The table of bifurcations and the sentences, for the terminal."""
    table = bifurcation_table(found)
    parts = [*([text_table(table)] if table else []), "\n".join(sentences(found))]
    return "\n\n".join(parts)
