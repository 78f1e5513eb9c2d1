"""Animations of a body as GIF files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.post.base.style import STATES, Figure, magnification, new_panels, scale_text, styled
from fenicsrom.post.body.body_figures import OUTLINE, SIZE
from fenicsrom.post.body.body_view import PolyData, View, form_edges, frame_of
from fenicsrom.post.body.rendering import (
    FINE,
    Part,
    Pixels,
    colour_bar,
    coloured,
    drawn_lines,
    pixels_of,
    window_of,
)
from fenicsrom.progress import tracked

FILM_SECONDS = 2.5
"""Duration of an animation, s."""

WIDTH, TIME_HEIGHT = 640, 24
"""Pixels of an animation's width, and of the height of the time above the body."""

FILM_DPI = 80
"""Pixels per inch of its letters."""


@dataclass(frozen=True, eq=False)
class Film:
    """A motion to be animated.

    Attributes:
        surface: the body in its state of rest.
        times: (k,) instants, s.
        moved: (k, n, 3) displacements of the points of the surface from the state of rest, m.
        view: the projection.
        loaded: whether the state of rest is an equilibrium under loads.
        dots: (k, P, 3) displacements of the contact points from the state of rest, m.
        places: (P, 3) their places in the state of rest, m.
        states: (k, P) their contact states.
    """

    surface: PolyData
    times: Array
    moved: Array
    view: View
    loaded: bool
    dots: Array
    places: Array
    states: NDArray[Any]


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
    first, *rest = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    duration = round(1e3 * FILM_SECONDS / len(images))
    with atomic_write(path) as temporary:
        first.save(temporary, "GIF", save_all=True, append_images=rest, duration=duration, loop=0)
    return path


def film_frames(film: Film) -> Iterator[Pixels]:
    """Draw the frames (height, width, 3) of a motion: the body above its colour bar and legend."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from pyvista import PolyData

    sizes = np.linalg.norm(film.moved, axis=2)
    largest = float(sizes.max())
    factor = magnification(largest, film.view.length)
    body, edges, cloud = film.surface.copy(), form_edges(film.surface), PolyData(film.places)
    body.point_data[SIZE], cloud.point_data["state"] = sizes[0], film.states[0]
    dots = coloured(cloud, "state", 1.0, [colour for _, colour in STATES.values()])
    look: dict[str, Any] = {"point_size": 9.0, "render_points_as_spheres": True}
    look["clim"] = (min(STATES), max(STATES))
    parts = [drawn_lines(edges, OUTLINE), coloured(body, SIZE, largest or 1.0)]
    parts.append(Part(cloud, dots.look | look))
    places = film.surface.points + factor * film.moved
    low, high = frame_of(film.view, [film.surface.points, *places])
    high[1] += TIME_HEIGHT / WIDTH * (high[0] - low[0])
    height = round(WIDTH * min(1.0, (high[1] - low[1]) / (high[0] - low[0])))
    window = window_of(parts, film.view, low, high, (WIDTH, height))
    canvas: Any = FigureCanvasAgg(_legend(film, 1e3 * largest, scale_text(factor)))
    canvas.draw()
    legend = np.asarray(canvas.buffer_rgba())[..., :3]
    look = {"position": (10.0, FINE * (height - TIME_HEIGHT)), "color": "black", "render": False}
    text: Any = window.add_text("", font_size=9 * FINE, **look)
    for k, time in enumerate(tracked(film.times)):
        body.points, body.point_data[SIZE][:] = places[k], sizes[k]
        if cloud.n_points:
            cloud.points = film.places + factor * film.dots[k]
            cloud.point_data["state"][:] = film.states[k]
        text.input = f"t = {time:#.6g} s"
        yield np.vstack([pixels_of(window), legend])


@styled
def _legend(film: Film, largest: float, scale: str) -> Figure:
    """Draw the colour bar to the largest displacement, mm, and the contact states."""
    from matplotlib.lines import Line2D

    figure, (axis,) = new_panels(WIDTH / FILM_DPI, 1.35)
    figure.set_dpi(FILM_DPI)
    axis.set_axis_off()
    about = "from the equilibrium, " if film.loaded else ""
    colour_bar(figure, axis, largest or 1.0, f"displacement, mm ({about}{scale})")
    if len(film.places):
        look: dict[str, Any] = {"linestyle": "", "marker": "o", "markeredgecolor": "black"}
        marks = [Line2D([], [], color=c, label=name, **look) for name, c in STATES.values()]
        figure.legend(handles=marks, loc="outside upper center", ncols=len(marks))
    return figure
