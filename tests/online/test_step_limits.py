"""Adaptive steps miss no load and no surface, however large their tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import linear_model, no_contacts

from fenicsrom.online.contact.surfaces import Contacts, planes
from fenicsrom.online.model.loads import LoadHistories, of_loads
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.online.step.step import landings, longest_step
from fenicsrom.scene import Load, Time

FREE = no_contacts()


def histories(**given: Any) -> LoadHistories:
    return of_loads([Load.of(group="tip", direction=(0.0, 1.0), force=1.0, **given)])


def wall(rows: list[tuple[float, float]]) -> Contacts:
    """A plane at the distance 1 that approaches."""
    ones = np.ones(1)
    found = planes(0.0 * ones, ones, ones, ones, 0.0 * ones, 1)
    times, distance = np.array(rows).T
    return found._replace(times=times, approach=distance[None, :])


def test_longest_step_follows_the_cube_root_of_the_tolerance() -> None:
    slow_and_fast = of_loads(
        [
            Load.of(group="tip", direction=(0.0, 1.0), force=1.0, frequency=f, **more)
            for f, more in ((1.0, {}), (2.0, {"harmonics": [[1, 1.0, 0.0], [25, 0.1, 0.0]]}))
        ]
    )
    for tolerance in (1.0, 1e-3):
        share = longest_step(slow_and_fast, FREE, tolerance) * 50.0
        assert share == pytest.approx(0.2 * tolerance ** (1 / 3))
    assert 50.0 * longest_step(slow_and_fast, FREE, 8.0) < 0.5  # the check of the largest tolerance


def test_longest_step_resolves_waves_that_pass_a_point() -> None:
    waves = wall([(0.0, 0.0)])._replace(
        order=np.array([3.0, 40.0]), height=np.array([[1e-3, 0.0]]), spin=np.array([-20.0 * np.pi])
    )
    none = of_loads(())
    assert longest_step(none, waves, 1.0) == pytest.approx(0.2 / 30.0)
    assert longest_step(none, waves._replace(spin=np.zeros(1)), 1.0) == np.inf


def test_steps_land_on_corners_of_tables_and_approach_but_not_on_straight_rows() -> None:
    table = histories(table=[[0.0, 0.0], [0.5, 1.0], [1.0, 2.0], [1.5, 1.0], [4.0, 1.0]])
    contacts = wall([(0.25, 0.0), (0.75, 1.0), (1.25, 2.0), (5.0, 2.0)])
    assert landings(table, contacts, 0.0, 3.0).tolist() == [0.25, 1.0, 1.25, 1.5, 3.0]
    assert landings(table, contacts, 1.0, 2.0).tolist() == [1.25, 1.5, 2.0]
    assert landings(of_loads(()), FREE, 1.0, 2.0).tolist() == [2.0]


def run(found: LoadHistories, contacts: Contacts, tolerance: float, duration: float) -> Motion:
    """x'' + x = load, in plain Python."""
    model = linear_model(1.0, 1.0, loads=[[1.0]], load_histories=found)
    time = Time.of(duration=duration, tolerance=tolerance)
    return integrate(Problem(model, contacts, time, None), compiled=False)


@pytest.mark.slow
def test_spike_of_a_table_gives_its_whole_impulse() -> None:
    """x'' + x = spike of the impulse 0.01 at t = 3: the amplitude afterwards is 0.01."""
    spike = histories(table=[[0, 0], [2.99, 0], [3.0, 1.0], [3.01, 0], [9, 0]])
    motion = run(spike, FREE, 0.1, 6.0)
    assert np.abs(motion.displacement).max() == pytest.approx(0.01, rel=0.05)


def test_small_fast_load_is_not_sampled_at_its_zeros() -> None:
    """The load of omega = 40 moves the mass by 1/1599 of its size; 10 steps per period see it."""
    fast = histories(frequency=20.0 / np.pi)
    motion = run(fast, FREE, 0.9, 3.0)
    assert np.diff(motion.time).max() <= 0.2 * np.pi / 20.0
    assert np.abs(motion.displacement).max() > 1e-2
