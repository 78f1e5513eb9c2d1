"""Files and folders that appear complete or not at all."""

from pathlib import Path

import numpy as np
import pytest

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import atomic_folder, atomic_write, read_archive


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError])
def test_atomic_write_after_error_leaves_older_file(tmp_path, stop):
    path = tmp_path / "new" / "history.npz"
    with pytest.raises(stop), atomic_write(path) as temporary:
        temporary.write_text("half")
        assert temporary.suffix == ".npz" and temporary.parent == path.parent
        raise stop
    assert list(path.parent.iterdir()) == []
    with atomic_write(path) as temporary:
        np.savez(temporary, a=1)
        assert not path.exists()
    with pytest.raises(stop), atomic_write(path) as temporary:
        temporary.write_text("half")
        raise stop
    assert np.load(path)["a"] == 1 and list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError])
def test_atomic_folder_after_error_leaves_older_folder(tmp_path, stop):
    path = tmp_path / "motion"
    with pytest.raises(stop), atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("half")
        raise stop
    assert list(tmp_path.iterdir()) == []
    with atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("first")
        assert not path.exists()
    with pytest.raises(stop), atomic_folder(path) as temporary:
        (temporary / "a.vtu").write_text("half")
        raise stop
    assert (path / "a.vtu").read_text() == "first"
    with atomic_folder(path) as temporary:
        (temporary / "b.vtu").write_text("second")
    assert list(tmp_path.iterdir()) == [path] and [p.name for p in path.iterdir()] == ["b.vtu"]


def test_atomic_folder_after_failed_swap_restores_older_folder(tmp_path, monkeypatch):
    import os

    path = tmp_path / "motion"
    path.mkdir()
    (path / "old").write_text("old")
    rename, calls = os.rename, []

    def failing(a, b):
        calls.append((a, b))
        if len(calls) == 2:
            raise OSError(28, "No space left on device", str(a))
        rename(a, b)

    monkeypatch.setattr(os, "rename", failing)
    with pytest.raises(OSError, match="motion"), atomic_folder(path) as temporary:
        (temporary / "new").write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["motion"] and (path / "old").exists()
    assert len(calls) == 3


def test_file_that_is_no_archive_is_refused_without_advice_to_load_it_unsafely(
    tmp_path: Path,
) -> None:
    path = tmp_path / "model.npz"
    path.write_text("no archive")
    with pytest.raises(SceneError) as caught, read_archive(path, "a reduced model", "form"):
        pass
    assert caught.value.kind is ErrorKind.FORMAT and "pickle" not in str(caught.value)
