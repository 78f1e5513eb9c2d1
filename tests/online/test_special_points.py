"""Contact events and changes of stability are located where they are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from motions import curve_point
from numpy.typing import NDArray
from support import harmonic, linear_model, no_contacts, one_contact

from fenicsrom.online.contact.state import SLIP, STICK
from fenicsrom.online.curves import events
from fenicsrom.online.curves.continuation import HASTE, STRETCH, Continuation, follow, hurries
from fenicsrom.online.curves.curve import (
    BIFURCATIONS,
    END,
    NEGLIGIBLE,
    OPENS,
    SLIPS,
    STICKS,
    Bracket,
    Curve,
    CurvePoint,
    Extremes,
    bracketed,
    occurrences,
)
from fenicsrom.online.curves.events import LOCATED, MOST, outside, special_points
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import (
    Family,
    Shooting,
    force_family,
    periodic_motion,
    solve,
)
from fenicsrom.online.step.state import no_record
from fenicsrom.scene import Time

Array = NDArray[np.float64]


@cache
def curve_over_force(
    low: float, high: float, *, preload: float = 1.0, gap: float = 0.0, friction: float = 0.4
) -> tuple[Continuation, Family, Curve]:
    """Two coupled masses, the first before a wall with friction, over the size of the load."""
    model = linear_model(
        np.eye(4),
        np.diag([1.0, 2.0, 3.0, 4.0]) + 0.3 * np.ones((4, 4)),
        damping=0.1,
        loads=np.array([[0.8], [1.2], [-0.5], [0.7]]),
        load_histories=harmonic(np.array([1.0]), np.array([1.3]), np.array([0.3])),
        masters=2,
    )
    contacts = one_contact(
        preload=preload, normal_stiffness=6.0, tangential_stiffness=5.0, friction=friction
    )
    contacts = contacts._replace(radius=contacts.radius + gap)
    period = 2.0 * np.pi / 1.3
    settings = Time.of(scheme="discrete-gradient", periods=1, steps_per_period=100)
    family = force_family(Problem(model, contacts, settings, period))
    shooting = Shooting(family(low))
    s = np.zeros(shooting.map.size)
    for _ in range(20):
        marched = shooting.march(s, derive=False)
        assert marched is not None
        s = s + marched[0]
    s = shooting.scaled(solve(shooting, s).z)
    path = Continuation(shooting, family, low, high, s)
    start = path.at_parameter(s, low)
    assert start is not None
    return path, family, path.run(start, 1.0, points=300)


def occurs(path: Continuation, near: CurvePoint, value: float, bits: int) -> bool:
    """Whether contact states occur in the motion at a value of the parameter."""
    point = path.at_parameter(near.s, value)
    assert point is not None
    return bool(point.states[0] & bits)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "kind", "bits"),
    [
        ({}, "first slip", SLIPS),
        ({}, "first lift-off", OPENS),
        ({"preload": 0.0, "gap": 0.3}, "first touch", SLIPS | STICKS),
    ],
)
def test_contact_event_is_between_motions_with_and_without_the_state(
    options: dict[str, float], kind: str, bits: int
) -> None:
    path, _, curve = curve_over_force(0.02, 4.0, **options)
    events = [point for point in curve.special if point.kind == kind]
    assert [event.contact for event in events] == [0]
    (event,) = events
    width = LOCATED * path.range
    assert not occurs(path, event, event.parameter - width, bits)
    assert occurs(path, event, event.parameter + width, bits)


def test_amplitude_at_the_probe_is_that_of_the_contact_point_where_it_sits() -> None:
    """The probe gives the first two coordinates, which are those of the contact point."""
    _, _, curve = curve_over_force(0.02, 4.0)
    for point in curve.points:
        np.testing.assert_allclose(
            point.probe_amplitude, point.amplitude[0], rtol=2e-3, atol=1e-3 * point.amplitude.max()
        )


@pytest.mark.parametrize(("share", "slips"), [(0.5, False), (2.0, True)])
def test_slip_of_the_size_of_round_off_counts_as_stick(share: float, slips: bool) -> None:
    """The threshold is a part of the largest stretch of the friction spring, mu N / k_t."""
    contacts = one_contact(
        preload=2.0, normal_stiffness=6.0, tangential_stiffness=5.0, friction=0.4
    )
    record = no_record(3, 1, 2, 0)
    record.time[:] = 1.0, 2.0, 3.0
    record.state[:, 0] = STICK, SLIP, STICK
    record.force[:, 0, 0] = 1.0, 2.0, 3.0
    limit = 0.4 * 3.0
    record.friction_dissipation[1:, 0] = share * NEGLIGIBLE * limit**2 / 5.0
    bits, extremes = occurrences(record, contacts)
    assert bool(bits[0] & SLIPS) == slips
    assert bits[0] & STICKS
    assert (extremes.slip[0] > 0.0) == slips


def test_marched_motion_dissipates_only_beyond_the_first_slip() -> None:
    # the slider moves until the friction spring reaches its limit on both sides
    path, _, curve = curve_over_force(0.02, 4.0)
    event = next(point for point in curve.special if point.kind == "first slip")
    losses = []
    for factor in (0.995, 1.005):
        problem, s = path.family(factor * event.parameter), curve.points[0].s
        for _ in range(300):
            found = path.shooting.march(s, problem, derive=False)
            assert found is not None
            s = s + found[0]
        losses.append(float(found[-1].record.friction_dissipation[-1].sum()))
    assert losses[0] < 1e-10 < 1e-7 < losses[1]


def test_point_that_sticks_throughout_leaves_its_slider_free() -> None:
    _, _, curve = curve_over_force(0.02, 0.15, friction=1e3)
    assert curve.reason == "end of the range"
    for point in curve.points:
        assert point.states[0] == STICKS
        assert point.free_sliders == 1
        assert point.stable
        assert np.min(np.abs(point.multipliers - 1.0)) < 1e-12
        assert point.judged.size == point.multipliers.size - 1
        assert np.abs(point.judged).max() < 0.99


class Line:
    """A curve whose unknowns are one variable and the parameter: the variable is zero."""

    def __init__(self, multipliers: Any):
        self.multipliers, self.calls = multipliers, 0

    def place(self, point: CurvePoint) -> Array:
        return np.array([0.0, point.parameter])

    def direction(self, point: CurvePoint) -> Array:
        return point.tangent

    def at(self, parameter: float) -> CurvePoint:
        found = np.asarray(self.multipliers(parameter), dtype=np.complex128)
        found = found[np.argsort(-np.abs(found))]
        return curve_point(parameter, multipliers=found, verdict="", extremes=None)

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint:
        self.calls += 1
        return self.at(float(y[-1]))


@pytest.mark.parametrize(
    ("multipliers", "kinds", "places"),
    [
        (lambda p: [-0.7 - p, 0.2], ["period doubling"], [0.3]),
        (lambda p: [0.7 + p, 0.2], ["branch point"], [0.3]),
        (lambda p: [(0.7 + p) * np.exp(1j), (0.7 + p) * np.exp(-1j)], ["torus"], [0.3]),
        (lambda p: [0.9 if p < 0.3 else 1.2], ["non-smooth"], [0.3]),
        (lambda p: [-0.7 - p, -0.5 - p], ["period doubling", "period doubling"], [0.3, 0.5]),
        (lambda p: [-0.7 - p, 0.5 + p], ["period doubling", "branch point"], [0.3, 0.5]),
        # a pair leaves the circle, meets the real axis and one of the two returns
        (
            lambda p: (
                -1.05 - np.emath.sqrt(0.04 * (p - 0.5)) * np.array([1.0, -1.0])
                if p > 0.4
                else -1.05
                - 0.5 * (0.4 - p) * -1.0
                - np.emath.sqrt(0.04 * (p - 0.5)) * np.array([1.0, -1.0])
            ),
            ["torus", "period doubling"],
            [None, 0.5625],
        ),
    ],
)
def test_every_change_of_the_number_of_multipliers_outside_is_located(
    multipliers: Any, kinds: list[str], places: list[float | None]
) -> None:
    line = Line(multipliers)
    a, b = line.at(0.0), line.at(1.0)
    found = special_points(line, a, b, np.zeros(0, np.int64))
    assert found is not None
    assert [point.kind for point in found] == kinds
    for point, place in zip(found, places, strict=True):
        assert place is None or point.parameter == pytest.approx(place, abs=LOCATED)
    assert line.calls < 150


class Crowded(Line):
    """A line on which each point that is found has one more multiplier outside than the last."""

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint:
        found = super().correct(y, along, exact=exact)
        sizes = np.full(1 + self.calls, 2.0, dtype=np.complex128)
        return replace(found, multipliers=sizes, verdict="fold")


class Broken(Line):
    """A line of which no point between 0.2 and 0.7 is found."""

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint | None:
        found = super().correct(y, along, exact=exact)
        return None if 0.2 < found.parameter < 0.7 else found


def test_number_of_changes_of_stability_between_two_points_is_bounded() -> None:
    line = Crowded(lambda p: [2.0] * int(p))
    found = special_points(line, line.at(0.0), line.at(1.0), np.zeros(0, np.int64))
    located = [point for point in found if point.within < LOCATED]
    assert len(located) == MOST
    assert max(point.within for point in found) > 0.9  # the rest is not told apart
    assert line.calls < 1000


def test_crossing_to_which_the_way_on_leads_back_is_listed_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three multipliers are outside at 0.3, one before and one beside it, and two at the end."""
    outside_at = {0.0: 1, 0.3 - 1e-8: 1, 0.3: 3, 0.3 + 1e-8: 1, 1.0: 2}
    line = Line(lambda p: [2.0] * outside_at[p] + [0.5] * 3)
    first, before, here, beside, last = (line.at(p) for p in outside_at)
    brackets = [
        Bracket(before, here, (-1.0, 1e-9)),
        Bracket(here, beside, (1e-9, -1.0)),
        Bracket(beside, last, (-1.0, 1.0)),
    ]
    monkeypatch.setattr(events, "change_of_sign", lambda *_: brackets.pop(0))
    found = special_points(line, first, last, np.zeros(0, np.int64))
    assert [point.parameter for point in found if point.within < LOCATED] == [0.3]
    assert not brackets


def test_event_in_a_part_of_the_curve_that_is_not_found_tells_its_width() -> None:
    line = Broken(lambda p: [0.7 + p, 0.2])
    (event,) = special_points(line, line.at(0.0), line.at(1.0), np.zeros(0, np.int64))
    assert event.kind == "branch point" and event.parameter in (0.0, 1.0)
    assert event.within == 1.0


class Slipping(Line):
    """A line along which contact points begin to slip at some parameters, one after the other."""

    begins = np.array([0.6, 0.3, 0.5])

    def at(self, parameter: float) -> CurvePoint:
        slip = parameter - self.begins
        there = np.ones(3)
        states = np.where(slip > 0.0, STICKS | SLIPS, STICKS)
        return replace(super().at(parameter), states=states, extremes=Extremes(there, -there, slip))


def test_contact_of_several_points_slips_first_where_its_first_point_slips() -> None:
    line = Slipping(lambda p: [0.5])
    found = special_points(line, line.at(0.0), line.at(1.0), np.array([0, 0, 1]))
    assert [(point.kind, point.contact) for point in found] == [
        ("first slip", 1),
        ("first slip", 2),
    ]
    assert [point.parameter for point in found] == pytest.approx([0.3, 0.5], abs=LOCATED)


@pytest.mark.parametrize("bend", [-0.5, 0.0, 0.5])
def test_smooth_change_of_sign_is_bracketed_by_few_evaluations(bend: float) -> None:
    evaluated: list[float] = []

    def between(points: list[float], ends: list[float], arc: float) -> float:
        evaluated.append(arc)
        return arc

    found = bracketed(between, lambda x: x - 0.3 + bend * (x - 0.3) ** 2, 0.0, 1.0, 1.0, 1e-7)
    assert found is not None
    assert found.before <= 0.3 <= found.after
    assert found.after - found.before <= 1e-7
    assert len(evaluated) <= 9  # bisection needs 24


@pytest.mark.parametrize("small", [1e-2, 1e-6, 1e-9])
@pytest.mark.parametrize("place", [0.1, 0.35, 0.9])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_jump_from_a_tiny_value_is_bracketed(small: float, place: float, turn: float) -> None:
    evaluated: list[float] = []

    def between(points: list[float], ends: list[float], arc: float) -> float:
        evaluated.append(arc)
        return arc

    def jump(x: float) -> float:
        return 1.0 if turn * (x - 0.06 * place) > 0.0 else -small

    found = bracketed(between, jump, 0.0, 0.06, 0.06, 1e-7)
    assert found is not None
    assert found.before <= 0.06 * place <= found.after <= found.before + 1e-7
    assert len(evaluated) <= 33  # bisection needs 20


@pytest.mark.slow
def test_guess_that_is_a_motion_is_accepted_after_one_march() -> None:
    path, _, curve = curve_over_force(0.02, 0.5)
    point = path.at_parameter(curve.points[-2].s, curve.points[-2].parameter)
    assert point is not None
    found = path.at_parameter(point.s, point.parameter)
    assert found is not None
    assert found.marches == (1, 1)
    np.testing.assert_allclose(found.s, point.s, rtol=1e-14)  # weighed and back
    moved = path.at_parameter(1.0001 * point.s, point.parameter)
    assert moved is not None
    assert moved.marches[1] > 1
    np.testing.assert_allclose(moved.s, point.s, rtol=0.0, atol=1e-9 * np.linalg.norm(point.s))


def test_stability_changes_only_at_bifurcations() -> None:
    _, _, curve = curve_over_force(0.02, 4.0)
    kinds = [point.kind for point in curve.special if point.kind in BIFURCATIONS]
    counts = [outside(point) for point in curve.points]
    changes = sum(a != b for a, b in pairwise(counts))
    assert changes <= len(kinds)


@pytest.mark.parametrize(("stiffness", "hurried"), [(2.0, False), (-2.0, True)])
def test_steps_of_a_long_unstable_stretch_are_twice_as_long(
    stiffness: float, hurried: bool
) -> None:
    """A mass on a spring, or on a spring of negative stiffness, over the size of its load."""
    load = harmonic(np.array([1.0]), np.array([1.3]), np.array([0.3]))
    model = linear_model([[1.0]], [[stiffness]], damping=0.1, loads=[[1.0]], load_histories=load)
    settings = Time.of(scheme="discrete-gradient", periods=1, steps_per_period=40)
    family = force_family(Problem(model, no_contacts(), settings, 2.0 * np.pi / 1.3))
    start = periodic_motion(family(1.0), (np.zeros(1), np.zeros(1), np.zeros((0, 1))))
    curve = follow(family, start, 1.0, (1.0, 3.0))
    assert curve.reason == END and {point.stable for point in curve.points} == {not hurried}
    steps = np.diff([point.parameter for point in curve.points])
    assert steps[STRETCH] / steps[STRETCH - 2] == pytest.approx(HASTE if hurried else 1.0, rel=0.05)
    assert [hurries(Curve(curve.points[:k])) for k in (STRETCH - 1, STRETCH)] == [False, hurried]
