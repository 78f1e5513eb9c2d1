"""Response curves of a symmetric body, whose basis lacks the modes that break the symmetry."""

from __future__ import annotations

import pytest
from support import beam_scene

pytest.importorskip("dolfinx")

from fenicsrom.study import build_model
from fenicsrom.study.curves import response


@pytest.mark.slow
def test_clamped_beam_under_pressure_warns_of_motions_that_lose_their_symmetry() -> None:
    """The second mode is antisymmetric. It is left out, and grows above 49.3 Hz."""
    sizes = {"length": 2.54, "height": 0.0254, "elements_along": 8, "elements_through": 1}
    scene = beam_scene(
        2,
        tuple(f"geometry.parameters.{name}={size}" for name, size in sizes.items()),
        supports=[{"group": "root"}, {"group": "tip"}],
        contacts=None,
        loads=[
            {
                "box": [[0.0, 0.0127], [2.54, 0.0127]],
                "pressure": 1e5,
                "follower": True,
                "frequency": 20.0,
            }
        ],
        material={"young": 207e9, "poisson": 0.28, "density": 7801.0, "mass_damping": 1.0},
        probe={"group": "load", "at": "centre"},
        basis={"accuracy": 1.0},
        time={"steps_per_period": 60},
        response={"parameter": "frequency", "first": 30.0, "last": 55.0},
    )
    stored = build_model(scene)
    found = response(stored.resized([name for name in stored.labels if name != "2V"]))
    wrong = {check.point.parameter for check in found.curves[0].checks if check.contradicted}
    assert len(wrong) >= 3
    assert sum("a richer basis finds another stability" in said for said in found.warnings) == 1
    for check in found.curves[0].checks:
        f = check.point.parameter
        assert check.point.verdict == "stable" and check.compared
        if f > 50.0:
            assert check.richer_verdict == "fold" and f in wrong
        elif f < 41.0:
            assert f not in wrong
