"""The geometrically exact beam against its own energy, Timoshenko's theory, and the elastica."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm
from scipy.optimize import brentq, root
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.reduction.beam import TimoshenkoBeam, _assemble, beam_structure
from fenicsrom.scene import BeamSection, Material

Array = NDArray[np.float64]

STEEL = Material(young=207e9, poisson=0.28, density=7801.0, mass_damping=5.0)
PAPER = BeamSection(length=2.54, height=0.0254, width=0.0254, elements=20, load_at=0.7)
STOCKY = BeamSection(length=1.0, height=0.2, width=0.1, elements=20, load_at=1.0)
SLENDER = BeamSection(length=1.0, height=1e-4, width=1.0, elements=20, load_at=1.0)


def rigidities(section: BeamSection) -> tuple[float, float, float]:
    """EA, κ_s GA, EI by hand."""
    axial = STEEL.young * section.width * section.height
    return axial, 5 / 6 * axial / (2 * (1 + STEEL.poisson)), axial * section.height**2 / 12


def equilibrium(beam: TimoshenkoBeam, loads: list[Array]) -> Array:
    """Newton's method for a series of loads, from rest."""
    q = np.zeros(len(beam.mass))
    for load in loads:
        for _ in range(60):
            force, tangent = beam.elastic(q)
            step = np.linalg.solve(tangent, load - force)
            q = q + step
            if np.abs(step).max() < 1e-11 * beam.length:
                break
        else:
            raise AssertionError("Newton's method does not converge")
    return q


def tip_load(beam: TimoshenkoBeam, component: int, value: float) -> Array:
    load = np.zeros(len(beam.mass))
    load[beam.unknown(beam.tip_node, component)] = value
    return load


def tip(beam: TimoshenkoBeam, q: Array) -> Array:
    """u, w, θ of the tip."""
    return q[[beam.unknown(beam.tip_node, component) for component in range(3)]]


def bent(seed: int, n: int) -> Array:
    """A state with large rotations, extension and shear."""
    return np.random.default_rng(seed).normal(scale=[0.05, 0.1, 0.7], size=(n // 3, 3)).ravel()


@pytest.mark.parametrize("linear", [False, True])
def test_force_is_the_derivative_of_the_energy(linear: bool) -> None:
    beam = TimoshenkoBeam(replace(STOCKY, elements=4), STEEL, linear)
    q, h = bent(1, 12), 1e-6
    differences = [(beam.energy(q + h * d) - beam.energy(q - h * d)) / (2 * h) for d in np.eye(12)]
    force = beam.elastic(q)[0]
    assert np.abs(force - differences).max() < 1e-8 * np.abs(force).max()


@pytest.mark.parametrize("linear", [False, True])
def test_tangent_is_the_derivative_of_the_force(linear: bool) -> None:
    beam = TimoshenkoBeam(replace(STOCKY, elements=4), STEEL, linear)
    q, h = bent(2, 12), 1e-6
    differences = np.array(
        [(beam.elastic(q + h * d)[0] - beam.elastic(q - h * d)[0]) / (2 * h) for d in np.eye(12)]
    ).T
    tangent = beam.elastic(q)[1]
    assert np.abs(tangent - differences).max() < 1e-8 * np.abs(tangent).max()
    assert np.array_equal(tangent, tangent.T)


def test_compiled_beam_equals_plain_python() -> None:
    q = bent(3, 21)
    compiled, plain = (f(q, 0.1, 2.0, 3.0, 5.0) for f in (_assemble, _assemble.py_func))
    for a, b in zip(compiled, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)


def test_linear_beam_is_the_tangent_at_rest() -> None:
    linear, exact = (TimoshenkoBeam(STOCKY, STEEL, choice) for choice in (True, False))
    q = bent(4, 60)
    np.testing.assert_array_equal(linear.elastic(q)[1], exact.elastic(np.zeros(60))[1])
    np.testing.assert_allclose(linear.elastic(q)[0], linear.stiffness @ q)
    assert exact.energy(1e-5 * q) == pytest.approx(linear.energy(1e-5 * q), rel=1e-3)
    assert abs(exact.energy(q) / linear.energy(q) - 1.0) > 0.1


def test_rigid_motion_has_no_energy_and_no_force() -> None:
    """Without supports, a rotation about the root and a shift have no energy and no force, and the
    force rotates with the beam."""
    x, angle = np.linspace(0.0, 2.54, 21), 2.0
    rigid = np.column_stack(
        (x * (np.cos(angle) - 1) + 0.4, x * np.sin(angle) - 0.7, np.full(21, angle))
    )
    stiffness = 1e7, 3e6, 4e3
    energy, force, _ = _assemble(rigid.ravel(), x[1], *stiffness)
    assert energy < 1e-20 * stiffness[0]
    assert np.abs(force).max() < 1e-13 * stiffness[0]

    rotation = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    start = np.column_stack((x, 0 * x, 0 * x))
    shape = bent(5, 63).reshape(-1, 3)
    turned = (start + shape) @ rotation.T + np.array([0.0, 0.0, angle]) - start
    before, force_before, _ = _assemble(shape.ravel(), x[1], *stiffness)
    after, force_after, _ = _assemble(turned.ravel(), x[1], *stiffness)
    assert after == pytest.approx(before, rel=1e-12)
    np.testing.assert_allclose(
        force_after.reshape(-1, 3),
        force_before.reshape(-1, 3) @ rotation.T,
        atol=1e-10 * np.abs(force_before).max(),
    )


@pytest.mark.parametrize("elements", [1, 20])
def test_linear_statics_is_exact_at_the_nodes(elements: int) -> None:
    """A tip force gives P L³/3EI by bending and P L/κGA by shear, for any number of elements."""
    beam = TimoshenkoBeam(replace(STOCKY, elements=elements), STEEL, True)
    axial, shear, bending = rigidities(STOCKY)
    _, w, theta = tip(beam, equilibrium(beam, [tip_load(beam, 1, 1e3)]))
    assert w == pytest.approx(1e3 / (3 * bending) + 1e3 / shear, rel=1e-12)
    assert theta == pytest.approx(1e3 / (2 * bending), rel=1e-12)
    u, *_ = tip(beam, equilibrium(beam, [tip_load(beam, 0, 1e3)]))
    assert u == pytest.approx(1e3 / axial, rel=1e-12)


def test_mass_and_rotary_inertia_match_closed_form() -> None:
    """The fields u = x, w = x, θ = x give ρA/3, ρA/3, ρI/3 on a beam of unit length."""
    beam = TimoshenkoBeam(STOCKY, STEEL, False)
    x = np.arange(1, 21) / 20
    area, inertia = STOCKY.width * STOCKY.height, STOCKY.width * STOCKY.height**3 / 12
    for component, value in enumerate((area, area, inertia)):
        field = np.zeros(60)
        field[component::3] = x
        assert field @ beam.mass @ field == pytest.approx(STEEL.density * value / 3, rel=1e-12)
    assert np.array_equal(beam.mass, beam.mass.T)


def timoshenko_frequencies(
    section: BeamSection, brackets: list[tuple[float, float]]
) -> list[float]:
    """Frequencies in Hz of the continuous cantilever: roots of the transfer matrix of (w, θ, V, M),
    clamp to tip."""
    _, shear, bending = rigidities(section)
    line = STEEL.density * section.width * section.height
    rotary = line * section.height**2 / 12

    def determinant(frequency: float) -> float:
        square = (2 * np.pi * frequency) ** 2
        slope = np.array(
            [
                [0, 1, 1 / shear, 0],
                [0, 0, 0, 1 / bending],
                [-line * square, 0, 0, 0],
                [0, -rotary * square, -1, 0],
            ]
        )
        scale = np.array([1, 1, bending, bending])
        transfer = expm(slope * scale / scale[:, None] * section.length)
        return float(np.linalg.det(transfer[2:, 2:]))

    return [brentq(determinant, *bracket, xtol=1e-10) for bracket in brackets]


def frequencies(section: BeamSection, number: int) -> Array:
    beam = TimoshenkoBeam(section, STEEL, True)
    squares: Array = eigh(
        beam.stiffness, beam.mass, eigvals_only=True, subset_by_index=[0, number - 1]
    )
    return np.sqrt(squares) / (2 * np.pi)


def test_frequencies_match_paper_beam() -> None:
    """3.276 Hz is the printed value for the paper's beam; 20 elements are 0.02 % below it.

    Reference: first frequency of the paper's beam, planar beam | Timoshenko beam, exact | 3.2758
    Hz | 0.02 % below | 0.02 %
    """
    first, second = frequencies(PAPER, 2)
    exact = timoshenko_frequencies(PAPER, [(3, 4), (18, 23)])
    slender = (
        1.8751040687**2
        / (2 * np.pi * PAPER.length**2)
        * np.sqrt(STEEL.young / STEEL.density / 12)
        * PAPER.height
    )
    assert exact[0] == pytest.approx(3.2758, abs=1e-4)
    assert exact[0] == pytest.approx(slender, rel=2e-4)
    assert first == pytest.approx(exact[0], rel=2e-4)
    assert second == pytest.approx(exact[1], rel=3e-3)


def test_frequencies_converge_at_second_order() -> None:
    exact = np.array(timoshenko_frequencies(STOCKY, [(120, 180), (650, 950)]))
    errors = np.array(
        [frequencies(replace(STOCKY, elements=n), 2) / exact - 1 for n in (10, 20, 40)]
    )
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all((rates > 1.9) & (rates < 2.1)), rates
    assert np.all(np.abs(errors[-1]) < 2e-3)


def test_linear_amplitude_matches_paper_beam() -> None:
    """The harmonic response at 3.2 Hz to 111.29 N at 0.7 L is 200.78 mm at the tip; loads at the
    neighbouring nodes give another amplitude."""
    factor = (2j * np.pi * 3.2) * STEEL.mass_damping - (2 * np.pi * 3.2) ** 2
    amplitudes = []
    for place in (0.65, 0.7, 0.75):
        beam = TimoshenkoBeam(replace(PAPER, load_at=place), STEEL, True)
        force = np.zeros(60)
        force[beam.unknown(beam.load_node, 1)] = 111.29
        solution = np.linalg.solve(beam.stiffness + factor * beam.mass, force)
        amplitudes.append(1e3 * abs(solution[beam.unknown(beam.tip_node, 1)]))
    below, here, above = amplitudes
    assert here == pytest.approx(200.78, abs=0.02)
    assert below < 0.9 * here and above > 1.1 * here


@pytest.mark.parametrize("turns", [0.25, 1.0])
def test_beam_under_end_moment_is_an_arc(turns: float) -> None:
    """The end moment is 2π EI/L times the turns: the tip turns by M L/EI, and the elements are
    chords of an arc.

    Reference: beam rolled up by an end moment, up to a full turn | arc of chords | closed form |
    agrees | 1e-9 m
    """
    beam = TimoshenkoBeam(PAPER, STEEL, False)
    moment = 2 * np.pi * turns * rigidities(PAPER)[2] / PAPER.length
    u, w, theta = tip(
        beam, equilibrium(beam, [tip_load(beam, 2, s * moment) for s in np.linspace(0, 1, 41)[1:]])
    )
    angles = 2 * np.pi * turns * (np.arange(20) + 0.5) / 20
    assert theta == pytest.approx(2 * np.pi * turns, rel=1e-10)
    assert PAPER.length + u == pytest.approx(PAPER.length * np.cos(angles).mean(), abs=1e-9)
    assert w == pytest.approx(PAPER.length * np.sin(angles).mean(), abs=1e-9)
    if turns == 1.0:
        assert abs(PAPER.length + u) < 1e-9 and abs(w) < 1e-9


def reissner_tip(section: BeamSection, along: float, across: float) -> Array:
    """u, w, θ of the tip of the continuous beam under a tip force, by shooting for the moment at
    the root."""
    axial, shear, bending = rigidities(section)

    def slope(_: float, state: Array) -> list[float]:
        _, _, theta, moment = state
        c, s = np.cos(theta), np.sin(theta)
        normal, transverse = along * c + across * s, across * c - along * s
        stretch, gamma = 1 + normal / axial, transverse / shear
        return [
            stretch * c - gamma * s,
            stretch * s + gamma * c,
            moment / bending,
            normal * gamma - transverse * stretch,
        ]

    def shoot(moment: float) -> Array:
        start = [0.0, 0.0, 0.0, moment * bending / section.length]
        path = solve_ivp(slope, (0, section.length), start, method="DOP853", rtol=1e-12, atol=1e-13)
        return np.asarray(path.y[:, -1])

    guess = (
        across * section.length**2 / bending / (1 + 0.2 * abs(across) * section.length**2 / bending)
    )
    found = root(lambda m: [shoot(m[0])[3] * section.length / bending], [guess], tol=1e-11)
    assert found.success, found.message
    x, y, theta, _ = shoot(float(found.x[0]))
    return np.array([x - section.length, y, theta])


@pytest.mark.parametrize("load, w, u", [(1.0, 0.30172, 0.05643), (10.0, 0.81061, 0.55500)])
def test_large_deflection_matches_elastica(load: float, w: float, u: float) -> None:
    """Mattiasson's table of the inextensible cantilever, P L²/EI = `load`, against the shooting
    method and then the elements.

    Reference: tip of a planar beam under a large force, PL²/EI = 1 and 10: w/L, u/L | elastica,
    Mattiasson (1981) | 0.30172, −0.05643; 0.81061, −0.55500 | agree | 0.1 %
    """
    force = load * rigidities(SLENDER)[2]
    exact = reissner_tip(SLENDER, 0.0, force)
    np.testing.assert_allclose(exact[:2], [-u, w], atol=6e-6)
    beam = TimoshenkoBeam(SLENDER, STEEL, False)
    found = tip(
        beam, equilibrium(beam, [tip_load(beam, 1, s * force) for s in np.linspace(0, 1, 41)[1:]])
    )
    np.testing.assert_allclose(found, exact, rtol=1e-3)


def test_stocky_cantilever_converges_to_reissner() -> None:
    """Large displacements with significant shear and extension under an oblique force: second order
    in the element size."""
    _, _, bending = rigidities(STOCKY)
    along, across = -0.8 * bending, 2.5 * bending
    exact = reissner_tip(STOCKY, along, across)
    rigid_in_shear = reissner_tip(replace(STOCKY, height=0.002, width=0.1e6), along, across)
    assert np.abs(rigid_in_shear / exact - 1).max() > 0.01
    errors = []
    for n in (10, 20, 40):
        beam = TimoshenkoBeam(replace(STOCKY, elements=n), STEEL, False)
        load = tip_load(beam, 0, along) + tip_load(beam, 1, across)
        errors.append(
            tip(beam, equilibrium(beam, [s * load for s in np.linspace(0, 1, 21)[1:]])) - exact
        )
    rates = np.log2(np.abs(np.array(errors[:-1]) / np.array(errors[1:])))
    assert np.all((rates > 1.8) & (rates < 2.2)), rates
    assert np.abs(errors[-1] / exact).max() < 1e-3


def test_shortening_by_bending_matches_second_order_theory() -> None:
    """A small tip force P moves the tip back by P² L⁵ / 15 EI²; the linear beam has no such
    motion."""
    bending = rigidities(PAPER)[2]
    shortening = []
    for force in (5.0, 10.0):
        linear, exact = (
            TimoshenkoBeam(replace(PAPER, elements=60), STEEL, choice) for choice in (True, False)
        )
        load = tip_load(exact, 1, force)
        assert tip(linear, equilibrium(linear, [load]))[0] == 0.0
        shortening.append(-tip(exact, equilibrium(exact, [load]))[0])
        assert shortening[-1] == pytest.approx(
            force**2 * PAPER.length**5 / (15 * bending**2), rel=2e-3
        )
    assert np.log2(shortening[1] / shortening[0]) == pytest.approx(2.0, abs=2e-3)


@pytest.mark.parametrize("load_at, allowed", [(0.72, "0.7 or 0.75"), (0.0, "0.05")])
def test_load_between_nodes_is_refused(load_at: float, allowed: str) -> None:
    with refusal(ErrorKind.RANGE, "reference.beam_section.load_at", names=f"at {allowed}"):
        TimoshenkoBeam(replace(PAPER, load_at=load_at), STEEL, False)


def test_beam_of_a_solid_in_space_moves_in_the_plane() -> None:
    section = {"length": 1.0, "height": 0.05, "width": 0.0254, "elements": 10, "load_at": 0.5}
    table = {"reference": {"beam": True, "beam_section": section}}
    found = beam_structure(beam_scene(3, **table))
    assert np.any(found.load_vectors) and found.contact_rows.shape[0] == 3
    with refusal(ErrorKind.CONFLICT, "reference.beam", names="leaves this plane"):
        beam_structure(beam_scene(3, ("loads.0.direction=[0.0, 0.6, 0.8]",), **table))
