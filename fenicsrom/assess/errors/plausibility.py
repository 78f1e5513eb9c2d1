"""Loads, motions and strains that are most likely consequences of wrong input."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from fenicsrom.arrays import Array
from fenicsrom.notes import Note, NoteKind, has_kind, implausible
from fenicsrom.online.contact.points import ContactPoints, closed_springs, contacts_of, shares
from fenicsrom.online.model.loads import largest
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.reactions import Stresses
from fenicsrom.online.stress.stress import Deformation, StressLaw
from fenicsrom.scene import Scene
from fenicsrom.scene.keys.excitation import highest_frequency

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid


EQUILIBRIUM = "in equilibrium"

LARGE_STRAIN = 0.1
"""Strain from which the user is warned. At a stretch of 0.9, the slope of the law under
uniaxial stress is ½ (3 · 0.9² − 1) = 72 % of Young's modulus."""


LARGE_MOTION = 0.1
"""The strains of a motion that is smaller than this part of the body are hardly large."""


def strain_warnings(states: Sequence[tuple[str, Deformation]]) -> list[Note]:
    """Say where the material is turned inside out, or is compressed so much that it softens.

    Args:
        states: where a state is, such as "at the load factor 2", and its deformation.

    Returns:
        A sentence on the first state that turns the material inside out; else a sentence on the
        first state with a large compression, or else with a large extension, if there is one.
    """
    for where, state in states:
        if state.is_inverted:
            place = ", ".join(f"{x + 0.0:.4g}" for x in state.position)
            text = (
                f"the material is turned inside out {where}: the volume ratio det F is "
                f"{state.volume_ratio:.2g} at ({place}) m, where the St Venant-Kirchhoff law has "
                "no meaning"
            )
            return [Note(NoteKind.LAW, text)]
    compressed = [1.0 - state.smallest_stretch for _, state in states]
    extended = [state.largest_stretch - 1.0 for _, state in states]
    for strains, name, meaning in (
        (compressed, "compressive", "softens in compression and loses its stiffness at 42 %"),
        (extended, "tensile", "is made for small strains, and hardens in tension"),
    ):
        for (where, _), strain in zip(states, strains, strict=True):
            if strain > LARGE_STRAIN:
                text = (
                    f"the {name} strain exceeds {100.0 * LARGE_STRAIN:g} % {where} and reaches "
                    f"{100.0 * max(strains):.3g} %: the St Venant-Kirchhoff law {meaning}"
                )
                return [Note(NoteKind.LAW, text)]
    return []


def equilibrium_deformation(solid: Solid, scene: Scene) -> Deformation | None:
    """The deformation in the equilibrium of a solid; None of an undeformed one. Collective."""
    from fenicsrom.fem.body.stress_points import body_deformation

    if not solid.loaded or not StressLaw.of(scene).deformed:
        return None
    return body_deformation(solid, scene, solid.equilibrium)


def equilibrium_warnings(found: Deformation | None) -> list[Note]:
    """The sentences of `strain_warnings` on an equilibrium; none on an undeformed body."""
    return [] if found is None else strain_warnings([(EQUILIBRIUM, found)])


def motion_warnings(
    solid: Solid, scene: Scene, vectors: Array, motion: Motion, strains: bool = True
) -> list[Note]:
    """The sentences of `strain_warnings` and `turns` on the state with most elastic energy.

    Args:
        solid: the solid.
        scene: its scene.
        vectors: (local, n) the basis.
        motion: a motion with the coordinates of its last period.
        strains: whether its strains are judged.
    """
    from fenicsrom.fem.body.stress_points import body_deformation

    assert motion.coordinates is not None and motion.coordinate_time is not None
    energies = motion.elastic[-motion.coordinate_time.size :]
    k = int(np.argmax(energies))
    u = solid.equilibrium + vectors @ motion.coordinates[k]
    where = f"at t = {motion.coordinate_time[k]:.6g} s"
    found = [*turns(solid, scene, u[:, None])]
    if strains:
        found += strain_warnings([(where, body_deformation(solid, scene, u))])
    return found


def state_warnings(stresses: Stresses, *, motion_only: bool = False) -> list[Note]:
    """The sentences of `strain_warnings` on the states whose stresses were found.

    Args:
        stresses: the stresses of the run, with their states.
        motion_only: whether to leave out the equilibrium, which `equilibrium_warnings` judged.
    """
    return strain_warnings(
        [
            (EQUILIBRIUM if peak.time is None else f"at t = {peak.time:.6g} s", deformed)
            for peak, deformed in zip(stresses.peaks, stresses.deformations, strict=True)
            if peak.time is not None or not motion_only
        ]
    )


FAR = 100.0
"""Ratio of frequencies beyond which one of them is most likely wrong."""

UNEQUAL = 1e6
"""Ratio of the linear static responses to two loads beyond which one load is most likely wrong."""

TOO_LARGE = 10.0
"""Linear response, in extents of the body, beyond which the loads are most likely wrong."""

DEEP = 0.05
"""Compression of a contact spring, in extents of the body, beyond which it is most likely wrong."""

OUT_OF_REACH = 10.0
"""A surface whose least gap is this many times the travel of the points is most likely wrong."""


def is_explained(warnings: Sequence[str]) -> bool:
    """Whether there is a likely cause already, which the sentences of this module would repeat."""
    return has_kind(warnings, NoteKind.IMPLAUSIBLE)


def implausible_loads(
    model: Any, scene: Scene, frequencies: Array, extent: float = np.inf
) -> list[Note]:
    """One sentence on loads far too fast, slow, large or unequal, or on damping; else none.

    Args:
        model: the reduced model.
        scene: its scene.
        frequencies: (v,) its natural frequencies, Hz.
        extent: largest extent of the body, m.
    """
    return list(islice(_of_loads(model, scene, frequencies, extent), 1))


def _of_loads(model: Any, scene: Scene, frequencies: Array, extent: float) -> Iterator[Note]:
    """The sentences of `implausible_loads`, the most likely cause first."""
    first, highest = float(np.min(frequencies, initial=np.inf)), highest_frequency(scene)
    units = "check the lengths, the material and the frequencies, and their units ([units])"
    if 0.0 < highest * FAR < first < np.inf:
        yield implausible(
            f"the scene excites up to {highest:.4g} Hz, 1/{first / highest:.3g} of "
            f"the first natural frequency of {first:.4g} Hz: the motion is nearly static; {units}"
        )
    if scene.period is not None and 0.0 < first * FAR * scene.period < 1.0:
        yield implausible(
            f"the loads repeat at {1.0 / scene.period:.4g} Hz, "
            f"{1.0 / (first * scene.period):.3g} times the first natural frequency of {first:.4g} "
            f"Hz: {units}"
        )
    if not isinstance(model, ReducedModel):
        return
    stiffness = closed_stiffness(model, scene)
    squares, shapes = eigh(stiffness, model.mass, subset_by_index=[0, 0])
    damped = model.velocity_matrix
    viscous = float(np.sum(shapes.T @ damped @ shapes)) if damped.size else 0.0
    if squares[0] > 0.0 and model.damping + viscous > 2.0 * np.sqrt(squares[0]):
        yield implausible(
            "the first mode has a damping ratio of "
            f"{(model.damping + viscous) / (2.0 * np.sqrt(squares[0])):.3g}: it does not swing; "
            "check material.mass_damping, [damping] and the dashpots, and their units ([units])"
        )
    sizes = largest(model.load_histories)
    if not sizes.size:
        return
    loads = model.loads * sizes
    # with (K + omega^2 M)^-1 the response is smaller than a static one, and than that of a free
    # body of the same mass
    rows = np.concatenate([model.contact_rows, model.probe])
    inertia = (2.0 * np.pi * highest) ** 2 * model.mass
    found = np.abs(rows @ np.linalg.solve(stiffness + inertia, loads))
    moved: Array = np.max(found, axis=0, initial=0.0)
    if moved.max() > TOO_LARGE * extent:
        yield implausible(
            f"loads[{int(np.argmax(moved))}] would move the linear body by "
            f"{moved.max():.3g} m, and the body is {extent:.4g} m long: check the sizes of the "
            "loads, the material and the lengths, and their units ([units])"
        )
    work = np.sum(loads * np.linalg.solve(stiffness, loads), axis=0)
    size: Array = np.sqrt(np.abs(work))
    large, small = int(np.argmax(size)), int(np.argmin(np.where(size > 0.0, size, np.inf)))
    if size[large] > UNEQUAL * size[small]:
        yield implausible(
            f"loads[{large}] deforms the body {size[large] / size[small]:.2g} times as "
            f"much as loads[{small}]: check the sizes and units of both ([units])"
        )


def closed_stiffness(model: ReducedModel, scene: Scene) -> Array:
    """K (n, n) with the springs of the contacts between bodies that are closed at rest."""
    if not scene.joined:
        return model.elastic.stiffness
    springs = closed_springs(contacts_of(scene, model.points), model.contact_offset)
    return np.asarray(
        model.elastic.stiffness + (model.contact_rows.T * springs) @ model.contact_rows
    )


def implausible_motion(
    motion: Motion, points: ContactPoints, extent: float, scene: Scene
) -> list[Note]:
    """One sentence on a motion larger than its body, far from its surfaces or in them; else none.

    Args:
        motion: the motion.
        points: its contact points.
        extent: largest extent of the body, m.
        scene: the scene of the motion.
    """
    return list(islice(_of_motion(motion, points, extent, scene), 1))


def _of_motion(
    motion: Motion, points: ContactPoints, extent: float, scene: Scene
) -> Iterator[Note]:
    """The sentences of `implausible_motion`."""
    moved = float(np.linalg.norm(motion.displacement, axis=2).max(initial=0.0))
    if moved > extent:
        yield implausible(
            f"the motion reaches {moved:.4g} m, and the body is {extent:.4g} m long: "
            "check the loads, the material and the lengths, and their units ([units])"
        )
    travel = np.ptp(motion.displacement, axis=0)
    for k in np.unique(points.contact):
        mine = np.flatnonzero(points.contact == k)
        stiffness = shares(scene, points)[mine] * scene.contacts[k].normal_stiffness
        depth = float(np.max(motion.force[:, mine, 0] / stiffness))
        if depth > DEEP * extent:
            yield implausible(
                f"the contact springs of contacts[{k}] are compressed by {depth:.3g} "
                f"m, and the body is {extent:.4g} m long: check the contact stiffness, the preload "
                "and the normal, and their units ([units])"
            )
        gap, reach = float(motion.gap[:, mine].min()), float(travel[mine, 0].max())
        if not np.any(motion.force[:, mine, 0] > 0.0) and gap > OUT_OF_REACH * reach:
            yield implausible(
                f"contacts[{k}] can hardly touch its surface: the smallest gap is "
                f"{1e3 * gap:.4g} mm, and the points move by {1e3 * reach:.4g} mm towards it and "
                "back: check the gap, the normal and the loads, and their units ([units])"
            )
    yield from slides(motion.displacement, motion.force[:, :, 0] > 0.0, points, scene)


def slides(
    displacement: Array, closed: NDArray[np.bool_], points: ContactPoints, scene: Scene
) -> Iterator[Note]:
    """A sentence on each contact between bodies whose points slide past their neighbours.

    Args:
        displacement: (ns, P, d) displacements of the contact points, m.
        closed: (ns, P) whether they are closed.
        points: the points.
        scene: their scene.
    """
    from scipy.spatial import cKDTree

    for number in (k for k, contact in enumerate(scene.contacts) if contact.against is not None):
        mine = np.flatnonzero(points.contact == number)
        x, moved = points.position[mine], displacement[:, mine, 1:]
        apart = np.median(cKDTree(x).query(x, 2)[0][:, 1])  # infinite for one point
        slide = np.linalg.norm(moved - moved[0], axis=2) * closed[:, mine]
        if (far := float(slide.max())) <= apart:
            continue
        text = (
            f"the points of contacts[{number}] slide by up to {1e3 * far:.3g} mm, and stand "
            f"{1e3 * apart:.3g} mm apart: they stay opposite the places where they were at the "
            "start, so pressure and friction are wrong; such slides need a rigid surface"
        )
        yield Note(NoteKind.WARNING, text, f"contacts[{number}]")


TURNED = 0.05
"""Turn of contact facets, rad, from which the user is warned: forces are off by this angle."""


def turns(solid: Solid, scene: Scene, fields: Array) -> Iterator[Note]:
    """A sentence on each contact between bodies whose facets turn while its normals do not.

    The turn of a node is that of the lines to its neighbours. Collective.

    Args:
        solid: the solid.
        scene: its scene.
        fields: (local, k) displacements from the undeformed body, m.
    """
    from scipy.spatial import cKDTree

    if not scene.geometrically_nonlinear:
        return
    d, comm = solid.dimension, solid.comm
    places = solid.space.tabulate_dof_coordinates()[:, :d]
    moved = fields.reshape(-1, d, fields.shape[1])
    for number, (nodes, _) in solid.sides.items():
        nodes = nodes[nodes < len(moved)]
        x, u = (np.concatenate(comm.allgather(part[nodes])) for part in (places, moved))
        near = cKDTree(x).query(x, range(2, d + 2))[1]
        if near.max() == len(x):  # fewer nodes than neighbours
            continue
        line, change = x[near] - x[:, None], u[near] - u[:, None]
        length = np.linalg.norm(line, axis=2)[..., None]
        length[length == 0.0] = np.inf  # nodes at the same place have no line
        along = np.einsum("nmd,nmdk->nmk", line / length, change)
        across = change - (line / length)[..., None] * along[:, :, None]
        if (turn := float(np.max(np.linalg.norm(across, axis=2) / length))) > TURNED:
            text = (
                f"the facets of contacts[{number}] turn by up to {turn:.2g} rad, and their normals "
                "stay those of the undeformed body: the directions of contact forces are off by "
                f"this angle, which should be at most {TURNED:g} rad"
            )
            yield Note(NoteKind.WARNING, text, f"contacts[{number}]")
