"""The folders of the program's own files."""

from __future__ import annotations

from pathlib import Path


def shared_meshes() -> Path:
    """Give the folder of the program's own meshes.

    The folder lies inside the installed package; in a checkout it lies beside the package.
    """
    return _shared("meshes")


def shared_demos() -> Path:
    """Give the folder of the demos, inside the package or beside it."""
    return _shared("demos")


def _shared(name: str) -> Path:
    package = Path(__file__).resolve().parents[1]
    installed = package / name
    return installed if installed.is_dir() else package.parent / name
