"""The meshes of rigid surfaces lie on the surfaces of the contact law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import frame, penetration, surface_normal
from fenicsrom.post.body.surface_mesh import surface_grid
from fenicsrom.scene import Scene

RUBBING = {"group": "tip", "normal_stiffness": 1e4, "tangential_stiffness": 1e4, "friction": 0.5}
TURNED = {"kind": "cylinder", "point": [-0.3, 0.1, 0.2], "axis": [0.2, 1.0, 0.1]}
SURFACES: dict[str, tuple[int, dict[str, Any]]] = {
    "wall": (3, {"normal": [1.0, 0.5, 0.0], "gap": 0.02}),
    "wall in 2D": (2, {"normal": [1.0, 0.5], "gap": 0.02, "approach": [[0.0, 0.0], [1.0, 0.01]]}),
    "casing": (
        3,
        {
            "surface": TURNED | {"waves": [[2, 2e-3, 0.3], [5, 1e-3, 0.0]], "spin": 3.0},
            "gap": 0.01,
            "approach": [[0.0, 0.0], [1.0, 0.004]],
        },
    ),
    "shaft inside": (3, {"surface": TURNED | {"inside": False}, "gap": 0.01}),
    "circle": (
        2,
        {"surface": {"kind": "cylinder", "point": [0.0, 0.1], "waves": [[3, 1e-3, 0.2]]}},
    ),
    "ball": (
        3,
        {
            "surface": {"kind": "sphere", "point": [0.5, 0.1, 0.0]},
            "gap": 0.01,
            "approach": [[0.0, 0.0], [1.0, 0.004]],
        },
    ),
}


def opposite(scene: Scene, places: Any) -> ContactPoints:
    """Contact points at some places of the first contact."""
    position, contact = np.array(places, float), scene.contacts[0]
    frames = [frame(surface_normal(contact, place, "test: contacts[0]")) for place in position]
    count = len(position)
    return ContactPoints(np.zeros(count, np.int64), np.ones(count), position, np.array(frames))


@pytest.mark.parametrize("name", SURFACES)
def test_penetration_is_zero_on_the_mesh_of_the_surface(name: str) -> None:
    dimension, contact = SURFACES[name]
    scene = beam_scene(dimension, contacts=[RUBBING | contact])
    places = np.array([[1.0, 0.0, 0.0], [1.0, 0.02, 0.0], [1.0, 0.01, 0.03]])[:, :dimension]
    if name.startswith("wall"):
        places = places[:1]  # each point of a wall has its own plane at the gap
    points, time = opposite(scene, places), 0.4
    grid = surface_grid(scene, points, 0, time)
    contacts = contacts_of(scene, points)
    assert grid.points.shape[1] == 3 and grid.cells.max() == len(grid.points) - 1
    size = float(np.ptp(grid.points, axis=0).max())
    for p, place in enumerate(places):
        moved = (grid.points[:, :dimension] - place) @ points.frame[p].T
        depths = np.array([penetration(contacts, p, x, time) for x in moved])
        np.testing.assert_allclose(depths, 0.0, atol=1e-12 * size)


def test_casing_follows_its_waves_and_covers_its_points() -> None:
    scene = beam_scene(3, contacts=[RUBBING | SURFACES["casing"][1]])
    points = opposite(scene, [[1.0, 0.0, 0.0], [1.0, 0.3, 0.0]])
    early, late = (surface_grid(scene, points, 0, time).points for time in (0.0, 0.5))
    assert np.abs(early - late).max() > 1e-3
    axis = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])
    heights = points.position @ axis
    assert (early @ axis).min() < heights.min() and (early @ axis).max() > heights.max()


@pytest.mark.parametrize("name", ["wall", "wall in 2D", "casing"])
def test_surface_covers_the_path_of_its_points(name: str) -> None:
    """The points slide by 0.7 in the first tangent, far beyond the surface at rest."""
    dimension, contact = SURFACES[name]
    scene = beam_scene(dimension, contacts=[RUBBING | contact])
    points = opposite(scene, [[1.0, 0.0, 0.0][:dimension]])
    along = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])  # the axis of the casing
    if name != "casing":
        along = points.frame[0, 1]
    slid = 0.7 * points.frame[0] @ along[:dimension]
    moved = np.array([[slid], [-0.5 * slid]])
    for given, covered in ((None, False), (moved, True)):
        reached = surface_grid(scene, points, 0, 0.0, given).points[:, :dimension] @ along
        path = points.position[0] @ along + np.array([0.7, -0.35])
        assert (reached.min() < path.min() and path.max() < reached.max()) == covered
