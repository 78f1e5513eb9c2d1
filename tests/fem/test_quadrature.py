"""The quadrature rule: its degree by the distortion of the cells, and what it does to the
frequencies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import STEEL, STOCKY, beam_scene, make_solid

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.fem.base.forms import LEAST_DEGREE
from fenicsrom.fem.body import elasticity
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.scene import make_scene

RING = """\
DefineConstant[ around = 4 ];
Point(1) = {0, 0, 0};
Point(2) = {0.08, 0, 0}; Point(3) = {0.1, 0, 0}; Point(4) = {0, 0.1, 0}; Point(5) = {0, 0.08, 0};
Line(1) = {2, 3}; Circle(2) = {3, 1, 4}; Line(3) = {4, 5}; Circle(4) = {5, 1, 2};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve {1, 3} = 3; Transfinite Curve {2, 4} = around + 1; Transfinite Surface {1};
Recombine Surface {1};
Physical Surface("solid") = {1}; Physical Curve("root") = {1}; Physical Curve("tip") = {3};
"""


def quarter_ring(folder: Path, around: int) -> Any:
    """A quarter of a ring of 2 x `around` curved quadrilaterals, clamped at one end."""
    (folder / "ring.geo").write_text(RING)
    return build_solid(
        make_scene(
            folder=folder,
            geometry={
                "mesh": "ring.geo",
                "dimension": 2,
                "thickness": 0.01,
                "curved": True,
                "parameters": {"around": around},
            },
            material=STEEL,
            supports=[{"group": "root"}],
            loads=[{"group": "tip", "direction": [1.0, 0.0], "force": 1.0, "frequency": 10.0}],
        ),
        MPI.COMM_WORLD,
    )


def frequencies(solid: Any) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(solid.eigenmodes(solid.factor, 4)[0]))


@pytest.mark.parametrize(("dimension", "cells"), [(2, "simplex"), (3, "structured")])
def test_straight_cells_keep_least_degree(dimension: int, cells: str) -> None:
    solid = make_solid(beam_scene(dimension, (*STOCKY, f"geometry.cells='{cells}'")))
    assert solid.quadrature_degree == LEAST_DEGREE == 4


@pytest.mark.slow
def test_frequencies_of_curved_cells_are_those_of_exact_integrals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A rule of degree 4 is off by 1e-3 on these cells."""
    found = quarter_ring(tmp_path, 4)
    errors = {}
    monkeypatch.setattr(elasticity, "quadrature_degree", lambda domain: 12)
    exact = frequencies(quarter_ring(tmp_path, 4))
    errors["chosen"] = np.abs(frequencies(found) / exact - 1.0).max()
    monkeypatch.setattr(elasticity, "quadrature_degree", lambda domain: LEAST_DEGREE)
    errors["least"] = np.abs(frequencies(quarter_ring(tmp_path, 4)) / exact - 1.0).max()
    assert errors["chosen"] < 1e-4 < 1e-3 < errors["least"]


def test_fine_curved_cells_need_no_higher_degree(tmp_path: Path) -> None:
    assert quarter_ring(tmp_path, 4).quadrature_degree == 6
    assert quarter_ring(tmp_path, 16).quadrature_degree == LEAST_DEGREE
