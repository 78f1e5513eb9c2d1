"""The commands on a mesh file: each takes the parsed options and returns the exit code."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from fenicsrom.cli.output import require_lasting
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind, SceneError


def inspect(options: argparse.Namespace) -> int:
    """Describe a mesh file.

    Raises:
        SceneError: the file cannot be read, or its mesh cannot be used.
    """
    from fenicsrom.post.run.pictures import draw_pictures
    from fenicsrom.post.studies import mesh_report

    density = _positive(options.density, "--density")
    found = _inspect(options)
    warnings, files = list(found.warnings), []
    if found.refusal is None:
        folder = Path(options.output or f"out/{Path(options.mesh).stem}")
        require_lasting(folder)
        picture = mesh_report.group_picture(found)
        files = [path for _, path in draw_pictures([picture], folder, warnings)]
    lines = mesh_report.lines(found, density)
    print_results(None, "\n".join(lines), warnings, files=files)
    if found.refusal is not None:
        raise found.refusal
    return 0


def init(options: argparse.Namespace) -> int:
    """Write a starter scene for a mesh file.

    Raises:
        SceneError: the mesh cannot be used, or the scene file exists.
    """
    from fenicsrom.files import atomic_write
    from fenicsrom.post.studies.starter import starter_scene

    path = Path(options.output or f"{Path(options.mesh).stem}.toml")
    require_lasting(path)
    if path.exists():
        reason = "the file exists; remove it, or choose another one with --output"
        raise SceneError(f"{path}: {reason}", kind=ErrorKind.FILE, key="output", source=str(path))
    found = _inspect(options)
    if found.refusal is not None:
        raise found.refusal
    with atomic_write(path) as temporary:
        temporary.write_text(starter_scene(found, path.parent), encoding="utf-8")
    print_results(None, "", found.warnings, [f"Now run: fenicsrom modes {path}"], [path])
    return 0


def _inspect(options: argparse.Namespace) -> Any:
    """Read the mesh file of the options."""
    from fenicsrom.fem.mesh.inspection import inspect

    scale, size = _positive(options.scale, "--scale"), _positive(options.size, "--size")
    return inspect(Path(options.mesh), scale or 1.0, size)


def _positive(text: str | None, name: str) -> float | None:
    """Read the number of an option, or None without it.

    Raises:
        SceneError: it is not a number above 0.
    """
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        reason = f"{name} {text}: must be a number above 0"
        raise SceneError(reason, kind=ErrorKind.RANGE, key=name.lstrip("-"))
    return value
