"""The announcement of kernels that are compiled, and their time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numba
import pytest

from fenicsrom.online.kernels import compilation
from fenicsrom.online.kernels.compilation import COMPILATIONS, KERNELS, Compilations, announced


def event(kernel: str) -> Any:
    """The event of the compilation of a function of `fenicsrom.online`."""
    module, _, name = f"fenicsrom.online.{kernel}".rpartition(".")
    function = SimpleNamespace(__module__=module, __qualname__=name)
    return SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=function)})


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time on the clock, s."""
    time = [100.0]
    monkeypatch.setattr(compilation.clock, "perf_counter", lambda: time[0])
    return time


def test_each_kernel_is_announced_with_its_number_and_the_time_so_far(now: list[float]) -> None:
    said: list[str] = []
    listener = Compilations()
    listener.say = said.append
    first, second, *_ = KERNELS
    for kernel, seconds in ((first, 4.0), ("model.loads.factors", 1.0), (second, 12.0)):
        listener.on_start(event(kernel))
        now[0] += seconds
        listener.on_end(event(kernel))
    one, two = said
    assert f"1 of at most {len(KERNELS)}" in one and KERNELS[first] in one
    assert "so far" not in one
    assert f"2 of at most {len(KERNELS)}" in two and KERNELS[second] in two
    assert "5 s so far" in two


def test_time_of_a_compilation_is_no_working_time_and_short_ones_are_silent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counted: list[float] = []
    monkeypatch.setattr(compilation, "add_compilation", counted.append)
    said: list[str] = []
    with announced(said.append):
        numba.njit(lambda x: x + 1)(1)
    assert len(counted) == 1 and counted[0] > 0.0
    assert said == []
    assert COMPILATIONS.say != said.append
