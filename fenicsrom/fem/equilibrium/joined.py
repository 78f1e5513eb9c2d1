"""The equilibrium of bodies that touch each other, and the springs of the points that are closed.

Bodies and walls are brought together without friction: with the springs of the closed points along
the normals, and with soft springs along the tangents whose ends follow the points until they carry
nothing. A body that contacts alone hold is then held in each solution. At the equilibrium the
closed points stick, without a tangential force: their springs are part of the matrix from which
modes, attachments and derivatives follow,

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
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.body.elasticity import Joint
from fenicsrom.fem.body.supports import free_motions
from fenicsrom.fem.equilibrium.statics import Statics
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.contact.law import at_rest, commit_all, forces_at
from fenicsrom.online.contact.points import closed_springs, trial_forces
from fenicsrom.online.contact.state import (
    ContactStep,
    Interval,
    contact_scratch,
    zero_contact_state,
)
from fenicsrom.online.contact.surfaces import PLANE, Contacts
from fenicsrom.scene.base.rules import Where

SOFT = 1e-6
"""Tangential springs of the search, relative to k_t: stiffer ones make their ends follow slowly."""

LEFT = 1e-9
"""Tangential forces that the soft springs may carry in the end, relative to the normal forces."""

SLIDE = 1e-3
"""Slide in the equilibrium, by the extent of the mesh, from which the user is warned."""

CHANGES = 60
"""Largest number of solutions until the closed points are known."""


class Rubbing:
    """The contacts of bodies along a path of equilibria: a joint whose points open, slip or stick.

    Between two equilibria of the path the points move on straight lines: the sliders follow at each
    equilibrium (`hold`), as at the end of a time step.

    Attributes:
        dissipated: what friction dissipated up to the last equilibrium, J.
    """

    dissipated = 0.0

    def __init__(self, rows: csr_array, contacts: Contacts, u: Array):
        """Begin with points that carry no friction at a displacement u (local,)."""
        count, d = contacts.axes.shape[:2]
        self._rows, self._shape = rows, (count, d)
        states = [zero_contact_state(count, d) for _ in range(2)]
        scratch, x = contact_scratch(count, d), self._displacement(u)
        at_rest(contacts, x, x, 0.0, states[0], scratch)
        self._step = ContactStep(contacts, Interval(0.0, 0.0, 0.0, False), *states, scratch)

    def _displacement(self, u: Array) -> Array:
        return np.ascontiguousarray((self._rows @ u).reshape(self._shape))

    def force(self, u: Array) -> Array:
        """The force (local,) at a displacement u (local,), N."""
        forces_at(self._step, self._displacement(u))
        return np.asarray(self._rows.T @ self._step.scratch.mean_force.ravel())

    def tangent(self, u: Array, symmetric: bool) -> csr_array:
        """The derivative of `force`, sparse (local, local).

        With constant limits of friction it is symmetric.
        """
        forces_at(self._step, self._displacement(u))
        blocks, numbers = self._step.scratch.force_derivative.copy(), np.arange(self._shape[0] + 1)
        if symmetric:
            blocks[:, 1:, 0] = blocks[:, 0, 1:]
        law = scipy.sparse.bsr_array((blocks, numbers[:-1], numbers))
        return csr_array(self._rows.T @ law @ self._rows)

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


def sticking(body: Any, contacts: Contacts, x: Array, soft: float = 1.0) -> Joint:
    """The closed points at displacements x (m,) as springs: they keep their normal forces there.

    `soft` is a factor of the tangential springs.
    """
    d, reference, springs = body.dimension, x.copy(), closed_springs(contacts, x)
    reference[::d] -= trial_forces(contacts, x) / contacts.normal_stiffness
    springs[np.arange(springs.size) % d > 0] *= soft
    return Joint(body.contact_rows, springs, reference)


def all_closed(body: Any, contacts: Contacts, paired: Array) -> Joint:
    """The points from which the search starts: those of the bodies, and of walls without a gap.

    `paired` (P,) tells which points touch another body.
    """
    d, rows = body.dimension, body.contact_rows.shape[0]
    x = np.zeros(rows)
    closed = paired | ((trial_forces(contacts, x) >= 0.0) & (contacts.kind == PLANE))
    x[::d] = np.where(closed, contacts.radius + 1.0, 0.0)
    return sticking(body, contacts, x, SOFT)


def bring_together(body: Any, contacts: Contacts, bends: bool) -> Array:
    """The equilibrium (local,) of a body under its static loads; its joint and factor follow.

    Args:
        body: the solid, undeformed, with the joint of `all_closed`; its factor is not made yet.
        contacts: the contacts between its pieces, at its contact points.
        bends: whether the equilibrium changes the stiffness.

    Raises:
        ConvergenceError: nothing presses on a piece that contacts hold, or no equilibrium was
            found.
        SceneError: a round surface presses on a body.
    """
    rows, rest, load = body.contact_rows, np.zeros(body.local), body.static_load
    normal = np.arange(rows.shape[0]) % body.dimension == 0
    u = rest
    with closing(Statics(body, body.factor, overwrite=body.symmetric)) as statics:
        for _ in range(CHANGES):
            if bends:
                u = statics.follow(u, body.residual(u, rest), load)
            else:
                u = -body.factor.solve(body.residual(rest, load)[:, None])[:, 0]
            x, before = rows @ u, body.joint
            shear = np.sum(np.abs(before.springs * (x - before.reference))[~normal])
            pressed = np.sum(np.maximum(trial_forces(contacts, x), 0.0))
            body.joint = sticking(body, contacts, x, SOFT)
            if np.array_equal(body.joint.springs, before.springs):
                if shear <= LEFT * pressed:
                    break
                continue
            held = free_motions(body, csr_array(body.couplings + body.joint.stiffness))
            if held.free.shape[1] > body.free_motions.shape[1]:
                reason = "the contacts of a piece of the mesh open under the static loads, and no "
                reason += "support holds it: press it on by a bolt or a load"
                raise ConvergenceError(reason, u)
            statics.renew(u if bends else rest)
        else:
            raise ConvergenceError(_restless(shear > LEFT * pressed, shear), u)
        body.joint = sticking(body, contacts, x)
        _require_planes(body, contacts, x)
        _note_slide(body, x)
        if bends:
            statics.finish(u, load)
        else:
            statics.renew(rest)
    return u


def _require_planes(body: Any, contacts: Contacts, x: Array) -> None:
    """Check that no round surface presses at x (m,); errors as `bring_together`."""
    pressing = (trial_forces(contacts, x) > 0.0) & (contacts.kind != PLANE)
    if pressing.any():
        where = Where(body.source, f"contacts[{body.points.contact[np.argmax(pressing)]}].surface")
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


def _note_slide(body: Any, x: Array) -> None:
    """Warn if the closed points slide farther than elastic bodies do that friction could hold."""
    d = body.dimension
    along = np.where(body.joint.springs > 0.0, x, 0.0).reshape(-1, d)[:, 1:]
    slide = float(np.linalg.norm(along, axis=1).max(initial=0.0))
    if slide > SLIDE * body.extent:
        text = (
            f"the bodies slide by up to {slide:.3g} m along one another before the motion begins, "
            "because they are brought together without friction: let the bolts pull straight "
            "across the contact, and hold the bodies against static loads along it by supports"
        )
        body.warnings.append(Note(NoteKind.WARNING, text, "contacts"))
