"""Modes of a disk by nodal diameter, and the engine orders that excite them.

With N sectors, a stationary pattern of engine order k is seen by the turning blades as waves with

    h = k mod N, running backward, or h = N − (k mod N), running forward,                 (1)

whichever is at most N/2: only modes with this number of nodal diameters and this direction respond.
Source: Singh et al., Proc. 17th Turbomachinery Symposium, 1988 (SAFE diagram).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.rotating_modes import hermitian, modes_at_speed
from fenicsrom.reduction.modes import close_frequency_groups

if TYPE_CHECKING:
    from fenicsrom.fem.solid.disk import Disk, Wave

COINCIDENT = 1e-7
"""Relative distance of frequencies below which waves of both directions are told apart by shape."""

OF_A_PAIR = 0.4
"""Part of the mass of a mode that goes one way, if the mode is one or half of a standing pair."""

LETTERS = {1: "f", -1: "b", 0: ""}
"""Of modes that run forward, with the rotation, or backward."""

MOST_DIAMETERS = 13
"""Number of nodal diameters unless the scene gives them."""

JUDGED = 3
"""Number of nodal diameters whose frequencies finer elements judge."""


class WaveMode(NamedTuple):
    """A mode of a disk.

    Attributes:
        sectors: number of sectors of the disk.
        diameter: nodal diameter h.
        number: number among the modes of this diameter and direction, from 1.
        direction: 1 if it runs with the rotation, -1 if against it, 0 if either way is alike.
        lag: the displacements of sector j are those of sector 0 times e^{i lag h 2π j/N}.
    """

    sectors: int
    diameter: int
    number: int
    direction: int
    lag: int

    @property
    def label(self) -> str:
        """A name such as "3: 2b", the second mode of 3 nodal diameters, which runs backward."""
        return f"{self.diameter}: {self.number}{LETTERS[self.direction]}"

    def meets(self, order: int) -> bool:
        """Whether an engine order excites the mode: (1)."""
        h, way, rest = self.diameter, self.direction, order % self.sectors
        return (rest == h and way <= 0) or (-order % self.sectors == h and way >= 0)


def diameters_of(scene: Any) -> tuple[int, ...]:
    """The nodal diameters of a scene with [cyclic]."""
    most = min(scene.cyclic.sectors // 2 + 1, MOST_DIAMETERS)
    return tuple(sorted(set(scene.cyclic.diameters or range(most))))


def judged_diameters(diameters: tuple[int, ...]) -> tuple[int, ...]:
    """The first, the middle and the last of some nodal diameters."""
    places = np.linspace(0, len(diameters) - 1, min(JUDGED, len(diameters))).round().astype(int)
    return tuple(diameters[k] for k in places)


def wave_modes(wave: Wave, count: int) -> tuple[Array, NDArray[Any], float]:
    """The lowest modes of one nodal diameter, which go one way each.

    Without the Coriolis force those of both ways are alike, and the ones of z₊ are given.

    Args:
        wave: the wave.
        count: number of modes.

    Returns:
        omega^2 (count,), ascending, shapes (own, count) of unit modal mass, and the last relative
        change of the frequencies with the Coriolis force.

    Raises:
        ConvergenceError, AccuracyError: the modes were not found.
    """
    if not wave.double:
        return modes_at_speed(wave, count)
    both = wave.gyroscopic is not None
    squares, shapes, change = modes_at_speed(wave, min(count if both else 2 * count, wave.free))
    found: list[tuple[float, NDArray[Any]]] = []
    for group in close_frequency_groups(np.sqrt(np.abs(squares)), COINCIDENT):
        for part in wave.parts(shapes[:, group])[: 1 + both]:
            sizes, turn = scipy.linalg.eigh(hermitian(wave, part, part))
            found += [
                (float(squares[group].mean()), part @ turn[:, k] / np.sqrt(sizes[k]))
                for k in np.flatnonzero(sizes > OF_A_PAIR)
            ]
    found = sorted(found, key=lambda mode: mode[0])[:count]
    return np.array([mode[0] for mode in found]), np.stack([mode[1] for mode in found], 1), change


def counts(disk: Disk, count: int) -> list[int]:
    """The number of modes of each nodal diameter: twice as many if the two ways are told apart."""
    return [count * (1 + (wave.double and wave.gyroscopic is not None)) for wave in disk.waves]


def disk_modes(disk: Disk, count: int) -> tuple[Array, NDArray[Any], float]:
    """The lowest modes of each nodal diameter, one diameter after another.

    Args:
        disk: the disk.
        count: number of modes of each nodal diameter and way.

    Returns:
        omega^2 (m,), shapes (own, m) and a change as `wave_modes`, whose errors these are.
    """
    pairs = zip(disk.waves, counts(disk, count), strict=True)
    parts = [wave_modes(wave, number) for wave, number in pairs]
    shapes = scipy.linalg.block_diag(*(part[1] for part in parts))
    return np.concatenate([part[0] for part in parts]), shapes, max(part[2] for part in parts)


def lowest(disk: Disk, count: int, more: int) -> NDArray[np.int64]:
    """The places of the `count` lowest modes of each diameter among `disk_modes` of `more`."""
    sizes = counts(disk, more)
    first = np.cumsum([0, *sizes[:-1]])
    pairs = zip(first, counts(disk, count), strict=True)
    return np.concatenate([begin + np.arange(number) for begin, number in pairs])


def waves_of(disk: Disk, shapes: NDArray[Any], count: int, sense: float) -> tuple[WaveMode, ...]:
    """Which waves the modes of `disk_modes` are.

    Args:
        disk: the disk.
        shapes: (own, m) their shapes.
        count: number of modes of each nodal diameter and way.
        sense: above 0 if the disk turns in the sense in which the sectors are counted, below 0 if
            against it, 0 if the modes have no direction.
    """
    assert disk.sector.cut is not None
    found: list[WaveMode] = []
    begin = 0
    for wave, place, number in zip(disk.waves, disk.places, counts(disk, count), strict=True):
        parts = wave.parts(shapes[place, begin : begin + number].astype(complex))
        behind, ahead = (np.diag(hermitian(wave, part, part)).real for part in parts)
        lags = [-1 if forward else 1 for forward in ahead > behind]
        ways = [-int(np.sign(sense)) * lag * wave.double for lag in lags]
        for k, (way, lag) in enumerate(zip(ways, lags, strict=True)):
            nth = ways[: k + 1].count(way)
            found.append(WaveMode(disk.sector.cut.sectors, wave.h, nth, way, lag))
        begin += number
    return tuple(found)
