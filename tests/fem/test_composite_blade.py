"""The demo of the composite blade on a small mesh: fibres, damping, follower pressures, rub."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from support import make_solid, scene_of

from fenicsrom.fem.full.full import FullModel
from fenicsrom.online.motion.measures import amplitude, peak_normal_force
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import read_scene

DEMO = Path(__file__).parents[2] / "demos" / "blade_composite.toml"
SMALL = """
    geometry.parameters.elements_along=4 geometry.parameters.elements_across=2
    time.steps_per_period=60 time.periods=1 time.steady_tolerance=0.0
""".split()


@pytest.mark.slow
def test_reduced_composite_blade_matches_the_full_one() -> None:
    solid = make_solid(read_scene(DEMO, SMALL))
    scene = scene_of(solid)
    assert not solid.material.is_isotropic and solid.viscous.acts and not solid.symmetric
    model = Reduction(solid, scene, lambda stage: contextlib.nullcontext()).model
    np.testing.assert_array_equal(model.pressure.numbers, [0, 1])
    motion, full = simulate(model, scene), simulate(FullModel(solid), scene)
    touching = np.any(full.force[:, :, 0] > 0.0, axis=1)
    assert 0.1 < touching.mean() < 0.95
    ours, theirs = amplitude(motion), amplitude(full)
    assert np.linalg.norm(ours - theirs) < 0.01 * np.linalg.norm(theirs)
    assert peak_normal_force(motion) == pytest.approx(peak_normal_force(full), rel=0.03)
    assert motion.relative_imbalance < 1e-9 and full.relative_imbalance < 1e-9
    work = np.abs(full.work).max()
    np.testing.assert_allclose(motion.work, full.work, rtol=0, atol=0.02 * work)
