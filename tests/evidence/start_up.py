"""What a run of a stored model and a sweep cost beside their integrations.

    docker/run python3 tests/evidence/start_up.py [--rounds N] [--runs N] [--output DIR]

The model is that of `slip_liftoff_2d`. First line: the CPU time of processes `fenicsrom run --from`
without pictures, minus that of the integration and the checks once everything is imported and
loaded, beside the CPU time of `import numba`. Second line: the CPU time of a sweep on two cores
relative to one core, and the efficiency: its run time on one core, divided by twice that on two.
The same of processes that only count is given beside it, because the cores of one machine slow each
other down. A round takes a measurement of each kind, and medians are given. The CPU times hold on
any machine; for the efficiency, it must have nothing else to do.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time as clock
from collections.abc import Sequence
from pathlib import Path

SCENE = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
ALONE = ("reference.full=false", "reference.beam=false", "output.pictures=false")
PROGRAM = (sys.executable, "-m", "fenicsrom")
COUNTING = """
import time
def count(n):
    begin = time.perf_counter()
    for _ in range(n):
        pass
    return time.perf_counter() - begin
count(10_000_000)
print(count(200_000_000))
"""
INTEGRATION = """
import sys, time
from fenicsrom.assess.errors import verdicts
from fenicsrom.cli import main
from fenicsrom.online.run import simulate
seconds = 0.0
def timed(function):
    def run(*arguments, **options):
        global seconds
        begin = time.process_time()
        try:
            return function(*arguments, **options)
        finally:
            seconds += time.process_time() - begin
    return run
main(sys.argv[1:])
simulate.simulate = timed(simulate.simulate)
verdicts.estimate_errors = timed(verdicts.estimate_errors)
main(sys.argv[1:])
print(seconds)
"""


def run(command: Sequence[str], cores: int = 1) -> tuple[float, float, str]:
    """Run a command on the first cores; give its CPU time and run time, s, and its last line."""
    allowed = sorted(os.sched_getaffinity(0))[:cores]
    begin = clock.perf_counter()
    process = subprocess.Popen(
        ["taskset", "-c", ",".join(map(str, allowed)), *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    lines = process.stdout.read().split("\n")
    _, status, used = os.wait4(process.pid, 0)
    seconds = clock.perf_counter() - begin
    if status != 0:
        raise SystemExit(f"{' '.join(command)}: exit status {status}")
    return used.ru_utime + used.ru_stime, seconds, (lines[-2] if len(lines) > 1 else "")


def counted(cores: int) -> float:
    """The longest time of as many processes that only count, one on each core, s."""
    processes = [
        subprocess.Popen(
            ["taskset", "-c", str(core), sys.executable, "-c", COUNTING],
            stdout=subprocess.PIPE,
            text=True,
        )
        for core in sorted(os.sched_getaffinity(0))[:cores]
    ]
    return max(float(process.communicate()[0]) for process in processes)


def median(values: Sequence[float]) -> float:
    """The median."""
    return statistics.median(values)


def start_up(model: Path, folder: Path, rounds: int) -> str:
    """Measure the CPU time of a run beside its integration."""
    arguments = ["run", "--from", str(model), "--output", str(folder / "run"), "--force"]
    run([*PROGRAM, *arguments])  # compiles what is missing
    totals, integrations, numba = [], [], []
    for _ in range(rounds):
        totals.append(run([*PROGRAM, *arguments])[0])
        integrations.append(float(run([sys.executable, "-c", INTEGRATION, *arguments])[2]))
        numba.append(run([sys.executable, "-c", "import numba"])[0])
    outside = [total - own for total, own in zip(totals, integrations, strict=True)]
    return (
        f"run --from: {median(outside):.2f} s ({min(outside):.2f} to {max(outside):.2f}) beside "
        f"{median(integrations):.2f} s of integration; import numba: {median(numba):.2f} s"
    )


def sweeps(model: Path, folder: Path, rounds: int, runs: int) -> str:
    """Measure sweeps on one core and on two."""
    arguments = ["sweep", "--from", str(model), "--over", f"loads.0.force=100:125:{runs}"]
    command = [*PROGRAM, *arguments, "--output", str(folder / "sweep"), "--force"]
    more, efficiency, bare = [], [], []
    for _ in range(rounds):
        (cpu_one, one, _), (cpu_two, two, _) = run(command, 1), run(command, 2)
        more.append(cpu_two / cpu_one)
        efficiency.append(one / (2.0 * two))
        bare.append(counted(1) / counted(2))
    return (
        f"sweep of {runs} runs: CPU time on two cores {median(more):.2f} times that on one, "
        f"efficiency {median(efficiency):.2f}; of processes that only count: {median(bare):.2f}"
    )


def main() -> None:
    """Build the model if it is missing, and print both lines."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=10, help="measurements of each kind")
    parser.add_argument("--runs", type=int, default=64, help="of the sweep")
    parser.add_argument("--output", type=Path, default=Path("out/start_up"))
    options = parser.parse_args()
    model = options.output / "model" / "reduced_model.npz"
    if not model.exists():
        settings = [word for text in ALONE for word in ("--set", text)]
        run([*PROGRAM, "run", str(SCENE), *settings, "--output", str(model.parent)])
    print(start_up(model, options.output, options.rounds), flush=True)
    print(sweeps(model, options.output, max(options.rounds // 3, 1), options.runs), flush=True)


if __name__ == "__main__":
    main()
