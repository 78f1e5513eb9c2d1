"""Modes of a rotating body at one speed, and their order from one speed to the next.

Without the Coriolis force the modes are real, K phi = omega^2 M phi. With the Coriolis force the
modes are complex:

    (K + i omega G - omega^2 M) phi = 0.

The real modes reduce this to a dense problem in state space. K^-1 times the residuals of its
solutions extends the space until the frequencies change by less than `COMPLEX_TOLERANCE`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError, ErrorKind
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


def modes_at_speed(solid: Solid | RangeBody, count: int) -> tuple[Array, Shapes, float]:
    """The lowest modes about the present equilibrium, complex with the Coriolis force.

    Args:
        solid: the body at speed.
        count: number of modes.

    Returns:
        omega^2 (count,), ascending, shapes (local, count) of unit modal mass, and the last relative
        change of the frequencies with the Coriolis force.

    Raises:
        ConvergenceError: the complex frequencies did not converge within `COMPLEX_ROUNDS`, or the
            equilibrium is unstable.
    """
    squares, normal = solid.eigenmodes(solid.factor, count)
    if solid.gyroscopic is None:
        return squares, normal, 0.0
    space = normal
    previous = np.sqrt(np.maximum(squares, 0.0))
    for _ in range(COMPLEX_ROUNDS):
        omega, z = _state_space_modes(solid, space, count)
        shapes = space @ z
        change = float(np.max(np.abs(omega - previous) / omega))
        if change <= COMPLEX_TOLERANCE or space.shape[1] >= solid.free:
            mass = _hermitian(solid, shapes, shapes)
            return omega**2, shapes / np.sqrt(np.diag(mass).real), change
        previous = omega
        new = [  # real and imaginary part of the residuals
            solid.stiffness_times(a)
            - omega**2 * solid.mass_times(a)
            - omega * solid.gyroscopic_times(b)
            for a, b in ((shapes.real, shapes.imag), (shapes.imag, -shapes.real))
        ]
        found = solid.factor.solve(np.concatenate(new, axis=1))
        space = extended_space(solid.mass_inner, space, found)
    raise ConvergenceError(
        f"complex modes: the frequencies still change by {change:.1e} after {COMPLEX_ROUNDS} "
        f"rounds, more than {COMPLEX_TOLERANCE:.0e}"
    )


def _state_space_modes(solid: Solid | RangeBody, space: Array, count: int) -> tuple[Array, Shapes]:
    """The complex modes within an M-orthonormal space (local, k).

    With K = L L^T the state (L^T q, dq/dt) obeys a skew matrix. That matrix times i is Hermitian,
    and its eigenvalues come in pairs +-omega.

    Returns:
        Frequencies (count,), rad/s, and coordinates (k, count).
    """
    k = space.shape[1]
    try:
        lower = np.linalg.cholesky(solid.inner(space, solid.stiffness_times(space)))
    except np.linalg.LinAlgError:
        raise ConvergenceError(
            "complex modes: the equilibrium is unstable", kind=ErrorKind.INSTABILITY
        ) from None
    skew = np.block(
        [[np.zeros((k, k)), lower.T], [-lower, -solid.inner(space, solid.gyroscopic_times(space))]]
    )
    values, vectors = np.linalg.eigh(-1j * skew)
    return values[k : k + count], vectors[k:, k : k + count]


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
        omega^2 and shapes in the order of `shapes`, and the MAC of each pair (m,).
    """
    common = _hermitian(solid, shapes, vectors)
    vectors = vectors @ aligning(common, squares)  # these shapes are returned
    common = _hermitian(solid, shapes, vectors)
    common = aligning(common.conj().T, before).conj().T @ common
    mac = np.abs(common) ** 2
    rows, columns = linear_sum_assignment(-mac)
    order = columns[np.argsort(rows)]
    return squares[order], vectors[:, order], np.minimum(mac[np.arange(order.size), order], 1.0)


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
