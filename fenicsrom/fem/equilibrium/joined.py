"""The equilibrium of bodies that touch each other, and the springs of the points that are closed.

Bodies and walls are brought together without friction (`fenicsrom.online.contact.together`). At the
equilibrium the closed points stick, without a tangential force: their springs are part of the
matrix from which modes, attachments and derivatives follow,

    K_lin = K + B k Bᵀ,    k = (k_n, k_t) of the closed points, else 0.

K itself has no springs. It is projected, because the contact law of the motion holds them.
"""

from contextlib import closing
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.body.elasticity import Joint
from fenicsrom.fem.body.supports import free_motions, free_pieces
from fenicsrom.fem.equilibrium.statics import Statics
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact import together
from fenicsrom.online.contact.law import at_rest, commit_all, forces_at
from fenicsrom.online.contact.state import (
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.contact.together import LOOSE, Springs

SLIDE = 1e-3
"""Slide in the equilibrium, by the extent of the mesh, from which the user is warned."""


class Rubbing:
    """The contacts of bodies along a path of equilibria: a joint whose points open, slip or stick.

    Between two equilibria of the path the points move on straight lines: the sliders follow at each
    equilibrium (`hold`), as at the end of a time step.

    Attributes:
        dissipated: what friction dissipated up to the last equilibrium, J.
    """

    dissipated = 0.0

    def __init__(self, body: Any, contacts: Contacts, u: Array):
        """Begin with points of a body that carry no friction at a displacement u (local,)."""
        count, d = contacts.axes.shape[:2]
        self._body, self._rows, self._shape = body, body.contact_rows, (count, d)
        states = [zero_contact_state(count, d) for _ in range(2)]
        scratch, x = contact_scratch(count, d), self._displacement(u)
        at_rest(contacts, x, x, 0.0, states[0], scratch)
        self._step = ContactStep(contacts, Interval(0.0, 0.0, 0.0, False), *states, scratch)

    def _displacement(self, u: Array) -> Array:
        return np.ascontiguousarray(self._body.contact_displacement(u).reshape(self._shape))

    def force(self, u: Array) -> Array:
        """The force (local,) at a displacement u (local,), N."""
        forces_at(self._step, self._displacement(u))
        return np.asarray(self._rows.T @ self._step.scratch.mean_force.ravel())

    def tangent(self, u: Array, symmetric: bool) -> csr_array:
        """The derivative of `force`, sparse (local, size).

        With constant limits of friction it is symmetric.
        """
        forces_at(self._step, self._displacement(u))
        blocks, numbers = self._step.scratch.force_derivative.copy(), np.arange(self._shape[0] + 1)
        if symmetric:
            blocks[:, 1:, 0] = blocks[:, 0, 1:]
        law = scipy.sparse.bsr_array((blocks, numbers[:-1], numbers))
        return csr_array(self._body.product(self._rows, law))

    def states(self, u: Array) -> NDArray[np.int8]:
        """The states (P,) of the points at a displacement u (local,): OPEN, SLIP or STICK."""
        forces_at(self._step, self._displacement(u))
        return self._step.scratch.mode.copy()

    def hold(self, u: Array) -> None:
        """Let the sliders follow to an equilibrium u (local,) of the path."""
        forces_at(self._step, self._displacement(u))
        self.dissipated += commit_all(self._step)
        for before, after in zip(self._step.start, self._step.end, strict=True):
            before[:] = after


def bring_together(body: Any, contacts: Contacts, bends: bool) -> Array:
    """The equilibrium (local,) of a body under its static loads; its joint and factor follow.

    Args:
        body: the solid, undeformed, with the joint of `all_closed`; its factor is not made yet.
        contacts: the contacts between its pieces, at its contact points.
        bends: whether the equilibrium changes the stiffness.

    Raises:
        ConvergenceError: nothing presses on a piece that contacts hold, or no equilibrium was
            found.
    """
    rows, rest, load = body.contact_rows, np.zeros(body.local), body.static_load
    u = rest
    with closing(Statics(body, body.factor, overwrite=body.symmetric)) as statics:

        def free(springs: Springs) -> str:
            found = free_motions(body, [body.couplings, Joint(body, rows, *springs).directions])
            more = found.free.shape[1] > body.free_motions.shape[1]
            return free_pieces(body, found) if more else ""

        def solve(springs: Springs, changed: bool) -> Array:
            nonlocal u
            body.joint = Joint(body, rows, *springs)
            if changed:
                if loose := free(springs):
                    raise ConvergenceError(LOOSE.format(loose), u)
                statics.renew(u if bends else rest)
            if bends:
                u = statics.follow(u, body.residual(u, rest), load)
            else:
                u = -body.factor.solve(body.residual(rest, load)[:, None])[:, 0]
            return np.asarray(body.contact_displacement(u))

        start = Springs(body.joint.springs, body.joint.reference)
        body.joint = Joint(body, rows, *together.bring_together(contacts, start, solve, free))
        _note_slide(body, body.contact_displacement(u))
        if bends:
            statics.finish(u, load)
        else:
            statics.renew(rest)
    return u


def _note_slide(body: Any, x: Array) -> None:
    """Warn if the closed points slide farther than elastic bodies do that friction could hold."""
    d = body.dimension
    along = np.where(body.joint.springs > 0.0, x, 0.0).reshape(-1, d)[:, 1:]
    slide = float(np.linalg.norm(along, axis=1).max(initial=0.0))
    said = any(note.key == "contacts" for note in body.warnings)  # at another speed
    if slide > SLIDE * body.extent and not said:
        text = (
            f"the bodies slide by up to {slide:.3g} m along one another before the motion begins, "
            "because they are brought together without friction: let the bolts pull straight "
            "across the contact, and hold the bodies against static loads along it by supports"
        )
        body.warnings.append(Note(NoteKind.WARNING, text, "contacts"))
