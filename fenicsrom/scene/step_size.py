"""The three ways to set the time step of a scene, stated once.

The [time] table sets the step by one of `tolerance`, `steps_per_period` or `step`: each excludes
the others. With a tolerance the local error of a second-order scheme falls with the third power of
the step, so half the step is an eighth of the tolerance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from fenicsrom.scene import Scene, parse_scene, scene_table

STEP_KEYS = ("tolerance", "steps_per_period", "step")


def step_key(scene: Scene) -> str:
    """The key of [time] that sets the step of a scene."""
    return next(name for name in STEP_KEYS if getattr(scene.time, name) is not None)


def without_replaced_step(time: Mapping[str, Any], given: Iterable[str]) -> dict[str, Any]:
    """Remove from a [time] table the step that a newly given key replaces.

    Args:
        time: the [time] table.
        given: the keys of [time] that are going to be set.

    Returns:
        The table without the other two ways to set the step, if `given` names one of the three.
    """
    named = set(given) & set(STEP_KEYS)
    return {key: time[key] for key in time if not named or key not in STEP_KEYS or key in named}


def with_time(scene: Scene, **changes: Any) -> Scene:
    """The scene with other values of [time]; a new step replaces the old one.

    Args:
        scene: the scene.
        changes: values by key. A new scheme resets `spectral_radius` to its default.

    Raises:
        SceneError: a value is not allowed.
    """
    table = scene_table(scene)
    time = without_replaced_step(table["time"], changes)
    if changes.get("scheme", scene.time.scheme) != scene.time.scheme:
        time.pop("spectral_radius", None)
    table["time"] = time | changes
    return parse_scene(table, scene.source, None)


def refined(scene: Scene, factor: int = 2) -> Scene:
    """The scene with its step divided by a factor (its tolerance by the factor cubed)."""
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=time.tolerance / factor**3))
    if time.steps_per_period is not None:
        return replace(scene, time=replace(time, steps_per_period=time.steps_per_period * factor))
    assert time.step is not None
    return replace(scene, time=replace(time, step=time.step / factor))


def coarser(scene: Scene) -> Scene:
    """The scene with twice its step, or eight times its tolerance.

    The result may be coarser than the scene format allows. The step stays within the duration.
    """
    time = scene.time
    if time.tolerance is not None:
        return replace(scene, time=replace(time, tolerance=8.0 * time.tolerance))
    if time.steps_per_period is not None:
        steps = max(time.steps_per_period // 2, 2)
        return replace(scene, time=replace(time, steps_per_period=steps))
    assert time.step is not None
    assert time.duration is not None
    return replace(scene, time=replace(time, step=min(2.0 * time.step, time.duration)))
