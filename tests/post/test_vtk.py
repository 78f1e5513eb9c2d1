"""Files for ParaView with known fields, read back with pyvista."""

import errno
import os

import numpy as np
import pytest

MPI = pytest.importorskip("mpi4py.MPI")
fem = pytest.importorskip("dolfinx.fem")
pyvista = pytest.importorskip("pyvista")

from dolfinx import mesh as dmesh  # noqa: E402
from spaces import CELLS, HEIGHT, LENGTH, field, of_space, space_on  # noqa: E402

from fenicsrom.post.paraview import vtk  # noqa: E402


@pytest.mark.parametrize(("cell", "degree"), zip(CELLS, (1, 2, 1, 2), strict=True))
def test_written_fields_are_read_back_by_label(tmp_path, cell, degree):
    space = space_on(cell, degree)
    d = space.mesh.geometry.dim
    function = fem.Function(space)
    function.x.array[:] = of_space(space, degree)
    path = vtk.write_fields(
        tmp_path, "modes", space, {"1V": function, '1V1S "&': 2 * function.x.array}
    )
    grid = pyvista.read(path)
    assert path == tmp_path / "modes.vtu" and grid.point_data.keys() == ["1V", '1V1S "&']
    assert set(grid.celltypes) == {CELLS[cell][degree - 1]}
    assert grid.n_cells == space.mesh.topology.index_map(d).size_local
    vectors = grid.point_data["1V"]
    assert vectors.shape == (grid.n_points, 3) and not vectors[:, d:].any()
    np.testing.assert_allclose(vectors[:, :d], field(grid.points, degree, d), atol=1e-14)
    np.testing.assert_array_equal(grid.point_data['1V1S "&'], 2 * vectors)
    assert os.listdir(tmp_path) == ["modes.vtu"]


@pytest.mark.parametrize("cell", CELLS)
def test_written_cells_have_vtk_node_order_and_positive_volume(tmp_path, cell):
    """VTK's own shape functions give the quadratic field between the nodes and the correct
    volume."""
    space = space_on(cell)
    d = space.mesh.geometry.dim
    grid = pyvista.read(vtk.write_fields(tmp_path, "modes", space, {"u": of_space(space, 2)}))
    rng = np.random.default_rng(1)
    inside = np.zeros((40, 3))
    inside[:, :d] = rng.uniform(0.01, 0.99, (40, d)) * [LENGTH, HEIGHT, HEIGHT][:d]
    sampled = pyvista.PolyData(inside).sample(grid)
    assert sampled.point_data["vtkValidPointMask"].all()
    np.testing.assert_allclose(sampled.point_data["u"][:, :d], field(inside, 2, d), atol=1e-4)
    frame = {
        "triangle": [0, 1, 2],
        "quadrilateral": [0, 1, 3],
        "tetrahedron": [0, 1, 2, 3],
        "hexahedron": [0, 1, 3, 4],
    }
    corners = np.array([grid.get_cell(i).points[frame[cell], :d] for i in range(grid.n_cells)])
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / {
        "triangle": 2,
        "tetrahedron": 6,
    }.get(cell, 1)
    assert (volumes > 0).all() and volumes.sum() == pytest.approx(LENGTH * HEIGHT ** (d - 1))


def test_curved_cell_has_middle_nodes_on_curve(tmp_path):
    """Degree-2 geometry: a quarter of an annulus as one quadrilateral."""
    import basix.ufl

    angles, radii = np.array([0, np.pi / 2, np.pi / 4]), np.array([1.0, 1.2, 1.1])
    polar = [
        (r, a) for r, a in [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (1, 2), (2, 1), (2, 2)]
    ]
    x = np.array([[radii[r] * np.cos(angles[a]), radii[r] * np.sin(angles[a])] for r, a in polar])
    element = basix.ufl.element("Lagrange", "quadrilateral", 2, shape=(2,))
    domain = dmesh.create_mesh(comm=MPI.COMM_SELF, cells=np.arange(9)[None], e=element, x=x)
    space = fem.functionspace(domain, ("Lagrange", 2, (2,)))
    grid = pyvista.read(vtk.write_fields(tmp_path, "modes", space, {"u": np.zeros(18)}))
    found = grid.get_cell(0).points
    found = np.stack(
        [np.hypot(found[:, 0], found[:, 1]), np.arctan2(found[:, 1], found[:, 0])], axis=1
    )
    corners = found[:4]
    np.testing.assert_allclose(found[4:8], (corners + np.roll(corners, -1, axis=0)) / 2, atol=1e-12)
    np.testing.assert_allclose(found[8], corners.mean(axis=0), atol=1e-12)


def test_written_motion_is_series_of_grids(tmp_path):
    space = space_on("tetrahedron")
    times = [0.0, 0.1, 0.25]
    states = np.outer(1 + np.arange(3), of_space(space, 2))
    path = vtk.write_motion(tmp_path, "motion", space, times, states.__getitem__)
    assert path == tmp_path / "motion" / "motion.pvd" and len(os.listdir(path.parent)) == 4
    reader = pyvista.get_reader(path)
    assert reader.time_values == times
    for i, time in enumerate(times):
        reader.set_active_time_value(time)
        grid = reader.read()[0]
        assert set(grid.celltypes) == {24}
        np.testing.assert_allclose(
            grid.point_data["displacement"],
            (1 + i) * field(grid.points, 2, 3),
            atol=1e-13,
            rtol=2.0**-23,  # single precision
        )


def test_written_points_are_series_of_point_sets(tmp_path):
    times, points = [0.5, 0.75], np.array([[1.0, 2.0, 0.0], [3.0, 4.0, 5.0], [0.0, 0.0, 1.0]])
    rng = np.random.default_rng(3)
    arrays = {"force": rng.normal(size=(2, 3, 3)), "gap": rng.normal(size=(2, 3))}
    arrays["state"] = np.array([[-1, 0, 1], [1, 1, -1]], dtype=np.int8)
    path = vtk.write_points(tmp_path, "points", times, points, arrays)
    assert path == tmp_path / "points" / "points.pvd" and len(os.listdir(path.parent)) == 3
    reader = pyvista.get_reader(path)
    assert reader.time_values == times
    for i, time in enumerate(times):
        reader.set_active_time_value(time)
        found = reader.read()[0]
        assert found.n_verts == found.n_cells == 3 and found.point_data.keys() == list(arrays)
        np.testing.assert_array_equal(found.points, points)
        for name, values in arrays.items():
            np.testing.assert_array_equal(found.point_data[name], values[i])
    with pytest.raises(OSError, match="points"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                vtk,
                "write_series",
                lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")),
            )
            vtk.write_points(tmp_path, "points", times[:1], points, {})
    assert os.listdir(tmp_path) == ["points"] and len(os.listdir(path.parent)) == 3


@pytest.mark.parametrize(
    "stop", [KeyboardInterrupt, OSError(errno.ENOSPC, "No space left on device")]
)
def test_interrupted_motion_leaves_older_one(tmp_path, stop):
    space = space_on("triangle")
    zero = np.zeros(len(of_space(space, 2)))
    vtk.write_motion(tmp_path, "motion", space, [0.0], lambda number: zero)

    def frame(number):
        if number == 1:
            raise stop
        return zero

    with pytest.raises(
        stop if isinstance(stop, type) else OSError,
        match=None if isinstance(stop, type) else "motion",
    ):
        vtk.write_motion(tmp_path, "motion", space, [0.0, 1.0, 2.0], frame)
    assert os.listdir(tmp_path) == ["motion"] and len(os.listdir(tmp_path / "motion")) == 2


@pytest.mark.parametrize("cell", CELLS)
def test_refined_grid_keeps_linear_fields_and_volume(tmp_path, cell):
    """Quadratic cells on the corners of dolfinx, with means of corners at their other nodes."""
    from fenicsrom.post.paraview.vtk import Attached, refined_grid, write_vtu

    space = space_on(cell, 1)
    d = space.mesh.geometry.dim
    points, cells = space.tabulate_dof_coordinates()[:, :d], np.asarray(space.dofmap.list)
    grid, mean = refined_grid(points, cells)
    assert grid.cell_type == CELLS[cell][1] and mean.shape == (len(grid.points), len(points))
    values = points @ np.arange(1.0, 1.0 + d)
    np.testing.assert_allclose(mean @ values, grid.points[:, :d] @ np.arange(1.0, 1.0 + d))
    write_vtu(tmp_path / "fine.vtu", grid, Attached({"x": mean @ values}))
    read = pyvista.read(tmp_path / "fine.vtu")
    sizes = np.abs(read.triangulate().compute_cell_sizes()["Area" if d == 2 else "Volume"])
    assert sizes.sum() == pytest.approx(LENGTH * HEIGHT ** (d - 1))
    assert len(np.unique(np.round(grid.points, 9), axis=0)) == len(grid.points)
