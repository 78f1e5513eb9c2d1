"""Pictures and animations of the solid body."""

import os
import shutil

import numpy as np
import pytest

pytest.importorskip("dolfinx.fem")
pytest.importorskip("pyvista")

from spaces import HEIGHT, LENGTH, space_on

from fenicsrom.post import drawing, rendering, style

needs_xvfb = pytest.mark.skipif(shutil.which("xvfb-run") is None, reason="needs Xvfb")


@pytest.mark.parametrize(
    ("largest", "factor"),
    [
        (0.0, 1),
        (0.5, 1),
        (0.06, 1),
        (0.05, 2),
        (0.04, 5),
        (0.02, 10),
        (1.01e-3, 100),
        (4e-5, 5000),
        (2e-8, 1e7),
    ],
)
def test_magnification_is_round_number(largest, factor):
    """A body of 2 m: displacements from 0.06 m on are drawn to scale, smaller ones with at most 0.2
    m."""
    assert style.magnification(largest, 2.0) == pytest.approx(factor)
    assert largest >= 0.06 or factor * largest <= 0.2 * (1 + 1e-9)


def swing(space, size, frames=4):
    """Times, a displacement that swings up, to rest, down and to rest, and a contact point that
    moves with the tip."""
    x = space.tabulate_dof_coordinates()
    up = np.zeros((len(x), space.mesh.geometry.dim))
    up[:, 1] = size * (x[:, 0] / LENGTH) ** 2
    phase = np.sin(np.pi / 2 * (1 + np.arange(frames)))
    tip = np.zeros((frames, 1, 3))
    tip[:, 0, 1] = size * phase
    state = np.array([[1], [0], [1], [0]], dtype=np.int8)[:frames]
    marks = (
        np.array([[LENGTH, HEIGHT / 2, 0.0]]),
        {"displacement": tip, "state": state, "gap": tip[..., 0]},
    )
    return np.linspace(0.1, 0.4, frames), lambda k: phase[k] * up.ravel(), marks


@pytest.mark.slow
@needs_xvfb
@pytest.mark.parametrize(
    ("cell", "size"),
    [("quadrilateral", 0.2), pytest.param("tetrahedron", 1e-4, marks=pytest.mark.slow)],
)
def test_animation_without_display_shows_motion_and_states(tmp_path, monkeypatch, cell, size):
    """The tip is drawn at its displaced position in the colour of its state; body and marker move
    together, magnified or not."""
    from PIL import Image

    from fenicsrom.post.style import STATES

    monkeypatch.delenv("DISPLAY", raising=False)
    space = space_on(cell)
    gif = rendering.animate(tmp_path / "motion.gif", space, *swing(space, size))
    assert gif == tmp_path / "motion.gif" and os.listdir(tmp_path) == ["motion.gif"]
    with Image.open(gif) as film:
        assert film.n_frames == 4 and film.info["loop"] == 0
        assert film.info["duration"] == pytest.approx(1e3 * drawing.FILM_SECONDS / 4)
        frames = []
        for k in range(4):
            film.seek(k)
            frames.append(np.asarray(film.convert("RGB")).astype(int))
    tips = []
    for frame, state in zip(frames, (1, 0, 1, 0), strict=True):
        colour = np.array(drawing._rgb(STATES[state][1]))
        near = (np.abs(frame - colour).max(axis=2) <= 5)[
            40:-70, 600:
        ]  # without legend and colour bar
        assert near.sum() >= 10
        tips.append(np.nonzero(near)[0].mean())
    up, rest, down, again = tips
    assert rest == pytest.approx(again, abs=0.6) and up + down == pytest.approx(2 * rest, abs=4)
    travel = (
        2 * size * style.magnification(size, LENGTH) / LENGTH
    )  # of the length, which is about 650 pixels long
    assert down - up == pytest.approx(650 * travel, rel=0.15)


def test_animation_without_renderer_warns_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(rendering.shutil, "which", lambda name: None)
    monkeypatch.setattr(rendering.sys, "executable", shutil.which("false") or "/bin/false")
    space = space_on("triangle")
    with pytest.warns(UserWarning, match=r"motion\.gif was not drawn: no display and no Xvfb.*\.$"):
        assert rendering.animate(tmp_path / "motion.gif", space, *swing(space, 0.2)) is None
    assert not os.listdir(tmp_path)


def test_film_frames_show_pictures_with_their_times():
    images = [np.full((100, 300, 3), shade, dtype=np.uint8) for shade in (0, 200, 200)]
    frames = drawing.film_frames(images, [0.1, 0.2, 0.3], "displacements to scale", 0.02, True)
    assert len({frame.shape for frame in frames}) == 1 and frames[0].dtype == np.uint8
    assert frames[0].shape[1] == 720
    shades = zip(frames, (0, 200, 200), strict=True)
    dark, light, later = (np.count_nonzero((frame == shade).all(axis=2)) for frame, shade in shades)
    assert dark > 0.3 * 720 * 240 and light == later > 0.3 * 720 * 240
    changed = np.flatnonzero((frames[1] != frames[2]).any(axis=(1, 2)))
    assert changed.size and np.ptp(changed) < 30  # the line of the time, and nothing else


@pytest.mark.slow
@needs_xvfb
@pytest.mark.parametrize("cell", ["quadrilateral", "hexahedron"])
def test_picture_of_stress_marks_largest_value_on_the_side_that_is_seen(
    tmp_path, monkeypatch, cell
):
    """The body is bent down: blue at the free end, red at the clamped end, and a white mark."""
    from matplotlib.image import imread

    from fenicsrom.online.stress import StressLaw, StressTable
    from fenicsrom.online.stress_peaks import equilibrium_peak

    monkeypatch.delenv("DISPLAY", raising=False)
    space = space_on(cell, 1)
    d = space.mesh.geometry.dim
    points, cells = space.tabulate_dof_coordinates()[:, :d], np.asarray(space.dofmap.list)
    centres = points[cells].mean(axis=1)
    gradients = np.zeros((1, len(cells), d, d))
    gradients[0, :, 0, 0] = 1e-3 * (LENGTH - centres[:, 0])
    moved = np.zeros((1, len(points), d))
    moved[0, :, 1] = -0.1 * points[:, 0] ** 2
    table = StressTable(
        StressLaw(1e11, 8e10, None, True, False),
        centres,
        np.ones(len(cells)),
        gradients,
        cells.astype(np.int64),
        points,
        moved,
        np.ones((cells.shape[1], 1)),
    )
    measure = "second-piola-kirchhoff"
    peak = equilibrium_peak(table, measure)
    png = rendering.picture_stress(tmp_path / "stress.png", table, peak, measure)
    assert png == tmp_path / "stress.png" and os.listdir(tmp_path) == ["stress.png"]
    picture = imread(png)[..., :3]
    body = picture[: int(0.75 * len(picture))]
    red = (body[..., 0] > 0.35) & (body[..., 0] > 2.0 * body[..., 1]) & (body[..., 2] < 0.2)
    blue = (body[..., 2] > 0.25) & (body[..., 2] > 1.5 * body[..., 1]) & (body[..., 0] < 0.35)
    assert red.sum() > 200 and blue.sum() > 200
    apart = np.nonzero(blue)[1].mean() - np.nonzero(red)[1].mean()
    assert abs(apart) > 0.3 * picture.shape[1] and (d == 3 or apart > 0.0)


@pytest.mark.slow
@needs_xvfb
def test_animation_about_equilibrium_leaves_out_its_displacement(tmp_path):
    """The same small swing about a large deflection: magnified as if the body were undeformed."""
    from PIL import Image

    space = space_on("quadrilateral")
    times, frames, marks = swing(space, 1e-3)
    rest = 0.0 * frames(0)
    rest[1::2] = 0.3 * HEIGHT
    shifted = (marks[0] + [0.0, 0.3 * HEIGHT, 0.0], marks[1])
    films = []
    for name, moved, about, dots in (
        ("plain", frames, None, marks),
        ("about", lambda k: rest + frames(k), rest, shifted),
    ):
        gif = rendering.animate(tmp_path / f"{name}.gif", space, times, moved, dots, about)
        with Image.open(gif) as film:
            film.seek(0)
            films.append(np.asarray(film.convert("RGB")).astype(int))
    plain, about = (film[40:-90] for film in films)  # without the texts
    assert plain.shape == about.shape
    assert np.mean(np.abs(plain - about).max(axis=2) > 60) < 0.01
