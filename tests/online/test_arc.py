"""Curves with corners, folds and branch points, in closed form and without mechanics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fenicsrom.online.curves.arc import FIRST_SIZE, LARGEST_STEP, ArcLength, Place, Values, oriented
from fenicsrom.online.curves.curve import BACK, END, LOST, OUT_OF_POINTS, REPEATS, Curve
from fenicsrom.online.curves.events import turned_points

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Spot:
    """A point of a curve."""

    s: Array
    parameter: float
    tangent: Array
    evaluations: tuple[int, int]
    sense: float = 1.0


class Toy(ArcLength):
    """The curve of an equation z = (s, p) -> r, J."""

    def __init__(
        self, equation: Callable[[Array], tuple[Any, Any]], low: float, high: float, count: int
    ):
        super().__init__(low, high, np.eye(count)[0], np.eye(count))
        self.equation = equation

    def values(self, s: Array, parameter: float, *, derive: bool) -> Values:
        r, jacobian = self.equation(np.append(s, parameter))
        return Values(np.atleast_1d(r), np.atleast_2d(np.asarray(jacobian, float)), None)

    def point(self, place: Place, evaluations: tuple[int, int]) -> Spot:
        weights = np.append(np.full(place.y.size - 1, self.size), self.range)
        s, p = place.y[:-1] * self.size, float(place.y[-1] * self.range)
        return Spot(s, p, place.tangent * weights, evaluations)


def followed(
    equation: Callable[[Array], tuple[Any, Any]],
    start: Any,
    bounds: tuple[float, float],
    direction: float = 1.0,
    **options: Any,
) -> Curve:
    """The curve of an equation through a point (s, p) of it."""
    z = np.asarray(start, float)
    toy = Toy(equation, *bounds, z.size - 1)
    first = toy.at_parameter(z[:-1], float(z[-1]))
    assert first is not None
    return toy.run(first, direction, points=options.pop("points", 400), **options)


def corner(a: float, b: float) -> Callable[[Array], tuple[Any, Any]]:
    """The curve p = 1 + a x for x < 0 and p = 1 - b x for x > 0."""

    def equation(z: Array) -> tuple[Any, Any]:
        slope = a if z[0] < 0.0 else -b
        return z[1] - 1.0 - slope * z[0], [-slope, 1.0]

    return equation


CORNERS = [(1, 1), (5, 0.2), (5, 3), (30, 30), (0.1, 0.1), (0.1, 10), (1, -0.3)]


@pytest.mark.parametrize(("a", "b"), CORNERS)
def test_curve_passes_a_corner(a: float, b: float) -> None:
    """In three of these corners the two tangents are normal to each other."""
    high = 3.0 if b > 0 else 2.0
    found = followed(corner(a, b), [-0.5, 1.0 - 0.5 * a], (-20.0, high))
    x = np.array([point.s[0] for point in found.points])
    assert found.reason == END
    assert found.points[-1].parameter == pytest.approx(-20.0 if b > 0 else 2.0)
    assert np.all(np.diff(x) > 0.0) and x[-1] > 0.5
    assert len(found.points) < 150 * (1.0 + 20.0 * max(1.0 / abs(b), 1.0) / 23.0)
    expected = 1.0 + np.where(x < 0.0, a * x, -b * x)
    np.testing.assert_allclose([point.parameter for point in found.points], expected, atol=1e-6)


def test_curve_with_corners_in_five_unknowns_goes_through_all() -> None:
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(5, 5)))[0]
    places, slopes = np.array([0.2, 0.35, 0.5, 0.65, 0.8]), np.array([3.0, 10.0, 1.0, 30.0, 5.0])

    def equation(z: Array) -> tuple[Any, Any]:
        away = z[5] - places
        jacobian = np.column_stack([turn, -slopes * np.sign(away)])
        return turn @ z[:5] - slopes * np.abs(away), jacobian

    found = followed(equation, np.append(turn.T @ (slopes * places), 0.0), (0.0, 1.0))
    assert found.reason == END
    assert found.points[-1].parameter == pytest.approx(1.0, abs=1e-12)
    assert np.all(np.diff([point.parameter for point in found.points]) > 0.0)


def sweep(z: Array) -> tuple[Any, Any]:
    """A slider w in the plane, kept within a distance of a point on an ellipse; x = 1 beside it.

    The distance is 1 + 20 (p - 1). Above p = 1 the slider rests wherever it is near enough to the
    whole ellipse.
    """
    w, p, moved, by_p = z[1:3].copy(), 20.0 * float(z[3]) - 19.0, np.eye(2), np.zeros(2)
    for angle in np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False):
        way = w - np.array([np.cos(angle), 0.4 * np.sin(angle + 0.4)])
        far = float(np.linalg.norm(way))
        if far > p:
            u = way / far
            turn = p / far * (np.eye(2) - np.outer(u, u))
            w, moved, by_p = w + (p - far) * u, turn @ moved, turn @ by_p + 20.0 * u
    jacobian = np.zeros((3, 4))
    jacobian[0, 0] = -1.0
    jacobian[1:, 1:3], jacobian[1:, 3] = moved - np.eye(2), by_p
    return np.append(1.0 - z[0], w - z[1:3]), jacobian


def test_point_that_sticks_in_two_directions_begins_to_slip(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Steps that drag the slider along its bounds must not lead back again and again."""
    monkeypatch.setattr(Toy, "sliders", np.array([1, 2]))
    for w in ([0.02, 0.1], [0.3, -0.2]):
        found = followed(sweep, [1.0, *w, 1.5], (0.975, 1.5), direction=-1.0)
        p = np.array([point.parameter for point in found.points])
        assert found.reason == END and p[-1] == pytest.approx(0.975)
        assert np.sum(np.diff(p) > 0.0) <= 2 and len(p) < 50


def test_smooth_folds_are_passed() -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[1] - z[0] ** 3 + z[0], [1.0 - 3.0 * z[0] ** 2, 1.0]

    found = followed(equation, [-1.5, -1.875], (-3.0, 2.0))
    x = np.array([point.s[0] for point in found.points])
    assert found.reason == END and np.all(np.diff(x) > 0.0)
    assert found.points[-1].parameter == pytest.approx(2.0)
    assert len({point.sense for point in found.points}) == 1  # no fold changes the sense
    steps = np.hypot(np.diff(x), np.diff([point.parameter for point in found.points]) / 5.0)
    assert steps.max() <= 1.1 * LARGEST_STEP * FIRST_SIZE * np.abs(x).max()


def test_two_folds_within_a_step_are_found_by_the_way_that_the_parameter_goes() -> None:
    """The folds of p = x^3 - 3 x are at -1 and 1; at -1.1 and 1.1 the tangents look upwards."""

    def equation(z: Array) -> tuple[Any, Any]:
        return z[1] - z[0] ** 3 + 3.0 * z[0], [3.0 - 3.0 * z[0] ** 2, 1.0]

    toy = Toy(equation, -4.0, 4.0, 1)
    places = [toy.at_parameter(np.array([x]), x**3 - 3.0 * x) for x in (-1.1, 1.1)]
    a, b = (oriented(place, -1.0) for place in places)
    (middle,) = turned_points(toy, a, b)
    assert a.tangent[-1] * b.tangent[-1] > 0.0 > a.tangent[-1] * middle.tangent[-1]
    assert not turned_points(toy, a, middle) and not turned_points(toy, middle, b)


def test_branch_point_is_passed_straight_and_changes_the_sense() -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[0] ** 3 - z[1] * z[0], [3.0 * z[0] ** 2 - z[1], -z[0]]

    found = followed(equation, [0.0, -1.013], (-2.0, 1.0))
    assert found.reason == END and found.points[-1].parameter == pytest.approx(1.0)
    assert max(abs(point.s[0]) for point in found.points) < 1e-6
    senses = np.array([point.sense for point in found.points])
    (change,) = np.flatnonzero(np.diff(senses))
    assert found.points[change].parameter < 0.0 < found.points[change + 1].parameter


def test_folds_are_not_sought_for_ever_if_all_tangents_are_contrary_to_the_way() -> None:
    class Counted(Toy):
        count = 0

        def values(self, s: Array, parameter: float, *, derive: bool) -> Values:
            self.count += 1
            assert self.count < 1000
            return super().values(s, parameter, derive=derive)

    toy = Counted(lambda z: (z[1] - z[0], [-1.0, 1.0]), -4.0, 4.0, 1)
    a, b = (toy.at_parameter(np.array([x]), x) for x in (0.1, -0.1))
    a, b = (oriented(place, place.sense * np.sign(place.tangent[-1])) for place in (a, b))
    assert 1 <= len(turned_points(toy, a, b)) <= 8


def test_point_of_another_part_of_the_curve_is_not_between_two_points() -> None:
    """The plane half way between them meets the curve near (0, 1)."""

    def equation(z: Array) -> tuple[Any, Any]:
        far = abs(z[0]) < 0.09
        return (z[1] - 1.0 if far else z[1] + 0.1 * z[0]), ([0.0, 1.0] if far else [0.1, 1.0])

    toy = Toy(equation, -4.0, 4.0, 1)
    a, b = (toy.at_parameter(np.array([x]), -0.1 * x) for x in (-0.1, 0.1))
    a, b = (oriented(place, place.sense * np.sign(place.tangent[-1])) for place in (a, b))
    assert not turned_points(toy, a, b)


@pytest.mark.parametrize("bound", [-0.02, -0.01, -0.001])
def test_last_point_leaves_the_range_if_a_branch_point_lies_beyond(bound: float) -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[0] ** 3 - z[1] * z[0], [3.0 * z[0] ** 2 - z[1], -z[0]]

    found = followed(equation, [0.0, -1.013], (-2.0, bound))
    assert found.reason == END and found.points[-1].parameter == pytest.approx(bound)
    assert all(point.tangent[-1] > 0.0 for point in found.points)
    assert len({point.sense for point in found.points}) == 1


def test_closed_curve_ends_where_it_began() -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[0] ** 2 + z[1] ** 2 - 1.0, [2.0 * z[0], 2.0 * z[1]]

    found = followed(equation, [1.0, 0.0], (-2.0, 2.0))
    assert found.reason == "closed" and found.points[-1] is found.points[0]


def test_curve_that_goes_round_a_closed_curve_beside_its_first_point_ends() -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[0] ** 2 + z[1] ** 2 - 1.0, [2.0 * z[0], 2.0 * z[1]]

    path = Toy(equation, -2.0, 2.0, 1)
    elsewhere = path.at_parameter(np.array([1.0]), -0.9)
    begin = path.at_parameter(np.array([1.0]), 0.0)
    outlier = replace(elsewhere, s=np.array([3.0]))  # from where a step has jumped
    found = path.run(begin, 1.0, curve=Curve([outlier, begin]), points=400)
    assert found.reason == REPEATS
    round_once = len(path.run(begin, 1.0, points=400).points)
    assert round_once < len(found.points) < round_once + 12


def test_curve_that_comes_back_says_so() -> None:
    found = followed(corner(1.0, 2.0), [-0.5, 0.5], (0.5, 3.0))
    assert found.reason == BACK
    assert found.points[-1].s[0] == pytest.approx(0.25)


def test_curve_over_a_falling_parameter_is_the_same() -> None:
    up = followed(corner(1.0, -0.3), [-0.5, 0.5], (0.5, 1.5))
    down = followed(corner(1.0, -0.3), [*up.points[-1].s.tolist(), 1.5], (0.5, 1.5), -1.0)
    assert down.reason == END
    assert down.points[-1].s[0] == pytest.approx(-0.5)


def test_curve_that_stops_is_lost_and_keeps_its_points() -> None:
    """Beyond x = 0 the equation has no value."""

    class Ending(Toy):
        def values(self, s: Array, parameter: float, *, derive: bool) -> Any:
            return None if s[0] > 0.0 else super().values(s, parameter, derive=derive)

    path = Ending(corner(1.0, -1.0), 0.0, 2.0, 1)
    found = path.run(path.at_parameter(np.array([-0.5]), 0.5), 1.0)
    assert found.reason == LOST
    assert -1e-6 < found.points[-1].s[0] <= 0.0


def test_limit_of_points_ends_a_curve_and_it_goes_on() -> None:
    def equation(z: Array) -> tuple[Any, Any]:
        return z[1] - z[0] ** 3 + z[0], [1.0 - 3.0 * z[0] ** 2, 1.0]

    whole = followed(equation, [-1.5, -1.875], (-3.0, 2.0))
    path = Toy(equation, -3.0, 2.0, 1)
    part = path.run(path.at_parameter(np.array([-1.5]), -1.875), 1.0, points=20)
    assert part.reason == OUT_OF_POINTS and len(part.points) == 20
    kept = [*part.points]
    Toy(equation, -3.0, 2.0, 1).run(kept[-1], None, curve=part)
    assert part.points[:20] == kept and part.reason == END
    assert part.points[-1].s[0] == pytest.approx(whole.points[-1].s[0], rel=1e-9)


@pytest.mark.parametrize("place", [-0.2, 0.0, 0.4])
def test_slider_that_sticks_rests_until_slip_moves_it(place: float) -> None:
    """A point that moves from -A to A drags a slider, which follows at a distance of 0.5."""

    class Dragged(Toy):
        sliders = np.array([1])

        def values(self, s: Array, parameter: float, *, derive: bool) -> Values:
            up, down = s[0] - 0.5, 0.5 - s[0]
            r = min(max(s[1], up), down) - s[1]
            row = [-1.0, -1.0, 0.0] if max(s[1], up) > down else [1.0, -1.0, 0.0]
            row = row if r else [0.0, 0.0, 0.0]
            return Values(np.array([s[0] - parameter, r]), np.array([[1, 0, -1.0], row]), None)

    path = Dragged(lambda z: (0.0, 0.0), 0.0, 1.0, 2)
    found = path.run(path.at_parameter(np.array([0.0, place]), 0.0), 1.0)
    assert found.reason == END and len(found.points) < 60
    for point in found.points:
        amplitude, slider = point.s
        assert abs(min(max(slider, amplitude - 0.5), 0.5 - amplitude) - slider) < 1e-6
        if amplitude < 0.5 - abs(place):
            assert slider == pytest.approx(place, abs=1e-12)
