"""Pictures of deformed bodies, drawn by matplotlib."""

import numpy as np
import pytest
from test_figures import drawn

from fenicsrom.post import body_drawing
from fenicsrom.post.body_surface import surface_of
from fenicsrom.post.style import magnification
from fenicsrom.post.vtk_files import Grid, reference_nodes

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
    view = body_drawing.view_of(surface)
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
    figure = body_drawing.shape_figure(surface, fields, titles)
    panels = figure.axes[:3]
    assert [axis.get_title(loc="left") for axis in panels] == list(titles.values())
    assert all({t.get_text() for t in axis.texts} >= {"x"} for axis in panels)
    drawn(figure, tmp_path)
    many = {f"{k}V": bent for k in range(30)}
    figure = body_drawing.shape_figure(surface, many, {name: name for name in many})
    shown = [axis for axis in figure.axes if axis.get_title(loc="left")]
    assert len(shown) == body_drawing.MOST_SHAPES
    assert "20 of 30" in figure.axes[-1].get_xlabel()


def test_deflection_names_its_magnification(plate, tmp_path):
    surface, normal = plate
    bent = 1e-3 * surface.points[:, :1] ** 2 * normal
    figure = body_drawing.deflection_figure(surface, bent, "equilibrium")
    factor = magnification(1e-3, LONG * 0.1)
    assert factor > 1.0 and f"× {factor:g}" in figure.axes[-1].get_xlabel()
    drawn(figure, tmp_path)


def test_setup_shows_every_mark_in_its_legend(plate, tmp_path):
    surface, normal = plate
    x = surface.points[:, 0]
    tip = surface.points[x > 0.99 * x.max()]
    marks = body_drawing.Marks(
        x < 1e-9,
        {
            'force on "tip"': (tip.mean(axis=0), normal, x > 0.99 * x.max()),
            "away from the viewer": (tip[0], np.zeros(3), x < 0.0),
        },
        {"contact": (tip, np.tile([1.0, 0.0, 0.0], (len(tip), 1)))},
        tip[0],
    )
    figure = body_drawing.setup_figure(surface, marks, "a plate")
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["support", *marks.loads, "contact", "probe"]
    held = body_drawing.MARK_COLOURS["support"]
    from matplotlib.colors import to_rgba

    found = [
        collection
        for collection in figure.axes[0].collections
        if np.allclose(collection.get_edgecolor()[:1], to_rgba(held))
    ]
    assert found and len(found[0].get_segments()) >= 4
    drawn(figure, tmp_path)
