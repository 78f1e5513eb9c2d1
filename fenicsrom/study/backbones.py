"""Damped nonlinear modes: of a scene, whose reduced model is built first, or of a stored model."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.execution import offline
from fenicsrom.study.stopwatch import Stopwatch, never

if TYPE_CHECKING:
    from fenicsrom.assess.curves.backbone import Backbone
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.scene import Scene


def backbone(
    scene: Scene,
    comm: Any = None,
    say: Callable[[str], None] | None = None,
    *,
    folder: Path | None = None,
    stop: Callable[[], bool] = never,
    fresh: bool = False,
) -> Backbone:
    """Build the reduced model of a scene and compute its nonlinear mode.

    Args:
        scene: the scene, with a table [backbone].
        comm: MPI communicator of the offline stages; by default all ranks.
        say: receives the progress, one line at a time; by default nobody.
        folder: folder of the reduced model; None writes no model.
        stop: asked between the offline stages; the run ends where it returns True.
        fresh: compute all offline results, also where the cache has them.

    Raises:
        SceneError: the scene cannot be used.
        ConvergenceError, AccuracyError: an offline stage failed.
        KeyboardInterrupt: `stop` returned True before the curve began.
        OSError: the model cannot be written.
    """
    from fenicsrom.assess.curves.backbone import check_backbone
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.run.summary import stored_model

    check_backbone(scene)
    built = offline(scene, comm, Stopwatch(say), stop=stop, fresh=fresh)
    stored = stored_model(built)
    if folder is not None and built.solid.comm.rank == 0:
        save_model(folder / MODEL, stored)
    found = _followed(stored, say)
    found.warnings[:0] = built.warnings
    return found


def backbone_of_model(stored: StoredModel, say: Callable[[str], None] | None = None) -> Backbone:
    """Compute the nonlinear mode of a stored model; arguments as `backbone`.

    Raises:
        SceneError: the scene of the model cannot be used.
        ConvergenceError: the model has no equilibrium.
    """
    from fenicsrom.assess.errors.large_strains import equilibrium_warnings

    found = _followed(stored, say)
    found.warnings[:0] = equilibrium_warnings(stored.deformation)
    return found


def _followed(stored: StoredModel, say: Callable[[str], None] | None) -> Backbone:
    """Compute the nonlinear mode of a stored model; arguments and errors as there."""
    from fenicsrom.assess.curves import backbone as modes

    watch = Stopwatch(say)
    with watch("nonlinear mode"):
        return modes.backbone(stored, lambda line: watch.say(f"  {line}"))
