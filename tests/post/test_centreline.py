"""Displacements along the centreline of a slender body."""

import numpy as np
import pytest

pytest.importorskip("dolfinx.fem")

from spaces import HEIGHT, LENGTH, space_on

from fenicsrom.post.run.pictures import centreline


@pytest.mark.parametrize("cell", ["triangle", "hexahedron"])
def test_centreline_of_bending_shape_has_no_axial_part(cell):
    """A bending shape with rotating sections and an axial shape: both are recovered, and bending
    has no axial part."""
    space = space_on(cell, along=40)
    d = space.mesh.geometry.dim
    corners = space.mesh.geometry.x
    inside = (corners[:, 0] > 1e-9) & (corners[:, 0] < LENGTH - 1e-9)
    corners[inside, 0] += np.random.default_rng(2).uniform(
        -0.01, 0.01, inside.sum()
    )  # uneven sections
    x = space.tabulate_dof_coordinates()
    k = 2.0 / LENGTH
    bending, axial = np.zeros((len(x), d)), np.zeros((len(x), d))
    bending[:, 1] = 1 - np.cos(k * x[:, 0])
    bending[:, 0] = -(x[:, 1] - HEIGHT / 2) * k * np.sin(k * x[:, 0])
    axial[:, 0] = np.sin(k * x[:, 0])
    positions, shapes = centreline(x[:, :d], np.array([bending, axial]), stations=41)
    assert shapes.shape == (2, 41, d) and positions[[0, -1]] == pytest.approx([0, LENGTH])
    np.testing.assert_allclose(shapes[0, :, 1], 1 - np.cos(k * positions), atol=2e-4)
    np.testing.assert_allclose(shapes[1, :, 0], np.sin(k * positions), atol=2e-4)
    assert np.abs(shapes[0, :, 0]).max() < 5e-3 * HEIGHT and np.abs(shapes[1, :, 1:]).max() < 1e-12


def test_centreline_puts_axial_component_first():
    space = space_on("hexahedron")
    space.mesh.geometry.x[:] = space.mesh.geometry.x[:, [1, 2, 0]]  # now along z
    x = space.tabulate_dof_coordinates()
    u = np.stack([x[:, 2], 2 * x[:, 2], 3 * x[:, 2]], axis=1)
    positions, shapes = centreline(x, u[None], stations=5)
    np.testing.assert_allclose(shapes[0], np.outer(positions, [3, 1, 2]), atol=1e-12)
