"""Contact numbers, the axis of rotation and round surfaces in the picture of a set-up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_body_drawing import plate  # noqa: F401
from test_figures import drawn, illegible

from fenicsrom.post.body.body_view import view_of
from fenicsrom.post.setup.setup_figure import setup_figure
from fenicsrom.post.setup.setup_marks import ContactMark, Marks, RotationMark
from fenicsrom.post.setup.setup_surroundings import (
    MOST_NUMBERS,
    axis_ends,
    numbered_points,
    surroundings,
    turning_arrow,
)
from fenicsrom.post.setup.setup_symbols import MARK_COLOURS

TURNING = RotationMark(100.0, np.array([-2.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8]))


def contacts(*counts: int) -> list[ContactMark]:
    """Contacts of some points on a line."""
    found, first = [], 1
    for count in counts:
        places = np.outer(np.arange(first, first + count), [0.1, 0.0, 0.0])
        found.append(ContactMark("contact", places, np.tile([0.0, 0.0, 1.0], (count, 1)), first))
        first += count
    return found


@pytest.mark.parametrize(
    ("counts", "numbers"),
    [
        ((), []),
        ((1,), []),
        ((1, 1), [1, 2]),
        ((MOST_NUMBERS,), list(range(1, MOST_NUMBERS + 1))),
        ((MOST_NUMBERS + 1,), [1, MOST_NUMBERS + 1]),
        ((9, 1, 4), [1, 9, 10, 11, 14]),
    ],
)
def test_many_contact_points_have_numbers_at_their_ends(
    counts: tuple[int, ...], numbers: list[int]
) -> None:
    found = numbered_points(contacts(*counts))
    assert list(found) == numbers
    for number, place in found.items():
        np.testing.assert_allclose(place, [0.1 * number, 0.0, 0.0])


def test_number_on_another_one_is_left_out(plate: Any) -> None:  # noqa: F811
    surface, _ = plate
    view = view_of(surface.points, surface.triangles)
    places = np.array([0.0, 1e-4, 0.2])[:, None] * view.right
    mark = ContactMark("contact", places, np.tile(view.up, (3, 1)))
    (axis,) = setup_figure(surface, Marks(contacts=[mark]), "a plate").axes
    blue = MARK_COLOURS["contact"]
    assert [text.get_text() for text in axis.texts if text.get_color() == blue] == ["1", "3"]


def test_arrow_around_the_axis_turns_by_the_right_hand_rule() -> None:
    arc = turning_arrow(TURNING, TURNING.point, 0.3) - TURNING.point
    np.testing.assert_allclose(np.linalg.norm(arc, axis=1), 0.3)
    np.testing.assert_allclose(arc @ TURNING.axis, 0.0, atol=1e-12)
    assert np.all(np.cross(arc[:-1], arc[1:]) @ TURNING.axis > 0.0)


def test_axis_passes_the_body_and_the_round_surfaces() -> None:
    ring = ContactMark("contact", np.zeros((1, 3)), np.eye(3)[:1], 1, [5.0 * np.eye(3)])
    places = np.random.default_rng(0).standard_normal((20, 3))
    *lines, ends = surroundings(Marks(contacts=[ring], rotation=TURNING), places)
    (line,) = lines
    along = np.concatenate([places, line]) @ TURNING.axis
    assert ends[0] @ TURNING.axis < along.min() and ends[1] @ TURNING.axis > along.max()
    np.testing.assert_allclose(np.cross(ends - TURNING.point, TURNING.axis), 0.0, atol=1e-12)
    np.testing.assert_allclose(axis_ends(TURNING, np.concatenate([places, line])), ends)
    assert not surroundings(Marks(), places)


@pytest.mark.parametrize(("distance", "panels"), [(0.5, 0), (-2.0, 1)])
def test_second_panel_shows_what_lies_beyond_the_picture(
    distance: float,
    panels: int,
    plate: Any,  # noqa: F811
    tmp_path: Path,
) -> None:
    """An axis that is seen as a point, in the body or far from it."""
    surface, _ = plate
    view = view_of(surface.points, surface.triangles)
    middle = surface.points.mean(axis=0)
    turning = RotationMark(100.0, middle + (distance - 0.5) * view.right, view.towards)
    marks = Marks(contacts=contacts(2), rotation=turning)
    figure = setup_figure(surface, marks, "a plate")
    (axis,) = figure.axes
    assert len(axis.child_axes) == panels and not illegible(figure)
    blue = MARK_COLOURS["contact"]
    assert [text.get_text() for text in axis.texts if text.get_color() == blue] == ["1", "2"]
    for panel in axis.child_axes:
        around = np.concatenate([line.get_xydata() for line in panel.lines])
        low, high = np.transpose([panel.get_xlim(), panel.get_ylim()])
        assert np.all(around > low) and np.all(around < high)
    (legend,) = figure.legends
    assert "axis of rotation, 100 rpm" in [text.get_text() for text in legend.get_texts()]
    drawn(figure, tmp_path)
