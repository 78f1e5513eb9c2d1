"""The interaction map of a scene or of a stored model for a range of speeds."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from fenicsrom.study.given import starts_from
from fenicsrom.study.source import scene_of, source_of
from fenicsrom.study.stopwatch import Stopwatch, never

if TYPE_CHECKING:
    from fenicsrom.assess.jobs import Workers
    from fenicsrom.assess.studies.interaction import InteractionMap
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.scene import Scene

LINES = "map_lines"  # folder of the speeds that are done


@starts_from("StoredModel")
def interaction_map(
    given: Scene | StoredModel,
    comm: Any = None,
    *,
    folder: Path | None = None,
    resume: bool = False,
    workers: Workers = 1,
    stop: Callable[[], bool] = never,
    fresh: bool = False,
) -> InteractionMap:
    """Compute the interaction map of a body that rubs its casing, over the speed of rotation.

    Args:
        given: a scene with `rotation.speeds_rpm` and a table [map], or a stored model of such a
            scene.
        comm: MPI communicator; several ranks share the speeds of a stored model.
        folder: folder of the output files; None writes no files.
        resume: keep the speeds that an earlier map left in the folder.
        workers: largest number of processes, or an executor.
        stop: asked often; the map ends where it returns True.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The map. After an interrupt it has the speeds that are done, and `interrupted` is set.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.errors.comparisons import of_model
    from fenicsrom.assess.studies import interaction
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.reports import report
    from fenicsrom.post.studies.interaction_report import write_hdf5

    interaction.map_speeds(scene_of(given))
    if resume and folder is not None:
        interaction.check_kept(folder / LINES)
    with TemporaryDirectory() if folder is None else nullcontext(folder) as place:
        source = source_of(given, comm, Stopwatch(), folder, stop, fresh)
        model = Path(place) / f"{'' if source.stored is not given else 'stored_'}{MODEL}"
        save_model(model, source.stored)
        found = interaction.interaction_map(
            source.stored.scene,
            model,
            Path(place) / LINES,
            resume=resume,
            workers=workers,
            stop=stop,
            comm=comm,
        )
        ends = found.speeds_rpm[[0, -1]] if found.lines else ()
        judged = of_model(source.stored, *ends).warnings(found.scene)
        found.warnings[:0] = [*source.warnings, *judged]
        if folder is not None and found.lines and (comm is None or comm.rank == 0):
            arrays = write_hdf5(found, folder / "map.h5")
            found.files = [*report(found).write(folder), *arrays]
    return found
