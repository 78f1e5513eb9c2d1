"""Materials of groups and materials with axes: closed forms, rotated frames, exact reduction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq
from support import (
    STOCKY,
    assert_force_of_energy,
    assert_polynomial_is_exact,
    assert_tangent_of_force,
    beam_scene,
    make_solid,
    refusal,
    scene_of,
)

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.body.stress_points import stress_table
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.online.store.archive import FORMS, makers
from fenicsrom.online.store.store import pack, unpack
from fenicsrom.online.stress.reactions import Recovery, equilibrium_reactions
from fenicsrom.online.stress.stress import StressLaw
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, Material, make_scene

Array = NDArray[np.float64]

LAMINA = {
    "young": [140e9, 10e9, 9e9],
    "poisson": [0.3, 0.25, 0.4],
    "shear": [5e9, 4.5e9, 3.4e9],
    "density": 1600.0,
}
FIBRES = {"young": [140e9, 10e9], "poisson": [0.3, 0.45], "shear": 5e9, "density": 1600.0}
SOFT = {"young": 70e9, "poisson": 0.0, "density": 2700.0}
STIFF = {"young": 210e9, "poisson": 0.0, "density": 7800.0}

TWO_PARTS = """
Point(1) = {{0, 0, 0}}; Point(2) = {{{middle}, 0, 0}}; Point(3) = {{{length}, 0, 0}};
Point(4) = {{{length}, {height}, 0}}; Point(5) = {{{middle}, {height}, 0}};
Point(6) = {{0, {height}, 0}};
Line(1) = {{1, 2}}; Line(2) = {{2, 3}}; Line(3) = {{3, 4}}; Line(4) = {{4, 5}};
Line(5) = {{5, 6}}; Line(6) = {{6, 1}}; Line(7) = {{2, 5}};
Curve Loop(1) = {{1, 7, 5, 6}}; Plane Surface(1) = {{1}};
Curve Loop(2) = {{2, 3, 4, -7}}; Plane Surface(2) = {{2}};
Transfinite Curve {{1, 2, 4, 5}} = {along} + 1; Transfinite Curve {{3, 6, 7}} = {across} + 1;
Transfinite Surface {{:}}; Recombine Surface {{:}};
"""
FLAT = 'Physical Surface("left") = {1}; Physical Surface("right") = {2};\n'
THICK = """
Extrude {{0, 0, {depth}}} {{ Surface{{1, 2}}; Layers{{1}}; Recombine; }}
Physical Volume("left") = {{1}}; Physical Volume("right") = {{2}};
Physical Volume("both") = {{1, 2}};
"""


def on_plane(axis: int, value: float, dimension: int = 2) -> dict[str, Any]:
    """The pick of the facets on the plane x_axis = value."""
    normal, point = [0.0] * dimension, [0.0] * dimension
    normal[axis], point[axis] = 1.0, value
    return {"plane": {"point": point, "normal": normal}}


def at_rest(solid: Any) -> Recovery:
    """The tables of stresses and reactions of a body without coordinates."""
    scene, none = scene_of(solid), np.zeros((solid.local, 0))
    table = stress_table(solid, scene, solid.equilibrium, none)
    return Recovery(table, reaction_table(solid, scene, none))


def two_parts(
    folder: Path, sizes: dict[str, float], depth: float | None = None, **tables: Any
) -> Any:
    """A rectangle or box of the groups left and right."""
    ending = FLAT if depth is None else THICK.format(depth=depth)
    (folder / "parts.geo").write_text(TWO_PARTS.format(**sizes) + ending)
    dimension = 2 if depth is None else 3
    geometry = {"mesh": "parts.geo", "dimension": dimension}
    if dimension == 2:
        geometry["thickness"] = 0.02
    return make_solid(make_scene(folder=folder, geometry=geometry, **tables))


BAR = {"middle": 0.4, "length": 1.0, "height": 0.05, "along": 8, "across": 1}
GUIDED = [
    on_plane(0, 0.0) | {"components": ["x"]},
    on_plane(1, 0.0) | {"components": ["y"]},
    on_plane(1, 0.05) | {"components": ["y"]},
]


def test_bimaterial_bar_under_tension_extends_as_two_springs_in_series(tmp_path: Path) -> None:
    """The groups differ in Young's modulus and in thickness.

    Reference: tension of a bar of two materials | springs in series | closed form | agrees |
    1e-10
    """
    solid = two_parts(
        tmp_path,
        BAR,
        geometrically_nonlinear=False,
        material=SOFT,
        materials=[STIFF | {"group": "right", "thickness": 0.01}],
        supports=GUIDED,
        loads=[
            on_plane(0, 1.0) | {"direction": [1.0, 0.0], "traction": 1e6},
            {"direction": [1.0, 0.0], "acceleration": 1.0, "frequency": 1.0},
        ],
    )
    x = solid.space.tabulate_dof_coordinates()[:, 0]
    force = 1e6 * 0.05 * 0.01
    left, right = force / (70e9 * 0.05 * 0.02), force / (210e9 * 0.05 * 0.01)
    expected = left * np.minimum(x, 0.4) + right * np.maximum(x - 0.4, 0.0)
    np.testing.assert_allclose(solid.equilibrium[::2], expected, atol=1e-10 * expected.max())
    mass = 0.05 * (2700.0 * 0.4 * 0.02 + 7800.0 * 0.6 * 0.01)
    weight = solid.load_vector(solid.loads[1], "loads[1]")  # of 1 m/s²
    assert weight.sum() == pytest.approx(mass, rel=1e-12)
    assert solid.load_vectors[:, 0].sum() == pytest.approx(0.05 * 0.01, rel=1e-12)
    found = at_rest(solid)
    stress = found.stress.stress(np.zeros(0))[:, 0]
    left_part = found.stress.position[:, 0] < 0.4
    np.testing.assert_allclose(stress, np.where(left_part, 0.5e6, 1e6), rtol=1e-9)
    reactions = equilibrium_reactions(found.reactions, scene_of(solid))
    assert reactions.values[0, 0, 0] == pytest.approx(-force, rel=1e-9)
    assert reactions.mismatch < 1e-9
    kept = pack(found, FORMS, named=True)
    read = unpack(*kept, makers(scene_of(solid)))
    np.testing.assert_array_equal(read.stress.stress(np.zeros(0))[:, 0], stress)


def test_bimaterial_bar_has_the_frequencies_of_the_closed_form(tmp_path: Path) -> None:
    """tan(k₁ L₁) tan(k₂ L₂) = √(E₁ ρ₁) / √(E₂ ρ₂) for a bar clamped at the first end.

    Reference: two axial frequencies of a bar of aluminium and steel | characteristic equation |
    closed form | agree | 1e-5
    """
    solid = two_parts(
        tmp_path,
        BAR | {"along": 16},
        material=STIFF,
        materials=[SOFT | {"group": "left"}],
        supports=GUIDED,
        loads=[on_plane(0, 1.0) | {"direction": [1.0, 0.0], "force": 1.0, "frequency": 1.0}],
    )
    speed = np.sqrt([70e9 / 2700.0, 210e9 / 7800.0])
    ratio = np.sqrt(70e9 * 2700.0) / np.sqrt(210e9 * 7800.0)

    def residual(omega: float) -> float:
        """The equation, multiplied by both cosines."""
        a, b = omega * 0.4 / speed[0], omega * 0.6 / speed[1]
        return float(np.sin(a) * np.sin(b) - ratio * np.cos(a) * np.cos(b))

    samples = np.linspace(100.0, 3e4, 300)
    signs = np.sign([residual(omega) for omega in samples])
    exact = [
        brentq(residual, *samples[k : k + 2]) for k in np.flatnonzero(signs[1:] != signs[:-1])[:2]
    ]
    found = component_modes(solid, Basis(modes=2)).omega[:2]
    np.testing.assert_allclose(found, exact, rtol=1e-5)


@pytest.mark.parametrize("angle", [0.4, 1.1])
def test_tension_of_a_turned_lamina_stretches_and_shears_by_the_closed_form(angle: float) -> None:
    """Off-axis modulus and coupling of shear and extension (Jones, 1999, equations 2.94).

    Reference: strains of a lamina under tension oblique to its fibres | Jones (1999) | closed
    form | agree | 1e-9
    """
    c, s = np.cos(angle), np.sin(angle)
    pull = {"group": "tip", "direction": [1.0, 0.0], "traction": 1e6}
    solid = make_solid(
        beam_scene(
            2,
            (*STOCKY, "geometrically_nonlinear=false"),
            material=LAMINA | {"axes": [[c, s]]},
            supports=[
                on_plane(0, 0.0) | {"components": ["x"]},
                {"node": [0.0, 0.0], "components": ["y"]},
            ],
            loads=[pull],
            contacts=None,
        )
    )
    (e1, e2, _), nu12, g12 = LAMINA["young"], LAMINA["poisson"][0], LAMINA["shear"][0]
    along = c**4 / e1 + (1.0 / g12 - 2.0 * nu12 / e1) * s**2 * c**2 + s**4 / e2
    across = (s**4 + c**4) * -nu12 / e1 + (1.0 / e1 + 1.0 / e2 - 1.0 / g12) * s**2 * c**2
    shear = (2.0 / e1 + 2.0 * nu12 / e1 - 1.0 / g12) * s * c**3
    shear -= (2.0 / e2 + 2.0 * nu12 / e1 - 1.0 / g12) * s**3 * c
    x, y = solid.space.tabulate_dof_coordinates()[:, :2].T
    u = solid.equilibrium.reshape(-1, 2)
    scale = 1e6 * along
    np.testing.assert_allclose(u[:, 0], 1e6 * along * x, atol=1e-9 * scale)
    np.testing.assert_allclose(u[:, 1], 1e6 * (across * y + shear * x), atol=1e-9 * scale)
    stress = at_rest(solid).stress.stress(np.zeros(0))
    np.testing.assert_allclose(stress - [1e6, 0, 0, 0, 0, 0], 0.0, atol=1e-3)


@pytest.mark.slow
def test_simply_supported_orthotropic_plate_has_the_frequencies_of_the_closed_form(
    tmp_path: Path,
) -> None:
    """ω = π² √((D₁ (m/a)⁴ + 2 D₃ (m n / a b)² + D₂ (n/b)⁴) / ρh) (Leissa, 1969, section 9.1).

    Reference: three frequencies of a thin orthotropic plate | Leissa (1969) | closed form |
    agree | 0.5 %
    """
    a, b, h = 1.0, 0.8, 0.005
    edges = [on_plane(0, at, 3) | {"components": ["y", "z"]} for at in (0.0, a)]
    edges += [on_plane(1, at, 3) | {"components": ["x", "z"]} for at in (0.0, b)]
    solid = two_parts(
        tmp_path,
        {"middle": 0.5 * a, "length": a, "height": b, "along": 8, "across": 16},
        h,
        material=LAMINA,
        supports=edges,
        loads=[
            {
                "nearest": [0.5, 0.4, 0.0],
                "direction": [0.0, 0.0, 1.0],
                "force": 1.0,
                "frequency": 1.0,
            }
        ],
    )
    (e1, e2, _), nu12, g12 = LAMINA["young"], LAMINA["poisson"][0], LAMINA["shear"][0]
    nu21 = nu12 * e2 / e1
    d1, d2 = (e * h**3 / 12.0 / (1.0 - nu12 * nu21) for e in (e1, e2))
    d3 = d1 * nu21 + 2.0 * g12 * h**3 / 12.0
    waves = [(m, n) for m in (1, 2) for n in (1, 2, 3)]
    exact = sorted(
        np.pi**2
        * np.sqrt(
            (d1 * (m / a) ** 4 + 2.0 * d3 * (m * n / a / b) ** 2 + d2 * (n / b) ** 4) / 1600.0 / h
        )
        for m, n in waves
    )
    found = component_modes(solid, Basis(modes=3)).omega[:3]
    np.testing.assert_allclose(found, exact[:3], rtol=5e-3)


KINDS: dict[str, tuple[int, dict[str, Any], tuple[str, ...]]] = {
    "plane stress": (2, LAMINA | {"axes": [[0.6, 0.8]]}, ()),
    "plane strain": (2, LAMINA | {"axes": [[0.6, 0.8]]}, ("geometry.plane='strain'",)),
    "space": (
        3,
        FIBRES | {"axes": [[0.6, 0.5, 0.3]]},
        ("geometry.parameters.width=0.15", "geometry.cells='simplex'"),
    ),
}


@pytest.fixture(scope="module", params=KINDS)
def composite(request: pytest.FixtureRequest) -> Any:
    """A stocky cantilever of two elements of a material with turned axes, bent by a static load."""
    dimension, material, overrides = KINDS[request.param]
    push = {"group": "tip", "direction": [0.3, 1.0, 0.5][:dimension], "force": 2e6}
    stocky = (*STOCKY, "geometry.parameters.elements_along=2")
    return make_solid(
        beam_scene(dimension, (*stocky, *overrides), material=material, loads=[push], contacts=None)
    )


def test_force_of_a_composite_is_the_derivative_of_the_energy(composite: Any) -> None:
    assert_force_of_energy(composite)


def test_tangent_of_a_composite_is_the_derivative_of_the_force(composite: Any) -> None:
    assert_tangent_of_force(composite)


def test_polynomial_of_a_composite_is_exact(composite: Any) -> None:
    assert np.abs(composite.equilibrium).max() > 0.01
    assert_polynomial_is_exact(composite)


def test_reactions_of_a_bent_composite_balance_the_load(composite: Any) -> None:
    found = equilibrium_reactions(at_rest(composite).reactions, scene_of(composite))
    d, load = composite.dimension, scene_of(composite).loads[0]
    force = -2e6 * np.array(load.direction)
    np.testing.assert_allclose(found.values[0, 0, :d], force, rtol=0, atol=1e-6 * 2e6)


@pytest.mark.parametrize("other", [STIFF, LAMINA | {"axes": [[0.6, 0.8]]}], ids=["steel", "lamina"])
def test_polynomial_of_two_materials_is_exact(other: dict[str, Any], tmp_path: Path) -> None:
    solid = two_parts(
        tmp_path,
        BAR | {"along": 2},
        material=SOFT,
        materials=[other | {"group": "right", "thickness": 0.03}],
        supports=[on_plane(0, 0.0)],
        loads=[on_plane(0, 1.0) | {"direction": [1.0, 1.0], "force": 1e4}],
    )
    assert_polynomial_is_exact(solid)


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_orthotropic_material_of_equal_constants_is_isotropic(plane: str) -> None:
    e, nu = 207e9, 0.28
    same = {
        "young": [e] * 3, "poisson": [nu] * 3, "shear": [e / 2.0 / (1.0 + nu)] * 3,
        "density": 7801.0, "axes": [[0.8, 0.6]],
    }  # fmt: skip
    stocky = (*STOCKY, f"geometry.plane='{plane}'")
    matrices = [
        make_solid(beam_scene(2, stocky, **changes)).stiffness[:, :]
        for changes in ({"material": same}, {})
    ]
    np.testing.assert_allclose(matrices[0], matrices[1], rtol=0, atol=1e-12 * matrices[1].max())


@pytest.mark.parametrize(
    ("plane", "linear"), [("stress", False), ("strain", False), (None, False), ("stress", True)]
)
def test_stresses_of_orthotropic_material_of_equal_constants_are_isotropic(
    plane: str | None, linear: bool
) -> None:
    e, nu, d = 200.0, 0.3, 3 if plane is None else 2
    same = Material(
        young=(e,) * 3, poisson=(nu,) * 3, shear=(e / 2.0 / (1.0 + nu),) * 3, density=1.0,
        axes=((0.6, 0.8, 0.0)[:d], (0.0, 0.6, 0.8)[:d]),
    )  # fmt: skip
    plain = Material(young=e, poisson=nu, density=1.0)
    isotropic, composite = (StressLaw(plane, linear, True, (each,)) for each in (plain, same))
    start, change = 0.1 * np.random.default_rng(1).standard_normal((2, 4, d, d))
    for measure in ("second_piola", "cauchy", "first_piola", "modal"):
        expected = getattr(isotropic, measure)(start, change)
        found = getattr(composite, measure)(start, change)
        np.testing.assert_allclose(found, expected, atol=1e-13 * e)


def test_turned_body_has_the_frequencies_of_the_turned_material(tmp_path: Path) -> None:
    """A cube, clamped at x = 0 with fibres along x, or at y = 0 with fibres along y."""

    def frequencies(axis: int) -> Array:
        corner = {"nearest": [1.0, 1.0, 1.0], "direction": [1.0, 1.0, 1.0]}
        solid = two_parts(
            tmp_path,
            {"middle": 0.5, "length": 1.0, "height": 1.0, "along": 1, "across": 2},
            1.0,
            material=STIFF,
            materials=[LAMINA | {"group": "both", "axes": np.eye(3)[[axis, 1 - axis]].tolist()}],
            supports=[on_plane(axis, 0.0, 3)],
            loads=[corner | {"force": 1.0, "frequency": 1.0}],
        )
        return np.asarray(component_modes(solid, Basis(modes=4)).omega[:4])

    np.testing.assert_allclose(frequencies(1), frequencies(0), rtol=1e-9)


@pytest.mark.parametrize(
    ("materials", "kind", "key"),
    [
        ([{"group": "both"}, {"group": "right"}], ErrorKind.CONFLICT, "materials[1].group"),
        ([{"group": "middle"}], ErrorKind.PLACE, "materials[0].group"),
    ],
    ids=["overlap", "unknown"],
)
def test_bad_groups_of_materials_are_refused(
    materials: list[dict[str, Any]], kind: ErrorKind, key: str, tmp_path: Path
) -> None:
    with refusal(kind, key):
        two_parts(
            tmp_path,
            BAR | {"along": 1},
            0.05,
            material=SOFT,
            materials=[STIFF | given for given in materials],
            supports=[on_plane(0, 0.0, 3)],
            loads=[on_plane(0, 1.0, 3) | {"direction": [1.0, 0.0, 0.0], "force": 1.0}],
        )
