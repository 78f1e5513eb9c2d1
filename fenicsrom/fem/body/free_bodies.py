"""Bodies that nothing holds: their rigid motions R, and what is refused of them.

The loads p of such a body accelerate it. The rest

    (I − M R Rᵀ) p,    Rᵀ M R = 1,                                                        (1)

is in balance with the inertia forces of this acceleration. It deforms the body, and moves it
relative to its rigid motion.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.body.supports import free_motions, loose
from fenicsrom.notes import Note, NoteKind
from fenicsrom.scene import Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import counted

ROUNDING = 1e-9
"""A smaller part of a load that deforms a free body, or of its rigid motions, counts as zero."""


def free_motions_of(body: Any, scene: Scene, springs: Sequence[csr_array]) -> Array:
    """The rigid motions (local, r) that neither supports nor springs hold. Collective.

    Args:
        body: the body.
        scene: its scene.
        springs: as `free_motions`.

    Raises:
        SceneError: they are free although there are supports; or something would move the body
            along them for ever, or hold it: a static load, a wall, a rotation or a dashpot to the
            ground; or it is a sector with a contact.
    """
    found = free_motions(body, springs)
    motions: Array = found.fields @ found.free
    if body.cut is not None:  # the others are no motions of the whole disk
        alike, across = (body.cut.waves_among(h, motions) for h in (0, 1))
        motions = np.hstack([alike.real, across.real, across.imag])
    if not motions.shape[1]:
        return motions
    if scene.supports:
        raise loose(body, found)
    dragged = abs(body.coupled(body.dashpots, motions))
    size = max(body.comm.allgather(float(body.dashpots.data.max(initial=0.0))))
    given = {
        "rotation": body.cut is None and scene.rotation,
        "contacts": body.cut is not None and scene.contacts,
        "static loads": [one for one in scene.loads if one.static or one.follower],
        "walls": [one for one in scene.contacts if one.against is None],
        "dashpots to the ground": body.comm.allreduce(bool((dragged > ROUNDING * size).any())),
    }
    for key, table in given.items():
        if table:
            raise _drifting(body, motions, f"a scene with {key}")
    return motions


def require_held(body: Any, where: str) -> None:
    """Refuse a free body.

    Args:
        body: the body, with its `free_motions`.
        where: what it would drift in, for the message.

    Raises:
        SceneError: the body is free.
    """
    if body.free_motions.shape[1]:
        raise _drifting(body, body.free_motions, where)


def require_small(body: Any) -> None:
    """Refuse motions of a free body in large displacements, which would turn it.

    Raises:
        SceneError: the body is free, and displacements may be large.
    """
    if body.geometrically_nonlinear:
        require_held(body, "large displacements (geometrically_nonlinear = true)")


def _drifting(body: Any, motions: Array, where: str) -> SceneError:
    """The error of rigid motions (local, r) that nothing holds."""
    allowed = (
        f"{counted(motions.shape[1], 'rigid motion')} would let the body drift in "
        f"{where}: hold it by supports or by springs to the ground; free bodies are allowed in "
        "fenicsrom modes and, with geometrically_nonlinear = false, in run, sweep, response, "
        "backbone and ringdown, without static loads, walls, [rotation] and dashpots to the "
        "ground; free disks ([cyclic]) in modes and campbell, without contacts"
    )
    return Where(body.source, "supports").refuse([], allowed, ErrorKind.SUPPORT)


def mass_orthonormal(body: Any, motions: Array) -> Array:
    """Combinations R (local, r) of independent motions (local, r) with Rᵀ M R = 1. Collective."""
    if not motions.shape[1]:
        return motions
    values, vectors = np.linalg.eigh(body.mass_inner(motions, motions))
    return np.asarray(motions @ vectors / np.sqrt(values))


def balanced_loads(body: Any, loads: Array) -> Array:
    """The part (1) of load vectors (local, k) in N; all of them of a body that is held. Collective.

    Raises:
        SceneError: a load deforms nothing.
    """
    if not body.rigid.shape[1]:
        return loads
    turned = body.inner(body.rigid, loads)
    found = loads - body.mass_times(body.rigid) @ turned
    sizes = [np.sqrt(body.comm.allreduce(np.sum(a**2, 0))) for a in (found, loads)]
    for k in np.flatnonzero(sizes[0] <= ROUNDING * sizes[1]):
        reason = "it deforms nothing: it moves the body, which nothing holds, as a rigid one"
        raise refuse(body.source, reason, ErrorKind.SUPPORT, f"loads[{k}]")
    if np.any(turned):
        count = counted(len(turned), "rigid motion")
        text = f"nothing holds the body: its {count} are left out, and displacements are "
        text += "relative to them"
        body.warnings.append(Note(NoteKind.REMARK, text, "supports"))
    return np.asarray(found)
