"""Figures of motions known in closed form."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from motions import jenkins, side_by_side

from fenicsrom.online.motion import measures
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.style import STATES
from fenicsrom.post.run import figures


def texts(figure):
    return " | ".join(
        t.get_text()
        for axis in figure.axes
        for t in [
            axis.xaxis.label,
            axis.yaxis.label,
            axis.title,
            *(axis.get_xticklabels() + axis.get_yticklabels()),
        ]
    )


def illegible(figure):
    """The titles, labels and legends of a figure that are cut off, and the pairs that overlap."""
    from matplotlib.figure import FigureBase
    from matplotlib.legend import Legend

    figure.draw_without_rendering()
    whole = figure.bbox.padded(1.0)
    found = [
        text
        for axis in figure.axes
        for text in (axis.xaxis.label, axis.yaxis.label, axis.title, axis._left_title)
    ]
    found = [text for text in found if text.get_text()]
    found += figure.findobj(Legend) + [
        part._suptitle for part in figure.findobj(FigureBase) if part._suptitle
    ]
    boxes = [item.get_window_extent() for item in found]
    cut = [
        str(item)
        for item, box in zip(found, boxes, strict=True)
        if min(*box.min - whole.min, *whole.max - box.max) < 0.0
    ]
    pairs = itertools.combinations(zip(found, boxes, strict=True), 2)
    return cut + [
        f"{a} on {b}"
        for (a, one), (b, other) in pairs
        if one.padded(-1.0).overlaps(other.padded(-1.0))
    ]


def drawn(figure, tmp_path):
    """Draw a figure and return the picture."""
    from matplotlib.image import imread

    figure.savefig(tmp_path / "figure.png")
    assert not illegible(figure)
    picture = imread(tmp_path / "figure.png")
    assert picture.shape[1] > 900 and picture[..., :3].std() > 0.02
    return picture


@pytest.mark.slow
def test_motion_figure_shows_last_two_periods_in_mm(tmp_path):
    cases = {"full": jenkins(), "reduced": jenkins(periods=6), "beam": jenkins()}
    figure = figure_of(figures.plot_motion(cases))
    assert len(figure.axes) == 2
    for axis, k in zip(figure.axes, range(2), strict=True):
        assert [line.get_label() for line in axis.lines] == list(cases)
        curves = [line.get_xydata() for line in axis.lines]
        for x, y in (curve.T for curve in curves):
            assert x[0] == pytest.approx(0) and x[-1] == pytest.approx(2)
            assert np.ptp(y) / 2 == pytest.approx([1.0, 8.0][k], rel=1e-3)
        np.testing.assert_allclose(
            curves[0], curves[1], atol=1e-9
        )  # phases agree though the runs differ in length
    assert "time / period" in texts(figure) and "mm" in texts(figure)
    drawn(figure, tmp_path)
    solid = figure_of(figures.plot_motion({"full": jenkins(3), "beam": jenkins(2)}))
    assert len(solid.axes) == 3
    drawn(solid, tmp_path)


@pytest.mark.slow
def test_contact_figure_shows_states_and_loops(tmp_path):
    cases = {"full": jenkins(normal=5e-3), "reduced": jenkins(normal=5e-3)}
    plot = figures.plot_contact(cases)
    states, *loops = (panel.items for panel in plot.panels)
    tangential, normal, orbit = (items[0] for items in loops)
    np.testing.assert_allclose(orbit.x, tangential.x)
    np.testing.assert_allclose(orbit.y, normal.x)
    case = cases["full"]
    part = case.last_period()
    np.testing.assert_allclose(tangential.x, 1e3 * case.displacement[part, 0, 1])
    np.testing.assert_allclose(tangential.y, case.force[part, 0, 1])
    assert normal.y.max() == pytest.approx(80, rel=1e-3)
    bars = states[: len(STATES)]  # of the first model
    sides = np.concatenate([np.transpose([bar.left, bar.right]) for bar in bars])
    sides = sides[np.argsort(sides[:, 0])]
    np.testing.assert_allclose(sides[1:, 0], sides[:-1, 1])
    assert sides[0, 0] == 0.0 and sides[-1, 1] == pytest.approx(1.0)
    share = {bar.label: (bar.right - bar.left).sum() for bar in bars}
    assert share == pytest.approx(measures.contact_fractions(case), abs=1e-9)
    assert {bar.label: bar.color for bar in bars} == dict(STATES.values())
    figure = figure_of(plot)
    assert "N" in texts(figure) and "mm" in texts(figure)
    drawn(figure, tmp_path)


@pytest.mark.slow
def test_points_figure_shows_loops_of_largest_normal_force(tmp_path):
    cases = [jenkins(3, normal=normal) for normal in (0.0, 1e-3, 5e-3, 2e-3, 1e-3, 0.0)]
    motions = {
        "reduced": side_by_side(*cases),
        "full": side_by_side(*cases),
        "beam": jenkins(3),
    }
    figure = figure_of(figures.plot_points(motions))
    peak, share, friction_dissipation, *loops = figure.axes
    np.testing.assert_allclose(
        peak.lines[0].get_xydata(), np.transpose([range(1, 7), [30, 40, 80, 50, 40, 30]]), rtol=1e-3
    )
    np.testing.assert_allclose(
        share.lines[1].get_ydata()[[0, 2]], [100.0, 100 - 100 * np.arccos(0.6) / np.pi], rtol=5e-3
    )
    assert friction_dissipation.lines[0].get_ydata().sum() == pytest.approx(
        measures.friction_dissipation_per_period(motions["reduced"])
    )
    assert [len(axis.lines) for axis in (peak, share, friction_dissipation)] == [3, 3, 3]
    hardest = cases[2]
    np.testing.assert_allclose(
        loops[0].lines[0].get_ydata(), hardest.force[hardest.last_period(), 0, 1]
    )
    assert len(loops) == 4 and loops[-1].get_title(loc="left") == "orbit"
    assert [len(axis.lines) for axis in loops] == [2] * len(loops)  # the beam has no third point
    drawn(figure, tmp_path)


def test_energy_figure_shows_four_energies_and_imbalance(tmp_path):
    figure = figure_of(figures.plot_energy(jenkins()))
    above, below = figure.axes
    assert len(above.lines) == 4
    work, damping, friction, energy = above.lines  # curves that coincide are all seen
    assert all(work.get_linewidth() > 2.0 * line.get_linewidth() for line in (friction, energy))
    assert damping.is_dashed() and damping.get_zorder() > energy.get_zorder()
    assert below.lines[0].get_ydata()[-1] == pytest.approx(-1e-3)
    drawn(figure, tmp_path)
    touching = jenkins()
    none = {name: getattr(touching, name)[:, :0] for name in ("state", "force", "gap")}
    free = figure_of(figures.plot_energy(replace(touching, **none)))
    labels = [text.get_text() for text in free.legends[0].get_texts()]
    assert len(labels) == 3 and not any("friction" in name or "contact" in name for name in labels)
