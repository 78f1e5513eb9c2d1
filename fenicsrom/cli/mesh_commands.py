"""The commands on a mesh file: each takes the parsed options and returns the exit code."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from fenicsrom.cli.output import require_lasting
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ConvergenceError, ErrorKind, SceneError


def inspect(options: argparse.Namespace) -> int:
    """Describe a mesh file.

    Raises:
        SceneError: the file cannot be read, or its mesh cannot be used.
    """
    from fenicsrom.post.base.picture import draw_pictures
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
    """Write a starter scene beside a mesh file.

    Raises:
        SceneError: the mesh cannot be used, or the scene file exists.
    """
    from fenicsrom.files import atomic_write
    from fenicsrom.post.studies.starter import starter_scene, units_of

    path = Path(options.output or Path(options.mesh).with_suffix(".toml"))
    require_lasting(path)
    if path.exists():
        reason = "the file exists; remove it, or choose another one with --output"
        raise SceneError(f"{path}: {reason}", kind=ErrorKind.FILE, key="output", source=str(path))
    found = _inspect(options)
    if found.refusal is not None:
        raise found.refusal
    warnings = list(found.warnings)
    settings = {
        "units": units_of(found, options.units),
        "root": options.root,
        "tip": options.tip,
        "template": options.template,
    }
    text = starter_scene(found, path.parent, **settings)
    mode = _first_mode(text, path, options.tip, warnings)
    if mode is not None:
        text = starter_scene(found, path.parent, **settings, mode=mode)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    task = {"rub": "run", "damper": "run"}.get(options.template, options.template)
    task = "modes" if mode is None else task
    print_results(None, "", warnings, [f"Now run: fenicsrom {task} {path}"], [path])
    return 0


def _first_mode(text: str, path: Path, tip: str | None, warnings: list[str]) -> Any:
    """The first mode of a starter scene without loads; None, and a warning, if it has none."""
    from fenicsrom.assess.studies.first_mode import first_mode
    from fenicsrom.scene import Place, parse_scene
    from fenicsrom.scene.toml import parse_toml

    try:
        scene = parse_scene(parse_toml(text), str(path), path.parent, unloaded=True)
        return first_mode(scene, None if tip is None else Place(group=tip))
    except (SceneError, ConvergenceError) as error:
        warnings.append(f"the scene has no load yet, because its modes were not found: {error}")
        return None


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
