"""Plots drawn with matplotlib.

The layout is computed from the lengths of texts: a layout that matplotlib solves would draw every
figure three times.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base import plot as plots
from fenicsrom.post.base.style import DPI, EDGE, SOFT, STYLE, Axes, Figure

LINE, LETTER = 0.19, 0.082
"""Height of a line of text and mean width of a letter, inches."""

BAR, BAR_BELOW = 0.6, 0.72
"""Space of a colour bar beside a panel, without the texts at its marks, and below it, inches."""

EDGE_SPACE = 0.12  # inches beside the outermost axes
MARK_SPACE = 0.19  # inches: a mark, its pads, and what a minus is wider than a letter
ROW = 0.225  # height of a row of a legend, inches
SAMPLE = 0.62  # width of the sample in a legend with its spaces, inches
SIDES = (0, 1, 2, 0, 1)
"""The rows of `_lay_out` for what `_spaces` gives."""
DECADE = 10.0  # a logarithmic axis with a smaller ratio of its ends has plain marks
LEGEND_ROWS = 9  # of a column of a legend beside a panel


def figure_of(plot: plots.Plot, dpi: int = DPI) -> Figure:
    """Draw a plot with so many pixels per inch, in the common style."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        return _figure(plot, dpi)


def _figure(plot: plots.Plot, dpi: int) -> Figure:
    from matplotlib.figure import Figure

    figure, axes = Figure((plot.width, plot.height or 5.0), dpi=dpi), []
    for k, (panel, limits) in enumerate(zip(plot.panels, plot.limits(), strict=True)):
        axes.append(figure.add_axes((0.1, 0.1, 0.8, 0.8), label=f"{k}"))
        _draw(axes[k], panel, limits)
        if "x" in plot.share and sum(panel.place[::2]) < plot.rows:
            axes[k].tick_params(labelbottom=False)
        if "y" in plot.share and panel.place[1] > 0:
            axes[k].tick_params(labelleft=False)
    _lay_out(figure, plot, axes)
    return figure


def _draw(axis: Axes, panel: plots.Panel, ends: plots.Limits) -> None:
    """Draw the items and the axes of a panel."""
    for name in "xy":
        if name in panel.log:
            axis.set(**{f"{name}scale": "log"})
        if marks := getattr(panel, f"{name}ticks"):
            getattr(axis, f"set_{name}ticks")(list(marks), list(marks.values()))
        elif name in panel.whole:
            getattr(axis, f"{name}axis").get_major_locator().set_params(integer=True)
    axis.set(xlim=ends["x"], ylim=ends["y"], autoscale_on=False)
    for name in panel.log:
        low, high = ends[name]
        if high < DECADE * low and not getattr(panel, f"{name}ticks"):
            _mark_plainly(getattr(axis, f"{name}axis"))
    for item in panel.items:
        _add(axis, item, ends, panel.log)
    axis.set(xlabel=panel.xlabel, ylabel=panel.ylabel)
    axis.set_title(panel.title)
    if panel.square:
        axis.set_aspect("equal")
    if panel.plain:
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        if not (panel.xticks or panel.yticks or panel.ylabel):
            axis.set(xticks=[], yticks=[])
    if panel.plain or any(isinstance(item, plots.Map) for item in panel.items):
        axis.grid(visible=False)
    if panel.legend:
        place: Any = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "ncols": _columns(panel)}
        axis.legend(handles=[*map(_sample, panel.legend)], **place)


def _mark_plainly(axis: Any) -> None:
    """Write a few numbers at a short logarithmic axis, where powers of ten would collide."""
    from matplotlib.ticker import MaxNLocator, NullLocator, ScalarFormatter

    axis.set_major_locator(MaxNLocator(4))
    axis.set_major_formatter(ScalarFormatter())
    axis.set_minor_locator(NullLocator())


def _columns(panel: plots.Panel) -> int:
    """The number of columns of the legend beside a panel."""
    return -(-len(panel.legend) // LEGEND_ROWS)


def _add(axis: Axes, item: plots.Item, ends: plots.Limits, log: str) -> None:
    """Draw an item."""
    if isinstance(item, plots.Line):
        _add_line(axis, item, ends)
    elif isinstance(item, plots.Bars):
        from matplotlib.collections import PolyCollection

        corners = (item.left, item.low, item.left, item.high, item.right, item.high)
        places = np.array([*corners, item.right, item.low], dtype=np.float64).T.reshape(-1, 4, 2)
        look: dict[str, Any] = {"facecolor": item.color, "edgecolor": "none"}
        axis.add_collection(PolyCollection(list(places), zorder=1.0, **look))
    elif isinstance(item, plots.Text):
        _add_text(axis, item, ends, log)
    elif isinstance(item, plots.Image):
        (left, low), (right, high) = item.low, item.high
        extent = (left, right, low, high)
        axis.imshow(item.pixels, extent=extent, interpolation="bilinear", aspect="auto")
    else:
        look = {"cmap": _colour_map(item.cmap), "vmin": item.vmin, "vmax": item.vmax}
        if isinstance(item, plots.Map):
            look |= {"rasterized": True, "zorder": 1.5}
            axis.pcolormesh(item.x, item.y, item.values, **look)
        else:
            look |= {"s": item.markersize**2, "marker": item.marker, "linewidths": 0.0}
            axis.scatter(item.x, item.y, c=item.values, zorder=3, **look)


def _add_line(axis: Axes, item: plots.Line, ends: plots.Limits) -> None:
    """Draw a line."""
    look = _look(item) | {"clip_on": item.y is not None}
    if item.spread is None:
        axis.plot(*item.places(ends), **look)
    else:
        axis.errorbar(*item.places(ends), item.spread, capsize=2, elinewidth=1.0, **look)


def _look(item: plots.Line) -> dict[str, Any]:
    """How matplotlib draws a line."""
    names = ("color", "linewidth", "markersize", "zorder")
    look: dict[str, Any] = {name: getattr(item, name) for name in names} | {"label": item.label}
    look |= {"linestyle": item.linestyle or "None", "marker": item.marker or "None"}
    return look | ({"markerfacecolor": "white"} if item.hollow else {})


def _add_text(axis: Axes, item: plots.Text, ends: plots.Limits, log: str) -> None:
    """Write a text."""
    look: dict[str, Any] = {name: getattr(item, name) for name in ("color", "fontsize", "ha", "va")}
    look |= {"rotation": item.rotation, "zorder": 7, "annotation_clip": False}
    if item.halo:
        from matplotlib.patheffects import withStroke

        look |= {"weight": "bold", "path_effects": [withStroke(linewidth=2.5, foreground="white")]}
    if item.leader:
        look["arrowprops"] = {"arrowstyle": "-", "color": item.color, "linewidth": 0.5}
    axis.annotate(item.text, item.place(ends, log), item.shift, textcoords="offset points", **look)


def _colour_map(colours: str | Sequence[str]) -> Any:
    """A colour map by its name, or with these colours."""
    from matplotlib.colors import ListedColormap

    return colours if isinstance(colours, str) else ListedColormap(list(colours))


def _sample(item: Any) -> Any:
    """The sample of an item in a legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if isinstance(item, plots.Line):
        return Line2D([], [], **_look(item))
    if isinstance(item, plots.Dots):
        return Line2D([], [], linestyle="none", marker=item.marker, color=SOFT, label=item.label)
    return Patch(facecolor=item.color, edgecolor=EDGE, linewidth=0.5, label=item.label)


def _lay_out(figure: Figure, plot: plots.Plot, axes: Sequence[Axes]) -> None:
    """Place the panels, the colour bars, the legend and the title."""
    rows = plot.rows
    columns = max(sum(panel.place[1::2]) for panel in plot.panels)
    before, after = np.zeros((3, columns)), np.zeros((2, rows))
    for axis, panel in zip(axes, plot.panels, strict=True):
        row, column, down, wide = panel.place
        cells = [(before, column)] * 2 + [(before, column + wide - 1)]
        cells += [(after, row), (after, row + down - 1)]
        for (space, at), side, size in zip(cells, SIDES, _spaces(axis, panel), strict=True):
            space[side, at] = max(space[side, at], size)
    wide_of = plots.sizes(plot.width - before.sum(), plot.widths, columns)
    head, height = _head_of(plot), plot.height
    if not height:  # that of the tallest panel to scale
        across = [wide_of[panel.place[1]] for panel in plot.panels]
        ends = zip(plot.limits(), across, strict=True)
        tall = max(width * np.ptp(own["y"]) / np.ptp(own["x"]) for own, width in ends)
        height = head + float(after.sum() + tall)
        figure.set_figheight(height)
    _write_head(figure, plot, height)
    tall_of = plots.sizes(height - head - after.sum(), plot.heights, rows)
    lefts = np.cumsum(before.sum(axis=0) + wide_of) - wide_of - before[2]
    lows = height - head - np.cumsum(after.sum(axis=0) + tall_of) + after[1]
    for axis, panel in zip(axes, plot.panels, strict=True):
        row, column, down, wide = panel.place
        x, y = lefts[column], lows[row + down - 1]
        last = column + wide - 1
        extent = lefts[last] + wide_of[last] - x, lows[row] + tall_of[row] - y
        whole = np.array([plot.width, height, plot.width, height])
        axis.set_position(tuple(np.array([x, y, *extent]) / whole))
        axis.yaxis.set_label_coords(-before[1, column] / extent[0], 0.5)
        for item in panel.items:
            if getattr(item, "bar", ""):
                _add_bar(figure, item, np.array([x, y, *extent]), whole, panel)


def _spaces(axis: Axes, panel: plots.Panel) -> tuple[float, float, float, float, float]:
    """The space around axes: label and marks on the left, right, top and bottom, inches."""
    marks = LETTER * max(map(_width, _marks(axis.yaxis)), default=0) + MARK_SPACE
    label = 0.06 + LINE * (1 + panel.ylabel.count("\n")) if panel.ylabel else 0.0
    shown = _marks(axis.xaxis)
    first, last = (
        0.5 * LETTER * max(map(_width, one), default=0) for one in (shown[:1], shown[-1:])
    )
    powers = 0.06 if "x" in panel.log else 0.0
    bottom = (LINE + 0.06 + powers if shown else 0.0) + LINE * 1.1 * (1 + panel.xlabel.count("\n"))
    bottom -= 0.0 if panel.xlabel else LINE
    top = EDGE_SPACE + (LINE * 1.3 if panel.title else 0.0)
    marks, right = max(marks, first), max(EDGE_SPACE, last, _beside(panel))
    item: Any
    for item in panel.items:
        if (
            isinstance(item, plots.Text)
            and "y" in item.part
            and item.y >= 1.0
            and item.va == "bottom"
        ):
            top = max(top, EDGE_SPACE + LINE * (1.0 + 1.3 * bool(panel.title)))
        if getattr(item, "bar", "") and panel.plain:
            bottom += BAR_BELOW + LINE * item.bar.count("\n")
        elif getattr(item, "bar", ""):
            texts = item.ticks.values() or ("0.0001",)
            right = BAR + LETTER * max(map(len, texts)) + _beside(panel)
    if panel.legend:
        longest = max(len(item.label) for item in panel.legend)
        right += _columns(panel) * (SAMPLE + LETTER * longest)
    return label, marks, right, top, bottom


def _beside(panel: plots.Panel) -> float:
    """The space of texts beside axes on the right, inches."""
    texts = [item for item in panel.items if isinstance(item, plots.Text)]
    lengths = [len(item.text) for item in texts if "x" in item.part and item.x > 1.0]
    return LETTER * max(lengths, default=0) + EDGE_SPACE * bool(lengths)


def _marks(axis: Any) -> list[str]:
    """The texts at the marks of an axis; none if they are hidden."""
    names = ("labelleft", "labelbottom")
    if not any(axis.get_tick_params().get(name, False) for name in names):
        return []
    low, high = sorted(axis.get_view_interval())
    places = [place for place in axis.get_majorticklocs() if low <= place <= high]
    return list(axis.get_major_formatter().format_ticks(places))


def _width(text: str) -> int:
    """The number of letters of a text without the marks of formulas."""
    return len(re.sub(r"\\mathdefault|[${}^]", "", text))


def _title_of(plot: plots.Plot) -> float:
    """The height of the title, inches."""
    return 0.12 + LINE * (1 + plot.title.count("\n")) if plot.title else 0.0


def _rows_of(plot: plots.Plot) -> int:
    """The number of rows of the legend, as few as fit; a column is as wide as its longest name."""
    widths = [SAMPLE + LETTER * len(item.label) for item in plot.samples]
    for rows in range(1, len(widths)):
        if sum(max(widths[k : k + rows]) for k in range(0, len(widths), rows)) <= plot.width:
            return rows
    return len(widths)


def _head_of(plot: plots.Plot) -> float:
    """The height of title and legend, inches."""
    rows = _rows_of(plot)
    return _title_of(plot) + (0.14 + ROW * rows if rows else 0.0)


def _write_head(figure: Figure, plot: plots.Plot, height: float) -> None:
    """Write the title and the legend."""
    if plot.title:
        place: dict[str, Any] = {"ha": "left", "va": "top", "fontsize": 11}
        figure.text(0.01, 1.0 - 0.08 / height, plot.title, **place)
    if samples := plot.samples:
        at: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, 1.0 - _title_of(plot) / height)}
        columns = -(-len(samples) // _rows_of(plot))  # rows of about equal length
        handles = [_sample(item) for item in samples]
        figure.legend(handles=handles, ncols=columns, borderaxespad=0.2, **at)


def _add_bar(figure: Figure, item: Any, box: Array, whole: Array, panel: plots.Panel) -> None:
    """Draw the colour bar of an item of a panel, whose box is (x, y, width, height), inches."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    x, y, width, height = box
    values = np.asarray(getattr(item, "values", [0.0, 1.0]), dtype=np.float64)
    known = values[np.isfinite(values)] if np.isfinite(values).any() else np.array([0.0, 1.0])
    low = float(known.min()) if item.vmin is None else item.vmin
    high = float(known.max()) if item.vmax is None else item.vmax
    place, look = (x + width + 0.1 + _beside(panel), y, 0.12, height), dict[str, Any]()
    if panel.plain:
        place = x + 0.25 * width, y - 0.24, 0.5 * width, 0.12
        look = {"orientation": "horizontal"}
    axes: Any = np.array(place) / whole
    shades = ScalarMappable(Normalize(low, high), _colour_map(item.cmap))
    bar: Any = figure.colorbar(shades, cax=figure.add_axes(axes), **look)
    if marks := {at: text for at, text in item.ticks.items() if low <= at <= high}:
        bar.set_ticks(list(marks), labels=list(marks.values()))
    bar.set_label(item.bar)
    bar.outline.set_visible(False)
