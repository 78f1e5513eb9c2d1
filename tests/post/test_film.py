"""Animations of a body."""

import os

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from test_body_surface import beam_surface

from fenicsrom.post.base import style
from fenicsrom.post.body.body_figures import FILM_SECONDS, Film, film_frames, write_film
from fenicsrom.post.body.body_view import view_of

LENGTH = 2.0
STATES = (1, 0, 1, 0)


def swing(size, name="quadrilateral"):
    """A beam that swings up, to rest, down and to rest, with a contact point at its tip."""
    surface = beam_surface(name, LENGTH)
    phase = np.array([1.0, 0.0, -1.0, 0.0])
    moved = np.zeros((4, surface.n_points, 3))
    moved[:, :, 1] = size * phase[:, None] * (surface.points[:, 0] / LENGTH) ** 2
    tip = np.zeros((4, 1, 3))
    tip[:, 0, 1] = size * phase
    view = view_of(surface, moved=np.array([0.0, 1.0, 0.0]))
    place, states = np.array([[LENGTH, 0.05, 0.0]]), np.array(STATES)[:, None]
    return Film(surface, np.linspace(0.1, 0.4, 4), moved, view, False, tip, place, states)


def heights(frames):
    """The height in the picture, from above, of the mark at the tip in each frame."""
    found = []
    for frame, state in zip(frames, STATES, strict=True):
        colour = frame[25:-110, frame.shape[1] // 2 :] / 255.0  # no legend, no colour bar
        away = np.abs(colour - to_rgb(style.STATES[state][1])).max(axis=2)
        near = away <= 0.1
        assert near.sum() >= 10
        found.append(np.nonzero(near)[0].mean())
    return found


@pytest.mark.parametrize(("name", "size"), [("quadrilateral", 0.2), ("hexahedron", 1e-4)])
def test_animation_moves_body_and_marks_in_the_colours_of_their_states(name, size):
    """Magnified or not, the mark travels as far as the tip."""
    frames = list(film_frames(swing(size, name)))
    assert len({frame.shape for frame in frames}) == 1
    up, rest, down, again = heights(frames)
    assert rest == pytest.approx(again, abs=0.1) and up + down == pytest.approx(2 * rest, abs=1)
    dark = (frames[1] < 200).any(axis=2)[25:-110]
    length = np.ptp(np.flatnonzero(dark.any(axis=0)))  # of the body, pixels
    travel = 2.0 * size * style.magnification(size, LENGTH) / LENGTH
    assert down - up == pytest.approx(travel * length, rel=0.1 if name == "quadrilateral" else 0.3)


def test_written_animation_has_all_frames(tmp_path):
    from PIL import Image

    path = write_film(tmp_path / "motion.gif", swing(0.2))
    assert os.listdir(tmp_path) == ["motion.gif"]
    with Image.open(path) as film:
        assert film.n_frames == 4 and film.info["loop"] == 0
        assert film.info["duration"] == pytest.approx(1e3 * FILM_SECONDS / 4, abs=10.0)
        frames = []
        for k in range(4):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")))
    heights(frames)
    drawn = np.array(list(film_frames(swing(0.2))), dtype=int)
    assert np.all(frames[0][60:, -5:] > 250)  # the background is white
    assert np.percentile(np.abs(drawn - frames).max(axis=3), 98.0) < 10  # but at smoothed edges
