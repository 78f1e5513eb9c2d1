"""The angle of a body whose speed of rotation varies.

The speed Ω(t) is linear between the rows of a table and constant after its last row. The angle
θ(t) = ∫ Ω dt is exact. Whatever turns uses θ(t): surfaces, sliders, wear and engine orders. An
engine order of the form sin(n Ω(t) t) would have the wrong frequency n (Ω + t dΩ/dt).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compiled import part

NO_HISTORY = np.zeros((0, 3))
"""The history of a body that turns at a constant speed."""


def speed_history(rows: ArrayLike) -> Array:
    """The history (k, 3) of rows (k, 2) of times in s, the first one 0, and speeds in rad/s.

    Its columns are the times, the speeds Ω and the angles θ in rad.
    """
    time, speed = np.asarray(rows, dtype=np.float64).reshape(-1, 2).T
    turned = np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))
    return np.column_stack([time, speed, np.concatenate([np.zeros(time.size)[:1], turned])])


def history_of(rotation: Any) -> Array:
    """The history (k, 3) of the [rotation] of a scene, or none."""
    if rotation is None or not rotation.history:
        return NO_HISTORY
    return speed_history(np.array(rotation.history) * [1.0, np.pi / 30.0])


def times_of_angles(history: Array, angle: float, end: float) -> Array:
    """The times (k,) in s between 0 and `end` at which θ is a multiple of an angle in rad.

    Multiples at a corner of the speed are left out.
    """
    found = []
    for row in range(len(history)):
        begin, speed, turned = map(float, history[row])
        until = min(end, history[row + 1, 0]) if row + 1 < len(history) else end
        if until <= begin:
            break
        first, last = np.array([turned, angle_at(history, until)]) / angle
        x = angle * np.arange(np.floor(first) + 1.0, np.ceil(last)) - turned
        growth = growth_after(history, row)
        found.append(begin + 2.0 * x / (speed + np.sqrt(speed**2 + 2.0 * growth * x)))
    return np.concatenate(found)


@part
def row_before(history: Array, time: float) -> int:
    """The last row of a history that is not after a time in s; the first one at least."""
    low, high = 0, history.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if history[middle, 0] <= time:
            low = middle
        else:
            high = middle
    return low


@part
def growth_after(history: Array, row: int) -> float:
    """dΩ/dt after a row of a history, rad/s²."""
    if row + 1 == history.shape[0]:
        return 0.0
    return (history[row + 1, 1] - history[row, 1]) / (history[row + 1, 0] - history[row, 0])


@part
def speed_at(history: Array, time: float) -> float:
    """Ω of a history at a time in s, rad/s."""
    row = row_before(history, time)
    return history[row, 1] + growth_after(history, row) * (time - history[row, 0])


@part
def angle_at(history: Array, time: float) -> float:
    """θ of a history at a time in s, rad."""
    row = row_before(history, time)
    x = time - history[row, 0]
    return history[row, 2] + (history[row, 1] + 0.5 * growth_after(history, row) * x) * x
