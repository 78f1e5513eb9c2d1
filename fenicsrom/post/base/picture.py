"""A picture that is not drawn yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Picture:
    """A picture that is not drawn yet.

    Attributes:
        heading: its heading in the report.
        name: name of the file.
        draw: makes the figure.
    """

    heading: str
    name: str
    draw: Callable[[], Figure]
