"""Coordinate systems of a Nastran file: CORD1 and CORD2, rectangular, cylindrical or spherical."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.mesh_file import Floats
from fenicsrom.formats.nastran_cards import Card

KINDS = {f"CORD{form}{kind}" for form in "12" for kind in "RCS"}
"""Names of the entries."""


@dataclass(eq=False)
class Systems:
    """Gives the coordinates of grid points in the basic system.

    Attributes:
        path: the file, for messages.
        grids: system and coordinates of each grid point by its number.
        entries: entry of each system by its number; one CORD1 entry may define two systems.
    """

    path: Path
    grids: dict[int, tuple[int, tuple[float, float, float]]]
    entries: dict[int, tuple[str, list[int] | Card]]
    _frames: dict[int, tuple[str, Floats, Floats]] = field(default_factory=dict)

    def basic(self, system: int, place: tuple[float, float, float]) -> Floats:
        """The coordinates (3,) in the basic system of a place in a system.

        Raises:
            SceneError: the file does not define the coordinate system.
        """
        if system == 0:
            return np.array(place)
        kind, origin, axes = self._frame(system)
        a, b, c = place
        if kind == "C":
            a, b, c = a * np.cos(np.radians(b)), a * np.sin(np.radians(b)), c
        elif kind == "S":
            polar, turn = np.radians(b), np.radians(c)
            a, b, c = a * np.array(
                [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)]
            )
        return origin + np.array([a, b, c]) @ axes

    def axes(self, system: int, place: Floats | None) -> Floats:
        """The axes (3, 3), as rows in the basic system, along which components at a place are.

        Raises:
            ValueError: they depend on the place, which is None.
            SceneError: the file does not define the coordinate system.
        """
        kind, origin, frame = self._frame(system)
        if kind == "R":
            return frame
        if place is None:
            raise ValueError(f"the axes of the coordinate system {system} depend on the place")
        x, y, z = (place - origin) @ frame.T
        turn, polar = np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)
        c, s = np.cos(turn), np.sin(turn)
        around, out = np.array([-s, c, 0.0]), np.array([c, s, 0.0])
        up = np.array([0.0, 0.0, 1.0])
        if kind == "C":
            return np.asarray(np.array([out, around, up]) @ frame)
        radial = np.sin(polar) * out + np.cos(polar) * up
        down = np.cos(polar) * out - np.sin(polar) * up
        return np.asarray(np.array([radial, down, around]) @ frame)

    def _frame(self, system: int) -> tuple[str, Floats, Floats]:
        """Kind, origin (3,) and axes (3, 3), as rows, of a system."""
        if system in self._frames:
            return self._frames[system]
        if system not in self.entries:
            raise refuse(self.path, f"the coordinate system {system} is not in the file")
        name, given = self.entries[system]
        if isinstance(given, Card):
            below = given.integer(1)
            values = [given.real(k) for k in range(2, 11)]
            rows = [self.basic(below, (values[k], values[k + 1], values[k + 2])) for k in (0, 3, 6)]
        else:
            rows = [self._grid(number) for number in given]
        origin, z = rows[0], rows[1] - rows[0]
        y = np.cross(z, rows[2] - origin)
        if not np.linalg.norm(z) > 0.0 or not np.linalg.norm(y) > 0.0:
            raise refuse(self.path, f"the points of the coordinate system {system} lie on one line")
        z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
        self._frames[system] = (name[-1], origin, np.array([np.cross(y, z), y, z]))
        return self._frames[system]

    def _grid(self, number: int) -> Floats:
        """The coordinates (3,) in the basic system of a grid point."""
        if number not in self.grids:
            raise refuse(self.path, f"a coordinate system refers to GRID {number}, not in the file")
        return self.basic(*self.grids[number])


def read_systems(cards: list[Card]) -> dict[int, tuple[str, list[int] | Card]]:
    """The entries of the coordinate systems by number."""
    found: dict[int, tuple[str, list[int] | Card]] = {}
    for card in cards:
        if card.name.startswith("CORD2"):
            found[card.integer(0)] = (card.name, card)
        elif card.name in KINDS:
            for first in (0, 4):
                if card.text(first):
                    grids = [card.integer(first + k) for k in (1, 2, 3)]
                    found[card.integer(first)] = (card.name, grids)
    return found
