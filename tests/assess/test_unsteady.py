"""Why a motion does not repeat: the sentence of the matrix."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, uncoupled

from fenicsrom.assess.unsteady import why_unsteady
from fenicsrom.online.simulate import simulate
from fenicsrom.online.state import PeriodicSearch

NOT_FOUND = PeriodicSearch(
    verdict="not found",
    tends=False,
    time=None,
    periods=1,
    marched=80,
    iterations=7,
    residual=0.3,
    multipliers=np.zeros(0, dtype=np.complex128),
    free_sliders=0,
)


def short_run(*overrides: str) -> tuple[Any, Any, Any]:
    """A linear model of one coordinate, its scene, and its motion over two periods."""
    scene = beam_scene(
        2,
        ("geometrically_nonlinear=false", "time.steps_per_period=50", "time.periods=2", *overrides),
        contacts=None,
        probe={"group": "tip"},
    )
    model = uncoupled(scene, 500.0)
    return model, scene, simulate(model, scene)


@pytest.mark.parametrize(
    ("verdict", "told"),
    [("torus", "unstable (torus, largest multiplier 1.25)"), ("stable", "not reached")],
)
def test_motion_that_was_found_is_told_with_its_multiplier(verdict: str, told: str) -> None:
    model, scene, motion = short_run()
    search = NOT_FOUND._replace(verdict=verdict, multipliers=np.array([0.75 + 1j, 0.75 - 1j]))
    assert told in why_unsteady(model, scene, replace(motion, search=search))


def test_motion_that_was_not_found_is_followed_from_heavy_damping() -> None:
    """The multipliers of the oscillator have the size exp(-alpha T / 2)."""
    model, scene, motion = short_run("material.mass_damping=0.5")
    told = why_unsteady(model, scene, replace(motion, search=NOT_FOUND))
    found = re.search(r"a stable periodic motion exists \(largest multiplier ([0-9.]+)\)", told)
    assert found is not None
    assert float(found[1]) == pytest.approx(np.exp(-0.25 * scene.period), rel=1e-3)


def test_adaptive_run_has_no_curve_to_follow() -> None:
    model, scene, motion = short_run()
    changed = replace(scene, time=replace(scene.time, stepping=None))
    told = why_unsteady(model, changed, replace(motion, search=NOT_FOUND))
    assert told.endswith("Newton's method found no periodic motion")
