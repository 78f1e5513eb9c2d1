"""Pictures of deformed bodies and of set-ups, drawn by pyvista into figures of matplotlib."""

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_figures import drawn, illegible

pytest.importorskip("pyvista")

from fenicsrom.post.base import picture
from fenicsrom.post.base import style as optional
from fenicsrom.post.base.picture import Picture
from fenicsrom.post.base.style import magnification
from fenicsrom.post.body import body_figures
from fenicsrom.post.body.body_view import (
    NODE,
    Frame,
    areas,
    face_on,
    is_seen,
    surface_of,
    view_at,
    view_of,
)
from fenicsrom.post.body.group_drawing import MORE_COLOURS, group_figure
from fenicsrom.post.body.rendering import painted, render
from fenicsrom.post.paraview.vtk import Grid, reference_nodes
from fenicsrom.post.setup.setup import (
    ARROW,
    CLAMPED,
    COLOURS,
    LOADED,
    Mark,
    load_tips,
    region_parts,
    setup_figure,
    surroundings,
    symbols,
)

LONG, WIDE, THIN = 10, 4, 0.1
NONE = np.zeros(0, dtype=bool)


def load_mark(label, places, way, on=NONE):
    return Mark("load", label, ARROW, np.reshape(places, (-1, 3)), np.array([way]), on)


def contact_mark(places, way, wall=None):
    normals = np.tile(way, (len(places), 1))
    return Mark("contact", "contact", "o", places, normals, wall=wall)


def axis_mark(point, way):
    label = "axis of rotation, 100 rpm"
    return Mark("rotation", label, ARROW, np.array([point]), np.array([way]))


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


def test_bracket_whose_legs_are_wide_is_no_plate():
    legs = blocks((8, 10), lambda i, j: i < 1 or j < 1)
    assert face_on(surface_of(replace(legs, points=legs.points * [1.0, 1.0, 6.0]))) is None


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


@pytest.mark.parametrize("symbol", [True, False])
def test_symbols_behind_a_body_are_pale(plate, symbol):
    import pyvista

    surface, _ = plate
    view = view_of(surface)
    low, high = np.array([-0.6, -0.5]), np.array([1.4, 1.0])
    place = surface.points.mean(axis=0) - 0.3 * view.towards
    ball = painted(pyvista.Sphere(radius=0.03, center=place), "#FF0000")._replace(symbol=symbol)
    image = render([painted(surface, "#FFFFFF"), ball], Frame(view, low, high), (400, 300)) / 255.0
    reddest = np.max(image[..., 0] - image[..., 1])
    assert 0.2 < reddest < 0.6 if symbol else reddest < 0.05


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


def test_shapes_are_drawn_with_titles_and_colours(plate, tmp_path):
    surface, normal = plate
    bent = surface.points[:, :1] ** 2 * normal
    for label, field in {"1V": bent, "2V": -bent, "1S": 0.0 * bent}.items():
        surface.point_data[label] = field
    titles = {"1V": "1V, 12.3 Hz", "2V": "2V, 45.6 Hz", "1S": "1S"}
    before = surface.points.copy()
    figure = body_figures.shape_figure(surface, titles)
    np.testing.assert_array_equal(surface.points, before)
    assert [text.get_text() for text in figure.axes[0].texts] == list(titles.values())
    drawn(figure, tmp_path)
    many = [f"{k}V" for k in range(30)]
    for label in many:
        surface.point_data[label] = bent
    figure = body_figures.shape_figure(surface, {name: name for name in many})
    assert len(figure.axes[0].texts) == body_figures.MOST_SHAPES
    assert "12 of 30" in figure.axes[-1].get_xlabel()
    assert body_figures.NO_SCALE in figure.axes[-1].get_xlabel()
    assert not illegible(figure)


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
        figure = body_figures.shape_figure(surface, {label: label}, [label])
        assert (body_figures.NODAL in figure.axes[-1].get_xlabel()) is said


def test_deflection_names_its_magnification(plate, tmp_path):
    surface, normal = plate
    surface.point_data["bent"] = 1e-3 * surface.points[:, :1] ** 2 * normal
    figure = body_figures.deflection_figure(surface, "bent", "equilibrium", view_of(surface))
    factor = magnification(1e-3, LONG * 0.1)
    assert factor > 1.0 and f"× {factor:g}" in figure.axes[-1].get_xlabel()
    drawn(figure, tmp_path)


@pytest.mark.slow
def test_setup_shows_every_mark_in_its_legend_and_in_its_colour(grid, tmp_path):
    normal, x = turn()[:, 2], grid.points[:, 0]
    tip = grid.points[x > 0.99 * x.max()]
    ends = x > 0.99 * x.max()
    marks = [
        Mark("support", CLAMPED, "<", grid.points[x < 1e-9], on=x < 1e-9),
        Mark("support", "support, held along x", "<", tip, np.eye(3)[:1], ends),
        load_mark("1: first", tip.mean(axis=0), normal, ends),
        load_mark("2: second", tip.mean(axis=0), normal),
        Mark("attachment", "spring, 3 N/m", "D", tip[:1]),
        Mark("attachment", "dashpot, 2 N s/m", "^", tip[:1]),
        Mark("attachment", "mass, 1 kg", "s", tip[-1:]),
        contact_mark(tip, [1.0, 0.0, 0.0]),
        Mark("probe", "probe", "*", tip[:1]),
    ]
    figure = setup_figure(grid, marks, "a plate")
    (legend,) = figure.legends
    labels = [mark.label for mark in marks]
    assert [text.get_text() for text in legend.get_texts()] == [*labels, "loaded region"]
    (axis,) = figure.axes
    loads = [text for text in axis.texts if text.get_color() == COLOURS["load"]]
    assert sorted(text.get_text() for text in loads) == ["1", "2"]
    for kind in ("load", "attachment", "contact", "probe"):
        assert shown_in(figure, COLOURS[kind]) > 50
    drawn(figure, tmp_path)


def test_arrows_of_one_place_stand_behind_one_another_and_others_stay(grid):
    """Two forces and a pressure that points nearly the same way as one of them."""
    place, up = grid.points.mean(axis=0), np.array([0.0, 0.0, 1.0])
    leaning = (up - 0.3 * np.array([1.0, 0.0, 0.0])) / np.hypot(1.0, 0.3)
    loads = [
        load_mark("down", place, -up),
        load_mark("up", place, up),
        load_mark("pressure", place - 0.01 * up, leaning),
    ]
    down, above, pressed = (tips[0] for tips in load_tips(loads, 0.1))
    np.testing.assert_allclose([down, above], [place, place])
    np.testing.assert_allclose(pressed, place - 0.01 * up - 0.11 * leaning)


def numbers_in(figure):
    """The texts of the numbers in the picture of a set-up, and the boxes around them."""
    figure.draw_without_rendering()
    wanted = (COLOURS["contact"], COLOURS["load"])
    found = [text for text in figure.axes[0].texts if text.get_color() in wanted]
    return [text.get_text() for text in found], [text.get_window_extent() for text in found]


@pytest.mark.parametrize(("count", "whole"), [(1, 0), (5, 5), (80, None)])
def test_numbers_of_contact_points_do_not_overlap(grid, count, whole):
    """The first and the last point of many have numbers."""
    places = grid.points[:1] + np.linspace(0.0, 1.0, count)[:, None] * np.eye(3)[0]
    mark = contact_mark(places, [0.0, 0.0, 1.0])
    load = load_mark("load", places[:1], [0.0, 0.0, -1.0])
    texts, boxes = numbers_in(setup_figure(grid, [mark, load], "a plate"))
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    assert len(texts) == whole if whole is not None else 2 < len(texts) < count
    assert count == 1 or {"1", str(count)} <= set(texts)


@pytest.mark.parametrize("lines", [1, 4])
def test_long_title_and_legend_of_the_setup_are_whole(grid, lines):
    label = "a load with a rather long label, 50 N, static"
    loads = [load_mark(f"{k}: {label}", grid.points[0], turn()[:, 2]) for k in range(lines)]
    title = "\n".join(["a title of many words"] * lines)
    assert not illegible(setup_figure(grid, loads, title))


def test_held_direction_is_drawn_as_cones_whose_tips_hold_the_points(grid):
    on = grid.points[:, 0] < 1e-9
    way = np.array([0.6, 0.8, 0.0])
    mark = Mark("support", "held", "<", grid.points[on], way[None], on)
    (part,) = symbols([mark], grid.points, 1.0)
    cones = part.mesh.connectivity().split_bodies()
    assert 1 < len(cones) <= on.sum()
    for cone in cones:
        tip = cone.points[np.argmax(cone.points @ way)]  # the cones stand out of the body
        assert np.linalg.norm(grid.points[on] - tip, axis=1).min() < 1e-6


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
    figure = body_figures.stress_figure(surface, "u", "bending")
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


def test_stress_that_no_view_shows_says_so():
    """The largest stress lies on the inner wall of a closed box."""
    surface = surface_of(blocks((5, 5), lambda i, j: i in (0, 4) or j in (0, 4)))
    lid = surface_of(blocks((5, 5)))
    closed = lid.scale([1.1, 1.1, 3.0]).translate([-0.025, -0.025, -0.1])
    body = surface.merge(closed, merge_points=False).extract_surface(algorithm="dataset_surface")
    inside = np.linalg.norm(body.points - [0.25, 0.1, 0.0], axis=1)
    body.point_data[body_figures.SIZE] = 1.0 - inside
    body.point_data["u"] = 0.0 * body.points
    figure = body_figures.stress_figure(body, "u", "bending")
    assert figure.axes[0].texts[0].get_text() == "bending, hidden by the body"


def test_groups_are_drawn_in_their_colours(plate, tmp_path):
    surface, _ = plate
    facets = surface.regular_faces
    normal = areas(surface) @ turn()[:, 2]
    front = facets[normal > 1e-9]
    back = facets[normal < -1e-9]
    groups = {"front": front, "back": back, "corners": np.unique(facets)[::20]}
    figure = group_figure(surface.points, facets, groups)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == list(groups)
    for panel, (shown, hidden) in enumerate([(0, 1), (1, 0)]):
        sizes = [shown_in(figure, colour, panel=panel) for colour in MORE_COLOURS[:3]]
        assert sizes[shown] > 1000 > 10 * sizes[hidden] and sizes[2] > 20
        names = [text.get_text() for text in figure.axes[panel].texts]
        assert list(groups)[shown] in names and list(groups)[hidden] not in names
    drawn(figure, tmp_path)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_setup_shows_the_loaded_side(grid, side):
    across = side * (grid.points @ turn()[:, 2])
    on = across > across.mean()
    marks = [load_mark("load", grid.points[0], turn()[:, 2], on)]
    figure = setup_figure(grid, marks, "a plate")
    assert shown_in(figure, LOADED, 0.08) > 0.3 * len(colours_of(figure))


def test_clamped_faces_are_seen_where_regions_overlap(plate):
    from pyvista import Color

    surface, _ = plate
    x = np.zeros(surface[NODE].max() + 1)
    x[surface[NODE]] = surface.points[:, 0]
    held = Mark("support", CLAMPED, "<", surface.points[:1], on=x < 0.35)
    body, alone, rim = region_parts(
        surface, [held, load_mark("load", surface.points[0], np.eye(3)[0], x > -1.0)]
    )
    paint = body.mesh.cell_data["paint"]
    clamped = (paint == Color(COLOURS["support"]).int_rgb).all(axis=1)
    assert (
        np.all(clamped | (paint == Color(LOADED).int_rgb).all(axis=1)) and not alone.mesh.n_points
    )
    assert 0.25 < body.mesh.points[body.mesh.regular_faces[clamped]][..., 0].max() < 0.35
    assert (
        rim.symbol and np.ptp(rim.mesh.points[:, 0]) == 0.0 and 0.25 < rim.mesh.points[0, 0] < 0.35
    )


def test_axis_passes_what_turns_about_it_and_points_along_the_axis():
    places, way = np.random.default_rng(0).standard_normal((20, 3)), np.array([0.0, 0.6, 0.8])
    point = np.array([-2.0, 0.0, 0.0])
    (part,) = surroundings([axis_mark(point, way)], places)
    along, reach = places @ way, part.mesh.points - point
    shown = reach @ way
    assert shown.min() < along.min() and shown.max() > along.max()
    across = np.linalg.norm(np.cross(reach, way), axis=1)
    assert across.max() < 0.1 * np.ptp(shown)
    assert shown[np.argmax(across)] > shown.mean()  # the head


@pytest.mark.parametrize(("distance", "panels"), [(0.0, 0), (-2.5, 1)])
def test_second_panel_shows_what_lies_beyond_the_picture(grid, distance, panels, tmp_path):
    """An axis that is seen as a point, in the body or far from it."""
    view = view_of(surface_of(grid))
    middle = grid.points.mean(axis=0)
    marks = [axis_mark(middle + distance * view.right, view.towards)]
    figure = setup_figure(grid, marks, "a plate")
    assert len(figure.axes[0].child_axes) == panels and not illegible(figure)
    (legend,) = figure.legends
    assert "axis of rotation, 100 rpm" in [text.get_text() for text in legend.get_texts()]
    assert not panels or shown_in_panel(figure, COLOURS["rotation"])
    drawn(figure, tmp_path)


def test_second_panel_beside_a_tall_body_is_whole(grid):
    tall = replace(grid, points=grid.points[:, [1, 2, 0]])
    view = view_of(surface_of(tall))
    axis = axis_mark(tall.points.mean(axis=0) + 2.5 * view.right, view.up)
    figure = setup_figure(tall, [axis], "a tall plate")
    figure.draw_without_rendering()
    (panel,) = figure.axes[0].child_axes
    assert panel.get_window_extent().x1 <= figure.bbox.x1


def shown_in_panel(figure, colour):
    """The number of pixels of the second panel with about this colour."""
    from matplotlib.colors import to_rgb

    (panel,) = figure.axes[0].child_axes
    image = np.asarray(panel.images[0].get_array())
    away = np.abs(image[..., :3] / 255.0 - to_rgb(colour)).max(axis=2)
    return int(np.sum(away < 0.15))


def test_surroundings_are_the_walls_and_an_axis_beside_them(grid):
    angle = np.linspace(0.0, 2.0 * np.pi, 101)
    circle = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    wall = Grid(circle, np.column_stack([np.arange(100), np.arange(1, 101)]), 3)
    mark = contact_mark(circle[:1], circle[0], wall)
    (line,) = surroundings([mark], grid.points)
    assert line.mesh.n_cells == 100 and line.look["color"] == COLOURS["contact"]
    way = np.array([1.0, 0.0, 0.0])
    _, axis = surroundings([mark, axis_mark(np.zeros(3), way)], grid.points)
    assert np.ptp(axis.mesh.points[:, 0]) > np.ptp(circle[:, 0])
    assert not surroundings([replace(mark, wall=None)], grid.points)


def test_pictures_in_space_are_left_out_in_one_sentence_where_none_can_be_drawn(
    monkeypatch, tmp_path
):
    from fenicsrom.post.base.style import new_figure

    monkeypatch.setattr(picture, "missing_renderer", lambda: "VTK finds no EGL")

    def drawn() -> Any:
        figure = new_figure(2.0, 2.0)
        figure.subplots()
        return figure

    names = {"setup.png": True, "motion.png": False, "shapes.png": True}
    listed = [Picture(n, n, drawn, in_space=space) for n, space in names.items()]
    notes = []
    written = picture.draw_pictures(listed, tmp_path, notes)
    assert notes == ["setup.png and shapes.png were not drawn: VTK finds no EGL"]
    assert [one.path.name for one in written] == ["motion.png"]


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
