"""Plots of motions, contacts, energies, mode shapes and wear."""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.motion.measures import NEGLIGIBLE, Wear, has_contact, point_summaries, wear_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.plot import Bars, Item, Line, Map, Panel, Plot, Text
from fenicsrom.post.base.style import COLOURS, EDGE, STATES, line_styles
from fenicsrom.post.base.tables import plain_names, write_rows
from fenicsrom.records import Rerun, Study
from fenicsrom.scene import Scene

HISTORY = "history.npz"
LOADS = "the loads"
LOADS_AND_SURFACES = "the loads and of moving surfaces"
LEAST_COMPONENT = 0.01  # of the largest component of a shape: the line of a smaller one is flat


def plot_motion(motions: Mapping[str, Motion], names: Sequence[str] = ()) -> Plot:
    """Displacements of the first point over the last two periods, one panel per direction.

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
    parts = {name: _phase(motion, 2) for name, motion in motions.items()}
    moved = {name: 1e3 * each.displacement[parts[name][1], 0] for name, each in motions.items()}
    sizes = {name: np.ptp(values, axis=0) for name, values in moved.items()}
    largest = max(float(size.max()) for size in sizes.values())
    count = max(motion.state.shape[1] for motion in motions.values())
    place = "contact point" if touching else "probe"
    panels = []
    for k in range(directions):
        there = [name for name, values in moved.items() if k < values.shape[1]]
        lines: list[Item] = [
            Line(parts[name][0], moved[name][:, k], label=name, **styles[name]) for name in there
        ]
        look: dict[str, Any] = {"ylabel": f"{names[k]}\ndisplacement, mm", "tight": "x"}
        if all(sizes[name][k] < NEGLIGIBLE * largest for name in there):
            lines, look["yticks"] = [NOISE], {0.0: ""}
        if k == 0:
            look["title"] = f"{place} 1 of {count}" if count > 1 else place
        panels.append(Panel(lines, **look))
    height = 0.7 + 2.2 * directions
    return Plot(panels, 8.6, height, share="x", xlabel=_time_label(motions))


def _time_label(motions: Mapping[str, Motion]) -> str:
    """The label of the axis of time."""
    periodic = all(motion.period is not None for motion in motions.values())
    return "time / period" if periodic else "time, s"


def probe_motions(found: Study | Rerun) -> dict[str, Motion]:
    """The motions of [probe] where they stand beside those of contact points."""
    if found.scene.probe is None or not found.scene.contacts:
        return {}
    pairs = ((name, motion.at_probe()) for name, motion in found.motions.items())
    return {name: motion for name, motion in pairs if motion is not None}


def plot_sizes(errors: Mapping[int, float], size: int, limit: float) -> Plot:
    """The error due to the basis over the number of coordinates.

    Args:
        errors: number of coordinates of each model that was tried -> its estimated error.
        size: that of the run, whose point is filled.
        limit: largest accepted error.
    """
    sizes = sorted(errors)
    percent = [100.0 * errors[n] for n in sizes]
    chosen = [n == size for n in sizes]
    look: dict[str, Any] = {"linestyle": "", "marker": "o"}
    items: list[Item] = [
        Line(None, np.full(2, 100.0 * limit), "--", EDGE, 1.0, label="basis.accuracy"),
        Line(sizes, percent, "-", "#b0b6bc", 0.8),
        Line(sizes, percent, hollow=True, label="tried", **look),
        Line(np.extract(chosen, sizes), np.extract(chosen, percent), label="this run", **look),
    ]
    labels: dict[str, Any] = {
        "xlabel": "number of coordinates",
        "ylabel": "estimated error of the basis, %",
    }
    return Plot([Panel(items, **labels, log="y", whole="x")], 5.4, 3.6)


def note(text: str) -> Text:
    """A text in the middle of an empty panel."""
    return Text(0.5, 0.6, text, "xy", ha="center", fontsize=10.5)


NOISE = note(f"amplitude below {NEGLIGIBLE:g} of the largest")
"""What an empty panel says whose curves would show rounding errors."""

# Number of directions -> the panels of a contact point, each with its quantities on the x and y
# axis. A quantity is the displacement u or the force f in direction 0 (normal), 1 or 2
# (tangential). The last panel is the orbit of the point.
_LOOPS = {
    2: ((("u", 1), ("f", 1)), (("u", 0), ("f", 0)), (("u", 1), ("u", 0))),
    3: ((("u", 1), ("f", 1)), (("u", 2), ("f", 2)), (("u", 0), ("f", 0)), (("u", 1), ("u", 2))),
}


def plot_contact(motions: Mapping[str, Motion], point: int = 0, names: Sequence[str] = ()) -> Plot:
    """Contact states over the last period, and contact forces against displacements.

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
    loops = _loops(motions, point, names)
    columns = 3 if len(loops) == 3 else 2
    rows = len(loops) // columns
    strip = 0.75 + 0.33 * len(motions)
    panels = [_states(motions, point, (0, 0, 1, columns))]
    for k, (items, look) in enumerate(loops):
        panels.append(Panel(items, **look, place=(1 + k // columns, k % columns, 1, 1)))
    size = 4.1 * columns if columns == 2 else 10.8, 0.7 + strip + 3.3 * rows
    heights = [0.33 * len(motions), *[2.5] * rows]
    return Plot(panels, *size, columns, heights)


def plot_points(
    motions: Mapping[str, Motion], names: Sequence[str] = (), places: ContactPoints | None = None
) -> Plot:
    """The peak force, the time in contact and the dissipation of all contact points.

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
    line = contact_axis(places, len(points[first]))
    work = f"friction dissipation, {line.unit.replace('N', 'J')}"
    curves: dict[str, tuple[Callable[[Mapping[str, Any]], float], Any]] = {
        f"peak normal force, {line.unit}": (itemgetter("peak_normal_force_N"), line.share),
        "time in contact, %": (lambda point: 100.0 * (1.0 - point["fraction"]["open"]), 1.0),
        work: (itemgetter("friction_dissipation_per_period_J"), line.share),
    }
    panels = []
    for k, (label, (value, share)) in enumerate(curves.items()):
        items: list[Item] = [*line.numbers()]
        for name in motions:
            found = np.array([value(point) for point in points[name]])
            along = found.size == line.at.size
            at, heights = (line.at, found / share) if along else (np.arange(found.size) + 1, found)
            notes = [f"contact point {k + 1}" for k in range(len(found))]
            look: dict[str, Any] = {"marker": "o", "markersize": 3.5, **styles[name]}
            items.append(Line(at, heights, label=name, notes=notes, **look))
        at_row = (0, *_columns(3)[k])
        panels.append(Panel(items, line.label, label, whole="x", place=at_row))
    there = {name: motion for name, motion in motions.items() if motion.state.shape[1] > hardest}
    loops = _loops(there, hardest, names)
    for k, (items, shown) in enumerate(loops):
        title = f"point {hardest + 1}: largest force" if k == 0 else shown.pop("title", "")
        at_row = (1, *_columns(len(loops))[k])
        panels.append(Panel(items, **shown, title=title, place=at_row))
    return Plot(panels, 3.6 * len(loops), 7.2)


COLUMNS = 12
"""Columns of a grid with a row of three panels and a row of three or four."""


def _columns(count: int) -> list[tuple[int, int, int]]:
    """The first column, and the number of rows and columns, of each of some panels in a row."""
    width = COLUMNS // count
    return [(k * width, 1, width) for k in range(count)]


def _loops(
    motions: Mapping[str, Motion], point: int, names: Sequence[str]
) -> list[tuple[list[Item], dict[str, Any]]]:
    """The lines and labels of each of `_LOOPS` of a contact point over the last period."""
    styles = line_styles(motions)
    directions = max((motion.displacement.shape[2] for motion in motions.values()), default=2)
    names = names or plain_names(directions, touching=True)
    found: list[tuple[list[Item], dict[str, Any]]] = []
    for pair in _LOOPS[directions]:
        items: list[Item] = []
        for name, motion in motions.items():
            part = motion.last_period()
            if all(k < motion.displacement.shape[2] for _, k in pair):
                values = {"u": 1e3 * motion.displacement[part], "f": motion.force[part]}
                x, y = (values[kind][:, point, k] for kind, k in pair)
                items.append(Line(x, y, label=name, **styles[name]))
        units = {"u": "displacement, mm", "f": "force, N"}
        across, up = (f"{names[k]} {units[kind]}" for kind, k in pair)
        found.append((items, {"xlabel": across, "ylabel": up}))
    found[-1][1]["title"] = "orbit"
    return found


def plot_modes(
    labels: Sequence[str], positions: Array, shapes: Array, names: Sequence[str]
) -> Plot:
    """The displacement of shapes along the axis of a slender body.

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
    shapes = np.asarray(shapes, dtype=float)
    largest = np.abs(shapes).max(axis=(1, 2), keepdims=True)
    shapes = shapes / np.where(largest > 0, largest, 1.0)
    kinds: dict[str, list[int]] = {}
    for i, label in enumerate(labels):
        letters = "".join(re.findall("[A-Z]", label))
        alone = "normal modes" if letters == "V" else "static modes"
        kind = "derivatives" if len(letters) > 1 else alone
        kinds.setdefault(kind, []).append(i)
    columns, panels = shapes.shape[2], []
    for row, (kind, members) in enumerate(kinds.items()):
        styles = line_styles(labels[i] for i in members)
        for k in range(columns):
            seen = [i for i in members if np.abs(shapes[i, :, k]).max() >= LEAST_COMPONENT]
            items: list[Item] = [
                Line(positions, shapes[i, :, k], label=labels[i], **styles[labels[i]]) for i in seen
            ]
            look: dict[str, Any] = {"title": names[k]} if row == 0 else {}
            if k == 0:
                look["ylabel"] = f"{kind}\ndisplacement / largest"
            if k == columns - 1:
                look["legend"] = [Line(label=labels[i], **styles[labels[i]]) for i in members]
            panels.append(
                Panel(items or [note(f"all below {100.0 * LEAST_COMPONENT:g} %")], **look)
            )
    size = 1.6 + (4.1 if columns == 2 else 3.3) * columns, 0.5 + 2.5 * len(kinds)
    across = "position along the axis, m"
    return Plot(panels, *size, columns, share="xy", xlabel=across, legend=())


def plot_energy(motion: Motion, work: str = LOADS) -> Plot:
    """The energy balance of a motion: work, dissipation, energy and imbalance.

    The elastic energy is relative to the equilibrium. It may be negative, because static loads
    stress the body in the equilibrium.

    Args:
        motion: the motion.
        work: what does work.
    """
    touching = has_contact(motion)
    time = motion.time / (motion.load_period or 1.0)
    energy = motion.kinetic + motion.elastic + motion.contact_energy
    # a wide curve below thin ones, and a dashed one on top: those that coincide are all seen
    above: list[Item] = [
        Line(time, motion.work, color=COLOURS[-1], linewidth=3.6, label=f"work of {work}"),
        Line(time, motion.damping_dissipation, "--", zorder=2.2, label="dissipated by damping"),
    ]
    if touching:
        friction = motion.friction_dissipation
        above.append(Line(time, friction, color=COLOURS[1], label="dissipated by friction"))
    below: list[Item] = []
    kinds = "kinetic + elastic + contact" if touching else "kinetic + elastic"
    label = f"{kinds}, relative to the equilibrium"
    for part in motion.parts:
        above.append(Line(time[part], energy[part], color=COLOURS[2], label=label))
        below.append(Line(time[part], motion.imbalance[part], color=EDGE))
        if part.start > 0:
            name = "Newton's method: periodic from here"
            jump = Line(np.full(2, time[part.start]), None, "--", "#8c8c8c", label=name)
            above.append(jump)
            below.append(jump)
    across = "time / period" if motion.load_period is not None else "time, s"
    panels = [
        Panel(above, ylabel="energy, J", tight="x"),
        Panel(below, across, "imbalance, J", tight="x"),
    ]
    return Plot(panels, 8.6, 5.0, heights=(3, 1), share="x")


def _states(motions: Mapping[str, Motion], point: int, place: Any) -> Panel:
    """One row for each model, coloured by the contact state over the last period."""
    bars = []
    for row, motion in enumerate(motions.values()):
        time, part = _phase(motion, 1)
        state = motion.state[part, point]
        ends = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
        starts = np.flatnonzero(np.diff(state, prepend=state[0] + 1))
        pairs = np.array([*itertools.pairwise([*starts, len(state)])])
        for number, (name, colour) in STATES.items():
            begin, stop = ends[pairs[state[pairs[:, 0]] == number]].T
            low = np.full(begin.shape, -row - 0.36)
            bars.append(Bars(begin, stop, low, low + 0.72, colour, label=name))
    names = {-float(row): name for row, name in enumerate(motions)}
    look: dict[str, Any] = {"title": "contact state", "yticks": names, "plain": True}
    return Panel(bars, _time_label(motions), **look, tight="x", place=place)


def _phase(motion: Motion, periods: int) -> tuple[Array, NDArray[np.bool_]]:
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

    def numbers(self, upright: bool = False) -> list[Text]:
        """Numbers of contact points beside an axis that shows their positions."""
        if self.at[0] == 1.0:
            return []
        wanted = np.linspace(0, self.at.size - 1, min(self.at.size, MOST_NUMBERS))
        look: dict[str, Any] = {"fontsize": 8.0, "color": COLOURS[0]}
        chosen = np.unique(wanted.round().astype(int))
        if upright:
            return [Text(1.005, self.at[k], f"{k + 1}", "x", **look) for k in chosen]
        look |= {"ha": "center", "va": "bottom", "shift": (0.0, 1.0)}
        return [Text(self.at[k], 1.0, f"{k + 1}", "y", **look) for k in chosen]


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


def plot_wear(found: Sequence[Wear]) -> Plot:
    """The worn depth over the angle: a line for each of a few worn rings, or a map of many."""
    worn = [one for one in found if np.any(one.depth)] or list(found[:1])
    worn = sorted(worn, key=lambda one: one.ring.position)
    items: list[Item] = []
    look: dict[str, Any] = {"ylabel": "worn depth, µm", "ylim": (0.0, None)}
    if len(worn) <= FEW_RINGS:
        for one, style in zip(worn, line_styles(map(str, range(len(worn)))).values(), strict=True):
            label = f"at {1e3 * one.ring.position:.4g} mm along the axis" if worn[1:] else ""
            degrees = np.append(np.degrees(one.ring.angle), 360.0)
            depth = 1e6 * np.append(one.depth, one.depth[0])
            items.append(Line(degrees, depth, label=label, **style))
    else:
        alike = [one for one in worn if one.ring.angle.size == worn[0].ring.angle.size]
        along = [1e3 * one.ring.position for one in alike]
        depth = 1e6 * np.array([one.depth for one in alike])
        degrees = np.degrees(alike[0].ring.angle)
        items.append(Map(degrees, along, depth, bar="worn depth, µm"))
        look = {"ylabel": "position along the axis, mm", "tight": "y"}
    ticks = {float(angle): f"{angle}" for angle in range(0, 361, 45)}
    across = "angle around the axis, degrees"
    return Plot([Panel(items, across, xlim=(0.0, 360.0), xticks=ticks, **look)], 8.6, 3.6)


def plot_wear_over_time(time: Array, worn: Array, points: Sequence[int]) -> Plot:
    """The worn depth (ns, P) before some points over the time (ns,), s."""
    styles = line_styles(f"{p}" for p in points)
    items: list[Item] = []
    for p, style in zip(points, styles.values(), strict=True):
        depth = 1e6 * worn[:, p]
        items.append(Line(time, depth, **{**style, "linewidth": 1.0}))
        items.append(Text(time[-1], depth[-1], f"{p + 1}", fontsize=8.0, shift=(2.0, 0.0)))
    labels = "time, s", "worn depth before each point, µm"
    return Plot([Panel(items, *labels, ylim=(0.0, None))], 8.6, 3.6)
