"""The announcement of kernels that are compiled."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fenicsrom.online.kernels import compilation
from fenicsrom.online.kernels.compilation import Compilations, announced, keep_time, known_times

ALL = "this takes some minutes"


def function(name: str, folder: Path | None) -> Any:
    """A compiled function whose machine code is stored in a folder."""
    named = SimpleNamespace(__module__="kernels", __qualname__=name)
    path = None if folder is None else str(folder)
    return SimpleNamespace(py_func=named, stats=SimpleNamespace(cache_path=path))


def event(of: Any, *, failed: bool = False) -> Any:
    """The event of a compilation."""
    return SimpleNamespace(data={"dispatcher": of}, is_failed=failed)


def compile_all(*functions: Any) -> list[str]:
    """Compile functions in a new process, so to say; give what is announced."""
    said: list[str] = []
    listener = Compilations(said.append)
    for compiled in functions:
        listener.on_start(event(compiled))
        listener.on_end(event(compiled))
    return said


def test_first_compilation_of_all_is_announced_once(tmp_path: Path) -> None:
    (sentence,) = compile_all(function("march", tmp_path), function("solve", tmp_path))
    assert ALL in sentence
    assert set(known_times(function("march", tmp_path))) == {"kernels.march", "kernels.solve"}


def test_long_compilation_is_announced_with_its_time_before(tmp_path: Path) -> None:
    march, solve = function("march", tmp_path), function("solve", tmp_path)
    keep_time(march, 77.4)
    keep_time(solve, 0.4)
    (sentence,) = compile_all(solve, march)
    assert "kernels.march" in sentence
    assert "77 s" in sentence


def test_new_kernel_is_announced_without_a_time(tmp_path: Path) -> None:
    keep_time(function("solve", tmp_path), 0.4)
    (sentence,) = compile_all(function("march", tmp_path))
    assert ALL not in sentence


def test_function_inside_another_is_neither_announced_nor_kept(tmp_path: Path) -> None:
    march, inner = function("march", tmp_path), function("inner", tmp_path)
    keep_time(march, 0.1)
    said: list[str] = []
    listener = Compilations(said.append)
    for compiled in (march, inner):
        listener.on_start(event(compiled))
    for compiled in (inner, march):
        listener.on_end(event(compiled))
    assert said == []
    assert "kernels.inner" not in known_times(march)


def test_failed_compilation_is_not_kept(tmp_path: Path) -> None:
    listener = Compilations(lambda line: None)
    listener.on_start(event(function("march", tmp_path)))
    listener.on_end(event(function("march", tmp_path), failed=True))
    assert known_times(function("march", tmp_path)) == {}


@pytest.mark.parametrize("content", ["", "[]", "null", '{"kernels.march": "soon"}'])
def test_damaged_file_of_times_is_replaced(content: str, tmp_path: Path) -> None:
    march = function("march", tmp_path)
    (tmp_path / compilation.TIMES).write_text(content)
    assert known_times(march) == {}
    keep_time(march, 2.0)
    assert known_times(march) == {"kernels.march": 2.0}


def test_compilation_that_is_not_stored_is_announced(tmp_path: Path) -> None:
    assert len(compile_all(function("march", None))) == 1


def test_numba_sends_the_event(tmp_path: Path) -> None:
    import numba

    said: list[str] = []
    with announced(said.append):
        numba.njit(lambda x: x + 1)(1)
    assert len(said) == 1
