"""Rigid surfaces against geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import SURFACES, casing
from numpy.typing import NDArray
from support import assert_tangent, one_contact, slope

from fenicsrom.online.contact.surfaces import (
    CYLINDER,
    PLANE,
    SPHERE,
    advect_with_surface,
    gap_discrete_gradient,
    penetration,
    speed_at,
    speed_history,
    surface_turn,
)
from fenicsrom.online.kernels.numbers import Dual, vector

Array = NDArray[np.float64]


def test_penetration_of_round_surface_matches_geometry() -> None:
    for inside in (True, False):
        side = 1.0 if inside else -1.0
        for d, kind in ((2, CYLINDER), (3, CYLINDER), (3, SPHERE)):
            contacts = casing(d, kind=kind, inside=inside)
            assert penetration(contacts, 0, np.zeros(d), 0.0) == pytest.approx(0.0, abs=1e-16)
            x = np.zeros(d)
            x[0] = 5e-4  # along the normal into the surface, whichever side it is seen from
            assert penetration(contacts, 0, x, 0.0) == pytest.approx(5e-4, rel=0.2)
            assert penetration(contacts, 0, np.zeros(d), 1.5) == pytest.approx(
                3e-3
            )  # it has come nearer, linearly
            assert penetration(contacts, 0, np.zeros(d), 9.0) == pytest.approx(4e-3)  # and stays
        x = np.array([0.0, 0.2])  # in the plane: on a circle about (-0.3 side, 0)
        exact = side * (np.hypot(0.3 * side, 0.2) - 0.3)
        assert penetration(casing(2, inside=inside), 0, x, 0.0) == pytest.approx(exact, rel=1e-13)


def test_waves_of_turning_surface_turn_with_it() -> None:
    still, gyroscopic_matrix = casing(2, waves=True), casing(2, waves=True, spin=0.7)
    centre, angle = still.centre[0], 0.7 * 1.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x = np.array([4e-3, 0.1])
    there = centre + turn @ (x - centre)
    assert penetration(gyroscopic_matrix, 0, there, 1.3) == pytest.approx(
        penetration(still, 0, x, 1.3), rel=1e-12
    )
    carried = advect_with_surface(gyroscopic_matrix, 0, 0.2, 1.5, vector(x))
    np.testing.assert_allclose(carried, vector(there), rtol=1e-14)


def test_surface_turn_with_varying_speed_is_integral_of_speed() -> None:
    rows = np.array([[0.0, 2.0], [0.4, 5.0], [1.0, 1.0]])
    still, history = casing(2, waves=True), speed_history(rows)
    varying = still._replace(turns=np.array([-1.0]), history=history)
    for begin, end in ((0.0, 0.3), (0.1, 0.7), (0.5, 2.5)):
        times = np.linspace(begin, end, 20001)
        speeds = np.interp(times, *rows.T)
        swept = np.sum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))
        assert surface_turn(varying, 0, begin, end) == pytest.approx(-swept, rel=1e-7)
        assert speed_at(history, end) == pytest.approx(speeds[-1], rel=1e-14)
    # at any time the surface stands where one that turns by the mean speed stands
    steady = still._replace(spin=np.array([surface_turn(varying, 0, 0.0, 0.7) / 0.7]))
    x = np.array([4e-3, 0.1])
    assert penetration(varying, 0, x, 0.7) == pytest.approx(penetration(steady, 0, x, 0.7))
    one, other = (advect_with_surface(c, 0, 0.0, 0.7, vector(x)) for c in (varying, steady))
    np.testing.assert_allclose(one, other, rtol=1e-14)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_gap_discrete_gradient_matches_change_of_penetration(surface: Any, d: int) -> None:
    contacts, rng = surface(d), np.random.default_rng(6)
    wavy = contacts.order.size > 0

    def mean(x0: Array, x1: Array) -> Array:
        return np.array(gap_discrete_gradient(contacts, 0, vector(x0), vector(x1), 0.4)[:d])

    def by_end(x0: Array, x1: Array) -> Array:
        moved = tuple(Dual(x, *row) for x, row in zip(vector(x1), np.eye(3), strict=True))
        start = tuple(Dual(x, 0.0, 0.0, 0.0) for x in vector(x0))
        return np.array([n[1:] for n in gap_discrete_gradient(contacts, 0, start, moved, 0.4)])

    for _ in range(20):
        x0, x1 = rng.uniform(-0.05, 0.05, (2, d))
        change = penetration(contacts, 0, x1, 0.4) - penetration(contacts, 0, x0, 0.4)
        assert mean(x0, x1) @ (x1 - x0) == pytest.approx(
            change, rel=1e-11 if not wavy else 2e-2, abs=1e-16 if not wavy else 2e-4
        )
        if contacts.kind[0] != PLANE:
            assert_tangent(
                lambda x, x0=x0: mean(x0, x), lambda x, x0=x0: by_end(x0, x)[:d, :d], x1, step=1e-5
            )
        gradient = [
            (penetration(contacts, 0, x0 + h, 0.4) - penetration(contacts, 0, x0 - h, 0.4)) / 2e-6
            for h in 1e-6 * np.eye(d)
        ]
        np.testing.assert_allclose(mean(x0, x0), gradient, rtol=1e-7, atol=1e-8)
    if wavy:  # to third order in the distance
        x0, way = rng.uniform(-0.05, 0.05, (2, d))
        before = penetration(contacts, 0, x0, 0.4)
        errors = [
            abs(
                mean(x0, x0 + s * way) @ way * s
                - penetration(contacts, 0, x0 + s * way, 0.4)
                + before
            )
            for s in (0.2, 0.1)
        ]
        assert slope([2, 1], errors) == pytest.approx(3.0, abs=0.3)


def test_penetration_at_large_radius_keeps_small_displacement() -> None:
    """The penetration of a casing of 2.5 m, at points some nanometres apart: its differences are
    accurate to 1e-7."""
    contacts = casing(2)._replace(
        centre=np.array([[-2.54, 0.0]]),
        radius=np.array([2.54]),
        times=np.zeros(0),
        approach=np.zeros((1, 0)),
    )
    for x in (1e-9, 3e-9, -2e-9):
        assert penetration(contacts, 0, np.array([x, 0.0]), 0.0) == pytest.approx(x, rel=1e-7)
        assert penetration(contacts, 0, np.array([0.0, 1e3 * x]), 0.0) == pytest.approx(
            (1e3 * x) ** 2 / (2 * 2.54), abs=1e-15
        )


def test_surface_rests_before_its_first_and_after_its_last_row() -> None:
    contacts = one_contact()._replace(
        times=np.array([1.0, 2.0, 4.0]), approach=np.array([[1e-3, 3e-3, 2e-3]])
    )
    depth = [penetration(contacts, 0, np.zeros(2), t) for t in (0.0, 1.0, 1.5, 3.0, 4.0, 5.0, 1e9)]
    np.testing.assert_allclose(depth, [1e-3, 1e-3, 2e-3, 2.5e-3, 2e-3, 2e-3, 2e-3], rtol=1e-12)
