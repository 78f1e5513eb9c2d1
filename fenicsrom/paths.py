"""Where the program's own files lie."""

from __future__ import annotations

from pathlib import Path


def shared_meshes() -> Path:
    """Give the folder of the program's own geometry: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    installed = package / "meshes"
    return installed if installed.is_dir() else package.parent / "meshes"
