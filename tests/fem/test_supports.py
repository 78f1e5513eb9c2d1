"""Supports: clamped components against closed forms and symmetry; bodies that are not held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import beam_scene, make_solid, refusal, scene_of

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.online.stress.reactions import equilibrium_reactions
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis

SLENDER = ("length=1.0", "height=0.01", "elements_along=20", "load_at=0.5")
PINNED = [{"node": [0.0, 0.0]}, {"node": [1.0, 0.0], "components": ["y"]}]


def beam(supports: list[dict[str, Any]], sizes: tuple[str, ...] = SLENDER, **tables: Any) -> Any:
    """A beam of 1 m x 10 mm in plane stress, without contact."""
    parameters = tuple(f"geometry.parameters.{size}" for size in sizes)
    return make_solid(
        beam_scene(
            2, (*parameters, "geometry.thickness=1.0"), contacts=None, supports=supports, **tables
        )
    )


def frequencies(solid: Any, count: int) -> Any:
    """The lowest angular frequencies, rad/s."""
    return component_modes(solid, Basis(modes=count)).omega[:count]


def reactions(solid: Any) -> Any:
    """Forces and moments of the supports at the equilibrium."""
    scene = scene_of(solid)
    table = reaction_table(solid, scene, np.zeros((solid.local, 0)))
    return equilibrium_reactions(table, scene)


def test_simply_supported_beam_has_the_frequencies_of_the_closed_form() -> None:
    """(n pi / L)² sqrt(E I / rho A), less rotary inertia and shear to first order.

    Reference: three frequencies of a simply supported beam | with shear to first order | closed
    form | agree | 0.1 %
    """
    solid = beam(PINNED, ("length=1.0", "height=0.01", "elements_along=40", "load_at=0.5"))
    material, slope = solid.material, np.arange(1, 4) * np.pi * 0.01
    euler = slope**2 / 0.01 * np.sqrt(material.young / material.density / 12.0)
    shear = 2.0 * (1.0 + material.poisson) / (5.0 / 6.0)
    timoshenko = euler * (1.0 - slope**2 / 24.0 * (1.0 + shear))
    np.testing.assert_allclose(frequencies(solid, 3), timoshenko, rtol=1e-3)


def test_roller_carries_half_the_load_without_a_moment() -> None:
    load = {"group": "load", "direction": [0.0, 1.0], "force": 10.0}
    solid = beam(PINNED, loads=[load])
    found = reactions(solid)
    # the ends approach each other in large displacements: second order in the deflection
    np.testing.assert_allclose(found.values[0, :, :2], [[0.0, -5.0], [0.0, -5.0]], atol=1e-6)
    np.testing.assert_allclose(found.values[0, :, 2], 0.0, atol=1e-9)
    assert found.mismatch < 1e-9


def test_half_model_with_symmetry_plane_has_the_symmetric_modes_of_the_whole() -> None:
    clamps = [{"group": "root"}, {"group": "tip"}]
    sizes = ("length=1.0", "height=0.1", "elements_along=8", "load_at=0.5")
    whole = frequencies(beam(clamps, sizes), 3)
    half = [{"group": "root"}, {"group": "tip", "components": ["x"]}]
    sizes = ("length=0.5", "height=0.1", "elements_along=4", "load_at=0.5")
    np.testing.assert_allclose(frequencies(beam(half, sizes), 2), whole[[0, 2]], rtol=1e-9)


def test_half_model_in_large_deflection_is_half_the_whole() -> None:
    """A pressure of 4 MPa bends the beam by more than its height."""

    def loaded(supports: list[dict[str, Any]], length: float, elements: int) -> Any:
        sizes = (f"length={length}", "height=0.02", f"elements_along={elements}", "load_at=0.5")
        load = {"box": [[-1.0, 0.0099], [2.0, 0.0101]], "pressure": 4e6}
        return beam(supports, sizes, loads=[load])

    whole = loaded([{"group": "root"}, {"group": "tip"}], 1.0, 12)
    half = loaded([{"group": "root"}, {"group": "tip", "components": ["x"]}], 0.5, 6)
    assert whole.largest(whole.equilibrium[:, None])[0] > 0.02
    assert half.largest(half.equilibrium[:, None])[0] == pytest.approx(
        whole.largest(whole.equilibrium[:, None])[0], rel=1e-8
    )
    both, one = reactions(whole).values[0], reactions(half).values[0]
    np.testing.assert_allclose(one[0], both[0], rtol=1e-7)
    assert one[1, 0] == pytest.approx(-one[0, 0], rel=1e-7)
    assert one[1, 1] == 0.0


@pytest.mark.parametrize(
    "supports",
    [
        [{"group": "root", "components": ["x"]}],
        [{"node": [0.0, 0.0]}, {"node": [1.0, 0.0], "components": ["x"]}],
    ],
    ids=["slides along y", "turns"],
)
def test_supports_that_leave_a_rigid_motion_are_refused(supports: list[dict[str, Any]]) -> None:
    with refusal(ErrorKind.SUPPORT, "supports"):
        beam(supports)


def test_symmetry_planes_hold_a_body_in_space() -> None:
    planes = [
        {"plane": {"point": [0.0, 0.0, 0.0], "normal": [1.0, 0.0, 0.0]}, "components": ["x"]},
        {"plane": {"point": [0.0, -0.1, 0.0], "normal": [0.0, 1.0, 0.0]}, "components": ["y"]},
        {"plane": {"point": [0.0, 0.0, -0.1], "normal": [0.0, 0.0, 1.0]}, "components": ["z"]},
    ]
    sizes = ("length=1", "height=0.2", "width=0.2", "elements_along=2", "load_at=0.5")
    overrides = tuple(f"geometry.parameters.{size}" for size in sizes)
    pull = {"group": "tip", "direction": [1.0, 0.0, 0.0], "force": 4e6}

    def bar(supports: list[dict[str, Any]]) -> Any:
        return make_solid(
            beam_scene(
                3,
                (*overrides, "geometrically_nonlinear=false"),
                supports=supports,
                loads=[pull],
                contacts=None,
            )
        )

    solid = bar(planes)
    x = solid.space.tabulate_dof_coordinates()
    strain = 4e6 / 0.04 / solid.material.young
    u = solid.equilibrium.reshape(-1, 3)
    np.testing.assert_allclose(u[:, 0], strain * x[:, 0], atol=1e-9 * strain)
    narrowing = -solid.material.poisson * strain
    np.testing.assert_allclose(u[:, 1], narrowing * (x[:, 1] + 0.1), atol=1e-9 * strain)
    with refusal(ErrorKind.SUPPORT, "supports"):
        bar(planes[:2])


def test_contact_point_with_a_clamped_component_is_refused() -> None:
    contact = {
        "group": "tip", "at": "centre", "normal": [0.0, 1.0], "preload": 1.0, "friction": 0.5,
        "normal_stiffness": 1e4, "tangential_stiffness": 1e4,
    }  # fmt: skip
    with refusal(ErrorKind.PLACE, "contacts[0]"):
        make_solid(
            beam_scene(
                supports=[{"group": "root"}, {"group": "tip", "components": ["x"]}],
                contacts=[contact],
            )
        )


def test_support_at_no_node_is_refused() -> None:
    with refusal(ErrorKind.PLACE, "supports"):
        make_solid(beam_scene(2, supports=[{"node": [0.3, 0.3]}]))
