"""What is kept: archives of arrays, versions, the cache of results, and checkpoints.

Dataclasses of arrays and numbers as JSON text and a few flat arrays, for an `.npz` file.

A list of many small records becomes a handful of entries of the file, so that it is written and
read in milliseconds.

The cache of results: a folder of archives with a limit of their total size.

The name of an archive is its key, a hash of all that its results depend on. An archive appears only
when it is complete, so that runs may share the folder. Using an archive renews its time; the oldest
ones are removed when the limit is exceeded. `FENICSROM_CACHE` names another folder, or is "off".

Checkpoints that continue a run of a reduced model bit for bit.

A checkpoint is a file with the scene of the run and the fingerprint of its model. A run continues
only on the same model, and under a scene that differs at most in the keys that say when the run
ends (`fenicsrom.online.store.scene_changes.END_KEYS`).

The checkpoint of a run that was stopped in its checks holds the whole motion too: under the same
end, the run that continues takes this motion, and only checks it.
"""

import hashlib
import json
import math
import os
import re
import time
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.files import read_archive, reads_other_files, write_archive
from fenicsrom.online.contact.state import ContactState
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.state import TIME, Checkpoint, PeriodicSearch, Record, State, no_state
from fenicsrom.online.store.scene_changes import END_KEYS, changed_run_key
from fenicsrom.progress import log
from fenicsrom.scene import Scene, parse_scene, scene_table
from fenicsrom.scene.base.rules import Where

DTYPES = ("float64", "complex128", "int64", "int8")  # of the arrays that can be packed


def pack(
    value: Any,
    forms: Mapping[str, Callable[..., dict[str, Any]]] | None = None,
    named: bool = False,
) -> tuple[Any, dict[str, Any]]:
    """Split a value into a tree that JSON can hold and arrays.

    Args:
        value: a dataclass, list, dict, tuple (named or not), array of `DTYPES`, complex or JSON
            value, nested at will.
        forms: for a class of this name, gives the fields that are kept, of all its fields.
        named: whether each array has the name of its path, such as "model.mass"; otherwise those of
            one type follow one another in one array, for a list of many small records.

    Returns:
        The tree and the arrays; an array in the tree is a place in one of these arrays.

    Raises:
        TypeError: a value of another type.
    """
    parts: dict[str, list[Any]] = {}
    sizes = dict.fromkeys(DTYPES, 0)

    def array(item: Any, path: str) -> Any:
        if named:
            parts[path] = [item]
            return {"array": path}
        name = item.dtype.name
        place = {"array": name, "shape": list(item.shape), "at": sizes[name]}
        parts.setdefault(name, []).append(item.ravel())
        sizes[name] += item.size
        return place

    def record(item: Any, path: str, names: Sequence[str]) -> Any:
        name, found = type(item).__name__, {key: getattr(item, key) for key in names}
        if forms and name in forms:
            found = forms[name](**found)
        return {"class": name, "fields": inside(found, path)}

    def inside(items: Mapping[str, Any], path: str) -> dict[str, Any]:
        return {name: tree(one, f"{path}.{name}".lstrip(".")) for name, one in items.items()}

    def sequence(items: Sequence[Any], path: str) -> list[Any]:
        return [tree(one, f"{path}.{k}".lstrip(".")) for k, one in enumerate(items)]

    def tree(item: Any, path: str) -> Any:
        if isinstance(item, np.ndarray) and item.dtype.name in DTYPES:
            return array(item, path)
        if isinstance(item, np.generic):
            item = item.item()
        if item is None or isinstance(item, bool | int | float | str):
            return item
        if isinstance(item, complex):
            return {"complex": [item.real, item.imag]}
        if isinstance(item, list):
            return sequence(item, path)
        if isinstance(item, dict):
            return {"dict": inside(item, path)}
        if isinstance(item, tuple) and hasattr(item, "_fields"):
            return record(item, path, item._fields)
        if isinstance(item, tuple):
            return {"tuple": sequence(item, path)}
        if is_dataclass(item) and not isinstance(item, type):
            return record(item, path, [part.name for part in fields(item)])
        raise TypeError(f"a value of type {type(item).__name__} cannot be packed")

    packed = tree(value, "")
    return packed, {
        name: found[0] if named else np.concatenate(found) for name, found in parts.items()
    }


def unpack(tree: Any, arrays: Mapping[str, Any], classes: Mapping[str, Any]) -> Any:
    """The value of which `pack` made a tree and arrays.

    Args:
        tree: the tree.
        arrays: the arrays by their names.
        classes: for the dataclasses and named tuples that may occur, by name, what makes one of the
            fields that were kept.

    Raises:
        KeyError, TypeError, ValueError: the tree was not made by `pack`, or of other classes.
    """
    if isinstance(tree, list):
        return [unpack(one, arrays, classes) for one in tree]
    if not isinstance(tree, dict):
        return tree
    if "at" in tree:
        size = int(np.prod(tree["shape"]))
        found = arrays[tree["array"]][tree["at"] : tree["at"] + size]
        return found.reshape(tree["shape"]).copy()
    if "array" in tree:
        return arrays[tree["array"]]
    if "complex" in tree:
        return complex(*tree["complex"])
    if "dict" in tree:
        return {name: unpack(one, arrays, classes) for name, one in tree["dict"].items()}
    if "tuple" in tree:
        return tuple(unpack(one, arrays, classes) for one in tree["tuple"])
    made = {name: unpack(one, arrays, classes) for name, one in tree["fields"].items()}
    return classes[tree["class"]](**made)


def provenance(
    modules: Sequence[str] = ("numpy", "numba", "fenics-dolfinx", "petsc4py", "slepc4py"),
) -> dict[str, str]:
    """Versions of this program and of the installed libraries that it uses."""
    found = {}
    for name in ("fenicsrom", *modules):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


VARIABLE = "FENICSROM_CACHE"
OFF = "off"

LIBRARIES = "numpy scipy numba gmsh meshio fenics-basix fenics-dolfinx petsc4py slepc4py".split()

PACKAGE = Path(__file__).parents[2]

Results = TypeVar("Results")

LIMIT = 5_000_000_000
"""Largest total size in bytes; a model of 300,000 unknowns takes a tenth of it."""

ARCHIVE = re.compile(r"([0-9a-f]{40}|\.[0-9a-f]{40}\.[0-9a-f]{12})\.npz")
"""Names of archives and of their temporary files; other files of the folder are not ours."""

ABANDONED = 3600.0
"""Age in s of a temporary file of a run that was killed; others write theirs within a minute."""


@dataclass(frozen=True)
class Entry:
    """One archive.

    Attributes:
        path: its file.
        size: bytes.
        used: time of the last use, s since the epoch.
    """

    path: Path
    size: int
    used: float


def cache_folder() -> Path | None:
    """The folder of the results; None if the cache is switched off.

    Raises:
        SceneError: the environment variable names a file.
    """
    given = os.environ.get(VARIABLE, "")
    if given.lower() == OFF:
        return None
    if not given:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(home) / "fenicsrom" / "results"
    if Path(given).exists() and not Path(given).is_dir():
        raise SceneError(
            f'{VARIABLE} = {given}: is not a folder; name a folder, or "{OFF}"',
            kind=ErrorKind.FILE,
            key=VARIABLE,
            source=given,
        )
    return Path(given)


def mesh_digest(files: Iterable[Path]) -> str | None:
    """A hash of the content of mesh files; None if the mesh depends on other files.

    Raises:
        OSError: a file cannot be read.
    """
    contents = [file.read_bytes() for file in files]
    if any(map(reads_other_files, contents)):
        return None
    return " ".join(hashlib.sha256(content).hexdigest() for content in contents)


def key_of(table: Any) -> str:
    """A hash of plain data and of the program: its modules, its libraries, the options of PETSc."""
    program = provenance(LIBRARIES) | {"package": package_digest(PACKAGE)}
    program |= {name: os.environ.get(name, "") for name in ("PETSC_OPTIONS", "OMP_NUM_THREADS")}
    return hashlib.sha256(json.dumps([table, program], sort_keys=True).encode()).hexdigest()


def package_digest(folder: Path) -> str:
    """SHA-256 of the names and the content of all modules in a folder."""
    digest = hashlib.sha256()
    for module in sorted(folder.rglob("*.py")):
        content = hashlib.sha256(module.read_bytes()).hexdigest()
        digest.update(f"{module.relative_to(folder)} {content}\n".encode())
    return digest.hexdigest()


def read_results(
    folder: Path, key: str, what: str, take: Callable[[Any, Any], Results]
) -> Results | None:
    """Read an archive; None if it is missing. A damaged one is removed.

    Args:
        folder: the folder of the cache.
        key: of the results.
        what: the archive should hold, such as "a motion".
        take: makes an object of the header and the arrays.
    """
    path = archive_of(folder, key)
    if not path.exists():
        return None
    try:
        with read_archive(path, what, key) as (header, arrays):
            found = take(header, arrays)
    except SceneError:
        _remove(path)
        return None
    with suppress(OSError):
        os.utime(path)
    return found


def write_results(
    folder: Path, key: str, what: str, header: dict[str, Any], arrays: dict[str, Any]
) -> None:
    """Write an archive, and keep the folder below its limit; a full disk costs only time.

    Args:
        folder: the folder of the cache.
        key: of the results.
        what: the archive holds, such as "a motion".
        header: plain data.
        arrays: by their names.
    """
    try:
        write_archive(archive_of(folder, key), {**header, "format": key}, arrays)
    except OSError as error:
        log.info(f"{what} was not stored in the cache: {error}")
    trim(folder)


def archive_of(folder: Path, key: str) -> Path:
    """The file of a key."""
    return folder / f"{key[:40]}.npz"


def entries(folder: Path) -> list[Entry]:
    """The archives of a folder, and abandoned temporary files, the oldest first.

    Another run may remove one at any time.
    """
    found = []
    with suppress(OSError):
        for path in folder.iterdir():
            if ARCHIVE.fullmatch(path.name):
                with suppress(OSError):
                    status = path.stat()
                    abandoned = status.st_mtime < time.time() - ABANDONED
                    if abandoned or not path.name.startswith("."):
                        found.append(Entry(path, status.st_size, status.st_mtime))
    return sorted(found, key=lambda entry: entry.used)


def trim(folder: Path, limit: int = LIMIT) -> None:
    """Remove the oldest archives until the others fit into the limit."""
    kept = entries(folder)
    size = sum(entry.size for entry in kept)
    for entry in kept:
        if size <= limit:
            return
        _remove(entry.path)
        size -= entry.size


def clear(folder: Path) -> int:
    """Remove all archives; give their number."""
    found = entries(folder)
    for entry in found:
        _remove(entry.path)
    return len(found)


def _remove(path: Path) -> None:
    """Remove an archive, if it is still there and may be removed."""
    with suppress(OSError):
        path.unlink()


FORMAT = "fenicsrom checkpoint 5"
EARLIER = "fenicsrom checkpoint"  # start of the names of earlier formats
CLASSES = {
    kind.__name__: kind
    for kind in (Checkpoint, State, ContactState, Record, PeriodicSearch, Motion)
}
"""The records of which a file consists."""
TIME_TOLERANCE = 1e-6  # of the time after a number of periods, relative to the period
INTERVAL = 10.0  # least time between two checkpoints, s of wall time


def without(*names: str) -> Callable[..., dict[str, Any]]:
    """A form of `pack` that leaves out fields."""
    return lambda **fields: {name: fields[name] for name in fields if name not in names}


def fingerprint(model: ReducedModel) -> str:
    """SHA-256 of the arrays of a model.

    The damping and the load histories are left out: they belong to the scene.
    """
    form = without("work", "load_histories", "damping", "turning", "bolts")
    tree, arrays = pack(model, {"ReducedModel": form})
    digest = hashlib.sha256(json.dumps(tree).encode())
    for name in sorted(arrays):
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()


def save_checkpoint(
    path: Path,
    model: ReducedModel,
    scene: Scene,
    checkpoint: Checkpoint,
    motion: Motion | None = None,
) -> None:
    """Write a checkpoint to a file that appears only when it is complete.

    Args:
        path: the file.
        model: the model.
        scene: the scene.
        checkpoint: the checkpoint.
        motion: the finished motion that ends there, if the file is to hold it.

    Raises:
        OSError: the file cannot be written.
    """
    kept = checkpoint._replace(
        state=checkpoint.state._replace(trial=None),  # type: ignore[arg-type]
        last=checkpoint.last._replace(coordinates=checkpoint.last.coordinates[:, :0]),
    )
    tree, arrays = pack((kept, motion and replace(motion, end=None)))
    header = {"format": FORMAT, "model": fingerprint(model), "tree": tree}
    header |= {"source": scene.source, "scene": scene_table(scene)}
    write_archive(path, header, arrays)


class _Content(NamedTuple):
    """The content of a file: the fingerprint of the model, the scene, the end and the motion."""

    model: str
    scene: Scene
    checkpoint: Checkpoint
    motion: Motion | None


def _read(path: Path) -> _Content:
    """The content of a file.

    Raises:
        SceneError: the file is missing, damaged or of another format.
    """
    with read_archive(path, "a checkpoint", FORMAT, EARLIER) as (header, arrays):
        scene = parse_scene(header["scene"], str(header["source"]), None)
        checkpoint, motion = unpack(header["tree"], arrays, CLASSES)
        state = checkpoint.state
        trial = no_state(state.q.size, *state.contact.x.shape).trial
        checkpoint = checkpoint._replace(state=state._replace(trial=trial))
        motion = motion and replace(motion, end=checkpoint)
        return _Content(header["model"], scene, checkpoint, motion)


def load_scene(path: Path) -> Scene:
    """The scene of the run that wrote a checkpoint.

    Raises:
        SceneError: as `load_start`.
    """
    return _read(path).scene


def holds_motion(path: Path) -> bool:
    """Whether a file is a checkpoint with a finished motion."""
    try:
        return _read(path).motion is not None
    except SceneError:
        return False


def check_checkpoint(path: Path, scene: Scene) -> None:
    """Check that a run of this scene can continue from a checkpoint, as far as no model is needed.

    Raises:
        SceneError: the file is missing or damaged, or belongs to another format or scene.
    """
    if (key := changed_run_key(load_scene(path), scene)) is not None:
        ends = ", ".join(f"time.{name}" for name in END_KEYS)
        reason = "differs from the scene of the run; a run that continues may only change its end"
        raise refuse(path, f"{reason}, by the keys: {ends}", ErrorKind.MISMATCH, key)


def load_start(path: Path, model: ReducedModel, scene: Scene) -> Checkpoint | Motion:
    """Read what a run of this model under this scene begins with.

    Returns:
        The finished motion, if the file holds one and the scene does not change the end of the run;
        otherwise the checkpoint from which the run continues.

    Raises:
        SceneError: the file is missing or damaged, belongs to another format, model or scene, or
            the run already reached its end.
    """
    check_checkpoint(path, scene)
    found = _read(path)
    if found.model != fingerprint(model):
        reason = "another reduced model wrote this checkpoint; resume with the model that wrote it"
        raise refuse(path, f"{reason}: --from MODEL", ErrorKind.MISMATCH)
    if found.motion is not None and found.scene.time == scene.time:
        return found.motion
    begin = found.checkpoint
    end = scene.time.periods if scene.period is not None else scene.time.duration
    reached = begin.spans if scene.period is not None else begin.state.scalars[TIME]
    assert end is not None
    if not reached < end:
        key = "periods" if scene.period is not None else "duration"
        place = f"period {reached:g}" if scene.period is not None else f"t = {reached:g} s"
        reason = f"the run already reached {place}; set a larger value to continue"
        raise Where(str(path), f"time.{key}").refuse(end, reason)
    return begin


def keeper(path: Path, model: ReducedModel, scene: Scene) -> Callable[[Checkpoint], None]:
    """A callback of `online.run.march.integrate` that writes a checkpoint each `INTERVAL`.

    It writes the first one at once, because the search for the periodic motion may take long.
    """
    last = -math.inf

    def keep(checkpoint: Checkpoint) -> None:
        nonlocal last
        if clock.monotonic() - last >= INTERVAL:
            save_checkpoint(path, model, scene, checkpoint)
            last = clock.monotonic()

    return keep


def save_end(
    path: Path, model: ReducedModel, scene: Scene, motion: Motion, *, whole: bool = False
) -> bool:
    """Write a checkpoint at the end of a motion, to continue later.

    Args:
        path: the file.
        model: the model.
        scene: the scene.
        motion: the motion.
        whole: write the whole motion too, for a run that only checks it.

    Returns:
        Whether the file was written: a motion that stopped within a period has no checkpoint.

    Raises:
        OSError: the file cannot be written.
    """
    end = motion.end
    if end is None or (
        motion.load_period is not None
        and abs(motion.time[-1] / motion.load_period - end.spans) > TIME_TOLERANCE
    ):
        return False
    held = motion if whole and motion.coordinates is not None else None
    save_checkpoint(path, model, scene, end, held)
    return True
