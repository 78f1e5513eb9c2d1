"""The table [statics]: a path of static equilibria over a load factor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fenicsrom.scene.base.rules import integer, list_of, number


@dataclass(frozen=True, kw_only=True)
class Statics:
    """The equilibrium path of `fenicsrom statics`.

    Attributes:
        last: load factor at which the path ends. The factor multiplies the static loads.
        lowest: load factor below zero at which the path ends too; by default minus `last`.
        displacement: displacement of the probe at which the path ends; by default no displacement
            ends the path.
        points: largest number of points.
        loads: numbers of the static loads that the factor multiplies, from 0, such as [1] for
            loads.1; the other static loads are constant. By default it multiplies all of them.
    """

    last: Annotated[float, number(above=0.0)] = 1.0
    lowest: Annotated[float | None, number(most=0.0)] = None
    displacement: Annotated[float | None, number(above=0.0, unit="m")] = None
    points: Annotated[int, integer(2, 100_000)] = 500
    loads: Annotated[tuple[int, ...] | None, list_of(integer(0, 1000), least=1)] = None
