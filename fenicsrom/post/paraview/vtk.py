"""Files for ParaView: fields on the solid mesh, values at its contact points, and lists of files.

The files are in VTK's XML format: `.vtu` for a grid with one point array per label, `.vtp` for
contact points; `.pvd` lists the files of instants, and `.vtm` those of blocks. This module writes
them without dolfinx, so that all labels share one file, quadratic cells keep VTK's quadratic types
and a full disk raises an error.
"""

from __future__ import annotations

import html
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.progress import tracked

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace
    from scipy.sparse import csr_array


Values = NDArray[Any]
Times = Sequence[float] | Values
"""Instants, s."""


@dataclass(frozen=True)
class Attached:
    """Values that go into the file of a grid, such as that of a displacement field.

    Attributes:
        nodes: name -> values (nodes, m) or (nodes,) at the local nodes of the space, or at the
            points of the grid.
        cells: name -> values (cells, m) or (cells,) in the cells of this rank.
        notes: name -> text, such as units.
    """

    nodes: Mapping[str, np.ndarray] = field(default_factory=dict)
    cells: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)

    def __or__(self, other: Attached) -> Attached:
        """The values of both."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return Attached(*({**own, **more} for own, more in pairs))


NOTHING = Attached()


Fields = Mapping[str, "np.ndarray | Function"]
"""Label -> nodal values, as an array of the local and ghost unknowns or a Function."""


def write_fields(
    folder: Path, name: str, space: FunctionSpace, fields: Fields, attached: Attached = NOTHING
) -> Path:
    """Write displacement fields as point arrays of one grid. Collective.

    One rank writes the file `folder/name.vtu`. Several ranks write the folder `folder/name`, which
    holds one piece per rank and the file `name.pvtu` to open.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the file, without suffix.
        space: vector Lagrange space of degree 1 or 2.
        fields: the fields.
        attached: values besides the fields.

    Returns:
        The file to open.

    Raises:
        OSError: the file cannot be written; no partial file remains.
    """
    comm = space.mesh.comm
    grid, nodes = grid_of(space)
    values = _at_points(nodes, space, fields, attached)
    if comm.size == 1:
        path = folder / f"{name}.vtu"
        with atomic_write(path) as temporary:
            write_vtu(temporary, grid, values)
        return path
    path = folder / name
    with atomic_folder(path, comm) as temporary:
        file = _write_parts(temporary, name, grid, values, comm)
    return path / file


def write_motion(
    folder: Path,
    name: str,
    space: FunctionSpace,
    times: Times,
    frames: Callable[[int], np.ndarray | Function],
    label: str = "displacement",
    attach: Callable[[int], Attached] = lambda number: NOTHING,
) -> Path:
    """Write a displacement that changes in time, one grid per instant. Collective.

    The files are in the folder `folder/name`: one per instant and rank, and `name.pvd` to open. An
    older folder of this name is replaced as a whole.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the new folder and of the files in it.
        space: vector Lagrange space of degree 1 or 2.
        times: (n_frames,) instants, s.
        frames: gives the displacement of the local and ghost unknowns by the frame number, m. The
            function is called once for each frame in order, on every rank at a different moment:
            it must not communicate.
        label: name of the point array, in single precision.
        attach: values besides the displacement, by the frame number; called as `frames`.

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; no partial file remains.
    """
    comm, (grid, nodes) = space.mesh.comm, grid_of(space)

    def write(place: Path, number: int) -> str:
        values = _at_points(nodes, space, {label: frames(number)}, attach(number))
        single = {**values.nodes, label: values.nodes[label].astype(np.float32)}
        values = replace(values, nodes=single)
        return _write_parts(place, f"{name}_{number:05d}", grid, values, comm)

    return write_instants(folder / name, times, write, comm)


def write_points(
    folder: Path, name: str, times: Times, points: Values, arrays: Mapping[str, Values]
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

    def write(place: Path, number: int) -> str:
        file = f"{name}_{number:05d}.vtp"
        write_vtp(place / file, points, {label: found[number] for label, found in arrays.items()})
        return file

    return write_instants(folder / name, times, write)


def grid_of(space: FunctionSpace) -> tuple[Grid, np.ndarray]:
    """Make the grid of the cells that this rank owns, all with positive volume.

    Returns:
        The grid, and the local numbers (n_points,) of its points in the function space.
    """
    mesh = space.mesh
    d = mesh.topology.dim
    name = mesh.topology.cell_type.name
    linear, quadratic = CELLS[name][0]
    nodes = np.asarray(space.element.basix_element.points)
    reference = reference_nodes(name)[: len(nodes)]

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
    return Grid(points[used], renumbered.reshape(cells.shape), cell_type), used


def unknowns_of(field: np.ndarray | Function) -> np.ndarray:
    """Give the array of local and ghost unknowns of a field."""
    return np.asarray(field.x.array if hasattr(field, "x") else field)


def _at_points(
    nodes: np.ndarray, space: FunctionSpace, fields: Fields, attached: Attached
) -> Attached:
    """Add fields to values, both at these nodes of the space; vectors get zeros in 2D."""
    block = space.dofmap.index_map_bs
    found = {
        label: in_space(unknowns_of(field).reshape(-1, block)[nodes])
        for label, field in fields.items()
    }
    found |= {label: values[nodes] for label, values in attached.nodes.items()}
    return replace(attached, nodes=found)


def _write_parts(folder: Path, name: str, grid: Grid, values: Attached, comm: Any) -> str:
    """Write the piece of this rank, and on the first rank the list of pieces; return its name."""
    several = comm.size > 1
    piece = f"{name}_p{comm.rank}.vtu" if several else f"{name}.vtu"
    write_vtu(folder / piece, grid, values)
    if several and comm.rank == 0:
        pieces = [f"{name}_p{rank}.vtu" for rank in range(comm.size)]
        write_pieces(folder / f"{name}.pvtu", pieces, values)
    return f"{name}.pvtu" if several else piece


TYPES = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "u1": "UInt8", "i1": "Int8"}


@dataclass(frozen=True)
class Grid:
    """Cells in VTK's numbering.

    Attributes:
        points: (n_points, 3) coordinates, m.
        cells: (n_cells, nodes per cell) point numbers of each cell.
        cell_type: VTK's number of the cell type.
    """

    points: Values
    cells: Values
    cell_type: int


# Cell -> VTK's types of the linear and the quadratic cell, and the reference coordinates of the
# nodes of the quadratic cell in halves and in VTK's order (corners, edges, faces, centre). The
# corners alone make the linear cell.
CELLS: dict[str, tuple[tuple[int, int], str]] = {
    "triangle": ((5, 22), "00 20 02 10 11 01"),
    "quadrilateral": ((9, 28), "00 20 22 02 10 21 12 01 11"),
    "tetrahedron": ((10, 24), "000 200 020 002 100 110 010 001 101 011"),
    "hexahedron": (
        (12, 29),
        "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021 "
        "011 211 101 121 110 112 111",
    ),
}
NAMES = {(2, 3): "triangle", (2, 4): "quadrilateral", (3, 4): "tetrahedron", (3, 8): "hexahedron"}


def reference_nodes(name: str) -> Values:
    """Reference coordinates (k, d) of the nodes of the quadratic cell, in VTK's order."""
    return np.array([[int(digit) for digit in node] for node in CELLS[name][1].split()]) / 2


def corner_shapes(nodes: Values, corners: int) -> Values:
    """Linear shape functions (k, corners) of a cell at reference coordinates (k, d).

    The corners are in the order of dolfinx.
    """
    d = nodes.shape[1]
    if corners == d + 1:
        return np.column_stack([1.0 - nodes.sum(axis=1), nodes])
    at_end = np.arange(corners)[:, None] >> np.arange(d) & 1
    return np.where(at_end, nodes[:, None], 1.0 - nodes[:, None]).prod(axis=2)


def refined_grid(points: Values, cells: Values) -> tuple[Grid, csr_array]:
    """The grid of quadratic cells on linear ones, and the means that give the values at its nodes.

    The von Mises stress changes faster in a cell than linear cells can show.

    Args:
        points: (n, d) corners, m.
        cells: (n_cells, corners) numbers of the corners, in the order of dolfinx.

    Returns:
        The grid, and the matrix (n_points, n).
    """
    from scipy.sparse import csr_array  # slow to import, and only solids with stresses need it

    corners = cells.shape[1]
    name = NAMES[points.shape[1], corners]
    shapes = corner_shapes(reference_nodes(name), corners)
    around = np.where(shapes > 0.0, cells[:, None], -1).reshape(-1, corners)
    ordered, first, numbers = np.unique(
        np.sort(around, axis=1), axis=0, return_index=True, return_inverse=True
    )
    weights = np.tile(shapes, (len(cells), 1))[first]
    rows, columns = np.nonzero(weights)
    mean = csr_array(
        (weights[rows, columns], (rows, around[first][rows, columns])),
        shape=(len(ordered), len(points)),
    )
    grid = Grid(
        in_space(mean @ points), numbers.reshape(len(cells), len(shapes)), CELLS[name][0][1]
    )
    return grid, mean


# Dimension of the cells and number of their corners -> VTK's type of the linear cell, and the
# corners in the order of VTK.
LINEAR_CELLS: dict[tuple[int, int], tuple[int, tuple[int, ...]]] = {
    (1, 2): (3, (0, 1)),
    (2, 3): (5, (0, 1, 2)),
    (2, 4): (9, (0, 1, 3, 2)),
    (3, 4): (10, (0, 1, 2, 3)),
    (3, 8): (12, (0, 1, 3, 2, 4, 5, 7, 6)),
}


def linear_grid(points: Values, cells: Values, dimension: int) -> Grid:
    """The grid of lines, faces or cells whose corners are in the order of dolfinx.

    Args:
        points: (n_points, d) m.
        cells: (n_cells, corners) point numbers.
        dimension: dimension of the cells.
    """
    cell_type, order = LINEAR_CELLS[dimension, cells.shape[1]]
    return Grid(in_space(points), cells[:, order], cell_type)


def in_space(vectors: Values) -> Values:
    """Vectors (..., 3) from vectors (..., d), with zeros in 2D."""
    found = np.zeros((*vectors.shape[:-1], 3))
    found[..., : vectors.shape[-1]] = vectors
    return found


def write_vtu(path: Path, grid: Grid, values: Attached) -> None:
    """Write one grid and values at its points and in its cells; ParaView shows notes as field data.

    Raises:
        OSError: the file cannot be written.
    """
    count, per_cell = grid.cells.shape
    cells: dict[str, Values] = {
        "connectivity": grid.cells.astype(np.int64).ravel(),
        "offsets": np.arange(1, count + 1, dtype=np.int64) * per_cell,
        "types": np.full(count, grid.cell_type, dtype=np.uint8),
    }
    _write_vtk(path, "UnstructuredGrid", grid.points, "Cells", cells, values)


def write_vtp(path: Path, points: Values, arrays: Mapping[str, Values]) -> None:
    """Write one point set."""
    count = np.arange(len(points), dtype=np.int64)
    cells = {"connectivity": count, "offsets": count + 1}
    _write_vtk(path, "PolyData", points, "Verts", cells, Attached(arrays))


def _write_vtk(
    path: Path,
    kind: str,
    points: Values,
    section: str,
    cells: Mapping[str, Values],
    found: Attached,
) -> None:
    """Write points, cells and values on them: an XML header, then the packed arrays."""
    blocks: list[bytes] = []
    position = 0

    def array(values: Values, name: str) -> str:
        nonlocal position
        values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        tag = f'<DataArray {_type(values, name)} format="appended" offset="{position}"/>'
        blocks.append(_packed(values))
        position += len(blocks[-1])
        return tag

    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor">',
        f"<{kind}>",
        "<FieldData>",
        *(_note(name, text) for name, text in found.notes.items()),
        f'</FieldData><Piece NumberOfPoints="{len(points)}" '
        f'NumberOf{section}="{cells["offsets"].size}">',
        "<PointData>",
        *(array(values, label) for label, values in found.nodes.items()),
        "</PointData><CellData>",
        *(array(values, label) for label, values in found.cells.items()),
        "</CellData><Points>",
        array(points.astype(np.float64), "Points"),
        f"</Points><{section}>",
        *(array(values, name) for name, values in cells.items()),
        f'</{section}></Piece></{kind}><AppendedData encoding="raw">\n_',
    ]
    with open(path, "wb") as stream:
        stream.write("\n".join(lines).encode())
        for values in blocks:
            stream.write(values)
        stream.write(b"\n</AppendedData></VTKFile>\n")


def _packed(values: Values) -> bytes:
    """An array in one compressed block, after the header of VTK."""
    if values.nbytes == 0:
        return np.zeros(3, "<u8").tobytes()
    block = zlib.compress(values.tobytes(), 6)
    return np.array([1, values.nbytes, 0, len(block)], "<u8").tobytes() + block


def _quoted(text: str) -> str:
    """A text as the value of an attribute. The module `xml.sax.saxutils` is slow to import."""
    return f'"{html.escape(text)}"'


def _type(values: Values, name: str) -> str:
    """Type, name and number of components of an array."""
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'type="{TYPES[values.dtype.str[1:]]}" Name={_quoted(name)}{components}'


def _note(name: str, text: str) -> str:
    """A text of the field data, as the codes of its characters."""
    codes = " ".join(str(code) for code in [*text.encode(), 0])
    return (
        f'<DataArray type="String" Name={_quoted(name)} NumberOfTuples="1" format="ascii">'
        f"{codes}</DataArray>"
    )


def write_series(path: Path, entries: Iterable[tuple[float, str]]) -> None:
    """Write the `.pvd` file that lists the instants (s) and their files."""
    lines = (f'timestep="{time!r}" part="0" file={_quoted(file)}' for time, file in entries)
    _write_list(path, "Collection", [f"<DataSet {line}/>" for line in lines])


def write_blocks(path: Path, blocks: Iterable[tuple[str, str]]) -> None:
    """Write the `.vtm` file that lists names of blocks and their files."""
    lines = (f"name={_quoted(name)} file={_quoted(file)}" for name, file in blocks)
    listed = [f'<DataSet index="{k}" {line}/>' for k, line in enumerate(lines)]
    _write_list(path, "vtkMultiBlockDataSet", listed)


def write_pieces(path: Path, pieces: Sequence[str], found: Attached) -> None:
    """Write the `.pvtu` file that lists the pieces of a grid, which have these values."""
    lines = [
        "<PPointData>",
        *(f"<PDataArray {_type(values, label)}/>" for label, values in found.nodes.items()),
        "</PPointData><PCellData>",
        *(f"<PDataArray {_type(values, label)}/>" for label, values in found.cells.items()),
        "</PCellData><PPoints>",
        '<PDataArray type="Float64" Name="Points" NumberOfComponents="3"/>',
        "</PPoints>",
        *(f"<Piece Source={_quoted(piece)}/>" for piece in pieces),
    ]
    _write_list(path, "PUnstructuredGrid", lines)


def _write_list(path: Path, kind: str, lines: Iterable[str]) -> None:
    """Write a file that lists other files."""
    head = f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0"><{kind}>'
    path.write_text("\n".join([head, *lines, f"</{kind}></VTKFile>\n"]), encoding="utf-8")


def write_instants(
    path: Path, times: Times, write: Callable[[Path, int], str], comm: Any = None
) -> Path:
    """Write a folder with a file for each instant, and the file that lists them.

    An older folder of this name is replaced as a whole. Collective if there is a communicator.

    Args:
        path: the folder.
        times: the instants, s.
        write: writes the file of an instant, by its number, into a folder; gives the file's name.
        comm: of the ranks that write into the folder; None for one rank.

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; no partial file remains.
    """
    with atomic_folder(path, comm) as temporary:
        entries = [(float(time), write(temporary, k)) for k, time in enumerate(tracked(times))]
        if comm is None or comm.rank == 0:
            write_series(temporary / f"{path.name}.pvd", entries)
    return path / f"{path.name}.pvd"
