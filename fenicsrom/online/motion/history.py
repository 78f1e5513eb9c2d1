"""Read the motions of a `history.npz`, the file of time histories that a run writes."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.words import brief

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
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception as error:  # numpy, zipfile and zlib each raise their own kinds
        why = getattr(error, "strerror", None)  # in the words of the operating system
        reason = why or f"is not a history.npz ({type(error).__name__})"
        raise refuse(path, reason, ErrorKind.FILE if why else ErrorKind.FORMAT) from None
    names = [name.removesuffix("_time") for name in arrays if name.endswith("_time")]
    if not names:
        raise refuse(path, "is not a history.npz: it holds no motion", ErrorKind.FORMAT)
    found = {}
    for name in names:
        for key in HISTORY_ARRAYS:
            if f"{name}_{key}" not in arrays:
                raise refuse(path, f"the array {name}_{key} is missing", ErrorKind.FORMAT)
        values: dict[str, Any] = {to: arrays[f"{name}_{key}"] for key, to in HISTORY_ARRAYS.items()}
        jump = arrays.get(f"{name}_{JUMP}")
        newton_from = None if jump is None else float(jump)
        probe = arrays.get(f"{name}_probe")
        found[name] = History(**values, period=period, newton_from=newton_from, probe=probe)
    return found
