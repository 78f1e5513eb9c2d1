"""The folders of the program's own files."""

from __future__ import annotations

from pathlib import Path


def shared_meshes() -> Path:
    """Give the folder of the program's own meshes.

    The folder lies inside the installed package; in a checkout it lies beside the package.
    """
    package = Path(__file__).resolve().parents[2]
    installed = package / "meshes"
    return installed if installed.is_dir() else package.parent / "meshes"
