"""Component modes about the equilibrium: normal modes, attachment, residual-flexibility and
constraint modes.

One factorisation of K serves everything. With the contact displacements x_c = B^T u held, the
inverse of the stiffness is

    K_held^-1 = K^-1 - G (B^T G)^-1 G^T = P K^-1 P^T,    G = K^-1 B (attachment modes),    P = I -
    R_m B^T,    R_m = G (B^T G)^-1

A slender body yields 1e8 times more to forces that bend it than to those that only strain the place
where they act, and so many digits cancel in the difference and in G times (B^T G)^-1. Hence R_m is
a second solve, K^-1 [B (B^T G)^-1] for forces that are in balance, scaled so that B^T R_m = I, and
the inverse the symmetric product: what is left of an error in R_m enters it squared.

The static modes are those of the method: residual flexibility Psi^r = G - sum phi_p (phi_p^T B) /
omega_p^2 (Rubin, eq. 9 corrected), constraint modes Psi^c = G (B^T G)^-1 (Craig-Bampton, eq. 11
corrected).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import SceneError

if TYPE_CHECKING:
    from fenicsrom.fem.linalg import Inverse
    from fenicsrom.fem.solid import Solid
    from fenicsrom.reduction.beam import BeamStructure

if TYPE_CHECKING:
    Structure = Solid | BeamStructure

# relative distance of frequencies below which modes are turned to face the load (tetrahedra split
# pairs)
PAIR_TOLERANCE = 5e-3
FACING_TOLERANCE = 1e-6  # participation, relative to the largest of all modes, that counts as none


@dataclass(frozen=True, eq=False)
class ComponentModes:
    """The vectors X = [Phi, Psi] of a method, (local, k) each.

    Attributes:
        method: "rubin" or "craig-bampton".
        omega: (v,) angular frequencies of the normal modes, rad/s.
        normal: (local, v) Phi, mass-normalised.
        static: (local, m) Psi, the static modes of the method.
        masters: (local, m) R_m = G (B^T G)^-1: unit displacement of one contact coordinate, the
        others held.
        rows: (m, local) B^T.
        inverse: K^-1 (Rubin) or K_held^-1 (Craig-Bampton).
        labels: 1V, 2V, ..; 1S, 2S, ..: of the columns of X.
        flexibility_condition: condition number of B^T Psi^r scaled to unit diagonal, as Rubin's
            method inverts it; 1 without contact. It grows with the number of modes; the basis does
            not use this inverse.
    """

    method: str
    omega: Array
    normal: Array
    static: Array
    masters: Array
    rows: Array
    inverse: Inverse
    labels: tuple[str, ...]
    flexibility_condition: float

    @property
    def frequencies_hz(self) -> Array:
        """(v,) natural frequencies, Hz."""
        return self.omega / (2.0 * np.pi)

    @property
    def vectors(self) -> Array:
        """(local, v + m) X = [Phi, Psi]."""
        return np.concatenate([self.normal, self.static], axis=1)


class ConstrainedInverse:
    """K^-1 with the contact displacements held at zero."""

    def __init__(self, inverse: Inverse, rows: Array, masters: Array, solid: Structure):
        """Keep B^T (m, local) and R_m (local, m)."""
        self._inverse, self._rows, self._masters, self._solid = inverse, rows, masters, solid

    def solve(self, block: Array) -> Array:
        """K_held^-1 times the columns of a block (local, k)."""
        free = self._inverse.solve(block - self._rows.T @ self._solid.inner(self._masters, block))
        return np.asarray(free - self._masters @ self._solid.inner(self._rows.T, free))


@dataclass(frozen=True, eq=False)
class SolvedModes:
    """What a method solves for, from which the component modes with any smaller number of normal
    modes follow.

    Attributes:
        method: "rubin" or "craig-bampton".
        squares: (v,) omega^2 of the normal modes, ascending, rad^2/s^2.
        normal: (local, v) normal modes, mass-normalised, turned to face the loads.
        rows: (m, local) B^T of the master directions.
        attachment: (local, m) G = K^-1 B.
        flexibility: (m, m) B^T G.
        masters: (local, m) R_m = G (B^T G)^-1.
        inverse: K^-1 (Rubin) or K_held^-1 (Craig-Bampton).
    """

    method: str
    squares: Array
    normal: Array
    rows: Array
    attachment: Array
    flexibility: Array
    masters: Array
    inverse: Inverse


def component_modes(solid: Structure, method: str, count: int) -> ComponentModes:
    """Compute the normal and static modes of a method.

    Args:
        solid: the body; its `factor` does every solve.
        method: "rubin" (free interface) or "craig-bampton" (contact displacements held).
        count: number of normal modes.

    Raises:
        SceneError: more modes than unknowns; a contact direction that the supports forbid, or
        depends on others.
        ConvergenceError: the eigensolver did not find them all.
        AccuracyError: a mode failed its residual check.
    """
    return first_modes(solid, solve_modes(solid, method, count), count)


def solve_modes(solid: Structure, method: str, count: int) -> SolvedModes:
    """The solves of `component_modes`, for this number of normal modes or any smaller one; errors
    as there.
    """
    b, attachment = master_directions(solid)
    m = b.shape[0]
    free = solid.free - (m if method == "craig-bampton" else 0)
    extra = min(
        2, max(free - count, 0)
    )  # so that a pair at the end of the list is whole when it is turned
    if count > free:
        raise SceneError(
            f"{solid.scene.source}: basis.modes = {count}: must be at most {free}, the number of free unknowns"
        )
    flexibility = solid.inner(b.T, attachment)
    masters = unit_displacements(solid, b, flexibility)
    inverse: Inverse = solid.factor
    if method == "craig-bampton" and m:
        inverse = ConstrainedInverse(solid.factor, b, masters, solid)
    squares, normal = solid.eigenmodes(inverse, count + extra if count else 0)
    if np.any(squares <= 0.0):
        solid.warnings.append(
            f"the equilibrium is unstable: {int(np.sum(squares <= 0))} modes have omega^2 < 0"
        )
    return SolvedModes(
        method,
        squares,
        face_loads(solid, squares, normal),
        b,
        attachment,
        flexibility,
        masters,
        inverse,
    )


def first_modes(solid: Structure, solved: SolvedModes, count: int) -> ComponentModes:
    """The component modes of a method with its first `count` normal modes."""
    b, method = solved.rows, solved.method
    normal, squares = solved.normal[:, :count], solved.squares[:count]
    # 1/omega^2, but for modes of a split pair that were turned: their flexibility is not quite
    # diagonal
    inertia = solid.mass_times(normal)
    flexibility = solid.inner(inertia, solved.inverse.solve(inertia)) if count else np.zeros((0, 0))
    residual = solved.attachment - normal @ (flexibility @ solid.inner(normal, b.T))
    condition = (
        scaled_condition(solid.inner(b.T, residual))
        if method == "rubin"
        else scaled_condition(solved.flexibility)
    )
    static = residual if method == "rubin" else solved.masters
    labels = tuple([f"{k + 1}V" for k in range(count)] + [f"{k + 1}S" for k in range(b.shape[0])])
    return ComponentModes(
        method,
        np.sqrt(np.maximum(squares, 0.0)),
        normal,
        static,
        solved.masters,
        b,
        solved.inverse,
        labels,
        condition,
    )


def unit_displacements(solid: Structure, rows: Array, flexibility: Array) -> Array:
    """R_m (local, m) of contact coordinates B^T (m, local) whose flexibility B^T K^-1 B (m, m) is
    known.
    """
    if rows.shape[0] == 0:
        return np.zeros((solid.local, 0))
    near = solid.factor.solve(rows.T @ np.linalg.inv(flexibility))
    return np.asarray(near @ np.linalg.inv(solid.inner(rows.T, near)))


def master_directions(solid: Structure) -> tuple[Array, Array]:
    """The directions W of the contact forces that are masters, as the scene's `basis.masters` asks.

    Interface modes are the eigenvectors of B^T K^-1 B with the largest eigenvalues: of all sets of
    so many combinations of contact forces theirs are the static responses that come nearest, in the
    energy, to those under any contact force.

    Returns:
        (m, local) W^T B^T, and the attachment modes (local, m) K^-1 B W.

    Raises:
        SceneError: a contact direction that the supports forbid, or, where each is a master, that
            depends on others.
    """
    rows, d, masters = (
        solid.contact_rows,
        solid.scene.geometry.dimension,
        solid.scene.basis.masters or "all",
    )
    if rows.shape[0] == 0:
        return rows, np.zeros((solid.local, 0))
    if masters == "normal":
        rows = rows[::d]
    attachment = solid.factor.solve(rows.T.copy())
    flexibility = solid.inner(rows.T, attachment)
    check_flexibility(solid, flexibility, isinstance(masters, str))
    if isinstance(masters, str):
        return rows, attachment
    values, vectors = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    independent = int(np.sum(values > 1e-12 * values[-1]))
    chosen = vectors[:, ::-1][:, : min(masters, independent)]
    chosen *= np.where(
        chosen[np.argmax(np.abs(chosen), axis=0), np.arange(chosen.shape[1])] < 0.0, -1.0, 1.0
    )
    return chosen.T @ rows, attachment @ chosen


def check_flexibility(solid: Structure, flexibility: Array, independent: bool) -> None:
    """Refuse contact coordinates that cannot move, or, of `independent` ones, not each alone: B^T G
    positive definite.
    """
    points = len(solid.points.contact)
    d = flexibility.shape[0] // points
    diagonal = np.diag(flexibility)
    for k in np.flatnonzero(~(diagonal > 1e-14 * np.max(diagonal))):
        raise SceneError(
            f"{solid.scene.source}: contacts[{solid.points.contact[k // d]}]: the supports forbid its motion along direction "
            f"{k % d + 1} of [normal, tangents]; move the contact away from the supports"
        )
    if independent and scaled_condition(flexibility) > 1e12:
        raise SceneError(
            f"{solid.scene.source}: contacts: two contact coordinates always move together; remove one of them, or set "
            "basis.masters to a number of interface modes"
        )


def scaled_condition(matrix: Array) -> float:
    """Condition number of a symmetric matrix after scaling to unit diagonal; 1 for an empty one."""
    if matrix.size == 0:
        return 1.0
    scale = np.sqrt(np.abs(np.diag(matrix)))
    return float(np.linalg.cond(matrix / np.outer(scale, scale)))


def face_loads(solid: Structure, squares: Array, modes: Array) -> Array:
    """Turn groups of modes of one frequency to face the loads, then the contact directions, and fix
    all signs.

    A symmetric section has pairs of modes that an eigensolver returns at an arbitrary angle. In
    each group of frequencies closer than `PAIR_TOLERANCE` the first mode takes all that the first
    load does, the second all that the next direction does, and so on; every mode does positive work
    with the first direction that moves it.
    """
    if modes.shape[1] == 0:
        return modes
    directions = np.concatenate(
        [solid.load_vectors, solid.contact_rows.T, solid.probe_rows.T], axis=1
    )
    work = np.concatenate(
        [solid.inner(modes, directions), solid.mass_inner(modes, solid.translations())], axis=1
    )
    largest = np.max(np.abs(work), axis=0)
    seen = np.abs(work) > FACING_TOLERANCE * largest
    turned = modes.copy()
    omega = np.sqrt(np.abs(squares))
    start = 0
    while start < omega.size:
        end = start + 1
        while end < omega.size and omega[end] - omega[end - 1] <= PAIR_TOLERANCE * omega[end]:
            end += 1
        group = slice(start, end)
        if end - start > 1:
            useful = np.flatnonzero(np.any(seen[group], axis=0))
            q, _ = np.linalg.qr(
                np.concatenate([work[group][:, useful], np.eye(end - start)], axis=1),
                mode="complete",
            )
            turned[:, group] = modes[:, group] @ q
            work[group] = q.T @ work[group]
            seen[group] = np.abs(work[group]) > FACING_TOLERANCE * largest
        start = end
    for k in range(turned.shape[1]):
        first = np.flatnonzero(seen[k])
        if first.size and work[k, first[0]] < 0.0:
            turned[:, k] *= -1.0
    return turned
