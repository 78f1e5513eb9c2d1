"""Figures and films of deformed bodies: shapes, static deflection and stresses."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_write
from fenicsrom.post.base.style import (
    STATES,
    Axes,
    Figure,
    magnification,
    new_panels,
    scale_text,
    styled,
)
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
    body_figure,
    colour_bar,
    coloured,
    drawn_lines,
    pixels_of,
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


@styled
def shape_figure(
    surface: PolyData,
    titles: Mapping[str, str],
    modes: Collection[str] = (),
    view: View | None = None,
) -> Figure:
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
    figure, axis = _deformed(surface, factors, titles, view, nodal=nodal)
    few = f" ({len(labels)} of {len(titles)} shapes)" if len(titles) > len(labels) else ""
    about = f"displacement / largest of the shape{few}{f'; {NODAL}' * bool(nodal)}\n{NO_SCALE}"
    colour_bar(figure, axis, 1.0, about)
    return figure


def _deformed(
    surface: PolyData,
    factors: Mapping[str, float],
    titles: Mapping[str, str],
    view: View,
    colours: str = "viridis",
    nodal: Mapping[str, PolyData] | None = None,
) -> tuple[Figure, Axes]:
    """Draw deformed bodies in rows, each coloured from 0 to its largest value.

    Args:
        surface: the surface; its colours are those of the point array `SIZE`, or else of the size
            of the displacement.
        factors: the point array of each displacement (n, 3) -> its factor.
        titles: the same -> its title.
        view: the projection.
        colours: name of the colour map.
        nodal: lines on the undeformed surface that move with it.
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
    parts = [coloured(merge(painted), SIZE, 1.0, colours), drawn_lines(merge(rest), OUTLINE)]
    parts += [drawn_lines(merge(bent)), *(drawn_lines(line, "white", 3.5) for line in white)]
    high = high + step * [columns - 1, 0] + [0.0, step[1] - (high - low)[1]]
    low = low - step * [0.0, row + 0.1 * (row > 0)]
    figure, axis, _ = body_figure(parts, Frame(view, low, high), 0.8, wide)
    for (x, y), title in corners:
        axis.text(x, y, title, fontsize=11, va="bottom")
    return figure, axis


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


@styled
def deflection_figure(surface: PolyData, label: str, title: str, view: View) -> Figure:
    """Draw a displacement in m, magnified by a stated factor if it is small.

    Args:
        surface: the surface.
        label: the point array of the displacement (n, 3).
        title: title of the figure.
        view: the projection.
    """
    largest = float(np.linalg.norm(largest_of(surface.point_data[label])))
    factor = magnification(largest, view.length)
    figure, axis = _deformed(surface, {label: factor}, {label: title}, view)
    colour_bar(figure, axis, 1e3 * largest or 1.0, f"displacement, mm ({scale_text(factor)})")
    return figure


@styled
def stress_figure(surface: PolyData, label: str, title: str) -> Figure:
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
    figure, axis = _deformed(surface, {label: factor}, titles, view, "turbo")
    at = view.project(surface.points[worst] + factor * displacement[worst])
    colour = "white" if seen else "none"
    axis.plot(*at, "o", color=colour, markersize=6.5, markeredgecolor="black", zorder=6)
    about = f"von Mises stress, MPa (displacements {scale_text(factor)})"
    colour_bar(figure, axis, 1e-6 * float(stress[worst]) or 1.0, about, "turbo")
    return figure


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
