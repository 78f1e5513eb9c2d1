"""Whether small motions about an equilibrium grow: the roots of the whole pencil.

A small motion obeys M q̈ + D q̇ + K q = 0, and q = φ exp(λ t) with

    (λ² M + λ D + K) φ = 0.    (1)

If K is positive definite and D takes no energy from outside, no motion grows. If K is not, (1)
decides. The Coriolis forces, the skew part of D, may hold an equilibrium that K does not hold, as
that of a shaft above its critical speed. Damping that turns with the body then makes a whirl grow
(Thomson and Tait; Bolotin, Nonconservative Problems of the Theory of Elastic Stability, 1963).
"""

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array

ROUNDING = 1e-6
"""A real part below this, relative to the absolute value of its root, is rounding."""

SMALLEST = 1e-13
"""A real part below this, relative to the largest root, is rounding."""


def roots(mass: Array, velocity: Array, stiffness: Array) -> NDArray[np.complex128]:
    """The roots λ (2 n,) of (1), 1/s.

    Args:
        mass: (n, n) M.
        velocity: (n, n) D; (0, 0) without such forces.
        stiffness: (n, n) K.
    """
    return np.asarray(np.linalg.eigvals(state_matrix(mass, velocity, stiffness)), np.complex128)


def state_matrix(mass: Array, velocity: Array, stiffness: Array) -> Array:
    """The matrix (2 n, 2 n) of d/dt (q, q̇), whose eigenvalues are the roots; as `roots`."""
    n = mass.shape[0]
    damped = velocity if velocity.size else np.zeros((n, n))
    lower = np.linalg.solve(mass, np.concatenate([-stiffness, -damped], axis=1))
    return np.concatenate([np.eye(n, 2 * n, n), lower])


def growing(mass: Array, velocity: Array, stiffness: Array) -> NDArray[np.complex128]:
    """The roots of (1) whose motions grow, the fastest first; arguments as `roots`."""
    found = roots(mass, velocity, stiffness)
    size = np.abs(found)
    grows = found[found.real > ROUNDING * size + SMALLEST * size.max(initial=0.0)]
    return grows[np.argsort(-grows.real, kind="stable")]
