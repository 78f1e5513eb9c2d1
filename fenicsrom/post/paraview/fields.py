"""Fields of a study for ParaView and animations: shapes, the last period and contact points."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import Contacts, unit_normals
from fenicsrom.online.model.support_motion import moves_supports, support_displacement
from fenicsrom.online.motion.motion import Motion
from fenicsrom.post.paraview.paraview import array_name, cell_groups, notes, stress_fields
from fenicsrom.post.paraview.vtk import Attached, in_space, write_fields, write_motion, write_points
from fenicsrom.records import Study
from fenicsrom.scene import Scene

DISPLACEMENT, STATE = "displacement_m", "contact_state"
ABSOLUTE = "absolute_displacement_m"
FRAMES = 30  # largest number of frames of a motion for ParaView and of an animation


def frame_rows(motion: Motion) -> NDArray[np.int64]:
    """Select at most `FRAMES` rows of a motion at nearly equal times over its last period.

    The rows cover the whole motion if it has no period.
    """
    part = motion.last_period()
    rows = np.arange(motion.time.size)[part]
    if motion.coordinates is not None:  # a resumed run may know those of its last part only
        rows = rows[-motion.coordinates.shape[0] :]
    wanted = np.linspace(motion.time[rows[0]], motion.time[-1], FRAMES)
    return np.unique(np.interp(wanted, motion.time[rows], rows).round().astype(np.int64))


def frame_coordinates(motion: Motion) -> Array:
    """The coordinates (k, size) of a reduced motion at the rows of `frame_rows`."""
    assert motion.coordinates is not None
    return motion.coordinates[frame_rows(motion) - motion.time.size]


def contact_places(points: ContactPoints) -> Array:
    """Positions (P, 3) of the contact points in the undeformed body, m; z = 0 in 2D."""
    return in_space(points.position)


def contact_vectors(
    scene: Scene, points: ContactPoints, motion: Motion, contacts: Contacts | None = None
) -> tuple[Array, Array, Array]:
    """Positions of the contact points and contact forces on the body, in global axes.

    Args:
        scene: the scene.
        points: the contact points.
        motion: the motion.
        contacts: parameters of the contact points in the motion; by default those of the scene.

    Returns:
        Positions, m, normal forces (from the obstacle into the body), N, and friction forces, N,
        all (ns, P, 3); the third component is 0 in 2D.
    """
    d = scene.geometry.dimension
    frames = in_space(points.frame)
    contacts = contacts_of(scene, points) if contacts is None else contacts
    normals = unit_normals(contacts, motion.displacement, motion.time)
    normal = -motion.force[:, :, :1] * normals
    # the forces are given in the frames of the current normals: rotate them back
    friction = motion.force.copy()
    friction[:, :, 0] = 0.0
    across = np.sum(friction * normals, axis=2, keepdims=True)
    friction -= across / (1.0 + normals[:, :, :1]) * (normals + np.eye(d)[0])
    moved, normal, friction = (
        np.einsum("spk,pkx->spx", values, frames)
        for values in (motion.displacement, normal, -friction)
    )
    return contact_places(points) + moved, normal, friction


def contact_arrays(
    study: Study, motion: Motion, contacts: Contacts | None = None
) -> dict[str, NDArray[Any]]:
    """The values at the contact points at the rows of `frame_rows`, by names with units.

    Argument `contacts` as for `contact_vectors`.
    """
    rows = frame_rows(motion)
    vectors = contact_vectors(study.scene, study.points, motion, contacts)
    position, normal, friction = (values[rows] for values in vectors)
    return {
        DISPLACEMENT: position - contact_places(study.points),
        "position_m": position,
        "gap_m": motion.gap[rows],
        "normal_force_N": motion.force[rows, :, 0],
        "normal_force_vector_N": normal,
        "friction_force_vector_N": friction,
        STATE: motion.state[rows],
    }


def contact_equilibrium(study: Study) -> Array:
    """The displacements (P, 3) of the contact points in the equilibrium, m. Collective."""
    solid, frames = study.solid, study.points.frame
    points, d = frames.shape[:2]
    local = np.sum(solid.comm.allgather(solid.contact_rows @ solid.equilibrium), axis=0)
    return in_space(np.einsum("pk,pkx->px", local.reshape(points, d), frames))


def shapes(study: Study) -> dict[str, dict[str, Any]]:
    """Normal modes, static modes, derivatives and equilibrium: file name -> label -> field."""
    solid, modes = study.solid, study.modes
    kinds: dict[str, dict[str, Any]] = {"normal_modes": {}, "static_modes": {}, "derivatives": {}}
    if modes is not None:
        for k, label in enumerate(modes.labels):
            kind = "normal_modes" if label.endswith("V") else "static_modes"
            kinds[kind][label] = solid.field(modes.vectors[:, k])
    if study.derivatives is not None:
        for k, label in enumerate(study.derivatives.labels):
            kinds["derivatives"][label] = solid.field(study.derivatives.vectors[:, k])
    if solid.loaded:
        kinds["equilibrium"] = {"displacement": solid.field(solid.equilibrium)}
    return {name: fields for name, fields in kinds.items() if fields}


def write_shapes(study: Study, folder: Path) -> list[Path]:
    """Write the ParaView files of the shapes, with stresses if there are any. Collective."""
    return [
        write_fields(
            folder,
            kind,
            study.solid.space,
            {array_name(study, kind, label): field for label, field in fields.items()},
            _attached(study, kind),
        )
        for kind, fields in shapes(study).items()
    ]


def _attached(study: Study, kind: str) -> Attached:
    """Groups and texts, and the stresses of the equilibrium or of the normal modes. Collective."""
    found = Attached(cells=cell_groups(study.solid), notes=notes(study, kind))
    if study.recovery is not None and kind == "equilibrium":
        table = study.recovery.stress
        stress = table.stress(np.zeros(table.size), study.scene.output.stresses)
        found |= stress_fields(study)(stress, "", "Pa")
    if study.recovery is not None and study.modes is not None and kind == "normal_modes":
        from fenicsrom.fem.body.stress_points import stress_table

        modes, attach = study.modes.normal, stress_fields(study)
        table = stress_table(study.solid, study.scene, study.solid.equilibrium, modes)
        stresses = table.modal_stress(np.eye(modes.shape[1]))
        for k, label in enumerate(study.modes.labels[: modes.shape[1]]):
            found |= attach(stresses[k], f"{label}_", "Pa_per_m_sqrt_kg")
    return found


def moving_field(study: Study) -> Callable[[int], Array]:
    """Make a function of the frame number that gives the displacement of the reduced model.

    The frames are the rows of `frame_rows`; the displacement has the local and ghost unknowns, m.
    Collective.
    """
    basis, solid = study.basis, study.solid
    assert basis is not None
    vectors = np.array([solid.field(vector).x.array.copy() for vector in basis.vectors.T])
    rest = solid.field(solid.equilibrium).x.array.copy()
    q = frame_coordinates(study.motions["reduced"])
    return lambda number: rest + q[number] @ vectors


def write_last_period(study: Study, folder: Path, contacts: Contacts | None = None) -> list[Path]:
    """Write the ParaView files of the last period of the reduced model. Collective.

    Argument `contacts` as for `contact_vectors`.
    """
    motion, solid, moving = study.motions["reduced"], study.solid, moving_field(study)
    times, attach = motion.time[frame_rows(motion)], _attached_to_frames(study, moving)
    files = [write_motion(folder, "motion", solid.space, times, moving, DISPLACEMENT, attach)]
    if study.scene.contacts and solid.comm.rank == 0:
        places, arrays = contact_places(study.points), contact_arrays(study, motion, contacts)
        files.append(write_points(folder, "contact_points", times, places, arrays))
        if study.scene.probe is not None and motion.probe is not None:
            moved = in_space(motion.probe[frame_rows(motion)])[:, None, :]
            place = solid.probe_position[None]
            files.append(write_points(folder, "probe", times, place, {DISPLACEMENT: moved}))
    return files


def _attached_to_frames(study: Study, moving: Callable[[int], Array]) -> Callable[[int], Attached]:
    """Make a function of the frame number that gives what goes into the file of a frame.

    These are groups, texts and stresses, and the displacement with that of moving supports; the
    function `moving` gives the displacement. Collective.
    """
    fixed, motion, d = _attached(study, "motion"), study.motions["reduced"], study.solid.dimension
    moved = support_displacement(study.scene.loads, motion.time[frame_rows(motion)], d)
    stresses = None if study.recovery is None else stress_fields(study)

    def attach(number: int) -> Attached:
        found = fixed
        if study.recovery is not None and stresses is not None:
            q, measure = frame_coordinates(motion)[number], study.scene.output.stresses
            found |= stresses(study.recovery.stress.stress(q, measure), "", "Pa")
        if moves_supports(study.scene):
            whole = moving(number).reshape(-1, d) + moved[number]
            found |= Attached({ABSOLUTE: in_space(whole)})
        return found

    return attach
