"""The wear of a casing in the summary, the table, the sentence and the picture."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene

from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.online.contact.surfaces import frame
from fenicsrom.online.motion.measures import wear_of
from fenicsrom.post.run.figures import wear_sentence, wear_summary, write_wear

RADIUS, CELLS = 0.5, 8
SCENE = beam_scene(
    3,
    contacts=[
        {
            "group": "tip",
            "normal_stiffness": 1e8,
            "tangential_stiffness": 1e8,
            "friction": 0.1,
            "surface": {
                "kind": "cylinder",
                "point": [0.0, 0.0, 0.0],
                "axis": [0.0, 1.0, 0.0],
                "radius": RADIUS,
                "spin": -2.0 * np.pi * 3.2,
            },
            "abradable": {
                "thickness": 2e-3,
                "modulus": 1e9,
                "yield_stress": 1e6,
                "area": 1e-4,
                "width": 0.02,
                "cells": CELLS,
            },
        }
    ],
)


def points(count: int) -> ContactPoints:
    """Points in a row along the axis of the casing."""
    position = np.array([[RADIUS, 0.01 * k, 0.0] for k in range(count)])
    frames = np.tile(frame(np.array([1.0, 0.0, 0.0])), (count, 1, 1))
    return ContactPoints(np.zeros(count, np.int64), np.ones(count), position, frames)


def motion(worn: Any, wearing: bool = False) -> Any:
    end = SimpleNamespace(worn=np.asarray(worn, float).ravel(), wearing=wearing)
    return SimpleNamespace(end=end, time=np.array([0.0, 5.0 / 3.2]), period=1.0 / 3.2)


def test_summary_of_wear_gives_depth_volume_work_and_torque() -> None:
    depth = np.array([np.full(CELLS, 1e-4), np.zeros(CELLS)])
    found = wear_summary({"reduced": motion(depth)}, SCENE, points(2))["wear"]["reduced"]
    volume = 2.0 * np.pi * RADIUS * 0.01 * 1e-4  # each ring has half of the width
    assert found["largest_depth_m"] == 1e-4
    assert found["worn_area_m_rad"] == pytest.approx(2.0 * np.pi * 1e-4)
    assert found["worn_volume_m3"] == pytest.approx(volume)
    assert found["plastic_work_J"] == pytest.approx(1e6 * volume)
    assert found["mean_torque_Nm"] == pytest.approx(1e6 * volume / (5.0 * 2.0 * np.pi))
    assert found["wears_at_end"] is False
    assert wear_summary({"reduced": motion(depth)}, beam_scene(3), points(2)) == {}


def test_sentence_on_wear_says_whether_the_casing_still_wears() -> None:
    depth = np.full((1, CELLS), 1e-4)
    said, more = (wear_sentence(motion(depth, wears), SCENE, points(1)) for wears in (False, True))
    assert said is not None and "100 µm" in said and "no wear in the last period" in said
    assert more is not None and "still wearing" in more
    assert wear_sentence(motion(0.0 * depth), SCENE, points(1)) == "Abradable layer: not worn."


def test_table_of_wear_has_a_row_for_each_angle(tmp_path: Path) -> None:
    depth = 1e-5 * np.arange(2 * CELLS).reshape(2, CELLS)
    (path,) = write_wear(tmp_path, {"reduced": motion(depth)}, SCENE, points(2))
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["depth_m"]) for row in rows] == pytest.approx(depth.ravel())
    assert [float(row["angle_deg"]) for row in rows[:CELLS]] == pytest.approx(45.0 * np.arange(8))
    assert float(rows[-1]["position_m"]) == pytest.approx(0.01)
    assert write_wear(tmp_path, {}, SCENE, points(2)) == []


def test_no_more_is_worn_than_the_layer() -> None:
    (ring,) = wear_of(motion(np.full((1, CELLS), 1.0)), SCENE, points(1))
    np.testing.assert_array_equal(ring.depth, 2e-3)
