"""The boundary of bodies as triangles, without and with dolfinx."""

import numpy as np
import pytest

pytest.importorskip("pyvista")

from fenicsrom.post.body.body_view import (
    NODE,
    areas,
    cell_edges,
    form_edges,
    gathered_grid,
    is_flat,
    surface_of,
)
from fenicsrom.post.paraview.vtk import CELLS, Grid, in_space, reference_nodes

CORNERS = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}
SURFACE = {
    "triangle": 0.5,
    "quadrilateral": 1.0,
    "tetrahedron": 1.5 + np.sqrt(3.0) / 2.0,
    "hexahedron": 6.0,
}


def one_cell(name, quadratic):
    """The reference cell as a grid."""
    nodes = reference_nodes(name)
    nodes = nodes if quadratic else nodes[: CORNERS[name]]
    return Grid(in_space(nodes), np.arange(len(nodes))[None], CELLS[name][0][quadratic])


def beam_surface(name, length, along=8, height=0.1):
    """A beam along x of quadratic cells."""
    nodes = reference_nodes(name)
    cells = np.arange(along)[:, None, None] * [1.0, 0.0, 0.0] + in_space(nodes)
    points, numbers = np.unique(cells.reshape(-1, 3), axis=0, return_inverse=True)
    grid = Grid(
        points * [length / along, height, height], numbers.reshape(along, -1), CELLS[name][0][1]
    )
    return surface_of(grid)


def sizes(surface):
    return np.linalg.norm(areas(surface), axis=1)


@pytest.mark.parametrize("quadratic", [0, 1])
@pytest.mark.parametrize("name", list(CORNERS))
def test_surface_of_one_cell_is_closed_and_looks_outwards(name, quadratic):
    surface = surface_of(one_cell(name, quadratic))
    size = sizes(surface)
    assert size.min() > 0.0 and size.sum() == pytest.approx(SURFACE[name])
    assert is_flat(surface.points) is (name in ("triangle", "quadrilateral"))
    if is_flat(surface.points):
        assert areas(surface)[:, 2].min() > 0.0
        return
    np.testing.assert_allclose(areas(surface).sum(axis=0), 0.0, atol=1e-12)
    middle = surface.points[surface.regular_faces].mean(axis=1)
    volume = np.sum(middle * areas(surface)) / 3.0
    assert volume == pytest.approx(1.0 if name == "hexahedron" else 1.0 / 6.0)


def edge_lengths(lines):
    pairs = lines.lines.reshape(-1, 3)[:, 1:]
    return np.linalg.norm(np.diff(lines.points[pairs], axis=1)[:, 0], axis=1)


@pytest.mark.parametrize(
    ("name", "edges", "quadratic"), [("triangle", 3, 0), ("hexahedron", 12, 1)]
)
def test_sharp_edges_show_the_form(name, edges, quadratic):
    grid = one_cell(name, quadratic)
    form = edge_lengths(form_edges(surface_of(grid)))
    assert len(form) == edges * (1 + quadratic)
    whole = 12.0 if name == "hexahedron" else 2.0 + np.sqrt(2.0)
    assert form.sum() == pytest.approx(whole)
    straight = edge_lengths(cell_edges(grid))
    assert len(straight) == edges and straight.sum() == pytest.approx(whole)


def test_face_between_two_cells_is_not_part_of_the_surface():
    x, y, z = np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], [0.0, 1.0], indexing="ij")
    number = np.arange(12).reshape(3, 2, 2)
    cells = [
        [number[i + a, b, c] for a, b, c in reference_nodes("hexahedron")[:8].astype(int)]
        for i in range(2)
    ]
    grid = Grid(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), np.array(cells), 12)
    surface = surface_of(grid)
    assert sizes(surface).sum() == pytest.approx(10.0)
    # edges of the box; a ring of four lines where the cells meet is flat
    assert len(edge_lengths(form_edges(surface))) == 16
    assert len(edge_lengths(cell_edges(grid))) == 20


def test_edges_of_bodies_that_touch_have_their_own_nodes():
    cells = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
    lower = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    grid = Grid(np.concatenate([lower, lower + np.array([0.0, 1.0, 0.0])]), cells, 9)
    assert set(form_edges(surface_of(grid)).point_data[NODE]) == set(range(8))


@pytest.mark.parametrize("name", ["triangle", "hexahedron"])
def test_fields_on_the_surface_are_those_of_its_nodes(name):
    grid = one_cell(name, 1)
    field = grid.points @ [1.0, -2.0, 3.0]
    surface = surface_of(grid, {"field": field})
    np.testing.assert_allclose(surface["field"], surface.points @ [1.0, -2.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(grid.points[surface[NODE]], surface.points, atol=1e-12)


def test_body_and_fields_are_collected_from_a_space():
    pytest.importorskip("dolfinx.fem")
    from spaces import HEIGHT, LENGTH, of_space, space_on

    space = space_on("tetrahedron")
    grid, values = gathered_grid(space, {"u": of_space(space, 2)})
    assert sizes(surface_of(grid)).sum() == pytest.approx(4.0 * LENGTH * HEIGHT + 2.0 * HEIGHT**2)
    x, y, _ = grid.points.T
    np.testing.assert_allclose(values["u"][:, 0], 1 + 2 * x - y, atol=1e-12)
