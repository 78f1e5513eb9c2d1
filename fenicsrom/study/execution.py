"""Execution of the stages of a scene: all of them, or those up to the reduced model."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import MISSING
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.notes import Note, NoteKind
from fenicsrom.progress import ask
from fenicsrom.scene.base.rules import Where
from fenicsrom.scene.checks.rotation_checks import require_disk_run
from fenicsrom.study.given import starts_from
from fenicsrom.study.output_folder import output_folder
from fenicsrom.study.scene_stages import offline_stages, stages
from fenicsrom.study.speed_range import build_range
from fenicsrom.study.stage import Run, Stage
from fenicsrom.study.stopwatch import Stopwatch
from fenicsrom.study.writing import keep_motion, written

if TYPE_CHECKING:
    from fenicsrom.assess.rotation.disk_run import DiskRun
    from fenicsrom.fem.mesh.mesh import Mesh
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.records import Study
    from fenicsrom.scene import Scene
    from fenicsrom.study.offline_cache import OfflineCache


@starts_from(sectors=True)
def run(
    scene: Scene,
    comm: Any = None,
    *,
    folder: Path | None = None,
    resume: Path | None = None,
    modes_only: bool = False,
    mesh: Mesh | None = None,
    overwrite: bool = False,
    fresh: bool = False,
) -> Study | DiskRun:
    """Run all stages that a scene needs; of a sector, integrate its disk.

    Args:
        scene: the scene, or the path of its file.
        comm: MPI communicator of the offline stages and the full model; by default all ranks.
        folder: folder of the output files; None writes no files.
        resume: checkpoint from which the reduced model continues.
        modes_only: stop after the modal derivatives.
        mesh: the mesh; None makes or reads the mesh of the scene.
        overwrite: replace the results of another scene in the folder.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The record of the run. If the integration or a check of a model failed, `unfinished` holds
        the name of the model and the error, and `motions` holds the motion up to the failure.

    Raises:
        SceneError: the scene, the checkpoint or the folder cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: the work was asked to stop (`fenicsrom.asking`).
        OSError: a file cannot be written.
    """
    from fenicsrom.records import Study

    if scene.cyclic is not None:
        if modes_only or resume is not None:
            given = "modes_only" if modes_only else "resume"
            raise refuse(scene.source, f"not allowed with {given}", ErrorKind.CONFLICT, "cyclic")
        return _disk_motion(scene, comm, folder, mesh)
    if scene.speeds_rpm is not None and not modes_only:
        reason = "not allowed in this run; build the model with build_model (or `fenicsrom run "
        reason += "SCENE`), or leave the key out"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT, "rotation.speeds_rpm")
    if resume is not None:
        _require_resumable(resume, scene)
    comm = comm or all_ranks()
    run = Run(Study(scene), comm, Stopwatch(), folder, resume, mesh)
    run.fresh, run.cached = fresh, mesh is None
    guarded = (
        nullcontext() if folder is None else output_folder(folder, scene, comm, None, overwrite)
    )
    with guarded:
        listed = stages(scene, modes_only, files=folder is not None)
        execute(run, listed, None if modes_only else _cache(run, fresh))
    return run.study


def _disk_motion(scene: Scene, comm: Any, folder: Any, mesh: Any) -> DiskRun:
    """Integrate the disk of a sector, and keep its sector. Collective; errors as `run`."""
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL

    comm, watch = comm or all_ranks(), Stopwatch()
    disk = build_disk(scene, mesh, comm, watch)
    if folder is None or comm.rank > 0:
        return run_disk(disk, watch=watch)
    save_model(folder / MODEL, disk)
    found = run_disk(disk, watch=watch, folder=folder)
    found.files.append(folder / MODEL)
    return found


@starts_from(sectors=True)
def build_disk(
    scene: Scene, mesh: Mesh | None = None, comm: Any = None, watch: Stopwatch | None = None
) -> StoredDisk:
    """Reduce the sector of a disk, without integrating the disk. Collective.

    Args:
        scene: a scene with the table [cyclic].
        mesh: the mesh of a sector; None makes or reads the mesh of the scene.
        comm: MPI communicator; by default all ranks.
        watch: times the stages.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: a stage failed.
    """
    from fenicsrom.fem.mesh.mesh import build_mesh
    from fenicsrom.fem.solid.fixed_sector import stored_disk

    if scene.cyclic is None:
        raise Where(scene.source, "cyclic").refuse(MISSING, "a disk needs this table")
    require_disk_run(scene)
    mesh = mesh or build_mesh(scene.geometry, comm or all_ranks())
    return stored_disk(scene, mesh, watch or Stopwatch())


@starts_from("StoredDisk", sectors=True)
def run_disk(
    disk: StoredDisk, *, folder: Path | None = None, watch: Stopwatch | None = None
) -> DiskRun:
    """Integrate a disk of reduced sectors, and write the files.

    Args:
        disk: the disk, under the scene of the run.
        folder: folder of the output files; None writes no files.
        watch: times the stages.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError: the disk has no equilibrium.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.rotation.disk_run import disk_run

    found = written(disk_run(disk, watch or Stopwatch()), folder)
    if folder is not None and disk.scene.output.motion:
        from fenicsrom.post.paraview.disk_motion import write_disk_motion

        found.files += write_disk_motion(found, folder)
    return found


def offline(
    scene: Scene,
    comm: Any,
    watch: Stopwatch,
    mesh: Mesh | None = None,
    fresh: bool = False,
) -> Study:
    """Run the stages up to the reduced model; write no files but those of the cache.

    Args:
        scene: the scene.
        comm: MPI communicator; None takes all ranks.
        watch: times the stages.
        mesh: the mesh; None makes or reads the mesh of the scene.
        fresh: compute all results, also those that the cache has.
    """
    from fenicsrom.records import Study

    run = Run(Study(scene), comm or all_ranks(), watch, mesh=mesh)
    execute(run, offline_stages(scene, modes_only=False), _cache(run, fresh))
    return run.study


@starts_from()
def build_model(
    scene: Scene, mesh: Mesh | None = None, comm: Any = None, fresh: bool = False
) -> StoredModel:
    """Build the reduced model of a scene, without integrating it.

    Args:
        scene: the scene.
        mesh: the mesh; None makes or reads the mesh of the scene.
        comm: MPI communicator; by default all ranks.
        fresh: compute all results, also those that the cache has.

    Returns:
        The model with its scene and labels, for `StoredModel.simulate` and `save_model`.

    Raises:
        SceneError: the scene cannot be used, all its loads are static, or its elastic force is
            projected, which needs the mesh.
        ConvergenceError, AccuracyError: a stage failed.

    Example:
        >>> import fenicsrom as fr
        >>> stored = fr.build_model(fr.read_scene("demos/open_2d.toml"))
        >>> stored.labels
        ('1V', '2V', '3V', '1V1V', '1V2V', '1V3V')
        >>> stored.frequencies_hz.round(2).tolist()
        [3.28, 20.59, 57.78]
    """
    if scene.static_only:
        reason = "all loads are static, so there is no reduced model to integrate"
        raise refuse(scene.source, reason, ErrorKind.CONFLICT)
    if _is_projected(scene):
        reason = "a model with the projected force needs the mesh and cannot be stored"
        raise _projected(scene.source, reason)
    if scene.speeds_rpm is not None:
        from fenicsrom.study.offline_cache import kept_range

        comm = comm or all_ranks()
        build = partial(build_range, scene, mesh, comm)
        cached = mesh is None and comm.size == 1
        return kept_range(scene, fresh, build) if cached else build()
    return offline(scene, comm, Stopwatch(), mesh, fresh=fresh).stored


def execute(run: Run, listed: list[Stage], cache: OfflineCache | None = None) -> None:
    """Run the needed stages in their order.

    After a failed motion or check, only the stages that write files run. An interrupted run keeps
    a motion that is finished.

    Args:
        run: the run.
        listed: its stages.
        cache: has the results of earlier stages, which do not run, and takes those of others.
    """
    study = run.study
    study.left_out += [
        Note(NoteKind.LEFT_OUT, item.reason, item.name)
        for stage in listed
        for item in (stage, *stage.parts)
        if not item.needed
    ]
    try:
        for stage in listed:
            if not stage.needed or (study.unfinished and not stage.writes):
                continue
            if cache is not None and cache.has(stage.name):
                continue
            ask()
            with run.watch(stage.name):
                stage.run(run)
            if not stage.writes:
                study.seconds.setdefault(stage.name, run.watch.seconds[stage.name])
            if cache is not None:
                cache.keep(stage.name)
    except KeyboardInterrupt:
        keep_motion(run)
        raise


def _cache(run: Run, fresh: bool) -> OfflineCache | None:
    """The cache of a run whose reduced model can be stored; None for others."""
    from fenicsrom.study.offline_cache import offline_cache

    scene = run.study.scene
    if scene.static_only or _is_projected(scene):
        return None
    return offline_cache(run, fresh)


def _is_projected(scene: Scene) -> bool:
    """Whether the reduced model takes its elastic force from the mesh."""
    return scene.geometrically_nonlinear and scene.basis.elastic_force == "projection"


def _projected(source: object, reason: str) -> SceneError:
    """The error of a projected elastic force."""
    where = Where(str(source), "basis.elastic_force")
    return where.refuse("projection", f'{reason}; use "polynomial"', ErrorKind.CONFLICT)


def _require_resumable(resume: Path, scene: Scene) -> None:
    """Check, before the offline stages, that a run of a scene can continue from a checkpoint.

    Raises:
        SceneError: the file cannot be read, or belongs to another scene; or models of this scene
            have no checkpoints.
    """
    from fenicsrom.online.store.store import check_checkpoint

    if _is_projected(scene):
        raise _projected(resume, "has no checkpoints")
    check_checkpoint(resume, scene)


def all_ranks() -> Any:
    """Give the communicator of all ranks."""
    from mpi4py import MPI

    return MPI.COMM_WORLD
