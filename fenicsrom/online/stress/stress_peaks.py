"""The largest stresses of a reduced model: at rest, in its modes, and during a motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.measures import has_contact
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.deformation import Deformation, deformation_at
from fenicsrom.online.stress.reactions import Reactions, equilibrium_reactions, motion_reactions
from fenicsrom.online.stress.recovery import Recovery
from fenicsrom.online.stress.stress import StressTable, principal, von_mises
from fenicsrom.scene import Scene

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
        numbers, frequencies, vectors = reduced_modes(model, modes)
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
        state,
        time,
        coordinates,
        float(vertex[k]),
        table.vertex_position[k],
        principal(recovered[k]),
        float(point[p]),
        table.position[p],
        frequency,
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
    rows = {state: _largest_row(table, q, measure)}
    moved = np.linalg.norm(motion.displacement[recorded, 0], axis=1)
    rows["largest displacement"] = int(np.argmax(moved))
    if has_contact(motion) and np.any(motion.force[recorded, :, 0] > 0.0):
        rows["largest contact force"] = int(np.argmax(motion.force[recorded, :, 0].sum(axis=1)))
    return tuple(
        peak(table, table.stress(q[row], measure), name, q[row], float(time[row]))
        for name, row in rows.items()
    )


def _largest_row(table: StressTable, q: Array, measure: str) -> int:
    """The row of the coordinates (k, n) with the largest von Mises stress at a vertex."""
    size = table.gradients[0].nbytes
    rows = max(1, int(CHUNK_BYTES / size))
    largest = [
        von_mises(table.at_vertices(table.stress(q[start : start + rows], measure))).max(axis=1)
        for start in range(0, q.shape[0], rows)
    ]
    return int(np.argmax(np.concatenate(largest)))


def reduced_modes(
    model: ReducedModel, known: Mapping[int, float]
) -> tuple[list[int], Array, Array]:
    """The normal modes of a reduced model about its equilibrium that are modes of the structure.

    No contact point touches, and there is no Coriolis force. A basis may leave modes out, and its
    other vectors make modes that the structure does not have. So a mode of the structure is the
    mode of the model that has its frequency.

    Args:
        model: the model, of n coordinates.
        known: the frequencies of the structure's modes in the basis by their numbers, Hz; nan takes
            the mode of this number of the model.

    Returns:
        The numbers (k,), ascending, the frequencies (k,) in Hz, and the modes (n, k).
    """
    import scipy.linalg  # slow to import, and few models have stresses
    from scipy.optimize import linear_sum_assignment

    squares, vectors = scipy.linalg.eigh(model.elastic.stiffness, model.mass)
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
