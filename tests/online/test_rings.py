"""Abradable layers of a scene: their keys, the rings of contact points, and what was worn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.online.contact.coating import ring_place, rings_of
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import frame, surface_normal
from fenicsrom.online.motion.measures import Wear

Array = NDArray[np.float64]

RADIUS, SPIN = 0.5, -2.0 * np.pi * 3.2
LAYER = {"thickness": 2e-3, "modulus": 1e9, "yield_stress": 1e6, "area": 3e-4}
CONTACT = {"group": "tip", "normal_stiffness": 1e8, "tangential_stiffness": 1e8, "friction": 0.1}
CASING = {
    "kind": "cylinder",
    "point": [0.0, 0.0, 0.0],
    "axis": [0.0, 1.0, 0.0],
    "radius": RADIUS,
    "spin": SPIN,
}
WALL = {"normal": [1.0, 0.0, 0.0]}


def scene_of(*contacts: dict[str, Any], **layer: Any) -> Any:
    """A beam with these contacts, each with a layer."""
    layers = {"abradable": {k: v for k, v in (LAYER | layer).items() if v is not None}}
    return beam_scene(3, contacts=[CONTACT | layers | contact for contact in contacts])


def points_of(scene: Any, contact: Any, angle: Array, along: Array) -> ContactPoints:
    """Points on the casing at these angles from x, towards -z, and places along the axis."""
    x = np.array([RADIUS * np.cos(angle), along, -RADIUS * np.sin(angle)]).T
    chosen = [scene.contacts[k] for k in contact]
    frames = [frame(surface_normal(one, at, "test")) for one, at in zip(chosen, x, strict=True)]
    return ContactPoints(np.array(contact), np.ones(len(x)), x, np.array(frames))


def test_points_at_one_place_along_the_axis_share_a_ring() -> None:
    scene = scene_of({"surface": CASING}, cells=90)
    points = points_of(
        scene, [0, 0, 0, 0], np.array([0.1, 0.2, 0.3, 0.4]), np.array([0, 2, 2, 4e0])
    )
    contacts = contacts_of(scene, points)
    rings = rings_of(scene, points, contacts)
    assert [ring.points for ring in rings] == [(0,), (1, 2), (3,)]
    assert [ring.first for ring in rings] == [0, 90, 180]
    assert [ring.position for ring in rings] == pytest.approx([0.0, 2.0, 4.0])
    assert [ring.width for ring in rings] == pytest.approx([1.0, 1.0, 1.0])  # a quarter of 4 m
    assert rings[1].area == pytest.approx(RADIUS * 2.0 * np.pi / 90 * 1.0)
    coating = contacts.coating
    np.testing.assert_allclose(coating.angle, [-0.15, -0.05, 0.05, 0.15], rtol=0, atol=1e-9)
    np.testing.assert_allclose(coating.yield_force, 1e6 * 3e-4 / 4, rtol=1e-12)
    soft = 1.0 / 1e8 + 4 * 2e-3 / (3e-4 * 1e9)
    np.testing.assert_allclose(contacts.normal_stiffness, 1.0 / soft, rtol=1e-12)
    assert coating.worn.shape == (270,)
    turned = ring_place(contacts, 1, 0.02) - ring_place(contacts, 1, 0.0)
    assert turned == pytest.approx(90.0 * 3.2 * 0.02)


def test_two_contacts_before_one_casing_share_its_rings() -> None:
    scene = scene_of({"surface": CASING}, {"surface": CASING, "friction": 0.2}, width=0.01)
    points = points_of(scene, [0, 1], np.array([0.1, 0.2]), np.zeros(2))
    assert [ring.points for ring in rings_of(scene, points, contacts_of(scene, points))] == [(0, 1)]


def test_points_before_a_plane_have_their_own_depth() -> None:
    scene = scene_of(WALL)
    points = points_of(scene, [0, 0], np.zeros(2), np.array([0.0, 0.1]))
    contacts = contacts_of(scene, points)
    rings = rings_of(scene, points, contacts)
    assert [(ring.cells, ring.area) for ring in rings] == [(1, 1.5e-4), (1, 1.5e-4)]
    assert contacts.coating.worn.shape == (2,)
    wear = Wear(rings[1], np.array([1e-4]), 0.0)
    assert wear.volume == pytest.approx(1.5e-8)
    assert wear.plastic_work == pytest.approx(1.5e-4 * 1e6 * 1e-4)
    assert wear.mean_torque == 0.0


def test_wear_of_a_ring_gives_volume_work_and_torque() -> None:
    scene = scene_of({"surface": CASING}, width=0.01, hardening=1e8)
    points = points_of(scene, [0], np.zeros(1), np.zeros(1))
    ring = rings_of(scene, points, contacts_of(scene, points))[0]
    wear = Wear(ring, np.full(720, 1e-4), 4.0 * np.pi)
    assert wear.area == pytest.approx(2.0 * np.pi * 1e-4)
    assert wear.volume == pytest.approx(2.0 * np.pi * 1e-4 * RADIUS * 0.01)
    work = 2.0 * np.pi * RADIUS * 0.01 * (1e6 * 1e-4 + 0.5 * 1e8 * 1e-8 / 2e-3)
    assert wear.plastic_work == pytest.approx(work)
    assert wear.mean_torque == pytest.approx(work / (4.0 * np.pi))


def test_trace_of_one_point_needs_a_width() -> None:
    scene = scene_of({"surface": CASING})
    points = points_of(scene, [0], np.zeros(1), np.zeros(1))
    with refusal(ErrorKind.MISSING, "contacts[0].abradable.width"):
        contacts_of(scene, points)
