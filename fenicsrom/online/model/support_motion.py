"""Supports that move together. The displacement of a body is relative to its supports.

With the absolute displacement u + r a(t), where r is the unit translation along a, the equation of
motion of the relative displacement u is

    M ü + C u̇ + f(u) = p - M r a″(t).    (1)

It is exact: strains and stresses depend on u only. Damping acts on the velocity relative to the
supports, and everything that the body touches (springs to the ground, rigid surfaces) moves with
the supports. The load vector is -M r, and the time factor is a″.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.turning import NO_HISTORY
from fenicsrom.online.model.loads import LoadHistories, factors, of_loads
from fenicsrom.scene import Harmonic, Harmonics, Load, Pulse, Scene, Sweep, Table
from fenicsrom.scene.keys.excitation import shortest_period
from fenicsrom.scene.keys.loads import SupportDisplacement

QUADRATURE_POINTS = 5
"""Gauss points of an interval: they integrate a tenth of a period to 1e-13 of the amplitude."""

INTERVALS = 10
"""Fewest intervals of the integration in the shortest period of a load."""


def histories_of(loads: Sequence[Load], history: Array = NO_HISTORY) -> LoadHistories:
    """The time factors of loads; that of a motion of the supports is its acceleration, m/s².

    Args:
        loads: the loads.
        history: (k, 3) of the speed of rotation (`online.contact.turning`).
    """
    return of_loads([load.by_acceleration() for load in loads], history)


def support_displacement(loads: Sequence[Load], time: Array, dimension: int) -> Array:
    """The displacement of the supports (k, d), m.

    A motion that is given by a periodic acceleration has no drift: its displacement is periodic
    about zero. Any other motion starts at rest at t = 0.

    Args:
        loads: loads; those that do not move the supports do not count.
        time: (k,) ascending, s.
        dimension: d.
    """
    found = np.zeros((time.size, dimension))
    for load in loads:
        if load.moves_supports:
            found += np.outer(_travel(load, time), np.array(load.direction))
    return found


def moves_supports(scene: Scene) -> bool:
    """Whether a load of the scene moves the supports."""
    return any(load.moves_supports for load in scene.loads)


def displacement_sines(loads: Sequence[Load]) -> NDArray[np.bool_]:
    """Which sines (s,) of the load histories belong to a given displacement of the supports.

    The amplitudes of these sines are accelerations, which grow with the square of the frequency.
    """
    spans = histories_of(loads).spans
    given = [isinstance(load.action, SupportDisplacement) for load in loads]
    return np.repeat(np.array(given, dtype=bool), spans[:, 1] - spans[:, 0])


def _travel(load: Load, time: Array) -> Array:
    """The displacement (k,) of the supports by one load, m."""
    size, history = load.size, load.history
    if isinstance(history, Harmonic | Harmonics):
        terms = [(1, 1.0, history.phase)] if isinstance(history, Harmonic) else history.harmonics
        omega = 2.0 * math.pi * history.frequency
        found = np.zeros_like(time)
        for order, part, phase in terms:
            wave = size * part * np.sin(order * omega * time + phase)
            given = isinstance(load.action, SupportDisplacement)
            found += wave if given else -wave / (order * omega) ** 2
        return found
    return _integrated_twice(load, time)


def _integrated_twice(load: Load, time: Array) -> Array:
    """The displacement (k,) of an acceleration that starts at rest at t = 0, m."""
    histories, end = of_loads([load]), float(time[-1])
    count = math.ceil(INTERVALS * end / shortest_period(load)) + 1
    kinks = np.array(_kinks(load))
    grid = np.unique(np.concatenate([[0.0], time, np.linspace(0.0, end, count + 1), kinks]))
    grid = grid[(grid >= 0.0) & (grid <= end)]
    lengths = np.diff(grid)
    points, doubled = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)
    nodes, weights = 0.5 * (points + 1.0), 0.5 * doubled  # of the interval from 0 to 1
    instants = grid[:-1, None] + lengths[:, None] * nodes
    values = np.array([factors(histories, t)[0] for t in instants.ravel()]).reshape(instants.shape)
    gained = lengths * (values @ weights)
    velocity = np.concatenate([[0.0], np.cumsum(gained)])
    moved = lengths * velocity[:-1] + lengths**2 * (values @ (weights * (1.0 - nodes)))
    return np.interp(time, grid, np.concatenate([[0.0], np.cumsum(moved)]))


def _kinks(load: Load) -> list[float]:
    """The times at which the history of a load is not smooth, s."""
    match load.history:
        case Table() as history:
            return [row[0] for row in history.rows]
        case Pulse(pulse=pulse):
            return [pulse.start, pulse.start + pulse.duration]
        case Sweep(sweep=sweep):
            return [sweep.duration]
    return []
