"""The tables of the paper, and tables with the numbers that its figures show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from paper_cases import BODIES, LINEAR, Table, body, error, full, millimetres, scene, tried

from fenicsrom.assess.errors.agreement import motion_errors
from fenicsrom.online.motion import measures
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import build_basis, project_intrusively
from fenicsrom.reduction.derivatives import all_pairs
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import differentiate


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
    """Tabulate errors and sizes of MMI and MMI-NLS selections by every other number of modes."""
    head = [
        f"{kind}, {method}: MMI, MMI-NLS"
        for kind in BODIES
        for method in ("Rubin", "Craig–Bampton")
    ]
    found: Table = [["normal modes", *head]]
    for count in modes[::2]:
        line: list[Any] = [count]
        for kind in BODIES:
            for method in ("rubin", "craig-bampton"):
                chosen = {
                    o.combination.derivatives: o
                    for o in tried(kind, name, f"compare.modes={list(modes)}")
                    if (o.combination.method, o.combination.modes) == (method, count)
                }
                line.append(", ".join(error(chosen[way]) for way in ("mmi", "mmi-nls")))
        found.append(line)
    return found


def plain_table(name: str, modes: Sequence[int]) -> Table:
    """Errors and sizes without derivatives, for the least and the largest number of modes."""
    found: Table = [
        ["normal modes", *(f"{kind}, {m}" for kind in BODIES for m in ("Rubin", "Craig–Bampton"))]
    ]
    for count in (modes[0], modes[-1]):
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
    """Compare MMI with MMI-NLS by threshold, Rubin's method with five modes under 333.3 N.

    The last column lists the derivatives that only MMI-NLS keeps.
    """
    head = [f"{kind}: {what}" for kind in BODIES for what in ("MMI", "MMI-NLS", "in MMI-NLS alone")]
    found: Table = [["threshold", *head]]
    only = ("compare.modes=[5]", 'compare.methods=["rubin"]')
    for threshold in (1e-4, 1e-5, 1e-6):
        line: list[Any] = [f"{threshold:.0e}"]
        for kind in BODIES:
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
        basis = build_basis(beam, modes, block, ["1V", *names])
        motion = simulate(project_intrusively(beam, basis), of)
        wrong = motion_errors(motion, full("beam", "high_load"))["amplitude_tangential"]
        found.append([name, basis.size, f"{wrong:.2g}"])
    return found


def state_table() -> Table:
    """Contact over a period: figs. 5 to 7, 12 and 13."""
    found: Table = [["case, solid", "open %", "slip %", "stick %", "peak N", "J a period"]]
    for label, name, overrides in (
        ("40 N (figs. 5, 6)", "slip_liftoff", ()),
        ("40 N, linear (fig. 7)", "slip_liftoff", (LINEAR,)),
        ("250 N (figs. 12, 13)", "stick_slip", ()),
    ):
        motion = full("solid", name, *overrides)
        shares = [f"{100 * share:.1f}" for share in measures.contact_fractions(motion).values()]
        energy = measures.friction_dissipation_per_period(motion)
        found.append([label, *shares, f"{measures.peak_normal_force(motion):.1f}", f"{energy:.4g}"])
    return found
