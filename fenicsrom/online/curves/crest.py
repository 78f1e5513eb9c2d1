"""Amplitudes between the samples of a period.

The largest of some samples jumps as the crest moves between them. A parabola through the largest
sample and its neighbours gives a smooth amplitude, with an error of fourth order in the step.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array


def half_range(time: Array, values: Array) -> Array:
    """Half of peak-to-peak (d,) of a periodic motion.

    Args:
        time: (rows,) ascending instants after the start of the period, the last at its end, s.
        values: (rows, d).
    """
    return np.array([0.5 * (_crest(time, column) + _crest(time, -column)) for column in values.T])


def _crest(time: Array, values: Array) -> float:
    """Largest value of the parabola through the largest sample and its neighbours."""
    rows = values.size
    k = int(np.argmax(values))
    near = np.array([k - 1, k, k + 1])
    y = values[near % rows]
    t = time[near % rows] + time[-1] * (near // rows)
    if rows < 3:
        return float(y[1])
    before, after = np.diff(y) / np.diff(t)
    curvature = (after - before) / (t[2] - t[0])
    slope = before + curvature * (t[1] - t[0])
    return float(y[1] - (0.25 * slope**2 / curvature if curvature < 0.0 else 0.0))
