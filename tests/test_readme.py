"""The pages of the project: links, pictures, length of the README, and its Python block."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import references

ROOT = Path(__file__).parents[1]
PAGES = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    *sorted(f"demos/{page.name}" for page in (ROOT / "demos").glob("*.md")),
    "demos/paper/README.md",
    "docker/README.md",
    "fenicsrom/README.md",
    "meshes/README.md",
    "tests/README.md",
]
README_LINES = 120
PICTURE_BYTES = 300_000
WORDS = 30_000
EVIDENCE = "docker/run python3 -m pytest tests/evidence"  # left out of the suite
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def prose(page: Path) -> str:
    """The text of a page without its code blocks, in which brackets are no links."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return "\n".join(line for line in text.splitlines() if not line.startswith("    "))


def anchors(page: Path) -> set[str]:
    """The anchors of the headings, as code forges make them."""
    kept = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in HEADING.findall(prose(page))]
    return {heading.replace(" ", "-") for heading in kept}


def broken_links(page: Path) -> list[str]:
    """The relative links of a page whose file or heading does not exist."""
    broken = []
    for link in LINK.findall(prose(page)):
        if re.match(r"\w+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    return broken


@pytest.mark.parametrize("page", PAGES)
def test_relative_links_of_a_page_exist(page: str) -> None:
    assert broken_links(ROOT / page) == []


def test_broken_links_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A Title!\n[a](#a-title) [b](page.md#b) [c](c.png) [d](https://d.org)\n")
    assert broken_links(page) == ["page.md#b", "c.png"]


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= README_LINES


def test_pictures_are_small_and_shown() -> None:
    pictures = sorted((ROOT / "demos" / "pictures").glob("*"))
    shown = {Path(link).name for page in PAGES for link in LINK.findall(prose(ROOT / page))}
    assert len(pictures) >= 10
    for picture in pictures:
        assert picture.suffix == ".png" and picture.stat().st_size < PICTURE_BYTES, picture
        assert picture.name in shown, picture


def test_pages_and_continuous_integration_give_one_test_command() -> None:
    (command,) = re.findall(r"(?m)^    (docker/run .*pytest.*)$", (ROOT / "README.md").read_text())
    assert (ROOT / ".ci" / "run").read_text().splitlines().count(command) == 1
    for page in ("CONTRIBUTING.md", "tests/README.md", "docker/README.md"):
        given = re.findall(r"(?m)^    (docker/run .*pytest[^#\n]*)", (ROOT / page).read_text())
        assert command in map(str.strip, given), page
        allowed = {command, f'{command} -m "not slow"', f"{command} -m long", EVIDENCE}
        assert {line.strip() for line in given} <= allowed, page


def test_every_demo_is_in_the_gallery() -> None:
    gallery = (ROOT / "demos" / "README.md").read_text()
    for scene in sorted((ROOT / "demos").glob("*.toml")):
        assert f"({scene.name})" in gallery and f"pictures/{scene.stem}.png" in gallery
    for script in sorted((ROOT / "demos").glob("*.py")):
        assert f"({script.name})" in gallery, script.name


def test_pages_together_are_short() -> None:
    """As wc counts words: what a page gains, another one must lose."""
    assert sum(len((ROOT / page).read_text().split()) for page in PAGES) <= WORDS


def test_table_of_references_is_that_of_the_tests() -> None:
    page = (ROOT / "tests" / "README.md").read_text(encoding="utf-8")
    assert page == references.replaced(page), "python3 tests/references.py writes the table"
    assert len(references.PART.findall(page)) == 1


def test_reference_without_five_fields_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "test_a.py"
    file.write_text('def test_a():\n    """Reference: what | source | value | ours"""\n')
    with pytest.raises(ValueError, match=r"test_a\.py, test_a: 4 fields"):
        references.references_of(file)


def test_citation_and_changelog_name_the_version() -> None:
    from fenicsrom import __version__

    cited = re.findall(r"(?m)^version: (\S+)$", (ROOT / "CITATION.cff").read_text())
    assert cited == [__version__]
    assert f"## [{__version__}]" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.slow
def test_python_block_of_the_readme_runs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    monkeypatch.chdir(ROOT)
    (block,) = PYTHON.findall((ROOT / "README.md").read_text())
    exec(compile(block, "README.md", "exec"), {"__name__": "readme"})
    printed = capsys.readouterr().out
    found = [float(value) for value in re.findall(r"'tangential': \[([\d.]+)\]", printed)]
    assert len(found) == 4 and "1V1S" in printed
    assert found[0] == pytest.approx(0.15759, rel=1e-4)
    assert found[1] < found[2] < found[0] < found[3]
