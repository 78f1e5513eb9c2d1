"""ParaView files and pictures of known fields, read back with pyvista."""

import errno
import os
import resource
import shutil
import signal

import numpy as np
import pytest

MPI = pytest.importorskip("mpi4py.MPI")
fem = pytest.importorskip("dolfinx.fem")
pyvista = pytest.importorskip("pyvista")

from dolfinx import mesh as dmesh  # noqa: E402
from support import needs_mpirun, on_ranks  # noqa: E402

from fenicsrom.post import vtk

CELLS = {
    "triangle": (5, 22),
    "quadrilateral": (9, 28),
    "tetrahedron": (10, 24),
    "hexahedron": (12, 29),
}
LENGTH, HEIGHT = 2.0, 0.1


def space_on(cell, degree=2, comm=MPI.COMM_SELF, along=6):
    kind = dmesh.CellType[cell]
    if cell in ("triangle", "quadrilateral"):
        domain = dmesh.create_rectangle(comm, [[0, 0], [LENGTH, HEIGHT]], [along, 1], kind)
    else:
        domain = dmesh.create_box(comm, [[0, 0, 0], [LENGTH, HEIGHT, HEIGHT]], [along, 1, 1], kind)
    return fem.functionspace(domain, ("Lagrange", degree, (domain.geometry.dim,)))


def field(points, degree, d):
    """Components that are different polynomials of the degree of the space, (n, d)."""
    x, y, z = points.T
    return np.stack(
        [1 + 2 * x - y, x**degree - 3 * z + y * x ** (degree - 1), y**degree + 4 * z - x][:d],
        axis=1,
    )


def of_space(space, degree):
    return field(space.tabulate_dof_coordinates(), degree, space.dofmap.index_map_bs).ravel()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("cell", CELLS)
def test_fields_are_read_back_by_label(tmp_path, cell, degree):
    space = space_on(cell, degree)
    d = space.mesh.geometry.dim
    function = fem.Function(space)
    function.x.array[:] = of_space(space, degree)
    path = export.write_fields(
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
def test_nodes_are_in_the_order_of_vtk_and_no_cell_is_inside_out(tmp_path, cell):
    """VTK's own shape functions give the quadratic field between the nodes, and the right
    volume."""
    space = space_on(cell)
    d = space.mesh.geometry.dim
    grid = pyvista.read(export.write_fields(tmp_path, "modes", space, {"u": of_space(space, 2)}))
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


def test_a_curved_body_has_its_middle_nodes_on_the_curve(tmp_path):
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
    grid = pyvista.read(export.write_fields(tmp_path, "modes", space, {"u": np.zeros(18)}))
    found = grid.get_cell(0).points
    found = np.stack(
        [np.hypot(found[:, 0], found[:, 1]), np.arctan2(found[:, 1], found[:, 0])], axis=1
    )
    corners = found[:4]
    np.testing.assert_allclose(found[4:8], (corners + np.roll(corners, -1, axis=0)) / 2, atol=1e-12)
    np.testing.assert_allclose(found[8], corners.mean(axis=0), atol=1e-12)


def test_a_field_of_the_wrong_size_or_degree_is_refused(tmp_path):
    space = space_on("triangle")
    with pytest.raises(ValueError, match="local unknowns"):
        export.write_fields(tmp_path, "modes", space, {"u": np.zeros(7)})
    with pytest.raises(ValueError, match="degree 1 or 2"):
        cubic = space_on("triangle", 3)
        export.write_fields(tmp_path, "modes", cubic, {"u": of_space(cubic, 2)})
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("as_callable", [True, False])
def test_a_motion_is_a_series_of_grids(tmp_path, as_callable):
    space = space_on("tetrahedron")
    times = [0.0, 0.1, 0.25]
    states = np.outer(1 + np.arange(3), of_space(space, 2))
    path = export.write_motion(
        tmp_path, "motion", space, times, states.__getitem__ if as_callable else states
    )
    assert path == tmp_path / "motion" / "motion.pvd" and len(os.listdir(path.parent)) == 4
    reader = pyvista.get_reader(path)
    assert reader.time_values == times
    for i, time in enumerate(times):
        reader.set_active_time_value(time)
        grid = reader.read()[0]
        assert set(grid.celltypes) == {24}
        np.testing.assert_allclose(
            grid.point_data["displacement"], (1 + i) * field(grid.points, 2, 3), atol=1e-13
        )


def test_contact_points_are_a_series_of_point_sets(tmp_path):
    times, points = [0.5, 0.75], np.array([[1.0, 2.0, 0.0], [3.0, 4.0, 5.0], [0.0, 0.0, 1.0]])
    rng = np.random.default_rng(3)
    arrays = {"force": rng.normal(size=(2, 3, 3)), "gap": rng.normal(size=(2, 3))}
    arrays["state"] = np.array([[-1, 0, 1], [1, 1, -1]], dtype=np.int8)
    path = export.write_points(tmp_path, "points", times, points, arrays)
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
                export,
                "_write_series",
                lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")),
            )
            export.write_points(tmp_path, "points", times[:1], points, {})
    assert os.listdir(tmp_path) == ["points"] and len(os.listdir(path.parent)) == 3


@pytest.mark.parametrize(
    "stop", [KeyboardInterrupt, SystemExit, OSError(errno.ENOSPC, "No space left on device")]
)
def test_an_interrupted_motion_leaves_the_older_one(tmp_path, stop):
    space = space_on("triangle")
    zero = np.zeros(len(of_space(space, 2)))
    export.write_motion(tmp_path, "motion", space, [0.0], [zero])

    def frame(number):
        if number == 1:
            raise stop
        return zero

    with pytest.raises(
        stop if isinstance(stop, type) else OSError,
        match=None if isinstance(stop, type) else "motion",
    ):
        export.write_motion(tmp_path, "motion", space, [0.0, 1.0, 2.0], frame)
    assert os.listdir(tmp_path) == ["motion"] and len(os.listdir(tmp_path / "motion")) == 2


def test_a_full_disk_leaves_nothing(tmp_path):
    """A limit on the size of files stands for the full disk."""
    space = space_on("hexahedron", along=30)
    u = of_space(space, 2)
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
        with pytest.raises(OSError, match=r"modes\.vtu"):
            export.write_fields(tmp_path, "modes", space, {"1V": u})
        with pytest.raises(OSError, match="motion"):
            export.write_motion(tmp_path, "motion", space, [0.0], [u])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize("cell", CELLS)
def test_the_centreline_of_a_slender_body_shows_no_rotation(cell):
    """A bending shape with its rotating sections, and an axial one: both come back, bending without
    an axial part."""
    space = space_on(cell, along=16)
    d = space.mesh.geometry.dim
    corners = space.mesh.geometry.x
    inside = (corners[:, 0] > 1e-9) & (corners[:, 0] < LENGTH - 1e-9)
    corners[inside, 0] += np.random.default_rng(2).uniform(
        -0.03, 0.03, inside.sum()
    )  # uneven sections
    x = space.tabulate_dof_coordinates()
    k = 2.0 / LENGTH
    bending, axial = np.zeros((len(x), d)), np.zeros((len(x), d))
    bending[:, 1] = 1 - np.cos(k * x[:, 0])
    bending[:, 0] = -(x[:, 1] - HEIGHT / 2) * k * np.sin(k * x[:, 0])
    axial[:, 0] = np.sin(k * x[:, 0])
    positions, shapes = export.centreline(
        space, {"1V": bending.ravel(), "1V1V": axial.ravel()}, stations=41
    )
    assert shapes.shape == (2, 41, d) and positions[[0, -1]] == pytest.approx([0, LENGTH])
    np.testing.assert_allclose(shapes[0, :, 1], 1 - np.cos(k * positions), atol=2e-4)
    np.testing.assert_allclose(shapes[1, :, 0], np.sin(k * positions), atol=2e-4)
    assert np.abs(shapes[0, :, 0]).max() < 5e-3 * HEIGHT and np.abs(shapes[1, :, 1:]).max() < 1e-12


def test_the_centreline_puts_the_axis_first():
    space = space_on("hexahedron")
    space.mesh.geometry.x[:] = space.mesh.geometry.x[:, [1, 2, 0]]  # now along z
    x = space.tabulate_dof_coordinates()
    u = np.stack([x[:, 2], 2 * x[:, 2], 3 * x[:, 2]], axis=1)
    positions, shapes = export.centreline(space, {"u": u.ravel()}, stations=5)
    np.testing.assert_allclose(shapes[0], np.outer(positions, [3, 1, 2]), atol=1e-12)


needs_xvfb = pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs Xvfb")


@pytest.mark.slow
@needs_xvfb
@pytest.mark.parametrize("cell", ["quadrilateral", "tetrahedron"])
def test_deformed_shapes_are_drawn_without_a_display(tmp_path, monkeypatch, cell):
    from matplotlib.image import imread

    monkeypatch.delenv("DISPLAY", raising=False)
    space = space_on(cell)
    x = space.tabulate_dof_coordinates()
    u = np.zeros((len(x), space.mesh.geometry.dim))
    u[:, 1] = x[:, 0] ** 2
    png = export.picture_modes(tmp_path / "modes.png", space, {"1V": u.ravel(), "2V": -u.ravel()})
    assert png == tmp_path / "modes.png" and os.listdir(tmp_path) == ["modes.png"]
    picture = imread(png)[..., :3]
    colourful = np.ptp(picture, axis=2) > 0.3
    height, width = colourful.shape
    assert height > 200 and width > 1000 and colourful.mean() > 0.005
    bent_up, bent_down = (
        np.nonzero(colourful[: height // 2, half])[0].mean()
        for half in (slice(0, width // 2), slice(width // 2, None))
    )
    assert bent_up < bent_down - 10  # pixels, counted from above


@needs_xvfb
def test_a_shape_that_does_not_move_is_drawn(tmp_path):
    from matplotlib.image import imread

    space = space_on("triangle")
    zero = 0 * of_space(space, 2)
    picture = imread(export.picture_modes(tmp_path / "modes.png", space, {"1V": zero}))[..., :3]
    body = picture[: len(picture) // 2] - np.array([68, 1, 84]) / 255  # the colour of zero
    assert (np.abs(body).max(axis=2) < 0.06).sum() > 1000


def test_without_anything_to_draw_with_there_is_a_warning_and_no_picture(tmp_path, monkeypatch):
    """A process that dies, as VTK does without a display, is survived."""
    monkeypatch.setattr(export.shutil, "which", lambda name: None)
    monkeypatch.setattr(export.sys, "executable", shutil.which("false") or "/bin/false")
    space = space_on("triangle")
    with pytest.warns(
        UserWarning, match=r"modes\.png was not drawn: there is neither a display nor Xvfb.*\.$"
    ):
        assert (
            export.picture_modes(tmp_path / "modes.png", space, {"u": of_space(space, 2)}) is None
        )
    assert not os.listdir(tmp_path)


# ------------------------------------------------------------------ animations


@pytest.mark.parametrize(
    ("largest", "factor"),
    [
        (0.0, 1),
        (0.5, 1),
        (0.06, 1),
        (0.05, 2),
        (0.04, 5),
        (0.02, 10),
        (1.01e-3, 100),
        (4e-5, 5000),
        (2e-8, 1e7),
    ],
)
def test_displacements_are_magnified_by_a_round_number(largest, factor):
    """A body of 2 m: to scale from 0.06 m on, else to at most 0.2 m."""
    assert export.magnification(largest, 2.0) == pytest.approx(factor)
    assert largest >= 0.06 or factor * largest <= 0.2 * (1 + 1e-9)


def swing(space, size, frames=4):
    """Times, a displacement that swings up, to rest, down and to rest, and a contact point at the
    tip that goes with it."""
    x = space.tabulate_dof_coordinates()
    up = np.zeros((len(x), space.mesh.geometry.dim))
    up[:, 1] = size * (x[:, 0] / LENGTH) ** 2
    phase = np.sin(np.pi / 2 * (1 + np.arange(frames)))
    tip = np.zeros((frames, 1, 3))
    tip[:, 0, 1] = size * phase
    state = np.array([[1], [0], [1], [0]], dtype=np.int8)[:frames]
    marks = (
        np.array([[LENGTH, HEIGHT / 2, 0.0]]),
        {"displacement": tip, "state": state, "gap": tip[..., 0]},
    )
    return np.linspace(0.1, 0.4, frames), lambda k: phase[k] * up.ravel(), marks


@pytest.mark.slow
@needs_xvfb
@pytest.mark.parametrize(("cell", "size"), [("quadrilateral", 0.2), ("tetrahedron", 1e-4)])
def test_a_motion_is_animated_without_a_display(tmp_path, monkeypatch, cell, size):
    """The tip is where it swings to, in the colour of its state; body and mark move together,
    magnified or not."""
    from PIL import Image

    from fenicsrom.post.style import STATES

    monkeypatch.delenv("DISPLAY", raising=False)
    space = space_on(cell)
    gif = export.animate(tmp_path / "motion.gif", space, *swing(space, size))
    assert gif == tmp_path / "motion.gif" and os.listdir(tmp_path) == ["motion.gif"]
    with Image.open(gif) as film:
        assert film.n_frames == 4 and film.info["loop"] == 0
        assert film.info["duration"] == pytest.approx(1e3 * export.FILM_SECONDS / 4)
        frames = []
        for k in range(4):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    tips = []
    for frame, state in zip(frames, (1, 0, 1, 0), strict=True):
        colour = np.array(export._rgb(STATES[state][1]))
        near = (np.abs(frame - colour).max(axis=2) <= 5)[
            40:-70, 600:
        ]  # without legend and colour bar
        assert near.sum() >= 10
        tips.append(np.nonzero(near)[0].mean())
    up, rest, down, again = tips
    assert rest == pytest.approx(again, abs=0.6) and up + down == pytest.approx(2 * rest, abs=4)
    travel = (
        2 * size * export.magnification(size, LENGTH) / LENGTH
    )  # of the length, which is about 650 pixels long
    assert down - up == pytest.approx(650 * travel, rel=0.15)


def test_without_anything_to_draw_with_there_is_a_warning_and_no_animation(tmp_path, monkeypatch):
    monkeypatch.setattr(export.shutil, "which", lambda name: None)
    monkeypatch.setattr(export.sys, "executable", shutil.which("false") or "/bin/false")
    space = space_on("triangle")
    with pytest.warns(
        UserWarning, match=r"motion\.gif was not drawn: there is neither a display nor Xvfb.*\.$"
    ):
        assert export.animate(tmp_path / "motion.gif", space, *swing(space, 0.2)) is None
    assert not os.listdir(tmp_path)


PARALLEL = """
import numpy as np
from mpi4py import MPI
from test_export import export, of_space, space_on
space = space_on("tetrahedron", comm=MPI.COMM_WORLD)
u = of_space(space, 2)
print(export.write_fields({folder!r}, "modes", space, {{"1V": u}}))
print(export.write_motion({folder!r}, "motion", space, [0.0, 0.5], lambda i: i * u))
positions, shapes = export.centreline(space, {{"1V": u}}, stations=9)
np.save({folder!r} + f"/line{{MPI.COMM_WORLD.rank}}.npy", shapes)
def frame(number):
    if MPI.COMM_WORLD.rank == 1 and number == 1:
        raise OSError(28, "No space left on device")
    return u
try:
    export.write_motion({folder!r}, "broken", space, [0.0, 0.5], frame)
except OSError as error:
    print("refused:", error)
"""


@pytest.mark.slow
@needs_mpirun
def test_two_ranks_write_one_grid(tmp_path):
    done = on_ranks(2, "-c", PARALLEL.format(folder=str(tmp_path)))
    assert done.stdout.count("refused:") == 2 and "rank 1 failed" in done.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "line0.npy",
        "line1.npy",
        "modes",
        "motion",
    ]
    whole = space_on("tetrahedron")
    grid = pyvista.read(tmp_path / "modes" / "modes.pvtu")
    assert grid.n_cells == whole.mesh.topology.index_map(3).size_local and set(grid.celltypes) == {
        24
    }
    np.testing.assert_allclose(grid.point_data["1V"], field(grid.points, 2, 3), atol=1e-13)
    reader = pyvista.get_reader(tmp_path / "motion" / "motion.pvd")
    reader.set_active_time_value(0.5)
    moved = reader.read()[0]
    np.testing.assert_allclose(
        moved.point_data["displacement"], field(moved.points, 2, 3), atol=1e-13
    )
    _, line = export.centreline(whole, {"1V": of_space(whole, 2)}, stations=9)
    for rank in (0, 1):
        np.testing.assert_allclose(np.load(tmp_path / f"line{rank}.npy"), line, atol=1e-10)
