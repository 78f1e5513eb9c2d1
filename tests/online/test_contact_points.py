"""Contact points and the surfaces opposite them: where the angle of the waves starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import frame, penetration, surface_normal

Array = NDArray[np.float64]

AXIS = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])
CENTRE = np.array([-0.3, 0.1, 0.2])
RADIUS = 1.5
WAVES = [[2, 2e-3, 0.3], [5, 1e-3, 0.0]]
HEIGHTS = np.array([0.0, 0.05, 0.1])


def around(angle: Any) -> Array:
    """Unit vectors across the axis at an angle from a first one, positive about the axis."""
    first = np.cross(AXIS, [0.0, 0.0, 1.0])
    first /= np.linalg.norm(first)
    return np.multiply.outer(np.cos(angle), first) + np.multiply.outer(
        np.sin(angle), np.cross(AXIS, first)
    )


def casing(angles: Array, spin: float = 0.0, **more: Any) -> tuple[Any, ContactPoints]:
    """A scene with a wavy casing, and three points on it at these angles."""
    surface = {"kind": "cylinder", "point": CENTRE.tolist(), "axis": AXIS.tolist()}
    surface |= {"radius": RADIUS, "waves": WAVES, "spin": spin} | more
    contact = {"normal_stiffness": 1e4, "tangential_stiffness": 1e4, "friction": 0.5}
    scene = beam_scene(3, contacts=[contact | {"group": "tip", "surface": surface}])
    position = CENTRE + RADIUS * around(angles) + HEIGHTS[:, None] * AXIS
    frames = [frame(surface_normal(scene.contacts[0], x, "test: contacts[0]")) for x in position]
    return scene, ContactPoints(np.zeros(3, np.int64), np.ones(3), position, np.array(frames))


def depths(scene: Any, points: ContactPoints, time: float) -> Array:
    """Penetrations of the undeformed body."""
    contacts = contacts_of(scene, points)
    return np.array([penetration(contacts, p, np.zeros(3), time) for p in range(3)])


def waves(angle: Array) -> Array:
    """The waves of the casing at angles from their start."""
    return np.sum([h * np.cos(order * angle - phase) for order, h, phase in WAVES], axis=0)


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0, 4.0])
def test_angle_of_waves_starts_at_the_middle_of_the_points(turn: float) -> None:
    """A body that stands elsewhere around the axis meets the same casing."""
    apart, time = np.array([-0.3, 0.1, 0.2]), 0.7
    middle = np.angle(np.sum(np.exp(1j * apart)))
    found = depths(*casing(turn + apart, spin=0.4), time)
    np.testing.assert_allclose(found, waves(apart - middle - 0.4 * time), rtol=0, atol=1e-14)


def test_angle_of_waves_starts_where_the_surface_says() -> None:
    """The part of the direction along the axis does not count."""
    angles = np.array([0.3, 0.7, 0.8])
    start = (3.0 * (around(1.1) + 0.4 * AXIS)).tolist()
    found = depths(*casing(angles, angle_from=start), 0.0)
    np.testing.assert_allclose(found, waves(angles - 1.1), rtol=0, atol=1e-14)


def test_waves_around_points_all_around_the_axis_need_a_direction() -> None:
    angles = 2.0 * np.pi / 3.0 * np.arange(3)
    with refusal(ErrorKind.MISSING, "contacts[0].surface.angle_from"):
        contacts_of(*casing(angles))
    found = depths(*casing(angles, angle_from=around(0.0).tolist()), 0.0)
    np.testing.assert_allclose(found, waves(angles), rtol=0, atol=1e-14)
    contacts_of(*casing(angles, waves=[]))
