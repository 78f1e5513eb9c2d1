"""Pictures of motions that answer one question each: transients, sections, maps, coordinates."""

from collections.abc import Sequence
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
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import NEGLIGIBLE, has_contact
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.directions import plain_names
from fenicsrom.post.base.style import (
    Figure,
    new_figure,
    new_panels,
    state_handles,
    state_map,
    styled,
)
from fenicsrom.post.run.figures import LOADS, contact_axis, note_noise

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
