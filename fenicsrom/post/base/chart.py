"""Charts to zoom: the curves of a matplotlib figure in Bokeh, for the pages of reports."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import Axes, Figure, missing_module

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.lines import Line2D

PIXELS = 74  # of an inch of a figure
LONG_NAME = 25  # characters of a name of which four in a row are too wide
MOST_POINTS = 4000  # of a line: longer ones are thinned
DASHES: dict[str, Any] = {"-": "solid", "--": [6, 4], "-.": "dashdot", ":": "dotted"}
MARKERS = {
    "o": "circle",
    "s": "square",
    "D": "diamond",
    "p": "hex",
    "h": "star",
    "^": "triangle",
    "v": "inverted_triangle",
    "<": "circle_dot",
    ">": "square_dot",
    "x": "x",
    "X": "square_x",
    "P": "square_cross",
}
CLICKED = """
const [k] = cb_obj.indices;
if (k === undefined) return;
sources.forEach((source, n) => { source.data = lines[k][n]; });
title.text = titles[k];
"""
"""What a click on a ringed point does."""

NOTES = "notes"
"""The attribute of a line with a text for each of its points; see `noted`."""


DETAILS = "details"
"""The attribute of a figure with what a click on its points shows; see `detailed`."""


@dataclass(frozen=True)
class Detail:
    """What a click on a point of the first axes of a figure shows.

    Attributes:
        title: above the small plots.
        at: the point.
        lines: the places x and y of the line in each small plot.
    """

    title: str
    at: tuple[float, float]
    lines: Sequence[tuple[Array, Array]]


def detailed(figure: Figure, labels: Sequence[tuple[str, str]], details: Sequence[Detail]) -> None:
    """Let the chart of a figure show details: small plots below it, with these labels of axes."""
    setattr(figure, DETAILS, (labels, details))


def noted(line: Line2D, notes: Sequence[str]) -> None:
    """Give each point of a line a text, which a chart shows on hover beside the values."""
    setattr(line, NOTES, list(notes))


def chart(figure: Figure) -> str | None:
    """The curves and bars of a drawn figure as a chart: zoom, values on hover, lines to hide.

    Args:
        figure: the figure, after it was drawn.

    Returns:
        The chart as JSON for Bokeh; None if the figure shows more than curves and bars, or if Bokeh
        is not installed.
    """
    if missing_module("bokeh") or not figure.axes or not all(map(_is_plain, figure.axes)):
        return None
    from bokeh.embed import json_item
    from bokeh.layouts import column, gridplot

    plots: list[Any] = []
    shown: list[tuple[Any, Any]] = []  # artists and what draws them
    for axes in figure.axes:
        plot, own = _plot(figure, axes)
        for other, known in zip(figure.axes, plots, strict=False):
            if axes.get_shared_x_axes().joined(axes, other):
                plot.x_range = known.x_range
            if axes.get_shared_y_axes().joined(axes, other):
                plot.y_range = known.y_range
        plots.append(plot)
        shown += own
    pairs = dict(zip(figure.axes, plots, strict=True))
    for legend in figure.legends:
        _add_legend(pairs, _entries(legend), shown)
    for axes, plot in pairs.items():
        if (legend := axes.get_legend()) is not None:
            _add_legend({axes: plot}, _entries(legend), shown)
    grid = gridplot([plots], sizing_mode="stretch_width", toolbar_options={"logo": None})
    grid.children = [(plot, *_place(axes)) for axes, plot in zip(figure.axes, plots, strict=True)]
    labels, details = getattr(figure, DETAILS, ((), ()))
    if details:
        grid = column(grid, _details(plots[0], labels, details), sizing_mode="stretch_width")
    return json.dumps(json_item(grid))


def _details(plot: Any, labels: Sequence[tuple[str, str]], details: Sequence[Detail]) -> Any:
    """Ring the points of details in a plot; the row of small plots, which a click fills."""
    from bokeh.layouts import row
    from bokeh.models import ColumnDataSource, CustomJS, TapTool
    from bokeh.plotting import figure as new_plot

    lines = [[{"x": _short(x), "y": _short(y)} for x, y in detail.lines] for detail in details]
    x, y = zip(*(detail.at for detail in details), strict=True)
    points, sources = ColumnDataSource({"x": x, "y": y}), [*map(ColumnDataSource, lines[0])]
    ring = {"size": 12, "fill_alpha": 0.0, "line_color": "#1d2125", "line_alpha": 0.6}
    plot.add_tools(TapTool(renderers=[plot.scatter("x", "y", source=points, **ring)]))
    small = []
    for (across, up), source in zip(labels, sources, strict=True):
        look: dict[str, Any] = {"sizing_mode": "stretch_width", "toolbar_location": None}
        look |= {"x_axis_label": across, "y_axis_label": up}
        small.append(new_plot(height=240, **look))
        small[-1].line("x", "y", source=source, line_width=2)
        for axis in (*small[-1].xaxis, *small[-1].yaxis):
            axis.axis_label_text_font_style = "normal"
    title = small[0].title  # a text of its own would need another library of Bokeh
    title.text, title.text_font_size = details[0].title, "12px"
    known = {"sources": sources, "lines": lines, "title": title}
    known["titles"] = [detail.title for detail in details]
    points.selected.js_on_change("indices", CustomJS(args=known, code=CLICKED))
    return row(*small, sizing_mode="stretch_width")


def _short(values: Array) -> list[float]:
    """Values with the digits that a small plot shows."""
    return [float(f"{value:.4g}") for value in values]


def _place(axes: Axes) -> tuple[int, int, int, int]:
    """The row and the column of axes in the grid, and how many rows and columns they span."""
    spec: Any = axes.get_subplotspec()
    rows, columns = spec.rowspan, spec.colspan
    return rows.start, columns.start, len(rows), len(columns)


def _is_plain(axes: Axes) -> bool:
    """Whether axes show lines, bars and texts at points of their data, and nothing else."""
    from matplotlib.patches import Rectangle

    others = [*axes.collections, *axes.images, *axes.tables, *axes.child_axes]
    drawn = [*axes.lines, *axes.patches]
    bars = all(isinstance(patch, Rectangle) for patch in axes.patches)
    return axes.name == "rectilinear" and bars and bool(drawn or axes.texts) and not others


def _plot(figure: Figure, axes: Axes) -> tuple[Any, list[tuple[Any, Any]]]:
    """The plot of axes, and pairs of an artist and what draws it."""
    from bokeh.models import BoxZoomTool, Range1d
    from bokeh.plotting import figure as new_plot
    from matplotlib.patches import Rectangle

    height = axes.get_position().height * figure.get_figheight() * PIXELS
    plot = new_plot(
        height=round(height) + 60,
        x_axis_type="log" if axes.get_xscale() == "log" else "linear",
        y_axis_type="log" if axes.get_yscale() == "log" else "linear",
        x_range=Range1d(*axes.get_xlim()),
        y_range=Range1d(*axes.get_ylim()),
        tools="box_zoom,pan,wheel_zoom,reset,save",
        title=_text(axes.get_title(loc="left")) or None,
    )
    plot.toolbar.active_drag = next(t for t in plot.tools if isinstance(t, BoxZoomTool))
    for axis, own in ((plot.xaxis, axes.xaxis), (plot.yaxis, axes.yaxis)):
        axis.axis_label = _text(own.get_label_text()) or None
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "12px"
        axis.minor_tick_line_color = None
        _set_ticks(axis, own)
    shown = [pair for line in axes.lines for pair in _line(plot, axes, line)]
    for bar in axes.patches:
        assert isinstance(bar, Rectangle)
        (left, bottom), (right, top) = bar.get_bbox().get_points()
        drawn = plot.quad(left, right, bottom, top, color=_colour(bar.get_facecolor()))
        shown.append((bar, drawn))
    _add_hover(plot, shown)
    _add_texts(plot, axes)
    return plot, shown


def _set_ticks(axis: Any, own: Axis) -> None:
    """Give the axis the names at its ticks, where they are not numbers."""
    from matplotlib.ticker import LogFormatter, ScalarFormatter

    if isinstance(own.get_major_formatter(), ScalarFormatter | LogFormatter):
        return
    places = [float(place) for place in own.get_majorticklocs()]
    names = [label.get_text() for label in own.get_majorticklabels()]
    axis.ticker = places
    axis.major_label_overrides = dict(zip(places, map(_text, names), strict=True))


def _line(plot: Any, axes: Axes, line: Line2D) -> Iterable[tuple[Any, Any]]:
    """Draw a line; yield it with what draws it."""
    from bokeh.models import ColumnDataSource

    colour, dash = _colour(line.get_color()), _dash(line)
    x, y = (np.asarray(part, dtype=float) for part in line.get_data(orig=False))
    if line.get_transform() == axes.get_yaxis_transform():  # across the whole plot
        x = np.array(axes.get_xlim())
    elif line.get_transform() == axes.get_xaxis_transform():
        y = np.array(axes.get_ylim())
    some = slice(None, None, max(1, -(-x.size // MOST_POINTS)))
    notes = list(getattr(line, NOTES, None) or [""] * x.size)
    source = ColumnDataSource({"x": x[some], "y": y[some], "note": notes[some]})
    drawn = []
    if dash is not None:
        look = {"color": colour, "line_dash": dash, "line_width": line.get_linewidth()}
        drawn.append(plot.line("x", "y", source=source, **look))
    if kind := MARKERS.get(str(line.get_marker())):
        fill = _colour(line.get_markerfacecolor())
        look = {"marker": kind, "fill_color": fill, "size": 1.3 * line.get_markersize()}
        drawn.append(plot.scatter("x", "y", source=source, line_color=colour, **look))
    yield from ((line, one) for one in drawn)


def _add_hover(plot: Any, shown: Iterable[tuple[Any, Any]]) -> None:
    """Show the name of a line, the values and the notes of its points on hover."""
    from bokeh.models import HoverTool

    lines = {line: drawn for line, drawn in shown if hasattr(line, "get_marker")}
    for line, drawn in lines.items():
        label = str(line.get_label())
        drawn.name = " " if label.startswith("_") else _text(label)
    rows = [("", "$name")] * any(drawn.name.strip() for drawn in lines.values())
    rows += [(_axis_name(plot.xaxis, "x"), "@x"), (_axis_name(plot.yaxis, "y"), "@y")]
    rows += [("", "@note")] * any(getattr(line, NOTES, None) for line in lines)
    if lines:
        plot.add_tools(HoverTool(renderers=list(lines.values()), tooltips=rows, visible=False))


def _axis_name(axis: Any, otherwise: str) -> str:
    """The label of an axis on one line."""
    return " ".join(str(axis[0].axis_label or otherwise).split())


def _add_texts(plot: Any, axes: Axes) -> None:
    """Write the texts that stand at points of the data."""
    from bokeh.models import Label

    for text in axes.texts:
        if text.get_text():
            corner = text.get_window_extent()
            x, y = map(float, axes.transData.inverted().transform((corner.x0, corner.y0)))
            end = max(axes.get_xlim())
            look = {"text_font_size": "11px", "text_color": _colour(text.get_color())}
            look["text_align"] = "right" if x > end else "left"
            plot.add_layout(Label(x=min(x, end), y=y, text=_text(text.get_text()), **look))


def _entries(legend: Any) -> list[tuple[str, Any]]:
    """The names and samples of a legend."""
    texts = (_text(text.get_text()) for text in legend.get_texts())
    return list(zip(texts, legend.legend_handles, strict=True))


def _add_legend(
    plots: Mapping[Axes, Any],
    entries: Sequence[tuple[str, Any]],
    shown: Sequence[tuple[Any, Any]],
) -> None:
    """Add a legend above the first plot that has its first entry.

    A click on an entry hides what looks like its sample.
    """
    from bokeh.models import Legend, LegendItem

    items, samples = [], []
    for name, sample in entries:
        alike = [drawn for artist, drawn in shown if _look(artist) == _look(sample)]
        if not alike and hasattr(sample, "get_marker"):  # a sample of a colour, mark or line style
            alike = _partly_alike(sample, shown)
        if alike:
            items.append(LegendItem(label=name, renderers=alike))
            samples.append(sample)
    if items:
        first = items[0].renderers
        pairs = [*plots.items()]
        axes, plot = next((pair for pair in pairs if first[0] in pair[1].renderers), pairs[0])
        for item, sample in zip(items, samples, strict=True):
            # the mark beside a name is that of the first renderer, which must be in this plot
            here = [one for one in item.renderers if one in plot.renderers]
            own = here or [drawn for _, drawn in _blank(plot, axes, sample)]
            item.renderers = [*own, *(one for one in item.renderers if one not in own)]
        columns = 3 if max(len(name) for name, _ in entries) > LONG_NAME else 4
        look = {"orientation": "horizontal", "click_policy": "hide", "border_line_color": None}
        plot.add_layout(Legend(items=items, ncols=columns, **look), "above")
        plot.height += 30 * -(-len(items) // columns)


def _blank(plot: Any, axes: Axes, sample: Any) -> Iterable[tuple[Any, Any]]:
    """Draw a line that is not seen and looks like a sample; none for a bar."""
    if not hasattr(sample, "get_marker"):
        return ()
    line = copy(sample)
    line.set_data([np.nan], [np.nan])  # a line without any point has no mark
    return _line(plot, axes, line)


def _look(artist: Any) -> tuple[Any, ...]:
    """What tells curves and bars apart."""
    if not hasattr(artist, "get_marker"):
        return (_colour(artist.get_facecolor()),)
    return _colour(artist.get_color()), str(_dash(artist)), str(artist.get_marker())


def _partly_alike(sample: Any, shown: Sequence[tuple[Any, Any]]) -> list[Any]:
    """What has the mark of a sample, or its colour, or its line style: the first that occurs."""
    colour, dash, mark = _look(sample)
    lines = [(_look(artist), drawn) for artist, drawn in shown if hasattr(artist, "get_marker")]
    if mark in MARKERS:
        return [drawn for look, drawn in lines if look[2] == mark]
    of_colour = [drawn for look, drawn in lines if look[0] == colour]
    return of_colour or [drawn for look, drawn in lines if look[1] == dash]


def _dash(line: Any) -> Any:
    """The dashes of a line in Bokeh; None of points that no line joins."""
    style = line.get_linestyle()
    if style in ("None", "none", "", " "):
        return None
    return DASHES.get(style, "dashed")


def _colour(colour: Any) -> str | None:
    """A colour in Bokeh; None if it is transparent."""
    from matplotlib.colors import to_hex, to_rgba

    return to_hex(colour) if to_rgba(colour)[3] > 0.0 else None


def _text(text: str) -> str:
    """A text without the marks of formulas."""
    return text.replace("$", "").replace("\\mathdefault", "")
