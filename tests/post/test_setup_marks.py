"""What the picture of the set-up marks, from scenes on small meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import beam_scene

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
from fenicsrom.post.setup.setup import Mark, gathered_marks

SMALL = (
    "geometry.parameters.length=1.0",
    "geometry.parameters.height=0.1",
    "geometry.parameters.elements_along=8",
    "geometry.parameters.load_at=0.5",
)
TOP = {"point": [0.0, 0.05], "normal": [0.0, 1.0]}


def marks(scene: Any, known: Any = UNDEFORMED) -> tuple[dict[str, list[Mark]], Any]:
    """The marks of a scene by their kinds, and the points of its body."""
    solid = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), known)
    found = gathered_marks(solid, scene, {})
    assert found is not None
    kinds: dict[str, list[Mark]] = {}
    for mark in found[2]:
        kinds.setdefault(mark.kind, []).append(mark)
    return kinds, found[0].points


@pytest.mark.slow
def test_follower_pressure_is_marked_on_the_undeformed_face_up_to_the_supports() -> None:
    """15 MPa turn the face of the equilibrium by several degrees."""
    load = {"plane": TOP, "pressure": 1.5e7, "follower": True}
    scene = beam_scene(2, SMALL, contacts=None, loads=[load])
    for known in (UNDEFORMED, None):
        found, points = marks(scene, known)
        (mark,) = found["load"]
        np.testing.assert_allclose(mark.ways[0], [0.0, -1.0, 0.0], atol=1e-12)
        assert mark.places[0, 1] == pytest.approx(0.05)
        np.testing.assert_array_equal(mark.on, np.abs(points[:, 1] - 0.05) < 1e-9)
        assert mark.label == "follower pressure, 1.5e+07 Pa, static"


def test_axis_of_rotation_has_the_sense_of_the_speed() -> None:
    speed = -30.0
    turning = {"speed_rpm": speed, "axis": [0.0, 3.0, 0.0], "point": [-0.3, 0.0, 0.1]}
    found, _ = marks(beam_scene(3, SMALL, contacts=None, probe={"group": "tip"}, rotation=turning))
    (axis,) = found["rotation"]
    assert axis.label == "axis of rotation, 30 rpm"
    np.testing.assert_allclose(axis.ways, [[0.0, np.sign(speed), 0.0]])
    np.testing.assert_allclose(axis.places, [[-0.3, 0.0, 0.1]])


def test_round_wall_is_marked_and_a_plane_is_not() -> None:
    friction = {"normal_stiffness": 1e4, "tangential_stiffness": 1e4, "friction": 0.5}
    casing = {"kind": "cylinder", "point": [0.0, 0.0]}
    contacts = [
        {"group": "tip", "at": "nodes", "normal": [1.0, 0.0], "preload": 5e5, **friction},
        {"plane": TOP, "at": "nodes", "surface": casing, "gap": 1e-3, **friction},
    ]
    found, _ = marks(beam_scene(2, SMALL, contacts=contacts))
    first, second = found["contact"]
    labels = ["contact 1, preload 500000 N per m² of facets", "contact 2, gap 1 mm"]
    assert [first.label, second.label] == labels
    assert first.wall is None
    assert second.wall is not None
    assert (
        np.linalg.norm(second.wall.points, axis=1).min()
        > np.linalg.norm(second.places, axis=1).max()
    )


def test_attachments_loads_and_contacts_are_marked_at_their_places() -> None:
    loads = [
        {"group": "load", "direction": [0.0, 1.0], "force": -5.0},
        {"support_acceleration": 2.0, "direction": [0.0, 1.0], "frequency": 3.0},
    ]
    attachments = [
        {"group": "tip", "stiffness": 3.0, "damping": 2.0},
        {"nearest": [0.51, 0.06], "mass": 0.25},
        {"group": "tip", "stiffness_per_area": 2.0, "components": ["y"]},
    ]
    supports = [{"group": "root"}, {"node": [0.5, -0.05], "components": ["y"]}]
    scene = beam_scene(2, SMALL, loads=loads, attachments=attachments, supports=supports)
    found, _ = marks(scene)
    assert [mark.label for mark in found["attachment"]] == [
        "spring, 3 N/m in each direction",
        "dashpot, 2 N s/m in each direction",
        "mass, 0.25 kg",
        "spring, 2 N/m per m² of facets along y",
    ]
    places = [mark.places[0] for mark in found["attachment"]]
    np.testing.assert_allclose(places[:3], [[1, 0, 0], [1, 0, 0], [0.5, 0.05, 0]], atol=1e-9)
    force, shaken = found["load"]
    assert force.ways[0] @ [0.0, 1.0, 0.0] == -1.0
    assert shaken.label == "2: support acceleration, 2 m/s², 3 Hz" and len(shaken.places) == 2
    np.testing.assert_allclose(shaken.places, [[0, 0, 0], [0.5, -0.05, 0]], atol=1e-9)
    (contact,) = found["contact"]
    np.testing.assert_allclose(contact.ways, [[1.0, 0.0, 0.0]])
    assert contact.label == "contact, preload 40 N"
    assert "probe" not in found  # the motion is read at the contact
