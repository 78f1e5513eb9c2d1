"""Files that meshio or, where it fails on a VTK file, pyvista reads.

Integer fields of cells and points, sets and tags become groups.
"""

import io
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.formats.mesh_file import Block, Ints, Marks, MeshFile, unsupported
from fenicsrom.formats.shapes import SHAPES, from_vtk

VALUES = 256
"""A field of integers with more values than this does not mark groups."""

MODULES = {
    ".vtu": "vtu",
    ".vtk": "vtk",
    ".pvtu": "",
    ".pvd": "",
    ".vtm": "",
    ".vtp": "",
    ".xdmf": "xdmf",
    ".xmf": "xdmf",
    ".e": "exodus",
    ".exo": "exodus",
    ".ex2": "exodus",
    ".med": "med",
    ".mesh": "medit",
    ".meshb": "medit",
    ".vol": "netgen",
    ".su2": "su2",
    ".avs": "avsucd",
}
"""Modules of meshio by the suffix of the file; without a module, pyvista alone reads it."""

VTK = (".vtu", ".vtk", ".pvtu", ".pvd", ".vtm", ".vtp")


def read_meshio(path: Path) -> MeshFile:
    """Read a file of one of these formats.

    Of a file with several blocks, the one with the cells of the highest dimension is read.

    Raises:
        SceneError: a package is missing, or the file cannot be read or has unknown cells.
    """
    try:
        import meshio

        kind_of = meshio.gmsh.meshio_to_gmsh_type
        for name, kind in kind_of.items():  # meshio 5.3.5 lacks two of them
            if kind in SHAPES:
                meshio._mesh.topological_dimension.setdefault(name, SHAPES[kind].dimension)
        mesh = _mesh_of(meshio, path)
    except ImportError as error:
        needed = error.name or str(error)
        reason = f"reading a {path.suffix} file needs {needed}: install it, or convert to .msh"
        raise refuse(path, reason, ErrorKind.DEPENDENCY) from None
    except (Exception, SystemExit) as error:  # a damaged file makes meshio raise any kind of error
        reason = " ".join(str(error).split()) or type(error).__name__
        message = f"cannot be read; the file may be truncated or damaged: {reason}"
        raise refuse(path, message) from error
    kept = [index for index, block in enumerate(mesh.cells) if len(block.data)]
    blocks = []
    for index in kept:
        name = mesh.cells[index].type
        if kind_of.get(name) not in SHAPES:
            raise refuse(path, unsupported(f"cells of type {name}"))
        nodes = np.asarray(mesh.cells[index].data, dtype=np.int64)
        blocks.append(Block(kind_of[name], from_vtk(kind_of[name], nodes), {}, name))
    for group, marks in _cell_groups(mesh, kept):
        present = zip(blocks, marks, strict=True)
        lowest = min(block.shape.dimension for block, mark in present if mark.any())
        for block, mark in zip(blocks, marks, strict=True):
            if block.shape.dimension == lowest:
                block.groups[group] = mark
    nodes_of = {name: np.asarray(nodes) for name, nodes in mesh.point_sets.items()}
    for field, values in mesh.point_data.items():
        names = getattr(mesh, "point_tags", {}) if field == "point_tags" else None
        for group, marks in _marked(str(field), [np.asarray(values)], names):
            nodes_of[group] = np.flatnonzero(marks[0])
    points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    return MeshFile(points, tuple(blocks), nodes_of)


def _mesh_of(meshio: Any, path: Path) -> Any:
    """The mesh of a file as meshio's record."""
    suffix = path.suffix.lower()
    failure: BaseException | None = None
    if module := MODULES[suffix]:
        try:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                return getattr(meshio, module).read(str(path))
        except (Exception, SystemExit) as error:
            if suffix not in VTK:
                raise
            failure = error
    try:
        import pyvista

        with pyvista.VtkErrorCatcher(raise_errors=True, send_to_logging=False):
            found = max(_leaves(pyvista.read(path)), key=lambda grid: grid.get_cell(0).dimension)
            return pyvista.to_meshio(found)
    except Exception as error:
        raise failure or error from None


def _leaves(block: Any) -> Iterator[Any]:
    """The grids with cells in a block of pyvista, at any depth."""
    if hasattr(block, "combine"):
        for part in block:
            yield from _leaves(part)
    elif block is not None and block.n_cells:
        yield block


def _cell_groups(mesh: Any, kept: list[int]) -> Iterator[tuple[str, list[Marks]]]:
    """The groups of cells of a mesh, with the members in each of the kept blocks."""
    for field, values in mesh.cell_data.items():
        names = getattr(mesh, "cell_tags", {}) if field == "cell_tags" else None
        yield from _marked(str(field), [np.asarray(values[index]) for index in kept], names)
    for name, parts in mesh.cell_sets.items():
        marks = []
        for index in kept:
            marks.append(np.zeros(len(mesh.cells[index].data), dtype=bool))
            marks[-1][np.asarray([] if parts[index] is None else parts[index], dtype=int)] = True
        if any(mark.any() for mark in marks):
            yield name, marks


def _marked(
    name: str, field: list[Ints], names: dict[int, list[str]] | None = None
) -> Iterator[tuple[str, list[Marks]]]:
    """The groups of an integer field: one if its values are 0 and 1, else one for each value.

    If names of the values are given, each name is a group.
    """
    if any(part.ndim != 1 or part.dtype.kind not in "iub" for part in field):
        return
    if names is not None:
        for group in dict.fromkeys(group for listed in names.values() for group in listed):
            values = [value for value, listed in names.items() if group in listed]
            marks = [np.isin(part, values) for part in field]
            if any(mark.any() for mark in marks):
                yield group.strip(), marks
        return
    values = np.unique(np.concatenate(field)).tolist()
    if set(values) <= {0, 1}:
        if 1 in values:
            yield name, [part == 1 for part in field]
    elif len(values) <= VALUES:
        for value in values:
            yield f"{name}:{value}", [part == value for part in field]
