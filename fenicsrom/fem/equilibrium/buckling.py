"""Stability of a static equilibrium, and a stable equilibrium near an unstable one.

An equilibrium is stable if its tangent stiffness K has no negative eigenvalue; the pivots of a
factorisation count the negative ones (Sylvester's law of inertia). From an unstable equilibrium the
body is pushed along its mode with the most negative ω². It then follows

    c M (u₁ − u₀) + f(u₁) = load    (1)

downhill in its energy. With c = 2 |ω²| the push doubles in each step; once K is positive definite,
c decreases, and Newton's method finds the equilibrium.

A body that snaps through jumps to a distant stable equilibrium. The body then moves much farther
than the tangent stiffness before the jump predicts. Where the whole displacement is larger than the
linear one, the loads grow again in small steps, and each change is compared with its prediction. A
step with a jump is halved, because Newton's method may jump before the limit point in a long step;
a true jump stays in one of the halves.

Follower pressures may have no potential. The tangent K = K_s + K_a then has a skew part K_a, by the
free edges of the loaded surfaces. The squares ω² of the angular frequencies without damping are
those of

    (K_s + K_a) φ = ω² M φ.    (2)

A real negative one is divergence, as in buckling; a pair of complex ones is flutter. The lowest are
found by Galerkin's method with the modes Φ of the symmetric part and their corrections K_s⁻¹ K_a Φ.
Source: Bolotin, Nonconservative Problems of the Theory of Elastic Stability, 1963.

Coriolis forces may hold an equilibrium whose stiffness has negative eigenvalues, as that of a shaft
above its critical speed. There the roots of the whole pencil decide (`online.model.pencil`), by
Galerkin's method with Φ and K⁻¹ G Φ.
"""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from fenicsrom.arrays import Array
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.fem.base.linalg import Factorisation, multiply, negative_eigenvalues
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.kernels.dense import orthonormal
from fenicsrom.online.model.pencil import growing
from fenicsrom.online.step.statics import Correction, downhill, newton, small_against_load
from fenicsrom.reduction import basis
from fenicsrom.words import counted

PUSH = 1e-3
"""Largest displacement of the push, relative to the extent of the body."""

SIDE = 1e-6
"""A smaller cosine between the push and the loads is rounding: they push to no side."""

ITERATIONS = 15
"""Largest number of Newton iterations of a step."""

SOFTENING = 2.0
"""The body may have snapped if its displacement, relative to the linear one, is larger."""

LOAD_STEPS = 20
"""Number of steps in which the loads grow again."""

JUMP = 4.0
"""A change that exceeds its prediction by this factor is a jump: before a limit point, where the
displacement changes like the square root of the load, the factor is at most 2."""

HALVINGS = 10
"""So often is a step with a jump halved. A jump stays in one of the halves; a steep growth, as that
of a column with a small imperfection just below its buckling load, is spread over them."""

GROWTH = 1e6
"""A step fails if Newton's decrement grows by this factor."""


def check_stability(body: Any) -> int:
    """Leave an unstable equilibrium for a stable one nearby, with a warning. Collective.

    A body with contacts keeps its equilibrium, which they may stabilise: the motion starts from the
    equilibrium with contacts (`fenicsrom.online.step.statics`).

    Args:
        body: the body in its equilibrium.

    Returns:
        Number of directions in which the equilibrium was unstable.

    Raises:
        ConvergenceError: the tangent stiffness is singular.
    """
    if body.symmetric:
        unstable = body.factor.negative_eigenvalues()
    else:
        unstable = check_coupling(body, negative_eigenvalues(body.factor.matrix))
    if not unstable:
        return 0
    if body.gyroscopic is not None and (whirling := _whirling(body, unstable)) is not None:
        return whirling
    if body.rotation is not None and body.gyroscopic is None:
        _warn(
            body,
            "rotation.coriolis = false leaves out the Coriolis forces, which hold a shaft above "
            "its critical speed: set it to true to judge whether the body is stable",
        )
    directions = counted(unstable, "direction")
    if body.points.contact.size:
        _warn(
            body,
            f"without its contacts the body is unstable under the static loads, in {directions}",
        )
        return unstable
    first = _probe_text(body)
    stable = _stable_equilibrium(body, unstable)
    if stable is None:
        _warn(
            body,
            f"the static equilibrium is unstable in {directions}, and no stable one was found near "
            "it: the loads are beyond the buckling load",
        )
        return unstable
    body.equilibrium = stable
    body.tangent(stable, body.factor.matrix)
    body.factor.update()
    _warn(
        body,
        f"the static loads buckle the body: the equilibrium that they reach from the undeformed "
        f"body displaces the probe by {first} and is unstable in {directions}, so the run takes a "
        f"stable equilibrium near it, which displaces the probe by {_probe_text(body)}; a "
        "symmetric body has a second one on the other side",
    )
    return unstable


def _whirling(body: Any, negative: int) -> int | None:
    """Number of growing roots of an equilibrium that Coriolis forces hold. Collective.

    Damping that turns with the body may make it whirl; this gives a warning.

    Args:
        body: the body in its equilibrium.
        negative: number of negative eigenvalues of its stiffness.

    Returns:
        None if the Coriolis forces do not hold the equilibrium, or if its modes were not found.
    """
    try:
        modes = body.eigenmodes(body.factor, min(negative + MODES, body.free - 1))[1]
    except (ConvergenceError, AccuracyError):
        return None
    moved = body.factor.solve(body.gyroscopic_times(modes))
    space = basis.extended_space(body.mass_inner, modes, moved)
    mass, stiffness = np.eye(space.shape[1]), body.inner(space, body.held_times(space))
    if growing(mass, basis.projected_gyroscopic(body, space), stiffness).size:
        return None
    damped = body.mass_damping * mass + basis.projected_velocity_matrix(body, space)
    found = growing(mass, damped, stiffness)
    if found.size:
        turn = 2.0 * np.pi / abs(body.rotation.omega)
        _warn(
            body,
            "the body turns above a critical speed, and damping that turns with it makes it whirl: "
            f"a small whirl grows by {100.0 * np.expm1(found[0].real * turn):.2g} % in a "
            "revolution; damping by bearings that stand still is not part of the model",
        )
    return int(found.size)


def check_snap(body: Any, linear: Array) -> None:
    """Warn if the body jumps as the static loads grow. Collective.

    Args:
        body: the body in its equilibrium, not rotating.
        linear: (local,) linear displacement under the static loads, m.
    """

    def size(u: Array) -> float:
        return float(np.sqrt(body.dot(u, multiply(body.mass, u))))

    if size(body.equilibrium) <= SOFTENING * size(linear):
        return
    full = body.static_load
    pushing = full + body.pressure_force(body.equilibrium)
    factor = body.factorised(body.tangent(body.equilibrium), "fenicsrom_snap")

    def at(part: float, u: Array) -> Array:
        body.pressures.part = part
        return body.static(part * full, u)

    def grown(u: Array, begin: float, end: float, halvings: int) -> Array | None:
        """The equilibrium at a larger load, on the path that u is on; None beyond a jump."""
        try:
            new = at(end, u)
        except ConvergenceError:
            new = None
        if new is not None:
            body.tangent(u, factor.matrix)
            factor.update()
            predicted = size(factor.solve((end - begin) * pushing[:, None])[:, 0])
            if size(new - u) <= JUMP * predicted:
                return new
        if not halvings:
            return None
        middle = 0.5 * (begin + end)
        half = grown(u, begin, middle, halvings - 1)
        return None if half is None else grown(half, middle, end, halvings - 1)

    u = np.zeros(body.local)
    try:
        for k in range(LOAD_STEPS):
            begin, end = k / LOAD_STEPS, (k + 1) / LOAD_STEPS
            new = grown(u, begin, end, HALVINGS)
            if new is None:
                _warn(
                    body,
                    f"the body snaps through between {100.0 * begin:g} % and {100.0 * end:g} % of "
                    "the static loads: the equilibrium is one after the snap, and the motion "
                    "during the snap is not computed; fenicsrom statics follows the path between",
                )
                return
            u = new
    except ConvergenceError:  # at the limit load itself
        return
    finally:
        factor.destroy(matrix=True)
        body.pressures.part = 1.0


def _warn(body: Any, text: str) -> None:
    """Warn of an unstable equilibrium."""
    body.warnings.append(Note(NoteKind.UNSTABLE, text))


def _probe_text(body: Any) -> str:
    """The displacement of the probe in the equilibrium, in words."""
    components = body.comm.allreduce(body.probe_rows @ body.equilibrium)
    return f"({', '.join(f'{1e3 * u:.5g}' for u in components)}) mm"


def _stable_equilibrium(body: Any, unstable: int) -> Array | None:
    """A stable equilibrium (local,) downhill of an unstable one, or None. Collective."""
    try:
        squares, modes = body.eigenmodes(body.factor, min(unstable + 2, body.free))
    except (ConvergenceError, AccuracyError):
        return None
    softest = int(np.argmin(squares))
    if squares[softest] >= 0.0:
        return None
    push = modes[:, softest] * _side(body, modes[:, softest])
    push *= PUSH * body.mesh.extent() / float(body.largest(push[:, None])[0])
    u, c = body.equilibrium + push, 2.0 * abs(float(squares[softest]))
    matrix = body.factor.matrix.duplicate(copy=True)
    factor = body.factorised(matrix, "fenicsrom_buckling")

    def unstable_at(u: Array) -> int:
        return negative_eigenvalues(body.tangent(u, matrix))

    try:
        return downhill(u, c, partial(_step, body, matrix, factor), unstable_at)
    finally:
        factor.destroy(matrix=True)


def _side(body: Any, shape: Array) -> float:
    """1 or -1: the direction of a shape (local,) to which the loads push, else the probe's."""
    force = body.load_vectors.sum(axis=1)
    work = body.dot(force, shape)
    if abs(work) <= SIDE * np.sqrt(body.dot(force, force) * body.dot(shape, shape)):
        probe = body.comm.allreduce(body.probe_rows @ shape)
        work = float(probe[np.argmax(np.abs(probe))])
    return -1.0 if work < 0.0 else 1.0


def _step(
    body: Any, matrix: PETSc.Mat, factor: Factorisation, start: Array, c: float
) -> Array | None:
    """The solution (local,) of (1) near its start, or None without convergence. Collective.

    Args:
        body: the body.
        matrix: work space of the tangent.
        factor: its factorisation.
        start: (local,) u₀.
        c: factor of the mass, 1/s²; 0 for the equilibrium.
    """
    load = body.static_load

    def correct(u: Array) -> Correction | None:
        residual = body.residual(u, load) + c * multiply(body.mass, u - start)
        body.tangent(u, matrix)
        matrix.axpy(c, body.mass, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        try:
            factor.update()
        except ConvergenceError:
            return None
        change = -factor.solve(residual[:, None])[:, 0]
        return change, abs(body.dot(residual, change))

    def converged(u: Array, decrement: float, first: float, last: float) -> bool:
        return small_against_load(decrement, first, body.dot(load + body.pressure_force(u), u))

    return newton(start, correct, converged, ITERATIONS, GROWTH)


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
        _warn(
            body,
            "the follower pressure makes the body flutter without damping, at "
            f"{frequencies[flutters].min():.4g} Hz: it is not conservative, because the loaded "
            "surface has a free edge",
        )
        return int(np.sum(coupled[~flutters].real < 0.0))
    squared = np.sort(coupled.real)
    changes = np.abs(np.sqrt(np.abs(squared / squares)) - 1.0)
    if negative or changes.max() > basis.COUPLING:
        _warn(
            body,
            "the follower pressure is not conservative, because the loaded surface has a free "
            "edge: the modes are those of the symmetric part of the stiffness; the other part "
            f"changes the lowest frequencies by up to {100.0 * changes.max():.2g} %, the first one "
            f"to {np.sqrt(np.abs(squared[0])) / (2.0 * np.pi):.4g} Hz",
        )
    return int(np.sum(squared < 0.0))


def _coupled_squares(body: Any, modes: Array) -> NDArray[np.complex128]:
    """The squares ω² of (2) for modes Φ (local, k) of the symmetric part, by absolute value."""

    def skew_times(block: Array) -> Array:
        at, sizes = body.equilibrium, body.pressures.static
        symmetric = body.pressures.tangent_times(at, block, sizes, symmetric=True)
        return np.asarray(symmetric - body.pressures.tangent_times(at, block, sizes))

    found = np.concatenate([modes, body.factor.solve(skew_times(modes))], axis=1)
    vectors = orthonormal(found, body.mass_inner(found, found), DEPENDENT)
    stiffness = body.inner(vectors, body.held_times(vectors))
    squares = np.linalg.eigvals(stiffness + body.inner(vectors, skew_times(vectors)))
    return np.asarray(squares[np.argsort(np.abs(squares))], dtype=np.complex128)
