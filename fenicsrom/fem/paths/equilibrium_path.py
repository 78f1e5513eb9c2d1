"""Paths of static equilibria: pseudo-arclength continuation in a load factor.

The equilibria u(λ) of

    r(u, λ) = f(u) − p₀ − λ p = 0    (1)

with the tangent stiffness K = ∂r/∂u form a curve in (u, λ), which is followed through limit points,
where λ turns back. Follower pressures are parts of p₀ and p that depend on u. Under them K may not
be symmetric (`fem.body.loads`); the negative pivots are then those of its symmetric part.

The points of bodies that touch open, slip and stick; their sliders follow at each equilibrium. The
path may turn there at once, in a short step. Negative pivots are those with constant friction.
Lengths are those of

    |(du, dλ)|² = |du|² / size² + dλ² / scale².    (2)

Size and scale are the displacement and the load factor of a point, or those of a linear body at the
end of the range or at the displacement `FARTHEST`, if these are larger.

The curve is extrapolated by the cubic through its last two points with their tangents. Newton's
method corrects the guess on the hyperplane normal to a direction c. Each correction solves the
bordered equations by block elimination, with one factor of the tangent stiffness K:

    K a = −r,    K b = p,    dλ = (gap − c·a) / (c·b + c_λ),    du = a + dλ b,    (3)

where gap is the distance to the hyperplane (Riks 1979; Crisfield 1981). The factor is kept while
the corrections become smaller by `CONTRACTION`; otherwise the mixed tangent is factorised
(`fem.body.elasticity`, eq. 5). At the point found, the exact tangent corrects once more. Its
negative pivots count the directions in which the equilibrium is unstable. The number of negative
pivots changes by one at a limit point, where the tangent of the curve has no component along λ; any
other change is a bifurcation, where a mode of K has the eigenvalue zero.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.fem.base.linalg import Factorisation, multiply
from fenicsrom.fem.equilibrium.statics import CONTRACTION
from fenicsrom.fem.solid.solid import Solid
from fenicsrom.online.contact.state import SLIP
from fenicsrom.online.curves.curve import Bracket, bracketed, hermite

INVERSE_ITERATIONS = 4
"""Solves for the eigenvalue of K nearest to zero; they start from the mode of the point before."""


class PathEquations:
    """The equations (1) of a body with a factor of K. Every method is collective.

    Attributes:
        slope: (local,) K⁻¹ p with the factor.
        contact: the contacts of bodies that touch, or None.
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
        self.contact = body.let_rub()
        symmetric = not (np.any(self._constant) or np.any(self._varied) or self.contact)
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

    def states(self, y: Array) -> NDArray[np.int8]:
        """The states (P,) of the contact points at y (local + 1,); none without contact."""
        return self.contact.states(y[:-1]) if self.contact else np.zeros(0, np.int8)

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


LIMIT_POINT, BIFURCATION = "limit point", "bifurcation"

FIRST_STEP, LARGEST_STEP, SMALLEST_STEP = 0.02, 0.1, 1e-6
"""Steps along the curve, with the lengths (2)."""

SHORTER = 0.1
"""Factor of the lengths where a special point lies within the first step of a path."""

SHORTEST = 1e-6
"""Least load factor that sets the lengths, in parts of the last one."""

FARTHEST = 3.0
"""Largest linear displacement of a node, in parts of the extent of the mesh, that sets the lengths.

A path to a larger load factor begins with the lengths of this one: steps in parts of the whole
path would miss what happens on it."""

STRAIGHT = 0.97
"""Least cosine of the angle between the tangents of two neighbours."""

KINK = 1e-3
"""A step is so short where the path may turn at once, as a contact point opens, closes or slips."""

AWAY = 0.1
"""Longest correction of a guess, in parts of the step."""

AIM = 0.02
"""Correction, in parts of the step, at which the step stays; it grows with its third power."""

REACH = 4.0
"""Longest step that the cubic extrapolates, in parts of the distance of its points."""

LONGEST = 1.0
"""Length of a correction above which the tangent is renewed: contact points may have closed."""

CORRECTIONS, RENEWALS = 30, 6
"""Largest numbers of corrections and of mixed tangents at one point."""

TOLERANCE = 1e-9
"""Length of the last correction; that with the exact tangent follows and is much shorter."""

ROUNDING = 1e-7
"""A shorter correction that does not contract has reached the rounding of a slender mesh."""

SLIDING, FLAT = "sliding", 1e-7
"""A path ends where friction no longer holds a body: points slip, and the load factor grows by
less than this part of a step."""

LOCATED = 1e-5
"""Width of the bracket of a special point. The load factor of a limit point is stationary there,
so its error is about the square of this."""

GAPS = (1e-4, 1e-3)
"""Distances from a bifurcation at which points are found where those nearer to it are not: the
rounding of the mesh is an imperfection that parts the branches."""


@dataclass(frozen=True, eq=False)
class PathPoint:
    """An equilibrium on the path.

    Attributes:
        y: (local + 1,) displacement u in m, and the load factor λ.
        tangent: (local + 1,) direction of the path, of length one in (2).
        negative: number of negative pivots of K.
        softness: size of the eigenvalue of K nearest to zero, N/m.
        residual: length (2) of the last correction, with the exact tangent of the equations (1).
        states: (P,) OPEN, SLIP or STICK of the contact points.
        kind: "" of an ordinary point, else `LIMIT_POINT` or `BIFURCATION`.
    """

    y: Array
    tangent: Array
    negative: int
    softness: float
    residual: float
    states: NDArray[np.int8]
    kind: str = ""

    @property
    def load_factor(self) -> float:
        """λ."""
        return float(self.y[-1])

    @property
    def displacement(self) -> Array:
        """Displacement u (local,), m."""
        return self.y[:-1]


def _has_kink(a: PathPoint, b: PathPoint) -> bool:
    """Whether a contact point opens, closes, slips or sticks between two points of the path."""
    return not np.array_equal(a.states, b.states)


class PathFollower:
    """Follows the equilibria of a body. Every method is collective.

    Attributes:
        reason: why the path ended: "end of the range" or `SLIDING`; "" before.
        longest: the longest step along the path, with the lengths (2).
        equations: the equations (1).
    """

    reason, longest = "", LARGEST_STEP

    def __init__(self, body: Solid, sizes: Array, lowest: float, last: float):
        """Start from the equilibrium of the body, at the load factor zero.

        Args:
            body: the body in its equilibrium under constant loads, which may be none.
            sizes: (loads,) sizes of the loads that λ multiplies, 0 of the others.
            lowest: λ at which the path ends, below zero.
            last: λ at which the path ends, above zero.

        Raises:
            ConvergenceError: the tangent stiffness is singular at the start.
        """
        self._body, self.equations = body, PathEquations(body, sizes)
        self._lowest, self._last = lowest, last
        slope = self.equations.slope
        fastest = float(body.largest(slope[:, None])[0])
        self._first_scale = min(last, FARTHEST * body.mesh.extent() / fastest)
        self._linear = self._first_scale * np.sqrt(body.dot(slope, slope))
        self._size, self._scale = self._linear, self._first_scale

    def points(self) -> Iterator[PathPoint]:
        """Yield the equilibria in the order of the path, special points among them.

        Raises:
            ConvergenceError: the first point was not found, or no step leads on from a point.
        """
        here = self._start()
        before, step, first = None, FIRST_STEP, True
        yield here
        while not self.reason:
            self._measure(here)
            guess = self._guess(before, here, step)
            found = self._next(here, guess, step)
            if first and found is not None and self._shorten(here, found):
                continue
            ends = found is not None and not self._lowest <= found.load_factor <= self._last
            if found is not None and ends:
                found = self._end(here, found)
            special = None if found is None else self._special(here, found)
            if found is None or special is None:
                step *= 0.4
                if step < SMALLEST_STEP:
                    raise ConvergenceError("no step along the path converged")
                continue
            yield from special
            if self.equations.contact:
                self.equations.contact.hold(found.displacement)
            if ends or self._slides(found):
                self.reason = "end of the range" if ends else SLIDING
            yield found
            away = self._length(found.y - guess) / step
            step *= float(np.clip((AIM / max(away, 1e-12)) ** (1.0 / 3.0), 0.5, 2.0))
            step = min(step, self.longest)
            first, before, here = False, None if _has_kink(here, found) else here, found

    # ------------------------------------------------------------------ lengths

    def _dot(self, a: Array, b: Array) -> float:
        """Inner product of (2)."""
        along = self._body.dot(a[:-1], b[:-1]) / self._size**2
        return along + float(a[-1] * b[-1]) / self._scale**2

    def _length(self, a: Array) -> float:
        return float(np.sqrt(self._dot(a, a)))

    def _measure(self, here: PathPoint) -> None:
        """Set the lengths (2) to those of this point or of the start, the larger ones."""
        self._scale = max(self._first_scale, abs(here.load_factor))
        u = here.displacement - self._body.equilibrium
        self._size = max(self._linear, float(np.sqrt(self._body.dot(u, u))))

    def _shorten(self, here: PathPoint, found: PathPoint) -> bool:
        """Make the lengths shorter if a special point lies within the first step.

        The lengths are the unit in which special points are located.

        Returns:
            Whether they were made shorter; the step is then to be taken again.
        """
        if found.negative == here.negative or self._first_scale < SHORTEST * self._last:
            return False
        self._first_scale *= SHORTER
        self._linear *= SHORTER
        return True

    def _unit(self, a: Array) -> Array:
        return np.asarray(a / self._length(a))

    # ------------------------------------------------------------------ one step

    def _start(self) -> PathPoint:
        """The point at λ = 0.

        Raises:
            ConvergenceError: the start was not found.
        """
        y = np.append(self._body.equilibrium, 0.0)
        found = self._correct(y, self._upwards(), self._upwards())
        if found is None:
            raise ConvergenceError("no equilibrium was found without the loads of the path")
        return found

    def _upwards(self) -> Array:
        """The direction of λ alone (local + 1,)."""
        return np.append(np.zeros(self._body.local), self._scale)

    def _guess(self, before: PathPoint | None, here: PathPoint, step: float) -> Array:
        """The unknowns (local + 1,) a step beyond a point, which may have one before it."""
        tangent = self._unit(here.tangent)
        if before is None:
            return np.asarray(here.y + step * tangent)
        length = self._length(here.y - before.y)
        share = 1.0 + min(step, REACH * length) / length
        return hermite(before.y, here.y, self._unit(before.tangent), tangent, length, share)

    def _next(self, here: PathPoint, guess: Array, step: float) -> PathPoint | None:
        """The point near a guess (local + 1,), or None to ask for a shorter step."""
        tangent = self._unit(here.tangent)
        found = self._correct(guess, tangent, tangent)
        if found is None or (step <= KINK and _has_kink(here, found)):
            return found
        turn = self._dot(self._unit(found.tangent), tangent)
        straight = turn >= STRAIGHT and self._length(found.y - guess) <= AWAY * step
        return found if straight else None

    def _slides(self, point: PathPoint) -> bool:
        """Whether a body slides at a point under a load that does not grow: K is singular there."""
        rises = abs(point.tangent[-1]) / self._scale
        return bool(np.any(point.states == SLIP)) and rises < FLAT

    def _end(self, here: PathPoint, beyond: PathPoint) -> PathPoint | None:
        """The point on the bound of the range between two points; None if it is not found."""
        bound = self._last if beyond.load_factor > self._last else self._lowest
        share = (bound - here.load_factor) / (beyond.load_factor - here.load_factor)
        guess = self._between_guess([here, beyond], share)
        guess[-1] = bound
        return self._correct(guess, self._upwards(), self._unit(beyond.y - here.y))

    # ------------------------------------------------------------------ corrections

    def _correct(self, guess: Array, along: Array, ahead: Array) -> PathPoint | None:
        """The point of the path on a hyperplane; None if it is not found.

        Args:
            guess: (local + 1,) a point of the hyperplane.
            along: (local + 1,) its normal in (2).
            ahead: (local + 1,) a direction on whose side the tangent of the path is taken.
        """
        y, last, renewals = guess.copy(), LONGEST / CONTRACTION, 0
        change: Array | None = None
        for _ in range(CORRECTIONS):
            correction = self._correction(y, guess, along)
            length = self._length(correction)
            if not length <= max(CONTRACTION * last, ROUNDING):
                renewals += 1
                if renewals > RENEWALS or not self.equations.renew(y, change):
                    return None
                correction = self._correction(y, guess, along)
                length = self._length(correction)
            if not length <= LONGEST:
                return None
            y = y + correction
            change = correction[:-1]
            if length <= TOLERANCE or (length <= ROUNDING and length > CONTRACTION * last):
                return self._exact(y, guess, along, ahead)
            last = length
        return None

    def _exact(self, y: Array, guess: Array, along: Array, ahead: Array) -> PathPoint | None:
        """The point after one more correction, with the exact tangent; None if it is not small."""
        if not self.equations.renew(y, None):
            return None
        correction = self._correction(y, guess, along)
        residual = self._length(correction)
        if not residual <= ROUNDING:
            return None
        counted = self.equations.count(y)
        if counted is None:
            return None
        tangent = self._unit(np.append(self.equations.slope, 1.0))
        tangent *= np.sign(self._dot(tangent, ahead)) or 1.0
        y = y + correction
        return PathPoint(y, tangent, *counted, residual, self.equations.states(y))

    def _correction(self, y: Array, guess: Array, along: Array) -> Array:
        """The correction (3) (local + 1,) at y (local + 1,)."""
        fixed = np.append(-self.equations.solve(self.equations.residual(y)), 0.0)
        path = np.append(self.equations.slope, 1.0)
        gap = self._dot(along, guess - y)
        return np.asarray(fixed + (gap - self._dot(along, fixed)) / self._dot(along, path) * path)

    # ------------------------------------------------------------------ special points

    def _special(self, a: PathPoint, b: PathPoint) -> list[PathPoint] | None:
        """The special points between two points of the path; None if one was not located."""
        change = b.negative - a.negative
        if self._slides(b):
            return []
        if a.tangent[-1] * b.tangent[-1] >= 0.0:
            return self._bifurcations(a, b) if change else []
        bracket = self._bracket(lambda point: float(point.tangent[-1]), a, b)
        if bracket is None:
            return None
        limit = [replace(bracket.nearest, kind=LIMIT_POINT)]
        if abs(change) == 1:
            return limit
        first = self._bifurcations(a, bracket.before)
        last = self._bifurcations(bracket.after, b)
        return None if first is None or last is None else first + limit + last

    def _bifurcations(self, a: PathPoint, b: PathPoint) -> list[PathPoint] | None:
        """Where the number of negative pivots changes between two points, in their order.

        The eigenvalue of a rank is a continuous function along the path. The eigenvalue whose rank
        is the larger number of negative pivots passes zero.
        """
        if a.negative == b.negative or self._length(b.y - a.y) <= 2.0 * LOCATED:
            return []
        rank = max(a.negative, b.negative)
        bracket = self._bracket(
            lambda point: -point.softness if point.negative >= rank else point.softness, a, b
        )
        if bracket is None:
            return None
        first = self._bifurcations(a, bracket.before)
        last = self._bifurcations(bracket.after, b)
        if first is None or last is None:
            return None
        return [*first, replace(bracket.nearest, kind=BIFURCATION), *last]

    def _bracket(
        self, test: Callable[[PathPoint], float], a: PathPoint, b: PathPoint
    ) -> Bracket[PathPoint] | None:
        """Bracket the change of sign of a function between two points."""
        chord = self._unit(b.y - a.y)

        def between(points: list[PathPoint], ends: list[float], arc: float) -> PathPoint | None:
            for at in (arc, *(arc + side * gap for gap in GAPS for side in (1.0, -1.0))):
                if not ends[0] < at < ends[1]:
                    continue
                guess = self._between_guess(points, (at - ends[0]) / (ends[1] - ends[0]))
                guess += (at - self._dot(chord, guess - a.y)) * chord
                found = self._correct(guess, chord, chord)
                if found is not None:
                    return found
            return None

        return bracketed(between, test, a, b, self._length(b.y - a.y), LOCATED, 2.0 * GAPS[-1])

    def _between_guess(self, points: list[PathPoint], share: float) -> Array:
        """The cubic (local + 1,) between two points."""
        first, last = points
        length = self._length(last.y - first.y)
        ahead = [self._unit(point.tangent) for point in points]
        return hermite(first.y, last.y, ahead[0], ahead[1], length, share)
