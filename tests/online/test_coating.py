"""Abradable layers: the law of one point and the ring against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import casing, step
from numpy.typing import NDArray
from support import assert_tangent, one_contact

from fenicsrom.online.contact.coating import (
    Ring,
    coated,
    depth,
    ring_place,
    wear,
    worn_depth,
    worn_through,
)
from fenicsrom.online.contact.law import at_rest
from fenicsrom.online.contact.state import Interval, contact_scratch, zero_contact_state
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.scene import Abradable

Array = NDArray[np.float64]

AREA, RADIUS, WIDTH = 100e-6, 0.25, 0.02
LAYER: dict[str, float] = {
    "thickness": 5e-3,
    "modulus": 1e9,
    "yield_stress": 5e6,
    "hardening": 0.1e9,
    "area": AREA,
}
RIGID = 1e20
"""A contact spring of this stiffness leaves only that of the layer, N/m."""


def layer_of(**values: float) -> Abradable:
    return Abradable(**(LAYER | values))  # type: ignore[arg-type]


def pressed(spring: float = RIGID, **values: float) -> tuple[Contacts, Ring]:
    """A point with a layer on a plane at rest, and its ring."""
    flat = one_contact(normal_stiffness=spring)
    ring = Ring(0, (0,), 0, 1, 0.0, 0.0, 0.0, AREA, layer_of(**values))
    return coated(flat, [ring], np.array([AREA])), ring


class Point:
    """A point that is pressed into its layer, step by step."""

    def __init__(self, contacts: Contacts, x: float = 0.0):
        self.contacts, self.time, self.work = contacts, 0.0, 0.0
        self.state, d = zero_contact_state(1, 2), contact_scratch(1, 2)
        start = np.array([[x, 0.0]])
        at_rest(contacts, start, start.copy(), 0.0, self.state, d)

    def move(self, x: float, duration: float = 1.0) -> float:
        """A step to the depth x; returns the mean force of the step."""
        interval = Interval(self.time, self.time + duration, 0.5, True)
        x0, x1 = self.state.x, np.array([[x, 0.0]])
        end, found, _, surface = step(
            self.contacts, self.state, x1, 0.5, True, (interval.begin, interval.end)
        )
        mean = float(found.mean_force[0, 0])
        assert surface == pytest.approx(-mean * (x - x0[0, 0]), rel=1e-14)
        wear(self.contacts, interval, 0, x0[0], x1[0])
        self.work += mean * (x - x0[0, 0])
        self.state, self.time = end, interval.end
        return mean

    @property
    def force(self) -> float:
        return max(float(self.state.trial_normal_force[0]), 0.0)

    @property
    def worn(self) -> float:
        return float(self.contacts.coating.worn[0])


@pytest.mark.parametrize("steps", [1, 1000])
@pytest.mark.slow
def test_layer_pressed_unloaded_and_pressed_again_matches_the_closed_form(steps: int) -> None:
    """Reference: abradable layer pressed to 50 and 60 µm: force, wear | law of Legrand, Batailly
    and Pierre (2012) | 545.4545, 563.6364 N; 22.72727, 31.81818 µm | agree | 1e-6
    """
    point = Point((made := pressed())[0])

    def to(x: float) -> None:
        for one in np.linspace(point.state.x[0, 0], x, steps + 1)[1:]:
            point.move(one)

    to(50e-6)
    assert point.force == pytest.approx(545.4545, rel=1e-7)
    assert point.worn == pytest.approx(22.72727e-6, rel=1e-6)
    assert point.work == pytest.approx(0.01931818, rel=1e-6)
    assert made[1].plastic_work(point.contacts.coating.worn) == pytest.approx(0.01188017, rel=1e-6)
    to(0.0)
    assert point.force == 0.0
    assert point.work == pytest.approx(0.01188017, rel=1e-6)  # the elastic part came back
    for x, force, worn in (
        (40e-6, 345.4545, 22.72727e-6),
        (50e-6, 545.4545, 22.72727e-6),
        (60e-6, 563.6364, 31.81818e-6),
    ):
        to(x)
        assert point.force == pytest.approx(force, rel=1e-6)
        assert point.worn == pytest.approx(worn, rel=1e-6)


def test_layer_yields_at_25_micrometres_and_opens_where_it_is_worn() -> None:
    point = Point(pressed()[0])
    point.move(25e-6)
    assert point.worn < 1e-18
    point.move(25.001e-6)
    assert point.worn > 0.0
    point.move(50e-6)
    point.move(22.73e-6)
    assert point.force > 0.0
    point.move(22.72e-6)
    assert point.force == 0.0


@pytest.mark.parametrize(
    ("values", "duration", "force", "worn", "work"),
    [
        ({"hardening": 0.0}, 1.0, 500.0, 25e-6, 0.01875),
        ({"viscosity": 1e4}, 1e-5, 761.9048, 11.90476e-6, None),
        ({"spring": 1e8}, 1.0, 535.7143, 17.85714e-6, None),
    ],
)
def test_layer_without_hardening_with_viscosity_and_behind_a_spring_matches_the_closed_form(
    values: dict[str, float], duration: float, force: float, worn: float, work: float | None
) -> None:
    """Reference: the layer without hardening, with viscosity, behind a spring: force | closed form
    | 500, 761.9048, 535.7143 N | agree | 1e-6
    """
    made, ring = pressed(**values)
    point = Point(made)
    point.move(50e-6, duration)
    assert point.force == pytest.approx(force, rel=1e-6)
    assert point.worn == pytest.approx(worn, rel=1e-6)
    if work is not None:
        assert point.work == pytest.approx(work, rel=1e-6)
        assert ring.plastic_work(made.coating.worn) == pytest.approx(0.0125, rel=1e-6)


@pytest.mark.slow
def test_mean_force_of_a_step_is_the_mean_along_its_path() -> None:
    """Loading from outside to beyond the yield stress, unloading to outside, both in one step."""
    for x0, x1 in ((-20e-6, 70e-6), (55e-6, -10e-6), (10e-6, 45e-6)):
        fine, coarse = Point(pressed()[0]), Point(pressed()[0])
        for point in (fine, coarse):
            point.move(x0)
        mean = coarse.move(x1)
        parts = [fine.move(x) for x in np.linspace(x0, x1, 4001)[1:]]
        assert mean == pytest.approx(np.mean(parts), rel=1e-9)
        assert coarse.worn == pytest.approx(fine.worn, rel=1e-12)


def test_layer_is_worn_through_where_the_depth_reaches_its_thickness() -> None:
    made, _ = pressed(hardening=0.0)
    point = Point(made)
    point.move(5.0e-3)
    assert not worn_through(made)
    point.move(5.1e-3)
    assert worn_through(made)


# ------------------------------------------------------------------ the ring


def ring_of(cells: int, spin: float = 1.0, **values: float) -> tuple[Contacts, Ring]:
    """A point at (RADIUS, 0) in a casing that turns, with a layer; and its ring."""
    round_ = casing(2, spin=spin, preload=0.0, normal_stiffness=RIGID, friction=0.0)
    round_ = round_._replace(
        axes=np.eye(2)[None],
        centre=np.array([[-RADIUS, 0.0]]),
        radius=np.array([RADIUS]),
        times=np.zeros(0),
        approach=np.zeros((1, 0)),
    )
    area = RADIUS * 2.0 * np.pi / cells * WIDTH
    ring = Ring(0, (0,), 0, cells, 0.0, RADIUS, WIDTH, area, layer_of(**values))
    return coated(round_, [ring], np.array([AREA])), ring


def revolve(point: Point, steps: int, spin: float, path: Any) -> tuple[Array, Array]:
    """One revolution along the depth path(phi); the mean forces and those at the ends."""
    mean, end = np.empty((2, steps))
    for k in range(steps):
        phi = spin * point.time + spin * 2.0 * np.pi / steps
        mean[k] = point.move(path(phi), 2.0 * np.pi / steps)
        end[k] = point.force
    return mean, end


def path(phi: Any) -> Any:
    """The depth of a rigid blade with two lobes in the casing."""
    return 10e-6 + 40e-6 * np.cos(2.0 * phi)


@pytest.mark.slow
@pytest.mark.parametrize("cells", [360, 720, 1000])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_rigid_blade_wears_two_lobes_as_the_closed_form(cells: int, way: float) -> None:
    """Reference: rigid blade wears two lobes in a turn: depth, area, work | closed form | 22.72727
    µm; 35.06363 µm rad; 0.908139 J | agree | 1e-5; 0.04 %; 0.1 %
    """
    made, ring = ring_of(cells, way)
    point = Point(made, 50e-6)
    mean, _ = revolve(point, 360, way, path)
    worn = made.coating.worn
    first = worn.copy()
    angle = 2.0 * np.pi / cells * np.arange(cells)
    exact = np.maximum(path(angle) - 25e-6, 0.0) / 1.1
    np.testing.assert_allclose(worn, exact, rtol=0.0, atol=0.006e-6)  # d is linear in a step
    assert np.sum(worn) * 2.0 * np.pi / cells == pytest.approx(35.06363e-6, rel=4e-4)
    assert np.max(worn) == pytest.approx(22.72727e-6, rel=1e-5)
    beside = np.abs((np.degrees(angle) + 90.0) % 180.0 - 90.0)  # from the middle of a lobe
    np.testing.assert_array_equal(worn > 0.0, beside < 33.98784)
    assert ring.plastic_work(worn) == pytest.approx(0.908139, rel=1e-3)
    assert ring.plastic_work(worn) / (RADIUS * WIDTH) == pytest.approx(181.6279, rel=1e-3)
    assert ring.volume(worn) == pytest.approx(35.06363e-6 * RADIUS * WIDTH, rel=4e-4)
    again, _ = revolve(point, 360, way, path)
    np.testing.assert_allclose(worn, first, rtol=1e-11)  # rounding
    np.testing.assert_allclose(again[1:], mean[1:], rtol=0.0, atol=2e-3 * np.max(mean))


def test_rigid_blade_at_constant_depth_wears_all_around_although_it_does_no_work() -> None:
    """Reference: rigid blade at constant depth: force, plastic work | closed form | 545.4545 N;
    3.732264 J | agree | 1e-6
    """
    made, ring = ring_of(360)
    point = Point(made, 50e-6)
    mean, end = revolve(point, 300, 1.0, lambda phi: 50e-6)
    np.testing.assert_allclose(end, 545.4545, rtol=1e-6)
    np.testing.assert_allclose(mean, 545.4545, rtol=1e-6)
    assert point.work == 0.0
    work = ring.plastic_work(made.coating.worn)
    assert work == pytest.approx(3.732264, rel=1e-6)
    assert work / (2.0 * np.pi * RADIUS * WIDTH) == pytest.approx(118.80165, rel=1e-6)
    torque = ring.plastic_work(made.coating.worn) / (2.0 * np.pi)
    assert torque == pytest.approx(2.376 * RADIUS, rel=1e-4)


@pytest.mark.parametrize("steps", [97, 360, 1000])
def test_no_node_is_missed_or_worn_twice(steps: int) -> None:
    """Steps that end on nodes, between nodes, and that are shorter and longer than a cell."""
    made, _ = ring_of(360, viscosity=1e5)
    point = Point(made, 50e-6)
    revolve(point, steps, 1.0, lambda phi: 50e-6)
    worn = made.coating.worn
    assert worn[1] > 0.0
    np.testing.assert_allclose(worn, worn[1], rtol=1e-9)


@pytest.mark.slow
def test_mean_force_on_a_worn_ring_is_the_mean_of_the_force_along_the_arc() -> None:
    rng = np.random.default_rng(3)
    made, _ = ring_of(50)
    for _ in range(20):
        made.coating.worn[:] = rng.uniform(0.0, 60e-6, 50)
        x0, x1 = rng.uniform(-20e-6, 90e-6, 2)
        begin, duration = rng.uniform(0.0, 6.0), rng.uniform(0.01, 1.0)
        start = zero_contact_state(1, 2)
        at_rest(made, np.array([[x0, 0.0]]), np.zeros((1, 2)), begin, start, contact_scratch(1, 2))
        time = begin, begin + duration
        _, found, *_ = step(made, start, np.array([[x1, 0.0]]), 0.5, True, time)
        s = (np.arange(20_000) + 0.5) / 20_000
        w = np.array([worn_depth(made, 0, ring_place(made, 0, begin + a * duration)) for a in s])
        d = x0 + s * (x1 - x0)
        y = 20e6 * (d - w)
        beyond = np.maximum(y - 500.0 - 2e6 * w, 0.0)
        exact = np.mean(np.maximum(y, 0.0) - beyond / 1.1)
        assert found.mean_force[0, 0] == pytest.approx(exact, rel=1e-6, abs=1e-3)


@pytest.mark.parametrize("blending", [0.0, 0.3])
def test_force_derivative_before_a_worn_ring_matches_differences(blending: float) -> None:
    rng, compared = np.random.default_rng(5), 0
    made, _ = ring_of(50)
    made = made._replace(friction=np.array([0.3]), tangential_stiffness=np.array([1e7]))
    for _ in range(20):
        made.coating.worn[:] = rng.uniform(0.0, 60e-6, 50)
        start, x = zero_contact_state(1, 2), rng.uniform(-20e-6, 90e-6, (2, 2))
        at_rest(made, x[:1], x[:1].copy(), 0.0, start, contact_scratch(1, 2))

        def found(x1: Array, start: Any = start) -> Any:
            return step(made, start, x1[None], 0.5, True, (0.0, 0.7), blending)[1]

        if not found(x[1]).mean_force.any():
            continue
        compared += 1
        assert_tangent(
            lambda x1, found=found: found(x1).mean_force[0].copy(),
            lambda x1, found=found: found(x1).force_derivative[0].copy(),
            x[1],
            step=1e-10,
            tolerance=1e-4,  # the law has kinks at each node
        )
    assert compared > 10


def test_depth_is_that_below_the_worn_surface() -> None:
    made, _ = ring_of(4)
    made.coating.worn[:] = [0.0, 4e-6, 8e-6, 4e-6]
    x = np.array([10e-6, 0.0])
    for turns, worn in ((0.0, 0.0), (0.125, 2e-6), (0.5, 8e-6), (1.75, 4e-6)):
        found = depth(made, 0, x, -2.0 * np.pi * turns)
        assert found == pytest.approx(10e-6 - worn, rel=1e-9)
