"""The whole motion of a periodic motion, with its coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.families import Problem
from fenicsrom.online.periodic.shooting import Shooting
from fenicsrom.online.step.loop import DONE
from fenicsrom.online.step.state import Record


def recorded_motion(problem: Problem, settings: Any, z: Array, m: int = 1) -> Motion:
    """One period of a periodic motion.

    Args:
        problem: the data of the motion.
        settings: scheme, spectral radius and steps per period: a `fenicsrom.scene.Time`.
        z: (N,) variables at the start of the period.
        m: number of periods of the loads in one of the motion.

    Raises:
        ConvergenceError: a step did not converge.
    """
    shooting = Shooting(problem.model, problem.contacts, settings, problem.period, m)
    status, end = shooting.map(problem.model, problem.contacts, problem.period, z, derive=False)
    if status != DONE:
        raise ConvergenceError("the periodic motion was lost when it was recorded")
    return _motion(_with_start(end.record), m * problem.period)


def motion_of(record: Record, period: float) -> Motion:
    """The motion of the rows of a period that Newton's method ended with."""
    return _motion(_with_start(record), period)


def _with_start(record: Record) -> Record:
    """The rows with the start of the period, which equals its end, at their head."""
    rows = Record._make(np.concatenate([array[-1:], array]) for array in record)
    for summed in (rows.time, rows.friction_dissipation, rows.energies[:, :3]):
        summed[0] = 0.0
    return rows


def _motion(record: Record, period: float) -> Motion:
    """The motion of the rows of a period."""
    work, damping, friction, kinetic, elastic, contact = record.energies.T
    displacement = record.displacement
    if displacement.shape[1] == 0:
        displacement = record.probe[:, None, :]
    steps = record.time.size - 1
    coordinates, velocity, acceleration = np.split(record.coordinates, 3, axis=1)
    return Motion(
        time=record.time,
        period=period,
        displacement=displacement,
        force=record.force,
        mean_force=record.mean_force,
        gap=record.gap,
        state=record.state,
        kinetic=kinetic,
        elastic=elastic,
        contact_energy=contact,
        work=work,
        damping_dissipation=damping,
        friction_dissipation=friction,
        point_friction_dissipation=record.friction_dissipation,
        steady=True,
        periods=1,
        steps=steps,
        rejected=0,
        newton_iterations=0,
        seconds=0.0,
        coordinates=coordinates,
        velocity=velocity,
        acceleration=acceleration,
        coordinate_time=record.time,
    )
