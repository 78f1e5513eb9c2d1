"""Time factors of the loads against their formulas, and the motions that they cause against known
solutions."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from support import harmonic, linear_model, no_contacts

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.model import loads as load_histories
from fenicsrom.online.model.loads import (
    LoadHistories,
    factors,
    instants,
    largest,
    of_loads,
    quarter_period,
)
from fenicsrom.online.model.model import Problem
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.march import integrate
from fenicsrom.online.store.scene_changes import changed_key
from fenicsrom.scene import (
    Load,
    PulseTable,
    Scene,
    SweepTable,
    Time,
    override_table,
    parse_scene,
    scene_table,
)
from fenicsrom.scene.keys.excitation import shortest_period

Array = NDArray[np.float64]

TABLE = ((0.5, 0.0), (1.0, 2.0), (1.5, -1.0), (3.0, -1.0))


def load(**given: Any) -> Load:
    return Load.of(group="tip", direction=(0.0, 1.0), **({"force": 3.0} | given))


LOADS = [
    load(frequency=2.0, phase=0.3),
    load(force=-5.0),
    load(frequency=2.0, harmonics=((1, 1.0, 0.2), (3, -0.5, 0.0), (5, 0.25, 1.0))),
    load(pulse=PulseTable(start=0.4, duration=0.2)),
    load(table=TABLE),
    load(frequency=2.0, sweep=SweepTable(to=5.0, duration=1.5), phase=0.3),
    load(frequency=8.0, sweep=SweepTable(to=1.0, duration=1.5, kind="logarithmic")),
]


def at(found: LoadHistories, times: Any) -> Array:
    """Factors (times, loads) at these times."""
    return np.array([factors(found, float(time)) for time in times])


def test_factor_of_each_history_matches_its_formula() -> None:
    t = np.linspace(-0.5, 4.0, 451)
    w = 2 * np.pi
    inside = (t >= 0.4) & (t <= 0.6)
    expected = [
        3 * np.sin(2 * w * t + 0.3) * (t >= 0),
        -5.0 + 0 * t,
        3
        * (np.sin(2 * w * t + 0.2) - 0.5 * np.sin(6 * w * t) + 0.25 * np.sin(10 * w * t + 1.0))
        * (t >= 0),
        3 * np.sin(np.pi * (t - 0.4) / 0.2) * inside,
        3 * np.interp(t, *zip(*TABLE, strict=True)),
    ]
    found = at(of_loads(LOADS), t)
    late = t >= 0.0
    for k, curve in enumerate(expected):
        np.testing.assert_allclose(found[late, k], curve[late], rtol=0, atol=1e-11)
    assert found[late, 3].max() == pytest.approx(3.0)


@pytest.mark.parametrize(("index", "low", "high"), [(5, 2.0, 5.0), (6, 8.0, 1.0)])
def test_sweep_has_its_start_and_end_frequency(index: int, low: float, high: float) -> None:
    """The angle is the integral of the frequency, which is linear or logarithmic in time and
    constant after the sweep."""

    def frequency(time: float) -> float:
        share = min(time / 1.5, 1.0)
        return low + (high - low) * share if index == 5 else low * (high / low) ** share

    phase = 0.3 if index == 5 else 0.0
    for time in (0.0, 0.2, 0.9, 1.5, 1.7, 3.1):
        angle = (
            phase + 2 * np.pi * quad(frequency, 0.0, time, points=[1.5] if time > 1.5 else None)[0]
        )
        assert factors(of_loads(LOADS), time)[index] == pytest.approx(3 * np.sin(angle), abs=1e-9)


def test_compiled_factors_equal_plain_python() -> None:
    found = of_loads(LOADS)
    for time in (0.0, 0.45, 0.5, 0.6, 1.2, 5.0):
        plain = np.full(len(LOADS), np.nan)
        load_histories.write_factors.py_func(found, time, plain)
        np.testing.assert_allclose(factors(found, time), plain, rtol=1e-14, atol=1e-14)


def test_largest_factor_of_each_history_is_known() -> None:
    found = of_loads(LOADS)
    bound = largest(found)
    np.testing.assert_allclose(bound, [3.0, 5.0, 3 * 1.75, 3.0, 6.0, 3.0, 3.0])
    seen = np.abs(at(found, np.linspace(0, 4, 8001))).max(axis=0)
    assert np.all(seen <= bound * (1 + 1e-12))
    np.testing.assert_allclose(np.delete(seen, 2), np.delete(bound, 2), rtol=1e-4)


def test_steps_end_at_corners_and_respect_the_longest_step() -> None:
    found = of_loads(LOADS)
    np.testing.assert_allclose(instants(found, 2.0), [0.4, 0.45, 0.5, 0.55, 0.6, 1.0, 1.5, 2.0])
    assert quarter_period(found) == pytest.approx(1 / 40)  # of the fifth harmonic
    assert quarter_period(of_loads(LOADS[5:])) == pytest.approx(1 / 32)
    assert quarter_period(of_loads(LOADS[5:6])) == pytest.approx(1 / 20)
    assert quarter_period(of_loads(LOADS[3:5])) == quarter_period(of_loads(LOADS[1:2])) == np.inf
    assert instants(of_loads(()), 2.0).tolist() == [2.0] and largest(of_loads(())).size == 0
    assert [shortest_period(load) for load in LOADS[:4] + LOADS[5:]] == pytest.approx(
        [1 / 2, np.inf, 1 / 10, 0.4, 1 / 5, 1 / 8]
    )


# ------------------------------------------------------------------ motions

DAMPING, STIFFNESS = 0.4, 50.0
FREE = no_contacts()


def oscillator(found: LoadHistories) -> Any:
    count = found.spans.shape[0]
    return linear_model(
        2.0, STIFFNESS, damping=DAMPING, loads=np.ones((1, count)), load_histories=found
    )


def duhamel(force: Any, times: Array, breaks: list[float]) -> Array:
    """x(t) = 1/(m w_d) int_0^t force(s) exp(-d/2 (t-s)) sin(w_d (t-s)) ds."""
    wd = np.sqrt(STIFFNESS / 2.0 - DAMPING**2 / 4)

    def response(t: float) -> float:
        def kernel(s: float) -> float:
            return force(s) * np.exp(-0.5 * DAMPING * (t - s)) * np.sin(wd * (t - s)) / (2.0 * wd)

        ends = [0.0, *(b for b in breaks if b < t), t]
        return sum(
            quad(kernel, a, b, epsabs=1e-12, limit=200)[0] for a, b in itertools.pairwise(ends)
        )

    return np.array([response(t) for t in times])


def run(found: LoadHistories, **time: Any) -> Motion:
    return integrate(Problem(oscillator(found), FREE, Time.of(**time), None))


@pytest.mark.parametrize("settings", [{"step": 1e-3}, {"tolerance": 1e-5}])
def test_response_to_impact_matches_duhamels_integral(settings: dict[str, float]) -> None:
    """Reference: response to an impact | Duhamel's integral | closed form | agrees | 0.02 %"""
    found = of_loads([load(pulse=PulseTable(start=0.3, duration=0.25))])
    motion = run(found, duration=2.0, **settings)
    part = np.arange(5, motion.time.size, max(1, motion.time.size // 25))
    exact = duhamel(lambda s: factors(found, s)[0], motion.time[part], [0.3, 0.55])
    np.testing.assert_allclose(
        motion.displacement[part, 0, 0], exact, rtol=0, atol=2e-4 * np.abs(exact).max()
    )


@pytest.mark.parametrize("kind", ["pulse", "table"])
@pytest.mark.parametrize("start", [0.0, 7.77])
def test_adaptive_steps_do_not_miss_a_short_impact(start: float, kind: str) -> None:
    """The impact lasts a thousandth of the run; after it, the free vibration of its impulse
    remains. The tolerance is relative to the static response to the peak load, which is forty times
    the free vibration."""
    short = 0.01
    given = {"pulse": PulseTable(start=start, duration=short)}
    if kind == "table":
        given = {"table": ((start, 0.0), (start + 0.5 * short, 1.0), (start + short, 0.0))}
    motion = run(of_loads([load(**given)]), duration=10.0, tolerance=1e-4)
    impulse = 3.0 * short * (2 / np.pi if kind == "pulse" else 0.5)
    wd = np.sqrt(STIFFNESS / 2.0 - DAMPING**2 / 4)
    late = motion.time > start + short
    since = motion.time[late] - start - 0.5 * short
    exact = impulse / (2.0 * wd) * np.exp(-0.5 * DAMPING * since) * np.sin(wd * since)
    np.testing.assert_allclose(
        motion.displacement[late, 0, 0], exact, rtol=0, atol=4e-4 * 3.0 / STIFFNESS
    )
    assert np.abs(exact).max() > 50 * 4e-4 * 3.0 / STIFFNESS and motion.steps < 600


@pytest.mark.slow
def test_adaptive_steps_do_not_alias_a_fast_load() -> None:
    """A sine of 100 Hz over 100 s: without the load history, the first step would be a whole period
    of it."""
    found = of_loads([load(frequency=100.0, sweep=SweepTable(to=100.0, duration=1.0))])
    motion = run(found, duration=100.0, tolerance=1e-4)
    w, wd = 200 * np.pi, np.sqrt(STIFFNESS / 2.0 - DAMPING**2 / 4)
    early = motion.time < 2.0
    assert np.diff(motion.time).max() <= 0.0025 * (1 + 1e-9)
    # it starts as if struck by the mean impulse F / omega of the first half-period
    exact = (
        1.5
        / (w * wd)
        * np.exp(-0.5 * DAMPING * motion.time[early])
        * np.sin(wd * motion.time[early])
    )
    np.testing.assert_allclose(
        motion.displacement[early, 0, 0], exact, rtol=0, atol=0.05 * np.abs(exact).max()
    )


def test_response_to_harmonics_is_the_sum_of_single_responses() -> None:
    orders = ((1, 1.0, 0.2), (2, -0.5, 0.0), (5, 0.25, 1.0))
    time = {"steps_per_period": 200, "periods": 3, "steady_tolerance": 0.0}
    whole = integrate(
        Problem(
            oscillator(of_loads([load(frequency=0.7, harmonics=orders)])),
            FREE,
            Time.of(**time),
            1 / 0.7,
        )
    )
    parts = [
        integrate(
            Problem(
                oscillator(harmonic(3 * a, n * 0.7 * 2 * np.pi, phase)),
                FREE,
                Time.of(**time),
                1 / 0.7,
            )
        )
        for n, a, phase in orders
    ]
    assert whole.steps == 600
    together = sum(part.displacement for part in parts)
    np.testing.assert_allclose(
        whole.displacement, together, rtol=0, atol=1e-12 * np.abs(together).max()
    )


def test_response_to_dense_table_matches_its_harmonic() -> None:
    times = np.linspace(0.0, 2.0, 2001)
    table = tuple(zip(times.tolist(), np.sin(2 * np.pi * 1.3 * times).tolist(), strict=True))
    one = run(of_loads([load(table=table)]), duration=2.0, step=2e-3)
    other = run(harmonic(3.0, 2 * np.pi * 1.3, 0.0), duration=2.0, step=2e-3)
    np.testing.assert_allclose(
        one.displacement, other.displacement, rtol=0, atol=1e-9 * np.abs(other.displacement).max()
    )


# ------------------------------------------------------------------ scenes

SCENE = """
geometrically_nonlinear = false
[geometry]
mesh = "beam2d.geo"
dimension = 2
thickness = 0.01
[material]
young = 207e9
poisson = 0.28
density = 7801
[[supports]]
group = "root"
[[loads]]
group = "load"
direction = [0.0, 1.0]
force = 100
"""


def parse(*overrides: str, text: str = SCENE, folder: Path | None = None) -> Scene:
    return parse_scene(override_table(tomllib.loads(text), overrides, "s"), "s", folder)


def refused(*overrides: str, folder: Path | None = None) -> tuple[ErrorKind, str]:
    with pytest.raises(SceneError) as caught:
        parse(*overrides, folder=folder)
    return caught.value.kind, caught.value.key


def test_table_file_is_read_into_the_scene(tmp_path: Path) -> None:
    time = "time={duration=1.0, step=1e-3}"
    for name, text in {
        "a.csv": "time,factor\n0,0\n0.5,1\n1,-1\n",
        "b.csv": "# measured\n t ; f\n0;0\n\n0.5 ; 1\n1;-1",
        "c.txt": "0 0\n0.5\t1\n1 -1\n",
    }.items():
        (tmp_path / name).write_text(text)
        (tmp_path / "beam2d.geo").touch()
        scene = parse(f'loads.0.table="{name}"', time, folder=tmp_path)
        assert scene.loads[0].history.rows == ((0.0, 0.0), (0.5, 1.0), (1.0, -1.0))
        assert scene.period is None and not scene.static_only
        (tmp_path / name).unlink()
        assert parse_scene(scene_table(scene), "s", tmp_path) == scene


@pytest.mark.parametrize(
    ("text", "kind", "line"),
    [
        ("t,f\n0,0\n1,x\n", ErrorKind.TYPE, 3),
        ("0,0\n1,1\n1,2\n", ErrorKind.RANGE, 3),
        ("t,f\n0,0\n", ErrorKind.RANGE, None),
        (b"\xff\xfe\x00", ErrorKind.FILE, None),
        (None, ErrorKind.FILE, None),
    ],
)
def test_damaged_table_is_refused_with_its_line(
    text: Any, kind: ErrorKind, line: int | None, tmp_path: Path
) -> None:
    (tmp_path / "beam2d.geo").touch()
    if text is not None:
        (tmp_path / "a.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    found = refused('loads.0.table="a.csv"', "time={duration=1.0, step=1e-3}", folder=tmp_path)
    where = "" if line is None else f' = "a.csv": line {line}'
    assert found == (kind, f"loads[0].table{where}")


HARMONIC, TWICE = "loads.0.frequency=2.0", ["loads.0.harmonics=[[2, 1, 0]]"]
TIME = "time={duration=1.0, step=1e-3}"


def whole(keys: str) -> str:
    """The override of a whole load; that of a single key would remove the keys it excludes."""
    return f"loads=[{{group='load', direction=[0.0, 1.0], force=100, {keys}}}]"


SWEEP = [HARMONIC, "loads.0.sweep={to=8.0, duration=1}"]


def test_stored_model_changes_history_and_refuses_new_direction() -> None:
    made = parse(HARMONIC)
    for change in (
        "loads.0.frequency=5.0",
        "loads.0.phase=0.1",
        "loads.0.force=1.0",
        "loads.0.harmonics=[[1, 1, 0], [2, 1, 0]]",
    ):
        assert changed_key(made, parse(HARMONIC, change)) is None
    assert (
        changed_key(made, parse(*SWEEP, TIME))
        is changed_key(made, parse("loads.0.pulse={duration=0.1}", TIME))
        is None
    )
    traction = "loads.0={group='load', direction=[0, 1], traction=100.0, frequency=2.0}"
    assert changed_key(made, parse(traction)) == "loads[0].traction"
    assert changed_key(made, parse()) == "loads[0]: a static load"
    assert changed_key(made, parse(HARMONIC, "loads.0.direction=[1, 0]")) == "loads[0].direction"


def test_period_and_static_flag_of_each_history_are_known() -> None:
    assert parse().static_only and parse().period is None
    assert not parse(TIME).static_only
    harmonics = parse(HARMONIC, "loads.0.harmonics=[[2, 1, 0], [3, 1, 0]]")
    assert harmonics.period == 0.5 and harmonics.time.steps_per_period == 200
    assert parse(*SWEEP, TIME).period is None
