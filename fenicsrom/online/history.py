"""Read the motions of a `history.npz`, the file of time histories that a run writes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError

HISTORY_ARRAYS: Mapping[str, str] = {
    **{key: key for key in ("time", "displacement", "force", "gap", "state")},
    **{key: key for key in ("kinetic", "elastic", "contact_energy", "work")},
    "damped": "damping_dissipation",
    "rubbed": "friction_dissipation",
}
"""The arrays of one model in `history.npz`, and the attribute of a `Motion` that each holds."""

JUMP = "newton_from"
"""The number in `history.npz` that tells when the periodic motion replaced the marched one, s."""


@dataclass(frozen=True, eq=False)
class History:
    """The part of a `Motion` that `history.npz` stores: ns steps, P contact points, d dimensions.

    Attributes:
        time: (ns,) s.
        displacement: (ns, P, d) contact displacement in the local frames [normal, tangents], or
            (ns, 1, d) displacement of the probe in global axes without contact, m.
        force: (ns, P, d) contact force [normal, tangents], N.
        gap: (ns, P) distance from the surface, negative inside it, m.
        state: (ns, P) -1 open, 0 slip, 1 stick.
        kinetic: (ns,) kinetic energy, J.
        elastic: (ns,) elastic energy, zero at the equilibrium, J.
        contact_energy: (ns,) energy of the contact springs, J.
        work: (ns,) work of the loads and of moving surfaces since the start, J.
        damping_dissipation: (ns,) energy dissipated by damping since the start, J.
        friction_dissipation: (ns,) energy dissipated by friction since the start, J.
        period: period of the motion, s, as given to `read_history`; None for the whole run.
        newton_from: the time at which Newton's method replaced the marched motion by the periodic
            one, s; the state jumps there. None where it did not.
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

    def last_period(self) -> slice:
        """The steps of the last period, both ends included; all steps without a period."""
        return last_period(self.time, self.period)


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
        The motion of each model that ran, by its name: "reduced", "full", "beam".

    Raises:
        SceneError: the file is missing, damaged, or not a `history.npz`.
    """
    path = Path(path)

    def refuse(reason: str, kind: ErrorKind) -> SceneError:
        return SceneError(f"{path}: {reason}", kind=kind, source=str(path))

    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise refuse("no such file", ErrorKind.FILE) from None
    except Exception as error:  # numpy, zipfile and zlib each raise their own kinds
        reason = f"is not a history.npz ({type(error).__name__})"
        raise refuse(reason, ErrorKind.FORMAT) from None
    names = [name.removesuffix("_time") for name in arrays if name.endswith("_time")]
    try:
        return {
            name: History(
                **{attribute: arrays[f"{name}_{key}"] for key, attribute in HISTORY_ARRAYS.items()},
                period=period,
                newton_from=float(arrays[f"{name}_{JUMP}"]) if f"{name}_{JUMP}" in arrays else None,
            )
            for name in names
        }
    except KeyError as error:
        reason = f"the array {error} is missing; the file is damaged"
        raise refuse(reason, ErrorKind.FORMAT) from None
