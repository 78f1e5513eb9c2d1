"""The numbers of response curves: rows of `response.csv` and contents of `response.json`."""

from typing import Any

import numpy as np

from fenicsrom.assess.curves.response_results import (
    FullPoint,
    Response,
    ResponseCurve,
    judged_multiplier,
)
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.post.base.tables import named
from fenicsrom.post.curves.peak_tables import optimum_summary
from fenicsrom.post.curves.response_figures import (
    contact_columns,
    directions,
    largest_component,
    largest_point,
)
from fenicsrom.scene.reading.units import column_name


def rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response.csv`: every point and event in the order along its curve."""
    families, component = found.table.families, largest_component(found)
    return [
        ({} if families is None else {column_name(found.scene, families.key): curve.value})
        | {"piece": number}
        | _row(found, point, component)
        for curve in found.curves
        for number, piece in enumerate(curve.pieces, 1)
        for point in piece.in_order()
    ]


def _row(found: Response, point: CurvePoint, component: tuple[int, int]) -> dict[str, Any]:
    """One point as a row. Of several contact points, amplitudes and force are the largest.

    Harmonics and phase are those of the contact point and direction of `component`; the harmonics
    are multiples of the lowest frequency of the loads.
    """
    multiplier = judged_multiplier(point)
    main = point.harmonics[:, component[0], component[1]]
    return {
        column_name(found.scene, found.table.parameter): point.parameter,
        **named("amplitude_{}_m", directions(found), point.amplitude.max(axis=0)),
        **named("probe_amplitude_{}_m", "xyz", point.probe_amplitude),
        "phase_deg": float(np.degrees(np.angle(main[0]))),
        **{f"harmonic_{k}_m": float(abs(value)) for k, value in enumerate(main, 1)},
        **(contact_columns(point) if found.contacts else {}),
        "damping_dissipation_per_period_J": point.damping_dissipation,
        "stability": point.verdict,
        "event": point.kind,
        "contact_point": None if point.contact < 0 else point.contact + 1,
        "periods": point.periods,
        "largest_multiplier": abs(multiplier),
        "multiplier_real": multiplier.real,
        "multiplier_imaginary": multiplier.imag,
        "free_sliders": point.free_sliders,
        "residual": point.residual,
        "marched_periods": point.marches[0],
        "marched_periods_with_derivatives": point.marches[1],
    }


def summary(found: Response) -> dict[str, Any]:
    """What `response.json` has of the curves."""
    table = found.table
    return {
        "parameter": table.parameter,
        "first": table.first,
        "last": table.last,
        "family": table.families.key if table.families else None,
        "coordinates": found.size,
        "steps_per_period": found.steps,
        "curves": [_curve_summary(found, curve) for curve in found.curves],
    }


def _curve_summary(found: Response, curve: ResponseCurve) -> dict[str, Any]:
    """The part of `response.json` about one curve."""
    component = largest_component(found)
    return {
        "value": curve.value,
        "points": len(curve.points),
        "ends": [piece.reason for piece in curve.pieces],
        "largest": _row(found, largest_point(found, curve), component),
        "events": [_row(found, point, component) for point in curve.special],
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
                "stability": check.point.verdict,
                "compared_with_a_richer_basis": check.compared,
                "stability_with_half_the_step": check.finer_verdict,
                "stability_with_a_richer_basis": check.richer_verdict,
            }
            for check in curve.checks
        ],
        "marched_periods": curve.marches[0],
        "marched_periods_with_derivatives": curve.marches[1],
        "seconds": curve.seconds,
        "optimum": optimum_summary(found, curve),
        "full_model": [_full_row(found, point) for point in curve.full],
    }


def _full_row(found: Response, point: FullPoint) -> dict[str, Any]:
    """One row that compares a motion of the full model with that of the reduced model."""
    names = directions(found)
    return {
        found.table.parameter: point.parameter,
        **named("full_amplitude_{}_m", names, point.amplitude.max(axis=0)),
        **named("reduced_amplitude_{}_m", names, point.reduced_amplitude.max(axis=0)),
        "relative_error": point.error,
        "stability_of_the_reduced_motion": point.verdict,
        "full_periods": point.periods,
        "full_periods_with_derivatives": point.derived,
        "residual": point.residual,
        "seconds": point.seconds,
    }


def full_rows(found: Response) -> list[dict[str, Any]]:
    """The rows of `response_full.csv`: the motions of the full model."""
    families = found.table.families
    return [
        ({} if families is None else {families.key: curve.value}) | _full_row(found, point)
        for curve in found.curves
        for point in curve.full
    ]
