"""Pictures of contacts between bodies: maps on the contact area, and forces over time."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.joints import Joint, joints_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.plot import Dots, Item, Line, Panel, Plot
from fenicsrom.post.base.style import SOFT, STATES, line_styles
from fenicsrom.records import Rerun, Study

JOINTS = "joints.csv"

MAP_CAPTION = (
    "The contact area: pressure in the equilibrium, part of the last period (or of the motion) in "
    "each state, and energy that friction dissipates in it by area."
)
FORCE_CAPTION = (
    "Force and moment of the contact on its first region, in global axes; moments about the "
    "centroid of the contact points."
)


def found_joints(found: Study | Rerun) -> dict[str, list[Joint]]:
    """The contacts between bodies in each motion of a run, by the names of the models."""
    if not found.scene.joined or not isinstance(found.model, ReducedModel):
        return {}
    rest = found.model.contact_offset
    return {
        name: joints_of(motion, found.scene, found.points, rest)
        for name, motion in found.motions.items()
    }


def joint_pictures(found: Study | Rerun) -> list[Picture]:
    """The pictures of each contact between bodies."""
    every, listed = found_joints(found), []
    for k, same in enumerate(zip(*every.values(), strict=True), 1):
        number = f"_{k}" * (len(next(iter(every.values()))) > 1)
        title, joints = f"Contact {same[0].contact + 1}", dict(zip(every, same, strict=True))
        listed += [
            Picture(
                f"{title}: maps",
                f"joint_map{number}.png",
                partial(plot_joint_map, same[0]),
                MAP_CAPTION,
            ),
            Picture(
                f"{title}: force and moment",
                f"joint{number}.png",
                partial(plot_joint_force, joints, found.motions),
                FORCE_CAPTION,
                JOINTS,
            ),
        ]
    return listed


def plot_joint_map(joint: Joint) -> Plot:
    """Pressure, states and dissipated energy over the contact area of a joint."""
    order = np.argsort(-np.ptp(joint.places, axis=0), kind="stable")[: joint.places.shape[1] - 1]
    order.sort()
    at = 1e3 * joint.places[:, order]
    labels: tuple[str, ...] = tuple(f"{'xyz'[axis]}, mm" for axis in order)
    pressure, energy = "pressure at rest, MPa", "friction, J/m²"
    maps = {pressure: 1e-6 * joint.pressure}
    maps |= {f"{state}, % of the time": 100.0 * part for state, part in joint.shares.items()}
    maps[energy] = joint.dissipation
    if len(order) == 2:
        x, y = at.T
        panels = [
            Panel(
                [Dots(x=x, y=y, values=values, bar=name, vmin=0.0, markersize=7.0)],
                labels[0],
                labels[1],
            )
            for name, values in maps.items()
        ]
        return Plot(panels, 12.0, 6.4, 3)
    look: dict[str, Any] = {"marker": "o", "markersize": 3.5}
    colours = dict(STATES.values()) | {"open": SOFT}
    states = [
        Line(at[:, 0], 100.0 * part, color=colours[state], label=state, **look)
        for state, part in joint.shares.items()
    ]
    panels = [
        Panel([Line(at[:, 0], maps[pressure], **look)], labels[0], pressure),
        Panel(states, labels[0], "part of the time, %"),
        Panel([Line(at[:, 0], maps[energy], **look)], labels[0], energy),
    ]
    return Plot(panels, 11.0, 3.4, 3)


def plot_joint_force(joints: Mapping[str, Joint], motions: Mapping[str, Motion]) -> Plot:
    """Force and moment through a joint over the last period, by the names of the models."""
    styles, panels = line_styles(motions), []
    for name in next(iter(joints.values())).columns:
        kind, axis, unit = name.split("_")
        items: list[Item] = []
        for model, joint in joints.items():
            motion = motions[model]
            part = motion.last_period()
            time = (motion.time[part] - motion.time[part][0]) / (motion.period or 1.0)
            items.append(Line(time, joint.columns[name][part], label=model, **styles[model]))
        panels.append(Panel(items, "", f"{kind} {axis}, {unit.replace('Nm', 'N m')}"))
    across = "time / period" if next(iter(motions.values())).period else "time, s"
    return Plot(panels, 8.6, 0.9 + 1.4 * len(panels), share="x", xlabel=across)


def joint_table(joints: list[Joint]) -> list[dict[str, Any]]:
    """What `summary.json` has of each joint."""
    return [
        {
            "contact": joint.contact,
            "friction_dissipation_per_period_J": float(joint.dissipation @ joint.area),
            "largest_pressure_at_rest_Pa": float(joint.pressure.max()),
            "largest": {name: float(np.abs(c).max()) for name, c in joint.columns.items()},
        }
        for joint in joints
    ]


def joint_rows(joints: list[Joint], time: Array) -> list[Mapping[str, Any]]:
    """The rows of `joints.csv`: force, moment and dissipated energy of each joint over time."""
    columns: dict[str, Array] = {"time_s": time}
    for joint in joints:
        start = f"contact_{joint.contact + 1}_"
        columns |= {start + name: values for name, values in joint.columns.items()}
        columns[f"{start}friction_dissipation_J"] = joint.spent
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
