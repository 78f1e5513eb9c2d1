"""Charts to zoom hold the curves, names and texts of the figures, and reports show them."""

from __future__ import annotations

import ast
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

import fenicsrom
from fenicsrom.notes import verdict_of
from fenicsrom.post.base.chart import chart
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.origin import is_result
from fenicsrom.post.base.page import Folded, html_report
from fenicsrom.post.base.picture import Picture, draw_pictures
from fenicsrom.post.base.plot import Line, Map, Panel, Plot, Text
from fenicsrom.post.run.figures import plot_points

TIME = np.linspace(0.0, 1.0, 7)


def two_curves() -> Plot:
    look: dict[str, Any] = {"linestyle": "--", "color": "#d55e00", "label": "full"}
    full = Line(TIME, TIME**2, **look, notes=["stick"] * TIME.size)
    reduced = Line(TIME, TIME**3, marker="o", label="reduced")
    below = [Line([0.5, 0.5], None, color="black"), Text(0.25, 0.75, "here", "y")]
    return Plot([Panel([full, reduced]), Panel(below, ylim=(0.0, 2.0))], 5.0, 4.0, share="x")


def numbers(packed: str) -> Any:
    return np.frombuffer(base64.b64decode(packed), "<f4")


def test_chart_holds_the_points_notes_and_names_of_curves() -> None:
    text = chart(two_curves())
    assert text is not None
    found = json.loads(text)
    upper, lower = found["panels"]
    full, reduced = upper["items"]
    for item, y in ((full, TIME**2), (reduced, TIME**3)):
        np.testing.assert_allclose(numbers(item["x"]), TIME, rtol=1e-6)
        np.testing.assert_allclose(numbers(item["y"]), y, rtol=1e-6)
    assert full["notes"] == ["stick"] * TIME.size and full["style"] == "--"
    assert [sample["label"] for sample in found["legend"]] == ["full", "reduced"]
    across, here = lower["items"]
    np.testing.assert_allclose(numbers(across["y"]), [0.0, 2.0])
    assert here["text"] == "here" and here["at"] == [0.25, 1.5]
    assert upper["x"]["ends"] == lower["x"]["ends"] and found["share"] == "x"


def test_places_of_many_contact_points_do_not_overlap() -> None:
    panels = plot_points({"reduced": side_by_side(*[jenkins()] * 6)}).panels
    cells = [(one.place[0], one.place[1] + k) for one in panels for k in range(one.place[3])]
    assert len(panels) == 6 and len(set(cells)) == len(cells)


def test_values_that_differ_by_rounding_have_no_offset() -> None:
    figure = figure_of(Plot([Panel([Line([0.0, 1.0], [50.5, 50.5 + 1e-10])])], 4.0, 3.0))
    figure.draw_without_rendering()
    (axis,) = figure.axes
    low, high = axis.get_ylim()
    assert high - low > 0.01 and axis.yaxis.get_offset_text().get_text() == ""


def test_short_logarithmic_axis_has_a_few_plain_numbers() -> None:
    figure = figure_of(Plot([Panel([Line([0.5, 1.4], [2.0, 3000.0])], log="xy")], 4.0, 3.0))
    (axis,) = figure.axes
    texts = [tick.get_text() for tick in axis.get_xticklabels(which="both")]
    assert "1.00" in texts and len(texts) <= 6
    assert any("10^" in tick.get_text() for tick in axis.get_yticklabels())


def test_plot_with_a_map_has_no_chart() -> None:
    assert chart(Plot([Panel([Map([0.0, 1.0], [0.0, 1.0], np.zeros((2, 2)))])])) is None


def test_axes_end_at_their_values_or_beside_them_and_share_their_ends() -> None:
    line = Line([1.0, 3.0], [10.0, 1000.0])
    panels = [Panel([line], log="y"), Panel([Line([2.0, 5.0], [0.0, 1.0])], tight="xy")]
    first, second = Plot(panels, share="x").limits()
    assert first["x"] == pytest.approx((0.8, 5.2)) and second["x"] == (1.0, 5.0)
    assert first["y"] == pytest.approx((10.0**0.9, 10.0**3.1)) and second["y"] == (0.0, 1.0)
    assert Panel([line], ylim=(0.0, None)).ylim == (0.0, None)


def test_report_holds_chart_with_its_picture_caption_and_packed_library(tmp_path: Path) -> None:
    (tmp_path / "history.npz").write_bytes(b"")
    notes: list[str] = []
    (drawn,) = draw_pictures(
        [Picture("Motion", "motion.png", two_curves, "what to see", "history.npz")], tmp_path, notes
    )
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
    assert '<a href="history.npz">' in page and "what to see" in page
    (packed,) = re.findall(r'atob\("([^"]+)"\)', page)
    assert b"embed_item" in gzip.decompress(base64.b64decode(packed))
    assert page.count('id="chart-motion.png"') == 1 and 'src="motion.png"' in page


def test_every_picture_has_a_name_of_a_result() -> None:
    """Of `mesh.png` there is no folder of results."""
    found = set()
    for path in (Path(fenicsrom.__file__).parent / "post").rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text())):
            named = isinstance(call, ast.Call) and ast.unparse(call.func).lower()
            if named in ("picture", "body_picture") and isinstance(call.args[1], ast.Constant):
                found.add(str(call.args[1].value).removesuffix(".png"))
    assert {"motion", "setup", "map", "response"} < found
    assert [name for name in found if not is_result(f"{name}.png")] == ["mesh"]
