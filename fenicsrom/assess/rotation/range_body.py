"""A body of which only the model for a range of speeds is known, for its modes at any of them."""

from __future__ import annotations

from dataclasses import MISSING
from typing import TYPE_CHECKING

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.notes import Note, NoteKind
from fenicsrom.reduction.beam import DenseBody
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.online.step.speed_range import RangeModel
    from fenicsrom.online.store.archive import StoredModel


class RangeBody(DenseBody):
    """A range model in its equilibrium at one speed: what the modes of a body need.

    Its vectors have the n coordinates of the range model.

    Attributes:
        whole: the range model.
        free: n.
        warnings: sentences for the user.
        equilibrium: (n,) coordinates of the equilibrium.
        gyroscopic: (n, n) gyroscopic matrix at this speed; None without the Coriolis force.
    """

    def __init__(self, whole: RangeModel, omega: float):
        """Store the range model and move to the equilibrium at a speed in rad/s."""
        self.whole, self.free = whole, whole.model.size
        self.mass, self.warnings = whole.model.mass, list[Note]()
        self.spin(omega)

    def spin(self, omega: float) -> None:
        """Move to the equilibrium at another speed in rad/s.

        Raises:
            ConvergenceError: there is no equilibrium.
        """
        self.equilibrium = self.whole.equilibrium(omega)
        self.stiffness = self.whole.tangent(omega, self.equilibrium)
        coriolis = self.whole.coriolis
        self.gyroscopic = omega * coriolis if coriolis.size else None

    @property
    def factor(self) -> RangeBody:
        """The inverse of the stiffness, which `solve` applies."""
        return self

    def solve(self, block: Array) -> Array:
        """The inverse of the stiffness times a block (n, k)."""
        return np.asarray(np.linalg.solve(self.stiffness, block), np.float64)

    def eigenmodes(self, inverse: object, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (n, count)."""
        squares, modes = scipy.linalg.eigh(
            self.stiffness, self.mass, subset_by_index=(0, count - 1)
        )
        return squares, modes

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of a contact point or of the probe in each column (n, k)."""
        model = self.whole.model
        d = model.points.frame.shape[2]
        moved = np.concatenate([model.contact_rows, model.probe]) @ block
        return np.linalg.norm(moved.reshape(-1, d, block.shape[1]), axis=1).max(axis=0, initial=0.0)


def range_body(stored: StoredModel, speeds: Array) -> RangeBody:
    """The body of a stored model at the first of some speeds (k,), rev/min.

    Raises:
        SceneError: the model is for one speed, or a speed is out of its range.
        ConvergenceError: there is no equilibrium at the first speed.
    """
    source, whole = stored.file or stored.scene.source, stored.whole
    if whole is None:
        reason = "the model is for one speed; build it for a range of speeds, or run the diagram "
        reason += "of the scene without --from"
        raise Where(source, "rotation.speeds_rpm").refuse(MISSING, reason)
    first, last = 30.0 / np.pi * whole.speeds[[0, -1]]
    out = speeds[(speeds < first) | (speeds > last)]
    if out.size:
        allowed = f"must be in the range of the model, {first:g} to {last:g} rpm"
        raise Where(source, "campbell.speeds_rpm").refuse(float(out[0]), allowed)
    found = RangeBody(whole, np.pi / 30.0 * float(speeds[0]))
    asked = stored.scene.campbell.modes
    if asked is not None and asked > whole.modes:
        text = (
            f"campbell.modes = {asked}: the diagram has the "
            f"{counted(whole.modes, 'mode')} of the basis; for more, build the model with a larger "
            "basis.modes"
        )
        found.warnings.append(Note(NoteKind.REMARK, text, "campbell.modes"))
    return found
