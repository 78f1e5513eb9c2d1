"""Periods of what excites a scene, and the fixed steps that resolve them."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene import Scene, override_table, parse_scene
from fenicsrom.scene.keys.excitation import shortest_swing
from fenicsrom.scene.reading.reading import coarser

TEXT = (Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml").read_text()
HILL = "contacts.0.approach=[[0, 0], [0.1, 0], [0.102, 0.01], [0.108, 0.01], [0.11, 0]]"
SURFACE = (
    "contacts.0={group='tip', surface={kind='cylinder', point=[-10.0, 0.0], spin=%s, "
    "waves=[[4, 1e-3, 0.0], [50, 0.0, 0.0]]}, normal_stiffness=1e4, tangential_stiffness=1e4, "
    "friction=0.1}"
)


def parse(*overrides: str) -> Scene:
    return parse_scene(override_table(tomllib.loads(TEXT), overrides, "s.toml"), "s.toml", None)


def refused(*overrides: str) -> tuple[ErrorKind, str]:
    with pytest.raises(SceneError) as caught:
        parse(*overrides)
    return caught.value.kind, caught.value.key


def test_swing_of_a_table_is_its_width_at_half_height() -> None:
    time = np.linspace(0.0, 3.0, 1201)
    cosine = np.stack([time, np.cos(2.0 * np.pi * time / 0.5)], axis=1).tolist()
    assert 2.0 * shortest_swing(cosine) == pytest.approx(0.5, rel=2e-3)
    spike = [(0.0, 0.0), (1.0, 0.0), (1.1, 2.0), (1.2, 0.0), (9.0, 0.0)]
    assert shortest_swing(spike) == pytest.approx(0.1)
    valley = [(t, -v) for t, v in spike]
    assert shortest_swing(valley) == pytest.approx(0.1)
    plateau = [(0.0, 0.0), (1.0, 0.0), (1.1, 2.0), (1.5, 2.0), (1.7, 0.0)]
    assert shortest_swing(plateau) == pytest.approx(0.05 + 0.4 + 0.1)


def test_table_without_a_swing_has_no_period() -> None:
    for rows in ([(0.0, 1.0)], [(0.0, 1.0), (1.0, 1.0)], [(0.0, 0.0), (1e-9, 5.0), (1.0, 7.0)]):
        assert math.isinf(shortest_swing(rows))


def test_noise_of_a_table_does_not_count() -> None:
    time = np.linspace(0.0, 1.0, 401)
    noise = np.where(np.arange(401) % 2, 4e-4, -4e-4)
    rows = np.stack([time, np.cos(2.0 * np.pi * time / 0.5) + noise], axis=1).tolist()
    assert 2.0 * shortest_swing(rows) == pytest.approx(0.5, rel=0.02)
    assert shortest_swing(rows, small=1e-4) < 0.01


FAST = "loads=[{group='load', direction=[0, 1], force=1e-3, frequency=2.0}, %s]"
SECOND = "{group='load', direction=[0, 1], force=100.0, frequency=%s}"


@pytest.mark.parametrize(
    ("overrides", "needed"),
    [
        ((FAST % SECOND % 20.0,), 100),
        ((FAST % SECOND % "2.0, harmonics=[[1, 1.0, 0.0], [13, 0.1, 0.0]]",), 130),
        (("loads.0.frequency=5.0", HILL), 125),
        (("loads.0.frequency=5.0", SURFACE % (2.0 * math.pi * 5.0)), 40),
        (("loads.0.frequency=5.0", SURFACE % (-2.0 * math.pi * 10.0)), 80),
        (
            (
                "loads.0.frequency=5.0",
                SURFACE.replace("spin=%s, ", ""),
                "rotation.speed_rpm=300.0",
                "reference.beam=false",
            ),
            40,
        ),
    ],
)
def test_fixed_steps_resolve_the_fastest_excitation(
    overrides: tuple[str, ...], needed: int
) -> None:
    """Loads beside a slower one, harmonics, a surface that comes and leaves, waves that turn.

    The waves of the last case are at rest, and the body turns.
    """
    steps = "time.steps_per_period="
    assert parse(*overrides, f"{steps}{needed}").time.steps_per_period == needed
    found = refused(*overrides, f"{steps}{needed - 1}")
    assert found == (ErrorKind.CONFLICT, "time.steps_per_period")


def test_load_of_zero_and_surface_at_rest_need_no_steps() -> None:
    zero = FAST % (SECOND % 2000.0).replace("100.0", "0.0")
    assert parse(zero, "time.steps_per_period=10").time.steps_per_period == 10
    assert parse(SURFACE % 0.0, "time.steps_per_period=10").time.steps_per_period == 10


def test_engine_order_needs_its_steps() -> None:
    order = FAST % "{group='load', direction=[0, 1], force=1.0, engine_order=30}"
    turning = ("rotation.speed_rpm=120.0", "reference.beam=false")
    assert refused(order, *turning) == (ErrorKind.CONFLICT, "time.steps_per_period")
    assert parse(order, *turning, "time.steps_per_period=300").time.steps_per_period == 300


@pytest.mark.parametrize(
    ("history", "step"),
    [
        ("frequency=2.0, sweep={to=25.0, duration=1.0}", 4e-3),
        ("pulse={duration=0.02}", 4e-3),
        ("table=[[0, 0], [0.1, 0], [0.12, 1], [0.14, 0], [2, 0]]", 4e-3),
    ],
)
def test_fixed_step_resolves_sweep_impact_and_table(history: str, step: float) -> None:
    load = f"loads.0={{group='load', direction=[0, 1], force=1.0, {history}}}"
    time = "time={duration=1.0, step=%r}"
    fine = parse(load, time % step)
    assert coarser(fine).time.step == 2.0 * step  # a check may have longer steps
    assert refused(load, time % (1.01 * step)) == (ErrorKind.CONFLICT, "time.step")
    assert parse(load, "time={duration=1.0, tolerance=0.5}").time.tolerance == 0.5


def noisy(interval: float) -> str:
    """A load whose table is noise at its sample rate, 201 rows."""
    values = np.random.default_rng(8).uniform(-1.0, 1.0, 201)
    rows = [[k * interval, float(value)] for k, value in enumerate(values)]
    return f"loads.0={{group='load', direction=[0, 1], force=1.0, table={rows}}}"


@pytest.mark.parametrize("step", [5e-3, 5e-3 / 3.0])
def test_noisy_table_is_accepted_with_a_step_that_divides_its_times(step: float) -> None:
    time = "time={duration=1.0, step=%r}"
    assert parse(noisy(5e-3), time % step).time.step == step
    for other in (5e-3 * 2.0, 1.001 * step):
        assert refused(noisy(5e-3), time % other) == (ErrorKind.CONFLICT, "time.step")


def test_gap_and_preload_exclude_each_other() -> None:
    assert refused("contacts.0.gap=0.002") == (ErrorKind.CONFLICT, "contacts[0].gap")
    assert parse("contacts.0.gap=0.002", "contacts.0.preload=0").contacts[0].gap == 0.002
