"""Ranks that wait for the scripts of the tests: MPI, dolfinx and the program start once a session.

    mpirun -n 2 python3 tests/ranks.py FOLDER PROCESS

Each rank runs `FOLDER/0.job`, `FOLDER/1.job`, .. in turn, until one is empty or the process of the
tests is gone. A job is a JSON list of the arguments of `python3`: `-c SCRIPT ..` or `-m MODULE ..`.
`FOLDER/JOB.RANK` holds what the rank printed, and its exit code.
"""

from __future__ import annotations

import contextlib
import json
import os
import runpy
import subprocess
import sys
import time
import traceback
from io import StringIO
from pathlib import Path

PAUSE = 0.02  # s between two looks for a file: a rank that waits leaves the processor to others


class Ranks:
    """Some ranks of this machine, which run one job after another.

    Args:
        number: of the ranks; one runs without mpirun.
        folder: of jobs and answers.
        environment: of the ranks.
    """

    def __init__(self, number: int, folder: Path, environment: dict[str, str]) -> None:
        start = ["mpirun", "--oversubscribe", "-n", str(number)] if number > 1 else []
        self.number, self.folder, self.jobs = number, folder, 0
        self.process = subprocess.Popen(
            [*start, sys.executable, __file__, str(folder), str(os.getpid())], env=environment
        )

    def run(self, command: tuple[str, ...], timeout: float) -> subprocess.CompletedProcess[str]:
        """Run a job; give its output, with the sum of the exit codes of the ranks."""
        write(self.folder / f"{self.jobs}.job", json.dumps(command))
        answers = [self.folder / f"{self.jobs}.{rank}" for rank in range(self.number)]
        last = time.monotonic() + timeout
        while not all(answer.exists() for answer in answers):
            if self.process.poll() is not None or time.monotonic() > last:
                self.process.kill()
                raise AssertionError(f"no answer of {self.number} ranks to {command}")
            time.sleep(PAUSE)
        self.jobs += 1
        out, err, codes = zip(*(json.loads(answer.read_text()) for answer in answers), strict=True)
        return subprocess.CompletedProcess(command, sum(codes), "".join(out), "".join(err))

    def end(self) -> None:
        """Let the ranks end."""
        write(self.folder / f"{self.jobs}.job", "[]")
        self.process.wait(60)


def write(path: Path, text: str) -> None:
    """Write a file that appears when it is complete."""
    part = path.with_name(f"{path.name}.part")
    part.write_text(text)
    part.replace(path)


def serve(folder: Path, tests: int) -> None:
    """Run jobs until an empty one comes, or the process of the tests is gone."""
    from mpi4py import MPI

    for number in range(sys.maxsize):
        job = folder / f"{number}.job"
        while not job.exists():
            time.sleep(PAUSE)
            if not Path(f"/proc/{tests}").exists():
                return
        command = json.loads(job.read_text())
        if not command:
            return
        out, err = StringIO(), StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = answer(command)
        answer_file = folder / f"{number}.{MPI.COMM_WORLD.rank}"
        write(answer_file, json.dumps([out.getvalue(), err.getvalue(), code]))


def answer(command: list[str]) -> int:
    """Run one job as `python3` does; give its exit code."""
    kind, what, *arguments = command
    sys.argv = [kind, *arguments]
    try:
        if kind == "-m":
            runpy.run_module(what, run_name="__main__", alter_sys=True)
        else:
            exec(compile(what, "<job>", "exec"), {"__name__": "__main__"})
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


if __name__ == "__main__":
    serve(Path(sys.argv[1]), int(sys.argv[2]))
