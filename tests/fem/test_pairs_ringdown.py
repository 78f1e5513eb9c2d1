"""Ring-downs of bodies that touch."""

from __future__ import annotations

import numpy as np
import pytest
from support import refusal
from test_pairs import COARSE, STEEL, lap, solid

import fenicsrom as fr
from fenicsrom.assess.studies import ringdown as module
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.scene import Scene, Time

PERIODS = 3


def shaken(masters: str) -> Scene:
    """The lap joint, of which a load that lifts the tip is let go."""
    return lap(
        geometrically_nonlinear=False,
        geometry=COARSE,
        material=STEEL | {"mass_damping": 2.0},
        loads=[{"group": "tip", "direction": [0, 1], "force": 30.0, "frequency": 30.0}],
        probe={"group": "tip"},
        basis={"masters": masters},
        time={"periods": 1, "steps_per_period": 100},
        ringdown={"periods": PERIODS + 1},
    )


@pytest.mark.slow
def test_ring_down_of_a_joint_loses_what_the_full_model_loses() -> None:
    scene = shaken("all")
    found = module.ringdown(fr.build_model(scene))
    assert found.unfinished is None
    body = solid(scene)
    squares, shapes = body.eigenmodes(body.factor, 1)
    length = 2.0 * np.pi / np.sqrt(squares[0])
    step = module.JOINT_LONG * length
    grown = module.JOINT_RAMP * step
    slow = {"scheme": "generalised-alpha", "spectral_radius": 0.0, "step": step}
    until = Time.of(**slow, duration=grown + module.JOINT_REST * step)
    held = module._loaded(scene, until, (0.0, 0.0), (grown, 1.0))
    q, v, sliders = end_of(simulate(full_model(solid(held)), held))
    time = Time.of(duration=(PERIODS + 1) * length, step=length / 100)
    free = module._loaded(scene, time, (0.0, 0.0), (1.0, 0.0))
    start = q, 0.0 * v, sliders
    motion = simulate(full_model(solid(free)), free, start=start, keep_coordinates=True)
    unit = np.abs(body.probe_rows @ shapes[:, 0]).max()
    moved = unit * (motion.coordinates @ body.mass_times(shapes)[:, 0])
    assert abs(found.curve[1, 0]) == pytest.approx(abs(moved[0]), rel=1e-4)
    expected = module.periods_of(motion, moved)[:PERIODS]
    for one, other in zip(found.periods[:PERIODS], expected, strict=True):
        assert one.frequency == pytest.approx(other.frequency, rel=3e-4)
        assert one.damping_ratio == pytest.approx(other.damping_ratio, abs=1e-4)
    spent, whole = (
        sum(one.friction_dissipation for one in each[:PERIODS])
        for each in (found.periods, expected)
    )
    assert spent == pytest.approx(whole, rel=3e-2)


def test_ring_down_does_not_take_vectors_of_another_motion() -> None:
    with refusal(ErrorKind.CONFLICT, "basis.masters", names="is another one"):
        fr.ringdown(shaken("motion"))
