"""The errors of the three time integration schemes on the demo beam, by step size.

    python3 tests/evidence/schemes.py --output DIR

The paper's three contact cases, a hard case and an impact are run by every scheme with 25 to 800
steps per period and with three tolerances. Two processes need about ten minutes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scheme_errors import Series, series
from scheme_report import terminal, write
from stability_matrix import CONTACT, KN, PAPER, SCENE, WALL

from fenicsrom.assess.jobs import run_jobs
from fenicsrom.assess.studies.stability import WORKERS, build, load, scene_of
from fenicsrom.errors import AccuracyError, ConvergenceError, SceneError

STUDIED = {**PAPER, "impact on 1e5 N/m": (*WALL, f"{CONTACT}gap=0.1", f"{KN}=1e5")}


def study(job: tuple[str, Sequence[str], Mapping[str, Any], str, Path]) -> Series:
    """All runs of one case: its name, overrides, and the table, source and folder of the scene."""
    name, changes, table, source, folder = job
    try:
        scene = scene_of(table, source, folder, changes)
        return series(name, build(scene, "reduced")[0], scene)
    except (SceneError, ConvergenceError, AccuracyError) as error:
        return Series(name, failure=str(error))


def main() -> int:
    """Run all cases by all schemes and write the report."""
    parser = argparse.ArgumentParser(description="The errors of the schemes by step size.")
    parser.add_argument("--output", default="out/schemes", type=Path, metavar="DIR")
    parser.add_argument("--case", action="append", help="run this case only; may be repeated")
    options = parser.parse_args()
    table, scene = load(SCENE)
    chosen = {name: STUDIED[name] for name in options.case or STUDIED}
    jobs = [(name, changes, table, scene.source, SCENE.parent) for name, changes in chosen.items()]
    found: dict[str, Series] = {}
    for _, made in run_jobs(study, jobs, lambda *_: None, WORKERS):
        found[made.name] = made
        result = made.failure or f"{len(made.runs)} runs"
        print(f"{len(found)}/{len(jobs)} {made.name}: {result}", file=sys.stderr, flush=True)
    ordered = [found[name] for name in chosen]
    files = write(ordered, options.output)
    print("\n".join([terminal(ordered), *map(str, files)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
