"""Forces and moments of the supports on the body, from the stresses and from the momentum.

The equations of the clamped unknowns, which no model solves, give the force of a support. With a
test function W that is a unit translation (or rotation) of its nodes and zero on all others, and
the load vectors p of unit loads,

    R = ∫ (F S) : ∇W + W · [M (ü + α u̇) + D u̇ + k u - Ω² (c + Q u)] - Σ W · p_k s_k(t),    (1)

where D u̇ are the Coriolis force Γ u̇ and the viscous forces of [damping] and of dashpots, and k u
the forces of springs to the ground. Stiffness and mass in these viscous forces are those of the
whole body with its clamped unknowns. S is the elastic stress.

All terms but the first are linear in the coordinates, and ∇W is zero outside the cells at the
support. The same equation with a translation of the whole body has no stresses: the rate of
momentum minus all loads, contact forces and forces to the ground is the sum of the reactions. Both
agree if the equations of the free unknowns are fulfilled: for the equilibrium to the tolerance of
its solution, for a reduced motion as far as its basis can. The momentum is then the more accurate
one; the difference shows how well the basis resolves the stresses at the supports.

Moments are about the centroid of the clamped nodes of the support.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import closed_springs, contacts_of, paired, trial_forces
from fenicsrom.online.model.loads import factors
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.measures import has_contact
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.stress import (
    Deformation,
    StressLaw,
    StressTable,
    deformation_at,
    principal,
    von_mises,
)
from fenicsrom.scene import Scene


@dataclass(frozen=True, eq=False)
class ReactionTable:
    """The terms of (1) of S supports and of the whole body, in d dimensions with n coordinates.

    There are m test functions for each: d translations, then 1 rotation in 2D or 3 in 3D. The last
    entry of an axis of S + 1 is the whole body, whose rotations are zero.

    Attributes:
        centre: (S, d) centroids of the clamped nodes, m.
        support: (R,) support that each Gauss point belongs to.
        gradients: (1 + n, R, d, d) displacement gradients of u₀ and of every φ.
        tests: (m, R, d, d) gradients of the test functions times the volume of the points, m².
        mass: (S + 1, m, n) W · M φ, kg.
        velocity: (S + 1, m, n) W · D φ, kg/s.
        static: (S + 1, m, 1 + n) W · (k u₀ - Ω² (c + Q u₀)) in N, then W · (k - Ω² Q) φ.
        loads: (S + 1, m, loads) W · p of the unit loads.
        material: (R,) number of the material of each Gauss point; None with one material.
    """

    centre: Array
    support: NDArray[np.int64]
    gradients: Array
    tests: Array
    mass: Array
    velocity: Array
    static: Array
    loads: Array
    material: NDArray[np.int64] | None = None

    def evaluate(
        self, law: StressLaw, q: Array, velocity: Array, inertia: Array, factor: Array
    ) -> tuple[Array, Array]:
        """Reactions (k, S, m), and the sum of all forces (k, d) of the supports by momentum, N.

        The second is without the contact forces.

        Args:
            law: the law of the stresses.
            q: (k, n) coordinates.
            velocity: (k, n) their velocities.
            inertia: (k, n) accelerations plus α times the velocities.
            factor: (k, loads) time factors of the loads.
        """
        smooth = (
            inertia @ self.mass.transpose(0, 2, 1)
            + velocity @ self.velocity.transpose(0, 2, 1)
            + q @ self.static[:, :, 1:].transpose(0, 2, 1)
            + self.static[:, None, :, 0]
            - factor @ self.loads.transpose(0, 2, 1)
        ).transpose(1, 0, 2)
        change = np.asarray(np.tensordot(q, self.gradients[1:], axes=1), np.float64)
        stress = law.at(self.material).first_piola(self.gradients[0], change)
        count, d = self.centre.shape
        found = smooth[:, :count].copy()
        for support in range(count):
            mine = self.support == support
            each = stress[:, mine], self.tests[:, mine]
            found[:, support] += np.tensordot(*each, axes=((1, 2, 3), (1, 2, 3)))
        return found, smooth[:, -1, :d]


@dataclass(frozen=True, eq=False)
class Reactions:
    """The reactions of S supports at k instants; m components: forces (N), then moments (N m).

    Attributes:
        supports: names of the supports.
        time: (k,) s.
        values: (k, S, m) from the stresses at the support.
        by_momentum: (k, d) sum of the forces of all supports, from the momentum of the body, N.
    """

    supports: tuple[str, ...]
    time: Array
    values: Array
    by_momentum: Array

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the m components, with their units."""
        forces = [f"force_{axis}_N" for axis in "xyz"[: self.by_momentum.shape[1]]]
        axes = "z" if self.by_momentum.shape[1] == 2 else "xyz"
        return (*forces, *(f"moment_{axis}_Nm" for axis in axes))

    @property
    def mismatch(self) -> float:
        """Largest difference of the two sums of forces, relative to their largest change.

        The change is that from the mean, which static loads and the centrifugal force dominate;
        where nothing changes, the difference is relative to the force itself.
        """
        d = self.by_momentum.shape[1]
        difference = self.values[:, :, :d].sum(axis=1) - self.by_momentum
        worst = float(np.linalg.norm(difference, axis=1).max(initial=0.0))
        changes = self.by_momentum - self.by_momentum.mean(axis=0)
        for forces in (changes, self.by_momentum):
            size = float(np.linalg.norm(forces, axis=1).max(initial=0.0))
            if size > 0.0:
                return worst / size
        return float(worst > 0.0)


def support_names(scene: Scene) -> tuple[str, ...]:
    """A name of each support: that of its group, where it has one, and there is no other."""
    groups = [support.group for support in scene.supports]
    return tuple(
        group if group and groups.count(group) == 1 else f"supports[{k}]"
        for k, group in enumerate(groups)
    )


def equilibrium_reactions(table: ReactionTable, scene: Scene) -> Reactions:
    """The reactions in the static equilibrium; only bodies that touch press on walls there."""
    none = np.zeros((1, table.mass.shape[2]))
    sizes = np.array([[load.size if load.static else 0.0 for load in scene.loads]])
    sizes = sizes.reshape(1, len(scene.loads))
    values, total = table.evaluate(StressLaw.of(scene), none, none, none, sizes)
    return Reactions(support_names(scene), np.zeros(1), values, total)


def motion_reactions(table: ReactionTable, scene: Scene, model: Any, motion: Motion) -> Reactions:
    """The mean reactions of each time step of the last period of a motion.

    The mean of a step does not contain the oscillations from step to step of waves that the time
    step does not resolve. The mean of the stresses is exact, by two Gauss points along the step;
    that of the inertia is the change of momentum. With the discrete gradient these are the terms of
    the balance that the step fulfils.

    Args:
        table: the table of the model.
        scene: the scene of the motion.
        model: the reduced model.
        motion: its motion, with coordinates at two instants or more.
    """
    q, v, time = motion.coordinates, motion.velocity, motion.coordinate_time
    assert q is not None and v is not None and time is not None
    middle, half = 0.5 * (q[1:] + q[:-1]), (q[1:] - q[:-1]) / (2.0 * np.sqrt(3.0))
    velocity = 0.5 * (v[1:] + v[:-1])
    inertia = np.diff(v, axis=0) / np.diff(time)[:, None] + model.damping * velocity
    instant = np.array([factors(model.load_histories, float(t)) for t in time])
    factor = 0.5 * (instant[1:] + instant[:-1]).reshape(time.size - 1, len(scene.loads))
    law = StressLaw.of(scene)
    ends = [
        table.evaluate(law, middle + side * half, velocity, inertia, factor) for side in (-1.0, 1.0)
    ]
    values, total = (0.5 * (one + other) for one, other in zip(*ends, strict=True))
    force = motion.mean_force[1 - time.size :].copy()
    if scene.joined:  # bodies that touch push one another with equal forces
        rest = trial_forces(contacts_of(scene, model.points), model.contact_offset)
        force[:, :, 0] -= rest.clip(0.0)  # it is in the table
        force[:, paired(scene, model.points)] = 0.0
    total = total + np.einsum("kpi,pix->kx", force, model.points.frame)
    return Reactions(support_names(scene), 0.5 * (time[1:] + time[:-1]), values, total)


@dataclass(frozen=True, eq=False)
class Recovery:
    """The tables of the stresses and of the reactions of a reduced model."""

    stress: StressTable
    reactions: ReactionTable

    def of(self, chosen: Sequence[int]) -> Recovery:
        """The tables of some of the coordinates."""
        at = np.asarray(chosen, dtype=np.int64)
        if np.array_equal(at, np.arange(len(self.stress.gradients) - 1)):
            return self
        rows, stress, reactions = np.append(0, 1 + at), self.stress, self.reactions
        return Recovery(
            replace(
                stress,
                gradients=stress.gradients[rows],
                vertex_displacement=stress.vertex_displacement[rows],
            ),
            replace(
                reactions,
                gradients=reactions.gradients[rows],
                mass=reactions.mass[:, :, at],
                velocity=reactions.velocity[:, :, at],
                static=reactions.static[:, :, rows],
            ),
        )

    def about(self, q0: Array) -> Recovery:
        """The tables in the same coordinates, measured from a state q0 (n,)."""
        weights = np.append(1.0, q0)

        def moved(values: Array) -> Array:
            return np.concatenate([np.tensordot(weights, values, 1)[None], values[1:]])

        stress, reactions = self.stress, self.reactions
        static = np.moveaxis(moved(np.moveaxis(reactions.static, 2, 0)), 0, 2)
        return Recovery(
            replace(
                stress,
                gradients=moved(stress.gradients),
                vertex_displacement=moved(stress.vertex_displacement),
            ),
            replace(reactions, gradients=moved(reactions.gradients), static=static),
        )


CHUNK_BYTES = 50e6  # memory of the gradients of one block of instants

EQUILIBRIUM = "equilibrium"
LAST_PERIOD = "largest of the last period"
WHOLE_MOTION = "largest of the motion"


@dataclass(frozen=True, eq=False)
class Peak:
    """The largest von Mises stress of the body in one state.

    Attributes:
        state: name of the state.
        time: instant, s; None for the equilibrium and for modes.
        coordinates: (n,) q of the state; of a mode, a direction.
        von_mises: largest value at the vertices, Pa; of a mode, Pa per m of its largest
            displacement.
        position: (d,) place of this vertex in the undeformed body, m.
        principal: (3,) principal stresses there, in the unit of `von_mises`.
        point_von_mises: largest value at the Gauss points, without extrapolation.
        point_position: (d,) place of this Gauss point, m.
        frequency: frequency of a mode, Hz; else None.
    """

    state: str
    time: float | None
    coordinates: Array
    von_mises: float
    position: Array
    principal: Array
    point_von_mises: float
    point_position: Array
    frequency: float | None = None


@dataclass(frozen=True, eq=False)
class Stresses:
    """The stresses of a run.

    Attributes:
        measure: the stress, one of `fenicsrom.online.stress.stress.MEASURES`.
        peaks: largest stresses of the equilibrium, of the motion and at marked instants.
        modes: largest stresses of the modes about the equilibrium.
        reactions: reactions of the supports in the equilibrium.
        motion_reactions: the reactions during the last period; None without a motion.
        deformations: deformations in the states of the peaks.
    """

    measure: str
    peaks: tuple[Peak, ...]
    modes: tuple[Peak, ...]
    reactions: Reactions
    motion_reactions: Reactions | None
    deformations: tuple[Deformation, ...]

    @property
    def largest(self) -> Peak:
        """The peak with the largest von Mises stress."""
        return max(self.peaks, key=lambda peak: peak.von_mises)


def find_stresses(
    recovery: Recovery,
    scene: Scene,
    model: object,
    motion: Motion | None,
    modes: Mapping[int, float],
) -> Stresses:
    """The stresses and reactions of the equilibrium, of the lowest modes and of a motion.

    Args:
        recovery: the tables of the model.
        scene: the scene; its [output] gives the stress.
        model: the model; the stresses of its modes are found if it is a `ReducedModel`.
        motion: its motion, or None. The stresses of a motion need its coordinates.
        modes: as `known` of `reduced_modes`.
    """
    table, measure = recovery.stress, scene.output.stresses
    peaks = [equilibrium_peak(table, measure)]
    moving = None
    if motion is not None and motion.coordinates is not None:
        peaks += motion_peaks(table, motion, measure)
        if motion.coordinates.shape[0] > 1:
            moving = motion_reactions(recovery.reactions, scene, model, motion)
    modal: tuple[Peak, ...] = ()
    if isinstance(model, ReducedModel) and modes:
        numbers, frequencies, vectors = reduced_modes(model, scene, modes)
        names = [f"mode {number}" for number in numbers]
        modal = modal_peaks(table, frequencies, vectors, names)
    rest = equilibrium_reactions(recovery.reactions, scene)
    deformed = tuple(deformation_at(table, peak.coordinates) for peak in peaks)
    return Stresses(measure, tuple(peaks), modal, rest, moving, deformed)


def peak(
    table: StressTable,
    stress: Array,
    state: str,
    coordinates: Array,
    time: float | None = None,
    frequency: float | None = None,
) -> Peak:
    """The largest von Mises stress of stresses (P, 6) at the Gauss points."""
    recovered = table.at_vertices(stress)
    vertex, point = von_mises(recovered), von_mises(stress)
    k, p = int(np.argmax(vertex)), int(np.argmax(point))
    return Peak(
        state=state,
        time=time,
        coordinates=coordinates,
        von_mises=float(vertex[k]),
        position=table.vertex_position[k],
        principal=principal(recovered[k]),
        point_von_mises=float(point[p]),
        point_position=table.position[p],
        frequency=frequency,
    )


def equilibrium_peak(table: StressTable, measure: str) -> Peak:
    """The largest stress of the equilibrium."""
    rest = np.zeros(table.size)
    return peak(table, table.stress(rest, measure), EQUILIBRIUM, rest)


def motion_peaks(table: StressTable, motion: Motion, measure: str) -> tuple[Peak, ...]:
    """The largest stresses of the last period of a motion, and at its marked instants.

    The marked instants are those of the largest displacement of the first contact point (or of the
    probe) and of the largest contact force. Without a period, the last period is the whole motion.

    Args:
        table: the table of the model.
        motion: the motion, with coordinates.
        measure: one of `fenicsrom.online.stress.stress.MEASURES`.
    """
    q, time = motion.coordinates, motion.coordinate_time
    assert q is not None and time is not None
    recorded = slice(motion.time.size - time.size, motion.time.size)
    state = LAST_PERIOD if motion.period is not None else WHOLE_MOTION
    rows = {state: largest_row(table, q, measure)}
    moved = np.linalg.norm(motion.displacement[recorded, 0], axis=1)
    rows["largest displacement"] = int(np.argmax(moved))
    if has_contact(motion) and np.any(motion.force[recorded, :, 0] > 0.0):
        rows["largest contact force"] = int(np.argmax(motion.force[recorded, :, 0].sum(axis=1)))
    return tuple(
        peak(table, table.stress(q[row], measure), name, q[row], float(time[row]))
        for name, row in rows.items()
    )


def largest_row(table: StressTable, q: Array, measure: str) -> int:
    """The row of the coordinates (k, n) with the largest von Mises stress at a vertex."""
    size = table.gradients[0].nbytes
    rows = max(1, int(CHUNK_BYTES / size))
    largest = [
        von_mises(table.at_vertices(table.stress(q[start : start + rows], measure))).max(axis=1)
        for start in range(0, q.shape[0], rows)
    ]
    return int(np.argmax(np.concatenate(largest)))


def reduced_modes(
    model: ReducedModel, scene: Scene, known: Mapping[int, float]
) -> tuple[list[int], Array, Array]:
    """The normal modes of a reduced model about its equilibrium that are modes of the structure.

    No contact point touches, or those of bodies that touch stick where they are closed; and there
    is no Coriolis force. A basis may leave modes out, and its
    other vectors make modes that the structure does not have. So a mode of the structure is the
    mode of the model that has its frequency.

    Args:
        model: the model, of n coordinates.
        scene: its scene.
        known: the frequencies of the structure's modes in the basis by their numbers, Hz; nan takes
            the mode of this number of the model.

    Returns:
        The numbers (k,), ascending, the frequencies (k,) in Hz, and the modes (n, k).
    """
    import scipy.linalg  # slow to import, and few models have stresses
    from scipy.optimize import linear_sum_assignment

    stiffness, rows = model.elastic.stiffness, model.contact_rows
    if scene.joined:
        springs = closed_springs(contacts_of(scene, model.points), model.contact_offset)
        stiffness = stiffness + rows.T @ (springs[:, None] * rows)
    squares, vectors = scipy.linalg.eigh(stiffness, model.mass)
    frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2.0 * np.pi)
    numbers = [number for number in sorted(known) if number <= model.size]
    asked = np.array([known[number] for number in numbers])
    chosen = np.array(numbers, dtype=np.int64) - 1
    if np.all(np.isfinite(asked)):
        chosen = linear_sum_assignment(np.abs(asked[:, None] - frequencies))[1]
    return numbers, frequencies[chosen], vectors[:, chosen]


def modal_peaks(
    table: StressTable, frequencies: Array, vectors: Array, names: Sequence[str]
) -> tuple[Peak, ...]:
    """The largest stresses of modes, per metre of the largest displacement of a vertex.

    Args:
        table: the table of the model.
        frequencies: (v,) Hz.
        vectors: (n, v) modes in the coordinates of the table.
        names: (v,) names of the modes.
    """
    found = []
    for k, name in enumerate(names):
        moved = np.tensordot(vectors[:, k], table.vertex_displacement[1:], axes=1)
        direction = vectors[:, k] / np.linalg.norm(moved, axis=1).max()
        stress = table.modal_stress(direction)
        found.append(peak(table, stress, name, direction, frequency=float(frequencies[k])))
    return tuple(found)
