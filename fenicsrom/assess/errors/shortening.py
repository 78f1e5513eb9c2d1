"""What stiffness damping takes from the shortening by bending.

A slender body that bends shortens without strain. In a basis, coordinates of modal derivatives hold
this shortening, and the nonlinear terms of the strain cancel their strain. The damping β K
(`fenicsrom.reduction.damping`) is linear and sees the strain of these coordinates alone: it takes
energy that no material takes, at any size of the basis and in the full model alike. At a resonance
the amplitude is too small by the share of this energy in all that the motion loses.

Of the coordinates q = (a, e) of modes a and derivatives e, the energy of the e is that which the a
cannot hold,

    ∫ β ėᵀ (K_ee − K_ea K_aa⁻¹ K_ae) ė dt.                                                      (1)
"""

import re

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.store.archive import StoredModel

LARGEST = 0.01
"""Largest share of (1) in the energy that a motion loses, from which the user is warned."""

DERIVATIVE = re.compile(r"\d+D|\d+[A-Z]\d+[A-Z]")
"""Labels of the coordinates of modal derivatives."""


def shortening_share(stored: StoredModel, motion: Motion) -> float:
    """The share of (1) in the energy that damping and friction take in the last period.

    Args:
        stored: a model.
        motion: its motion, with its coordinates.
    """
    model, factor = stored.model, stored.scene.damping.stiffness
    names = np.array([DERIVATIVE.fullmatch(label) is not None for label in stored.labels])
    if factor == 0.0 or not names.any() or motion.coordinates is None:
        return 0.0
    assert motion.coordinate_time is not None
    moved = np.diff(motion.coordinates, axis=0)
    lasting = np.diff(motion.coordinate_time)[:, None]

    def spent(damping: Array, change: Array) -> float:
        return float(np.sum((change @ damping) * change / lasting))

    k = model.elastic.stiffness
    among, other = k[np.ix_(names, names)], k[np.ix_(~names, names)]
    held = np.linalg.lstsq(k[np.ix_(~names, ~names)], other)[0]
    rubbed = motion.friction_dissipation[-len(motion.coordinates) :]
    damping = model.damping * model.mass + 0.5 * (model.velocity_matrix + model.velocity_matrix.T)
    lost = spent(damping, moved) + float(rubbed[-1] - rubbed[0])
    return factor * spent(among - other.T @ held, moved[:, names]) / lost if lost > 0.0 else 0.0


def shortening_notes(
    stored: StoredModel, motion: Motion, curve: str = "", quantity: str = ""
) -> list[Note]:
    """A note if the share is above `LARGEST`.

    Args:
        stored: a model.
        motion: its motion, with its coordinates.
        curve: title of the curve of the motion.
        quantity: what the note doubts.
    """
    if (share := shortening_share(stored, motion)) <= LARGEST:
        return []
    text = (
        f"{100.0 * share:.2g} % of the energy that the largest motion loses goes into "
        "damping.stiffness by the shortening of bent bodies, which has no strain (at most "
        f"{100.0 * LARGEST:g} % casts no doubt): at a resonance the amplitude is too small by as "
        "much, in the full model too; use damping.ratios or material.mass_damping"
    )
    return [Note(NoteKind.ERROR, text, "damping.stiffness", curve, quantity)]
