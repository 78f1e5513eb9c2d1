"""The motion of a disk of sectors for ParaView and in a picture, from the table of one sector."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from fenicsrom.arrays import Array
from fenicsrom.assess.rotation.disk_run import DiskRun
from fenicsrom.online.model.disk_model import lag_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.disk import StoredDisk
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

    def __init__(self, disk: StoredDisk):
        """Turn the cells of one sector."""
        table, cyclic = disk.table, disk.scene.cyclic
        assert table is not None and cyclic is not None
        self._table, self.numbers = table, np.array(disk.chosen)
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
        OSError: the file cannot be written.
    """
    motion = found.motion
    if found.disk.table is None or motion.coordinates is None:
        return []
    rows = frame_rows(motion)
    every = found.model.sector_coordinates(motion.coordinates[rows - motion.time.size])
    series = _write_sectors(found.disk, motion.time[rows], every, folder)
    return [*write_index(folder, [series]), series]


def write_wave(disk: StoredDisk, motion: Motion, folder: Path) -> list[Path]:
    """Write the ParaView files of a wave; none without a table. On one rank.

    Args:
        disk: the disk.
        motion: a period of sector 0. The next sector is ahead of it by the lag of the loads.
        folder: folder of the files.

    Raises:
        OSError: the file cannot be written.
    """
    cyclic = disk.scene.cyclic
    if disk.table is None or motion.coordinates is None or cyclic is None:
        return []
    rows, own = frame_rows(motion), motion.coordinates[1:]
    orders, sectors = np.arange(len(own) // 2 + 1), np.arange(cyclic.sectors)
    ahead = np.exp(1j * lag_of(disk.scene) * np.multiply.outer(sectors, orders))
    every = np.fft.irfft(ahead[:, :, None] * np.fft.rfft(own, axis=0), len(own), axis=1)
    return [_write_sectors(disk, motion.time[rows], every[:, rows - 1], folder)]


def _write_sectors(disk: StoredDisk, time: Array, every: Array, folder: Path) -> Path:
    """Write the instants (k,) of the coordinates (N, k, n) of all sectors."""
    sectors, measure, each = _Sectors(disk), disk.scene.output.stresses, every.transpose(1, 0, 2)
    per_sector = len(sectors.grid.cells) // len(sectors.numbers)
    numbers = np.repeat(sectors.numbers, per_sector).astype(np.int64)

    def write(place: Path, number: int) -> str:
        q, name = each[number], f"motion_{number:05d}.vtu"
        points: dict[str, Any] = {DISPLACEMENT: sectors.displacement(q).astype(np.float32)}
        if measure != "none":
            points["von_mises_Pa"] = sectors.von_mises(q, measure).astype(np.float32)
        vtk.write_vtu(place / name, sectors.grid, vtk.Attached(points, {"sector": numbers}))
        return name

    return vtk.write_instants(folder / "motion", time, write)


def moved_disk(found: DiskRun, name: str) -> PolyData:
    """The surface of the chosen sectors, displaced as where one of their probes moves most."""
    import pyvista

    assert found.motion.coordinates is not None
    sectors = _Sectors(found.disk)
    probes = found.displacement[:, sectors.numbers]
    moved = np.linalg.norm(probes - probes.mean(axis=0), axis=2)
    row = int(np.argmax(moved.max(axis=1)))
    q = found.model.sector_coordinates(found.motion.coordinates[row : row + 1])[:, 0]
    kinds = {sectors.grid.cell_type: sectors.grid.cells}
    whole = pyvista.UnstructuredGrid(kinds, sectors.grid.points)
    whole.point_data[name] = sectors.displacement(q)
    return whole.extract_surface(algorithm="dataset_surface")
