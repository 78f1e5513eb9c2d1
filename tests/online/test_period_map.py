"""The derivative of the period map against central differences of the compiled march."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from support import fresh_python, harmonic, linear_model, one_contact, random_model

from fenicsrom.online.contact.law import implicit_blending
from fenicsrom.online.contact.state import OPEN, SLIP, STICK
from fenicsrom.online.contact.surfaces import CYLINDER, PLANE, SPHERE, Contacts
from fenicsrom.online.derivative.period_sensitivity import (
    differentiate_blending,
    drift_of,
    no_sensitivity,
)
from fenicsrom.online.kernels.numbers import STEP
from fenicsrom.online.model.loads import PHASE
from fenicsrom.online.model.model import Problem, ReducedModel
from fenicsrom.online.model.turning import Turning, rest_row
from fenicsrom.online.periodic.period_map import PeriodMap
from fenicsrom.online.periodic.shooting import (
    Family,
    contact_family,
    damping_family,
    family_of,
    force_family,
    frequency_family,
    speed_family,
)
from fenicsrom.online.step.state import scheme
from fenicsrom.online.step.step import DONE
from fenicsrom.progress import asking

Array = NDArray[np.float64]

SCHEMES = ["discrete-gradient", "average-acceleration", "generalised-alpha"]
PERIOD = 2.0 * np.pi / 1.3
STEPS = 60
UNEQUAL = np.concatenate([np.linspace(0.0, 0.5, 41), 0.5 + np.linspace(0.0, 0.5, 21)[1:]])


def shaken(dimension: int = 2, n: int = 4, *, nonlinear: bool = True) -> ReducedModel:
    """A model whose first coordinates are the displacement of one contact point."""
    if nonlinear and dimension == 2:
        return random_model(n, seed=3, damping=0.1, masters=2, force=2.0, omega=1.3)
    rng = np.random.default_rng(5)
    root = rng.standard_normal((n, n))
    return linear_model(
        np.eye(n) + 0.2 * root @ root.T,
        np.diag(1.0 + np.arange(n)) + 0.1 * (root + root.T),
        damping=0.1,
        loads=rng.uniform(0.5, 1.5, (n, 1)),
        load_histories=harmonic(np.array([3.0]), np.array([1.3]), np.array([0.3])),
        masters=dimension,
    )


def curved(contacts: Contacts, kind: int, spin: float) -> Contacts:
    """Contacts in front of the inside of a turning surface of radius 3 m; a cylinder has waves."""
    d = contacts.centre.shape[1]
    waves = 2 if kind == CYLINDER else 0
    centre = np.zeros_like(contacts.centre)
    centre[:, 0] = -3.0
    axes = np.tile(np.eye(d), (contacts.preload.size, 1, 1))
    return contacts._replace(
        kind=np.full(contacts.preload.size, kind),
        axes=axes,
        centre=centre,
        radius=np.full(contacts.preload.size, 3.0),
        spin=np.full(contacts.preload.size, spin),
        order=np.arange(1.0, 1.0 + waves),
        height=np.full((contacts.preload.size, waves), 0.05),
        phase=np.full((contacts.preload.size, waves), 0.4),
    )


RUB: dict[str, Any] = {
    "preload": 0.4,
    "normal_stiffness": 6.0,
    "tangential_stiffness": 5.0,
    "friction": 0.4,
}


def period_map(model: ReducedModel, contacts: Contacts, name: str) -> PeriodMap:
    plan = scheme(name, model, 0.8)
    return PeriodMap(Problem(model, contacts, None, None), plan, np.linspace(0.0, 1.0, STEPS + 1))


def end(pmap: PeriodMap, model: ReducedModel, contacts: Contacts, z: Array, **options: Any) -> Any:
    problem = Problem(model, contacts, None, options.pop("period", PERIOD))
    status, found = pmap(problem, z, **options)
    assert status == DONE
    return found


def run_in(pmap: PeriodMap, model: ReducedModel, contacts: Contacts, periods: int = 6) -> Array:
    """The state after some periods from rest."""
    z = np.zeros(pmap.size)
    for _ in range(periods):
        z = end(pmap, model, contacts, z, derive=False).z
    return z


def assert_matrix(
    pmap: PeriodMap,
    model: ReducedModel,
    contacts: Contacts,
    z: Array,
    *,
    step: float = 1e-6,
    tolerance: float = 2e-6,
) -> Any:
    """Compare the monodromy matrix with central differences of the march."""
    found = end(pmap, model, contacts, z)
    columns = []
    for k in range(z.size):
        change = np.zeros(z.size)
        change[k] = step
        ahead = end(pmap, model, contacts, z + change, derive=False).z
        behind = end(pmap, model, contacts, z - change, derive=False).z
        columns.append((ahead - behind) / (2.0 * step))
    differences = np.array(columns).T
    size = np.abs(differences).max()
    assert np.abs(found.matrix - differences).max() <= tolerance * size
    return found


def assert_by_parameter(
    pmap: PeriodMap, at: Callable[[float], Problem], value: float, z: Array, h: float = 1e-6
) -> Any:
    """Compare the derivative by a parameter with central differences of the march."""
    status, found = pmap(at(value), z)
    assert status == DONE
    ahead, behind = (pmap(at(value + k), z, derive=False)[1].z for k in (h, -h))
    differences = (ahead - behind) / (2.0 * h)
    assert np.abs(found.by_parameter - differences).max() <= 3e-6 * np.abs(differences).max()
    return found


def test_derivatives_are_compiled_once_for_two_and_three_dimensions() -> None:
    signatures = []
    for dimension in (2, 3):
        model, contacts = shaken(dimension), one_contact(dimension, **RUB)
        pmap = period_map(model, contacts, "discrete-gradient")
        drift = drift_of(Problem(model, contacts, None, PERIOD))
        arguments = model, contacts, pmap.plan, drift, pmap._record, pmap._sensitivity
        signatures.append([numba.typeof(value) for value in arguments])
    assert signatures[0] == signatures[1]


def unequal_map(model: ReducedModel, contacts: Contacts) -> PeriodMap:
    """A period map with twice as many steps in the first half of the period as in the second."""
    plan = scheme("discrete-gradient", model, 0.8)
    return PeriodMap(Problem(model, contacts, None, None), plan, UNEQUAL)


def test_unequal_intervals_are_marched_in_turn() -> None:
    model, contacts = shaken(), one_contact(**RUB)
    pmap = unequal_map(model, contacts)
    found = assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))
    np.testing.assert_allclose(found.record.time, PERIOD * UNEQUAL[1:], rtol=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
def test_period_in_parts_that_can_be_interrupted_is_the_same(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, contacts = shaken(), one_contact(**RUB)
    pmap = period_map(model, contacts, name)
    z = run_in(pmap, model, contacts)
    whole = end(pmap, model, contacts, z)
    monkeypatch.setattr(pmap, "_rows", 7)
    parts = end(pmap, model, contacts, z)
    np.testing.assert_array_equal(parts.z, whole.z)
    np.testing.assert_array_equal(parts.matrix, whole.matrix)
    np.testing.assert_array_equal(parts.record.time, whole.record.time)
    asked: list[bool] = []
    with (
        pytest.raises(KeyboardInterrupt),
        asking(lambda: bool(asked.append(True) or len(asked) > 12)),
    ):
        end(pmap, model, contacts, z)
    assert 9 <= STEPS // 7 + 1 < len(asked)  # within the derivatives


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize(
    ("preload", "friction", "states"),
    [
        (0.4, 0.4, {OPEN, SLIP, STICK}),
        (0.4, 3.0, {OPEN, STICK}),
        (-50.0, 0.4, {OPEN}),
        (50.0, 0.4, {STICK}),
        (4.0, 0.4, {SLIP, STICK}),
    ],
)
def test_monodromy_in_each_state_matches_differences(
    name: str, preload: float, friction: float, states: set[int]
) -> None:
    model, contacts = shaken(), one_contact(**RUB | {"preload": preload, "friction": friction})
    pmap = period_map(model, contacts, name)
    found = assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))
    assert set(np.unique(found.record.state)) - ({SLIP} if friction > 1.0 else set()) == states


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("surface", ["plane", "casing"])
def test_monodromy_of_gyroscopic_model_on_stiff_contact_matches_differences(
    name: str, surface: str
) -> None:
    """The weight of the implicit blending, here about a half, depends on the model at rest only."""
    model = shaken()
    contacts = one_contact(**RUB | {"preload": 50.0, "normal_stiffness": 600.0})
    if surface == "casing":
        contacts = curved(contacts, CYLINDER, 0.7)
    skew = np.triu(np.random.default_rng(2).standard_normal((4, 4)), 1)
    model = model._replace(velocity_matrix=np.ascontiguousarray(20.0 * (skew - skew.T)))
    pmap = period_map(model, contacts, name)
    found = assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))
    assert name != "discrete-gradient" or found.record.blending.max() > 0.1


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("spin", [0.0, 0.7])
def test_monodromy_of_wavy_turning_cylinder_matches_differences(name: str, spin: float) -> None:
    model, contacts = shaken(nonlinear=False), curved(one_contact(**RUB), CYLINDER, spin)
    pmap = period_map(model, contacts, name)
    assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))


def period_on_waves() -> Array:
    """The end of a period before a wavy turning cylinder, and its derivatives: (N, N + 2)."""
    model, contacts = shaken(nonlinear=False), curved(one_contact(**RUB), CYLINDER, 0.7)
    pmap = period_map(model, contacts, "discrete-gradient")
    found = end(pmap, model, contacts, run_in(pmap, model, contacts, 1))
    return np.column_stack([found.z, found.matrix, found.by_parameter])


PLAIN = """
import sys
sys.path[:0] = sys.argv[1:3]
from test_period_map import period_on_waves
period_on_waves().tofile(sys.argv[3])
"""


@pytest.mark.slow
def test_plain_code_gives_the_derivatives_of_compiled_code(tmp_path: Path) -> None:
    here, path, expected = Path(__file__).parent, tmp_path / "period", period_on_waves()
    fresh_python(PLAIN, str(here.parent), str(here), str(path), NUMBA_DISABLE_JIT="1")
    found = np.fromfile(path).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("kind", [PLANE, CYLINDER, SPHERE])
def test_monodromy_in_three_dimensions_matches_differences(name: str, kind: int) -> None:
    model = shaken(3)
    contacts = one_contact(3, **RUB)
    if kind != PLANE:
        contacts = curved(contacts, kind, 0.7 if kind == CYLINDER else 0.0)
    pmap = period_map(model, contacts, name)
    found = assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))
    assert SLIP in found.record.state


@pytest.mark.parametrize("name", SCHEMES)
def test_monodromy_of_many_points_matches_differences(name: str) -> None:
    rng = np.random.default_rng(8)
    root = rng.standard_normal((6, 6))
    model = linear_model(
        np.eye(6) + 0.1 * root @ root.T,
        np.diag(1.0 + np.arange(6)),
        damping=0.1,
        loads=rng.uniform(-1.5, 1.5, (6, 1)),
        load_histories=harmonic(np.array([3.0]), np.array([1.3]), np.array([0.3])),
        masters=6,
    )
    contacts = one_contact(**RUB | {"preload": [0.1, 0.6, 1.5]})
    pmap = period_map(model, contacts, name)
    found = assert_matrix(pmap, model, contacts, run_in(pmap, model, contacts))
    assert set(np.unique(found.record.state)) == {OPEN, SLIP, STICK}


FAMILIES = ["frequency", "force", "damping", "preload", "normal_stiffness"]
FAMILIES += ["tangential_stiffness", "friction", "gap"]


def family(name: str, model: ReducedModel, contacts: Contacts) -> tuple[Family, float]:
    """The family of a parameter, and its value at the model given."""
    problem = Problem(model, contacts, None, PERIOD)
    if name == "frequency":
        return frequency_family(problem), 1.0 / PERIOD
    if name == "force":
        return force_family(problem), 1.0
    if name == "damping":
        return damping_family(problem), model.damping
    value = 0.0 if name == "gap" else float(getattr(contacts, name)[0])
    return contact_family(problem, name), value


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("parameter", FAMILIES)
def test_derivative_by_parameter_matches_differences(name: str, parameter: str) -> None:
    model, contacts = shaken(nonlinear=False), one_contact(**RUB)
    at, value = family(parameter, model, contacts)
    pmap = period_map(model, contacts, name)
    found = assert_by_parameter(pmap, at, value, run_in(pmap, model, contacts))
    assert np.abs(found.by_parameter).max() > 0.0


def numbers(name: str) -> tuple[Callable[[Any], Problem], float]:
    """Problems by a number of the online stage that has no family of its own, and its value."""
    model, contacts = shaken(nonlinear=False), curved(one_contact(**RUB), CYLINDER, 0.7)
    problem, histories, elastic = (
        Problem(model, contacts, None, PERIOD),
        model.load_histories,
        model.elastic,
    )
    skew = np.diag(np.arange(4.0))
    problem = problem._replace(model=model._replace(velocity_matrix=0.1 * skew))

    def at(value: Any) -> Problem:
        changed, moved = problem.model, contacts
        if name == "phase":
            sines = histories.sines.astype(np.result_type(histories.sines, value))
            sines[:, PHASE] = value
            changed = changed._replace(load_histories=histories._replace(sines=sines))
        elif name == "stiffness":
            stiffness = elastic.stiffness + value * np.eye(4)
            changed = changed._replace(elastic=elastic._replace(stiffness=stiffness))
        elif name == "dashpot":
            changed = changed._replace(velocity_matrix=value * skew)
        else:
            moved = contacts._replace(**{name: value + 0.0 * getattr(contacts, name)})
        return problem._replace(model=changed, contacts=moved)

    return at, {"phase": 0.3, "stiffness": 0.1, "dashpot": 0.1}.get(name, 0.05)


@pytest.mark.parametrize("name", ["discrete-gradient", "generalised-alpha"])
@pytest.mark.parametrize("number", ["phase", "stiffness", "dashpot", "height", "turns", "spin"])
def test_derivative_by_any_number_of_the_problem_matches_differences(
    name: str, number: str
) -> None:
    build, value = numbers(number)
    at = family_of(build)
    problem = at(value)
    pmap = period_map(problem.model, problem.contacts, name)
    z = run_in(pmap, problem.model, problem.contacts)
    found = assert_by_parameter(pmap, at, value, z)
    assert (np.abs(found.by_parameter).max() > 0.0) == (number != "turns")  # of a varying speed


@pytest.mark.parametrize("name", ["mass", "cubic"])
def test_number_that_belongs_to_the_basis_is_no_parameter_of_a_curve(name: str) -> None:
    model = shaken()
    if name == "mass":
        other = model._replace(mass=model.mass + 0j)
    else:
        other = model._replace(elastic=model.elastic._replace(cubic=model.elastic.cubic + 0j))
    problem = Problem(model, one_contact(**RUB), None, PERIOD)
    with pytest.raises(ValueError, match=f"{name}.* the modes"):
        drift_of(problem._replace(varied=problem._replace(model=other)))


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("stiff", [False, True])
def test_derivative_by_speed_matches_differences(name: str, stiff: bool) -> None:
    """Of a nonlinear model with Coriolis and centrifugal forces, measured from its equilibrium; the
    weight of the implicit blending on the stiff contact depends on the centrifugal ones."""
    model, n, rng = shaken(), 4, np.random.default_rng(6)
    softening, gyroscopic = (0.2 * rng.standard_normal((n, n)) for _ in range(2))
    squares = np.linspace(0.5, 3.0, 9)
    elastic = model.elastic
    turning = Turning(
        np.array([[0.0, 1.0, 0.0]]),
        rng.uniform(0.1, 0.3, n),
        softening + softening.T,
        gyroscopic - gyroscopic.T,
        np.zeros(n),
        0.0,
        np.zeros((1, 1 + n)),
        np.zeros((0, 3)),
    )
    rows = [
        rest_row(turning, elastic, square, 0.1 * square**0.8 * np.ones(n)) for square in squares
    ]
    model = model._replace(
        turning=turning._replace(rest=np.array(rows)), velocity_matrix=np.zeros((n, n))
    )
    given = {"preload": 50.0, "normal_stiffness": 600.0} if stiff else {}
    contacts = curved(one_contact(**RUB | given), CYLINDER, -0.7)
    at = speed_family(Problem(model, contacts, None, PERIOD), 10.0, np.zeros(1, dtype=bool))
    pmap = period_map(at(10.0).model, contacts, name)
    z = np.zeros(pmap.size)
    for _ in range(6):
        z = pmap(at(10.0), z, derive=False)[1].z
    found = assert_by_parameter(pmap, at, 10.0, z, 1e-5)
    assert (found.record.blending.max() > 0.1) == (stiff and name == "discrete-gradient")
    assert np.abs(found.by_parameter).max() > 0.0


def test_derivative_by_frequency_of_stiff_contact_with_dashpots_matches_differences() -> None:
    """The weight of the implicit blending is about a half."""
    model = shaken(nonlinear=False)
    root = np.random.default_rng(4).standard_normal((4, 4))
    model = model._replace(velocity_matrix=np.ascontiguousarray(2.0 * (root @ root.T + np.eye(4))))
    contacts = one_contact(**RUB | {"preload": 50.0, "normal_stiffness": 600.0})
    pmap = period_map(model, contacts, "discrete-gradient")
    at, value = family("frequency", model, contacts)
    found = assert_by_parameter(pmap, at, value, run_in(pmap, model, contacts))
    assert found.record.blending.max() > 0.1


@pytest.mark.parametrize("parameter", ["frequency", "damping", "normal_stiffness"])
@pytest.mark.parametrize(("preload", "kind"), [(50.0, PLANE), (0.4, CYLINDER)])
@pytest.mark.parametrize(("stiffness", "least", "most"), [(400.0, 0.2, 0.9), (5e3, 0.98, 1.0)])
def test_derivative_by_parameter_on_stiff_contact_matches_differences(
    stiffness: float, least: float, most: float, preload: float, kind: int, parameter: str
) -> None:
    """The weight of the implicit blending depends on the stiffness and on both sizes of steps."""
    model = shaken(nonlinear=False)
    contacts = one_contact(**RUB | {"preload": preload, "normal_stiffness": stiffness})
    if kind != PLANE:
        contacts = curved(contacts, kind, 0.0)
    at, value = family(parameter, model, contacts)
    pmap = unequal_map(model, contacts)
    z = run_in(pmap, model, contacts)
    weights = assert_by_parameter(pmap, at, value, z, 1e-7 * max(1.0, value)).record.blending
    assert least < weights.min() < weights.max() < most


@pytest.mark.parametrize("by", ["step", "stiffness of the contacts", "stiffness of the model"])
def test_derivative_of_blending_weights_matches_differences(by: str) -> None:
    model, rng = random_model(5, masters=4), np.random.default_rng(7)
    contacts = one_contact(normal_stiffness=[20.0, 200.0])
    h, root = 0.4, rng.standard_normal((5, 5))

    def at(moved: Any) -> Problem:
        elastic, stiffness = model.elastic, contacts.normal_stiffness
        period = 2.0 * (1.0 + (0.7 * moved if by == "step" else 0.0))
        if by == "stiffness of the model":
            elastic = elastic._replace(stiffness=elastic.stiffness + moved * (root + root.T))
        if by == "stiffness of the contacts":
            stiffness = stiffness + moved * np.array([3.0, 20.0])
        changed = contacts._replace(normal_stiffness=stiffness)
        return Problem(model._replace(elastic=elastic), changed, None, period)

    def weights(moved: float) -> Array:
        problem, found = at(moved), np.zeros(2)
        problem.model.write_normal_flexibility(h * problem.period / 2.0, found)
        implicit_blending(problem.contacts, found)
        return found

    assert np.all((0.05 < weights(0.0)) & (weights(0.0) < 0.999))
    s = no_sensitivity(5, 8, 2, 2)
    drift = drift_of(at(0.0)._replace(varied=at(1j * STEP)))
    differentiate_blending(model, contacts, drift, h, s)
    np.testing.assert_allclose(s.blending, (weights(1e-6) - weights(-1e-6)) / 2e-6, rtol=1e-6)
