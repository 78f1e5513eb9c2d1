"""The common part of the records of response curves and of nonlinear modes."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from fenicsrom.assess.errors.mesh_check import MeshCheck
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind, SceneError
from fenicsrom.notes import Note
from fenicsrom.online.contact.points import ContactPoints
from fenicsrom.scene import Scene

Table = TypeVar("Table")


@dataclass(eq=False)
class CurveRecord:
    """The model that a curve belongs to, and how its computation ended.

    Attributes:
        scene: the scene.
        size: number of coordinates of the reduced model.
        dimension: of space.
        contact_points: the contact points.
        steps: time steps of a period.
        seconds: run time.
        warnings: notes for the user.
        unfinished: the error that ended the computation, or that of the first curve that was not
            found; None if there is none.
        interrupted: whether the run was asked to stop; the last curve is then incomplete.
        files: the written files, the one to open first at the head.
        mesh_check: estimated errors of the natural frequencies due to the mesh, which move the
            curve by about as much.
    """

    scene: Scene
    size: int
    dimension: int
    contact_points: ContactPoints
    steps: int
    seconds: float = field(default=0.0, kw_only=True)
    warnings: list[Note] = field(default_factory=list, kw_only=True)
    unfinished: ConvergenceError | AccuracyError | None = field(default=None, kw_only=True)
    interrupted: bool = field(default=False, kw_only=True)
    files: list[Path] = field(default_factory=list, kw_only=True)
    mesh_check: MeshCheck = field(default_factory=MeshCheck, kw_only=True)

    @property
    def contacts(self) -> int:
        """Number of contact points."""
        return self.contact_points.contact.size


def required_table(scene: Scene, name: str, table: Table | None) -> Table:
    """The table of a scene with the given name.

    Raises:
        SceneError: the scene has no such table.
    """
    if table is None:
        raise SceneError(
            f"{scene.source}: {name} is missing: must be a table with first and last (or add "
            f"--set {name}.first=NUMBER --set {name}.last=NUMBER)",
            kind=ErrorKind.MISSING,
            key=name,
            source=scene.source,
        )
    return table
