"""Plots as data: lines, bars, maps, dots, images and texts in panels.

`fenicsrom.post.base.drawing` draws a plot with matplotlib, `fenicsrom.post.base.chart` on a page.
The looks of items have the names and values of matplotlib.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import COLOURS, SOFT

EQUAL, APART = 1e-6, 1e-3
"""Relative range of values that differ by rounding only, and half of the range that is drawn."""

MARGIN = 0.05
"""What an axis shows beyond its values, relative to their range."""

Ends = tuple[float | None, float | None]
Limits = Mapping[str, tuple[float, float]]
"""The ends of the axes "x" and "y" of a panel."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _Named:
    """What may have a name in the legend.

    Attributes:
        label: its name; "" of none. A click on a name of a chart hides all that have it.
        also: other names that it has in a legend.
    """

    label: str = ""
    also: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Line(_Named):
    """A curve, or points alone.

    Attributes:
        x, y: (n,) places. None: from edge to edge of the panel, or at its upper edge without a
            line.
        linestyle: "-", "--", "-.", ":", or "" of points alone.
        color, linewidth, marker, markersize, zorder: as in matplotlib.
        hollow: whether the marks are empty.
        notes: a text for each point, which a chart shows on hover.
        spread: (n,) half of the lengths of error bars.
    """

    x: Any = ()
    y: Any = ()
    linestyle: str = "-"
    color: str = COLOURS[0]
    linewidth: float = 1.6
    marker: str = ""
    markersize: float = 5.0
    zorder: float = 2.0
    hollow: bool = False
    notes: Sequence[str] = ()
    spread: Any = None

    def places(self, limits: Limits) -> tuple[Any, Any]:
        """Its places x and y in a panel with these limits."""
        x, y = (limits[k] if own is None else own for k, own in (("x", self.x), ("y", self.y)))
        marks = self.y is None and not self.linestyle  # at the upper edge
        return x, np.full(np.shape(x), y[1]) if marks else y


@dataclass(frozen=True, eq=False)
class Bars(_Named):
    """Filled rectangles of one colour: their (n,) edges."""

    left: Any = ()
    right: Any = ()
    low: Any = ()
    high: Any = ()
    color: str = COLOURS[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shaded(_Named):
    """What has colours by its values, and a colour bar if it has a title.

    Attributes:
        cmap: name of the colour map, or a colour for each whole number from `vmin`.
        vmin, vmax: range of the values.
        bar: title of the colour bar, which is below a plain panel; "" of none.
        ticks: the marks of the colour bar and their texts.
    """

    cmap: str | Sequence[str] = "viridis"
    vmin: float | None = None
    vmax: float | None = None
    bar: str = ""
    ticks: Mapping[float, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Map(_Shaded):
    """Values (r, c) of a grid.

    Its x (c,) and y (r,) are the middles of cells, or (c + 1,) and (r + 1,) their edges, or both
    (r + 1, c + 1) their corners.
    """

    x: Any
    y: Any
    values: Any


@dataclass(frozen=True, eq=False)
class Dots(_Shaded):
    """Points with colours; x, y and values (n,)."""

    x: Any
    y: Any
    values: Any
    markersize: float = 4.0
    marker: str = "o"


@dataclass(frozen=True, eq=False)
class Image(_Shaded):
    """Pixels (height, width, 3) between the corners low (2,) and high (2,)."""

    pixels: Any
    low: Array
    high: Array


@dataclass(frozen=True, eq=False)
class Text:
    """A text at a place.

    Attributes:
        x, y: the place.
        text: the text.
        part: axes ("x", "y" or "xy") along which the place is a part of the panel, from 0 to 1.
        shift: of the text from its place, points.
        leader: whether a thin line joins the text and its place.
        halo: whether the text is bold with a white rim.
        color, fontsize, ha, va, rotation: as in matplotlib.
    """

    x: float
    y: float
    text: str
    part: str = ""
    shift: tuple[float, float] = (0.0, 0.0)
    leader: bool = False
    halo: bool = False
    color: str = SOFT
    fontsize: float = 9.0
    ha: str = "left"
    va: str = "center"
    rotation: float = 0.0

    def place(self, limits: Limits, log: str) -> tuple[float, float]:
        """Its place in the units of the axes of a panel with these limits and this `log`."""
        found = []
        for axis, value in (("x", self.x), ("y", self.y)):
            if axis in self.part:
                low, high = limits[axis]
                value = low * (high / low) ** value if axis in log else low + value * (high - low)
            found.append(float(value))
        return found[0], found[1]


Item = Line | Bars | Map | Dots | Image | Text


@dataclass(frozen=True, eq=False)
class Panel:
    """Axes with items.

    Attributes:
        items: what is drawn.
        xlabel, ylabel, title: texts.
        xlim, ylim: ends of the axes; None where the values give them.
        log: axes with a logarithmic scale: "x", "y" or "xy".
        tight: axes that end at their values.
        whole: axes that have whole numbers only.
        xticks, yticks: marks and their texts, where they are not numbers.
        place: row and column, and how many rows and columns it spans; the plot fills its rows with
            panels without a place.
        plain: whether nothing of its axes is drawn but their texts.
        square: whether both axes have the same scale.
        legend: names beside the panel on the right.
    """

    items: Sequence[Item]
    xlabel: str = ""
    ylabel: str = ""
    title: str = ""
    xlim: Ends = (None, None)
    ylim: Ends = (None, None)
    log: str = ""
    tight: str = ""
    whole: str = ""
    xticks: Mapping[float, str] = field(default_factory=dict)
    yticks: Mapping[float, str] = field(default_factory=dict)
    place: tuple[int, ...] = ()
    plain: bool = False
    square: bool = False
    legend: Sequence[_Named] = ()

    def values(self, axis: str) -> Array:
        """All finite values that an axis shows."""
        found = [np.zeros(0)]
        for item in self.items:
            found += [np.ravel(part).astype(np.float64) for part in _extent(item, axis)]
        values = np.concatenate(found)
        return np.asarray(values[np.isfinite(values)])


def _extent(item: Item, axis: str) -> Iterator[Any]:
    """The places of an item along an axis."""
    if isinstance(item, Bars):
        yield from (item.left, item.right) if axis == "x" else (item.low, item.high)
    elif isinstance(item, Image):
        yield np.array([item.low, item.high])[:, "xy".index(axis)]
    elif not isinstance(item, Text):
        places = getattr(item, axis)
        if places is None:
            return
        yield places
        if isinstance(item, Line) and item.spread is not None and axis == "y":
            yield from (np.subtract(places, item.spread), np.add(places, item.spread))
        if isinstance(item, Map) and np.size(places) == np.shape(item.values)["yx".index(axis)]:
            yield edges_of(places)


def sizes(space: float, parts: Sequence[float], count: int) -> Array:
    """The widths or heights (count,) of panels that share a space in these parts, or equally."""
    shares = np.array(parts or np.ones(count), dtype=np.float64)
    return np.asarray(max(space, 0.5) * shares / shares.sum())


def edges_of(middles: Any) -> Array:
    """The edges (n + 1,) of cells with these middles (n,)."""
    middles = np.asarray(middles, dtype=np.float64)
    if middles.size == 1:
        return np.asarray(middles + np.array([-0.5, 0.5]))
    between = 0.5 * (middles[1:] + middles[:-1])
    first, last = 2.0 * middles[0] - between[0], 2.0 * middles[-1] - between[-1]
    return np.concatenate([[first], between, [last]])


@dataclass(frozen=True, eq=False)
class Detail:
    """What a click on a point of the first panel of a plot shows.

    Attributes:
        title: above the small plots.
        at: the point.
        lines: the places x and y of the line in each small plot.
    """

    title: str
    at: tuple[float, float]
    lines: Sequence[tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Plot:
    """Panels with one legend.

    Attributes:
        panels: the panels.
        width, height: inches; 0 for the height that the layout of a `square` panel needs.
        columns: number of columns of panels.
        heights, widths: those of the rows and columns, relative to each other.
        share: axes ("x", "y" or "xy") that all panels share.
        xlabel, ylabel: of the lowest panels, and of the panels in the first column, without one.
        title: above all.
        legend: samples of the legend; by default all named items of the panels, each name once.
        details: what a click on points of the first panel of a chart shows.
        detail_labels: labels of the axes x and y of its small plots.
    """

    panels: Sequence[Panel]
    width: float = 8.4
    height: float = 5.0
    columns: int = 1
    heights: Sequence[float] = ()
    widths: Sequence[float] = ()
    share: str = ""
    xlabel: str = ""
    ylabel: str = ""
    title: str = ""
    legend: Sequence[_Named] | None = None
    details: Sequence[Detail] = ()
    detail_labels: Sequence[tuple[str, str]] = ()

    def __post_init__(self) -> None:
        """Give each panel its place; only the lowest and the left panels label their axes."""
        panels = [
            replace(panel, place=panel.place or (*divmod(k, self.columns), 1, 1))
            for k, panel in enumerate(self.panels)
        ]
        lowest = max((sum(panel.place[::2]) for panel in panels), default=0)
        for k, panel in enumerate(panels):
            row, column, down, _ = panel.place
            xlabel = panel.xlabel or self.xlabel * (row + down == lowest)
            ylabel = panel.ylabel or self.ylabel * (column == 0)
            panels[k] = replace(panel, xlabel=xlabel, ylabel=ylabel)
        object.__setattr__(self, "panels", panels)

    @property
    def rows(self) -> int:
        """The number of rows of panels."""
        return max((sum(panel.place[::2]) for panel in self.panels), default=0)

    @property
    def samples(self) -> list[_Named]:
        """The samples of the legend."""
        if self.legend is not None:
            return list(self.legend)
        found: dict[str, _Named] = {}
        for item in (item for panel in self.panels for item in panel.items if not panel.legend):
            if isinstance(item, _Named) and item.label:
                found.setdefault(item.label, item)
        return list(found.values())

    def limits(self) -> list[dict[str, tuple[float, float]]]:
        """The ends of the axes "x" and "y" of each panel."""
        found: list[dict[str, tuple[float, float]]] = [{} for _ in self.panels]
        for axis in "xy":
            values = [panel.values(axis) for panel in self.panels]
            if axis in self.share:
                values = [np.concatenate(values)] * len(self.panels)
            for ends, panel, own in zip(found, self.panels, values, strict=True):
                ends[axis] = _ends(panel, axis, own)
        return found


def _ends(panel: Panel, axis: str, values: Array) -> tuple[float, float]:
    """The ends of an axis with these values; values that are equal to rounding look equal."""
    log = axis in panel.log
    values = np.log10(values[values > 0.0]) if log else values
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    size = max(abs(low), abs(high))
    spare = 0.0 if axis in panel.tight else MARGIN * (high - low)
    if not high - low > EQUAL * size:
        spare = 0.5 if log else APART * size or MARGIN
    ends = (low - spare, high + spare)
    given = panel.xlim if axis == "x" else panel.ylim
    scaled = (10.0**end if log else end for end in ends)
    one, other = (end if own is None else own for own, end in zip(given, scaled, strict=True))
    return (one, other) if one != other else (one - 0.5, other + 0.5)
