"""The common style of all pictures, and which modules for drawing are missing.

matplotlib is imported only when a figure is made, and never pyplot: no window opens and no figure
stays in memory.
"""

import importlib.util
import itertools
import os
from collections.abc import Iterable
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
EDGE = "#555B61"
"""The colour of axes, and of the edges of samples in legends."""
SOFT = "#5b636b"
"""The colour of texts in a picture."""
DPI = 130
"""Pixels per inch of pictures."""

_LINES: dict[str, dict[str, Any]] = {
    "full": {"color": "#A6ABB0", "linewidth": 4.0, "zorder": 2.0},
    "beam": {"color": "#D55E00", "linewidth": 1.6, "linestyle": "--", "zorder": 4.0},
    "reduced": {"color": "#0072B2", "linewidth": 1.6, "zorder": 3.0},
}
STYLE = {
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
