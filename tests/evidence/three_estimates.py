"""The estimates of a run, by its time step, its basis and its mesh, against the true errors.

    python3 tests/evidence/three_estimates.py --output DIR [--seed 7] [--planar 90] [--several 35]
                                              [--spatial 25]

The scenes are run as a user runs them, on random meshes with random time steps: the variants that
`fenicsrom stability --random` makes of a beam with a rubbing tip in the plane and in space, and the
plane beams with several contact points of `basis_size.py`. The true error by the time step is the
distance from the motion with an eighth of the step, that by the basis the distance from the full
model on the same mesh with the same steps, and that by the mesh the distance from the motion on
four times the elements along the beam and two to four times across it. Every result is one line of
`runs.jsonl`; a run that is there already is not repeated. `estimates.png` shows the estimates. A
run is silently wrong if it ends with exit code 0 and a true error is above 1 % and above three
times its estimate.
"""

from __future__ import annotations

import argparse
import json
import signal
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from basis_estimate import DEMOS, LEAST, TooSlow, read
from basis_size import random_scene
from figures import new_figure, styled

import fenicsrom
from fenicsrom.assess.errors.estimates import MotionErrors, check_motion, distances
from fenicsrom.assess.errors.sizing import fitted
from fenicsrom.assess.full.full_motions import full_distances, missed
from fenicsrom.assess.studies import stability
from fenicsrom.assess.studies.axes import random_cases, scales_of
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.online.motion.measures import has_settled
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.base.tables import write_figure
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.reading import refined
from fenicsrom.study.source import source_of

CAUSES = ("time step", "basis", "mesh")
LONGEST = 12.0  # CPU seconds of a reference; a longer one counts as missing
LONGEST_RUN = 60.0  # CPU seconds of a run; a longer one has no result
PLAIN = ("reference={}", "output.pictures=false", "output.paraview=false", "output.stresses='none'")
FINER = 4  # times the elements along the beam
STEPS = (20, 40, 80)
FAILURES = (SceneError, ConvergenceError, AccuracyError, TooSlow)


def _interrupt(*_: Any) -> None:
    raise TooSlow("too many CPU seconds")


def variant(name: str, seed: int, number: int) -> tuple[Scene, Scene]:
    """A random variant of a demo on a random mesh, and the same on the finer mesh."""
    rng = np.random.default_rng((seed, number, 3))
    plane = name.endswith("2d")
    along = int(np.exp(rng.uniform(np.log(2.0), np.log(13.0 if plane else 7.0))))
    through = int(rng.choice((1, 1, 2) if plane else (1,)))
    mesh = [
        f"geometry.cells='{rng.choice(('structured', 'structured', 'simplex'))}'",
        f"geometry.degree={rng.choice((2, 2, 2, 1))}",
        f"time.steps_per_period={rng.choice(STEPS)}",
        "geometry.parameters.load_at=0.5",
    ]
    sizes = ((along, through), (FINER * along, (FINER if plane else 2) * through))
    found = []
    table, scene = stability.load(DEMOS / f"{name}.toml", (*PLAIN, *mesh))
    scales = scales_of(stability.build(scene, "reduced")[0], scene)
    case = random_cases(scene, scales, number + 1, seed)[number]
    for elements, across in sizes:
        cells = [
            f"geometry.parameters.elements_along={elements}",
            f"geometry.parameters.elements_through={across}",
        ]
        found.append(stability.scene_of(table, scene.source, DEMOS, (*cells, *case.overrides)))
    return found[0], found[1]


def several(seed: int, number: int) -> tuple[Scene, Scene]:
    """A plane beam with several contact points on a random mesh, and the same on the finer mesh."""
    cells = 2 * int(np.random.default_rng((seed, number, 4)).integers(2, 7))
    coarse, fine = (random_scene(2, seed, number, cells, finer) for finer in (1, FINER))
    return coarse, fine


def examine(scene: Scene, finer: Callable[[], Scene]) -> dict[str, Any]:
    """Run a scene as a user would, and measure its errors."""
    found: dict[str, Any] = {}
    begin = clock.process_time()
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST_RUN)
    study = fenicsrom.run(scene)
    signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    found |= {"unknowns": study.solid.free, "size": study.model.size, "warnings": study.warnings}
    found["refused"] = str(study.unfinished[1]) if study.unfinished else ""
    found["run"] = clock.process_time() - begin
    if not study.errors:
        return found
    motion, scene = study.motions["reduced"], study.scene
    found |= {"settled": has_settled(motion), "periodic": motion.period is not None}
    found["estimates"] = {cause: value._asdict() for cause, value in study.errors.items()}
    references: dict[str, Callable[[], MotionErrors]] = {
        "time step": lambda: distances(
            motion, check_motion(study.model, refined(scene, 8), motion)
        ),
        "basis": lambda: full_distances(study.basis.vectors, study.solid, scene, motion),
        "mesh": lambda: distances(motion, on_mesh(finer())),
    }
    found["errors"] = {}
    for cause, reference in references.items():
        begin = clock.process_time()
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
        try:
            found["errors"][cause] = reference()._asdict()
        except FAILURES as failure:
            found[f"no {cause}"] = f"{type(failure).__name__}: {failure}"[:200]
        finally:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        found[f"seconds of {cause}"] = clock.process_time() - begin
    return found


def on_mesh(scene: Scene) -> Any:
    """The motion of a scene whose reduced model has the size that it chooses."""
    stored = source_of(scene, None, None, fresh=False).stored
    motion = simulate(stored.model, stored.scene, keep_coordinates=True)
    found = fitted(stored, motion, [])
    return motion if found is None else found.motion


def wrong(run: Mapping[str, Any]) -> list[str]:
    """The causes by which a run is silently wrong."""
    if run.get("refused", "no result"):
        return []
    return [
        cause
        for cause, error in run["errors"].items()
        if missed(error["amplitude"], run["estimates"].get(cause, {}).get("amplitude", 0.0))
    ]


def pairs(runs: Sequence[Mapping[str, Any]], cause: str) -> np.ndarray:
    """True errors and estimates (k, 2) by a cause."""
    found = [
        (run["errors"][cause]["amplitude"], run["estimates"][cause]["amplitude"])
        for run in runs
        if cause in run.get("errors", {}) and cause in run["estimates"]
    ]
    return np.array(found, dtype=float).reshape(-1, 2)


def statistics(values: np.ndarray) -> str:
    """The distribution of the effectivity, the estimate over the true error, in a sentence."""
    error, estimate = values.T
    counted = (error > LEAST) & np.isfinite(error) & np.isfinite(estimate)
    low, middle, high = np.quantile(estimate[counted] / error[counted], (0.05, 0.5, 0.95))
    notable = counted & (error > 0.01)
    return (
        f"{error.size} compared, {np.sum(error > 0.01)} errors above 1 %; effectivity {low:.2f}, "
        f"{middle:.2f}, {high:.2f} (5 %, median, 95 %); of errors above 1 %: least "
        f"{np.min(estimate[notable] / error[notable], initial=np.inf):.2f}"
    )


@styled
def figure(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Estimate against true error by each cause; runs with exit code 1 are crosses."""
    made = new_figure(10.0, 3.6)
    line = np.array([LEAST, 10.0])
    for axes, cause in zip(made.subplots(1, len(CAUSES), sharey=True), CAUSES, strict=True):
        for factor, style in ((1.0, "-"), (1.0 / 3.0, ":")):
            axes.plot(line, factor * line, style, color="#777777", lw=0.8)
        for accepted, marker, label in ((True, "o", "exit code 0"), (False, "x", "exit code 1")):
            chosen = [run for run in runs if bool(run.get("refused", "")) != accepted]
            values = np.clip(pairs(chosen, cause), *line)
            axes.plot(*values.T, marker, ms=3, alpha=0.7, label=f"{label} ({len(values)})")
        axes.set(xscale="log", yscale="log", xlim=line, ylim=line, title=cause)
        axes.set(xlabel="true error", ylabel="estimate" if cause == CAUSES[0] else "")
        axes.legend(fontsize=7, loc="upper left")
    return made


def main() -> None:
    """Run the scenes, print the statistics and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=7)
    for kind, count in (("planar", 90), ("several", 35), ("spatial", 25)):
        parser.add_argument(f"--{kind}", type=int, default=count)
    options = parser.parse_args()
    signal.signal(signal.SIGVTALRM, _interrupt)
    options.output.mkdir(parents=True, exist_ok=True)
    path, seed = options.output / "runs.jsonl", options.seed
    makers: dict[str, Callable[[int], tuple[Scene, Scene]]] = {
        "planar": lambda k: variant("slip_liftoff_2d", seed, k),
        "several": lambda k: several(seed, k),
        "spatial": lambda k: variant("slip_liftoff_3d", seed, k),
    }
    wanted = [(k, kind) for kind in makers for k in range(getattr(options, kind))]
    done = {(run["number"], run["kind"]) for run in read(path)}
    for number, kind in sorted(set(wanted) - done):
        begin = clock.process_time()
        found: dict[str, Any] = {"kind": kind, "number": number}
        try:
            scene, fine = makers[kind](number)
            found |= examine(scene, lambda fine=fine: fine)
        except FAILURES as failure:
            found["refused"] = f"{type(failure).__name__}: {failure}"
        found["cpu"] = clock.process_time() - begin
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(found) + "\n")
        told = [f"{cause} {found['errors'][cause]['amplitude']:.1e}" for cause in wrong(found)]
        print(kind, number, f"{found['cpu']:.0f} s", found["refused"][:90], *told, flush=True)
    runs = read(path)
    for kind in makers:
        chosen = [run for run in runs if run["kind"] == kind]
        refused = sum(bool(run["refused"]) for run in chosen)
        print(f"{kind}: {len(chosen)} scenes, {refused} with exit code 1, ", end="")
        print(f"silently wrong: {sum(bool(wrong(run)) for run in chosen)}")
        for cause in CAUSES:
            if len(pairs(chosen, cause)):
                print(f"  {cause}: {statistics(pairs(chosen, cause))}")
    print(write_figure(options.output / "estimates.png", figure(runs)))


if __name__ == "__main__":
    main()
