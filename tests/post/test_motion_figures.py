"""Pictures of transients, sections, maps, energies and coordinates of motions in closed form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from motions import jenkins, motion, side_by_side
from support import beam_scene, contact_points
from test_figures import drawn, texts

from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.run import motion_figures
from fenicsrom.post.run.motion_figures import open_sentence, touching_points
from fenicsrom.post.run.pictures import motion_pictures


def decay():
    """A free motion with 12 Hz and 30 Hz."""
    time = np.linspace(0.0, 4.0, 3001)
    x = np.zeros((time.size, 1, 2))
    x[:, 0, 1] = 1e-3 * np.exp(-time) * np.cos(2 * np.pi * 12.0 * time)
    x[:, 0, 1] += 2e-4 * np.exp(-time) * np.cos(2 * np.pi * 30.0 * time)
    return motion(time, x, period=None)


@pytest.mark.slow
def test_transient_shows_envelope_spectrum_and_natural_frequencies(tmp_path):
    figure = figure_of(motion_figures.plot_transient(decay(), np.array([12.0, 30.0, 500.0])))
    above, below, side = figure.axes[:3]
    assert [line.get_label() for line in above.lines][:2] == ["y displacement", "envelope"]
    curve = side.lines[0].get_xydata()
    assert curve[np.argmax(curve[:, 0]), 1] == pytest.approx(12.0, abs=0.3)
    marks = [line.get_ydata()[0] for line in side.lines[1:]]
    assert marks == [12.0, 30.0] and below.get_ylim() == side.get_ylim()
    assert "frequency, Hz" in texts(figure)
    drawn(figure, tmp_path)


def test_rub_map_shows_force_and_state_of_each_point(tmp_path):
    cases = [jenkins(normal=normal) for normal in (0.0, 1e-3, 5e-3, 2e-3, 1e-3, 0.0)]
    case = side_by_side(*cases)
    figure = figure_of(motion_figures.plot_rub_map(case))
    force, state = (axis.collections[0].get_array() for axis in figure.axes[:2])
    assert force.shape == state.shape == (6, motion_figures.COLUMNS)
    assert np.ma.getmaskarray(force)[2].any() and not np.ma.getmaskarray(force)[0].any()
    np.testing.assert_allclose(force.max(axis=1), [30, 40, 80, 50, 40, 30], rtol=5e-3)
    assert set(np.unique(state[2])) == {-1, 0, 1} and -1 not in state[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["open", "slip", "stick"]
    drawn(figure, tmp_path)


def test_each_picture_is_drawn_only_where_it_answers_a_question():
    def names(case):
        scene, points = beam_scene(2), contact_points([1.0, 0.0])
        run = {"motions": {"reduced": case}, "frequencies_hz": np.zeros(0)}
        found = SimpleNamespace(**run, scene=scene, points=points)
        return [picture.name for picture in motion_pictures(found)]

    assert names(jenkins(periods=3)) == ["motion.png", "contact.png", "energy.png"]
    assert names(jenkins(periods=4)) == [*names(jenkins(periods=3)), "energy_per_period.png"]
    assert "spectra.png" in names(decay())
    many = side_by_side(*[jenkins(periods=3)] * 6)
    assert names(many) == ["motion.png", "contact.png", "rub_map.png", "energy.png"]
    never = replace(jenkins(periods=3), force=0.0 * jenkins(periods=3).force)
    assert names(never) == ["motion.png", "energy.png"] and "do" in str(
        open_sentence({"reduced": never})
    )
    pair = side_by_side(jenkins(periods=3), jenkins(periods=3))
    pair.force[:, 1] = 0.0
    assert names(pair) == ["motion.png", "contact_1.png", "energy.png"]
    assert "point 2 does" in str(open_sentence({"reduced": pair}))
    assert open_sentence({"reduced": many}) is None
    slick = jenkins(periods=3)
    slick.force[:, :, 1:] = 0.0  # pressed, without friction
    assert touching_points({"reduced": slick}) == [0]
    wild = jenkins(periods=30, steps=40, uneven=False)
    growing = wild.displacement * (1.0 + wild.time[:, None, None])
    wild = replace(wild, displacement=growing, steady=False)
    assert "section.png" in names(wild) and "section.png" not in names(
        jenkins(periods=30, steps=40)
    )
