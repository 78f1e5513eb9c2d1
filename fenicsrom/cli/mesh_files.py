"""Mesh files on the command line."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from fenicsrom.cli.arguments import refused
from fenicsrom.errors import ErrorKind


def inspected(options: argparse.Namespace) -> Any:
    """Read the mesh file of the options."""
    from fenicsrom.fem.mesh.inspection import inspect

    scale, size = positive(options.scale, "--scale"), positive(options.size, "--size")
    return inspect(Path(options.mesh), scale or 1.0, size)


def positive(text: str | None, name: str) -> float | None:
    """Read the number of an option; None if the option is not given.

    Raises:
        SceneError: the number is not above 0.
    """
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise refused(name, text, "must be a number above 0", ErrorKind.RANGE)
    return value
