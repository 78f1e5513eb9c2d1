"""Pictures of deformed bodies and of set-ups, drawn by pyvista into figures of matplotlib."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from test_figures import drawn

pytest.importorskip("pyvista")

from fenicsrom.post.base import style as optional
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.style import magnification
from fenicsrom.post.body import body_figures
from fenicsrom.post.body.body_view import Frame, face_on, is_seen, surface_of, view_at, view_of
from fenicsrom.post.body.rendering import painted, render
from fenicsrom.post.paraview.vtk import Grid, reference_nodes
from fenicsrom.post.setup.setup import ARROW, LOADED, Mark, setup_figure

LONG, WIDE, THIN = 10, 4, 0.1
NONE = np.zeros(0, dtype=bool)


def load_mark(label, places, way, on=NONE):
    return Mark("load", label, ARROW, np.reshape(places, (-1, 3)), np.array([way]), on)


def blocks(size, kept=lambda i, j: True):
    """A grid of cubes of side 0.1 in the plane of x and y, without some of them."""
    count = np.array([*size, 1]) + 1
    at = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1)
    number = np.arange(count.prod()).reshape(count)
    corners = reference_nodes("hexahedron")[:8].astype(int)
    cells = [
        [number[i + a, j + b, c] for a, b, c in corners]
        for i, j in itertools.product(*(range(n) for n in size))
        if kept(i, j)
    ]
    return Grid(0.1 * at.reshape(-1, 3), np.array(cells), 12)


@pytest.fixture(scope="module")
def grid():
    """A thin plate along x whose broad side is turned by 40 degrees about x."""
    found = blocks((LONG, WIDE))
    return replace(found, points=found.points * [1.0, 1.0, THIN] @ turn().T)


def turn():
    angle = np.radians(40.0)
    return np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )


@pytest.fixture
def plate(grid):
    return surface_of(grid), turn()[:, 2]


def colours_of(figure, panel=0):
    """The colours (n, 3) of the body's picture in a panel, from 0 to 1."""
    image = np.asarray(figure.axes[panel].images[0].get_array())
    return image[image.min(axis=2) < 255] / 255.0


def shown_in(figure, colour, tolerance=0.12, panel=0):
    """The number of pixels of the body's picture with this colour, in any light."""
    from matplotlib.colors import to_rgb

    found, wanted = colours_of(figure, panel), np.array(to_rgb(colour))
    found = found * (wanted.sum() / np.maximum(found.sum(axis=1, keepdims=True), 1e-3))
    return int(np.sum(np.abs(found - wanted).max(axis=1) < tolerance * wanted.max()))


def test_view_shows_the_broad_side_with_the_long_axis_to_the_right(plate):
    surface, normal = plate
    view = view_of(surface)
    assert abs(view.towards @ normal) > 0.7
    places = view.project(np.eye(3))
    assert places[0, 0] > 0.9
    frame = np.array([view.right, view.up, view.towards])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_plate_is_seen_face_on_and_a_beam_is_not(plate):
    surface, normal = plate
    assert abs(face_on(surface).towards @ normal) == pytest.approx(1.0)
    assert face_on(surface_of(blocks((10, 1)))) is None


def test_picture_shows_a_place_where_the_projection_says(plate):
    import pyvista

    surface, _ = plate
    view, size = view_of(surface), (400, 300)
    low, high = np.array([-0.6, -0.5]), np.array([1.4, 1.0])
    corner = surface.points[np.argmax(surface.points[:, 0] + 1e-3 * surface.points @ view.towards)]
    place = corner + 0.2 * view.towards
    ball = painted(pyvista.Sphere(radius=0.02, center=place), "#FF0000")
    image = render([painted(surface), ball], Frame(view, low, high), size)
    assert image.shape == (300, 400, 3) and image[0, 0].min() == 255
    red = (image[..., 0] > 150) & (image[..., 1] < 80)
    y, x = (found.mean() + 0.5 for found in np.nonzero(red))
    (at,) = view.project(place[None])
    np.testing.assert_allclose([x, 300 - y], (at - low) / (high - low) * size, atol=1.0)


def test_front_of_a_concave_body_hides_what_is_behind_it():
    """A U whose open end is at the right: the inner side of one leg lies behind the other leg."""
    surface = surface_of(blocks((6, 5), lambda i, j: i < 1 or j in (0, 4)))
    inner = np.flatnonzero(np.isclose(surface.points[:, 1], 0.4) & (surface.points[:, 0] > 0.3))
    low = next(k for k in inner if surface.points[k, 2] < 0.01)
    across = replace(view_of(surface), towards=np.array([0.0, -1.0, 0.0]))
    above = replace(across, towards=np.array([0.0, -0.6, 0.8]))
    high = next(k for k in inner if surface.points[k, 2] > 0.09)
    assert not is_seen(surface, surface.points[low], across)
    assert is_seen(surface, surface.points[high], above)
    for place in (low, high):
        view, seen = view_at(surface, place)
        assert seen and is_seen(surface, surface.points[place], view)


def test_nodal_line_is_drawn_where_the_shape_changes_its_sign(plate):
    surface, normal = plate
    surface.point_data["twist"] = (surface.points[:, :1] - 0.6) * normal
    surface.point_data["swing"] = 0.0 * normal + surface.points[:, :1] * turn()[:, 1]
    view = face_on(surface)
    line = body_figures._nodal_lines(surface, surface["twist"], view)
    np.testing.assert_allclose(line.points[:, 0], 0.6, atol=1e-6)
    swing = body_figures._nodal_lines(surface, surface["swing"], view)
    assert line.n_points and not swing.n_points  # moves in the plane
    for label, said in (("twist", True), ("swing", False)):
        figure = figure_of(body_figures.shape_figure(surface, {label: label}, [label]))
        assert (body_figures.NODAL in figure.axes[-1].get_xlabel()) is said


def test_deflection_names_its_magnification(plate, tmp_path):
    surface, normal = plate
    surface.point_data["bent"] = 1e-3 * surface.points[:, :1] ** 2 * normal
    figure = figure_of(
        body_figures.deflection_figure(surface, "bent", "equilibrium", view_of(surface))
    )
    factor = magnification(1e-3, LONG * 0.1)
    assert factor > 1.0 and f"× {factor:g}" in figure.axes[-1].get_xlabel()
    drawn(figure, tmp_path)


def test_view_turns_to_a_place_that_must_be_seen(plate):
    """From in front, from behind, from above, from below and from the ends."""
    surface, normal = plate
    along = np.array([1.0, 0.0, 0.0])
    across = np.cross(normal, along)
    for facing in (normal, -normal, across, -across, along, -along):
        view = view_of(surface, facing)
        assert view.towards @ facing > 0.1
        assert np.cross(view.right, view.up) @ view.towards == pytest.approx(1.0)


def test_view_looks_across_the_largest_displacement(plate):
    surface, normal = plate
    across = np.cross(normal, [1.0, 0.0, 0.0])
    for moved in (normal, -normal, across):
        view = view_of(surface, moved=0.01 * moved)
        assert abs(view.towards @ moved) < 0.5 < np.linalg.norm(view.project(moved))
    usual, along = (
        view_of(surface, moved=moved) for moved in (None, 0.01 * np.array([1.0, 0.0, 0.0]))
    )
    np.testing.assert_allclose(along.towards, usual.towards)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stress_marks_its_largest_value_on_the_side_that_is_seen(plate, tmp_path, side):
    surface, normal = plate
    x, across = surface.points[:, 0], surface.points @ normal
    surface.point_data["u"] = 0.01 * surface.points
    stress = 1e6 * (1.0 - x) * (1.0 + side * np.sign(across - across.mean()))
    surface.point_data[body_figures.SIZE] = stress
    figure = figure_of(body_figures.stress_figure(surface, "u", "bending"))
    panel, bar = figure.axes
    assert bar.get_xlabel().startswith("von Mises stress, MPa")
    assert [float(text.get_text()) for text in bar.get_xticklabels()] == [0.0, 1.0, 2.0]
    assert [text.get_text() for text in panel.texts] == ["bending"]
    (mark,) = panel.lines
    image = np.asarray(panel.images[0].get_array())
    low, high = np.transpose([panel.get_xlim(), panel.get_ylim()])
    column, row = ((mark.get_xydata()[0] - low) / (high - low) * image.shape[1::-1]).astype(int)
    around = (slice(max(at - 40, 0), at + 40) for at in (row, column))
    near = image[::-1][*around].reshape(-1, 3)
    red, _, blue = near[near.min(axis=1) < 250].mean(axis=0)
    assert red > 2.0 * blue  # the stressed side, not its back, where the stress is zero
    drawn(figure, tmp_path)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_setup_shows_the_loaded_side(grid, side):
    across = side * (grid.points @ turn()[:, 2])
    on = across > across.mean()
    marks = [load_mark("load", grid.points[0], turn()[:, 2], on)]
    figure = figure_of(setup_figure(grid, marks, "a plate"))
    assert shown_in(figure, LOADED, 0.08) > 0.3 * len(colours_of(figure))


def test_renderer_is_missing_where_vtk_falls_back_to_a_library_that_is_not_there(monkeypatch):
    from vtkmodules import vtkRenderingCore

    class Window:
        def GetClassName(self):
            return "vtkOSOpenGLRenderWindow"

    assert optional.missing_renderer() is None
    optional.missing_renderer.cache_clear()
    monkeypatch.setattr(vtkRenderingCore, "vtkRenderWindow", Window)
    monkeypatch.setattr(optional, "find_library", lambda name: None)
    assert "OSMesa" in optional.missing_renderer()
    monkeypatch.undo()
    optional.missing_renderer.cache_clear()
