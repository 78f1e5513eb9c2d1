"""Numbers that no computation can use are refused where the scene is read."""

from __future__ import annotations

import pytest
from support import beam_scene, refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.base.rules import LARGEST, SMALLEST


@pytest.mark.parametrize(
    ("override", "key"),
    [
        ("material.young=1e300", "material.young"),
        ("material.density=1e-300", "material.density"),
        ("material.mass_damping=1e300", "material.mass_damping"),
        ("geometry.thickness=1e300", "geometry.thickness"),
        ("loads.0.force=-1e300", "loads[0].force"),
        ("loads.0.frequency=1e-300", "loads[0].frequency"),
        ("contacts.0.normal_stiffness=1e300", "contacts[0].normal_stiffness"),
        ("contacts.0.friction=1e300", "contacts[0].friction"),
        ("rotation={speed_rpm=1e300}", "rotation.speed_rpm"),
        ("campbell={speeds_rpm=[0, 1e300]}", "campbell.speeds_rpm[1]"),
        ("rotation={speed_rpm=1, point=[1e300, 0]}", "rotation.point"),
    ],
)
def test_size_beyond_any_computation_is_refused(override: str, key: str) -> None:
    with refusal(ErrorKind.RANGE, key, "test"):
        beam_scene(2, (override,))


def test_largest_and_smallest_size_are_accepted() -> None:
    scene = beam_scene(2, (f"material.young={LARGEST}", f"material.density={SMALLEST}"))
    assert (scene.material.young, scene.material.density) == (LARGEST, SMALLEST)
