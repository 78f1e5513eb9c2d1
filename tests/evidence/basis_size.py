"""The size and the error of reduced models that choose their size, on random nonlinear scenes.

    python3 tests/evidence/basis_size.py --output DIR [--planar 28] [--spatial 12] [--seed 1]
    python3 tests/evidence/basis_size.py --output DIR SCENE ...

The scenes are cantilever beams of 12 cells in the plane and of 6 cells in space, with 1 to 8
contact points, shaken near their first resonance by a load that would swing the free tip by 0.1 %
to 10 % of the length. The reference is the full model on the same mesh with the same time steps,
started at the periodic motion of the reduced model. Errors and estimates are of all directions
together, and of the worst direction. Every result is one line of `runs.jsonl`; a run
that is there already is not repeated. `sizes.png` shows the sizes and the errors. With names of
scenes these are examined instead.
"""

from __future__ import annotations

import argparse
import json
import signal
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from figures import new_figure, styled

import fenicsrom
from fenicsrom.assess.errors.estimates import distances
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.motion.measures import has_settled
from fenicsrom.online.run.march import end_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.base.tables import write_figure
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import choose, differentiate, enrich, reduce
from fenicsrom.scene import Scene, make_scene, read_scene
from fenicsrom.scene.reading.reading import with_time

YOUNG, DENSITY, DAMPING_RATIO = 207e9, 7800.0, 0.02
CELLS = {2: 12, 3: 6}
STEPS = 120  # in a period
FULL_PERIODS = 20  # of the full model from the motion of the reduced one
TIMED_PERIODS = 5  # from rest, which time the steps of the reduced models
LEAST = 1e-6  # smaller errors are rounding and are left out of the effectivity


class TooSlow(Exception):
    """The full model took more than `--longest` CPU seconds."""


def _interrupt(*_: Any) -> None:
    raise TooSlow


def random_scene(dimension: int, seed: int, number: int, cells: int = 0, finer: int = 1) -> Scene:
    """Scene `number` of a seed; with an even number of equal cells, each cut into `finer`."""
    equal = {"load_at": 0.5} if cells else {}  # all places are nodes of the finer mesh too
    cells = cells or CELLS[dimension]
    rng = np.random.default_rng((dimension, seed, number))

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    length = between(0.5, 2.0)
    height = length / rng.uniform(20.0, 40.0)
    bending = YOUNG * height**4 / 12.0
    stiffness = 3.0 * bending / length**3
    omega = (1.875 / length) ** 2 * np.sqrt(bending / (DENSITY * height**2))
    swing = between(1e-3, 1e-1)
    force = 2.0 * DAMPING_RATIO * stiffness * swing * length
    points = int(rng.integers(1, 9))
    directions = np.eye(dimension)[1:]
    springs = {
        "normal_stiffness": stiffness * between(10.0, 3e3),
        "tangential_stiffness": stiffness * between(10.0, 1e3),
        "friction": float(rng.uniform(0.1, 1.0)),
        "preload": force * between(0.1, 3.0),
    }
    nodes = 2 * cells
    among = np.arange(nodes // 3, nodes)
    places = np.append(nodes, rng.choice(among, min(points - 1, among.size), replace=False))
    contacts = []
    for k, place in enumerate(places):
        normal = np.eye(dimension)[0] if k == 0 and rng.random() < 0.5 else rng.choice(directions)
        contacts.append(
            {
                "nearest": [float(place) / nodes * length, *[0.0] * (dimension - 1)],
                "normal": (float(rng.choice((-1.0, 1.0))) * normal).tolist()
                if normal[0] == 0.0
                else normal.tolist(),
                **springs,
            }
        )
    sizes = {"length": length, "height": height, "elements_along": finer * cells}
    sizes |= {"elements_through": min(finer, 2)} | equal
    place = round(float(rng.uniform(0.5, 1.0)) * nodes) / nodes * length
    return make_scene(
        title=f"{dimension}D, seed {seed}, number {number}",
        geometrically_nonlinear=True,
        geometry={
            "mesh": f"beam{dimension}d.geo",
            "dimension": dimension,
            "parameters": sizes | ({"width": height} if dimension == 3 else {}),
            **({"thickness": height} if dimension == 2 else {}),
        },
        material={
            "young": YOUNG,
            "poisson": 0.3,
            "density": DENSITY,
            "mass_damping": 2.0 * DAMPING_RATIO * omega,
        },
        damping={"stiffness": 1e-3 / omega},
        supports=[{"group": "root"}],
        loads=[
            {
                "nearest": [place, *[0.0] * (dimension - 1)],
                "direction": [0.0, 1.0, 0.0][:dimension],
                "force": force,
                "frequency": float(omega * rng.uniform(0.8, 1.5) / (2.0 * np.pi)),
            }
        ],
        contacts=contacts,
        time={"steps_per_period": STEPS},
        output={"pictures": False, "paraview": False},
    )


def examine(scene: Scene, longest: float) -> dict[str, Any]:
    """Run a scene with the size that it chooses, and measure its error in so many CPU seconds."""
    found: dict[str, Any] = {"points": len(scene.contacts)}
    try:
        study = fenicsrom.run(scene)
        motion, sized, solid = study.motions["reduced"], study.sized, study.solid
        assert sized is not None and study.basis is not None
        found |= {
            "unknowns": solid.free,
            "first": study.basis.size - len(sized.energies),
            "size": study.basis.size,
            "known": study.basis.size + len(sized.stored.further),
            "seconds": motion.seconds,
            "sizing": study.seconds["size"],
            "step": seconds_of_a_step(study.model, scene),
            "checks": study.seconds["checks"],
            "settled": has_settled(motion),
            "estimate": sized.errors.amplitude,
            "worst_estimate": sized.errors.largest,
            "warned": bool(sized.warning),
            "unfinished": str(study.unfinished[1])[:80] if study.unfinished else "",
        }
        found |= by_pairs(scene, solid, longest)
        start = None
        if motion.newton_from is not None:
            q, v, sliders = end_of(motion)
            start = study.basis.vectors @ q, study.basis.vectors @ v, sliders
            scene = with_time(scene, periods=FULL_PERIODS)
        signal.setitimer(signal.ITIMER_VIRTUAL, longest)
        full = simulate(full_model(solid), scene, start=start)
        error = distances(motion, full)
        found |= {"error": error.amplitude, "worst_error": error.largest}
        found |= {"full_step": full.seconds / full.steps}
        found["full_settled"] = has_settled(full)
    except (SceneError, ConvergenceError, AccuracyError, TooSlow) as failure:
        return found | {"refused": f"{type(failure).__name__}: {failure}"}
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return found


def by_pairs(scene: Scene, solid: Any, longest: float) -> dict[str, Any]:
    """The size of a basis with derivatives along pairs of modes (MMI-NLS), and s of a step."""
    basis = replace(scene.basis, derivatives="mmi-nls")
    if len(scene.contacts) > 4:
        basis = replace(basis, masters=10)
    scene = replace(scene, basis=basis)
    modes = component_modes(solid, basis)
    chosen = choose(solid, scene, modes)
    found = {"paired": len(chosen.modes) + len(modes.loads.labels) + len(chosen.derivatives)}
    signal.setitimer(signal.ITIMER_VIRTUAL, longest)
    try:
        vectors = enrich(solid, modes, chosen, differentiate(solid, basis, modes, chosen))
        step = seconds_of_a_step(reduce(solid, basis, vectors), scene)
    except (ConvergenceError, AccuracyError, TooSlow):
        return found
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return found | {"paired": vectors.size, "paired_step": step}


def seconds_of_a_step(model: Any, scene: Scene) -> float:
    """Seconds of a time step of the first periods from rest."""
    motion = simulate(model, with_time(scene, periods=TIMED_PERIODS, steady="march"))
    return motion.seconds / motion.steps


def read(path: Path) -> list[dict[str, Any]]:
    """The runs of a file."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def compared(runs: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The periodic motions of runs whose full model found one too."""
    return [run for run in runs if "error" in run and run["settled"] and run["full_settled"]]


def statistics(runs: Sequence[Mapping[str, Any]], accuracy: float) -> dict[str, float]:
    """Sizes, errors, effectivity and speed of the runs with a full model."""
    known = compared(runs)
    size, paired, error, estimate, worst, step, full = (
        np.array([run[key] for run in known], dtype=float)
        for key in ("size", "paired", "error", "estimate", "worst_error", "step", "full_step")
    )
    timed = [run for run in known if "paired_step" in run]
    faster = np.array([run["paired_step"] / run["step"] for run in timed])
    counted = (error > LEAST) & np.isfinite(estimate)
    effectivity = estimate[counted] / error[counted]
    silent = [run["error"] > 2.0 * accuracy and not run["warned"] for run in known]
    return {
        "runs": len(runs),
        "not periodic": int(sum("error" in run for run in runs)) - len(known),
        "without a result": int(sum("refused" in run for run in runs)),
        "compared": len(known),
        "median size": float(np.median(size)),
        "largest size": float(size.max()),
        "median size by pairs": float(np.median(paired)),
        "largest size by pairs": float(paired.max()),
        "below the accuracy": float(np.mean(error <= accuracy)),
        "below twice the accuracy": float(np.mean(error <= 2.0 * accuracy)),
        "above it without a warning": int(np.sum(silent)),
        "warned": int(sum(run["warned"] for run in known)),
        "median error": float(np.median(error)),
        "largest error": float(error.max()),
        "median error of the worst direction": float(np.median(worst)),
        "largest error of a direction": float(worst.max()),
        "median effectivity": float(np.median(effectivity)),
        "effectivity 5 %": float(np.quantile(effectivity, 0.05)),
        "effectivity 95 %": float(np.quantile(effectivity, 0.95)),
        "median speed of a step": float(np.median(full / step)),
        "least speed of a step": float((full / step).min()),
        "median speed of a step against pairs": float(np.median(faster)),
        "largest speed of a step against pairs": float(faster.max()),
    }


@styled
def figure(runs: Sequence[Mapping[str, Any]], accuracy: float) -> Any:
    """The sizes over the number of contact points, and the estimate over the true error."""
    made = new_figure(9.0, 3.8)
    left, right = made.subplots(1, 2)
    known = compared(runs)
    points = [run["points"] for run in runs if "size" in run]
    for name, colour in (("paired", "#b0b6bc"), ("size", "#0072B2")):
        values = [run[name] for run in runs if "size" in run]
        label = "along pairs of modes" if name == "paired" else "by basis.accuracy"
        left.plot(points, values, "o", ms=4, alpha=0.7, color=colour, label=label)
    left.set(xlabel="contact points", ylabel="coordinates", ylim=(0.0, None))
    left.legend()
    line = np.array([1e-7, 1.0])
    right.plot(line, line, "-", color="#777777", lw=0.8)
    for warned, marker in ((False, "o"), (True, "x")):
        chosen = [run for run in known if run["warned"] == warned]
        errors, estimates = ([run[key] for run in chosen] for key in ("error", "estimate"))
        label = "accuracy not reached" if warned else "accuracy reached"
        right.plot(np.clip(errors, *line), np.clip(estimates, *line), marker, ms=4, label=label)
    right.axhline(accuracy, color="#777777", ls=":")
    right.axvline(accuracy, color="#777777", ls=":")
    right.set(xscale="log", yscale="log", xlabel="error against the full model", ylabel="estimate")
    right.legend()
    return made


def main() -> None:
    """Run the scenes, print the statistics and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", type=Path)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--planar", type=int, default=28)
    parser.add_argument("--spatial", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=40.0, help="CPU seconds of a full model")
    options = parser.parse_args()
    signal.signal(signal.SIGVTALRM, _interrupt)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "runs.jsonl"
    wanted = [(2, k) for k in range(options.planar)] + [(3, k) for k in range(options.spatial)]
    done = {run["name"] for run in read(path)}
    scenes = [read_scene(scene) for scene in options.scenes] or [
        random_scene(dimension, options.seed, number)
        for dimension, number in sorted(wanted, key=lambda scene: scene[1])
    ]
    for scene in scenes:
        if scene.title in done:
            continue
        begin = clock.process_time()
        found = {"name": scene.title} | examine(scene, options.longest)
        found["cpu"] = clock.process_time() - begin
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(found) + "\n")
        print(json.dumps(found), flush=True)
    runs, accuracy = read(path), random_scene(2, 1, 0).basis.accuracy
    if compared(runs):
        for name, value in statistics(runs, accuracy).items():
            print(f"{name}: {value:.4g}")
    print(write_figure(options.output / "sizes.png", figure(runs, accuracy)))


if __name__ == "__main__":
    main()
