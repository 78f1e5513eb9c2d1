"""Response curves: of a scene, whose reduced model is built first, or of a stored model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.execution import offline
from fenicsrom.study.stopwatch import Stopwatch, never

if TYPE_CHECKING:
    from fenicsrom.assess.curves.response_results import Response
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.scene import Scene


STATE = "response_state"  # folder of what is kept of the curves


def response(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    resume: Path | None = None,
    workers: int = 1,
    stop: Callable[[], bool] = never,
    fresh: bool = False,
) -> Response:
    """Build the reduced model of a scene, compute its response curves and write their files.

    Args:
        scene: the scene, with a table [response].
        comm: MPI communicator of the offline stages; by default all ranks.
        say: receives the progress, one line at a time; by default nobody.
        folder: folder of the output files; None writes no files.
        resume: folder of the state of an earlier run, from which the curves continue.
        workers: largest number of processes that compute curves at the same time, see
            `fenicsrom.assess.curves.response.response`; with several ranks there are no processes.
        stop: asked between the offline stages and at each point of a curve; the run ends where it
            returns True.
        fresh: compute all offline results, also where the cache has them.

    Raises:
        SceneError: the scene or the earlier state cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: `stop` returned True before the curves began.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves.response_files import check_folder
    from fenicsrom.assess.curves.response_problem import check_response
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.curves.response_report import write
    from fenicsrom.post.run.summary import stored_model

    check_response(scene)
    if resume is not None:
        check_folder(resume)
    built = offline(scene, comm, Stopwatch(say), stop=stop, fresh=fresh)
    stored, ranks = stored_model(built), built.solid.comm
    kept = folder if ranks.rank == 0 else None
    if kept is not None:
        save_model(kept / MODEL, stored)
    found = _curves(stored, say, kept, resume, workers if ranks.size == 1 else 1, stop)
    found.warnings[:0] = built.warnings
    if found.table.full_values and not found.interrupted:
        from fenicsrom.assess.curves.full_points import add_full_points

        assert built.basis is not None
        watch = Stopwatch(say)
        with watch("full model"):
            add_full_points(found, stored, built.solid, built.basis.vectors, watch.say)
    if folder is not None and found.curves:
        found.files = write(found, stored, folder, built)
    return found


def response_of_model(
    stored: StoredModel,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    resume: Path | None = None,
    workers: int = 1,
    stop: Callable[[], bool] = never,
) -> Response:
    """Compute the response curves of a stored model; arguments as `response`.

    Raises:
        SceneError: the scene of the model or the earlier state cannot be used.
        OSError: a file cannot be written.
    """
    from fenicsrom.assess.curves.response_files import check_folder
    from fenicsrom.assess.errors.large_strains import equilibrium_warnings
    from fenicsrom.post.curves.response_report import write

    if resume is not None:
        check_folder(resume)
    found = _curves(stored, say, folder, resume, workers, stop)
    found.warnings[:0] = equilibrium_warnings(stored.deformation)
    if found.table.full_values:
        found.warnings.append(
            "response.full was left out: the full model needs the mesh, which a stored model does "
            "not have; run fenicsrom response SCENE."
        )
    if folder is not None and found.curves:
        found.files = write(found, stored, folder)
    return found


def _curves(
    stored: StoredModel,
    say: Callable[[str], None] | None,
    folder: Path | None,
    resume: Path | None,
    workers: int,
    stop: Callable[[], bool],
) -> Response:
    """Compute the response curves of a stored model; arguments as `response`."""
    from fenicsrom.assess.curves import response as curves
    from fenicsrom.assess.curves.trust import richer_model

    watch = Stopwatch(say)
    with watch("response curves"):
        return curves.response(
            stored,
            lambda line: watch.say(f"  {line}"),
            state=None if folder is None else folder / STATE,
            resume=resume,
            workers=workers,
            stop=stop,
            richer=richer_model(stored),
        )
