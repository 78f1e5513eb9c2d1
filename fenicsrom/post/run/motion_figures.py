"""The table of responses, run-ups, and pictures of motions that answer one question each."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors import signals
from fenicsrom.assess.rotation.run_up import RunUp
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.motion import measures
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base import tables
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Bars, Dots, Item, Line, Map, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS, EDGE, STATES
from fenicsrom.post.run import figures
from fenicsrom.post.run.joint_figures import joint_pictures
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.contacts import surface_spin

Draw = Callable[[], Plot]
CAPTIONS = {
    "setup": "The body with its supports, loads and contact points.",
    "shapes": "The shapes of the basis: normal modes (V) with nodal lines, static modes (S), and "
    "modal derivatives. Displacements are magnified.",
    "equilibrium": "The equilibrium under the static loads. The grey lines are the body at rest.",
    "stress": "The von Mises stress at the instant and on the side of its largest value.",
    "motion": "Displacement of the contact point or probe. Where the motion repeats, this is its "
    "last period. Lines that lie on each other agree.",
    "probe": "Displacement of the probe, beside that of the contact points.",
    "spectra": "The motion over time, and its spectrum beside the natural frequencies (dashed).",
    "section": "One point for each period of the load. A motion that repeats gives a few points, a "
    "quasi-periodic one a closed curve.",
    "contact": "States and forces of contact over the last period. The area inside a loop of the "
    "tangential force over the displacement is the energy that friction dissipates.",
    "rub_map": "The state of each contact point over the last period.",
    "energy": "The work of the loads is the sum of the stored and the dissipated energy. The "
    "imbalance is the error of this sum.",
    "energy_per_period": "Energies of each period. Bars of the same height mean a steady motion.",
    "wear": "The depth that the body wore of the abradable layer, over the angle of the casing; or "
    "before each contact point over time, if the surface does not turn.",
    "run_up": "Each revolution over its mean speed: the largest distance from the equilibrium of "
    "the same speed, the largest normal force, and the mean torque of the shaft. Dashed: speeds "
    "where an engine order of the loads or waves meets a mode without contact.",
    "coordinates": "The part of each normal mode in the motion. Later modes should be small.",
    "modes": "The shapes of the basis along the axis of the body, relative to their largest value.",
    "mac": "Agreement of the modes: 1 on the diagonal means the same shapes.",
    "sizes": "A larger basis has a smaller error. The run has the filled point.",
    "motion.gif": "The last period. Displacements are magnified as stated.",
}
"""Name of a picture of a run -> what to see in it."""


def picture(
    heading: str, name: str, draw: Draw, numbers: str = figures.HISTORY, **more: Any
) -> Picture:
    """A picture of a run by the name of its caption, or this name with a number."""
    caption = CAPTIONS[name.rstrip("_0123456789")]
    return Picture(heading, f"{name}.png", draw, caption, numbers, **more)


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
        found = measures.response_summary(motion)
        amplitudes = tables.millimetres(tables.in_order(found["amplitude_m"]))
        row = {"model": name, "size": sizes.get(name)}
        row |= {f"{direction} mm": None for direction in names}
        row |= {f"{direction} mm": a for direction, a in zip(names, amplitudes, strict=False)}
        if name in probes:
            moved = tables.in_order(measures.response_summary(probes[name])["amplitude_m"])
            texts = zip("xyz", tables.millimetres(moved), strict=False)
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
    return tables.table_of(rows)


def points_note(motions: Mapping[str, Motion], scene: Scene) -> str | None:
    """State to which contact points the numbers of the table belong; None if there is no choice."""
    touching = {name: motion for name, motion in motions.items() if measures.has_contact(motion)}
    count = max((motion.state.shape[1] for motion in touching.values()), default=0)
    if not touching or (count < 2 and scene.probe is None):
        return None
    probe = " and of the probe" if scene.probe is not None else ""
    if count < 2:
        return f"Amplitudes are those of the contact point{probe}."
    hardest = {}
    for name, motion in touching.items():
        peaks = [point["peak_normal_force_N"] for point in measures.point_summaries(motion)]
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


def revolutions(found: RunUp) -> list[tables.Quantity]:
    """What is told of each revolution, by its number."""
    told = {
        ("time_s", ""): found.time,
        ("speed_rpm", "speed, rpm"): 30.0 / np.pi * found.speed,
        ("amplitude_m", "amplitude, mm"): found.amplitude,
        ("peak_normal_force_N", "peak normal force, N"): found.peak_force,
        ("friction_dissipation_J", ""): found.friction,
        ("shaft_torque_Nm", "shaft torque, N m"): found.torque,
        ("shaft_power_W", ""): found.power,
    }
    return [
        tables.Quantity(key, partial(operator.getitem, values.tolist()), head)
        for (key, head), values in told.items()
    ]


def run_up_rows(found: RunUp) -> list[dict[str, Any]]:
    """The rows of `run_up.csv`, one for each revolution."""
    return tables.rows_of(range(found.time.size), revolutions(found))


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
    draw = partial(plot_run_up, found)
    return [picture("Amplitude over the speed", "run_up", draw, RUN_UP)]


def plot_run_up(found: RunUp) -> Plot:
    """Amplitude, peak force and shaft torque over the speed, with the critical speeds."""
    numbers = range(found.time.size)
    speed, *told = (one for one in revolutions(found) if one.head)
    drawn = {one: one.column(numbers) for one in told}
    chosen = {one: values for one, values in drawn.items() if np.any(values)}  # a rub or none
    rpm = speed.column(numbers)
    speeds: list[Item] = [
        Line(np.full(2, place), None, "--", EDGE, 0.8, zorder=1.0) for *_, place in found.critical
    ]
    names: list[Item] = [
        Text(place, 0.98, f"order {order}, mode {mode}", "y", rotation=90.0, ha="right", va="top")
        for mode, order, place in found.critical
    ]
    panels: list[Panel] = []
    for (one, values), color in zip(chosen.items(), COLOURS, strict=False):
        curve = Line(rpm, values, color=color, marker=".", markersize=3.0)
        texts = [] if panels else names
        panels.append(Panel([*speeds, curve, *texts], ylabel=one.head))
    return Plot(panels, 8.0, 2.2 * len(panels) + 0.5, share="x", xlabel=speed.head)


WINDOWS = 100  # largest number of windows of an envelope
SWINGS = 1.2  # least length of a window in periods of the strongest frequency
LEAST = 1e-4  # smallest amplitude that a spectrum shows, relative to the largest
COLUMNS = 600  # instants of a map
MOST_COORDINATES = 6


def plot_transient(motion: Motion, natural_hz: Array, names: Sequence[str] = ()) -> Plot:
    """A motion that does not repeat: envelope, spectrum and spectrogram.

    The direction is that with the largest motion of the first contact point or the probe.

    Args:
        motion: the motion.
        natural_hz: (n,) natural frequencies, Hz, to mark in the spectrum.
        names: names of the directions.
    """
    moved = motion.displacement[:, 0]
    k = int(np.argmax(np.ptp(moved, axis=0)))
    time, x = motion.time, 1e3 * moved[:, k]
    name = (names or tables.plain_names(moved.shape[1], measures.has_contact(motion)))[k]
    hertz, size = signals.spectrum(time, x)
    strongest = max(signals.strongest_oscillation(hertz, size), 1e-300)
    width = max((time[-1] - time[0]) / WINDOWS, SWINGS / strongest)
    middle, low, high = signals.envelope(time, x, min(width, 0.25 * (time[-1] - time[0])))
    above: list[Item] = [Line(time, x, linewidth=0.6, label=f"{name} displacement")]
    for edge in (high, low):
        above.append(Line(middle, edge, color=COLOURS[1], linewidth=1.2, label="envelope"))
    top = _highest(hertz, size)
    least = LEAST * float(size.max()) or 1e-12
    frequencies, instants, sizes = signals.moving_spectrum(time, x)
    shown = frequencies <= top
    level = 20.0 * np.log10(np.maximum(sizes[shown], least) / (float(sizes.max()) or 1.0))
    look: dict[str, Any] = {"cmap": "magma", "vmin": -60.0, "vmax": 0.0, "bar": "dB of the largest"}
    map_ = Map(instants, frequencies[shown], level, **look)
    across: list[Item] = [Line(np.maximum(size, least), hertz, linewidth=1.0)]
    across += [
        Line(None, np.full(2, value), "--", EDGE, 0.8, label="natural frequencies")
        for value in natural_hz
        if value <= top
    ]
    ends = (least, 2.0 * float(size.max()) or 1.0)
    upper: Any = {"tight": "x", "place": (0, 0, 1, 2)}
    lower: Any = {"ylabel": "frequency, Hz", "ylim": (0.0, top)}
    panels = [
        Panel(above, "time, s", "displacement, mm", **upper),
        Panel([map_], "time, s", **lower, xlim=(time[0], time[-1]), place=(1, 0, 1, 1)),
        Panel(across, "amplitude, mm", **lower, xlim=ends, log="x", place=(1, 1, 1, 1)),
    ]
    return Plot(panels, 9.6, 6.2, widths=(2.2, 1.0))


def _highest(hertz: Array, size: Array) -> float:
    """The frequency up to which a spectrum is worth showing, Hz."""
    large = np.flatnonzero(size >= 10.0 * LEAST * float(size.max()))
    return float(min(1.2 * hertz[large[-1]], hertz[-1])) if large.size else float(hertz[-1])


def plot_section(motion: Motion, names: Sequence[str] = ()) -> Plot:
    """The states of the first point once per period of the loads: velocity over displacement."""
    names = names or tables.plain_names(motion.displacement.shape[2], measures.has_contact(motion))
    displacement, velocity = (1e3 * found for found in signals.stroboscopic_states(motion))
    count, directions = displacement.shape
    bars = [""] * (directions - 1) + ["period of the loads"]
    panels: list[Panel] = []
    for k, bar in enumerate(bars):
        dots = Dots(displacement[:, k], velocity[:, k], np.arange(count), bar=bar)
        labels = f"{names[k]} displacement, mm", f"{names[k]} velocity, mm/s"
        panels.append(Panel([dots], *labels))
    return Plot(panels, 3.9 * directions + 1.0, 3.9, directions)


def plot_rub_map(motion: Motion, places: ContactPoints | None = None) -> Plot:
    """The normal force and the state of all contact points over the last period.

    The axis of the contact points is that of `contact_axis`.
    """
    start = motion.time[-1] - motion.period if motion.period is not None else motion.time[0]
    instants = np.linspace(max(start, motion.time[0]), motion.time[-1], COLUMNS)
    rows = np.clip(np.searchsorted(motion.time, instants), 0, motion.time.size - 1)
    line = figures.contact_axis(places, motion.state.shape[1])
    across = (instants - instants[0]) / (motion.period or 1.0)
    pressed = motion.force[rows, :, 0].T / line.share[:, None]
    shown = np.where(pressed > 0.0, pressed, np.nan)  # no colour where there is no force
    bar = f"normal force, {line.unit}"
    force = Map(across, line.at, shown, cmap="viridis_r", vmin=0.0, bar=bar)
    states = motion.state[rows].T
    label = line.label.replace(" along", "\nalong")
    look: dict[str, Any] = {"ylabel": label, "tight": "xy", "whole": "y"}
    numbers = line.numbers(upright=True)
    time = "time / period" if motion.period is not None else "time, s"
    panels = [
        Panel([force, *numbers], **look),
        Panel([state_map(across, line.at, states), *numbers], time, **look),
    ]
    return Plot(panels, 9.0, 5.8, share="x", legend=state_samples(states))


def state_map(x: Any, y: Any, states: Any) -> Map:
    """A map of contact states (r, c)."""
    colours = [STATES[state][1] for state in sorted(STATES)]
    return Map(x, y, states, cmap=colours, vmin=-1.5, vmax=1.5)


def state_samples(states: Any) -> list[Bars]:
    """The samples in a legend of the contact states that occur."""
    present = {int(state) for state in np.unique(states)}
    return [
        Bars(color=color, label=name) for state, (name, color) in STATES.items() if state in present
    ]


def plot_energy_per_period(motion: Motion, source: str = figures.LOADS) -> Plot:
    """The work and the dissipated energies of each period of the loads.

    Args:
        motion: the motion.
        source: what does work.
    """
    found = signals.energy_per_period(motion)
    work = found["work"]
    edges = 0.5 + np.arange(work.size + 1)
    base: Array = np.zeros(work.size)
    items: list[Item] = []
    for name, color in (("damping", COLOURS[5]), ("friction", COLOURS[4])):
        if np.any(found[name] != 0.0):
            part = 100.0 * found[name][-1] / max(abs(float(work[-1])), 1e-300)
            label = f"{name} (last period: {part:.3g} % of the work)"
            top = base + found[name]
            items.append(Bars(edges[:-1], edges[1:], base, top, color, label=label))
            base = top
    steps = np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(work, 2), [0.0]])
    items.append(Line(*steps, color=COLOURS[-1], linewidth=1.4, label=f"work of {source}"))
    labels = "period of the loads", "energy per period, J"
    return Plot([Panel(items, *labels, tight="x", whole="x")], 8.6, 3.6)


def plot_coordinates(motion: Motion, labels: Sequence[str], modal: Array) -> Plot:
    """The modal coordinates of a reduced motion over its last period, one panel each.

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
    left = f"; the largest {len(chosen)} of {len(labels)}" if len(labels) > len(chosen) else ""
    title = f"modal coordinate × largest displacement of the mode{left}"
    panels: list[Panel] = []
    for k in chosen:
        look: dict[str, Any] = {"ylabel": f"{labels[int(k)]}\nmm", "tight": "x"}
        look["title"] = "" if panels else title
        noise = sizes[k] < measures.NEGLIGIBLE * sizes.max()
        look["yticks"] = {0.0: ""} if noise else {}
        panels.append(Panel([figures.NOISE if noise else Line(shown, moved[:, k])], **look))
    across = "time / period" if motion.period is not None else "time, s"
    return Plot(panels, 8.6, 0.9 + 1.25 * len(chosen), share="x", xlabel=across)


LEAST_PERIODS = 3.5  # fewer periods show no trend of the energies
LEAST_SECTION = 20  # fewer periods make no section


def motion_pictures(found: Study | Rerun) -> list[Picture]:
    """List the pictures of the motions, of the contact, of the energy and of the wear of a run."""
    if not found.motions:
        return []
    motions, points = found.motions, found.points
    names, work = tables.direction_names(found.scene, points), working(found.scene)
    first = next(iter(motions.values()))
    listed = [picture("Motion", "motion", lambda: figures.plot_motion(motions, names))]
    if probes := figures.probe_motions(found):
        listed.append(picture("Motion of the probe", "probe", partial(figures.plot_motion, probes)))
    if first.period is None and first.time.size >= signals.LEAST_SAMPLES:
        draw = partial(plot_transient, first, found.frequencies_hz, names)
        listed.append(picture("Spectra", "spectra", draw))
    if measures.is_unsteady(first) and first.periods >= LEAST_SECTION:
        listed.append(picture("Poincaré section", "section", partial(plot_section, first, names)))
    listed += _contact_pictures(motions, names, points)
    if first.state.shape[1] > FEW_POINTS and touching_points(motions):
        listed.append(picture("Rub map", "rub_map", partial(plot_rub_map, first, points)))
    listed += joint_pictures(found)
    listed.append(picture("Energy", "energy", partial(figures.plot_energy, first, work)))
    if first.time[-1] / (first.load_period or np.inf) > LEAST_PERIODS:
        draw = partial(plot_energy_per_period, first, work)
        listed.append(picture("Energy per period", "energy_per_period", draw))
    if "reduced" in motions:
        listed += wear_pictures(motions["reduced"], found.scene, points)
    return listed


def wear_pictures(motion: Motion, scene: Scene, points: ContactPoints) -> list[Picture]:
    """The picture of the worn depth of abradable layers: of a casing, or before single points."""
    found = measures.wear_of(motion, scene, points)
    if rings := [one for one in found if one.ring.radius]:
        return [
            picture("Wear of the casing", "wear", partial(figures.plot_wear, rings), figures.WEAR)
        ]
    if not found:
        return []
    worn = measures.worn_under_points(motion, contacts_of(scene, points))
    mine = [one.ring.points[0] for one in found]
    draw = partial(figures.plot_wear_over_time, motion.time, worn, mine)
    return [picture("Wear of the layer", "wear", draw, figures.WEAR)]


def working(scene: Scene) -> str:
    """Say what does work: the loads, and the surfaces if one of them moves, turns or wears."""
    turning = [
        surface_spin(contact.surface, scene.rotation)
        for contact in scene.contacts
        if contact.surface is not None
    ]
    moving = any(turning) or scene.wears or any(contact.approach for contact in scene.contacts)
    return figures.LOADS_AND_SURFACES if moving else figures.LOADS


def _contact_pictures(
    motions: Mapping[str, Motion], names: Sequence[str], points: ContactPoints | None
) -> list[Picture]:
    """List the pictures of contact points: one for each of a few points, or one for many points."""
    touching, count = touching_points(motions), next(iter(motions.values())).force.shape[1]
    if count > FEW_POINTS and touching:
        draw = partial(figures.plot_points, motions, names, points)
        return [picture(f"Contact of {count} points", "contact", draw)]
    listed = []
    for k in touching:
        mine = {name: motion for name, motion in motions.items() if motion.force.shape[1] > k}
        heading = f"Contact point {k + 1}" if count > 1 else "Contact"
        name = f"contact_{k + 1}" if count > 1 else "contact"
        listed.append(picture(heading, name, partial(figures.plot_contact, mine, k, names)))
    return listed
