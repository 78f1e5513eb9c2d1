"""Checkpoints that continue a run of a reduced model bit for bit.

A checkpoint is an `.npz` file of plain arrays with the scene of the run and the fingerprint of its
model. A run continues only on the same model, and under a scene that differs at most in the keys
that say when the run ends (`fenicsrom.online.store.scene_changes.END_KEYS`).

The checkpoint of a run that was stopped in its checks holds the whole motion too: under the same
end, the run that continues takes this motion, and only checks it.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.state import TIME, Checkpoint, PeriodicSearch, no_record, no_state
from fenicsrom.online.store.finished import finished_motion, motion_arrays, motion_header
from fenicsrom.online.store.scene_changes import END_KEYS, changed_run_key
from fenicsrom.scene import Scene, parse_scene, scene_table

FORMAT = "fenicsrom checkpoint 3"
TIME_TOLERANCE = 1e-6  # of the time after a number of periods, relative to the period
INTERVAL = 10.0  # least time between two checkpoints, s of wall time


def fingerprint(model: ReducedModel) -> str:
    """SHA-256 of the arrays of a model.

    The damping and the load histories are left out: they belong to the scene.
    """
    digest = hashlib.sha256()
    points = [
        model.points.contact,
        model.points.tributary_area,
        model.points.position,
        model.points.frame,
    ]
    arrays = (
        model.mass,
        *model.elastic,
        model.loads,
        model.contact_rows,
        model.contact_offset,
        model.probe,
        model.probe_offset,
    )
    followers = model.pressure if model.pressure.numbers.size else ()
    for array in (*arrays, model.velocity_matrix, *points, *followers):
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
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
    header = {
        "format": FORMAT,
        "model": fingerprint(model),
        "source": scene.source,
        "scene": scene_table(scene),
        "spans": checkpoint.spans,
        "buckled": checkpoint.buckled,
        "size": checkpoint.size,
        "search": _search_table(checkpoint.search),
        "motion": None if motion is None else motion_header(motion),
    }
    whole = {} if motion is None else motion_arrays(motion)
    write_archive(path, header, {**_arrays(checkpoint), **whole})


def _search_table(search: PeriodicSearch | None) -> dict[str, Any] | None:
    """The result of Newton's method as plain data."""
    if search is None:
        return None
    pairs = [[value.real, value.imag] for value in search.multipliers]
    return {**search._asdict(), "multipliers": pairs}


def _search_of(table: dict[str, Any] | None) -> PeriodicSearch | None:
    """The inverse of `_search_table`."""
    if table is None:
        return None
    pairs = np.array(table["multipliers"], dtype=np.float64).reshape(-1, 2)
    counts = [int(table[name]) for name in ("periods", "marched", "iterations", "free_sliders")]
    if not (counts[0] >= 1 and min(counts) >= 0):
        raise ValueError("these are not the numbers of a search")
    return PeriodicSearch(**{**table, "multipliers": pairs[:, 0] + 1j * pairs[:, 1]})


def _arrays(checkpoint: Checkpoint) -> dict[str, Any]:
    """The arrays of a checkpoint by the names they have in its file."""
    state, last = checkpoint.state, checkpoint.last
    return {
        **{
            name: array
            for name, array in state._asdict().items()
            if name not in ("contact", "trial")
        },
        **{f"contact_{name}": array for name, array in state.contact._asdict().items()},
        **{
            f"last_{name}": array for name, array in last._asdict().items() if name != "coordinates"
        },
    }


def load_scene(path: Path) -> Scene:
    """The scene of the run that wrote a checkpoint.

    Raises:
        SceneError: as `load_checkpoint`.
    """
    return _read(path)[1]


def holds_motion(path: Path) -> bool:
    """Whether a file is a checkpoint with a finished motion."""
    try:
        return _read(path)[0].get("motion") is not None
    except SceneError:
        return False


def check_checkpoint(path: Path, scene: Scene) -> None:
    """Check that a run of this scene can continue from a checkpoint, as far as no model is needed.

    Raises:
        SceneError: the file is missing or damaged, or belongs to another format or scene.
    """
    _require_same_run(path, load_scene(path), scene)


def _require_same_run(path: Path, made: Scene, scene: Scene) -> None:
    """Check that the scene of a checkpoint differs from another one at most in the end of the run.

    Raises:
        SceneError: another key differs.
    """
    if (key := changed_run_key(made, scene)) is not None:
        ends = ", ".join(f"time.{name}" for name in END_KEYS)
        raise SceneError(
            f"{path}: {key} differs from the scene of the run; "
            f"a run that continues may only change its end, by the keys: {ends}",
            kind=ErrorKind.MISMATCH,
            key=key,
            source=str(path),
        )


def load_checkpoint(path: Path, model: ReducedModel, scene: Scene) -> Checkpoint:
    """Read a checkpoint of a run of this model under this scene.

    Raises:
        SceneError: the file is missing or damaged, belongs to another format, model or scene, or
            the run already reached its end.
    """
    header, made, data = _read(path)
    found = _checkpoint(path, header, made, data, model, scene)
    end = scene.time.periods if scene.period is not None else scene.time.duration
    reached = found.spans if scene.period is not None else found.state.scalars[TIME]
    assert end is not None
    if not reached < end:
        key = "periods" if scene.period is not None else "duration"
        place = f"period {reached:g}" if scene.period is not None else f"t = {reached:g} s"
        raise SceneError(
            f"{path}: time.{key} = {end:g}: the run already reached {place}; set a larger value to "
            "continue",
            kind=ErrorKind.RANGE,
            key=f"time.{key}",
            source=str(path),
        )
    return found


def load_start(path: Path, model: ReducedModel, scene: Scene) -> Checkpoint | Motion:
    """Read what a run of this model under this scene begins with.

    Returns:
        The finished motion, if the file holds one and the scene does not change the end of the run;
        otherwise the checkpoint from which the run continues.

    Raises:
        SceneError: as `load_checkpoint`.
    """
    header, made, data = _read(path)
    if header.get("motion") is None or made.time != scene.time:
        return load_checkpoint(path, model, scene)
    end = _checkpoint(path, header, made, data, model, scene)
    try:
        return finished_motion(header["motion"], data, end)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _damaged(path, str(error)) from None


def _checkpoint(
    path: Path, header: Any, made: Scene, data: Any, model: ReducedModel, scene: Scene
) -> Checkpoint:
    """The checkpoint of the contents of a file.

    Raises:
        SceneError: the file is damaged, or belongs to another model or scene.
    """
    if header["model"] != fingerprint(model):
        raise SceneError(
            f"{path}: another reduced model wrote this checkpoint; "
            "resume with the model that wrote it: --from MODEL",
            kind=ErrorKind.MISMATCH,
            source=str(path),
        )
    _require_same_run(path, made, scene)
    points, d = model.points.position.shape
    found = Checkpoint(
        no_state(model.size, points, d),
        no_record(data["last_time"].size, points, d),
        float(header["size"]),
        header["spans"],
        header["buckled"],
        header["search"],
    )
    for name, array in _arrays(found).items():
        given = data.get(name)
        if (
            given is None
            or given.shape != array.shape
            or given.dtype != array.dtype
            or not np.all(np.isfinite(given))
        ):
            raise _damaged(path, f"{name} is not {array.shape} of finite {array.dtype}")
        array[...] = given
    if not _is_consistent(found, scene.period):
        raise _damaged(path, "the times or the numbers of the run contradict each other")
    return found


def _damaged(path: Path, reason: str) -> SceneError:
    """The refusal of a damaged file."""
    sentence = f"{path}: {reason}: the file is damaged"
    return SceneError(sentence, kind=ErrorKind.FORMAT, source=str(path))


def _is_consistent(found: Checkpoint, period: float | None) -> bool:
    """Whether the times and numbers of a checkpoint can be those of a run."""
    times, now = found.last.time, float(found.state.scalars[TIME])
    if found.spans < 0 or found.buckled < 0 or not (np.isfinite(found.size) and found.size >= 0.0):
        return False
    if not times.size or np.any(np.diff(times) <= 0.0) or times[0] < 0.0 or times[-1] != now:
        return False
    return period is None or abs(now / period - found.spans) <= TIME_TOLERANCE


def _read(path: Path) -> tuple[dict[str, Any], Scene, dict[str, Any]]:
    """Header, scene and arrays of a checkpoint."""
    with read_archive(path, "a checkpoint", FORMAT) as (header, data):
        kinds = {"model": str, "spans": int, "buckled": int, "size": float}
        if (
            not all(type(header[key]) is kind for key, kind in kinds.items())
            or data["last_time"].ndim != 1
        ):
            raise _damaged(path, "this is not the header of a checkpoint")
        header["search"] = _search_of(header.get("search"))
        return header, parse_scene(header["scene"], str(header["source"]), None), data


def keeper(path: Path, model: ReducedModel, scene: Scene) -> Callable[[Checkpoint], None]:
    """A callback of `online.run.march.integrate` that writes a checkpoint each `INTERVAL`."""
    last = clock.monotonic()

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
