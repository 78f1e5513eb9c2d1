"""What is attached to a body: concentrated masses, springs, dashpots and bolts.

Two places x₁, x₂ of a body move apart by R u = u(x₂) − u(x₁). A spring between them that acts along
orthonormal directions, the rows of A, has the stiffness k (A R)ᵀ A R. A bolt of length l and force
F pulls head and nut together along the line between them. Its direction a follows their motion, so
that the force is, linear in the displacements,

    F a + F/l (1 − a aᵀ) R u.                                                             (1)

Without the second term a joint that bends is too soft. In a geometrically linear scene the stress
of the parts that balances this term is missing, so the term is left out.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.body.loads import pressure_vector
from fenicsrom.fem.body.places import Places
from fenicsrom.fem.body.supports import node_pieces
from fenicsrom.fem.mesh.picking import ROUNDING
from fenicsrom.notes import Note, NoteKind, implausible
from fenicsrom.online.model.bolts import Bolts
from fenicsrom.scene import Attachment, Bolt, Place
from fenicsrom.scene.keys.places import AXES

TILTED = 10.0
"""Angle between a bolt and the normal of its head or nut, degrees, from which the user is warned:
its sine is then about a usual coefficient of friction."""


def attach(
    body: Any, places: Places, attachments: Sequence[Attachment], unit_length: float
) -> None:
    """Add springs, dashpots and concentrated masses to a body. Collective.

    Args:
        body: the body; its `couplings`, `dashpots`, `point_masses` and `inertia` change.
        places: its places.
        attachments: the attachments.
        unit_length: unit of length of the scene, m.

    Raises:
        SceneError: a place is not found or clamped, or a spring connects a place with itself.
    """
    for k, found in enumerate(attachments):
        key, area = f"attachments[{k}]", 0.0
        if found.to is None:
            unit, area = _to_ground(body, places, found, key, unit_length)
        else:
            unit = _between(body, places, found, found.to, key)
        stiffness = found.stiffness + found.stiffness_per_area * area
        damping = found.damping + found.damping_per_area * area
        body.couplings = csr_array(body.couplings + stiffness * unit)
        body.dashpots = csr_array(body.dashpots + damping * unit)
    body.couplings.eliminate_zeros()
    body.dashpots.eliminate_zeros()
    body.inertia.add_point_masses(body.point_masses.reshape(-1, body.dimension).max(axis=1))


def _to_ground(
    body: Any, places: Places, found: Attachment, key: str, unit_length: float
) -> tuple[csr_array, float]:
    """Add a mass; the matrix (local, size) of a unit spring, and the measure of the place."""
    spread = bool(found.stiffness_per_area or found.damping_per_area)
    weights, area = places.shares(found.place, key, spread)
    if found.place.is_mean:  # `fenicsrom.online.contact.points.shares` says why
        area *= unit_length ** body.mesh.unit_lengths(found.place)
    each = np.repeat(weights, body.dimension)
    each[body.clamped] = 0.0
    if not body.comm.allreduce(bool(each.any())):
        raise places.clamped(key)
    body.point_masses += found.mass * each
    axes = AXES[: body.dimension]
    each *= np.tile(np.isin(axes, found.components or axes), len(weights))
    return csr_array(scipy.sparse.diags_array(each) @ body.own), area


def _between(body: Any, places: Places, found: Attachment, to: Place, key: str) -> csr_array:
    """The matrix (local, size) of a unit spring between two places. Collective."""
    apart, line = _apart(places, (found.place, key), (to, f"{key}.to"))
    directions, length = np.eye(body.dimension), float(np.linalg.norm(line))
    if found.components:
        directions = directions[[AXES.index(axis) for axis in found.components]]
    elif length > ROUNDING * body.extent:
        directions = line[None, : body.dimension] / length
    rows = csr_array(directions @ apart)
    if body.comm.allreduce(float(abs(rows).sum())) <= ROUNDING:
        reason = "its nodes are those of the place of the attachment: must be another place"
        raise refuse(body.source, reason, ErrorKind.PLACE, f"{key}.to")
    return body.product(rows, scipy.sparse.eye_array(len(directions)))


def set_bolts(body: Any, places: Places, bolts: Sequence[Bolt]) -> None:
    """Add the forces of bolts to a body, and their stiffness across: (1).

    Args:
        body: the body; its `bolts`, its `tension` and its `couplings` change.
        places: its places.
        bolts: the bolts.

    Raises:
        SceneError: a place is not found, or head and nut have the same centre.
    """
    lines, rows = [], []
    for k, bolt in enumerate(bolts):
        ends = ((Place(group=getattr(bolt, end)), f"bolts[{k}].{end}") for end in ("head", "nut"))
        apart, line = _apart(places, *ends)
        length = float(np.linalg.norm(line))
        if length <= ROUNDING * body.extent:
            reason = "head and nut have the same centre, so the bolt has no direction"
            raise refuse(body.source, reason, ErrorKind.PLACE, f"bolts[{k}].nut")
        axis = (line / length)[: body.dimension]
        for end, inward in (("head", axis), ("nut", -axis)):
            _note_tilt(body, getattr(bolt, end), inward, f"bolts[{k}].{end}")
        body.tension -= bolt.force * (axis @ apart)
        if body.geometrically_nonlinear:
            across = bolt.force / length * (np.eye(body.dimension) - np.outer(axis, axis))
            body.couplings = csr_array(body.couplings + body.product(csr_array(apart), across))
        lines.append(line[: body.dimension])
        rows.append(csr_array(apart).toarray())
    if bolts:
        body.bolts = Bolts(np.array(lines), np.array(rows))
        _note_one_body(body, bolts, body.bolts.apart)


def _note_tilt(body: Any, group: str, inward: Array, key: str) -> None:
    """Warn of a head or nut whose face is not square to the pull (d,) of its bolt. Collective."""
    place = Place(group=group)
    if not body.mesh.has_facets(place):
        return
    nodal = pressure_vector(body, place).reshape(-1, body.dimension)
    pushed = body.comm.allreduce(nodal.sum(axis=0))
    size = float(np.linalg.norm(pushed))
    whole = body.comm.allreduce(float(np.linalg.norm(nodal, axis=1).sum()))
    if size < 0.5 * whole:  # a thread or another face without a direction
        return
    angle = np.degrees(np.arccos(np.clip(pushed @ inward / size, -1.0, 1.0)))
    if angle > TILTED:
        text = (
            f"the face of {key} = {group!r} is tilted by {angle:.0f}° to the line from head to "
            "nut, along which the bolt pulls: a part of its force pushes the bodies along one "
            "another; choose faces that are square to this line"
        )
        body.warnings.append(Note(NoteKind.WARNING, text, key))


def _note_one_body(body: Any, bolts: Sequence[Bolt], apart: Array) -> None:
    """Warn of bolts, by their R (b, d, local), whose head and nut are on one body. Collective.

    Their force meets no contact, unless this body has one with itself, as a clamp with a slit.
    """
    piece, d = node_pieces(body.mesh, body.space)[0].repeat(body.dimension), body.dimension
    contact = np.repeat(body.points.contact, d)
    sets = [*apart, *(body.contact_rows[contact == k] for k in np.unique(contact))]
    touched = [{*piece[csr_array(rows).indices].tolist()} for rows in sets]
    bodies = [set().union(*parts) for parts in zip(*body.comm.allgather(touched), strict=True)]
    of_contacts = bodies[len(bolts) :]
    for k, (bolt, held) in enumerate(zip(bolts, bodies, strict=False)):
        if len(held) == 1 and held not in of_contacts:
            text = f"bolts[{k}].head = {bolt.head!r} and bolts[{k}].nut = {bolt.nut!r} are on one "
            note = implausible(f"{text}body: the bolt presses no contact")
            body.warnings.append(Note(note.kind, note, f"bolts[{k}].nut"))


def _apart(places: Places, one: tuple[Place, str], other: tuple[Place, str]) -> tuple[Array, Array]:
    """R (d, local) of two places, each with its key, and x₂ − x₁ (3,)."""
    (rows, start), (others, end) = places.find(*one), places.find(*other)
    return others - rows, end - start
