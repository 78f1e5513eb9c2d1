"""The commands that exchange models with other programs; each returns the exit code."""

from __future__ import annotations

import argparse
from pathlib import Path

from fenicsrom.cli.output import require_lasting, require_other
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind, SceneError


def export(options: argparse.Namespace) -> int:
    """Write a stored model, or the deck of a scene, for another program.

    Raises:
        SceneError: the model or the scene cannot be read.
    """
    from fenicsrom.exchange.export import SUFFIXES
    from fenicsrom.exchange.export import export as write
    from fenicsrom.online.store import archive

    model = Path(options.model)
    is_model = model.suffix.lower() == ".npz"
    if is_model != (options.format != "inp"):
        needed = "a stored model (.npz)" if options.format != "inp" else "a scene file"
        raise SceneError(
            f"{model}: --format {options.format} needs {needed}",
            kind=ErrorKind.CONFLICT,
            key="--format",
            source=str(model),
        )
    if not is_model:
        return _export_scene(options)
    stored = archive.load_model(model).with_overrides(options.overrides)
    path = Path(options.output or f"{model.stem}{SUFFIXES[options.format]}")
    require_lasting(path)
    require_other(path, [model])
    found = write(stored, path, options.format)
    print_results(stored.scene, "", [], found.notes, found.files)
    return 0


def _export_scene(options: argparse.Namespace) -> int:
    """Write the CalculiX deck of a scene."""
    from fenicsrom.exchange.calculix import write_deck
    from fenicsrom.exchange.deck import scene_deck
    from fenicsrom.scene import read_scene

    scene = read_scene(options.model, options.overrides, unloaded=True)
    path = Path(options.output or f"{Path(options.model).stem}.inp")
    require_lasting(path)
    require_other(path, [Path(options.model), scene.geometry.mesh])
    deck = scene_deck(scene)
    write_deck(path, deck)
    print_results(scene, "", deck.notes, [f"Now run: ccx {path.with_suffix('')}"], [path])
    return 0


def import_matrices(options: argparse.Namespace) -> int:
    """Make a stored model of the matrices of a superelement.

    Raises:
        SceneError: the matrices or the scene cannot be used.
    """
    from fenicsrom.exchange.superelement import read_matrices, superelement_model
    from fenicsrom.online.store import archive
    from fenicsrom.scene.rules import counted
    from fenicsrom.scene.superelement import read_superelement_scene

    matrices, scene = Path(options.matrices), options.superelement_scene
    path = Path(options.output or f"{matrices.stem}.npz")
    require_lasting(path)
    require_other(path, [matrices, Path(scene)])
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
