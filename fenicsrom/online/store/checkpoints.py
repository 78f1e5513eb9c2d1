"""Checkpoints that continue a run of a reduced model bit for bit.

A checkpoint is a file with the scene of the run and the fingerprint of its model. A run continues
only on the same model, and under a scene that differs at most in the keys that say when the run
ends (`fenicsrom.online.store.scene_changes.END_KEYS`).

The checkpoint of a run that was stopped in its checks holds the whole motion too: under the same
end, the run that continues takes this motion, and only checks it.
"""

import hashlib
import time as clock
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.contact.state import ContactState
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.step.state import TIME, Checkpoint, PeriodicSearch, Record, State, no_state
from fenicsrom.online.store.archive import PLAIN
from fenicsrom.online.store.packing import pack, unpack
from fenicsrom.online.store.scene_changes import END_KEYS, changed_run_key
from fenicsrom.scene import Scene, parse_scene, scene_table
from fenicsrom.scene.base.rules import Where

FORMAT = "fenicsrom checkpoint 4"
EARLIER = "fenicsrom checkpoint"  # start of the names of earlier formats
CLASSES = {
    kind.__name__: kind
    for kind in (Checkpoint, State, ContactState, Record, PeriodicSearch, Motion)
}
"""The records of which a file consists."""
TIME_TOLERANCE = 1e-6  # of the time after a number of periods, relative to the period
INTERVAL = 10.0  # least time between two checkpoints, s of wall time


def fingerprint(model: ReducedModel) -> str:
    """SHA-256 of the arrays of a model.

    The damping and the load histories are left out: they belong to the scene.
    """
    digest = hashlib.sha256()
    arrays = (getattr(model, name) for name in PLAIN)
    followers = model.pressure if model.pressure.numbers.size else ()
    for array in (model.mass, *model.elastic, *arrays, *model.points, *followers):
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
