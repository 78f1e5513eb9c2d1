"""Analyses that need no reduced model of their own: paths, diagrams, comparisons, extremes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from fenicsrom.scene import Rotation, Scene
from fenicsrom.scene.base.rules import Where
from fenicsrom.study.execution import all_ranks, run
from fenicsrom.study.given import starts_from
from fenicsrom.study.writing import written

if TYPE_CHECKING:
    from fenicsrom.assess.curves.equilibrium_path import EquilibriumPath
    from fenicsrom.assess.rotation.campbell import Campbell
    from fenicsrom.assess.studies.compare import Comparison
    from fenicsrom.assess.studies.stability import Matrix
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.records import Study
    from fenicsrom.scene import Overrides


@starts_from()
def statics(scene: Scene, comm: Any = None, *, folder: Path | None = None) -> EquilibriumPath:
    """Follow the static equilibria of a scene over a load factor. Collective.

    Args:
        scene: a scene with static loads and a table [statics].
        comm: MPI communicator; by default all ranks.
        folder: folder of the output files; None writes no files.

    Returns:
        The path. After an interrupt it ends where it was, and `interrupted` is set; if it was lost,
        `unfinished` holds the error.

    Raises:
        SceneError: the scene cannot be used.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves.equilibrium_path import equilibrium_path

    comm = comm or all_ranks()
    found = equilibrium_path(scene, comm)
    if folder is not None and found.points:
        from fenicsrom.post.curves import equilibrium_report
        from fenicsrom.post.run.pictures import setup_pictures

        shapes = equilibrium_report.write_shapes(found, folder)
        setup = setup_pictures(found.body, scene)
        if comm.rank == 0:
            found.files = [*equilibrium_report.report(found, setup).write(folder), *shapes]
    return found


@starts_from(sectors=True)
def modes(scene: Scene, comm: Any = None, *, folder: Path | None = None) -> Study | Campbell:
    """Compute the modes and the modal derivatives of a scene, which needs no loads. Collective.

    Arguments and errors as `run`. Of a sector of a disk, the modes come by nodal diameter: see
    `nodal_diameters`.
    """
    if scene.cyclic is not None:
        return nodal_diameters(scene, comm, folder=folder)
    return cast("Study", run(scene, comm, folder=folder, modes_only=True))


@starts_from(sectors=True)
def nodal_diameters(scene: Scene, comm: Any = None, *, folder: Path | None = None) -> Campbell:
    """Compute the modes of a disk by nodal diameter, at the speed of the scene. Collective.

    Args:
        scene: a scene with the table [cyclic].
        comm: MPI communicator; by default all ranks.
        folder: folder of the output files; None writes no files.

    Returns:
        A Campbell diagram at one speed.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: the modes were not found.
        OSError: a file cannot be written.
    """
    cyclic = scene.cyclic
    if cyclic is None:
        raise Where(scene.source, "cyclic").refuse(MISSING, "a disk needs this table")
    rotation = scene.rotation or Rotation(speed_rpm=0.0, axis=cyclic.axis, point=cyclic.point)
    modes = scene.basis.modes if isinstance(scene.basis.modes, int) else scene.campbell.modes
    diagram = replace(scene.campbell, speeds_rpm=(rotation.speed_rpm,), modes=modes)
    return campbell(replace(scene, rotation=rotation, campbell=diagram), comm, folder=folder)


@starts_from("StoredModel", sectors=True)
def campbell(
    given: Scene | StoredModel, comm: Any = None, *, folder: Path | None = None
) -> Campbell:
    """Compute the Campbell diagram of a scene, or of a stored model for a range of speeds.

    Args:
        given: a scene with the tables [rotation] and [campbell], for which the call is collective;
            or a stored model, which needs no mesh.
        comm: MPI communicator of a scene; by default all ranks.
        folder: folder of the output files; None writes no files.

    Returns:
        The diagram; `unfinished` holds an error that stopped it before the last speed.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: the body has no modes at the first speed.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.rotation import campbell as diagram

    if isinstance(given, Scene):
        comm = comm or all_ranks()
    found = diagram.campbell(given, comm)
    if folder is not None:
        from fenicsrom.post.run.pictures import setup_pictures
        from fenicsrom.post.studies import disk_report
        from fenicsrom.post.studies.campbell_report import report

        more = [] if found.body is None else setup_pictures(found.body, found.scene)
        written: list[Path] = []
        if found.waves:
            report = disk_report.disk_report
            if found.scene.output.pictures:
                more = [*disk_report.shape_picture(found), *more]
            if found.scene.output.paraview:
                written = disk_report.write_disk(found, folder)
        if comm is None or comm.rank == 0:
            found.files = [*report(found, more).write(folder), *written]
    return found


@starts_from(sectors=True)
def compare(scene: Scene, comm: Any = None, *, folder: Path | None = None) -> Comparison:
    """Compare reduced bases of a scene with its full model: error against run time. Collective.

    Args:
        scene: a scene with a table [compare]; with [cyclic], its full model is the whole disk.
        comm: MPI communicator; by default all ranks.
        folder: folder of the output files; None writes no files.

    Returns:
        The comparison. After an interrupt, `interrupted` is set, and the outcomes are those of the
        combinations that are done.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: the full model has no motion.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.studies.compare import compare as compare_bases
    from fenicsrom.assess.studies.compare_disk import compare_disk

    comm = comm or all_ranks()
    compared = compare_bases if scene.cyclic is None else compare_disk
    return written(compared(scene, comm), folder, comm)


def stability(
    scene: Path,
    overrides: Overrides = (),
    *,
    axes: Sequence[str] = (),
    variants: int = 0,
    seed: int = 0,
    folder: Path | None = None,
) -> Matrix:
    """Run extreme or random variants of a scene file, with a verdict on each.

    Args:
        scene: the scene file.
        overrides: changes of the scene, as texts "KEY=VALUE" or as values by their keys.
        axes: names of the axes that are run; by default all.
        variants: number of random variants, which run instead of the axes.
        seed: seed of the random variants.
        folder: folder of the output files; None writes no files.

    Raises:
        SceneError: the scene cannot be used.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.studies import stability as extremes
    from fenicsrom.scene import override_texts

    found = extremes.stability(scene, override_texts(overrides), axes, variants=variants, seed=seed)
    return written(found, folder)
