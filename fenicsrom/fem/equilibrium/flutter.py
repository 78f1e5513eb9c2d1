"""Stability of an equilibrium under follower pressures, which may have no potential.

The tangent K = K_s + K_a then has a skew part K_a, by the free edges of the loaded surfaces. The
squares ω² of the angular frequencies without damping are those of

    (K_s + K_a) φ = ω² M φ.    (1)

A real negative one is divergence, as in buckling; a pair of complex ones is flutter. The lowest are
found by Galerkin's method with the modes Φ of the symmetric part and their corrections K_s⁻¹ K_a Φ.
Source: Bolotin, Nonconservative Problems of the Theory of Elastic Stability, 1963.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.reduction.projection import COUPLING

MODES = 8
"""Number of modes Φ besides those with negative squares; half as many squares are judged."""

DEPENDENT = 1e-10
"""Smaller eigenvalues of the mass matrix of scaled vectors are rounding."""

IMAGINARY = 1e-6
"""A smaller imaginary part, relative to the absolute value, is the rounding of a double root."""


def check_coupling(body: Any, negative: int) -> int:
    """Warn if the follower pressures couple the modes. Collective.

    Args:
        body: the body in its equilibrium under static follower pressures.
        negative: number of negative eigenvalues of the symmetric part of the stiffness.

    Returns:
        Number of directions of divergence, at most `negative`.
    """
    count = min(negative + MODES, body.free - 1)
    try:
        squares, modes = body.eigenmodes(body.factor, count)
    except (ConvergenceError, AccuracyError):
        return negative
    coupled = _coupled_squares(body, modes)[: negative + MODES // 2]
    squares = squares[: coupled.size]
    flutters = np.abs(coupled.imag) > IMAGINARY * np.abs(coupled)
    frequencies = np.sqrt(np.abs(coupled)) / (2.0 * np.pi)
    if np.any(flutters):
        body.flutters = True
        body.warnings.append(
            "the follower pressure makes the body flutter without damping, at "
            f"{frequencies[flutters].min():.4g} Hz: it is not conservative, because the loaded "
            "surface has a free edge"
        )
        return int(np.sum(coupled[~flutters].real < 0.0))
    squared = np.sort(coupled.real)
    changes = np.abs(np.sqrt(np.abs(squared / squares)) - 1.0)
    if negative or changes.max() > COUPLING:
        body.warnings.append(
            "the follower pressure is not conservative, because the loaded surface has a free "
            "edge: the modes are those of the symmetric part of the stiffness; the other part "
            f"changes the lowest frequencies by up to {100.0 * changes.max():.2g} %, the first one "
            f"to {np.sqrt(np.abs(squared[0])) / (2.0 * np.pi):.4g} Hz"
        )
    return int(np.sum(squared < 0.0))


def _coupled_squares(body: Any, modes: Array) -> NDArray[np.complex128]:
    """The squares ω² of (1) for modes Φ (local, k) of the symmetric part, by absolute value."""

    def skew_times(block: Array) -> Array:
        at, sizes = body.equilibrium, body.pressures.static
        symmetric = body.pressures.tangent_times(at, block, sizes, symmetric=True)
        return np.asarray(symmetric - body.pressures.tangent_times(at, block, sizes))

    found = np.concatenate([modes, body.factor.solve(skew_times(modes))], axis=1)
    found /= np.maximum(np.sqrt(np.diag(body.mass_inner(found, found))), np.finfo(float).tiny)
    values, axes = np.linalg.eigh(body.mass_inner(found, found))
    kept = values > DEPENDENT
    vectors = found @ (axes[:, kept] / np.sqrt(values[kept]))
    stiffness = body.inner(vectors, body.stiffness_times(vectors))
    squares = np.linalg.eigvals(stiffness + body.inner(vectors, skew_times(vectors)))
    return np.asarray(squares[np.argsort(np.abs(squares))], dtype=np.complex128)
