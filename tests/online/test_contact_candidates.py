"""Steps with many contact points solve for those that may touch, and find the motion of all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import one_contact, period_steps, random_model

from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.problem import (
    add_candidates,
    compliance_of,
    delassus_of,
    form_delassus,
    given_compliance,
    list_candidates,
    solve_contact,
)
from fenicsrom.online.contact.state import (
    OPEN,
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.model.model import Problem, ReducedModel, reduced_model
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.period_map import PeriodMap
from fenicsrom.online.run import march
from fenicsrom.online.run.march import integrate
from fenicsrom.online.step import step
from fenicsrom.online.step.state import scheme
from fenicsrom.online.step.statics import equilibrium

POINTS, SIZE = 7, 6  # 14 contact directions: more than coordinates where four points touch
PERIOD = 2.0 * np.pi / 1.3


def edge() -> ReducedModel:
    """A nonlinear model with an edge of contact points that heaves, shifts and bends."""
    model = random_model(SIZE, seed=3, damping=0.1, masters=0, force=2.0, omega=1.3)
    along = np.linspace(0.0, np.pi, POINTS)
    rows = np.zeros((POINTS, 2, SIZE))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    for i in range(2, SIZE):
        rows[:, i % 2, i] = np.cos(i // 2 * along) / i
    points = ContactPoints(
        np.arange(POINTS),
        np.ones(POINTS),
        np.zeros((POINTS, 2)),
        np.tile(np.eye(2), (POINTS, 1, 1)),
    )
    return reduced_model(
        model.mass,
        model.damping,
        model.elastic,
        model.loads,
        model.load_histories,
        points,
        rows.reshape(-1, SIZE),
        np.zeros(2 * POINTS),
        model.probe,
        model.probe_offset,
    )


def walls(gap: float = 0.02, preload: float = 0.0) -> Contacts:
    """Planes before the edge, each a little nearer than the one before."""
    gaps = gap + 0.02 * np.arange(POINTS)[::-1]
    return one_contact(
        gap=gaps, preload=preload, normal_stiffness=8.0, tangential_stiffness=5.0, friction=0.4
    )


def shaken(scheme_name: str, *, compiled: bool = True, steps: int = 80) -> Motion:
    settings = period_steps(steps, scheme_name).changed(periods=2, steady_tolerance=0.0)
    return integrate(Problem(edge(), walls(), settings, PERIOD), compiled=compiled)


@pytest.mark.parametrize("name", ["discrete-gradient", "average-acceleration"])
def test_motion_with_candidates_is_the_motion_with_all_points(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = shaken(name)
    monkeypatch.setattr(march, "scheme", lambda *a: scheme(*a)._replace(all_points=True))
    expected = shaken(name)
    touching = np.sum(expected.state != OPEN, axis=1)
    assert touching.min() == 0 and touching.max() > SIZE // 2
    assert np.any((touching > 0) & (touching <= SIZE // 2))
    for field in ("displacement", "mean_force", "force", "work", "point_friction_dissipation"):
        array, other = getattr(found, field), getattr(expected, field)
        np.testing.assert_allclose(array, other, rtol=0, atol=1e-9 * np.abs(other).max())
    np.testing.assert_array_equal(found.state, expected.state)


def test_step_is_repeated_where_a_point_was_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, missed = shaken("discrete-gradient", steps=40), []

    def choose_touching(made: ContactStep, every: bool) -> int:
        made.scratch.is_candidate[:] = made.start.trial_normal_force > 0.0
        missed.append(list_candidates(made.scratch))
        return int(missed[-1])

    def add(*arguments: Any) -> int:
        count = int(add_candidates(*arguments))
        missed[-1] = count - missed[-1]
        return count

    monkeypatch.setattr(step, "choose_candidates", choose_touching)
    monkeypatch.setattr(step, "add_candidates", add)
    found = shaken("discrete-gradient", compiled=False, steps=40)
    assert sum(count > 0 for count in missed) >= 2
    assert found.newton_iterations > expected.newton_iterations
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.state, expected.state)


def test_contact_problem_in_coordinates_has_the_solution_of_the_formed_one() -> None:
    rng, points, d, n = np.random.default_rng(2), 5, 2, 4
    slid = 0
    for _ in range(40):
        rows, root = rng.standard_normal((points * d, n)), rng.standard_normal((n, n))
        compliance = compliance_of(rows)
        compliance.unit[:, : points * d] = np.linalg.solve(np.eye(n) + root @ root.T, rows.T)
        delassus = rows @ compliance.unit[:, : points * d]
        np.testing.assert_allclose(delassus_of(compliance), delassus, rtol=1e-12)
        contacts = one_contact(
            d,
            gap=rng.uniform(0.0, 0.5, points),
            normal_stiffness=np.full(points, 10.0 ** rng.uniform(-1, 2)),
            tangential_stiffness=np.full(points, 1.0),
            friction=rng.uniform(0.0, 0.5, points),
        )
        interval, free = Interval(0.0, 1.0, 0.0, False), rng.uniform(-2.0, 2.0, (points, d))
        ends, scratches = [], []
        for response in (compliance, given_compliance(delassus)):
            start, end = zero_contact_state(points, d), zero_contact_state(points, d)
            scratch = contact_scratch(points, d)
            made = ContactStep(contacts, interval, start, end, scratch)
            assert solve_contact(made, scratch.candidates, response, free)
            ends.append(end.x)
            scratches.append(scratch)
        np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-11)
        np.testing.assert_allclose(
            scratches[0].mean_force, scratches[1].mean_force, rtol=0, atol=1e-8
        )
        slid += int(np.any(scratches[0].mode == 0))
        form_delassus(rows, compliance, scratch.directions)
        np.testing.assert_allclose(compliance.delassus, delassus, rtol=1e-12)
    assert slid > 10


def test_equilibrium_under_preload_of_many_points_balances() -> None:
    model, contacts = edge(), walls(preload=0.3)._replace(radius=np.zeros(POINTS))
    q, _ = equilibrium(Problem(model, contacts, None, None))
    x = model.contact_displacement(q).reshape(POINTS, 2)
    force = np.zeros((POINTS, 2))
    force[:, 0] = np.maximum(contacts.preload + contacts.normal_stiffness * x[:, 0], 0.0)
    assert np.count_nonzero(force) > SIZE // 2
    balance = model.elastic_at(q)[0] + model.contact_rows.T @ force.reshape(-1)
    np.testing.assert_allclose(balance, 0.0, atol=1e-10)


def test_monodromy_with_more_touching_directions_than_coordinates_matches_differences() -> None:
    model = edge()
    # stiff enough for a weight of the implicit blending that matters
    contacts = walls(gap=0.0)
    contacts = contacts._replace(
        normal_stiffness=10.0 * contacts.normal_stiffness, radius=0.1 * contacts.radius
    )
    problem = Problem(model, contacts, None, PERIOD)
    pmap = PeriodMap(problem, scheme("discrete-gradient", model), np.linspace(0.0, 1.0, 41))
    z = np.zeros(pmap.size)
    z = pmap(problem, z, derive=False)[1].z
    found = pmap(problem, z)[1]
    touching = np.sum(found.record.mean_force[:, :, 0] != 0.0, axis=1)
    assert touching.max() > SIZE // 2 and touching.min() == 0
    direction = np.random.default_rng(1).standard_normal(pmap.size)
    ends = [pmap(problem, z + change * direction, derive=False)[1].z for change in (-1e-6, 1e-6)]
    expected = (ends[1] - ends[0]) / 2e-6
    np.testing.assert_allclose(
        found.matrix @ direction, expected, rtol=0, atol=2e-6 * np.abs(expected).max()
    )
