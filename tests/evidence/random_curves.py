"""Response curves of random scenes: how many are complete, and whether their points are right.

    python3 tests/evidence/random_curves.py [--count 40] [--seed 1] [--output FOLDER]

Each scene is a beam, planar or spatial, linear or not, with one to ten contact points at random
places, in random directions, with random preloads or gaps, stiffnesses and friction, and one or two
loads. The parameter of its curve is the frequency over the lowest resonance, the size of the first
load, a preload or a friction coefficient. Every tenth point is confirmed by half the time step,
which must move the curve by less than `CHANGE`; the middle one of the stable ones also by a march
of up to 500 periods that starts 0.1 % beside it and must come nearer. A curve ends at the latest
after `SECONDS` of CPU time. Its special points, which change no point, are not located. It is one
line of the table, and one file of the folder. A curve whose file is there is not computed again, so
the table may be made in several runs.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time as clock
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.curves.results import response_table
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import COMPLETE, Curve, CurvePoint, norm
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting, periodic_motion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.scene import parse_scene
from fenicsrom.study import build_model

PARAMETERS = ("frequency", "loads.0.force", "contacts.0.preload", "contacts.0.friction")
MESHES = Path(__file__).parents[2] / "meshes"
POINTS = 1000  # largest number of points of a curve
SECONDS = 120.0  # largest CPU time of a curve, without its confirmation
PERIODS = 500  # largest number of periods of a march that confirms a point
BESIDE, NEAR = 1e-3, 1e-5  # distances from a motion, relative to it, at the start and at the end
CHANGE = 0.1  # of an amplitude by half the time step, as a run accepts it


def random_scene(seed: int) -> dict[str, Any]:
    """The table of a scene."""
    rng = np.random.default_rng(seed)
    d = int(rng.choice([2, 3]))
    length, height = 0.5, 0.01
    free = 0.1615 * np.sqrt(2.1e11 / 7850.0) * height / length**2  # Hz, of the cantilever
    parameter = PARAMETERS[int(rng.integers(4))]
    table: dict[str, Any] = {
        "title": f"random curve {seed}",
        "geometrically_nonlinear": bool(rng.random() < 0.5),
        "geometry": {
            "mesh": f"beam{d}d.geo",
            "dimension": d,
            "cells": "structured",
            "parameters": {"length": length, "height": height, "elements_along": 10},
        },
        "material": {
            "young": 2.1e11,
            "poisson": 0.3,
            "density": 7850.0,
            "mass_damping": float(10.0 ** rng.uniform(0.0, 1.3)),
        },
        "supports": [{"group": "root"}],
        "basis": {"modes": 3},
        "time": {"steps_per_period": 200},
        "contacts": [_contact(rng, d, length, height) for _ in range(int(rng.integers(1, 11)))],
    }
    if d == 2:
        table["geometry"]["thickness"] = 0.02
    else:
        table["geometry"]["parameters"]["width"] = 0.02
    table["contacts"][0] |= {"preload": 20.0, "friction": 0.3}
    table["contacts"][0].pop("gap", None)
    frequency = free * float(rng.uniform(0.8, 2.5))
    size = float(10.0 ** rng.uniform(-0.5, 1.2))
    across = [0.0, 1.0, 0.3][:d]
    table["loads"] = [
        {
            "nearest": [length, *[0.0] * (d - 1)],
            "direction": across,
            "force": size,
            "frequency": frequency,
        }
    ]
    if rng.random() < 0.4:
        second = {"nearest": [0.6 * length, *[0.0] * (d - 1)], "direction": [1.0, 0.5, 0.0][:d]}
        table["loads"].append(second | {"force": 0.5 * size, "frequency": frequency, "phase": 1.0})
    ranges = {
        "frequency": (0.7 * free, 2.6 * free),
        "loads.0.force": (0.1 * size, 5.0 * size),
        "contacts.0.preload": (1.0, 60.0),
        "contacts.0.friction": (0.02, 1.0),
    }
    first, last = ranges[parameter][:: int(rng.choice([1, -1]))]
    table["response"] = {"parameter": parameter, "first": first, "last": last}
    return table


def _contact(rng: np.random.Generator, d: int, length: float, height: float) -> dict[str, Any]:
    """A contact point at the upper or the lower side, or at a side of a spatial beam."""
    axis, side = int(rng.integers(1, d)), float(rng.choice([-1.0, 1.0]))
    place, normal = [float(rng.uniform(0.1, 1.0)) * length, 0.0, 0.0][:d], [0.0] * d
    place[axis] = side * (0.5 * height if axis == 1 else 0.01)
    normal[axis] = side
    stiffness = float(10.0 ** rng.uniform(4.0, 6.0))
    found: dict[str, Any] = {
        "nearest": place,
        "normal": normal,
        "normal_stiffness": stiffness,
        "tangential_stiffness": stiffness * float(rng.uniform(0.2, 1.0)),
        "friction": float(rng.uniform(0.0, 0.8)),
    }
    if rng.random() < 0.4:
        return found | {"gap": float(10.0 ** rng.uniform(-5.0, -3.5))}
    return found | {"preload": float(10.0 ** rng.uniform(0.0, 2.0))}


def shift(path: Continuation, point: CurvePoint, settings: Any) -> float | None:
    """How far half the step moves the curve at a point; None if the other curve is not found.

    The motion with half the step is sought at the same parameter. If this fails or moves it by more
    than `CHANGE`, it is sought in the plane normal to the curve (where the curve is steep, a small
    change of the parameter is a large one of the amplitude), and by Newton's method with bounded
    steps, which crosses kinks.

    Returns:
        The larger one of the relative changes of the amplitude and of the parameter.
    """
    steps = 2 * settings.steps_per_period
    problem = path.family(point.parameter)._replace(time=settings.changed(steps_per_period=steps))
    fine = Shooting(problem)
    here = replace(point, s=fine.scaled(point.z))
    near = Continuation(fine, path.family, path.low, path.high, here.s)
    found = [np.inf]

    def compare(other: CurvePoint | PeriodicMotion | None, parameter: float) -> bool:
        if other is not None:
            change = abs(other.amplitude.max() / point.amplitude.max() - 1.0)
            found.append(float(max(change, abs(parameter / point.parameter - 1.0))))
        return found[-1] <= CHANGE

    for normal in (np.append(0.0 * here.s, 1.0), near.direction(here)):
        other = near.correct(near.place(here), normal, exact=True)
        if compare(other, other.parameter if other else 0.0):
            return found[-1]
    with contextlib.suppress(ConvergenceError):
        compare(periodic_motion(problem, point.z, tolerance=1e-8), point.parameter)
    return None if min(found) == np.inf else min(found)


def attracts(path: Continuation, point: CurvePoint) -> bool:
    """Whether a march that starts beside a motion comes nearer to it."""
    problem, shooting, size = path.family(point.parameter), path.shooting, norm(point.s)
    s = (1.0 + BESIDE) * point.s
    begin = norm(shooting.march(s, problem, derive=False)[0]) + BESIDE * size
    for _ in range(PERIODS):
        found = shooting.march(s, problem, derive=False)
        if found is None:
            return False
        s = s + found[0]
        amplitude = np.abs(found[-1].record.displacement).max()
        apart = _apart(s, point, shooting)
        if apart <= NEAR * size:
            return True
    return apart <= begin and bool(amplitude > 0.0)


def _apart(s: Any, point: CurvePoint, shooting: Shooting) -> float:
    """Distance from a motion, without the sliders, which need not be unique."""
    moves = slice(0, shooting.map.blocks * shooting.map.n)
    return norm(s[moves] - point.s[moves])


@dataclass(frozen=True)
class Followed:
    """A curve, its path and its CPU time in seconds."""

    curve: Curve
    path: Continuation
    seconds: float


def follow_curve(stored: StoredModel, *, locate: bool = True) -> Followed:
    """Follow the response curve of a stored model, and locate its special points if asked to.

    Raises:
        ConvergenceError, AccuracyError: the first motion was not found.
    """
    table = response_table(stored.scene)
    begin, family = clock.process_time(), family_of(stored)
    motion = start_motion(stored, family, table.first)
    shooting = shooting_of(stored, family)
    s = shooting.scaled(motion.z)
    path = Continuation(shooting, family, table.low, table.high, s)
    first = path.at_parameter(s, table.first)
    if first is None:
        raise ConvergenceError("the first motion was lost")
    curve, direction = Curve([first]), np.sign(table.last - table.first)

    def limit(point: CurvePoint) -> None:
        if clock.process_time() - begin > SECONDS:
            raise TimeoutError

    try:
        path.run(first, direction, curve=curve, points=POINTS, locate=locate, progress=limit)
    except TimeoutError:
        curve.reason = f"{SECONDS:g} CPU seconds"
    return Followed(curve, path, clock.process_time() - begin)


def examine(seed: int) -> dict[str, Any]:
    """Compute a curve and confirm its points."""
    scene = parse_scene(random_scene(seed), f"random curve {seed}", MESHES)
    stored = build_model(scene)
    found: dict[str, Any] = {
        "seed": seed,
        "dimension": scene.geometry.dimension,
        "contacts": len(scene.contacts),
        "nonlinear": scene.geometrically_nonlinear,
        "coordinates": stored.size,
        "parameter": response_table(scene).parameter,
    }
    try:
        followed = follow_curve(stored, locate=False)
    except (ConvergenceError, AccuracyError) as error:
        return found | {"end": f"no start: {error}", "complete": False}
    curve = followed.curve
    tenth = curve.points[::10]
    shifts = [shift(followed.path, point, scene.time) for point in tenth]
    missed = [
        [point.parameter, point.verdict, change]
        for point, change in zip(tenth, shifts, strict=True)
        if change is None or change > CHANGE
    ]
    stable = [point for point in curve.points if point.stable]
    return found | {
        "end": curve.reason,
        "complete": curve.reason in COMPLETE,
        "points": len(curve.points),
        "unstable": sum(not point.stable for point in curve.points),
        "marches": [sum(point.marches[k] for point in curve.points) for k in (0, 1)],
        "seconds": round(followed.seconds, 2),
        "compared": len(tenth),
        "missed": missed,
        "attracts": all(attracts(followed.path, point) for point in stable[len(stable) // 2 :][:1]),
        "reached": round(curve.points[-1].parameter, 4),
    }


def main() -> None:
    """Examine the curves, one line of JSON each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    rows = []
    for seed in range(options.seed, options.seed + options.count):
        file = options.output / f"{seed}.json" if options.output else None
        if file and file.exists():
            rows.append(json.loads(file.read_text(encoding="utf-8")))
        else:
            rows.append(examine(seed))
            if file:
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps(rows[-1]) + "\n", encoding="utf-8")
        print(json.dumps(rows[-1]), flush=True)
    print(f"{sum(row['complete'] for row in rows)} of {len(rows)} curves are complete")
    compared = sum(row.get("compared", 0) for row in rows)
    missed = sum(len(row.get("missed", ())) for row in rows)
    print(f"half the step confirms {compared - missed} of {compared} points")


if __name__ == "__main__":
    main()
