"""Bodies that are brought together without friction: the points that close, as springs.

The springs of the closed points act along the normals. Soft springs along the tangents, whose ends
follow the points until they carry nothing, hold a body that contacts alone hold. In the end the
closed points stick, without a tangential force (`fenicsrom.fem.equilibrium.joined`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.online.contact.points import ContactPoints, closed_springs, trial_forces
from fenicsrom.online.contact.surfaces import PLANE, Contacts
from fenicsrom.scene.base.rules import Where

SOFT = 1e-6
"""Tangential springs of the search, relative to k_t: stiffer ones make their ends follow slowly."""

LEFT = 1e-9
"""Tangential forces that the soft springs may carry in the end, relative to the normal forces."""

CHANGES = 60
"""Largest number of solutions until the closed points are known."""

LOOSE = (
    "the contacts of a piece of the mesh open under the static loads, and no support holds it: "
    "press it on by a bolt or a load"
)
"""Why a piece that contacts alone hold has no equilibrium."""


class Springs(NamedTuple):
    """Contact points as springs.

    Attributes:
        springs: (m,) k, N/m.
        reference: (m,) x_ref, m.
    """

    springs: Array
    reference: Array

    def force(self, x: Array) -> Array:
        """The forces (m,) k (x − x_ref) at displacements x (m,), N."""
        return self.springs * (x - self.reference)


def sticking(contacts: Contacts, x: Array, soft: float = 1.0) -> Springs:
    """The closed points at displacements x (m,) as springs: they keep their normal forces there.

    `soft` is a factor of the tangential springs.
    """
    d, reference, springs = contacts.axes.shape[1], x.copy(), closed_springs(contacts, x)
    reference[::d] -= trial_forces(contacts, x) / contacts.normal_stiffness
    springs[np.arange(springs.size) % d > 0] *= soft
    return Springs(springs, reference)


def all_closed(contacts: Contacts, paired: NDArray[np.bool_]) -> Springs:
    """The points from which the search starts: those of the bodies, and of walls without a gap.

    `paired` (P,) tells which points touch another body.
    """
    count, d = contacts.axes.shape[:2]
    x = np.zeros(count * d)
    closed = paired | ((trial_forces(contacts, x) >= 0.0) & (contacts.kind == PLANE))
    x[::d] = np.where(closed, contacts.radius + 1.0, 0.0)
    return sticking(contacts, x, SOFT)


def bring_together(
    contacts: Contacts, start: Springs, solve: Callable[[Springs, bool], Array]
) -> Springs:
    """Find the points that are closed in equilibrium.

    Args:
        contacts: the contacts.
        start: the springs of the first solution.
        solve: gives the contact displacements (m,) of the equilibrium with springs, and is told
            whether other points are closed than in the solution before.

    Returns:
        The closed points at the equilibrium, which stick.

    Raises:
        ConvergenceError: the search does not end; or as `solve`.
    """
    now, changed = start, False
    normal = np.arange(now.springs.size) % contacts.axes.shape[1] == 0
    for _ in range(CHANGES):
        x, before = solve(now, changed), now
        shear = float(np.sum(np.abs(before.force(x))[~normal]))
        slides = shear > LEFT * np.sum(np.maximum(trial_forces(contacts, x), 0.0))
        now = sticking(contacts, x, SOFT)
        changed = not np.array_equal(now.springs, before.springs)
        if not (changed or slides):
            return sticking(contacts, x)
    raise ConvergenceError(_restless(slides, shear), x)


def require_planes(contacts: Contacts, points: ContactPoints, x: Array, source: str) -> None:
    """Check that no round surface presses at displacements x (m,).

    Raises:
        SceneError: one presses; the error names its key.
    """
    pressing = (trial_forces(contacts, x) > 0.0) & (contacts.kind != PLANE)
    if pressing.any():
        where = Where(source, f"contacts[{points.contact[np.argmax(pressing)]}].surface")
        allowed = "must not press on the body before the motion begins, because another contact is "
        allowed += "against a region of the body: give this contact a gap, and an approach"
        raise where.refuse("a table", allowed, ErrorKind.CONFLICT)


def _restless(slides: bool, shear: float) -> str:
    """Why the search for the closed points does not end."""
    if slides:
        return (
            f"static loads push a body along its contacts with about {shear:.3g} N, and only "
            "friction holds it; bodies are brought together without friction: hold the body along "
            "the contact by a support, or let this load begin with the motion"
        )
    return (
        f"some contact points open and close in turn, still after {CHANGES} solutions: lower "
        "contacts.normal_stiffness, or press the bodies on more firmly"
    )
