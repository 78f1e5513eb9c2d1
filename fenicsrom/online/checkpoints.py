"""Restarts: where a run of a reduced model stands, in a file, to go on from bit for bit.

A checkpoint is an `.npz` of plain arrays with the scene of the run and the fingerprint of its
model. A run goes on only on the same model, and under a scene in which nothing is changed but when
it ends: `ENDS`.
"""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import read_archive, write_archive
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.online.state import TIME, Checkpoint, no_record, no_state
from fenicsrom.scene import Scene, parse_scene, scene_table

FORMAT = "fenicsrom checkpoint 2"
EVERY = 10.0  # s between two checkpoints, at least
ENDS = (
    "periods",
    "duration",
    "steady_tolerance",
)  # keys of [time] that say when a run ends, and nothing else


def fingerprint(model: ReducedModel) -> str:
    """SHA-256 of the arrays of a model; its damping and the time factors of its loads are the
    scene's.
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
    for array in (*arrays, model.gyroscopic_matrix, *points):
        digest.update(repr((array.shape, array.dtype.str)).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def save_checkpoint(path: Path, model: ReducedModel, scene: Scene, checkpoint: Checkpoint) -> None:
    """Write where a run stands; the file appears whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    header = {
        "format": FORMAT,
        "model": fingerprint(model),
        "source": scene.source,
        "scene": scene_table(scene),
        "spans": checkpoint.spans,
        "buckled": checkpoint.buckled,
        "size": checkpoint.size,
    }
    write_archive(path, header, _arrays(checkpoint))


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
    """The scene of the run that a checkpoint is of.

    Raises:
        SceneError: as `load_checkpoint`.
    """
    return _read(path)[1]


def load_checkpoint(path: Path, model: ReducedModel, scene: Scene) -> Checkpoint:
    """Read where a run of this model under this scene stands.

    Raises:
        SceneError: the file is missing, damaged, of another format, model or scene, or the run has
            come to its end.
    """
    header, made, data = _read(path)
    if header["model"] != fingerprint(model):
        raise SceneError(
            f"{path}: is a checkpoint of another reduced model: go on with that it was made with, by --from"
        )
    if (key := changed_key(made, scene)) is not None:
        ends = ", ".join(f"time.{name}" for name in ENDS)
        raise SceneError(
            f"{path}: {key} is another than that of the run: only when it ends may change, {ends}"
        )
    points, d = model.points.position.shape
    found = Checkpoint(
        no_state(model.size, points, d),
        no_record(data["last_time"].size, points, d),
        float(header["size"]),
        header["spans"],
        header["buckled"],
    )
    for name, array in _arrays(found).items():
        given = data.get(name)
        if (
            given is None
            or given.shape != array.shape
            or given.dtype != array.dtype
            or not np.all(np.isfinite(given))
        ):
            raise SceneError(
                f"{path}: {name} is not {array.shape} of finite {array.dtype}: the file is damaged",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
        array[...] = given
    end = scene.time.periods if scene.period is not None else scene.time.duration
    reached = found.spans if scene.period is not None else found.state.scalars[TIME]
    assert end is not None
    if not reached < end:
        key = "periods" if scene.period is not None else "duration"
        raise SceneError(
            f"{path}: time.{key} = {end:g}: the run has come there already: must be more to go on"
        )
    return found


def _read(path: Path) -> tuple[dict[str, Any], Scene, dict[str, Any]]:
    """Header, scene and arrays of a checkpoint."""
    with read_archive(path, "a checkpoint", FORMAT) as (header, data):
        kinds = {"model": str, "spans": int, "buckled": int, "size": float}
        if (
            not all(type(header[key]) is kind for key, kind in kinds.items())
            or data["last_time"].ndim != 1
        ):
            raise SceneError(
                f"{path}: its header does not fit a checkpoint: the file is damaged",
                kind=ErrorKind.FORMAT,
                source=str(path),
            )
        return header, parse_scene(header["scene"], str(header["source"]), None), data


def changed_key(made: Scene, wanted: Scene) -> str | None:
    """The first key in which two scenes of one model differ that may not change on the way, None if
    there is none.
    """
    for name in ("geometrically_nonlinear", "material", "rotation", "loads", "contacts"):
        if getattr(made, name) != getattr(wanted, name):
            return name
    for name in (item.name for item in fields(made.time) if item.name not in ENDS):
        if getattr(made.time, name) != getattr(wanted.time, name):
            return f"time.{name}"
    return "time" if (made.period is None) != (wanted.period is None) else None


def keeper(path: Path, model: ReducedModel, scene: Scene) -> Callable[[Checkpoint], None]:
    """A callback for `fenicsrom.online.march.integrate` that writes a checkpoint now and then."""
    last = clock.monotonic()

    def keep(checkpoint: Checkpoint) -> None:
        nonlocal last
        if clock.monotonic() - last >= EVERY:
            save_checkpoint(path, model, scene, checkpoint)
            last = clock.monotonic()

    return keep


def save_end(path: Path, model: ReducedModel, scene: Scene, motion: Motion) -> bool:
    """Write where a motion ended, to go on from later; False, and nothing, if it broke off within a
    period.

    Raises:
        OSError: it cannot be written.
    """
    end = motion.end
    if end is None or (
        motion.period is not None and abs(motion.time[-1] / motion.period - end.spans) > 1e-6
    ):
        return False
    save_checkpoint(path, model, scene, end)
    return True
