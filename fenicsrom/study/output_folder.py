"""The folder of a run: it holds one run, says what was run, and is written by one process.

The same scene may run again in its folder; the new files replace the old ones. The results of
another scene are replaced only on request. Files of the earlier run wait in a hidden folder until
the new run ends. A run without results puts them back; a run of the same scene that fails or is
interrupted puts back those that it has not written again.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import ErrorKind, SceneError

if TYPE_CHECKING:
    from fenicsrom.post.base.origin import Origin
    from fenicsrom.scene import Scene

WAITING = ".earlier"  # folder of the files of the earlier run
UNNAMED_RESULTS = ("report.html", "summary.json")  # of runs without a record
Stamps = dict[str, tuple[int, int]]

_held: set[Path] = set()
"""The folders that this process holds; a second entry does nothing."""


@contextmanager
def output_folder(
    folder: Path,
    scene: Scene,
    comm: Any = None,
    origin: Origin | None = None,
    overwrite: bool = False,
) -> Iterator[None]:
    """Hold a folder, write what is run, and replace the results of an earlier run. Collective.

    Args:
        folder: the folder, made if missing.
        scene: the scene.
        comm: MPI communicator, of which the first rank writes; None for one process.
        origin: how the computation was started; by default by a Python program.
        overwrite: replace the results of another scene, too.

    Raises:
        SceneError: another process writes to the folder, or it holds another run.
        OSError: the folder cannot be written.
    """
    with ExitStack() as stack:
        if comm is None or comm.rank == 0:
            held = _held_folder(folder, scene, comm, origin, overwrite)
            _together(comm, lambda: stack.enter_context(held))
        else:
            _together(comm, lambda: None)
        yield


def _together(comm: Any, work: Callable[[], Any]) -> None:
    """Do the work of the first rank; every rank raises its error."""
    failure: Exception | None = None
    try:
        work()
    except (SceneError, OSError) as error:
        failure = error
    if comm is not None:
        failure = comm.bcast(failure)
    if failure is not None:
        raise failure


@contextmanager
def _held_folder(
    folder: Path, scene: Scene, comm: Any, origin: Origin | None, overwrite: bool
) -> Iterator[None]:
    """`output_folder` on the first rank."""
    from fenicsrom.files import locked_folder
    from fenicsrom.post.base.origin import SCENE_FILE, python_origin, read_record, write_origin

    place = folder.resolve()
    if place in _held:
        yield
        return
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    with locked_folder(folder) as free:
        record = read_record(folder)
        if not free:
            what = f" ({record['command']}, since {record['began']})" if record else ""
            raise _refused(folder, f"another run is writing to it{what}; choose another folder")
        origin = origin or python_origin()
        _put_back(folder)  # of a run that was killed
        inputs = [Path(scene.source), scene.geometry.mesh, origin.model, origin.resume]
        kept = {path.resolve() for path in inputs if path is not None}
        continued = _continues(folder, record, scene, origin)
        if record is None and (folder / SCENE_FILE).exists():
            reason = f"it holds a {SCENE_FILE}, which the run would replace; choose another folder"
            raise _refused(folder, reason)
        earlier = [] if continued else _earlier_results(folder, record)
        same = record is not None and _is_same_run(folder, record, scene, origin)
        if not (continued or overwrite or same):
            _require_free(folder, record, earlier)
        _put_aside(folder, earlier, kept)
        before = _stamps(folder)
        _held.add(place)
        try:
            try:
                written = write_origin(folder, scene, origin, 1 if comm is None else comm.size)
            except BaseException:
                _restore(folder, set(_stamps(folder)) - set(before))
                raise
            own = _earlier_results(folder, record) if continued else []
            with _recorded(folder, written, before, own, same):
                yield
        finally:
            _held.discard(place)
            if made and not any(folder.iterdir()):
                folder.rmdir()


@contextmanager
def _recorded(
    folder: Path, record: dict[str, Any], before: Stamps, continued: list[str], same: bool
) -> Iterator[None]:
    """Complete the record when the body ends; without results, restore the earlier state.

    Args:
        folder: the folder.
        record: the record of the run.
        before: the entries of the folder before the run.
        continued: names of the results of the run that this one continues in its own folder.
        same: whether the earlier run is one of the same scene.
    """
    from fenicsrom.post.base.origin import RECORD, SCENE_FILE, end_record, write_record

    state = "complete"
    copies = [record[key].get("copy") for key in ("mesh", "model") if record[key]]
    own = {SCENE_FILE, RECORD, *copies}
    try:
        yield
    except BaseException as error:
        interrupted = isinstance(error, KeyboardInterrupt)
        state = "interrupted" if interrupted else f"failed: {error}"
        raise
    finally:
        results = [name for name, stamp in _stamps(folder).items() if before.get(name) != stamp]
        results = [name for name in results if name not in own]
        if results or state == "complete":
            back = _put_back(folder) if same and state != "complete" else []
            shutil.rmtree(folder / WAITING, ignore_errors=True)
            results = sorted({*results, *continued, *back})
            copy = [name for name in own - {SCENE_FILE, RECORD} if name and name not in before]
            write_record(folder, end_record(record, state, [*results, *copy]))
        else:
            _restore(folder, {name for name in own if name and name not in before})


def _require_free(folder: Path, record: dict[str, Any] | None, earlier: list[str]) -> None:
    """Check that a folder holds no results.

    Raises:
        SceneError: it holds some.
    """
    if record is None:
        unnamed = [name for name in UNNAMED_RESULTS if (folder / name).exists()]
        if unnamed:
            reason = f"it holds {unnamed[0]} of a run without provenance.json"
            raise _refused(folder, f"{reason}; choose another folder, or add --force")
    elif earlier:
        what = f"{record['command']}, {record['began']}"
        raise _refused(
            folder, f"it holds another run ({what}); choose another folder, or add --force"
        )


def _continues(folder: Path, record: dict[str, Any] | None, scene: Scene, origin: Origin) -> bool:
    """Whether a run continues what the same command left in this folder.

    A sweep may go on with other values, but only under the scene of its earlier results.
    """
    if record is None or origin.resume is None:
        return False
    same_command = list(record.get("task") or ())[:1] == list(origin.task[:1])
    inside = folder.resolve() in origin.resume.resolve().parents
    sweeps = origin.task[0] == "sweep"
    return same_command and inside and (not sweeps or _has_same_scene(folder, record, scene))


def _is_same_run(folder: Path, record: dict[str, Any], scene: Scene, origin: Origin) -> bool:
    """Whether the folder holds the same task on the same scene and the same mesh file."""
    return record.get("task") == list(origin.task) and _has_same_scene(folder, record, scene)


def _has_same_scene(folder: Path, record: dict[str, Any], scene: Scene) -> bool:
    """Whether the folder holds a run of the same scene and the same mesh file."""
    from fenicsrom.post.base.origin import SCENE_FILE, checksum
    from fenicsrom.scene import scene_table

    try:
        found = tomllib.loads((folder / SCENE_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    wanted, mesh = scene_table(scene), scene.geometry.mesh
    for table in (found, wanted):
        table.get("geometry", {}).pop("mesh", None)
        table.pop("title", None)
    known = record["mesh"]
    same_mesh = known is None or not mesh.is_file() or known["sha256"] == checksum(mesh)
    return bool(found == wanted) and same_mesh


def _earlier_results(folder: Path, record: dict[str, Any] | None) -> list[str]:
    """Names of the files and folders that an earlier run wrote, as far as they are known."""
    if record is None:
        return []
    if record["results"] is not None:
        return [name for name in record["results"] if (folder / name).exists()]
    usual = _usual_names(folder) | {(record["mesh"] or {}).get("copy")}
    return [name for name in _stamps(folder) if name in usual]


def _usual_names(folder: Path) -> set[str]:
    """Names that a run that was killed may have left: those of this program's kinds of files."""
    kinds = {".html", ".json", ".npz", ".png", ".gif", ".csv", ".vtu"}
    return {path.name for path in folder.iterdir() if path.suffix in kinds or _is_series(path)}


def _is_series(path: Path) -> bool:
    """Whether a folder holds a series for ParaView or the state of curves."""
    return path.is_dir() and (any(path.glob("*.pvd")) or path.name == "response_state")


def _stamps(folder: Path) -> Stamps:
    """The entries of a folder that may be results, with marks that change when they are written."""
    from fenicsrom.post.base.origin import RECORD

    found = {}
    for path in folder.iterdir():
        if path.name == WAITING or (path / RECORD).exists():  # a folder of another run
            continue
        state = path.stat()
        found[path.name] = (state.st_ino, state.st_mtime_ns)
    return found


def _put_aside(folder: Path, names: list[str], kept: set[Path]) -> None:
    """Move the record and the results, but no input of the new run, into the waiting folder."""
    from fenicsrom.post.base.origin import RECORD, SCENE_FILE

    waiting = folder / WAITING
    if not waiting.exists():
        waiting.mkdir()
    for name in dict.fromkeys((SCENE_FILE, RECORD, *names)):
        path = folder / name
        own = name in (SCENE_FILE, RECORD)  # the new run writes these again
        inside = any(path.resolve() in (file, *file.parents) for file in kept)
        if path.exists() and (own or not inside):
            os.replace(path, waiting / name)
    if not any(waiting.iterdir()):
        waiting.rmdir()


def _put_back(folder: Path) -> list[str]:
    """Put back the waiting files that the new run has not written; give their names."""
    waiting, back = folder / WAITING, []
    if waiting.exists():
        for path in waiting.iterdir():
            if not (folder / path.name).exists():
                os.replace(path, folder / path.name)
                back.append(path.name)
        shutil.rmtree(waiting)
    return back


def _restore(folder: Path, written: set[str]) -> None:
    """Remove the files that the new run wrote, and put all earlier ones back."""
    for name in written:
        (folder / name).unlink(missing_ok=True)
    waiting = folder / WAITING
    if waiting.exists():
        for path in waiting.iterdir():
            os.replace(path, folder / path.name)
        waiting.rmdir()


def _refused(folder: Path, reason: str) -> SceneError:
    """The error of a folder that cannot be used."""
    return SceneError(
        f"--output {folder}: {reason}", kind=ErrorKind.FILE, key="--output", source=str(folder)
    )
