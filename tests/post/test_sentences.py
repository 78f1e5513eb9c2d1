"""What a run says below its table."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from support import beam_scene

from fenicsrom.post.record import Study
from fenicsrom.post.sentences import (
    PERIODS_NOTE,
    RESPONSE_NOTE,
    basis_sentences,
    response_table,
)
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
