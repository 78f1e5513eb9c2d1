"""The common style of all figures, and which modules for drawing are missing.

Figures are matplotlib `Figure` objects made without pyplot: no window opens and no figure stays in
memory. `figure.savefig(path)` writes one. matplotlib is imported only when a figure is made.
"""

import functools
import importlib.util
import itertools
import os
from collections.abc import Callable, Collection, Iterable
from ctypes.util import find_library
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from fenicsrom.online.motion.measures import STATE_NAMES

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:
    Axes = Figure = Any  # types only: matplotlib is imported when a figure is made

# Ratio of displacement and length of the body from which displacements are drawn to scale.
TRUE_SCALE = 0.03
# The colours of Okabe and Ito, which colour-blind readers can distinguish. Their yellow is left out
# because it is hard to see on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
# Contact state -> name and colour.
STATES = {
    state: (name, colour)
    for (state, name), colour in zip(
        STATE_NAMES.items(), ("#D9DDE1", "#E69F00", "#009E73"), strict=True
    )
}
EQUAL, APART = 1e-6, 1e-3
"""Relative range of values that differ by rounding only, and half of the range that is drawn."""
EDGE = "#555B61"
"""The colour of axes, and of the edges of samples in legends."""

_LINES: dict[str, dict[str, Any]] = {
    "full": {"color": "#A6ABB0", "linewidth": 4.0, "zorder": 2},
    "beam": {"color": "#D55E00", "linewidth": 1.6, "linestyle": (0, (5, 3)), "zorder": 4},
    "reduced": {"color": "#0072B2", "linewidth": 1.6, "zorder": 3},
}
_STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.5,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": EDGE,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,  # "1e-10+5.05e1" says nothing
    "axes.formatter.limits": (-5, 6),  # the multiplier of an axis may lie over its label
    "grid.color": "#E6E8EA",
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 10,
    "lines.linewidth": 1.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Decorate a drawing function so that it uses the common style."""

    @functools.wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Figure:
        import matplotlib

        with matplotlib.rc_context(_STYLE):
            figure = draw(*args, **kwargs)
            for axes in figure.axes:
                _widen(axes)
            return figure

    return drawn


def _widen(axes: Axes) -> None:
    """Give an axis whose values differ by rounding only a range that shows them as equal."""
    for name in ("x", "y"):
        low, high = getattr(axes, f"get_{name}lim")()
        size = max(abs(low), abs(high))
        if getattr(axes, f"get_{name}scale")() == "linear" and abs(high - low) < EQUAL * size:
            getattr(axes, f"set_{name}lim")(low - APART * size, high + APART * size)


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=140, layout="constrained")


def new_panels(
    width: float, height: float, rows: int = 1, columns: int = 1, **more: Any
) -> tuple[Figure, list[Any]]:
    """Make a figure of this size in inches, and its panels row by row.

    Args:
        width: of the figure.
        height: of the figure.
        rows: number of rows of panels.
        columns: number of columns of panels.
        more: other arguments of `Figure.subplots`.
    """
    figure = new_figure(width, height)
    return figure, list(figure.subplots(rows, columns, squeeze=False, **more).flat)


def state_handles(present: Collection[int] = tuple(STATES)) -> list[Any]:
    """The entries of a legend for these contact states."""
    from matplotlib.patches import Patch

    look: dict[str, Any] = {"edgecolor": EDGE, "linewidth": 0.5}
    states = [STATES[state] for state in STATES if state in present]
    return [Patch(facecolor=colour, label=name, **look) for name, colour in states]


def state_map() -> dict[str, Any]:
    """How a map of contact states looks: its colours, and their range."""
    from matplotlib.colors import ListedColormap

    colours = ListedColormap([STATES[state][1] for state in sorted(STATES)])
    return {"cmap": colours, "vmin": -1.5, "vmax": 1.5, "shading": "nearest", "rasterized": True}


def line_styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Give each name its own line style.

    `full`, `beam` and `reduced` have fixed styles; the other names share the remaining colours.
    """
    names = list(names)
    free = [
        colour
        for colour in COLOURS
        if all(_LINES[name]["color"] != colour for name in names if name in _LINES)
    ]
    cycle = itertools.cycle(itertools.product(("-", "--", "-.", ":"), free))
    return {
        name: _LINES.get(name) or dict(zip(("linestyle", "color"), next(cycle), strict=True))
        for name in names
    }


def magnification(largest: float, length: float) -> float:
    """Choose the factor by which displacements are multiplied in a picture.

    Args:
        largest: largest displacement, m.
        length: length of the body, m.

    Returns:
        1 if the largest displacement is zero or at least `TRUE_SCALE` of the length; otherwise the
        largest of 1, 2 and 5 times a power of ten with which no displacement exceeds a tenth of the
        length.
    """
    if largest >= TRUE_SCALE * length or largest == 0.0:
        return 1.0
    wanted = 0.1 * length / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(
        max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1.0 + 1e-9)) * power
    )


def scale_text(factor: float) -> str:
    """Say in words by which factor the drawn displacements are multiplied."""
    return "drawn to scale" if factor == 1.0 else f"drawn × {factor:g}"


def missing_module(*names: str) -> str | None:
    """Say which of some Python modules is not installed; None if all are installed."""
    missing = (name for name in names if importlib.util.find_spec(name) is None)
    return next((f"{name} is not installed" for name in missing), None)


@cache
def missing_renderer() -> str | None:
    """Say why bodies in space cannot be drawn on this machine; None if they can."""
    if reason := missing_module("matplotlib", "pyvista", "vtkmodules"):
        return reason
    import pyvista
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  # the windows that can be found
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    pyvista.vtk_verbosity("off")  # VTK would print which kinds of windows it tries
    kind = vtkRenderWindow().GetClassName()
    if kind == "vtkXOpenGLRenderWindow" and "DISPLAY" not in os.environ:
        return "VTK older than 9.4 cannot draw without a screen"
    if kind == "vtkOSOpenGLRenderWindow" and not find_library("OSMesa"):
        return "VTK finds neither EGL nor OSMesa, one of which it needs to draw without a screen"
    return None
