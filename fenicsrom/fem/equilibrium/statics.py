"""Nonlinear static equilibria of a solid, with few factorisations.

A correction solves with a factor of the tangent stiffness that is kept while each correction is
smaller than the one before by `CONTRACTION`, in the energy norm. Otherwise the mixed tangent at the
current state (`fem.body.elasticity`, eq. 5) is factorised. Anderson's acceleration joins up to
five corrections with the same factor (Walker and Ni, SIAM J. Numer. Anal., 2011). The residual is
always that of the full equations, so the equilibrium does not depend on the tangents. Where this
fails, at a limit load, plain Newton with the tangent of each state follows.
"""

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.fem.base.linalg import Factorisation
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.online.step.newton import STATIC_TOLERANCE, Correction, in_load_steps, newton

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
        u, reached = in_load_steps(begin, solve, SMALLEST_LOAD_STEP)
        if reached < 1.0:  # at a limit load plain Newton jumps to the equilibrium after a snap
            self._plain = True
            u, reached = in_load_steps(begin, solve, SMALLEST_LOAD_STEP)
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
                f"{100.0 * SMALLEST_LOAD_STEP:g} %; fenicsrom statics follows the equilibria "
                "past a limit load",
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
        if not decrement <= max(STATIC_TOLERANCE**2 * step.scale, STATIC_LAST_RESORT):
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
                self._factor = Factorisation(matrix, "fenicsrom_static", symmetric)
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

        def correct(u: Array) -> Correction | None:
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
            small = decrement <= STATIC_TOLERANCE**2 * step.scale
            contracts = 0.0 < last and decrement <= CONTRACTION**2 * last
            coming = decrement * (decrement / last) if contracts else decrement
            return coming <= self._tolerance**2 * step.scale or (small and not contracts)

        limits = STATIC_ITERATIONS, STATIC_GROWTH, STATIC_LAST_RESORT
        return newton(start, correct, converged, *limits, self._decrements)

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
        acting = self._load + self._body.pressure_force(u)
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
        return (slow or far) and not decrement <= max(enough, STATIC_TOLERANCE**2 * self.scale)

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
