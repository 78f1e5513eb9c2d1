"""What the picture of the set-up marks, from scenes on small meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STEEL, beam_scene

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
from fenicsrom.post.body.body_surface import gathered_grid
from fenicsrom.post.setup.setup_marks import CLAMPED, Marks, marked, marks_of
from fenicsrom.scene import make_scene

SMALL = (
    "geometry.parameters.length=1.0",
    "geometry.parameters.height=0.1",
    "geometry.parameters.elements_along=8",
    "geometry.parameters.load_at=0.5",
)
TOP = {"point": [0.0, 0.05], "normal": [0.0, 1.0]}


def marks(scene: Any, known: Any = UNDEFORMED) -> tuple[Marks, Any]:
    """The marks of a scene and the points of its body."""
    solid = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), known)
    regions = marked(solid, scene)
    fields = {name: solid.field(values) for name, values in regions.fields.items()}
    found = gathered_grid(solid.space, fields)
    assert found is not None
    grid, values = found
    return marks_of(solid, scene, regions, grid.points, values), grid.points


def test_follower_pressure_is_marked_on_the_undeformed_face_up_to_the_supports() -> None:
    """15 MPa turn the face of the equilibrium by several degrees."""
    load = {"plane": TOP, "pressure": 1.5e7, "follower": True}
    scene = beam_scene(2, SMALL, contacts=None, loads=[load])
    for known in (UNDEFORMED, None):
        found, points = marks(scene, known)
        (mark,) = found.loads
        np.testing.assert_allclose(mark.direction, [0.0, -1.0, 0.0], atol=1e-12)
        assert mark.places[0, 1] == pytest.approx(0.05)
        np.testing.assert_array_equal(mark.on, np.abs(points[:, 1] - 0.05) < 1e-9)
        assert mark.label == "follower pressure, 1.5e+07 Pa, static"


def test_supports_that_hold_the_same_are_one_mark() -> None:
    supports = [
        {"group": "root"},
        {"group": "tip", "normal": [0.6, 0.8]},
        {"node": [0.5, -0.05], "components": ["y"]},
        {"node": [0.25, -0.05], "components": ["y"]},
    ]
    found, points = marks(beam_scene(2, SMALL, contacts=None, supports=supports))
    clamped, slanted, roller = found.supports
    assert clamped.label == CLAMPED and not len(clamped.directions)
    assert slanted.label == "held along (0.6, 0.8)" and roller.label == "held along y"
    np.testing.assert_allclose(slanted.directions, [[0.6, 0.8, 0.0]])
    np.testing.assert_array_equal(slanted.on, points[:, 0] > 0.999)
    assert roller.on.sum() == 2


@pytest.mark.parametrize("speed", [-30.0, 30.0])
def test_axis_of_rotation_has_the_sense_of_the_speed(speed: float) -> None:
    turning = {"speed_rpm": speed, "axis": [0.0, 3.0, 0.0], "point": [-0.3, 0.0, 0.1]}
    found, _ = marks(beam_scene(3, SMALL, contacts=None, probe={"group": "tip"}, rotation=turning))
    assert found.rotation is not None and found.rotation.speed_rpm == 30.0
    np.testing.assert_allclose(found.rotation.axis, [0.0, np.sign(speed), 0.0])
    np.testing.assert_allclose(found.rotation.point, [-0.3, 0.0, 0.1])


def test_points_of_all_contacts_are_numbered_in_one_row() -> None:
    """A casing has lines, and a plane has none."""
    friction = {"normal_stiffness": 1e4, "tangential_stiffness": 1e4, "friction": 0.5}
    casing = {"kind": "cylinder", "point": [0.0, 0.0]}
    contacts = [
        {"group": "tip", "at": "nodes", "normal": [1.0, 0.0], "preload": 5e5, **friction},
        {"plane": TOP, "at": "nodes", "surface": casing, "gap": 1e-3, **friction},
    ]
    found, _ = marks(beam_scene(2, SMALL, contacts=contacts))
    first, second = found.contacts
    assert first.label == "contact 1, preload 500000 Pa" and second.label == "contact 2, gap 1 mm"
    assert first.first == 1 and second.first == 1 + len(first.places) and first.wall is None
    assert second.wall is not None
    assert (
        np.linalg.norm(second.wall.points, axis=1).min()
        > np.linalg.norm(second.places, axis=1).max()
    )


BOX = """\
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {1, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve {1, 2, 3, 4} = 2; Transfinite Surface {1}; Recombine Surface {1};
v() = Extrude {0, 0, 1} { Surface{1}; Layers{1}; Recombine; };
Physical Volume("solid") = {v(1)}; Physical Surface("root") = {v(0)};
Physical Surface("base") = {1}; Physical Curve("edge") = {1}; Physical Point("corner") = {1};
"""


@pytest.mark.parametrize(
    ("group", "unit"), [("base", "N/m³"), ("edge", "N/m²"), ("corner", "N/m per node")]
)
def test_stiffness_per_area_has_the_unit_of_its_region(
    group: str, unit: str, tmp_path: Path
) -> None:
    (tmp_path / "box.geo").write_text(BOX)
    attachment = {"group": group, "stiffness_per_area": 2.0, "damping_per_area": 3.0}
    scene = make_scene(
        folder=tmp_path,
        geometry={"mesh": "box.geo", "dimension": 3, "degree": 1},
        material=STEEL,
        supports=[{"group": "root"}],
        loads=[{"group": "base", "direction": [1.0, 0.0, 0.0], "force": 1.0, "frequency": 1.0}],
        attachments=[attachment],
        probe={"group": "base"},
    )
    found, _ = marks(scene)
    assert [mark.label for mark in found.attachments] == [
        f"spring, 2 {unit} in each direction",
        f"dashpot, 3 {unit.replace('N', 'N s')} in each direction",
    ]


def test_attachments_loads_and_contacts_are_marked_at_their_places() -> None:
    loads = [
        {"group": "load", "direction": [0.0, 1.0], "force": -5.0},
        {"support_acceleration": 2.0, "direction": [0.0, 1.0], "frequency": 3.0},
    ]
    attachments = [
        {"group": "tip", "stiffness": 3.0, "damping": 2.0},
        {"nearest": [0.51, 0.06], "mass": 0.25},
    ]
    supports = [{"group": "root"}, {"node": [0.5, -0.05], "components": ["y"]}]
    scene = beam_scene(2, SMALL, loads=loads, attachments=attachments, supports=supports)
    found, _ = marks(scene)
    assert [(mark.kind, mark.label) for mark in found.attachments] == [
        ("spring", "spring, 3 N/m in each direction"),
        ("dashpot", "dashpot, 2 N s/m in each direction"),
        ("mass", "mass, 0.25 kg"),
    ]
    places = [mark.place for mark in found.attachments]
    np.testing.assert_allclose(places, [[1, 0, 0], [1, 0, 0], [0.5, 0.05, 0]], atol=1e-9)
    force, shaken = found.loads
    assert force.direction @ [0.0, 1.0, 0.0] == -1.0
    assert shaken.label == "support acceleration, 2 m/s², 3 Hz" and len(shaken.places) == 2
    np.testing.assert_allclose(shaken.places, [[0, 0, 0], [0.5, -0.05, 0]], atol=1e-9)
    (contact,) = found.contacts
    np.testing.assert_allclose(contact.normals, [[1.0, 0.0, 0.0]])
    assert contact.label == "contact, preload 40 N"
    assert found.probe is None  # the motion is read at the contact
