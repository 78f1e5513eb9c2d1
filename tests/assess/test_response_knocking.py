"""The response curve of a beam that knocks on a stop."""

from __future__ import annotations

import numpy as np
import pytest
from support import beam_scene

pytest.importorskip("dolfinx")

from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.response_problem import family_of, start_motion
from fenicsrom.notes import STABILITY
from fenicsrom.online.curves.continuation import follow
from fenicsrom.online.curves.curve import BIFURCATIONS, UNSURE
from fenicsrom.online.periodic.shooting import Shooting, periodic_motion
from fenicsrom.study import build_model


@pytest.mark.slow
@pytest.mark.long
def test_period_doubles_where_a_march_does_without_other_bifurcations() -> None:
    sizes = {"length": 0.35, "height": 0.008, "elements_along": 14}
    load = {"nearest": [0.3, 0.0], "direction": [0.0, 1.0], "force": 4.0, "frequency": 70.0}
    stop = {"nearest": [0.35, -0.004], "normal": [0.0, -1.0], "gap": 4e-4, "friction": 0.15}
    stored = build_model(
        beam_scene(
            2,
            (
                "geometry.thickness=0.015",
                'geometry.cells="structured"',
                *(f"geometry.parameters.{name}={size}" for name, size in sizes.items()),
            ),
            material={"young": 7.1e10, "poisson": 0.33, "density": 2750.0, "mass_damping": 12.0},
            damping={"stiffness": 4e-6},
            loads=[load],
            contacts=[stop | {"normal_stiffness": 2e5, "tangential_stiffness": 1e5}],
            basis={"modes": 4},
            time={"steps_per_period": 300},
            response={"first": 48.3, "last": 48.7},
        )
    )
    family = family_of(stored)
    curve = follow(family, start_motion(stored, family, 48.3), 48.3, (48.3, 48.7))
    (doubling,) = [point for point in curve.special if point.kind in BIFURCATIONS]
    assert doubling.kind == "period doubling"
    for share, doubled in ((-5e-4, False), (5e-4, True)):
        shooting = Shooting(family((1.0 + share) * doubling.parameter))
        s, change = 1.001 * shooting.scaled(doubling.z), np.zeros((2, doubling.z.size))
        for _ in range(1500):
            found = shooting.march(s, derive=False)
            assert found is not None
            s, change = s + found[0], np.array([change[-1], found[0]])
        one, two = (np.linalg.norm(way) / np.linalg.norm(s) for way in (change[1], sum(change)))
        assert (one > 1e-2) == doubled and two < 1e-8
    # half the time step finds all these motions stable: the doubling is not said to be found
    found = response(stored)
    (judged,) = found.curves
    assert not [point for point in judged.special if point.kind in BIFURCATIONS]
    assert all(point.known_stability in ("stable", UNSURE) for point in judged.points)
    assert all(point.denied == "stable" for point in judged.points if not point.stable)
    assert judged.points[-1].denied and found.unfinished is None
    assert STABILITY in [note.quantity for note in found.warnings]


@pytest.mark.slow
def test_torus_that_moves_with_the_step_is_not_listed() -> None:
    """With 400 steps at 3.4877 and 3.5001 Hz, with 1600 between 3.501 and 3.52 Hz."""
    sizes = {"length": 2.54, "height": 0.0254, "elements_along": 10, "elements_through": 1}
    stop = {"group": "tip", "at": "centre", "normal": [0.0, 1.0], "gap": 0.01, "friction": 0.0}
    load = {"group": "load", "at": "centre", "direction": [0.0, 1.0], "force": 5.0}
    stored = build_model(
        beam_scene(
            2,
            tuple(f"geometry.parameters.{name}={size}" for name, size in sizes.items()),
            material={"young": 207e9, "poisson": 0.28, "density": 7801.0, "mass_damping": 1.0},
            loads=[load | {"frequency": 3.2}],
            contacts=[stop | {"normal_stiffness": 2e4, "tangential_stiffness": 1e3}],
            time={"steps_per_period": 400},
            response={"first": 3.48, "last": 3.525},
        )
    )
    (curve,) = response(stored).curves
    assert not [point for point in curve.special if point.kind in BIFURCATIONS]
    unsure = [point.parameter for point in curve.points if point.denied]
    assert len(unsure) > 2 and 3.485 < min(unsure) < 3.495 and 3.51 < max(unsure) < 3.525
    near = min(curve.points, key=lambda point: abs(point.parameter - 3.49))
    problem = family_of(stored)(3.49)
    fine = problem._replace(time=problem.time.changed(steps_per_period=1600))
    motion = periodic_motion(fine, near.z)
    assert motion.stable and motion.amplitude.max() == pytest.approx(12.826e-3, rel=1e-3)
