"""The scripts of the demos: each can be imported, and the page of the paper is what its script
computes."""

from __future__ import annotations

import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("pyvista")

DEMOS = Path(__file__).parents[2] / "demos"
SCRIPTS = sorted(path for path in DEMOS.rglob("*.py") if path.name != "slip_liftoff.py")


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
@pytest.mark.slow
def test_demo_script_is_imported_without_error(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work of a script stands in functions. (`slip_liftoff.py` is run by another test.)"""
    monkeypatch.syspath_prepend(str(path.parent))
    found = runpy.run_path(str(path), run_name="imported")
    assert found["__doc__"]


@pytest.fixture(scope="module")
def paper() -> Iterator[dict[str, Any]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(DEMOS / "paper"))
        yield runpy.run_path(str(DEMOS / "paper" / "paper_cases.py"), run_name="imported")


def printed(label: str) -> list[str]:
    """The cells of the row of this label in the page of the paper."""
    rows = (DEMOS / "paper" / "README.md").read_text(encoding="utf-8").splitlines()
    (row,) = [row for row in rows if row.startswith(f"| {label} |")]
    return [cell.strip() for cell in row.strip("|").split("|")]


@pytest.mark.parametrize(
    ("label", "name", "linear", "kind"),
    [
        ("40 N, linear", "slip_liftoff", True, "beam"),
        ("open, linear", "open", True, "beam"),
        ("open, linear", "open", True, "solid"),
        pytest.param("40 N, linear", "slip_liftoff", True, "solid", marks=pytest.mark.long),
        pytest.param("40 N, nonlinear", "slip_liftoff", False, "beam", marks=pytest.mark.long),
    ],
)
@pytest.mark.slow
def test_page_of_the_paper_shows_what_its_script_computes(
    paper: dict[str, Any], label: str, name: str, linear: bool, kind: str
) -> None:
    motion = paper["full"](kind, name, *([paper["LINEAR"]] if linear else []))
    across, along = paper["millimetres"](motion)
    cells = printed(label)
    column = 2 + paper["BODIES"].index(kind)
    assert cells[column] == f"{across:.2f}"
    if not linear:
        assert cells[column + 3] == f"{along:.3g}"
