"""The notebook of the demos, cell by cell.

IPython executes it, which k3d brings along; a kernel and its packages would be needed to keep the
outputs only.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("dolfinx")
pytest.importorskip("k3d")
pytest.importorskip("pyvista")

NOTEBOOK = Path(__file__).parents[1] / "demos" / "plate_with_a_hole.ipynb"


@pytest.mark.slow
def test_notebook_leads_from_the_mesh_to_the_response_curve() -> None:
    from IPython.core.interactiveshell import InteractiveShell

    shell, results = InteractiveShell(), []
    for cell in json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            done = shell.run_cell("".join(cell["source"]))
            done.raise_error()
            results.append(done.result)
    widget = next(found for found in results if hasattr(found, "children"))
    shapes, plot = widget.children
    names = [name for name, _ in shapes.options]
    assert names[0] == "set-up" and any(name.startswith("1V, ") for name in names)
    before: Any = plot.time
    shapes.value = shapes.options[1][1]
    assert plot.time != before
    page = next(found for found in results if hasattr(found, "_repr_html_"))
    assert "Largest" in page._repr_html_() or "largest" in page._repr_html_()
    top, frequency = shell.user_ns["top"], shell.user_ns["study"].modes.frequencies_hz[0]
    assert 45.0 < top.parameter < 70.0 and top.parameter > 0.9 * frequency
