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
        ("loads.0.force=-1e300", "loads[0].force"),
        ("rotation={speed_rpm=1e300}", "rotation.speed_rpm"),
        ("rotation={speed_rpm=1, point=[1e300, 0]}", "rotation.point"),
    ],
)
def test_size_beyond_any_computation_is_refused(override: str, key: str) -> None:
    with refusal(ErrorKind.RANGE, key, "test"):
        beam_scene(2, (override,))


def test_largest_and_smallest_size_are_accepted() -> None:
    scene = beam_scene(2, (f"material.young={LARGEST}", f"material.density={SMALLEST}"))
    assert (scene.material.young, scene.material.density) == (LARGEST, SMALLEST)
