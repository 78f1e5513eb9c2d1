"""A problem: a model with everything that determines its motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import contacts_of
from fenicsrom.online.contact.surfaces import Contacts

WEAR_ROUNDING = 1e-9
"""Growth of a worn depth, relative to the largest one, that is rounding."""


class Problem(NamedTuple):
    """A model under its loads, its damping and its contacts, and how its motion is computed.

    Attributes:
        model: a `online.model.model.ReducedModel`, or any model with its operations.
        contacts: parameters of the P contact points, in the order of the model's contact
            displacements.
        time: a `fenicsrom.scene.Time`: scheme, step or tolerance, periods, steady tolerance and way
            to the steady state, or duration.
        period: period of the loads, s; None runs for `time.duration`.
        drift: derivatives of the data by the parameter of a family of problems, a
            `online.derivative.sensitivity.Drift`; None of a problem by itself.
        rest: (n,) coordinates of a state near which the model moves, from which the variables of a
            periodic motion are measured; None of q = 0.
    """

    model: Any
    contacts: Contacts
    time: Any
    period: Any
    drift: Any = None
    rest: Any = None

    @classmethod
    def of(cls, model: Any, scene: Any) -> Problem:
        """The problem of a model that has the loads and the damping of a scene.

        Raises:
            SceneError: as `contacts_of`.
        """
        return cls(model, contacts_of(scene, model.points), scene.time, scene.period)

    @property
    def dimension(self) -> int:
        """The dimension of space d."""
        return int(self.contacts.centre.shape[1])

    def settled(self) -> Problem:
        """The problem after all surfaces have approached the body."""
        contacts = self.contacts
        if contacts.times.size == 0:
            return self
        last = np.ascontiguousarray(contacts.approach[:, -1:])
        moved = contacts._replace(times=contacts.times[-1:].copy(), approach=last)
        return self._replace(contacts=moved)

    def with_own_wear(self, worn: Array | None = None) -> Problem:
        """The problem with its own copy of the worn depths, or of others (nodes,), in m.

        A march changes them.
        """
        coating = self.contacts.coating
        coating = coating._replace(worn=(coating.worn if worn is None else worn).copy())
        return self._replace(contacts=self.contacts._replace(coating=coating))

    def with_yield(self, factor: float) -> Problem:
        """The problem with layers of so many times the yield stress; infinitely many: elastic."""
        coating = self.contacts.coating
        coated = coating.cells > 0
        strength = np.where(coated, coating.yield_force, 1.0) * factor
        coating = coating._replace(yield_force=np.where(coated, strength, 0.0))
        return self._replace(contacts=self.contacts._replace(coating=coating))

    def has_worn_since(self, worn: Array) -> bool:
        """Whether a layer was worn since its depths were `worn` (nodes,), beyond rounding."""
        now = self.contacts.coating.worn
        return bool(np.any(now - worn > WEAR_ROUNDING * np.max(now, initial=0.0)))
