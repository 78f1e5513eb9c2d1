"""Disks of reduced sectors against the whole disk in finite elements: error against run time.

Besides numbers of normal modes, [compare] may list schemes and time steps.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

from fenicsrom.assess.full.full_motions import full_motion
from fenicsrom.assess.rotation.disk_run import disk_run
from fenicsrom.assess.studies.compare import (
    Combination,
    Comparison,
    Outcome,
    combinations,
    errors_against,
    kept,
    outcome_notes,
    time_runs,
    timed,
    try_each,
    with_combination,
)
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.fem.mesh.mesh import Mesh, build_mesh
from fenicsrom.fem.solid.fixed_sector import stored_disk
from fenicsrom.fem.solid.solid import Solid, solid_of
from fenicsrom.fem.solid.whole_disk import as_sectors, damp_waves, picks, whole_scene
from fenicsrom.notes import Note, NoteKind, note_of
from fenicsrom.online.model.disk_model import deviations, disk_scene
from fenicsrom.progress import log
from fenicsrom.scene import Compare, Scene
from fenicsrom.scene.base.rules import Problem, Problems, Where
from fenicsrom.scene.base.tables import require_none
from fenicsrom.scene.checks.rotation_checks import require_disk_run


def compare_disk(scene: Scene, comm: Any) -> Comparison:
    """Compare reduced disks of a scene's [compare] table with the whole disk in finite elements.

    Args:
        scene: a scene with the table [cyclic].
        comm: MPI communicator.

    Raises:
        SceneError: the scene or a combination is impossible.
        ConvergenceError, AccuracyError: the whole disk or the first reduced one failed. The failure
            of another one is part of its outcome.
    """
    whole, scenes = scenes_of_disks(scene)
    wanted = [*scenes]
    cold, seconds = dict[str, float](), dict[str, float]()
    with timed(seconds, "mesh"):
        mesh = build_mesh(scene.geometry, comm)
    log.info("compiling and warming up ..")
    with timed(cold, "compilation"):
        first = stored_disk(scenes[wanted[0]], mesh, partial(timed, {}))
    points = first.sector.model.points
    body = _body(scene, whole, mesh)
    log.info(f"the whole disk in finite elements has {body.free} unknowns")
    full, full_run = full_motion(body, whole, "disk")
    beside = as_sectors(full, body, points, scene)
    told: dict[Note, list[str]] = {}

    def attempt(combination: Combination) -> Outcome:
        one, outcome = scenes[combination], Outcome(combination, offline=dict(seconds))
        try:
            with timed(outcome.offline, "disk"):
                disk = stored_disk(one, mesh, partial(timed, {}))
            found = disk_run(disk, partial(timed, {}))
            if found.interrupted:
                raise KeyboardInterrupt
            for note in found.warnings:
                if note.kind is not NoteKind.UNSETTLED:  # a note of all outcomes
                    told.setdefault(note, []).append(combination.name)
            if found.unfinished is not None and not found.errors:  # else only an error is large
                raise found.unfinished
            timings = time_runs(found.model, disk_scene(one), found.motion, comm)
        except (ConvergenceError, AccuracyError) as error:
            outcome.failure = str(error)
            return outcome
        outcome.labels = tuple(f"q{k + 1}" for k in range(disk.size))
        outcome.estimated = found.errors.get("basis")
        outcome.motion = kept(found.motion)
        outcome.online, outcome.timed_periods = timings
        outcome.errors = errors_against(found.motion, beside, scene)
        return outcome

    outcomes, interrupted = try_each(wanted, attempt)
    # a note on a place comes from the sector, whose keys are those of the scene
    warned = [note for note in map(note_of, body.warnings) if "[" not in note.key]
    warned += [*_disk_notes(told, len(outcomes)), *outcome_notes(scene, outcomes)]
    if deviations(scene).any() and body.loaded:
        text = "mistuning changes the moduli of the whole disk, but in reduced sectors the "
        text += "stiffness about one equilibrium: rotation and static loads make a difference"
        warned.append(Note(NoteKind.REMARK, text, "cyclic.mistuning"))
    return Comparison(
        scene,
        outcomes,
        full=full,
        full_run=full_run,
        unknowns=body.free,
        points=points,
        compilation=cold["compilation"],
        warnings=list(dict.fromkeys(warned)),
        interrupted=interrupted,
    )


def _body(scene: Scene, whole: Scene, mesh: Mesh) -> Solid:
    """The whole disk in finite elements, with the modal damping of the waves of its sector."""
    comm = mesh.domain.comm
    body = solid_of(whole, build_mesh(scene.geometry, comm, scene.cyclic, picks(scene)))
    if any(scene.damping.modal):
        sector = solid_of(scene, mesh)
        damp_waves(body, sector, scene)
        sector.destroy()
    return body


def _disk_notes(told: dict[Note, list[str]], count: int) -> list[Note]:
    """The notes of `count` reduced disks, with the names of those that have them if not all do."""
    return [
        note if len(names) == count else note.saying(f"{'; '.join(names)}: {note}")
        for note, names in told.items()
    ]


def scenes_of_disks(scene: Scene) -> tuple[Scene, dict[Combination, Scene]]:
    """The scene of the whole disk, and that of a sector by each combination.

    Raises:
        SceneError: the scene or a combination is impossible.
    """
    require_none(_problems(scene.compare), scene, Where(scene.source))
    basis = scene.basis
    table = replace(scene.compare, methods=(basis.method,), derivatives=(basis.derivatives,))
    scene = replace(scene, compare=table)
    scenes = {choice: with_combination(scene, choice) for choice in combinations(scene)}
    for one in scenes.values():
        require_disk_run(one)
    return whole_scene(scene), scenes


def _problems(table: Compare) -> Problems:
    """Yield the lists that do not choose among reduced disks."""
    usual = Compare()
    for name in ("full", "methods", "derivatives", "sizes", "elastic_force", "meshes"):
        if getattr(table, name) != getattr(usual, name):
            allowed = "not allowed with [cyclic], which allows the lists modes, schemes and steps"
            yield Problem(f"compare.{name}", allowed)
