"""Longer and shorter time steps of a scene.

The local error of a second-order scheme falls with the third power of the step. With an adaptive
step, half the step therefore means an eighth of the tolerance. The steps of this module may be
longer or shorter than a scene file allows.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from fenicsrom.scene.keys import times
from fenicsrom.scene.keys.schema import Scene
from fenicsrom.scene.reading.overrides import override_table
from fenicsrom.scene.reading.reading import parse_scene, scene_table


def step_key(scene: Scene) -> str:
    """The key of [time] that sets the step of a scene."""
    return fields(scene.time.stepping)[0].name


def with_time(scene: Scene, **changes: Any) -> Scene:
    """The scene with other values of [time]; a new step replaces the old one.

    Args:
        scene: the scene.
        changes: values by key. A new scheme resets `spectral_radius` to its default.

    Raises:
        SceneError: a value is not allowed.
    """
    table = scene_table(scene)
    if changes.get("scheme", scene.time.scheme) != scene.time.scheme:
        table["time"].pop("spectral_radius", None)
    overrides = [f"time.{key}={value!r}" for key, value in changes.items()]
    return parse_scene(override_table(table, overrides, scene.source), scene.source, None)


def refined(scene: Scene, factor: float = 2) -> Scene:
    """The scene with its step divided by a factor (its tolerance by the factor cubed).

    With a factor below 1 the step is longer; no step exceeds the duration, and a period has at
    least two.
    """
    stepping: times.Stepping
    match scene.time.stepping:
        case times.Tolerance(tolerance=tolerance):
            stepping = times.Tolerance(tolerance=tolerance / factor**3)
        case times.StepsPerPeriod(steps_per_period=steps):
            stepping = times.StepsPerPeriod(steps_per_period=max(int(steps * factor), 2))
        case times.StepsPerRevolution(steps_per_revolution=steps):
            stepping = times.StepsPerRevolution(steps_per_revolution=max(int(steps * factor), 2))
        case times.FixedStep(step=step):
            assert scene.time.duration is not None
            stepping = times.FixedStep(step=min(step / factor, scene.time.duration))
        case other:
            stepping = other
    return replace(scene, time=replace(scene.time, stepping=stepping))


def coarser(scene: Scene) -> Scene:
    """The scene with twice its step or eight times its tolerance, as `refined` by a half."""
    return refined(scene, 0.5)
