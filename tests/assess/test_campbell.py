"""What a Campbell diagram says of modes whose shapes change from speed to speed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from fenicsrom.assess.rotation.campbell import _warnings


def test_mode_that_keeps_little_of_its_shape_gets_a_remark() -> None:
    mac = np.array([[1.0, 1.0, 1.0], [0.99, 0.55, 0.4], [0.7, 0.9, 1.0]])
    found: Any = SimpleNamespace(
        squares=np.ones((3, 3)),
        mac=mac,
        speeds_rpm=np.array([0.0, 500.0, 1000.0]),
        numbers=["1", "2", "3"],
    )
    swapped, lost = _warnings(found)
    assert swapped.startswith("mode 2 may") and "0 and 500 rpm (MAC 0.55)" in swapped
    assert lost.startswith("mode 3 was lost")
