"""Bodies that no support holds: rigid and elastic modes, bodies on springs, refusals."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from support import random_field, refusal

pytest.importorskip("dolfinx")
import dolfinx.mesh
from mpi4py import MPI

import fenicsrom
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.mesh import build_mesh, mesh_from_dolfinx
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.post.run.summary import summary
from fenicsrom.reduction.modes import component_modes
from fenicsrom.scene import Basis, parse_scene

STEEL = {"young": 2.1e11, "poisson": 0.0, "density": 7800.0}
SLENDER = {"length": 1.0, "height": 0.01, "elements_along": 48, "load_at": 0.5}


def plane_scene(**tables: Any) -> Any:
    """A free beam of 1 m x 10 mm in the plane."""
    geometry = {"mesh": "beam2d.geo", "dimension": 2, "thickness": 0.01, "parameters": SLENDER}
    table = {"geometry": geometry, "material": STEEL, "supports": [], "probe": {"group": "tip"}}
    return parse_scene(table | tables, "free.toml", Path.cwd(), unloaded=True)


def solid(scene: Any) -> Any:
    return solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), free=True)


def block_scene(**tables: Any) -> Any:
    geometry = {"mesh": "in_memory.msh", "dimension": 3}
    material = STEEL | {"poisson": 0.3}
    table = {"geometry": geometry, "material": material, "supports": [], "probe": {"group": "end"}}
    return parse_scene(table | tables, "free.toml", None, unloaded=True)


def block(move: Callable[[Any], Any] = np.array) -> Any:
    """The solid of a moved block of 0.3 x 0.2 x 0.1 m, with a spring between two corners."""
    corners = [np.zeros(3), np.array([0.3, 0.2, 0.1])]
    kind = dolfinx.mesh.CellType.hexahedron
    domain = dolfinx.mesh.create_box(MPI.COMM_SELF, corners, [3, 2, 1], kind)
    end = dolfinx.mesh.locate_entities_boundary(domain, 2, lambda x: x[0] < 1e-9)
    tags = dolfinx.mesh.meshtags(domain, 2, np.sort(end), np.ones(end.size, dtype=np.int32))
    domain.geometry.x[:] = move(domain.geometry.x)
    here, there = ({"node": np.ravel(move(x[None])).tolist()} for x in corners)
    scene = block_scene(attachments=[{**here, "to": there, "stiffness": 1e9}])
    return solid_of(scene, mesh_from_dolfinx(domain, tags, {"end": 1}), free=True)


def test_free_beam_has_the_frequencies_of_the_closed_forms() -> None:
    """Three rigid modes; cosh λ cos λ = 1 bends it, and f = c / 2L is the first axial mode.

    Reference: bending and axial modes of a free beam | closed form | 53.336 to 476.45; 2594.4 Hz |
    agree | 0.3 %; 1e-4
    """
    found = component_modes(solid(plane_scene()), Basis(modes=14))
    assert found.rigid == 3 and not found.omega[:3].any()
    roots = [brentq(lambda x: np.cos(x) - 1.0 / np.cosh(x), a, a + 2) for a in (4, 7, 10, 13)]
    speed = np.sqrt(2.1e11 / 7800.0)
    bending = np.square(roots) * speed * 0.01 / np.sqrt(12.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequencies_hz[3:7], bending, rtol=3e-3)
    assert np.abs(found.frequencies_hz / (speed / 2.0) - 1.0).min() < 1e-4


def test_free_body_has_the_same_modes_wherever_it_lies() -> None:
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0])
    here, there = block(), block(lambda x: np.add(turn.apply(x), [1.0, -3.0, 0.5]))
    found = [component_modes(body, Basis(modes=10)) for body in (here, there)]
    assert [modes.rigid for modes in found] == [6, 6]
    np.testing.assert_allclose(found[1].omega, found[0].omega, rtol=1e-9)
    products = here.mass_inner(found[0].normal, found[0].normal)
    np.testing.assert_allclose(products, np.eye(10), atol=1e-9)
    held = here.stiffness_times(found[0].normal[:, :6])
    assert np.abs(held).max() < 1e-9 * found[0].omega[6] ** 2


def test_inverse_of_a_free_body_solves_for_balanced_forces() -> None:
    """K K⁺ f = Pᵀ f, with the inertia forces of the rigid acceleration, and Rᵀ M K⁺ f = 0."""
    body = block()
    force = random_field(body, 1.0)[:, None]
    found = body.factor.solve(force)
    balanced = force - body.mass_times(body.rigid) @ (body.rigid.T @ force)
    np.testing.assert_allclose(body.stiffness_times(found), balanced, atol=1e-9)
    size = np.sqrt(body.mass_inner(found, found)[0, 0])
    assert np.abs(body.mass_inner(body.rigid, found)).max() < 1e-12 * size


def test_modes_of_a_free_body_name_the_rigid_ones(tmp_path: Path) -> None:
    """With modes = "auto" there are three elastic modes besides the rigid ones."""
    study = fenicsrom.modes(plane_scene(), folder=tmp_path)
    assert summary(study)["rigid_modes"] == 3 and study.frequencies_hz.size == 6
    assert (tmp_path / "report.html").read_text().count("0 (rigid)") == 3


def test_springs_to_the_ground_hold_a_body() -> None:
    """A stiff bar on two springs k: f = √(2k/m)/2π twice, and √3 times as much in rotation.

    Reference: stiff bar on two springs | closed form | 0.5033, 0.8717 Hz | agree | 0.1 %
    """
    springs = [{"group": group, "stiffness": 3.9} for group in ("root", "tip")]
    found = component_modes(solid(plane_scene(attachments=springs)), Basis(modes=3))
    assert found.rigid == 0
    own = np.sqrt(7.8 / 0.78) / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequencies_hz, own * np.sqrt([1.0, 1.0, 3.0]), rtol=1e-3)


FORCE = {"group": "tip", "direction": [0.0, 1.0], "force": 1.0, "frequency": 3.0}


@pytest.mark.parametrize(
    ("command", "tables"),
    [
        ("run", {"loads": [FORCE]}),
        ("modes", {"loads": [FORCE]}),
        ("response", {"loads": [FORCE], "response": {"first": 1.0, "last": 2.0}}),
        ("backbone", {"loads": [FORCE], "backbone": {"first": 1e-4, "last": 1e-3}}),
        ("campbell", {"rotation": {"speed_rpm": 100.0, "point": [0.0, 0.0]}}),
        ("statics", {"loads": [{k: v for k, v in FORCE.items() if k != "frequency"}]}),
        ("build_model", {"time": {"duration": 1.0, "step": 0.01}}),
    ],
)
def test_command_in_which_a_free_body_drifts_is_refused(command: str, tables: Any) -> None:
    with refusal(ErrorKind.SUPPORT, "supports", file="free.toml"):
        getattr(fenicsrom, command)(plane_scene(**tables))


def test_stresses_of_a_body_without_supports_are_refused() -> None:
    with refusal(ErrorKind.CONFLICT, "output.stresses"):
        plane_scene(output={"stresses": "cauchy"})


def test_free_lap_joint_is_the_same_in_small_and_large_displacements() -> None:
    """The bolts stiffen the joint by their tension, and the press of the strips takes it away."""
    tables = tomllib.loads(Path("demos/lap_joint.toml").read_text())
    found = []
    for nonlinear in (False, True):
        table = tables | {"supports": [], "loads": [], "geometrically_nonlinear": nonlinear}
        study = fenicsrom.modes(parse_scene(table, "lap.toml", Path.cwd(), unloaded=True))
        assert study.modes.rigid == 3 and not study.contact_hz[:3].any()
        assert (study.contact_hz[3:, 1] > study.contact_hz[3:, 0]).all()
        found.append(study.frequencies_hz)
    np.testing.assert_allclose(found[1], found[0], rtol=3e-5)
