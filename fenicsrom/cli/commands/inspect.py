"""`fenicsrom inspect`: describe a mesh file."""

import argparse
from pathlib import Path

from fenicsrom.cli.arguments import MESH, OUTPUT, SCALE, SIZE, Argument, command
from fenicsrom.cli.output import target
from fenicsrom.cli.printing import print_results
from fenicsrom.cli.starting import inspected, positive
from fenicsrom.notes import note_of

DENSITY = Argument("--density", metavar="NUMBER", help="density in kg/m³, for the mass")


@command(
    "describe a mesh file: cells, box, volume, mass, groups and what is not read",
    MESH,
    DENSITY,
    SCALE,
    SIZE,
    OUTPUT,
)
def inspect(options: argparse.Namespace) -> int:
    """Describe a mesh file.

    Raises:
        SceneError: the file cannot be read, or its mesh cannot be used.
    """
    from fenicsrom.post.base.picture import draw_pictures
    from fenicsrom.post.studies import mesh_report

    density = positive(options.density, "--density")
    found = inspected(options)
    warnings, files = [*map(note_of, found.warnings)], []
    if found.refusal is None:
        folder = target(options.output or f"out/{Path(options.mesh).stem}")
        picture = mesh_report.group_picture(found)
        files = [one.path for one in draw_pictures([picture], folder, warnings)]
        files += mesh_report.write_group_page(found, folder, warnings)
    lines = mesh_report.lines(found, density)
    print_results(None, "\n".join(lines), warnings, files=files)
    if found.refusal is not None:
        raise found.refusal
    return 0
