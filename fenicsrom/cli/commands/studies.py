"""The commands that compute a study: start, study, finish.

The arguments of a command follow from the parameters of its function in `fenicsrom.study`.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

from fenicsrom import study
from fenicsrom.cli.arguments import (
    FORCE,
    FROM,
    OUTPUT,
    SET,
    Argument,
    Command,
    repeated,
    scene_file,
)
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.cli.starting import given_keys, source, workers
from fenicsrom.cli.termination import is_stopped
from fenicsrom.progress import asking
from fenicsrom.scene import Scene, read_scene
from fenicsrom.scene.reading.overrides import make_axes


def natural(text: str) -> int:
    """Read a whole number of at least 0.

    Raises:
        ValueError: the text is not a whole number of at least 0.
    """
    number = int(text)
    if number < 0:
        raise ValueError(text)
    return number


OVER = repeated(
    "--over",
    "over",
    "KEY=VALUES",
    help="values of a key of the scene: a list such as loads.0.force=[50, 100], or a range "
    "FIRST:LAST:COUNT, with :log in equal ratios; all combinations run",
)
ALONG = "as --over, but all keys of --zip change together"
ZIP = repeated("--zip", "together", "KEY=VALUES", ALONG)
AXIS = repeated("--axis", "axes", "NAME", "run this axis only, such as friction")
RANDOM = Argument(
    "--random",
    type=natural,
    default=0,
    metavar="N",
    dest="variants",
    help="run N random variants instead of the axes, and compare them with the full model",
)
SEED = Argument(
    "--seed", type=natural, default=0, metavar="S", help="seed of the random variants (default: 0)"
)
SCHEDULER = Argument(
    "--scheduler",
    metavar="ADDRESS",
    help="compute on a running Dask cluster, such as tcp://node1:8786; its workers need fenicsrom "
    "and the output folder",
)
FRESH = Argument(
    "--fresh",
    action="store_true",
    help="compute modes and reduced model again, also where an earlier run left them in the cache",
)
RESUME_FOLDER = Argument(
    "--resume",
    action="store_true",
    help="keep the results in the output folder, and compute only the others",
)
OPTIONS = {
    "varied": (OVER, ZIP),
    "axes": (AXIS,),
    "variants": (RANDOM,),
    "seed": (SEED,),
    "resume": (RESUME_FOLDER,),
    "workers": (SCHEDULER,),
    "stored": (FROM,),
    "overrides": (SET,),
    "fresh": (FRESH,),
    "folder": (OUTPUT, FORCE),
}
"""The arguments for each parameter of a study, in their order."""


def _study(
    function: Callable[..., Any],
    help: str,
    content: str = "",
    name: str = "",
    resume: tuple[str, str] | None = None,
    unloaded: bool = False,
) -> Command:
    """The command of a function of `fenicsrom.study`.

    Args:
        function: computes the study, and returns its record.
        help: what the command does.
        content: what the command reads in the scene file.
        name: of the command; by default that of the function.
        resume: name and description of the file or folder from which the command continues; by
            default its output folder.
        unloaded: whether the scene needs no load, no probe and no times.
    """
    parameters = signature(function).parameters
    stored = any("StoredModel" in str(one.annotation) for one in parameters.values())
    names = {*parameters, "overrides", *(["stored"] if stored else [])}
    optional = {"nargs": "?"} if "stored" in names else {}
    found = [scene_file(content, **optional)]
    for key, arguments in OPTIONS.items():
        if key == "resume" and resume is not None:
            found.append(Argument("--resume", metavar=resume[0], type=Path, help=resume[1]))
        elif key in names:
            found += arguments
    compute = partial(_compute, function, unloaded)
    return Command(name or function.__name__, help, compute, tuple(found))


def _compute(function: Callable[..., Any], unloaded: bool, options: argparse.Namespace) -> int:
    """Start a study, compute it, and finish the command as its computation ended."""
    varied = make_axes(options.over, options.together) if hasattr(options, "over") else ()
    comm, given, scene = source(options, unloaded)
    study.require_usable(options.name, scene)  # before the output folder is opened
    first, *others = signature(function).parameters.values()
    names = [one.name for one in others]
    comm = comm if "comm" in names else None

    def variant(overrides: Sequence[str]) -> Scene:
        if options.scene is not None:
            return read_scene(options.scene, [*options.overrides, *overrides])
        from fenicsrom.online.store.scene_changes import changed_scene

        return changed_scene(scene, overrides, given.file)

    with (
        asking(is_stopped),
        workers(options) as computing,
        opened(options, scene, comm) as folder,
    ):
        known = {
            **vars(options),
            **{"scene": scene, "given": given, "comm": comm, "folder": folder, "varied": varied},
            **{"variant": variant, "workers": computing},
        }
        if "keys" in names:
            known["keys"] = given_keys(options)
        settings = {key: known[key] for key in names if key in known}
        begin = Path(options.scene) if first.annotation == "Path" else known[first.name]
        return finish(function(begin, **settings), comm)


COMMANDS = (
    _study(
        study.integrate,
        "run a scene, or integrate a stored reduced model again",
        name="run",
        resume=(
            "CHECKPOINT",
            "continue the reduced model from the checkpoint.npz of an earlier run",
        ),
    ),
    _study(
        study.modes, "compute only the modes and modal derivatives, for ParaView", unloaded=True
    ),
    _study(
        study.compare,
        "compare reduced bases with the full model: error and run time",
        "; its [compare] table lists the bases",
    ),
    _study(
        study.campbell,
        "compute a Campbell diagram: frequencies and critical speeds",
        " with a [rotation] table; its [campbell] table gives the speeds",
        unloaded=True,
    ),
    _study(
        study.response,
        "follow periodic motions over a parameter: response curves and stability",
        "; its [response] table gives the parameter and its range",
        resume=("STATE", "continue the curves from the folder response_state of an earlier run"),
    ),
    _study(
        study.backbone,
        "follow a damped nonlinear mode: frequency and damping ratio against amplitude",
        "; its [backbone] table gives the mode and the range of its amplitude",
    ),
    _study(
        study.ringdown,
        "let go from the loads: frequency and damping ratio of the free decay by periods",
        "; its [ringdown] table gives the mode and the length of the decay",
    ),
    _study(
        study.statics,
        "follow static equilibria over a load factor, through limit points (snap-through)",
        " with static loads; its [statics] table gives the range of their factor",
        unloaded=True,
    ),
    _study(
        study.interaction_map,
        "map the motions of a body that rubs its casing over speed and engine order",
        " with rotation.speeds_rpm; its [map] table gives speeds and revolutions",
        name="map",
    ),
    _study(
        study.run_sweep,
        "run a scene or a stored model for lists or ranges of values of its keys",
        name="sweep",
    ),
    _study(study.stability, "run extreme or random variants of a scene, with a verdict on each"),
)
