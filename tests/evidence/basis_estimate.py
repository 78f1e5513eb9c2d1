"""The estimate of the error due to the basis against the true error, on random scenes.

    python3 tests/evidence/basis_estimate.py --output DIR [--planar 250] [--spatial 50] [--seed 1]

The scenes are the random variants that `fenicsrom stability --random` makes of a cantilever beam
with a rubbing tip: planar with 6 x 1 quadratic cells, and spatial with 4 x 1 x 1. The reference is
the full model on the same mesh with the same time steps, so that their error cancels. Every result
is one line of `runs.jsonl`; a run that is there already is not repeated. `effectivity.png` shows
the estimate and the effectivity, which is the estimate over the true error. 300 scenes take about
half an hour on one core.
"""

from __future__ import annotations

import argparse
import json
import signal
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from figures import new_figure, styled

from fenicsrom.assess.errors.estimates import basis_errors, nested_motion
from fenicsrom.assess.errors.verdicts import BASIS_ERROR
from fenicsrom.assess.full.full_motions import full_distances
from fenicsrom.assess.studies import stability
from fenicsrom.assess.studies.axes import random_cases, scales_of
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError
from fenicsrom.online.motion.measures import has_settled
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.base.tables import write_figure
from fenicsrom.reduction.candidates import candidate_model

DEMOS = Path(__file__).parents[2] / "demos"
SMALL = ("time.steps_per_period=40", "reference={}", "output={}")
SCENES = {
    "planar": ("slip_liftoff_2d.toml", (*SMALL, "geometry.parameters.elements_along=6")),
    "spatial": ("slip_liftoff_3d.toml", (*SMALL, "geometry.parameters.elements_along=4")),
}
NOTABLE = 0.01  # true errors above this must be seen
LONGEST = 8.0  # CPU seconds of the full model; a longer run has no result
LEAST = 1e-6  # smaller errors are rounding and are left out of the statistics


class TooSlow(Exception):
    """The full model took more than `LONGEST`."""


def _interrupt(*_: Any) -> None:
    raise TooSlow


def examine(case: Any, table: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Run a variant, estimate its error and measure it."""
    found: dict[str, Any] = {"case": case.value, "overrides": list(case.overrides)}
    begin = clock.process_time()
    try:
        scene = stability.scene_of(table, source, DEMOS, case.overrides)
        model, reduction, solid = stability.build(scene, "reduced")
        motion = simulate(model, scene)
        found |= {"settled": has_settled(motion), "periodic": motion.period is not None}
        found["size"] = model.size
        found["run"] = clock.process_time() - begin
        begin = clock.process_time()
        candidates = candidate_model(solid, scene.basis, reduction)
        estimate = basis_errors(motion, nested_motion(candidates, scene, motion))
        found["estimating"] = clock.process_time() - begin
        begin = clock.process_time()
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
        error = full_distances(reduction.basis.vectors, solid, scene, motion)
        found["reference"] = clock.process_time() - begin
    except (SceneError, ConvergenceError, AccuracyError, TooSlow) as failure:
        return found | {"refused": f"{type(failure).__name__}: {failure}"}
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
    return found | {"estimate": estimate._asdict(), "error": error._asdict()}


def run(kind: str, count: int, seed: int, path: Path) -> None:
    """Examine the variants of one scene that the file does not hold."""
    name, changes = SCENES[kind]
    table, scene = stability.load(DEMOS / name, changes)
    scales = scales_of(stability.build(scene, "reduced")[0], scene)
    done = {(r["kind"], r["case"]) for r in read(path)}
    for case in random_cases(scene, scales, count, seed):
        if (kind, case.value) in done:
            continue
        found = {"kind": kind} | examine(case, table, scene.source)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(found) + "\n")
        estimate, error = (found.get(k, {}).get("amplitude") for k in ("estimate", "error"))
        print(kind, case.value, f"{estimate} {error}", found.get("refused", ""), flush=True)


def read(path: Path) -> list[dict[str, Any]]:
    """The runs of a file."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def pairs(runs: Sequence[Mapping[str, Any]], quantity: str = "amplitude") -> np.ndarray:
    """True errors and estimates (k, 2) of the runs that were not refused by a failure."""
    found = []
    for each in runs:
        if "error" in each:
            error, estimate = (np.atleast_1d(each[k][quantity]) for k in ("error", "estimate"))
            found += list(zip(error, estimate, strict=True))
    return np.array(found, dtype=float).reshape(-1, 2)


def statistics(values: np.ndarray) -> dict[str, float]:
    """The distribution of the effectivity."""
    error, estimate = values.T
    counted = (error > LEAST) & np.isfinite(error) & np.isfinite(estimate)
    effectivity = estimate[counted] / error[counted]
    missed = (error > NOTABLE) & (estimate < error / 3.0)
    silent = (error > NOTABLE) & (estimate < error / 3.0) & (estimate <= BASIS_ERROR)
    ranks = [np.argsort(np.argsort(x[counted])) for x in (error, estimate)]
    return {
        "runs": int(error.size),
        "median": float(np.median(effectivity)),
        "lower": float(np.quantile(effectivity, 0.05)),
        "upper": float(np.quantile(effectivity, 0.95)),
        "missed": float(np.mean(missed)),
        "silent": float(np.mean(silent)),
        "above the limit": int(np.sum(estimate > BASIS_ERROR)),
        "rank correlation": float(np.corrcoef(*ranks)[0, 1]),
    }


@styled
def figure(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Estimate against true error, and the distribution of the effectivity."""
    made = new_figure(9.0, 4.0)
    left, right = made.subplots(1, 2)
    line = np.array([LEAST, 10.0])
    for factor, style in ((1.0, "-"), (3.0, ":"), (1.0 / 3.0, ":")):
        left.plot(line, factor * line, style, color="#777777", lw=0.8)
    groups = {
        "periodic": [r for r in runs if r.get("settled")],
        "transient, sweep, impact": [r for r in runs if r.get("periodic") is False],
        "not settled": [r for r in runs if r.get("periodic") and not r.get("settled")],
    }
    for name, chosen in groups.items():
        values = np.clip(pairs(chosen), LEAST, 10.0)
        left.plot(*values.T, "o", ms=3, alpha=0.7, label=f"{name} ({len(values)})")
    left.set(xscale="log", yscale="log", xlabel="true error", ylabel="estimate")
    left.set(xlim=line, ylim=line)
    left.legend(fontsize=7)
    values = pairs(runs)
    values = values[(values[:, 0] > LEAST) & np.all(np.isfinite(values), axis=1)]
    effectivity = np.clip(values[:, 1] / values[:, 0], 1e-2, 1e2)
    right.hist(effectivity, bins=np.logspace(-2, 2, 41))
    right.axvline(1.0 / 3.0, color="#777777", ls=":")
    right.set(xscale="log", xlabel="estimate over true error", ylabel="runs")
    return made


def main() -> None:
    """Run the scenes, print the statistics and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--planar", type=int, default=250)
    parser.add_argument("--spatial", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    signal.signal(signal.SIGVTALRM, _interrupt)
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "runs.jsonl"
    for kind in SCENES:
        run(kind, getattr(options, kind), options.seed, path)
    runs = read(path)
    for kind in SCENES:
        chosen = [r for r in runs if r["kind"] == kind]
        failed = sum("refused" in r for r in chosen)
        print(f"{kind}: {len(chosen)} scenes, {failed} refused")
        for quantity in ("amplitude", "directions", "peak_force"):
            if len(pairs(chosen, quantity)):
                print(f"  {quantity}: {statistics(pairs(chosen, quantity))}")
    print(write_figure(options.output / "effectivity.png", figure(runs)))


if __name__ == "__main__":
    main()
