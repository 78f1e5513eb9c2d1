"""Values and records in a few words."""

from __future__ import annotations

import pytest

from fenicsrom.scene.base.rules import show
from fenicsrom.words import value_in_words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([1, 2.5, "a"], "1, 2.5, a"),
        ([[1, 2], [3, 4]], "2 of 1, 2"),
        ([[1, 2]], "1, 2"),
        ({"a": [1, 2]}, "a = 1, 2"),
        ([], "none"),
    ],
)
def test_list_is_written_out_and_a_list_of_lists_by_its_number_and_its_first(
    value: object, words: str
) -> None:
    assert value_in_words(value) == words


@pytest.mark.parametrize(("length", "shown"), [(58, 60), (59, 60), (200, 60)])
def test_value_of_a_scene_file_is_cut_at_the_width(length: int, shown: int) -> None:
    text = show("x" * length, 60)
    assert len(text) == shown and text.endswith("…") == (length > 58)
