"""Response curves and backbones: of a scene, whose reduced model is built first, or of a model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.execution import all_ranks, execute
from fenicsrom.study.scene_stages import offline_stages
from fenicsrom.study.stage import Run
from fenicsrom.study.stopwatch import Stopwatch, never

if TYPE_CHECKING:
    from fenicsrom.assess.backbone import Backbone
    from fenicsrom.assess.response import Response
    from fenicsrom.online.archive import StoredModel
    from fenicsrom.scene import Scene


def response(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    stop: Callable[[], bool] = never,
) -> Response:
    """Build the reduced model of a scene and compute its response curves.

    Args:
        scene: the scene, with a table [response].
        comm: MPI communicator of the offline stages; by default all ranks.
        say: receives the progress, one line at a time; by default nobody.
        folder: folder of the reduced model; None writes no model.
        stop: asked between the offline stages; the run ends where it returns True.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: `stop` returned True before the curves began.
        OSError: the model cannot be written.
    """
    from fenicsrom.assess.response import check_response

    check_response(scene)
    stored, warnings = _reduce(scene, comm, say, folder, stop)
    found = response_of_model(stored, say)
    found.warnings[:0] = warnings
    return found


def response_of_model(stored: StoredModel, say: Callable[[str], None] | None = None) -> Response:
    """Compute the response curves of a stored model; arguments as `response`.

    Raises:
        SceneError: the scene of the model cannot be used.
    """
    from fenicsrom.assess import response as curves

    watch = Stopwatch(say if say is not None else lambda line: None)
    with watch("response curves"):
        return curves.response(stored, watch.say)


def backbone(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    stop: Callable[[], bool] = never,
) -> Backbone:
    """Build the reduced model of a scene and compute its nonlinear mode.

    Args and errors are those of `response`; the scene has a table [backbone].
    """
    from fenicsrom.assess.backbone import check_backbone

    check_backbone(scene)
    stored, warnings = _reduce(scene, comm, say, folder, stop)
    found = backbone_of_model(stored, say)
    found.warnings[:0] = warnings
    return found


def backbone_of_model(stored: StoredModel, say: Callable[[str], None] | None = None) -> Backbone:
    """Compute the nonlinear mode of a stored model; arguments as `response`.

    Raises:
        SceneError: the scene of the model cannot be used.
        ConvergenceError: the model has no equilibrium.
    """
    from fenicsrom.assess import backbone as modes

    watch = Stopwatch(say if say is not None else lambda line: None)
    with watch("nonlinear mode"):
        return modes.backbone(stored, watch.say)


def _reduce(
    scene: Scene,
    comm: Any,
    say: Callable[[str], None] | None,
    folder: Path | None,
    stop: Callable[[], bool],
) -> tuple[StoredModel, list[str]]:
    """Build the reduced model of a scene and store it; also give the warnings of its stages."""
    from fenicsrom.online.archive import save_model
    from fenicsrom.post.record import Study
    from fenicsrom.post.summary import MODEL, stored_model

    say = say if say is not None else (lambda line: None)
    run = Run(Study(scene), comm or all_ranks(), Stopwatch(say), folder, stop=stop)
    execute(run, offline_stages(scene, modes_only=False))
    stored = stored_model(run.study)
    if folder is not None and run.comm.rank == 0:
        save_model(folder / MODEL, stored)
    return stored, run.study.warnings
