"""The jobs of a study: progress, results that are kept, failures and interrupts.

A result is kept in a file whose name is a digest of all that determines it, so that a study that is
repeated or changed computes only what is missing.
"""

import hashlib
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from fenicsrom.assess.jobs import Job, Workers, run_jobs
from fenicsrom.errors import SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.store.store import pack, unpack
from fenicsrom.progress import log, time_left, working_time
from fenicsrom.words import counted

FORMAT = "fenicsrom result 1"
INTERVAL = 2.0  # shortest time between two lines of progress, s


class _Task(NamedTuple):
    """A job, and the file that keeps its result, or None."""

    function: Job
    job: Any
    file: Path | None


@dataclass(eq=False)
class Batch:
    """Jobs of one kind. An error of a job is its result, and the other jobs go on.

    Attributes:
        noun: what a job computes, such as "speed".
        folder: keeps the results; None keeps nothing.
        classes: the dataclasses of the results, by name; see `fenicsrom.online.store.store.unpack`.
        resume: whether to take results that the folder has.
        workers: compute the jobs, and so do the ranks of `comm`; see `run_jobs`.
        comm: MPI communicator.
        interval: shortest time between two lines of progress, s.
        reused: number of results that the folder had.
        interrupted: whether the jobs were interrupted.
    """

    noun: str
    folder: Path | None = None
    classes: Mapping[str, Any] = field(default_factory=dict)
    resume: bool = False
    workers: Workers = 1
    comm: Any = None
    interval: float = INTERVAL
    reused: int = 0
    interrupted: bool = False

    def each(
        self,
        function: Job,
        jobs: Sequence[Any],
        say: Callable[[int, Any], str],
        digests: Sequence[str] = (),
        cost: Sequence[float] = (),
        after: Callable[[Any, Any], Any] | None = None,
    ) -> dict[int, Any]:
        """Compute jobs.

        Args:
            function: computes a job.
            jobs: the jobs.
            say: a line on a job, from its number and its result.
            digests: what determines the result of each job, if results are kept.
            cost: of each job, relative to others.
            after: makes a job that continues from the result of the one before, or from None. The
                jobs are then computed one after another, and end where one has an error.

        Returns:
            Results or errors by the numbers of the jobs; after an interrupt those that are there.

        Raises:
            OSError: a file cannot be written.
        """
        files = [self._file(text) for text in digests] or [None] * len(jobs)
        found = {k: one for k, file in enumerate(files) if self.resume for one in self._kept(file)}
        self.reused += len(found)
        if found:
            log.info(f"done already: {len(found)} of {counted(len(jobs), self.noun)}")
        waiting = [k for k in range(len(jobs)) if k not in found]
        costs = cost or [1.0] * len(jobs)
        begin, said, total, spent = working_time(), 0.0, sum(costs[k] for k in waiting), 0.0
        how = (self.workers, self.comm) if after is None else (1, None)
        try:
            for group in [waiting] if after is None else [[k] for k in waiting]:
                chosen = [jobs[k] for k in group]
                if after is not None:
                    before = found.get(group[0] - 1)
                    if group[0] and (before is None or isinstance(before, Exception)):
                        break
                    chosen = [after(chosen[0], before)]
                tasks = [
                    _Task(function, job, files[k]) for job, k in zip(chosen, group, strict=True)
                ]
                for n, result in run_jobs(_compute, tasks, _silent, *how):
                    found[group[n]], now = result, clock.perf_counter()
                    spent += costs[group[n]]
                    if now - said >= self.interval or len(found) == len(jobs):
                        said, left = now, time_left(working_time() - begin, spent / total)
                        place = f"{len(found)} of {counted(len(jobs), self.noun)}"
                        log.info(f"  {place}: {say(group[n], result)}; {left}")
        except KeyboardInterrupt:
            self.interrupted = True
            missing = (k for k in waiting if k not in found)
            found |= {k: one for k in missing for one in self._kept(files[k])}
        return found

    def _file(self, text: str) -> Path | None:
        """The file that keeps the result that a text determines."""
        name = hashlib.sha256(text.encode()).hexdigest()[:16]
        return None if self.folder is None else self.folder.resolve() / f"{name}.npz"

    def _kept(self, file: Path | None) -> list[Any]:
        """The result that a file keeps, in a list; a damaged file is as good as none."""
        if file is None or not file.exists():
            return []
        try:
            with read_archive(file, "a result of a study", FORMAT) as (header, arrays):
                return [unpack(header["tree"], arrays, self.classes)]
        except SceneError as error:
            log.info(f"{error}; it is computed again")
            return []


def _silent(number: int, fraction: float, line: str) -> None:
    """The lines of progress are written where the results arrive."""


def _compute(task: _Task) -> Any:
    """Compute a job, and keep its result."""
    result = task.function(task.job)
    if task.file is not None:
        tree, arrays = pack(result)
        write_archive(task.file, {"format": FORMAT, "tree": tree}, arrays)
    return result
