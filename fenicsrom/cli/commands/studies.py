"""The commands that compute one study of a scene or of a stored model, and print its report."""

import argparse
from inspect import signature
from pathlib import Path

from fenicsrom import study
from fenicsrom.cli.arguments import (
    FROM,
    FROM_MODEL,
    RESULTS,
    RESUME_FOLDER,
    SCHEDULER,
    Argument,
    Command,
    scene_file,
)
from fenicsrom.cli.output import opened
from fenicsrom.cli.printing import finish
from fenicsrom.cli.starting import ranks, source, workers
from fenicsrom.cli.termination import is_stopped

RESUME_CURVES = Argument(
    "--resume",
    metavar="STATE",
    type=Path,
    help="continue the curves from the folder response_state of an earlier run",
)
FUNCTIONS = {"map": study.interaction_map}
"""Functions of `fenicsrom.study` that do not have the name of their command."""


def compute(options: argparse.Namespace) -> int:
    """Compute the study that has the name of the command, with those options that it takes."""
    function = FUNCTIONS.get(options.name) or getattr(study, options.name)
    comm, given, scene = source(options, unloaded=options.name == "campbell")
    if options.name == "map":
        comm = comm or ranks()
    elif options.name == "statics":
        from fenicsrom.assess.curves.equilibrium_path import varied_loads

        varied_loads(scene)  # before the output folder is opened
    with workers(options) as computing, opened(options, scene, comm) as folder:
        known = {**vars(options), "workers": computing, "stop": is_stopped}
        names = {"resume", "fresh", "workers", "stop"} & {*signature(function).parameters}
        settings = {name: known[name] for name in names}
        return finish(function(given, comm, folder=folder, **settings), comm)


def _command(name: str, help: str, content: str, *arguments: Argument) -> Command:
    """The command of a study; `content` says what the study reads in the scene file."""
    optional = {"nargs": "?"} if FROM in arguments else {}
    return Command(name, help, compute, (scene_file(content, **optional), *arguments))


COMMANDS = (
    _command(
        "compare",
        "compare reduced bases with the full model: error and run time",
        "; its [compare] table lists the bases",
        *RESULTS,
    ),
    _command(
        "campbell",
        "compute a Campbell diagram: frequencies and critical speeds",
        " with a [rotation] table; its [campbell] table gives the speeds",
        *(FROM, *RESULTS),
    ),
    _command(
        "response",
        "follow periodic motions over a parameter: response curves and stability",
        "; its [response] table gives the parameter and its range",
        *(RESUME_CURVES, SCHEDULER, *FROM_MODEL),
    ),
    _command(
        "backbone",
        "follow a damped nonlinear mode: frequency and damping ratio against amplitude",
        "; its [backbone] table gives the mode and the range of its amplitude",
        *FROM_MODEL,
    ),
    _command(
        "statics",
        "follow static equilibria over a load factor, through limit points (snap-through)",
        " with static loads; its [statics] table gives the range of their factor",
        *RESULTS,
    ),
    _command(
        "map",
        "map the motions of a body that rubs its casing over speed and engine order",
        " with rotation.speeds_rpm; its [map] table gives speeds and revolutions",
        *(RESUME_FOLDER, SCHEDULER, *FROM_MODEL),
    ),
)
