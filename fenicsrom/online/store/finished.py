"""A finished motion in a checkpoint, of which a continued run repeats only the checks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.state import Checkpoint

PREFIX = "motion_"
ENERGIES = ("kinetic", "elastic", "contact_energy", "work")
DISSIPATED = ("damping_dissipation", "friction_dissipation")
LAST_ROWS = ("coordinates", "velocity", "acceleration")
COUNTS = ("periods", "steps", "rejected", "newton_iterations")


def motion_header(motion: Motion) -> dict[str, Any]:
    """The numbers of a motion that are no arrays, as plain data."""
    numbers = {name: getattr(motion, name) for name in COUNTS}
    return {
        "steady": motion.steady,
        "period": motion.period,
        "seconds": motion.seconds,
        **numbers,
    }


def motion_arrays(motion: Motion) -> dict[str, Array]:
    """The arrays of a motion that kept its coordinates, by their names in a file."""
    names = _shapes(0, 0, 0, 0, 0)
    return {f"{PREFIX}{name}": np.asarray(getattr(motion, name)) for name in names}


def finished_motion(
    header: Mapping[str, Any], arrays: Mapping[str, Any], end: Checkpoint
) -> Motion:
    """The motion of a file.

    Args:
        header: its numbers, of `motion_header`.
        arrays: the arrays of the file.
        end: the checkpoint at the end of the motion.

    Raises:
        KeyError, TypeError, ValueError: the file is damaged; the error names what is wrong.
    """
    points, d = end.state.contact.x.shape
    rows, last = (arrays[f"{PREFIX}{name}"].size for name in ("time", "coordinate_time"))
    found: dict[str, Any] = {}
    for name, shape in _shapes(rows, last, points, d, end.state.q.size).items():
        array = arrays[f"{PREFIX}{name}"]
        kind = np.int8 if name == "state" else np.float64
        if array.shape != shape or array.dtype != kind or not np.all(np.isfinite(array)):
            raise ValueError(f"{PREFIX}{name} is not {shape} of finite {np.dtype(kind)}")
        found[name] = array
    if found["time"].size == 0 or found["time"][-1] != end.last.time[-1]:
        raise ValueError("the motion and the checkpoint end at different times")
    found |= {name: int(header[name]) for name in COUNTS}
    return Motion(
        **found,
        period=None if header["period"] is None else float(header["period"]),
        steady=bool(header["steady"]),
        seconds=float(header["seconds"]),
        end=end,
        buckled=end.buckled,
        search=end.search,
    )


def _shapes(rows: int, last: int, points: int, d: int, n: int) -> dict[str, tuple[int, ...]]:
    """The shapes of the arrays of a motion; its attributes have these names."""
    return {
        "time": (rows,),
        "displacement": (rows, points or 1, d),
        "force": (rows, points, d),
        "mean_force": (rows, points, d),
        "gap": (rows, points),
        "state": (rows, points),
        "point_friction_dissipation": (rows, points),
        **dict.fromkeys((*ENERGIES, *DISSIPATED), (rows,)),
        **dict.fromkeys(LAST_ROWS, (last, n)),
        "coordinate_time": (last,),
    }
