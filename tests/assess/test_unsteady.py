"""Why a motion does not repeat: the sentence of the matrix."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, uncoupled

from fenicsrom.assess.curves import unsteady
from fenicsrom.assess.curves.unsteady import why_unsteady
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.step.state import PeriodicSearch

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


def growing(motion: Motion, percent: float) -> Motion:
    """The motion with amplitudes that grow by so much in a period, so that it does not settle."""
    assert motion.period is not None
    factor = 1.0 + 0.01 * percent * motion.time / motion.period
    moved = factor[:, None, None] * motion.displacement
    return replace(motion, steady=False, search=NOT_FOUND, displacement=moved)


@pytest.mark.parametrize(
    ("verdict", "told"),
    [("torus", "unstable (torus, largest multiplier 1.25)"), ("stable", "not reached")],
)
def test_motion_that_was_found_is_told_with_its_multiplier(verdict: str, told: str) -> None:
    model, scene, motion = short_run()
    search = NOT_FOUND._replace(verdict=verdict, multipliers=np.array([0.75 + 1j, 0.75 - 1j]))
    lost = growing(motion, 5.0)
    found = why_unsteady(model, scene, replace(lost, search=search), lost)
    assert told in found and "half the step" not in found
    settled = replace(motion, steady=True)
    assert "; with an eighth of the step" in why_unsteady(model, scene, lost, settled)


@pytest.mark.parametrize("way", ["near generalised-alpha", "from heavy damping"])
def test_motion_that_was_not_found_is_sought_in_two_ways(
    way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The multipliers of the oscillator have the size exp(-alpha T / 2)."""
    model, scene, motion = short_run("material.mass_damping=0.5", "time.periods=8")
    left_out = {
        "near generalised-alpha": ("_from_heavy_damping", ("", None)),
        "from heavy damping": ("_near_generalised_alpha", None),
    }
    name, result = left_out[way]
    monkeypatch.setattr(unsteady, name, lambda *_: result)
    told = why_unsteady(model, scene, growing(motion, 5.0), growing(motion, 5.0))
    found = re.search(r"a stable periodic motion exists \(largest multiplier ([0-9.]+)\)", told)
    assert found is not None
    assert float(found[1]) == pytest.approx(np.exp(-0.25 * scene.period), rel=1e-3)


def test_motion_that_is_lost_is_told_with_its_amplitudes() -> None:
    """An adaptive run has no curve to follow."""
    model, scene, motion = short_run("time.periods=4")
    changed = replace(scene, time=replace(scene.time, stepping=None))
    lost = growing(motion, 5.0)
    told = why_unsteady(model, changed, lost, lost)
    found = re.search(r"found no periodic motion; over the last (\d) periods .* (\S+) mm$", told)
    assert found is not None and int(found[1]) == lost.periods
    assert float(found[2]) == pytest.approx(1e3 * np.linalg.norm(amplitude(lost)), rel=1e-3)
