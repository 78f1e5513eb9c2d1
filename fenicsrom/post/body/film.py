"""Animations of a body as GIF files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.post.base.style import STATES, magnification, scale_text, styled
from fenicsrom.post.body.body_drawing import (
    DARKEST,
    body_panel,
    colour_bar,
    draw_outline,
    draw_smooth_body,
    mark_places,
)
from fenicsrom.post.body.body_figures import shown_part
from fenicsrom.post.body.body_surface import Surface
from fenicsrom.post.body.body_view import View
from fenicsrom.progress import tracked

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILM_SECONDS = 2.5
"""Duration of an animation, s."""

FILM_DPI = 90
"""Pixels per inch of an animation, whose width is 8 inches at most."""

BODY_COLOURS, LIGHTS, GREYS = 215, 5, 36
"""Numbers of colours in the palette: of the body, in so many lights in space; and of the rest."""

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

    surface: Surface
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
    images = list(film_frames(film))
    with atomic_write(path) as temporary:
        _write_gif(temporary, images, film_palette(film.surface.flat))
    return path


def film_frames(film: Film) -> Iterator[Pixels]:
    """Draw the frames (height, width, 3) of a motion.

    The parts at rest are drawn once, and each frame is drawn on a copy of this drawing.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    surface, view = film.surface, film.view
    sizes = np.linalg.norm(film.moved, axis=2)
    largest = float(sizes.max())
    factor = magnification(largest, view.length)
    places = surface.points + factor * film.moved
    low, high = shown_part(view, [surface.points, *places])
    figure = _empty_frame(film, (low, high), largest, factor)
    (axis, *_) = figure.axes
    draw_outline(axis, surface, view)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    still = canvas.copy_from_bbox(figure.bbox)
    figure.set_layout_engine("none")
    colours = matplotlib.colormaps["viridis"](sizes / (largest or 1.0))
    for k in tracked(range(len(film.times))):
        canvas.restore_region(still)
        moving = draw_smooth_body(axis, surface, view, places[k], colours[k])
        if film.dots is not None:
            paint = [STATES[int(state)][1] for state in film.dots.states[k]]
            at = film.dots.places + factor * film.dots.moved[k]
            moving.append(mark_places(axis, view, at, paint))
        corner = {"transform": axis.transAxes, "va": "bottom"}
        moving.append(axis.text(0.0, 1.0, f"t = {film.times[k]:#.6g} s", corner, fontsize=11))
        for artist in moving:
            axis.draw_artist(artist)
            artist.remove()
        yield np.asarray(canvas.buffer_rgba())[..., :3].copy()


@styled
def _empty_frame(film: Film, part: tuple[Array, Array], largest: float, factor: float) -> Figure:
    """Make the figure of a film without the body: triad, colour bar and legend of the states."""
    from matplotlib.lines import Line2D

    figure, axis = body_panel(film.view, *part, 1.4)
    figure.set_dpi(FILM_DPI)
    axis.set_title(" ")  # room for the time
    about = "from the equilibrium, " if film.loaded else ""
    label = f"displacement, mm ({about}{scale_text(factor)})"
    colour_bar(figure, axis, 1e3 * largest or 1.0, label)
    if film.dots is not None:
        look: dict[str, Any] = {"linestyle": "", "marker": "o", "markeredgecolor": "black"}
        marks = [Line2D([], [], color=c, label=name, **look) for name, c in STATES.values()]
        figure.legend(handles=marks, loc="outside upper right", ncols=len(marks))
    return figure


def _write_gif(path: Path, images: Sequence[Pixels], palette: Pixels) -> None:
    """Write pictures as an animated GIF with one palette (at most 256, 3) for all frames."""
    from PIL import Image

    common = Image.new("P", (1, 1))
    common.putpalette(palette.tobytes())
    frames = [
        Image.fromarray(image).quantize(palette=common, dither=Image.Dither.NONE)
        for image in images
    ]
    frames[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=round(1e3 * FILM_SECONDS / len(frames)),
        loop=0,
    )


def film_palette(flat: bool) -> Pixels:
    """The colours of an animation: displacements in each light, greys, and the contact states."""
    import matplotlib

    lights = np.linspace(1.0, DARKEST, 1 if flat else LIGHTS)
    levels = np.linspace(0.0, 1.0, BODY_COLOURS // len(lights))
    body = 255.0 * lights[:, None, None] * matplotlib.colormaps["viridis"](levels)[:, :3]
    greys = np.repeat(np.linspace(0.0, 255.0, GREYS)[:, None], 3, axis=1)
    states = [state_rgb(state) for state in STATES]
    return np.concatenate([body.reshape(-1, 3), greys, states]).round().astype(np.uint8)


def state_rgb(state: int) -> tuple[int, ...]:
    """The colour of a contact state as three bytes."""
    return tuple(bytes.fromhex(STATES[state][1][1:]))
