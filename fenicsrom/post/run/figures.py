"""Figures of motions, contacts, energies, mode shapes and wear."""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.errors.sizing import NestedSize
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import NEGLIGIBLE, Wear, has_contact, point_summaries, wear_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.chart import noted
from fenicsrom.post.base.style import (
    STATES,
    Axes,
    Figure,
    line_styles,
    new_figure,
    new_panels,
    state_handles,
    styled,
)
from fenicsrom.post.base.tables import plain_names, write_rows
from fenicsrom.scene import Scene

LOADS = "the loads"
LOADS_AND_SURFACES = "the loads and of moving surfaces"
NARROW = 4  # largest number of intervals between the ticks of a narrow panel
LEAST_COMPONENT = 0.01  # of the largest component of a shape: the line of a smaller one is flat


@styled
def plot_motion(motions: Mapping[str, Motion], names: Sequence[str] = ()) -> Figure:
    """Draw displacements of the first point over the last two periods, one panel per direction.

    Each panel shows all models, as figure 5 of the paper does. A direction in which they move by
    rounding errors only has no curves.

    Args:
        motions: model name -> motion.
        names: names of the directions.
    """
    styles = line_styles(motions)
    directions = max(motion.displacement.shape[2] for motion in motions.values())
    touching = any(map(has_contact, motions.values()))
    names = names or plain_names(directions, touching)
    figure, axes = new_panels(8.6, 0.7 + 2.2 * directions, directions, sharex=True)
    parts = {name: _phase(motion, 2) for name, motion in motions.items()}
    moved = {name: 1e3 * each.displacement[parts[name][1], 0] for name, each in motions.items()}
    sizes = {name: np.ptp(values, axis=0) for name, values in moved.items()}
    largest = max(float(size.max()) for size in sizes.values())
    for k, axis in enumerate(axes):
        there = [name for name, values in moved.items() if k < values.shape[1]]
        if all(sizes[name][k] < NEGLIGIBLE * largest for name in there):
            note_noise(axis)
            there = []
        for name in there:
            axis.plot(parts[name][0], moved[name][:, k], label=name, **styles[name])
        axis.set_ylabel(f"{names[k]}\ndisplacement, mm")
        axis.margins(x=0)
    periodic = all(motion.period is not None for motion in motions.values())
    axes[-1].set_xlabel("time / period" if periodic else "time, s")
    count = max(motion.state.shape[1] for motion in motions.values())
    place = "contact point" if touching else "probe"
    axes[0].set_title(f"{place} 1 of {count}" if count > 1 else place)
    _legend(figure, next((axis for axis in axes if axis.lines), axes[0]))
    figure.align_ylabels()
    return figure


@styled
def plot_sizes(sizes: Sequence[NestedSize], size: int) -> Figure:
    """Draw the error due to the basis over the run time, for models of several sizes.

    Args:
        sizes: the models; each point has its number of coordinates.
        size: number of coordinates of the run, whose point is filled.
    """
    figure, (axis,) = new_panels(4.6, 3.2)
    seconds, errors = ([getattr(each, name) for each in sizes] for name in ("seconds", "error"))
    axis.plot(seconds, np.multiply(100.0, errors), "-", color="#b0b6bc", lw=0.8)
    for each in sizes:
        fill = None if each.size == size else "white"
        axis.plot(each.seconds, 100.0 * each.error, "o", color="#0072B2", markerfacecolor=fill)
        place = each.seconds, 100.0 * each.error
        axis.annotate(str(each.size), place, (4, 4), textcoords="offset points")
    axis.set(xscale="log", yscale="log", xlabel="run time of the steps, s")
    axis.set_ylabel("estimated error of the basis, %")
    axis.set_title("numbers of coordinates; filled: this run")
    return figure


def note_noise(axis: Axes) -> None:
    """Say in an empty panel that its curves would show rounding errors."""
    _note(axis, f"amplitude below {NEGLIGIBLE:g} of the largest")
    axis.set_yticks([])


def _note(axis: Axes, text: str) -> None:
    """Write into the middle of an empty panel."""
    axis.text(0.5, 0.6, text, color="#5b636b", transform=axis.transAxes, ha="center")


# Number of directions -> the panels of a contact point, each with its quantities on the x and y
# axis. A quantity is the displacement u or the force f in direction 0 (normal), 1 or 2
# (tangential). The last panel is the orbit of the point.
_LOOPS = {
    2: (("u1", "f1"), ("u0", "f0"), ("u1", "u0")),
    3: (("u1", "f1"), ("u2", "f2"), ("u0", "f0"), ("u1", "u2")),
}


@styled
def plot_contact(
    motions: Mapping[str, Motion], point: int = 0, names: Sequence[str] = ()
) -> Figure:
    """Draw contact states over the last period, and contact forces against displacements.

    The loops show the tangential force against the tangential displacement, one panel per tangent
    direction, and the normal force against the normal displacement (figures 6 and 13 of the paper).
    The last panel is the orbit of the point: in 2D its normal against its tangential displacement,
    in 3D its path in the contact plane.

    Args:
        motions: model name -> motion; motions without contact are left out.
        point: number of the contact point.
        names: names of the directions.
    """
    motions = {name: motion for name, motion in motions.items() if has_contact(motion)}
    directions = max((motion.displacement.shape[2] for motion in motions.values()), default=2)
    loops = len(_LOOPS[directions])
    columns = 3 if loops == 3 else 2
    rows = loops // columns
    strip = 0.75 + 0.33 * len(motions)
    figure = new_figure(4.1 * columns if columns == 2 else 10.8, 0.4 + strip + 3.3 * rows)
    grid = figure.add_gridspec(1 + rows, columns, height_ratios=[strip] + [3.3] * rows)
    _plot_states(figure.add_subplot(grid[0, :]), motions, point)
    panels = [figure.add_subplot(grid[1 + k // columns, k % columns]) for k in range(loops)]
    _plot_loops(panels, motions, point, names)
    _legend(figure, panels[0])
    return figure


@styled
def plot_points(
    motions: Mapping[str, Motion], names: Sequence[str] = (), places: ContactPoints | None = None
) -> Figure:
    """Draw the peak force, the time in contact and the dissipation of all contact points.

    Points on a line stand at their positions, with their numbers above. Force and dissipation are
    per length or area. Below are the loops of the point with the largest normal force in the first
    motion.

    Args:
        motions: model name -> motion; motions without contact are left out.
        names: names of the directions.
        places: the contact points.
    """
    motions = {name: motion for name, motion in motions.items() if has_contact(motion)}
    points = {name: point_summaries(motion) for name, motion in motions.items()}
    styles, first = line_styles(motions), next(iter(motions))
    hardest = int(np.argmax([point["peak_normal_force_N"] for point in points[first]]))
    directions = motions[first].displacement.shape[2]
    loops = len(_LOOPS[directions])
    figure = new_figure(3.6 * loops, 7.2)
    grid = figure.add_gridspec(2, COLUMNS)
    axes = [figure.add_subplot(grid[0, part]) for part in _columns(3)]
    line = contact_axis(places, len(points[first]))
    work = f"friction dissipation, {line.unit.replace('N', 'J')}"
    curves: dict[str, tuple[Callable[[Mapping[str, Any]], float], Any]] = {
        f"peak normal force, {line.unit}": (itemgetter("peak_normal_force_N"), line.share),
        "time in contact, %": (lambda point: 100.0 * (1.0 - point["fraction"]["open"]), 1.0),
        work: (itemgetter("friction_dissipation_per_period_J"), line.share),
    }
    for axis, (label, (value, share)) in zip(axes, curves.items(), strict=True):
        for name in motions:
            found, at = np.array([value(point) for point in points[name]]), line.at
            heights = found / share if found.size == at.size else found
            at = at if found.size == at.size else np.arange(1.0, found.size + 1.0)
            look = {"marker": "o", "markersize": 3.5, "label": name, **styles[name]}
            (drawn,) = axis.plot(at, heights, **look)
            noted(drawn, [f"contact point {k + 1}" for k in range(len(found))])
        axis.set(xlabel=line.label, ylabel=label)
        axis.xaxis.get_major_locator().set_params(integer=True)
        line.write_numbers(axis)
    panels = [figure.add_subplot(grid[1, part]) for part in _columns(loops)]
    there = {name: motion for name, motion in motions.items() if motion.state.shape[1] > hardest}
    _plot_loops(panels, there, hardest, names)
    panels[0].set_title(f"point {hardest + 1}: largest force")
    _legend(figure, axes[0])
    return figure


COLUMNS = 12
"""Columns of a grid with a row of three panels and a row of three or four."""


def _columns(count: int) -> list[slice]:
    """The columns of each of some panels in a row."""
    width = COLUMNS // count
    return [slice(k * width, (k + 1) * width) for k in range(count)]


def _plot_loops(
    panels: Sequence[Axes], motions: Mapping[str, Motion], point: int, names: Sequence[str]
) -> None:
    """Draw the loops of a contact point over the last period, one panel for each of `_LOOPS`."""
    styles = line_styles(motions)
    directions = max((motion.displacement.shape[2] for motion in motions.values()), default=2)
    names = names or plain_names(directions, touching=True)
    for axis, pair in zip(panels, _LOOPS[directions], strict=True):
        for name, motion in motions.items():
            part = motion.last_period()
            if all(int(k) < motion.displacement.shape[2] for _, k in pair):
                values = {"u": 1e3 * motion.displacement[part], "f": motion.force[part]}
                curve = [values[kind][:, point, int(k)] for kind, k in pair]
                axis.plot(*curve, label=name, **styles[name])
        axis.set(xlabel=_quantity(pair[0], names), ylabel=_quantity(pair[1], names))
        axis.locator_params(axis="x", nbins=NARROW)
    panels[-1].set_title("orbit")


def _quantity(name: str, names: Sequence[str]) -> str:
    """Compose the axis label of a quantity of `_LOOPS`."""
    kind, k = name
    return f"{names[int(k)]} {'displacement, mm' if kind == 'u' else 'force, N'}"


@styled
def plot_modes(
    labels: Sequence[str], positions: np.ndarray, shapes: np.ndarray, names: Sequence[str]
) -> Figure:
    """Draw the displacement of shapes along the axis of a slender body.

    The axial component is on the left, the transverse ones on the right (figure 10 of the paper).
    Normal modes, static modes and derivatives have one row each. Every shape is divided by its
    largest component. A component below `LEAST_COMPONENT` is not drawn, because its line would hide
    other lines.

    Args:
        labels: one per shape, such as 1V, 2S, 1V1S.
        positions: (k,) positions along the axis, m.
        shapes: (n_labels, k, d) components, the axial one first.
        names: (d,) names of the components.
    """
    from matplotlib.lines import Line2D

    shapes = np.asarray(shapes, dtype=float)
    largest = np.abs(shapes).max(axis=(1, 2), keepdims=True)
    shapes = shapes / np.where(largest > 0, largest, 1.0)
    kinds: dict[str, list[int]] = {}
    for i, label in enumerate(labels):
        letters = "".join(re.findall("[A-Z]", label))
        alone = "normal modes" if letters == "V" else "static modes"
        kind = "derivatives" if len(letters) > 1 else alone
        kinds.setdefault(kind, []).append(i)
    columns = shapes.shape[2]
    size = 1.6 + (4.1 if columns == 2 else 3.3) * columns, 0.5 + 2.5 * len(kinds)
    figure, panels = new_panels(*size, len(kinds), columns, sharex=True, sharey=True)
    axes = np.reshape(panels, (-1, columns))
    for row, (kind, members) in zip(axes, kinds.items(), strict=True):
        styles = line_styles(labels[i] for i in members)
        for k, axis in enumerate(row):
            seen = [i for i in members if np.abs(shapes[i, :, k]).max() >= LEAST_COMPONENT]
            for i in seen:
                axis.plot(positions, shapes[i, :, k], **styles[labels[i]])
            if not seen:
                _note(axis, f"all below {100.0 * LEAST_COMPONENT:g} %")
        row[0].set_ylabel(f"{kind}\ndisplacement / largest")
        row[-1].legend(
            handles=[Line2D([], [], label=labels[i], **styles[labels[i]]) for i in members],
            loc="center left",
            bbox_to_anchor=(1.0, 0.5),
            ncols=1 + (len(members) - 1) // 9,
        )
    for axis, name in zip(axes[0], names, strict=True):
        axis.set_title(name)
    for axis in axes[-1]:
        axis.set_xlabel("position along the axis, m")
    return figure


@styled
def plot_energy(motion: Motion, work: str = LOADS) -> Figure:
    """Draw the energy balance of a motion: work, dissipation, energy and imbalance.

    The elastic energy is relative to the equilibrium. It may be negative, because static loads
    stress the body in the equilibrium.

    Args:
        motion: the motion.
        work: what does work.
    """
    touching = has_contact(motion)
    figure, (above, below) = new_panels(8.6, 4.8, 2, sharex=True, height_ratios=[3, 1])
    periodic = motion.load_period is not None
    time = motion.time / motion.load_period if motion.load_period is not None else motion.time
    energy = motion.kinetic + motion.elastic + motion.contact_energy
    # a wide curve below thin ones, and a dashed one on top: those that coincide are all seen
    above.plot(time, motion.work, color="#000000", linewidth=3.6, label=f"work of {work}")
    damping = {"color": "#0072B2", "linestyle": (0, (5, 3)), "zorder": 2.2}
    above.plot(time, motion.damping_dissipation, label="dissipated by damping", **damping)
    if touching:
        friction = motion.friction_dissipation
        above.plot(time, friction, color="#D55E00", label="dissipated by friction")
    kinds = "kinetic + elastic + contact" if touching else "kinetic + elastic"
    for part in motion.parts:
        label = f"{kinds}, relative to the equilibrium" if part.start == 0 else None
        above.plot(time[part], energy[part], color="#009E73", label=label)
        below.plot(time[part], motion.imbalance[part], color="#555B61")
        if part.start > 0:
            for axis, name in ((above, "Newton's method: periodic from here"), (below, None)):
                axis.axvline(time[part.start], color="#8c8c8c", linestyle="--", label=name)
    above.set_ylabel("energy, J")
    above.margins(x=0)
    below.set(ylabel="imbalance, J", xlabel="time / period" if periodic else "time, s")
    below.margins(x=0)
    _legend(figure, above, columns=2)
    return figure


def _plot_states(axis: Axes, motions: Mapping[str, Motion], point: int) -> None:
    """Draw one bar per model, coloured by the contact state over the last period."""
    for row, motion in enumerate(motions.values()):
        time, part = _phase(motion, 1)
        state = motion.state[part, point]
        ends = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
        starts = np.flatnonzero(np.diff(state, prepend=state[0] + 1))
        for start, stop in itertools.pairwise([*starts, len(state)]):
            colour = STATES[int(state[start])][1]
            axis.barh(row, ends[stop] - ends[start], 0.72, ends[start], color=colour)
    axis.set_yticks(range(len(motions)), list(motions))
    axis.invert_yaxis()
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)
    axis.tick_params(left=False)
    axis.margins(x=0)
    periodic = all(motion.period is not None for motion in motions.values())
    axis.set_xlabel("time / period" if periodic else "time, s")
    place: dict[str, Any] = {
        "loc": "lower right",
        "bbox_to_anchor": (1.0, 1.0),
        "borderaxespad": 0.2,
    }
    axis.legend(handles=state_handles(), ncols=3, **place)
    axis.set_title("contact state")


def _phase(motion: Motion, periods: int) -> tuple[np.ndarray, np.ndarray]:
    """Select the last periods of a motion.

    Returns:
        The time in periods since the start of the selection, and the mask of its instants. A motion
        without a period is selected as a whole, with its time in s.
    """
    if motion.period is None:
        return motion.time, np.ones(len(motion.time), dtype=bool)
    cycles = motion.time / motion.period
    last = float(cycles[-1])  # a subharmonic motion may begin at any period of the loads
    last = last if motion.period != motion.load_period else round(last)
    start = max(last - periods, 0)
    part = cycles >= start - 1e-9
    return cycles[part] - start, part


def _legend(figure: Figure, axis: Axes, columns: int | None = None) -> None:
    """Put one legend above the whole figure."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper right", ncols=columns or len(labels))


SAME_LENGTH = 0.1
"""Relative difference from which the length of the points' path is not that of their region."""

MOST_NUMBERS = 9
"""Largest number of contact points whose numbers stand at an axis."""


class ContactAxis(NamedTuple):
    """The places of P contact points along an axis.

    Attributes:
        at: (P,) places.
        label: of the axis.
        share: (P,) what forces are divided by. The nodes of a quadratic face or edge have unequal
            shares of it, and so have their forces; the force per area or length is smooth.
        unit: of a force divided by it.
    """

    at: Array
    label: str
    share: Array
    unit: str

    def write_numbers(self, axes: Axes, upright: bool = False) -> None:
        """Write numbers of contact points beside an axis that shows their positions."""
        if self.at[0] == 1.0:
            return
        wanted = np.linspace(0, self.at.size - 1, min(self.at.size, MOST_NUMBERS))
        look: dict[str, Any] = {"fontsize": 8, "color": "#0072B2"}
        axes.yaxis.get_offset_text().set_horizontalalignment("right")  # beside the first number
        if upright:
            look |= {"transform": axes.get_yaxis_transform(), "va": "center"}
        else:
            look |= {"transform": axes.get_xaxis_transform(), "va": "bottom", "ha": "center"}
        for k in np.unique(wanted.round().astype(int)):
            x, y = (1.005, self.at[k]) if upright else (self.at[k], 1.0)
            axes.text(x, y, str(k + 1), **look)


def contact_axis(points: ContactPoints | None, count: int) -> ContactAxis:
    """The axis for the points of one contact that is a region of nodes, or else for their numbers.

    In space, nodes lie on a line if the sum of their lengths is that of the path through them.
    """
    numbers = ContactAxis(np.cumsum(np.ones(count)), "contact point", np.ones(count), "N")
    if points is None or count < 2 or len(points.contact) != count or points.contact.any():
        return numbers
    if np.all(points.tributary_area == 1.0):
        return numbers
    steps = np.linalg.norm(np.diff(points.position, axis=0), axis=1)
    whole, plane = float(points.tributary_area.sum()), points.position.shape[1] == 2
    if plane or abs(steps.sum() - whole) < SAME_LENGTH * whole:
        at = 1e3 * np.append(0.0, np.cumsum(steps))
        unit = "N/m²" if plane else "N/m"
        return ContactAxis(at, "position along the contact points, mm", points.tributary_area, unit)
    return numbers._replace(share=points.tributary_area, unit="N/m²")


WEAR = "wear.csv"
FEW_RINGS = 4  # rings that have a line each; more rings are a map


def wear_summary(
    motions: Mapping[str, Motion], scene: Scene, points: ContactPoints
) -> dict[str, Any]:
    """The entry `wear` of `summary.json`; empty without abradable layers.

    Returns:
        For each model `largest_depth_m`, `worn_area_m_rad` (the largest integral of the depth over
        the angle of all rings), `worn_volume_m3`, `plastic_work_J`, `mean_torque_Nm` (the plastic
        work over the angle of rotation), and `wears_at_end` (whether a layer was worn in the last
        period).
    """
    found = {}
    for name, motion in motions.items():
        rings = wear_of(motion, scene, points)
        if rings and motion.end is not None:
            found[name] = {
                "largest_depth_m": max(float(np.max(one.depth)) for one in rings),
                "worn_area_m_rad": max(one.area for one in rings),
                "worn_volume_m3": sum(one.volume for one in rings),
                "plastic_work_J": sum(one.plastic_work for one in rings),
                "mean_torque_Nm": sum(one.mean_torque for one in rings),
                "wears_at_end": motion.end.wearing,
            }
    return {"wear": found} if found else {}


def wear_sentence(motion: Motion, scene: Scene, points: ContactPoints) -> str | None:
    """State what a motion wore; None without abradable layers."""
    found = wear_summary({"": motion}, scene, points)
    if not found:
        return None
    numbers = found["wear"][""]
    if not numbers["largest_depth_m"]:
        return "Abradable layer: not worn."
    torque, ends = numbers["mean_torque_Nm"], ""
    if motion.period is not None:
        wears = numbers["wears_at_end"]
        ends = "; still wearing at the end" if wears else "; no wear in the last period"
    return (
        f"Abradable layer: worn by at most {1e6 * numbers['largest_depth_m']:.4g} µm, "
        f"{1e9 * numbers['worn_volume_m3']:.4g} mm³ in all; plastic work "
        f"{numbers['plastic_work_J']:.4g} J"
        + (f", a mean torque of {torque:.4g} N m on the shaft" if torque else "")
        + f"{ends}."
    )


def write_wear(
    folder: Path, motions: Mapping[str, Motion], scene: Scene, points: ContactPoints
) -> list[Path]:
    """Write the worn depth of the reduced model at each node, if there is any.

    Raises:
        OSError: the file cannot be written.
    """
    rings = wear_of(motions["reduced"], scene, points) if "reduced" in motions else []
    rows = [
        {
            "ring": k + 1,
            "contact": one.ring.contact + 1,
            "position_m": one.ring.position,
            "angle_deg": np.degrees(angle),
            "depth_m": depth,
        }
        for k, one in enumerate(rings)
        for angle, depth in zip(one.ring.angle, one.depth, strict=True)
    ]
    return [write_rows(folder / WEAR, rows)] if rows else []


@styled
def plot_wear(found: Sequence[Wear]) -> Figure:
    """Draw the worn depth over the angle: a line for each of a few worn rings, or a map of many."""
    figure, (axis,) = new_panels(8.6, 3.6)
    worn = [one for one in found if np.any(one.depth)] or list(found[:1])
    worn = sorted(worn, key=lambda one: one.ring.position)
    if len(worn) <= FEW_RINGS:
        for one in worn:
            label = f"at {1e3 * one.ring.position:.4g} mm along the axis"
            degrees = np.append(np.degrees(one.ring.angle), 360.0)
            axis.plot(degrees, 1e6 * np.append(one.depth, one.depth[0]), label=label)
        axis.set(ylabel="worn depth, µm")
        axis.set_ylim(bottom=0.0)
        if len(worn) > 1:
            figure.legend(loc="outside upper right", ncols=len(worn))
    else:
        alike = [one for one in worn if one.ring.angle.size == worn[0].ring.angle.size]
        along = [1e3 * one.ring.position for one in alike]
        depth = 1e6 * np.array([one.depth for one in alike])
        degrees = np.degrees(alike[0].ring.angle)
        mesh = axis.pcolormesh(degrees, along, depth, cmap="viridis", shading="nearest")
        axis.set(ylabel="position along the axis, mm")
        axis.grid(visible=False)
        figure.colorbar(mesh, ax=axis, pad=0.01, label="worn depth, µm")
    axis.set(xlabel="angle around the axis, degrees", xlim=(0.0, 360.0))
    axis.set_xticks(np.arange(0.0, 361.0, 45.0))
    return figure


@styled
def plot_wear_over_time(time: Array, worn: Array, points: Sequence[int]) -> Figure:
    """Draw the worn depth (ns, P) before some points over the time (ns,), s."""
    figure, (axis,) = new_panels(8.6, 3.6)
    for p in points:
        axis.plot(time, 1e6 * worn[:, p], linewidth=1.0)
        axis.annotate(f"{p + 1}", (time[-1], 1e6 * worn[-1, p]), fontsize="x-small", va="center")
    axis.set(xlabel="time, s", ylabel="worn depth before each point, µm")
    axis.set_ylim(bottom=0.0)
    return figure
