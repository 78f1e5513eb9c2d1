"""Loads: a place, an action of some size on it, and a history.

The given keys select one kind of action and one kind of history.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from fenicsrom.scene.base import rules
from fenicsrom.scene.base.rules import integer, number
from fenicsrom.scene.base.tables import OneOf, changed, from_keys, table_of
from fenicsrom.scene.keys.places import Place


@dataclass(frozen=True, kw_only=True)
class Directed:
    """An action along a direction.

    Attributes:
        direction: direction, of any length.
    """

    direction: Annotated[tuple[float, ...], rules.direction]


@dataclass(frozen=True, kw_only=True)
class PointForce(Directed):
    """A force at a point, or on the mean displacement of a region.

    Attributes:
        force: force at a point, or on the mean displacement of a region.
    """

    force: Annotated[float, number(unit="N")]


@dataclass(frozen=True, kw_only=True)
class Traction(Directed):
    """A force per area on facets.

    Attributes:
        traction: force per area on facets.
    """

    traction: Annotated[float, number(unit="Pa")]


@dataclass(frozen=True, kw_only=True)
class Pressure:
    """A pressure on facets, along the normal.

    Attributes:
        pressure: pressure on facets, positive into the body.
        follower: whether the pressure acts along the current normal on the current area, as a fluid
            does.
    """

    pressure: Annotated[float, number(unit="Pa")]
    follower: Annotated[bool, rules.flag] = False


@dataclass(frozen=True, kw_only=True)
class Acceleration(Directed):
    """A force per volume: the density times an acceleration.

    Attributes:
        acceleration: acceleration of the whole body, a force per volume (gravity).
    """

    acceleration: Annotated[float, number(unit="m/s²")]


@dataclass(frozen=True, kw_only=True)
class SupportAcceleration(Directed):
    """A translation of all supports, given by its acceleration.

    Attributes:
        support_acceleration: acceleration of all supports together. Displacements are relative to
            the supports.
    """

    support_acceleration: Annotated[float, number(unit="m/s²")]


@dataclass(frozen=True, kw_only=True)
class SupportDisplacement(Directed):
    """A periodic translation of all supports, given by its displacement.

    Attributes:
        support_displacement: displacement of all supports together, with frequency or harmonics.
    """

    support_displacement: Annotated[float, number(unit="m")]


SupportMotion = SupportAcceleration | SupportDisplacement
Action = PointForce | Traction | Pressure | Acceleration | SupportMotion
ACTIONS = OneOf(
    force=PointForce,
    traction=Traction,
    pressure=Pressure,
    acceleration=Acceleration,
    support_acceleration=SupportAcceleration,
    support_displacement=SupportDisplacement,
)

WHOLE_BODY = tuple(
    tag for tag, kind in ACTIONS.tags.items() if issubclass(kind, Acceleration | SupportMotion)
)
"""Keys of the actions on the whole body, which have no place."""


@dataclass(frozen=True, kw_only=True)
class SweepTable:
    """A change of the frequency that starts at t = 0; after the change the frequency is constant.

    Attributes:
        to: last frequency.
        duration: duration of the change.
        kind: change at a constant rate in Hz/s or in octaves/s.
    """

    to: Annotated[float, number(above=0.0, unit="Hz")]
    duration: Annotated[float, number(above=0.0, unit="s")]
    kind: Annotated[str, rules.choice("linear", "logarithmic")] = "linear"


@dataclass(frozen=True, kw_only=True)
class PulseTable:
    """An impact: half a sine, zero before and after it.

    Attributes:
        duration: duration of the impact.
        start: start of the impact.
    """

    duration: Annotated[float, number(above=0.0, unit="s")]
    start: Annotated[float, number(least=0.0, unit="s")] = 0.0


@dataclass(frozen=True, kw_only=True)
class EngineOrder:
    """The key that may replace the frequency of a load.

    Attributes:
        engine_order: multiple of the speed of rotation, in place of the frequency.
    """

    engine_order: Annotated[int, integer(1, 1000)]


class OrderFrequency(float):
    """The frequency, in Hz, of an engine order at a speed of rotation; it remembers the order."""

    order: int

    @classmethod
    def at(cls, order: int, speed_rpm: float) -> OrderFrequency:
        """The frequency of an engine order at a speed in rev/min."""
        found = cls(order * abs(speed_rpm) / 60.0)
        found.order = order
        return found


_HERTZ = number(above=0.0, unit="Hz")


def _read_frequency(value: Any, where: rules.Where) -> Any:
    return value if isinstance(value, OrderFrequency) else _HERTZ(value, where)


Frequency = Annotated[float, replace(_HERTZ, read=_read_frequency), EngineOrder]


@dataclass(frozen=True, kw_only=True)
class Static:
    """A load that is constant in time, a part of the equilibrium."""


@dataclass(frozen=True, kw_only=True)
class Harmonic:
    """A load with the factor sin(2π frequency t + phase).

    Attributes:
        frequency: frequency of the factor sin(2π frequency t + phase); with a sweep, at t = 0.
            Without frequency, pulse and table the load is static.
        phase: phase at t = 0.
    """

    frequency: Frequency
    phase: Annotated[float, number(unit="rad")] = 0.0


@dataclass(frozen=True, kw_only=True)
class Harmonics:
    """A load with the factor Σ amplitude · sin(2π order frequency t + phase).

    Attributes:
        frequency: frequency of order 1.
        harmonics: terms of the factor Σ amplitude · sin(2π order frequency t + phase).
    """

    frequency: Frequency
    harmonics: Annotated[tuple[tuple[int, float, float], ...], rules.harmonics]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A sine with a frequency that changes.

    Attributes:
        frequency: frequency of the factor sin(2π frequency t + phase); with a sweep, at t = 0.
            Without frequency, pulse and table the load is static.
        sweep: change of the frequency.
        phase: phase at t = 0.
    """

    frequency: Frequency
    sweep: Annotated[SweepTable, table_of(SweepTable)]
    phase: Annotated[float, number(unit="rad")] = 0.0


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """An impact.

    Attributes:
        pulse: an impact, half a sine.
    """

    pulse: Annotated[PulseTable, table_of(PulseTable)]


@dataclass(frozen=True, kw_only=True)
class Table:
    """A factor that is given at some times and interpolated linearly between them.

    Attributes:
        table: factor over time: linear between the rows, constant outside.
    """

    table: Annotated[Path | tuple[tuple[float, float], ...], rules.series]

    @property
    def rows(self) -> Sequence[tuple[float, float]]:
        """The rows (time in s, factor) of a scene that was read."""
        if isinstance(self.table, Path):
            raise TypeError(f"{self.table} was not read: make the scene with make_scene")
        return self.table


Oscillation = Harmonic | Harmonics | Sweep
History = Static | Oscillation | Pulse | Table
HISTORIES = OneOf(
    Static, table=Table, pulse=Pulse, sweep=Sweep, harmonics=Harmonics, frequency=Harmonic
)


@dataclass(frozen=True, kw_only=True)
class Load:
    """A load of constant direction: place, action and history.

    Attributes:
        place: where the load acts: a region of facets for a traction or a pressure, None for an
            acceleration and for a motion of the supports.
        action: the kind of the load, and its size.
        history: the factor of the size as a function of time.
    """

    place: Annotated[Place, Place]
    action: Annotated[Action, ACTIONS]
    history: Annotated[History, HISTORIES] = Static()

    @classmethod
    def of(cls, **keys: Any) -> Load:
        """Make a load from its keys in a scene file, such as `force=2.0, frequency=3.2`."""
        return from_keys(cls, keys)

    def changed(self, **keys: Any) -> Load:
        """Give this load with other values of some keys."""
        return changed(self, keys)

    @property
    def kind(self) -> str:
        """The key of the action, such as "force" or "acceleration"."""
        return next(tag for tag, kind in ACTIONS.tags.items() if isinstance(self.action, kind))

    @property
    def size(self) -> float:
        """The size in N, Pa, m/s² or m."""
        return float(getattr(self.action, self.kind))

    @property
    def everywhere(self) -> bool:
        """Whether the load acts on the whole body and therefore has no place."""
        return self.kind in WHOLE_BODY

    @property
    def moves_supports(self) -> bool:
        """Whether the load is a motion of the supports."""
        return isinstance(self.action, SupportMotion)

    @property
    def direction(self) -> tuple[float, ...] | None:
        """The unit vector of the direction; None for a pressure."""
        return None if isinstance(self.action, Pressure) else self.action.direction

    @property
    def follower(self) -> bool:
        """Whether the load is a pressure that follows the deformation."""
        return isinstance(self.action, Pressure) and self.action.follower

    @property
    def frequency(self) -> float | None:
        """The frequency in Hz (at t = 0); None of a load without a frequency."""
        return self.history.frequency if isinstance(self.history, Oscillation) else None

    def at_speed(self, speed_rpm: float) -> Load:
        """Give this load with its engine order, if it has one, at a speed above 0 in rev/min."""
        history = self.history
        if not isinstance(history, Oscillation):
            return self
        if not isinstance(history.frequency, OrderFrequency):
            return self
        frequency = OrderFrequency.at(history.frequency.order, speed_rpm)
        return replace(self, history=replace(history, frequency=frequency))

    def seen_ahead(self, angle: float) -> Load:
        """Give this load as seen by a sector that is ahead by an angle (rad) along the rotation.

        The sector meets the pattern of an engine order earlier. Other loads act alike.
        """
        history, ahead = self.history, self.order * angle
        if isinstance(history, Harmonic):
            history = replace(history, phase=history.phase + ahead)
        if isinstance(history, Harmonics):
            terms = ((k, size, phase + k * ahead) for k, size, phase in history.harmonics)
            history = replace(history, harmonics=tuple(terms))
        return replace(self, history=history)

    @property
    def order(self) -> int:
        """The engine order; 0 of a load without one."""
        return self.frequency.order if isinstance(self.frequency, OrderFrequency) else 0

    @property
    def static(self) -> bool:
        """Whether the load is constant in time."""
        return isinstance(self.history, Static)

    @property
    def transient(self) -> bool:
        """Whether the load varies in time and does not repeat."""
        return isinstance(self.history, Sweep | Pulse | Table)

    def by_acceleration(self) -> Load:
        """Give this load with the acceleration of the supports in place of their displacement.

        The displacement A sin(ω t + φ) has the acceleration −ω² A sin(ω t + φ).
        """
        action, history = self.action, self.history
        if not isinstance(action, SupportDisplacement):
            return self
        assert isinstance(history, Harmonic | Harmonics)
        size = -((2.0 * math.pi * history.frequency) ** 2) * self.size
        if isinstance(history, Harmonics):
            terms = ((order, order**2 * part, phase) for order, part, phase in history.harmonics)
            history = replace(history, harmonics=tuple(terms))
        accelerated = SupportAcceleration(direction=action.direction, support_acceleration=size)
        return replace(self, action=accelerated, history=history)


def with_rows(load: Load, rows: tuple[tuple[float, float], ...]) -> Load:
    """Give a load with the rows of its table in place of the path."""
    return replace(load, history=Table(table=rows))
