"""The one-step schemes, and the state of a time integration with its record."""

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array, zeros
from fenicsrom.online.contact.state import ContactScratch, ContactState, contact_scratch


class Scheme(NamedTuple):
    """The weights of a one-step scheme, as in `fenicsrom.online.run.march`.

    Attributes:
        alpha_m: weight am of the old acceleration.
        alpha_f: weight af of the old velocity, load and friction.
        beta: Newmark's beta.
        gamma: Newmark's gamma.
        discrete_gradient: elastic and contact forces are means along the step.
        start_weight: weight of the elastic force at the start of the step.
        points: (g,) points in [0, 1] along the step at which the elastic force is evaluated.
        weights: (g,) their weights.
        damping: alpha of the model, 1/s.
        linear: one iteration solves the step: the force is linear and Newton's method exact.
        velocity_forces: the model has forces D v.
        quadratic: Newton's method is exact and converges quadratically; otherwise the model keeps
            a factor for several iterations, which converge linearly.
        all_points: every step solves for all contact points, whose solutions the model keeps with
            its factor; otherwise only for those that may touch.
    """

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    discrete_gradient: bool
    start_weight: float
    points: Array
    weights: Array
    damping: float
    linear: bool
    velocity_forces: bool
    quadratic: bool
    all_points: bool


def scheme(name: str, model: Any, spectral_radius: float = 0.8) -> Scheme:
    """The scheme of this name for a model.

    Args:
        name: "average-acceleration", "generalised-alpha" or "discrete-gradient".
        model: gives the damping, whether it is linear, and the number of Gauss points that
            integrate its force exactly.
        spectral_radius: spectral radius of generalised-alpha at infinite frequency, in [0, 1].
    """
    model_is = (
        float(model.damping),
        bool(model.linear and model.exact_newton),
        bool(model.velocity_forces),
        bool(model.exact_newton),
        not model.exact_newton,
    )
    end = np.ones(1)
    if name == "average-acceleration":
        return Scheme(0.0, 0.0, 0.25, 0.5, False, 0.0, end, end, *model_is)
    if name == "generalised-alpha":
        am = (2.0 * spectral_radius - 1.0) / (spectral_radius + 1.0)
        af = spectral_radius / (spectral_radius + 1.0)
        beta, gamma = 0.25 * (1.0 - am + af) ** 2, 0.5 - am + af
        return Scheme(am, af, beta, gamma, False, af, end, np.array([1.0 - af]), *model_is)
    if name == "discrete-gradient":
        points, weights = np.polynomial.legendre.leggauss(model.gauss_points)
        return Scheme(0.5, 0.5, 0.25, 0.5, True, 0.0, 0.5 + 0.5 * points, 0.5 * weights, *model_is)
    raise ValueError(
        f"scheme {name!r}: must be average-acceleration, generalised-alpha or discrete-gradient"
    )


class Control(NamedTuple):
    """How the step is chosen.

    Attributes:
        grid: the run stops on multiples of this time after `origin`, s; the step never exceeds it.
        tolerance: for adaptive steps: the local error of a step is at most
            `online.step.step.STEP_SHARE` of it, relative to the size of the motion; 0 for a
            fixed step.
        size: lower bound of the size of the motion in relative errors, in the mass norm.
        times: (k,) ascending times in place of the grid, s; none where the grid is equidistant.
    """

    grid: float
    tolerance: float
    size: float
    times: Array = np.zeros(0)


SCALARS = 14
(
    TIME,
    STEP,
    LAST_STEP,
    WORK,
    DAMPING_DISSIPATION,
    FRICTION_DISSIPATION,
    KINETIC,
    ELASTIC,
    CONTACT,
    ENERGY_SCALE,
    SIZE,
    STEPS,
    REJECTED,
    ITERATIONS,
) = range(SCALARS)


class Trial(NamedTuple):
    """The step that is being tried.

    Attributes:
        dq: (n,) the step.
        change: (n,) its last change in the iteration; after acceptance, the new velocity.
        residual: (n,) of the equations of motion.
        inertia_offset: (n,) M times this is the part of the inertia and damping forces that does
            not depend on dq.
        external_force: (n,) mean load, N.
        vector: (n,) scratch argument of the model's operations.
        contact: the contact points at the end of the step.
        free_displacement: (P, d) their displacement without contact forces, m.
        scratch: scratch arrays of the contact problem; they hold the mean contact force over the
            step.
    """

    dq: Annotated[Array, "n"]
    change: Annotated[Array, "n"]
    residual: Annotated[Array, "n"]
    inertia_offset: Annotated[Array, "n"]
    external_force: Annotated[Array, "n"]
    vector: Annotated[Array, "n"]
    contact: ContactState
    free_displacement: Annotated[Array, "P d"]
    scratch: ContactScratch


class State(NamedTuple):
    """The last accepted state; only the acceptance of a step writes to it (except for `trial`).

    Attributes:
        q: (n,) displacement coordinates.
        v: (n,) velocity.
        a: (n,) acceleration of the scheme.
        mean_velocity: (n,) dq/h of the last step.
        mean_acceleration: (n,) rate at which the mean velocity changed from the step before. The
            next step is extrapolated from both mean values; the distance of its solution from this
            extrapolation estimates the error.
        elastic_force: (n,) elastic force at q, N.
        load_vector: (n,) load vector at the time, N.
        contact: the contact points.
        friction_dissipation: (P,) energy dissipated by friction at each point, J.
        scalars: (SCALARS,) time, next step, last step, work of the loads and of moving surfaces,
            energies dissipated by damping and friction, kinetic, elastic and contact energy,
            energy and displacement scales of the run, counts of steps, rejected steps and
            iterations.
        trial: scratch of the next step, no part of the state.
    """

    q: Annotated[Array, "n"]
    v: Annotated[Array, "n"]
    a: Annotated[Array, "n"]
    mean_velocity: Annotated[Array, "n"]
    mean_acceleration: Annotated[Array, "n"]
    elastic_force: Annotated[Array, "n"]
    load_vector: Annotated[Array, "n"]
    contact: ContactState
    friction_dissipation: Annotated[Array, "P"]
    scalars: Annotated[Array, "scalars"]
    trial: Trial


class Record(NamedTuple):
    """Arrays (rows, ..) of what is kept of each accepted step.

    Attributes:
        time: (rows,) s.
        displacement: (rows, P, d) of the contact points, m.
        probe: (rows, d) displacement of the probe, m.
        force: (rows, P, d) contact forces [N, T], N.
        mean_force: (rows, P, d) mean contact force of the step, N.
        gap: (rows, P) m.
        blending: (rows, P) weight of the implicit blending in the step.
        friction_dissipation: (rows, P) J.
        state: (rows, P) OPEN, SLIP or STICK.
        energies: (rows, 6) the entries `WORK` to `CONTACT` of the scalars, J.
        turning: (rows, 3) angular momentum about the axis, kg m^2/s, moment of inertia, kg m^2, and
            moment of the loads, N m, at a varying speed; else (rows, 0).
        coordinates: (rows, 3 n) q, v and a, or (rows, 0).
    """

    time: Annotated[Array, "rows"]
    displacement: Annotated[Array, "rows P d"]
    probe: Annotated[Array, "rows d"]
    force: Annotated[Array, "rows P d"]
    mean_force: Annotated[Array, "rows P d"]
    gap: Annotated[Array, "rows P"]
    blending: Annotated[Array, "rows P"]
    friction_dissipation: Annotated[Array, "rows P"]
    state: Annotated[NDArray[np.int8], "rows P"]
    energies: Annotated[Array, "rows 6"]
    turning: Annotated[Array, "rows turning"]
    coordinates: Annotated[Array, "rows width"]

    @property
    def observed(self) -> Array:
        """(rows, P, d) `displacement`, or (rows, 1, d) that of the probe without contact, m."""
        return self.displacement if self.displacement.shape[1] else self.probe[:, None, :]


class PeriodicSearch(NamedTuple):
    """What Newton's method found of the periodic motion to which a run tends.

    Attributes:
        verdict: "stable", "fold", "period doubling" or "torus" of the motion that was found: how
            its stability was lost; "wears" if it wears a layer and thus is no periodic motion;
            "not found" without one.
        tends: whether the run tends to this motion.
        time: when the periodic motion replaced the marched one, s; None if it did not.
        periods: number of periods of the loads in one of the motion.
        marched: periods that were marched before the last attempt.
        iterations: Newton iterations of all attempts.
        residual: relative residual of the last attempt.
        multipliers: (k,) Floquet multipliers, the largest first; empty without a motion.
        free_sliders: number of slider components that are not unique.
        at_yield: whether the motion presses an abradable layer just to its yield stress; the
            verdict then holds for motions that press it less.
        away: distance of the marched state from the motion, relative to it, if the march comes
            nearer to the motion without being seen to tend to it; otherwise infinite.
    """

    verdict: str
    tends: bool
    time: float | None
    periods: int
    marched: int
    iterations: int
    residual: float
    multipliers: NDArray[np.complex128]
    free_sliders: int
    at_yield: bool = False
    away: float = np.inf

    @property
    def accepted(self) -> bool:
        """Whether the periodic motion may replace the marched one."""
        return self.verdict == "stable" and self.tends


class Checkpoint(NamedTuple):
    """The state of a run between two periods or steps, to continue the run bit for bit.

    Attributes:
        state: the state.
        last: rows of the last period (of the motion, if that is known to last several periods of
            the loads), with which the next period is compared to find a steady state; without a
            period the last rows, at most 4096.
        size: lower bound of the size of the motion in relative errors (`Control.size`).
        spans: periods run.
        buckled: as in `Motion`.
        search: what Newton's method found; None before its first attempt.
        worn: (nodes,) worn depths of abradable layers, m; None without layers.
        wearing: whether a layer was worn in the last period.
    """

    state: State
    last: Record
    size: float
    spans: int
    buckled: int
    search: PeriodicSearch | None = None
    worn: Array | None = None
    wearing: bool = False


def no_state(n: int, points: int, dimension: int) -> State:
    """A state of zeros, of n coordinates and P contact points."""
    sizes = {"n": n, "P": points, "d": dimension, "scalars": SCALARS}
    trial = zeros(Trial, {"scratch": contact_scratch(points, dimension)}, **sizes)
    return zeros(State, {"trial": trial}, **sizes)


def no_record(
    rows: int, points: int, dimension: int, width: int = 0, *, varies: bool = False
) -> Record:
    """A record of zeros, of P contact points and coordinates (width,), at a speed that varies."""
    sizes = {"rows": rows, "P": points, "d": dimension, "width": width}
    return zeros(Record, turning=3 if varies else 0, **sizes)


def copied_rows(record: Record, count: int) -> Record:
    """The first rows of a record, copied."""
    return Record._make(array[:count].copy() for array in record)


def joined_rows(pieces: list[Record], counts: list[int]) -> Record:
    """The first rows of several records, joined."""
    return Record._make(
        np.concatenate([array[:count] for array, count in zip(arrays, counts, strict=True)])
        for arrays in zip(*pieces, strict=True)
    )
