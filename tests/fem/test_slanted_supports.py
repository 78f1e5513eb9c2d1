"""Supports along slanted directions, against turned bodies and component supports."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.typing import NDArray
from support import _SCENES, beam_scene, needs_mpirun, on_ranks, random_field, refusal, scene_of

pytest.importorskip("dolfinx")

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.full.full import full_model
from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.reaction_rows import reaction_table
from fenicsrom.fem.solid.solid import solid_of
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.stress.reactions import equilibrium_reactions
from fenicsrom.reduction.modes import component_modes
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Basis

Array = NDArray[np.float64]

ANGLE = np.radians(30.0)
SIZES = ("length=1.0", "height=0.05", "elements_along=6", "load_at=0.5")


def turn(dimension: int, angle: float) -> Array:
    """A rotation about z, in space after one about x."""
    c, s = np.cos(angle), np.sin(angle)
    about_z = np.eye(dimension)
    about_z[:2, :2] = [[c, -s], [s, c]]
    if dimension == 2:
        return about_z
    return about_z @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def turned(
    angle: float,
    supports: list[dict[str, Any]],
    *overrides: str,
    dimension: int = 2,
    sizes: tuple[str, ...] = SIZES,
    **tables: Any,
) -> Any:
    """A beam turned by an angle; nodes, normals and directions are given for the beam along x."""
    rotation = turn(dimension, angle)

    def moved(table: dict[str, Any]) -> dict[str, Any]:
        keys = [key for key in ("node", "nearest", "normal", "direction") if key in table]
        return table | {
            k: (rotation @ table[k]).tolist() for k in keys if len(table[k]) == dimension
        }

    parameters = tuple(f"geometry.parameters.{size}" for size in sizes)
    thickness = ("geometry.thickness=0.05",) if dimension == 2 else ()
    given = {
        "loads": [],
        "contacts": None,
        "probe": {"group": "tip"},
        "supports": supports,
    } | tables
    given = {
        name: [moved(entry) for entry in table] if isinstance(table, list) else table
        for name, table in given.items()
    }
    scene = beam_scene(dimension, (*parameters, *thickness, *overrides), **given)
    mesh = build_mesh(scene.geometry, MPI.COMM_WORLD)
    x = mesh.domain.geometry.x
    x[:, :dimension] = x[:, :dimension] @ rotation.T
    solid = solid_of(scene, mesh)
    _SCENES[solid] = scene
    return solid


def frequencies(solid: Any, count: int = 4) -> Array:
    """The lowest angular frequencies, rad/s."""
    return np.asarray(component_modes(solid, Basis(modes=count)).omega[:count])


HINGE = {"node": [0.0, 0.0]}
ROLLER = {"node": [1.0, 0.0], "components": ["y"]}
SLANTED_ROLLER = {"node": [1.0, 0.0], "normal": [0.0, 1.0]}
MASS = [{"node": [1.0, 0.0], "mass": 0.3, "stiffness": 2e5}]


def test_turned_solid_between_planes_has_the_frequencies_of_the_solid() -> None:
    """In space: a face that slides in its plane, and an edge of nodes held in two directions."""
    sizes = ("length=1", "height=0.2", "width=0.15", "elements_along=2", "load_at=0.5")

    def solid(angle: float, *supports: dict[str, Any]) -> Any:
        return turned(angle, list(supports), dimension=3, sizes=sizes)

    corner = [0.0, -0.1, -0.075]
    flat = solid(
        0.0,
        {"group": "root", "components": ["x"]},
        {"group": "tip", "components": ["y", "z"]},
        {"node": corner, "components": ["y", "z"]},
    )
    up, across = [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]
    slanted = solid(
        ANGLE,
        {"group": "root", "normal": [1.0, 0.0, 0.0]},
        {"group": "tip", "normal": up},
        {"group": "tip", "normal": across},
        {"node": corner, "normal": up},
        {"node": corner, "normal": across},
    )
    assert slanted.free == flat.free
    np.testing.assert_allclose(frequencies(slanted), frequencies(flat), rtol=1e-9)


def test_half_model_at_a_slanted_plane_has_the_symmetric_modes_of_the_whole() -> None:
    clamps = [{"group": "root"}, {"group": "tip"}]
    probe = {"group": "load"}
    sizes = ("length=1.0", "height=0.05", "elements_along=8", "load_at=0.25")
    whole = frequencies(turned(0.0, clamps, sizes=sizes, probe=probe), 3)
    sizes = ("length=0.5", "height=0.05", "elements_along=4", "load_at=0.5")
    plane = {"group": "tip", "normal": [1.0, 0.0]}
    slanted = turned(ANGLE, [{"group": "root"}, plane], sizes=sizes, probe=probe)
    np.testing.assert_allclose(frequencies(slanted, 2), whole[[0, 2]], rtol=1e-9)


def test_two_slanted_rollers_at_a_node_are_a_hinge() -> None:
    hinges = [HINGE, {"node": [1.0, 0.0]}]
    load = {"group": "load", "at": "centre", "direction": [0.3, -1.0], "force": 2e4}
    flat = turned(0.0, hinges, loads=[load])
    first, second = np.array([0.6, 0.8]), np.array([-1.0, 0.0])
    rollers = [{"node": [1.0, 0.0], "normal": n.tolist()} for n in (first, second)]
    slanted = turned(ANGLE, [HINGE, *rollers], loads=[load])
    rotation = turn(2, ANGLE)
    expected = flat.equilibrium.reshape(-1, 2) @ rotation.T
    np.testing.assert_allclose(
        slanted.equilibrium.reshape(-1, 2), expected, atol=1e-9 * np.abs(expected).max()
    )
    # each roller pushes along its normal; together they push as the hinge does
    both, split = (reactions(solid).values[0, :, :2] for solid in (flat, slanted))
    np.testing.assert_allclose(split[1] + split[2], rotation @ both[1], rtol=1e-8)
    for force, normal in ((split[1], first), (split[2], second)):
        along = rotation @ normal
        assert abs(along[0] * force[1] - along[1] * force[0]) < 1e-9 * np.linalg.norm(force)


def reactions(solid: Any) -> Any:
    """Forces and moments of the supports at the equilibrium."""
    table = reaction_table(solid, scene_of(solid), np.zeros((solid.local, 0)))
    return equilibrium_reactions(table, scene_of(solid))


@pytest.mark.parametrize("follower", [False, True])
def test_equilibrium_on_a_slanted_roller_is_that_of_the_turned_beam(follower: bool) -> None:
    """In large displacements, under a force, and a pressure that follows the tip; the reactions are
    computed without the pressure only."""
    push = {"group": "tip", "pressure": 2e7, "follower": True}
    bend = {"group": "load", "at": "centre", "direction": [0.0, -1.0], "force": 4e5}
    flat, slanted = (
        turned(angle, [{"group": "root"}, roller], loads=[bend, push][: 1 + follower])
        for angle, roller in ((0.0, ROLLER), (ANGLE, SLANTED_ROLLER))
    )
    rotation, u = turn(2, ANGLE), flat.equilibrium.reshape(-1, 2)
    assert np.abs(u).max() > 0.02
    np.testing.assert_allclose(
        slanted.equilibrium.reshape(-1, 2), u @ rotation.T, atol=1e-9 * np.abs(u).max()
    )
    np.testing.assert_allclose(frequencies(slanted), frequencies(flat), rtol=1e-8)
    if not follower:
        one, other = reactions(flat).values[0, :, :2], reactions(slanted)
        np.testing.assert_allclose(other.values[0, :, :2], one @ rotation.T, atol=1e-8 * 4e5)
        assert other.mismatch < 1e-8


@pytest.mark.slow
def test_motion_on_a_slanted_roller_is_that_of_the_turned_beam() -> None:
    """Full and reduced model, with damping of all kinds, in a rotating frame."""
    load = {
        "group": "load",
        "at": "centre",
        "direction": [0.0, 1.0],
        "force": 3e4,
        "frequency": 60.0,
    }
    run = ("time.periods=1", "time.steps_per_period=40", "time.steady_tolerance=0.0")
    found = {}
    for name, angle, roller in (("flat", 0.0, ROLLER), ("slanted", ANGLE, SLANTED_ROLLER)):
        solid = turned(
            angle,
            [{"group": "root"}, roller],
            *run,
            "basis.modes=3",
            "basis.derivatives='all'",
            loads=[load],
            damping={"stiffness": 1e-5, "ratios": 0.02, "modes": 2},
            rotation={"speed_rpm": 300.0, "coriolis": True},
            probe={"group": "load", "at": "centre"},
        )
        scene = scene_of(solid)
        reduced = Reduction(solid, scene, lambda name: nullcontext()).model
        found[name] = [simulate(model, scene) for model in (full_model(solid), reduced)]
    rotation = turn(2, ANGLE)
    for one, other in zip(found["flat"], found["slanted"], strict=True):
        x, y = one.displacement[:, 0] @ rotation.T, other.displacement[:, 0]
        assert np.abs(x).max() > 1e-3
        np.testing.assert_allclose(y, x, atol=1e-7 * np.abs(x).max())
    full, reduced = (motion.displacement for motion in found["slanted"])
    assert np.abs(full - reduced).max() < 0.02 * np.abs(full).max()


def test_tangent_and_mass_are_those_of_the_projected_unknowns() -> None:
    solid = turned(ANGLE, [{"group": "root"}, SLANTED_ROLLER], attachments=MASS)
    u, x = random_field(solid, 0.01), random_field(solid, 0.01, 1)
    held = np.array(x)
    solid.without_held(x)
    assert 0.0 < np.abs(held - x).max()
    solid.without_held(u)
    step = 1e-4
    change = solid.internal_force(u + step * x) - solid.internal_force(u - step * x)
    expected = change / (2.0 * step)
    np.testing.assert_allclose(
        solid.tangent_times(u, x[:, None])[:, 0], expected, atol=1e-7 * np.abs(expected).max()
    )
    np.testing.assert_allclose(solid.mass_times(held), solid.mass_times(x), atol=1e-15)


def test_body_that_slides_on_a_slanted_support_is_refused() -> None:
    with refusal(ErrorKind.SUPPORT, "supports"):
        turned(0.0, [{"group": "root", "normal": [1.0, 0.1]}])


def test_contact_point_on_a_slanted_roller_is_refused() -> None:
    contact = {
        "nearest": [1.0, 0.0], "normal": [1.0, 0.0], "preload": 1.0, "friction": 0.5,
        "normal_stiffness": 1e4, "tangential_stiffness": 1e4,
    }  # fmt: skip
    with refusal(ErrorKind.PLACE, "contacts[0]"):
        turned(
            ANGLE,
            [{"group": "root"}, SLANTED_ROLLER],
            contacts=[contact],
            probe=None,
            loads=[{"acceleration": 1.0, "frequency": 3.2, "direction": [0.0, 1.0]}],
        )


PARALLEL = """
from mpi4py import MPI
from test_slanted_supports import ANGLE, HINGE, MASS, SLANTED_ROLLER, frequencies, turned
solid = turned(ANGLE, [HINGE, SLANTED_ROLLER], attachments=MASS)
omega = frequencies(solid, 2)
if MPI.COMM_WORLD.rank == 0:
    print(solid.free, *omega)
"""


@pytest.mark.slow
@needs_mpirun
def test_slanted_nodes_are_found_on_two_ranks() -> None:
    one = turned(ANGLE, [HINGE, SLANTED_ROLLER], attachments=MASS)
    free, *omega = on_ranks(2, "-c", PARALLEL).stdout.split()
    assert int(free) == one.free
    np.testing.assert_allclose([float(w) for w in omega], frequencies(one, 2), rtol=1e-8)
