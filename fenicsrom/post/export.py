"""ParaView files, pictures and animations of fields on the solid mesh and at its contact points.

The files are VTK's XML format (`.vtu`, one grid with a point array per label; `.vtp`, contact
points). They are written here rather than by dolfinx so that all labels share one file, quadratic
cells have VTK's own quadratic types, and a failing disk raises.
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

from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.post import report

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace

TRUE_SCALE = 0.03  # of the length of a body: displacements from here on are drawn to scale
FILM_SECONDS = 3.0  # that an animation takes, from its start to its end

# Reference coordinates of the nodes of VTK's quadratic cells, in halves and in VTK's order
# (corners, edges, faces, the middle; the corners alone are the linear cell), after the VTK types of
# the linear and the quadratic cell.
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

    In serial it is the file `folder/name.vtu`; with more than one MPI rank the folder
    `folder/name`, which holds a piece per rank and `name.pvtu` to open. Collective.

    Args:
        folder: where to write, made if missing.
        name: of the file, without suffix.
        space: vector Lagrange space of degree 1 or 2.
        fields: for each label the nodal values: an array of the local and ghost unknowns, or a
            Function.

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
    """Write a displacement that moves, one grid per instant, for ParaView and pyvista.

    It is the folder `folder/name`, replaced as a whole, with a file per instant (and rank) and
    `name.pvd` to open. Collective.

    Args:
        folder: where to write, made if missing.
        name: of the folder and the files in it.
        space: vector Lagrange space of degree 1 or 2.
        times: instants (n_frames,), s.
        frames: displacement, m, of the local and ghost unknowns: an array (n_frames, n_unknowns),
            or a callable that is given the number of the frame, called once for each in order (on
            every rank, but not at the same moment: it must not communicate).
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
    with atomic_folder(path, comm) as temporary:
        entries = []
        for number, time in enumerate(times):
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
    """Write points with values that change in time, one point set per instant, for ParaView and
    pyvista. Not collective.

    It is the folder `folder/name`, replaced as a whole, with a file per instant and `name.pvd` to
    open.

    Args:
        folder: where to write, made if missing.
        name: of the folder and the files in it.
        times: instants (n_frames,), s.
        points: their places in the undeformed body, (P, 3), m.
        arrays: by label: numbers (n_frames, P), of 8 bytes or int8, or vectors (n_frames, P, 3).

    Returns:
        The `.pvd` file to open.

    Raises:
        OSError: a file cannot be written; nothing is left behind.
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


def picture_modes(
    png: str | Path, space: FunctionSpace, fields: Mapping[str, np.ndarray | Function]
) -> Path | None:
    """Draw deformed shapes, coloured by the size of the displacement, one labelled panel each.

    Every shape is scaled to its own largest displacement, drawn as 15 % of the length of the body,
    beside the outline of the undeformed body. The picture is made by pyvista in a process of its
    own, under Xvfb where that is installed, since VTK may abort its process when there is no
    display. Collective.

    Args:
        png: the picture to write.
        space: vector Lagrange space of degree 1 or 2.
        fields: as in `write_fields`.

    Returns:
        The picture; None, after a warning of one sentence, where nothing can be drawn on this
        machine.

    Raises:
        OSError: the picture cannot be written.
    """

    def task(scratch: Path) -> dict[str, Any]:
        return {
            "source": str(write_fields(scratch, "shapes", space, fields)),
            "labels": list(fields),
        }

    return _drawn_apart(png, space.mesh.comm, "_draw_shapes", task)


def animate(
    gif: str | Path,
    space: FunctionSpace,
    times: Sequence[float] | np.ndarray,
    frames: Callable[[int], np.ndarray | Function],
    marks: tuple[np.ndarray, Mapping[str, np.ndarray]] | None = None,
) -> Path | None:
    """Draw a motion as an animated GIF: the body deformed, coloured by the size of its
    displacement, its contact points marked.

    Displacements are drawn to scale where the largest is at least `TRUE_SCALE` of the length of the
    body, else magnified by a round number that the picture states. Drawn as `picture_modes` draws.
    Collective.

    Args:
        gif: the file to write.
        space: vector Lagrange space of degree 1 or 2.
        times: instants (n_frames,), s.
        frames: as in `write_motion`.
        marks: places of contact points in the undeformed body (P, 3), m, and the arrays
            `displacement` (n_frames, P, 3), m, and `state` (n_frames, P).

    Returns:
        The file; None, after a warning of one sentence, where nothing can be drawn on this machine.

    Raises:
        OSError: the file cannot be written.
    """
    comm = space.mesh.comm

    def task(scratch: Path) -> dict[str, Any]:
        found = {
            "motion": str(write_motion(scratch, "motion", space, times, frames)),
            "points": None,
        }
        if marks is not None and comm.rank == 0:
            points, arrays = marks
            drawn = {name: arrays[name] for name in ("displacement", "state")}
            found["points"] = str(write_points(scratch, "points", times, points, drawn))
        return found

    return _drawn_apart(gif, comm, "_draw_motion", task)


def centreline(
    space: FunctionSpace, fields: Mapping[str, np.ndarray | Function], stations: int = 101
) -> tuple[np.ndarray, np.ndarray]:
    """Sample fields along the axis of a slender body, for `report.plot_modes`.

    The axis is the coordinate direction in which the body is longest. At each station a field
    quadratic along the axis and linear across it is fitted to the nodes nearby (weights falling
    linearly with the distance, over two spacings or as many as the mesh needs) and taken in the
    middle of the section, so that the rotation of a section does not show as an axial displacement.
    Collective; the result is the same on all ranks.

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
    values = np.array(
        [_unknowns(space, field)[: owned * d].reshape(-1, d) for field in fields.values()]
    )
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
            right[k] = weighted.T @ values[:, near].transpose(1, 0, 2).reshape(
                near.size, len(fields) * d
            )
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
    reference = (
        np.array([[int(digit) for digit in node] for node in digits.split()])[: len(nodes)] / 2
    )

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
        raise ValueError(
            f"a field has shape {values.shape} where the space has {expected} local unknowns with ghosts"
        )
    return values


def _nodal(grid: _Grid, space: FunctionSpace, field: np.ndarray | Function) -> np.ndarray:
    """Vectors at the points of the grid, padded to three components, (n_points, 3)."""
    values = _unknowns(space, field).reshape(-1, space.dofmap.index_map_bs)
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
    """Write points with their arrays, and `count` cells in a section: a short XML header, then the
    arrays as in memory.
    """
    blocks: list[np.ndarray] = []
    position = 0

    def array(values: np.ndarray, name: str) -> str:
        nonlocal position
        values = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
        vtk_type = {"f8": "Float64", "i8": "Int64", "u1": "UInt8", "i1": "Int8"}[
            values.dtype.str[1:]
        ]
        components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
        tag = f'<DataArray type="{vtk_type}" Name={quoteattr(name)}{components} format="appended" offset="{position}"/>'
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
    """Write the `.pvd` file that names the files of instants (s)."""
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
    """Write the piece of this rank, and on the first rank the file that holds the pieces together;
    return its name.
    """
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


def _drawn_apart(
    picture: str | Path, comm: Any, draw: str, task: Callable[[Path], dict[str, Any]]
) -> Path | None:
    """Have a function of this module draw a picture in a process of its own. Collective.

    Args:
        picture: the file to write.
        comm: the communicator.
        draw: name of the function.
        task: writes what is to be drawn into a folder that is taken away afterwards, and says what
            the function is to know.

    Returns:
        The picture; None, after a warning, where nothing can be drawn.
    """
    scratch = Path(comm.bcast(tempfile.mkdtemp(prefix="fenicsrom-") if comm.rank == 0 else None))
    reason: str | None = None
    failure: OSError | None = None
    try:
        known = task(scratch)
        if comm.rank == 0:
            drawn = scratch / Path(picture).name
            reason = _run_apart(draw, drawn, known)
            if reason:
                warnings.warn(f"{picture} was not drawn: {reason}.", stacklevel=3)
            else:
                try:
                    with atomic_write(picture) as temporary:
                        shutil.copyfile(drawn, temporary)
                except OSError as error:
                    failure = error
    finally:
        if comm.rank == 0:
            shutil.rmtree(scratch, ignore_errors=True)
    reason, failure = comm.bcast((reason, failure))
    if failure:
        raise failure
    return None if reason else Path(picture)


def _run_apart(draw: str, picture: Path, task: Mapping[str, Any]) -> str | None:
    """Run a drawing function in a process of its own; return why nothing was drawn, or None."""
    program = f"from fenicsrom.post.export import {draw}; {draw}()"
    command = [sys.executable, "-c", program, json.dumps({"picture": str(picture), **task})]
    if server := shutil.which("xvfb-run"):
        command = [server, "-a", *command]
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("OMPI_", "PMIX_", "PRTE_", "PMI_"))
    }
    package = str(Path(__file__).resolve().parents[2])
    environment["PYTHONPATH"] = os.pathsep.join(
        filter(None, [package, environment.get("PYTHONPATH")])
    )
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
    if process.returncode == 0 and picture.exists():
        return None
    if "No module named 'pyvista'" in said:
        return "pyvista is not installed"
    if server is None:
        return "there is neither a display nor Xvfb (packages xvfb and xauth) to draw it with"
    return f"the drawing process ended with code {process.returncode} ({(said.strip().splitlines() or ['silently'])[-1]})"


class _Stage:
    """Where a body is drawn, off-screen: a camera that looks at it from its broad side, and a
    light.

    Attributes:
        length: largest extent of the body, m.
        towards: unit vector from the body to the camera.
        window: pixels of the square picture.
    """

    def __init__(self, grid: Any, margin: float = 0.0, pixels: int = 1600):
        """Look at an undeformed grid, with room for displacements of `margin` (m) about it."""
        import pyvista

        self._points = np.asarray(grid.points)
        extent = np.ptp(self._points, axis=0)
        self.length = float(extent.max())
        thin, middle, along = np.eye(3)[np.argsort(extent, kind="stable")]
        self._flat = extent[2] < 1e-12 * self.length
        if self._flat:
            direction, self._up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
        elif along[2]:
            direction, self._up = 0.25 * along - 0.65 * thin + 0.75 * middle, along
        else:
            direction, self._up = 0.12 * along + 0.45 * thin + 0.85 * middle, thin
        self.towards = direction / np.linalg.norm(direction)
        self._scale = 0.75 * float(np.linalg.norm(extent)) + margin
        self.plotter = pyvista.Plotter(off_screen=True, window_size=[pixels, pixels])
        self.plotter.set_background("white")
        self.plotter.enable_anti_aliasing("ssaa")
        self.plotter.enable_parallel_projection()
        undeformed = grid.extract_surface(nonlinear_subdivision=2).clean()
        self._outline = undeformed.extract_feature_edges(
            feature_angle=40.0, manifold_edges=False, non_manifold_edges=False
        )

    def show(self, grid: Any, vectors: np.ndarray, factor: float, largest: float) -> None:
        """Put the body there, displaced by factor times the vectors (n, 3), coloured by their size
        up to the largest.
        """
        self.plotter.clear_actors()
        self.plotter.add_mesh(self._outline, color="#8c8c8c", line_width=2, render=False)
        shape = grid.copy()
        shape.clear_data()
        shape.point_data["size"] = np.linalg.norm(vectors, axis=1) / largest
        shape.points = self._points + factor * vectors
        self.plotter.add_mesh(
            shape.extract_surface(nonlinear_subdivision=2),
            scalars="size",
            cmap="viridis",
            clim=(0, 1),
            show_scalar_bar=False,
            lighting=not self._flat,
            smooth_shading=not self._flat,
            split_sharp_edges=not self._flat,
            ambient=0.5,
            diffuse=0.6,
            render=False,
        )

    def photograph(self) -> np.ndarray:
        """The picture, (pixels, pixels, 3)."""
        camera = self.plotter.camera
        camera.focal_point = (self._points.max(axis=0) + self._points.min(axis=0)) / 2
        camera.position = camera.focal_point + 5 * self.length * self.towards
        camera.up = self._up
        camera.parallel_scale = self._scale
        self.plotter.reset_camera_clipping_range()
        self.plotter.render()
        return np.asarray(self.plotter.screenshot(return_img=True))


def _cropped(images: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The pictures without the margin that is white in all of them, but for 20 pixels."""
    drawn = np.array([(image < 250).any(axis=2) for image in images]).any(axis=0)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    box = (
        slice(max(rows[0] - 20, 0), rows[-1] + 20),
        slice(max(columns[0] - 20, 0), columns[-1] + 20),
    )
    return [image[box] for image in images]


def _draw_shapes() -> None:
    """Draw the shapes named by the task on the command line: rendered by pyvista, put together by
    matplotlib.
    """
    import pyvista

    task = json.loads(sys.argv[1])
    grid = pyvista.read(task["source"])
    stage = _Stage(grid)
    images = []
    for label in task["labels"]:
        vectors = np.asarray(grid.point_data[label])
        largest = float(np.linalg.norm(vectors, axis=1).max()) or 1.0
        stage.show(grid, vectors, 0.15 * stage.length / largest, largest)
        images.append(stage.photograph())
    stage.plotter.close()
    report.panels(task["labels"], _cropped(images)).savefig(task["picture"])


def magnification(largest: float, length: float) -> float:
    """By what displacements are multiplied in a picture: 1, or a round number that brings the
    largest to about a tenth.

    Args:
        largest: displacement, m.
        length: of the body, m.

    Returns:
        1 where the largest is at least `TRUE_SCALE` of the length, or nothing moves; else 1, 2 or 5
        times a power of ten, the largest by which no displacement exceeds a tenth of the length.
    """
    if largest >= TRUE_SCALE * length or largest == 0.0:
        return 1.0
    wanted = 0.1 * length / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(
        max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1.0 + 1e-9)) * power
    )


def _draw_motion() -> None:
    """Draw the motion named by the task on the command line: rendered by pyvista, captioned by
    matplotlib, written by Pillow.
    """
    import pyvista
    from PIL import Image

    task = json.loads(sys.argv[1])
    motion = pyvista.get_reader(task["motion"])
    points = pyvista.get_reader(task["points"]) if task["points"] else None

    def at(reader: Any, time: float) -> Any:
        reader.set_active_time_value(time)
        return reader.read()[0]

    vectors = [np.array(at(motion, time).point_data["displacement"]) for time in motion.time_values]
    grid = at(motion, motion.time_values[0])
    largest = max(float(np.linalg.norm(frame, axis=1).max()) for frame in vectors)
    factor = magnification(largest, float(np.ptp(np.asarray(grid.points), axis=0).max()))
    stage = _Stage(grid, margin=factor * largest, pixels=900)
    images = []
    for time, frame in zip(motion.time_values, vectors, strict=True):
        stage.show(grid, frame, factor, largest or 1.0)
        if points is not None:
            found = at(points, time)
            where = np.asarray(found.points) + factor * np.asarray(found.point_data["displacement"])
            marks = pyvista.PolyData(
                where + 2 * stage.length * stage.towards
            )  # before the body, wherever they are on it
            marks.point_data["colour"] = [
                _rgb(report.STATES[int(state)][1]) for state in found.point_data["state"]
            ]
            for size, how in ((21, {"color": "black"}), (15, {"scalars": "colour", "rgb": True})):
                stage.plotter.add_points(
                    marks,
                    point_size=size,
                    render_points_as_spheres=True,
                    lighting=False,
                    render=False,
                    **how,
                )
                marks = marks.translate(0.1 * stage.length * stage.towards)
        images.append(stage.photograph())
    stage.plotter.close()
    scale = "displacements to scale" if factor == 1.0 else f"displacements × {factor:g}"
    film = report.film(_cropped(images), motion.time_values, scale, largest, points is not None)
    common = Image.fromarray(np.concatenate(film[:: max(1, len(film) // 8)])).quantize(
        250, dither=Image.Dither.NONE
    )
    kept = [
        (0, 0, 0),
        (255, 255, 255),
        *(_rgb(colour) for _, colour in report.STATES.values()),
    ]  # too rare to be found
    common.putpalette([*common.getpalette()[: 3 * 250], *np.ravel(kept)])
    frames = [
        Image.fromarray(image).quantize(palette=common, dither=Image.Dither.NONE) for image in film
    ]
    frames[0].save(
        task["picture"],
        save_all=True,
        append_images=frames[1:],
        duration=round(1e3 * FILM_SECONDS / len(frames)),
        loop=0,
    )


def _rgb(colour: str) -> tuple[int, ...]:
    """The numbers of a colour such as "#0072B2"."""
    return tuple(bytes.fromhex(colour[1:]))
