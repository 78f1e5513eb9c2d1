"""Random variants of a scene, from a seed: other loads, contacts, damping, bases and spans of time.

The ranges are relative to the scene and to the scales of its reduced model, like the axes of the
stability matrix (`assess.studies.axes`). They reach beyond what a basis of few modes holds:
frequencies far above the kept modes, axial loads, bases without derivatives, impacts and sweeps. A
variant may therefore be refused, but its result must not be silently wrong.
"""

import math
from typing import Any

import numpy as np

from fenicsrom.assess.studies.axes import SCHEMES, Case, Scales
from fenicsrom.scene import Scene, scene_table
from fenicsrom.scene.base.tables import toml_value
from fenicsrom.scene.keys.loads import ACTIONS

AXIS = "random"
KINDS = ("periodic", "transient", "sweep", "impact")  # a transient ends before it settles
SHARES = (0.5, 0.15, 0.15, 0.2)  # of these kinds
FREQUENCY = (0.2, 12.0)  # times the first natural frequency
LOAD = (0.1, 3.0)  # times the load of the scene, and more at high frequencies
RATIO = (0.03, 0.3)  # damping ratio at the frequency of the load
STIFFNESS = (0.1, 10.0)  # times the stiffness of the contacts of the scene
PRELOAD = (0.0, 1.5)  # times their preload
LARGEST_FRICTION = 1.0
THRESHOLD = (1e-5, 1e-2)  # of the selection of derivatives
MOST_MODES = 4
OPEN_SHARE, LINEAR_SHARE, AXIAL_SHARE = 0.3, 0.1, 0.1
PERIODS = 40  # most periods of a periodic variant
SPAN = 8  # periods of the load in the other variants


def random_cases(scene: Scene, scales: Scales, count: int, seed: int) -> list[Case]:
    """Random variants of a scene; variant k of a seed is the same whatever their number.

    Args:
        scene: the scene; its loads become loads at the place of its first load that varies.
        scales: its scales.
        count: number of variants.
        seed: seed of the random numbers.
    """
    return [_variant(scene, scales, seed, k) for k in range(count)]


def _variant(scene: Scene, scales: Scales, seed: int, number: int) -> Case:
    """One variant."""
    rng = np.random.default_rng((seed, number))
    kind = str(rng.choice(KINDS, p=SHARES))
    ratio = _between(rng, FREQUENCY)
    frequency = ratio * scales.omega / (2.0 * math.pi)
    damping = 2.0 * _between(rng, RATIO) * max(ratio, 1.0) * scales.omega
    table = scene_table(scene)
    load = next(
        entry for entry, made in zip(table["loads"], scene.loads, strict=True) if not made.static
    )
    factor = _between(rng, LOAD) * max(ratio, 1.0)
    load = _random_load(rng, load, factor, kind, frequency, scene.geometry.dimension)
    changes: dict[str, Any] = {
        "loads": [load],
        "time": _time(rng, scene, kind, frequency),
        "material.mass_damping": damping,
        "basis": _basis(rng, table["basis"]),
    }
    if rng.random() < LINEAR_SHARE:
        changes["geometrically_nonlinear"] = False
    if scene.contacts:
        is_open = bool(rng.random() < OPEN_SHARE)
        changes["contacts"] = [] if is_open else [_contact(rng, c) for c in table["contacts"]]
        if is_open:
            changes["basis"].pop("masters", None)
    overrides = tuple(f"{key}={toml_value(value)}" for key, value in changes.items())
    return Case(AXIS, f"seed {seed}, number {number}: {kind}", overrides, full=True)


def _between(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """A number between two ends, uniform in its logarithm."""
    return float(np.exp(rng.uniform(math.log(ends[0]), math.log(ends[1]))))


def _random_load(
    rng: np.random.Generator,
    load: dict[str, Any],
    factor: float,
    kind: str,
    frequency: float,
    dimension: int,
) -> dict[str, Any]:
    """The load of a variant: its size, direction and history."""
    sizes = tuple(ACTIONS.tags)
    kept = ("group", "at", "near", "point", "direction", *sizes)
    made = {key: value for key, value in load.items() if key in kept}
    for key in sizes:
        if key in made:
            made[key] *= factor
    if "direction" in made:
        across = rng.standard_normal(dimension - 1)
        tilt = math.pi / 2.0 if rng.random() < AXIAL_SHARE else 0.3 * rng.standard_normal()
        around = math.cos(tilt) * across / np.linalg.norm(across)
        made["direction"] = [float(x) for x in (math.sin(tilt), *around)]
    if kind == "impact":
        made["pulse"] = {"duration": 0.5 / frequency}
        return made
    made["frequency"] = frequency
    if kind == "sweep":
        to = frequency * float(rng.choice((0.4, 2.5)))
        made["sweep"] = {"to": to, "duration": SPAN / frequency}
    return made


def _time(rng: np.random.Generator, scene: Scene, kind: str, frequency: float) -> dict[str, Any]:
    """The time integration of a variant, with the number of steps per period of the scene."""
    steps = scene.time.steps_per_period or 200
    made: dict[str, Any] = {"scheme": str(rng.choice(SCHEMES))}
    if kind == "periodic":
        return made | {"periods": PERIODS, "steps_per_period": steps}
    if kind == "transient":
        return made | {"periods": SPAN, "steps_per_period": steps, "steady": "march"}
    highest = 2.5 * frequency if kind == "sweep" else frequency
    return made | {"duration": SPAN / frequency, "step": 1.0 / (highest * steps)}


def _basis(rng: np.random.Generator, basis: dict[str, Any]) -> dict[str, Any]:
    """The basis of a variant."""
    kinds = ("mmi-nls", "all", "none")
    return basis | {
        "method": str(rng.choice(("rubin", "craig-bampton"))),
        "modes": int(rng.integers(1, MOST_MODES + 1)),
        "derivatives": str(rng.choice(kinds, p=(0.7, 0.15, 0.15))),
        "threshold": _between(rng, THRESHOLD),
    }


def _contact(rng: np.random.Generator, contact: dict[str, Any]) -> dict[str, Any]:
    """A contact of a variant."""
    made = dict(contact)
    made["friction"] = float(rng.uniform(0.0, LARGEST_FRICTION))
    for key in ("normal_stiffness", "tangential_stiffness"):
        made[key] *= _between(rng, STIFFNESS)
    if "preload" in made:
        made["preload"] *= float(rng.uniform(*PRELOAD))
    return made
