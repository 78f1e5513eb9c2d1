"""Follower pressures of reduced models: tangents, energy ledger, derivatives, stored models."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import (
    STOCKY,
    assert_tangent,
    beam_scene,
    first,
    harmonic,
    one_contact,
    random_polynomial,
    refusal,
)

from fenicsrom.errors import ErrorKind
from fenicsrom.online.model.loads import PressurePolynomial, factors, unit_tangent
from fenicsrom.online.model.matrices import model_arrays
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import paired_cubic, unique_cubic
from fenicsrom.online.periodic.period_map import PeriodMap
from fenicsrom.online.periodic.shooting import damping_family, force_family, frequency_family
from fenicsrom.online.run.march import integrate
from fenicsrom.online.step.state import scheme
from fenicsrom.online.step.step import DONE
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.online.store.store import fingerprint
from fenicsrom.scene import Scene, Time

Array = NDArray[np.float64]

SCHEMES = ["discrete-gradient", "average-acceleration", "generalised-alpha"]
OMEGA, STATIC = 1.3, 0.2
PERIOD = 2.0 * np.pi / OMEGA


def pressed(n: int = 3, *, masters: int = 0, depth: int | None = None) -> ReducedModel:
    """A model under a force, a pressure that varies in time and a static one."""
    rng = np.random.default_rng(7)
    root = rng.standard_normal((n, n))
    quadratic = rng.standard_normal((2, n, n, n))
    quadratic = 0.1 * (quadratic + quadratic.transpose(0, 3, 2, 1))  # symmetric in c and j
    pressure = PressurePolynomial(
        np.array([1, 2]), 0.4 * rng.standard_normal((2, n, n)), quadratic[:, :depth]
    )
    histories = harmonic(
        np.array([1.0, 0.6, STATIC]),
        np.array([OMEGA, 2.0 * OMEGA, 0.0]),
        np.array([0.3, 0.7, 0.5 * np.pi]),
    )
    return reduced_model(
        np.eye(n) + 0.2 * root @ root.T,
        0.3,
        random_polynomial(n, seed=2),
        rng.uniform(0.5, 1.0, (n, 3)),
        histories,
        *first(masters, n),
        np.eye(2, n),
        np.zeros(2),
        pressure=pressure,
    )


# ------------------------------------------------------------------ forces


@pytest.mark.parametrize("depth", [None, 0])
@pytest.mark.parametrize("name", SCHEMES)
def test_force_of_a_step_is_its_mean_and_its_tangent(name: str, depth: int | None) -> None:
    model = pressed(depth=depth)
    plan, q0 = scheme(name, model, 0.8), np.array([0.3, -0.5, 0.2])
    without = model._replace(
        pressure=PressurePolynomial(np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0,) * 4))
    )

    def over_step(of: ReducedModel, dq: Array) -> tuple[Array, Array]:
        of.set_interval(0.4, 0.9)
        arguments = np.zeros(3), q0, dq, plan.start_weight, plan.points, plan.weights
        force, tangent = of.elastic_over_step(*arguments)
        return force.copy(), tangent.matrix.copy()

    dq = np.array([0.4, 0.1, -0.6])
    assert_tangent(lambda x: over_step(model, x)[0], lambda x: over_step(model, x)[1], dq)
    begin, end = (model.load_histories, 0.4), (model.load_histories, 0.9)
    expected = np.zeros(3)
    for s, weight in zip(plan.points, plan.weights, strict=True):
        both = (1.0 - s) * factors(*begin) + s * factors(*end)
        for k, number in enumerate(model.pressure.numbers):
            q = q0 + s * dq
            tangent = model.pressure.linear[k] + unit_tangent(model.pressure, k, q)
            expected += weight * both[number] * 0.5 * tangent @ q
    np.testing.assert_allclose(
        over_step(without, dq)[0] - over_step(model, dq)[0], expected, rtol=1e-12
    )


def test_model_at_rest_feels_the_static_pressure_only() -> None:
    model = pressed()
    model.set_interval(0.4, 0.9)
    model.set_at_rest()
    zero, one = np.zeros(3), np.ones(1)
    tangent = model.elastic_over_step(zero, zero, zero, 0.0, one, one)[1].matrix
    expected = model.elastic.stiffness - STATIC * unit_tangent(model.pressure, 1, zero)
    np.testing.assert_allclose(tangent, expected, rtol=1e-14)
    np.testing.assert_allclose(model.rest_stiffness(), expected, rtol=1e-14)


# ------------------------------------------------------------------ motions


def moving(name: str, *, compiled: bool = True, contact: bool = False) -> Any:
    model = pressed(masters=2 if contact else 0)
    touch = one_contact(normal_stiffness=6.0, tangential_stiffness=5.0, friction=0.4, gap=0.1)
    contacts = touch if contact else one_contact(preload=[])
    settings = Time.of(
        periods=2, steps_per_period=60, steady_tolerance=0.0, scheme=name, steady="march"
    )
    if name == "generalised-alpha":
        settings = settings.changed(spectral_radius=0.8)
    return integrate(Problem(model, contacts, settings, PERIOD), compiled=compiled)


@pytest.mark.parametrize("contact", [False, True])
def test_discrete_gradient_balances_the_work_of_pressures(contact: bool) -> None:
    motion = moving("discrete-gradient", contact=contact)
    size = np.max(motion.kinetic + np.abs(motion.elastic)) + np.max(np.abs(motion.work))
    assert np.abs(motion.imbalance).max() < 1e-12 * size
    assert not contact or {-1, 0} <= set(motion.state.ravel())


def test_ledger_of_average_acceleration_is_of_second_order() -> None:
    model, found = pressed(), []
    for steps in (100, 200):
        settings = Time.of(
            periods=1,
            steps_per_period=steps,
            steady_tolerance=0.0,
            scheme="average-acceleration",
            steady="march",
        )
        motion = integrate(Problem(model, one_contact(preload=[]), settings, PERIOD))
        found.append(np.abs(motion.imbalance).max())
    assert np.log2(found[0] / found[1]) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("name", SCHEMES)
def test_compiled_motion_equals_the_plain_one(name: str) -> None:
    one, other = moving(name), moving(name, compiled=False)
    np.testing.assert_allclose(
        one.displacement, other.displacement, rtol=0, atol=1e-12 * np.abs(one.displacement).max()
    )
    np.testing.assert_allclose(one.work, other.work, rtol=0, atol=1e-12 * np.abs(one.work).max())


def test_resumed_motion_equals_the_whole_one_bit_for_bit() -> None:
    model, contacts, kept = pressed(), one_contact(preload=[]), []
    settings = Time.of(periods=2, steps_per_period=60, steady_tolerance=0.0, steady="march")

    def keep(here: Any) -> None:
        kept.append(copy.deepcopy(here))

    whole = integrate(Problem(model, contacts, settings, PERIOD), checkpoint=keep)
    resumed = integrate(Problem(model, contacts, settings, PERIOD), resume=kept[0])
    np.testing.assert_array_equal(resumed.displacement[-60:], whole.displacement[-60:])
    np.testing.assert_array_equal(resumed.work[-60:], whole.work[-60:])


@pytest.mark.parametrize("name", SCHEMES)
def test_derivatives_of_the_period_match_differences(name: str) -> None:
    model, contacts = pressed(), one_contact(preload=[])
    plan = scheme(name, model, 0.8)
    problem = Problem(model, contacts, None, PERIOD)
    pmap = PeriodMap(problem, plan, np.linspace(0.0, 1.0, 41))

    def end(z: Array, at: Any = None, **options: Any) -> Any:
        status, found = pmap(problem if at is None else at, z, **options)
        assert status == DONE
        return found

    z = np.zeros(pmap.size)
    for _ in range(3):
        z = end(z, derive=False).z
    h, columns = 1e-6, []
    for e in np.eye(z.size):
        columns.append((end(z + h * e, derive=False).z - end(z - h * e, derive=False).z) / (2 * h))
    differences = np.array(columns).T
    size = np.abs(differences).max()
    assert np.abs(end(z).matrix - differences).max() <= 1e-7 * size
    families = (
        (force_family(problem, 1), 0.6),
        (frequency_family(problem), 1.0),
        (damping_family(problem), 0.3),
    )
    for family, value in families:
        found = end(z, family(value)).by_parameter
        ahead, behind = (end(z, family(value + s), derive=False).z for s in (h, -h))
        differences = (ahead - behind) / (2.0 * h)
        assert np.abs(differences).max() > 0.0
        assert np.abs(found - differences).max() <= 1e-6 * np.abs(differences).max()


# ------------------------------------------------------------------ stored models


def scene_with(*overrides: str) -> Scene:
    loads = [
        {"group": "load", "direction": [0.0, 1.0], "force": 1.0, "frequency": 1.0},
        {"group": "tip", "pressure": 0.6, "follower": True, "frequency": 2.0},
        {"group": "tip", "pressure": STATIC, "follower": True},
    ]
    return beam_scene(2, (*STOCKY, "time.periods=2", *overrides), contacts=None, loads=loads)


@pytest.fixture
def stored() -> StoredModel:
    scene, made = scene_with(), pressed(depth=0)
    cubic = paired_cubic(unique_cubic(made.elastic.cubic, 3), 3)  # symmetric, as a file stores it
    model = StoredModel(
        made._replace(elastic=made.elastic._replace(cubic=cubic)),
        scene,
        "rubin",
        ("1V", "2V", "3V"),
        9,
        np.array([1.0, 2.0]),
        {},
    )
    return model.with_scene(scene)


def test_stored_model_keeps_its_pressures(stored: StoredModel, tmp_path: Path) -> None:
    save_model(tmp_path / "model.npz", stored)
    again = load_model(tmp_path / "model.npz").model
    for name, array in stored.model.pressure._asdict().items():
        np.testing.assert_array_equal(getattr(again.pressure, name), array)
    assert fingerprint(again) == fingerprint(stored.model)
    changed = again.pressure._replace(linear=np.ones((2, 3, 3)))
    assert fingerprint(again._replace(pressure=changed)) != fingerprint(again)


def test_stored_model_runs_under_another_pressure_that_varies(stored: StoredModel) -> None:
    changed = stored.with_scene(scene_with("loads.1.pressure=0.3"))
    ends = []
    for model in (stored.model, changed.model):
        model.set_interval(0.0, 0.1)
        ends.append(model.work.pressure_factors[1].copy())
    np.testing.assert_allclose(ends[1], ends[0] * [0.5, 1.0])


@pytest.mark.parametrize(
    ("override", "key"),
    [("loads.1.follower=false", "loads[1].follower"), ("loads.2.pressure=0.3", "loads[2]")],
)
def test_scene_with_another_equilibrium_is_refused(
    stored: StoredModel, override: str, key: str
) -> None:
    with refusal(ErrorKind.MISMATCH, f"{key}: a static load" if "2" in key else key):
        stored.with_scene(scene_with(override))


def test_arrays_for_other_programs_refuse_a_follower_pressure(stored: StoredModel) -> None:
    with refusal(ErrorKind.CONFLICT, "loads[1].follower"):
        model_arrays(stored.model, "scene.toml")
