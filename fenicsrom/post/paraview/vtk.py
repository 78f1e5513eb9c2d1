"""Files for ParaView: fields on the solid mesh and values at its contact points.

The files are in VTK's XML format: `.vtu` for a grid with one point array per label, `.vtp` for
contact points. This module writes them without dolfinx, so that all labels share one file,
quadratic cells keep VTK's quadratic types and a full disk raises an error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.post.paraview.vtk_files import (
    CELLS,
    Grid,
    in_space,
    reference_nodes,
    write_instants,
    write_pieces,
    write_vtp,
    write_vtu,
)

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace


@dataclass(frozen=True)
class Attached:
    """Values that go into the file of a displacement field.

    Attributes:
        nodes: name -> values (nodes, m) or (nodes,) at the local nodes of the space.
        cells: name -> values (cells, m) or (cells,) in the cells of this rank.
        notes: name -> text, such as units.
    """

    nodes: Mapping[str, np.ndarray] = field(default_factory=dict)
    cells: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)


NOTHING = Attached()


def write_fields(
    folder: str | Path,
    name: str,
    space: FunctionSpace,
    fields: Mapping[str, np.ndarray | Function],
    attached: Attached = NOTHING,
) -> Path:
    """Write displacement fields as point arrays of one grid. Collective.

    One rank writes the file `folder/name.vtu`. Several ranks write the folder `folder/name`, which
    holds one piece per rank and the file `name.pvtu` to open.

    Args:
        folder: the folder to write to; it is created if it is missing.
        name: name of the file, without suffix.
        space: vector Lagrange space of degree 1 or 2.
        fields: label -> nodal values, as an array of the local and ghost unknowns or a Function.
        attached: values besides the fields.

    Returns:
        The file to open.

    Raises:
        OSError: the file cannot be written; no partial file remains.
    """
    comm = space.mesh.comm
    grid = grid_of(space)
    arrays = _arrays(grid, space, fields, attached)
    if comm.size == 1:
        path = Path(folder) / f"{name}.vtu"
        with atomic_write(path) as temporary:
            write_vtu(temporary, grid.grid, arrays, attached.cells, attached.notes)
        return path
    path = Path(folder) / name
    with atomic_folder(path, comm) as temporary:
        file = _write_parts(temporary, name, grid, arrays, attached, comm)
    return path / file


def write_motion(
    folder: str | Path,
    name: str,
    space: FunctionSpace,
    times: Sequence[float] | np.ndarray,
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
    comm, grid = space.mesh.comm, grid_of(space)

    def write(place: Path, number: int) -> str:
        attached = attach(number)
        arrays = _arrays(grid, space, {label: frames(number)}, attached)
        arrays[label] = arrays[label].astype(np.float32)
        return _write_parts(place, f"{name}_{number:05d}", grid, arrays, attached, comm)

    return write_instants(Path(folder) / name, times, write, comm)


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

    def write(place: Path, number: int) -> str:
        file = f"{name}_{number:05d}.vtp"
        write_vtp(place / file, points, {label: found[number] for label, found in arrays.items()})
        return file

    return write_instants(Path(folder) / name, times, write)


@dataclass(frozen=True)
class NumberedGrid:
    """The cells of one rank in VTK's numbering.

    Attributes:
        grid: the grid.
        nodes: (n_points,) local numbers of its points in the function space.
    """

    grid: Grid
    nodes: np.ndarray


def grid_of(space: FunctionSpace) -> NumberedGrid:
    """Make the grid of the cells that this rank owns, all with positive volume."""
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
    return NumberedGrid(Grid(points[used], renumbered.reshape(cells.shape), cell_type), used)


def unknowns_of(field: np.ndarray | Function) -> np.ndarray:
    """Give the array of local and ghost unknowns of a field."""
    return np.asarray(field.x.array if hasattr(field, "x") else field)


def _arrays(
    grid: NumberedGrid,
    space: FunctionSpace,
    fields: Mapping[str, np.ndarray | Function],
    attached: Attached,
) -> dict[str, np.ndarray]:
    """Give the values at the points of the grid by name; vectors are padded with zeros in 2D."""
    block = space.dofmap.index_map_bs
    found = {
        label: in_space(unknowns_of(field).reshape(-1, block)[grid.nodes])
        for label, field in fields.items()
    }
    return found | {label: values[grid.nodes] for label, values in attached.nodes.items()}


def _write_parts(
    folder: Path,
    name: str,
    grid: NumberedGrid,
    arrays: Mapping[str, np.ndarray],
    attached: Attached,
    comm: Any,
) -> str:
    """Write the piece of this rank, and on the first rank the list of pieces; return its name."""
    several = comm.size > 1
    piece = f"{name}_p{comm.rank}.vtu" if several else f"{name}.vtu"
    write_vtu(folder / piece, grid.grid, arrays, attached.cells, attached.notes)
    if several and comm.rank == 0:
        pieces = [f"{name}_p{rank}.vtu" for rank in range(comm.size)]
        write_pieces(folder / f"{name}.pvtu", pieces, arrays, attached.cells)
    return f"{name}.pvtu" if several else piece
