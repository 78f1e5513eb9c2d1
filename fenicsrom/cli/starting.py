"""The start of a command from a scene, a stored model or a mesh file."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fenicsrom.cli.arguments import refused
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.scene import Scene, read_scene
from fenicsrom.scene.reading.overrides import names_of
from fenicsrom.scene.reading.reading import read_toml
from fenicsrom.study.execution import all_ranks

if TYPE_CHECKING:
    from fenicsrom.assess.jobs import Workers

SHARED = ("sweep", "map")
"""The commands whose ranks share the runs of a stored model."""

PATIENCE = 10  # s in which the scheduler of a cluster must answer


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


def source(options: argparse.Namespace, unloaded: bool) -> tuple[Any, Any, Scene]:
    """Give the communicator, a scene or a stored model, and its scene.

    MPI starts first, so that only one rank prints an error in the scene. A stored model runs on one
    rank, without MPI, but its runs or speeds may be shared by the ranks of `SHARED` commands.

    Args:
        options: those of the command.
        unloaded: whether the scene needs no load and no probe.

    Raises:
        SceneError: there is no scene, or it cannot be used.
    """
    from fenicsrom.post.base.style import missing_module

    shared = options.name in SHARED and not missing_module("mpi4py")
    comm = all_ranks() if shared else None
    if model := getattr(options, "stored", None):
        from fenicsrom.online.store import archive
        from fenicsrom.online.store import store as checkpoints

        stored, checkpoint = archive.load_stored(model), getattr(options, "resume", None)
        if options.name == "run" and checkpoint is not None:
            # the stopped run may have used another scene than the model
            stored = replace(stored, scene=checkpoints.load_scene(checkpoint))
        if options.scene is not None:
            stored = stored.with_scene(read_scene(options.scene, options.overrides, mesh=False))
        else:
            stored = stored.with_overrides(options.overrides)
        _require_effect(options, stored.scene)
        return comm, stored, stored.scene
    if options.scene is None:
        resuming = getattr(options, "resume", None)
        also = "--resume also needs the scene file or --from MODEL"
        sentence = also if resuming else f"{options.name}: give a scene file or --from MODEL"
        raise SceneError(sentence, kind=ErrorKind.MISSING, key="scene")
    comm = comm or all_ranks()
    scene = read_scene(options.scene, options.overrides, unloaded=unloaded)
    _require_effect(options, scene)
    return comm, scene, scene


def _require_effect(options: argparse.Namespace, scene: Any) -> None:
    """Refuse --set for a number that the curves of `response` set themselves."""
    if options.name != "response" or (table := scene.response) is None:
        return
    varied = {"response.parameter": table.parameter}
    if table.families is not None:
        varied["response.families.key"] = table.families.key
    for by, key in varied.items():
        if ".".join(names_of(key)) in _set_keys(options):
            allowed = f"--set has no effect on it, because {by} varies it: set the values there"
            raise refuse(scene.source, allowed, ErrorKind.CONFLICT, key)


def _set_keys(options: argparse.Namespace) -> set[str]:
    """The keys of --set."""
    return {".".join(names_of(override.partition("=")[0])) for override in options.overrides}


def given_keys(options: argparse.Namespace) -> set[str]:
    """The keys that the user gave in the scene file and by --set, such as "output.motion"."""
    keys = _set_keys(options)
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
