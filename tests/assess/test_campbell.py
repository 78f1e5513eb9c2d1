"""What a Campbell diagram says of modes whose shapes change from speed to speed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fenicsrom.assess.rotation.campbell import _warnings
from fenicsrom.post.studies.campbell_report import figure, five_digits


def test_mode_that_keeps_little_of_its_shape_gets_a_remark() -> None:
    mac = np.array([[1.0, 1.0, 1.0], [0.99, 0.55, 0.4], [0.7, 0.9, 1.0]])
    found: Any = SimpleNamespace(
        squares=np.ones((3, 3)), mac=mac, speeds_rpm=np.array([0.0, 500.0, 1000.0])
    )
    swapped, lost = _warnings(found)
    assert swapped.startswith("mode 2 may") and "0 and 500 rpm (MAC 0.55)" in swapped
    assert lost.startswith("mode 3 was lost")


@pytest.mark.parametrize(
    ("value", "text"), [(227.9, "227.90"), (34.6192, "34.619"), (12345.4, "12345"), (0.0, "0.0000")]
)
def test_numbers_of_the_tables_keep_five_digits(value: float, text: str) -> None:
    assert five_digits(value) == text


@pytest.mark.parametrize(
    ("highest", "orders", "named"),
    [
        (1000.0, (1, 2, 3, 4), {1, 2, 3, 4}),
        (9000.0, (4, 1, 2, 3), {1}),  # the lines end close together, at the bottom right
        (9000.0, (1, 2, 120, 149, 150, 151, 170, 1000), {1, 120, 149, 170, 1000}),
    ],
)
def test_names_of_engine_orders_do_not_overlap(
    highest: float, orders: tuple[int, ...], named: set[int]
) -> None:
    found: Any = SimpleNamespace(
        speeds_rpm=np.array([500.0, 3500.0]),
        frequencies_hz=np.array([[50.0, highest], [70.0, highest]]),
        labels=["1", "2"],
        critical=[],
        margins=None,
        curves=list,
        scene=SimpleNamespace(campbell=SimpleNamespace(engine_orders=orders)),
    )
    drawn = figure(found)
    drawn.draw_without_rendering()
    texts = drawn.axes[0].texts
    assert {int(text.get_text().removeprefix("EO ")) for text in texts} == named
    boxes = [text.get_window_extent() for text in texts]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
