"""Names of modes whose motion at the tip is known."""

import numpy as np
import pytest

from fenicsrom.assess.rotation.rotating_modes import mode_names, section_axes

SPAN, CHORD, THICKNESS = 0.7, 0.15, 0.006
STAGGER = np.radians(50.0)
AXIS = np.array([0.0, 1.0, 0.0])


class OneRank:
    """The communicator of one process."""

    def allgather(self, value):
        return [value]


@pytest.fixture(scope="module")
def blade():
    """Nodes of a flat blade along x whose chord is turned from y towards z, and its axes."""
    s, c, t = np.meshgrid(
        np.linspace(0.0, SPAN, 41),
        np.linspace(-0.5, 0.5, 9) * CHORD,
        np.array([-0.5, 0.5]) * THICKNESS,
        indexing="ij",
    )
    chord = np.array([0.0, np.cos(STAGGER), np.sin(STAGGER)])
    normal = np.array([0.0, -np.sin(STAGGER), np.cos(STAGGER)])
    s, c, t = s.ravel(), c.ravel(), t.ravel()
    points = np.outer(s, [1.0, 0.0, 0.0]) + np.outer(c, chord) + np.outer(t, normal)
    return points, s / SPAN, c, chord, normal


def shapes(blade):
    """Flap, edge, torsion, second flap, chordwise bending, axial, first torsion again."""
    points, s, c, chord, normal = blade
    turn = np.cross([1.0, 0.0, 0.0], points)
    along = np.outer(s, [1.0, 0.0, 0.0])
    return np.stack(
        [
            np.outer(s**2, normal) + 0.1 * s[:, None] * turn,
            np.outer(s**2, chord) + 0.3 * np.outer(s**2, normal),
            s[:, None] * turn + 0.01 * np.outer(s, normal),
            np.outer(s**2 * (4.0 - 5.0 * s), normal),
            np.outer((c / CHORD) ** 2 - 1.0 / 15.0, normal) * s[:, None],
            along,
            (s - 2.0 * s**2)[:, None] * turn,
        ],
        axis=2,
    )


@pytest.mark.parametrize("phase", [1.0, 1.0j])
def test_modes_of_staggered_blade_are_named_by_their_motion_at_the_tip(blade, phase):
    point = np.array([-0.3, 0.0, 0.0])
    named = mode_names(blade[0], phase * shapes(blade), AXIS, point, OneRank())
    assert named == ["1F", "1E", "1T", "2F", "1C", "1A", "2T"]


def test_shaft_about_its_own_axis_has_no_names(blade):
    point = np.array([-0.3, 0.0, 0.0])
    along = np.array([1.0, 0.0, 0.0])
    assert mode_names(blade[0], shapes(blade), along, point, OneRank()) == []


def test_bending_in_a_plane_that_rotates_is_edgewise():
    """In 2D the axis is normal to the plane."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, 21), [-0.02, 0.02]))
    shape = np.stack([0.0 * x, x**2], axis=1)[:, :, None]
    axis, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    assert mode_names(np.stack([x, y], axis=1), shape, axis, origin, OneRank()) == ["1E"]


def test_square_section_takes_its_normal_along_the_axis():
    arms = np.array([[0.0, y, z] for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    chord, normal = section_axes(arms, np.array([1.0, 0.0, 0.0]), AXIS)
    np.testing.assert_allclose(np.abs(normal), AXIS, atol=1e-12)
    np.testing.assert_allclose(np.abs(chord), [0.0, 0.0, 1.0], atol=1e-12)
