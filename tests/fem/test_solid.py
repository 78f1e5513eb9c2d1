"""The solid: its forms against differences, its places and frames, statics against beam theory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import (
    KINDS_OF_CELLS,
    STOCKY,
    assert_force_of_energy,
    assert_tangent,
    assert_tangent_of_force,
    beam_scene,
    dense,
    free_unknowns,
    make_solid,
    random_field,
    refusal,
)

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.online.contact.surfaces import frame
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, Place

Array = NDArray[np.float64]

TINY = (*STOCKY, "geometry.parameters.elements_along=2")


@pytest.fixture(scope="module", params=KINDS_OF_CELLS)
def tiny(request: pytest.FixtureRequest) -> Any:
    """A stocky cantilever of two elements, of each kind of cell."""
    dimension, overrides = KINDS_OF_CELLS[request.param]
    return make_solid(beam_scene(dimension, (*TINY, *overrides)))


def positions(solid: Any) -> Array:
    """(nodes, d) of the unknowns."""
    d = solid.dimension
    return solid.space.tabulate_dof_coordinates()[: solid.local // d, :d]


def affine(solid: Any, gradient: Array) -> Array:
    """The displacement of a uniform gradient; clamped unknowns are not zero."""
    return (positions(solid) @ gradient.T).ravel()


# ------------------------------------------------------------------ forms


@pytest.mark.slow
def test_force_is_the_derivative_of_the_energy(tiny: Any) -> None:
    assert_force_of_energy(tiny)


def test_tangent_is_the_derivative_of_the_force(tiny: Any) -> None:
    assert_tangent_of_force(tiny)


@pytest.mark.parametrize("bent", ["bent2d", "bent3d"])
def test_derivative_of_tangent_at_deformed_equilibrium_matches_differences(
    bent: str, request: pytest.FixtureRequest
) -> None:
    solid = request.getfixturevalue(bent)
    u, y = solid.equilibrium, random_field(solid, 0.02, 4)
    directions = np.array([random_field(solid, 0.02, seed) for seed in (1, 2)])
    exact = np.array([solid.tangent_derivative(x, y) for x in directions]).T
    assert_tangent(
        lambda s: solid.tangent_times(u + s @ directions, y[:, None])[:, 0],
        lambda s: exact,
        np.zeros(2),
        step=0.5,
        tolerance=1e-9,
    )
    by_difference = np.array([solid.tangent_difference(x, y) for x in directions]).T
    np.testing.assert_allclose(by_difference, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


def test_matrices_are_symmetric_and_mass_is_density_times_volume(tiny: Any) -> None:
    keep = free_unknowns(tiny)
    for matrix in (tiny.mass, tiny.stiffness, tiny.tangent(random_field(tiny, 0.02))):
        values = dense(matrix, keep)
        np.testing.assert_allclose(values, values.T, rtol=0, atol=1e-12 * np.abs(values).max())
    assert np.linalg.eigvalsh(dense(tiny.stiffness, keep))[0] > 0
    # the mass in a field linear in x, which is zero on the clamped unknowns: int rho x^2 = rho A
    # L^3 / 3
    parameters = {"width": 0.0254} | tiny.geometry.parameters
    ramp = affine(tiny, np.diag([1.0, *[0.0] * (tiny.dimension - 1)]))
    assert tiny.mass_inner(ramp[:, None], ramp[:, None])[0, 0] == pytest.approx(
        7801.0 * parameters["height"] * parameters["width"] * parameters["length"] ** 3 / 3,
        rel=1e-12,
    )


def test_rigid_rotation_is_free_of_stress(tiny: Any) -> None:
    d = tiny.dimension
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((d, d)))[0]
    turn *= np.sign(np.linalg.det(turn))
    rotation = affine(tiny, turn - np.eye(d)) + 0.1
    stretched = affine(tiny, 0.01 * turn)
    assert abs(tiny.energy(rotation)) < 1e-12 * tiny.energy(stretched)
    assert (
        np.abs(tiny.internal_force(rotation)).max()
        < 1e-11 * np.abs(tiny.internal_force(stretched)).max()
    )
    # and the energy of a strained body does not change when it is turned
    gradient = np.eye(d) + 0.05 * np.random.default_rng(1).standard_normal((d, d))
    once = tiny.energy(affine(tiny, gradient - np.eye(d)))
    assert tiny.energy(affine(tiny, turn @ gradient - np.eye(d))) == pytest.approx(once, rel=1e-12)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_plane_solid_matches_solid_without_lateral_strain(plane: str) -> None:
    flat = make_solid(
        beam_scene(2, (*TINY, f"geometry.plane='{plane}'", "geometry.thickness=0.15"))
    )
    thick = make_solid(beam_scene(3, (*TINY, "geometry.parameters.width=0.15")))
    gradient = np.array([[1.05, -0.02], [0.04, 1.03]])
    green = 0.5 * (gradient.T @ gradient - np.eye(2))
    full = np.eye(3)
    full[:2, :2] = gradient
    if plane == "stress":  # S_zz = 0: E_zz = -nu / (1 - nu) (E_xx + E_yy)
        full[2, 2] = np.sqrt(1 - 2 * 0.28 / (1 - 0.28) * np.trace(green))
    expected = thick.energy(affine(thick, full - np.eye(3)))
    assert flat.energy(affine(flat, gradient - np.eye(2))) == pytest.approx(expected, rel=1e-12)


# ------------------------------------------------------------------ statics


@pytest.mark.parametrize(("dimension", "tolerance"), [(2, 1e-3), (3, 2e-3)])
def test_tip_under_small_load_matches_timoshenko(dimension: int, tolerance: float) -> None:
    load = {"group": "tip", "direction": [0, 1, 0][:dimension], "force": 1e-3, "frequency": 1.0}
    solid = make_solid(
        beam_scene(
            dimension, ("geometry.parameters.elements_along=60",), loads=[load], contacts=None
        )
    )
    tip = solid.probe_rows @ solid.static(1e-3 * solid.load_vectors[:, 0])
    length, side, young = 2.54, 0.0254, 207e9
    bending = 1e-3 * length**3 / (3 * young * side**4 / 12)
    shear = 1e-3 * length / (5 / 6 * young / 2.56 * side**2)
    assert tip[1] == pytest.approx(bending + shear, rel=tolerance)
    assert np.abs(np.delete(tip, 1)).max() < 1e-6 * tip[1]


def test_tip_under_large_load_matches_elastica() -> None:
    """Reference: tip of a cantilever under a large force, PL²/EI = 1: w/L, u/L | elastica,
    Mattiasson (1981) | 0.30172, −0.05643 | 0.30160, −0.05640 | 0.1 %
    """
    solid = make_solid(beam_scene(2, ("geometry.parameters.elements_along=60",)))
    rows, _ = solid.place(Place(group="tip"), "probe")
    force = 207e9 * 0.0254**4 / 12 / 2.54**2
    along, across = rows @ solid.static(force * rows[1]) / 2.54
    assert across == pytest.approx(0.30172, rel=1e-3)
    assert along == pytest.approx(-0.05643, rel=1e-3)


# ------------------------------------------------------------------ places


def test_frames_are_right_handed() -> None:
    rng = np.random.default_rng(0)
    for d in (2, 3):
        for normal in [*np.eye(d), *-np.eye(d), *rng.standard_normal((20, d))]:
            unit = normal / np.linalg.norm(normal)
            local = frame(unit)
            np.testing.assert_allclose(local @ local.T, np.eye(d), atol=1e-14)
            np.testing.assert_array_equal(local[0], unit)
            assert np.linalg.det(local) == pytest.approx(1.0)
    np.testing.assert_array_equal(frame(np.array([1.0, 0.0])), np.eye(2))
    np.testing.assert_array_equal(
        frame(np.array([1.0, 0.0, 0.0])), np.eye(3)
    )  # a wall beyond the tip


@pytest.mark.parametrize("group", ["tip", "load"])
def test_mean_over_group_weighs_by_area(tiny: Any, group: str) -> None:
    d = tiny.dimension
    rows, centroid = tiny.place(Place(group=group), "probe")
    height = tiny.geometry.parameters["height"]
    assert rows.shape == (d, tiny.local)
    np.testing.assert_allclose(centroid, [1.0 if group == "tip" else 0.5, 0, 0], atol=1e-12)
    for k in range(d):  # weights sum to one, in each component
        unit = np.zeros((tiny.local // d, d))
        unit[:, k] = 1.0
        np.testing.assert_allclose(rows @ unit.ravel(), np.eye(d)[k], atol=1e-12)
    np.testing.assert_allclose(
        rows @ affine(tiny, np.ones((d, d))), np.ones(d) * centroid.sum(), atol=1e-12
    )
    square = np.zeros((tiny.local // d, d))
    square[:, 0] = positions(tiny)[:, 1] ** 2  # area-weighted: mean of y^2 = h^2 / 12
    assert (rows @ square.ravel())[0] == pytest.approx(height**2 / 12, rel=1e-12)


def test_centre_is_the_node_nearest_to_the_centroid(tiny: Any) -> None:
    d = tiny.dimension
    rows, where = tiny.place(Place(group="tip", at="centre"), "probe")
    node, at = tiny.place(Place(node=tuple(where[:d])), "probe")
    np.testing.assert_array_equal(rows, node)
    np.testing.assert_array_equal(where, at)
    np.testing.assert_allclose(where, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(rows @ positions(tiny).ravel(), where[:d], atol=1e-12)
    assert np.count_nonzero(rows) == d and np.all(rows.sum(axis=1) == 1.0)


def test_contact_rows_are_in_the_local_frame() -> None:
    scene = beam_scene(2, (*TINY, "contacts.0.normal=[0.6, 0.8]"))
    solid = make_solid(scene)
    u = random_field(solid, 1.0)
    rows, _ = solid.place(scene.contacts[0].place, "contacts[0]")
    np.testing.assert_allclose(
        solid.contact_rows @ u, [[0.6, 0.8], [-0.8, 0.6]] @ (rows @ u), rtol=1e-12
    )


def test_place_used_twice_warns_once() -> None:
    """Contact and probe are the same point, a load is another: two different sentences."""
    place = {"nearest": [1.0, 0.09]}
    shake = {"nearest": [0.5, 0.03], "direction": [0.0, 1.0], "force": 1.0, "frequency": 3.0}
    solid = make_solid(beam_scene(2, TINY, contacts=contact_at(**place), loads=[shake]))
    assert [warning.split(":")[1].split(".")[0] for warning in solid.warnings] == [
        " contacts[0]",
        " loads[0]",
    ]
    np.testing.assert_array_equal(solid.probe_rows, solid.contact_rows.toarray())
    np.testing.assert_array_equal(
        solid.place(Place(nearest=(1.0, 0.09)), "again")[0], solid.probe_rows
    )
    assert len(solid.warnings) == 2


def contact_at(**place: Any) -> list[dict[str, Any]]:
    stiffness = {"normal_stiffness": 1.0, "tangential_stiffness": 1.0}
    return [place | stiffness | {"normal": [1.0, 0.0], "preload": 1.0, "friction": 0.5}]


def test_clamped_contact_is_refused() -> None:
    for place in ({"node": [0.0, 0.0]}, {"group": "root", "at": "centre"}):
        with refusal(ErrorKind.PLACE, "contacts[0]", names="[0.0, 0.0]"):
            make_solid(beam_scene(2, TINY, contacts=contact_at(**place)))
    with refusal(ErrorKind.PLACE, "contacts[0]", names="every node"):
        make_solid(beam_scene(2, TINY, contacts=contact_at(group="root")))


def test_load_on_clamped_group_is_refused() -> None:
    with refusal(ErrorKind.PLACE, "loads[0]", "test"):
        make_solid(
            beam_scene(2, TINY, loads=[{"group": "root", "frequency": 3.0, "pressure": 1.0}])
        )


def test_other_material_needs_no_compilation() -> None:
    """The numbers of the material are constants of the forms, not a part of their code."""
    changes = ("material.young=1.23e9", "material.density=1234.5", "geometry.thickness=0.0123")
    solids = [make_solid(beam_scene(2, (*TINY, *more))) for more in ((), changes)]
    for name in ("_tangent_form", "_force_form", "_energy_form", "_derivative_form"):
        one, other = (getattr(solid, name).module.__name__ for solid in solids)
        assert one == other, name
    one, other = (solid.inertia.form.module.__name__ for solid in solids)
    assert one == other
    ratio = solids[1].mass.getDiagonal().array.max() / solids[0].mass.getDiagonal().array.max()
    assert ratio == pytest.approx(1234.5 * 0.0123 / (7801.0 * 0.0254), rel=1e-12)


def test_contact_given_twice_is_refused() -> None:
    with refusal(ErrorKind.CONFLICT, "contacts[1]"):
        beam_scene(2, TINY, contacts=2 * contact_at(group="tip"))


def test_linear_elements_lock_and_warn(beam2d: Any) -> None:
    assert beam2d.warnings == []
    for cells in ("structured", "simplex"):
        linear = make_solid(beam_scene(2, ("geometry.degree=1", f"geometry.cells='{cells}'")))
        assert any("linear elements lock" in warning for warning in linear.warnings)
        assert component_modes(linear, Basis(method="rubin", modes=1)).frequencies_hz[0] > 2 * 3.28
