"""What a time integration returns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.motion.history import History
from fenicsrom.online.step.state import Checkpoint, PeriodicSearch, Record
from fenicsrom.words import brief

ENERGIES = (
    *("work", "damping_dissipation", "friction_dissipation"),
    *("kinetic", "elastic", "contact_energy"),
)
"""The energies of a `Record`, in their order."""

SAME = ("time", "force", "mean_force", "gap", "state", "turning")
"""What a `Record` holds under the name that it has in a `Motion`."""


class Interrupted(KeyboardInterrupt):
    """A time integration was asked to stop.

    Attributes:
        partial: the `Motion` up to the interruption.
    """

    def __init__(self, partial: Motion):
        """Store the motion up to the interruption."""
        super().__init__(f"time integration stopped on request at t = {partial.time[-1]:.6g} s")
        self.partial = partial


@brief(
    *("time", "period", "displacement", "force", "coordinates"),
    *("steady", "steps", "newton_iterations", "search"),
)
@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Motion(History):
    """A motion in time with its record: ns steps, the start included; P contact points.

    Attributes:
        mean_force: (ns, P, d) mean contact force over the step that ended there, in the frames of
            the points, N.
        point_friction_dissipation: (ns, P) energy dissipated by friction at each contact point, J.
        steady: whether the motion was found to repeat.
        periods: number of periods of the loads that were run.
        steps: accepted steps.
        rejected: rejected steps.
        newton_iterations: number of iterations of all steps, rejected steps included.
        seconds: run time of the integration with Newton's method, compilation excluded.
        coordinates: (k, n) coordinates q of the last period, if they were requested.
        velocity: (k, n) their velocities in the scheme.
        acceleration: (k, n) their accelerations in the scheme (zero for the discrete gradient,
            which does not use them).
        coordinate_time: (k,) their times, s.
        end: the checkpoint at the end of the motion, to continue from.
        buckled: number of directions in which the nearest equilibrium was unstable; the motion then
            started in another one.
        search: what Newton's method found of the periodic motion; None if it was not tried.
        turning: (ns, 3) angular momentum about the axis, kg m²/s, moment of inertia, kg m², and
            moment of the loads, N m, at a varying speed of rotation; else (ns, 0).
    """

    mean_force: Array
    point_friction_dissipation: Array
    steady: bool
    periods: int
    steps: int
    rejected: int = 0
    newton_iterations: int = 0
    seconds: float = 0.0
    coordinates: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    coordinate_time: Array | None = None
    end: Checkpoint | None = None
    buckled: int = 0
    search: PeriodicSearch | None = None
    turning: Array | None = None

    @classmethod
    def of_rows(cls, rows: Record, coordinates: Array, **numbers: Any) -> Motion:
        """The motion of the rows of a time integration.

        Args:
            rows: all rows.
            coordinates: (k, 3 n) q, v and a of the last rows; empty if they were not kept.
            numbers: the other attributes.
        """
        numbers |= dict(zip(ENERGIES, rows.energies.T, strict=True))
        numbers |= {name: getattr(rows, name) for name in SAME}
        if coordinates.size:
            q, v, a = np.split(coordinates, 3, axis=1)
            numbers |= {"coordinates": q, "velocity": v, "acceleration": a}
            numbers["coordinate_time"] = rows.time[-len(q) :]
        found = rows.displacement if rows.displacement.shape[1] else rows.probe[:, None, :]
        rubbed = rows.friction_dissipation
        numbers["probe"] = rows.probe
        return cls(displacement=found, point_friction_dissipation=rubbed, **numbers)

    def at_probe(self) -> Motion | None:
        """The motion of the probe without the contact points; None if it is not known."""
        if self.probe is None:
            return None
        contact = ("force", "mean_force", "gap", "state", "point_friction_dissipation")
        nothing = {name: getattr(self, name)[:, :0] for name in contact}
        return replace(self, displacement=self.probe[:, None, :], **nothing)

    @property
    def load_period(self) -> float | None:
        """The period of the loads, s; None without harmonic load."""
        if self.period is None or self.search is None or self.search.time is None:
            return self.period
        return self.period / self.search.periods

    @property
    def parts(self) -> tuple[slice, ...]:
        """The steps that were integrated without a jump: one part, or two around `newton_from`."""
        whole = slice(0, self.time.size)
        if self.newton_from is None:
            return (whole,)
        jump = int(np.searchsorted(self.time, self.newton_from * (1.0 - 1e-12)))
        parts = slice(0, jump), slice(jump, self.time.size)
        return tuple(part for part in parts if part.start < part.stop) or (whole,)

    @property
    def imbalance(self) -> Array:
        """(ns,) the energy ledger: energy + dissipated - work - initial, J.

        It is zero except for the error of the scheme. Each of the `parts` starts at zero.
        """
        energy = self.kinetic + self.elastic + self.contact_energy
        spent = self.damping_dissipation + self.friction_dissipation - self.work
        pairs = ((energy[part] - energy[part.start], spent[part]) for part in self.parts)
        return np.concatenate([stored + lost - lost[0] for stored, lost in pairs])

    @property
    def relative_imbalance(self) -> float:
        """Largest imbalance relative to the largest kinetic plus elastic energy of the run."""
        scale = np.max(self.kinetic + np.abs(self.elastic))
        return float(np.max(np.abs(self.imbalance)) / scale) if scale > 0.0 else 0.0
