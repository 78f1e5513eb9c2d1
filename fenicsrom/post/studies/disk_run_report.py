"""The report of a disk in time: tables, picture and files."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.verdicts import contact_quantities, in_percent
from fenicsrom.assess.rotation.disk_run import DiskRun
from fenicsrom.notes import AMPLITUDES, FREQUENCIES
from fenicsrom.online.motion.measures import (
    contact_fractions,
    friction_dissipation_per_period,
    peak_normal_force,
    point_summaries,
)
from fenicsrom.post.base.page import Report, Section
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Bars, Map, Panel, Plot
from fenicsrom.post.base.tables import Quantity, rows_of, table_of
from fenicsrom.post.body.body_figures import deflection_figure
from fenicsrom.post.body.body_view import largest_of, view_of
from fenicsrom.post.paraview.disk_motion import moved_disk
from fenicsrom.post.run.summary import (
    RECOVERY_NOTE,
    STRESSES_FILE,
    estimates_summary,
    stress_rows,
    stress_table,
)
from fenicsrom.words import counted, enumerated

NO_REACTIONS = "The reactions of the supports of a disk are not found."

LEAST = 1e-4
"""Smaller shares of a nodal diameter are not in the table."""

SECTORS = (
    Quantity("sector", "sector", "sector"),
    Quantity("amplitude_m", "amplitude", "amplitude, mm"),
    Quantity("mistuning", "mistuning", "change of stiffness, %", 3),
)
CONTACTS = (
    Quantity("contact", "contact", "contact"),
    Quantity("sector", "sector", "sector"),
    *(Quantity(name, name, f"{name}, %", 3) for name in ("open", "slip", "stick")),
    Quantity("peak_normal_force_N", "peak", "largest normal force of a point, N", 4),
    Quantity("friction_dissipation_per_period_J", "loss", "friction, J per period", 4),
)
BETWEEN = "Sector j has its contacts with sector j + 1."
DIAMETERS = (
    Quantity("nodal_diameter", "diameter", "nodal diameter"),
    Quantity("share", "share", "share of the motion, %"),
)


def sectors(found: DiskRun) -> list[dict[str, float]]:
    """A row for each sector."""
    pairs = enumerate(zip(found.peaks, found.mistuning, strict=True))
    return [
        {"sector": j, "amplitude": float(a), "mistuning": float(delta)} for j, (a, delta) in pairs
    ]


def contacts(found: DiskRun) -> list[dict[str, float]]:
    """A row for each contact of the scene in each sector."""
    points = point_summaries(found.motion)
    of = found.model.points.contact.reshape(found.mistuning.size, -1)
    rows = []
    for k, (j, each) in itertools.product(range(len(found.scene.contacts)), enumerate(of)):
        mine = [points[j * each.size + p] for p in np.flatnonzero(each == k)]
        shares = {s: np.mean([one["fraction"][s] for one in mine]) for s in mine[0]["fraction"]}
        peak = max(one["peak_normal_force_N"] for one in mine)
        loss = sum(one["friction_dissipation_per_period_J"] for one in mine)
        rows.append({"contact": k, "sector": j, **shares, "peak": peak, "loss": loss})
    return rows


def diameters(found: DiskRun) -> list[dict[str, float]]:
    """A row for each nodal diameter."""
    pairs = enumerate(map(float, found.shares))
    return [{"diameter": h, "share": share} for h, share in pairs]


def sentences(found: DiskRun) -> list[str]:
    """The results in sentences, for the terminal and the report."""
    motion, peaks, shares, sector = found.motion, found.peaks, found.shares, found.disk.sector
    j, h = int(np.argmax(peaks)), int(np.argmax(shares))
    checked, error = found.disk.wave_error
    span = f"{counted(motion.periods, 'period')}" if motion.period else f"{motion.time[-1]:.4g} s"
    lines = [
        f"The mesh is {found.disk.sentence}.",
        f"{counted(found.model.mass.shape[0], 'coordinate')}, {sector.shapes} shapes of each cut "
        f"face; {counted(motion.steps, 'step')} of {span} in {motion.seconds:.1f} s. The reduction "
        f"changes frequencies of waves with {counted(checked, 'nodal diameter')}, which have "
        f"{100.0 * shares[checked]:.2g} % of the motion, by {100.0 * error:.2g} %.",
        f"The largest amplitude of a probe along {'xyz'[found.direction]} of its sector is "
        f"{1e3 * peaks[j]:.5g} mm, in sector {j}, the smallest {1e3 * peaks.min():.5g} mm; "
        f"{100.0 * shares[h]:.3g} % of the motion is in waves with {counted(h, 'nodal diameter')}.",
    ]
    if found.amplification is not None:
        lines.append(
            f"The largest amplitude is {found.amplification:.4g} times that of the tuned disk."
        )
    if found.scene.contacts:
        parts = {name: f"{100.0 * part:.3g} %" for name, part in contact_fractions(motion).items()}
        lines.append(
            f"Friction dissipates {friction_dissipation_per_period(motion):.4g} J per period in "
            f"all sectors together. On average a contact point is open for {parts['open']} of the "
            f"time, slips for {parts['slip']} and sticks for {parts['stick']}. The largest normal "
            f"force of a point is {peak_normal_force(motion):.4g} N."
        )
    joined = found.scene.joined
    worst = {cause: each.deciding(joined) for cause, each in found.errors.items()}
    known = [f"{in_percent(size)} by the {c}" for c, size in worst.items() if np.isfinite(size)]
    if known:
        walls = bool(found.scene.contacts) and not joined
        where = "contact points, of the worst direction" if walls else "probe of sector 0"
        lines.append(f"Estimated errors of the amplitudes of the {where}: {enumerated(known)}.")
    if found.peaks_of_stress:
        peak = max(found.peaks_of_stress, key=lambda each: each.von_mises)
        lines.append(
            f"The largest von Mises stress is {1e-6 * peak.von_mises:.4g} MPa, in {peak.state}."
        )
    return lines


def shape_of(found: DiskRun) -> Plot:
    """The disk at the instant at which a probe moves most."""
    name = "displacement"
    disk = moved_disk(found, name)
    view = view_of(disk, moved=largest_of(np.asarray(disk.point_data[name])))
    return deflection_figure(disk, name, "largest displacement of a probe", view)


def report(found: DiskRun) -> Report:
    """The report of a disk in time: `disk.csv`, `diameters.csv`, `disk.json` and `disk.png`."""
    motion, told = found.motion, [row for row in diameters(found) if row["share"] >= LEAST]
    by_sector = SECTORS if found.mistuning.any() else SECTORS[:2]
    touching, moved = bool(found.scene.contacts), [AMPLITUDES, *contact_quantities(found.scene)]
    summary = {
        "sectors": found.mistuning.size,
        "coordinates": found.model.mass.shape[0],
        "shapes_of_a_cut_face": found.disk.sector.shapes,
        "checked_nodal_diameter": found.disk.wave_error[0],
        "relative_frequency_error": found.disk.wave_error[1],
        "steps": motion.steps,
        "periods": motion.periods,
        "steady": motion.steady,
        "probe_direction": "xyz"[found.direction],
        "largest_amplitude_m": float(found.peaks.max()),
        "amplification": found.amplification,
        "shares_of_diameters": found.shares.tolist(),
        "relative_energy_imbalance": motion.relative_imbalance,
        "estimated_error_percent": estimates_summary(found.errors),
    }
    if touching:
        summary["contact_fractions"] = contact_fractions(motion)
        summary["friction_dissipation_per_period_J"] = friction_dissipation_per_period(motion)
        summary["peak_normal_force_N"] = peak_normal_force(motion)
    more = {"diameters.csv": rows_of(diameters(found), DIAMETERS)}
    if found.peaks_of_stress:
        more[STRESSES_FILE] = stress_rows(found.peaks_of_stress)
    rows, items = contacts(found) if touching else [], list[Any]()
    if touching:
        more["contacts.csv"] = rows_of(rows, CONTACTS)
        items = [table_of(rows, CONTACTS), BETWEEN * bool(found.disk.sector.ahead.any())]
    shape = Picture("Disk", "shapes.png", lambda: shape_of(found), in_space=True)
    return Report(
        "disk",
        "disk in time",
        found,
        sentences(found),
        [
            Section("Amplitudes by sector", [table_of(sectors(found), by_sector)]),
            Section("Shares of nodal diameters", [table_of(told, DIAMETERS)]),
            *([Section("Contacts", items, terminal=False, keys=2)] if touching else []),
            Section(
                "Stresses at places of sector 0",
                [stress_table(found.peaks_of_stress), RECOVERY_NOTE, NO_REACTIONS]
                if found.peaks_of_stress
                else [],
                terminal=False,
            ),
        ],
        rows_of(sectors(found), SECTORS),
        summary,
        [
            Picture(
                "Motion of the disk",
                "disk.png",
                lambda: figure(found),
                f"Amplitudes{' and friction' * touching} by sector, shares of nodal diameters, and "
                "the displacements of the probes over the last period: waves are slanted stripes.",
                "disk.csv",
            ),
            *([shape] if found.disk.table is not None else []),
        ],
        more_rows=more,
        quantities=[FREQUENCIES, *(moved if found.errors else [])],
        unjudged=[
            *([] if found.errors else moved),
            *(["stresses"] if found.peaks_of_stress else []),
            "errors of the mesh",
        ],
    )


def figure(found: DiskRun) -> Plot:
    """Amplitudes by sector, shares of nodal diameters, and the waves of the last period."""
    peaks, shares = 1e3 * found.peaks, 100.0 * found.shares
    time, moved = found.motion.coordinate_time, 1e3 * found.displacement[:, :, found.direction]
    moved = (moved - moved.mean(axis=0)).T
    top = float(np.abs(moved).max(initial=0.0)) or 1.0
    title = f"along {'xyz'[found.direction]} about the mean, mm"
    sectors = np.arange(peaks.size)
    waves = Map(time, sectors, moved, cmap="RdBu_r", vmin=-top, vmax=top, bar=title)
    panels = [
        Panel([_bars(peaks)], "sector", "amplitude, mm", whole="x"),
        Panel([_bars(shares)], "nodal diameter", "share of the motion, %", whole="x"),
        Panel([waves], "time, s", "sector", tight="xy", whole="y"),
    ]
    if found.scene.contacts:
        loss = np.zeros(peaks.size)
        for row in contacts(found):
            loss[int(row["sector"])] += row["loss"]
        panels.insert(1, Panel([_bars(loss)], "sector", "friction,\nJ per period", whole="x"))
    heights = [*[1.0] * (len(panels) - 1), 1.8]
    return Plot(panels, 8.4, 2.2 * sum(heights), heights=heights)


def _bars(values: Array) -> Bars:
    """A bar for each of some values."""
    at = np.arange(values.size)
    return Bars(at - 0.4, at + 0.4, np.zeros(values.size), values)
