"""Component modes about the equilibrium: normal modes and static modes.

One factorisation of K serves all modes. With the contact displacements x_c = Bᵀ u held at zero,
the inverse of the stiffness is

    K_held⁻¹ = K⁻¹ − G (Bᵀ G)⁻¹ Gᵀ = P K⁻¹ Pᵀ,    (1)
    G = K⁻¹ B,    P = I − R_m Bᵀ,    R_m = G (Bᵀ G)⁻¹,    (2)

where the columns of G are the attachment modes. A slender body is about 1e8 times more flexible in
bending than under forces that only strain the material near their points, so the difference in (1)
and the product in (2) lose digits by cancellation. Therefore R_m is computed by a second solve,
K⁻¹ [B (Bᵀ G)⁻¹], whose forces are in balance, and is then scaled so that Bᵀ R_m = I. The inverse is
computed as the symmetric product in (1): an error of R_m then changes it only by the square of this
error.

The static modes depend on the method:

    Rubin:          Ψʳ = G − Σ_p φ_p (φ_pᵀ B) / ω_p²    (residual flexibility),    (3)
    Craig-Bampton:  Ψᶜ = G (Bᵀ G)⁻¹                     (constraint modes).    (4)

Sources: Rubin, AIAA J. 13, 1975, and Craig and Bampton, AIAA J. 6, 1968. Equations (3) and (4) are
eqs. (9) and (11) of Mashayekhi and Zucca (2024), corrected: the projection on B is missing in their
eq. (9), and a minus sign in their eq. (11).

With modes = "auto", a basis has the modes up to `HIGHEST_MODE` times the highest frequency that the
scene excites (`fenicsrom.scene.keys.excitation`), and the next one, but at least `LEAST_MODES`. A
mode above twice the frequency of a load responds with at most 1/(1 − 1/4) = 1.3 times its static
response. The responses of the modes that are left out are therefore small and nearly static.

The masters: the directions of the contact forces for which static modes are computed.

With a few contact points, all their directions are masters. With many points, interface modes take
their place: the eigenvectors of the contact flexibility Bᵀ K⁻¹ B with the largest eigenvalues.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.notes import Note, NoteKind
from fenicsrom.online.kernels.dense import scaled, scaled_condition
from fenicsrom.reduction.interface import VECTORS
from fenicsrom.reduction.load_responses import LoadVectors, load_responses, load_vectors
from fenicsrom.reduction.protocols import Inverse, Structure
from fenicsrom.scene import Basis, Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.checks import INTERFACE_MODES, LEAST_MODES
from fenicsrom.scene.keys.excitation import HIGHEST_MODE, highest_frequency
from fenicsrom.words import brief, counted

if TYPE_CHECKING:
    from scipy.sparse import csr_array


INDEPENDENCE = 1e-12
"""Smaller eigenvalues of the contact flexibility, relative to the largest, count as zero."""

DEPENDENT = 1e-11
"""A contact coordinate depends on others if the part of its flexibility that is its own, relative
to all of it, is smaller."""

IMMOBILE = 1e-14
"""A contact coordinate cannot move if its flexibility, relative to the largest, is smaller."""

DIRECT_DIRECTIONS = 60
"""With more contact directions, an iterative method finds the interface modes."""

GUARD_VECTORS = 4
"""Vectors of a block beyond the wanted ones, so that the last wanted ones converge sooner."""

INTERFACE_TOLERANCE = 1e-10
"""Largest residual of an interface mode, relative to the largest eigenvalue.

The eigenvalues have the square of this error.
"""


def master_directions(structure: Structure, masters: str | int) -> tuple[Array, Array]:
    """Give the master directions W of the contact forces and their attachment modes.

    Interface modes are the eigenvectors of Bᵀ K⁻¹ B with the largest eigenvalues. Among all sets of
    the same number of force combinations, their static responses are closest, in the energy norm,
    to the responses under all contact forces.

    Args:
        structure: the structure.
        masters: "all" directions that are independent, the "normal" ones of them, or a number of
            interface modes.

    Returns:
        Wᵀ Bᵀ (m, local), and the attachment modes K⁻¹ B W (local, m).

    Raises:
        SceneError: the supports forbid a contact direction.
    """
    rows = structure.contact_rows
    if rows.shape[0] == 0:
        return rows.toarray(), np.zeros((structure.local, 0))
    if structure.interface is not None:
        chosen = structure.interface[:, : VECTORS if masters == "motion" else int(masters)]
        attachment = structure.factor.solve(rows.T @ chosen)
        # combinations of their own flexibility: others mix stiff with soft, and lose digits
        turn = np.linalg.eigh(structure.inner(rows.T @ chosen, attachment))[1]
        return (chosen @ turn).T @ rows, attachment @ turn
    if masters == "motion":  # the first of its motions
        masters = INTERFACE_MODES
    if masters == "normal":
        rows = rows[:: structure.dimension]
    if not isinstance(masters, str) and rows.shape[0] > DIRECT_DIRECTIONS:
        chosen = _interface_modes(structure, rows, masters)
        return np.asarray(chosen.T @ rows), structure.factor.solve(rows.T @ chosen)
    attachment = structure.factor.solve(rows.T.toarray())
    flexibility = structure.inner(rows.T, attachment)
    _check_mobile(structure, np.diag(flexibility))
    if isinstance(masters, str):
        kept = independent_coordinates(flexibility)
        return rows.toarray()[kept], attachment[:, kept]
    values, vectors = np.linalg.eigh(0.5 * (flexibility + flexibility.T))
    independent = int(np.sum(values > INDEPENDENCE * values[-1]))
    chosen = _with_sign(vectors[:, ::-1][:, : min(masters, independent)])
    return np.asarray(chosen.T @ rows), attachment @ chosen


def _with_sign(vectors: Array) -> Array:
    """Vectors (m, k) whose largest component is positive."""
    largest = vectors[np.argmax(np.abs(vectors), axis=0), np.arange(vectors.shape[1])]
    return vectors * np.where(largest < 0.0, -1.0, 1.0)


def _interface_modes(structure: Structure, rows: csr_array, count: int) -> Array:
    """The eigenvectors (m, count) of Bᵀ K⁻¹ B with the largest eigenvalues, by few solves.

    The block Lanczos method finds them, with full orthogonalisation.

    Raises:
        SceneError: the supports forbid a contact direction.
    """
    # a direction that the supports forbid moves no free unknown
    _check_mobile(structure, structure.comm.allreduce(rows.multiply(rows).sum(axis=1)))
    m = rows.shape[0]
    block = np.random.default_rng(0).standard_normal((m, count + GUARD_VECTORS))
    basis, images = np.zeros((m, 0)), np.zeros((m, 0))
    while True:
        for _ in range(2):
            block = block - basis @ (basis.T @ block)
            block = np.linalg.qr(block)[0]
        block = block[:, : m - basis.shape[1]]
        image = structure.inner(rows.T, structure.factor.solve(rows.T @ block))
        basis = np.concatenate([basis, block], axis=1)
        images = np.concatenate([images, image], axis=1)
        projected = basis.T @ images
        values, vectors = np.linalg.eigh(0.5 * (projected + projected.T))
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        errors = np.linalg.norm(images @ vectors - basis @ vectors * values, axis=0)
        independent = values > INDEPENDENCE * values[0]
        if basis.shape[1] == m or np.all(errors[independent] <= INTERFACE_TOLERANCE * values[0]):
            return _with_sign(basis @ vectors[:, independent])
        block = image


def independent_coordinates(flexibility: Array) -> list[int]:
    """The coordinates that move independently of the ones before them.

    Two stops on both sides of one point share its displacement: the first one gives the coordinate.

    Args:
        flexibility: (m, m) Bᵀ K⁻¹ B of the contact coordinates.
    """
    products, kept = scaled(flexibility), list[int]()
    for k in range(len(products)):
        row = products[kept, k]
        alone = products[k, k] - row @ np.linalg.solve(products[np.ix_(kept, kept)], row)
        if alone > DEPENDENT:
            kept.append(k)
    return kept


def _check_mobile(structure: Structure, mobility: Array) -> None:
    """Check that no entry of the mobility (m,) of the contact coordinates is zero.

    Raises:
        SceneError: the supports forbid the motion of a coordinate.
    """
    contact = structure.points.contact
    d = mobility.size // len(contact)
    for k in np.flatnonzero(~(mobility > IMMOBILE * np.max(mobility))):
        key = f"contacts[{contact[k // d]}]"
        reason = f"the supports forbid direction {k % d + 1} of [normal, tangents] of the contact "
        reason += "point; move it away from the supports"
        raise refuse(structure.source, reason, ErrorKind.PLACE, key)


ENOUGH = 1.5
"""The last mode of any basis should be above this multiple of the highest excited frequency."""

MOST_MODES = 12
"""Most modes of "auto" in a nonlinear scene: its derivatives grow with the square of the modes."""

MOST_LINEAR_MODES = 100
"""Most modes of "auto" in a linear scene; at most half of the free unknowns in any scene."""

EXTRA_MODES = 2
"""Modes computed beyond the wanted ones, so that the last group of close modes is complete."""


def solve_eigenmodes(
    structure: Structure, inverse: Inverse, wanted: str | int, free: int
) -> tuple[Array, Array, int]:
    """Compute the normal modes that [basis] asks for, and a few more.

    Args:
        structure: the structure.
        inverse: the inverse of its stiffness, with the contact displacements held or free.
        wanted: the key `basis.modes`.
        free: the number of free unknowns.

    Returns:
        ω² (k,) ascending, the modes (local, k), and the number of modes to keep.

    Raises:
        SceneError: there are fewer free unknowns than modes.
        ConvergenceError: the eigensolver did not find all modes.
        AccuracyError: a mode failed its residual check.
    """
    count = min(LEAST_MODES, free) if isinstance(wanted, str) else wanted
    if count > free:
        allowed = f"must be at most {free}, the number of free unknowns"
        raise Where(structure.source, "basis.modes").refuse(count, allowed)
    most = MOST_MODES if structure.geometrically_nonlinear else MOST_LINEAR_MODES
    most = max(count, min(most, free // 2))  # all modes would leave no flexibility to static modes
    while True:
        solved = count + min(EXTRA_MODES, free - count) if count else 0
        omega_squared, modes = structure.eigenmodes(inverse, solved)
        if not isinstance(wanted, str):
            return omega_squared, modes, count
        frequencies = np.sqrt(np.maximum(omega_squared, 0.0)) / (2.0 * np.pi)
        needed = int(np.sum(frequencies <= HIGHEST_MODE * structure.excitation)) + 1
        if needed <= solved or count == most:
            break
        count = min(2 * count, most)
    if needed - 1 > most:
        text = (
            f'basis.modes = "auto" keeps {most} modes, up to {frequencies[most - 1]:.5g} Hz, but '
            f"the scene excites up to {structure.excitation:.5g} Hz; for more modes, set "
            "basis.modes to a larger number"
        )
        structure.warnings.append(Note(NoteKind.WARNING, text, "basis.modes"))
    return omega_squared, modes, max(min(needed, most), min(LEAST_MODES, free))


def missing_modes(scene: Scene, frequencies: Array) -> Note | None:
    """Give a warning of loads that are too fast for the modes of a basis; None without such loads.

    Args:
        scene: the scene.
        frequencies: (v,) natural frequencies of the normal modes, Hz.
    """
    highest, last = highest_frequency(scene), float(np.max(frequencies, initial=0.0))
    if highest * ENOUGH <= last or highest == 0.0:
        return None
    return Note(
        NoteKind.BASIS,
        f"the scene excites up to {highest:.5g} Hz, and the normal modes of the basis "
        f"({frequencies.size}) end at {last:.5g} Hz; they should reach {ENOUGH:g} times the "
        'highest excited frequency: run the scene with basis.modes = "auto", or with more modes',
    )


PAIR_TOLERANCE = 5e-3
"""Two modes are a pair if the relative distance of their frequencies is smaller.

A mesh of tetrahedra splits an exact pair of a symmetric section.
"""

EQUAL = 1e-7
"""Of three and more close modes, such as those of the blades of a disk, only modes whose relative
distance is smaller share a frequency."""

FACING_TOLERANCE = 1e-6
"""Smaller works of a mode on a direction, relative to the largest work, count as zero."""


@brief()
@dataclass(frozen=True, eq=False, repr=False)
class ComponentModes:
    """The component modes X = [Φ, Ψ] of a method.

    Attributes:
        method: "rubin" or "craig-bampton".
        omega: (v,) angular frequencies of the normal modes, rad/s.
        normal: (local, v) normal modes Φ, mass-normalised.
        static: (local, m) static modes Ψ of the method.
        masters: (local, m) R_m of (2): unit displacement of one contact coordinate with the others
            held.
        rows: (m, local) Bᵀ of the master directions.
        inverse: K⁻¹ (Rubin) or K_held⁻¹ (Craig-Bampton).
        labels: labels of the columns of X: 1V, 2V, ..., then 1S, 2S, ...; first 1R, 2R, ... of
            rigid motions.
        flexibility_condition: condition number, after scaling to unit diagonal, of Bᵀ Ψʳ (Rubin) or
            of Bᵀ G (Craig-Bampton); 1 without contact. With Rubin's method it grows with the number
            of modes; the basis does not use the inverse of this matrix.
        loads: static responses to the loads that the modes leave out.
        rigid: number of the first normal modes that are rigid motions.
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
    loads: LoadVectors
    rigid: int = 0

    @property
    def frequencies_hz(self) -> Array:
        """(v,) natural frequencies in Hz."""
        return np.asarray(self.omega / (2.0 * np.pi))

    @property
    def vectors(self) -> Array:
        """(local, v + m) component modes X = [Φ, Ψ]."""
        return np.concatenate([self.normal, self.static], axis=1)


class ConstrainedInverse:
    """K_held⁻¹ of (1): the inverse stiffness with the contact displacements held at zero."""

    def __init__(self, inverse: Inverse, rows: Array, masters: Array, structure: Structure):
        """Store K⁻¹, Bᵀ (m, local) and R_m (local, m)."""
        self._inverse, self._rows, self._masters = inverse, rows, masters
        self._structure = structure

    def solve(self, block: Array) -> Array:
        """K_held⁻¹ times the columns of a block (local, k)."""
        inner = self._structure.inner
        free = self._inverse.solve(block - self._rows.T @ inner(self._masters, block))
        return np.asarray(free - self._masters @ inner(self._rows.T, free))


class SupportedInverse:
    """The inverse stiffness of a body whose contact points stick to their springs.

    With the springs D along the rows Bᵀ, by the formula of Sherman, Morrison and Woodbury,

        (K + B D Bᵀ)⁻¹ = K⁻¹ − K⁻¹ B (D⁻¹ + Bᵀ K⁻¹ B)⁻¹ Bᵀ K⁻¹.
    """

    def __init__(self, rows: Array, stiffness: Array, structure: Structure):
        """Solve for each row of Bᵀ (m, local) with a spring (m,) in N/m above zero."""
        self._structure = structure
        self._near = structure.factor.solve(np.asfortranarray(rows.T))
        self._core = np.linalg.inv(np.diag(1.0 / stiffness) + structure.inner(rows.T, self._near))

    def solve(self, block: Array) -> Array:
        """(K + B D Bᵀ)⁻¹ times the columns of a block (local, k)."""
        moved = self._core @ self._structure.inner(self._near, block)
        return np.asarray(self._structure.factor.solve(block) - self._near @ moved)


def contact_frequencies(structure: Structure, stiffness: Array, count: int) -> Array:
    """The lowest natural frequencies without contact, and with all contact points stuck.

    Args:
        structure: the structure.
        stiffness: (m,) springs of the contact rows, N/m.
        count: number of frequencies.

    Returns:
        (count, 2) Hz.

    Raises:
        ConvergenceError, AccuracyError: the modes were not found.
    """
    held = np.flatnonzero(stiffness > 0.0)
    rows = structure.contact_rows[held].toarray()
    stuck = SupportedInverse(rows, stiffness[held], structure) if held.size else structure.factor
    squares = [structure.eigenmodes(inverse, count)[0] for inverse in (structure.factor, stuck)]
    return np.sqrt(np.maximum(np.transpose(squares), 0.0)) / (2.0 * np.pi)


def component_modes(
    structure: Structure, options: Basis, rigid: Array | None = None
) -> ComponentModes:
    """Compute the normal and static modes of a method.

    Those of a free body are elastic: a motion relative to its rigid one needs no others.

    Args:
        structure: the structure; its `factor` does every solve.
        options: `method`, `modes` (number of normal modes) and `masters`.
        rigid: (local, r) mass-orthonormal rigid motions, which become the first normal modes.

    Returns:
        The component modes.

    Raises:
        SceneError: there are fewer free unknowns than modes; the supports forbid a contact
            direction; or contact directions depend on one another.
        ConvergenceError: the eigensolver did not find all modes.
        AccuracyError: a mode failed its residual check.
    """
    rubin = options.method == "rubin"
    b, attachment = master_directions(structure, options.masters or "all")
    m = b.shape[0]
    contact_flexibility = structure.inner(b.T, attachment)
    masters = unit_displacements(structure, b, contact_flexibility)
    inverse: Inverse = structure.factor
    if m and not rubin:
        inverse = ConstrainedInverse(structure.factor, b, masters, structure)
    free = structure.free - (0 if rubin else m)
    omega_squared, normal, elastic = solve_eigenmodes(structure, inverse, options.modes, free)
    rigid = normal[:, :0] if rigid is None else rigid
    omega_squared = np.append(np.zeros(rigid.shape[1]), omega_squared)
    normal, count = np.concatenate([rigid, normal], axis=1), rigid.shape[1] + elastic
    # of a body with Coriolis forces the whole pencil was judged (`fem.equilibrium.buckling`)
    if structure.gyroscopic is None and np.any(omega_squared < 0.0):
        what = "the equilibrium is unstable" if structure.symmetric else "of the symmetric part"
        number = counted(int(np.sum(omega_squared < 0)), "mode")
        structure.warnings.append(Note(NoteKind.UNSTABLE, f"{what}: omega^2 < 0 of {number}"))
    normal = align_modes(structure, omega_squared, normal)[:, :count]
    static = masters
    if rubin:
        static = _residual_attachments(structure, normal, b, attachment)
        contact_flexibility = structure.inner(b.T, static)
    numbers = {"R": rigid.shape[1], "V": elastic, "S": m}
    labels = tuple(f"{k + 1}{kind}" for kind, size in numbers.items() for k in range(size))
    held, omega = np.concatenate([masters, normal], axis=1), np.sqrt(omega_squared.clip(0.0))
    return ComponentModes(
        method=options.method,
        omega=omega[:count],
        normal=normal,
        static=static,
        masters=masters,
        rows=b,
        inverse=inverse,
        labels=labels,
        flexibility_condition=scaled_condition(contact_flexibility),
        loads=load_vectors(structure, held, load_responses(structure)),
        rigid=rigid.shape[1],
    )


def _residual_attachments(
    structure: Structure, normal: Array, rows: Array, attachment: Array
) -> Array:
    """Ψʳ (local, m) of attachment modes G (local, m), without the part of modes (local, v).

    The modal flexibility is 1/ω²; rotated modes of a split pair make it slightly non-diagonal.
    """
    if not normal.shape[1]:
        return attachment
    inertia = structure.mass_times(normal)
    flexibility = structure.inner(inertia, structure.factor.solve(inertia))
    return attachment - normal @ (flexibility @ structure.inner(normal, rows.T))


def with_mode_count(scene: Scene, modes: ComponentModes) -> Scene:
    """The scene in which the number of normal modes replaces "auto"."""
    elastic = modes.omega.size - modes.rigid
    return replace(scene, basis=replace(scene.basis, modes=elastic))


def unit_displacements(structure: Structure, rows: Array, flexibility: Array) -> Array:
    """Compute R_m of (2) for contact coordinates.

    Args:
        structure: the structure.
        rows: (m, local) Bᵀ.
        flexibility: (m, m) Bᵀ K⁻¹ B.

    Returns:
        (local, m) R_m.
    """
    if rows.shape[0] == 0:
        return np.zeros((structure.local, 0))
    near = structure.factor.solve(rows.T @ np.linalg.inv(flexibility))
    return np.asarray(near @ np.linalg.inv(structure.inner(rows.T, near)))


def close_frequency_groups(omega: Array, tolerance: float) -> list[slice]:
    """Split frequencies into groups of close neighbours.

    Args:
        omega: (k,) frequencies, neighbours next to each other.
        tolerance: largest distance of two neighbours in a group, relative to the second one.

    Returns:
        The groups, in order; they cover all k frequencies.
    """
    apart = np.flatnonzero(~(np.abs(np.diff(omega)) <= tolerance * omega[1:])) + 1
    ends = [0, *map(int, apart), omega.size] if omega.size else []
    return [slice(begin, end) for begin, end in pairwise(ends)]


def _equal_groups(omega: Array) -> list[slice]:
    """Groups of frequencies (k,) that are equal, or would be on a symmetric mesh: close pairs."""
    groups: list[slice] = []
    for near in close_frequency_groups(omega, PAIR_TOLERANCE):
        pair = near.stop - near.start <= 2
        equal = close_frequency_groups(omega[near], PAIR_TOLERANCE if pair else EQUAL)
        groups += [slice(near.start + group.start, near.start + group.stop) for group in equal]
    return groups


def align_modes(structure: Structure, omega_squared: Array, modes: Array) -> Array:
    """Align modes of equal frequency with the loads and contacts, and fix the sign of each mode.

    A symmetric section has pairs of modes that an eigensolver returns at an arbitrary angle. The
    directions are the loads, then the contact coordinates, the probe and the translations. In each
    group of `_equal_groups`, the first mode does all the work on the first direction, the second
    mode all the remaining work on the next direction, and so on. Every mode does positive work on
    the first direction on which it does work.

    Args:
        structure: the structure.
        omega_squared: (k,) ω², ascending.
        modes: (local, k) mass-normalised modes.

    Returns:
        (local, k) rotated modes.
    """
    if modes.shape[1] == 0:
        return modes
    work = np.concatenate(
        [
            structure.inner(modes, structure.load_vectors),
            structure.inner(structure.contact_rows.T, modes).T,
            structure.inner(modes, structure.probe_rows.T),
            structure.mass_inner(modes, structure.translations()),
        ],
        axis=1,
    )
    largest = np.max(np.abs(work), axis=0)
    works = np.abs(work) > FACING_TOLERANCE * largest
    aligned = modes.copy()
    for group in _equal_groups(np.sqrt(np.abs(omega_squared))):
        size = group.stop - group.start
        if size > 1:
            useful = np.flatnonzero(np.any(works[group], axis=0))
            columns = np.concatenate([work[group][:, useful], np.eye(size)], axis=1)
            q, _ = np.linalg.qr(columns, mode="complete")
            aligned[:, group] = modes[:, group] @ q
            work[group] = q.T @ work[group]
            works[group] = np.abs(work[group]) > FACING_TOLERANCE * largest
    for k in range(aligned.shape[1]):
        first = np.flatnonzero(works[k])
        if first.size and work[k, first[0]] < 0.0:
            aligned[:, k] *= -1.0
    return aligned
