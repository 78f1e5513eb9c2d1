"""Figure 4 of the paper: response curves at four preloads."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
from paper_cases import Table, body, scene

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.checks import add_full_points
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.results import Response
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.plot import Item, Line, Panel, Plot
from fenicsrom.post.curves.response_figures import (
    FULL_MARKER,
    colour_of,
    curve_items,
    legend_samples,
)
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce

PRELOADS = (0, 40, 60, 250)
LOW, HIGH = (2.6, 3.8), (7.0, 9.0)  # Hz: first, last
RANGES = {0: LOW, 40: LOW, 60: LOW, 250: HIGH}
FULL_POINTS = {0: (3.0, 3.28), 40: (3.2, 3.28), 60: (3.2, 3.3), 250: (7.8, 8.1)}


@functools.cache
def reduced_solid() -> tuple[StoredModel, Array]:
    """The reduced model of the solid (Rubin, three normal modes, MMI-NLS), and its basis."""
    of = scene("slip_liftoff")
    solid = body("solid", of)
    modes = component_modes(solid, replace(of.basis, method="rubin"))
    selection = choose(solid, of, modes)
    derivatives = differentiate(solid, of.basis, modes, selection.derivatives)
    basis = enrich(solid, modes, selection, derivatives)
    model = reduce(solid, of.basis, basis)
    stored = StoredModel(
        model, of, basis.method, basis.labels, solid.free, modes.frequencies_hz, {}
    )
    return stored, basis.vectors


def at_preload(preload: int) -> StoredModel:
    """The reduced model at a preload; without preload the wall is out of reach."""
    low, high = RANGES[preload]
    overrides = [
        f"contacts.0.preload={preload:.1f}",
        f"contacts.0.gap={0.0 if preload else 1.0}",
        f"response.first={low}",
        f"response.last={high}",
        f"response.full={list(FULL_POINTS[preload])}",
    ]
    return reduced_solid()[0].with_overrides(overrides)


@functools.cache
def curve_at(preload: int) -> Response:
    """The response curve at a preload with some points of the full model."""
    stored = at_preload(preload)
    found = response(stored)
    found.curves = [replace(curve, value=float(preload)) for curve in found.curves]
    add_full_points(found, stored, body("solid", stored.scene), reduced_solid()[1])
    return found


def response_table() -> Table:
    """Resonances of fig. 4, unstable points, and the error of the basis at full-model points."""
    found: Table = [
        ["preload N", "resonance Hz", "mm", "points", "unstable", "full model: Hz, off by %"]
    ]
    for preload in PRELOADS:
        curve = curve_at(preload).curves[0]
        peak = max(curve.points, key=lambda point: point.amplitude.max())
        off = ", ".join(f"{full.parameter:g}: {100 * full.error:.2g}" for full in curve.full)
        found.append(
            [
                preload,
                f"{peak.parameter:.3f}",
                f"{1e3 * peak.amplitude.max():.2f}",
                len(curve.points),
                sum(not point.stable for point in curve.points),
                off,
            ]
        )
    return found


def response_figure() -> Plot:
    """Fig. 4."""
    families = f'response.families={{key="contacts.0.preload", values={list(PRELOADS)}}}'
    of = scene("slip_liftoff", f"response.first={LOW[0]}", f"response.last={HIGH[1]}", families)
    curves = [curve for preload in PRELOADS for curve in curve_at(preload).curves]
    found = replace(curve_at(PRELOADS[0]), scene=of, curves=curves)

    def across(points: list[CurvePoint]) -> Array:
        return np.array([1e3 * point.amplitude[0, 1] for point in points])

    items: list[list[Item]] = [[], []]
    for preload, curve in zip(PRELOADS, curves, strict=True):
        x = [full.parameter for full in curve.full]
        y = [1e3 * full.amplitude[0, 1] for full in curve.full]
        full = Line(x, y, "", colour_of(found, curve), marker=FULL_MARKER, zorder=5.0)
        items[int(preload == 250)] += [*curve_items(found, [curve], across), full]
    panels = [
        Panel(part, xlabel="frequency, Hz", ylabel=label)
        for part, label in zip(items, ("tip amplitude, mm", ""), strict=True)
    ]
    return Plot(panels, 9.6, 4.8, columns=2, legend=legend_samples(found))
