"""Static responses to loads that the modes of a basis leave out.

A load p that varies slowly moves the structure by K⁻¹ p. The static response within a basis R does
only a part of the work of K⁻¹ p. The share of the work that the basis leaves out is

    share = 1 − pᵀ R (Rᵀ K R)⁻¹ Rᵀ p / (pᵀ K⁻¹ p).    (1)

The share is the relative error of the displacement at the load, in the direction of the load. It is
also the square of the relative error of the response in the energy norm. The lowest modes of a
slender body bend it. An axial load does no work on these modes, and its share is 1.

An oblique load does nearly all its work by bending, so that (1) does not see its axial part. With
the part pₐ of the load along the axis a, the relative error of the displacement at the load along
this axis is

    share = |pₐᵀ (K⁻¹ p − R (Rᵀ K R)⁻¹ Rᵀ p)| / |pₐᵀ K⁻¹ p|.    (2)

The largest share counts. If it is above `LOAD_SHARE`, the static response K⁻¹ p (an attachment
mode: Rubin 1975; mode acceleration corrects the same error after the run) joins the basis. A linear
basis always holds the static responses (`LINEAR_SHARE`): there a coordinate costs little. The cost
of a nonlinear one grows with the fourth power of its coordinates; smaller shares are candidates
(`fenicsrom.reduction.candidates`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.loads import OMEGA
from fenicsrom.reduction.protocols import Structure

LOAD_SHARE = 0.05
"""Largest share of a static response that may be left out; the accepted error by the basis."""

LINEAR_SHARE = 1e-6
"""The same in a linear model: smaller shares are rounding."""

LOAD_PART = 0.05
"""A load acts along an axis if its part along this axis has this size, relative to the load.

A smaller direction does not count by itself, as in the estimates of the errors.
"""


@dataclass(frozen=True, eq=False)
class LoadVectors:
    """Static responses that complete a basis.

    Attributes:
        labels: (k,) labels: 1L is the response to the first load of the scene.
        vectors: (local, k) responses to unit loads.
        shares: largest share, (1) or (2), that the modes leave out, by the label of each load that
            varies.
    """

    labels: tuple[str, ...]
    vectors: Array
    shares: dict[str, float]


def varying_loads(structure: Structure) -> list[int]:
    """The numbers, from 0, of the loads that vary in time."""
    histories, found = structure.load_histories, []
    for k in range(len(histories.spans)):
        first, last, row, end = map(int, histories.spans[k])
        if end > row or np.any(histories.sines[first:last, OMEGA] != 0.0):
            found.append(k)
    return found


def load_responses(structure: Structure) -> Array:
    """K⁻¹ p (local, k) of the loads that vary."""
    numbers = varying_loads(structure)
    if not numbers:
        return np.zeros((structure.local, 0))
    return structure.factor.solve(np.ascontiguousarray(structure.load_vectors[:, numbers]))


def load_vectors(structure: Structure, basis: Array, responses: Array) -> LoadVectors:
    """Choose the static responses that a basis leaves out.

    Args:
        structure: the structure.
        basis: (local, n) static modes and normal modes.
        responses: (local, k) K⁻¹ p of the loads that vary (`load_responses`).

    Returns:
        The responses to add. A response that earlier ones contain is not added again.
    """
    limit = LOAD_SHARE if structure.geometrically_nonlinear else LINEAR_SHARE
    labels: list[str] = []
    shares: dict[str, float] = {}
    chosen: list[int] = []
    for column, number in enumerate(varying_loads(structure)):
        load = structure.load_vectors[:, [number]]
        label = f"{number + 1}L"
        vectors = np.concatenate([basis, responses[:, chosen]], axis=1)
        shares[label] = _share_left_out(structure, vectors, load, responses[:, [column]])
        if shares[label] > limit:
            chosen.append(column)
            labels.append(label)
    return LoadVectors(tuple(labels), responses[:, chosen], shares)


def _share_left_out(structure: Structure, vectors: Array, load: Array, response: Array) -> float:
    """The largest share, (1) or (2), for a load (local, 1) with its response (local, 1)."""
    inner = structure.inner
    work = float(inner(load, response)[0, 0])
    if vectors.shape[1] == 0 or work <= 0.0:
        return float(work > 0.0)
    stiffness = inner(vectors, structure.held_times(vectors))
    size = np.sqrt(np.abs(np.diag(stiffness)))
    scaled = stiffness / np.outer(size, size)
    # nearly dependent vectors (static and normal modes): the pseudo-inverse drops round-off
    q = np.linalg.lstsq(scaled, inner(vectors, load)[:, 0] / size, rcond=1e-12)[0] / size
    missing = response - vectors @ q[:, None]
    parts = load * structure.translations()
    sizes = np.sqrt(np.diag(inner(parts, parts)))
    parts = parts[:, sizes > LOAD_PART * np.linalg.norm(sizes)]
    parts = np.concatenate([load, parts], axis=1)
    whole, left_out = np.abs(inner(parts, response)[:, 0]), np.abs(inner(parts, missing)[:, 0])
    return float(np.max(left_out[whole > 0.0] / whole[whole > 0.0]))
