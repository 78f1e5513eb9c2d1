"""What curves start from: a stored model, or a scene whose reduced model is built first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.notes import Note
from fenicsrom.scene import Scene
from fenicsrom.study.building import resize
from fenicsrom.study.execution import build_model, offline
from fenicsrom.study.stopwatch import Stopwatch

if TYPE_CHECKING:
    from fenicsrom.online.store.archive import StoredModel
    from fenicsrom.online.store.disk import StoredDisk
    from fenicsrom.records import Study


@dataclass(frozen=True, eq=False)
class Source:
    """A reduced model and where it came from.

    Attributes:
        stored: the model under its scene.
        warnings: warnings of its offline stages, or of its equilibrium.
        study: the record of the offline stages; None of a stored model.
    """

    stored: StoredModel
    warnings: list[Note]
    study: Study | None

    @property
    def first(self) -> bool:
        """Whether this rank writes files."""
        return self.study is None or self.study.solid.comm.rank == 0

    @property
    def comm(self) -> Any:
        """Communicator of the offline stages; None for a stored model."""
        return None if self.study is None else self.study.solid.comm

    def with_model(self, stored: StoredModel, folder: Path | None) -> Source:
        """The source with other coordinates of its model, which is written to the folder.

        Raises:
            OSError: the model cannot be written.
        """
        from fenicsrom.online.store.archive import save_model
        from fenicsrom.post.base.origin import MODEL

        if self.study is not None:
            resize(self.study, stored)
            if folder is not None and self.first:
                save_model(folder / MODEL, stored)
        return replace(self, stored=stored)


def source_of(
    given: Scene | StoredModel,
    comm: Any,
    folder: Path | None,
    fresh: bool,
) -> Source:
    """Take a stored model as it is, or build the model of a scene and write it to the folder.

    Arguments and errors as `fenicsrom.study.execution.offline`.

    Raises:
        OSError: the model cannot be written.
    """
    from fenicsrom.assess.errors.plausibility import equilibrium_warnings
    from fenicsrom.online.store.archive import save_model
    from fenicsrom.post.base.origin import MODEL
    from fenicsrom.post.run.report import range_warnings

    if not isinstance(given, Scene):
        warnings = [*equilibrium_warnings(given.deformation), *range_warnings(given)]
        return Source(given, warnings, None)
    if given.speeds_rpm is not None:
        stored = build_model(given, comm=comm, fresh=fresh)
        if folder is not None:
            save_model(folder / MODEL, stored)
        return Source(stored, range_warnings(stored), None)
    built = offline(given, comm, Stopwatch(), fresh=fresh)
    found = Source(built.stored, built.warnings, built)
    if folder is not None and found.first:
        save_model(folder / MODEL, found.stored)
    return found


def scene_of(given: Scene | StoredModel | StoredDisk) -> Scene:
    """The scene of a stored model or disk, or the scene itself."""
    return given if isinstance(given, Scene) else given.scene
