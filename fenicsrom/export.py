"""ParaView files and pictures of fields on the solid mesh.

The files are VTK's XML format (`.vtu`, one grid with a point array per label). They are written here rather than by
dolfinx so that all labels share one file, quadratic cells have VTK's own quadratic types, and a failing disk raises.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fenicsrom import report
from fenicsrom.files import whole, whole_folder

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace

# Reference coordinates of the nodes of VTK's quadratic cells, in halves and in VTK's order (corners, edges, faces, the
# middle; the corners alone are the linear cell), after the VTK types of the linear and the quadratic cell.
_CELLS: dict[str, tuple[tuple[int, int], str]] = {
    "triangle": ((5, 22), "00 20 02 10 11 01"),
    "quadrilateral": ((9, 28), "00 20 22 02 10 21 12 01 11"),
    "tetrahedron": ((10, 24), "000 200 020 002 100 110 010 001 101 011"),
    "hexahedron": (
        (12, 29),
        "000 200 220 020 002 202 222 022 100 210 120 010 102 212 122 012 001 201 221 021 011 211 101 121 110 112 111",
    ),
}


def write_fields(
    folder: str | Path, name: str, space: FunctionSpace, fields: Mapping[str, np.ndarray | Function]
) -> Path:
    """Write displacement fields by label, as point arrays of one grid, for ParaView and pyvista.

    In serial it is the file `folder/name.vtu`; with more than one MPI rank the folder `folder/name`, which holds a
    piece per rank and `name.pvtu` to open. Collective.

    Args:
        folder: where to write, made if missing.
        name: of the file, without suffix.
        space: vector Lagrange space of degree 1 or 2.
        fields: for each label the nodal values: an array of the local and ghost unknowns, or a Function.

    Returns:
        The file to open.

    Raises:
        OSError: the file cannot be written; nothing is left behind.
    """
    comm = space.mesh.comm
    grid = _grid(space)
    arrays = {label: _nodal(grid, space, field) for label, field in fields.items()}
    if comm.size == 1:
        path = Path(folder) / f"{name}.vtu"
        with whole(path) as temporary:
            _write_vtu(temporary, grid, arrays)
        return path
    path = Path(folder) / name
    with whole_folder(path, comm) as temporary:
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
    """Write a displacement that moves, one grid per instant, for ParaView and pyvista.

    It is the folder `folder/name`, replaced as a whole, with a file per instant (and rank) and `name.pvd` to open.
    Collective.

    Args:
        folder: where to write, made if missing.
        name: of the folder and the files in it.
        space: vector Lagrange space of degree 1 or 2.
        times: instants (n_frames,), s.
        frames: displacement, m, of the local and ghost unknowns: an array (n_frames, n_unknowns), or a callable that is
            given the number of the frame, called once for each in order (on every rank, but not at the same moment: it
            must not communicate).
        label: name of the point array.

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; nothing is left behind.
    """
    comm = space.mesh.comm
    grid = _grid(space)
    frame: Callable[[int], Any] = frames if callable(frames) else frames.__getitem__
    path = Path(folder) / name
    with whole_folder(path, comm) as temporary:
        entries = []
        for number, time in enumerate(times):
            file = _write_parts(
                temporary, f"{name}_{number:05d}", grid, {label: _nodal(grid, space, frame(number))}, comm
            )
            entries.append(f'<DataSet timestep="{float(time)!r}" part="0" file={quoteattr(file)}/>')
        if comm.rank == 0:
            (temporary / f"{name}.pvd").write_text(
                '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0"><Collection>\n'
                + "\n".join(entries)
                + "\n</Collection></VTKFile>\n",
                encoding="utf-8",
            )
    return path / f"{name}.pvd"


def picture_modes(png: str | Path, space: FunctionSpace, fields: Mapping[str, np.ndarray | Function]) -> Path | None:
    """Draw deformed shapes, coloured by the size of the displacement, one labelled panel each.

    Every shape is scaled to its own largest displacement, drawn as 15 % of the length of the body, beside the outline
    of the undeformed body. The picture is made by pyvista in a process of its own, under Xvfb where that is installed,
    since VTK may abort its process when there is no display. Collective.

    Args:
        png: the picture to write.
        space: vector Lagrange space of degree 1 or 2.
        fields: as in `write_fields`.

    Returns:
        The picture; None, after a warning of one sentence, where nothing can be drawn on this machine.

    Raises:
        OSError: the picture cannot be written.
    """
    comm = space.mesh.comm
    scratch = Path(comm.bcast(tempfile.mkdtemp(prefix="fenicsrom-") if comm.rank == 0 else None))
    reason: str | None = None
    failure: OSError | None = None
    try:
        source = write_fields(scratch, "shapes", space, fields)
        if comm.rank == 0:
            reason = _draw_apart(scratch / "picture.png", source, fields)
            if reason:
                warnings.warn(f"{png} was not drawn: {reason}.", stacklevel=2)
            else:
                try:
                    with whole(png) as temporary:
                        shutil.copyfile(scratch / "picture.png", temporary)
                except OSError as error:
                    failure = error
    finally:
        if comm.rank == 0:
            shutil.rmtree(scratch, ignore_errors=True)
    reason, failure = comm.bcast((reason, failure))
    if failure:
        raise failure
    return None if reason else Path(png)


def centreline(
    space: FunctionSpace, fields: Mapping[str, np.ndarray | Function], stations: int = 101
) -> tuple[np.ndarray, np.ndarray]:
    """Sample fields along the axis of a slender body, for `report.plot_modes`.

    The axis is the coordinate direction in which the body is longest. At each station a field quadratic along the axis
    and linear across it is fitted to the nodes nearby (weights falling linearly with the distance, over two spacings or
    as many as the mesh needs) and taken in the middle of the section, so that the rotation of a section does not show
    as an axial displacement. Collective; the result is the same on all ranks.

    Args:
        space: vector Lagrange space.
        fields: as in `write_fields`.
        stations: number of points along the axis.

    Returns:
        positions (stations,) in m, from the smallest to the largest coordinate;
        values (n_fields, stations, d), the axial component first, then the others in order.
    """
    comm = space.mesh.comm
    d = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    x = space.tabulate_dof_coordinates()[:owned, :d]
    values = np.array([_unknowns(space, field)[: owned * d].reshape(-1, d) for field in fields.values()])
    values = values.reshape(len(fields), owned, d)
    boxes = comm.allgather((x.min(axis=0), x.max(axis=0)) if owned else None)
    low = np.min([box[0] for box in boxes if box], axis=0)
    high = np.max([box[1] for box in boxes if box], axis=0)
    axis = int(np.argmax(high - low))
    order = [axis, *(k for k in range(d) if k != axis)]
    positions = np.linspace(low[axis], high[axis], stations)
    length = high[axis] - low[axis]
    across = (x[:, order[1:]] - ((low + high) / 2)[order[1:]]) / length
    result = np.zeros((len(fields), stations, d))
    pending, reach = np.arange(stations), 2 * length / (stations - 1)
    while len(pending):
        gram = np.zeros((len(pending), d + 2, d + 2))
        right = np.zeros((len(pending), d + 2, len(fields) * d))
        sides = np.full((2, len(pending), d - 1), -np.inf)
        for k, position in enumerate(positions[pending]):
            s = (x[:, axis] - position) / reach
            near = np.flatnonzero(np.abs(s) < 1)
            rows = np.column_stack([np.ones(near.size), s[near], s[near] ** 2, across[near]])
            weighted = rows * (1 - np.abs(s[near]))[:, None]
            sides[:, k] = np.max([across[near], -across[near]], axis=1, initial=-np.inf)
            gram[k] = weighted.T @ rows
            right[k] = weighted.T @ values[:, near].transpose(1, 0, 2).reshape(near.size, len(fields) * d)
        gram, right = sum(comm.allgather(gram)), sum(comm.allgather(right))
        sides = np.max(comm.allgather(sides), axis=0)
        spread = np.linalg.eigvalsh(gram[:, :3, :3])
        enough = (spread[:, 0] > 1e-4 * spread[:, 2]) | (reach > length)
        for k in np.flatnonzero(enough):
            at = np.concatenate([[1.0, 0.0, 0.0], (sides[0, k] - sides[1, k]) / 2])
            fitted = at @ np.linalg.pinv(gram[k], rcond=1e-13, hermitian=True) @ right[k]
            result[:, pending[k]] = fitted.reshape(len(fields), d)[:, order]
        pending, reach = pending[~enough], 2 * reach
    return positions, result


@dataclass(frozen=True)
class _Grid:
    """The cells of one rank, in VTK's numbering.

    Attributes:
        points: coordinates (n_points, 3), m.
        cells: points of each cell (n_cells, nodes per cell).
        cell_type: VTK's number of the type.
        nodes: nodes of the space that the points are (n_points,), local numbers.
    """

    points: np.ndarray
    cells: np.ndarray
    cell_type: int
    nodes: np.ndarray


def _grid(space: FunctionSpace) -> _Grid:
    """The cells a rank owns, with the nodes of the space as points and none of them inside out."""
    mesh = space.mesh
    d = mesh.topology.dim
    (linear, quadratic), digits = _CELLS[mesh.topology.cell_type.name]
    nodes = np.asarray(space.element.basix_element.points)
    reference = np.array([[int(digit) for digit in node] for node in digits.split()])[: len(nodes)] / 2

    def places(points: np.ndarray, among: np.ndarray) -> np.ndarray:
        """Where points are found among others."""
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


def _unknowns(space: FunctionSpace, field: np.ndarray | Function) -> np.ndarray:
    """The array of local and ghost unknowns behind a field."""
    values = np.asarray(field.x.array if hasattr(field, "x") else field)
    index_map, block = space.dofmap.index_map, space.dofmap.index_map_bs
    expected = (index_map.size_local + index_map.num_ghosts) * block
    if values.shape != (expected,):
        raise ValueError(f"a field has shape {values.shape} where the space has {expected} local unknowns with ghosts")
    return values


def _nodal(grid: _Grid, space: FunctionSpace, field: np.ndarray | Function) -> np.ndarray:
    """Vectors at the points of the grid, padded to three components, (n_points, 3)."""
    values = _unknowns(space, field).reshape(-1, space.dofmap.index_map_bs)
    vectors = np.zeros((len(grid.nodes), 3))
    vectors[:, : values.shape[1]] = values[grid.nodes]
    return vectors


def _write_vtu(path: Path, grid: _Grid, arrays: Mapping[str, np.ndarray]) -> None:
    """Write one grid: a short XML header, then the arrays as they are in memory."""
    per_cell = grid.cells.shape[1]
    blocks: list[np.ndarray] = []
    position = 0

    def array(values: np.ndarray, name: str) -> str:
        nonlocal position
        values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        vtk_type = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}[values.dtype.str[1:]]
        components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
        tag = f'<DataArray type="{vtk_type}" Name={quoteattr(name)}{components} format="appended" offset="{position}"/>'
        blocks.append(values)
        position += 8 + values.nbytes
        return tag

    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(grid.points)}" NumberOfCells="{len(grid.cells)}">',
        "<PointData>",
        *(array(values, label) for label, values in arrays.items()),
        "</PointData><Points>",
        array(grid.points.astype(np.float64), "Points"),
        "</Points><Cells>",
        array(grid.cells.astype(np.int64).ravel(), "connectivity"),
        array(np.arange(1, len(grid.cells) + 1, dtype=np.int64) * per_cell, "offsets"),
        array(np.full(len(grid.cells), grid.cell_type, dtype=np.uint8), "types"),
        '</Cells></Piece></UnstructuredGrid><AppendedData encoding="raw">\n_',
    ]
    with open(path, "wb") as stream:
        stream.write("\n".join(lines).encode())
        for values in blocks:
            stream.write(np.uint64(values.nbytes).astype("<u8").tobytes())
            stream.write(values.data)
        stream.write(b"\n</AppendedData></VTKFile>\n")


def _write_parts(folder: Path, name: str, grid: _Grid, arrays: Mapping[str, np.ndarray], comm: Any) -> str:
    """Write the piece of this rank, and on the first rank the file that holds the pieces together; return its name."""
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


def _draw_apart(png: Path, source: Path, labels: Iterable[str]) -> str | None:
    """Run `_draw` in a process of its own; return why nothing was drawn, or None."""
    task = json.dumps({"png": str(png), "source": str(source), "labels": list(labels)})
    command = [sys.executable, "-c", "from fenicsrom.export import _draw; _draw()", task]
    if server := shutil.which("xvfb-run"):
        command = [server, "-a", *command]
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PRTE_", "PMI_"))}
    package = str(Path(__file__).resolve().parents[1])
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [package, environment.get("PYTHONPATH")]))
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _, said = process.communicate()
    except BaseException:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait()
        raise
    if process.returncode == 0 and png.exists():
        return None
    if "No module named 'pyvista'" in said:
        return "pyvista is not installed"
    if server is None:
        return "there is neither a display nor Xvfb (packages xvfb and xauth) to draw it with"
    return (
        f"the drawing process ended with code {process.returncode} ({(said.strip().splitlines() or ['silently'])[-1]})"
    )


def _draw() -> None:
    """Draw the shapes named by the task on the command line: rendered by pyvista, put together by matplotlib."""
    import pyvista

    task = json.loads(sys.argv[1])
    grid = pyvista.read(task["source"])
    points = np.asarray(grid.points)
    extent = np.ptp(points, axis=0)
    length = float(extent.max())
    thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
    flat = extent[2] < 1e-12 * length
    if flat:
        direction, up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    elif along[2]:
        direction, up = 0.25 * along - 0.65 * thin + 0.75 * middle, along
    else:
        direction, up = 0.12 * along + 0.45 * thin + 0.85 * middle, thin
    plotter = pyvista.Plotter(off_screen=True, window_size=[1600, 1600])
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.enable_parallel_projection()
    undeformed = grid.extract_surface(nonlinear_subdivision=2).clean()
    outline = undeformed.extract_feature_edges(feature_angle=40.0, manifold_edges=False, non_manifold_edges=False)
    images = []
    for label in task["labels"]:
        vectors = np.asarray(grid.point_data[label])
        size = np.linalg.norm(vectors, axis=1)
        largest = size.max() or 1.0
        shape = grid.copy()
        shape.clear_data()
        shape.point_data["size"] = size / largest
        shape.points = points + (0.15 * length / largest) * vectors
        plotter.clear_actors()
        plotter.add_mesh(outline, color="#8c8c8c", line_width=2)
        plotter.add_mesh(
            shape.extract_surface(nonlinear_subdivision=2),
            scalars="size",
            cmap="viridis",
            clim=(0, 1),
            show_scalar_bar=False,
            lighting=not flat,
            smooth_shading=not flat,
            split_sharp_edges=not flat,
            ambient=0.5,
            diffuse=0.6,
        )
        plotter.camera.focal_point = (points.max(axis=0) + points.min(axis=0)) / 2
        plotter.camera.position = plotter.camera.focal_point + 5 * length * direction
        plotter.camera.up = up
        plotter.camera.parallel_scale = 0.75 * float(np.linalg.norm(extent))
        plotter.reset_camera_clipping_range()
        images.append(plotter.screenshot(return_img=True))
    plotter.close()
    drawn = np.array([(image < 250).any(axis=2) for image in images]).any(axis=0)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    box = (slice(max(rows[0] - 20, 0), rows[-1] + 20), slice(max(columns[0] - 20, 0), columns[-1] + 20))
    report.panels(task["labels"], [image[box] for image in images]).savefig(task["png"])
