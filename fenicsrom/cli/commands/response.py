"""`fenicsrom response`: follow periodic motions over a parameter."""

from __future__ import annotations

import argparse
from pathlib import Path

from fenicsrom import study
from fenicsrom.cli.arguments import FROM_MODEL, SCHEDULER, Argument, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import source, workers
from fenicsrom.cli.termination import is_terminated

RESPONDING_SCENE = scene_file("; its [response] table gives the parameter and its range", nargs="?")
RESUME_CURVES = Argument(
    "--resume",
    metavar="STATE",
    help="continue the curves from the folder response_state of an earlier run",
)


def response(options: argparse.Namespace) -> int:
    """Compute the response curves of a scene or of a stored model."""
    comm, given, scene = source(options)
    with workers(options) as computing, opened(options, scene, comm) as folder:
        found = study.response(
            given,
            comm,
            folder=folder,
            resume=Path(options.resume) if options.resume else None,
            workers=computing,
            stop=is_terminated,
            fresh=options.fresh,
        )
        return finish(found, comm, found.curves)


COMMAND = Command(
    "response",
    "follow periodic motions over a parameter: response curves and stability",
    response,
    (RESPONDING_SCENE, RESUME_CURVES, SCHEDULER, *FROM_MODEL),
)
