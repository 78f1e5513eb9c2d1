"""Tables, HTML pages and the files of the writers."""

import json
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from motions import jenkins

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.page import html_report
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.base.tables import write_summary
from fenicsrom.post.run.figures import plot_motion


def test_html_report_is_one_well_formed_page(tmp_path):
    figure = figure_of(plot_motion({"full": jenkins()}))
    (tmp_path / "a.gif").write_bytes(b"GIF89a")
    film = Drawn("Animation", tmp_path / "a.gif")
    page = html_report(
        "slip & lift-off",
        [
            ("Motion", ["a < b", figure, film]),
            ("Table", [[["model", "amplitude, mm"], ["full <1>", 157.6]]]),
        ],
    )
    assert (
        page.startswith("<!doctype html>")
        and "slip &amp; lift-off" in page
        and "<p>a &lt; b</p>" in page
    )
    assert (
        page.count("data:image/png;base64,iVBOR") == 1
        and page.count("data:image/gif;base64,R0lG") == 1
    )
    assert '<td class="s">full &lt;1&gt;</td><td class="n s">157.6</td>' in page
    assert not re.search(r"src=(?!\"data:)", page) and "@import" not in page and "{{" not in page
    body = page[page.index("<body>") : page.index("</html>")]
    ElementTree.fromstring(
        re.sub(r"class=(\w+)", r'class="\1"', re.sub(r"(<img [^>]*)>", r"\1/>", body))
    )


def test_summary_keeps_order_and_refuses_nan(tmp_path):
    path = tmp_path / "summary.json"
    write_summary(
        path,
        {"b": np.float64(1.5), "a": {"z": np.arange(2), "y": (np.bool_(True), None)}, "p": path},
    )
    assert list(json.loads(path.read_text())) == ["b", "a", "p"]
    assert json.loads(path.read_text())["a"] == {"z": [0, 1], "y": [True, None]}
    before = path.read_bytes()
    for bad, key in (
        ({"response": {"full": {"tangential": [1.0, np.nan]}}}, "response.full.tangential[1]"),
        ({"x": np.float32("inf")}, "x"),
    ):
        with pytest.raises(AccuracyError) as caught:
            write_summary(path, bad)
        assert (caught.value.kind, caught.value.key) == (ErrorKind.NOT_FINITE, key)
    assert path.read_bytes() == before and [p.name for p in tmp_path.iterdir()] == ["summary.json"]
