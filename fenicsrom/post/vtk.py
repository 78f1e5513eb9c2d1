"""Files for ParaView: fields on the solid mesh and values at its contact points.

The files are in VTK's XML format: `.vtu` for a grid with one point array per label, `.vtp` for
contact points. This module writes them without dolfinx, so that all labels share one file,
quadratic cells keep VTK's quadratic types and a full disk raises an error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.progress import tracked

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace


# Cell -> VTK's types of the linear and the quadratic cell, and the reference coordinates of the
# nodes of the quadratic cell in halves and in VTK's order (corners, edges, faces, centre). The
# corners alone make the linear cell.
_CELLS: dict[str, tuple[tuple[int, int], str]] = {
    "triangle": ((5, 22), "00 20 02 10 11 01"),
    "quadrilateral": ((9, 28), "00 20 22 02 10 21 12 01 11"),
    "tetrahedron": ((10, 24), "000 200 020 002 100 110 010 001 101 011"),
    "hexahedron": (
        (12, 29),
        "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021 "
        "011 211 101 121 110 112 111",
    ),
}


def write_fields(
    folder: str | Path, name: str, space: FunctionSpace, fields: Mapping[str, np.ndarray | Function]
) -> Path:
    """Write displacement fields as point arrays of one grid. Collective.

    One rank writes the file `folder/name.vtu`. Several ranks write the folder `folder/name`, which
    holds one piece per rank and the file `name.pvtu` to open.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the file, without suffix.
        space: vector Lagrange space of degree 1 or 2.
        fields: label -> nodal values, as an array of the local and ghost unknowns or a Function.

    Returns:
        The file to open.

    Raises:
        OSError: the file cannot be written; no partial file remains.
    """
    comm = space.mesh.comm
    grid = _grid(space)
    arrays = {label: _nodal(grid, space, field) for label, field in fields.items()}
    if comm.size == 1:
        path = Path(folder) / f"{name}.vtu"
        with atomic_write(path) as temporary:
            _write_vtu(temporary, grid, arrays)
        return path
    path = Path(folder) / name
    with atomic_folder(path, comm) as temporary:
        file = _write_parts(temporary, name, grid, arrays, comm)
    return path / file


def write_motion(
    folder: str | Path,
    name: str,
    space: FunctionSpace,
    times: Sequence[float] | np.ndarray,
    frames: Callable[[int], np.ndarray | Function] | np.ndarray | Sequence[np.ndarray],
    label: str = "displacement",
) -> Path:
    """Write a displacement that changes in time, one grid per instant. Collective.

    The files are in the folder `folder/name`: one per instant and rank, and `name.pvd` to open. An
    older folder of this name is replaced as a whole.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the new folder and of the files in it.
        space: vector Lagrange space of degree 1 or 2.
        times: (n_frames,) instants, s.
        frames: displacement of the local and ghost unknowns, m: an array (n_frames, n_unknowns), or
            a function of the frame number. The function is called once for each frame in order, on
            every rank at a different moment: it must not communicate.
        label: name of the point array.

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; no partial file remains.
    """
    comm = space.mesh.comm
    grid = _grid(space)
    frame: Callable[[int], Any] = frames if callable(frames) else frames.__getitem__
    path = Path(folder) / name
    with atomic_folder(path, comm) as temporary:
        entries = []
        for number, time in enumerate(tracked(times)):
            file = _write_parts(
                temporary,
                f"{name}_{number:05d}",
                grid,
                {label: _nodal(grid, space, frame(number))},
                comm,
            )
            entries.append((float(time), file))
        if comm.rank == 0:
            _write_series(temporary / f"{name}.pvd", entries)
    return path / f"{name}.pvd"


def write_points(
    folder: str | Path,
    name: str,
    times: Sequence[float] | np.ndarray,
    points: np.ndarray,
    arrays: Mapping[str, np.ndarray],
) -> Path:
    """Write points with values that change in time, one point set per instant. Not collective.

    The files are in the folder `folder/name`: one per instant, and `name.pvd` to open. An older
    folder of this name is replaced as a whole.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the new folder and of the files in it.
        times: (n_frames,) instants, s.
        points: (P, 3) positions in the undeformed body, m.
        arrays: label -> scalars (n_frames, P), of 8 bytes or int8, or vectors (n_frames, P, 3).

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; no partial file remains.
    """
    path = Path(folder) / name
    with atomic_folder(path) as temporary:
        entries = [(float(time), f"{name}_{number:05d}.vtp") for number, time in enumerate(times)]
        for number, (_, file) in enumerate(entries):
            _write_vtp(
                temporary / file,
                points,
                {label: values[number] for label, values in arrays.items()},
            )
        _write_series(temporary / f"{name}.pvd", entries)
    return path / f"{name}.pvd"


@dataclass(frozen=True)
class _Grid:
    """The cells of one rank in VTK's numbering.

    Attributes:
        points: (n_points, 3) coordinates, m.
        cells: (n_cells, nodes per cell) point numbers of each cell.
        cell_type: VTK's number of the cell type.
        nodes: (n_points,) local numbers of the points in the function space.
    """

    points: np.ndarray
    cells: np.ndarray
    cell_type: int
    nodes: np.ndarray


def _grid(space: FunctionSpace) -> _Grid:
    """Make the grid of the cells that this rank owns, all with positive volume."""
    mesh = space.mesh
    d = mesh.topology.dim
    (linear, quadratic), digits = _CELLS[mesh.topology.cell_type.name]
    nodes = np.asarray(space.element.basix_element.points)
    reference = (
        np.array([[int(digit) for digit in node] for node in digits.split()])[: len(nodes)] / 2
    )

    def places(points: np.ndarray, among: np.ndarray) -> np.ndarray:
        """Find points in a list of points."""
        distance = np.abs(points[:, None] - among[None]).max(axis=2)
        if len(points) > len(among) or distance.min(axis=1).max() > 1e-12:
            raise ValueError("fields are written from Lagrange spaces of degree 1 or 2 only")
        return distance.argmin(axis=1)

    owned = mesh.topology.index_map(d).size_local
    cells = space.dofmap.list[:owned][:, places(reference, nodes)]
    points = space.tabulate_dof_coordinates()
    corners = points[cells[:, places(np.vstack([np.zeros(d), np.eye(d)]), reference)], :d]
    inverted = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    mirror = places(reference[:, [1, 0, *range(2, d)]], reference)
    cells = np.where(inverted[:, None], cells[:, mirror], cells)
    used, renumbered = np.unique(cells, return_inverse=True)
    cell_type = linear if len(nodes) == 2**d or len(nodes) == d + 1 else quadratic
    return _Grid(points[used], renumbered.reshape(cells.shape), cell_type, used)


def unknowns_of(space: FunctionSpace, field: np.ndarray | Function) -> np.ndarray:
    """Give the array of local and ghost unknowns of a field."""
    values = np.asarray(field.x.array if hasattr(field, "x") else field)
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    expected = (index_map.size_local + index_map.num_ghosts) * block
    if values.shape != (expected,):
        raise ValueError(
            f"a field has shape {values.shape}, but the space has {expected} local and ghost "
            "unknowns"
        )
    return values


def _nodal(grid: _Grid, space: FunctionSpace, field: np.ndarray | Function) -> np.ndarray:
    """Give the vectors (n_points, 3) at the points of the grid, padded with zeros in 2D."""
    values = unknowns_of(space, field).reshape(-1, space.dofmap.index_map_bs)
    vectors = np.zeros((len(grid.nodes), 3))
    vectors[:, : values.shape[1]] = values[grid.nodes]
    return vectors


def _write_vtu(path: Path, grid: _Grid, arrays: Mapping[str, np.ndarray]) -> None:
    """Write one grid."""
    count, per_cell = grid.cells.shape
    cells = {
        "connectivity": grid.cells.astype(np.int64).ravel(),
        "offsets": np.arange(1, count + 1, dtype=np.int64) * per_cell,
        "types": np.full(count, grid.cell_type, dtype=np.uint8),
    }
    _write_vtk(path, "UnstructuredGrid", grid.points, arrays, "Cells", count, cells)


def _write_vtp(path: Path, points: np.ndarray, arrays: Mapping[str, np.ndarray]) -> None:
    """Write one point set."""
    count = np.arange(len(points), dtype=np.int64)
    _write_vtk(
        path,
        "PolyData",
        points,
        arrays,
        "Verts",
        len(points),
        {"connectivity": count, "offsets": count + 1},
    )


def _write_vtk(
    path: Path,
    kind: str,
    points: np.ndarray,
    arrays: Mapping[str, np.ndarray],
    section: str,
    count: int,
    cells: Mapping[str, np.ndarray],
) -> None:
    """Write points, their arrays and `count` cells: an XML header, then the raw arrays."""
    blocks: list[np.ndarray] = []
    position = 0

    def array(values: np.ndarray, name: str) -> str:
        nonlocal position
        values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        vtk_type = {"f8": "Float64", "i8": "Int64", "u1": "UInt8", "i1": "Int8"}[
            values.dtype.str[1:]
        ]
        components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
        tag = (
            f'<DataArray type="{vtk_type}" Name={quoteattr(name)}{components} '
            f'format="appended" offset="{position}"/>'
        )
        blocks.append(values)
        position += 8 + values.nbytes
        return tag

    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<{kind}><Piece NumberOfPoints="{len(points)}" NumberOf{section}="{count}">',
        "<PointData>",
        *(array(values, label) for label, values in arrays.items()),
        "</PointData><Points>",
        array(points.astype(np.float64), "Points"),
        f"</Points><{section}>",
        *(array(values, name) for name, values in cells.items()),
        f'</{section}></Piece></{kind}><AppendedData encoding="raw">\n_',
    ]
    with open(path, "wb") as stream:
        stream.write("\n".join(lines).encode())
        for values in blocks:
            stream.write(np.uint64(values.nbytes).astype("<u8").tobytes())
            stream.write(values.data)
        stream.write(b"\n</AppendedData></VTKFile>\n")


def _write_series(path: Path, entries: Iterable[tuple[float, str]]) -> None:
    """Write the `.pvd` file that lists the instants (s) and their files."""
    lines = [
        f'<DataSet timestep="{time!r}" part="0" file={quoteattr(file)}/>' for time, file in entries
    ]
    head, tail = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0"><Collection>',
        "</Collection></VTKFile>\n",
    )
    path.write_text("\n".join([head, *lines, tail]), encoding="utf-8")


def _write_parts(
    folder: Path, name: str, grid: _Grid, arrays: Mapping[str, np.ndarray], comm: Any
) -> str:
    """Write the piece of this rank, and on the first rank the list of pieces; return its name."""
    if comm.size == 1:
        _write_vtu(folder / f"{name}.vtu", grid, arrays)
        return f"{name}.vtu"
    _write_vtu(folder / f"{name}_p{comm.rank}.vtu", grid, arrays)
    if comm.rank == 0:
        vector = '<PDataArray type="Float64" Name={} NumberOfComponents="3"/>'
        lines = [
            '<?xml version="1.0"?>',
            '<VTKFile type="PUnstructuredGrid" version="1.0"><PUnstructuredGrid GhostLevel="0">',
            "<PPointData>",
            *(vector.format(quoteattr(label)) for label in arrays),
            "</PPointData><PPoints>",
            vector.format('"Points"'),
            "</PPoints>",
            *(f"<Piece Source={quoteattr(f'{name}_p{rank}.vtu')}/>" for rank in range(comm.size)),
            "</PUnstructuredGrid></VTKFile>",
        ]
        (folder / f"{name}.pvtu").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return f"{name}.pvtu"
