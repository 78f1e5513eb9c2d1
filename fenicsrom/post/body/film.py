"""Animations of a body as GIF files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.post.base.style import STATES, magnification, new_figure, scale_text, styled
from fenicsrom.post.body.body_figures import OUTLINE, SIZE, shown_part
from fenicsrom.post.body.body_surface import form_edges
from fenicsrom.post.body.body_view import View
from fenicsrom.post.body.rendering import (
    Part,
    colour_bar,
    coloured,
    drawn_lines,
    pixels_of,
    window_of,
)
from fenicsrom.progress import tracked

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pyvista import PolyData

FILM_SECONDS = 2.5
"""Duration of an animation, s."""

WIDTH, TIME_HEIGHT = 640, 24
"""Pixels of an animation's width, and of the height of the time above the body."""

FILM_DPI = 80
"""Pixels per inch of its letters."""

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Dots:
    """Contact points in an animation.

    Attributes:
        places: (P, 3) their places in the state of rest, m.
        moved: (k, P, 3) their displacements from there, m.
        states: (k, P) their contact states.
    """

    places: Array
    moved: Array
    states: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Film:
    """A motion to be animated.

    Attributes:
        surface: the body in its state of rest.
        times: (k,) instants, s.
        moved: (k, n, 3) displacements of the points of the surface from the state of rest, m.
        view: the projection.
        loaded: whether the state of rest is an equilibrium under loads.
        dots: the contact points, if there are any.
    """

    surface: PolyData
    times: Array
    moved: Array
    view: View
    loaded: bool = False
    dots: Dots | None = None


def write_film(path: Path, film: Film) -> Path:
    """Draw a motion as an animated GIF.

    The body is coloured by its displacement, its contact points by their state. Displacements are
    drawn to scale if the largest is at least `style.TRUE_SCALE` of the length of the body;
    otherwise they are magnified by a round number that the picture shows.

    Raises:
        OSError: the file cannot be written.
    """
    from PIL import Image

    images = [Image.fromarray(frame) for frame in film_frames(film)]
    palette = images[len(images) // 4].quantize(256)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    with atomic_write(path) as temporary:
        frames[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=round(1e3 * FILM_SECONDS / len(frames)),
            loop=0,
        )
    return path


def film_frames(film: Film) -> Iterator[Pixels]:
    """Draw the frames (height, width, 3) of a motion: the body above its colour bar and legend."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from pyvista import PolyData

    sizes = np.linalg.norm(film.moved, axis=2)
    largest = float(sizes.max())
    factor = magnification(largest, film.view.length)
    body, edges = film.surface.copy(), form_edges(film.surface)
    body.point_data[SIZE] = sizes[0]
    parts = [drawn_lines(edges, OUTLINE), coloured(body, SIZE, largest or 1.0)]
    dots, cloud = film.dots, PolyData()
    if dots is not None:
        cloud = PolyData(dots.places)
        cloud.point_data["colour"] = np.zeros((cloud.n_points, 3), dtype=np.uint8)
        look = {"scalars": "colour", "rgb": True, "point_size": 9.0, "copy_mesh": False}
        parts.append(Part(cloud, look | {"render_points_as_spheres": True}))
    places = film.surface.points + factor * film.moved
    low, high = shown_part(film.view, [film.surface.points, *places])
    high[1] += TIME_HEIGHT / WIDTH * (high[0] - low[0])
    height = round(WIDTH * min(1.0, (high[1] - low[1]) / (high[0] - low[0])))
    window = window_of(parts, film.view, low, high, (WIDTH, height))
    canvas: Any = FigureCanvasAgg(_legend(film, factor))
    canvas.draw()
    legend = np.asarray(canvas.buffer_rgba())[..., :3]
    for k, time in enumerate(tracked(film.times)):
        body.points, body.point_data[SIZE][:] = places[k], sizes[k]
        if dots is not None:
            cloud.points = dots.places + factor * dots.moved[k]
            cloud.point_data["colour"][:] = [state_rgb(int(n)) for n in dots.states[k]]
        text = {"position": "upper_left", "font_size": 9, "color": "black", "name": "time"}
        window.add_text(f"t = {time:#.6g} s", render=False, **text)
        yield np.vstack([pixels_of(window, opaque=True), legend])


@styled
def _legend(film: Film, factor: float) -> Figure:
    """Draw the colour bar and the contact states."""
    from matplotlib.lines import Line2D

    figure = new_figure(WIDTH / FILM_DPI, 1.35)
    figure.set_dpi(FILM_DPI)
    axis = figure.subplots()
    axis.set_axis_off()
    about = "from the equilibrium, " if film.loaded else ""
    largest = 1e3 * float(np.linalg.norm(film.moved, axis=2).max())
    colour_bar(figure, axis, largest or 1.0, f"displacement, mm ({about}{scale_text(factor)})")
    if film.dots is not None:
        look: dict[str, Any] = {"linestyle": "", "marker": "o", "markeredgecolor": "black"}
        marks = [Line2D([], [], color=c, label=name, **look) for name, c in STATES.values()]
        figure.legend(handles=marks, loc="outside upper center", ncols=len(marks))
    return figure


def state_rgb(state: int) -> tuple[int, ...]:
    """The colour of a contact state as three bytes."""
    return tuple(bytes.fromhex(STATES[state][1][1:]))
