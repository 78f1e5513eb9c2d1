"""The masters: the directions of the contact forces for which static modes are computed.

With a few contact points, all their directions are masters. With many points, interface modes take
their place: the eigenvectors of the contact flexibility Bᵀ K⁻¹ B with the largest eigenvalues.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.online.kernels.symmetric import scaled
from fenicsrom.reduction.protocols import Structure

if TYPE_CHECKING:
    from scipy.sparse import csr_array

INDEPENDENCE = 1e-12
"""Smaller eigenvalues of the contact flexibility, relative to the largest, count as zero."""

DEPENDENT = 1e-11
"""A contact coordinate depends on others if the part of its flexibility that is its own, relative
to all of it, is smaller."""

IMMOBILE = 1e-14
"""A contact coordinate cannot move if its flexibility, relative to the largest, is smaller."""

DIRECT_DIRECTIONS = 60
"""With more contact directions, an iterative method finds the interface modes."""

GUARD_VECTORS = 4
"""Vectors of a block beyond the wanted ones, so that the last wanted ones converge sooner."""

INTERFACE_TOLERANCE = 1e-10
"""Largest residual of an interface mode, relative to the largest eigenvalue.

The eigenvalues have the square of this error.
"""


def master_directions(structure: Structure, masters: str | int) -> tuple[Array, Array]:
    """Give the master directions W of the contact forces and their attachment modes.

    Interface modes are the eigenvectors of Bᵀ K⁻¹ B with the largest eigenvalues. Among all sets of
    the same number of force combinations, their static responses are closest, in the energy norm,
    to the responses under all contact forces.

    Args:
        structure: the structure.
        masters: "all" directions that are independent, the "normal" ones of them, or a number of
            interface modes.

    Returns:
        Wᵀ Bᵀ (m, local), and the attachment modes K⁻¹ B W (local, m).

    Raises:
        SceneError: the supports forbid a contact direction.
    """
    rows = structure.contact_rows
    if rows.shape[0] == 0:
        return rows.toarray(), np.zeros((structure.local, 0))
    if masters == "normal":
        rows = rows[:: structure.dimension]
    if not isinstance(masters, str) and rows.shape[0] > DIRECT_DIRECTIONS:
        chosen = _interface_modes(structure, rows, masters)
        return np.asarray(chosen.T @ rows), structure.factor.solve(rows.T @ chosen)
    attachment = structure.factor.solve(rows.T.toarray())
    flexibility = structure.inner(rows.T, attachment)
    _check_mobile(structure, np.diag(flexibility))
    if isinstance(masters, str):
        kept = independent_coordinates(flexibility)
        return rows.toarray()[kept], attachment[:, kept]
    values, vectors = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    independent = int(np.sum(values > INDEPENDENCE * values[-1]))
    chosen = _with_sign(vectors[:, ::-1][:, : min(masters, independent)])
    return np.asarray(chosen.T @ rows), attachment @ chosen


def _with_sign(vectors: Array) -> Array:
    """Vectors (m, k) whose largest component is positive."""
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(vectors.shape[1])]
    return vectors * np.where(largest < 0.0, -1.0, 1.0)


def _interface_modes(structure: Structure, rows: csr_array, count: int) -> Array:
    """The eigenvectors (m, count) of Bᵀ K⁻¹ B with the largest eigenvalues, by few solves.

    The block Lanczos method finds them, with full orthogonalisation.

    Raises:
        SceneError: the supports forbid a contact direction.
    """
    # a direction that the supports forbid moves no free unknown
    _check_mobile(structure, structure.comm.allreduce(rows.multiply(rows).sum(axis=1)))
    m = rows.shape[0]
    block = np.random.default_rng(0).standard_normal((m, count + GUARD_VECTORS))
    basis, images = np.zeros((m, 0)), np.zeros((m, 0))
    while True:
        for _ in range(2):
            block = block - basis @ (basis.T @ block)
            block = np.linalg.qr(block)[0]
        block = block[:, : m - basis.shape[1]]
        image = structure.inner(rows.T, structure.factor.solve(rows.T @ block))
        basis = np.concatenate([basis, block], axis=1)
        images = np.concatenate([images, image], axis=1)
        projected = basis.T @ images
        values, vectors = np.linalg.eigh(0.5 * (projected + projected.T))
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        errors = np.linalg.norm(images @ vectors - basis @ vectors * values, axis=0)
        independent = values > INDEPENDENCE * values[0]
        if basis.shape[1] == m or np.all(errors[independent] <= INTERFACE_TOLERANCE * values[0]):
            return _with_sign(basis @ vectors[:, independent])
        block = image


def independent_coordinates(flexibility: Array) -> list[int]:
    """The coordinates that move independently of the ones before them.

    Two stops on both sides of one point share its displacement: the first one gives the coordinate.

    Args:
        flexibility: (m, m) Bᵀ K⁻¹ B of the contact coordinates.
    """
    products, kept = scaled(flexibility), list[int]()
    for k in range(len(products)):
        row = products[kept, k]
        alone = products[k, k] - row @ np.linalg.solve(products[np.ix_(kept, kept)], row)
        if alone > DEPENDENT:
            kept.append(k)
    return kept


def _check_mobile(structure: Structure, mobility: Array) -> None:
    """Check that no entry of the mobility (m,) of the contact coordinates is zero.

    Raises:
        SceneError: the supports forbid the motion of a coordinate.
    """
    contact = structure.points.contact
    d = mobility.size // len(contact)
    for k in np.flatnonzero(~(mobility > IMMOBILE * np.max(mobility))):
        key = f"contacts[{contact[k // d]}]"
        reason = f"the supports forbid direction {k % d + 1} of [normal, tangents] of the contact "
        reason += "point; move it away from the supports"
        raise refuse(structure.source, reason, ErrorKind.PLACE, key)
