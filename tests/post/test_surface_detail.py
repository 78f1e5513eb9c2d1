"""Surfaces with fewer or with more triangles."""

import numpy as np
import pytest
from test_body_surface import areas, beam_surface

from fenicsrom.post.body.body_surface import normals
from fenicsrom.post.body.surface_detail import for_picture, refined, simplified


@pytest.mark.parametrize("name", ["triangle", "quadrilateral", "tetrahedron", "hexahedron"])
def test_refined_surface_has_the_same_form_and_linear_fields(name):
    if name in ("triangle", "tetrahedron"):
        from test_body_surface import one_cell

        from fenicsrom.post.body.body_surface import surface_of

        surface = surface_of(one_cell(name, 1))
    else:
        surface = beam_surface(name, 2.0)
    finer, mean = refined(surface, 300)
    assert 300 <= len(finer.triangles) < 1200
    np.testing.assert_allclose(mean @ surface.points, finer.points)
    assert areas(finer).sum() == pytest.approx(areas(surface).sum())
    before, after = (normals(s.points, s.triangles) for s in (surface, finer))
    factor = len(finer.triangles) // len(surface.triangles)
    np.testing.assert_allclose(after, np.repeat(before, factor, axis=0), atol=1e-12)
    np.testing.assert_array_equal(finer.edges, surface.edges)
    np.testing.assert_allclose(after[finer.sides], before[surface.sides], atol=1e-12)


@pytest.mark.parametrize("name", ["quadrilateral", "hexahedron"])
def test_simplified_surface_keeps_form_and_edges(name):
    surface = beam_surface(name, 2.0, along=400)
    coarse, kept = simplified(surface, 600)
    assert 200 < len(coarse.triangles) < 900
    np.testing.assert_array_equal(coarse.points, surface.points[kept])
    assert areas(coarse).sum() == pytest.approx(areas(surface).sum(), rel=0.05)
    assert np.ptp(coarse.points[:, 0]) == pytest.approx(2.0, abs=0.03)
    length = [
        np.linalg.norm(np.diff(s.points[s.edges], axis=1)[:, 0], axis=1).sum()
        for s in (coarse, surface)
    ]
    assert length[0] == pytest.approx(length[1], rel=0.1)
    assert coarse.sides.min() >= 0 and coarse.sides.max() < len(coarse.triangles)


def test_thin_plate_keeps_both_sides_apart():
    """The cubes are larger than the thickness."""
    surface = beam_surface("hexahedron", 2.0, along=400, height=1e-3)
    coarse, _ = simplified(surface, 400)
    up = normals(coarse.points, coarse.triangles)[:, 1]
    size = areas(coarse)
    assert size[up > 0.9].sum() == pytest.approx(2e-3, rel=0.1)
    assert size[up < -0.9].sum() == pytest.approx(2e-3, rel=0.1)


def test_surface_of_a_picture_has_only_its_own_points():
    surface = beam_surface("hexahedron", 2.0)
    values = {"x": surface.points[:, 0], "u": surface.points}
    shown, found = for_picture(surface, values, 100)
    assert len(np.unique(shown.triangles)) == len(shown.points) < len(surface.points)
    np.testing.assert_allclose(found["u"], shown.points)
    np.testing.assert_allclose(found["x"], shown.points[:, 0])
    places = np.sort(np.linalg.norm(surface.points[surface.wires].mean(axis=1), axis=1))
    again = np.sort(np.linalg.norm(shown.points[shown.wires].mean(axis=1), axis=1))
    np.testing.assert_allclose(places, again)
