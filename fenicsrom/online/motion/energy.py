"""The energy balance of a motion, judged in one place.

The balance of a motion is (Gonzalez 1996, Simo and Tarnow 1992, for schemes that keep it exactly)

    d(t) = [T + V + V_c + D](t) - W(t) - the same at the start,

with kinetic energy T, elastic energy V, energy of the contact springs V_c, energy D dissipated by
damping and friction, and work W of the loads (`online.motion.motion.Motion.imbalance`). The
balance is zero except for the error of the scheme: d > 0 is energy that was created, d < 0 energy
that was lost. Where Newton's method has replaced the marched motion by the periodic one, the state
jumps: each part of the motion (`Motion.parts`) is judged alone, from its own start.
"""

from typing import NamedTuple

import numpy as np

from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.motion.motion import Motion
from fenicsrom.words import counted

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


class EnergyErrors(NamedTuple):
    """The energy errors of a motion and the energies to compare them with, J.

    Attributes:
        created: largest excess of the balance.
        lost: largest deficit of the balance.
        energy: largest kinetic plus elastic energy.
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
    return EnergyErrors(
        created=float(np.max(imbalance)),
        lost=float(np.max(-imbalance)),
        energy=float(np.max(motion.kinetic[part] + np.abs(motion.elastic[part]))),
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
    if found.friction_gain > ENERGY_ERROR * found.dissipated:
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
