"""A report as one HTML file that contains its pictures."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from fenicsrom.post.base.origin import origin_table
from fenicsrom.post.base.tables import cell_text, filled_columns, numeric_columns
from fenicsrom.post.base.writers import write_text

FEW_COLUMNS = 8  # a table with more columns has smaller letters
SHORT = 28  # characters of the longest cell that is not broken into lines


class Page(str):
    """A page of its own, which a report shows in a frame."""


def write_report(
    path: str | Path, title: str, sections: Iterable[tuple[str, Iterable[Any]]]
) -> Path:
    """Write a report, see `html_report`; return its path.

    The report ends with what was run, if the folder has the record of `fenicsrom.post.base.origin`.

    Raises:
        OSError: the file cannot be written.
    """
    run = origin_table(Path(path).parent)
    last = [("What was run", [run])] if run else []
    return write_text(path, html_report(title, [*sections, *last]))


def html_report(title: str, sections: Iterable[tuple[str, Iterable[Any]]]) -> str:
    """Compose a report in one HTML page.

    Args:
        title: title of the report.
        sections: pairs of a heading and its items. An item is a paragraph (text), a table (a list
            of rows, the first row is the header), a matplotlib figure, the path of a PNG or GIF
            picture, or a `Page`.

    Returns:
        The HTML text.
    """
    body = [f"<h1>{html.escape(title)}</h1>"]
    for heading, items in sections:
        body.append(f"<section><h2>{html.escape(heading)}</h2>")
        body.extend(_item(item, heading) for item in items)
        body.append("</section>")
    return _PAGE.format(title=html.escape(title), body="\n".join(body))


def _item(item: Any, heading: str) -> str:
    """Compose one item of a section."""
    if isinstance(item, Page):
        return f'<iframe id="body" title="{heading}" srcdoc="{html.escape(item)}"></iframe>'
    if isinstance(item, str):
        return f"<p>{html.escape(item)}</p>"
    if isinstance(item, Path):
        return _picture(item.read_bytes(), heading, item.suffix.removeprefix("."))
    if hasattr(item, "savefig"):
        png = io.BytesIO()
        item.savefig(png, format="png")
        return _picture(png.getvalue(), heading, "png")
    return _table(filled_columns(item))


def _table(rows: Sequence[Sequence[Any]]) -> str:
    """Compose a table: headers may break between words, short cells do not."""
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
    kinds = "wide broad many" if len(right) > FEW_COLUMNS else "wide"
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


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark;
  --ink: #1d2125; --paper: #fdfdfc; --line: #d9dde1; --soft: #5b636b; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e4e7ea; --paper: #17191c; --line: #3a3f45; --soft: #a2aab2; }}
}}
body {{ font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 62rem;
  margin: 2.5rem auto; padding: 0 1.25rem; }}
h1 {{ font-size: 1.7rem; line-height: 1.25; margin: 0 0 1.5rem; }}
h2 {{ font-size: 1.15rem; margin: 2.4rem 0 .7rem; padding-bottom: .3rem;
  border-bottom: 1px solid var(--line); }}
p {{ max-width: 46rem; margin: .6rem 0; }}
img {{ display: block; max-width: 100%; height: auto; margin: 1rem 0; padding: .6rem;
  box-sizing: border-box;
  background: #fff; border: 1px solid var(--line); border-radius: 6px; }}
iframe {{ width: 100%; height: 32rem; border: 1px solid var(--line); border-radius: 6px; }}
.wide {{ overflow-x: auto; margin: 1rem 0; }}
.broad {{ width: max-content; min-width: 100%;
  max-width: calc(100vw - 3rem); position: relative; left: 50%; transform: translateX(-50%); }}
table {{ border-collapse: collapse; font-size: .92rem; font-variant-numeric: tabular-nums; }}
th, td {{ text-align: left; padding: .3rem .9rem .3rem 0; border-bottom: 1px solid var(--line);
  vertical-align: top; }}
th {{ color: var(--soft); font-weight: 600; }}
.n {{ text-align: right; }}
td.n {{ padding-left: .9rem; }}
.s {{ white-space: nowrap; }}
td {{ overflow-wrap: anywhere; }}
.many table {{ font-size: .82rem; }}
.many th, .many td, .many td.n {{ padding: .25rem .7rem .25rem 0; }}
.many th {{ vertical-align: bottom; }}
@media print {{ .wide, .broad {{ max-width: none; overflow: visible; }} }}
</style>
</head>
<body>
{body}
</body>
</html>
"""
