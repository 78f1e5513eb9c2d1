"""Two stops on both sides of one point: both contacts have the displacement of this point."""

from __future__ import annotations

import numpy as np
import pytest
from support import STOCKY, beam_scene, make_solid, touching

pytest.importorskip("dolfinx")

from fenicsrom.reduction.modes import independent_coordinates, master_directions


def stop(up: float) -> dict[str, object]:
    """A stop above or below the tip."""
    return touching(
        normal=[0.0, up], gap=1e-3, friction=0.1, normal_stiffness=1e6, tangential_stiffness=1e6
    )


def test_stops_on_both_sides_share_the_coordinates_of_their_point() -> None:
    solid = make_solid(beam_scene(2, STOCKY, contacts=[stop(1.0), stop(-1.0)]))
    one = make_solid(beam_scene(2, STOCKY, contacts=[stop(1.0)]))
    rows, attachment = master_directions(solid, "all")
    alone, same = master_directions(one, "all")
    np.testing.assert_array_equal(rows, alone)
    np.testing.assert_allclose(attachment, same, rtol=0, atol=1e-12 * np.abs(same).max())
    assert solid.contact_rows.shape[0] == 4 and rows.shape[0] == 2
    assert master_directions(solid, "normal")[0].shape[0] == 1


def test_coordinates_that_depend_on_earlier_ones_are_left_out() -> None:
    columns = np.array([[1.0, 0.0], [1e-3, 0.0], [1.0, 0.1], [0.0, 1.0]])
    assert independent_coordinates(columns @ columns.T) == [0, 2]
    assert independent_coordinates(np.zeros((0, 0))) == []
