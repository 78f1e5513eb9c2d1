"""ParaView files of a study, and one file with a script that shows them all.

The names of arrays end in their unit. Texts on the normalisation and on the material are field
data, which ParaView shows in the Information panel.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.files import atomic_folder, atomic_write
from fenicsrom.online.contact.points import ContactPoints, contacts_of
from fenicsrom.online.contact.surfaces import Contacts, unit_normals
from fenicsrom.online.model.loads import moves_supports, support_displacement
from fenicsrom.online.motion.joints import contact_maps
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.stress.stress import principal, von_mises
from fenicsrom.post.paraview import vtk
from fenicsrom.records import Study
from fenicsrom.scene import Elasticity, GroupMaterial, Scene, scene_heading

if TYPE_CHECKING:
    from fenicsrom.fem.solid.solid import Solid


INDEX = "results.pvd"
LOOK = "look.py"
BLOCKS = "results"  # folder of the lists of blocks, one per instant
GROUPS = "groups.vtu"

NORMALISATION = {
    "normal_modes": (
        "The modes have the modal mass 1 kg: the displacement in m is the array times a modal "
        "coordinate in m sqrt(kg), and the stress in Pa is its array times the same coordinate."
    ),
    "static_modes": (
        "rubin: residual displacement under a unit contact force, m/N. craig-bampton: displacement "
        "by a unit contact displacement, m/m."
    ),
    "derivatives": (
        "The derivative AB is the change of vector A along vector B: the unit is that of A times "
        "that of B, per metre."
    ),
    "equilibrium": "The displacement and the stress under the static loads, at speed.",
}


def array_name(study: Study, kind: str, label: str) -> str:
    """Name of the array of a shape, with frequency and unit."""
    if kind == "normal_modes" and study.modes is not None:
        frequency = study.modes.frequencies_hz[study.modes.labels.index(label)]
        return f"{label}_{frequency:.5g}_Hz_per_sqrt_kg"
    if kind == "static_modes" and study.modes is not None:
        unit = "m_per_N" if study.modes.method == "rubin" else "m_per_m"
        return f"{label}_{unit}"
    return "displacement_m" if kind == "equilibrium" else label


def _constants(material: Elasticity) -> str:
    """The constants of a material in words."""
    young, poisson = (
        ", ".join(f"{value:g}" for value in (given if isinstance(given, tuple) else (given,)))
        for given in (material.young, material.poisson)
    )
    of = f"group {material.group}: " if isinstance(material, GroupMaterial) else ""
    return (
        f"{of}Young's modulus {young} Pa, Poisson's ratio {poisson}, "
        f"density {material.density:g} kg/m^3"
    )


def notes(study: Study, kind: str) -> dict[str, str]:
    """The texts of a file: normalisation and material."""
    scene = study.scene
    found = {
        "title": scene_heading(scene),
        "material": "; ".join(map(_constants, (scene.material, *scene.materials))),
    }
    if kind in NORMALISATION:
        found["normalisation"] = NORMALISATION[kind]
    if study.recovery is not None and kind in ("normal_modes", "equilibrium", "motion"):
        found["stress"] = (
            "Points: extrapolated from the Gauss points and averaged over cells. Cells: mean of "
            "the Gauss points. Components: xx, yy, zz, xy, yz, xz."
        )
    return found


def cell_groups(solid: Solid) -> dict[str, NDArray[np.int8]]:
    """For each group of cells, 1 in its cells on this rank and 0 in all other cells."""
    mesh, cells = solid.mesh, solid.owned_cells()
    return {
        f"group_{name}": np.isin(cells, mesh.cells(name)).astype(np.int8)
        for name in mesh.cell_groups
    }


def stress_fields(study: Study) -> Callable[[Array, str, str], vtk.Attached]:
    """Make a function that gives stresses (P, 6) at the Gauss points as arrays of this rank.

    The other arguments of this function are a prefix and a suffix of the names, such as the unit.
    Collective.
    """
    from fenicsrom.fem.body.stress_points import local_part

    assert study.recovery is not None
    table, part = study.recovery.stress, local_part(study.solid)

    def attach(stress: Array, prefix: str, unit: str) -> vtk.Attached:
        nodes = part.at_nodes(table, table.at_vertices(stress))
        cells = table.in_cells(stress)[part.cells]

        def named(values: Array) -> dict[str, Any]:
            derived = {"von_mises": von_mises(values), "principal": principal(values)}
            found = {"stress": values} | derived
            return {f"{prefix}{name}_{unit}": a.astype(np.float32) for name, a in found.items()}

        return vtk.Attached(named(nodes), named(cells))

    return attach


def write_groups(solid: Solid, folder: Path) -> list[Path]:
    """Write the facets of all facet groups, with 1 in the facets of each group. Collective.

    Raises:
        OSError: the file cannot be written.
    """
    from fenicsrom.fem.base.compat import entity_nodes

    mesh, domain = solid.mesh, solid.mesh.domain
    d = domain.topology.dim
    names = list(mesh.facet_groups)
    owned = domain.topology.index_map(d - 1).size_local
    facets = np.unique(np.concatenate([*(mesh.facets(name) for name in names), np.zeros(0, int)]))
    facets = facets[facets < owned]
    domain.topology.create_connectivity(d - 1, d)
    domain.topology.create_connectivity(d - 1, 0)
    count = domain.topology.connectivity(d - 1, 0).links(0).size
    corners = entity_nodes(domain, d - 1, facets)[:, :count]
    places = domain.geometry.x[corners]
    flags = {f"group_{name}": np.isin(facets, mesh.facets(name)) for name in names}
    every = domain.comm.gather((places, flags))
    if every is None or not names:
        return []
    whole = np.concatenate([part[0] for part in every])
    points, cells = np.unique(whole.reshape(-1, 3), axis=0, return_inverse=True)
    marks = {
        name: np.concatenate([part[1][name] for part in every]).astype(np.int8) for name in flags
    }
    grid = vtk.linear_grid(points, cells.reshape(whole.shape[:2]), d - 1)
    with atomic_write(folder / GROUPS) as temporary:
        vtk.write_vtu(temporary, grid, vtk.Attached(cells=marks))
    return [folder / GROUPS]


def write_index(folder: Path, files: Sequence[Path]) -> list[Path]:
    """Write the `.pvd` file that opens all ParaView files of a run together, block by block.

    Static files are repeated at every instant. A script beside it shows the motion or a shape in
    ParaView. On one rank.

    Args:
        folder: the folder of the run.
        files: files of the run; files that ParaView does not read are left out.

    Raises:
        OSError: a file cannot be written.
    """
    static = {path.stem: _pieces(path) for path in files if path.suffix in (".vtu", ".pvtu")}
    series = {path.stem: _instants(path) for path in files if path.suffix == ".pvd"}
    if not static and not series:
        return []
    times = sorted({time for instants in series.values() for time, _ in instants}) or [0.0]
    with atomic_folder(folder / BLOCKS) as temporary:
        entries = []
        for number, time in enumerate(times):
            found = dict(static)
            for name, instants in series.items():
                found[name] = min(instants, key=lambda instant: abs(instant[0] - time))[1]
            blocks = [
                (name if len(pieces) == 1 else f"{name} {k}", f"../{piece.relative_to(folder)}")
                for name, pieces in sorted(found.items())
                for k, piece in enumerate(pieces)
            ]
            file = f"{BLOCKS}_{number:05d}.vtm"
            vtk.write_blocks(temporary / file, blocks)
            entries.append((time, f"{BLOCKS}/{file}"))
    with atomic_write(folder / INDEX) as temporary:
        vtk.write_series(temporary, entries)
    script = Path(__file__).with_name(LOOK).read_text(encoding="utf-8")
    with atomic_write(folder / LOOK) as temporary:
        temporary.write_text(
            script.replace('FOLDER = "."', f"FOLDER = {str(folder)!r}"), encoding="utf-8"
        )
    return [folder / INDEX, folder / LOOK]


def _pieces(path: Path) -> list[Path]:
    """The files of a grid: those of its ranks, or the file itself."""
    if path.suffix != ".pvtu":
        return [path]
    sources = (piece.get("Source") for piece in ET.parse(path).iter("Piece"))
    return [path.parent / source for source in sources if source]


def _instants(path: Path) -> list[tuple[float, list[Path]]]:
    """The instants (s) of a series, and the files of each."""
    return [
        (float(entry.attrib["timestep"]), _pieces(path.parent / entry.attrib["file"]))
        for entry in ET.parse(path).iter("DataSet")
    ]


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
    return vtk.in_space(points.position)


def contact_vectors(
    scene: Scene, points: ContactPoints, motion: Motion, rows: Any, contacts: Contacts | None = None
) -> tuple[Array, Array, Array]:
    """Positions of the contact points and contact forces on the body, in global axes.

    Args:
        scene: the scene.
        points: the contact points.
        motion: the motion.
        rows: the k rows of the motion that are wanted.
        contacts: parameters of the contact points in the motion; by default those of the scene.

    Returns:
        Positions, m, normal forces (from the obstacle into the body), N, and friction forces, N,
        all (k, P, 3); the third component is 0 in 2D.
    """
    d = scene.geometry.dimension
    frames = vtk.in_space(points.frame)
    contacts = contacts_of(scene, points) if contacts is None else contacts
    displacement, friction = motion.displacement[rows], motion.force[rows].copy()
    normals = unit_normals(contacts, displacement, motion.time[rows])
    normal = -friction[:, :, :1] * normals
    # the forces are given in the frames of the current normals: rotate them back
    friction[:, :, 0] = 0.0
    across = np.sum(friction * normals, axis=2, keepdims=True)
    friction -= across / (1.0 + normals[:, :, :1]) * (normals + np.eye(d)[0])
    moved, normal, friction = (
        np.einsum("spk,pkx->spx", values, frames) for values in (displacement, normal, -friction)
    )
    return contact_places(points) + moved, normal, friction


def contact_arrays(
    study: Study, motion: Motion, contacts: Contacts | None = None
) -> dict[str, NDArray[Any]]:
    """The values at the contact points at the rows of `frame_rows`, by names with units.

    Argument `contacts` as for `contact_vectors`.
    """
    rows = frame_rows(motion)
    position, normal, friction = contact_vectors(study.scene, study.points, motion, rows, contacts)
    maps: dict[str, NDArray[Any]] = {}
    if study.scene.joined:
        for name, values in contact_maps(motion, study.points).items():
            maps[name] = np.broadcast_to(values, (len(rows), values.size))
        maps["pressure_Pa"] = motion.force[rows, :, 0] / study.points.tributary_area
    return {
        DISPLACEMENT: position - contact_places(study.points),
        "position_m": position,
        "gap_m": motion.gap[rows],
        "normal_force_N": motion.force[rows, :, 0],
        "normal_force_vector_N": normal,
        "friction_force_vector_N": friction,
        STATE: motion.state[rows],
        **maps,
    }


def contact_equilibrium(study: Study) -> Array:
    """The displacements (P, 3) of the contact points in the equilibrium, m. Collective."""
    solid, frames = study.solid, study.points.frame
    points, d = frames.shape[:2]
    local = solid.contact_displacement(solid.equilibrium).reshape(points, d)
    return vtk.in_space(np.einsum("pk,pkx->px", local, frames))


def shapes(study: Study) -> dict[str, dict[str, Any]]:
    """Normal modes, static modes, derivatives and equilibrium: file name -> label -> field."""
    solid, modes = study.solid, study.modes
    kinds: dict[str, dict[str, Any]] = {"normal_modes": {}, "static_modes": {}, "derivatives": {}}
    if modes is not None:
        for k, label in enumerate(modes.labels):
            kind = "static_modes" if label.endswith("S") else "normal_modes"
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
        vtk.write_fields(
            folder,
            kind,
            study.solid.space,
            {array_name(study, kind, label): field for label, field in fields.items()},
            _attached(study, kind),
        )
        for kind, fields in shapes(study).items()
    ]


def _attached(study: Study, kind: str) -> vtk.Attached:
    """Groups and texts, and the stresses of the equilibrium or of the normal modes. Collective."""
    found = vtk.Attached(cells=cell_groups(study.solid), notes=notes(study, kind))
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
    files = [vtk.write_motion(folder, "motion", solid.space, times, moving, DISPLACEMENT, attach)]
    if study.scene.contacts and solid.comm.rank == 0:
        places, arrays = contact_places(study.points), contact_arrays(study, motion, contacts)
        files.append(vtk.write_points(folder, "contact_points", times, places, arrays))
        if study.scene.probe is not None and motion.probe is not None:
            moved = vtk.in_space(motion.probe[frame_rows(motion)])[:, None, :]
            place = solid.probe_position[None]
            files.append(vtk.write_points(folder, "probe", times, place, {DISPLACEMENT: moved}))
    return files


def _attached_to_frames(
    study: Study, moving: Callable[[int], Array]
) -> Callable[[int], vtk.Attached]:
    """Make a function of the frame number that gives what goes into the file of a frame.

    These are groups, texts and stresses, and the displacement with that of moving supports; the
    function `moving` gives the displacement. Collective.
    """
    fixed, motion, d = _attached(study, "motion"), study.motions["reduced"], study.solid.dimension
    moved = support_displacement(study.scene.loads, motion.time[frame_rows(motion)], d)
    stresses = None if study.recovery is None else stress_fields(study)

    def attach(number: int) -> vtk.Attached:
        found = fixed
        if study.recovery is not None and stresses is not None:
            q, measure = frame_coordinates(motion)[number], study.scene.output.stresses
            found |= stresses(study.recovery.stress.stress(q, measure), "", "Pa")
        if moves_supports(study.scene):
            whole = moving(number).reshape(-1, d) + moved[number]
            found |= vtk.Attached({ABSOLUTE: vtk.in_space(whole)})
        return found

    return attach
