"""Reports: what a command found, as files, in the terminal and on one HTML page."""

import base64
import io
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, cached_property
from itertools import count
from pathlib import Path
from typing import Any

from fenicsrom.notes import Note, Verdict, verdict_of
from fenicsrom.online.store.store import provenance
from fenicsrom.post.base import tables
from fenicsrom.post.base.chart import page_script
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.origin import origin_table
from fenicsrom.post.base.picture import Drawn, Picture, draw_pictures
from fenicsrom.post.base.style import Figure
from fenicsrom.scene import Scene, scene_heading
from fenicsrom.words import counted

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
    return tables.write_text(path, html_report(title, [*sections, *last], verdict, warnings))


def html_report(
    title: str, sections: Sections, verdict: Verdict | None = None, warnings: Sequence[str] = ()
) -> str:
    """Compose a report in one HTML page.

    Args:
        title: title of the report.
        sections: pairs of a heading and its items. An item is a paragraph (text), a table (a list
            of rows, the first row is the header), a matplotlib figure, a `Drawn` picture, which
            gets a number and its caption, or a `Page`. A section with a `Folded` heading is closed
            at first.
        verdict: whether the results can be trusted, at the top.
        warnings: warnings, below the verdict.

    Returns:
        The HTML text.
    """
    numbers, charts, parts = count(1), dict[str, str](), []
    for heading, items in sections:
        told = [_told(item, numbers) for item in items]
        parts.append({"heading": heading, "folded": isinstance(heading, Folded), "items": told})
        drawn = [item for item in items if isinstance(item, Drawn)]
        charts |= {f"chart-{one.path.name}": one.chart for one in drawn if one.chart}
    script = page_script(charts) if charts else None
    lines = dict.fromkeys(warnings)
    return _template().render(
        title=title, verdict=verdict, warnings=lines, sections=parts, script=script
    )


@cache
def _template() -> Any:
    """The template of a page."""
    import jinja2

    text = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    look: Any = {"trim_blocks": True, "lstrip_blocks": True, "autoescape": True}
    return jinja2.Environment(**look).from_string(text)


def _told(item: Any, numbers: Iterator[int]) -> dict[str, Any]:
    """What the template shows of an item: one of text, page, image, figure and table."""
    if isinstance(item, Page):
        return {"page": str(item)}
    if isinstance(item, str):
        return {"text": item}
    if isinstance(item, Drawn):
        path = item.path
        links = [path.name, *([item.numbers] if item.numbers else [])]
        links = [name for name in links if (path.parent / name).exists()]
        image = None if item.chart else _embedded(path.read_bytes(), path.suffix[1:])
        return {"figure": item, "number": next(numbers), "links": links, "image": image}
    if hasattr(item, "savefig"):
        png = io.BytesIO()
        item.savefig(png, format="png")
        return {"image": _embedded(png.getvalue(), "png")}
    return _table(tables.filled_columns(item))


def _embedded(content: bytes, kind: str) -> str:
    """The address of a PNG or GIF picture in the page."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _table(rows: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """The cells of a table with their classes; a wide table of few rows is turned."""
    if len(rows) <= 1 + FEW_ROWS and len(rows[0]) > FEW_COLUMNS:
        rows = list(zip(*rows, strict=True))
    right = tables.numeric_columns(rows)
    table = []
    for i, row in enumerate(rows):
        texts = [*map(tables.cell_text, row)]
        kinds = (
            " ".join(["n"] * number + ["s"] * (i > 0 and len(text) <= SHORT))
            for text, number in zip(texts, right, strict=True)
        )
        table.append(list(zip(texts, kinds, strict=True)))
    return {"table": table, "many": len(right) > FEW_COLUMNS}


LONG = 20  # rows of a table that is folded

Table = Sequence[Sequence[Any]]
"""The rows of a table; the first row is the header."""


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes:
        heading: its heading on the page.
        items: tables, and paragraphs as texts; empty ones are left out, and so is a section
            without others.
        terminal: whether the terminal shows it.
        keys: number of the first columns, which tell the rows of a table apart.
        most: most rows of a table in the terminal; None for all.
        top: whether the page begins with it.
    """

    heading: str
    items: Sequence[Table | str | None]
    terminal: bool = True
    keys: int = 1
    most: int | None = None
    top: bool = False

    @property
    def filled(self) -> list[Table | str]:
        """The items that are not empty."""
        return [item for item in self.items if item]


@dataclass(frozen=True, repr=False)
class Report:
    """What a command found.

    Attributes:
        name: name of the numbers, such as "campbell": `campbell.csv` and `campbell.json`.
        title: what the report shows, after the heading of the scene; "" for a run.
        found: the record of the command. Its scene says whether pictures are drawn.
        sentences: what was found.
        sections: the tables.
        rows: rows of the CSV file.
        summary: the content of the JSON file, without what `_json` adds.
        pictures: the pictures.
        notes: paragraphs below the sentences, on the page only.
        varied: keys of the scene that its heading leaves out.
        more_rows: rows of other CSV files, by the name of the file.
        quantities: what the user reads, each with its own judgement; see `Verdict`.
        unjudged: what the user reads and no check judges.
    """

    name: str
    title: str
    found: Any
    sentences: Sequence[str]
    sections: Sequence[Section]
    rows: Sequence[Mapping[str, Any]]
    summary: Mapping[str, Any]
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()
    varied: Collection[str] = ()
    more_rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    quantities: Sequence[str] = ()
    unjudged: Sequence[str] = ()

    @property
    def scene(self) -> Scene:
        """The scene of the record."""
        scene: Scene = self.found.scene
        return scene

    @cached_property
    def warnings(self) -> list[Note]:
        """Warnings for the user; a picture that cannot be drawn adds one."""
        warnings: list[Note] = getattr(self.found, "warnings", [])
        return warnings

    def write_numbers(self, folder: Path) -> list[Path]:
        """Write `NAME.csv`, `NAME.json` and the other CSV files.

        Raises:
            OSError: a file cannot be written.
        """
        return [
            tables.write_rows(folder / f"{self.name}.csv", self.rows),
            tables.write_summary(folder / f"{self.name}.json", self._json()),
            *(tables.write_rows(folder / name, rows) for name, rows in self.more_rows.items()),
        ]

    def _json(self) -> dict[str, Any]:
        """The content of the JSON file: the scene, the summary, and how the computation ended."""
        found, names = self.found, ("seconds", "interrupted")
        ended = {name: getattr(found, name) for name in names if hasattr(found, name)}
        if hasattr(found, "unfinished"):
            ended["unfinished"] = str(found.unfinished) if found.unfinished else None
        if hasattr(found, "mesh_check"):
            ended["estimated_mesh_error"] = asdict(found.mesh_check)
        last = {**told(self.verdict, self.warnings), "provenance": provenance()}
        return {"scene": self.scene.source, **self.summary, **ended, **last}

    def write(self, folder: Path) -> list[Path]:
        """Write the numbers, the pictures and `report.html`.

        Returns:
            The files, the one to open first at the head.

        Raises:
            OSError: a file cannot be written.
        """
        files, known = self.write_numbers(folder), len(self.warnings)
        listed = self.pictures if self.scene.output.pictures else ()
        pictures = draw_pictures(listed, folder, self.warnings)
        if len(self.warnings) > known:
            files = self.write_numbers(folder)
        return [self.write_page(folder, pictures), *files, *(drawn.path for drawn in pictures)]

    def write_page(
        self, folder: Path, pictures: Sequence[Drawn], more: Sequence[tuple[str, list[Any]]] = ()
    ) -> Path:
        """Write `report.html` with pictures that were drawn.

        Args:
            folder: folder of the page.
            pictures: the pictures; the first one is below the results.
            more: headings and items that come next.

        Raises:
            OSError: the file cannot be written.
        """
        first, *others = [(drawn.heading, [drawn]) for drawn in pictures] or [("", [])]
        parts = self._parts([first, *more, *others])
        page = folder / "report.html"
        return write_report(page, self._heading(), parts, self.verdict, self.warnings)

    @property
    def verdict(self) -> Verdict:
        """Whether the results can be trusted."""
        interrupted = getattr(self.found, "interrupted", False)
        return verdict_of(
            self.warnings,
            failure_of(self.found),
            interrupted=interrupted,
            quantities=self.quantities,
            unjudged=self.unjudged,
        )

    def plot(self) -> Figure:
        """Draw the first picture, a matplotlib figure."""
        return figure_of(self.pictures[0].draw())

    def __repr__(self) -> str:
        """The sentences."""
        return "\n".join([self._heading(), *self.sentences])

    def _repr_html_(self) -> str:
        """The page with its first picture, for notebooks."""
        first = [(p.heading, [figure_of(p.draw()), p.caption]) for p in self.pictures[:1]]
        return html_report(self._heading(), self._parts(first), self.verdict, self.warnings)

    def _heading(self) -> str:
        """The heading of the page."""
        return ": ".join(filter(None, [scene_heading(self.scene, self.varied), self.title]))

    def _parts(self, pictures: Sequence[tuple[str, list[Any]]]) -> list[tuple[str, list[Any]]]:
        """The parts of the page: headings and items."""
        head = [item for s in self.sections if s.top for item in s.filled]
        shown = [s for s in self.sections if s.filled and not s.top]
        results = [s for s in shown if s.terminal] or shown[:1]
        first = [item for _, items in pictures[:1] for item in items if item]
        return [
            ("Results", [*head, *self.sentences, *first]),
            *((s.heading, s.filled) for s in results if not _is_long(s)),
            *((heading, list(filter(None, items))) for heading, items in pictures[1:]),
            *((Folded(s.heading), s.filled) for s in shown if s not in results or _is_long(s)),
            *([(Folded("Notes"), list(self.notes))] if self.notes else []),
        ]

    def text(self) -> str:
        """The tables and the sentences, for the terminal."""
        parts = [
            self._shown(item, section)
            for section in self.sections
            if section.terminal
            for item in section.filled
        ]
        return "\n\n".join([*parts, "\n".join(self.sentences)])

    def _shown(self, item: Table | str, section: Section) -> str:
        """A table or a paragraph in the terminal."""
        if isinstance(item, str):
            return item
        more = 0 if section.most is None else len(item) - 1 - section.most
        if more <= 1:  # the sentence takes a line, too
            return tables.text_table(item, section.keys)
        shown = tables.text_table(item[: 1 + (section.most or 0)], section.keys)
        return f"{shown}\n{self.name}.csv lists {counted(more, 'more row')}."


def told(verdict: Verdict, warnings: Sequence[str]) -> dict[str, Any]:
    """The entries of a JSON file on the trust in its results."""
    return {"verdict": asdict(verdict), "warnings": warnings}


def failure_of(found: Any) -> Exception | None:
    """The error that ended the computation of a record, or None."""
    failed: Any = getattr(found, "unfinished", None)
    return failed[1] if isinstance(failed, tuple) else failed  # a study names the model, too


def _is_long(section: Section) -> bool:
    """Whether a section has a table that is folded at first."""
    return any(not isinstance(item, str) and len(item) > LONG for item in section.filled)
