"""Charts to zoom hold the curves, names and texts of the figures, and reports show them."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import jenkins, side_by_side

pytest.importorskip("bokeh")

from fenicsrom.notes import verdict_of
from fenicsrom.post.base.chart import _place, chart, noted
from fenicsrom.post.base.page import Folded, html_report
from fenicsrom.post.base.picture import Picture, caption, draw_pictures
from fenicsrom.post.base.style import new_figure, new_panels, styled
from fenicsrom.post.run.figures import plot_points

TIME = np.linspace(0.0, 1.0, 7)


def two_curves() -> Any:
    figure = new_figure(5.0, 4.0)
    upper, lower = figure.subplots(2, sharex=True)
    (line,) = upper.plot(TIME, TIME**2, "--", color="#d55e00", label="full")
    noted(line, ["stick"] * TIME.size)
    upper.plot(TIME, TIME**3, "o-", label="reduced")
    lower.axvline(0.5, color="black")
    lower.text(0.25, 0.75, "here")
    upper.legend()
    figure.draw_without_rendering()
    return figure


def objects(found: Any) -> list[dict[str, Any]]:
    """All objects of a chart."""
    if isinstance(found, dict):
        own = [found] if found.get("type") == "object" else []
        return own + [one for value in found.values() for one in objects(value)]
    return [one for value in found for one in objects(value)] if isinstance(found, list) else []


def named(found: list[dict[str, Any]], name: str) -> list[dict[str, Any]]:
    return [one["attributes"] for one in found if one["name"] == name]


def numbers(array: Any) -> Any:
    packed = base64.b64decode(array["array"]["data"])
    return np.frombuffer(gzip.decompress(packed), array["dtype"])


def test_chart_holds_the_points_notes_and_names_of_curves() -> None:
    text = chart(two_curves())
    assert text is not None
    found = objects(json.loads(text))
    entries = [dict(source["data"]["entries"]) for source in named(found, "ColumnDataSource")]
    for x, y in ((TIME, TIME**2), (TIME, TIME**3)):
        np.testing.assert_array_equal(numbers(entries[0]["x"]), x)
        assert any(np.array_equal(numbers(entry["y"]), y) for entry in entries)
    assert any(entry["note"] == ["stick"] * TIME.size for entry in entries)
    labels = {item["label"]["value"]: item["renderers"] for item in named(found, "LegendItem")}
    assert set(labels) == {"full", "reduced"}
    assert len(labels["full"]) == 1 and len(labels["reduced"]) == 2  # a line and its marks
    (here,) = named(found, "Label")
    assert here["text"] == "here" and here["x"] == pytest.approx(0.25, abs=1e-6)
    assert [legend["click_policy"] for legend in named(found, "Legend")] == ["hide"]


def test_legend_has_a_mark_for_a_line_that_is_in_another_panel() -> None:
    figure, (left, right) = new_panels(6.0, 3.0, 1, 2)
    (far,) = left.plot(TIME, TIME, "--", color="#D55E00", label="far")
    (near,) = right.plot(TIME, TIME, color="#0072B2", label="near")
    right.legend(handles=[near, far])
    figure.draw_without_rendering()
    text = chart(figure)
    assert text is not None
    found = objects(json.loads(text))
    items = {item["label"]["value"]: item["renderers"] for item in named(found, "LegendItem")}
    (legend,) = [one["id"] for one in found if one["name"] == "Legend"]
    (plot,) = [one for one in named(found, "Figure") if legend in json.dumps(one.get("above"))]
    inside = json.dumps(plot["renderers"])
    assert all(renderers[0]["id"] in inside for renderers in items.values())
    assert len(items["far"]) == 2  # the mark, and the line that a click hides


def test_rows_of_many_contact_points_have_places_of_their_own() -> None:
    figure = plot_points({"reduced": side_by_side(*[jenkins()] * 6)})
    places = [_place(axes) for axes in figure.axes]
    cells = [(row, column + k) for row, column, _, wide in places for k in range(wide)]
    assert len(places) == 6 and len(set(cells)) == len(cells)


def test_values_that_differ_by_rounding_have_no_offset() -> None:
    @styled
    def draw() -> Any:
        figure, (axis,) = new_panels(4.0, 3.0)
        axis.plot([0.0, 1.0], [50.5, 50.5 + 1e-10])
        return figure

    figure = draw()
    figure.draw_without_rendering()
    (axis,) = figure.axes
    low, high = axis.get_ylim()
    assert high - low > 0.01 and axis.yaxis.get_offset_text().get_text() == ""


def test_report_holds_chart_with_its_picture_caption_and_packed_library(tmp_path: Path) -> None:
    (tmp_path / "history.npz").write_bytes(b"")
    notes: list[str] = []
    (drawn,) = draw_pictures([Picture("Motion", "motion.png", two_curves)], tmp_path, notes)
    page = html_report(
        "title",
        [("Motion", [drawn]), (Folded("Details"), ["a detail"])],
        verdict_of(["a < b; use c"]),
        ["a < b; use c"],
    )
    assert not notes
    assert '<p class="verdict doubtful">Doubtful: a &lt; b; use c.</p>' in page
    assert page.index("verdict doubtful") < page.index("<li>a &lt; b") < page.index("Figure 1.")
    assert "<details><summary>Details</summary>" in page
    assert '<a href="history.npz">' in page and caption("motion.png") in page
    (packed,) = re.findall(r'atob\("([^"]+)"\)', page)
    assert b"embed_item" in gzip.decompress(base64.b64decode(packed))
    assert page.count('id="chart-motion.png"') == 1 and 'src="motion.png"' in page
