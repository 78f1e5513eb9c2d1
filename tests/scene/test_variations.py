"""The axes of a sweep: their values, their overrides, and what is refused."""

from __future__ import annotations

import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.scene.reading import overrides as variations
from fenicsrom.scene.reading.overrides import combinations, make_axes


def test_list_keeps_values_of_toml() -> None:
    (axis,) = make_axes(["a.b=[1, 2.5, true, 'x', [0, 1]]"])
    assert [value for (value,) in axis.values] == [1, 2.5, True, "x", [0, 1]]
    assert [axis.overrides(k) for k in (2, 3, 4)] == [["a.b=true"], ['a.b="x"'], ["a.b=[0, 1]"]]


def test_range_has_equal_steps_and_both_ends() -> None:
    (axis,) = make_axes(["p=0:0.3:4"])
    assert axis.values == ((0.0,), (0.1,), (0.2,), (0.3,))


def test_logarithmic_range_has_equal_ratios() -> None:
    (axis,) = make_axes(["p=0.01:100:5:log"])
    assert axis.values == ((0.01,), (0.1,), (1.0,), (10.0,), (100.0,))


def test_axes_combine_and_zipped_keys_change_together() -> None:
    axes = make_axes(["a=[1, 2]"], ["b=[3, 4, 5]", "c=6:8:3"])
    assert axes[1].keys == ("b", "c")
    positions = list(combinations(axes))
    assert len(positions) == 6
    assert positions[:4] == [(0, 0), (0, 1), (0, 2), (1, 0)]
    assert axes[1].overrides(2) == ["b=5", "c=8"]


@pytest.mark.parametrize(
    "text", ["p", "p=[]", "p=1:2", "p=1:2:3:linear", "p=0:1:3:log", "p=[{a=1}]"]
)
def test_wrong_axis_is_refused(text: str) -> None:
    with refusal(ErrorKind.FORMAT, text.partition("=")[0]):
        make_axes([text])


@pytest.mark.parametrize(
    "text", ["basis.modes=2:5:3", "response.points=[3, 4.5]", "probe.group=[1]"]
)
def test_axis_whose_values_have_another_type_than_its_key_is_refused(text: str) -> None:
    with refusal(ErrorKind.TYPE, text.partition("=")[0]):
        make_axes([text])


def test_range_of_an_integer_key_that_gives_integers_is_taken() -> None:
    (axis,) = make_axes(["basis.modes=2:6:3"])
    assert axis.values == ((2,), (4,), (6,))


def test_key_given_twice_is_refused() -> None:
    with refusal(ErrorKind.FORMAT, "a"):
        make_axes(["a=[1]"], ["a=[2]"])


def test_zipped_keys_of_different_length_are_refused() -> None:
    with refusal(ErrorKind.FORMAT, "a"):
        make_axes([], ["a=[1]", "b=[1, 2]"])


def test_too_many_runs_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variations, "MOST_RUNS", 5)
    with refusal(ErrorKind.FORMAT, "a"):
        make_axes(["a=[1, 2, 3]", "b=[1, 2]"])
