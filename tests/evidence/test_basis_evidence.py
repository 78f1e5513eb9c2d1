"""The evidence on the estimate of the error by the basis: its statistics and its picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import basis_estimate
import numpy as np
import pytest


def run_with(error: float, estimate: float, **others: Any) -> dict[str, Any]:
    """A run with its true error and its estimate."""
    found = {"settled": True, "periodic": True} | others
    for name, value in (("error", error), ("estimate", estimate)):
        found[name] = {"amplitude": value, "directions": [value, value], "peak_force": 0.0}
    return found


RUNS = [
    run_with(0.01, 0.02),
    run_with(0.02, 0.03, settled=False),
    run_with(0.30, 0.06, settled=False, periodic=False),
    run_with(0.04, 0.01),
    run_with(1e-9, 0.5),
    {"settled": True, "refused": "TooSlow: "},
]


def test_statistics_count_what_was_missed() -> None:
    """Two of five are below a third of an error above 1 %; one of them would end with code 0."""
    found = basis_estimate.statistics(basis_estimate.pairs(RUNS))
    assert found["runs"] == 5 and found["above the limit"] == 2
    assert found["median"] == pytest.approx(0.5 * (0.25 + 1.5))  # of 2, 1.5, 0.2 and 0.25
    assert found["missed"] == pytest.approx(0.4) and found["silent"] == pytest.approx(0.2)
    assert len(basis_estimate.pairs(RUNS, "directions")) == 10


def test_runs_are_read_back_and_drawn(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    assert basis_estimate.read(path) == []
    path.write_text("".join(json.dumps(run) + "\n" for run in RUNS), encoding="utf-8")
    assert basis_estimate.read(path) == RUNS
    left, right = basis_estimate.figure(basis_estimate.read(path)).axes
    points = sum(len(line.get_xdata()) for line in left.lines if line.get_marker() == "o")
    assert points == 5
    assert np.sum([patch.get_height() for patch in right.patches]) == 4.0
