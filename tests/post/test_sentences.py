"""What a run says below its table."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from motions import jenkins, side_by_side
from support import beam_scene

from fenicsrom.post.motion_table import PERIODS_NOTE, RESPONSE_NOTE, points_note, response_table
from fenicsrom.post.record import Study
from fenicsrom.post.sentences import basis_sentences
from fenicsrom.reduction.selection import Selection


def test_vectors_that_the_basis_leaves_out_are_named() -> None:
    modes: Any = SimpleNamespace(labels=("1V", "2V", "3V", "1S"), flexibility_condition=1.0)
    basis: Any = SimpleNamespace(
        method="rubin", size=2, labels=("1S", "1V"), condition=1.0, dropped={"1V1V": 1e-9}
    )
    chosen = Selection(("1V", "1S"), (), {}, {})
    study = Study(beam_scene(2), modes=modes, basis=basis, selection=chosen)
    _, modes_left, vectors_left, _ = basis_sentences(study)
    assert modes_left.endswith(": 2V 3V") and vectors_left.endswith(": 1V1V")
    assert "0.0001" in modes_left  # basis.threshold
    whole = Study(
        beam_scene(2), modes=modes, basis=basis, selection=Selection(modes.labels, (), {}, {})
    )
    basis.dropped = {}
    assert len(basis_sentences(whole)) == 2


def test_notes_of_the_table_say_what_its_periods_are() -> None:
    assert PERIODS_NOTE in RESPONSE_NOTE
    assert response_table({}, {}, beam_scene(2)) == ""


def test_note_says_to_which_contact_points_the_numbers_belong() -> None:
    one, probe = jenkins(normal=1e-3), beam_scene(2, probe={"group": "tip", "at": "centre"})
    scene, pushed = beam_scene(2), jenkins(normal=5e-3)
    assert points_note({"reduced": one, "full": one}, scene) is None
    alone = points_note({"reduced": one}, probe)
    assert alone is not None and "not of the probe" in alone
    several = {"reduced": side_by_side(one, pushed, one), "beam": one}
    note = points_note(several, scene)
    assert note is not None and note in response_table(several, {}, scene)
    assert "contact point 1;" in note and "3 points" in note and note.endswith("of point 2.")
    note = points_note(several | {"full": side_by_side(one, one, pushed)}, probe)
    assert note is not None and "2 (reduced), 3 (full)" in note and "not of the probe" in note
