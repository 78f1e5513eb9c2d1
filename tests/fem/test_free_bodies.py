"""Bodies that no support holds: rigid and elastic modes, motions, bodies on springs, refusals."""

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
from fenicsrom.reduction.interface import dissipated
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.snapshots import linear_model
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


def block(move: Callable[[Any], Any] = np.array, **tables: Any) -> Any:
    """The solid of a moved block of 0.3 x 0.2 x 0.1 m, with a spring between two corners."""
    corners = [np.zeros(3), np.array([0.3, 0.2, 0.1])]
    kind = dolfinx.mesh.CellType.hexahedron
    domain = dolfinx.mesh.create_box(MPI.COMM_SELF, corners, [3, 2, 1], kind)
    end = dolfinx.mesh.locate_entities_boundary(domain, 2, lambda x: x[0] < 1e-9)
    tags = dolfinx.mesh.meshtags(domain, 2, np.sort(end), np.ones(end.size, dtype=np.int32))
    domain.geometry.x[:] = move(domain.geometry.x)
    here, there = ({"node": np.ravel(move(x[None])).tolist()} for x in corners)
    scene = block_scene(attachments=[{**here, "to": there, "stiffness": 1e9}], **tables)
    return solid_of(scene, mesh_from_dolfinx(domain, tags, {"end": 1}), free=True)


def test_free_beam_has_the_frequencies_of_the_closed_forms() -> None:
    """Besides three rigid modes, cosh λ cos λ = 1 bends it, and f = c / 2L is the first axial mode.

    Reference: bending and axial modes of a free beam | closed form | 53.336 to 476.45; 2594.4 Hz |
    agree | 0.3 %; 1e-4
    """
    body = solid(plane_scene())
    assert body.rigid.shape[1] == 3
    found = component_modes(body, Basis(modes=11))
    roots = [brentq(lambda x: np.cos(x) - 1.0 / np.cosh(x), a, a + 2) for a in (4, 7, 10, 13)]
    speed = np.sqrt(2.1e11 / 7800.0)
    bending = np.square(roots) * speed * 0.01 / np.sqrt(12.0) / (2.0 * np.pi)
    np.testing.assert_allclose(found.frequencies_hz[:4], bending, rtol=3e-3)
    assert np.abs(found.frequencies_hz / (speed / 2.0) - 1.0).min() < 1e-4


def test_free_body_has_the_same_modes_wherever_it_lies() -> None:
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0])
    here, there = block(), block(lambda x: np.add(turn.apply(x), [1.0, -3.0, 0.5]))
    found = [component_modes(body, Basis(modes=4), body.rigid) for body in (here, there)]
    assert [modes.rigid for modes in found] == [6, 6]
    assert found[0].labels[4:8] == ("5R", "6R", "1V", "2V")
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


STATIC = {"group": "tip", "direction": [0.0, 1.0], "force": 1.0}
FORCE, LINEAR = STATIC | {"frequency": 3.0}, {"geometrically_nonlinear": False}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "tables"),
    [
        ("run", {"loads": [FORCE]}),
        ("modes", {"loads": [STATIC]}),
        ("run", LINEAR | {"loads": [FORCE, STATIC]}),
        ("response", {"loads": [FORCE], "response": {"first": 1.0, "last": 2.0}}),
        ("backbone", {"loads": [FORCE], "backbone": {"first": 1e-4, "last": 1e-3}}),
        ("campbell", {"rotation": {"speed_rpm": 100.0, "point": [0.0, 0.0]}}),
        ("compare", LINEAR | {"loads": [FORCE]}),
        ("statics", {"loads": [STATIC]}),
        ("build_model", {"time": {"duration": 1.0, "step": 0.01}}),
        ("run", LINEAR | {"loads": [FORCE], "attachments": [{"group": "tip", "damping": 1.0}]}),
    ],
)
def test_command_in_which_a_free_body_drifts_is_refused(command: str, tables: Any) -> None:
    with refusal(ErrorKind.SUPPORT, "supports", file="free.toml"):
        getattr(fenicsrom, command)(plane_scene(**tables))


def test_load_that_deforms_nothing_is_refused() -> None:
    weight = {"acceleration": 1.0, "direction": [0.0, 1.0], "frequency": 3.0}
    with refusal(ErrorKind.SUPPORT, "loads[0]", file="free.toml"):
        fenicsrom.run(plane_scene(**LINEAR, loads=[weight]))


def test_force_on_the_end_of_a_free_bar_moves_it_as_the_closed_form() -> None:
    """u(L) = −F cot(kL)/EAk of EA (u″ + k² u) = 0, less the rigid motion −F/(m s), EA k² = ρA s.

    With the damping α the factor is s = ω² − iαω.

    Reference: free bar under a harmonic force | closed form | – | agrees | 0.1 %
    """
    force, alpha, hertz = 1e4, 500.0, 2000.0
    load = {"group": "tip", "direction": [1.0, 0.0], "force": force, "frequency": hertz}
    material, time = STEEL | {"mass_damping": alpha}, {"steps_per_period": 400}
    scene = plane_scene(**LINEAR, loads=[load], material=material, time=time)
    motion = fenicsrom.build_model(scene).simulate()
    omega, area = 2.0 * np.pi * hertz, 1e-4
    s = omega**2 - 1j * alpha * omega
    k = np.sqrt(7800.0 / 2.1e11 * s)
    exact = -force / (2.1e11 * area * k * np.tan(k)) + force / (7800.0 * area * s)
    assert fenicsrom.amplitudes(motion)["normal"] == pytest.approx(abs(exact), rel=1e-3)


@pytest.mark.slow
def test_backbone_of_a_free_beam_is_its_first_mode() -> None:
    """The first elastic mode is number 1: f of the closed form at any amplitude, ζ = α/2ω."""
    tables = {"loads": [FORCE], "backbone": {"first": 1e-4, "last": 1e-3}}
    found = fenicsrom.backbone(
        plane_scene(**LINEAR, **tables, material=STEEL | {"mass_damping": 2.0})
    )
    frequency = np.array([point.frequency for point in found.points])
    ratio = np.array([point.damping_ratio for point in found.points])
    np.testing.assert_allclose(frequency, 53.336, rtol=5e-4)
    np.testing.assert_allclose(ratio, 1.0 / (2.0 * np.pi * frequency), rtol=1e-10)


def test_reduced_model_of_a_free_body_is_the_same_wherever_it_lies() -> None:
    """Its stiffness is regular, and its load does the same work on it."""
    turn = Rotation.from_rotvec([0.3, -1.0, 2.0])
    found = []
    for move, axes in (
        (np.array, np.eye(3)),
        (lambda x: np.add(turn.apply(x), [1.0, -3.0, 0.5]), turn.as_matrix()),
    ):
        direction = (axes @ [0.6, 0.8, 0.0]).tolist()
        body = block(move, loads=[{**FORCE, "group": "end", "direction": direction}])
        model = linear_model(body, component_modes(body, Basis(modes=4))).model
        load, stiffness = model.loads[:, 0], model.elastic.stiffness
        moved = [np.linalg.solve(stiffness - s * model.mass, load) for s in (0.0, 1e8)]
        found.append([load @ each for each in moved])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-11)


@pytest.mark.slow
def test_free_lap_joint_dissipates_as_its_full_model() -> None:
    """A blow on the end: the friction and the motion of the end in 20 ms, all unknowns beside."""
    tables = tomllib.loads(Path("demos/lap_joint.toml").read_text())
    tables |= LINEAR | {"supports": [], "time": {"duration": 0.02, "step": 1e-4}}
    tables |= {"reference": {"full": True}}
    study = fenicsrom.run(parse_scene(tables, "lap.toml", Path.cwd()))
    reduced, full = study.motions["reduced"], study.motions["full"]
    exact = np.interp(reduced.time, full.time, full.probe[:, 1])
    assert np.linalg.norm(reduced.probe[:, 1] - exact) < 1.4e-3 * np.linalg.norm(exact)
    assert dissipated(reduced) == pytest.approx(dissipated(full), rel=8e-3)


def test_stresses_of_a_body_without_supports_are_refused() -> None:
    with refusal(ErrorKind.CONFLICT, "output.stresses"):
        plane_scene(output={"stresses": "cauchy"})


@pytest.mark.slow
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
