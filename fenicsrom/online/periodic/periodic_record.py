"""The whole motion of a periodic motion, with its coordinates."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.shooting import Shooting
from fenicsrom.online.step.loop import DONE
from fenicsrom.online.step.state import Record


def recorded_motion(problem: Problem, z: Array, m: int = 1) -> Motion:
    """One period of a periodic motion.

    Args:
        problem: of a reduced model.
        z: (N,) variables at the start of the period.
        m: number of periods of the loads in one of the motion.

    Raises:
        ConvergenceError: a step did not converge.
    """
    status, end = Shooting(problem, m).map(problem, z, derive=False)
    if status != DONE:
        raise ConvergenceError("the periodic motion was lost when it was recorded")
    return motion_of(end.record, m * problem.period)


def motion_of(record: Record, period: float) -> Motion:
    """The motion of the rows of a period, with the start, which equals the end, at their head."""
    rows = Record._make(np.concatenate([array[-1:], array]) for array in record)
    for summed in (rows.time, rows.friction_dissipation, rows.energies[:, :3]):
        summed[0] = 0.0
    return Motion.of_rows(
        rows, rows.coordinates, period=period, steady=True, periods=1, steps=record.time.size
    )
