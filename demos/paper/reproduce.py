"""Recompute every number and curve of the paper, for the beam and for the 2D solid.

    python3 demos/paper/reproduce.py --output out/paper

The paper is Mashayekhi and Zucca, Appl. Sci. 14 (2024) 3936. The numbers printed in the paper are
constants of this script; the rest is computed. The results are the tables of README.md and
pictures. The elastic force of the beam is not a polynomial, so its reduced models are intrusive
projections. If parts are named, only these parts are made, and README.md keeps its other tables.
"""

from __future__ import annotations

import argparse
import functools
import re
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from mpi4py import MPI

from fenicsrom.arrays import Array
from fenicsrom.assess.agreement import motion_errors
from fenicsrom.assess.compare import Outcome, Workshop, compare_bases
from fenicsrom.assess.full_points import add_full_points
from fenicsrom.assess.response import response
from fenicsrom.assess.response_results import Response, judged_multiplier
from fenicsrom.fem.full import full_model
from fenicsrom.fem.mesh import build_mesh
from fenicsrom.fem.solid import solid_of
from fenicsrom.files import atomic_write
from fenicsrom.online import measures
from fenicsrom.online.archive import StoredModel
from fenicsrom.online.curve import CurvePoint
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.post import figures
from fenicsrom.post.response_figures import (
    FULL_MARKER,
    INK,
    colour_of,
    draw_curves,
    legend_handles,
)
from fenicsrom.post.style import COLOURS, line_styles, new_figure, styled
from fenicsrom.post.writers import write_figure
from fenicsrom.reduction.basis import build_basis
from fenicsrom.reduction.beam import beam_structure
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.projection import project_intrusively
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce
from fenicsrom.scene import Scene, read_scene, scene_heading

HERE = Path(__file__).parent
BODIES = ("beam", "solid")
LINEAR = "geometrically_nonlinear=false"
MARCHED_MARKER = "+"
Table = list[list[Any]]


def scene(name: str, *overrides: str) -> Scene:
    """A scene of this folder."""
    return read_scene(HERE / f"{name}.toml", overrides)


@functools.cache
def mesh() -> Any:
    """The one mesh of all scenes."""
    return build_mesh(scene("open").geometry, MPI.COMM_WORLD)


def body(kind: str, of: Scene) -> Any:
    """The beam or the solid of a scene."""
    return beam_structure(of) if kind == "beam" else solid_of(of, mesh())


@functools.cache
def full(kind: str, name: str, *overrides: str) -> Motion:
    """The motion of a full model."""
    of = scene(name, *overrides)
    print(f"full {kind}: {name} {' '.join(overrides)}", flush=True)
    return simulate(full_model(body(kind, of)), of)


@functools.cache
def tried(kind: str, name: str, *overrides: str) -> tuple[Outcome, ...]:
    """The combinations of a scene's [compare] table against the full model."""
    force = ["projection"] if kind == "beam" else ["polynomial"]
    of = scene(name, *overrides, f"compare.elastic_force={force}")
    reference = full(
        kind, name, *(o for o in overrides if not o.startswith(("compare.", "basis.")))
    )
    workshop = Workshop(body(kind, of), of, {}, max(of.compare.modes))
    return tuple(
        compare_bases(
            workshop, of, reference, lambda line: print(kind, line, flush=True), timing=False
        )
    )


def error(outcome: Outcome) -> str:
    """Give the error of the tip amplitude and (the size); a star marks an unsteady motion."""
    if outcome.motion is None:
        return "stops"
    value = outcome.errors["amplitude_tangential"]
    star = "" if outcome.motion.steady else "*"
    return f"{value:.2g}{star} ({len(outcome.labels)})" if value is not None else "–"


def millimetres(motion: Motion) -> tuple[float, float]:
    """Tip amplitudes across and along the beam, mm; a probe's first axis is x."""
    found = measures.amplitudes(motion)
    return 1e3 * found["tangential"][0], 1e3 * found["normal"]


# ---------------------------------------------------------------------- tables


def amplitude_rows(cases: Sequence[tuple[str, str, tuple[str, ...], tuple[str, str]]]) -> Table:
    """Amplitudes of the full models beside those of the paper."""
    found: Table = [["case", "paper U_y", "beam", "solid", "paper U_x", "beam", "solid"]]
    for label, name, overrides, printed in cases:
        ours = [millimetres(full(kind, name, *overrides)) for kind in BODIES]
        found.append(
            [
                label,
                printed[0],
                *(f"{o[0]:.2f}" for o in ours),
                printed[1],
                *(f"{o[1]:.3g}" for o in ours),
            ]
        )
    return found


def table_1() -> Table:
    """Tip amplitudes of linear and nonlinear models, open and at 40 N."""
    return amplitude_rows(
        [
            ("40 N, linear", "slip_liftoff", (LINEAR,), ("123.5", "0.00039")),
            ("40 N, nonlinear", "slip_liftoff", (), ("157.6", "2.835")),
            ("open, linear", "open", (LINEAR,), ("200.8", "0.0")),
            ("open, nonlinear", "open", (), ("200.5", "4.6")),
            ("200 N, 333.3 N, nonlinear (sec. 3.1)", "high_load", (), ("418", "")),
        ]
    )


def table_2() -> Table:
    """Errors of bases with given derivatives, both loads."""
    rows = [
        ("rubin", ["1V1V"], ("4.03", "42")),
        ("rubin", ["1V1V", "1V1S", "1V2S"], ("0.41", "4.2")),
        ("craig-bampton", ["1V1V"], ("7.18", "49")),
        ("craig-bampton", ["1V1V", "1V1S", "1V2S", "1S2S", "2S2S"], ("0.57", "26.3")),
    ]
    loads = [("slip_liftoff", ()), ("high_load", ("loads.0.force=333.87",))]
    found: Table = [
        ["basis, 1V and", "111.29 N: paper", "beam", "solid", "333.87 N: paper", "beam", "solid"]
    ]
    lists = [labels for _, labels, _ in rows]
    common = (
        "compare.modes=[1]",
        f"compare.derivatives={[x for k, x in enumerate(lists) if x not in lists[:k]]}",
    )
    for method, labels, printed in rows:
        line: list[Any] = [f"{method}: {' '.join(labels)}"]
        for column, (name, overrides) in enumerate(loads):
            line.append(printed[column])
            for kind in BODIES:
                outcomes = tried(kind, name, *overrides, *common)
                line += [
                    error(o)
                    for o in outcomes
                    if o.combination.method == method and o.combination.derivatives == tuple(labels)
                ]
        found.append(line)
    return found


def table_3() -> Table:
    """Tip amplitudes of linear and nonlinear models at 250 N."""
    return amplitude_rows(
        [
            ("linear", "stick_slip", (LINEAR,), ("19.73", "0.00248")),
            ("nonlinear", "stick_slip", (), ("19.618", "0.044")),
        ]
    )


def selection_table(name: str, modes: Sequence[int]) -> Table:
    """Tabulate errors and sizes of MMI and MMI-NLS selections by the number of normal modes."""
    head = [
        f"{kind}, {method}: MMI / MMI-NLS"
        for kind in BODIES
        for method in ("Rubin", "Craig–Bampton")
    ]
    found: Table = [["normal modes", *head]]
    for count in modes:
        line: list[Any] = [count]
        for kind in BODIES:
            for method in ("rubin", "craig-bampton"):
                chosen = {
                    o.combination.derivatives: o
                    for o in tried(kind, name, f"compare.modes={list(modes)}")
                    if (o.combination.method, o.combination.modes) == (method, count)
                }
                line.append(" / ".join(error(chosen[way]) for way in ("mmi", "mmi-nls")))
        found.append(line)
    return found


def plain_table(name: str, modes: Sequence[int]) -> Table:
    """Errors and sizes without derivatives."""
    found: Table = [
        ["normal modes", *(f"{kind}, {m}" for kind in BODIES for m in ("Rubin", "Craig–Bampton"))]
    ]
    for count in modes:
        line: list[Any] = [count]
        for kind in BODIES:
            outcomes = tried(
                kind, name, f"compare.modes={list(modes)}", 'compare.derivatives=["none"]'
            )
            line += [
                error(o)
                for m in ("rubin", "craig-bampton")
                for o in outcomes
                if (o.combination.method, o.combination.modes) == (m, count)
            ]
        found.append(line)
    return found


def threshold_table() -> Table:
    """Compare MMI with MMI-NLS by threshold, Rubin's method under 333.3 N.

    The last column lists the derivatives that only MMI-NLS keeps.
    """
    head = [f"{kind}: {what}" for kind in BODIES for what in ("MMI", "MMI-NLS", "in MMI-NLS alone")]
    found: Table = [["threshold", "normal modes", *head]]
    for threshold in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        for count in (3, 5):
            line: list[Any] = [f"{threshold:.0e}", count]
            for kind in BODIES:
                only = (f"compare.modes=[{count}]", 'compare.methods=["rubin"]')
                outcomes = tried(kind, "high_load", f"basis.threshold={threshold}", *only)
                by = {o.combination.derivatives: o for o in outcomes}
                alone = [label for label in by["mmi-nls"].labels if label not in by["mmi"].labels]
                line += [error(by["mmi"]), error(by["mmi-nls"]), " ".join(alone) or "–"]
            found.append(line)
    return found


def third_order_table() -> Table:
    """Show what the beam lacks under 333.3 N: one vector of third order.

    The first row has all derivatives of 1V, 1S and 2S; the second row adds the vector.
    """
    of = scene("high_load")
    beam = body("beam", of)
    modes = component_modes(beam, replace(of.basis, method="rubin", modes=1))
    labels = tuple(all_pairs(modes.labels))
    derivatives = differentiate(beam, of.basis, modes, labels)
    # the odd part of the nonlinear static deflection along the first mode, without its linear part,
    # is of third order
    force = beam.stiffness_times(modes.normal[:, :1])[:, 0] * (
        0.02 * beam.beam.length / beam.largest(modes.normal)[0]
    )
    linear = beam.factor.solve(force[:, None])[:, 0]
    third = 0.5 * (beam.static(force, linear) - beam.static(-force, -linear)) - linear
    found: Table = [["beam, Rubin, 333.3 N", "size", "error %"]]
    for name, vectors, names in (
        ("1V and all derivatives", derivatives.vectors, labels),
        (
            "the same and one vector of third order",
            np.column_stack([derivatives.vectors, third]),
            (*labels, "1V1V1V"),
        ),
    ):
        block = np.concatenate([modes.normal, vectors], axis=1)
        basis = build_basis(
            "rubin",
            modes.masters,
            modes.rows,
            block,
            ["1V", *names],
            beam.mass_inner,
            beam.comm.allreduce,
        )
        motion = simulate(project_intrusively(beam, basis), of)
        wrong = motion_errors(motion, full("beam", "high_load"))["amplitude_tangential"]
        found.append([name, basis.size, f"{wrong:.2g}"])
    return found


def state_table() -> Table:
    """Contact over a period: figs. 5 to 7, 12 and 13."""
    found: Table = [["case", "body", "open %", "slip %", "stick %", "peak N", "J a period"]]
    for label, name, overrides in (
        ("40 N (figs. 5, 6)", "slip_liftoff", ()),
        ("40 N, linear (fig. 7)", "slip_liftoff", (LINEAR,)),
        ("250 N (figs. 12, 13)", "stick_slip", ()),
    ):
        for kind in BODIES:
            motion = full(kind, name, *overrides)
            shares = [f"{100 * share:.1f}" for share in measures.contact_fractions(motion).values()]
            energy = measures.dissipated_per_period(motion)
            found.append(
                [label, kind, *shares, f"{measures.peak_normal_force(motion):.1f}", f"{energy:.4g}"]
            )
    return found


# ---------------------------------------------------------------------- the frequency response

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
    response(few, lambda _: None)
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
    found = response(stored, lambda _: None)
    seconds = clock.process_time() - begin
    found.curves = [replace(curve, value=float(preload)) for curve in found.curves]
    print(
        f"curve at {preload} N: {len(found.curves[0].points)} points, {seconds:.1f} s", flush=True
    )
    add_full_points(found, stored, body("solid", stored.scene), reduced_solid()[1], print)
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


# ---------------------------------------------------------------------- pictures


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


@styled
def deflection_figure(kind: str, name: str) -> Any:
    """Figs. 5a and 12a: the deflected beam at instants of the steady state."""
    of = scene(name)
    beam = body("beam", of)
    motion = simulate(full_model(beam), of, keep_coordinates=True)
    figure = new_figure(7.6, 3.6)
    axis = figure.subplots()
    x = np.linspace(0, beam.beam.length, beam.beam.elements + 1)[1:]
    instants = np.linspace(0, motion.coordinates.shape[0] - 1, 9).astype(int)[:-1]
    for (name, style), k in zip(
        line_styles(f"{j / 8:g} T" for j in range(8)).items(), instants, strict=True
    ):
        q = motion.coordinates[k]
        axis.plot(x + q[0::3], 1e3 * q[1::3], label=name, **style)
    axis.set(xlabel="position, m", ylabel="deflection, mm")
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


@styled
def selection_figure(parts: Sequence[tuple[str, Sequence[int], Sequence[int]]]) -> Any:
    """Draw Figs. 8, 9 and 14: error by size, with and without derivatives, for both bodies."""
    figure = new_figure(4.2 * len(parts) + 1.0, 6.4)
    axes = figure.subplots(2, len(parts), sharey=True, squeeze=False)
    colours = {"none": COLOURS[0], "mmi": COLOURS[1], "mmi-nls": COLOURS[2]}
    for column, (name, chosen, plain) in enumerate(parts):
        for row, kind in enumerate(BODIES):
            axis = axes[row][column]
            outcomes = [
                *tried(kind, name, f"compare.modes={list(chosen)}"),
                *tried(kind, name, f"compare.modes={list(plain)}", 'compare.derivatives=["none"]'),
            ]
            for way, colour in colours.items():
                for method, style in (("rubin", "o-"), ("craig-bampton", "s--")):
                    points = sorted(
                        (len(o.labels), max(o.errors["amplitude_tangential"] or 0.0, 1e-5))
                        for o in outcomes
                        if o.errors
                        and (o.combination.derivatives, o.combination.method) == (way, method)
                    )
                    if points:
                        label = f"{'Rubin' if method == 'rubin' else 'Craig–Bampton'}, {way}"
                        axis.plot(
                            *zip(*points, strict=True),
                            style,
                            color=colour,
                            markersize=4,
                            label=label,
                        )
            axis.set(yscale="log", title=f"{kind}: {scene_heading(scene(name))}")
    for axis in axes[-1]:
        axis.set_xlabel("number of coordinates")
    for axis in axes[:, 0]:
        axis.set_ylabel("error of the tip amplitude, %")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    return figure


CHOSEN, PLAIN = (1, 2, 3, 4, 5), (1, 3, 8, 14)
STICKING, STICKING_PLAIN = (1, 2, 3), (1, 3)

PARTS: dict[str, Callable[[], Table]] = {
    "table 1": table_1,
    "table 2": table_2,
    "table 3": table_3,
    "figures 5 to 7, 12, 13": state_table,
    "figure 4": response_table,
    "figure 4, marching": marching_table,
    "figure 8, left": lambda: selection_table("slip_liftoff", CHOSEN),
    "figure 8, right": lambda: selection_table("high_load", CHOSEN),
    "figure 9, left": lambda: plain_table("slip_liftoff", PLAIN),
    "figure 9, right": lambda: plain_table("high_load", PLAIN),
    "figure 14": lambda: selection_table("stick_slip", STICKING),
    "figure 14, no derivatives": lambda: plain_table("stick_slip", STICKING_PLAIN),
    "thresholds": threshold_table,
    "third order": third_order_table,
}
PICTURES: dict[str, tuple[str, Callable[[], Any]]] = {
    "figure_04": ("figure 4", response_figure),
    "figure_05": ("figures 5 to 7, 12, 13", lambda: deflection_figure("beam", "slip_liftoff")),
    "figure_05_motion": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_motion({k: full(k, "slip_liftoff") for k in BODIES}),
    ),
    "figure_06": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "slip_liftoff") for k in BODIES}),
    ),
    "figure_07": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "slip_liftoff", LINEAR) for k in BODIES}),
    ),
    "figures_08_09": (
        "figure 9, right",
        lambda: selection_figure([("slip_liftoff", CHOSEN, PLAIN), ("high_load", CHOSEN, PLAIN)]),
    ),
    "figure_12": ("figures 5 to 7, 12, 13", lambda: deflection_figure("beam", "stick_slip")),
    "figure_13": (
        "figures 5 to 7, 12, 13",
        lambda: figures.plot_contact({k: full(k, "stick_slip") for k in BODIES}),
    ),
    "figure_14": (
        "figure 14, no derivatives",
        lambda: selection_figure([("stick_slip", STICKING, STICKING_PLAIN)]),
    ),
}


def markdown(table: Table) -> str:
    """A table in Markdown."""
    lines = ["| " + " | ".join(str(value) for value in row) + " |" for row in table]
    return "\n".join([lines[0], "|" + " --- |" * len(table[0]), *lines[1:]])


def fill(readme: Path, name: str, text: str) -> None:
    """Replace the text between the markers of a part."""
    page = readme.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not pattern.search(page):
        raise ValueError(f"{readme}: no markers of {name}")
    with atomic_write(readme) as temporary:
        temporary.write_text(
            pattern.sub(lambda found: f"{found[1]}{text}\n{found[2]}", page), encoding="utf-8"
        )


def main() -> None:
    """Make the named parts, or all."""
    parser = argparse.ArgumentParser(description="Reproduce the paper's tables and figures.")
    parser.add_argument(
        "parts", nargs="*", help=f"parts to make: {', '.join(PARTS)} (default: all)"
    )
    parser.add_argument("--output", default="out/paper", help="folder of the pictures")
    options = parser.parse_args()
    wanted = options.parts or list(PARTS)
    for name in wanted:
        fill(HERE / "README.md", name, markdown(PARTS[name]()))
    for file, (part, draw) in PICTURES.items():
        if part in wanted:
            write_figure(Path(options.output) / f"{file}.png", draw())


if __name__ == "__main__":
    main()
