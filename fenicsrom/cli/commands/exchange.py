"""`fenicsrom export` and `import`: models and matrices of other programs."""

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import FILE, SET, Argument, command, refused
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.errors import ErrorKind

MODEL = Argument("model", help="the reduced_model.npz of an earlier run; for inp a scene file")
FORMAT = Argument(
    "--format",
    required=True,
    choices=("mat", "fmu", "dmig", "op4", "inp"),
    help="mat (MATLAB and Octave) and fmu (a Functional Mock-up Unit) hold "
    "the nonlinear model; dmig and op4 (Nastran) hold the linear part of the model; inp "
    "is the CalculiX deck of a scene",
)
FREQUENCIES = Argument(
    "--frequencies",
    action="store_true",
    help="with inp: only the natural frequencies about the equilibrium, without loads that vary",
)


@command(
    "write a stored reduced model for MATLAB or Nastran, or a scene for CalculiX",
    MODEL,
    FORMAT,
    FREQUENCIES,
    SET,
    FILE,
)
def export(options: argparse.Namespace) -> int:
    """Write a stored model, or the deck of a scene, for another program.

    Raises:
        SceneError: the model or the scene cannot be read.
    """
    from fenicsrom.assess.errors.comparisons import of_model
    from fenicsrom.exchange.export import SUFFIXES
    from fenicsrom.exchange.export import export as write
    from fenicsrom.online.store import archive

    model = Path(options.model)
    is_model = model.suffix.lower() == ".npz"
    if is_model != (options.format != "inp"):
        needed = "a stored model (.npz)" if options.format != "inp" else "a scene file"
        reason = f"needs {needed}, but is given {model}"
        raise refused("--format", options.format, reason, ErrorKind.CONFLICT)
    if is_model and options.frequencies:
        reason = "only allowed with --format inp"
        raise refused("--frequencies", options.format, reason, ErrorKind.CONFLICT)
    if not is_model:
        return _export_scene(options)
    stored = archive.load_model(model).with_overrides(options.overrides)
    path = target(options.output or f"{model.stem}{SUFFIXES[options.format]}", model)
    found, judged = write(stored, path, options.format), of_model(stored)
    lines = [*found.notes, *filter(None, [judged.sentence()])]
    print_results(stored.scene, "", judged.warnings(stored.scene), lines, found.files)
    return 0


def _export_scene(options: argparse.Namespace) -> int:
    """Write the CalculiX deck of a scene."""
    from fenicsrom.exchange.calculix import write_deck
    from fenicsrom.exchange.deck import scene_deck
    from fenicsrom.scene import read_scene

    scene = read_scene(options.model, options.overrides, unloaded=True)
    name = options.output or f"{Path(options.model).stem}.inp"
    path = target(name, options.model, *scene.geometry.files)
    deck = scene_deck(scene, frequencies=options.frequencies)
    write_deck(path, deck)
    print_results(scene, "", deck.notes, [f"Now run: ccx {path.with_suffix('')}"], [path])
    return 0


MATRICES = Argument("matrices", help="file of the matrices: .op4, .bdf, .pch, .mtx, .mat or .npz")
INTERFACE_SCENE = Argument(
    "--scene",
    required=True,
    dest="superelement_scene",
    metavar="SCENE",
    help="scene file (TOML) with the tables [superelement] and [[nodes]]",
)


@command(
    "make a reduced model of the matrices of a linear superelement",
    MATRICES,
    INTERFACE_SCENE,
    FILE,
    name="import",
)
def import_matrices(options: argparse.Namespace) -> int:
    """Make a stored model of the matrices of a superelement.

    Raises:
        SceneError: the matrices or the scene cannot be used.
    """
    from fenicsrom.exchange.superelement import read_matrices, superelement_model
    from fenicsrom.online.store import archive
    from fenicsrom.scene.reading.superelement import read_superelement_scene
    from fenicsrom.words import counted

    matrices, scene = Path(options.matrices), options.superelement_scene
    path = target(options.output or f"{matrices.stem}.npz", matrices, scene)
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
