"""The tables [rotation] and [cyclic]: the speed of a body, and a disk of equal sectors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import (
    Rule,
    Where,
    array,
    either,
    flag,
    integer,
    list_of,
    number,
    rows_of,
)
from fenicsrom.scene.base.tables import read_table, table_of


@dataclass(frozen=True, kw_only=True)
class Range:
    """Equally spaced values.

    Attributes:
        first: first value.
        last: last value.
        number: number of values.
    """

    first: Annotated[float, number(least=0.0, unit="rev/min")]
    last: Annotated[float, number(above=0.0, unit="rev/min")]
    number: Annotated[int, integer(2, 10_000)]


def _read_speeds(value: Any, where: Where) -> tuple[float, ...]:
    """Give ascending speeds from a list or from a table of first, last and number."""
    if isinstance(value, Mapping):
        span = read_table(Range, value, where)
        if span.last <= span.first:
            raise where.at("last").refuse(span.last, f"must be above first, {span.first:g}")
        step = (span.last - span.first) / (span.number - 1)
        return (*(span.first + k * step for k in range(span.number - 1)), span.last)
    if not rules.is_sequence(value) or len(value) < 2:
        allowed = "must be a list of at least two speeds, or a table of first, last and number"
        raise where.refuse(value, allowed, ErrorKind.TYPE)
    speeds = tuple(number(least=0.0)(entry, where.at(index)) for index, entry in enumerate(value))
    for index in range(1, len(speeds)):
        if speeds[index] <= speeds[index - 1]:
            allowed = f"must be above the previous speed, {speeds[index - 1]:g}"
            raise where.at(index).refuse(value[index], allowed)
    return speeds


SPEEDS = Rule(
    _read_speeds,
    {"oneOf": [array({"type": "number", "minimum": 0}, 2), {"kind": Range}]},
    "ascending list of numbers, or { first, last, number }",
    "rev/min",
)


@dataclass(frozen=True, kw_only=True)
class Rotation:
    """A rotation about a fixed axis.

    The scene, its loads and its surfaces are described in the frame that turns with the body.

    Attributes:
        speed_rpm: speed, positive about the axis; a run with `history` ignores it.
        axis: axis in 3D, of any length.
        point: a point of the axis. Default: the origin.
        coriolis: whether the Coriolis force acts.
        speeds_rpm: speeds for the basis of one model for a range of speeds, two or three as a rule.
            Default: one model for `speed_rpm`.
        history: speeds of a run over time, linear between the rows, constant after the last one,
            inside `speeds_rpm`.
    """

    speed_rpm: Annotated[float, number(unit="rev/min")]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    point: Annotated[tuple[float, ...] | None, rules.point] = None
    coriolis: Annotated[bool, flag] = False
    speeds_rpm: Annotated[tuple[float, ...] | None, SPEEDS] = None
    history: Annotated[
        tuple[tuple[float, ...], ...], rows_of("time", "speed", unit="s, rev/min")
    ] = ()

    @property
    def omega(self) -> float:
        """Angular velocity in rad/s."""
        return math.pi / 30.0 * self.speed_rpm


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Random differences between the sectors of a disk.

    Attributes:
        deviation: standard deviation of the relative changes of stiffness.
        seed: seed of the random numbers.
    """

    deviation: Annotated[float, number(least=0.0, below=0.3)]
    seed: Annotated[int, integer(0, 2**31 - 1)] = 0


@dataclass(frozen=True, kw_only=True)
class Cyclic:
    """A disk of which the mesh is one sector.

    Loads, contacts, supports and attachments are in every sector alike, turned with it.

    Attributes:
        sectors: number of sectors of the disk.
        left: group of facets of one cut face.
        right: group of facets of the other cut face: the left one turned by 360°/sectors.
        axis: axis of the disk in 3D, of any length. Default: that of [rotation].
        point: a point of the axis. Default: that of [rotation], or the origin.
        diameters: nodal diameters. Default: 0 to 12, or to half the number of sectors.
        mistuning: relative changes of the stiffness of all sectors in a run, or their deviation and
            seed. Default: none.
    """

    sectors: Annotated[int, integer(3, 1000)]
    left: Annotated[str, rules.name]
    right: Annotated[str, rules.name]
    axis: Annotated[tuple[float, ...] | None, rules.direction] = None
    point: Annotated[tuple[float, ...] | None, rules.point] = None
    diameters: Annotated[tuple[int, ...] | None, list_of(integer(0, 500))] = None
    mistuning: Annotated[
        tuple[float, ...] | Deviation | None,
        either(list_of(number(above=-1.0), distinct=False), table_of(Deviation)),
    ] = None

    @property
    def waves(self) -> tuple[int, ...]:
        """The nodal diameters whose modes are wanted, ascending."""
        return tuple(sorted(set(self.diameters or range(min(self.sectors // 2, 12) + 1))))
