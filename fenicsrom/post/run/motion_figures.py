"""The table of responses, run-ups, and pictures of motions that answer one question each."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.signals import (
    energy_per_period,
    envelope,
    moving_spectrum,
    spectrum,
    stroboscopic_states,
    strongest_oscillation,
)
from fenicsrom.assess.rotation.run_up import RunUp
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import (
    NEGLIGIBLE,
    has_contact,
    point_summaries,
    response_summary,
)
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.style import (
    Figure,
    new_figure,
    new_panels,
    state_handles,
    state_map,
    styled,
)
from fenicsrom.post.base.tables import in_order, millimetres, plain_names, table_of
from fenicsrom.post.run.figures import LOADS, contact_axis, note_noise
from fenicsrom.scene import Scene

FEW_POINTS = 4  # largest number of contact points that have one picture each
PERIODS_NOTE = "Periods: the number of periods of the loads from the start of the run to its end."
SIZE_NOTE = "The size is the number of unknowns. Amplitudes are half of peak-to-peak over"
IMBALANCE_NOTE = (
    "The imbalance is the largest error of the energy balance relative to the largest energy of "
    "the motion."
)


def has_period(motions: Mapping[str, Motion]) -> bool:
    """Whether the motions have a period, which all models of a scene share."""
    return any(motion.period is not None for motion in motions.values())


def response_note(motions: Mapping[str, Motion]) -> str:
    """Explain the columns of `response_rows`."""
    if not has_period(motions):
        return f"{SIZE_NOTE} the whole motion. {IMBALANCE_NOTE}"
    return f"{SIZE_NOTE} the last period of the motion. {IMBALANCE_NOTE}"


def response_rows(
    motions: Mapping[str, Motion],
    sizes: Mapping[str, int],
    names: Sequence[str],
    probes: Mapping[str, Motion],
) -> list[list[Any]]:
    """Compose the table of responses; the first row is the header.

    Without contact there are no fractions, no force and no dissipation by friction. Without a
    period of the loads, nothing is counted in periods, and nothing becomes steady. The beam has no
    third direction.

    Args:
        motions: model name -> motion.
        sizes: model name -> number of unknowns.
        names: names of the directions.
        probes: model name -> motion of the probe, where it stands beside contact points.
    """
    repeats = has_period(motions)
    work = "J per period" if repeats else "J"
    rows = []
    for name, motion in motions.items():
        found = response_summary(motion)
        amplitudes = millimetres(in_order(found["amplitude_m"]))
        row = {"model": name, "size": sizes.get(name)}
        row |= {f"{direction} mm": None for direction in names}
        row |= {f"{direction} mm": a for direction, a in zip(names, amplitudes, strict=False)}
        if name in probes:
            moved = in_order(response_summary(probes[name])["amplitude_m"])
            texts = zip("xyz", millimetres(moved), strict=False)
            row |= {f"probe {axis} mm": text for axis, text in texts}
        contact = {
            **{f"{state} %": f"{100.0 * part:.1f}" for state, part in found["fraction"].items()},
            "peak N": f"{found['peak_normal_force_N']:.5g}",
            work: f"{found['friction_dissipation_per_period_J']:.5g}",
        }
        row |= contact if motion.force.shape[1] else dict.fromkeys(contact)
        if repeats:
            row |= {"periods": found["periods"], "steady": "yes" if found["steady"] else "no"}
        rows.append(row | {"imbalance": f"{found['energy_imbalance']:.1e}"})
    return table_of(rows)


def points_note(motions: Mapping[str, Motion], scene: Scene) -> str | None:
    """State to which contact points the numbers of the table belong; None if there is no choice."""
    touching = {name: motion for name, motion in motions.items() if has_contact(motion)}
    count = max((motion.state.shape[1] for motion in touching.values()), default=0)
    if not touching or (count < 2 and scene.probe is None):
        return None
    probe = " and of the probe" if scene.probe is not None else ""
    if count < 2:
        return f"Amplitudes are those of the contact point{probe}."
    hardest = {}
    for name, motion in touching.items():
        peaks = [point["peak_normal_force_N"] for point in point_summaries(motion)]
        if len(peaks) > 1:
            hardest[name] = 1 + int(np.argmax(peaks))
    of = {f"{point}" for point in hardest.values()}
    peak = of.pop() if len(of) == 1 else ", ".join(f"{p} ({name})" for name, p in hardest.items())
    return (
        f"Amplitudes are those of contact point 1{probe}; open, slip and stick are means over "
        f"{count} points; the peak force is that of point {peak}."
    )


def touching_points(motions: Mapping[str, Motion]) -> list[int]:
    """The numbers of the contact points that some motion presses in its last period."""
    pressed = [np.any(m.force[m.last_period(), :, 0] > 0.0, axis=0) for m in motions.values()]
    return sorted({int(point) for points in pressed for point in np.flatnonzero(points)})


def open_sentence(motions: Mapping[str, Motion]) -> str | None:
    """Name the contact points without a picture, which do not touch; None if all have a picture."""
    count = max((motion.force.shape[1] for motion in motions.values()), default=0)
    touching = touching_points(motions)
    if len(touching) == count or (touching and count > FEW_POINTS):
        return None
    listed = ", ".join(str(point + 1) for point in range(count) if point not in touching)
    which = (
        f"Contact points {listed} do"
        if count - len(touching) > 1
        else f"Contact point {listed} does"
    )
    return f"{which} not touch in the last period: there is no picture of the contact."


RUN_UP = "run_up.csv"
ROWS = ("time", "speed", "amplitude", "peak_force", "friction", "torque", "power")


def run_up_rows(found: RunUp) -> list[dict[str, float]]:
    """The rows of `run_up.csv`, one for each revolution."""
    columns = {
        "time_s": found.time,
        "speed_rpm": 30.0 / np.pi * found.speed,
        "amplitude_m": found.amplitude,
        "peak_normal_force_N": found.peak_force,
        "friction_dissipation_J": found.friction,
        "shaft_torque_Nm": found.torque,
        "shaft_power_W": found.power,
    }
    rows = zip(*columns.values(), strict=True)
    return [dict(zip(columns, map(float, row), strict=True)) for row in rows]


def run_up_summary(found: RunUp | None) -> dict[str, Any]:
    """The entry `run_up` of `summary.json`, without what `run_up.csv` holds."""
    if found is None:
        return {}
    worst = int(np.argmax(found.amplitude))
    whole = {name: value for name, value in asdict(found).items() if name not in ROWS}
    largest = {
        "largest_amplitude_m": found.amplitude[worst],
        "at_speed_rpm": 30.0 / np.pi * found.speed[worst],
    }
    return {"run_up": largest | whole}


def run_up_sentences(found: RunUp | None) -> list[str]:
    """State the largest amplitude of a motion at a varying speed, and what the shaft does."""
    if found is None:
        return []
    worst = int(np.argmax(found.amplitude))
    return [
        f"Speed from {30.0 / np.pi * found.speed[0]:.6g} to {30.0 / np.pi * found.speed[-1]:.6g} "
        f"rpm (means of the first and the last revolution). The largest distance from the "
        f"equilibrium of the same speed is {1e3 * found.amplitude[worst]:.4g} mm, at "
        f"{30.0 / np.pi * found.speed[worst]:.5g} rpm.",
        f"Shaft: work {found.shaft_work:.6g} J, angular momentum {found.momentum[0]:.5g} to "
        f"{found.momentum[1]:.5g} kg m²/s. The energy of the body rises by "
        f"{found.energy_rise:.6g} J. From the shaft, contacts take {found.contact_work:.5g} J and "
        f"loads {found.load_work:.5g} J. Loads and surfaces do {found.deformation_work:.6g} J of "
        f"work on the deformation; of this, damping takes {found.damping:.5g} J, friction "
        f"{found.friction_heat:.6g} J and the contact springs {found.spring_energy:.2g} J. These "
        f"works differ from the rise by {found.balance:.2g} J.",
    ]


def run_up_pictures(found: RunUp | None) -> list[Picture]:
    """List the picture of a motion at a varying speed, if it is one."""
    if found is None:
        return []
    return [Picture("Amplitude over the speed", "run_up.png", lambda: plot_run_up(found))]


@styled
def plot_run_up(found: RunUp) -> Figure:
    """Draw amplitude, peak force and shaft torque over the speed, with the critical speeds."""
    rub = bool(np.any(found.peak_force > 0.0))
    drawn = [("amplitude, mm", 1e3 * found.amplitude, "#0072B2")]
    drawn += [("peak normal force, N", found.peak_force, "#D55E00")] if rub else []
    drawn += [("shaft torque, N m", found.torque, "#009E73")]
    figure, axes = new_panels(8.0, 2.2 * len(drawn) + 0.5, len(drawn), sharex=True)
    for mode, order, speed in found.critical:
        for axis in axes:
            axis.axvline(speed, color="grey", linewidth=0.8, linestyle="--")
        axes[0].annotate(
            f"order {order}, mode {mode}",
            (speed, 1.0),
            xycoords=("data", "axes fraction"),
            rotation=90.0,
            ha="right",
            va="top",
            fontsize="x-small",
        )
    for axis, (name, values, colour) in zip(axes, drawn, strict=True):
        axis.plot(30.0 / np.pi * found.speed, values, color=colour, marker=".", markersize=3)
        axis.set_ylabel(name)
    axes[-1].set_xlabel("speed, rpm")
    return figure


WINDOWS = 100  # largest number of windows of an envelope
SWINGS = 1.2  # least length of a window in periods of the strongest frequency
LEAST = 1e-4  # smallest amplitude that a spectrum shows, relative to the largest
COLUMNS = 600  # instants of a map
MOST_COORDINATES = 6


@styled
def plot_transient(motion: Motion, natural_hz: Array, names: Sequence[str] = ()) -> Figure:
    """Draw a motion that does not repeat: envelope, spectrum and spectrogram.

    The direction is that with the largest motion of the first contact point or the probe.

    Args:
        motion: the motion.
        natural_hz: (n,) natural frequencies, Hz, to mark in the spectrum.
        names: names of the directions.
    """
    moved = motion.displacement[:, 0]
    k = int(np.argmax(np.ptp(moved, axis=0)))
    time, x = motion.time, 1e3 * moved[:, k]
    figure = new_figure(9.6, 6.2)
    grid = figure.add_gridspec(2, 2, width_ratios=[2.2, 1.0])
    above = figure.add_subplot(grid[0, :])
    below = figure.add_subplot(grid[1, 0])
    side = figure.add_subplot(grid[1, 1], sharey=below)
    name = (names or plain_names(moved.shape[1], has_contact(motion)))[k]
    above.plot(time, x, color="#0072B2", linewidth=0.6, label=f"{name} displacement")
    hertz, size = spectrum(time, x)
    strongest = max(strongest_oscillation(hertz, size), 1e-300)
    width = max((time[-1] - time[0]) / WINDOWS, SWINGS / strongest)
    middle, low, high = envelope(time, x, min(width, 0.25 * (time[-1] - time[0])))
    above.plot(middle, high, color="#D55E00", linewidth=1.2, label="envelope")
    above.plot(middle, low, color="#D55E00", linewidth=1.2)
    above.set(xlabel="time, s", ylabel="displacement, mm")
    above.set_xlim(time[0], time[-1])
    top = _highest(hertz, size)
    least = LEAST * float(size.max()) or 1e-12
    frequencies, instants, sizes = moving_spectrum(time, x)
    shown = frequencies <= top
    level = 20.0 * np.log10(np.maximum(sizes[shown], least) / (float(sizes.max()) or 1.0))
    mesh = below.pcolormesh(
        instants, frequencies[shown], level, cmap="magma", vmin=-60.0, vmax=0.0, rasterized=True
    )
    below.set(xlabel="time, s", ylabel="frequency, Hz", ylim=(0.0, top))
    below.set_xlim(time[0], time[-1])
    below.grid(visible=False)
    label = "dB of the largest"
    figure.colorbar(mesh, ax=[below, side], location="right", pad=0.01, label=label)
    side.plot(np.maximum(size, least), hertz, color="#0072B2", linewidth=1.0)
    side.set(xscale="log", xlabel="amplitude, mm", xlim=(least, 2.0 * float(size.max()) or 1.0))
    marked = [value for value in natural_hz if value <= top]
    for number, value in enumerate(marked):
        look: dict[str, Any] = {"color": "#555B61", "linestyle": "--", "linewidth": 0.8}
        side.axhline(value, label="natural frequencies" if number == 0 else None, **look)
    handles = [*above.get_legend_handles_labels()[0], *side.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    return figure


def _highest(hertz: Array, size: Array) -> float:
    """The frequency up to which a spectrum is worth showing, Hz."""
    large = np.flatnonzero(size >= 10.0 * LEAST * float(size.max()))
    return float(min(1.2 * hertz[large[-1]], hertz[-1])) if large.size else float(hertz[-1])


@styled
def plot_section(motion: Motion, names: Sequence[str] = ()) -> Figure:
    """Draw the states of the first point once per period of the loads: velocity, displacement."""
    names = names or plain_names(motion.displacement.shape[2], has_contact(motion))
    displacement, velocity = (1e3 * found for found in stroboscopic_states(motion))
    count, directions = displacement.shape
    figure, axes = new_panels(3.9 * directions + 1.0, 3.9, 1, directions)
    for k, axis in enumerate(axes):
        look = {"c": np.arange(count), "s": 14, "cmap": "viridis"}
        dots = axis.scatter(displacement[:, k], velocity[:, k], **look)
        axis.set(xlabel=f"{names[k]} displacement, mm", ylabel=f"{names[k]} velocity, mm/s")
    bar: Any = figure.colorbar(dots, ax=axes, label="period of the loads")
    bar.ax.yaxis.get_major_locator().set_params(integer=True)
    return figure


@styled
def plot_rub_map(motion: Motion, places: ContactPoints | None = None) -> Figure:
    """Draw the normal force and the state of all contact points over the last period.

    The axis of the contact points is that of `contact_axis`.
    """
    start = motion.time[-1] - motion.period if motion.period is not None else motion.time[0]
    instants = np.linspace(max(start, motion.time[0]), motion.time[-1], COLUMNS)
    rows = np.clip(np.searchsorted(motion.time, instants), 0, motion.time.size - 1)
    line = contact_axis(places, motion.state.shape[1])
    across = (instants - instants[0]) / (motion.period or 1.0)
    figure, (force, state) = new_panels(9.0, 5.6, 2, sharex=True)
    pressed = motion.force[rows, :, 0].T / line.share[:, None]
    shown = np.where(pressed > 0.0, pressed, np.nan)  # no colour where there is no force
    look: dict[str, Any] = {"vmin": 0.0, "shading": "nearest", "rasterized": True}
    drawn = force.pcolormesh(across, line.at, shown, cmap="viridis_r", **look)
    state.pcolormesh(across, line.at, motion.state[rows].T, **state_map())
    figure.colorbar(drawn, ax=force, pad=0.03, label=f"normal force, {line.unit}")
    state.set_xlim(across[0], across[-1])
    for axis in (force, state):
        axis.set_ylabel(line.label.replace(" along", "\nalong"))
        axis.locator_params(axis="y", integer=True)
        axis.grid(visible=False)
        line.write_numbers(axis, upright=True)
    state.set_xlabel("time / period" if motion.period is not None else "time, s")
    handles = state_handles({int(number) for number in np.unique(motion.state[rows])})
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles))
    return figure


@styled
def plot_energy_per_period(motion: Motion, source: str = LOADS) -> Figure:
    """Draw the work and the dissipated energies of each period of the loads.

    Args:
        motion: the motion.
        source: what does work.
    """
    found = energy_per_period(motion)
    figure, (axis,) = new_panels(8.6, 3.6)
    work = found["work"]
    edges = 0.5 + np.arange(work.size + 1)
    base: Array = np.zeros(work.size)
    for name, colour in (("damping", "#56B4E9"), ("friction", "#E69F00")):
        if np.any(found[name] != 0.0):
            top = base + found[name]
            part = 100.0 * found[name][-1] / max(abs(float(work[-1])), 1e-300)
            label = f"{name} (last period: {part:.3g} % of the work)"
            axis.stairs(top, edges, baseline=base, fill=True, color=colour, label=label)
            base = top
    axis.stairs(work, edges, color="#000000", label=f"work of {source}", linewidth=1.4)
    axis.set(xlabel="period of the loads", ylabel="energy per period, J")
    axis.set_xlim(edges[0], edges[-1])
    axis.locator_params(axis="x", integer=True)
    figure.legend(loc="outside upper right", ncols=2)
    return figure


@styled
def plot_coordinates(motion: Motion, labels: Sequence[str], modal: Array) -> Figure:
    """Draw the modal coordinates of a reduced motion over its last period, one panel each.

    The largest coordinates are drawn, in the order of the modes; a coordinate that is only rounding
    error has no curve.

    Args:
        motion: a motion with coordinates.
        labels: one per mode.
        modal: (k, m) modal coordinates at the times of the coordinates, multiplied by the largest
            displacement of the mode, m.
    """
    assert motion.coordinate_time is not None
    time = motion.coordinate_time
    part = time >= time[-1] - (motion.period or np.inf) * (1.0 + 1e-9)
    moved = 1e3 * modal[part]
    sizes = np.ptp(moved, axis=0)
    order = np.argsort(-np.abs(moved).max(axis=0), kind="stable")
    chosen = np.sort(order[:MOST_COORDINATES])
    shown = (time[part] - time[part][0]) / (motion.period or 1.0)
    figure, axes = new_panels(8.6, 0.9 + 1.25 * len(chosen), len(chosen), sharex=True)
    for axis, k in zip(axes, chosen, strict=True):
        if sizes[k] < NEGLIGIBLE * sizes.max():
            note_noise(axis)
        else:
            axis.plot(shown, moved[:, k], color="#0072B2")
        axis.set_ylabel(f"{labels[int(k)]}\nmm")
        axis.margins(x=0)
    axes[-1].set_xlabel("time / period" if motion.period is not None else "time, s")
    left = f"; the largest {len(chosen)} of {len(labels)}" if len(labels) > len(chosen) else ""
    axes[0].set_title(f"modal coordinate × largest displacement of the mode{left}")
    figure.align_ylabels()
    return figure
