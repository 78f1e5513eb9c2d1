"""Damped nonlinear modes of a scene or of a stored model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.source import scene_of, source_of
from fenicsrom.study.stopwatch import Stopwatch, never

if TYPE_CHECKING:
    from fenicsrom.assess.curves.backbone import Backbone
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.scene import Scene


def backbone(
    given: Scene | StoredModel,
    comm: Any = None,
    *,
    folder: Path | None = None,
    stop: Callable[[], bool] = never,
    fresh: bool = False,
) -> Backbone:
    """Compute the nonlinear mode of a scene, whose reduced model is built first, or of a model.

    Args:
        given: a scene with a table [backbone], or a stored model under such a scene.
        comm: MPI communicator of the offline stages; by default all ranks.
        folder: folder of the output files; None writes no files.
        stop: asked between the offline stages; the run ends where it returns True.
        fresh: compute all offline results, also those that the cache has.

    Returns:
        The mode. After an interrupt it ends where it was, and `interrupted` is set; if the curve or
        a peak was not found, `unfinished` holds the error.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed, or the model has no equilibrium.
        KeyboardInterrupt: `stop` returned True before the curve began.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves import backbone as modes
    from fenicsrom.assess.errors.mesh_check import of_model
    from fenicsrom.assess.errors.sizing import with_size
    from fenicsrom.post.reports import report

    modes.check_backbone(scene_of(given))
    watch = Stopwatch()
    source = source_of(given, comm, watch, folder, stop, fresh)
    if (size := source.stored.scene.basis.size) is not None:
        source = source.with_model(with_size(source.stored, None, size), folder)
    with watch("nonlinear mode"):
        found = modes.backbone(source.stored)
    if found.labels != source.stored.labels:
        source = source.with_model(source.stored.resized(found.labels), folder)
    found.mesh_check = of_model(source.stored)
    found.warnings[:0] = [*source.warnings, *found.mesh_check.warnings(found.scene)]
    if folder is not None and found.points and source.first:
        found.files = report(found).write(folder)
    return found
