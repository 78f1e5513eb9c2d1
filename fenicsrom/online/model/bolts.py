"""The bolts of a reduced model, whose forces may change: `fenicsrom.fem.body.attachments`, (1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.polynomial import ElasticPolynomial


class Bolts(NamedTuple):
    """How head and nut of b bolts move apart.

    Attributes:
        line: (b, d) from the head to the nut, m.
        apart: (b, d, 1 + n) how far the nut moves from the head at q = 0, m, and by coordinates; of
            a body (b, d, local), by its displacements.
    """

    line: Array
    apart: Array

    def moved(self, change: Callable[[Array], Array]) -> Bolts:
        """The bolts with other rows (b d, 1 + n), by a change of them."""
        found = change(self.apart.reshape(-1, self.apart.shape[2]))
        return self._replace(apart=found.reshape(*self.line.shape, found.shape[1]))

    def pulled(self, elastic: ElasticPolynomial, forces: Array, across: bool) -> ElasticPolynomial:
        """An elastic force to which these forces (b,) in N are added; `across` with the F/l."""
        force, stiffness = elastic.force.copy(), elastic.stiffness.copy()
        for k in range(len(self.line)):
            pull, line, apart = forces[k], self.line[k], self.apart[k]
            length = float(np.linalg.norm(line))
            axis, rows = line / length, apart[:, 1:]
            force += pull * (axis @ rows)
            if across:
                turned = pull / length * (rows - np.outer(axis, axis @ rows)).T
                force += turned @ apart[:, 0]
                stiffness += turned @ rows
        return elastic._replace(force=force, stiffness=stiffness)


def no_bolts(d: int, columns: int) -> Bolts:
    """No bolts, with rows of so many columns."""
    return Bolts(np.zeros((0, d)), np.zeros((0, d, columns)))
