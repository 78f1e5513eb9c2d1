"""The notebooks of the demos, cell by cell, on coarser meshes than the reader's.

IPython executes them, which k3d brings along; a kernel and its packages would be needed to keep the
outputs only.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("k3d")
pytest.importorskip("pyvista")

DEMOS = Path(__file__).parents[1] / "demos"
COARSER = {
    "plate_with_a_hole": {},
    "blade_and_casing": {
        '"elements_along": 12, "elements_across": 8': '"elements_along": 4, "elements_across": 2',
        '"output.animation": False': '"output.animation": False, "basis.modes": 2, '
        '"basis.masters": 2, "time.steps_per_period": 100, "time.periods": 6, '
        '"time.steady": "march"',
    },
    "bolted_joint": {
        '"elements_along": 12': '"elements_along": 4',
        '"time.duration": 0.1, "time.step": 1e-4': '"time.duration": 0.03, "time.step": 2e-4',
    },
}
"""For each notebook, what the tests change in its cells."""
Executed = Callable[[str], tuple[Any, list[Any]]]
pytestmark = pytest.mark.slow


@pytest.fixture(params=[False, pytest.param(True, marks=pytest.mark.long)])
def executed(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Executed:
    """Runs a notebook on coarser meshes or as it is."""
    return lambda name: run_cells(name, {} if request.param else dict(COARSER[name]), monkeypatch)


def run_cells(
    name: str, coarser: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> tuple[Any, list[Any]]:
    """The variables of a notebook and the results of its cells, whose widget shows a mode."""
    from IPython.core.interactiveshell import InteractiveShell

    monkeypatch.chdir(DEMOS)
    shell, results = InteractiveShell(), []
    for cell in json.loads((DEMOS / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            text = "".join(cell["source"])
            for given in [given for given in coarser if given in text]:
                text = text.replace(given, coarser.pop(given))
            done = shell.run_cell(text)
            done.raise_error()
            results.append(done.result)
    assert not coarser
    widget = next(found for found in results if hasattr(found, "children"))
    shapes, plot = widget.children
    names = [name for name, _ in shapes.options]
    assert names[0] == "set-up" and any(name.startswith("1V, ") for name in names)
    before: Any = plot.time
    shapes.value = shapes.options[1][1]
    assert plot.time != before
    return shell.user_ns, results


def test_notebook_leads_from_the_mesh_to_the_response_curve(executed: Executed) -> None:
    known, results = executed("plate_with_a_hole")
    page = next(found for found in results if hasattr(found, "_repr_html_"))
    assert "largest" in page._repr_html_().lower()
    top, frequency = known["top"], known["study"].modes.frequencies_hz[0]
    assert 45.0 < top.parameter < 70.0 and top.parameter > 0.9 * frequency


def test_notebook_of_the_blade_finds_the_gap_without_rub(executed: Executed) -> None:
    known, _ = executed("blade_and_casing")
    narrow, middle, wide = known["peaks"].values()
    assert narrow > middle > wide == 0.0
    assert known["diagram"].frequencies_hz[-1, 0] > known["diagram"].frequencies_hz[0, 0]


def test_notebook_of_the_joint_finds_damping_that_grows_with_the_blow(executed: Executed) -> None:
    known, _ = executed("bolted_joint")
    low, middle, high = known["shares"].values()
    assert 0.0 < low < middle < high < 1.0
