"""The motion of a disk of sectors for ParaView and in a picture, from the table of one sector."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.disk_run import DiskRun
from fenicsrom.online.stress.stress import von_mises
from fenicsrom.post.paraview import vtk
from fenicsrom.post.paraview.paraview import DISPLACEMENT, frame_rows, write_index

if TYPE_CHECKING:
    from pyvista import PolyData


class _Sectors:
    """The chosen sectors of a disk side by side, in the frame of sector 0.

    Attributes:
        grid: their cells.
        numbers: (S,) of the sectors.
    """

    def __init__(self, found: DiskRun):
        """Turn the cells of one sector."""
        table, cyclic = found.disk.table, found.scene.cyclic
        assert table is not None and cyclic is not None
        self._table, self.numbers = table, np.array(found.chosen)
        axis = np.array(cyclic.axis or (0.0, 0.0, 1.0))
        angles = 2.0 * np.pi / cyclic.sectors * self.numbers
        self._turns = Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
        points, corners = vtk.in_space(table.vertex_position), len(table.vertex_position)
        middle = vtk.in_space(np.array(cyclic.point))
        places = middle + self._turned(np.array([points - middle] * len(self.numbers)))
        cells = [table.cells + k * corners for k in range(len(self.numbers))]
        self.grid = vtk.linear_grid(places, np.concatenate(cells), table.position.shape[1])

    def _turned(self, vectors: Array) -> Array:
        """Vectors (S p, 3) of vectors (S, p, 3) in the frames of the sectors."""
        return np.einsum("sij,spj->spi", self._turns, vectors).reshape(-1, 3)

    def displacement(self, q: Array) -> Array:
        """Displacements (S p, 3) of the points for coordinates q (N, n) of all sectors, m."""
        return self._turned(vtk.in_space(self._table.displacement(q[self.numbers])))

    def von_mises(self, q: Array, measure: str) -> Array:
        """Von Mises stresses (S p,) of the points, Pa."""
        stress = self._table.stress(q[self.numbers], measure)
        return von_mises(self._table.at_vertices(stress)).ravel()


def write_disk_motion(found: DiskRun, folder: Path) -> list[Path]:
    """Write the ParaView files of the last period; none without a table. On one rank.

    Raises:
        OSError: a file cannot be written.
    """
    motion, measure = found.motion, found.scene.output.stresses
    if found.disk.table is None or motion.coordinates is None:
        return []
    sectors, rows = _Sectors(found), frame_rows(motion)
    coordinates = motion.coordinates[rows - motion.time.size]
    each = found.model.sector_coordinates(coordinates).transpose(1, 0, 2)
    per_sector = len(sectors.grid.cells) // len(sectors.numbers)
    numbers = np.repeat(sectors.numbers, per_sector).astype(np.int64)

    def write(place: Path, number: int) -> str:
        q, name = each[number], f"motion_{number:05d}.vtu"
        points: dict[str, Any] = {DISPLACEMENT: sectors.displacement(q).astype(np.float32)}
        if measure != "none":
            points["von_mises_Pa"] = sectors.von_mises(q, measure).astype(np.float32)
        vtk.write_vtu(place / name, sectors.grid, vtk.Attached(points, {"sector": numbers}))
        return name

    series = vtk.write_instants(folder / "motion", motion.time[rows], write)
    return [*write_index(folder, [series]), series]


def moved_disk(found: DiskRun, name: str) -> PolyData:
    """The surface of the chosen sectors, displaced as where one of their probes moves most."""
    import pyvista

    assert found.motion.coordinates is not None
    sectors = _Sectors(found)
    probes = found.displacement[:, sectors.numbers]
    moved = np.linalg.norm(probes - probes.mean(axis=0), axis=2)
    row = int(np.argmax(moved.max(axis=1)))
    q = found.model.sector_coordinates(found.motion.coordinates[row : row + 1])[:, 0]
    kinds = {sectors.grid.cell_type: sectors.grid.cells}
    whole = pyvista.UnstructuredGrid(kinds, sectors.grid.points)
    whole.point_data[name] = sectors.displacement(q)
    return whole.extract_surface(algorithm="dataset_surface")
