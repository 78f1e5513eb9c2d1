"""The equilibrium under the preload, below and beyond the buckling load: Euler, the elastica, and
the solid model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from support import harmonic, linear_model, one_contact

from fenicsrom.assess.studies import stability
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.model.model import Problem
from fenicsrom.online.run import simulate as online
from fenicsrom.online.step import statics
from fenicsrom.scene import Scene

Array = NDArray[np.float64]

SCENE = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
YOUNG, HEIGHT, LENGTH, CONTACT = 207e9, 0.0254, 2.54, 1e4
AXIAL = YOUNG * HEIGHT**2
SHEAR = 5 / 6 * AXIAL / (2 * 1.28)
EULER = np.pi**2 * AXIAL * HEIGHT**2 / 12 / (4 * LENGTH**2)
CRITICAL = EULER / (1 + EULER / SHEAR)  # Engesser
MODELS = ["beam", "reduced", "full"]


def scene(preload: float, *changes: str) -> Scene:
    table, plain = stability.load(SCENE)
    return stability.scene_of(
        table, plain.source, SCENE.parent, (f"contacts.0.preload={preload!r}", *changes)
    )


@pytest.fixture(scope="module")
def models() -> dict[str, Any]:
    """The beam, the solid and the reduced model of the demo."""
    pytest.importorskip("dolfinx")
    return {name: stability.build(scene(40.0), name)[0] for name in MODELS}


def press(model: Any, preload: float, *changes: str) -> tuple[Array, int, Array]:
    """The equilibrium, the number of unstable directions of the straight state, and the
    displacement of the tip."""
    wanted = scene(preload, *changes)
    q, buckled = statics.equilibrium(Problem(model, contacts_of(wanted, model.points), None, None))
    return q, buckled, model.contact_displacement(q).copy()


def elastica(preload: float) -> tuple[float, Array]:
    """Force and displacement of the tip of a buckled cantilever that the spring of the contact
    presses."""

    def at(slope: float) -> tuple[float, Array]:
        k = np.sin(slope / 2)
        force = EULER * (2 * ellipk(k**2) / np.pi) ** 2
        along = LENGTH * (2 * ellipe(k**2) / ellipk(k**2) - 2) - force * LENGTH / AXIAL
        return force, np.array([along, 2 * k * LENGTH / ellipk(k**2)])

    return at(brentq(lambda slope: preload + CONTACT * at(slope)[1][0] - at(slope)[0], 1e-6, 3.0))


@pytest.mark.parametrize("seed", range(3))
def test_unstable_directions_are_those_of_the_stiffness_with_the_springs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((6, 6))
    stiffness, rows = root + root.T, rng.standard_normal((4, 6))
    springs = 10.0 ** rng.uniform(-1.0, 3.0, 2)
    model = linear_model(np.eye(6), stiffness, masters=4)._replace(contact_rows=rows)
    contacts = one_contact(preload=[1.0, 1.0], normal_stiffness=springs)
    normals = rows[::2]
    whole = np.linalg.eigvalsh(stiffness + normals.T @ np.diag(springs) @ normals)
    problem = statics._Statics(Problem(model, contacts, None, None))
    assert problem.unstable(np.zeros(6)) == np.sum(whole < 0.0)


@pytest.mark.parametrize("lowest", [-0.1, 0.1])
def test_softest_direction_is_lowest_mode_with_the_springs(lowest: float) -> None:
    rng = np.random.default_rng(4)
    modes, rows = rng.standard_normal((2, 6, 6))
    rows, springs = rows[:4], np.array([0.5, 2.0])
    mass = np.linalg.inv(modes @ modes.T)  # so that the modes are M-orthonormal
    whole = mass @ modes @ np.diag([lowest, 2.0, 3.0, 4.0, 5.0, 6.0]) @ modes.T @ mass
    stiffness = whole - rows[::2].T @ np.diag(springs) @ rows[::2]
    model = linear_model(mass, stiffness, masters=4)._replace(contact_rows=rows)
    contacts = one_contact(preload=[1.0, 1.0], normal_stiffness=springs)
    shape, rate = statics._Statics(Problem(model, contacts, None, None))._soften(
        np.zeros(6), np.ones(6)
    )
    assert rate == pytest.approx(lowest, rel=1e-6)
    assert abs(shape @ mass @ modes[:, 0]) == pytest.approx(1.0, rel=1e-6)


def test_response_to_loads_is_not_overwritten_by_next_solve() -> None:
    load = harmonic(np.array([2.0]), np.ones(1), np.zeros(1))
    model = linear_model(
        np.eye(2), np.diag([4.0, 5.0]), loads=[[1.0], [0.0]], load_histories=load, masters=2
    )
    contacts = one_contact(preload=1.0, normal_stiffness=1.0)
    problem = statics._Statics(Problem(model, contacts, None, None))
    response, force = problem._seed(np.zeros(2))
    problem._soften(np.zeros(2), np.ones(2))
    np.testing.assert_allclose(response, [0.5, 0.0])
    np.testing.assert_allclose(force, [2.0, 0.0])


def test_unstable_structure_held_by_contact_springs_is_stable() -> None:
    model = linear_model(np.eye(4), np.diag([-1.0, 2.0, 3.0, 4.0]), masters=4)
    rows = np.eye(4)
    rows[2] = -rows[0]  # the second spring is opposite to the first one
    contacts = one_contact(preload=[0.4, 0.4], normal_stiffness=[6.0, 6.0])
    q, unstable = statics.equilibrium(
        Problem(model._replace(contact_rows=rows), contacts, None, None)
    )
    assert unstable == 0
    np.testing.assert_allclose(q, 0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_beam_below_buckling_load_stays_straight(models: dict[str, Any], name: str) -> None:
    _, buckled, x = press(models[name], 0.99 * CRITICAL)
    assert buckled == 0
    shortening = 0.99 * CRITICAL / (AXIAL / LENGTH + CONTACT)
    np.testing.assert_allclose(x, [-shortening, 0.0], atol=1e-3 * shortening)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(("ratio", "tolerance"), [(1.01, 0.08), (1.1, 0.01), (2.0, 0.003)])
def test_beam_beyond_buckling_load_matches_elastica(
    models: dict[str, Any], name: str, ratio: float, tolerance: float
) -> None:
    """The deflection grows with the square root of the excess: just above the buckling load, an
    error of 0.2 % of this load changes it by 7 %.

    Reference: tip deflection at twice the buckling load, against a wall | elastica with the
    contact spring | 1.00036 m | 1.00040 m (beam), 0.99860 m (solid) | 0.3 %
    """
    model, preload = models[name], ratio * CRITICAL
    q, buckled, x = press(model, preload)
    force, exact = elastica(preload)
    assert buckled == 1
    assert x[1] == pytest.approx(
        exact[1], rel=tolerance
    )  # to the side that the load pushes to first
    assert preload + CONTACT * x[0] == pytest.approx(force, rel=0.003)
    # a minimum of the energy: below the straight state, and above nothing near it
    contacts = contacts_of(scene(preload), model.points)
    problem = statics._Statics(Problem(model, contacts, None, None))
    straight = problem.newton(np.zeros_like(q), 1.0, 0.0)
    assert straight is not None and problem.unstable(straight) == 1 and problem.unstable(q) == 0
    here = energy(model, q, preload)
    assert here < energy(model, straight, preload) * (1 - 1e-6)
    shape = q - straight
    for part in (-0.3, -0.01, 0.01, 0.3):
        assert energy(model, q + part * shape, preload) > here


def energy(model: Any, q: Array, preload: float) -> float:
    pushed = max(0.0, preload + CONTACT * model.contact_displacement(q)[0])
    return model.elastic_at(q)[1] + pushed**2 / (2 * CONTACT)


@pytest.mark.parametrize("name", ["beam", pytest.param("full", marks=pytest.mark.slow)])
def test_buckling_load_matches_euler(models: dict[str, Any], name: str) -> None:
    """Found by bisection; the finite elements are at most 0.3 % above it.

    Reference: buckling load of the beam against its wall | Euler, shear by Engesser | 2745.80 N
    | 2747.94 N (beam), 2749.66 N (solid) | 0.3 %
    """
    found = brentq(
        lambda preload: press(models[name], preload)[1] - 0.5,
        0.98 * CRITICAL,
        1.02 * CRITICAL,
        xtol=0.5,
    )
    assert found / CRITICAL == pytest.approx(1.0, abs=3e-3)


@pytest.mark.slow
def test_basis_about_straight_state_spans_buckled_state(models: dict[str, Any]) -> None:
    for ratio in (1.01, 1.1, 2.0):
        x, exact = (press(models[name], ratio * CRITICAL)[2] for name in ("reduced", "full"))
        assert np.linalg.norm(x - exact) < (1e-3 if ratio < 1.05 else 2e-4) * np.linalg.norm(exact)


@pytest.mark.long
@pytest.mark.slow
def test_basis_that_misses_buckled_state_is_refused() -> None:
    """A soft beam far beyond its buckling load: no derivative is left out, but more modes give
    another shape."""
    pytest.importorskip("dolfinx")
    table, plain = stability.load(SCENE)
    case = stability.Case("buckled", "", ("material.young=1e4", "basis.modes=3"))
    found = stability.examine(case, table, plain.source, SCENE.parent)
    assert (
        found.buckled > 1
        and found.verdict == stability.Verdict.REFUSED
        and "basis is too small" in found.why
    )


@pytest.mark.slow
def test_motion_of_buckled_beam_becomes_steady(models: dict[str, Any]) -> None:
    preload = 1.1 * CRITICAL
    wanted = scene(preload, "contacts.0.friction=0.1")
    motion = online.simulate(models["reduced"], wanted)
    assert motion.buckled == 1 and motion.steady
    np.testing.assert_allclose(motion.displacement[0, 0], press(models["reduced"], preload)[2])
    assert (
        motion.displacement[:, 0, 1].min() > 0.5 * motion.displacement[0, 0, 1]
    )  # about the buckled state
    quiet = scene(preload, "loads.0.force=0", "time.periods=3")
    still = online.simulate(
        models["reduced"]._replace(load_histories=online.load_histories(quiet)), quiet
    )
    assert np.ptp(still.displacement[:, 0], axis=0).max() < 1e-9 * motion.displacement[0, 0, 1]


def test_contact_without_preload_keeps_beam_at_rest() -> None:
    """A contact with a gap, and one whose preload a linear spring carries."""
    model = linear_model(np.eye(2), np.diag([3.0, 2.0]), masters=2)
    for preload, gap, moved in ((0.0, 0.1, 0.0), (6.0, 0.0, -6.0 / (3.0 + 1.0))):
        q, buckled = statics.equilibrium(
            Problem(model, one_contact(preload=preload, gap=gap), None, None)
        )
        np.testing.assert_allclose(q, [moved, 0.0], atol=1e-14)
        assert buckled == 0


@pytest.mark.parametrize(
    ("coriolis", "spring", "count"), [(True, 0.01, 0), (False, 0.01, 2), (True, 0.5, 1)]
)
def test_rotor_above_its_critical_speed_is_held_by_the_coriolis_force(
    coriolis: bool, spring: float, count: int
) -> None:
    """A disk on a round shaft at 1.2 times its critical speed of 1 rad/s, and two higher modes. A
    contact spring that turns with the disk and is stiff enough for one direction lets it fall in
    the other one."""
    speed = 1.2
    stiffness = np.diag([1.0 - speed**2, 1.0 - speed**2, 30.0, 50.0])
    velocity = np.zeros((4, 4))
    velocity[1, 0], velocity[0, 1] = 2.0 * speed, -2.0 * speed
    model = linear_model(np.eye(4), stiffness, masters=2)
    model = model._replace(velocity_matrix=velocity if coriolis else np.zeros((0, 0)))
    contacts = one_contact(preload=1.0, normal_stiffness=spring)
    problem = statics._Statics(Problem(model, contacts, None, None))
    assert problem.unstable(np.zeros(4)) == count
