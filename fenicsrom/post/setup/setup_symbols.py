"""The symbols of supports, loads, attachments, contacts and the probe in the picture of a set-up.

Each symbol has a form and a colour of its own, so that readers who cannot tell the colours apart
see the form.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.body.body_surface import Surface
from fenicsrom.post.body.body_view import View
from fenicsrom.post.setup.setup_marks import (
    CLAMPED,
    AttachmentMark,
    ContactMark,
    LoadMark,
    Marks,
    SupportMark,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARK_COLOURS = {
    "support": "#56585A",
    "load": "#D55E00",
    "attachment": "#882255",
    "contact": "#0072B2",
    "probe": "#009E73",
    "rotation": "#332288",
}

REGION_COLOURS = {"loaded": "#F3C6A5", "clamped": "#56585A", "held": "#9AA1A8"}
"""Colours of the regions of loads, and of supports that hold all or some components."""

MOST_BARS = 7
"""Points of a support at which its held directions are drawn."""

APART = 0.045
"""Distance of two arrows or symbols at one place, relative to the size of the body."""

DOT = 0.15
"""Length of an arrow that is drawn as a dot, relative to its true length."""

NUMBER = 0.16
"""Distance of a number from the tail of its arrow, relative to the true length of the arrow."""

SAME_WAY = 0.9
"""Cosine of the angle from which two arrows have the same direction."""

CONTACT_FORMS = ("o", "s", "D", "^", "v", "P", "X")
"""Markers of the points of the contacts."""

AXIS_LINE: Any = (0, (8, 2, 1.5, 2))
"""The line style of the axis of rotation."""

ARROW = r"$\rightarrow$"
"""The marker of an arrow in the legend."""


class Arrow(NamedTuple):
    """The arrow of a load in the picture.

    Attributes:
        number: number of its load.
        start, end: (2,) m.
    """

    number: int
    start: Array
    end: Array


def load_arrows(loads: Sequence[LoadMark], view: View, reach: float) -> list[Arrow]:
    """Place the arrows of loads; those of one place and direction are drawn side by side.

    The first one stays at its place: a concentrated load, if there is one. The others turn away
    from it.
    """
    arrows = [
        Arrow(number, *view.project(np.array([place - reach * load.direction, place])))
        for number, load in enumerate(loads)
        for place in load.places
    ]
    shifted = []
    for arrow in arrows:
        beside = [other for other in arrows if _coincide(arrow, other, APART * view.length)]
        beside.sort(key=lambda other: (bool(loads[other.number].on.any()), other.number))
        rank = [other.number for other in beside].index(arrow.number)
        way = arrow.end - arrow.start
        across = np.array([way[1], -way[0]]) / (np.linalg.norm(way) or 1.0)
        first = beside[0].end - beside[0].start
        turned = -1.0 if across @ first < 0.0 else 1.0
        shift = turned * rank * APART * view.length * across
        shifted.append(Arrow(arrow.number, arrow.start + shift, arrow.end + shift))
    return shifted


def _coincide(arrow: Arrow, other: Arrow, near: float) -> bool:
    """Whether two arrows would lie on one another."""
    a, b = arrow.end - arrow.start, other.end - other.start
    same = a @ b >= SAME_WAY * np.linalg.norm(a) * np.linalg.norm(b)
    return bool(same and np.linalg.norm(arrow.end - other.end) < near)


def number_places(arrows: Sequence[Arrow], reach: float, taken: Array) -> list[Array]:
    """Places (2,) of the numbers of arrows: behind or beside their tails, where there is room.

    Arguments as for `draw_arrows`.
    """
    shafts = [start + np.linspace(0.0, 1.0, 8)[:, None] * (end - start) for _, start, end in arrows]
    every: Array = np.concatenate([np.zeros((0, 2)), taken, *shafts])
    places: list[Array] = []
    for _, start, end in arrows:
        size = float(np.linalg.norm(end - start))
        way = np.array([0.0, -1.0])
        if size > DOT * reach:
            way = (end - start) / size
        across = np.array([-way[1], way[0]])
        steps = np.array([[1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [2, 0], [2, 1], [2, -1]])
        options = start + NUMBER * reach * steps @ [-way, across]
        apart = np.linalg.norm(options[:, None] - np.array([*every, *places]), axis=2).min(axis=1)
        free = np.flatnonzero(apart > 0.9 * NUMBER * reach)
        places.append(options[free[0] if free.size else int(np.argmax(apart))])
    return places


def draw_arrows(
    axis: Axes, arrows: Sequence[Arrow], reach: float, numbered: bool, taken: Array
) -> None:
    """Draw the arrows of loads with their numbers; one that is seen from its end is a dot.

    Args:
        axis: the panel.
        arrows: the arrows.
        reach: the length of an arrow that is seen from its side, m.
        numbered: whether the loads have numbers.
        taken: (k, 2) places where no number may stand, m.
    """
    from matplotlib.patheffects import withStroke

    colour = MARK_COLOURS["load"]
    look: dict[str, Any] = {
        "arrowstyle": "-|>",
        "color": colour,
        "lw": 2.2,
        "shrinkA": 0,
        "shrinkB": 0,
    }
    places = number_places(arrows, reach, taken)
    for (number, start, end), place in zip(arrows, places, strict=True):
        if np.linalg.norm(end - start) > DOT * reach:
            head, tail = ((float(x), float(y)) for x, y in (end, start))
            axis.annotate("", head, tail, arrowprops=look, zorder=5)
        else:
            axis.plot(*end, "o", color=colour, markersize=9, zorder=5)
        if numbered:
            text: dict[str, Any] = {"ha": "center", "va": "center", "weight": "bold"}
            text["path_effects"] = [withStroke(linewidth=3.0, foreground="white")]
            x, y = place
            axis.text(x, y, str(number + 1), color=colour, fontsize=10, zorder=7, **text)


def bars(mark: SupportMark, surface: Surface, view: View, reach: float) -> Array:
    """The lines (k, 2, 2) from points of a support along its held directions, out of the body."""
    nodes = np.flatnonzero(mark.on)
    if not len(nodes) or not len(mark.directions):
        return np.zeros((0, 2, 2))
    seen = view.project(surface.points[nodes])
    chosen, away = [0], np.full(len(nodes), np.inf)
    for _ in range(MOST_BARS - 1):
        away = np.minimum(away, np.linalg.norm(seen - seen[chosen[-1]], axis=1))
        if away.max() < APART * view.length:
            break
        chosen.append(int(np.argmax(away)))
    middle = surface.points.mean(axis=0)
    lines = []
    for direction in mark.directions:
        outward = np.sign((surface.points[nodes].mean(axis=0) - middle) @ direction) or 1.0
        for place in surface.points[nodes[chosen]]:
            lines.append(view.project(np.array([place, place + reach * outward * direction])))
    return np.array(lines)


def draw_bars(axis: Axes, lines: Array) -> None:
    """Draw lines (k, 2, 2) that end in a bar across, as a wall that holds them."""
    from matplotlib.collections import LineCollection

    if not len(lines):
        return
    way = lines[:, 1] - lines[:, 0]
    across = 0.3 * np.column_stack([way[:, 1], -way[:, 0]])
    ends = np.stack([lines[:, 1] - across, lines[:, 1] + across], axis=1)
    both: Any = np.concatenate([lines, ends])
    axis.add_collection(
        LineCollection(both, colors=MARK_COLOURS["support"], linewidths=1.8, zorder=3.5)
    )


_ZIGZAG = [(0.15 + 0.1 * k, 0.0 if k in (0, 7) else 0.15 * (-1) ** k) for k in range(8)]
_GROUND = ([(1.0, -0.2), (1.0, 0.2)], *([(1.0, y), (1.09, y - 0.09)] for y in (-0.1, 0.05, 0.2)))
_FORMS: dict[str, tuple[list[tuple[float, float]], ...]] = {
    "spring": ([(0.0, 0.0), *_ZIGZAG, (1.0, 0.0)], *_GROUND),
    "dashpot": (
        [(0.0, 0.0), (0.5, 0.0)],
        [(0.5, -0.1), (0.5, 0.1)],
        [(0.35, -0.16), (0.7, -0.16), (0.7, 0.16), (0.35, 0.16)],
        [(0.7, 0.0), (1.0, 0.0)],
        *_GROUND,
    ),
}
"""Lines of the symbols from the body at (0, 0) to the ground at (1, 0)."""

_BAR = ([(0.0, 0.0), (1.0, 0.0)], [(1.0, -0.16), (1.0, 0.16)])
"""The same of a held direction, in the legend."""


class Symbol(NamedTuple):
    """The symbol of an attachment in the picture.

    Attributes:
        kind: "mass", "spring" or "dashpot".
        place: (2,) the place of the attachment, m.
        lines: lines (k, 2) of the symbol, m; empty for a mass.
    """

    kind: str
    place: Array
    lines: list[Array]


def attachment_symbols(
    attachments: Sequence[AttachmentMark], view: View, reach: float, taken: Array
) -> list[Symbol]:
    """Place the symbols of attachments where nothing else is drawn.

    Args:
        attachments: the attachments.
        view: the projection.
        reach: length of a symbol, m.
        taken: (k, 2) places of arrows and other symbols, m.
    """
    symbols = []
    for mark in attachments:
        (place,) = view.project(mark.place[None])
        if mark.kind not in _FORMS:
            symbols.append(Symbol(mark.kind, place, []))
            continue
        options = [
            (place + offset * APART * view.length * np.array([-way[1], way[0]]), reach * way)
            for way in np.array([[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0], [1.0, 0.0]])
            for offset in (0, 1, -1)
        ]
        free = [_distance(taken, foot, way) for foot, way in options]
        near = 0.8 * APART * view.length
        best = next((k for k, found in enumerate(free) if found > near), int(np.argmax(free)))
        foot, way = options[best]
        taken = np.concatenate([taken, _along(foot, way)])
        turn = np.array([way, [-way[1], way[0]]])
        symbols.append(
            Symbol(mark.kind, place, [foot + np.array(x) @ turn for x in _FORMS[mark.kind]])
        )
    return symbols


def _along(foot: Array, way: Array) -> Array:
    """Places (3, 2) along a symbol."""
    return np.asarray(foot + np.outer([0.3, 0.65, 1.0], way))


def _distance(taken: Array, foot: Array, way: Array) -> float:
    """Smallest distance between a symbol and places (k, 2), m."""
    apart = _along(foot, way)[:, None] - taken[None]
    return float(np.min(np.linalg.norm(apart, axis=2), initial=np.inf))


def draw_attachments(axis: Axes, symbols: Sequence[Symbol]) -> None:
    """Draw the symbols of attachments."""
    look: dict[str, Any] = {"color": MARK_COLOURS["attachment"], "zorder": 5.5}
    for kind, place, lines in symbols:
        for line in lines:
            axis.plot(*line.T, lw=1.5, solid_capstyle="round", **look)
        if lines and np.linalg.norm(lines[0][0] - place) > 0.0:
            axis.plot(*np.transpose([place, lines[0][0]]), lw=1.5, **look)
        if kind == "mass":
            axis.plot(*place, zorder=5.5, linestyle="none", **_MASS)


def draw_contacts(axis: Axes, view: View, contacts: Sequence[ContactMark], reach: float) -> None:
    """Draw contact points with the normals into their walls."""
    colour = MARK_COLOURS["contact"]
    for form, mark in zip(itertools.cycle(CONTACT_FORMS), contacts, strict=False):
        at, ways = view.project(mark.places), view.project(reach * mark.normals)
        axis.quiver(
            *at.T,
            *ways.T,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color=colour,
            width=0.0018,
            headwidth=5.0,
            headlength=6.0,
            headaxislength=6.0,
            zorder=4,
        )
        look: dict[str, Any] = {"linestyle": "none", "markersize": 6, "markeredgecolor": "white"}
        axis.plot(*at.T, marker=form, color=colour, zorder=6, **look)


_MASS: dict[str, Any] = {
    "marker": "s",
    "markersize": 13,
    "markerfacecolor": "none",
    "markeredgecolor": MARK_COLOURS["attachment"],
    "markeredgewidth": 2.5,
}
"""The frame around the place of a mass, which hides nothing."""

_RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 13,
    "markerfacecolor": "none",
    "markeredgecolor": MARK_COLOURS["probe"],
    "markeredgewidth": 2.0,
}
"""The ring around the probe."""


def draw_probe(axis: Axes, view: View, probe: Array) -> None:
    """Draw a ring around the probe, which hides nothing."""
    axis.plot(*view.project(probe[None])[0], linestyle="none", zorder=4.5, **_RING)


def legend_handles(marks: Marks) -> list[Any]:
    """The entries of the legend: each support, load, attachment and contact once."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.path import Path

    def entry(label: str, what: str, form: Any = "o", size: float = 7.0, **look: Any) -> Any:
        look = {"color": MARK_COLOURS[what], "marker": form, "markersize": size} | look
        return Line2D([], [], linestyle="none", label=label, **look)

    def drawn(label: str, what: str, lines: Sequence[Sequence[tuple[float, float]]]) -> Any:
        shape = Path.make_compound_path(*(Path(np.array(line) - [0.5, 0.0]) for line in lines))
        return entry(label, what, shape, 24.0, markerfacecolor="none", markeredgewidth=1.5)

    handles: list[Any] = []
    for support in marks.supports:
        if support.label == CLAMPED:
            handles.append(Patch(color=MARK_COLOURS["support"], label=f"support, {CLAMPED}"))
        else:
            handles.append(drawn(f"support, {support.label}", "support", _BAR))
    several = len(marks.loads) > 1
    for k, load in enumerate(marks.loads):
        label = f"{k + 1}: {load.label}" if several else load.label
        handles.append(entry(label, "load", ARROW, 14.0))
    if any(load.on.any() for load in marks.loads):
        handles.append(Patch(color=REGION_COLOURS["loaded"], label="loaded region"))
    for label, kind in {mark.label: mark.kind for mark in marks.attachments}.items():
        if kind in _FORMS:
            handles.append(drawn(label, "attachment", _FORMS[kind]))
        else:
            handles.append(entry(label, "attachment", **_MASS))
    for form, contact in zip(itertools.cycle(CONTACT_FORMS), marks.contacts, strict=False):
        handles.append(entry(contact.label, "contact", form))
    if marks.contacts:
        handles.append(entry("normal into the wall", "contact", ARROW, 14.0))
    if any(contact.lines for contact in marks.contacts):
        handles.append(Line2D([], [], color=MARK_COLOURS["contact"], alpha=0.6, label="round wall"))
    if marks.rotation is not None:
        label = f"axis of rotation, {marks.rotation.speed_rpm:g} rpm"
        look = {"color": MARK_COLOURS["rotation"], "linestyle": AXIS_LINE}
        handles.append(Line2D([], [], label=label, **look))
    if marks.probe is not None:
        handles.append(entry("probe", "probe", **_RING))
    return handles
