"""What a time integration returns, its energy balance, and the file of time histories.

The energy balance of a motion, judged in one place.

The balance of a motion is (Gonzalez 1996, Simo and Tarnow 1992, for schemes that keep it exactly)

    d(t) = [T + V + V_c + D](t) - W(t) - the same at the start,

with kinetic energy T, elastic energy V, energy of the contact springs V_c, energy D dissipated by
damping and friction, and work W of the loads (`online.motion.motion.Motion.imbalance`). The
balance is zero except for the error of the scheme: d > 0 is energy that was created, d < 0 energy
that was lost. Where Newton's method has replaced the marched motion by the periodic one, the state
jumps: each part of the motion (`Motion.parts`) is judged alone, from its own start.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, refuse
from fenicsrom.online.step.state import Checkpoint, PeriodicSearch, Record
from fenicsrom.words import brief, counted

JUMP = "newton_from"
"""The number in `history.npz` that tells when the periodic motion replaced the marched one, s."""

KEYS = {"damping_dissipation": "damped", "friction_dissipation": "rubbed"}
"""The keys in `history.npz` that differ from the names of the attributes."""


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class History:
    """The histories of a motion: ns steps, the start included; P contact points, d dimensions.

    Attributes:
        time: (ns,) s.
        displacement: (ns, P, d) contact displacement in the local frames [normal, tangents], or
            (ns, 1, d) of the probe in global axes where there is no contact, m.
        force: (ns, P, d) contact forces [N, T] acting against the motion, along the normal of the
            current position and the tangents there (the frame of the point turned the shortest
            way), N.
        gap: (ns, P) distance from the surface, negative inside it, m.
        state: (ns, P) -1 open, 0 slip, 1 stick.
        kinetic: (ns,) kinetic energy, J.
        elastic: (ns,) elastic energy from the equilibrium, J.
        contact_energy: (ns,) energy of the contact springs, J.
        work: (ns,) work of the loads, and of surfaces that move, since the start, J.
        damping_dissipation: (ns,) energy dissipated since the start by damping, and by impacts too
            short for the step, J.
        friction_dissipation: (ns,) energy dissipated by friction since the start, J.
        period: period of the motion, s: that of the loads, or several of these if Newton's method
            found a subharmonic motion; None without harmonic load, or if `read_history` got none.
        newton_from: the time at which the periodic motion of Newton's method replaced the marched
            one, s, or None. The record at this time is that of the periodic motion. The sums (work
            and dissipated energies) go on; the state, and with it the stored energy, jumps.
        probe: (ns, d) displacement of the probe in global axes, m; None if it is not known.
    """

    time: Array
    displacement: Array
    force: Array
    gap: Array
    state: NDArray[np.int8]
    kinetic: Array
    elastic: Array
    contact_energy: Array
    work: Array
    damping_dissipation: Array
    friction_dissipation: Array
    period: float | None = None
    newton_from: float | None = None
    probe: Array | None = None

    def last_period(self) -> slice:
        """The steps of the last period, both ends included; without a period all steps."""
        return last_period(self.time, self.period)


HISTORY_ARRAYS: Mapping[str, str] = {
    KEYS.get(field.name, field.name): field.name
    for field in fields(History)
    if field.name not in ("period", JUMP, "probe")
}
"""The arrays of one model in `history.npz`, and the attribute of a `History` that each holds."""


def last_period(time: Array, period: float | None) -> slice:
    """The steps of the last period of a time axis (ns,) in s; all steps if the period is None."""
    if period is None:
        return slice(0, time.size)
    return slice(int(np.searchsorted(time, time[-1] - period * (1.0 + 1e-9))), time.size)


def read_history(path: str | os.PathLike[str], period: float | None = None) -> dict[str, History]:
    """Read the motions that a run wrote to `history.npz`.

    Args:
        path: the file.
        period: period of the motion in s, usually that of the loads, `Scene.period`; with it
            `amplitudes` and `contact_fractions` look at the last period, without it at the whole
            run.

    Returns:
        The motion of each model that ran, by its name ("reduced", "full" or "beam").

    Raises:
        SceneError: the file is missing, damaged, or not a `history.npz`, or the period is not a
            positive number.

    Example:
        The folder is that of `fenicsrom run --from out/beam.npz --output out/beam`.

        >>> import fenicsrom as fr
        >>> motions = fr.read_history("out/beam/history.npz", period=1 / 3.2)
        >>> list(motions), round(fr.amplitudes(motions["reduced"])["tangential"][0], 5)
        (['reduced'], 0.12352)
    """
    path = Path(path)
    if period is not None and not 0.0 < period < np.inf:
        raise refuse(path, f"period = {period}: must be a finite number above 0", ErrorKind.RANGE)
    found = {}
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        for name in [name.removesuffix("_time") for name in arrays if name.endswith("_time")]:
            values: Any = {to: arrays[f"{name}_{key}"] for key, to in HISTORY_ARRAYS.items()}
            jump = arrays.get(f"{name}_{JUMP}")
            newton_from = None if jump is None else float(jump)
            probe = arrays.get(f"{name}_probe")
            found[name] = History(**values, period=period, newton_from=newton_from, probe=probe)
    except Exception as error:  # numpy, zipfile and zlib each raise their own kinds
        why = getattr(error, "strerror", None)  # in the words of the operating system
        reason = why or f"is not a history.npz ({type(error).__name__})"
        raise refuse(path, reason, ErrorKind.FILE if why else ErrorKind.FORMAT) from None
    if not found:
        raise refuse(path, "is not a history.npz: it holds no motion")
    return found


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
        rubbed = rows.friction_dissipation
        numbers["probe"] = rows.probe
        return cls(displacement=rows.observed, point_friction_dissipation=rubbed, **numbers)

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


# Largest imbalance that the time integration accepts, relative to the largest energy plus the
# largest work of the run, by scheme. The discrete gradient keeps the balance to Newton's tolerance;
# a larger imbalance of the other schemes is a sign of instability. Only created energy counts
# against generalised-alpha, which loses some on purpose.
SCHEME_TOLERANCE = {
    "discrete-gradient": 1e-6,
    "average-acceleration": 0.05,
    "generalised-alpha": 0.05,
}
# Largest imbalance of an accepted motion. Created energy is relative to the largest energy, lost
# energy to the largest energy plus the work. The energy that friction gives to the motion has the
# same limit, relative to the dissipated energy.
ENERGY_ERROR = 1e-2
# a gain by friction in one step is rounding if it is smaller, relative to the energies
ROUNDING = 1e-12
# Smaller energies of a motion, relative to that of the contacts, are rounding: bodies that are
# pressed together rest until something drives them.
RESTING = 1e-7


class EnergyErrors(NamedTuple):
    """The energy errors of a motion and the energies to compare them with, J.

    Attributes:
        created: largest excess of the balance.
        lost: largest deficit of the balance.
        energy: largest kinetic plus elastic energy, with `RESTING` times that of the contacts.
        work: largest work of the loads since the first record of the part.
        friction_gain: sum of all negative friction dissipation, with a positive sign.
        largest_friction_gain: the largest gain of one step.
        dissipated: sum of all positive friction dissipation, plus the damping dissipation.
    """

    created: float
    lost: float
    energy: float
    work: float
    friction_gain: float
    largest_friction_gain: float
    dissipated: float


def energy_errors(motion: Motion, part: slice | None = None) -> EnergyErrors:
    """Compute the energy errors of a motion, or of one of its `parts`."""
    part = slice(None) if part is None else part
    imbalance, work = motion.imbalance[part], motion.work[part]
    steps = np.diff(motion.friction_dissipation[part])
    damping_dissipation = motion.damping_dissipation[part]
    damped = float(damping_dissipation[-1] - damping_dissipation[0])
    resting = RESTING * np.abs(motion.contact_energy[part])
    return EnergyErrors(
        created=float(np.max(imbalance)),
        lost=float(np.max(-imbalance)),
        energy=float(np.max(motion.kinetic[part] + np.abs(motion.elastic[part]) + resting)),
        work=float(np.max(np.abs(work - work[0]))),
        friction_gain=-float(np.sum(steps[steps < 0.0])),
        largest_friction_gain=-float(steps.min(initial=0.0)),
        dissipated=float(np.sum(steps[steps > 0.0])) + max(damped, 0.0),  # less is rounding
    )


def check_scheme(motion: Motion, scheme: str) -> None:
    """Refuse a motion that misses the energy balance of its scheme.

    Args:
        motion: the motion.
        scheme: name of the scheme that integrated it.

    Raises:
        AccuracyError: the imbalance exceeds `SCHEME_TOLERANCE`; `partial` holds the motion.
    """
    one_sided = scheme == "generalised-alpha"
    allowed = SCHEME_TOLERANCE[scheme]
    for part in motion.parts:
        found = energy_errors(motion, part)
        size = found.energy + found.work
        off = found.created if one_sided else max(found.created, found.lost)
        if off > allowed * size:
            other = "" if scheme == "discrete-gradient" else " or the discrete gradient"
            raise AccuracyError(
                f"time integration: the energy ledger is off by {100.0 * off / size:.3g} % of the "
                f"energy and work, more than {100.0 * allowed:.3g} % (scheme {scheme}, "
                f"{counted(motion.steps, 'step')}): take shorter steps{other}",
                motion,
                kind=ErrorKind.ENERGY,
            )


def attempted(
    march: Callable[[], Motion],
) -> tuple[Motion, AccuracyError | ConvergenceError | None]:
    """The motion of a march, up to its failure if there was one, and the failure.

    Raises:
        AccuracyError, ConvergenceError: the march failed before its first step.
    """
    try:
        return march(), None
    except (AccuracyError, ConvergenceError) as error:
        if not isinstance(error.partial, Motion):
            raise
        return error.partial, error


def check_energy(motion: Motion) -> None:
    """Refuse a motion whose energy balance is off by more than `ENERGY_ERROR`.

    Created energy is compared with the largest energy of the motion, because it may become all of
    it. Lost energy is compared with the largest energy plus the work of the loads, because it acts
    as additional damping. Friction must not give energy to the motion.

    Raises:
        AccuracyError: the balance is off, or friction gives energy.
    """
    for part in motion.parts:
        _check_part(energy_errors(motion, part))


def _check_part(found: EnergyErrors) -> None:
    """`check_energy` for one part of a motion."""
    both = found.energy + found.work
    for off, size, name, verb in (
        (found.created, found.energy, "largest energy", "is created"),
        (found.lost, both, "largest energy and the work of the loads", "is lost"),
    ):
        if not off <= ENERGY_ERROR * size:
            relative = off / size if size > 0.0 else np.inf
            raise AccuracyError(
                f"the energy ledger is off: {relative:.1e} of the {name} {verb} "
                f"(at most {ENERGY_ERROR:g} is allowed): the steps are too long for the scheme",
                kind=ErrorKind.ENERGY,
            )
    if found.friction_gain > ENERGY_ERROR * found.dissipated + ROUNDING * found.energy:
        part = (
            f"{found.friction_gain / found.dissipated:.1e} of the dissipated energy"
            if found.dissipated > 0.0
            else "although nothing is dissipated"
        )
        raise AccuracyError(
            f"friction gives energy to the motion, {part} (at most {ENERGY_ERROR:g} is allowed): "
            "the steps are too long for the stiffness of the contact",
            kind=ErrorKind.ENERGY,
        )


def friction_gains_energy(motion: Motion) -> bool:
    """Whether friction gives energy in any step, beyond rounding.

    The discrete gradient excludes this gain; the other schemes do not.
    """
    spent = float(motion.friction_dissipation[-1])
    every = [energy_errors(motion, part) for part in motion.parts]
    return any(one.largest_friction_gain > ROUNDING * (one.energy + spent) for one in every)
