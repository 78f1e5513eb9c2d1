"""Plots on a page: `chart.js` draws them with Bokeh, to zoom, to hide curves and to read values."""

import base64
import gzip
import json
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.post.base.plot import Bars, Item, Limits, Line, Panel, Plot, Text, sizes
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
    tall = sizes(plot.height * PIXELS, plot.heights, plot.rows)
    panels = [
        {
            "place": panel.place,
            "height": round(float(tall[panel.place[0] :][: panel.place[2]].sum())),
            "x": _axis(panel, "x", limits["x"]),
            "y": _axis(panel, "y", limits["y"]),
            "title": panel.title or plot.title * (panel.place[:2] == (0, 0)),
            "items": [_item(item, limits, panel.log) for item in panel.items],
        }
        for panel, limits in zip(plot.panels, plot.limits(), strict=True)
    ]
    details = [
        {"title": one.title, "at": one.at, "lines": [_points(*line) for line in one.lines]}
        for one in plot.details
    ]
    samples = [*plot.samples, *(item for panel in plot.panels for item in panel.legend)]
    found = {"panels": panels, "share": plot.share, "legend": [*map(_look, samples)]}
    return json.dumps(found | {"details": details, "detail_labels": plot.detail_labels})


def _axis(panel: Panel, name: str, ends: tuple[float, float]) -> dict[str, Any]:
    """An axis: label, ends, scale, and the texts at its marks."""
    marks = getattr(panel, f"{name}ticks")
    found = {"label": getattr(panel, f"{name}label"), "ends": ends, "log": name in panel.log}
    return found | {"marks": [[float(place), text] for place, text in marks.items()]}


def _item(item: Item, limits: Limits, log: str) -> dict[str, Any]:
    """An item of a panel with these limits and this `log`: its look and its places."""
    if isinstance(item, Text):
        (x, y), edge = item.place(limits, log), limits["x"][1]
        at = {"at": (min(x, edge), y), "shift": item.shift}
        align = "right" if x >= edge else item.ha
        return {"kind": "text", "text": item.text, "color": item.color, "align": align, **at}
    if isinstance(item, Bars):
        corners = (item.left, item.right, item.low, item.high)
        return _look(item) | {"corners": [*map(_packed, corners)]}
    assert isinstance(item, Line)
    x, y = item.places(limits)
    notes = {"notes": list(item.notes[:: _step(np.size(x))])} if item.notes else {}
    return _look(item) | notes | _points(x, y)


def _look(item: Any) -> dict[str, Any]:
    """The kind, the names in the legend and the look of a line or of bars."""
    found = {"names": [item.label, *item.also], "label": item.label, "color": item.color}
    if isinstance(item, Bars):
        return found | {"kind": "bars"}
    found |= {"kind": "line", "style": item.linestyle, "width": item.linewidth}
    return found | {"marker": item.marker, "size": 1.3 * item.markersize, "hollow": item.hollow}


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
