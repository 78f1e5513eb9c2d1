"""Bodies and symbols in space, drawn by pyvista into the panels of matplotlib figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.base.style import new_figure
from fenicsrom.post.body.body_view import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pyvista import Plotter, PolyData

TRIAD = 0.18
"""Size of the arrows of the global axes in the lower left corner, relative to the picture."""

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

SHARP = 140.0
"""Pixels of a picture in an inch of its panel."""

Pixels = NDArray[np.uint8]


class Part(NamedTuple):
    """Something in space with one look.

    Attributes:
        mesh: its points, lines and faces.
        look: how pyvista draws it: arguments of `Plotter.add_mesh`.
        symbol: whether it also shows through the body.
    """

    mesh: PolyData
    look: Mapping[str, Any]
    symbol: bool = False


def painted(mesh: PolyData, colour: str = GREY, **look: Any) -> Part:
    """A surface in one colour."""
    return Part(mesh, {"color": colour, **look})


def drawn_lines(mesh: PolyData, colour: str = LINE, width: float = 1.8) -> Part:
    """Lines in one colour, with their width in pixels."""
    return Part(mesh, {"color": colour, "line_width": width, "lighting": False})


def coloured(mesh: PolyData, scalars: str, largest: float, colours: str = "viridis") -> Part:
    """A surface with the colours of a point array from 0 to its largest value."""
    look = {"scalars": scalars, "clim": (0.0, largest), "cmap": colours, "copy_mesh": False}
    return Part(mesh, look | {"show_scalar_bar": False})


@cache
def _window() -> Plotter:
    """The window of pyvista in which all pictures are drawn. It is never shown."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, lighting="none")
    plotter.add_light(pyvista.Light(position=(-0.3, 0.6, 1.0), light_type="camera light"))
    plotter.enable_anti_aliasing("msaa", multi_samples=4)
    plotter.background_color = "white"
    look: Any = {f"{axis}_color": LINE for axis in "xyz"} | {"color": LINE, "line_width": 2}
    plotter.add_axes(interactive=False, **look, **{f"{axis}label": axis for axis in "xyz"})
    return plotter


def window_of(
    parts: Sequence[Part], view: View, low: Array, high: Array, size: tuple[int, int]
) -> Plotter:
    """The window with these parts and nothing else in it.

    Args:
        parts: what to draw.
        view: the projection.
        low: (2,) lower left corner of the picture, m.
        high: (2,) its upper right corner, m.
        size: width and height in pixels.
    """
    plotter = _window()
    plotter.clear_actors()
    plotter.window_size = list(size)
    triad = TRIAD * max(size)
    plotter.renderer.axes_widget.SetViewport(0.0, 0.0, triad / size[0], triad / size[1])
    drawn = [part for part in parts if part.mesh.n_points]
    for mesh, look, _ in drawn:
        shaded = {"ambient": 0.75, "diffuse": 0.3, **look}
        actor = plotter.add_mesh(mesh, render=False, **shaded)
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


def pixels_of(plotter: Plotter, opaque: bool = False) -> Pixels:
    """What the window shows now, (height, width, 4) red, green, blue and opacity, or without it."""
    plotter.render()
    image: Any = plotter.screenshot(transparent_background=not opaque, return_img=True)
    return image


def render(
    parts: Sequence[Part], view: View, low: Array, high: Array, size: tuple[int, int]
) -> Pixels:
    """Draw the parts on a transparent ground; arguments as `window_of`.

    Returns:
        (height, width, 4) red, green, blue and opacity. Symbols behind the body are pale.
    """
    whole = pixels_of(window_of(parts, view, low, high, size))
    symbols = [part for part in parts if part.symbol]
    if not symbols:
        return whole
    front = pixels_of(window_of(symbols, view, low, high, size))
    here = front[..., 3] > 0
    pale, below = front[here].astype(float), whole[here]
    weight = HIDDEN / 255.0 * pale[:, 3:]
    whole[here, :3] = weight * pale[:, :3] + (1.0 - weight) * below[:, :3] + 0.5
    whole[here, 3] = np.maximum(below[:, 3], HIDDEN * pale[:, 3])
    return whole


def show(
    axis: Axes, parts: Sequence[Part], view: View, low: Array, high: Array, width: float
) -> None:
    """Draw the parts in a panel without axes and to scale.

    Args:
        axis: the panel.
        parts: what to draw.
        view: the projection.
        low: (2,) lower left corner of the part of the picture that is shown, m.
        high: (2,) its upper right corner, m.
        width: of the panel, inches.
    """
    axis.set_axis_off()
    axis.set(xticks=[], yticks=[])  # measuring hidden ticks takes time
    extent = high - low
    size = np.rint(SHARP * width * np.array([1.0, extent[1] / extent[0]])).astype(int)
    image = render(parts, view, low, high, (int(size[0]), int(size[1])))
    axis.imshow(image, extent=(low[0], high[0], low[1], high[1]), interpolation="bilinear")
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")


def body_panel(view: View, low: Array, high: Array, spare: float) -> tuple[Figure, Axes, float]:
    """Make a figure with one panel for a body.

    Args:
        view: the projection.
        low: (2,) lower left corner of the part of the picture that is shown, m.
        high: (2,) its upper right corner, m.
        spare: height of title, legend and colour bar, inches.

    Returns:
        The figure, the panel and its width in inches.
    """
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    wide = 8.0 * min(1.0, max(0.6, 1.0 / aspect))
    figure = new_figure(wide, wide * aspect + spare)
    axis = figure.subplots()
    return figure, axis, wide


def colour_bar(
    figure: Figure, axes: Any, largest: float, label: str, colours: str = "viridis"
) -> None:
    """Add the colour bar of values from 0 to the largest below all panels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar: Any = figure.colorbar(
        ScalarMappable(Normalize(0.0, largest), colours),
        ax=axes,
        location="bottom",
        shrink=0.3 if np.size(axes) > 1 else 0.5,
        aspect=40,
        ticks=[0.0, 0.5 * largest, largest],
        format="{x:.3g}",
    )
    bar.set_label(label)
    bar.outline.set_visible(False)
    # constrained layout cuts the label of a tall figure without this margin
    margin = LABEL_MARGIN / figure.get_figheight()
    layout: Any = figure.get_layout_engine()
    layout.set(rect=(0.0, margin, 1.0, 1.0 - margin))
