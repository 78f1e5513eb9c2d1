"""What a time integration returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.motion.history import last_period
from fenicsrom.online.step.state import Checkpoint, PeriodicSearch
from fenicsrom.words import brief


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
    "time",
    "period",
    "displacement",
    "force",
    "coordinates",
    "steady",
    "steps",
    "newton_iterations",
    "search",
)
@dataclass(frozen=True, eq=False, repr=False)
class Motion:
    """A motion in time: ns accepted steps, the start included; P contact points in d dimensions.

    Attributes:
        time: (ns,) s.
        period: period of the motion, s: that of the loads, or several of these if Newton's method
            found a subharmonic motion; None without harmonic load.
        displacement: (ns, P, d) contact displacement in the local frames [normal, tangents], or
            (ns, 1, d) of the probe in global axes where there is no contact, m.
        force: (ns, P, d) contact forces [N, T] acting against the motion, along the normal of the
            current position and the tangents there (the frame of the point turned the shortest
            way), N.
        mean_force: (ns, P, d) mean contact force over the step that ended there, in the frames of
            the points, N.
        gap: (ns, P) distance from the surface, negative inside it, m.
        state: (ns, P) -1 open, 0 slip, 1 stick.
        kinetic: (ns,) kinetic energy, J.
        elastic: (ns,) elastic energy from the equilibrium, J.
        contact_energy: (ns,) energy of the contact springs, J.
        work: (ns,) work of the loads, and of surfaces that move, since the start, J.
        damping_dissipation: (ns,) energy dissipated since the start by damping, and by impacts too
        short for the step, J.
        friction_dissipation: (ns,) energy dissipated by friction since the start, J.
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
    """

    time: Array
    period: float | None
    displacement: Array
    force: Array
    mean_force: Array
    gap: Array
    state: NDArray[np.int8]
    kinetic: Array
    elastic: Array
    contact_energy: Array
    work: Array
    damping_dissipation: Array
    friction_dissipation: Array
    point_friction_dissipation: Array
    steady: bool
    periods: int
    steps: int
    rejected: int
    newton_iterations: int
    seconds: float
    coordinates: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    coordinate_time: Array | None = None
    end: Checkpoint | None = None
    buckled: int = 0
    search: PeriodicSearch | None = None

    @property
    def newton_from(self) -> float | None:
        """The time at which the periodic motion replaced the marched one, s, or None.

        The record at this time is that of the periodic motion. The sums (work and dissipated
        energies) go on; the state, and with it the stored energy, jumps.
        """
        return self.search.time if self.search is not None else None

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
        return np.concatenate(
            [
                energy[part] - energy[part.start] + spent[part] - spent[part.start]
                for part in self.parts
            ]
        )

    @property
    def relative_imbalance(self) -> float:
        """Largest imbalance relative to the largest kinetic plus elastic energy of the run."""
        scale = np.max(self.kinetic + np.abs(self.elastic))
        return float(np.max(np.abs(self.imbalance)) / scale) if scale > 0.0 else 0.0

    def last_period(self) -> slice:
        """The steps of the last period, both ends included; all steps without a period."""
        return last_period(self.time, self.period)
