"""What a run says below its table."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from motions import jenkins
from support import beam_scene

from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.notes import DISSIPATION, PEAK_FORCE, PROBE
from fenicsrom.online.motion.measures import has_contact
from fenicsrom.post.run.motion_figures import response_note, response_rows
from fenicsrom.post.run.report import estimate_rows, motion_warnings, step_sentence


def test_motion_without_a_period_counts_nothing_in_periods() -> None:
    motions = {"reduced": replace(jenkins(), period=None)}
    head, row = response_rows(motions, {"reduced": 2}, ["x", "y"], {})
    assert "J" in head and len(row) == len(head)
    shown = " ".join(head) + response_note(motions)
    assert "period" not in shown.lower() and "steady" not in shown
    assert row[head.index("J")] == f"{motions['reduced'].friction_dissipation[-1]:.5g}"


def test_table_of_estimates_has_a_row_for_each_direction_and_the_force() -> None:
    errors = {
        name: MotionErrors(size, 3 * size, (2 * size, np.nan), dissipation=4 * size, probe=5 * size)
        for name, size in (("time step", 0.01), ("basis", 0.1))
    }
    probe = beam_scene(2, probe={"group": "tip", "at": "centre"})
    rows = estimate_rows(probe, errors, jenkins(), ["normal x", "tangential y"])
    assert rows[0][1:] == ["time step %", "basis %"]
    named = ["normal x", "tangential y", PROBE, PEAK_FORCE, DISSIPATION]
    assert [row[0].split(", ")[-1] for row in rows[2:]] == named
    assert [row[1:] for row in rows[1:]] == [
        ["1", "10"],
        ["2", "20"],
        ["unknown", "unknown"],
        ["5", "50"],
        ["3", "30"],
        ["4", "40"],
    ]


def test_probe_beside_contact_points_has_columns_of_its_own() -> None:
    touching = jenkins(normal=1e-3)
    moved = np.column_stack([3e-3 * np.sin(touching.time), 0.0 * touching.time])
    probe = replace(touching, probe=moved).at_probe()
    assert probe is not None and not has_contact(probe)
    names = ["normal x", "tangential y"]
    head, row = response_rows({"full": touching}, {}, names, {"full": probe})
    assert head[2:6] == ["normal x mm", "tangential y mm", "probe x mm", "probe y mm"]
    part = touching.last_period()
    half = 0.5e3 * np.ptp(moved[part, 0])
    assert float(row[4]) == pytest.approx(half, rel=1e-4) and float(row[5]) == 0.0
    assert touching.at_probe() is None


def test_warning_of_an_unsteady_motion_names_shorter_steps() -> None:
    """With the key of the scene, and with the other scheme only where it helps."""
    unsteady = {"steady": False, "buckled": 0, "search": None, "periods": 100}
    motion: Any = SimpleNamespace(**unsteady, time=np.array([0.0, 30.0]))
    (told,) = motion_warnings("reduced", motion, beam_scene(2, ("time.steps_per_period=200",)))
    assert "time.steps_per_period = 400" in told and "generalised-alpha" in told
    other = ("time.tolerance=8e-3", "time.scheme='generalised-alpha'")
    (told,) = motion_warnings("reduced", motion, beam_scene(2, other))
    assert "time.tolerance = 0.001" in told and "generalised-alpha" not in told


@pytest.mark.parametrize(("end", "told"), [(1.9, True), (2.0, False)])
def test_motion_that_ends_before_its_surface_has_arrived_is_warned_of(
    end: float, told: bool
) -> None:
    motion: Any = SimpleNamespace(steady=True, buckled=0, search=None, time=np.array([0.0, end]))
    scene = beam_scene(2, ("contacts.0.approach=[[0.0, 0.0], [2.0, 1e-3]]",))
    found = motion_warnings("reduced", motion, scene)
    assert [line.startswith("contacts.0.approach: ") for line in found] == [True] * told


def test_reduced_model_that_is_slower_than_the_solid_is_named() -> None:
    assert step_sentence(0.001, 0.002) is None
    said = step_sentence(0.08, 0.005)
    assert said is not None and "0.08 s" in said and "0.005 s" in said and "slower" in said
