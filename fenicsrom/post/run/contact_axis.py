"""Where contact points stand in maps: along their line, with force per length or area."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SAME_LENGTH = 0.1
"""Relative difference from which the length of the points' path is not that of their region."""

MOST_NUMBERS = 9
"""Largest number of contact points whose numbers stand at an axis."""


class ContactAxis(NamedTuple):
    """The places of P contact points along an axis.

    Attributes:
        at: (P,) places.
        label: of the axis.
        share: (P,) what forces are divided by. The nodes of a quadratic face or edge have unequal
            shares of it, and so have their forces; the force per area or length is smooth.
        unit: of a force divided by it.
    """

    at: Array
    label: str
    share: Array
    unit: str

    def write_numbers(self, axes: Axes, upright: bool = False) -> None:
        """Write numbers of contact points beside an axis that shows their positions."""
        if self.at[0] == 1.0:
            return
        wanted = np.linspace(0, self.at.size - 1, min(self.at.size, MOST_NUMBERS))
        look: dict[str, Any] = {"fontsize": 8, "color": "#0072B2"}
        axes.yaxis.get_offset_text().set_horizontalalignment("right")  # beside the first number
        for k in np.unique(wanted.round().astype(int)):
            if upright:
                place, turn = (1.005, self.at[k]), axes.get_yaxis_transform()
                axes.text(*place, str(k + 1), transform=turn, va="center", **look)
            else:
                place, turn = (self.at[k], 1.0), axes.get_xaxis_transform()
                axes.text(*place, str(k + 1), transform=turn, ha="center", va="bottom", **look)


def contact_axis(points: ContactPoints | None, count: int) -> ContactAxis:
    """The axis for the points of one contact that is a region of nodes, or else for their numbers.

    In space, nodes lie on a line if the sum of their lengths is that of the path through them.
    """
    numbers = ContactAxis(np.cumsum(np.ones(count)), "contact point", np.ones(count), "N")
    if points is None or count < 2 or len(points.contact) != count or points.contact.any():
        return numbers
    if np.all(points.tributary_area == 1.0):
        return numbers
    steps = np.linalg.norm(np.diff(points.position, axis=0), axis=1)
    whole, plane = float(points.tributary_area.sum()), points.position.shape[1] == 2
    if plane or abs(steps.sum() - whole) < SAME_LENGTH * whole:
        at = 1e3 * np.append(0.0, np.cumsum(steps))
        unit = "N/m²" if plane else "N/m"
        return ContactAxis(at, "position along the contact points, mm", points.tributary_area, unit)
    return numbers._replace(share=points.tributary_area, unit="N/m²")
