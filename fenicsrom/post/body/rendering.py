"""Bodies and symbols in space, drawn by pyvista into the panels of matplotlib figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import Axes, Figure, new_panels
from fenicsrom.post.base.tables import PICTURE_DPI
from fenicsrom.post.body.body_view import Frame, PolyData

if TYPE_CHECKING:
    from pyvista import Plotter

TRIAD = 0.18
"""Size of the arrows of the global axes in the lower left corner, relative to the body."""

LEAST_TRIAD = 100.0
"""Pixels of these arrows from which their names can be read."""

LABEL_MARGIN = 0.1
"""Margin below the label of a colour bar, inches."""

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


def show(axis: Axes, parts: Sequence[Part], frame: Frame, width: float) -> None:
    """Draw the parts in a panel without axes and to scale.

    Args:
        axis: the panel.
        parts: what to draw.
        frame: the part of the picture that is shown.
        width: of the panel, inches.
    """
    _, low, high = frame
    axis.set_axis_off()
    axis.set(xticks=[], yticks=[])  # measuring hidden ticks takes time
    wide, tall = np.rint(PICTURE_DPI * width / (high - low)[0] * (high - low)).astype(int)
    image = render(parts, frame, (int(wide), int(tall)))
    axis.imshow(image, extent=(low[0], high[0], low[1], high[1]), interpolation="bilinear")
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


def body_figure(
    parts: Sequence[Part], frame: Frame, spare: float, width: float = 8.0
) -> tuple[Figure, Axes, float]:
    """Draw the parts in a figure with one panel, not much taller than wide.

    Args:
        parts: what to draw.
        frame: the part of the picture that is shown.
        spare: height of title, legend and colour bar, inches.
        width: largest width of the panel, inches.

    Returns:
        The figure, the panel and its width in inches.
    """
    across, up = frame.high - frame.low
    aspect = up / across
    wide = width * min(1.0, max(0.6, 1.0 / aspect))
    figure, (axis,) = new_panels(wide, wide * aspect + spare)
    show(axis, parts, frame, wide)
    return figure, axis, wide


def write_names(axis: Axes, names: Iterable[tuple[str, Array, str]], wide: float) -> None:
    """Write names in a panel; one that would cover an earlier name is left out.

    Args:
        axis: the panel.
        names: each name with its place (2,), m, and its colour.
        wide: width of the panel, inches.
    """
    from matplotlib.patheffects import withStroke

    point = abs(np.subtract(*axis.get_xlim())) / (72.0 * wide)
    taken: list[tuple[Array, Array]] = []
    look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "weight": "bold"}
    look["path_effects"] = [withStroke(linewidth=2.5, foreground="white")]
    for name, at, colour in names:
        half = point * np.array([4.0 + 3.0 * len(name), 5.0])
        if all(np.any(np.abs(at - other) > half + size) for other, size in taken):
            taken.append((at, half))
            text = axis.text(at[0], at[1], name, color=colour, zorder=7, **look)
            text.set_in_layout(False)  # it lies inside the panel; measuring it takes time


def colour_bar(
    figure: Figure, axis: Axes, largest: float, label: str, colours: str = "viridis"
) -> None:
    """Add the colour bar of values from 0 to the largest below a panel."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar: Any = figure.colorbar(
        ScalarMappable(Normalize(0.0, largest), colours),
        ax=axis,
        location="bottom",
        shrink=0.5,
        aspect=40,
        ticks=[0.0, 0.5 * largest, largest],
        format="{x:.3g}",
        label=label,
    )
    bar.outline.set_visible(False)
    # constrained layout cuts the label of a tall figure without this margin
    margin = LABEL_MARGIN / figure.get_figheight()
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, margin, 1.0, 1.0 - margin))
