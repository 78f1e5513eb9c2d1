"""The frequencies beside measurements that tests/README.md states, on coarse meshes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("meshio")
pytest.importorskip("dolfinx")
from tests.evidence import measured


def stated(body: str, column: int) -> list[float]:
    """The numbers of a row of the page: 1 for the measured ones, 2 for ours, 3 for differences."""
    page = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| {body} \|.*", page, re.MULTILINE)
    return [float(value) for value in row.replace("−", "-").split("|")[1 + column].split(",")]


@pytest.mark.parametrize("body", ["panel", "beam, across its lap", "beam, along its lap"])
def test_differences_of_the_page_are_those_of_its_frequencies(body: str) -> None:
    found = 100.0 * (np.divide(stated(body, 2), stated(body, 1)) - 1.0)
    np.testing.assert_allclose(stated(body, 3), found, atol=0.051)


def test_damping_of_the_page_is_that_which_was_measured() -> None:
    amplitude, _, ratio = np.transpose(measured.DAMPING)
    np.testing.assert_allclose(stated("amplitude, mm", 1), amplitude)
    np.testing.assert_allclose(stated("damping, measured, %", 1), ratio)


def test_panel_has_the_frequencies_of_the_page() -> None:
    """Twelve cells have an error below 1 %; the measured modes are as far away as the page says."""
    found = measured.panel(12)
    np.testing.assert_allclose(found[:4], stated("panel", 2)[:4], rtol=1e-2)
    np.testing.assert_allclose(stated("panel", 1), measured.PANEL)
    np.testing.assert_allclose(found[:4], measured.PANEL[:4], rtol=4.5e-2)


@pytest.mark.slow
def test_beam_with_a_lap_has_the_frequencies_of_the_page() -> None:
    across, along = measured.beam(1)
    np.testing.assert_allclose(across[:6], stated("beam, across its lap", 2), rtol=3e-2)
    assert along[0] == pytest.approx(stated("beam, along its lap", 2)[0], rel=1e-2)
