"""What a run says below its table."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from motions import jenkins, side_by_side
from support import beam_scene, contact_points

from fenicsrom.assess.errors.estimates import MotionErrors
from fenicsrom.notes import DISSIPATION, PEAK_FORCE, PROBE
from fenicsrom.online.motion.measures import has_contact
from fenicsrom.post.run.motion_figures import (
    PERIODS_NOTE,
    points_note,
    response_note,
    response_rows,
)
from fenicsrom.post.run.report import (
    basis_sentences,
    estimate_rows,
    motion_warnings,
    report,
    speed_sentence,
    step_sentence,
)
from fenicsrom.records import Rerun, Study
from fenicsrom.reduction.derivatives import Selection


def test_vectors_that_the_basis_leaves_out_are_named() -> None:
    modes: Any = SimpleNamespace(labels=("1V", "2V", "3V", "1S"), flexibility_condition=1.0)
    basis: Any = SimpleNamespace(
        method="rubin", size=2, labels=("1S", "1V"), condition=1.0, dropped={"1V1V": 1e-9}
    )
    chosen = Selection(("1V", "1S"), (), {}, {})
    study = Study(beam_scene(2), modes=modes, basis=basis, selection=chosen)
    _, modes_left, vectors_left, _ = basis_sentences(study)
    assert modes_left.endswith(": 2V 3V.") and vectors_left.endswith(": 1V1V.")
    assert "0.0001" in modes_left  # basis.threshold
    whole = Study(
        beam_scene(2), modes=modes, basis=basis, selection=Selection(modes.labels, (), {}, {})
    )
    basis.dropped = {}
    assert len(basis_sentences(whole)) == 2


def test_notes_of_the_table_say_what_its_periods_are() -> None:
    motion, points = jenkins(), contact_points([1.0, 0.0])
    stored: Any = SimpleNamespace(
        size=4,
        scene=beam_scene(2),
        whole=None,
        model=SimpleNamespace(points=points),
        frequencies_hz=np.zeros(0),
    )
    assert PERIODS_NOTE in report(Rerun(stored, motion, {}, None, [])).text()
    assert response_rows({}, {}, ["x", "y"], {}) == []


def test_motion_without_a_period_counts_nothing_in_periods() -> None:
    motions = {"reduced": replace(jenkins(), period=None)}
    head, row = response_rows(motions, {"reduced": 2}, ["x", "y"], {})
    assert "J" in head and len(row) == len(head)
    shown = " ".join(head) + response_note(motions)
    assert "period" not in shown.lower() and "steady" not in shown
    assert row[head.index("J")] == f"{motions['reduced'].friction_dissipation[-1]:.5g}"


def test_note_says_to_which_contact_points_the_numbers_belong() -> None:
    one, probe = jenkins(normal=1e-3), beam_scene(2, probe={"group": "tip", "at": "centre"})
    scene, pushed = beam_scene(2), jenkins(normal=5e-3)
    assert points_note({"reduced": one, "full": one}, scene) is None
    alone = points_note({"reduced": one}, probe)
    assert alone is not None and alone.endswith("the contact point and of the probe.")
    several = {"reduced": side_by_side(one, pushed, one), "beam": one}
    note = points_note(several, scene)
    assert note is not None
    assert "contact point 1;" in note and "3 points" in note and note.endswith("of point 2.")
    note = points_note(several | {"full": side_by_side(one, one, pushed)}, probe)
    assert (
        note is not None and "2 (reduced), 3 (full)" in note and "point 1 and of the probe;" in note
    )


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


def test_row_of_responses_has_the_order_of_the_directions() -> None:
    head, row = response_rows({"full": jenkins(normal=1e-3)}, {}, ["normal x", "tangential y"], {})
    assert head[2:4] == ["normal x mm", "tangential y mm"]
    assert float(row[3]) == pytest.approx(8.0, rel=1e-3) and float(row[2]) < 2.0


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


def test_run_times_are_written_without_powers_of_ten() -> None:
    motions: Any = {"reduced": SimpleNamespace(seconds=1.5), "full": SimpleNamespace(seconds=156.0)}
    said = speed_sentence(motions)
    assert said is not None and said.endswith(
        "1.5 s, that of the full model 156 s: 104 times as long."
    )


def test_reduced_model_that_is_slower_than_the_solid_is_named() -> None:
    assert step_sentence(0.001, 0.002) is None
    said = step_sentence(0.08, 0.005)
    assert said is not None and "0.08 s" in said and "0.005 s" in said and "slower" in said
