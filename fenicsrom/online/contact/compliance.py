"""How the displacements of contact points respond to forces at them: the Delassus operator.

With the rows R (m, n) of the contact displacements, forces F move the coordinates by -Z F and the
contact displacements by -G F,

    Z = S^-1 R^T,    G = R Z,                                                                   (1)

where S is the effective stiffness of the step. For more forces than coordinates, G has no full
rank and is not formed. Newton's equation (I + G F') u = -r, with the derivatives F' of the forces
and the residual r, then becomes

    u = -r + R dz,    (I + Z F' R) dz = Z F' r                                                  (2)

by the identity of Sherman, Morrison and Woodbury (Hager 1989, SIAM Review 31, 221-239).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.state import ContactScratch
from fenicsrom.online.kernels.compiled import kernel, part
from fenicsrom.online.kernels.dense import add_combined_rows, lu_factor, lu_solve


class Compliance(NamedTuple):
    """The response of c contact points in d dimensions, of all P with m = P d directions.

    Attributes:
        rows: (m, n) R of all points; (0, 0) if all of G is given.
        unit: (n, m + 1) its first c d columns hold Z.
        delassus: (m, m) its first c d rows and columns hold G, or only its blocks (d, d) on the
            diagonal where `is_formed` is False.
        change: (n, 1) scratch: change of the coordinates.
        weighted: (n, m) scratch: Z F' of the points that touch.
        gathered: (m, n) scratch: the rows of some points.
        jacobian: (n, n) scratch: the matrix of (2).
        pivots: (n,)
    """

    rows: Array
    unit: Array
    delassus: Array
    change: Array
    weighted: Array
    gathered: Array
    jacobian: Array
    pivots: NDArray[np.int64]


def compliance_of(rows: Array, delassus: Array | None = None) -> Compliance:
    """A `Compliance` of contact rows (m, n), with arrays for its results; or of a given G."""
    m, n = rows.shape
    return Compliance(
        rows=rows,
        unit=np.zeros((n, m + 1)),
        delassus=np.zeros((m, m)) if delassus is None else delassus,
        change=np.zeros((n, 1)),
        weighted=np.zeros((n, m)),
        gathered=np.zeros((m, n)),
        jacobian=np.zeros((n, n)),
        pivots=np.zeros(n, dtype=np.int64),
    )


def given_compliance(delassus: Array) -> Compliance:
    """The `Compliance` of a given G (c d, c d)."""
    return compliance_of(np.zeros((0, 0)), np.ascontiguousarray(delassus))


def delassus_of(compliance: Compliance) -> Array:
    """G (m, m) of a response of all points."""
    m, n = compliance.rows.shape
    return compliance.rows @ compliance.unit[:, :m] if m > n else compliance.delassus


@part
def is_formed(compliance: Compliance, size: int) -> bool:
    """Whether G is formed for so many directions."""
    n = compliance.rows.shape[1]
    return n == 0 or size <= n


@part
def form_delassus(rows: Array, compliance: Compliance, directions: NDArray[np.int64]) -> None:
    """Write all of G for the rows (m, n) of the directions (c d,) whose columns Z holds."""
    count, gathered, delassus = directions.size, compliance.gathered, compliance.delassus
    for i in range(count):
        for a in range(gathered.shape[1]):
            gathered[i, a] = rows[directions[i], a]
        for j in range(count):
            delassus[i, j] = 0.0
    add_combined_rows(gathered[:count], compliance.unit[:, :count], delassus[:count, :count])


@kernel
def add_response(
    compliance: Compliance, candidates: NDArray[np.int64], count: int, scratch: ContactScratch
) -> None:
    """Add G F to the residual of the candidates, from the forces at `count` touching points."""
    rows, unit, z, d = compliance.rows, compliance.unit, compliance.change, len(scratch.space)
    for a in range(rows.shape[1]):
        z[a, 0] = 0.0
        for t in range(count):
            place = scratch.touching[t]
            for j in range(d):
                z[a, 0] += unit[a, place * d + j] * scratch.mean_force[candidates[place], j]
    for p in candidates:
        for k in range(d):
            for a in range(rows.shape[1]):
                scratch.residual[p, k] += rows[p * d + k, a] * z[a, 0]


@kernel
def update_in_coordinates(
    compliance: Compliance, candidates: NDArray[np.int64], count: int, scratch: ContactScratch
) -> bool:
    """Turn the residual of all candidates into Newton's update by (2); False if it has none."""
    rows, unit, jacobian = compliance.rows, compliance.unit, compliance.jacobian
    weighted, dz, n, d = compliance.weighted, compliance.change, rows.shape[1], len(scratch.space)
    for a in range(n):
        dz[a, 0] = 0.0
        for b in range(n):
            jacobian[a, b] = 1.0 if a == b else 0.0
        for t in range(count):
            place = scratch.touching[t]
            p = candidates[place]
            for j in range(d):
                value = 0.0
                for i in range(d):
                    value += unit[a, place * d + i] * scratch.force_derivative[p, i, j]
                weighted[a, t * d + j] = value
                dz[a, 0] += value * scratch.residual[p, j]
    for t in range(count):
        row = candidates[scratch.touching[t]] * d
        for j in range(d):
            for b in range(n):
                compliance.gathered[t * d + j, b] = rows[row + j, b]
    add_combined_rows(weighted, compliance.gathered[: count * d], jacobian)
    if not lu_factor(jacobian, compliance.pivots, n):
        return False
    lu_solve(jacobian, compliance.pivots, dz, n, 1)
    for p in candidates:
        for k in range(d):
            value = -scratch.residual[p, k]
            for a in range(n):
                value += rows[p * d + k, a] * dz[a, 0]
            scratch.residual[p, k] = value
    return True
