"""Modes of a rotating body at one speed, and their order from one speed to the next.

Without the Coriolis force the modes are real, K phi = omega^2 M phi. With the Coriolis force the
modes are complex:

    (K + i omega G - omega^2 M) phi = 0.

The real modes reduce this to a dense problem in state space. K^-1 times the residuals of its
solutions extends the space until the frequencies change by less than `COMPLEX_TOLERANCE`.

Above a critical speed K has negative eigenvalues, and the Coriolis force may hold the body. A mode
with negative energy, omega^2 phi^H M phi + phi^H K phi < 0, has then passed through omega = 0: it
is the mode with -omega, and takes part with its conjugate shape, so that shapes are continuous.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.model.pencil import ROUNDING
from fenicsrom.reduction.basis import extended_space
from fenicsrom.reduction.modes import close_frequency_groups

if TYPE_CHECKING:
    from fenicsrom.assess.rotation.range_body import RangeBody
    from fenicsrom.fem.solid.solid import Solid

Shapes = NDArray[Any]  # real, or complex with the Coriolis force

# relative distance of frequencies below which the modes span one eigenspace
COINCIDENT = 1e-4
# relative change of the frequencies at which the space of the complex modes is large enough
COMPLEX_TOLERANCE = 1e-8
COMPLEX_ROUNDS = 12
# of modes with equal MAC, the one with the nearest number by frequency is taken
SAME_RANK = 1e-3
# |a^T M a| above which a mode counts as a standing one, of a body at rest
STANDING = 0.9
# smallest part of a mode in a whirl
LEAST_PART = 0.1


def modes_at_speed(solid: Solid | RangeBody, count: int) -> tuple[Array, Shapes, float]:
    """The lowest modes about the present equilibrium, complex with the Coriolis force.

    Args:
        solid: the body at speed.
        count: number of modes.

    Returns:
        omega^2 (count,), ascending, negative where the motion of a mode grows, shapes
        (local, count) of unit modal mass, and the last relative change of the frequencies with the
        Coriolis force.

    Raises:
        ConvergenceError: the complex frequencies did not converge within `COMPLEX_ROUNDS`.
    """
    squares, normal = solid.eigenmodes(solid.factor, count)
    if solid.gyroscopic is None:
        return squares, normal, 0.0
    space = normal
    previous = np.sqrt(np.abs(squares))
    for _ in range(COMPLEX_ROUNDS):
        roots, z = _state_space_modes(solid, space, count)
        shapes, sizes = space @ z, np.abs(roots)
        change = float(np.max(np.abs(sizes - previous) / sizes))
        if change <= COMPLEX_TOLERANCE or space.shape[1] >= solid.free:
            mass = _hermitian(solid, shapes, shapes)
            return _squares(roots), shapes / np.sqrt(np.diag(mass).real), change
        previous = sizes
        residuals = _residuals(solid, roots, shapes)
        found = solid.factor.solve(np.concatenate([residuals.real, residuals.imag], axis=1))
        space = extended_space(solid.mass_inner, space, found)
    raise ConvergenceError(
        f"complex modes: the frequencies still change by {change:.1e} after {COMPLEX_ROUNDS} "
        f"rounds, more than {COMPLEX_TOLERANCE:.0e}"
    )


def _residuals(solid: Solid | RangeBody, roots: Shapes, shapes: Shapes) -> Shapes:
    """(K + lambda G + lambda^2 M) phi of modes (local, k) with their roots lambda (k,)."""
    parts = []
    for times in (solid.stiffness_times, solid.gyroscopic_times, solid.mass_times):
        real, imaginary = (times(np.ascontiguousarray(x)) for x in (shapes.real, shapes.imag))
        parts.append(real + 1j * imaginary)
    return np.asarray(parts[0] + roots * (parts[1] + roots * parts[2]))


def _squares(roots: Shapes) -> Array:
    """omega^2 of roots lambda (k,): -|lambda|^2 where the real part is more than rounding."""
    sign = np.where(np.abs(roots.real) > ROUNDING * np.abs(roots), -1.0, 1.0)
    return np.asarray(sign * np.abs(roots) ** 2, dtype=np.float64)


def _state_space_modes(solid: Solid | RangeBody, space: Array, count: int) -> tuple[Shapes, Shapes]:
    """The complex modes within an M-orthonormal space (local, k).

    With K = L L^T the state (L^T q, dq/dt) obeys a skew matrix. That matrix times i is Hermitian,
    and its eigenvalues come in pairs +-omega. Where K has negative eigenvalues, the state is
    (q, dq/dt), and each pair of roots gives one mode.

    Returns:
        Roots lambda (count,), 1/s, by omega^2, and coordinates (k, count).
    """
    k = space.shape[1]
    stiffness = solid.inner(space, solid.stiffness_times(space))
    gyroscopic = solid.inner(space, solid.gyroscopic_times(space))
    try:
        lower = np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        state = np.block([[np.zeros((k, k)), np.eye(k)], [-stiffness, -gyroscopic]])
        roots, vectors = np.linalg.eig(state)
        order = np.lexsort((-roots.real, -roots.imag))[:k]  # one of each pair
        order = order[np.argsort(_squares(roots[order]), kind="stable")][:count]
        roots, z = roots[order], vectors[:k, order]
        z = z / np.linalg.norm(z, axis=0)
        energy = np.abs(roots) ** 2 + np.sum(z.conj() * (stiffness @ z), axis=0).real
        passed = energy < 0.0
        return np.where(passed, roots.conj(), roots), np.where(passed, z.conj(), z)
    skew = np.block([[np.zeros((k, k)), lower.T], [-lower, -gyroscopic]])
    values, vectors = np.linalg.eigh(-1j * skew)
    return 1j * values[k : k + count], vectors[k:, k : k + count]


def have_passed_zero(solid: Solid | RangeBody, squares: Array, shapes: Shapes) -> bool:
    """Whether some of the modes of `modes_at_speed` have negative energy.

    Damping that turns with the body makes their motions grow.
    """
    energy = squares.copy()
    for part in (shapes.real, shapes.imag):
        block = np.ascontiguousarray(part)
        energy += np.diag(solid.inner(block, solid.stiffness_times(block)))
    return bool(np.any((squares > 0.0) & (energy < 0.0)))


def _hermitian(solid: Solid | RangeBody, a: Shapes, b: Shapes) -> Shapes:
    """a^H M b of real or complex blocks (local, k) and (local, l)."""
    if not (np.iscomplexobj(a) or np.iscomplexobj(b)):
        return solid.mass_inner(a, b)
    parts = [np.concatenate([block.real, block.imag], axis=1) for block in (a, b)]
    k, n = a.shape[1], b.shape[1]
    inner = solid.mass_inner(*parts)
    return inner[:k, :n] + inner[k:, n:] + 1j * (inner[:k, n:] - inner[k:, :n])


# ---------------------------------------------------------------------- tracking


def follow(
    solid: Solid | RangeBody, before: Array, shapes: Shapes, squares: Array, vectors: Shapes
) -> tuple[Array, Shapes, Array]:
    """Sort the modes at one speed in the order of the modes at the previous speed.

    Args:
        solid: the body.
        before: (m,) omega^2 at the previous speed.
        shapes: (local, m) shapes at the previous speed, of unit modal mass.
        squares: (m,) omega^2 at this speed, ascending.
        vectors: (local, m) shapes at this speed, of unit modal mass.

    Returns:
        omega^2 and shapes in the order of `shapes`, and the MAC of each pair (m,): with two modes
        that the Coriolis force has joined to a whirl, that with both (`_joint`).
    """
    common = _hermitian(solid, shapes, vectors)
    vectors = vectors @ aligning(common, squares)  # these shapes are returned
    common = _hermitian(solid, shapes, vectors)
    common = aligning(common.conj().T, before).conj().T @ common
    mac = _joint(common, np.diag(_hermitian(solid, shapes.conj(), shapes)))
    ranks = np.argsort(np.argsort(before, kind="stable"))
    apart = np.abs(ranks[:, None] - np.arange(squares.size)) / squares.size
    rows, columns = linear_sum_assignment(SAME_RANK * apart - mac)
    order = columns[np.argsort(rows)]
    return squares[order], vectors[:, order], np.minimum(mac[np.arange(order.size), order], 1.0)


def _joint(common: Shapes, still: Shapes) -> Array:
    """The MAC (m, m) of modes a at one speed with modes b at the next one.

    The modes of a round body at rest come in pairs, of nearly the same frequency on a mesh. The
    Coriolis force joins a pair to two whirls, in which it takes part in quadrature: b = a_1 +- i
    a_2. A whirl has then half of each, but neither is lost or swapped. Parts in quadrature count
    for both; parts in phase, as where frequencies veer, do not.

    Args:
        common: (m, m) a^H M b.
        still: (m,) a^T M a, of absolute value 1 if all points of a mode pass zero at once.
    """
    mac = np.abs(common) ** 2
    if not np.iscomplexobj(common):
        return mac
    at_once = np.abs(still) > STANDING
    turned = common * np.exp(0.5j * np.angle(still))[:, None]  # parts of the modes as real shapes
    sides = (
        np.imag(turned[:, None].conj() * turned[None]) ** 2 * np.outer(at_once, at_once)[..., None]
    )
    found: Array = mac + sides.sum(axis=1) / np.maximum(mac, np.finfo(float).tiny)
    return np.where(mac > LEAST_PART, found, mac)


def aligning(common: Shapes, squares: Array) -> Shapes:
    """The rotation of modes within coincident frequencies that aligns them with other modes.

    Args:
        common: (k, m) inner products of the other modes with these.
        squares: (m,) omega^2 of these modes.

    Returns:
        (m, m) unitary matrix; the modes times this matrix are aligned.
    """
    turn = np.eye(squares.size, dtype=common.dtype)
    omega = np.sqrt(np.abs(squares))
    order = np.argsort(squares)
    for part in close_frequency_groups(omega[order], COINCIDENT):
        group = order[part]
        if group.size > 1:
            rows = np.sort(np.argsort(-np.sum(np.abs(common[:, group]) ** 2, axis=1))[: group.size])
            u, _, vh = np.linalg.svd(common[np.ix_(rows, group)])
            turn[np.ix_(group, group)] = (u @ vh).conj().T
    return turn
