"""Figure 4 of the paper: response curves at four preloads, and what they cost beside marching."""

from __future__ import annotations

import functools
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from paper_cases import Table, body, scene

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.checks import add_full_points
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.results import Response, judged_multiplier
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.post.base.style import new_figure, styled
from fenicsrom.post.curves.response_figures import (
    FULL_MARKER,
    INK,
    colour_of,
    draw_curves,
    legend_handles,
)
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce

MARCHED_MARKER = "+"
PRELOADS = (0, 40, 60, 250)
LOW, HIGH = (2.6, 3.8, 0.02), (7.0, 9.0, 0.05)  # Hz: first, last, step of a marched sweep
RANGES = {0: LOW, 40: LOW, 60: LOW, 250: HIGH}
FULL_POINTS = {0: (3.0, 3.28), 40: (3.2, 3.28), 60: (3.2, 3.3), 250: (7.8, 8.1)}
MARCHED = {0: (3.0, 3.24), 40: (3.0, 3.22), 60: (3.0, 3.2), 250: (7.4, 7.8)}
MARCHED_WITHIN = 1e-6  # distance from the steady state, relative to the size of the motion
MOST_PERIODS = 6_000  # to march; a multiplier of 0.9998 reduces a distance by 70 % in as many


@dataclass(frozen=True)
class Marched:
    """A motion that was marched to its steady state, beside the point of the curve.

    Attributes:
        frequency: Hz.
        amplitude: across the beam, mm.
        difference: of the amplitudes of the curve, relative to the largest.
        periods: number of marched periods.
        needed: number of them after which the amplitudes stay within `MARCHED_WITHIN` of the curve.
        seconds: CPU time.
        settled: whether the bound of the remaining distance fell below `MARCHED_WITHIN`.
    """

    frequency: float
    amplitude: float
    difference: float
    periods: int
    needed: int
    seconds: float
    settled: bool


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
    # a few points of a curve and a marched run load all compiled code before a clock starts
    few = stored.with_overrides(["response.first=3.0", "response.last=3.1", "response.points=3"])
    response(few)
    stored.with_overrides(['time.steady="march"', "time.periods=2"]).simulate()
    return stored, basis.vectors


def at_preload(preload: int) -> StoredModel:
    """The reduced model at a preload; without preload the wall is out of reach."""
    low, high, _ = RANGES[preload]
    overrides = [
        f"contacts.0.preload={preload:.1f}",
        f"contacts.0.gap={0.0 if preload else 1.0}",
        f"response.first={low}",
        f"response.last={high}",
        f"response.full={list(FULL_POINTS[preload])}",
    ]
    return reduced_solid()[0].with_overrides(overrides)


@functools.cache
def curve_at(preload: int) -> tuple[Response, float]:
    """The response curve at a preload with some points of the full model, and its CPU time, s."""
    stored = at_preload(preload)
    begin = clock.process_time()
    found = response(stored)
    seconds = clock.process_time() - begin
    found.curves = [replace(curve, value=float(preload)) for curve in found.curves]
    print(
        f"curve at {preload} N: {len(found.curves[0].points)} points, {seconds:.1f} s", flush=True
    )
    add_full_points(found, stored, body("solid", stored.scene), reduced_solid()[1])
    return found, seconds


@functools.cache
def marched_at(preload: int) -> tuple[Marched, ...]:
    """March to the steady state at points of the curve, as a sweep up and a sweep down do.

    Each run starts from the periodic motion at the previous frequency of the sweep. Near a steady
    state the distance from it is at most the change in a period divided by 1 - |multiplier|, with
    the largest Floquet multiplier.
    """
    stored, step = at_preload(preload), RANGES[preload][2]
    points = [point for point in curve_at(preload)[0].curves[0].points if point.stable]
    runs = []
    for wanted in MARCHED[preload]:
        point = min(points, key=lambda point: abs(point.parameter - wanted))
        loss = 1.0 - abs(judged_multiplier(point))
        run = stored.with_overrides(
            [
                f"loads.0.frequency={point.parameter!r}",
                'time.steady="march"',
                f"time.steady_tolerance={MARCHED_WITHIN * loss!r}",
                f"time.periods={MOST_PERIODS}",
            ]
        )
        for way in (-step, step):
            before = stored.with_overrides([f"loads.0.frequency={point.parameter + way!r}"])
            start = before.simulate()
            begin = clock.process_time()
            motion = run.simulate(start=start)
            seconds = clock.process_time() - begin
            tips = amplitudes_by_period(motion)
            apart = np.max(np.abs(tips - point.amplitude[0]), axis=1) / point.amplitude.max()
            runs.append(
                Marched(
                    frequency=point.parameter,
                    amplitude=1e3 * float(tips[-1].max()),
                    difference=float(apart[-1]),
                    periods=motion.periods,
                    needed=int(np.max(np.flatnonzero(apart > MARCHED_WITHIN), initial=-1)) + 2,
                    seconds=seconds,
                    settled=motion.steady,
                )
            )
            print(f"marched at {preload} N, multiplier {1.0 - loss:.6f}: {runs[-1]}", flush=True)
    return tuple(runs)


def amplitudes_by_period(motion: Motion) -> Array:
    """(periods, d) half of peak-to-peak of the tip in each period of a motion, m."""
    assert motion.period is not None
    ends = np.arange(1, motion.periods) * motion.period * (1.0 + 1e-9)
    starts = np.concatenate([[0], np.searchsorted(motion.time, ends)])
    tip = motion.displacement[:, 0]
    return np.asarray((np.maximum.reduceat(tip, starts) - np.minimum.reduceat(tip, starts)) / 2.0)


def response_table() -> Table:
    """Resonances of fig. 4, unstable points, and the error of the basis at full-model points."""
    found: Table = [
        ["preload N", "resonance Hz", "mm", "points", "unstable", "full model: Hz, off by %"]
    ]
    for preload in PRELOADS:
        curve = curve_at(preload)[0].curves[0]
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


def marching_table() -> Table:
    """Run times of the curves of fig. 4 and of sweeps that march, and how well they agree."""
    found: Table = [
        [
            "preload N",
            "curve, s",
            "marched runs: settled",
            "periods",
            "two sweeps, s",
            "ratio",
            "periods to 1e-6",
            "two sweeps to 1e-6, s",
            "ratio to 1e-6",
            "largest difference",
        ]
    ]
    total = np.zeros(3)
    for preload in PRELOADS:
        low, high, step = RANGES[preload]
        runs, seconds = marched_at(preload), curve_at(preload)[1]
        settled = [run for run in runs if run.settled]
        count = 2 * (round((high - low) / step) + 1)  # of the runs of a sweep up and a sweep down
        safe = count * float(np.mean([run.seconds for run in runs]))
        least = count * float(np.mean([run.seconds * run.needed / run.periods for run in runs]))
        total += seconds, safe, least
        found.append(
            [
                preload,
                f"{seconds:.1f}",
                f"{len(runs)}: {len(settled)}",
                span([run.periods for run in runs]),
                f"{safe:.0f}",
                f"{safe / seconds:.0f}",
                span([run.needed for run in runs]),
                f"{least:.1f}",
                f"{least / seconds:.1f}",
                f"{max(run.difference for run in settled):.0e}" if settled else "–",
            ]
        )
    curves, safe, least = total
    ratios = f"{safe / curves:.0f}", f"{least / curves:.1f}"
    found.append(
        [
            "all",
            f"{curves:.1f}",
            "",
            "",
            f"{safe:.0f}",
            ratios[0],
            "",
            f"{least:.1f}",
            ratios[1],
            "",
        ]
    )
    return found


def span(numbers: Sequence[int]) -> str:
    """The smallest and the largest of some numbers."""
    return f"{min(numbers)} to {max(numbers)}"


@styled
def response_figure() -> Any:
    """Fig. 4."""
    families = f'response.families={{key="contacts.0.preload", values={list(PRELOADS)}}}'
    of = scene("slip_liftoff", f"response.first={LOW[0]}", f"response.last={HIGH[1]}", families)
    curves = [curve for preload in PRELOADS for curve in curve_at(preload)[0].curves]
    found = replace(curve_at(PRELOADS[0])[0], scene=of, curves=curves)

    def across(points: list[CurvePoint]) -> Array:
        return np.array([1e3 * point.amplitude[0, 1] for point in points])

    figure = new_figure(9.6, 4.8)
    axes = figure.subplots(1, 2, width_ratios=[3, 2])
    for preload, curve in zip(PRELOADS, curves, strict=True):
        axis, colour = axes[int(preload == 250)], colour_of(found, curve)
        draw_curves(axis, found, [curve], across)
        axis.plot(
            [full.parameter for full in curve.full],
            [1e3 * full.amplitude[0, 1] for full in curve.full],
            FULL_MARKER,
            color=colour,
            zorder=5,
        )
        settled = [run for run in marched_at(preload) if run.settled]
        axis.plot(
            [run.frequency for run in settled],
            [run.amplitude for run in settled],
            MARCHED_MARKER,
            color=colour,
            zorder=5,
        )
    for axis in axes:
        axis.set_xlabel("frequency, Hz")
    axes[0].set_ylabel("tip amplitude, mm")
    marched = Line2D([], [], linestyle="", color=INK, marker=MARCHED_MARKER, label="marched")
    figure.legend(handles=[*legend_handles(found), marched], loc="outside upper center", ncols=4)
    return figure
