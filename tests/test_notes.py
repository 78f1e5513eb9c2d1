"""Notes and the verdict that they give."""

import pickle

import pytest

from fenicsrom.errors import AccuracyError
from fenicsrom.notes import (
    AMPLITUDES,
    PEAK_FORCE,
    STABILITY,
    Note,
    NoteKind,
    has_kind,
    implausible,
    packed,
    unpacked,
    verdict_of,
)

READ = (AMPLITUDES, PEAK_FORCE, STABILITY)
FORCE = Note(NoteKind.ERROR, "its estimated error is 17 %", quantity=PEAK_FORCE)
COARSE = Note(NoteKind.WARNING, "coarse mesh")
UNDRAWN = Note(NoteKind.NOT_DRAWN, "motion.gif was not drawn: no EGL", "motion.gif")


@pytest.mark.parametrize(
    ("notes", "line"),
    [
        (
            [UNDRAWN],
            "Trusted: no check found a reason for doubt about amplitudes, peak normal force and "
            "stability.",
        ),
        ([COARSE, COARSE], "Doubtful: coarse mesh."),
        ([FORCE, COARSE], "Doubtful: its estimated error is 17 %, and 1 more warning."),
        (
            [FORCE],
            "Doubtful: peak normal force: its estimated error is 17 %. "
            "Trusted: amplitudes and stability.",
        ),
        (["a text without a kind"], "Doubtful: a text without a kind."),
        ([Note(NoteKind.CUT_SHORT, "not checked")], "Incomplete: not checked"),
    ],
)
def test_verdict_is_that_of_the_worst_quantity(notes: list[str], line: str) -> None:
    assert verdict_of(notes, quantities=READ).text == line


def test_each_quantity_has_its_own_judgement() -> None:
    assert verdict_of([FORCE], quantities=READ).quantities == {
        AMPLITUDES: "trusted",
        PEAK_FORCE: "its estimated error is 17 %",
        STABILITY: "trusted",
    }
    assert set(verdict_of([FORCE, COARSE], quantities=READ).quantities.values()) == {FORCE, COARSE}


def test_quantity_without_a_check_is_not_called_trusted() -> None:
    found = verdict_of([], quantities=READ[:1], unjudged=READ[1:])
    assert found.text.endswith("about amplitudes. Not judged: peak normal force and stability.")
    assert found.quantities == dict(zip(READ, ("trusted", "not judged", "not judged"), strict=True))


def test_verdict_of_a_failure_and_of_an_interrupt_holds_for_all_quantities() -> None:
    refused = verdict_of([], ValueError("no motion"), quantities=READ)
    assert refused.text == "Refused: no motion"
    assert set(refused.quantities.values()) == {"refused: no motion"}
    assert verdict_of([COARSE], interrupted=True, quantities=READ).kind == "incomplete"


def test_failure_of_one_quantity_leaves_the_others() -> None:
    found = verdict_of([FORCE], AccuracyError("17 %", quantity=PEAK_FORCE), quantities=READ)
    assert found.text.startswith("Refused: peak normal force: its estimated error is 17 %. Trusted")
    assert found.quantities == verdict_of([FORCE], quantities=READ).quantities


def test_note_survives_archive_and_process() -> None:
    note = Note(NoteKind.ERROR, "a", "time.steps", "loads.0.force = 25 N: ", PEAK_FORCE)
    for copy in (pickle.loads(pickle.dumps(note)), *unpacked(packed([note]))):
        assert (copy, vars(copy)) == (note, vars(note))
    assert unpacked(packed(["plain"]))[0].kind is NoteKind.WARNING


def test_kind_decides_and_not_the_text() -> None:
    assert has_kind([implausible("too long")], NoteKind.IMPLAUSIBLE)
    assert not has_kind(["implausible: too long"], NoteKind.IMPLAUSIBLE)
