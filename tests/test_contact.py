"""The contact law against its definition, and the contact problem of a step against brute force."""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import assert_tangent, fixed_steps, linear_model, one_contact, slope

from fenicsrom.contact import OPEN, SLIP, STICK, Contacts, energy, law, mean_normal_force, no_contacts, resolve
from fenicsrom.integrate import integrate
from fenicsrom.signals import harmonic

Array = NDArray[np.float64]

RUB = one_contact(preload=40.0, gap=1e-3, normal_stiffness=1e4, tangential_stiffness=2e4, friction=0.5)


def apply(contacts: Contacts, x: Array, slider: Array, p: int = 0) -> tuple[int, Array, Array, Array]:
    """State, force, tangent and new slider, with rubbish where the law has to write."""
    d = x.size
    force, tangent, new = np.full(d, np.nan), np.full((d, d), np.nan), np.full(d - 1, np.nan)
    before = x.copy(), slider.copy()
    state = law(contacts, p, x, slider, force, tangent, new)
    assert np.array_equal(x, before[0]) and np.array_equal(slider, before[1])
    return state, force, tangent, new


# ------------------------------------------------------------------ the law


@pytest.mark.parametrize(
    ("x", "state", "force", "slider"),
    [
        ([-0.01, 0.02], OPEN, [0.0, 0.0], 0.02),  # N0 + k_n (x_n - g0) = -70: the slider follows
        ([-0.003, 0.02], OPEN, [0.0, 0.0], 0.02),  # exactly touching
        ([0.0, 0.0012], STICK, [30.0, 4.0], 0.001),  # N = 30, trial 4 < 15
        ([0.0, 0.00175], STICK, [30.0, 15.0], 0.001),  # at the limit
        ([0.0, 0.0030], SLIP, [30.0, 15.0], 0.0030 - 15 / 2e4),
        ([0.002, -0.0030], SLIP, [50.0, -25.0], -0.0030 + 25 / 2e4),
    ],
)
def test_open_stick_slip(x: list[float], state: int, force: list[float], slider: float) -> None:
    found = apply(RUB, np.array(x), np.array([0.001]))
    assert found[0] == state
    np.testing.assert_allclose(found[1], force, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found[3], [slider], rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_without_friction_nothing_pulls_and_the_slider_follows(dimension: int) -> None:
    x = np.array([0.002, 0.3, -0.2])[:dimension]
    state, force, _, slider = apply(RUB._replace(friction=np.zeros(1)), x, np.zeros(dimension - 1))
    assert state == SLIP
    np.testing.assert_array_equal(force[1:], 0.0)
    np.testing.assert_array_equal(slider, x[1:])


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("normal", "across", "state"), [(-0.01, 0.002, OPEN), (0.001, 5e-4, STICK), (0.001, 4e-3, SLIP)]
)
def test_tangent_is_consistent(dimension: int, normal: float, across: float, state: int) -> None:
    x = np.array([normal, across, -0.6 * across])[:dimension]
    slider = np.array([1e-4, 2e-4])[: dimension - 1]
    if state == OPEN:
        np.testing.assert_array_equal(apply(RUB, x, slider)[2], 0.0)
    else:
        assert_tangent(lambda x: apply(RUB, x, slider)[1], lambda x: apply(RUB, x, slider)[2], x, step=1e-6)
    assert apply(RUB, x, slider)[0] == state


def test_along_a_line_three_dimensions_are_two() -> None:
    rng = np.random.default_rng(1)
    line = np.array([0.6, -0.8])
    slider = 0.0
    seen = set()
    for _ in range(200):
        normal, across = rng.uniform(-6e-3, 4e-3), rng.uniform(-4e-3, 4e-3)
        plane = apply(RUB, np.array([normal, across]), np.array([slider]))
        space = apply(RUB, np.array([normal, *(across * line)]), slider * line)
        seen.add(plane[0])
        assert space[0] == plane[0]
        np.testing.assert_allclose(space[1], [plane[1][0], *(plane[1][1] * line)], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(space[3], plane[3][0] * line, rtol=1e-12, atol=1e-16)
        along = np.array([[1.0, 0.0], [0.0, line[0]], [0.0, line[1]]])
        np.testing.assert_allclose(along.T @ space[2] @ along, plane[2], rtol=1e-9, atol=1e-9)
        slider = plane[3][0]
    assert seen == {OPEN, SLIP, STICK}


def test_friction_has_no_preferred_direction() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.eye(3)
        turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        x, slider = rng.uniform(-4e-3, 4e-3, 3), rng.uniform(-4e-3, 4e-3, 2)
        state, force, tangent, new = apply(RUB, x, slider)
        turned = apply(RUB, turn @ x, turn[1:, 1:] @ slider)
        assert turned[0] == state
        np.testing.assert_allclose(turned[1], turn @ force, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(turned[2], turn @ tangent @ turn.T, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(turned[3], turn[1:, 1:] @ new, rtol=1e-12, atol=1e-16)


def rubbed(path: Array) -> float:
    """Work done against friction along a path (steps, d), its first point at rest."""
    slider, work = path[0, 1:].copy(), 0.0
    force = apply(RUB, path[0], slider)[1]
    for before, x in pairwise(path):
        _, new, _, slider = apply(RUB, x, slider)
        work += 0.5 * (force + new)[1:] @ (x - before)[1:]
        force = new
    return float(work)


def test_closed_loop_of_a_jenkins_element() -> None:
    preload, amplitude = 30.0, 6e-3
    limit = RUB.friction[0] * preload
    up = np.linspace(-amplitude, amplitude, 1 + 8 * 6)  # every turning and yielding point lies on the path
    loop = np.concatenate([up[24:], up[-2::-1], up[1:]])
    path = np.stack([np.zeros_like(loop), loop], axis=1)  # N0 - k_n g0 = 30 N
    first = len(up) - 24 - 1  # from the crest to the next
    closed = rubbed(path) - rubbed(path[: first + 1])
    assert closed == pytest.approx(4 * limit * (amplitude - limit / RUB.tangential_stiffness[0]), rel=1e-12)


def test_a_point_led_in_a_circle_drags_its_slider_on_a_smaller_one() -> None:
    preload, radius = 30.0, 4e-3
    limit = RUB.friction[0] * preload
    inner = np.sqrt(radius**2 - (limit / RUB.tangential_stiffness[0]) ** 2)
    errors = []
    for steps in (200, 400):
        angle = 2 * np.pi * np.arange(5 * steps + 1) / steps
        path = np.stack([np.zeros_like(angle), radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        last = rubbed(path) - rubbed(path[: -steps])
        errors.append(abs(last / (2 * np.pi * inner * limit) - 1))
    assert errors[1] < 2e-3
    assert slope([2, 1], errors) == pytest.approx(1.0, abs=0.1)


def test_energy_of_the_springs() -> None:
    two = one_contact(normal_stiffness=[1e4, 2e4], tangential_stiffness=[3e3, 4e3])
    force = np.array([[10.0, 3.0, 4.0], [0.0, 6.0, 0.0]])
    assert energy(two, np.zeros((2, 3)), force) == pytest.approx(100 / 2e4 + 25 / 6e3 + 36 / 8e3, rel=1e-14)


def test_mean_normal_force_is_the_discrete_gradient_of_the_energy() -> None:
    rng = np.random.default_rng(3)
    kinds = set()
    for before, after in rng.uniform(-50.0, 50.0, (500, 2)):
        mean, by_after = mean_normal_force(before, after)
        kinds.add((before > 0, after > 0))
        work = 0.5 * max(after, 0.0) ** 2 - 0.5 * max(before, 0.0) ** 2
        assert mean * (after - before) == pytest.approx(work, rel=1e-12, abs=1e-9)
        if min(abs(before), abs(after), abs(after - before)) > 0.1:
            step = 1e-4
            above, below = (mean_normal_force(before, after + sign * step)[0] for sign in (1, -1))
            assert by_after == pytest.approx((above - below) / (2 * step), rel=1e-5, abs=1e-8)
    assert len(kinds) == 4
    assert mean_normal_force(7.0, 7.0)[0] == 7.0
    assert mean_normal_force(0.0, 0.0)[0] == 0.0


# ------------------------------------------------------------------ the contact problem of a step


def random_problem(rng: np.random.Generator, points: int, d: int, stiffness: float | None) -> dict[str, Any]:
    """A contact problem of lengths about 1, from a state that the law allows; stiffness relative to the structure."""
    m = points * d
    root = rng.standard_normal((m, m))
    k = stiffness or 10.0 ** rng.uniform(-2, 3)
    contacts = Contacts(
        rng.uniform(0.0, 2.0, points), rng.uniform(0.0, 0.5, points), np.full(points, k),
        k * rng.uniform(0.5, 1.0, points), rng.uniform(0.0, 0.5, points),
    )  # fmt: skip
    force, slider = rng.uniform(-0.5, 1.0, (points, d)), rng.uniform(-0.5, 0.5, (points, d - 1))
    force[:, 1:] *= (contacts.friction * np.maximum(force[:, 0], 0.0))[:, None] / np.sqrt(d - 1)
    x = np.empty((points, d))
    x[:, 0] = contacts.gap + (force[:, 0] - contacts.preload) / np.where(force[:, 0] > 0, k, 1.0)
    x[:, 1:] = slider + force[:, 1:] / contacts.tangential_stiffness[:, None]
    force[:, 0] = np.maximum(force[:, 0], 0.0)
    return {
        "contacts": contacts,
        "compliance": np.eye(m) + 0.3 * root @ root.T / m,
        "free": rng.uniform(-2.0, 2.0, (points, d)),
        "x0": x,
        "force0": force,
        "slider0": slider,
    }


def solve(problem: dict[str, Any], start_weight: float, line: bool) -> tuple[bool, Array, Array, Array, Array, Array]:
    points, d = problem["free"].shape
    x = problem["x0"].copy()
    force, slider = np.full((points, d), np.nan), np.full((points, d - 1), np.nan)
    state, mean = np.zeros(points, dtype=np.int8), np.full((points, d), np.nan)
    copies = {name: np.copy(problem[name]) for name in ("compliance", "free", "x0", "force0", "slider0")}
    solved = resolve(
        *(problem[name] for name in ("contacts", "compliance", "free", "x0", "force0", "slider0")),
        start_weight, line, x, force, slider, state, mean,
    )  # fmt: skip
    for name, copy in copies.items():
        assert np.array_equal(problem[name], copy), f"{name} was written to"
    return solved, x, force, slider, state, mean


def mean_force(problem: dict[str, Any], x: Array, start_weight: float, line: bool) -> Array:
    """The mean force over the step, from the law point by point."""
    contacts = problem["contacts"]
    mean = np.empty_like(x)
    for p in range(x.shape[0]):
        force = apply(contacts, x[p], problem["slider0"][p], p)[1]
        mean[p] = start_weight * problem["force0"][p] + (1 - start_weight) * force
        if line:
            ends = [
                contacts.preload[p] + contacts.normal_stiffness[p] * (end[p, 0] - contacts.gap[p])
                for end in (problem["x0"], x)
            ]
            mean[p, 0] = mean_normal_force(*ends)[0]
    return mean


@pytest.mark.parametrize(("start_weight", "line"), [(0.0, False), (0.4, False), (0.5, True)])
@pytest.mark.parametrize(("points", "d"), [(1, 2), (1, 3), (2, 2), (3, 3)])
@pytest.mark.parametrize("stiffness", [None, 1e6, 1e12])
def test_contact_problem_is_solved_at_any_stiffness(
    points: int, d: int, stiffness: float | None, start_weight: float, line: bool
) -> None:
    rng = np.random.default_rng(4)
    seen, unsolved = set(), 0
    for _ in range(150):
        problem = random_problem(rng, points, d, stiffness)
        solved, x, force, slider, state, mean = solve(problem, start_weight, line)
        if not solved:
            unsolved += 1
            continue
        for p in range(points):
            found = apply(problem["contacts"], x[p], problem["slider0"][p], p)
            seen.add(found[0])
            assert state[p] == found[0]
            np.testing.assert_array_equal(force[p], found[1])
            np.testing.assert_array_equal(slider[p], found[3])
        expected = mean_force(problem, x, start_weight, line)
        np.testing.assert_allclose(mean, expected, rtol=1e-12)
        residual = x - problem["free"] + (problem["compliance"] @ mean.ravel()).reshape(points, d)
        # x is right to rounding, which a stiff contact multiplies
        stiffest = problem["contacts"].normal_stiffness.max() * np.abs(problem["compliance"]).max()
        assert np.abs(residual).max() <= 1e-13 * (1.0 + stiffest) + 1e-10
    # a mean along the step that starts far off is hard on friction: now and then the step has to be halved
    assert unsolved <= (3 if line else 0), "the iteration cycles"
    assert seen == {OPEN, SLIP, STICK}


def brute_force(problem: dict[str, Any]) -> list[Array]:
    """All solutions of a planar problem without start weight: each combination of states is linear; keep what fits."""
    contacts, free = problem["contacts"], problem["free"]
    points, d = free.shape
    found = []
    for combination in product(("open", "stick", "up", "down"), repeat=points):
        matrix, rhs = np.zeros((points * d, points * d)), np.zeros(points * d)  # F = matrix x + rhs
        for p, state in enumerate(combination):
            k, kn, kt, mu = d * p, contacts.normal_stiffness[p], contacts.tangential_stiffness[p], contacts.friction[p]
            if state == "open":
                continue
            matrix[k, k], rhs[k] = kn, contacts.preload[p] - kn * contacts.gap[p]
            if state == "stick":
                matrix[k + 1, k + 1], rhs[k + 1] = kt, -kt * problem["slider0"][p, 0]
            else:
                sign = 1.0 if state == "up" else -1.0
                matrix[k + 1, k], rhs[k + 1] = sign * mu * kn, sign * mu * rhs[k]
        system = np.eye(points * d) + problem["compliance"] @ matrix
        x = np.linalg.solve(system, free.ravel() - problem["compliance"] @ rhs).reshape(points, d)
        fits = True
        for p, state in enumerate(combination):
            normal = contacts.preload[p] + contacts.normal_stiffness[p] * (x[p, 0] - contacts.gap[p])
            trial = contacts.tangential_stiffness[p] * (x[p, 1] - problem["slider0"][p, 0])
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
def test_contact_problem_against_brute_force(points: int) -> None:
    rng = np.random.default_rng(5)
    unique = 0
    for _ in range(200):
        problem = random_problem(rng, points, 2, None)
        solved, x, *_ = solve(problem, 0.0, False)
        candidates = brute_force(problem)
        assert solved and candidates
        assert min(np.abs(x - candidate).max() for candidate in candidates) < 1e-9
        unique += len(candidates) == 1
    assert unique >= 195


# ------------------------------------------------------------------ a block that slides to rest


GRAVITY, MASS, FRICTION, SPEED = 9.81, 2.0, 0.3, 1.5


def slide(stiffness: float, scheme: str = "discrete-gradient", steps: int = 4000) -> tuple[float, float]:
    """Farthest displacement of a block on a rigid floor, and the energy rubbed, until just after it has stopped."""
    weight = harmonic(np.array([MASS * GRAVITY]), np.zeros(1), np.array([np.pi / 2]))
    block = linear_model(MASS * np.eye(2), np.zeros((2, 2)), loads=[1.0, 0.0], signals=weight, masters=2)
    floor = one_contact(preload=MASS * GRAVITY, normal_stiffness=1e5, tangential_stiffness=stiffness, friction=FRICTION)
    stop = SPEED / (FRICTION * GRAVITY)
    start = np.zeros(2), np.array([0.0, SPEED])
    motion = integrate(block, floor, fixed_steps(scheme, steps, 1.3 * stop), None, dimension=2, start=start)
    assert np.all(motion.force[:, 0, 0] == pytest.approx(MASS * GRAVITY))
    return float(motion.displacement[:, 0, 1].max()), float(motion.rubbed[-1])


@pytest.mark.parametrize("scheme", ["discrete-gradient", "average-acceleration", "generalised-alpha"])
def test_block_slides_to_rest(scheme: str) -> None:
    pull = FRICTION * MASS * GRAVITY
    distance = SPEED**2 / (2 * FRICTION * GRAVITY)
    # with a spring of finite stiffness: 1/2 m v^2 = pull w + pull^2 / (2 k_t) when it turns, at w + pull / k_t
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


def test_no_contacts_are_none() -> None:
    assert all(values.shape == (0,) for values in no_contacts())
    assert energy(no_contacts(), np.zeros((0, 2)), np.zeros((0, 2))) == 0.0
