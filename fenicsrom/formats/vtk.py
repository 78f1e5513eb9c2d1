"""VTK files (.vtu, .vtk) through meshio. Integer fields become groups."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.formats.mesh_file import Block, Ints, Marks, MeshFile, unsupported
from fenicsrom.formats.shapes import SHAPES, from_vtk

VALUES = 256
"""A field of integers with more values than this does not mark groups."""


def read_vtk(path: Path) -> MeshFile:
    """Read a .vtu or .vtk file.

    Raises:
        SceneError: meshio is missing, or the file cannot be read or has unknown cells.
    """
    try:
        import meshio
    except ImportError:
        reason = f"reading a {path.suffix} file needs meshio: install it, or convert to .msh"
        raise refuse(path, reason, ErrorKind.DEPENDENCY) from None
    try:
        module = meshio.vtu if path.suffix.lower() == ".vtu" else meshio.vtk
        mesh = module.read(path)
    except (Exception, SystemExit) as error:  # a damaged file makes meshio raise any kind of error
        reason = " ".join(str(error).split()) or type(error).__name__
        message = f"cannot be read; the file may be truncated or damaged: {reason}"
        raise refuse(path, message) from error
    kept = [index for index, block in enumerate(mesh.cells) if len(block.data)]
    names = [mesh.cells[index].type for index in kept]
    kinds = [meshio.gmsh.meshio_to_gmsh_type.get(name) for name in names]
    for name, kind in zip(names, kinds, strict=True):
        if kind not in SHAPES:
            raise refuse(path, unsupported(f"cells of type {name}"))
    blocks = []
    for name, kind, index in zip(names, kinds, kept, strict=True):
        nodes = np.asarray(mesh.cells[index].data, dtype=np.int64)
        blocks.append(Block(kind, from_vtk(kind, nodes), {}, name))
    for field, values in mesh.cell_data.items():
        for group, marks in _marked(str(field), [np.asarray(values[index]) for index in kept]):
            present = zip(blocks, marks, strict=True)
            lowest = min(block.shape.dimension for block, mark in present if mark.any())
            for block, mark in zip(blocks, marks, strict=True):
                if block.shape.dimension == lowest:
                    block.groups[group] = mark
    nodes_of = {}
    for field, values in mesh.point_data.items():
        for group, marks in _marked(str(field), [np.asarray(values)]):
            nodes_of[group] = np.flatnonzero(marks[0])
    points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    return MeshFile(points, tuple(blocks), nodes_of)


def _marked(name: str, field: list[Ints]) -> Iterator[tuple[str, list[Marks]]]:
    """The groups of an integer field: one if its values are 0 and 1, else one for each value."""
    if any(part.ndim != 1 or part.dtype.kind not in "iub" for part in field):
        return
    values = np.unique(np.concatenate(field))
    if np.isin(values, (0, 1)).all():
        if 1 in values:
            yield name, [part == 1 for part in field]
    elif len(values) <= VALUES:
        for value in values:
            yield f"{name}:{value}", [part == value for part in field]
