"""The contact law over a step against its definition and closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from contact_cases import RUB, RUB3, SCHEMES, SURFACES, apply, casing, rest, step
from numpy.typing import NDArray
from support import assert_tangent, one_contact

from fenicsrom.online.contact.friction import blended, mean_of_positive
from fenicsrom.online.contact.law import at_rest, contact_energy
from fenicsrom.online.contact.state import (
    OPEN,
    SLIP,
    STICK,
    ContactState,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import PLANE, Contacts

Array = NDArray[np.float64]


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
def test_contact_law_gives_state_force_and_slider(
    x: list[float], state: int, force: list[float], slider: float
) -> None:
    found = apply(RUB, np.array(x), np.array([0.001]))
    assert found[0] == state
    np.testing.assert_allclose(found[1], force, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(found[2], [slider], rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_slider_without_friction_follows_the_point(dimension: int) -> None:
    x = np.array([0.002, 0.3, -0.2])[:dimension]
    contacts = (RUB if dimension == 2 else RUB3)._replace(friction=np.zeros(1))
    state, force, slider = apply(contacts, x, np.zeros(dimension - 1))
    assert state == SLIP
    np.testing.assert_array_equal(force[1:], 0.0)
    np.testing.assert_array_equal(slider, x[1:])


def test_law_in_3d_along_a_line_equals_law_in_2d() -> None:
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


def test_friction_of_a_turned_displacement_is_turned() -> None:
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("a", "line", "blending"), [*((*scheme, 0.0) for scheme in SCHEMES), (0.5, True, 0.3)]
)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_force_derivative_matches_differences(
    surface: Any, d: int, a: float, line: bool, blending: float
) -> None:
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

        def found(x: Array, start: ContactState = start) -> Any:
            return step(contacts, start, x[None], a, line, (0.1, 0.5), blending)[1]

        near = [
            step(contacts, start, (x + s * e)[None], a, line, (0.1, 0.5), blending)[:2]
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
            lambda x, found=found: found(x).mean_force[0].copy(),
            lambda x, found=found: found(x).force_derivative[0].copy(),
            x,
            step=1e-7,
            tolerance=5e-8,
        )
    assert seen == {OPEN, SLIP, STICK}


@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize("surface", SURFACES[:2])
def test_forces_scale_with_the_stiffnesses(surface: Any, a: float, line: bool) -> None:
    """Also forces of nanonewtons."""
    heavy, rng, unit = surface(3), np.random.default_rng(12), 1e-9
    names = ("preload", "normal_stiffness", "tangential_stiffness")
    light = heavy._replace(**{name: unit * getattr(heavy, name) for name in names})
    way, modes = np.array([6e-3, 1e-3, 1e-3]), set()
    for _ in range(40):
        x, w, end = rng.uniform(-way, way, (3, 1, 3))
        forces = []
        for contacts in (heavy, light):
            start = zero_contact_state(1, 3)
            at_rest(contacts, x, w, 0.1, start, contact_scratch(1, 3))
            found = step(contacts, start, end, a, line, (0.1, 0.5))[1]
            forces.append(found.mean_force)
        modes.add(int(found.mode[0]))
        np.testing.assert_allclose(forces[1] / unit, forces[0], rtol=1e-8, atol=1e-8)
    assert modes == {OPEN, SLIP, STICK}


@pytest.mark.parametrize("blending", [0.0, 0.3, 1.0])
def test_blended_normal_force_takes_energy(blending: float) -> None:
    rng = np.random.default_rng(3)
    for before, after in rng.uniform(-2.0, 2.0, (500, 2)):
        force = blended(before, after, blending)
        stored = (max(after, 0.0) ** 2 - max(before, 0.0) ** 2) / 2
        lost = force * (after - before) - stored
        assert lost >= -1e-14 if blending else abs(lost) < 1e-14
    assert blended(0.0, 2.0, blending) == pytest.approx(1.0 + blending)


@pytest.mark.slow
@pytest.mark.parametrize(("a", "line"), SCHEMES)
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("surface", SURFACES)
def test_step_dissipates_and_balances_energy(surface: Any, d: int, a: float, line: bool) -> None:
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


def test_node_dragged_around_casing_does_the_work_of_friction() -> None:
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


# ------------------------------------------------------------------ energies


def friction_dissipation(contacts: Contacts, path: Array, a: float, line: bool) -> float:
    """Energy dissipated along a path (steps, d), its first point at rest."""
    here, lost = rest(contacts, path[0], path[0, 1:]), 0.0
    for x in path[1:]:
        here, _, dissipated, _ = step(contacts, here, x[None], a, line)
        lost += dissipated
    return lost


@pytest.mark.parametrize(("a", "line"), SCHEMES)
def test_slip_dissipation_matches_jenkins_loop(a: float, line: bool) -> None:
    """Every turning and yielding point lies on a path of 48 steps. Where slip begins within a step,
    the dissipation is exact if the step locates it, else of second order.

    Reference: energy of a closed friction loop | closed form | 4 μN (X − μN/k_t) | agrees | 1e-12
    """
    preload, amplitude = 30.0, 6e-3
    limit = RUB.friction[0] * preload
    exact = 4 * limit * (amplitude - limit / RUB.tangential_stiffness[0])
    errors = []
    for steps in (48, 46, 460):
        up = np.linspace(-amplitude, amplitude, 1 + steps)
        loop = np.concatenate([up[steps // 2 :], up[-2::-1], up[1:]])
        path = np.stack([np.zeros_like(loop), loop], axis=1)  # N0 - k_n g0 = 30 N
        crest = len(up) - steps // 2  # the loop closes at the next one
        whole, first = (friction_dissipation(RUB, x, a, line) for x in (path, path[:crest]))
        errors.append(abs(whole - first - exact) / exact)
    assert errors[0] < 1e-12
    if line:
        assert max(errors) < 1e-12
    else:
        assert 0.0 < errors[1] < 0.02 and errors[2] <= 0.05 * errors[1] + 1e-9


def along(
    contacts: Contacts, start: ContactState, x: Array, parts: int
) -> tuple[ContactState, Array, float]:
    """A straight step in equal parts: its end, the mean force and the dissipation."""
    here, mean, lost = start, np.zeros_like(x), 0.0
    for k in range(parts):
        end, found, dissipated, _ = step(
            contacts, here, start.x + (x - start.x) * (k + 1) / parts, 0.5, True
        )
        mean, lost, here = mean + found.mean_force / parts, lost + dissipated, end
    return here, mean, lost


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
def test_one_step_equals_the_mean_of_its_parts(d: int) -> None:
    """Touch-down, lift-off, stick and slip are located within the step, exactly for a point that
    moves to and fro."""
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


def test_contact_energy_is_that_of_the_springs() -> None:
    two = one_contact(3, normal_stiffness=[1e4, 2e4], tangential_stiffness=[3e3, 4e3])
    here = zero_contact_state(2, 3)
    here.trial_normal_force[:] = [10.0, -5.0]
    here.friction[:] = [[0.0, 3.0, 4.0], [0.0, 6.0, 0.0]]
    assert contact_energy(two, here) == pytest.approx(100 / 2e4 + 25 / 6e3 + 36 / 8e3, rel=1e-14)


def test_mean_normal_force_is_discrete_gradient_of_energy() -> None:
    rng = np.random.default_rng(3)
    kinds = set()
    for before, after in rng.uniform(-50.0, 50.0, (500, 2)):
        mean = mean_of_positive(before, after)
        kinds.add((before > 0, after > 0))
        work = 0.5 * max(after, 0.0) ** 2 - 0.5 * max(before, 0.0) ** 2
        assert mean * (after - before) == pytest.approx(work, rel=1e-12, abs=1e-9)
    assert len(kinds) == 4
    assert mean_of_positive(7.0, 7.0) == 7.0
    assert mean_of_positive(0.0, 0.0) == 0.0


@pytest.mark.parametrize(("moved", "force"), [(0.0, 15.0), (-1e-4, 14.0), (1e-3, 15.0)])
def test_stretch_beyond_the_limit_at_the_start_is_cut(moved: float, force: float) -> None:
    """The normal force of 30 N allows 15 N; the stretch of 3 mm at the start would give 60 N.

    The point then rests, moves back (15 N - 2e4 N/m 0.1 mm/2), or slips on.
    """
    start = rest(RUB, np.array([0.0, 0.0]), np.zeros(1))
    start.slider[0, 1] = -3e-3
    end, found, *_ = step(RUB, start, np.array([[0.0, moved]]), 0.5, True)
    np.testing.assert_allclose(found.mean_force[0], [30.0, force], rtol=1e-12)
    stretch = min(15.0 / 2e4, 15.0 / 2e4 + moved)
    np.testing.assert_allclose(moved - end.slider[0, 1], stretch, rtol=1e-12)


def test_point_that_leaves_a_casing_has_no_friction_whatever_its_slider() -> None:
    """Also where the friction spring gave up more energy than it held."""
    contacts, rng = casing(2), np.random.default_rng(5)
    gave = 0
    for _ in range(40):
        start = rest(contacts, np.array([rng.uniform(0.0, 1e-3), 0.0]), np.zeros(1))
        start.slider[0, 1] += rng.uniform(-5e-4, 5e-4)
        end, _, lost, _ = step(
            contacts, start, np.array([[-5e-3, rng.uniform(-1e-3, 1e-3)]]), 0.5, True
        )
        assert end.state[0] == OPEN
        np.testing.assert_array_equal(end.friction, 0.0)
        gave += lost < 0.0
    assert gave > 0
