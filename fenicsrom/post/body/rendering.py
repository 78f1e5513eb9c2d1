"""Bodies and symbols in space, drawn by pyvista as images of plots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.plot import Image, Item, Panel, Text
from fenicsrom.post.base.style import DPI
from fenicsrom.post.body.body_view import Frame, PolyData

if TYPE_CHECKING:
    from pyvista import Plotter

TRIAD = 0.18
"""Size of the arrows of the global axes in the lower left corner, relative to the body."""

LEAST_TRIAD = 100.0
"""Pixels of these arrows from which their names can be read."""

GREY = "#D9DDE1"
"""Colour of the undeformed body."""

LINE = "#30363C"
"""Colour of the edges of a body."""

HIDDEN = 0.4
"""Opacity of a symbol behind the body."""

ABOVE = 0.002
"""Distance of lines from the faces below them, relative to the size of the body."""

FINE = 2
"""Pixels of the window in a pixel of the picture, in each direction: they smooth the edges."""

Pixels = NDArray[np.uint8]


class Part(NamedTuple):
    """Something in space with one look.

    Attributes:
        mesh: its points, lines and faces.
        look: how pyvista draws it: arguments of `Plotter.add_mesh`.
        symbol: whether it also shows through the body.
    """

    mesh: PolyData
    look: dict[str, Any]
    symbol: bool = False


def painted(mesh: PolyData, colour: str = GREY, symbol: bool = False, **look: Any) -> Part:
    """Something in one colour."""
    return Part(mesh, {"color": colour, **look}, symbol)


def drawn_lines(mesh: PolyData, colour: str = LINE, width: float = 1.8) -> Part:
    """Lines in one colour, with their width in pixels."""
    return painted(mesh, colour, line_width=width, lighting=False)


def coloured(mesh: PolyData, scalars: str, largest: float, colours: Any = "viridis") -> Part:
    """A surface with the colours of a point array from 0 to its largest value."""
    look = {"scalars": scalars, "clim": (0.0, largest), "cmap": colours, "copy_mesh": False}
    return Part(mesh, look | {"show_scalar_bar": False})


@cache
def _window() -> Plotter:
    """The window of pyvista in which all pictures are drawn. It is never shown."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, lighting="none")
    plotter.add_light(pyvista.Light(position=(-0.3, 0.6, 1.0), light_type="camera light"))
    plotter.disable_anti_aliasing()
    plotter.background_color = "white"
    look: Any = {f"{axis}_color": LINE for axis in "xyz"} | {"color": LINE, "line_width": 2 * FINE}
    plotter.add_axes(interactive=False, **look, **{f"{axis}label": axis for axis in "xyz"})
    return plotter


def window_of(parts: Sequence[Part], frame: Frame, size: tuple[int, int]) -> Plotter:
    """The window with these parts and nothing else in it.

    Args:
        parts: what to draw.
        frame: the part of the picture that is shown.
        size: width and height of the picture in pixels.
    """
    plotter, (view, low, high) = _window(), frame
    plotter.clear_actors()
    window: Any = plotter.render_window
    window.SetSize(FINE * size[0], FINE * size[1])  # `window_size` would draw everything
    triad = np.maximum(TRIAD * view.length / (high - low), LEAST_TRIAD / np.array(size))
    plotter.renderer.axes_widget.SetViewport(0.0, 0.0, *triad)
    drawn = [part for part in parts if part.mesh.n_points]
    for mesh, look, _ in drawn:
        shaded = {"ambient": 0.75, "diffuse": 0.3, **look}
        for width in ("line_width", "point_size"):
            shaded[width] = FINE * look.get(width, 1.0)
        actor: Any = plotter.add_mesh(mesh, render=False, **shaded)
        if not mesh.n_faces:  # lines and points lie in front of the faces on which they are
            actor.position = ABOVE * view.length * view.towards
    reach = max([view.length, *(float(np.abs(part.mesh.bounds).max()) for part in drawn)])
    focus = 0.5 * (low + high) @ np.array([view.right, view.up])
    camera: Any = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = focus
    camera.position = focus + 4.0 * reach * view.towards
    camera.up = view.up
    camera.parallel_scale = 0.5 * (high[1] - low[1])
    camera.clipping_range = (0.5 * reach, 8.0 * reach)
    return plotter


def pixels_of(plotter: Plotter) -> Pixels:
    """What the window shows now, (height, width, 3) red, green and blue."""
    from PIL import Image

    plotter.render()
    image: Any = plotter.screenshot(return_img=True)
    return np.array(Image.fromarray(image).reduce(FINE))


def render(parts: Sequence[Part], frame: Frame, size: tuple[int, int]) -> Pixels:
    """Draw the parts; symbols behind the body are pale. Arguments as for `window_of`."""
    whole = pixels_of(window_of(parts, frame, size))
    if symbols := [part for part in parts if part.symbol]:
        front = pixels_of(window_of(symbols, frame, size))
        here = front.min(axis=2) < 255
        whole[here] = HIDDEN * front[here] + (1.0 - HIDDEN) * whole[here] + 0.5
    return whole


def image_of(parts: Sequence[Part], frame: Frame, width: float, **bar: Any) -> Image:
    """Draw the parts to scale.

    Args:
        parts: what to draw.
        frame: the part of the picture that is shown.
        width: of the image, inches.
        bar: the colour bar, as in `Image`.
    """
    _, low, high = frame
    wide, tall = np.rint(DPI * width / (high - low)[0] * (high - low)).astype(int)
    return Image(render(parts, frame, (int(wide), int(tall))), low, high, **bar)


def body_panel(items: Sequence[Item], title: str = "") -> Panel:
    """A panel of an image and texts, without axes."""
    return Panel(items, title=title, tight="xy", plain=True, square=True)


def width_of(frame: Frame, width: float = 8.0) -> float:
    """The width of a picture that is not much taller than wide, at most `width`, inches."""
    across, up = frame.high - frame.low
    return float(width * min(1.0, max(0.6, across / up)))


def names_at(names: Iterable[tuple[str, Array, str]], frame: Frame, wide: float) -> list[Item]:
    """Names in a panel; one that would cover an earlier name is left out.

    Args:
        names: each name with its place (2,), m, and its colour.
        frame: the part of the picture that is shown.
        wide: width of the panel, inches.
    """
    point = float(frame.high[0] - frame.low[0]) / (72.0 * wide)
    taken: list[tuple[Array, Array]] = []
    found: list[Item] = []
    for name, at, color in names:
        half = point * np.array([4.0 + 3.0 * len(name), 5.0])
        if all(np.any(np.abs(at - other) > half + size) for other, size in taken):
            taken.append((at, half))
            look: dict[str, Any] = {"color": color, "fontsize": 8.0, "ha": "center"}
            found.append(Text(at[0], at[1], name, halo=True, **look))
    return found


def bar_to(largest: float, title: str, cmap: str = "viridis") -> dict[str, Any]:
    """A colour bar below a body, from 0 to the largest value."""
    ticks = {part * largest: f"{part * largest:.3g}" for part in (0.0, 0.5, 1.0)}
    return {"bar": title, "vmin": 0.0, "vmax": largest, "cmap": cmap, "ticks": ticks}
