"""A state near the equilibrium at speed, from a small reduced model of the undeformed body.

The tension of a rotating body stiffens it. The linear displacement of the body lacks this
stiffening and is several times too large. It is a bad start for Newton's method, of which each
tangent costs an assembly and a factorisation. The factor of the undeformed body is there anyway. It
gives the basis

    x_1 = K⁻¹ p,    x_{k+1} = K⁻¹ M x_k,    θ_kl = −K⁻¹ K′[x_k] x_l,    (1)

where p are the loads with the centrifugal force on the undeformed body. The vectors x_k approximate
the modes in which p moves the body, and the static derivatives θ_kl describe how the body stretches
as these vectors bend it (Idelsohn and Cardona, Comput. Methods Appl. Mech. Eng. 49, 1985). The
equilibrium of the elastic polynomial in this basis is within a few percent of that of the body, for
less than the cost of a factorisation. Newton's method for the full equations starts there.

The equilibrium in the basis is followed from rest in `LOAD_STEPS` steps. It is therefore the one
that the body reaches as it spins up, also above a critical speed. If it loses its stability on this
path, there is no prediction.
"""

from typing import Any

import numpy as np
import scipy.linalg

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.symmetric import negative_eigenvalues
from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.online.step.newton import Correction, newton, small_against_load

UNKNOWNS = 10_000
"""With fewer unknowns, the factorisations that a prediction saves cost less than the prediction."""

KRYLOV_VECTORS = 4
"""Number of the x_k: with their 10 derivatives they leave an error of 1 % on a fan blade."""

QUADRATURE_DEGREE = 2
"""Degree of the rule that integrates the polynomial; the error of the basis is larger."""

INDEPENDENCE = 1e-10
"""Smaller eigenvalues of the products of the scaled basis in the energy norm count as zero."""

ITERATIONS = 20
"""Largest number of Newton iterations of a load step in the basis."""

GROWTH = 1e8
"""There is no prediction if Newton's decrement grows by this factor."""

LOAD_STEPS = 10
"""Number of steps in which load and Ω² grow; Newton's method needs few iterations in each."""


def predicted_equilibrium(body: Any) -> Array | None:
    """Predict the equilibrium of a rotating body. Collective.

    Args:
        body: the undeformed body with its factor; no static follower pressures act.

    Returns:
        (local,) a state near the equilibrium, or None if the basis has no path of stable equilibria
        from rest.
    """
    rotation = body.rotation
    assert rotation is not None
    rest = np.zeros(body.local)
    load = body.static_load + rotation.centrifugal_force(rest)
    vectors = _basis(body, load)
    elastic = body.strain_polynomial(vectors, QUADRATURE_DEGREE)
    pushing = body.inner(vectors, load[:, None])[:, 0]
    softening = rotation.omega_squared * body.inner(vectors, rotation.mass_times(vectors))
    force, tangent = np.empty(pushing.size), np.empty(softening.shape)

    def solve(start: Array, part: float) -> Array | None:
        """The equilibrium in the basis under a part of the loads."""

        def correct(q: Array) -> Correction | None:
            elastic_force(elastic, q, force, tangent)
            residual = force - part * (pushing + softening @ q)
            try:
                change = -np.linalg.solve(tangent - part * softening, residual)
            except np.linalg.LinAlgError:
                return None
            return change, abs(float(residual @ change))

        def converged(q: Array, decrement: float, first: float, last: float) -> bool:
            return small_against_load(decrement, first, float(pushing @ q))

        return newton(start, correct, converged, ITERATIONS, GROWTH)

    q = np.zeros(pushing.size)
    for part in np.arange(1, LOAD_STEPS + 1) / LOAD_STEPS:
        found = solve(q, float(part))
        if found is None:
            return None
        q = found
        elastic_force(elastic, q, force, tangent)
        if negative_eigenvalues(tangent - part * softening):
            return None
    return np.asarray(vectors @ q)


def _basis(body: Any, load: Array) -> Array:
    """The basis (1) (local, n) of a load (local,), orthonormal in the energy norm."""
    vectors = body.factor.solve(load[:, None])
    for _ in range(KRYLOV_VECTORS - 1):
        more = body.factor.solve(body.mass_times(vectors[:, -1:]))
        vectors = np.concatenate([vectors, more], axis=1)
    vectors = _orthonormal(body, vectors)
    rest, (first, second) = np.zeros(body.local), np.triu_indices(vectors.shape[1])
    changes = [
        body.derivative_at(rest, vectors[:, i], vectors[:, j])
        for i, j in zip(first, second, strict=True)
    ]
    derivatives = body.factor.solve(np.array(changes).T)
    return _orthonormal(body, np.concatenate([vectors, derivatives], axis=1))


def _orthonormal(body: Any, vectors: Array) -> Array:
    """Vectors with the span of others (local, k), orthonormal in the energy norm at rest."""
    products = body.inner(vectors, body.stiffness_times(vectors))
    scale = 1.0 / np.sqrt(np.diag(products))
    values, directions = scipy.linalg.eigh(products * np.outer(scale, scale))
    kept = values > INDEPENDENCE
    return np.asarray(vectors @ (scale[:, None] * directions[:, kept] / np.sqrt(values[kept])))
