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
"""Tangential springs of the search, relative to k_n: stiffer ones make their ends follow slowly."""

LEFT = 1e-9
"""Tangential forces that the soft springs may carry in the end, relative to the normal forces."""

HELD = 1e-6
"""The same if they fall no more: a motion along the contact that next to nothing drives."""

FALLS = 0.99
"""Tangential forces fall if a solution leaves less than this part of them."""

CHANGES = 60
"""Largest number of solutions until the closed points are known."""

LOOSE = (
    "the contacts open under the static loads, and no support holds {}: press the body on by a "
    "bolt or a load"
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


def sticking(contacts: Contacts, x: Array) -> Springs:
    """The closed points at displacements x (m,) as springs: they keep their normal forces there."""
    reference, springs = x.copy(), closed_springs(contacts, x)
    reference[:: contacts.axes.shape[1]] -= trial_forces(contacts, x) / contacts.normal_stiffness
    return Springs(springs, reference)


def sliding(contacts: Contacts, x: Array) -> Springs:
    """As `sticking`, with the soft tangential springs of the search in place of stiffer ones."""
    found = sticking(contacts, x)
    springs = found.springs.reshape(-1, contacts.axes.shape[1])
    springs[:, 1:] = SOFT * springs[:, :1] * (springs[:, 1:] > 0.0)
    return found


def all_closed(contacts: Contacts, paired: NDArray[np.bool_]) -> Springs:
    """The points from which the search starts: those of the bodies, and of walls without a gap.

    `paired` (P,) tells which points touch another body.
    """
    count, d = contacts.axes.shape[:2]
    x = np.zeros(count * d)
    closed = paired | ((trial_forces(contacts, x) >= 0.0) & (contacts.kind == PLANE))
    x[::d] = np.where(closed, contacts.radius + 1.0, 0.0)
    return sliding(contacts, x)


def bring_together(
    contacts: Contacts,
    start: Springs,
    solve: Callable[[Springs, bool], Array],
    free: Callable[[Springs], str] = lambda springs: "",
) -> Springs:
    """Find the points that are closed in equilibrium.

    Args:
        contacts: the contacts.
        start: the springs of the first solution.
        solve: gives the contact displacements (m,) of the equilibrium with springs, and is told
            whether other points are closed than in the solution before.
        free: names the bodies that springs do not hold, and their motions.

    Returns:
        The closed points at the equilibrium, which stick.

    Raises:
        ConvergenceError: the search does not end; or as `solve`.
    """
    now, changed, shear = start, False, np.inf
    normal = np.arange(now.springs.size) % contacts.axes.shape[1] == 0
    for _ in range(CHANGES):
        x, before, last = solve(now, changed), now, shear
        shear = float(np.sum(np.abs(before.force(x))[~normal]))
        least = HELD if not changed and shear > FALLS * last else LEFT
        slides = shear > least * np.sum(np.maximum(trial_forces(contacts, x), 0.0))
        now = sliding(contacts, x)
        changed = not np.array_equal(now.springs, before.springs)
        if not (changed or slides):
            return sticking(contacts, x)
    along = free(now._replace(springs=now.springs * normal))
    raise ConvergenceError(_restless(slides, shear, along or "it"), x)


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


def _restless(slides: bool, shear: float, free: str) -> str:
    """Why the search for the closed points does not end; `free` names what friction alone holds."""
    if slides:
        return (
            f"static loads push a body along its contacts with about {shear:.3g} N, and only "
            f"friction holds {free}; bodies are brought together without friction: hold "
            "the body along the contact by a support, or let this load begin with the motion"
        )
    return (
        f"some contact points open and close in turn, still after {CHANGES} solutions: lower "
        "contacts.normal_stiffness, or press the bodies on more firmly"
    )
