"""Pictures of deformed bodies, drawn by matplotlib."""

import itertools

import numpy as np
import pytest
from test_figures import drawn, illegible

from fenicsrom.post.base.style import magnification
from fenicsrom.post.body import body_figures
from fenicsrom.post.body.body_surface import surface_of
from fenicsrom.post.body.body_view import view_of
from fenicsrom.post.body.group_drawing import MORE_COLOURS, group_figure
from fenicsrom.post.paraview.vtk_files import Grid, reference_nodes
from fenicsrom.post.setup import setup_figure
from fenicsrom.post.setup.setup_marks import (
    CLAMPED,
    AttachmentMark,
    ContactMark,
    LoadMark,
    Marks,
    SupportMark,
)
from fenicsrom.post.setup.setup_symbols import (
    APART,
    MARK_COLOURS,
    MOST_BARS,
    NUMBER,
    REGION_COLOURS,
    Arrow,
    attachment_symbols,
    bars,
    load_arrows,
    number_places,
)

LONG, WIDE, THIN = 10, 4, 0.1


@pytest.fixture(scope="module")
def plate():
    """A thin plate along x whose broad side is turned by 40 degrees about x."""
    count = np.array([LONG + 1, WIDE + 1, 2])
    at = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1)
    number = np.arange(count.prod()).reshape(count)
    corners = reference_nodes("hexahedron")[:8].astype(int)
    cells = [
        [number[i + a, j + b, c] for a, b, c in corners] for i in range(LONG) for j in range(WIDE)
    ]
    points = at.reshape(-1, 3) * [0.1, 0.1, THIN * 0.1]
    angle = np.radians(40.0)
    turn = np.array(
        [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    )
    return surface_of(Grid(points @ turn.T, np.array(cells), 12)), turn[:, 2]


def test_view_shows_the_broad_side_with_the_long_axis_to_the_right(plate):
    surface, normal = plate
    view = view_of(surface.points, surface.triangles)
    assert abs(view.towards @ normal) > 0.7
    places = view.project(np.eye(3))
    assert places[0, 0] > 0.9
    frame = np.array([view.right, view.up, view.towards])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)


def test_shapes_are_drawn_with_titles_and_colours(plate, tmp_path):
    surface, normal = plate
    bent = surface.points[:, :1] ** 2 * normal
    fields = {"1V": bent, "2V": -bent, "1S": 0.0 * bent}
    titles = {"1V": "1V, 12.3 Hz", "2V": "2V, 45.6 Hz", "1S": "1S"}
    figure = body_figures.shape_figure(surface, fields, titles)
    panels = figure.axes[:3]
    assert [axis.get_title(loc="left") for axis in panels] == list(titles.values())
    assert all({t.get_text() for t in axis.texts} >= {"x"} for axis in panels)
    drawn(figure, tmp_path)
    many = {f"{k}V": bent for k in range(30)}
    figure = body_figures.shape_figure(surface, many, {name: name for name in many})
    shown = [axis for axis in figure.axes if axis.get_title(loc="left")]
    assert len(shown) == body_figures.MOST_SHAPES
    assert "20 of 30" in figure.axes[-1].get_xlabel()
    assert body_figures.NO_SCALE in figure.axes[-1].get_xlabel()
    assert not illegible(figure)


def test_deflection_names_its_magnification(plate, tmp_path):
    surface, normal = plate
    bent = 1e-3 * surface.points[:, :1] ** 2 * normal
    figure = body_figures.deflection_figure(surface, bent, "equilibrium")
    factor = magnification(1e-3, LONG * 0.1)
    assert factor > 1.0 and f"× {factor:g}" in figure.axes[-1].get_xlabel()
    drawn(figure, tmp_path)


def test_setup_shows_every_mark_in_its_legend(plate, tmp_path):
    surface, normal = plate
    x = surface.points[:, 0]
    tip = surface.points[x > 0.99 * x.max()]
    none = np.zeros(len(x), dtype=bool)
    marks = Marks(
        supports=[
            SupportMark(CLAMPED, x < 1e-9, np.zeros((0, 3))),
            SupportMark("held along x", x > 0.99 * x.max(), np.eye(3)[:1]),
        ],
        loads=[
            LoadMark("first", tip.mean(axis=0)[None], normal, x > 0.99 * x.max()),
            LoadMark("second", tip.mean(axis=0)[None], normal, none),
        ],
        attachments=[
            AttachmentMark("spring", "spring, 3 N/m", tip[0]),
            AttachmentMark("dashpot", "dashpot, 2 N s/m", tip[0]),
            AttachmentMark("mass", "mass, 1 kg", tip[-1]),
        ],
        contacts=[ContactMark("contact", tip, np.tile([1.0, 0.0, 0.0], (len(tip), 1)))],
        probe=tip[0],
    )
    figure = setup_figure.setup_figure(surface, marks, "a plate")
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "support, clamped",
        "support, held along x",
        "1: first",
        "2: second",
        "loaded region",
        "spring, 3 N/m",
        "dashpot, 2 N s/m",
        "mass, 1 kg",
        "contact",
        "normal into the wall",
        "probe",
    ]
    (axis,) = figure.axes
    loads = [text for text in axis.texts if text.get_color() == MARK_COLOURS["load"]]
    numbers = [text for text in loads if text.get_text()]
    boxes = [text.get_window_extent() for text in numbers]
    assert len(boxes) == 2 and not boxes[0].overlaps(boxes[1])
    from matplotlib.colors import to_rgba

    held = to_rgba(REGION_COLOURS["clamped"])
    found = [c for c in axis.collections if np.allclose(c.get_edgecolor()[:1], held)]
    assert found and len(found[0].get_segments()) >= 4
    hollow = [line.get_marker() for line in axis.lines if line.get_markerfacecolor() == "none"]
    assert sorted(hollow) == ["o", "s"]  # nothing below the probe and the mass is hidden
    drawn(figure, tmp_path)


def test_numbers_of_loads_are_apart_and_forces_stay_at_their_places(plate):
    """A pressure beside two forces on a mass, one of which points nearly the same way."""
    surface, _ = plate
    view = view_of(surface.points, surface.triangles)
    place = surface.points.mean(axis=0)
    none = np.zeros(len(surface.points), dtype=bool)
    leaning = view.up - 0.3 * view.right
    loads = [
        LoadMark("pressure", place[None] - 0.01 * view.up, leaning / np.hypot(1.0, 0.3), ~none),
        LoadMark("down", place[None], -view.up, none),
        LoadMark("up", place[None], view.up, none),
    ]
    marks = Marks(loads=loads, attachments=[AttachmentMark("mass", "mass", place)])
    reach = setup_figure.REACH * view.length
    arrows = load_arrows(loads, view, reach)
    (at,) = view.project(place[None])
    for arrow in arrows[1:]:
        np.testing.assert_allclose(arrow.end, at)
    assert np.linalg.norm(arrows[0].start - arrows[2].start) > APART * view.length  # they diverge
    figure = setup_figure.setup_figure(surface, marks, "a plate")
    figure.draw_without_rendering()
    (axis,) = figure.axes
    boxes = [text.get_window_extent() for text in axis.texts if text.get_text() in tuple("123")]
    assert len(boxes) == 3
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
    for _, start, end in arrows:
        shaft = axis.transData.transform(np.linspace(start, end, 50))
        assert not any(box.contains(*spot) for box in boxes for spot in shaft)
    assert any(line.get_marker() == "s" and line.get_mfc() == "none" for line in axis.lines)


def test_numbers_avoid_what_is_drawn_behind_the_tails():
    arrows = [
        Arrow(0, np.zeros(2), np.array([1.0, 0.0])),
        Arrow(1, np.zeros(2), np.array([0, 1.0])),
    ]
    free = number_places(arrows, 1.0, np.zeros((0, 2)))
    np.testing.assert_allclose(free, [[-NUMBER, 0.0], [0.0, -NUMBER]], atol=1e-12)
    moved = number_places(arrows, 1.0, free[:1])
    assert np.linalg.norm(moved[0] - free[0]) > 0.9 * NUMBER
    assert np.linalg.norm(moved[0] - moved[1]) > 0.9 * NUMBER


@pytest.mark.parametrize("lines", [1, 4])
def test_long_title_and_legend_of_the_setup_are_whole(plate, lines):
    surface, normal = plate
    none = np.zeros(len(surface.points), dtype=bool)
    load = LoadMark(
        "a load with a rather long label, 50 N, static", surface.points[:1], normal, none
    )
    title = "\n".join(["a title of many words"] * lines)
    assert not illegible(setup_figure.setup_figure(surface, Marks(loads=[load] * lines), title))


def test_symbols_of_attachments_lie_on_nothing_else(plate):
    surface, _ = plate
    view = view_of(surface.points, surface.triangles)
    place = surface.points[0]
    marks = [AttachmentMark("spring", "spring", place), AttachmentMark("dashpot", "", place)]
    taken = view.project(place[None]) - [[0.0, 0.1]]
    symbols = attachment_symbols(marks, view, 0.1, taken)
    ends = np.array([symbol.lines[0][-1] for symbol in symbols])
    spots = np.array([np.concatenate(symbol.lines).mean(axis=0) for symbol in symbols])
    assert np.linalg.norm(spots[0] - spots[1]) > 0.5 * APART * view.length
    assert np.all(np.linalg.norm(ends - taken, axis=1) > 0.5 * APART * view.length)


def test_held_direction_is_drawn_as_a_line_with_a_bar(plate):
    surface, _ = plate
    view = view_of(surface.points, surface.triangles)
    on = surface.points[:, 0] < 1e-9
    lines = bars(SupportMark("held", on, np.array([[0.6, 0.8, 0.0]])), surface, view, 0.1)
    ways = lines[:, 1] - lines[:, 0]
    expected = view.project(np.array([[-0.06, -0.08, 0.0]]))  # out of the body
    assert 1 < len(lines) <= MOST_BARS
    np.testing.assert_allclose(ways, np.tile(expected, (len(ways), 1)), atol=1e-12)


def test_view_turns_to_a_place_that_must_be_seen(plate):
    """From in front, from behind, from above and from below."""
    surface, normal = plate
    across = np.cross(normal, [1.0, 0.0, 0.0])
    for facing in (normal, -normal, across, -across):
        view = view_of(surface.points, surface.triangles, facing)
        assert view.towards @ facing > 0.2
        assert np.cross(view.right, view.up) @ view.towards == pytest.approx(1.0)


def test_view_looks_across_the_largest_displacement(plate):
    surface, normal = plate
    across = np.cross(normal, [1.0, 0.0, 0.0])
    for moved in (normal, -normal, across):
        view = view_of(surface.points, surface.triangles, moved=0.01 * moved)
        assert abs(view.towards @ moved) < 0.5 < np.linalg.norm(view.project(moved))
    usual, along = (
        view_of(surface.points, surface.triangles, moved=moved)
        for moved in (None, 0.01 * np.array([1.0, 0.0, 0.0]))
    )
    np.testing.assert_allclose(along.towards, usual.towards)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stress_marks_its_largest_value_on_the_side_that_is_seen(plate, tmp_path, side):
    surface, normal = plate
    x, across = surface.points[:, 0], surface.points @ normal
    stress = 1e6 * (1.0 - x) * (1.0 + side * np.sign(across - across.mean()))
    figure = body_figures.stress_figure(surface, 0.01 * surface.points, stress, "bending")
    panel, bar = figure.axes
    assert bar.get_xlabel().startswith("von Mises stress, MPa")
    assert [float(text.get_text()) for text in bar.get_xticklabels()] == [0.0, 1.0, 2.0]
    _, faces, _, mark = panel.collections
    (at,) = mark.get_offsets()
    assert abs(at[0]) < 0.02  # at x = 0
    middle = np.array([path.vertices[:3].mean(axis=0) for path in faces.get_paths()])
    near = np.linalg.norm(middle - at, axis=1) < 0.1
    red, _, blue, _ = faces.get_facecolors()[near].mean(axis=0)
    assert red > 2.0 * blue  # the stressed side, not its back, where the stress is zero
    drawn(figure, tmp_path)


@pytest.mark.parametrize(("side", "far"), [(1.0, False), (-1.0, True)])
def test_stress_on_the_side_that_is_not_seen_says_so(plate, side, far):
    surface, normal = plate
    view = view_of(surface.points, surface.triangles, normal)
    across = surface.points @ normal
    away = np.linalg.norm(surface.points - surface.points.mean(axis=0), axis=1)
    stress = 2.0 + np.sign(side * (across - across.mean())) - away
    figure = body_figures.stress_figure(surface, 0.01 * surface.points, stress, "bending", view)
    title = figure.axes[0].get_title(loc="left")
    assert title == ("bending, on the far side" if far else "bending")


def test_groups_are_drawn_in_their_colours_with_small_ones_in_front(plate, tmp_path):
    from matplotlib.colors import to_rgb

    surface, _ = plate
    facets = surface.triangles
    front = facets[surface.points[facets][..., 0].max(axis=1) > 0.99]
    groups = {"tip": front, "all": facets, "corner": facets[0][:1]}
    figure = group_figure(surface.points, facets, groups)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == list(groups)
    body, largest, small = figure.axes[0].collections
    assert [len(found.get_paths()) for found in (body, largest, small)] == [
        len(facets),
        len(facets),
        len(front),
    ]
    assert to_rgb(small.get_facecolor()[0]) == to_rgb(MORE_COLOURS[0])
    (dots,) = figure.axes[0].lines
    assert to_rgb(dots.get_color()) == to_rgb(MORE_COLOURS[2])
    drawn(figure, tmp_path)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_setup_shows_the_loaded_side(plate, side):
    """The faces of the load have its colour in the picture, which shows no face from behind."""
    from matplotlib.colors import to_rgba

    surface, normal = plate
    across = side * (surface.points @ normal)
    on = across > across.mean()
    marks = Marks(loads=[LoadMark("load", surface.points[:1], normal, on)])
    figure = setup_figure.setup_figure(surface, marks, "a plate")
    colours = figure.axes[0].collections[0].get_facecolors()
    red, _, blue, _ = np.array(to_rgba(REGION_COLOURS["loaded"]))
    assert np.mean(colours[:, 0] / colours[:, 2] > 0.99 * red / blue) > 0.5
