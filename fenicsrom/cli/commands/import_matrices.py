"""`fenicsrom import`: make a reduced model of the matrices of a superelement."""

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import FILE, Argument, command
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results

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
