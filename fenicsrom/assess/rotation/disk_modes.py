"""Modes of a disk by nodal diameter, and the engine orders that excite them.

With N sectors, a stationary pattern of engine order k is seen by the turning blades as waves with

    h = k mod N, running backward, or h = N − (k mod N), running forward,                 (1)

whichever is at most N/2: only modes with this number of nodal diameters and this direction respond.
Source: Singh et al., Proc. 17th Turbomachinery Symposium, 1988 (SAFE diagram).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.rotating_modes import Shapes, hermitian, modes_at_speed
from fenicsrom.reduction.modes import close_frequency_groups

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.fem.solid.wave import Wave

COINCIDENT = 1e-7
"""Relative distance of frequencies below which waves of both directions are told apart by shape."""

OF_A_PAIR = 0.4
"""Part of the mass of a mode that goes one way, if the mode is one or half of a standing pair."""

LETTERS = {1: "f", -1: "b", 0: ""}
"""Of modes that run forward, with the rotation, or backward."""


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


def directions(sector: Solid, h: int) -> int:
    """How many directions of a wave with h nodal diameters have frequencies of their own."""
    assert sector.cut is not None
    return 1 if sector.gyroscopic is None or sector.cut.is_real(h) else 2


def wave_modes(wave: Wave, count: int) -> tuple[Array, Shapes, float]:
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
    found: list[tuple[float, Shapes]] = []
    for group in close_frequency_groups(np.sqrt(np.abs(squares)), COINCIDENT):
        for part in wave.parts(shapes[:, group])[: 1 + both]:
            sizes, turn = scipy.linalg.eigh(hermitian(wave, part, part))
            found += [
                (float(squares[group].mean()), part @ turn[:, k] / np.sqrt(sizes[k]))
                for k in np.flatnonzero(sizes > OF_A_PAIR)
            ]
    found = sorted(found, key=lambda mode: mode[0])[:count]
    return np.array([mode[0] for mode in found]), np.stack([mode[1] for mode in found], 1), change


def waves_of(
    sector: Solid,
    shapes: Sequence[tuple[int, Shapes]],
    sense: float,
    displacements: Callable[[int, Shapes], Shapes],
) -> tuple[tuple[WaveMode, ...], Shapes]:
    """Which waves some modes are, and their displacements.

    Args:
        sector: the sector of the disk.
        shapes: nodal diameters, and the shapes (own, m) of modes of `wave_modes`.
        sense: above 0 if the disk turns in the sense in which the sectors are counted, below 0 if
            against it, 0 if the modes have no direction.
        displacements: of the shapes of a nodal diameter, as `CutFaces.displacements`.

    Returns:
        The waves, and their complex amplitudes (local, all modes) in the sector.
    """
    assert sector.cut is not None
    found: list[WaveMode] = []
    amplitudes = []
    for h, z in shapes:
        real = sector.cut.is_real(h)
        lags = np.ones(z.shape[1], int) if real else lags_of(z, sector.comm)
        ways = [0 if real else -int(np.sign(sense)) * int(lag) for lag in lags]
        for k, (way, lag) in enumerate(zip(ways, lags, strict=True)):
            number = ways[: k + 1].count(way)
            found.append(WaveMode(sector.cut.sectors, h, number, way, int(lag)))
        amplitudes.append(displacements(h, z))
    return tuple(found), np.concatenate(amplitudes, axis=1)


def lags_of(z: Shapes, comm: Any) -> NDArray[np.int64]:
    """The sign (k,) of the lag of waves (own, k) that go one way: b = ∓ i a of z₊ and z₋."""
    turned = np.sum(z[::2].conj() * z[1::2], axis=0).imag
    return np.where(comm.allreduce(turned) < 0.0, 1, -1)
