"""The common style of the figures."""

import pytest

from fenicsrom.post.base import style
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.plot import Line, Panel, Plot


@pytest.mark.parametrize(
    ("largest", "factor"),
    [(0.0, 1), (0.06, 1), (0.05, 2), (1.01e-3, 100), (4e-5, 5000), (2e-8, 1e7)],
)
def test_magnification_is_round_number(largest, factor):
    """A body of 2 m: displacements from 0.06 m on are drawn to scale, smaller ones with at most 0.2
    m."""
    assert style.magnification(largest, 2.0) == pytest.approx(factor)
    assert largest >= 0.06 or factor * largest <= 0.2 * (1 + 1e-9)


@pytest.mark.parametrize("largest", [2e-4, 9e5])
def test_axis_with_usual_values_has_no_multiplier(largest):
    line = Line([-largest, largest], [0.0, largest])
    figure = figure_of(Plot([Panel([line])], 3.9, 3.9))
    figure.draw_without_rendering()
    (axis,) = figure.axes
    assert axis.xaxis.get_offset_text().get_text() == ""
    assert axis.yaxis.get_offset_text().get_text() == ""
