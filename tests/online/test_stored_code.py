"""Machine code that is loaded without what only compilation needs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from fenicsrom.online.kernels.compiled import compiled
from fenicsrom.online.kernels.emission import IS_CHECKED
from fenicsrom.online.kernels.stored_code import MARK, StoredLibrary, load_code_only

pytestmark = pytest.mark.skipif(not IS_CHECKED, reason="numba is of another version")
EMPTY = "an array without entries"


def sum_of_squares(values):  # type: ignore[no-untyped-def]
    """The inner product of a vector with itself, by BLAS."""
    if values.size == 0:
        raise ValueError(EMPTY)
    return np.dot(values, values)


PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
import test_stored_code
test_stored_code.load_code_only()
test_stored_code.compiled(test_stored_code.sum_of_squares)(test_stored_code.np.ones(3))
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which another process stored the compiled function."""
    folder = tmp_path_factory.mktemp("numba")
    subprocess.run(
        [sys.executable, "-c", PROGRAM, str(Path(__file__).parent)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder)},
        check=True,
    )
    return folder


@pytest.fixture
def stored(store: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The function, loaded from the store."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(store))
    load_code_only()
    loaded = compiled(sum_of_squares)
    loaded(np.ones(3))
    assert sum(loaded.entry.stats.cache_hits.values()) == 1
    return loaded


def library_of(function: Any) -> StoredLibrary:
    """The library of the only signature of a function."""
    (result,) = function.entry.overloads.values()
    assert isinstance(result.library, StoredLibrary)
    return result.library


def test_stored_function_runs_without_its_intermediate_code(stored: Any) -> None:
    assert stored(np.array([3.0, 4.0])) == 25.0
    assert library_of(stored)._shared_module is None


def test_stored_function_raises_its_errors(stored: Any) -> None:
    with pytest.raises(ValueError, match=EMPTY):
        stored(np.zeros(0))


@pytest.mark.parametrize("content", [slice(0, 0), slice(0, -20), slice(40, None)])
@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
def test_damaged_stored_function_is_compiled_and_stored_again(
    suffix: str, content: slice, store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(store, tmp_path / "numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
    load_code_only()
    (damaged,) = folder.rglob(f"*.{suffix}")
    damaged.write_bytes(damaged.read_bytes()[content])
    for hits in (0, 1):
        function = compiled(sum_of_squares)
        assert function(np.array([3.0, 4.0])) == 25.0
        assert sum(function.entry.stats.cache_hits.values()) == hits


def test_every_damaged_byte_of_a_stored_function_is_noticed(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shutil.copytree(store, tmp_path / "numba")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(folder))
    load_code_only()
    (path,) = folder.rglob("*.nbc")
    content = path.read_bytes()
    stored = compiled(sum_of_squares).entry._cache._cache_file
    assert stored._load_data(path.name)
    for place in range(0, len(content) - 20, len(content) // 50):
        path.write_bytes(content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :])
        with pytest.raises(ValueError, match="damaged"):
            stored._load_data(path.name)
    path.write_bytes(content[: -len(MARK) - 8])  # written without a checksum
    assert stored._load_data(path.name)
