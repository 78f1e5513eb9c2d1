"""Why a motion does not repeat, from the search for a periodic motion nearby.

Newton's method may find no periodic motion from the states that a march reaches. Two other ways
lead to one. The first starts at the motion of generalised-alpha, which settles more often because
this scheme damps the waves that the step does not resolve. The second follows the motion of the
heavily damped body while its damping falls to that of the scene. The Floquet multipliers of the
motion that is found tell whether a run can end in it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from fenicsrom.assess.curves.response import response
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.motion.measures import has_settled, period_amplitudes
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import PeriodicMotion, largest_multiplier, periodic_motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import Response, Scene
from fenicsrom.scene.keys.times import GENERALISED_ALPHA
from fenicsrom.scene.reading.reading import with_time
from fenicsrom.words import counted

PARAMETER = "material.mass_damping"
HEAVY = (
    0.3  # the first damping ratio at the frequency of the loads, or this times that of the scene
)
FACTOR = 10.0
POINTS = 400
RECORDED = 20  # periods whose amplitudes are told where no periodic motion was found


def why_unsteady(model: Any, scene: Scene, motion: Motion, fine: Motion) -> str:
    """Say what a motion that does not repeat does instead, and why.

    Args:
        model: the model that was integrated.
        scene: its scene.
        motion: the motion.
        fine: the motion with an eighth of the step.
    """
    told = [
        f"the motion does not repeat after {counted(motion.periods, 'period')}",
        *_found(model, scene, motion),
    ]
    if has_settled(fine):
        told.append("with an eighth of the step it settles")
    return "; ".join(told)


def _found(model: Any, scene: Scene, motion: Motion) -> list[str]:
    """Clauses about the periodic motion, or about the record if there is none."""
    search = motion.search
    if search is not None and search.verdict != "not found":
        return [_judgement(search.verdict, abs(search.multipliers[0]))]
    if search is None or not isinstance(model, ReducedModel) or not scene.time.steps_per_period:
        return ["Newton's method found no periodic motion", _record(motion)]
    near = _near_generalised_alpha(model, scene)
    if near is not None:
        return [
            _judgement(near.verdict, abs(largest_multiplier(near.multipliers, near.free_sliders)))
        ]
    followed, point = _from_heavy_damping(model, scene)
    if point is not None:
        return [_judgement(point.verdict, abs(point.judged[0]))]
    return [followed, _record(motion)]


def _judgement(verdict: str, multiplier: float) -> str:
    """The clause about a periodic motion with the given verdict and largest multiplier."""
    size = f"largest multiplier {multiplier:.5g}"
    if verdict == "stable":
        return f"a stable periodic motion exists ({size}), but it is not reached"
    return f"the periodic motion is unstable ({verdict}, {size})"


def _record(motion: Motion) -> str:
    """The clause about the amplitudes of the last periods."""
    sizes = [1e3 * float(np.linalg.norm(a)) for a in period_amplitudes(motion, RECORDED)]
    return (
        f"over the last {len(sizes)} periods the amplitude lies between {min(sizes):.4g} and "
        f"{max(sizes):.4g} mm"
    )


def _near_generalised_alpha(model: ReducedModel, scene: Scene) -> PeriodicMotion | None:
    """The periodic motion near that of generalised-alpha, or None."""
    if scene.time.scheme == GENERALISED_ALPHA:
        return None
    assert scene.period is not None
    try:
        start = simulate(model, with_time(scene, scheme=GENERALISED_ALPHA))
        if not start.steady or start.period is None:
            return None
        m = round(start.period / scene.period)
        return periodic_motion(Problem.of(model, scene), start.end, m)
    except (ConvergenceError, AccuracyError):
        return None


def _from_heavy_damping(model: ReducedModel, scene: Scene) -> tuple[str, CurvePoint | None]:
    """Follow the periodic motion from a heavy damping to that of the scene.

    Returns:
        How this ended, and the motion at the damping of the scene, if it was reached.
    """
    damping, period = scene.material.mass_damping, scene.period
    assert period is not None
    heavy = max(2.0 * HEAVY * 2.0 * np.pi / period, FACTOR * damping)
    table = Response(parameter=PARAMETER, first=heavy, last=damping, points=POINTS)
    stored = StoredModel(
        model, replace(scene, response=table), scene.basis.method, (), 0, np.zeros(0), {}
    )
    try:
        curves = response(stored).curves
    except (ConvergenceError, SceneError):
        curves = []
    points: list[CurvePoint] = [point for curve in curves for point in curve.points]
    if not points:
        return "no periodic motion was found, with heavy damping neither", None
    last = min(points, key=lambda point: point.parameter)
    told = f"its periodic motion was followed down to a damping of {last.parameter:.4g} 1/s only"
    reached = last.parameter <= damping * (1.0 + 1e-9) + 1e-9 * heavy
    return told, last if reached else None
