"""Why a motion does not repeat: what became of its periodic motion.

Newton's method may find no periodic motion from the states that a march reaches. The motion of the
heavily damped body is easy to find. It is followed here while the damping falls to that of the
scene, and its Floquet multipliers there tell whether a motion can end in it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.assess.response import response
from fenicsrom.errors import ConvergenceError, SceneError
from fenicsrom.online.archive import StoredModel
from fenicsrom.online.curve import CurvePoint
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.scene import Response, Scene

PARAMETER = "material.mass_damping"
HEAVY = (
    0.3  # the first damping ratio at the frequency of the loads, or this times that of the scene
)
FACTOR = 10.0
POINTS = 400


def why_unsteady(model: Any, scene: Scene, motion: Motion) -> str:
    """Say what a motion that does not repeat does instead, and why.

    Args:
        model: the model that was integrated.
        scene: its scene.
        motion: the motion.
    """
    begin = f"the motion does not repeat after {motion.periods} periods"
    search = motion.search
    if search is not None and search.verdict != "not found":
        size = f"largest multiplier {abs(search.multipliers[0]):.4g}"
        if search.verdict == "stable":
            return f"{begin}; a stable periodic motion exists ({size}), but it is not reached"
        return f"{begin}; the periodic motion is unstable ({search.verdict}, {size})"
    if search is None or not isinstance(model, ReducedModel) or not scene.time.steps_per_period:
        return f"{begin}; Newton's method found no periodic motion"
    return f"{begin}; {_from_heavy_damping(model, scene)}"


def _from_heavy_damping(model: ReducedModel, scene: Scene) -> str:
    """Follow the periodic motion from a heavy damping to that of the scene, and say how it ends."""
    damping, period = scene.material.mass_damping, scene.period
    assert period is not None
    heavy = max(2.0 * HEAVY * 2.0 * np.pi / period, FACTOR * damping)
    table = Response(parameter=PARAMETER, first=damping, last=heavy, points=POINTS)
    stored = StoredModel(
        model, replace(scene, response=table), scene.basis.method, (), 0, np.zeros(0), {}
    )
    try:
        curves = response(stored, lambda line: None).curves
    except (ConvergenceError, SceneError):
        curves = []
    points: list[CurvePoint] = [point for curve in curves for point in curve.points]
    if not points:
        return "no periodic motion was found, with heavy damping neither"
    last = min(points, key=lambda point: point.parameter)
    size = f"largest multiplier {abs(last.judged[0]):.4g}"
    if last.parameter > damping * (1.0 + 1e-9) + 1e-9 * heavy:
        return (
            f"its periodic motion was followed down to a damping of {last.parameter:.4g} 1/s only"
        )
    if last.stable:
        return f"a stable periodic motion exists ({size}), but it is not reached"
    return f"the periodic motion is unstable ({last.verdict}, {size})"
