"""Pictures of transients, sections, maps, energies and coordinates of motions in closed form."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from motions import PERIOD, jenkins, motion, side_by_side
from support import beam_scene, contact_points
from test_figures import drawn, texts

from fenicsrom.post.run import motion_figures
from fenicsrom.post.run.motion_figures import open_sentence, touching_points
from fenicsrom.post.run.pictures import motion_pictures, working
from fenicsrom.scene import read_scene

DEMOS = Path(__file__).parents[2] / "demos"


def decay():
    """A free motion with 12 Hz and 30 Hz."""
    time = np.linspace(0.0, 4.0, 3001)
    x = np.zeros((time.size, 1, 2))
    x[:, 0, 1] = 1e-3 * np.exp(-time) * np.cos(2 * np.pi * 12.0 * time)
    x[:, 0, 1] += 2e-4 * np.exp(-time) * np.cos(2 * np.pi * 30.0 * time)
    return motion(time, x, period=None)


@pytest.mark.slow
def test_transient_shows_envelope_spectrum_and_natural_frequencies(tmp_path):
    figure = motion_figures.plot_transient(decay(), np.array([12.0, 30.0, 500.0]))
    above, below, side = figure.axes[:3]
    assert [line.get_label() for line in above.lines][:2] == ["y displacement", "envelope"]
    curve = side.lines[0].get_xydata()
    assert curve[np.argmax(curve[:, 0]), 1] == pytest.approx(12.0, abs=0.3)
    marks = [line.get_ydata()[0] for line in side.lines[1:]]
    assert marks == [12.0, 30.0] and below.get_ylim() == side.get_ylim()
    assert "frequency, Hz" in texts(figure)
    drawn(figure, tmp_path)


def test_section_has_panel_per_direction(tmp_path):
    case = jenkins(periods=30, steps=60)
    figure = motion_figures.plot_section(case)
    assert len(figure.axes) == 3
    assert figure.axes[0].collections[0].get_offsets().shape == (16, 2)
    drawn(figure, tmp_path)


def test_rub_map_shows_force_and_state_of_each_point(tmp_path):
    cases = [jenkins(normal=normal) for normal in (0.0, 1e-3, 5e-3, 2e-3, 1e-3, 0.0)]
    case = side_by_side(*cases)
    figure = motion_figures.plot_rub_map(case)
    force, state = (axis.collections[0].get_array() for axis in figure.axes[:2])
    assert force.shape == state.shape == (6, motion_figures.COLUMNS)
    assert np.ma.getmaskarray(force)[2].any() and not np.ma.getmaskarray(force)[0].any()
    np.testing.assert_allclose(force.max(axis=1), [30, 40, 80, 50, 40, 30], rtol=5e-3)
    assert set(np.unique(state[2])) == {-1, 0, 1} and -1 not in state[0]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["open", "slip", "stick"]
    drawn(figure, tmp_path)


def test_energy_per_period_names_what_dissipates(tmp_path):
    figure = motion_figures.plot_energy_per_period(jenkins(periods=6))
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [name.split(" (")[0] for name in names] == [
        "damping",
        "friction",
        "work of the loads",
    ]
    parts = [float(name.split(": ")[1].split()[0]) for name in names[:2]]
    assert sum(parts) == pytest.approx(100.0, abs=0.5)
    assert figure.axes[0].get_xlim() == (0.5, 6.5)
    for name, words in (("blade_rub", "moving surfaces"), ("slip_liftoff_3d", "loads")):
        assert working(read_scene(DEMOS / f"{name}.toml")).endswith(words)
    drawn(figure, tmp_path)


@pytest.mark.slow
def test_modal_coordinates_have_panel_each(tmp_path):
    case = jenkins()
    late = case.last_period()
    time = case.time[late]
    modal = (
        1e-3 * np.sin(np.outer(2 * np.pi * time / PERIOD, np.arange(1, 9))) / np.arange(8, 0, -1)
    )
    case = replace(case, coordinates=modal, coordinate_time=time)
    labels = [f"{k + 1}V" for k in range(8)]
    figure = motion_figures.plot_coordinates(case, labels, modal)
    assert [axis.get_ylabel().split("\n")[0] for axis in figure.axes] == labels[2:]
    assert np.abs(figure.axes[-1].lines[0].get_ydata()).max() == pytest.approx(1.0, rel=1e-3)
    drawn(figure, tmp_path)
    modal[:, 2] *= 1e-10
    flat = motion_figures.plot_coordinates(case, labels[:3], modal[:, :3]).axes
    assert [len(axis.lines) for axis in flat] == [1, 1, 0] and "below" in flat[2].texts[
        0
    ].get_text()


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
