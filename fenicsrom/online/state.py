"""The state of a time integration, its record and its checkpoint."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact_state import (
    ContactScratch,
    ContactState,
    contact_scratch,
    zero_contact_state,
)

# the scalars of a state
(
    TIME,
    STEP,
    LAST,
    WORK,
    DAMPED,
    RUBBED,
    KINETIC,
    ELASTIC,
    CONTACT,
    SCALE,
    SIZE,
    STEPS,
    REJECTED,
    ITERATIONS,
) = range(14)
SCALARS = 14


class Trial(NamedTuple):
    """The step that is being tried.

    Attributes:
        dq: (n,) the step.
        change: (n,) its last change in the iteration; then the new velocity.
        residual: (n,) of the equations of motion.
        rest: (n,) M times this is the part of the inertia and damping forces that does not depend
        on dq.
        push: (n,) mean load.
        total: (n,) a sum to be handed on.
        touch: the contact points at the end of the step.
        before: (P, d) their displacement before the iteration.
        free: (P, d) their displacement without contact forces.
        room: for the contact problem; holds the mean contact force over the step.
    """

    dq: Array
    change: Array
    residual: Array
    rest: Array
    push: Array
    total: Array
    touch: ContactState
    before: Array
    free: Array
    room: ContactScratch


class State(NamedTuple):
    """The last accepted state; only acceptance of a step writes to it (but for `trial`).

    Attributes:
        q: (n,) displacement coordinates.
        v: (n,) velocity.
        a: (n,) acceleration of the scheme.
        rate: (n,) mean velocity dq/h over the last step.
        growth: (n,) how that changed from the step before, per time: together they extrapolate to
            the next step, and the distance of the solution from that extrapolation estimates the
            error.
        start: (n,) elastic force at q, where the scheme asks for it.
        load: (n,) load vector at the time.
        touch: the contact points.
        friction_dissipation: (P,) energy that each has dissipated by friction, J.
        scalars: time, next step, last step, work of the loads and of moving surfaces, energies
            dissipated by damping and friction, kinetic, elastic and contact energy, energy and
            displacement scales of the run, counts of steps, rejected steps and iterations.
        trial: the step that is being tried: no part of the state, but room that is needed at every
            step.
    """

    q: Array
    v: Array
    a: Array
    rate: Array
    growth: Array
    start: Array
    load: Array
    touch: ContactState
    friction_dissipation: Array
    scalars: Array
    trial: Trial


class Record(NamedTuple):
    """Room for what is kept of each accepted step: (rows, ..)."""

    time: Array
    displacement: Array
    probe: Array
    force: Array
    mean_force: Array
    gap: Array
    friction_dissipation: Array
    state: NDArray[np.int8]
    energies: Array
    coordinates: Array


class Checkpoint(NamedTuple):
    """Where a run stands between two periods (or, without a period, two steps): all that follows
    depends on, bit for bit.

    Attributes:
        state: the state.
        last: the rows of the last period, by which the next is judged steady; without a period the
        last ones, at most 4096.
        size: of the motion, that errors are measured against (`Control.size`).
        spans: periods run.
        buckled: as in `Motion`.
    """

    state: State
    last: Record
    size: float
    spans: int
    buckled: int


def no_state(n: int, points: int, dimension: int) -> State:
    """A state of zeros, of n coordinates and P contact points."""

    def zeros() -> Array:
        return np.zeros(n)

    trial = Trial(
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zero_contact_state(points, dimension),
        np.zeros((points, dimension)),
        np.zeros((points, dimension)),
        contact_scratch(points, dimension),
    )
    return State(
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zeros(),
        zero_contact_state(points, dimension),
        np.zeros(points),
        np.zeros(SCALARS),
        trial,
    )


def no_record(rows: int, points: int, dimension: int, width: int = 0) -> Record:
    """Room for so many rows, of P contact points and, where they are kept, coordinates (width,)."""
    return Record(
        np.zeros(rows),
        np.zeros((rows, points, dimension)),
        np.zeros((rows, dimension)),
        np.zeros((rows, points, dimension)),
        np.zeros((rows, points, dimension)),
        np.zeros((rows, points)),
        np.zeros((rows, points)),
        np.zeros((rows, points), dtype=np.int8),
        np.zeros((rows, 6)),
        np.zeros((rows, width)),
    )
