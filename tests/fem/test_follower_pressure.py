"""Follower pressures: forces and tangents, exact coefficients, rings, a rod of large deflection."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support import (
    STOCKY,
    assert_same_motion,
    assert_tangent,
    beam_scene,
    dense,
    free_unknowns,
    make_solid,
    motions_of_all_unknowns,
    random_directions,
    random_field,
    scene_of,
)

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from mpi4py import MPI

from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.equilibrium.buckling import _coupled_squares
from fenicsrom.fem.solid.solid import KnownEquilibrium, build_solid, solid_of
from fenicsrom.notes import NoteKind, has_kind
from fenicsrom.online.model.loads import unit_tangent
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.snapshots import fastest_growth, linear_model, require_bounded
from fenicsrom.scene import Scene, make_scene

Array = NDArray[np.float64]

KINDS = {
    "quadrilaterals": (2, ("geometry.thickness=0.15",)),
    "triangles": (2, ("geometry.thickness=0.15", "geometry.cells='simplex'")),
    "hexahedra": (3, ("geometry.parameters.width=0.15",)),
    "tetrahedra": (3, ("geometry.parameters.width=0.15", "geometry.cells='simplex'")),
}
ALL, TIP = 0, 1  # numbers of the pressures below


@pytest.fixture(scope="module", params=KINDS)
def solid(request: pytest.FixtureRequest) -> Any:
    """A stocky cantilever under a static pressure all around and one on its tip that varies."""
    d, overrides = KINDS[request.param]
    loads = [
        {"box": [[-9.0] * d, [9.0] * d], "pressure": 2e9, "follower": True},
        {"group": "tip", "pressure": 3e7, "follower": True, "frequency": 30.0},
    ]
    sizes = (*STOCKY, "geometry.parameters.elements_along=2", *overrides)
    return make_solid(beam_scene(d, sizes, contacts=None, loads=loads))


# ------------------------------------------------------------------ forces and tangents


@pytest.mark.slow
def test_force_on_closed_surface_is_the_change_of_volume(solid: Any) -> None:
    """The resultant vanishes, and the work on the place x is minus d volumes.

    Reference: work of a pressure on a closed surface | −p dV | closed form | agrees | 1e-12
    """
    d, u = solid.dimension, 0.3 * random_field(solid, 0.02)
    surface, pressures = solid.pressures._surfaces[ALL], solid.pressures
    solid.set_field(pressures._u, u)
    force = solid.assembled(surface.force).reshape(-1, d)  # clamped unknowns included
    x = solid.space.tabulate_dof_coordinates()[: len(force), :d] + u.reshape(-1, d)
    gradient = ufl.Identity(d) + ufl.grad(pressures._u)
    volume = fem.assemble_scalar(fem.form(solid.thickness * ufl.det(gradient) * solid.dx))
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * np.abs(force).sum())
    assert np.sum(force * x) == pytest.approx(-d * volume, rel=1e-12)
    assert abs(volume / (0.2 * 0.15) - 1.0) > 1e-3  # of the undeformed body


def test_tangent_is_the_derivative_of_the_force(solid: Any) -> None:
    u, directions = random_directions(solid)
    pressures = solid.pressures
    for k, factors in enumerate(np.eye(2)):
        assert_tangent(
            lambda s, k=k: pressures.unit_forces(u + s @ directions)[:, k],
            lambda s, factors=factors: pressures.tangent_times(
                u + s @ directions, directions.T, factors
            ),
            np.zeros(3),
            step=0.5,
            tolerance=1e-9,
        )


def test_tangent_of_the_body_contains_the_static_pressure(solid: Any) -> None:
    u, directions = random_directions(solid)
    assert_tangent(
        lambda s: solid.residual(u + s @ directions, solid.static_load),
        lambda s: solid.tangent_times(u + s @ directions, directions.T),
        np.zeros(3),
        step=0.5,
        tolerance=1e-9,
    )
    x, y = directions[:2]
    exact, difference = solid.tangent_derivative(x, y), solid.tangent_difference(x, y)
    np.testing.assert_allclose(difference, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


def test_tangent_is_symmetric_on_a_surface_without_free_edges_only(solid: Any) -> None:
    u, v = random_field(solid, 0.02), np.eye(solid.local)[:, free_unknowns(solid)]
    for k, symmetric in ((ALL, True), (TIP, False)):
        tangent = v.T @ solid.pressures.tangent_times(u, v, np.eye(2)[k])
        skew = np.abs(tangent - tangent.T).max() / np.abs(tangent).max()
        assert bool(skew < 1e-13) == symmetric
        if not symmetric:
            assert skew > 0.1


def test_static_pressure_is_part_of_equilibrium_and_stiffness(solid: Any) -> None:
    assert solid.loaded and not solid.symmetric
    residual = solid.residual(solid.equilibrium, solid.static_load)
    force = solid.internal_force(solid.equilibrium)
    assert np.abs(residual).max() < 1e-9 * np.abs(force).max()
    np.testing.assert_array_equal(
        solid.load_vectors, solid.pressures.unit_forces(solid.equilibrium)
    )
    keep = free_unknowns(solid)
    tangent = solid.tangent_times(solid.equilibrium, np.eye(solid.local)[:, keep])[keep]
    np.testing.assert_allclose(
        dense(solid.stiffness, keep),
        0.5 * (tangent + tangent.T),
        rtol=0,
        atol=1e-12 * np.abs(tangent).max(),
    )


@pytest.mark.slow
def test_known_equilibrium_gives_the_same_matrices(solid: Any) -> None:
    known = KnownEquilibrium(solid.equilibrium, solid.unstable)
    other, keep = solid_of(scene_of(solid), solid.mesh, known), free_unknowns(solid)
    np.testing.assert_array_equal(other.load_vectors, solid.load_vectors)
    np.testing.assert_array_equal(dense(other.stiffness, keep), dense(solid.stiffness, keep))


def test_reduced_coefficients_equal_the_projected_force(solid: Any) -> None:
    vectors = np.array([random_field(solid, 0.05, seed) for seed in range(3)]).T
    found, pressures, u0 = solid.pressure_polynomial(vectors), solid.pressures, solid.equilibrium
    np.testing.assert_array_equal(found.numbers, [ALL, TIP])
    for seed in range(3):
        q = np.random.default_rng(seed).standard_normal(3)
        change = pressures.unit_forces(u0 + vectors @ q) - pressures.unit_forces(u0)
        for k in (ALL, TIP):
            expected = vectors.T @ change[:, k]
            np.testing.assert_allclose(
                0.5 * (found.linear[k] + unit_tangent(found, k, q)) @ q,
                expected,
                rtol=0,
                atol=1e-12 * np.abs(expected).max(),
            )
            tangent = pressures.tangent_times(u0 + vectors @ q, vectors, np.eye(2)[k])
            expected = vectors.T @ tangent
            np.testing.assert_allclose(
                unit_tangent(found, k, q), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
            )


# ------------------------------------------------------------------ buckling of a ring

RADIUS, THICKNESS, YOUNG = 1.0, 0.02, 200e9  # of the middle of the wall, m, m, Pa
QUARTER = """\
r = {low}; s = {high};
Point(1) = {{0, 0, 0}}; Point(2) = {{r, 0, 0}}; Point(3) = {{s, 0, 0}};
Point(4) = {{0, r, 0}}; Point(5) = {{0, s, 0}};
Line(1) = {{2, 3}}; Circle(2) = {{3, 1, 5}}; Line(3) = {{5, 4}}; Circle(4) = {{4, 1, 2}};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
Transfinite Curve {{1, 3}} = 2; Transfinite Curve {{2, 4}} = {count};
Transfinite Surface {{1}}; Recombine Surface {{1}};
Physical Surface("solid") = {{1}}; Physical Curve("outside") = {{2}};
Physical Curve("right") = {{1}}; Physical Curve("top") = {{3}};
"""


def ring_scene(folder: Path, load: dict[str, Any], **tables: Any) -> Scene:
    """A quarter of a ring between its planes of symmetry, under pressure from outside."""
    sizes = {"low": RADIUS - THICKNESS / 2, "high": RADIUS + THICKNESS / 2, "count": 33}
    (folder / "ring.geo").write_text(QUARTER.format(**sizes))
    return make_scene(
        folder=folder,
        geometry={"mesh": "ring.geo", "dimension": 2, "thickness": 1.0, "curved": True},
        material={"young": YOUNG, "poisson": 0.3, "density": 7800.0},
        supports=[{"group": "right", "components": ["y"]}, {"group": "top", "components": ["x"]}],
        loads=[{"group": "outside", **load}],
        **tables,
    )


def ring(folder: Path, pressure: float, **load: Any) -> Any:
    """The solid of the ring."""
    return build_solid(ring_scene(folder, {"pressure": pressure, **load}), MPI.COMM_SELF)


OUTSIDE = RADIUS / (RADIUS + THICKNESS / 2)


@pytest.mark.slow
@pytest.mark.parametrize(("follower", "factor"), [(True, 3.0), (False, 4.0 * OUTSIDE**2)])
def test_ring_buckles_at_the_pressure_of_theory(
    follower: bool, factor: float, tmp_path: Path
) -> None:
    """3 E I / R³ per length if the pressure follows, 4 E I / R³ in constant directions.

    Timoshenko and Gere, Theory of Elastic Stability, art. 7.3; Bodner, J. Aeronaut. Sci. 25, 1958.
    Here the pressure acts on the outside. A pressure that follows works on the enclosed area, whose
    change is that of the middle line. A dead one has more work by `OUTSIDE`⁻²: by its larger length
    and, as the wall turns, by its arm.

    Reference: buckling of a ring under follower and dead pressure | closed form | 3EI/R³; 4EI/R³
    | 1.0009; 0.9998 of it | 0.2 %
    """
    critical = factor * YOUNG * THICKNESS**3 / 12 / RADIUS**3
    squares = []
    for part in (0.5, 0.9):
        body = ring(tmp_path, part * critical, follower=follower)
        squares.append(body.eigenmodes(body.factor, 1)[0][0])
        assert body.unstable == 0 and not body.warnings
    first, second = squares
    found = 0.5 + 0.4 * first / (first - second)
    assert found == pytest.approx(1.0, rel=2e-3)
    beyond = ring(tmp_path, 1.02 * critical, follower=follower)
    assert beyond.unstable == 1


# ------------------------------------------------------------------ a rod with a free end


def rod_tip(load: float) -> Array:
    """The tip of a clamped inextensible rod of length 1 under a pressure on its lower side.

    `load` is p L³ / (E I). The pressure follows the rod, so the equations of the forces do not
    depend on the direction of the rod: they are integrated from the free end, and the result is
    turned until the rod leaves its support along x.
    """

    def slopes(s: float, y: Array) -> list[float]:
        axial, shear, curvature, angle = y[:4]
        return [
            shear * curvature,
            -axial * curvature - load,
            -shear,
            curvature,
            np.cos(angle),
            np.sin(angle),
        ]

    found = solve_ivp(slopes, (1.0, 0.0), np.zeros(6), rtol=1e-10, atol=1e-12).y[:, -1]
    angle, (x, y) = found[3], -found[4:]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([cosine * x + sine * y, cosine * y - sine * x])


def rod(height: float, elements: int, loads: list[dict[str, Any]]) -> Any:
    """A clamped rod of length 1 and thickness 1."""
    sizes = {"length": 1, "height": height, "elements_along": elements, "load_at": 0.5}
    overrides = [f"geometry.parameters.{name}={size}" for name, size in sizes.items()]
    probe = {"group": "tip", "at": "centre"}
    return make_solid(
        beam_scene(2, (*overrides, "geometry.thickness=1"), contacts=None, loads=loads, probe=probe)
    )


@pytest.mark.parametrize("load", [2.0, 8.0])
def test_free_rod_bends_as_the_elastica_under_pressure(load: float) -> None:
    """The free edge makes the tangent unsymmetric.

    Reference: tip of a cantilever under follower pressure | inextensible rod, integrated | 0.96479,
    0.24559; 0.53930, 0.76351 | 0.96484, 0.24541; 0.53987, 0.76308 | 0.001 L
    """
    height = 0.01
    pressure = load * 207e9 * height**3 / 12
    # half from below, half as suction from above: the mean area is that of the axis
    sides = [
        {
            "plane": {"point": [0.0, side * height / 2], "normal": [0.0, 1.0]},
            "pressure": -0.5 * side * pressure,
            "follower": True,
        }
        for side in (-1, 1)
    ]
    solid = rod(height, 48, sides)
    tip = solid.probe_rows @ solid.equilibrium + [1.0, 0.0]
    np.testing.assert_allclose(tip, rod_tip(load), rtol=0, atol=1e-3)


@pytest.mark.parametrize(("part", "flutters"), [(0.98, False), (1.02, True)])
def test_column_under_a_pressure_on_its_end_flutters_at_the_load_of_beck(
    part: float, flutters: bool
) -> None:
    """20.05 E I / L²: Beck, Z. Angew. Math. Phys. 3, 1952. The column never buckles.

    Reference: flutter of a column under a follower pressure on its end | Beck (1952) | 20.05
    EI/L² | 0.994 to 1 of it | 2 %
    """
    height = 0.02
    pressure = part * 20.05 * 207e9 * height**2 / 12
    solid = rod(height, 16, [{"group": "tip", "pressure": pressure, "follower": True}])
    assert solid.unstable == 0
    assert len(solid.warnings) == 1
    assert ("flutter" in solid.warnings[0]) is flutters
    assert -1e-3 < solid.equilibrium.min() < -6e-4  # compressed and straight


def column(part: float) -> Any:
    """A column under a part of the pressure of Beck on its end, that a small force shakes."""
    height = 0.02
    pressure = part * 20.05 * 207e9 * height**2 / 12
    shaken = {"group": "tip", "at": "centre", "direction": [0.0, 1.0], "force": 1.0}
    end = {"group": "tip", "pressure": pressure, "follower": True}
    return rod(height, 8, [{**shaken, "frequency": 5.0}, end])


def test_linear_transient_below_the_load_of_beck_is_bounded() -> None:
    """The symmetric part of the stiffness alone would diverge."""
    solid = column(0.93)
    model = linear_model(solid, component_modes(solid, scene_of(solid).basis)).model
    assert np.linalg.eigvalsh(model.elastic.stiffness)[0] < 0.0
    assert fastest_growth(model)[0] < 1e-6
    _, modes = solid.eigenmodes(solid.factor, 8)
    wanted = _coupled_squares(solid, modes)[0].real
    found = np.linalg.eigvals(model.rest_stiffness()).real.min()
    assert found == pytest.approx(wanted, rel=0.15)  # of few modes
    require_bounded(model, scene_of(solid))


def test_linear_transient_beyond_the_load_of_beck_is_refused() -> None:
    solid = column(1.3)
    assert has_kind(solid.warnings, NoteKind.UNSTABLE)
    model = linear_model(solid, component_modes(solid, scene_of(solid).basis)).model
    with pytest.raises(ConvergenceError, match=re.escape("loads[1].pressure")) as caught:
        require_bounded(model, scene_of(solid))
    assert caught.value.kind is ErrorKind.INSTABILITY


# ------------------------------------------------------------------ motions


@pytest.mark.slow
def test_full_model_moves_as_the_reduced_model_of_all_unknowns() -> None:
    """With a contact that slips and opens; also the work of the pressures."""
    below = {"plane": {"point": [0.0, -0.025], "normal": [0.0, 1.0]}, "follower": True}
    loads = [{**below, "pressure": 2e6, "frequency": 40.0}, {**below, "pressure": 5e5}]
    one, other = motions_of_all_unknowns(loads)
    assert_same_motion(one, other, 1e-5)
