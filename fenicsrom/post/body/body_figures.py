"""Figures and films of deformed bodies: shapes, static deflection and stresses."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.post.base.drawing import figure_of
from fenicsrom.post.base.plot import Image, Item, Line, Panel, Plot, Text
from fenicsrom.post.base.style import STATES, magnification, scale_text
from fenicsrom.post.body.body_view import (
    Frame,
    PolyData,
    View,
    areas,
    face_on,
    form_edges,
    frame_of,
    largest_of,
    view_at,
    view_of,
)
from fenicsrom.post.body.rendering import (
    FINE,
    Part,
    Pixels,
    bar_to,
    body_panel,
    coloured,
    drawn_lines,
    image_of,
    pixels_of,
    width_of,
    window_of,
)
from fenicsrom.progress import tracked

SHAPE = 0.15
"""Largest displacement of a mode shape in a picture, relative to the size of the body."""

MOST_SHAPES = 12
"""Largest number of shapes in one picture."""

NO_SCALE = "shapes have no scale: each is drawn with the same largest displacement"
"""What the picture of shapes says of their size."""

NODAL = "white: nodal lines"
"""What it says of the lines on which the displacement towards the viewer is zero."""

OUTLINE = "#A6ABB0"
"""Colour of the edges of the undeformed body."""

SIZE = "size"
"""The point array that gives a surface its colours."""

STEEP = 0.1
"""Least slope of a shape at its nodal lines, relative to its largest displacement and the body."""

TOWARDS = 0.7
"""Part of the squares of a shape along the line of sight from which its nodal lines are drawn."""

TITLE = 0.25
"""Height of a title above a body, inches."""


def shape_figure(
    surface: PolyData,
    titles: Mapping[str, str],
    modes: Collection[str] = (),
    view: View | None = None,
) -> Plot:
    """Draw shapes as deformed bodies, coloured by their displacement, one beside another.

    The largest displacement is drawn as `SHAPE` of the size of the body. The edges of the
    undeformed body are grey. At most `MOST_SHAPES` shapes are drawn. A plate is seen face-on.

    Args:
        surface: the surface, with the displacements (n, 3) as point arrays.
        titles: name of the displacement -> its title.
        modes: names of those that get nodal lines, if they move towards the viewer.
        view: the projection of other bodies; by default the first shape is seen from its side.
    """
    labels = list(titles)[:MOST_SHAPES]
    fields = {label: np.asarray(surface.point_data[label]) for label in labels}
    view = face_on(surface) or view or view_of(surface, moved=largest_of(fields[labels[0]]))
    factors = {
        label: SHAPE * view.length / (float(np.linalg.norm(largest_of(field))) or 1.0)
        for label, field in fields.items()
    }
    nodal = {
        label: line
        for label in labels
        if label in modes and (line := _nodal_lines(surface, fields[label], view)).n_points
    }
    few = f" ({len(labels)} of {len(titles)} shapes)" if len(titles) > len(labels) else ""
    about = f"displacement / largest of the shape{few}{f'; {NODAL}' * bool(nodal)}\n{NO_SCALE}"
    return _deformed(surface, factors, titles, view, bar_to(1.0, about), nodal)


def _deformed(
    surface: PolyData,
    factors: Mapping[str, float],
    titles: Mapping[str, str],
    view: View,
    bar: Mapping[str, Any],
    nodal: Mapping[str, PolyData] | None = None,
    marks: Sequence[Item] = (),
) -> Plot:
    """Draw deformed bodies in rows, each coloured from 0 to its largest value.

    Args:
        surface: the surface; its colours are those of the point array `SIZE`, or else of the size
            of the displacement.
        factors: the point array of each displacement (n, 3) -> its factor.
        titles: the same -> its title.
        view: the projection.
        bar: the colour bar, as in `Image`.
        nodal: lines on the undeformed surface that move with it.
        marks: what is drawn above the bodies.
    """
    from pyvista import merge

    edges, nodal = form_edges(surface), nodal or {}
    bodies = {label: surface.warp_by_vector(label, factor=k) for label, k in factors.items()}
    points = [surface.points, *(body.points for body in bodies.values())]
    _, low, high = frame_of(view, points)
    step = high - low
    columns = min(len(bodies), 2 if step[1] < 0.25 * step[0] else 3 if step[1] < step[0] else 5)
    wide = 9.6 if columns > 1 else 8.0
    step[1] += TITLE * columns * step[0] / wide
    painted, rest, bent, white, corners = [], [], [], [], []
    for k, (label, body) in enumerate(bodies.items()):
        row, column = divmod(k, columns)
        moved = step * [column, -row]
        place = moved @ np.array([view.right, view.up])
        if SIZE not in body.point_data:
            body.point_data[SIZE] = np.linalg.norm(surface.point_data[label], axis=1)
        found = body.point_data[SIZE]
        body.point_data[SIZE] = found / (float(found.max()) or 1.0)
        painted.append(body.translate(place))
        rest.append(edges.translate(place - 2.0 * view.length * view.towards))
        bent.append(edges.warp_by_vector(label, factor=factors[label]).translate(place))
        if label in nodal:
            lines = nodal[label].warp_by_vector(label, factor=factors[label])
            white.append(lines.translate(place))
        corners.append((low + moved + [0.0, high[1] - low[1]], titles[label]))
    parts = [coloured(merge(painted), SIZE, 1.0, bar["cmap"]), drawn_lines(merge(rest), OUTLINE)]
    parts += [drawn_lines(merge(bent)), *(drawn_lines(line, "white", 3.5) for line in white)]
    high = high + step * [columns - 1, 0] + [0.0, step[1] - (high - low)[1]]
    low = low - step * [0.0, row + 0.1 * (row > 0)]
    frame = Frame(view, low, high)
    wide = width_of(frame, wide)
    look: dict[str, Any] = {"fontsize": 11.0, "va": "bottom", "color": "black"}
    texts = [Text(x, y, title, **look) for (x, y), title in corners]
    panel = body_panel([image_of(parts, frame, wide, **bar), *texts, *marks])
    return Plot([panel], wide, 0.0)


def _nodal_lines(surface: PolyData, displacement: Array, view: View) -> PolyData:
    """The lines of zero displacement towards the viewer, if most of the motion goes there."""
    from pyvista import PolyData

    across = displacement @ view.towards
    if not np.any(across) or np.sum(across**2) < TOWARDS * np.sum(displacement**2):
        return PolyData()
    corners = across[surface.regular_faces]
    size = np.sqrt(2.0 * np.linalg.norm(areas(surface), axis=1))
    steep = np.ptp(corners, axis=1) * view.length >= STEEP * np.abs(across).max() * size
    found = surface.copy()
    found.point_data["across"] = across
    return found.remove_cells(~steep).contour([0.0], scalars="across")


def deflection_figure(surface: PolyData, label: str, title: str, view: View) -> Plot:
    """Draw a displacement in m, magnified by a stated factor if it is small.

    Args:
        surface: the surface.
        label: the point array of the displacement (n, 3).
        title: title of the figure.
        view: the projection.
    """
    largest = float(np.linalg.norm(largest_of(surface.point_data[label])))
    factor = magnification(largest, view.length)
    bar = bar_to(1e3 * largest or 1.0, f"displacement, mm ({scale_text(factor)})")
    return _deformed(surface, {label: factor}, {label: title}, view, bar)


def stress_figure(surface: PolyData, label: str, title: str) -> Plot:
    """Draw the von Mises stress on a deformed body and mark its largest value.

    The viewer sees the place of the largest stress. If no projection shows it, the mark is hollow
    and the title says so.

    Args:
        surface: the surface, with the stress (n,) as its point array `SIZE`, Pa.
        label: the point array of the displacement (n, 3); it is magnified by a stated factor if it
            is small, m.
        title: title of the figure.
    """
    stress, displacement = surface.point_data[SIZE], np.asarray(surface.point_data[label])
    worst = int(np.argmax(stress))
    view, seen = view_at(surface, worst)
    factor = magnification(float(np.linalg.norm(largest_of(displacement))), view.length)
    titles = {label: title if seen else f"{title}, hidden by the body"}
    x, y = view.project(surface.points[worst] + factor * displacement[worst])
    look: dict[str, Any] = {"linestyle": "", "marker": "o", "zorder": 6.0}
    rims = [Line([x], [y], color="black", markersize=7.5, hollow=seen, **look)]
    about = f"von Mises stress, MPa (displacements {scale_text(factor)})"
    bar = bar_to(1e-6 * float(stress[worst]) or 1.0, about, "turbo")
    return _deformed(surface, {label: factor}, titles, view, bar, marks=rims)


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
    view, low, high = frame_of(film.view, [film.surface.points, *places])
    high[1] += TIME_HEIGHT / WIDTH * (high[0] - low[0])
    height = round(WIDTH * min(1.0, (high[1] - low[1]) / (high[0] - low[0])))
    window = window_of(parts, Frame(view, low, high), (WIDTH, height))
    canvas: Any = FigureCanvasAgg(figure_of(_legend(film, 1e3 * largest, factor), FILM_DPI))
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


def _legend(film: Film, largest: float, factor: float) -> Plot:
    """The colour bar to the largest displacement, mm, and the contact states."""
    about = "from the equilibrium, " if film.loaded else ""
    bar = bar_to(largest or 1.0, f"displacement, mm ({about}{scale_text(factor)})")
    empty = Image(np.full((1, 1, 3), 255, np.uint8), np.zeros(2), np.ones(2), **bar)
    look: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 7.0}
    marks = [Line(color=color, label=name, **look) for name, color in STATES.values()]
    panel = Panel([empty], plain=True, tight="xy")
    return Plot([panel], WIDTH / FILM_DPI, 1.35, legend=marks if len(film.places) else ())
