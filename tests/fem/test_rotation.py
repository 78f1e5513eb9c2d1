"""A rotating body: its forms, its equilibrium at speed, its frequencies against beam theory, and
the Campbell diagram."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("dolfinx")

import ufl
from dolfinx import fem
from scipy.integrate import solve_bvp
from support import (
    STOCKY,
    assert_force_of_energy,
    assert_tangent,
    assert_tangent_of_force,
    beam_scene,
    dense,
    enriched,
    free_unknowns,
    make_solid,
    random_directions,
    random_field,
    refusal,
    scene_of,
)

from fenicsrom.assess.rotation import campbell as diagram
from fenicsrom.assess.rotation import rotating_modes
from fenicsrom.cli import main
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.full.full import FullModel
from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.online.store.scene_changes import changed_key
from fenicsrom.reduction.basis import project, project_intrusively, projected_gyroscopic
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, Place, parse_scene, scene_table
from fenicsrom.study import run

Array = NDArray[np.float64]

STEEL_DENSITY, STEEL_YOUNG = 7801.0, 207e9

# Wright et al. (1982), recomputed for a uniform Euler-Bernoulli cantilever clamped on the axis:
# omega L^2 sqrt(rho A / E I) of the first flap mode at eta = Omega L^2 sqrt(rho A / E I); lag^2 =
# flap^2 - eta^2
ETA = (0.0, 1.0, 2.0, 4.0, 8.0, 12.0)
FLAP = (3.5160, 3.6816, 4.1373, 5.5850, 9.2568, 13.1702)
LENGTH, HEIGHT = 2.54, 0.0254
UNIT = np.sqrt(STEEL_YOUNG * HEIGHT**2 / 12.0 / (STEEL_DENSITY * LENGTH**4))  # rad/s
RPM = 30.0 / np.pi

TILTED = {
    "speed_rpm": 4000.0,
    "axis": [0.6, 0.0, 0.8],
    "point": [-0.2, 0.1, 0.05],
    "coriolis": True,
}
PUSH = [
    {"group": "load", "direction": [0.0, 1.0, 0.0], "force": 20.0, "frequency": 3.2},
    {"group": "tip", "direction": [0.2, 0.5, 1.0], "force": 2e5},
]


def rotating_scene(
    dimension: int, *overrides: str, rotation: dict[str, Any] | None = None, **tables: Any
) -> Any:
    """A short rotating beam on a tiny mesh."""
    rotation = rotation or (
        {"speed_rpm": 4000.0, "point": [-0.2, 0.1]} | ({"coriolis": True})
        if dimension == 2
        else TILTED
    )
    return beam_scene(dimension, (*STOCKY, *overrides), rotation=rotation, **tables)


@pytest.fixture(scope="module", params=[2, 3])
def spun(request: pytest.FixtureRequest) -> Any:
    return make_solid(rotating_scene(request.param))


@pytest.fixture(scope="module")
def slender() -> Any:
    """The paper's beam with a Poisson's ratio of zero, clamped on the axis z, at rest."""
    still = {"speed_rpm": 0.0, "axis": [0.0, 0.0, 1.0]}
    sizes = ("geometry.parameters.elements_along=40", "material.poisson=0.0")
    return make_solid(beam_scene(3, sizes, contacts=None, rotation=still))


# ------------------------------------------------------------------ forms


def test_energy_force_and_tangent_are_derivatives(spun: Any) -> None:
    u, directions = random_directions(spun)
    assert np.abs(spun.rotation.centrifugal_force(u)).max() > 0.0
    assert_force_of_energy(spun)
    assert_tangent_of_force(spun)
    # the centrifugal part alone, because the elastic part is much larger
    frame, q = spun.rotation, directions
    assert_tangent(
        lambda s: frame.energy(s @ q),
        lambda s: -q @ frame.centrifugal_force(s @ q),
        np.ones(3),
        step=0.5,
        tolerance=1e-10,
    )
    softening = spun.stiffness.copy()
    softening.zeroEntries()
    frame.add_spin_softening(softening, 0.5)
    keep = free_unknowns(spun)
    assert_tangent(
        lambda s: -0.5 * (q @ frame.centrifugal_force(s @ q)),
        lambda s: (q[:, keep] @ dense(softening, keep)) @ q[:, keep].T,
        np.ones(3),
        step=0.5,
        tolerance=1e-10,
    )
    matrix = spun.stiffness.copy()
    spun.add_tangent(matrix, u, 0.3)
    expected = dense(spun.stiffness, keep) + 0.3 * dense(spun.tangent(u), keep)
    np.testing.assert_allclose(
        dense(matrix, keep), expected, rtol=0, atol=1e-13 * np.abs(expected).max()
    )


def test_matrices_of_inertia_are_those_of_their_forms(spun: Any) -> None:
    frame, trial, test = spun.rotation, ufl.TrialFunction(spun.space), ufl.TestFunction(spun.space)
    forms = {
        "mass": (spun.mass, ufl.dot(trial, test)),
        "centrifugal": (frame.mass, frame.out_of_axis(trial, test)),
        "Coriolis": (spun.gyroscopic, frame.omega * frame.coriolis(trial, test)),
    }
    for name, (matrix, form) in forms.items():
        assembled = spun.matrix(fem.form(spun.density * form * spun.dx), 0.0)
        found, expected = (dense(each, np.arange(spun.local)) for each in (matrix, assembled))
        error = np.abs(found - expected).max()
        assert 0.0 < np.abs(expected).max() and error <= 1e-14 * np.abs(expected).max(), name


@pytest.mark.parametrize("dimension", [2, 3])
def test_rotation_forces_of_linear_field_match_closed_form(dimension: int) -> None:
    """u = x a: integrals over the box are closed forms."""
    solid = make_solid(rotating_scene(dimension))
    omega = 4000.0 / RPM
    axis = np.array([0.6, 0.0, 0.8] if dimension == 3 else [0.0, 0.0, 1.0])
    point, a, b = (
        np.array([-0.2, 0.1, 0.05]),
        np.array([0.2, -0.1, 0.3]),
        np.array([-0.3, 0.25, 0.1]),
    )
    if dimension == 2:
        point[2] = a[2] = b[2] = 0.0
    x = solid.space.tabulate_dof_coordinates()[: solid.local // dimension, 0]
    u, v = (np.outer(x, vector[:dimension]).ravel() for vector in (a, b))
    normal = np.eye(3) - np.outer(axis, axis)
    parameters = solid.geometry.parameters
    section = (
        STEEL_DENSITY * parameters["height"] * 0.0254
    )  # the width of beam3d.geo, the thickness of the plane beam
    length = parameters["length"]
    # int x, x^2 over the length; y and z have no mean
    static = a @ normal @ (np.array([length**3 / 3.0, 0.0, 0.0]) - point * length**2 / 2.0)
    potential = -section * omega**2 * (static + 0.5 * a @ normal @ a * length**3 / 3.0)
    assert solid.rotation.energy(u) == pytest.approx(potential, rel=1e-12)
    work = 2.0 * omega * section * length**3 / 3.0 * (a @ np.cross(axis, b))
    assert u @ solid.gyroscopic_times(v[:, None])[:, 0] == pytest.approx(work, rel=1e-12)


def test_gyroscopic_matrix_is_skew_and_grows_with_the_speed(spun: Any) -> None:
    keep = free_unknowns(spun)
    g = dense(spun.gyroscopic, keep)
    assert np.abs(g).max() > 0.0
    np.testing.assert_allclose(g, -g.T, rtol=0, atol=1e-14 * np.abs(g).max())
    v = np.random.default_rng(3).standard_normal(keep.size)
    assert abs(v @ g @ v) < 1e-12 * np.abs(v) @ np.abs(g) @ np.abs(v)  # no power
    scene = scene_of(spun)
    back = make_solid(
        replace(scene, rotation=replace(scene.rotation, speed_rpm=-0.5 * scene.rotation.speed_rpm))
    )
    np.testing.assert_allclose(
        dense(back.gyroscopic, keep), -0.5 * g, rtol=0, atol=1e-14 * np.abs(g).max()
    )
    r = np.array([random_field(spun, 1.0, seed) for seed in range(4)]).T
    np.testing.assert_allclose(
        projected_gyroscopic(spun, r), r[keep].T @ g @ r[keep], rtol=1e-10, atol=1e-9
    )


# ------------------------------------------------------------------ equilibrium


@pytest.mark.parametrize("speed", [0.02, 0.3])
def test_stretch_of_spinning_rod_matches_boundary_value_problem(slender: Any, speed: float) -> None:
    """k L = `speed`, k^2 = rho Omega^2 / E: (S (1 + u'))' + k^2 (x + u) = 0, S = u' + u'^2/2, u(0)
    = 0 = S(L).

    Where strains are small that is u'' + k^2 (x + u) = 0: x + u = sin(k x) / (k cos(k L)).

    Reference: stretch of a spinning rod, kL = 0.3 | boundary-value problem of the rod |
    numerical | agrees | 0.01 %
    """
    k = speed / LENGTH
    slender.spin(k * np.sqrt(STEEL_YOUNG / STEEL_DENSITY))
    tip = slender.place(Place(group="tip"), "probe")[0] @ slender.equilibrium

    def rates(x: Array, y: Array) -> Array:
        u, e = y
        return np.array([e, -(k**2) * (x + u) / (1.0 + 3.0 * e + 1.5 * e**2)])

    start = np.linspace(0.0, LENGTH, 50)
    exact = solve_bvp(
        rates, lambda a, b: np.array([a[0], b[1]]), start, np.zeros((2, 50)), tol=1e-10
    )
    assert exact.success
    assert tip[0] == pytest.approx(exact.sol(LENGTH)[0], rel=1e-4)
    assert np.abs(tip[1:]).max() < 1e-9 * LENGTH
    small = np.tan(speed) / k - LENGTH
    assert tip[0] == pytest.approx(small, rel=1.5 * speed**2)
    # without the growing lever, k^2 L^3 / 3, it would be less by 2/5 (k L)^2: what strains of this
    # size change has the other sign
    assert abs(exact.sol(LENGTH)[0] / small - 1.0) > 0.1 * speed**2
    slender.spin(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_equilibrium_at_speed_balances_and_is_independent_of_the_path(dimension: int) -> None:
    scene = rotating_scene(
        dimension, loads=[{**load, "direction": load["direction"][:dimension]} for load in PUSH]
    )
    solid = make_solid(scene)
    assert solid.loaded
    force = solid.internal_force(solid.equilibrium)
    size = np.abs(solid.rotation.centrifugal_force(solid.equilibrium)).max()
    np.testing.assert_allclose(force, solid.static_load, rtol=0, atol=1e-7 * size)
    assert np.abs(solid.equilibrium).max() > 1e-4
    slow = make_solid(replace(scene, rotation=replace(scene.rotation, speed_rpm=100.0)))
    for rpm in (1500.0, 4000.0):
        slow.spin(rpm / RPM)
    scale = np.abs(solid.equilibrium).max()
    np.testing.assert_allclose(slow.equilibrium, solid.equilibrium, rtol=0, atol=1e-8 * scale)
    keep = free_unknowns(solid)
    for name in ("stiffness", "gyroscopic"):
        ours, theirs = dense(getattr(slow, name), keep), dense(getattr(solid, name), keep)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8 * np.abs(theirs).max())
    b = random_field(slow, 1.0)
    np.testing.assert_allclose(
        slow.stiffness_times(slow.factor.solve(b[:, None]))[:, 0], b, rtol=0, atol=1e-8
    )
    u = solid.static(1.2 * solid.static_load, solid.equilibrium)  # from a guess, at this speed
    np.testing.assert_allclose(u, solid.static(1.2 * solid.static_load), rtol=0, atol=1e-8 * scale)


@pytest.mark.slow
def test_geometrically_linear_scene_vibrates_about_same_equilibrium() -> None:
    nonlinear, linear = (
        make_solid(rotating_scene(3, f"geometrically_nonlinear={word}", loads=PUSH))
        for word in ("true", "false")
    )
    np.testing.assert_array_equal(linear.equilibrium, nonlinear.equilibrium)
    np.testing.assert_allclose(
        linear.rest_force, linear.static_load, rtol=0, atol=1e-6 * np.abs(linear.static_load).max()
    )
    modes = component_modes(linear, Basis(method="rubin", modes=2))
    np.testing.assert_allclose(
        modes.omega, component_modes(nonlinear, Basis(method="rubin", modes=2)).omega, rtol=1e-10
    )
    full = FullModel(linear)
    q = 1e-3 * modes.normal[:, 0]
    expected = linear.static_load + linear.stiffness_times(q)
    np.testing.assert_allclose(
        full.elastic_at(q)[0], expected, rtol=0, atol=1e-7 * np.abs(expected).max()
    )


def test_equilibrium_that_is_not_found_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    from fenicsrom.fem.equilibrium import statics

    monkeypatch.setattr(statics, "STATIC_ITERATIONS", 1)
    with pytest.raises(
        ConvergenceError, match="up to 0 % of the load and of the centrifugal force"
    ):
        make_solid(rotating_scene(2))


# ------------------------------------------------------------------ frequencies


def test_rotating_cantilever_matches_beam_theory(slender: Any) -> None:
    """Reference: flap and lag of a rotating cantilever, η up to 12 | Wright et al. (1982),
    recomputed | flap 3.5160 to 13.1702 | 0.03 % | 0.05 %
    """
    worst = 0.0
    for eta, flap in zip(ETA, FLAP, strict=True):
        slender.spin(eta * UNIT)
        squares, modes = slender.eigenmodes(slender.factor, 2)
        found = np.sqrt(squares) / UNIT
        across = np.array([np.sum(modes[k::3] ** 2, axis=0) for k in range(3)])
        assert np.argmax(across, axis=0).tolist() in ([1, 2], [2, 1])
        lag = np.sqrt(flap**2 - eta**2)
        if eta:
            assert np.argmax(across, axis=0).tolist() == [
                1,
                2,
            ]  # the softer one lies in the plane of rotation
            assert found[1] ** 2 - found[0] ** 2 == pytest.approx(eta**2, rel=1e-3)
        worst = max(worst, *np.abs(found / [lag, flap] - 1.0))
        assert found == pytest.approx([lag, flap], rel=5e-4)
    assert worst < 5e-4
    slender.spin(0.0)


@pytest.mark.parametrize(
    ("dimension", "loads", "method"), [(2, PUSH[:1], "rubin"), (3, PUSH, "craig-bampton")]
)
def test_polynomial_about_spinning_state_matches_projected_force(
    dimension: int, loads: Any, method: str
) -> None:
    scene = rotating_scene(
        dimension, loads=[{**load, "direction": load["direction"][:dimension]} for load in loads]
    )
    solid = make_solid(scene)
    assert np.abs(solid.equilibrium).max() > 1e-4
    _, _, basis = enriched(solid, method, 2)
    model, intrusive, r = project(solid, basis), project_intrusively(solid, basis), basis.vectors
    n = basis.size
    force, tangent = np.empty(n), np.empty((n, n))
    rng = np.random.default_rng(2)
    largest = solid.largest(r)
    for size in (1e-3, 1e-2, 1e-1):
        q = size * rng.standard_normal(n) / largest
        u = solid.equilibrium + r @ q
        energy = elastic_force(model.elastic, q, force, tangent)
        # measured in coordinates that move the body alike
        expected, expected_tangent = (
            r.T @ solid.internal_force(u) / largest,
            r.T @ solid.tangent_times(u, r),
        )
        assert np.abs(force / largest - expected).max() <= 1e-12 * np.abs(expected).max()
        scale = np.outer(largest, largest)
        assert (
            np.abs((tangent - expected_tangent) / scale).max()
            <= 1e-12 * np.abs(expected_tangent / scale).max()
        )
        ours, theirs = intrusive.elastic_at(q)
        assert np.abs(ours / largest - expected).max() <= 1e-12 * np.abs(expected).max()
        # `theirs` is a difference of two energies and has the digits that are left
        assert energy == pytest.approx(
            theirs, rel=1e-12, abs=1e-13 * abs(solid.energy(solid.equilibrium))
        )
    at_rest = r.T @ solid.static_load / largest  # what holds it at q = 0 are the static loads
    centrifugal = np.abs(r.T @ solid.rotation.centrifugal_force(solid.equilibrium) / largest).max()
    np.testing.assert_allclose(
        model.elastic.force / largest, at_rest, rtol=0, atol=1e-7 * centrifugal
    )


@pytest.mark.slow
def test_whirling_shaft_splits_its_frequencies_by_the_speed(tmp_path: Path) -> None:
    """A square shaft turning about its own axis: omega_0 - Omega and omega_0 + Omega in the turning
    frame.

    Reference: whirl of a square shaft | closed form | ω₀ ± Ω | agrees | 0.01 %
    """
    still = {"speed_rpm": 0.0, "axis": [1.0, 0.0, 0.0], "coriolis": True}
    sizes = ("geometry.parameters.elements_along=10",)
    table = {"speeds_rpm": [0.0, 40.0, 80.0, 120.0, 160.0], "modes": 2, "engine_orders": [1]}
    scene = beam_scene(3, sizes, contacts=None, rotation=still, campbell=table)
    found = diagram.campbell(scene, world())
    first = found.frequencies_hz[0, 0]
    assert first == pytest.approx(found.frequencies_hz[0, 1], rel=1e-6)
    assert 60.0 * first > 160.0
    expected = first + np.outer(found.speeds_rpm / 60.0, [-1.0, 1.0])
    np.testing.assert_allclose(
        np.sort(found.frequencies_hz, axis=1), expected, rtol=0, atol=1e-4 * first
    )  # (r/L)^2 = 8e-6
    assert (
        found.mac.min() > 0.99
    )  # circular shapes are followed from the start, where any two will do
    (critical,) = found.critical  # forwards omega_0 + Omega never meets Omega
    assert critical.speed_rpm == pytest.approx(30.0 * first, rel=1e-4)
    assert critical.frequency_hz == pytest.approx(0.5 * first, rel=1e-4)


def test_complex_modes_match_dense_eigenvalues(spun: Any) -> None:
    """Against all eigenvalues of the dense matrices of the mesh."""
    keep = free_unknowns(spun)
    mass, stiffness, gyroscopic = (
        dense(m, keep) for m in (spun.mass, spun.stiffness, spun.gyroscopic)
    )
    squares, shapes, change = rotating_modes.modes_at_speed(spun, 4)
    assert 0.0 <= change <= rotating_modes.COMPLEX_TOLERANCE
    n = keep.size
    state = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, gyroscopic)],
        ]
    )
    values = np.linalg.eigvals(state)
    expected = np.sort(values.imag[values.imag > 0.0])[:4]
    np.testing.assert_allclose(np.sqrt(squares), expected, rtol=1e-7)
    real, _ = spun.eigenmodes(spun.factor, 4)
    assert np.abs(np.sqrt(real) / expected - 1.0).max() > 1e-4  # the Coriolis force changes them
    for k in range(4):
        phi = shapes[keep, k]
        force = stiffness @ phi
        residual = force + 1j * expected[k] * (gyroscopic @ phi) - squares[k] * (mass @ phi)
        assert np.linalg.norm(residual) < 5e-6 * np.linalg.norm(force)


@pytest.mark.parametrize("complex_shapes", [False, True])
def test_modes_of_equal_frequency_are_followed(complex_shapes: bool) -> None:
    """The solver returns any combination of two modes of equal frequency; the modes at the previous
    speed tell them apart."""
    rng = np.random.default_rng(4)
    shapes = rng.standard_normal((9, 4)) + 1j * complex_shapes * rng.standard_normal((9, 4))
    shapes, _ = np.linalg.qr(shapes if complex_shapes else shapes.real)
    mix, _ = np.linalg.qr(
        rng.standard_normal((2, 2)) + 1j * complex_shapes * rng.standard_normal((2, 2))
    )
    mix = mix if complex_shapes else mix.real
    body = SimpleNamespace(mass_inner=lambda a, b: a.T @ b)
    # 2 has sunk beneath 0 and meets 1; 3 stays; 0 has risen above both
    vectors = np.column_stack([shapes[:, [1, 2]] @ mix, shapes[:, 0], shapes[:, 3]])
    squares, kept, mac = rotating_modes.follow(
        body, np.array([1.0, 4.0, 9.0, 16.0]), shapes, np.array([3.0, 3.0, 5.0, 17.0]), vectors
    )
    np.testing.assert_allclose(squares, [5.0, 3.0, 3.0, 17.0], rtol=1e-14)
    np.testing.assert_allclose(mac, 1.0, rtol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(kept.conj() * shapes, axis=0)), 1.0, rtol=1e-12)
    # frequencies that are nearly equal are not joined to a mean
    near = np.array([3.0, 3.0001, 5.0, 17.0])
    squares, _, _ = rotating_modes.follow(
        body, np.array([1.0, 4.0, 9.0, 16.0]), shapes, near, vectors
    )
    np.testing.assert_allclose(np.sort(squares), near, rtol=1e-14)
    # and where they part again, as combinations of the two that met
    met, parted = np.array([1.0, 4.0, 4.0, 16.0]), shapes.copy()
    parted[:, 1:3] = shapes[:, 1:3] @ mix
    squares, _, mac = rotating_modes.follow(
        body, met, shapes, np.array([1.0, 3.0, 5.0, 17.0]), parted
    )
    np.testing.assert_allclose(np.sort(squares), [1.0, 3.0, 5.0, 17.0], rtol=1e-14)
    np.testing.assert_allclose(mac, 1.0, rtol=1e-12)


@pytest.mark.slow
def test_crossing_modes_are_followed() -> None:
    """Two bending modes of a flat beam, out of and in the plane of rotation, cross as the first
    stiffens; each keeps its shape."""
    sizes = (
        "geometry.parameters.elements_along=10",
        "geometry.parameters.height=0.0254",
        "geometry.parameters.width=0.020",
        "material.poisson=0.0",
    )
    top = 8.0 * UNIT * RPM
    table = {
        "speeds_rpm": {"first": 0.0, "last": top, "number": 9},
        "modes": 2,
        "engine_orders": [1, 2],
    }
    spin = {"speed_rpm": 0.0, "axis": [0.0, 0.0, 1.0]}
    found = diagram.campbell(
        beam_scene(3, sizes, contacts=None, rotation=spin, campbell=table), world()
    )
    flap, lag = found.frequencies_hz.T
    assert flap[0] < lag[0] and flap[-1] > lag[-1]
    assert found.mac.min() > 0.9 and not found.warnings
    # lag^2 + Omega^2 of a height is flap^2 of it: both are nearly a + b Omega^2, the same b for
    # each up to the section
    slope = (
        np.diff(found.frequencies_hz**2, axis=0) / np.diff((found.speeds_rpm / 60.0) ** 2)[:, None]
    )
    np.testing.assert_allclose(slope[:, 0] - slope[:, 1], 1.0, atol=0.02)
    # every critical speed is one: the frequency there, computed afresh, is the engine order's
    assert found.critical
    for item in found.critical:
        solid = make_solid(
            beam_scene(3, sizes, contacts=None, rotation=spin | {"speed_rpm": item.speed_rpm})
        )
        exact = np.sqrt(solid.eigenmodes(solid.factor, 2)[0]) / (2.0 * np.pi)
        assert np.abs(exact - item.frequency_hz).min() < 1e-3 * item.frequency_hz
        assert item.frequency_hz == pytest.approx(item.order * item.speed_rpm / 60.0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("speed_rpm", "said"), [(5e4, ""), (1e5, "det F is -1")])
def test_modes_and_campbell_warn_of_a_block_that_is_crushed_at_speed(
    speed_rpm: float, said: str
) -> None:
    """The axis lies beyond the free end, so that the inertia forces press the block on its root."""
    sizes = {"length": 0.2, "height": 0.4, "elements_along": 2, "load_at": 0.5}
    parameters = tuple(f"geometry.parameters.{name}={size}" for name, size in sizes.items())
    scene = beam_scene(
        2,
        parameters,
        contacts=None,
        rotation={"speed_rpm": speed_rpm, "point": [0.4, 0.0]},
        output={"stresses": "cauchy"},
        campbell={"speeds_rpm": [0.0, 3e4, speed_rpm], "modes": 1, "engine_orders": [1]},
    )
    modes = [text for text in run(scene, modes_only=True).warnings if "Kirchhoff" in text]
    assert len(modes) == bool(said) and all(said in text for text in modes)
    found = diagram.campbell(scene, world())
    warnings = [text for text in found.warnings if "Kirchhoff" in text]
    assert len(warnings) == bool(said)
    assert all(said in text and f" at {speed_rpm:g} rpm" in text for text in warnings)


def world() -> Any:
    from mpi4py import MPI

    return MPI.COMM_WORLD


@pytest.mark.slow
@pytest.mark.parametrize("coriolis", [False, True])
def test_beam_inside_its_axis_becomes_unstable(coriolis: bool) -> None:
    """The axis lies beyond the tip: a straight beam stays straight, but unstable."""
    table = {"speeds_rpm": [0.0, 500.0, 5000.0], "modes": 2}
    scene = rotating_scene(
        2, rotation={"speed_rpm": 0.0, "point": [5.0, 0.0], "coriolis": coriolis}, campbell=table
    )
    found = diagram.campbell(scene, world())
    assert found.unfinished is None and found.speeds_rpm[-1] == 5000.0
    low, high = np.sort(found.frequencies_hz[:2, 0])
    assert 0.0 < low == found.frequencies_hz[1, 0] < high and found.squares[2, 0] < 0.0
    (warning,) = found.warnings
    assert warning.startswith("mode 1 has omega^2 < 0 at 5000 rpm")
    assert ("without the Coriolis force" in warning) == (not coriolis)


# ------------------------------------------------------------------ scene and command


def test_rotation_in_space_needs_an_axis() -> None:
    for axis, kind in (({}, ErrorKind.MISSING), ({"axis": [0.0] * 3}, ErrorKind.RANGE)):
        with refusal(kind, "rotation.axis"):
            beam_scene(3, rotation={"speed_rpm": 1.0, **axis})


def test_rotating_scene_survives_its_table() -> None:
    scene = rotating_scene(3, campbell={"speeds_rpm": {"first": 0.0, "last": 9.0, "number": 4}})
    assert scene.campbell.speeds_rpm == (0.0, 3.0, 6.0, 9.0)
    assert scene.rotation.omega == pytest.approx(4000.0 * 2.0 * np.pi / 60.0)
    assert parse_scene(json.loads(json.dumps(scene_table(scene))), "test", None) == scene
    assert rotating_scene(2).rotation.point == (-0.2, 0.1)
    assert beam_scene(2, rotation={"speed_rpm": 1.0}).rotation.point == (0.0, 0.0)
    other = replace(scene, rotation=replace(scene.rotation, speed_rpm=1.0))
    assert changed_key(scene, other) == "rotation"  # a stored model is of one speed


SMALL_SCENE = """
title = "a small rotor"
[geometry]
mesh = "beam2d.geo"
dimension = 2
thickness = 0.02
[geometry.parameters]
length = 1.0
height = 0.05
elements_along = 4
load_at = 0.5
[material]
young = 207e9
poisson = 0.3
density = 7800.0
[[supports]]
group = "root"
[[loads]]
group = "tip"
direction = [0.0, 1.0]
force = 1.0
frequency = 10.0
[rotation]
speed_rpm = 3000.0
[campbell]
modes = 2
engine_orders = [1, 2]
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "rotor.toml"
    path.write_text(SMALL_SCENE)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("coriolis", ["true", "false"])
def test_modes_say_that_they_leave_out_the_coriolis_force(
    small: Path, tmp_path: Path, capsys: Any, coriolis: str
) -> None:
    sets = ["--set", f"rotation.coriolis={coriolis}", "--set", "output.pictures=false"]
    assert main(["modes", str(small), "--output", str(tmp_path / "out"), *sets]) == 0
    said = "leave out the Coriolis force" in capsys.readouterr().out
    assert said == (coriolis == "true")


@pytest.mark.slow
def test_campbell_command_writes_its_files(small: Path, tmp_path: Path, capsys: Any) -> None:
    folder = tmp_path / "out"
    coriolis = ["--set", "rotation.coriolis=true"]
    assert main(["campbell", str(small), "--output", str(folder), *coriolis]) == 0
    printed, progress = capsys.readouterr()
    assert progress.count(" rpm: ") == 13 and "2 modes at 13 speeds from 0 to 3000 rpm" in printed
    files = ["report.html", "campbell.csv", "campbell.json", "campbell.png", "setup.png"]
    assert printed.splitlines()[-6:] == ["files:", *(f"  {folder / name}" for name in files)]
    found = json.loads((folder / "campbell.json").read_text())
    frequencies = np.array(found["frequencies_Hz"])
    assert frequencies.shape == (13, 2) and found["speeds_rpm"][-1] == 3000.0
    assert found["coriolis"] is True and found["complex_change"] is not None
    assert found["unfinished"] is None
    section = 0.05**2 / 12.0
    assert frequencies[0, 0] == pytest.approx(
        3.516 / (2.0 * np.pi) * np.sqrt(207e9 * section / 7800.0), rel=0.02
    )
    assert np.all(np.diff(frequencies, axis=0)[1:] > 0.0)
    margins = frequencies[-1][:, None] / (np.array([1, 2]) * 50.0) - 1.0
    np.testing.assert_allclose(found["margins"], margins, rtol=1e-9)
    for item in found["critical_speeds"]:
        assert item["frequency_Hz"] == pytest.approx(item["order"] * item["speed_rpm"] / 60.0)
        line = np.interp(item["speed_rpm"], found["speeds_rpm"], frequencies[:, item["mode"] - 1])
        assert line == pytest.approx(item["frequency_Hz"], rel=0.01)
    with open(folder / "campbell.csv", newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["speed_rpm", "mode_1_Hz", "mode_2_Hz", "mode_1_mac", "mode_2_mac"]
    np.testing.assert_allclose(np.array(rows[1:], float)[:, 1:3], frequencies)


def test_campbell_command_refuses_wrong_scenes(small: Path, tmp_path: Path, capsys: Any) -> None:
    def refused(*overrides: str) -> str:
        options = [word for override in overrides for word in ("--set", override)]
        assert main(["campbell", str(small), "--output", str(tmp_path / "out"), *options]) == 2
        last = capsys.readouterr().err.splitlines()[-1]
        assert last.startswith("fenicsrom: ")
        return last

    assert "campbell.modes = 500" in refused("campbell.modes=500")
    small.write_text(SMALL_SCENE.replace("[rotation]\nspeed_rpm = 3000.0\n", ""))
    assert "rotation is missing" in refused()


def test_campbell_writes_the_speeds_before_a_failure(
    small: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from fenicsrom.fem.solid.solid import Solid

    spin = Solid.spin

    def limited(self: Any, omega: float) -> None:
        if omega * RPM > 1100.0:
            raise ConvergenceError("static equilibrium: no convergence")
        spin(self, omega)

    monkeypatch.setattr(Solid, "spin", limited)
    assert main(["campbell", str(small), "--output", str(tmp_path / "out")]) == 1
    assert "campbell: at 1250 rpm: static equilibrium: no convergence" in capsys.readouterr().err
    found = json.loads((tmp_path / "out" / "campbell.json").read_text())
    assert (
        found["speeds_rpm"] == [0.0, 250.0, 500.0, 750.0, 1000.0]
        and "1250 rpm" in found["unfinished"]
    )
