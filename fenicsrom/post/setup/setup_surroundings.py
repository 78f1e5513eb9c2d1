"""What surrounds the body in the picture of a set-up: its axis of rotation and round surfaces.

They are often much larger than the body. The picture of the body shows the part of them that lies
in it. A second panel shows all of them, where they reach beyond the picture of the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body.body_drawing import draw_body, show_part
from fenicsrom.post.body.body_surface import Surface
from fenicsrom.post.body.body_view import View, frame_of
from fenicsrom.post.setup.setup_marks import ContactMark, Marks, RotationMark
from fenicsrom.post.setup.setup_symbols import AXIS_LINE, MARK_COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPARE = 0.15
"""Length of the axis of rotation beyond what it passes, relative to the extent along it."""

TURN = 0.035
"""Radius of the arrow around the axis of rotation, relative to the size of the picture."""

OVERVIEW = 0.32
"""Width of the second panel, relative to the picture of the body."""

MOST_NUMBERS = 6
"""Largest number of contact points that all have numbers; of more, the first and the last have."""

NUMBERS_APART = 0.025
"""Smallest distance of two points with numbers in the picture, relative to the size of the body."""


def numbered_points(contacts: Sequence[ContactMark]) -> dict[int, Array]:
    """The numbers of contact points in the picture and their places (3,); none of a single point.

    Of many points, the first and the last of each contact have numbers.
    """
    places: dict[int, Array] = {}
    for mark in contacts:
        places |= dict(enumerate(list(mark.places), mark.first))
    if len(places) == 1:
        return {}
    if len(places) <= MOST_NUMBERS:
        return places
    ends = {n for mark in contacts for n in (mark.first, mark.first + len(mark.places) - 1)}
    return {number: places[number] for number in sorted(ends)}


def draw_numbers(axis: Axes, view: View, contacts: Sequence[ContactMark]) -> None:
    """Write the numbers of contact points beside them, against the normals into their walls.

    A number that would lie on an earlier one is left out.
    """
    from matplotlib.patheffects import withStroke

    normals: dict[int, Array] = {}
    for mark in contacts:
        normals |= dict(enumerate(list(mark.normals), mark.first))
    taken: Array = np.full((1, 2), np.inf)
    for number, place in numbered_points(contacts).items():
        (at,), (way,) = view.project(place[None]), view.project(normals[number][None])
        if np.linalg.norm(taken - at, axis=1).min() < NUMBERS_APART * view.length:
            continue
        taken = np.append(taken, at[None], axis=0)
        size = float(np.linalg.norm(way))
        shift = -10.0 * way / size if size > 0.0 else np.array([0.0, -10.0])
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "zorder": 7}
        text["path_effects"] = [withStroke(linewidth=2.5, foreground="white")]
        axis.annotate(
            str(number),
            (float(at[0]), float(at[1])),
            (float(shift[0]), float(shift[1])),
            textcoords="offset points",
            color=MARK_COLOURS["contact"],
            **text,
        )


def axis_ends(rotation: RotationMark, places: Array) -> Array:
    """The ends (2, 3) of the drawn part of the axis of rotation, beside places (n, 3)."""
    along = (places - rotation.point) @ rotation.axis
    spare = SPARE * float(np.ptp(places, axis=0).max())
    return np.asarray(
        rotation.point + np.outer([along.min() - spare, along.max() + spare], rotation.axis)
    )


def turning_arrow(rotation: RotationMark, centre: Array, radius: float) -> Array:
    """An arc (n, 3) around the axis, in the sense in which the body turns."""
    first = np.eye(3)[int(np.argmin(np.abs(rotation.axis)))]
    across = np.cross(rotation.axis, first)
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 1.6 * np.pi, 33)[:, None]
    upward = np.cross(rotation.axis, across)
    return np.asarray(centre + radius * (np.cos(angle) * across + np.sin(angle) * upward))


def surroundings(marks: Marks, places: Array) -> list[Array]:
    """Lines (n, 3) that show the round surfaces and the axis of rotation, in this order."""
    lines = [line for mark in marks.contacts for line in mark.lines]
    if marks.rotation is not None:
        lines.append(axis_ends(marks.rotation, np.concatenate([places, *lines])))
    return lines


def draw_surroundings(axis: Axes, view: View, marks: Marks, lines: Sequence[Array]) -> None:
    """Draw the lines of `surroundings` in a panel whose limits are set."""
    low, high = (np.array(limits) for limits in zip(axis.get_xlim(), axis.get_ylim(), strict=True))
    round_lines = lines if marks.rotation is None else lines[:-1]
    for line in round_lines:
        axis.plot(*view.project(line).T, color=MARK_COLOURS["contact"], lw=1.0, alpha=0.6, zorder=1)
    if marks.rotation is None:
        return
    look: dict[str, Any] = {"color": MARK_COLOURS["rotation"], "zorder": 4.2}
    seen = view.project(lines[-1])
    axis.plot(*seen.T, lw=1.3, linestyle=AXIS_LINE, **look)
    inside = np.flatnonzero(np.all((low < seen) & (seen < high), axis=1))
    if not inside.size:
        return
    arc = view.project(
        turning_arrow(marks.rotation, lines[-1][inside[-1]], TURN * float(np.max(high - low)))
    )
    axis.plot(*arc[:-2].T, lw=1.5, **look)
    head, tail = ((float(x), float(y)) for x, y in (arc[-1], arc[-3]))
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", head, tail, arrowprops={**arrow, "color": look["color"]}, zorder=4.2)
    if np.linalg.norm(seen[1] - seen[0]) < TURN * float(np.max(high - low)):
        axis.plot(*seen[0], "o", markersize=4, **look)  # seen along the axis


def draw_overview(
    figure: Figure, axis: Axes, surface: Surface, view: View, marks: Marks, lines: Sequence[Array]
) -> None:
    """Draw the whole surroundings beside the picture of the body, if they reach beyond it."""
    if not lines:
        return
    every = [view.project(line) for line in (surface.points, *lines)]
    low, high = frame_of(every, 0.0)
    shown = (np.array(limits) for limits in zip(axis.get_xlim(), axis.get_ylim(), strict=True))
    inner_low, inner_high = shown
    if np.all(low >= inner_low) and np.all(high <= inner_high):
        return
    spare = 2.0 * TURN * float(np.max(high - low))
    width, height = figure.get_size_inches()
    figure.set_size_inches(width * (1.0 + OVERVIEW), height)
    panel = axis.inset_axes((1.02, 0.0, OVERVIEW, 1.0))
    show_part(panel, low - spare, high + spare)
    draw_body(panel, surface, view)
    draw_surroundings(panel, view, marks, lines)
