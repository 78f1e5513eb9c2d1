"""Stress measures of known deformations and tensors, without a mesh."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support import isotropic_material

from fenicsrom.online.stress.stress import (
    CAUCHY,
    StressLaw,
    StressTable,
    components,
    principal,
    tensors,
    von_mises,
)

Array = NDArray[np.float64]

LAME, MU = 3.0, 2.0


def law(plane: str | None = None, linear: bool = False, deformed: bool = True) -> StressLaw:
    """A law of simple numbers."""
    return StressLaw(plane, linear, deformed, (isotropic_material(LAME, MU),))


def rotation(angle: float, d: int = 3) -> Array:
    """A rotation about z."""
    found = np.eye(d)
    found[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return found


def point(stress_law: StressLaw, start: Array, *directions: Array) -> StressTable:
    """The table of a single point."""
    d = start.shape[0]
    return StressTable(
        stress_law,
        np.zeros((1, d)),
        np.ones(1),
        np.array([start, *directions])[:, None],
        np.zeros((1, 1), dtype=np.int64),
        np.zeros((1, d)),
        np.zeros((1 + len(directions), 1, d)),
        np.ones((1, 1)),
    )


@pytest.mark.parametrize(
    ("stress", "expected"),
    [
        ([7.0, 0, 0, 0, 0, 0], 7.0),
        ([-7.0, -7.0, -7.0, 0, 0, 0], 0.0),
        ([0, 0, 0, 2.0, 0, 0], 2.0 * np.sqrt(3.0)),
        ([0, 0, 0, 0, 0, -2.0], 2.0 * np.sqrt(3.0)),
        ([5.0, -5.0, 0, 0, 0, 0], 5.0 * np.sqrt(3.0)),
        ([4.0, 4.0, 0, 0, 0, 0], 4.0),
        ([3.0, 0, 0, 0, 2.0, 0], np.sqrt(21.0)),
    ],
)
def test_von_mises_of_known_tensors(stress: list[float], expected: float) -> None:
    assert von_mises(np.array(stress)) == pytest.approx(expected, abs=1e-14)


def test_principal_stresses_do_not_depend_on_axes() -> None:
    turned = rotation(0.3) @ np.diag([5.0, -2.0, 1.0]) @ rotation(0.3).T
    stress = components(turned, np.array(0.0))
    np.testing.assert_allclose(tensors(stress), turned, atol=1e-15)
    np.testing.assert_allclose(principal(stress), [5.0, 1.0, -2.0], atol=1e-14)
    assert von_mises(stress) == pytest.approx(von_mises(np.array([5.0, -2.0, 1.0, 0, 0, 0])))


@pytest.mark.parametrize("plane", [None, "stress", "strain"])
def test_rigid_rotation_has_no_stress(plane: str | None) -> None:
    d = 2 if plane else 3
    table = point(law(plane), rotation(1.1, d) - np.eye(d))
    for measure in (CAUCHY, "second-piola-kirchhoff"):
        np.testing.assert_allclose(table.stress(np.zeros(0), measure), 0.0, atol=1e-14)


@pytest.mark.parametrize("plane", [None, "stress", "strain"])
def test_superposed_rotation_keeps_second_piola_and_turns_cauchy(plane: str | None) -> None:
    d = 2 if plane else 3
    gradient = np.random.default_rng(1).uniform(-0.2, 0.2, (d, d))
    turn = rotation(0.7, d)
    turned = turn @ (np.eye(d) + gradient) - np.eye(d)
    here, there = (point(law(plane), value) for value in (gradient, turned))
    q = np.zeros(0)
    np.testing.assert_allclose(there.stress(q), here.stress(q), atol=1e-13)
    expected = rotation(0.7) @ tensors(here.stress(q, CAUCHY)) @ rotation(0.7).T
    np.testing.assert_allclose(tensors(there.stress(q, CAUCHY)), expected, atol=1e-13)
    assert np.abs(expected - tensors(here.stress(q, CAUCHY))).max() > 0.1


def test_plane_stress_is_body_with_free_faces() -> None:
    """In 3D, the thickness strain that frees the faces gives the stresses of the plane law."""
    gradient = np.random.default_rng(2).uniform(-0.2, 0.2, (2, 2))
    strain = 0.5 * (gradient + gradient.T + gradient.T @ gradient)
    across = -LAME / (LAME + 2.0 * MU) * np.trace(strain)
    solid = np.zeros((3, 3))
    solid[:2, :2], solid[2, 2] = gradient, np.sqrt(1.0 + 2.0 * across) - 1.0
    flat, full = point(law("stress"), gradient), point(law(), solid)
    for measure in (CAUCHY, "second-piola-kirchhoff"):
        found = full.stress(np.zeros(0), measure)
        np.testing.assert_allclose(flat.stress(np.zeros(0), measure), found, atol=1e-14)
        assert abs(found[0, 2]) < 1e-14


def test_plane_strain_is_body_without_thickness_strain() -> None:
    gradient = np.random.default_rng(3).uniform(-0.2, 0.2, (2, 2))
    solid = np.zeros((3, 3))
    solid[:2, :2] = gradient
    flat, full = point(law("strain"), gradient), point(law(), solid)
    for measure in (CAUCHY, "second-piola-kirchhoff"):
        found = full.stress(np.zeros(0), measure)
        np.testing.assert_allclose(flat.stress(np.zeros(0), measure), found, atol=1e-14)
        assert abs(found[0, 2]) > 0.01


def test_uniaxial_stretch_has_cauchy_stress_of_force_by_current_area() -> None:
    """A bar of stretch s with free sides: S = E_young (s² − 1)/2, force s S on the first area."""
    stretch, young = 1.2, MU * (3.0 * LAME + 2.0 * MU) / (LAME + MU)
    poisson = LAME / (2.0 * (LAME + MU))
    axial = 0.5 * (stretch**2 - 1.0)
    side = np.sqrt(1.0 - 2.0 * poisson * axial)
    table = point(law(), np.diag([stretch, side, side]) - np.eye(3))
    expected = young * axial
    np.testing.assert_allclose(table.stress(np.zeros(0))[0], [expected, 0, 0, 0, 0, 0], atol=1e-13)
    np.testing.assert_allclose(
        table.stress(np.zeros(0), CAUCHY)[0],
        [stretch * expected / side**2, 0, 0, 0, 0, 0],
        atol=1e-13,
    )


@pytest.mark.parametrize("plane", [None, "stress", "strain"])
def test_modal_stress_is_derivative_of_stress(plane: str | None) -> None:
    d = 2 if plane else 3
    start, direction = np.random.default_rng(4).uniform(-0.2, 0.2, (2, d, d))
    table = point(law(plane), start, direction)
    h = 0.1  # the stress is quadratic, so the central difference is exact
    difference = (table.stress(np.array([h])) - table.stress(np.array([-h]))) / (2.0 * h)
    np.testing.assert_allclose(table.modal_stress(np.ones(1)), difference, atol=1e-13)


def test_linear_stress_is_tangent_at_equilibrium() -> None:
    start, direction = np.random.default_rng(5).uniform(-0.2, 0.2, (2, 3, 3))
    for deformed in (True, False):
        table = point(law(linear=True, deformed=deformed), start, direction)
        rest = table.stress(np.zeros(1))
        found = table.stress(np.array([3.0])) - rest
        np.testing.assert_allclose(found, 3.0 * table.modal_stress(np.ones(1)), atol=1e-13)
    exact = point(law(), start, direction).stress(np.zeros(1))
    spun = point(law(linear=True), start, direction).stress(np.zeros(1))
    np.testing.assert_allclose(spun, exact, atol=1e-14)


@pytest.mark.parametrize("linear", [False, True])
def test_first_piola_is_derivative_of_the_energy_and_its_tangent(linear: bool) -> None:
    """By differences of the energy; the linear one is the tangent of the nonlinear one."""
    start, change = np.random.default_rng(6).uniform(-0.2, 0.2, (2, 3, 3))
    nonlinear = law()

    def energy(gradient: Array) -> float:
        strain = nonlinear.strain(start, gradient)
        return 0.5 * float(np.sum(strain * nonlinear.of_strain(strain)))

    h = 1e-3
    if not linear:
        expected = np.empty((3, 3))
        for i, j in np.ndindex(3, 3):
            e = np.zeros((3, 3))
            e[i, j] = h
            near = energy(change + e) - energy(change - e)
            far = energy(change + 2 * e) - energy(change - 2 * e)
            expected[i, j] = (8.0 * near - far) / (12.0 * h)
        found = nonlinear.first_piola(start, change)
    else:
        tangent = law(linear=True)
        found = tangent.first_piola(start, change) - tangent.first_piola(start, 0.0 * change)
        expected = (
            nonlinear.first_piola(start, h * change) - nonlinear.first_piola(start, -h * change)
        ) / (2.0 * h)
    np.testing.assert_allclose(found, expected, atol=1e-6 if linear else 1e-10)
