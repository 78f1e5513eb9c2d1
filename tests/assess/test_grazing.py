"""Contact events that the time steps of a curve do not resolve."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from motions import curve_point

from fenicsrom.assess.curves.stability_search import resolved_events
from fenicsrom.online.curves.curve import Curve, CurvePoint, Extremes

STEPS, RANGE = 200, 50.0
SHARE = (2.0 * np.pi / STEPS) ** 2  # of the range of the normal force that is not resolved


def motion(parameter: float, force: float, kind: str = "", contact: int = -1) -> CurvePoint:
    """A motion whose largest trial normal force is given; nothing else matters."""
    extremes = Extremes(np.array([force]), np.array([RANGE - force]), np.zeros(1))
    return curve_point(parameter, extremes=extremes, kind=kind, contact=contact)


def curve_of(force: Callable[[float], float]) -> Curve:
    """A curve from 0 to 1 with the touches that a force (of the parameter) has."""
    points = [motion(p, force(p)) for p in np.linspace(0.0, 1.0, 41)]
    curve = Curve(points)
    for a, b in pairwise(points):
        before, after = a.extremes.touch[0], b.extremes.touch[0]
        if before * after < 0.0:
            where = a.parameter + (b.parameter - a.parameter) * before / (before - after)
            curve.special.append(
                motion(where, 0.0, "first touch" if after > 0.0 else "last touch", 0)
            )
    return curve


def kept(curve: Curve) -> list[str]:
    return [point.kind for point in resolved_events(curve, STEPS)]


@pytest.mark.parametrize(("sign", "left"), [(1.0, []), (-1.0, ["first touch"])])
def test_touch_that_seems_to_come_and_go_leaves_one_event_at_most(
    sign: float, left: list[str]
) -> None:
    """The force swings about zero by less than a step resolves, an even or odd number of times."""
    turns = 3.0 if sign > 0.0 else 2.5
    curve = curve_of(
        lambda p: sign * 0.9 * SHARE * RANGE * np.cos(2.0 * np.pi * (turns * p + 0.001))
    )
    assert len(curve.special) in (5, 6)
    assert kept(curve) == left


def test_touch_that_the_steps_resolve_keeps_its_events() -> None:
    curve = curve_of(lambda p: 1.1 * SHARE * RANGE * np.cos(2.0 * np.pi * 3.0 * (p + 0.001)))
    assert kept(curve) == ["last touch", "first touch"] * 3


def test_touch_that_lasts_after_grazing_keeps_its_beginning() -> None:
    """The force swings, and then grows: only the last event is a touch that lasts."""

    def force(p: float) -> float:
        swing = -0.5 * SHARE * RANGE * np.cos(2.0 * np.pi * 5.0 * (p + 0.001))
        return float(swing + max(p - 0.5, 0.0) * RANGE)

    curve = curve_of(force)
    assert len(curve.special) > 2
    assert kept(curve) == ["first touch"]
    assert resolved_events(curve, STEPS)[0] is curve.special[-1]


def test_other_special_points_stay() -> None:
    curve = curve_of(lambda p: 1.0)
    curve.special = [motion(0.5, 1.0, "fold")]
    assert resolved_events(curve, STEPS) == curve.special
