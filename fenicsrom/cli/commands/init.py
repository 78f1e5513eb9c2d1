"""`fenicsrom init`: write a starter scene for a mesh file."""

from __future__ import annotations

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import FILE, MESH, SCALE, SIZE, Command
from fenicsrom.cli.mesh_files import inspected
from fenicsrom.cli.output import require_lasting
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind, SceneError


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
    found = inspected(options)
    if found.refusal is not None:
        raise found.refusal
    with atomic_write(path) as temporary:
        temporary.write_text(starter_scene(found, path.parent), encoding="utf-8")
    print_results(None, "", found.warnings, [f"Now run: fenicsrom modes {path}"], [path])
    return 0


COMMAND = Command(
    "init",
    "write a starter scene for a mesh file",
    init,
    (
        MESH,
        SCALE,
        SIZE,
        FILE,
    ),
)
