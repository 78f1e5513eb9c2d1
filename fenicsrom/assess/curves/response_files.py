"""Files that keep what is done of response curves, to continue an interrupted run.

A folder holds one file for each curve, so that the processes that compute the curves share no file.
Each file names the model and the scene it belongs to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.checkpoints import fingerprint
from fenicsrom.online.store.packing import pack, unpack
from fenicsrom.online.store.scene_changes import changed_run_key, first_difference
from fenicsrom.scene import Scene, parse_scene, scene_table

if TYPE_CHECKING:
    from fenicsrom.assess.curves.response_results import ResponseCurve

FORMAT = "fenicsrom response state 3"
WHAT = "the state of a response curve"


@dataclass(frozen=True, eq=False)
class KeptCurve:
    """The part of a curve that a file keeps.

    Attributes:
        curve: the computed part of the curve.
        done: whether it is complete.
    """

    curve: ResponseCurve
    done: bool


@dataclass(frozen=True, eq=False)
class CurveFile:
    """The file of one curve.

    Attributes:
        path: the file.
        number: number of the curve, from 1.
        model: fingerprint of the model.
        scene: the scene of all curves.
    """

    path: Path
    number: int
    model: str
    scene: Scene

    def save(self, curve: ResponseCurve, *, done: bool) -> None:
        """Write the file; it appears only when it is complete.

        Raises:
            OSError: the file cannot be written.
        """
        tree, arrays = pack(KeptCurve(curve, done))
        header = {
            "format": FORMAT,
            "model": self.model,
            "source": self.scene.source,
            "scene": scene_table(self.scene),
            "number": self.number,
            "tree": tree,
        }
        write_archive(self.path, header, arrays)

    def load(self, classes: Mapping[str, Any]) -> KeptCurve | None:
        """Read the file; None if it does not exist, because its curve did not begin.

        Args:
            classes: the dataclasses of a curve, by name.

        Raises:
            SceneError: the file is damaged, or belongs to another model or scene.
        """
        if not self.path.exists():
            return None
        with read_archive(self.path, WHAT, FORMAT) as (header, arrays):
            self._check(header)
            found: KeptCurve = unpack(header["tree"], arrays, {**classes, "KeptCurve": KeptCurve})
        return found

    def _check(self, header: Mapping[str, Any]) -> None:
        """Check that the file belongs to the model and the scene.

        Raises:
            SceneError: it does not.
        """
        made = parse_scene(header["scene"], str(header["source"]), None)
        if (key := changed_response_key(made, self.scene)) is not None:
            raise SceneError(
                f"{self.path}: {key} differs from the scene that wrote this file; "
                "curves continue only with the same scene",
                kind=ErrorKind.MISMATCH,
                key=key,
                source=str(self.path),
            )
        if header["model"] != self.model or header["number"] != self.number:
            raise SceneError(
                f"{self.path}: another reduced model wrote this file; "
                "resume with the model that wrote it: --from MODEL",
                kind=ErrorKind.MISMATCH,
                source=str(self.path),
            )


def curve_file(folder: Path, stored: StoredModel, number: int) -> CurveFile:
    """The file of a curve in a folder."""
    return CurveFile(
        folder / f"curve_{number}.npz", number, fingerprint(stored.model), stored.scene
    )


def check_folder(folder: Path) -> None:
    """Check that a folder holds the state of curves.

    Raises:
        SceneError: it does not.
    """
    if not any(folder.glob("curve_*.npz")):
        raise SceneError(
            f"{folder}: must be a folder with curve_1.npz, such as the response_state of an "
            "earlier run",
            kind=ErrorKind.FILE,
            source=str(folder),
        )


def forget(folder: Path) -> None:
    """Remove the state of an earlier run.

    Raises:
        OSError: a file cannot be removed.
    """
    for path in folder.glob("curve_*.npz"):
        path.unlink(missing_ok=True)


def changed_response_key(made: Scene, wanted: Scene) -> str | None:
    """The first key on which a response curve depends and in which two scenes differ, or None."""
    if (key := changed_run_key(made, wanted)) is not None:
        return key
    if made.response is None or wanted.response is None:
        return None if made.response == wanted.response else "response"
    names = [part.name for part in fields(wanted.response)]
    name = first_difference(made.response, wanted.response, names)
    return None if name is None else f"response.{name}"
