"""The output folder, which holds one run, says what was run, and is written by one process.

The program touches the names of `fenicsrom.post.base.origin.RESULTS` and its copies of input files,
and nothing else. The same scene may run again in its folder: new files replace the old ones, and
old results that a complete run has not written again are removed. The results of another scene are
removed on request only, before the new run begins.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.errors import ErrorKind, SceneError

if TYPE_CHECKING:
    from fenicsrom.post.base.origin import Origin
    from fenicsrom.scene import Scene

Stamps = dict[str, list[tuple[int, int]]]

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
        origin: start of the computation; by default a Python program.
        overwrite: replace the results of another scene, too.

    Raises:
        SceneError: another process writes to the folder, it holds another run or files of the user
            with names of results, or its record is damaged.
        OSError: the folder cannot be written.
    """
    first = comm is None or comm.rank == 0
    held = _held_folder(folder, scene, comm, origin, overwrite) if first else nullcontext()
    with ExitStack() as stack:
        _together(comm, lambda: stack.enter_context(held))
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
    from fenicsrom.post.base.origin import python_origin, read_record, write_origin

    place = folder.resolve()
    if place in _held:
        yield
        return
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with locked_folder(folder) as free:
            origin, earlier = origin or python_origin(), read_record(folder)
            if not free:
                what = f" ({earlier['command']}, since {earlier['began']})" if earlier else ""
                raise _refused(folder, f"another run is writing to it{what}; choose another folder")
            own, stale = _make_room(folder, earlier, scene, origin, overwrite)
            before = _stamps(folder)
            record = write_origin(folder, scene, origin, 1 if comm is None else comm.size, own)
            _held.add(place)
            try:
                with _recorded(folder, record, before, own, stale):
                    yield
            finally:
                _held.discard(place)
    finally:
        if made and not any(folder.iterdir()):
            folder.rmdir()


@contextmanager
def _recorded(
    folder: Path, record: dict[str, Any], before: Stamps, own: list[str], stale: list[str]
) -> Iterator[None]:
    """Complete the record when the body ends; a folder without results keeps no record.

    Args:
        folder: the folder.
        record: the record of the run.
        before: the results in the folder before the run.
        own: names of those that belong to this run.
        stale: names of those that go if the run completes without writing them again.
    """
    from fenicsrom.post.base.origin import RECORD, SCENE_FILE, end_record

    state = "complete"
    try:
        yield
    except BaseException as error:
        interrupted = isinstance(error, KeyboardInterrupt)
        state = "interrupted" if interrupted else f"failed: {error}"
        raise
    finally:
        found, copies = _stamps(folder), record["results"]
        old = {name for name, stamp in found.items() if before.get(name) == stamp}
        gone = old.intersection(stale) - set(copies) if state == "complete" else set()
        results = sorted((found.keys() - old | old.intersection(own)) - gone - set(copies))
        _remove(folder, gone)
        if results or state == "complete":
            end_record(folder, record, state, [*results, *copies])
        else:
            _remove(folder, [*copies, SCENE_FILE, RECORD])


def _make_room(
    folder: Path, record: dict[str, Any] | None, scene: Scene, origin: Origin, overwrite: bool
) -> tuple[list[str], list[str]]:
    """Check that a run may write to a folder, and remove the results of another run on request.

    Args:
        folder: the folder.
        record: that of the earlier run.
        scene: the scene.
        origin: how the computation was started.
        overwrite: replace the results of another run.

    Returns:
        The names of the results that belong to the run already, and of those among them that go
        unless the run writes them again.

    Raises:
        SceneError: the folder holds another run, or files that no run recorded.
    """
    from fenicsrom.post.base.origin import RECORD, SCENE_FILE

    if record is None and (folder / SCENE_FILE).exists():
        reason = f"it holds a {SCENE_FILE}, which the run would replace; choose another folder"
        raise _refused(folder, reason)
    given = (Path(scene.source), *scene.geometry.files, origin.model, origin.resume)
    read = [path.resolve() for path in given if path is not None]
    inputs = {
        path.name
        for path in folder.iterdir()
        if any(path.resolve() in (one, *one.parents) for one in read)
    }
    earlier = _earlier_results(folder, record)
    continued = _continues(folder, record, scene, origin)
    same = continued or (
        record is not None
        and record.get("task") == list(origin.task)
        and _has_same_scene(folder, record, scene)
    )
    if not overwrite:
        if record is not None and earlier and not same:
            what = f"another run ({record['command']}, {record['began']})"
            raise _refused(folder, f"it holds {what}; choose another folder, or add --force")
        foreign = sorted(_stamps(folder).keys() - inputs - set(earlier))
        if foreign:
            what = f"{foreign[0]}, which is in no provenance.json"
            raise _refused(folder, f"it holds {what}; choose another folder, or add --force")
    stale = [name for name in earlier if name not in inputs]
    if same:
        return earlier, [] if continued else stale
    if record is not None:
        _remove(folder, [*stale, SCENE_FILE, RECORD])  # no record may name the files of another run
    return [name for name in earlier if name in inputs], []


def _continues(folder: Path, record: dict[str, Any] | None, scene: Scene, origin: Origin) -> bool:
    """Whether a run continues what the same command left in this folder.

    A sweep may go on with other values, but only under the scene of its earlier results.
    """
    if record is None or origin.resume is None:
        return False
    same_command = list(record.get("task") or ())[:1] == list(origin.task[:1])
    inside = folder.resolve() in origin.resume.resolve().parents
    return (
        same_command and inside and (not origin.in_place or _has_same_scene(folder, record, scene))
    )


def _has_same_scene(folder: Path, record: dict[str, Any], scene: Scene) -> bool:
    """Whether the folder holds a run of the same scene and the same mesh file."""
    from fenicsrom.post.base.origin import SCENE_FILE, checksum
    from fenicsrom.scene import scene_table

    try:
        found = tomllib.loads((folder / SCENE_FILE).read_text(encoding="utf-8"))
        found["geometry"] = {**found["geometry"], "mesh": None, "also": []}
    except (OSError, ValueError, KeyError, AttributeError):  # edited by the user
        return False
    wanted, files = scene_table(scene), scene.geometry.files
    wanted["geometry"] |= {"mesh": None, "also": []}
    for table in (found, wanted):
        table.pop("title", None)
    known = [record["mesh"], *(record.get("also") or ())]
    same_mesh = len(known) == len(files) and all(
        kept is None or not file.is_file() or kept["sha256"] == checksum(file)
        for kept, file in zip(known, files, strict=True)
    )
    return bool(found == wanted) and same_mesh


def _earlier_results(folder: Path, record: dict[str, Any] | None) -> list[str]:
    """Names of the results and unchanged copies of an earlier run that are still in the folder."""
    from fenicsrom.post.base.origin import checksum

    if record is None:
        return []
    named, found = record["results"] or [], _stamps(folder)
    inside = {path.name for path in folder.iterdir()}
    kept = [record[key] for key in ("mesh", "model") if record[key]]
    kept += filter(None, record.get("also") or ())
    sums = {one["copy"]: one["sha256"] for one in kept if one.get("copy") in named}
    copies = [
        name for name, known in sums.items() if name in inside and checksum(folder / name) == known
    ]
    killed = record["state"] == "running"
    return [*copies, *(name for name in found if name not in sums and (killed or name in named))]


def _stamps(folder: Path) -> Stamps:
    """The entries of a folder with names of results, with marks that change when they are written.

    The marks of a folder are those of all files in it.
    """
    from fenicsrom.post.base.origin import is_result

    found = {}
    for path in folder.iterdir():
        if is_result(path.name):
            states = [one.lstat() for one in (path, *sorted(path.rglob("*")))]
            found[path.name] = [(state.st_ino, state.st_mtime_ns) for state in states]
    return found


def _remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files and folders; a link is removed, and not what it points to.

    Raises:
        OSError: one cannot be removed.
    """
    for path in map(folder.joinpath, names):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _refused(folder: Path, reason: str) -> SceneError:
    """The error of a folder that cannot be used."""
    return SceneError(
        f"--output {folder}: {reason}", kind=ErrorKind.FILE, key="--output", source=str(folder)
    )
