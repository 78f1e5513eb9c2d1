"""Whether a fixed step resolves what excites a scene (`fenicsrom.scene.keys.excitation`)."""

from __future__ import annotations

import math

from fenicsrom.scene.base.rules import Problem, Problems
from fenicsrom.scene.keys.excitation import excitations
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.keys.times import FixedStep, StepsPerPeriod, StepsPerRevolution

STEPS = 10
"""Fewest fixed steps in the shortest period of an excitation."""

ROUNDING = 1e-5
"""The longest step is printed with six digits, and a step with the printed value is accepted."""


def step_problems(scene: Scene) -> Problems:
    """Yield the step of a completed scene if an excitation is too fast for it."""
    fastest = min(excitations(scene), key=lambda found: found.period, default=None)
    if fastest is None or math.isinf(fastest.period):
        return
    key, period = fastest
    shortest = f"the shortest period of {key}, {period:.6g} s"
    if key.endswith(".table"):
        shortest += (
            " (twice its shortest swing; if this is noise, smooth the table, or take a step of "
        )
        shortest += "which all its times are multiples)"
    match scene.time.stepping:
        case FixedStep(step=step) if step > (1.0 + ROUNDING) * period / STEPS:
            allowed = f"must be at most {period / STEPS:.6g}, so that {STEPS} steps resolve"
            yield Problem("time.step", f"{allowed} {shortest}")
        case StepsPerRevolution(steps_per_revolution=steps):
            assert scene.rotation is not None
            slowest = min(speed for _, speed in scene.rotation.history)
            needed = math.ceil((1.0 - ROUNDING) * STEPS * 60.0 / slowest / period)
            if steps < needed:
                allowed = f"must be at least {needed}, so that {STEPS} steps resolve {shortest}"
                yield Problem("time.steps_per_revolution", allowed)
        case StepsPerPeriod(steps_per_period=steps) if scene.period is not None:
            needed = math.ceil((1.0 - ROUNDING) * STEPS * scene.period / period)
            if steps < needed:
                allowed = f"must be at least {needed}, so that {STEPS} steps resolve {shortest}"
                yield Problem("time.steps_per_period", allowed)
