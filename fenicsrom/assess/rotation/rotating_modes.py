"""Modes of a rotating body at one speed, and their order from one speed to the next.

Without the Coriolis force the modes are real, K phi = omega^2 M phi. With the Coriolis force the
modes are complex:

    (K + i omega G - omega^2 M) phi = 0.

The real modes reduce this to a dense problem in state space. K^-1 times the residuals of its
solutions extends the space until the frequencies change by less than `COMPLEX_TOLERANCE`.

Above a critical speed K has negative eigenvalues, and the Coriolis force may hold the body. A mode
with negative energy, omega^2 phi^H M phi + phi^H K phi < 0, has then passed through omega = 0: it
is the mode with -omega, and takes part with its conjugate shape, so that shapes are continuous.

Names of the modes of a rotating body, such as 1F (first flap) and 1T (first torsion).

The rule looks at the tip: the nodes within the outermost part `TIP` of the span, which is measured
along the radius r from the axis of rotation to the middle of the body. The chord c and the normal n
of the tip section are the principal axes of these nodes perpendicular to r, with the larger spread
along c. If the spreads are nearly equal, n is along the axis of rotation. A rigid motion is fitted
to the tip; t is its translation, theta its rotation, and rho the distance from r. The largest of
these lengths gives the letter:

    F  flap       |t . n|                E  edge   |t . c|
    T  torsion    |theta . r| rms(rho)   A  axial  |t . r|
    C  chordwise bending of the section: rms of the displacement that the rigid motion leaves

The number counts the modes of one letter in the order of their frequencies.

A body of which only the model for a range of speeds is known, for its modes at any of them.
"""

from __future__ import annotations

from dataclasses import MISSING
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.model.pencil import ROUNDING
from fenicsrom.reduction.basis import extended_space
from fenicsrom.reduction.beam import DenseBody
from fenicsrom.reduction.modes import close_frequency_groups
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.online.step.speed_range import RangeModel
    from fenicsrom.online.store.archive import StoredModel


TIP = 0.05
"""Part of the span that is the tip."""

ROUND = 1.5
"""Ratio of the principal spreads below which a section has no chord of its own."""

LEAST_RADIUS = 0.1
"""Smallest distance of the middle of the body from the axis, relative to the size of the body."""

LETTERS = ("F", "E", "T", "A", "C")


def mode_names(
    positions: Array, shapes: NDArray[Any], axis: Array, point: Array, comm: Any
) -> list[str]:
    """Name modes by their motion at the tip. Collective.

    Args:
        positions: (n, d) nodes of this rank, m.
        shapes: (n, d, m) shapes at these nodes, real or complex, in ascending frequency.
        axis: (3,) unit vector of the axis of rotation.
        point: (3,) a point on it, m.
        comm: the communicator.

    Returns:
        One name per mode; empty for a body that does not point away from its axis, such as a shaft.
    """
    at, moved = _in_space(positions), _in_space(shapes)
    count = sum(comm.allgather(len(at)))
    middle = sum(comm.allgather(at.sum(axis=0))) / count - point
    radius = middle - (middle @ axis) * axis
    boxes = comm.allgather((at.min(axis=0), at.max(axis=0)) if len(at) else None)
    low = np.min([box[0] for box in boxes if box], axis=0)
    high = np.max([box[1] for box in boxes if box], axis=0)
    if np.linalg.norm(radius) < LEAST_RADIUS * np.linalg.norm(high - low):
        return []
    radial = radius / np.linalg.norm(radius)
    along = at @ radial
    top = max(comm.allgather(float(along.max(initial=-np.inf))))
    bottom = min(comm.allgather(float(along.min(initial=np.inf))))
    tip = along >= top - TIP * (top - bottom)
    at, moved = (
        np.concatenate(comm.allgather(part)) for part in (at[tip], np.ascontiguousarray(moved[tip]))
    )
    sizes = [tip_motion(at, moved[:, :, k], radial, axis) for k in range(moved.shape[2])]
    letters = [LETTERS[int(np.argmax(size))] for size in sizes]
    return [f"{letters[: k + 1].count(letter)}{letter}" for k, letter in enumerate(letters)]


def tip_motion(positions: Array, shape: NDArray[Any], radial: Array, axis: Array) -> Array:
    """The lengths that belong to `LETTERS`.

    Args:
        positions: (n, 3) nodes of the tip, m.
        shape: (n, 3) displacements of the tip, real or complex.
        radial: (3,) unit vector along the span.
        axis: (3,) unit vector of the axis of rotation.
    """
    arms = positions - positions.mean(axis=0)
    chord, normal = section_axes(arms, radial, axis)
    columns = np.zeros((arms.shape[0], 3, 6))
    columns[:, :, :3] = np.eye(3)
    columns[:, :, 3:] = np.cross(np.eye(3)[None], arms[:, None, :]).transpose(0, 2, 1)
    matrix = columns.reshape(-1, 6)
    rigid = np.linalg.lstsq(matrix, shape.reshape(-1), rcond=None)[0]
    rest = shape.reshape(-1) - matrix @ rigid
    across = arms - np.outer(arms @ radial, radial)
    rho = np.sqrt(np.mean(np.sum(across**2, axis=1)))
    lengths = [
        rigid[:3] @ normal,
        rigid[:3] @ chord,
        (rigid[3:] @ radial) * rho,
        rigid[:3] @ radial,
        np.linalg.norm(rest) / np.sqrt(len(arms)),
    ]
    return np.abs(lengths)


def section_axes(arms: Array, radial: Array, axis: Array) -> tuple[Array, Array]:
    """Chord and normal (3,) of a section of nodes at arms (n, 3) from its middle."""
    normal: Array = axis - (axis @ radial) * radial
    normal /= np.linalg.norm(normal)
    chord: Array = np.asarray(np.cross(normal, radial), dtype=np.float64)
    plane = np.array([chord, normal])
    spread, turn = np.linalg.eigh((arms @ plane.T).T @ (arms @ plane.T))
    if spread[1] > ROUND**2 * spread[0]:
        normal, chord = turn.T @ plane
    return chord, normal


def _in_space(block: NDArray[Any]) -> NDArray[Any]:
    """A block (n, d, ..) with three components."""
    missing = 3 - block.shape[1]
    return np.pad(block, [(0, 0), (0, missing)] + [(0, 0)] * (block.ndim - 2))


Shapes = NDArray[Any]  # real, or complex with the Coriolis force
TurningBody = Any  # a solid, a `RangeBody`, or a `fenicsrom.fem.solid.wave.Wave`

# relative distance of frequencies below which the modes span one eigenspace
COINCIDENT = 1e-4
# relative change of the frequencies at which the space of the complex modes is large enough
COMPLEX_TOLERANCE = 1e-8
COMPLEX_ROUNDS = 12
TINY = np.finfo(float).tiny
# of modes with equal MAC, the one with the nearest number by frequency is taken
SAME_RANK = 1e-3
# |a^T M a| above which a mode counts as a standing one, of a body at rest
STANDING = 0.9
# smallest part of a mode in a whirl
LEAST_PART = 0.1


def modes_at_speed(solid: TurningBody, count: int) -> tuple[Array, Shapes, float]:
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
    space, rigid = normal, solid.rigid.shape[1]
    previous = np.sqrt(np.abs(squares))
    drift = np.sqrt(np.maximum(-squares[:rigid], 0.0)).max(initial=0.0)
    for _ in range(COMPLEX_ROUNDS):
        if drift > 0.0:
            roots, z = _state_space_modes(solid, space[:, rigid:], count - rigid, 0)
            roots = np.append(np.full(rigid, 1j * drift), roots)
            order = np.argsort(_squares(roots), kind="stable")
            roots, z = roots[order], scipy.linalg.block_diag(np.eye(rigid), z)[:, order]
        else:
            roots, z = _state_space_modes(solid, space, count, rigid)
        shapes, sizes = space @ z, np.abs(roots)
        change = float(np.max(np.abs(sizes - previous) / np.maximum(sizes, TINY)))
        if change <= COMPLEX_TOLERANCE or space.shape[1] >= solid.free:
            mass = hermitian(solid, shapes, shapes)
            return _squares(roots), shapes / np.sqrt(np.diag(mass).real), change
        previous = sizes
        residuals = _residuals(solid, roots, shapes)
        found = solid.factor.solve(np.concatenate([residuals.real, residuals.imag], axis=1))
        space = extended_space(solid.mass_inner, space, found)
    raise ConvergenceError(
        f"complex modes: the frequencies still change by {change:.1e} after {COMPLEX_ROUNDS} "
        f"rounds, more than {COMPLEX_TOLERANCE:.0e}"
    )


def _residuals(solid: TurningBody, roots: Shapes, shapes: Shapes) -> Shapes:
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


def _state_space_modes(
    solid: TurningBody, space: Array, count: int, rigid: int
) -> tuple[Shapes, Shapes]:
    """The complex modes within an M-orthonormal space (local, k), which begins with rigid motions.

    With K = L L^T the state (L^T q, dq/dt) obeys a skew matrix. That matrix times i is Hermitian,
    and its eigenvalues come in pairs +-omega. Where K has negative eigenvalues, the state is
    (q, dq/dt), and each pair of roots gives one mode.

    Returns:
        Roots lambda (count,), 1/s, by omega^2, and coordinates (k, count).
    """
    k = space.shape[1]
    r, stiffness = rigid, solid.inner(space, solid.stiffness_times(space))
    gyroscopic, lower = solid.inner(space, solid.gyroscopic_times(space)), np.zeros((k, k - r))
    try:
        lower[r:] = np.linalg.cholesky(stiffness[r:, r:])
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
    skew = np.block([[np.zeros((k - r, k - r)), lower.T], [-lower, -gyroscopic]])
    values, vectors = np.linalg.eigh(-1j * skew)
    vectors[k - r :, k - r : k] = np.eye(k, r)  # between the pairs
    values[k - r : k] = 0.0
    return 1j * values[k - r :][:count], vectors[k - r :, k - r :][:, :count]


def have_passed_zero(solid: TurningBody, squares: Array, shapes: Shapes) -> bool:
    """Whether some of the modes of `modes_at_speed` have negative energy.

    Damping that turns with the body makes their motions grow.
    """
    energy = squares.copy()
    for part in (shapes.real, shapes.imag):
        block = np.ascontiguousarray(part)
        energy += np.diag(solid.inner(block, solid.stiffness_times(block)))
    return bool(np.any((squares > 0.0) & (energy < -ROUNDING * squares)))


def hermitian(solid: TurningBody, a: Shapes, b: Shapes) -> Shapes:
    """a^H M b of real or complex blocks (local, k) and (local, l)."""
    if not (np.iscomplexobj(a) or np.iscomplexobj(b)):
        return solid.mass_inner(a, b)
    parts = [np.concatenate([block.real, block.imag], axis=1) for block in (a, b)]
    k, n = a.shape[1], b.shape[1]
    inner = solid.mass_inner(*parts)
    return inner[:k, :n] + inner[k:, n:] + 1j * (inner[:k, n:] - inner[k:, :n])


# ---------------------------------------------------------------------- tracking


def follow(
    solid: TurningBody, before: Array, shapes: Shapes, squares: Array, vectors: Shapes
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
        that the Coriolis force has joined to a whirl, that with both (`_joint`). Shapes of
        coincident frequencies are aligned; each then has the omega^2 of the nearest of them.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import

    turn = aligning(hermitian(solid, shapes, vectors), squares)
    _, taken = linear_sum_assignment(-(np.abs(turn) ** 2))
    vectors, squares = vectors @ turn, squares[np.argsort(taken)]  # these are returned
    common = hermitian(solid, shapes, vectors)
    common = aligning(common.conj().T, before).conj().T @ common
    mac = _joint(common, np.diag(hermitian(solid, shapes.conj(), shapes)))
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
    found: Array = mac + sides.sum(axis=1) / np.maximum(mac, TINY)
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


class RangeBody(DenseBody):
    """A range model in its equilibrium at one speed: what the modes of a body need.

    Its vectors have the n coordinates of the range model.

    Attributes:
        whole: the range model.
        free: n.
        warnings: sentences for the user.
        equilibrium: (n,) coordinates of the equilibrium.
        gyroscopic: (n, n) gyroscopic matrix at this speed; None without the Coriolis force.
    """

    def __init__(self, whole: RangeModel, omega: float):
        """Store the range model and move to the equilibrium at a speed in rad/s."""
        self.whole, self.free = whole, whole.model.size
        self.mass, self.warnings = whole.model.mass, list[Note]()
        self.rigid = np.zeros((self.free, 0))
        self.spin(omega)

    def spin(self, omega: float) -> None:
        """Move to the equilibrium at another speed in rad/s.

        Raises:
            ConvergenceError: there is no equilibrium.
        """
        self.equilibrium = self.whole.equilibrium(omega)
        self.stiffness = self.whole.tangent(omega, self.equilibrium)
        coriolis = self.whole.coriolis
        self.gyroscopic = omega * coriolis if coriolis.size else None

    @property
    def factor(self) -> RangeBody:
        """The inverse of the stiffness, which `solve` applies."""
        return self

    def solve(self, block: Array) -> Array:
        """The inverse of the stiffness times a block (n, k)."""
        return np.asarray(np.linalg.solve(self.stiffness, block), np.float64)

    def eigenmodes(self, inverse: object, count: int) -> tuple[Array, Array]:
        """The `count` lowest ω² (count,) and mass-normalised modes (n, count)."""
        squares, modes = scipy.linalg.eigh(
            self.stiffness, self.mass, subset_by_index=(0, count - 1)
        )
        return squares, modes

    def largest(self, block: Array) -> Array:
        """Largest displacement (k,) of a contact point or of the probe in each column (n, k)."""
        model = self.whole.model
        d = model.points.frame.shape[2]
        moved = np.concatenate([model.contact_rows, model.probe]) @ block
        return np.linalg.norm(moved.reshape(-1, d, block.shape[1]), axis=1).max(axis=0, initial=0.0)


def range_body(stored: StoredModel, speeds: Array) -> RangeBody:
    """The body of a stored model at the first of some speeds (k,), rev/min.

    Raises:
        SceneError: the model is for one speed, or a speed is out of its range.
        ConvergenceError: there is no equilibrium at the first speed.
    """
    source, whole = stored.file or stored.scene.source, stored.whole
    if whole is None:
        reason = "the model is for one speed; build it for a range of speeds, or run the diagram "
        reason += "of the scene without --from"
        raise Where(source, "rotation.speeds_rpm").refuse(MISSING, reason)
    first, last = 30.0 / np.pi * whole.speeds[[0, -1]]
    out = speeds[(speeds < first) | (speeds > last)]
    if out.size:
        allowed = f"must be in the range of the model, {first:g} to {last:g} rpm"
        raise Where(source, "campbell.speeds_rpm").refuse(float(out[0]), allowed)
    found = RangeBody(whole, np.pi / 30.0 * float(speeds[0]))
    asked = stored.scene.campbell.modes
    if asked is not None and asked > whole.modes:
        text = (
            f"campbell.modes = {asked}: the diagram has the "
            f"{counted(whole.modes, 'mode')} of the basis; for more, build the model with a larger "
            "basis.modes"
        )
        found.warnings.append(Note(NoteKind.REMARK, text, "campbell.modes"))
    return found
