"""The work of the stages from the mesh to the reduced model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, cast

from fenicsrom.notes import FREQUENCIES, Note, NoteKind, has_kind
from fenicsrom.progress import log
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.checks import too_small
from fenicsrom.study.stage import Run

if TYPE_CHECKING:
    from fenicsrom.arrays import Array
    from fenicsrom.fem.solid.finer import FinerSolid
    from fenicsrom.fem.solid.solid import Solid
    from fenicsrom.online.motion.motion import Motion
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.scene_changes import Trained
    from fenicsrom.records import Study
    from fenicsrom.reduction.modes import ComponentModes
    from fenicsrom.reduction.stages import Reduction
    from fenicsrom.scene import Scene

LARGE_CONDITION = 1e4
"""Condition number of the scaled reduced mass from which the user is warned."""


def mesh(run: Run) -> None:
    """Make or read the mesh, unless the caller gave one."""
    from fenicsrom.fem.mesh.mesh import build_mesh

    if run.mesh is None:
        run.mesh = build_mesh(run.study.scene.geometry, run.comm)


def solid(run: Run, modes_only: bool = False) -> None:
    """Assemble the solid, and solve for its static equilibrium if there are static loads."""
    import numpy as np

    from fenicsrom.assess.errors.plausibility import (
        equilibrium_deformation,
        equilibrium_warnings,
        turns,
    )
    from fenicsrom.fem.body.free_bodies import require_small
    from fenicsrom.fem.solid.solid import solid_of

    assert run.mesh is not None
    body = run.study.solid = solid_of(run.study.scene, run.mesh, free=True)
    if not modes_only:
        require_small(body)
    for text in body.warnings:
        if has_kind([text], NoteKind.IMPLAUSIBLE, NoteKind.UNSTABLE):
            log.info(f"  warning: {text}")  # said now, because a wrong scene may run for long
    run.study.deformation = equilibrium_deformation(body, run.study.scene)
    body.warnings += equilibrium_warnings(run.study.deformation)
    body.warnings += turns(body, run.study.scene, body.equilibrium[:, None])
    if body.loaded and len(body.probe_rows):
        deflection = body.comm.allreduce(body.probe_rows @ body.equilibrium)
        run.study.deflection = np.asarray(deflection)


def interface_vectors(run: Run) -> None:
    """Let motions of the scene choose the interface vectors of its basis."""
    from fenicsrom.online.model.model import ReducedModel
    from fenicsrom.online.store.archive import StoredModel

    solid, scene = run.study.solid, run.study.scene

    def stored(reduction: Reduction) -> StoredModel:
        names, model = reduction.basis.labels, cast(ReducedModel, reduction.model)
        hertz = reduction.modes.frequencies_hz
        return StoredModel(model, scene, scene.basis.method, names, solid.free, hertz, {})

    run.study.trained = trained(solid, scene, stored)


def trained(solid: Solid, scene: Scene, stored: Callable[[Reduction], StoredModel]) -> Trained:
    """Let motions of a scene choose the interface vectors of its solid, in the models `stored`."""
    from fenicsrom.assess.curves.checks import curve_motions
    from fenicsrom.assess.curves.response_problem import of_curves, scenes_of_curves
    from fenicsrom.reduction.training import motion_of_scene, train

    def moves(reduction: Reduction) -> Sequence[Motion]:
        found = stored(reduction)
        return curve_motions(of_curves(found)) if is_curve else motion_of_scene(found.model, scene)

    is_curve = scene.response is not None and scene.backbone is None
    return train(solid, scene, moves, scenes_of_curves(scene) if is_curve else [scene])


def modes(run: Run, modes_only: bool = False) -> None:
    """Compute the component modes; those of a free body have the rigid ones without a basis."""
    from fenicsrom.reduction.modes import component_modes

    body = run.study.solid
    rigid = body.rigid if modes_only else None
    set_modes(run, component_modes(body, run.study.scene.basis, rigid))
    check_size(run.study)


def check_size(study: Study) -> None:
    """Check the number of coordinates that the scene asks for as soon as it can be known.

    Raises:
        SceneError: the model cannot have this `basis.size`.
    """
    from fenicsrom.online.store.archive import require_size
    from fenicsrom.reduction.candidates import most_coordinates

    size = study.scene.basis.size
    if size is None or study.modes is None:
        return
    masters = study.modes.rows.shape[0]
    if size <= masters:
        raise Where(study.scene.source, "basis.size").refuse(size, too_small(masters))
    if size >= (most := most_coordinates(study.scene, study.modes)):
        allowed = f"must be below {most}: with these modes and loads, no model has as many"
        raise Where(study.scene.source, "basis.size").refuse(size, f"{allowed} coordinates")
    if study.extended is not None and study.basis is not None:
        require_size(study.scene, study.extended.labels, study.basis.size)


def contact_frequencies(run: Run) -> None:
    """Compute the natural frequencies of the body without contact and with all points stuck."""
    import numpy as np

    from fenicsrom.online.contact.points import closed_springs, contacts_of, springs_of
    from fenicsrom.online.contact.together import SOFT
    from fenicsrom.reduction.modes import contact_frequencies as found

    study = run.study
    assert study.modes is not None
    contacts, d = contacts_of(study.scene, study.solid.points), study.solid.dimension
    springs = springs_of(contacts, d)
    if study.solid.joined:  # the others are in the factor already
        closed = closed_springs(contacts, study.solid.contact_displacement(study.solid.equilibrium))
        springs -= closed
        held = closed.reshape(-1, d)[:, 1:].max(axis=1) > SOFT * contacts.normal_stiffness
        if (free := np.flatnonzero((contacts.friction == 0.0) & held)).size:
            key = f"contacts[{study.solid.points.contact[free[0]]}].friction"
            text = (
                f"{key} is 0, but the closed points of this contact stick in the modes to which "
                f"damping.ratios belong: a tangential_stiffness below {SOFT:g} of normal_stiffness "
                "lets them slide"
            )
            study.warnings.append(Note(NoteKind.WARNING, text, key, quantity=FREQUENCIES))
    rigid = study.modes.rigid
    elastic = found(study.solid, springs, study.modes.omega.size - rigid)
    study.contact_hz = np.concatenate([np.zeros((rigid, 2)), elastic])


def set_modes(run: Run, found: ComponentModes) -> None:
    """Take component modes into the record, say what they lack, and begin the reduction."""
    from fenicsrom.reduction.load_responses import LOAD_SHARE
    from fenicsrom.reduction.modes import missing_modes, with_mode_count
    from fenicsrom.reduction.snapshots import Snapshots
    from fenicsrom.reduction.stages import Reduction

    study = run.study
    study.modes, study.scene = found, with_mode_count(study.scene, found)
    sentence = missing_modes(study.scene, found.frequencies_hz)
    if sentence is not None:
        study.warnings.append(sentence)
    for label, share in study.modes.loads.shares.items():
        if label not in study.modes.loads.labels:
            text = (
                f"the modes leave out {100.0 * share:.2g} % of it "
                f"(at most {100.0 * LOAD_SHARE:g} % is accepted)"
            )
            study.left_out.append(Note(NoteKind.LEFT_OUT, text, f"response to load {label}"))
    run.snapshots = Snapshots(study.solid, study.scene, study.modes)
    run.reduction = Reduction(
        study.solid, study.scene, lambda stage: nullcontext(), study.modes, run.snapshots
    )


def linear_transient(run: Run) -> None:
    """Compute the deflections of the geometrically linear transient; a free body has none."""
    if not run.study.modes.rigid:
        _ = run.snapshots.linear  # computed when it is first read


def nonlinear_statics(run: Run) -> None:
    """Compute the nonlinear static deflections; a free body has none."""
    if not run.study.modes.rigid:
        _ = run.snapshots.static


def selection(run: Run) -> None:
    """Select modes and derivatives, and note the ones that are left out."""
    from fenicsrom.reduction.stages import Derivatives

    study = run.study
    assert study.modes is not None
    study.selection = run.reduction.selection
    study.derivatives = Derivatives((), study.modes.normal[:, :0])  # placeholder
    if not study.selection.derivatives and study.selection.principal is None:
        run.reduction.derivatives = study.derivatives
    note_selection(study)


def note_selection(study: Study) -> None:
    """Note the modes and derivatives that the selection left out."""
    selected, dropped = study.selection, study.dropped_modes
    threshold = study.scene.basis.threshold
    light = [label for label in selected.weights if label not in selected.derivatives]
    if dropped:
        text = f"their amplitude is below {threshold:g} of the largest"
        study.left_out.append(Note(NoteKind.LEFT_OUT, text, f"modes {', '.join(dropped)}"))
    if light:
        text = f"their weight is at most {threshold:g} of the largest"
        study.left_out.append(Note(NoteKind.LEFT_OUT, text, f"derivatives {', '.join(light)}"))


def derivatives(run: Run) -> None:
    """Compute the selected modal derivatives."""
    run.study.derivatives = run.reduction.derivatives


def basis(run: Run) -> None:
    """Build the reduced basis."""
    study = run.study
    study.basis = run.reduction.basis
    by_motion = study.scene.basis.masters == "motion"  # these vectors are few, and chosen already
    fewer = '"motion"' if study.scene.joined else "a smaller number of interface modes"
    if study.basis.condition > LARGE_CONDITION and not by_motion:
        text = (
            f"the reduced mass has a condition number of {study.basis.condition:.2g} (above "
            f"{LARGE_CONDITION:g}): contact coordinates move almost together, and rounding grows "
            f"by this factor; set basis.masters to {fewer}"
        )
        study.warnings.append(Note(NoteKind.WARNING, text, "basis.masters"))


def candidates(run: Run) -> None:
    """Extend the basis by its candidates."""
    from fenicsrom.reduction.candidates import extended_basis

    study, plain = run.study, run.reduction.basis
    study.extended = extended_basis(study.solid, study.scene.basis, run.reduction)
    study.further = study.extended.labels[plain.size :]
    check_size(study)
    study.basis = replace(plain, vectors=study.extended.vectors[:, : plain.size])


def reduced_model(run: Run) -> None:
    """Project the solid on the extended basis; the model of the basis is a part of this one."""
    from fenicsrom.online.model.subspace import nested_model
    from fenicsrom.reduction.basis import project, project_intrusively

    study, solid = run.study, run.study.solid
    assert study.basis is not None and study.extended is not None
    nonlinear = solid.geometrically_nonlinear
    study.candidates = project(solid, study.extended, nonlinear)
    if nonlinear and study.scene.basis.elastic_force == "projection":
        study.model = project_intrusively(solid, study.basis)
    else:
        study.model = nested_model(study.candidates, range(study.basis.size))


def finer_elements(run: Run) -> None:
    """Compare the solid with elements of one degree more, and reduce these with the same basis."""
    from fenicsrom.assess.errors import comparisons as mesh_check
    from fenicsrom.reduction.candidates import finer_model
    from fenicsrom.reduction.modes import component_modes

    study, options = run.study, run.study.scene.basis

    def squares(solid: Solid) -> Array:
        assert study.modes is not None
        elastic = study.modes.omega.size - study.modes.rigid
        rigid = solid.rigid if study.modes.rigid else None
        return component_modes(solid, replace(options, modes=elastic), rigid).omega ** 2

    def reduce(solid: FinerSolid) -> None:
        if study.basis is not None:
            study.finer, study.finer_labels, study.finer_frequencies_hz = finer_model(
                study.solid, solid, options, run.reduction
            )

    study.mesh_check = mesh_check.of_solid(
        study.scene,
        study.solid,
        (study.modes.omega**2, squares) if study.modes and study.basis is None else None,
        None if study.deflection is None else lambda solid: solid.equilibrium,
        reduce,
    )
    study.warnings.extend(study.mesh_check.warnings(study.scene, FREQUENCIES))
    if study.scene.static_only and (error := study.mesh_check.failure(study.scene)):
        study.unfinished = ("static", error)


def stress_points(run: Run) -> None:
    """Tabulate the gradients of the basis vectors; of the normal modes if there is no basis."""
    import numpy as np

    from fenicsrom.fem.body.stress_points import stress_table
    from fenicsrom.fem.solid.reaction_rows import reaction_table
    from fenicsrom.online.stress.reactions import Recovery

    study = run.study
    solid, scene = study.solid, study.scene
    vectors = np.zeros((solid.local, 0))
    if study.extended is not None:
        vectors = study.extended.vectors
    elif study.modes is not None:
        vectors = study.modes.normal
    study.tables = Recovery(
        stress_table(solid, scene, solid.equilibrium, vectors),
        reaction_table(solid, scene, vectors),
    )


def resize(study: Study, stored: StoredModel) -> None:
    """Take the coordinates of a resized model into the record."""
    assert study.extended is not None
    study.basis = study.extended.part(stored.labels, stored.model.mass)
    study.model, study.candidates = stored.model, stored.candidates
    study.tables, study.further = stored.tables, stored.further
