"""Mesh files of other programs, through meshio: Abaqus .inp, Nastran .bdf and VTK .vtu.

The nodes of a cell are in gmsh's order. Sets and integer fields become groups. A file is refused if
meshio would silently read a wrong mesh from it.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenicsrom.errors import ErrorKind, SceneError

Ints = npt.NDArray[Any]
Marks = list[npt.NDArray[np.bool_]]
Floats = npt.NDArray[np.float64]

PART = "\x1f"  # separates the name of a set from the number of its part
VALUES = 256  # a field of integers with more values than this does not mark groups

# meshio's names of cells (nodes as VTK orders them) -> gmsh type, and gmsh's order of the nodes
# where it differs
CELLS: dict[str, tuple[int, list[int] | None]] = {
    "vertex": (15, None),
    "line": (1, None),
    "line3": (8, None),
    "triangle": (2, None),
    "triangle6": (9, None),
    "quad": (3, None),
    "quad8": (16, None),
    "quad9": (10, None),
    "tetra": (4, None),
    "tetra4": (4, None),
    "tetra10": (11, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]),
    "hexahedron": (5, None),
    "hexahedron20": (17, [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14]),
    "hexahedron27": (
        12,
        [
            0,
            1,
            2,
            3,
            4,
            5,
            6,
            7,
            8,
            11,
            16,
            9,
            17,
            10,
            18,
            19,
            12,
            15,
            13,
            14,
            24,
            22,
            20,
            21,
            23,
            25,
            26,
        ],
    ),
    "wedge": (6, None),
    "pyramid": (7, None),
}
# Faces of a hexahedron of 20 nodes in VTK's order, four corners and four midsides, in the order of
# nodes 20 to 25 of 27
FACES = [
    [0, 4, 7, 3, 16, 15, 19, 11],
    [1, 2, 6, 5, 9, 18, 13, 17],
    [0, 1, 5, 4, 8, 17, 12, 16],
    [3, 7, 6, 2, 19, 14, 18, 10],
    [0, 1, 2, 3, 8, 9, 10, 11],
    [4, 5, 6, 7, 12, 13, 14, 15],
]


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The content of a mesh file.

    Attributes:
        points: coordinates of the nodes, shape (n, 3).
        blocks: gmsh type, and node indices in gmsh's order, shape (k, nodes), of the cells of each
        block.
        groups: for each group, the cells of each block that belong to it.
        nodes: node indices of each node set.
    """

    points: Floats
    blocks: list[tuple[int, Ints]]
    groups: dict[str, Marks]
    nodes: dict[str, Ints]


def read(path: Path, form: str, curved: bool) -> MeshFile:
    """Read a file.

    Args:
        path: the file.
        form: "abaqus", "nastran" or "vtu".
        curved: whether to add the nodes that serendipity cells (of 8 and 20 nodes) lack.

    Returns:
        The mesh as the file holds it: cells of any dimension and of mixed types.

    Raises:
        SceneError: meshio is missing, the file cannot be read, or it has no cells, unknown cells,
            or cells without nodes.
    """
    mesh = _parse(path, form)
    points = np.asarray(mesh.points, dtype=np.float64).reshape(len(mesh.points), -1)
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells if len(block.data)]
    if not blocks:
        raise SceneError(
            f"{path}: the file has no cells; write the file with its mesh",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    for kind, cells in blocks:
        if kind not in CELLS:
            raise SceneError(
                f"{path}: cells of type {kind} are not supported; use triangles, quadrilaterals, "
                "tetrahedra or hexahedra",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
        if cells.min() < 0 or cells.max() >= len(points):
            raise SceneError(
                f"{path}: a cell refers to a node that is not in the file; the mesh is incomplete",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
    if not np.isfinite(points).all():
        raise SceneError(
            f"{path}: a coordinate is not a finite number",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    groups, nodes = _groups(mesh, form), _node_sets(mesh)
    if curved:
        points, blocks, nodes = _complete(points, blocks, nodes)
    ordered = []
    for kind, cells in blocks:
        number, order = CELLS[kind]
        ordered.append((number, cells if order is None else cells[:, order]))
    return MeshFile(points, ordered, groups, nodes)


def _parse(path: Path, form: str) -> Any:
    """Read a file with meshio; refuse content that meshio would silently read wrongly."""
    try:
        import meshio
    except ImportError:
        raise SceneError(
            f"{path}: reading a {path.suffix} file needs meshio: install it, or convert to .msh",
            kind=ErrorKind.DEPENDENCY,
            source=str(path),
        ) from None
    try:
        if form == "vtu":
            return meshio.vtu.read(path)
        text = path.read_text(errors="replace").replace("\r", "") + "\n"
        if form == "abaqus":
            text = _check_abaqus(path, text)
            mesh = meshio.abaqus.read(io.StringIO(text))
            _element_sets(mesh, text)
            return mesh
        mesh = meshio.nastran.read(io.StringIO(_check_nastran(path, text)))
    except SceneError:
        raise
    except (Exception, SystemExit) as error:  # a damaged file makes meshio raise any kind of error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SceneError(
            f"{path}: cannot be read; the file may be truncated or damaged: {reason}",
            kind=ErrorKind.FORMAT,
            source=str(path),
        ) from error
    if np.any(mesh.point_data.get("nastran:ref", 0)):
        raise SceneError(
            f"{path}: a GRID has its own coordinate system; use the basic system "
            "(field 3 empty or 0)",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    return mesh


def _check_abaqus(path: Path, text: str) -> str:
    """Refuse what meshio would skip in an Abaqus file.

    Returns:
        The text with keywords and types in capitals.
    """
    lines = [
        re.sub(r"^\*[^,]*|\bTYPE *= *\w+", lambda match: match[0].upper(), line, flags=re.I)
        for line in text.splitlines()
        if not line.startswith("**")
    ]
    keywords = [line.partition(",")[0].strip() for line in lines if line.startswith("*")]
    if keywords.count("*NODE") != 1:
        raise SceneError(
            f"{path}: the file has {keywords.count('*NODE')} *NODE blocks; "
            "one is allowed, with all nodes of one part",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    if "*INCLUDE" in keywords:
        raise SceneError(
            f"{path}: *INCLUDE is not supported; write everything into one file",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    block = ""
    for index, line in enumerate(lines):
        if line.startswith("*"):
            block = line.partition(",")[0].strip()
            if block in (
                "*NSET",
                "*ELSET",
            ):  # a set may be given in several parts: meshio would keep only the last one
                lines[index] = re.sub(
                    r"(,\s*N?E?L?SET\s*=\s*[^,]*)",
                    rf"\g<1>{PART}{index}",
                    line,
                    count=1,
                    flags=re.I,
                )
        elif block in ("*NSET", "*ELSET") and re.search(r"[^-0-9,\s]", line):
            raise SceneError(
                f"{path}: {block} lists the names of other sets ({line.strip()}); "
                "list node or element numbers instead",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
    return "\n".join(lines) + "\n"


def _element_sets(mesh: Any, text: str) -> None:
    """Put the sets that *ELEMENT names by ELSET= into the mesh.

    Meshio assigns these sets to wrong blocks if some *ELEMENT has no ELSET=.
    """
    blocks = re.findall(r"^\*ELEMENT *,(.*)$", text, flags=re.MULTILINE)
    names = [re.search(r"ELSET *= *\"?([^,\"]+)", line, flags=re.I) for line in blocks]
    for name in {match[1].strip() for match in names if match}:
        own = [match is not None and match[1].strip() == name for match in names]
        mesh.cell_sets[name] = [
            np.arange(len(block.data) * mine) for block, mine in zip(mesh.cells, own, strict=True)
        ]


def _check_nastran(path: Path, text: str) -> str:
    """Refuse a truncated bulk data file; return its text with the line that meshio looks for."""
    if not re.search(r"^ENDDATA", text, flags=re.MULTILINE):
        raise SceneError(
            f"{path}: the file does not end with ENDDATA; it may be truncated",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    if not re.search(
        r"^[A-Z]+\*? *,? *[0-9]", text.partition("BEGIN BULK")[2] or text, flags=re.MULTILINE
    ):
        raise SceneError(
            f"{path}: the file has no cells; write the file with its mesh",
            kind=ErrorKind.FORMAT,
            source=str(path),
        )
    return text if re.search(r"^ *BEGIN BULK", text, flags=re.MULTILINE) else "BEGIN BULK\n" + text


def _groups(mesh: Any, form: str) -> dict[str, Marks]:
    """The cells of each group, block by block, from cell sets and integer fields of the cells."""
    blocks = [block for block in mesh.cells if len(block.data)]
    kept = [index for index, block in enumerate(mesh.cells) if len(block.data)]
    found: dict[str, Marks] = {}
    for name, members in mesh.cell_sets.items():
        marks = found.setdefault(
            _set_name(name), [np.zeros(len(block.data), dtype=bool) for block in blocks]
        )
        for mark, index in zip(marks, kept, strict=True):
            if index < len(members) and members[index] is not None:
                mark[np.asarray(members[index], dtype=np.int64)] = True
    for name, values in mesh.cell_data.items():
        field = [np.asarray(values[index]) for index in kept]
        for group, marks in _marked(form, str(name), field):
            lowest = min(block.dim for block, mark in zip(blocks, marks, strict=True) if mark.any())
            found[group] = [
                mark & (block.dim == lowest) for block, mark in zip(blocks, marks, strict=True)
            ]
    return found


def _node_sets(mesh: Any) -> dict[str, Ints]:
    """Indices of the nodes of each node set, and of each integer field of the points."""
    found: dict[str, Ints] = {}
    for name, nodes in mesh.point_sets.items():
        found[_set_name(name)] = np.union1d(found.get(_set_name(name), []), nodes).astype(np.int64)
    for name, values in mesh.point_data.items():
        for group, marks in _marked("", str(name), [np.asarray(values)]):
            found[group] = np.flatnonzero(marks[0])
    return found


def _set_name(name: str) -> str:
    """The name of the set to which a part belongs, without quotes."""
    return str(name).partition(PART)[0].strip().strip('"')


def _marked(form: str, name: str, field: list[Ints]) -> Iterator[tuple[str, Marks]]:
    """The groups of an integer field: one if its values are 0 and 1, else one for each value."""
    if any(part.ndim != 1 or part.dtype.kind not in "iub" for part in field):
        return
    values = np.unique(np.concatenate(field))
    if np.isin(values, (0, 1)).all() and form != "nastran":
        if 1 in values:
            yield name, [part == 1 for part in field]
    elif len(values) <= VALUES:
        for value in values:
            yield (
                str(value) if form == "nastran" else f"{name}:{value}",
                [part == value for part in field],
            )


def _complete(
    points: Floats, blocks: list[tuple[str, Ints]], sets: dict[str, Ints]
) -> tuple[Floats, list[tuple[str, Ints]], dict[str, Ints]]:
    """Add the nodes of degree 2 that serendipity cells lack, by the shape functions of the cell.

    A node in the middle of a face is in the node sets that contain the whole face.
    """
    faces = [np.empty((0, 8), dtype=np.int64)]
    for kind, rows in blocks:
        if kind in ("quad8", "hexahedron20"):
            faces.append(rows[:, FACES].reshape(-1, 8) if kind == "hexahedron20" else rows)
    every = np.concatenate(faces)
    _, first, which = np.unique(
        np.sort(every[:, :4], axis=1), axis=0, return_index=True, return_inverse=True
    )
    middle = len(points) + which.ravel()
    unique = every[first]
    sets = {
        name: np.concatenate(
            [nodes, len(points) + np.flatnonzero(np.isin(unique, nodes).all(axis=1))]
        )
        for name, nodes in sets.items()
    }
    added = 0.5 * points[unique[:, 4:]].sum(axis=1) - 0.25 * points[unique[:, :4]].sum(axis=1)
    points = np.concatenate([points, added])
    done, start = [], 0
    for kind, rows in blocks:
        if kind == "quad8":
            done.append(("quad9", np.column_stack([rows, middle[start : start + len(rows)]])))
            start += len(rows)
        elif kind == "hexahedron20":
            centre = 0.25 * points[rows[:, 8:]].sum(axis=1) - 0.25 * points[rows[:, :8]].sum(axis=1)
            sides = middle[start : start + 6 * len(rows)].reshape(-1, 6)
            start += 6 * len(rows)
            done.append(
                ("hexahedron27", np.column_stack([rows, sides, len(points) + np.arange(len(rows))]))
            )
            points = np.concatenate([points, centre])
        else:
            done.append((kind, rows))
    return points, done, sets
