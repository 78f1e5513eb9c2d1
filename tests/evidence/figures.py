"""Figures that matplotlib draws in the style of the program."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from fenicsrom.post.base.style import DPI, STYLE


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Decorate a function that draws with matplotlib so that it uses the common style."""

    @functools.wraps(draw)
    def drawn(*args: Any, **kwargs: Any) -> Figure:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of this size in inches."""
    return Figure(figsize=(width, height), dpi=DPI, layout="constrained")
