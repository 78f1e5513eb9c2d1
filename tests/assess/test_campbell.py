"""What a Campbell diagram says of modes whose shapes change from speed to speed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from fenicsrom.assess.rotation.campbell import _warnings
from fenicsrom.assess.rotation.rotating_modes import follow


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


def test_modes_that_nearly_coincide_keep_their_frequencies() -> None:
    """Their shapes are aligned with those at the speed before, and the frequencies with them."""
    body: Any = SimpleNamespace(mass_inner=lambda a, b: a.T @ b)
    before, shapes = np.array([100.0, 100.001]), np.eye(2)
    squares, vectors = np.array([99.999, 100.0]), np.eye(2)[:, ::-1]
    found, aligned, mac = follow(body, before, shapes, squares, vectors)
    np.testing.assert_allclose(found, [100.0, 99.999], rtol=1e-12)
    np.testing.assert_allclose(np.abs(aligned), np.eye(2), atol=1e-12)
    np.testing.assert_allclose(mac, 1.0)
