"""Where the stability on a curve is compared besides, from sizes of multipliers in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from fenicsrom.assess.curves.stability_search import EXTRA, SHORTEST, divide_gaps, lengths_along
from fenicsrom.online.curves.curve import Piece


@dataclass(eq=False)
class Motion:
    parameter: float
    stable: bool = True
    amplitude: Any = field(default_factory=lambda: np.ones((1, 1)))


def divided(
    size: Callable[[float], float],
    compared: int = 9,
    every: int = 8,
    unstable: tuple[float, float] = (2.0, 2.0),
    between: Callable[[Any, Any], Any] | None = None,
) -> list[float]:
    """The parameters that are compared besides, on a curve from 0 to 1.

    Args:
        size: |mu| by the parameter.
        compared: number of motions that were compared before.
        every: steps of the curve between two of them.
        unstable: an interval in which the model itself is unstable.
        between: see `divide_gaps`; by default the mean of the parameters.
    """
    count = (compared - 1) * every + 1
    points: Any = [
        Motion(p, not unstable[0] < p < unstable[1]) for p in np.linspace(0.0, 1.0, count)
    ]
    sizes = {point: size(point.parameter) for point in points[::every]}
    found: list[float] = []

    def compare(point: Any) -> float:
        assert point.stable
        found.append(point.parameter)
        return size(point.parameter)

    middle = between or (lambda a, b: Motion(0.5 * (a.parameter + b.parameter)))
    divide_gaps([Piece(points)], sizes, middle, compare)
    assert len(set(found)) == len(found)
    return found


def hill(p: float) -> float:
    """Of a vibration of light damping, above 1 from 0.55 to 0.59."""
    return float(0.97 + 0.04 / (1.0 + ((p - 0.57) / 0.0346) ** 2))


def test_distances_along_a_curve_are_relative_to_both_extents() -> None:
    """From 2 to 6 Hz, and to amplitudes of which the largest is 10."""
    points: Any = [Motion(2.0), Motion(4.0), Motion(6.0)]
    for point, sizes in zip(points, ([1.0, 2.0], [4.0, 2.0], [4.0, 10.0]), strict=True):
        point.amplitude = np.array(sizes)
    (found,) = lengths_along([Piece(points)])
    assert found == pytest.approx(
        [0.0, np.hypot(0.5, 0.3), np.hypot(0.5, 0.3) + np.hypot(0.5, 0.8)]
    )


@pytest.mark.parametrize("every", [1, 4])
def test_stretch_between_two_compared_motions_is_found_where_multipliers_come_near_one(
    every: int,
) -> None:
    found = divided(hill, every=every)
    assert hill(0.5) < 1.0 and hill(0.625) < 1.0
    assert any(hill(p) > 1.0 for p in found[:2])
    assert len(found) == EXTRA and sum(0.4 < p < 0.8 for p in found) > EXTRA // 2


def test_gap_in_which_multipliers_change_fast_is_divided() -> None:
    """They change from 0.3 to 0.7 across one gap, and are constant elsewhere."""
    found = divided(lambda p: 0.3 if p < 0.51 else 0.7)
    assert found and all(0.5 < p < 0.625 for p in found)
    assert np.ptp(found[-2:]) < 0.02


def test_well_damped_curve_is_not_compared_any_further() -> None:
    assert not divided(lambda p: 0.9 - 0.1 * p)


def test_lightly_damped_curve_is_divided_evenly() -> None:
    found = divided(lambda p: 0.98)
    assert len(found) == EXTRA
    assert set(np.arange(1, 16, 2) / 16.0) <= set(found)


def test_gaps_next_to_instability_and_short_ones_are_left() -> None:
    assert not divided(lambda p: 1.02)
    inside = divided(lambda p: 0.98, unstable=(0.26, 0.74))
    assert inside and all(p < 0.26 or p > 0.74 for p in inside)
    assert not divided(lambda p: 0.98, compared=round(1.1 / SHORTEST), every=1)


def test_motion_that_is_not_found_closes_its_gap_only() -> None:
    asked: list[tuple[float, float]] = []

    def lost(a: Any, b: Any) -> None:
        asked.append((a.parameter, b.parameter))

    assert not divided(lambda p: 0.98, every=1, between=lost)
    assert len(set(asked)) == len(asked) == 8
    unknown = divided(lambda p: 0.98 if p * 8 % 1 == 0 else np.nan, every=2)
    assert sorted(unknown) == list(np.arange(1, 16, 2) / 16.0)
