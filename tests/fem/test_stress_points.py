"""Stresses from the table of a reduced model against dolfinx, and against theory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import KINDS_OF_CELLS, STOCKY, beam_scene, make_solid, random_field, scene_of

from fenicsrom.online.stress.stress import stiffness

pytest.importorskip("dolfinx")

import basix
import ufl
from dolfinx import fem

from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.online.stress.stress import (
    CAUCHY,
    MEASURES,
    StressTable,
    principal,
    tensors,
    von_mises,
)

Array = NDArray[np.float64]

SHORT = ("geometry.parameters.length=1.0", "geometry.parameters.height=0.05")
KINDS = KINDS_OF_CELLS | {"linear elements": (2, ("geometry.degree=1",))}


def without_basis(solid: Any) -> StressTable:
    """The table of the equilibrium of a solid."""
    return stress_table(solid, scene_of(solid), solid.equilibrium, np.zeros((solid.local, 0)))


def full_stress(solid: Any, u: Array, measure: str) -> Array:
    """Stresses (P, 6) at the same points by ufl, with the thickness strain written out."""
    scene, d = scene_of(solid), solid.dimension
    young, nu = scene.material.young, scene.material.poisson
    lame, mu = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    h = ufl.grad(solid.field(u))
    rows = [[h[i, j] if i < d and j < d else 0.0 * h[0, 0] for j in range(3)] for i in range(3)]
    strain = ufl.sym(h) + 0.5 * h.T * h
    if scene.geometry.plane == "stress":
        across = -lame / (lame + 2 * mu) * ufl.tr(strain)
        rows[2][2] = ufl.sqrt(1 + 2 * across) - 1
    f = ufl.Identity(3) + ufl.as_matrix(rows)
    e = 0.5 * (f.T * f - ufl.Identity(3))
    s = lame * ufl.tr(e) * ufl.Identity(3) + 2 * mu * e
    if measure == CAUCHY:
        s = f * s * f.T / ufl.det(f)
    degree, domain = solid.geometry.degree, solid.mesh.domain
    simplex = domain.topology.cell_type.name in ("triangle", "tetrahedron")
    points, _ = basix.make_quadrature(
        domain.basix_cell(), 2 * (degree - 1) if simplex else 2 * degree - 1
    )
    parts = ufl.as_vector([s[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))])
    return np.asarray(fem.Expression(parts, points).eval(domain, solid.owned_cells())).reshape(
        -1, 6
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_reduced_stresses_equal_full_ones_at_equal_displacement(kind: str) -> None:
    dimension, overrides = KINDS[kind]
    options = (*STOCKY, "geometry.parameters.elements_along=2", *overrides)
    solid = make_solid(beam_scene(dimension, options))
    vectors = np.array([random_field(solid, 0.02, seed) for seed in range(4)]).T
    start = random_field(solid, 0.02, 9)
    table = stress_table(solid, scene_of(solid), start, vectors)
    q = np.array([0.5, -0.3, 0.2, 0.4])
    for measure in MEASURES:
        expected = full_stress(solid, start + vectors @ q, measure)
        found = table.stress(q, measure)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    assert table.volume.sum() == pytest.approx(solid_volume(solid), rel=1e-12)
    expected = (start + vectors @ q).reshape(-1, dimension)
    x = solid.space.tabulate_dof_coordinates()[:, :dimension]
    near = [int(np.argmin(np.abs(x - place).max(axis=1))) for place in table.vertex_position]
    np.testing.assert_allclose(table.displacement(q), expected[near], atol=1e-15)


def solid_volume(solid: Any) -> float:
    """Volume of a body, m³."""
    one = fem.Constant(solid.mesh.domain, 1.0)
    return float(fem.assemble_scalar(fem.form(solid.thickness * one * solid.dx)))


@pytest.mark.parametrize("kind", ["plane stress", "tetrahedra"])
def test_linear_stress_is_recovered_exactly(kind: str) -> None:
    """Quadratic displacements of a linear scene have linear stresses, at the vertices too."""
    dimension, overrides = KINDS[kind]
    options = (*STOCKY, *overrides, "geometrically_nonlinear=false")
    solid = make_solid(beam_scene(dimension, options))
    x = solid.space.tabulate_dof_coordinates()[: solid.local // dimension, :dimension]
    field = np.zeros_like(x)
    field[:, 0], field[:, 1] = 1e-3 * x[:, 0] * x[:, 1], -0.5e-3 * x[:, 0] ** 2
    table = stress_table(solid, scene_of(solid), 0.0 * field.ravel(), field.reshape(-1, 1))
    found = table.at_vertices(table.stress(np.ones(1)))
    along = stiffness(table.law.materials[0], dimension, table.law.plane)[0, 0]
    expected = along * 1e-3 * table.vertex_position[:, 1]
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-10 * np.abs(expected).max())
    np.testing.assert_allclose(found[:, 3], 0.0, atol=1e-10 * np.abs(expected).max())
    means = table.in_cells(table.stress(np.ones(1)))
    centres = table.in_cells(table.position)
    np.testing.assert_allclose(
        means[:, 0], along * 1e-3 * centres[:, 1], atol=1e-10 * np.abs(expected).max()
    )


# ------------------------------------------------------------------ theory


def loaded(dimension: int, direction: list[float], force: float, *options: str) -> Any:
    """A cantilever of 1 m with a square section of 50 mm under a tip force."""
    load = {"group": "tip", "direction": direction[:dimension], "force": force}
    width = ("geometry.parameters.width=0.05",) if dimension == 3 else ("geometry.thickness=0.05",)
    size = (*SHORT, "geometry.parameters.elements_along=12", "geometry.parameters.load_at=0.5")
    return make_solid(beam_scene(dimension, (*size, *width, *options), loads=[load], contacts=None))


@pytest.mark.parametrize("dimension", [2, 3])
def test_bending_stress_of_cantilever_matches_beam_theory(dimension: int) -> None:
    """M y / I half way between root and tip.

    Reference: bending stress of a cantilever | M y / I | closed form | 2e-7 | 1e-6
    """
    force, height = 10.0, 0.05
    solid = loaded(dimension, [0.0, 1.0, 0.0], force, "material.poisson=0.0")
    table = without_basis(solid)
    stress = table.at_vertices(table.stress(np.zeros(0)))
    x, y = table.vertex_position[:, 0], table.vertex_position[:, 1]
    middle = np.abs(x - 0.5) < 1e-9
    assert np.count_nonzero(middle) == 2 ** (dimension - 1)
    expected = -12.0 * force * 0.5 * (y[middle] - y[middle].mean()) / height**4
    np.testing.assert_allclose(stress[middle, 0], expected, rtol=1e-6)
    np.testing.assert_allclose(von_mises(stress[middle]), np.abs(expected), rtol=1e-2)


@pytest.mark.parametrize("dimension", [2, 3])
def test_axial_bar_has_uniform_stress(dimension: int) -> None:
    """Reference: stresses of a bar under a large axial force | St Venant–Kirchhoff bar | closed
    form | agree | 1e-6
    """
    force = 1000.0
    solid = loaded(dimension, [1.0, 0.0, 0.0], force, "material.poisson=0.0", "loads.0.at='mean'")
    table = without_basis(solid)
    here = np.abs(table.position[:, 0] - 0.5) < 0.2
    stress = table.stress(np.zeros(0), CAUCHY)[here]
    assert np.count_nonzero(here) > 10
    # the St Venant-Kirchhoff bar: the force is s S A with S = E (s² − 1)/2
    area, young = 0.05**2, 207e9
    stretch = np.real(np.roots([0.5, 0.0, -0.5, -force / (area * young)])[0])
    np.testing.assert_allclose(stress[:, 0], stretch * 0.5 * young * (stretch**2 - 1), rtol=1e-6)
    np.testing.assert_allclose(stress[:, 1:], 0.0, atol=1e-5 * stress[0, 0])
    np.testing.assert_allclose(principal(stress)[:, 0], stress[:, 0], rtol=1e-9)


@pytest.mark.parametrize("nonlinear", ["true", "false"])
def test_rotating_bar_has_centrifugal_stress(nonlinear: str) -> None:
    """A slow bar about its root: ρ Ω² (L² − x²)/2, and only second order in Ω² off it.

    Reference: stress of a spinning bar | closed form | ρΩ²(L² − x²)/2 | 9e-6 | 1e-4
    """
    solid = make_solid(
        beam_scene(
            2,
            (
                *SHORT,
                "geometry.parameters.elements_along=12",
                "material.poisson=0.0",
                f"geometrically_nonlinear={nonlinear}",
            ),
            contacts=None,
            rotation={"speed_rpm": 300.0, "point": [0.0, 0.0]},
        )
    )
    table = without_basis(solid)
    for measure in MEASURES:
        stress = table.stress(np.zeros(0), measure)
        x = table.position[:, 0]
        expected = 7801.0 * (10.0 * np.pi) ** 2 * (1.0 - x**2) / 2.0
        inside = (x > 0.1) & (x < 0.9)
        np.testing.assert_allclose(stress[inside, 0], expected[inside], rtol=1e-4)


@pytest.mark.parametrize("bent", ["bent2d", "bent3d"])
def test_prestressed_equilibrium_turns_with_the_body(
    bent: str, request: pytest.FixtureRequest
) -> None:
    """The stress of a loaded equilibrium, and the same displacement with a rotation about z."""
    solid = request.getfixturevalue(bent)
    d = solid.dimension
    turn = np.eye(3)
    turn[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    x = solid.space.tabulate_dof_coordinates()[: solid.local // d, :d]
    place = x + solid.equilibrium.reshape(-1, d)
    turned = (place @ turn[:d, :d].T - x).ravel()
    scene, none = scene_of(solid), np.zeros((solid.local, 0))
    here, there = (stress_table(solid, scene, u, none) for u in (solid.equilibrium, turned))
    q = np.zeros(0)
    size = np.abs(here.stress(q)).max()
    assert size > 1e7
    np.testing.assert_allclose(there.stress(q), here.stress(q), rtol=0, atol=1e-9 * size)
    expected = turn @ tensors(here.stress(q, CAUCHY)) @ turn.T
    np.testing.assert_allclose(tensors(there.stress(q, CAUCHY)), expected, rtol=0, atol=1e-9 * size)
