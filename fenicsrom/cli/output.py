"""The output folder of a command: its name, its record, and how to continue after an interrupt."""

import argparse
import json
import os
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fenicsrom import study
from fenicsrom.cli.arguments import refused
from fenicsrom.cli.printing import logged_progress
from fenicsrom.errors import ErrorKind
from fenicsrom.progress import log
from fenicsrom.scene import Scene

CONTAINER = "FENICSROM_CONTAINER"  # variable that is set where only mounted folders outlive a run
MOUNTS = Path("/proc/self/mountinfo")


@contextmanager
def opened(options: argparse.Namespace, scene: Scene, comm: Any = None) -> Iterator[Path]:
    """Open the output folder of a command, and say how to continue if it is interrupted.

    Raises:
        SceneError: the folder holds another run, is in use, or lies inside the container and would
            be deleted with it.
        OSError: the folder cannot be written.
    """
    from fenicsrom.online.kernels.compilation import announced

    folder = output_path(options)
    require_lasting(folder)
    quiet = comm is not None and comm.rank > 0
    try:
        with (
            study.output_folder(folder, scene, comm, _origin(options, folder), options.force),
            logged_progress(quiet),
            announced(log.info),
        ):
            yield folder
    except KeyboardInterrupt:
        options.continuation = _continuation(options, folder)
        raise


def output_path(options: argparse.Namespace) -> Path:
    """The folder of --output, or out/ and the name of the scene or of the stored model.

    Each command but `run` adds its own name once, such as out/NAME_modes. A file `scene.toml`, such
    as an earlier run wrote, takes the name of its folder.

    Raises:
        SceneError: a file has the name of the output folder or of a folder above it.
    """
    from fenicsrom.post.base.origin import SCENE_FILE

    source = Path(options.scene or options.stored)
    own = source.resolve().parent.name if source.name == SCENE_FILE else ""
    ending = "" if options.name == "run" else f"_{options.name}"
    name = (own or source.stem).removesuffix(ending) + ending
    folder = Path(options.output) if options.output else Path("out") / name
    for place in (folder, *folder.parents):
        if place.exists() and not place.is_dir():
            reason = f"{place} is a file; must be a folder, or a new name"
            raise refused("--output", folder, reason, ErrorKind.FILE)
    return folder


VARIATIONS = {"axes": "--axis", "over": "--over", "together": "--zip"}  # options that vary a scene
STATES = {
    "run": "checkpoint.npz",
    "response": "response_state",
    "sweep": "runs",
    "map": "map_lines",
    "ringdown": "ringdown_decays",
}


def _origin(options: argparse.Namespace, folder: Path) -> Any:
    """How the command was started."""
    from fenicsrom.post.base.origin import Origin

    model = getattr(options, "stored", None)
    resume = getattr(options, "resume", None)
    in_place = isinstance(resume, bool)
    if in_place:
        resume = folder / STATES[options.name] if resume else None
    varied = [
        word
        for name, option in VARIATIONS.items()
        for value in getattr(options, name, [])
        for word in (option, value)
    ]
    command, task = ("fenicsrom", *options.arguments), (options.name, *varied)
    return Origin(command, task, options.overrides, model, resume, in_place)


def _continuation(options: argparse.Namespace, folder: Path) -> str:
    """Say how to go on after an interrupt."""
    from fenicsrom.online.store.store import holds_motion
    from fenicsrom.post.base.origin import MODEL

    state = STATES.get(options.name)
    if state is None or not (folder / state).exists():
        if options.name == "run" and not options.stored and _is_of(options, folder / MODEL):
            words = ["fenicsrom", "run", "--from", str(folder / MODEL)]
            words += ["--output", f"{folder}_reduced"]
            marched = (folder / "disk.json").exists()
            motion = "as was the motion so far" if marched else "but no motion"
            return (
                f"the reduced model was kept, {motion}; to run this model: {shlex.join(words)}"
                "; to compute all, run the command again"
            )
        return "nothing to continue from was kept; run the command again"
    words = ["fenicsrom", *options.arguments]  # of options that are repeated, the last one counts
    if isinstance(options.resume, bool):
        words += [] if "--resume" in words else ["--resume"]
    else:
        words += ["--resume", str(folder / state)]
    if options.name == "run" and holds_motion(folder / state):
        if _is_checked(folder):
            return f"the motion was kept and checked; to write all files: {shlex.join(words)}"
        return f"the motion was kept, but it is not checked; to check it: {shlex.join(words)}"
    return f"to continue: {shlex.join(words)}"


def _is_checked(folder: Path) -> bool:
    """Whether the summary of an interrupted run gives the errors of its motion."""
    from fenicsrom.post.run.summary import SUMMARY

    verdict = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["verdict"]
    return bool(verdict["kind"] != "incomplete")


def _is_of(options: argparse.Namespace, result: Path) -> bool:
    """Whether a result exists and this command wrote the record beside it."""
    from fenicsrom.post.base.origin import read_record

    record = read_record(result.parent) or {}
    own = record.get("command") == shlex.join(("fenicsrom", *options.arguments))
    return own and result.exists()


def target(name: str | Path, *read: str | Path) -> Path:
    """The path of the file or folder that a command without a scene writes.

    Args:
        name: the path.
        read: the files that the command reads.

    Raises:
        SceneError: the command would replace a file that it reads, or the path lies inside the
            container and would be deleted with it.
    """
    path = Path(name)
    require_lasting(path)
    if path.resolve() in [Path(other).resolve() for other in read]:
        reason = "the command reads this file; give another name"
        raise refused("--output", path, reason, ErrorKind.FILE)
    return path


def require_lasting(path: Path, option: str = "--output") -> None:
    """Check that a file or folder is on a mounted file system, inside a container.

    Args:
        path: the file or folder to be written.
        option: the option that gives the path.

    Raises:
        SceneError: the path lies inside the container and would be deleted with it.
    """
    if not os.environ.get(CONTAINER) or not MOUNTS.exists():
        return
    mounted = [Path(line.split()[4]) for line in MOUNTS.read_text("utf-8").splitlines()]
    place = path.resolve()
    shared = [path for path in mounted if path != Path("/") and path in (place, *place.parents)]
    if not shared:
        reason = f"only mounted folders outlive the container, and {place} is in none of them"
        raise refused(option, path, f"{reason}; {os.environ[CONTAINER]}", ErrorKind.FILE)
