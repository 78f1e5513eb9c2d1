"""How fast the loads, the approaching surfaces and the waves of surfaces excite a scene.

A step that is not much shorter than an excitation misses the excitation, or samples it at its
zeros. With ten steps in the shortest period, the check with twice the step has five. Both numbers
are above two, so neither run mistakes a fast load for a slow one.

A table, of a load or of the approach of a surface, has no period. Its swings take the place of half
periods. A swing leads up and down again (or down and up); the width of a swing is that at half of
its height. A sine in a table has swings of half a period.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from fenicsrom.scene.keys import loads
from fenicsrom.scene.keys.contacts import Surface, surface_spin
from fenicsrom.scene.keys.rotation import Rotation
from fenicsrom.scene.keys.schema import Scene

SMALL_SWING = 1e-3
"""Swings of a table below this part of its range are noise: they change the load by less."""

ON_STEP = 1e-6
"""A row lies at the end of a step if it is at most this part of a step away: rounding."""

HIGHEST_MODE = 2.0
"""With basis.modes = "auto", all modes up to this multiple of the highest frequency are kept."""

LARGE_SWING = 0.1
"""Swings of a table above this part of its range determine the highest frequency."""

Rows = Sequence[Sequence[float]]


class Excitation(NamedTuple):
    """Something that moves the body.

    Attributes:
        key: the key of the scene that describes it.
        period: its shortest period, s.
    """

    key: str
    period: float


def excitations(scene: Scene) -> Iterator[Excitation]:
    """Yield what moves the body of a scene whose tables were read.

    At a speed of rotation that varies, they are those at the speed that asks most of the steps: the
    largest one, or the smallest one for steps of equal angles.

    A load table does not count if each of its rows lies at the end of a fixed step. Such steps miss
    no row, and the mean of a load over a step is exact. The check with twice the step skips every
    second row, so that the error estimate shows what the rows change.
    """
    step = scene.time.step
    if scene.rotation is not None and scene.rotation.history:
        speeds = [speed for _, speed in scene.rotation.history]
        by_angle = scene.time.steps_per_revolution is not None
        scene = scene.at_speed(min(speeds) if by_angle else max(speeds))
    for index, load in enumerate(scene.loads):
        if (
            isinstance(load.history, loads.Table)
            and step
            and _at_ends_of_steps(load.history.rows, step)
        ):
            continue
        if load.size != 0.0 and not isinstance(load.history, loads.Static):
            key = f"loads[{index}]{'.table' if isinstance(load.history, loads.Table) else ''}"
            yield Excitation(key, shortest_period(load))
    for index, contact in enumerate(scene.contacts):
        key = f"contacts[{index}]"
        if contact.approach:
            yield Excitation(f"{key}.approach", 2.0 * shortest_swing(contact.approach))
        if contact.surface is not None and contact.surface.waves:
            period = _wave_period(contact.surface, scene.rotation)
            yield Excitation(f"{key}.surface.waves", period)


def _at_ends_of_steps(rows: Rows, step: float) -> bool:
    """Whether the times of a table are multiples of a step."""
    return all(abs(math.remainder(time, step)) < ON_STEP * step for time, _ in rows)


def shortest_period(load: loads.Load, small: float = SMALL_SWING) -> float:
    """The shortest period of a load in s: twice an impact, or twice the shortest swing of a table.

    It is infinite for a load that does not swing.
    """
    match load.history:
        case loads.Harmonic(frequency=frequency):
            return 1.0 / frequency
        case loads.Harmonics(frequency=frequency, harmonics=terms):
            orders = [order for order, amplitude, _ in terms if amplitude != 0.0]
            return 1.0 / (frequency * max(orders)) if orders else math.inf
        case loads.Sweep(frequency=frequency, sweep=sweep):
            return 1.0 / max(frequency, sweep.to)
        case loads.Pulse(pulse=pulse):
            return 2.0 * pulse.duration
        case loads.Table() as history:
            return 2.0 * shortest_swing(history.rows, small)
    return math.inf


def highest_frequency(scene: Scene) -> float:
    """The highest frequency in Hz that a scene excites; 0 if nothing oscillates.

    Most of the spectrum of an impact of duration D lies below 1/D. Of a table, only the swings
    above `LARGE_SWING` of its range count. A response curve over the frequency changes all
    frequencies in proportion. Contacts excite higher frequencies, but the static modes follow the
    contact forces without inertia.
    """
    found = [0.0]
    for load in scene.loads:
        if load.size != 0.0:
            faster = 2.0 if isinstance(load.history, loads.Pulse) else 1.0
            found.append(faster / shortest_period(load, LARGE_SWING))
    for contact in scene.contacts:
        if contact.approach:
            found.append(0.5 / shortest_swing(contact.approach, LARGE_SWING))
        if contact.surface is not None and contact.surface.waves:
            found.append(1.0 / _wave_period(contact.surface, scene.rotation))
    scale, response = 1.0, scene.response
    if response is not None and response.parameter == "frequency" and scene.period is not None:
        scale = max(response.high * scene.period, 1.0)
    return scale * max(found)


def _wave_period(surface: Surface, rotation: Rotation | None) -> float:
    """The time in which the shortest wave of a surface passes a point of the body, s."""
    orders = [order for order, height, _ in surface.waves if height != 0.0]
    rate = abs(surface_spin(surface, rotation)) * max(orders, default=0.0)
    return 2.0 * math.pi / rate if rate > 0.0 else math.inf


def shortest_swing(rows: Rows, small: float = SMALL_SWING) -> float:
    """The shortest width, at half height, of the swings of a table; infinite without a swing.

    Args:
        rows: times in s, ascending, and values.
        small: swings below this part of the range of the values do not count.
    """
    values = [value for _, value in rows]
    turns = _turns(values, small * (max(values) - min(values)))
    widths = (
        _half_width(rows, *turns[k - 1 : k + 2])  # the turn before, the turn, the turn after
        for k in range(1, len(turns) - 1)
    )
    return min(widths, default=math.inf)


def _turns(values: Sequence[float], small: float) -> list[int]:
    """The rows in which values turn round, with both ends; smaller turns do not count."""
    turns: list[int] = []
    way, low, high = 0, 0, 0  # 1 upwards, -1 downwards; the extremes since the last turn
    for k, value in enumerate(values):
        if value > values[high]:
            high = k
        if value < values[low]:
            low = k
        if way >= 0 and values[high] - value > small:
            turns.append(high)
            way, low = -1, k
        elif way <= 0 and value - values[low] > small:
            turns.append(low)
            way, high = 1, k
    if turns:
        turns.append(high if way > 0 else low)
    return turns


def _half_width(rows: Rows, before: int, turn: int, after: int) -> float:
    """The width at half height of the swing whose extreme is the row `turn`."""

    def crossing(steps: range, end: int) -> float:
        level = 0.5 * (rows[turn][1] + rows[end][1])
        for k in steps:
            (inner, near), (outer, far) = rows[k], rows[k + steps.step]
            if (near - level) * (far - level) <= 0.0 and near != far:
                return inner + (outer - inner) * (near - level) / (near - far)
        return rows[end][0]

    return crossing(range(turn, after), after) - crossing(range(turn, before, -1), before)


def excited_orders(scene: Scene) -> tuple[int, ...]:
    """The engine orders of loads, and the multiples of the orders of waves, up to `map.orders`."""
    top = scene.map.orders
    found = {
        multiple
        for contact in scene.contacts
        if contact.surface is not None
        for order, height, _ in contact.surface.waves
        if height
        for multiple in range(int(order), top + 1, int(order))
    }
    for load in scene.loads:
        if isinstance(load.frequency, loads.OrderFrequency):
            terms = getattr(load.history, "harmonics", ((1, 1.0, 0.0),))
            found |= {load.frequency.order * order for order, part, _ in terms if part}
    return tuple(sorted(order for order in found if order <= top))
