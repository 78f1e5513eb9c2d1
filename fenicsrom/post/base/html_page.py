"""A report as one HTML file that contains its pictures and charts."""

import base64
import gzip
import html
import io
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import count
from pathlib import Path
from string import Template
from typing import Any

from fenicsrom.notes import Verdict
from fenicsrom.post.base.captions import numbers_of
from fenicsrom.post.base.origin import origin_table
from fenicsrom.post.base.picture import Drawn
from fenicsrom.post.base.tables import cell_text, filled_columns, numeric_columns
from fenicsrom.post.base.writers import write_text

FEW_COLUMNS = 8  # a table with more columns has smaller letters, or is turned if it has few rows
FEW_ROWS = 3  # of a table that is turned: its columns become rows
SHORT = 28  # characters of the longest cell that is not broken into lines


class Page(str):
    """A page of its own, which a report shows in a frame."""


class Folded(str):
    """A heading whose section opens by a click."""


Sections = Iterable[tuple[str, Iterable[Any]]]
"""Headings and the items below them; see `html_report`."""


def write_report(
    path: Path,
    title: str,
    sections: Sections,
    verdict: Verdict | None = None,
    warnings: Sequence[str] = (),
) -> Path:
    """Write a report, see `html_report`; return its path.

    The report ends with what was run, if the folder has the record of `fenicsrom.post.base.origin`.

    Raises:
        OSError: the file cannot be written.
    """
    run = origin_table(path.parent)
    last = [(Folded("What was run"), [run])] if run else []
    return write_text(path, html_report(title, [*sections, *last], verdict, warnings))


def html_report(
    title: str, sections: Sections, verdict: Verdict | None = None, warnings: Sequence[str] = ()
) -> str:
    """Compose a report in one HTML page.

    Args:
        title: title of the report.
        sections: pairs of a heading and its items. An item is a paragraph (text), a table (a list
            of rows, the first row is the header), a matplotlib figure, a `Drawn` picture, which
            gets a number and a caption, or a `Page`. A section with a `Folded` heading is closed
            at first.
        verdict: whether the results can be trusted, at the top.
        warnings: warnings, below the verdict.

    Returns:
        The HTML text.
    """
    body = [f"<h1>{html.escape(title)}</h1>"]
    if verdict:
        body.append(f'<p class="verdict {verdict.kind}">{html.escape(verdict.text)}</p>')
    if warnings:
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in dict.fromkeys(warnings))
        body.append(f"<section><h2>Warnings</h2><ul>{lines}</ul></section>")
    number, charts = count(1), []
    for heading, items in sections:
        folded = isinstance(heading, Folded)
        tag, head = ("details", "summary") if folded else ("section", "h2")
        body.append(f"<{tag}><{head}>{html.escape(heading)}</{head}>")
        for item in items:
            if isinstance(item, Drawn):
                body.append(_figure(item, next(number)))
                charts += [(item.path.name, item.chart)] if item.chart else []
            else:
                body.append(_item(item, heading))
        body.append(f"</{tag}>")
    script = _script(charts) if charts else ""
    return _filled("page.html", title=html.escape(title), body="\n".join(body), script=script)


def _figure(drawn: Drawn, number: int) -> str:
    """Compose a picture with its number and caption; a script puts the chart in its place."""
    path, links = drawn.path, [drawn.path.name]
    links += [name] if (name := numbers_of(path.name)) and (path.parent / name).exists() else []
    if drawn.chart:
        name = html.escape(path.name)
        image = f'<img alt="{html.escape(drawn.heading)}" src="{name}">'  # where no script runs
        place = f'<div id="chart-{name}">{image}</div>'
    else:
        place = _picture(path.read_bytes(), drawn.heading, path.suffix.removeprefix("."))
    note = f" {html.escape(drawn.note)}" if drawn.note else ""
    hint = " Drag to zoom, click a name to hide its curve." if drawn.chart else ""
    named = ", ".join(f'<a href="{name}">{name}</a>' for name in map(html.escape, links))
    text = f"<b>Figure {number}. {html.escape(drawn.heading)}.</b>{note}{hint} {named}"
    return f"<figure>{place}<figcaption>{text}</figcaption></figure>"


def _script(charts: Sequence[tuple[str, str]]) -> str:
    """Compose what draws the charts: the library, packed, and the data."""
    items = ",".join(f'["chart-{name}", {chart}]' for name, chart in charts)
    return _filled("charts.html", library=_library(), items=items.replace("</", "<\\/"))


def _filled(name: str, **values: str) -> str:
    """A file beside this module, with values in the place of $NAME."""
    return Template(Path(__file__).with_name(name).read_text(encoding="utf-8")).substitute(values)


@cache
def _library() -> str:
    """The script of Bokeh, compressed, as text."""
    from bokeh.resources import Resources

    code = "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)
    return base64.b64encode(gzip.compress(code.encode(), 9, mtime=0)).decode()


def _item(item: Any, heading: str) -> str:
    """Compose one item of a section."""
    if isinstance(item, Page):
        return f'<iframe id="body" title="{heading}" srcdoc="{html.escape(item)}"></iframe>'
    if isinstance(item, str):
        return f"<p>{html.escape(item)}</p>"
    if hasattr(item, "savefig"):
        png = io.BytesIO()
        item.savefig(png, format="png")
        return _picture(png.getvalue(), heading, "png")
    return _table(filled_columns(item))


def _table(rows: Sequence[Sequence[Any]]) -> str:
    """Compose a table: headers may break between words, short cells do not."""
    if len(rows) <= 1 + FEW_ROWS and len(rows[0]) > FEW_COLUMNS:
        rows = list(zip(*rows, strict=True))
    right = numeric_columns([[_as_number(value) for value in row] for row in rows])
    lines = []
    for i, row in enumerate(rows):
        tag = "td" if i else "th"
        cells = ""
        for value, number in zip(row, right, strict=True):
            text = cell_text(value)
            short = bool(i) and len(text) <= SHORT
            kinds = " ".join(["n"] * number + ["s"] * short)
            cells += f"<{tag}{f' class={chr(34)}{kinds}{chr(34)}' if kinds else ''}>"
            cells += f"{html.escape(text)}</{tag}>"
        lines.append(f"<tr>{cells}</tr>")
    head, *rest = lines
    kinds = "wide many" if len(right) > FEW_COLUMNS else "wide"
    return (
        f'<div class="{kinds}"><table><thead>{head}</thead><tbody>{"".join(rest)}</tbody></table>'
        "</div>"
    )


def _as_number(value: Any) -> Any:
    """The number that a text is; other values as they are."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _picture(content: bytes, heading: str, kind: str) -> str:
    """Embed a PNG or GIF picture in the page."""
    data = base64.b64encode(content).decode()
    return f'<img alt="{html.escape(heading)}" src="data:image/{kind};base64,{data}">'
