"""The start of a command from a scene, a stored model or a mesh file."""

from __future__ import annotations

import argparse
import gc
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.cli.arguments import refused
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.scene import Scene, read_scene
from fenicsrom.scene.reading.overrides import names_of
from fenicsrom.scene.reading.reading import read_toml
from fenicsrom.study.execution import all_ranks

if TYPE_CHECKING:
    from fenicsrom.assess.jobs import Workers

PATIENCE = 10  # s in which the scheduler of a cluster must answer


@contextmanager
def importing() -> Iterator[None]:
    """Switch the collector of garbage off while modules are imported.

    The collector would look at all imported objects again and again, which takes a tenth of the
    time of a short command. After the imports it leaves these objects out, because they are never
    garbage.
    """
    gc.disable()
    try:
        yield
    finally:
        if gc.get_freeze_count() == 0:  # once in a process: results may be garbage later
            gc.freeze()
        gc.enable()


@contextmanager
def workers(options: argparse.Namespace) -> Iterator[Workers]:
    """The workers of a command: the cluster of --scheduler, or the cores of this machine.

    Raises:
        SceneError: `distributed` is not installed, or there is no scheduler at the address.
    """
    from fenicsrom.assess.jobs import available_cores
    from fenicsrom.post.base.style import missing_module

    address = getattr(options, "scheduler", None)
    if address is None:
        yield available_cores()
        return
    problem = missing_module("distributed")
    if problem is None:
        import distributed

        cluster: Any = distributed
        try:
            client = cluster.Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            problem = f"no Dask scheduler answers ({error})"
    if problem is not None:
        raise refused("--scheduler", address, problem, ErrorKind.FILE)
    with client, client.get_executor(pure=False) as executor:
        yield executor


def require_scene(options: argparse.Namespace) -> None:
    """Check that a command without a stored model has a scene file.

    Raises:
        SceneError: the command has no scene file.
    """
    if options.scene is not None:
        return
    resuming = getattr(options, "resume", None)
    sentence = (
        "--resume also needs the scene file or --from MODEL"
        if resuming
        else f"{options.name}: give a scene file or --from MODEL"
    )
    raise SceneError(sentence, kind=ErrorKind.MISSING, key="scene")


def start(options: argparse.Namespace, unloaded: bool = False) -> tuple[Any, Scene]:
    """Give the communicator and the scene.

    A command that only computes modes takes a scene that is `unloaded`, without a load or a probe.
    MPI starts first, so that only one rank prints an error in the scene.
    """
    return all_ranks(), read_scene(options.scene, options.overrides, unloaded=unloaded)


def ranks() -> Any:
    """Give the communicator of all ranks; None where mpi4py is not installed."""
    from fenicsrom.post.base.style import missing_module

    return None if missing_module("mpi4py") else all_ranks()


def changed_model(options: argparse.Namespace, stored: Any) -> Any:
    """Give a stored model under the scene file, or under its own scene with the values of --set."""
    if options.scene is not None:
        return stored.with_scene(read_scene(options.scene, options.overrides, mesh=False))
    return stored.with_overrides(options.overrides)


def source(options: argparse.Namespace, unloaded: bool = False) -> tuple[Any, Any, Scene]:
    """Give the communicator, a scene or a stored model, and its scene.

    A stored model needs no MPI, and has no communicator. Argument `unloaded` as `start`.
    """
    if getattr(options, "stored", None):
        from fenicsrom.online.store import archive

        current = changed_model(options, archive.load_model(options.stored))
        return None, current, current.scene
    require_scene(options)
    comm, scene = start(options, unloaded)
    return comm, scene, scene


def given_keys(options: argparse.Namespace) -> set[str]:
    """The keys that the user gave in the scene file and by --set, such as "output.motion"."""
    keys = {".".join(names_of(override.partition("=")[0])) for override in options.overrides}
    for name, value in (read_toml(options.scene) if options.scene is not None else {}).items():
        keys |= {f"{name}.{key}" for key in value} if isinstance(value, dict) else {name}
    return keys


def inspected(options: argparse.Namespace) -> Any:
    """Read the mesh file of the options."""
    from fenicsrom.fem.mesh.inspection import inspect

    scale, size = positive(options.scale, "--scale"), positive(options.size, "--size")
    return inspect(Path(options.mesh), scale or 1.0, size)


def positive(text: str | None, name: str) -> float | None:
    """Read the number of an option; None if the option is not given.

    Raises:
        SceneError: the number is not above 0.
    """
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise refused(name, text, "must be a number above 0", ErrorKind.RANGE)
    return value
