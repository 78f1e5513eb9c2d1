"""Measure the table "How accurate, how fast" of the README on this machine.

    python3 tests/evidence/benchmark.py
        --errors              the errors too: the full blade takes an hour
        --offline 32 24 1     CPU times of the offline stages instead
        --offline 32 24 1 --points 17 100 500 1000    the same by contact points
        --floors              CPU times of the steps of reduced models
        --whole run SCENE     the CPU time of a command by what it is spent on

A row is a scene and changes of its keys. Both models take the same steps: one period from rest. The
ratio is that of the median CPU times of 25 runs of the reduced model and five runs of the full
model (three if the model has more than 1000 unknowns). On a machine that others use, wall time
would measure the others. The runs follow one another, with compiled code warm. The spread is half
the distance of the quartiles. "apart" is the largest difference of the tip displacements in this
period. The error is that of the tip amplitude of the motion that repeats.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from mpi4py import MPI

from fenicsrom.assess.full.full_motions import machine
from fenicsrom.fem.full.full import FullModel
from fenicsrom.fem.solid.solid import build_solid
from fenicsrom.online.motion.measures import errors_percent
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene, read_scene

DEMOS = Path(__file__).parents[2] / "demos"
LARGE = 1000  # unknowns above which the full model runs three times instead of five
ROWS = (
    ("slip_liftoff_2d", ()),
    ("slip_liftoff_2d", ("basis.method='craig-bampton'",)),
    ("high_load_2d", ()),
    ("slip_liftoff_2d", ("basis.modes=5", "basis.derivatives='none'")),
    ("slip_liftoff_3d", ()),
    ("blade_rub", ()),
)


def measure(name: str, changes: tuple[str, ...], errors: bool) -> str:
    """Measure a row of the table; returns it as a sentence."""
    scene = read_scene(DEMOS / f"{name}.toml", changes)
    solid = build_solid(scene, MPI.COMM_WORLD)
    found = Reduction(solid, scene, lambda stage: nullcontext())
    full = FullModel(solid)
    once = replace(scene, time=scene.time.changed(periods=1, steady_tolerance=0.0))
    simulate(found.model, once)
    motion, quick = repeat(found.model, once, 25)
    reference, slow = repeat(full, once, 5 if solid.free < LARGE else 3)
    assert motion.steps == reference.steps
    change = np.abs(motion.displacement - reference.displacement).max()
    words = [
        f"{np.median(slow) / np.median(quick):.0f} times",
        f"spread {spread(quick):.0f} and {spread(slow):.0f} %",
        f"{motion.steps} steps",
        f"{motion.newton_iterations} and {reference.newton_iterations} iterations",
        f"apart {change / np.abs(reference.displacement).max():.1e}",
    ]
    if errors:
        exact = errors_percent(simulate(found.model, scene), simulate(full, scene))
        words += [f"{key} {value:.2g} %" for key, value in exact.items() if value is not None]
    size = f"{found.basis.size} coordinates against {solid.free} unknowns"
    return f"{' '.join((name, *changes))}, {size}: {', '.join(words)}"


def repeat(model: Any, scene: Scene, count: int) -> tuple[Motion, list[float]]:
    """Return the motion and the CPU seconds of each run."""
    seconds = []
    for _ in range(count):
        start = process_time()
        motion = simulate(model, scene)
        seconds.append(process_time() - start)
    return motion, seconds


def spread(seconds: list[float]) -> float:
    """Half the distance of the quartiles, in percent of the median."""
    low, middle, high = np.quantile(seconds, (0.25, 0.5, 0.75))
    return float(50.0 * (high - low) / middle)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="How much faster the reduced models are.")
    parser.add_argument(
        "--errors", action="store_true", help="also compare the motions that repeat"
    )
    parser.add_argument(
        "--offline",
        nargs=3,
        type=int,
        metavar=("ALONG", "ACROSS", "THROUGH"),
        help="time the offline stages of blade_rub, with this number of elements",
    )
    parser.add_argument(
        "--points",
        nargs="+",
        type=int,
        metavar="COUNT",
        help="with --offline: for these numbers of contact points on one mesh",
    )
    parser.add_argument(
        "--floors", action="store_true", help="time the steps of reduced models instead"
    )
    parser.add_argument(
        "--whole",
        nargs=argparse.REMAINDER,
        metavar="COMMAND",
        help="split the CPU time of a command, such as `run demos/blade_rub.toml`",
    )
    options = parser.parse_args()
    if options.whole:
        import benchmark_whole

        benchmark_whole.measure(options.whole)
        return
    if options.points and not options.offline:
        parser.error("--points needs --offline")
    if options.offline:
        import benchmark_offline

        if options.points:
            benchmark_offline.measure_points(options.offline, options.points)
        else:
            benchmark_offline.measure(*options.offline)
        return
    if options.floors:
        sys.path.append(str(Path(__file__).parents[1]))  # of `support`
        import benchmark_floors

        benchmark_floors.measure()
        return
    print(", ".join(f"{key} {value}" for key, value in machine().items()))
    for name, changes in ROWS:
        print(measure(name, changes, options.errors), flush=True)


if __name__ == "__main__":
    main()
