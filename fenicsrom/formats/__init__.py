"""Mesh files of other programs, each read by a module of its own into a `MeshFile`.

    abaqus    .inp of Abaqus and CalculiX
    nastran   .bdf, .nas, .dat
    ansys     .cdb, and .dat or .inp with NBLOCK
    meshio    .vtu, .vtk and other files of ParaView, .xdmf, .med, Exodus, and more

`fem.mesh.gmsh_files` puts a `MeshFile` into gmsh, whatever its format was. Nothing here needs
gmsh or dolfinx. A file is refused if a part of it that changes the mesh cannot be read; all other
parts that are left out are named.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.abaqus import read_abaqus
from fenicsrom.formats.ansys import read_ansys
from fenicsrom.formats.cells import complete, divided, sorted_elements
from fenicsrom.formats.collector import reading
from fenicsrom.formats.mesh_file import Block, MeshFile
from fenicsrom.formats.meshio_file import MODULES, read_meshio
from fenicsrom.formats.nastran import read_nastran

READERS = {"abaqus": read_abaqus, "nastran": read_nastran, "ansys": read_ansys}
"""Readers of finite-element models, by format."""

SUFFIXES = {
    ".inp": "abaqus",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".dat": "nastran",
    ".cdb": "ansys",
    **dict.fromkeys(MODULES, "meshio"),
}
"""Formats by the suffix of the file; `_format` looks at the content as well."""


def read(path: Path) -> MeshFile:
    """Read a mesh file.

    Returns:
        The mesh; for a finite-element model the cells of the highest dimension and the facets that
        name groups, for a file that meshio reads everything that it holds.

    Raises:
        SceneError: the file cannot be read, has no cells, or has content that changes the mesh and
            is not supported.
    """
    form = _format(path)
    if form == "meshio":
        mesh = read_meshio(path)
        if max((block.shape.dimension for block in mesh.blocks), default=0) < 2:
            raise refuse(path, "the file has no cells; write the file with its mesh")
        mesh = divided(mesh)
    else:
        with reading(path):
            mesh = READERS[form](path)
        mesh = _without_bending(sorted_elements(path, divided(mesh)))
    for block in mesh.blocks:
        if block.nodes.min() < 0 or block.nodes.max() >= len(mesh.points):
            raise refuse(path, "a cell refers to a node that is not in the file")
    if not np.isfinite(mesh.points).all():
        raise refuse(path, "a coordinate is not a finite number")
    # groups without a member would be in the way later
    blocks = [
        replace(block, groups={name: marks for name, marks in block.groups.items() if marks.any()})
        for block in mesh.blocks
    ]
    return replace(mesh, blocks=tuple(blocks))


SHELLS = re.compile(r"S\d.*|STRI.*|C(QUAD|TRIA)[R0-9]+|type (43|63|93|143|181|281)")
"""Names of elements that are shells in their own programs."""


def _without_bending(mesh: MeshFile) -> MeshFile:
    """Say that shells in a plane are read as plane cells."""
    names = dict.fromkeys(b.name for b in mesh.blocks if b.shape.dimension == 2)
    plane = all(block.shape.dimension < 3 for block in mesh.blocks)
    shells = [name for name in names if plane and SHELLS.fullmatch(name)]
    if not shells:
        return mesh
    note = f"the shells ({', '.join(shells)}) are read as cells of a plane body, which do not bend"
    return replace(mesh, notes=(*mesh.notes, note))


def _format(path: Path) -> str:
    """The format of a file: .inp and .dat files of several programs look different."""
    form = SUFFIXES[path.suffix.lower()]
    if form in ("abaqus", "nastran"):
        with path.open("rb") as file:
            head = file.read(1_000_000).decode(errors="replace")
        if re.search(r"^\s*(NBLOCK|EBLOCK)\s*,", head, flags=re.M | re.I):
            return "ansys"
        if path.suffix.lower() == ".dat" and re.search(r"^\s*\*NODE\b", head, flags=re.M | re.I):
            return "abaqus"
    return form
