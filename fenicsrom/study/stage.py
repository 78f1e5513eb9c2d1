"""A stage of a scene, a line of the plan, and the data that the stages of one run share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.study.stopwatch import Stopwatch

if TYPE_CHECKING:
    from fenicsrom.fem.mesh.mesh import Mesh
    from fenicsrom.reduction.snapshots import Snapshots
    from fenicsrom.reduction.stages import Reduction


@dataclass(frozen=True)
class Item:
    """One line of the plan.

    Attributes:
        name: name of a stage, or of a part of the stage above this line.
        needed: whether the scene needs the stage.
        reason: why, in a few words.
    """

    name: str
    needed: bool
    reason: str


@dataclass(frozen=True)
class Stage(Item):
    """One stage of a scene.

    Attributes:
        run: executes the stage and stores its result in the study.
        parts: the parts of the stage; the stage skips a part that is not needed.
        writes: whether the stage only writes files. Such a stage runs even if a motion failed.
    """

    run: Callable[[Run], None]
    parts: tuple[Item, ...] = ()
    writes: bool = False


@dataclass(eq=False)
class Run:
    """The data that the stages of one run share.

    Attributes:
        study: the record that the stages fill: a `Study`, or the `Rerun` of a stored model.
        comm: MPI communicator of the offline stages and the full model; None for a stored model.
        watch: times the stages.
        folder: folder of the output files; None writes no files.
        resume: checkpoint from which the reduced model continues.
        mesh: the mesh; None until it is made.
        fresh: whether to compute all results, also those that the cache has.
        cached: whether the cache may have results: the mesh is that of the scene.
        snapshots: the deflections by which modes and derivatives are selected.
        reduction: the stages from the modes to the reduced model.
    """

    study: Any
    comm: Any
    watch: Stopwatch
    folder: Path | None = None
    resume: Path | None = None
    mesh: Mesh | None = None
    fresh: bool = False
    cached: bool = True
    snapshots: Snapshots = field(init=False)
    reduction: Reduction = field(init=False)

    @property
    def first(self) -> bool:
        """Whether this rank writes the files."""
        return self.comm is None or self.comm.rank == 0
