"""The equations of an equilibrium path, their tangent, and its unstable directions.

The equilibria of a body under the loads p₀ + λ p solve

    r(u, λ) = f(u) − p₀ − λ p = 0    (1)

with the tangent stiffness K = ∂r/∂u. Follower pressures are parts of p₀ and p that depend on u.
Under them K may not be symmetric (`fem.body.pressure`); the negative pivots are then those of
its symmetric part.
"""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.base.linalg import Factorisation, multiply
from fenicsrom.fem.solid.solid import Solid

INVERSE_ITERATIONS = 4
"""Solves for the eigenvalue of K nearest to zero; they start from the mode of the point before."""


class PathEquations:
    """The equations (1) of a body with a factor of K. Every method is collective.

    Attributes:
        slope: (local,) K⁻¹ p with the factor.
        asymmetry: largest size of the part of K that is not symmetric, by its action on the slope,
            relative to the stiffness against p at the start.
    """

    asymmetry = 0.0

    def __init__(self, body: Solid, sizes: Array):
        """Factorise K at the equilibrium of the body.

        Args:
            body: the body in its equilibrium under p₀.
            sizes: (loads,) sizes of the loads of p, 0 of the others.

        Raises:
            ConvergenceError: K is singular.
        """
        self._body, dead, numbers = body, sizes.copy(), body.pressures.numbers
        dead[numbers] = 0.0
        self._constant, self._varied = body.pressures.static.copy(), sizes[numbers]
        symmetric = not (np.any(self._constant) or np.any(self._varied))
        self._force = body.load_vectors @ dead
        matrix = body.tangent(body.equilibrium, symmetric=False)
        self._factor = Factorisation(matrix, "fenicsrom_path", symmetric, counting=symmetric)
        self._counter = self._factor
        if not symmetric:
            half = body.tangent(body.equilibrium)
            self._counter = Factorisation(half, "fenicsrom_path_pivots", counting=True)
        first, _ = matrix.getOwnershipRange()
        self._soft = body.without_held(np.sin(1.0 + first + np.arange(body.local, dtype=float)))
        force = self._loads(body.equilibrium)
        self.slope = self.solve(force)
        self._stiffness = self._size(force) / self._size(self.slope)

    def residual(self, y: Array) -> Array:
        """The residual (local,) of (1) at y = (u, λ) (local + 1,)."""
        self._set_factor(y)
        return self._body.residual(y[:-1], self._body.static_load + y[-1] * self._force)

    def solve(self, right: Array) -> Array:
        """K⁻¹ times a vector (local,), with the factor."""
        return self._factor.solve(right[:, None])[:, 0]

    def renew(self, y: Array, change: Array | None) -> bool:
        """Factorise K at y (local + 1,); the mixed tangent after a change (local,) of u.

        Returns:
            False if it is singular.
        """
        self._set_factor(y)
        self._body.tangent(y[:-1], self._factor.matrix, change, symmetric=False)
        try:
            self._factor.update()
        except ConvergenceError:
            return False
        self.slope = self.solve(self._loads(y[:-1]))
        return True

    def count(self, y: Array) -> tuple[int, float] | None:
        """The negative pivots of the factor, which is that of K at y (local + 1,).

        Returns:
            Their number, and the size of the eigenvalue nearest to zero, N/m; None if the symmetric
            part of K is singular.
        """
        if self._counter is not self._factor:
            self._body.tangent(y[:-1], self._counter.matrix)
            try:
                self._counter.update()
            except ConvergenceError:
                return None
            whole, half = (multiply(f.matrix, self.slope) for f in (self._factor, self._counter))
            part = self._size(whole - half) / (self._stiffness * self._size(self.slope))
            self.asymmetry = max(self.asymmetry, part)
        size = 0.0
        for _ in range(INVERSE_ITERATIONS):
            self._soft = self._counter.solve(self._soft[:, None])[:, 0]
            size = self._size(self._soft)
            self._soft /= size
        return self._counter.negative_pivots, 1.0 / size

    def _set_factor(self, y: Array) -> None:
        """Make the follower pressures of the body those at λ."""
        self._body.pressures.static = self._constant + y[-1] * self._varied

    def _loads(self, u: Array) -> Array:
        """The loads p (local,) at a displacement u (local,), N."""
        if not np.any(self._varied):
            return self._force
        return np.asarray(self._force + self._body.pressures.unit_forces(u) @ self._varied)

    def _size(self, a: Array) -> float:
        return float(np.sqrt(self._body.dot(a, a)))
