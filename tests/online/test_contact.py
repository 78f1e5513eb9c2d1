"""The contact law against its definition, surfaces against geometry, and the contact problem of a
step against brute force."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import assert_tangent, fixed_steps, linear_model, one_contact, slope

from fenicsrom.online.contact_problem import solve_contact
from fenicsrom.online.contact_state import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact_step import (
    at_rest,
    commit_contact_state,
    contact_energy,
    contact_force,
    implicit_blending,
)
from fenicsrom.online.friction import blended_normal_force, mean_normal_force
from fenicsrom.online.load_histories import harmonic
from fenicsrom.online.march import integrate
from fenicsrom.online.surfaces import (
    CYLINDER,
    PLANE,
    SPHERE,
    Contacts,
    advect_with_surface,
    frame,
    gap_discrete_gradient,
    no_contacts,
    penetration,
)

Array = NDArray[np.float64]

RUB = one_contact(
    preload=40.0, gap=1e-3, normal_stiffness=1e4, tangential_stiffness=2e4, friction=0.5
)
RUB3 = one_contact(
    3, preload=40.0, gap=1e-3, normal_stiffness=1e4, tangential_stiffness=2e4, friction=0.5
)
SCHEMES = [(0.0, False), (0.4, False), (0.5, True)]


def rest(contacts: Contacts, x: Array, slider: Array) -> ContactState:
    """The law at a displacement (d,) with a slider (d - 1,) in the tangent plane."""
    found = zero_contact_state(1, x.size)
    at_rest(contacts, x[None], np.array([[0.0, *slider]]), 0.0, found, contact_scratch(1, x.size))
    return found


def apply(contacts: Contacts, x: Array, slider: Array) -> tuple[int, Array, Array]:
    """State, force [N, T] and new slider before a plane."""
    found = rest(contacts, x, slider)
    return int(found.state[0]), (found.normal + found.friction)[0], found.slider[0, 1:]


def step(
    contacts: Contacts,
    start: ContactState,
    x: Array,
    a: float,
    line: bool,
    time: tuple[float, float] = (0.0, 1.0),
) -> Any:
    """A step of all points to x (P, d): the state at its end, what was found, dissipation and work
    of the surface."""
    points, d = x.shape
    end, found, interval = (
        zero_contact_state(points, d),
        contact_scratch(points, d),
        Interval(*time, a, line),
    )
    end.x[:] = x
    sums = np.zeros(2)
    for p in range(points):
        contact_force(contacts, interval, p, start, end, found)
        sums += commit_contact_state(contacts, interval, p, start, end, found)[:2]
    return end, found, *sums


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
    np.testing.assert_allclose(found[2], [slider], rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_without_friction_nothing_pulls_and_the_slider_follows(dimension: int) -> None:
    x = np.array([0.002, 0.3, -0.2])[:dimension]
    contacts = (RUB if dimension == 2 else RUB3)._replace(friction=np.zeros(1))
    state, force, slider = apply(contacts, x, np.zeros(dimension - 1))
    assert state == SLIP
    np.testing.assert_array_equal(force[1:], 0.0)
    np.testing.assert_array_equal(slider, x[1:])


def test_along_a_line_three_dimensions_are_two() -> None:
    rng = np.random.default_rng(1)
    line = np.array([0.6, -0.8])
    slider = 0.0
    seen = set()
    for _ in range(200):
        normal, across = rng.uniform(-6e-3, 4e-3), rng.uniform(-4e-3, 4e-3)
        plane = apply(RUB, np.array([normal, across]), np.array([slider]))
        space = apply(RUB3, np.array([normal, *(across * line)]), slider * line)
        seen.add(plane[0])
        assert space[0] == plane[0]
        np.testing.assert_allclose(
            space[1], [plane[1][0], *(plane[1][1] * line)], rtol=1e-12, atol=1e-12
        )
        np.testing.assert_allclose(space[2], plane[2][0] * line, rtol=1e-12, atol=1e-16)
        slider = plane[2][0]
    assert seen == {OPEN, SLIP, STICK}


def test_friction_has_no_preferred_direction() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.eye(3)
        turn[1:, 1:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        x, slider = rng.uniform(-4e-3, 4e-3, 3), rng.uniform(-4e-3, 4e-3, 2)
        state, force, new = apply(RUB3, x, slider)
        turned = apply(RUB3, turn @ x, turn[1:, 1:] @ slider)
        assert turned[0] == state
        np.testing.assert_allclose(turned[1], turn @ force, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(turned[2], turn[1:, 1:] @ new, rtol=1e-12, atol=1e-16)


# ------------------------------------------------------------------ surfaces


def casing(
    d: int = 3,
    *,
    kind: int = CYLINDER,
    inside: bool = True,
    waves: bool = False,
    spin: float = 0.0,
    **values: Any,
) -> Contacts:
    """A point before a round surface of radius about 0.3 m, its axis askew, whose normal there is
    the first axis."""
    given = {
        "preload": 3.0,
        "normal_stiffness": 2e4,
        "tangential_stiffness": 1e4,
        "friction": 0.4,
    } | values
    flat = one_contact(d, **given)
    side = 1.0 if inside else -1.0
    axes = np.zeros((1, d, d))
    if d == 2 or kind == SPHERE:
        axes[0] = frame(np.array([0.8, 0.6, 0.0][:d]))
    else:
        axes[0, :2] = np.array([[0.8, 0.6 * 0.6, 0.6 * 0.8], [-0.6, 0.8 * 0.6, 0.8 * 0.8]])
    return flat._replace(
        kind=np.array([kind]),
        axes=axes,
        centre=np.array([[-0.3 * side, 0.0, 0.0][:d]]),
        radius=np.array([0.3]),
        side=np.array([side]),
        spin=np.array([spin]),
        order=np.array([2.0, 5.0] if waves else []),
        height=np.array([[3e-3, -1e-3] if waves else []]),
        phase=np.array([[0.3, 1.0] if waves else []]),
        times=np.array([0.0, 2.0]),
        approach=np.array([[0.0, 4e-3]]),
    )


SURFACES = [
    pytest.param(lambda d: RUB if d == 2 else RUB3, id="plane"),
    pytest.param(lambda d: casing(d), id="casing"),
    pytest.param(lambda d: casing(d, inside=False), id="shaft"),
    pytest.param(lambda d: casing(d, waves=True, spin=2e-3), id="oval casing that turns"),
    pytest.param(lambda d: casing(d, kind=SPHERE) if d == 3 else casing(d), id="sphere"),
]


def test_penetration_of_round_surfaces() -> None:
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


def test_waves_turn_with_the_surface() -> None:
    still, gyroscopic_matrix = casing(2, waves=True), casing(2, waves=True, spin=0.7)
    centre, angle = still.centre[0], 0.7 * 1.3
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x = np.array([4e-3, 0.1])
    there = centre + turn @ (x - centre)
    assert penetration(gyroscopic_matrix, 0, there, 1.3) == pytest.approx(
        penetration(still, 0, x, 1.3), rel=1e-12
    )
    carried = np.empty(2)
    advect_with_surface(gyroscopic_matrix, 0, 1.3, x, carried)
    np.testing.assert_allclose(carried, there, rtol=1e-14)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_direction_is_the_discrete_gradient_of_the_penetration(surface: Any, d: int) -> None:
    contacts, rng = surface(d), np.random.default_rng(6)
    wavy = contacts.order.size > 0
    n, slope_, spare = np.empty(d), np.empty((d, d)), np.empty(d)

    def mean(x0: Array, x1: Array) -> Array:
        gap_discrete_gradient(contacts, 0, x0, x1, 0.4, n, slope_, spare)
        return n.copy()

    for _ in range(20):
        x0, x1 = rng.uniform(-0.05, 0.05, (2, d))
        change = penetration(contacts, 0, x1, 0.4) - penetration(contacts, 0, x0, 0.4)
        assert mean(x0, x1) @ (x1 - x0) == pytest.approx(
            change, rel=1e-11 if not wavy else 2e-2, abs=1e-16 if not wavy else 2e-4
        )
        if contacts.kind[0] != PLANE:
            assert_tangent(
                lambda x: mean(x0, x), lambda x: (mean(x0, x), slope_.copy())[1], x1, step=1e-5
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


@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_slope_of_the_mean_force_is_consistent(surface: Any, d: int, a: float, line: bool) -> None:
    contacts, rng = surface(d), np.random.default_rng(7)
    seen = set()
    for _ in range(40):
        start = zero_contact_state(1, d)
        way = np.array([6e-3, *([1e-3] * (d - 1))])
        at_rest(
            contacts,
            rng.uniform(-way, way, (1, d)),
            rng.uniform(-way, way, (1, d)),
            0.1,
            start,
            contact_scratch(1, d),
        )
        x = rng.uniform(-way, way)

        def found(x: Array) -> Any:
            return step(contacts, start, x[None], a, line, (0.1, 0.5))[1]  # noqa: B023

        near = [
            step(contacts, start, (x + s * e)[None], a, line, (0.1, 0.5))[:2]
            for e in np.eye(d)
            for s in (-1e-6, 1e-6)
        ]
        sides = {(int(found.mode[0]), bool(end.trial_normal_force[0] > 0.0)) for end, found in near}
        if len(sides) > 1:
            continue  # a kink
        seen |= {motion for motion, _ in sides}
        if np.abs(found(x).force_derivative).max() < 1e-9:  # open, or only at its start not
            np.testing.assert_array_equal(found(x + 1e-7).mean_force.copy(), found(x).mean_force)
            continue
        assert_tangent(
            lambda x: found(x).mean_force[0].copy(),
            lambda x: found(x).force_derivative[0].copy(),
            x,
            step=1e-7,
            tolerance=5e-8,
        )
    assert seen == {OPEN, SLIP, STICK}


@pytest.mark.parametrize("lean", [0.0, 0.3, 1.0])
def test_a_force_that_leans_to_the_end_takes_energy(lean: float) -> None:
    """Whatever the step; and its slope is its derivative."""
    rng = np.random.default_rng(3)
    for before, after in rng.uniform(-2.0, 2.0, (500, 2)):
        force, slope = blended_normal_force(before, after, lean)
        stored = (max(after, 0.0) ** 2 - max(before, 0.0) ** 2) / 2
        lost = force * (after - before) - stored
        assert lost >= -1e-14 if lean else abs(lost) < 1e-14
        ahead, behind = (blended_normal_force(before, after + e, lean)[0] for e in (1e-6, -1e-6))
        if abs(after) > 1e-5:
            assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-5)
    assert blended_normal_force(0.0, 2.0, lean)[0] == pytest.approx(1.0 + lean)


def test_a_small_displacement_is_not_lost_in_a_large_radius() -> None:
    """Differences of the penetration of a casing of 2.5 m between points some nanometres apart, to
    1e-7 of them."""
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


@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_every_step_dissipates_and_balances_its_energy(
    surface: Any, d: int, a: float, line: bool
) -> None:
    contacts, rng = surface(d), np.random.default_rng(8)
    here, lost = zero_contact_state(1, d), []
    at_rest(contacts, np.zeros((1, d)), np.zeros((1, d)), 0.0, here, contact_scratch(1, d))
    states = set()
    for k in range(400):
        way = (
            np.array([2e-3, *([6e-4] * (d - 1))])
            if contacts.kind[0] == PLANE
            else np.array([2e-3, *([2e-4] * (d - 1))])
        )
        x = here.x + rng.uniform(-way, way, (1, d)) - 0.1 * here.x
        end, found, dissipated, surface_work = step(
            contacts, here, x, a, line, (0.01 * k, 0.01 * (k + 1))
        )
        gain = contact_energy(contacts, end) - contact_energy(contacts, here)
        work = float(np.sum(found.mean_force * (x - here.x)))
        if (
            line and contacts.order.size == 0
        ):  # what goes in is stored, dissipated, or came from the surface
            assert work + surface_work == pytest.approx(gain + dissipated, rel=1e-9, abs=1e-12)
        lost.append(dissipated / (1.0 + contact_energy(contacts, here)))
        limit = contacts.friction[0] * max(end.trial_normal_force[0], 0.0)
        assert np.linalg.norm(end.friction[0]) <= limit * (1 + 1e-12)
        states.add(int(end.state[0]))
        here = end
    if line:
        assert min(lost) >= -1e-15
    assert sum(lost) > 0.0
    assert max(lost) > 1e-6
    assert states == {OPEN, SLIP, STICK}


def test_node_dragged_around_a_casing_does_the_work_of_friction() -> None:
    radius, turn, depth = 0.3, 5.0, 1e-4
    errors = []
    for dragged in (True, False):  # or the casing is turned about a node at rest
        contacts = casing(2, spin=0.0 if dragged else -turn, preload=0.0)._replace(
            approach=np.zeros((1, 2))
        )
        normal = 2e4 * depth
        stretch = 0.4 * normal / 1e4
        for steps in (500, 1000):
            here = zero_contact_state(1, 2)
            at_rest(
                contacts,
                np.array([[depth, 0.0]]),
                np.array([[depth, -stretch]]),
                0.0,
                here,
                contact_scratch(1, 2),
            )
            total = np.zeros(3)
            for k in range(steps):
                angle = turn * (k + 1) / steps if dragged else 0.0
                x = (radius + depth) * np.array([[np.cos(angle), np.sin(angle)]]) - [[radius, 0.0]]
                end, found, dissipated, surface = step(
                    contacts, here, x, 0.5, True, (k / steps, (k + 1) / steps)
                )
                total += np.sum(found.mean_force * (x - here.x)), dissipated, surface
                assert end.state[0] == SLIP
                here = end
            exact = 0.4 * normal * (radius + depth) * turn
            assert total[1] == pytest.approx(exact, rel=1e-3)
            assert total[0 if dragged else 2] == pytest.approx(exact, rel=1e-3)
            errors.append(abs(total[1] / exact - 1.0))
    assert errors[1] < 0.6 * errors[0] or errors[1] < 1e-5


def test_two_points_of_half_weight_equal_one() -> None:
    rng = np.random.default_rng(9)
    for a, line in SCHEMES:
        whole = casing(3, waves=True, spin=0.7)
        half = Contacts(
            *(
                np.repeat(v, 2, axis=0) if k not in ("times", "order") else v
                for k, v in whole._asdict().items()
            )
        )
        half = half._replace(
            **{
                k: 0.5 * getattr(half, k)
                for k in ("preload", "normal_stiffness", "tangential_stiffness")
            }
        )
        start, double = zero_contact_state(1, 3), zero_contact_state(2, 3)
        x, w = rng.uniform(-2e-3, 2e-3, (2, 1, 3))
        at_rest(whole, x, w, 0.0, start, contact_scratch(1, 3))
        at_rest(
            half,
            np.repeat(x, 2, axis=0),
            np.repeat(w, 2, axis=0),
            0.0,
            double,
            contact_scratch(2, 3),
        )
        root = rng.standard_normal((3, 3))
        compliance, free = 1e-4 * (np.eye(3) + 0.2 * root @ root.T), rng.uniform(0.0, 4e-3, (1, 3))
        ends = zero_contact_state(1, 3), zero_contact_state(2, 3)
        rooms = contact_scratch(1, 3), contact_scratch(2, 3)
        assert solve_contact(
            whole, Interval(0.0, 0.3, a, line), compliance, free, start, ends[0], rooms[0]
        )
        both = np.tile(compliance, (2, 2))
        assert solve_contact(
            half,
            Interval(0.0, 0.3, a, line),
            both,
            np.repeat(free, 2, axis=0),
            double,
            ends[1],
            rooms[1],
        )
        np.testing.assert_allclose(
            ends[1].x, np.repeat(ends[0].x, 2, axis=0), rtol=1e-9, atol=1e-14
        )
        np.testing.assert_allclose(
            rooms[1].mean_force.sum(axis=0), rooms[0].mean_force[0], rtol=1e-9
        )


# ------------------------------------------------------------------ energies


def friction_dissipation(contacts: Contacts, path: Array, a: float, line: bool) -> float:
    """Energy dissipated along a path (steps, d), its first point at rest."""
    here, lost = rest(contacts, path[0], path[0, 1:]), 0.0
    for x in path[1:]:
        here, _, dissipated, _ = step(contacts, here, x[None], a, line)
        lost += dissipated
    return lost


@pytest.mark.parametrize(("a", "line"), SCHEMES)
def test_closed_loop_of_a_jenkins_element(a: float, line: bool) -> None:
    preload, amplitude = 30.0, 6e-3
    limit = RUB.friction[0] * preload
    up = np.linspace(
        -amplitude, amplitude, 1 + 8 * 6
    )  # every turning and yielding point lies on the path
    loop = np.concatenate([up[24:], up[-2::-1], up[1:]])
    path = np.stack([np.zeros_like(loop), loop], axis=1)  # N0 - k_n g0 = 30 N
    first = len(up) - 24 - 1  # from the crest to the next
    closed = friction_dissipation(RUB, path, a, line) - friction_dissipation(
        RUB, path[: first + 1], a, line
    )
    assert closed == pytest.approx(
        4 * limit * (amplitude - limit / RUB.tangential_stiffness[0]), rel=1e-12
    )


@pytest.mark.parametrize(("a", "line"), SCHEMES)
def test_a_loop_that_yields_within_its_steps(a: float, line: bool) -> None:
    """The energy lost is exact where slip is located within the step, and of second order at the
    weighted point."""
    preload, amplitude = 30.0, 6e-3
    limit = RUB.friction[0] * preload
    exact = 4 * limit * (amplitude - limit / RUB.tangential_stiffness[0])
    errors = []
    for steps in (46, 460):
        up = np.linspace(-amplitude, amplitude, 1 + steps)
        loop = np.concatenate([up[steps // 2 :], up[-2::-1], up[1:]])
        path = np.stack([np.zeros_like(loop), loop], axis=1)
        turn = len(up) - steps // 2 - 1
        errors.append(
            abs(
                friction_dissipation(RUB, path, a, line)
                - friction_dissipation(RUB, path[: turn + 1], a, line)
                - exact
            )
            / exact
        )
    if line:
        assert max(errors) < 1e-12
    else:
        assert 0.0 < errors[0] < 0.02 and errors[1] <= 0.05 * errors[0] + 1e-9


def along(
    contacts: Contacts, start: ContactState, x: Array, parts: int
) -> tuple[ContactState, Array, float]:
    """A straight step in equal parts: its end, the mean force and what is dissipated."""
    here, mean, lost = start, np.zeros_like(x), 0.0
    for k in range(parts):
        end, found, dissipated, _ = step(
            contacts, here, start.x + (x - start.x) * (k + 1) / parts, 0.5, True
        )
        mean, lost, here = mean + found.mean_force / parts, lost + dissipated, end
    return here, mean, lost


@pytest.mark.parametrize("d", [2, 3])
def test_a_step_is_what_its_parts_come_to(d: int) -> None:
    """Closing, opening, sticking and slipping are located within the step: exactly for a point that
    slides to and fro."""
    contacts, rng = RUB if d == 2 else RUB3, np.random.default_rng(11)
    way = np.array([6e-3, *([3e-3] * (d - 1))])
    changes, gaps = set(), []
    for _ in range(200):
        start = zero_contact_state(1, d)
        at_rest(
            contacts,
            rng.uniform(-way, way, (1, d)),
            rng.uniform(-way, way, (1, d)),
            0.0,
            start,
            contact_scratch(1, d),
        )
        x = rng.uniform(-way, way, (1, d))
        whole, fine = along(contacts, start, x, 1), along(contacts, start, x, 37)
        changes.add((int(start.state[0]), int(whole[0].state[0])))
        if d == 2:
            np.testing.assert_allclose(whole[1], fine[1], rtol=1e-11, atol=1e-11)
            np.testing.assert_allclose(whole[0].friction, fine[0].friction, rtol=1e-9, atol=1e-11)
            assert whole[2] == pytest.approx(fine[2], rel=1e-9, abs=1e-14)
        else:
            finer, finest = along(contacts, start, x, 74), along(contacts, start, x, 592)
            gaps.append([np.abs(some[1] - finest[1]).max() for some in (fine, finer)])
    assert len(changes) >= 8
    if d == 3:  # the direction of slip turns within the parts
        coarse, finer = np.array(gaps).max(axis=0)
        assert 0.0 < finer < 0.3 * coarse < 3e-2


def test_a_point_led_in_a_circle_drags_its_slider_on_a_smaller_one() -> None:
    preload, radius = 30.0, 4e-3
    limit = RUB.friction[0] * preload
    inner = np.sqrt(radius**2 - (limit / RUB.tangential_stiffness[0]) ** 2)
    errors = []
    for steps in (200, 400):
        angle = 2 * np.pi * np.arange(5 * steps + 1) / steps
        path = np.stack(
            [np.zeros_like(angle), radius * np.cos(angle), radius * np.sin(angle)], axis=1
        )
        last = friction_dissipation(RUB3, path, 0.5, True) - friction_dissipation(
            RUB3, path[:-steps], 0.5, True
        )
        errors.append(abs(last / (2 * np.pi * inner * limit) - 1))
    assert errors[1] < 2e-3
    assert slope([2, 1], errors) == pytest.approx(2.0, abs=0.2)


def test_energy_of_the_springs() -> None:
    two = one_contact(3, normal_stiffness=[1e4, 2e4], tangential_stiffness=[3e3, 4e3])
    here = zero_contact_state(2, 3)
    here.trial_normal_force[:] = [10.0, -5.0]
    here.friction[:] = [[0.0, 3.0, 4.0], [0.0, 6.0, 0.0]]
    assert contact_energy(two, here) == pytest.approx(100 / 2e4 + 25 / 6e3 + 36 / 8e3, rel=1e-14)


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


def random_problem(
    rng: np.random.Generator, points: int, d: int, stiffness: float | None
) -> dict[str, Any]:
    """A contact problem of lengths about 1, from a state that the law allows; stiffness relative to
    the structure."""
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
        "compliance": np.eye(m) + 0.3 * root @ root.T / m,
        "free": rng.uniform(-2.0, 2.0, (points, d)),
        "start": start,
    }


def solve(problem: dict[str, Any], a: float, line: bool) -> tuple[bool, ContactState, Any]:
    """Whether it was solved, the end of the step and what was found."""
    points, d = problem["free"].shape
    start = problem["start"]
    end, found = zero_contact_state(points, d), contact_scratch(points, d)
    end.x[:] = start.x
    copies = {"compliance": problem["compliance"].copy(), "free": problem["free"].copy()} | {
        name: array.copy() for name, array in start._asdict().items()
    }
    solved = solve_contact(
        problem["contacts"],
        Interval(0.0, 1.0, a, line),
        problem["compliance"],
        problem["free"],
        start,
        end,
        found,
    )
    for name, copy in copies.items():
        here = problem[name] if name in problem else getattr(start, name)
        assert np.array_equal(here, copy), f"{name} was written to"
    return solved, end, found


@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize(("points", "d"), [(1, 2), (1, 3), (2, 2), (3, 3)])
@pytest.mark.parametrize("stiffness", [None, 1e6, 1e12])
def test_contact_problem_is_solved_at_any_stiffness(
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
            + (problem["compliance"] @ found.mean_force.ravel()).reshape(points, d)
        )
        # x is right to rounding, which a stiff contact multiplies
        stiffest = problem["contacts"].normal_stiffness.max() * np.abs(problem["compliance"]).max()
        assert np.abs(residual).max() <= 1e-13 * (1.0 + stiffest) + 1e-10
    # a mean along the step that starts far off is hard on friction: now and then the step has to be
    # halved
    assert unsolved == 0, "the iteration cycles"
    assert seen == {OPEN, SLIP, STICK}


@pytest.mark.parametrize("d", [2, 3])
def test_a_stiff_contact_that_is_let_go_is_solved(d: int) -> None:
    """Where the mean force leans to the end, and with it the limit of friction, most of the
    friction before is let go."""
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
        end, found, interval, compliance = (
            zero_contact_state(1, d),
            contact_scratch(1, d),
            Interval(0.0, 1.0, 0.5, True),
            np.eye(d),
        )
        end.x[:] = x
        implicit_blending(contacts, interval, compliance, start, found)
        unsolved += not solve_contact(contacts, interval, compliance, free, start, end, found)
        slid += found.mode[0] == SLIP
    assert unsolved <= 2, "the iteration cycles"
    assert slid > 100


def brute_force(problem: dict[str, Any]) -> list[Array]:
    """All solutions of a planar problem without start weight: each combination of states is linear;
    keep what fits."""
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
        system = np.eye(points * d) + problem["compliance"] @ matrix
        x = np.linalg.solve(system, free.ravel() - problem["compliance"] @ rhs).reshape(points, d)
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
def test_contact_problem_against_brute_force(points: int) -> None:
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
    """Farthest displacement of a block on a rigid floor, and the energy rubbed, until just after it
    has stopped."""
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
        block, floor, fixed_steps(scheme, steps, 1.3 * stop), None, dimension=2, start=start
    )
    assert np.all(motion.force[:, 0, 0] == pytest.approx(MASS * GRAVITY))
    return float(motion.displacement[:, 0, 1].max()), float(motion.friction_dissipation[-1])


@pytest.mark.parametrize(
    "scheme", ["discrete-gradient", "average-acceleration", "generalised-alpha"]
)
def test_block_slides_to_rest(scheme: str) -> None:
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
def test_an_impact_within_a_step_rubs_as_hard_as_it_pushes(stiffness: float, share: float) -> None:
    """A mass that strikes a wall at 45 degrees slides all the while: its impulses are as its
    forces, mu to one."""
    mass = linear_model(np.eye(2), 1e-9 * np.eye(2), masters=2)
    wall = one_contact(
        gap=0.1 + 0.01 * share,
        normal_stiffness=stiffness,
        tangential_stiffness=0.5 * stiffness,
        friction=0.2,
    )
    start = np.zeros(2), np.ones(2)
    motion = integrate(
        mass, wall, fixed_steps("discrete-gradient", 40, 0.4), None, dimension=2, start=start
    )
    normal, friction = np.diff(motion.time) @ motion.mean_force[1:, 0]
    assert normal > 0.99
    assert friction == pytest.approx(0.2 * normal, rel=2e-3)


def test_no_contacts_are_none() -> None:
    assert all(values.shape[0] == 0 for values in no_contacts())
    assert contact_energy(no_contacts(), zero_contact_state(0, 2)) == 0.0
