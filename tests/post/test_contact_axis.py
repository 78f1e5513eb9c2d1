"""The axis of contact points in maps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motions import jenkins, side_by_side

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom.fem.mesh.mesh import build_mesh
from fenicsrom.fem.solid.solid import UNDEFORMED, solid_of
from fenicsrom.post.run.figures import contact_axis, plot_points
from fenicsrom.post.run.motion_figures import plot_rub_map
from fenicsrom.scene import read_scene

DEMOS = Path(__file__).parents[2] / "demos"
COARSE = ["geometry.parameters.elements_along=4", "geometry.parameters.elements_across=4"]


def test_analytic_line_load_does_not_alternate_along_the_edge_of_a_blade() -> None:
    """The nodal forces of quadratic elements alternate: 1 to 4 to 2 for a constant load."""
    scene = read_scene(DEMOS / "blade_rub.toml", COARSE)
    solid = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED)
    count = len(solid.points.contact)
    line = contact_axis(solid.points, count)
    assert count == 9 and line.unit == "N/m" and "position" in line.label
    x = 1e-3 * line.at
    load = 1e3 * (1.0 + (x / x[-1]) ** 2)  # N/m
    force = load * line.share
    assert force.sum() == pytest.approx(1e3 * x[-1] * 4.0 / 3.0, rel=1e-2)
    assert np.all(np.diff(force)[::2] > 0.0) and np.all(np.diff(force)[1::2] < 0.0)

    motion = side_by_side(*[jenkins(3)] * count)
    pressed = motion.force.copy()
    pressed[:, :, 0] = force
    motion = replace(motion, force=pressed)
    shown = plot_rub_map(motion, solid.points).panels[0].items[0].values
    np.testing.assert_allclose(shown, np.tile(load[:, None], shown.shape[1]))
    *numbers, curve = plot_points({"reduced": motion}, (), solid.points).panels[0].items
    np.testing.assert_allclose([curve.x, curve.y], [line.at, load])
    assert [number.text for number in numbers] == [str(k + 1) for k in range(count)]


@pytest.mark.slow
def test_points_on_a_face_have_numbers_and_force_per_area() -> None:
    scene = read_scene(DEMOS / "blade_rub.toml", [*COARSE, 'contacts.0.group="tip"'])
    solid = solid_of(scene, build_mesh(scene.geometry, MPI.COMM_SELF), UNDEFORMED)
    count = len(solid.points.contact)
    face = contact_axis(solid.points, count)
    assert face.unit == "N/m²" and face.label == "contact point"
    np.testing.assert_array_equal(face.at, np.arange(1, count + 1))
    np.testing.assert_array_equal(face.share, solid.points.tributary_area)
    bare = contact_axis(None, 4)
    assert bare.unit == "N" and np.all(bare.share == 1.0)
