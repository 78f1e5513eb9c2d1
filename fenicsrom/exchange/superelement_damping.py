"""The damping of a superelement, from its file and from the table [damping].

A damping matrix of the file that is proportional to the mass becomes the factor α of the model. Any
other damping matrix, with its symmetric and its skew (gyroscopic) part, is a matrix D of forces D
v. To this matrix the table [damping] of the scene adds

    β K + Σ_k 2 ζ_k ω_k (M φ_k) (M φ_k)ᵀ                                              (1)

with the normal modes φ_k of the superelement, as `fenicsrom.reduction.damping` does for a body.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.exchange.matrix_set import SYMMETRY
from fenicsrom.scene import Damping

PROPORTIONAL = 1e-8
"""Largest part of the damping matrix, relative to it, that may not be proportional to the mass.

Files have ten significant digits or more.
"""


def damping_parts(given: Array | None, mass: Array) -> tuple[float, Array]:
    """The damping matrix of a file as the factor α, 1/s, and the rest D (n, n), kg/s.

    Args:
        given: (n, n) the damping matrix, or None.
        mass: (n, n) M.

    Raises:
        ValueError: the matrix gives energy to a motion.
    """
    none = np.zeros_like(mass)
    if given is None or not np.any(given):
        return 0.0, none
    alpha = float(np.vdot(given, mass) / np.vdot(mass, mass))
    off = float(np.linalg.norm(given - alpha * mass))
    if alpha >= 0.0 and off <= PROPORTIONAL * float(np.linalg.norm(given)):
        return alpha, none
    rates, vectors = np.linalg.eigh(0.5 * (given + given.T))
    if rates[0] < -SYMMETRY * float(np.max(np.abs(given))):
        raise ValueError("the damping matrix of the file gives energy to the motion")
    dissipative = (vectors * np.maximum(rates, 0.0)) @ vectors.T
    return 0.0, np.asarray(dissipative + 0.5 * (given - given.T))


def table_matrix(damping: Damping, mass: Array, stiffness: Array) -> Array:
    """The matrix (1) (n, n) of the table [damping], kg/s.

    Raises:
        ValueError: there are more damping ratios than modes.
    """
    ratios = np.array(damping.modal)
    if ratios.size > len(mass):
        raise ValueError(f"{ratios.size} damped modes are too many: there are {len(mass)}")
    squares, modes = scipy.linalg.eigh(stiffness, mass)
    rates = 2.0 * ratios * np.sqrt(squares[: ratios.size])
    moved = mass @ modes[:, : ratios.size]
    return np.asarray(damping.stiffness * stiffness + (moved * rates) @ moved.T)
