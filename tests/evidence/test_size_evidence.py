"""The evidence on the size of reduced models: its statistics and its picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import basis_size
import numpy as np
import pytest


def run_with(error: float, estimate: float, **others: Any) -> dict[str, Any]:
    """A run with its true error and its estimate."""
    found = {"settled": True, "full_settled": True, "warned": False, "points": 2, "step": 1e-5}
    found |= {"size": 10, "paired": 20, "paired_step": 4e-5, "full_step": 1e-3}
    return found | {"error": error, "estimate": estimate, "worst_error": 2.0 * error} | others


RUNS = [
    run_with(1e-4, 2e-4),
    run_with(5e-4, 5e-4, size=12),
    run_with(5e-3, 1e-4, size=14),
    run_with(3e-2, 2e-2, warned=True, size=16),
    run_with(1e-8, 1e-4, size=18),
    run_with(0.5, 1e-4, full_settled=False),
    {"points": 3, "refused": "TooSlow: "},
]


def test_statistics_count_errors_that_nobody_warns_of() -> None:
    found = basis_size.statistics(RUNS, 1e-3)
    counts = [found[key] for key in ("runs", "compared", "not periodic", "without a result")]
    assert counts == [7, 5, 1, 1]
    assert found["above it without a warning"] == 1 and found["warned"] == 1
    assert found["largest error of a direction"] == 2.0 * found["largest error"] == 0.06
    assert found["below the accuracy"] == pytest.approx(0.6)
    assert found["median effectivity"] == pytest.approx(0.5 * (1.0 + 2.0 / 3.0))
    assert (found["median size"], found["largest size"]) == (14.0, 18.0)
    assert found["median speed of a step"] == pytest.approx(100.0)
    assert found["median speed of a step against pairs"] == pytest.approx(4.0)


def test_scenes_depend_on_their_seed_and_number_only() -> None:
    first, again, other = (basis_size.random_scene(2, *pair) for pair in ((1, 3), (1, 3), (1, 4)))
    assert first == again and first != other
    assert 1 <= len(first.contacts) <= 8


def test_runs_are_read_back_and_drawn(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    assert basis_size.read(path) == []
    path.write_text("".join(json.dumps(run) + "\n" for run in RUNS), encoding="utf-8")
    assert basis_size.read(path) == RUNS
    left, right = basis_size.figure(basis_size.read(path), 1e-3).axes
    assert [len(np.asarray(line.get_xdata())) for line in left.lines] == [6, 6]
    assert sum(len(np.asarray(line.get_xdata())) for line in right.lines[1:3]) == 5
