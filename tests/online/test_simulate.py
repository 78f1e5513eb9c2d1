"""What `simulate` refuses before the first step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, refusal, touching, uncoupled

from fenicsrom.errors import ErrorKind
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.run.march import Instant
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.scene import Scene


def round_wall(radius: float, preload: float, *overrides: str, **more: Any) -> Scene:
    """The tip of a beam of 2.54 m in a casing about the origin; the steps end at once."""
    surface = {"kind": "cylinder", "point": [0.0, 0.0], "radius": radius, **more}
    contact = touching(surface=surface, preload=preload)
    short = ("time.periods=1", "geometrically_nonlinear=false", *overrides)
    return beam_scene(2, short, contacts=[contact], probe=None)


def test_preload_needs_a_surface_that_touches_and_a_period_waves_that_repeat() -> None:
    points = ContactPoints(
        np.zeros(1, dtype=np.int64), np.ones(1), np.array([[2.54, 0.0]]), np.eye(2)[None]
    )
    touching, apart, unpressed = round_wall(2.54, 40.0), round_wall(2.55, 40.0), round_wall(2.55, 0)
    model = linear_model(
        np.eye(2),
        1e5 * np.eye(2),
        damping=touching.material.mass_damping,
        loads=[[0.0], [1.0]],
        load_histories=load_histories(touching),
        masters=2,
    )._replace(points=points)
    for scene in (touching, unpressed):
        assert simulate(model, scene, compiled=False).periods == 1
    with refusal(ErrorKind.CONFLICT, "contacts[0].surface.radius", names="0.01 m"):
        simulate(model, apart, compiled=False)
    turning: dict[str, Any] = {"waves": [[2, 1e-6, 0.0]], "spin": 1.0}
    with refusal(ErrorKind.RANGE, "contacts[0].surface.waves"):
        simulate(model, round_wall(2.55, 0.0, **turning), compiled=False)
    unsought = round_wall(2.55, 0.0, "time.steady_tolerance=0", **turning)
    assert simulate(model, unsought, compiled=False).periods == 1


def test_static_loads_without_duration_are_refused() -> None:
    static = {"group": "load", "direction": [0.0, 1.0], "force": 1.0}
    scene = beam_scene(2, contacts=None, probe={"group": "tip"}, loads=[static], time={})
    model = linear_model(
        np.eye(2),
        1e5 * np.eye(2),
        damping=scene.material.mass_damping,
        loads=[[0.0], [1.0]],
        load_histories=load_histories(scene),
    )
    with refusal(ErrorKind.MISSING, "time.duration"):
        simulate(model, scene, compiled=False)


@pytest.mark.parametrize("compiled", [True, False])
def test_look_sees_each_step_and_changes_nothing(compiled: bool) -> None:
    scene = beam_scene(
        2,
        ("time.periods=3", "time.steps_per_period=20", "geometrically_nonlinear=false"),
        contacts=None,
        probe={"group": "tip"},
    )
    model, seen = uncoupled(scene, 500.0, 900.0), list[Instant]()
    plain = simulate(model, scene, keep_coordinates=True, compiled=compiled)
    motion = simulate(model, scene, keep_coordinates=True, compiled=compiled, look=seen.append)
    np.testing.assert_array_equal(motion.displacement, plain.displacement)
    np.testing.assert_array_equal([each.time for each in seen], motion.time[1:])
    np.testing.assert_array_equal([each.probe for each in seen], motion.displacement[1:, 0])
    assert motion.coordinates is not None and motion.velocity is not None
    np.testing.assert_array_equal(seen[-1].coordinates, motion.coordinates[-1])
    np.testing.assert_array_equal(seen[-1].velocity, motion.velocity[-1])
