"""Measure how many times faster the reduced model is than the full one, on this machine.

    python3 demos/benchmark.py
    python3 demos/benchmark.py --offline 32 24 1     # CPU times of the offline stages instead

Both models take the same steps: one period from rest, 200 steps (300 for the blade). The ratio is
that of the median run times of 25 runs of the reduced model and five runs of the full model (three
for the blade, whose full model takes a quarter of a second per step). The runs follow one another,
with compiled code warm, on one thread unless OMP_NUM_THREADS says otherwise. The spread is half the
distance of the quartiles. "apart" is the largest difference of the tip displacements.
"""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenicsrom.assess.full_cache import machine
from fenicsrom.fem.full import FullModel
from fenicsrom.fem.solid import Solid, build_solid
from fenicsrom.online.contact_points import contacts_of
from fenicsrom.online.motion import Motion
from fenicsrom.online.simulate import simulate
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.projection import project, project_intrusively
from fenicsrom.reduction.selection import Selection
from fenicsrom.reduction.stages import Reduction, differentiate, enrich
from fenicsrom.scene import Scene, read_scene

HERE = Path(__file__).parent
SIX = {
    2: ("1V1V", "1V1S", "1V2S"),
    3: ("1V1V", "1V1S"),
}  # with 1V and the static modes: six coordinates


def run(model: Any, scene: Scene, count: int = 5) -> tuple[Motion, list[float]]:
    """Return a motion of one period and the seconds of each run."""
    motions = [simulate(model, scene) for _ in range(count)]
    return motions[0], [motion.seconds for motion in motions]


def compare(name: str, fast: tuple[Motion, list[float]], slow: tuple[Motion, list[float]]) -> None:
    """Print how many times faster the first model is than the second."""
    (quick, few), (long, many) = fast, slow
    assert quick.steps == long.steps
    apart = np.abs(quick.displacement - long.displacement).max() / np.abs(long.displacement).max()
    spread = [
        f"{50 * (np.quantile(s, 0.75) - np.quantile(s, 0.25)) / np.median(s):.0f} %"
        for s in (few, many)
    ]
    print(
        f"{name}: {np.median(many) / np.median(few):.0f} times (spread {spread[0]}, {spread[1]}; "
        f"{long.steps} steps, {long.newton_iterations} and {quick.newton_iterations} iterations, "
        f"apart {apart:.1e})",
        flush=True,
    )


def main() -> None:
    """Measure and print."""
    print(", ".join(f"{key} {value}" for key, value in machine().items()))

    def full(solid: Solid, scene: Scene) -> FullModel:
        return FullModel(solid, contacts_of(scene, solid.points))

    for dimension in (2, 3):
        scene = read_scene(HERE / f"slip_liftoff_{dimension}d.toml")
        scene = replace(scene, time=scene.time.changed(periods=1, steady_tolerance=0.0))
        solid = build_solid(scene, MPI.COMM_WORLD)
        modes = component_modes(solid, replace(scene.basis, method="rubin", modes=1))
        selection = Selection(modes.labels, SIX[dimension], {}, {})
        basis = enrich(
            solid, modes, selection, differentiate(solid, scene.basis, modes, selection.derivatives)
        )
        model = project(solid, basis)
        simulate(model, scene)
        reduced = run(model, scene, 25)
        unknowns = solid.free
        name = f"{dimension}D, {basis.size} coordinates"
        compare(f"{name}, against {unknowns} unknowns", reduced, run(full(solid, scene), scene))
        compare(
            f"{name}, polynomial against projection",
            reduced,
            run(project_intrusively(solid, basis), scene),
        )
    scene = read_scene(HERE / "blade_rub.toml", ["time.periods=1", "time.steady_tolerance=0.0"])
    solid = build_solid(scene, MPI.COMM_WORLD)
    found = Reduction(solid, scene, lambda stage: nullcontext())
    model = found.model
    simulate(model, scene)
    points = len(solid.points.contact)
    name = f"blade, {found.basis.size} coordinates, {points} contact points"
    compare(
        f"{name}, against {solid.free} unknowns",
        run(model, scene, 25),
        run(full(solid, scene), scene, 3),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--offline",
        nargs=3,
        type=int,
        metavar=("ALONG", "ACROSS", "THROUGH"),
        help="time the offline stages of blade_rub, with this number of elements",
    )
    offline = parser.parse_args().offline
    if offline:
        from benchmark_offline import measure

        measure(*offline)
    else:
        main()
