"""Nonlinear static equilibria of a solid, with few factorisations.

A correction solves with a factor of the tangent stiffness that is kept while each correction is
smaller than the one before by `CONTRACTION`, in the energy norm. Otherwise the mixed tangent at the
current state (`fem.body.elasticity`, eq. 5) is factorised. Anderson's acceleration joins up to
five corrections with the same factor (Walker and Ni, SIAM J. Numer. Anal., 2011). The residual is
always that of the full equations, so the equilibrium does not depend on the tangents. Where this
fails, at a limit load, plain Newton with the tangent of each state follows.

A state near the equilibrium at speed, from a small reduced model of the undeformed body.

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

from functools import partial
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.base.linalg import Factorisation
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.online.kernels.dense import negative_eigenvalues, orthonormal
from fenicsrom.online.step import statics

CONTRACTION = 0.5
"""Largest ratio of two corrections with one factor.

The tangent of a large body and its factor cost as much as about twenty corrections; accelerated,
these gain as many digits as after a new factorisation.
"""

LAST_CORRECTIONS = 5
"""A factor is kept if, at the rate of the last two corrections, so many more will be enough."""

DEPTH = 4
"""Number of corrections before that Anderson's acceleration combines with the next one."""

LARGEST_WEIGHT = 1.0
"""Largest weight of a correction before in the next one: it halves or doubles a correction."""

EQUILIBRIUM_TOLERANCE = 1e-12
"""Error of an equilibrium in the energy norm, relative to its deflection: rounding of good meshes.

An iteration that stops to contract below `STATIC_TOLERANCE` has reached the rounding of its mesh.
"""

NEAR = 0.1
"""Largest correction that a factor of an earlier state may make, relative to the deflection."""

STATIC_ITERATIONS = 60
"""Largest number of corrections of a load step."""

STATIC_FACTORISATIONS = 25
"""Largest number of factorisations of a load step."""

STATIC_GROWTH = 1e6
"""Newton's decrement may grow by this factor; if it grows more, the load step is halved."""

STATIC_LAST_RESORT = 1e-15
"""Decrement in J that is accepted after `STATIC_ITERATIONS`."""

SMALLEST_LOAD_STEP = 2e-4
"""Load steps are halved down to this fraction of the load; then the iteration fails."""


class Statics:
    """Finds successive equilibria of a body, with one factor as long as the corrections contract.

    Every method is collective.
    """

    def __init__(
        self,
        body: ElasticBody,
        factor: Factorisation,
        overwrite: bool,
        tolerance: float = EQUILIBRIUM_TOLERANCE,
    ):
        """Start with the factor of a tangent stiffness of the body.

        Args:
            body: the body.
            factor: the factor.
            overwrite: whether other tangents may overwrite this factor and its matrix; otherwise
                they get their own, which `close` frees.
            tolerance: error of an equilibrium in the energy norm, relative to its deflection.
        """
        self._body, self._factor, self._tolerance = body, factor, tolerance
        self._overwrite, self._borrowed = overwrite, not overwrite
        self._plain = False  # Newton's method with the tangent of each state
        self._decrements: list[float] = []  # of the last attempt of Newton's method, J

    def close(self) -> None:
        """Free the factor that was made here."""
        if not self._overwrite and not self._borrowed:
            self._factor.destroy(matrix=True)

    def follow(
        self,
        u: Array,
        start: Array,
        load: Array,
        square: float | None = None,
        predicted: Array | None = None,
        pressed: float | None = None,
    ) -> Array:
        """Follow the equilibrium as load, Ω² and follower pressures change together.

        Args:
            u: (local,) equilibrium under the load `start` at Ω² = `square`.
            start: (local,) N.
            load: (local,) final load, N; the final Ω² is that of the rotating frame.
            square: rad²/s²; by default the final one.
            predicted: (local,) a state near the equilibrium under the final load, or None.
            pressed: the part of the static follower pressures that acts at u; by default the one
                that acts in the end.

        Returns:
            (local,) the equilibrium under the final load.

        Raises:
            ConvergenceError: a load step below `SMALLEST_LOAD_STEP` failed.
        """
        rotation, pressures = self._body.rotation, self._body.pressures
        goal = rotation.omega_squared if rotation else 0.0
        square = goal if square is None else square
        final = pressures.part
        pressed = final if pressed is None else pressed
        if predicted is not None:
            found = self._newton(predicted, load)
            if found is not None:
                return found
            self.renew(u)

        def solve(u: Array, part: float) -> Array | None:
            if rotation:
                rotation.omega_squared = square + part * (goal - square)
            pressures.part = pressed + part * (final - pressed)
            return self._newton(u, start + part * (load - start))

        begin = u
        u, reached = statics.in_load_steps(begin, solve, SMALLEST_LOAD_STEP)
        if reached < 1.0:  # at a limit load plain Newton jumps to the equilibrium after a snap
            self._plain = True
            u, reached = statics.in_load_steps(begin, solve, SMALLEST_LOAD_STEP)
            self._plain = False
        if reached < 1.0:
            what = "of the load"
            pressures.part = final
            if rotation:
                rotation.omega_squared = goal
                what += " and of the centrifugal force"
            raise ConvergenceError(
                f"static equilibrium: Newton's method converged up to {100.0 * reached:.4g} % "
                f"{what}, and then failed even with a load step below "
                f"{100.0 * SMALLEST_LOAD_STEP:g} %; without contacts between bodies, fenicsrom "
                "statics follows the equilibria past a limit load",
                u,
                decrements=self._decrements,
            )
        return u

    def finish(self, u: Array, load: Array) -> None:
        """Make the factor that of the tangent at an equilibrium u (local,), and check its residual.

        Raises:
            ConvergenceError: the tangent is singular, or the residual is too large.
        """
        if not self.renew(u):
            raise ConvergenceError("static equilibrium: the tangent stiffness is singular", u)
        residual = self._body.residual(u, load)
        decrement = abs(self._body.dot(residual, self._solve(residual)))
        step = _Step(self._body, load)
        step.note(u, decrement, 0.0)
        if not decrement <= max(statics.STATIC_TOLERANCE**2 * step.scale, STATIC_LAST_RESORT):
            raise ConvergenceError(
                "static equilibrium: the residual of the full equations has a work of "
                f"{decrement:.1e} J, which is too large",
                u,
                decrements=[*self._decrements, decrement],
            )

    def renew(self, u: Array, change: Array | None = None) -> bool:
        """Factorise the tangent at u (local,), or the mixed tangent after a change (local,) of u.

        Returns:
            False if it is singular.
        """
        try:
            if self._borrowed:
                matrix = self._factor.matrix.duplicate()
                self._body.tangent(u, matrix, change, symmetric=False)
                symmetric = self._body.symmetric
                self._factor = self._body.factorised(matrix, "fenicsrom_static", symmetric)
                self._borrowed = False
            else:
                self._body.tangent(u, self._factor.matrix, change, symmetric=False)
                self._factor.update()
        except ConvergenceError as error:
            if error.kind is ErrorKind.MEMORY:
                raise
            return False
        return True

    def _newton(self, start: Array, load: Array) -> Array | None:
        """The equilibrium (local,) under a load (local,) near a start, or None."""
        step = _Step(self._body, load)

        def correct(u: Array) -> statics.Correction | None:
            residual = self._body.residual(u, load)
            change = self._solve(residual)
            decrement = abs(self._body.dot(residual, change))
            if self._plain or step.needs_factor(decrement, self._tolerance):
                if step.factorisations == STATIC_FACTORISATIONS:
                    return None
                step.factorisations += 1
                step.forget()
                if not self.renew(u, None if self._plain else step.change):
                    return None
                change = self._solve(residual)
                decrement = abs(self._body.dot(residual, change))
            step.change = step.accelerated(residual, change)
            return step.change, decrement

        def converged(u: Array, decrement: float, first: float, last: float) -> bool:
            step.note(u, decrement, first)
            small = decrement <= statics.STATIC_TOLERANCE**2 * step.scale
            contracts = 0.0 < last and decrement <= CONTRACTION**2 * last
            coming = decrement * (decrement / last) if contracts else decrement
            return coming <= self._tolerance**2 * step.scale or (small and not contracts)

        limits = STATIC_ITERATIONS, STATIC_GROWTH, STATIC_LAST_RESORT
        return statics.newton(start, correct, converged, *limits, self._decrements)

    def _solve(self, residual: Array) -> Array:
        """Minus the inverse of the factorised tangent times a residual (local,)."""
        return -self._factor.solve(residual[:, None])[:, 0]


class _Step:
    """The history of the corrections of one load step."""

    def __init__(self, body: ElasticBody, load: Array):
        self._body, self._load = body, load
        self.change: Array | None = None
        self._last: tuple[Array, Array] | None = None
        self._differences: list[tuple[Array, Array, Array]] = []
        self.decrement, self.scale, self.factorisations = np.inf, 0.0, 0

    def note(self, u: Array, decrement: float, first: float) -> None:
        """Note a correction that led to u (local,)."""
        acting = self._load + self._body.tension + self._body.pressure_force(u)
        if self._body.rotation is not None:
            acting = acting + self._body.rotation.centrifugal_force(u)
        self.decrement = decrement
        self.scale = max(first, abs(self._body.dot(acting, u)))

    def needs_factor(self, decrement: float, tolerance: float) -> bool:
        """Whether a decrement is too large after the one before, and far from small enough."""
        rate = decrement / self.decrement if self.decrement > 0.0 else np.inf
        enough = tolerance**2 * self.scale
        slow = not rate <= CONTRACTION**2 and not (
            rate < 1.0 and decrement * rate**LAST_CORRECTIONS <= enough
        )
        far = not decrement <= NEAR**2 * self.scale and np.isfinite(self.decrement)
        return (slow or far) and not decrement <= max(
            enough, statics.STATIC_TOLERANCE**2 * self.scale
        )

    def forget(self) -> None:
        """Forget the earlier corrections with the factor."""
        self._last, self._differences = None, []

    def accelerated(self, residual: Array, change: Array) -> Array:
        """A correction (local,) combined with the earlier corrections of the same factor.

        Anderson's acceleration, in the energy norm of the factor: in the plane of the corrections
        it finds the smallest next one, if the body were linear.
        """
        if self._last is not None and self.change is not None:
            last_residual, last_change = self._last
            found = (residual - last_residual, change - last_change, self.change)
            self._differences = [*self._differences[1 - DEPTH :], found]
        self._last = residual, change
        for first in range(len(self._differences)):
            forces, gains, steps = np.array(self._differences[first:]).transpose(1, 2, 0)
            sizes = np.sqrt(np.maximum(-self._body.inner(forces, gains).diagonal(), 0.0))
            if not np.all(sizes > 0.0):
                continue
            products = -self._body.inner(forces / sizes, gains / sizes)
            works = -self._body.inner(forces / sizes, change[:, None])[:, 0]
            weights = np.linalg.lstsq(products, works)[0] / sizes
            if np.all(np.abs(weights) <= LARGEST_WEIGHT):
                return np.asarray(change - (steps + gains) @ weights)
        return change


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
    q = np.zeros(pushing.size)
    for part in np.arange(1, LOAD_STEPS + 1) / LOAD_STEPS:
        turning = elastic._replace(stiffness=elastic.stiffness - part * softening)
        forces = partial(statics.force_and_tangent, turning)
        found = statics.dense_newton(q, forces, part * pushing, ITERATIONS, GROWTH)
        if found is None or negative_eigenvalues(forces(found)[1]):
            return None
        q = found
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
    return orthonormal(vectors, products, INDEPENDENCE)
