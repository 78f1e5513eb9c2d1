"""Plots on a page: `chart.js` draws them with Bokeh, to zoom, to hide curves and to read values."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.post.base.drawing import place_of
from fenicsrom.post.base.plot import Bars, Line, Panel, Plot, Text
from fenicsrom.post.base.style import missing_module

PIXELS = 74  # of an inch of a figure
MOST_POINTS = 4000  # of a line: longer ones are thinned


def chart(plot: Plot) -> str | None:
    """A plot of lines, bars and texts as JSON for `chart.js`.

    Returns:
        The text; None if the plot shows something else, or if Bokeh is not installed.
    """
    items = [item for panel in plot.panels for item in panel.items]
    if missing_module("bokeh") or not all(isinstance(item, Line | Bars | Text) for item in items):
        return None
    limits, places = plot.limits(), plot.places()
    rows = max(row + down for row, _, down, _ in places)
    parts = np.array(plot.heights or [1.0] * rows)
    tall = plot.height * PIXELS * parts / parts.sum()
    panels = [
        {
            "place": place,
            "height": round(float(tall[place[0] : place[0] + place[2]].sum())),
            "x": _axis(panel, "x", ends["x"]),
            "y": _axis(panel, "y", ends["y"]),
            "title": panel.title or plot.title * (place[:2] == (0, 0)),
            "items": [_item(item, ends, panel) for item in panel.items],
        }
        for panel, ends, place in zip(plot.panels, limits, places, strict=True)
    ]
    details = [
        {"title": one.title, "at": one.at, "lines": [_points(*line) for line in one.lines]}
        for one in plot.details
    ]
    nothing: Any = {"x": (0.0, 1.0), "y": (0.0, 1.0)}
    samples = [*plot.samples, *(item for panel in plot.panels for item in panel.legend)]
    legend = [_item(item, nothing, Panel(())) for item in samples]
    found = {"panels": panels, "share": plot.share, "legend": legend}
    return json.dumps(found | {"details": details, "detail_labels": plot.detail_labels})


def _axis(panel: Panel, name: str, ends: tuple[float, float]) -> dict[str, Any]:
    """An axis: label, ends, scale, and the texts at its marks."""
    marks = getattr(panel, f"{name}ticks")
    found = {"label": getattr(panel, f"{name}label"), "ends": ends, "log": name in panel.log}
    return found | {"marks": [[float(place), text] for place, text in marks.items()]}


def _item(item: Any, ends: Any, panel: Panel) -> dict[str, Any]:
    """An item; its kind, its names in the legend and its look."""
    if isinstance(item, Text):
        place = place_of(item, ends, panel.log)
        align = "right" if place[0] >= ends["x"][1] else item.ha
        at = {"at": (min(place[0], ends["x"][1]), place[1]), "shift": item.shift, "align": align}
        return {"kind": "text", "text": item.text, "color": item.color, **at}
    found = {"names": [item.label, *item.also], "label": item.label, "color": item.color}
    if isinstance(item, Bars):
        corners = (item.left, item.right, item.low, item.high)
        return found | {"kind": "bars", "corners": [_packed(corner) for corner in corners]}
    x = ends["x"] if item.x is None else item.x
    y = ends["y"] if item.y is None else item.y
    if item.y is None and not item.linestyle:
        y = np.full(np.shape(x), ends["y"][1])
    if np.size(item.notes) == np.size(x):
        step = _step(np.size(x))
        found["notes"] = list(item.notes[::step])
    found |= {"kind": "line", "style": item.linestyle, "width": item.linewidth}
    found |= {"marker": item.marker, "size": 1.3 * item.markersize, "hollow": item.hollow}
    return found | _points(x, y)


def _step(count: int) -> int:
    """Every which of some points is kept."""
    return max(1, -(-count // MOST_POINTS))


def _points(x: Any, y: Any) -> dict[str, str]:
    """The places of a line."""
    step = _step(np.size(x))
    return {"x": _packed(np.asarray(x)[::step]), "y": _packed(np.asarray(y)[::step])}


def _packed(values: Any) -> str:
    """Numbers with seven digits, as text."""
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


@cache
def library() -> str:
    """The scripts of Bokeh, compressed, as text. The package of Bokeh is not imported."""
    spec = find_spec("bokeh")
    assert spec is not None and spec.origin is not None
    folder = Path(spec.origin).parent / "server" / "static" / "js"
    code = "\n".join(
        (folder / name).read_text("utf-8") for name in ("bokeh.min.js", "bokeh-api.min.js")
    )
    return base64.b64encode(gzip.compress(code.encode(), 9, mtime=0)).decode()


def page_script(charts: Mapping[str, str]) -> dict[str, str]:
    """What a page needs to draw charts: the packed library, the code, and names with data.

    Args:
        charts: the name of the place of each chart on the page -> what `chart` gives.
    """
    items = ",".join(f'["{name}",{data}]' for name, data in charts.items()).replace("</", "<\\/")
    code = Path(__file__).with_name("chart.js").read_text("utf-8")
    return {"library": library(), "code": code, "charts": f"[{items}]"}
