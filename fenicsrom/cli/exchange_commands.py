"""The commands that exchange models with other programs; each returns the exit code."""

from __future__ import annotations

import argparse
from pathlib import Path

from fenicsrom.cli.output import require_lasting
from fenicsrom.cli.printing import print_results


def export(options: argparse.Namespace) -> int:
    """Write a stored model for another program.

    Raises:
        SceneError: the model cannot be read.
    """
    from fenicsrom.online import archive
    from fenicsrom.online.exchange.export import SUFFIXES
    from fenicsrom.online.exchange.export import export as write

    model = Path(options.model)
    stored = archive.load_model(model)
    path = Path(options.output or f"{model.stem}{SUFFIXES[options.format]}")
    require_lasting(path)
    found = write(stored, path, options.format)
    print_results(stored.scene, "", [], found.notes, found.files)
    return 0


def import_matrices(options: argparse.Namespace) -> int:
    """Make a stored model of the matrices of a superelement.

    Raises:
        SceneError: the matrices or the scene cannot be used.
    """
    from fenicsrom.online import archive
    from fenicsrom.online.exchange.superelement import read_matrices, superelement_model
    from fenicsrom.scene.rules import counted
    from fenicsrom.scene.superelement import read_superelement_scene

    matrices, scene = Path(options.matrices), options.superelement_scene
    path = Path(options.output or f"{matrices.stem}.npz")
    require_lasting(path)
    given = read_superelement_scene(scene, matrices)
    stored = superelement_model(read_matrices(matrices), given)
    archive.save_model(path, stored)
    points = stored.model.points.contact.size
    lowest = ", ".join(f"{value:.6g}" for value in stored.frequencies_hz[:5])
    lines = [
        f"{counted(stored.size, 'coordinate')}, {counted(points, 'contact point')}",
        f"lowest natural frequencies: {lowest} Hz",
        f"Now run: fenicsrom run --from {path}",
    ]
    print_results(stored.scene, "", [], lines, [path])
    return 0
