"""The contact problem of a step against brute force, and a block that slides to rest."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from contact_cases import SCHEMES, spoiled_scratch, step
from numpy.typing import NDArray
from support import fixed_steps, harmonic, linear_model, one_contact, slope

from fenicsrom.online.contact.law import at_rest, implicit_blending
from fenicsrom.online.contact.problem import given_compliance, solve_contact
from fenicsrom.online.contact.state import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.model.model import Problem
from fenicsrom.online.run.march import integrate

Array = NDArray[np.float64]


def random_problem(
    rng: np.random.Generator, points: int, d: int, stiffness: float | None
) -> dict[str, Any]:
    """A contact problem with lengths of about 1, from a state that the law allows; stiffness
    relative to the structure."""
    m = points * d
    root = rng.standard_normal((m, m))
    k = stiffness or 10.0 ** rng.uniform(-2, 3)
    contacts = one_contact(
        d,
        preload=rng.uniform(0.0, 2.0, points),
        gap=rng.uniform(0.0, 0.5, points),
        normal_stiffness=np.full(points, k),
        tangential_stiffness=k * rng.uniform(0.5, 1.0, points),
        friction=rng.uniform(0.0, 0.5, points),
    )
    raw = rng.uniform(-0.5, 1.0, points)
    x = rng.uniform(-0.5, 0.5, (points, d))
    x[:, 0] = contacts.radius + (raw - contacts.preload) / np.where(raw > 0, k, 1.0)
    start = zero_contact_state(points, d)
    at_rest(
        contacts,
        x,
        x + rng.uniform(-1.0, 1.0, (points, d)) / k,
        0.0,
        start,
        contact_scratch(points, d),
    )
    return {
        "contacts": contacts,
        "delassus": np.eye(m) + 0.3 * root @ root.T / m,
        "free": rng.uniform(-2.0, 2.0, (points, d)),
        "start": start,
    }


def solve(problem: dict[str, Any], a: float, line: bool) -> tuple[bool, ContactState, Any]:
    """Whether it was solved, the end of the step and the results."""
    points, d = problem["free"].shape
    start = problem["start"]
    end, found = zero_contact_state(points, d), spoiled_scratch(points, d)
    end.x[:] = start.x
    copies = {"delassus": problem["delassus"].copy(), "free": problem["free"].copy()} | {
        name: array.copy() for name, array in start._asdict().items()
    }
    made = ContactStep(problem["contacts"], Interval(0.0, 1.0, a, line), start, end, found)
    response = given_compliance(problem["delassus"])
    solved = solve_contact(made, found.candidates, response, problem["free"])
    for name, copy in copies.items():
        here = problem[name] if name in problem else getattr(start, name)
        assert np.array_equal(here, copy), f"{name} was written to"
    return solved, end, found


@pytest.mark.slow
@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize(("points", "d"), [(1, 2), (3, 3)])
@pytest.mark.parametrize("stiffness", [None, 1e6, 1e12])
def test_contact_problem_of_any_stiffness_is_solved(
    points: int, d: int, stiffness: float | None, a: float, line: bool
) -> None:
    rng = np.random.default_rng(4)
    seen, unsolved = set(), 0
    for _ in range(150):
        problem = random_problem(rng, points, d, stiffness)
        solved, end, found = solve(problem, a, line)
        if not solved:
            unsolved += 1
            continue
        seen |= set(found.mode.tolist())
        expected = step(problem["contacts"], problem["start"], end.x, a, line)[1].mean_force
        np.testing.assert_allclose(found.mean_force, expected, rtol=1e-12)
        residual = (
            end.x
            - problem["free"]
            + (problem["delassus"] @ found.mean_force.ravel()).reshape(points, d)
        )
        # x is right to rounding, which a stiff contact multiplies
        stiffest = problem["contacts"].normal_stiffness.max() * np.abs(problem["delassus"]).max()
        assert np.abs(residual).max() <= 1e-13 * (1.0 + stiffest) + 1e-10
    # a mean along the step that starts far off is hard on friction: now and then the step has to be
    # halved
    assert unsolved == 0, "the iteration cycles"
    assert seen == {OPEN, SLIP, STICK}


@pytest.mark.parametrize("d", [2, 3])
def test_contact_problem_of_released_stiff_contact_is_solved(d: int) -> None:
    """If the mean force is blended towards the end of the step, most of the earlier friction is
    released, because the friction limit follows the mean force."""
    rng, unsolved, slid = np.random.default_rng(21), 0, 0
    for _ in range(400):
        k, friction = 10.0 ** rng.uniform(1.0, 5.0), rng.uniform(0.1, 1.0)
        contacts = one_contact(
            d, normal_stiffness=k, tangential_stiffness=0.5 * k, friction=friction
        )
        raw = rng.uniform(0.1, 1.0)
        x = np.array([[raw / k, *rng.uniform(-1.0, 1.0, d - 1)]])
        start = zero_contact_state(1, d)
        at_rest(
            contacts,
            x,
            x + np.array([0.0, *(rng.uniform(-2.0, 2.0, d - 1) * friction * raw / k)]),
            0.0,
            start,
            contact_scratch(1, d),
        )
        free = x + 10.0 ** rng.uniform(-6.0, 0.0) * rng.uniform(-1.0, 1.0, (1, d))
        end, found, interval, delassus = (
            zero_contact_state(1, d),
            contact_scratch(1, d),
            Interval(0.0, 1.0, 0.5, True),
            np.eye(d),
        )
        end.x[:] = x
        made = ContactStep(contacts, interval, start, end, found)
        found.blending[:] = 1.0
        implicit_blending(contacts, found.blending)
        unsolved += not solve_contact(made, found.candidates, given_compliance(delassus), free)
        slid += found.mode[0] == SLIP
    assert unsolved <= 2, "the iteration cycles"
    assert slid > 100


def brute_force(problem: dict[str, Any]) -> list[Array]:
    """All solutions of a planar problem without start weight: each combination of states is linear;
    the consistent ones are kept."""
    contacts, free = problem["contacts"], problem["free"]
    points, d = free.shape
    found = []
    for combination in product(("open", "stick", "up", "down"), repeat=points):
        matrix, rhs = np.zeros((points * d, points * d)), np.zeros(points * d)  # F = matrix x + rhs
        for p, state in enumerate(combination):
            k, kn, kt, mu = (
                d * p,
                contacts.normal_stiffness[p],
                contacts.tangential_stiffness[p],
                contacts.friction[p],
            )
            if state == "open":
                continue
            matrix[k, k], rhs[k] = kn, contacts.preload[p] - kn * contacts.radius[p]
            if state == "stick":
                matrix[k + 1, k + 1], rhs[k + 1] = kt, -kt * problem["start"].slider[p, 1]
            else:
                sign = 1.0 if state == "up" else -1.0
                matrix[k + 1, k], rhs[k + 1] = sign * mu * kn, sign * mu * rhs[k]
        system = np.eye(points * d) + problem["delassus"] @ matrix
        x = np.linalg.solve(system, free.ravel() - problem["delassus"] @ rhs).reshape(points, d)
        fits = True
        for p, state in enumerate(combination):
            normal = contacts.preload[p] + contacts.normal_stiffness[p] * (
                x[p, 0] - contacts.radius[p]
            )
            trial = contacts.tangential_stiffness[p] * (x[p, 1] - problem["start"].slider[p, 1])
            limit = contacts.friction[p] * normal
            fits &= {
                "open": normal <= 0.0,
                "stick": normal > 0.0 and abs(trial) <= limit,
                "up": normal > 0.0 and trial > limit,
                "down": normal > 0.0 and -trial > limit,
            }[state]
        if fits:
            found.append(x)
    return found


@pytest.mark.parametrize("points", [1, 2])
def test_contact_problem_matches_brute_force(points: int) -> None:
    """Reference: contact problem of a step, one and two points | brute force over all states | the
    solution | agrees | 1e-9 m
    """
    rng = np.random.default_rng(5)
    unique = 0
    for _ in range(200):
        problem = random_problem(rng, points, 2, None)
        solved, end, _ = solve(problem, 0.0, False)
        x = end.x
        candidates = brute_force(problem)
        assert solved and candidates
        assert min(np.abs(x - candidate).max() for candidate in candidates) < 1e-9
        unique += len(candidates) == 1
    assert unique >= 195


# ------------------------------------------------------------------ a block that slides to rest


GRAVITY, MASS, FRICTION, SPEED = 9.81, 2.0, 0.3, 1.5


def slide(
    stiffness: float, scheme: str = "discrete-gradient", steps: int = 4000
) -> tuple[float, float]:
    """Largest displacement of a block on a rigid floor, and the friction dissipation, until just
    after it has stopped."""
    weight = harmonic(np.array([MASS * GRAVITY]), np.zeros(1), np.array([np.pi / 2]))
    block = linear_model(
        MASS * np.eye(2), np.zeros((2, 2)), loads=[1.0, 0.0], load_histories=weight, masters=2
    )
    floor = one_contact(
        preload=MASS * GRAVITY,
        normal_stiffness=1e5,
        tangential_stiffness=stiffness,
        friction=FRICTION,
    )
    stop = SPEED / (FRICTION * GRAVITY)
    start = np.zeros(2), np.array([0.0, SPEED])
    motion = integrate(
        Problem(block, floor, fixed_steps(scheme, steps, 1.3 * stop), None), start=start
    )
    assert np.all(motion.force[:, 0, 0] == pytest.approx(MASS * GRAVITY))
    return float(motion.displacement[:, 0, 1].max()), float(motion.friction_dissipation[-1])


@pytest.mark.parametrize(
    "scheme", ["discrete-gradient", "average-acceleration", "generalised-alpha"]
)
def test_sliding_block_comes_to_rest_where_coulomb_says(scheme: str) -> None:
    """Reference: block that slides to rest: distance, dissipation | closed form | Coulomb, elastic
    slider | agree | 1e-5
    """
    pull = FRICTION * MASS * GRAVITY
    distance = SPEED**2 / (2 * FRICTION * GRAVITY)
    # with a spring of finite stiffness: 1/2 m v^2 = pull w + pull^2 / (2 k_t) when it turns, at w +
    # pull / k_t
    for stiffness in (1e2, 1e3):
        farthest, lost = slide(stiffness, scheme)
        slid = distance - pull / (2 * stiffness)
        assert farthest == pytest.approx(slid + pull / stiffness, rel=1e-5)
        assert lost == pytest.approx(pull * slid, rel=1e-5)
    # and in the limit v^2 / (2 mu g)
    stiff = np.array([1e2, 1e3, 1e4])
    errors = [abs(slide(k, scheme)[0] - distance) for k in stiff]
    assert slope(1 / stiff, errors) == pytest.approx(1.0, abs=0.02)
    assert slide(1e6, scheme)[0] == pytest.approx(distance, rel=5e-4)


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7, 1e9])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_impact_inside_a_step_has_friction_in_proportion(stiffness: float, share: float) -> None:
    """A mass that strikes a wall at 45 degrees slides all the time: the ratio of its impulses is
    mu, as that of its forces.

    Reference: oblique impact inside one step | closed form | friction impulse μ times the normal
    one | agrees | 0.2 %
    """
    mass = linear_model(np.eye(2), 1e-9 * np.eye(2), masters=2)
    wall = one_contact(
        gap=0.1 + 0.01 * share,
        normal_stiffness=stiffness,
        tangential_stiffness=0.5 * stiffness,
        friction=0.2,
    )
    start = np.zeros(2), np.ones(2)
    motion = integrate(
        Problem(mass, wall, fixed_steps("discrete-gradient", 40, 0.4), None), start=start
    )
    normal, friction = np.diff(motion.time) @ motion.mean_force[1:, 0]
    assert normal > 0.99
    assert friction == pytest.approx(0.2 * normal, rel=2e-3)
