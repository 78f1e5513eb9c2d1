"""Materials, sizes and contact normals that are most likely mistakes: warned, with the cause."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import STOCKY, beam_scene, make_solid, refusal

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
from fenicsrom.notes import NoteKind, has_kind
from fenicsrom.scene import read_scene

DEMOS = sorted((Path(__file__).parents[2] / "demos").glob("*.toml"))


def sentences(*overrides: str, dimension: int = 2) -> list[str]:
    """The warnings of the undeformed body of a scene."""
    scene = beam_scene(dimension, (*STOCKY, *overrides))
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED).warnings


def test_steel_beam_is_plausible() -> None:
    assert sentences() == [] and sentences(dimension=3) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("young", "density", "cause"),
    [
        ("207000.0", "7801.0", "Young's modulus in MPa"),
        ("207e9", "7.8e-9", "density in t/mm³"),
        ("207000.0", "7.8e-9", '[units] length = "mm", mass = "t", time = "s"'),
        ("207.0", "7.8e-6", '[units] length = "mm", mass = "kg", time = "ms"'),
        ("1e-3", "1e20", "all numbers are in SI units"),
    ],
)
def test_units_of_a_material_are_guessed(young: str, density: str, cause: str) -> None:
    (found,) = sentences(f"material.young={young}", f"material.density={density}")
    assert found.kind is NoteKind.IMPLAUSIBLE and cause in found


def test_wrong_units_of_a_scene_name_the_right_ones() -> None:
    """The numbers are judged as the scene gives them, not as its wrong units convert them."""
    (found,) = sentences("units.mass='t'", "material.young=207e9", "material.density=7801.0")
    assert 'length = "m", mass = "kg", time = "s"' in found


@pytest.mark.parametrize(("young", "density"), [(2e7, 1100.0), (1.1e12, 3500.0)])
def test_hard_rubber_and_diamond_are_plausible(young: float, density: float) -> None:
    assert sentences(f"material.young={young}", f"material.density={density}") == []


@pytest.mark.parametrize(("length", "is_warned"), [(100.0, False), (346.0, True), (1e-5, False)])
def test_body_of_hundreds_of_metres_may_be_in_millimetres(length: float, is_warned: bool) -> None:
    found = sentences(
        f"geometry.parameters.length={length}", f"geometry.parameters.height={0.1 * length}"
    )
    assert [text for text in found if "mm" in text] == found and bool(found) == is_warned


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "normal", "is_warned"),
    [
        ("group='tip'", "[1.0, 0.0]", False),
        ("group='tip'", "[-1.0, 0.0]", True),
        ("group='tip'", "[0.0, -1.0]", False),
        ("plane={point=[0.5, 0.1], normal=[0.0, 1.0]}", "[0.0, 1.0]", False),
        ("plane={point=[0.5, 0.1], normal=[0.0, 1.0]}", "[0.0, -1.0]", True),
    ],
)
def test_normal_into_the_body_is_warned_on_the_boundary(
    place: str, normal: str, is_warned: bool
) -> None:
    key, _, value = place.partition("=")
    found = sentences(
        f"contacts.0={{{key}={value}, at='nodes', normal={normal}, friction=0.1, preload=1.0, "
        "normal_stiffness=1e4, tangential_stiffness=1e4}"
    )
    assert bool(found) == is_warned
    assert all("contacts[0].normal" in text for text in found)


def test_contact_of_a_section_inside_the_body_is_refused() -> None:
    with refusal(ErrorKind.PLACE, "contacts[0].group", names="'load'"):
        sentences(
            "contacts.0={group='load', at='nodes', normal=[-1.0, 0.0], friction=0.1, preload=1.0, "
            "normal_stiffness=1e4, tangential_stiffness=1e4}"
        )


@pytest.mark.parametrize(
    ("at", "normal", "is_warned"),
    [
        ([0.5, 0.1], [0.0, 1.0], False),
        ([0.5, 0.1], [0.0, -1.0], True),
        ([1.0, 0.1], [0.0, -1.0], True),  # at a corner
        ([0.5, 0.0], [0.0, 1.0], False),  # within the body
    ],
)
def test_normal_into_the_body_is_warned_at_a_node(
    at: list[float], normal: list[float], is_warned: bool
) -> None:
    found = sentences(
        f"contacts.0={{nearest={at}, normal={normal}, friction=0.1, preload=1.0, "
        "normal_stiffness=1e4, tangential_stiffness=1e4}"
    )
    assert bool(found) == is_warned
    assert all("contacts[0].normal" in text for text in found)


def test_stops_on_both_sides_of_a_place_are_plausible() -> None:
    key = "group='tip', at='centre', friction=0.1, normal_stiffness=1e4, tangential_stiffness=1e4"
    right, left = (f"{{{key}, gap=1e-4, normal=[{x}, 0.0]}}" for x in (1.0, -1.0))
    assert sentences(f"contacts=[{right}, {left}]") == []
    (found,) = sentences(f"contacts=[{left}, {right.replace('tip', 'load')}]")
    assert "contacts[0].normal" in found


def test_normal_into_the_body_is_warned_in_3d() -> None:
    shape = "geometry.cells='simplex'"
    assert sentences(shape, "contacts.0.normal=[1.0, 0.0, 0.0]", dimension=3) == []
    (found,) = sentences(shape, "contacts.0.normal=[-1.0, 0.0, 0.0]", dimension=3)
    assert "contacts[0].normal" in found


def test_failure_names_the_likely_cause() -> None:
    wrong = ("material.young=207000.0",)
    weight = {"acceleration": 1e5, "direction": [0.0, -1.0]}
    with pytest.raises(ConvergenceError) as caught:
        make_solid(beam_scene(2, wrong, loads=[weight], contacts=None, probe={"group": "tip"}))
    assert "Young's modulus in MPa" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("path", DEMOS[::3], ids=lambda path: path.stem)
def test_demos_are_plausible(path: Path) -> None:
    scene = read_scene(path)
    body = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED)
    assert not has_kind(body.warnings, NoteKind.IMPLAUSIBLE)
