"""`fenicsrom map`: the interaction map of a body that rubs its casing."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import FROM_MODEL, SCHEDULER, Argument, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import ranks, source, workers
from fenicsrom.cli.termination import is_terminated

RUBBING_SCENE = scene_file(
    " with rotation.speeds_rpm; its [map] table gives speeds and revolutions", nargs="?"
)
RESUME_MAP = Argument(
    "--resume",
    action="store_true",
    help="keep the speeds that are done in the output folder, and compute only the others",
)


def map(options: argparse.Namespace) -> int:
    """Compute an interaction map."""
    comm, given, scene = source(options)
    comm = comm or ranks()
    with workers(options) as computing, opened(options, scene, comm) as folder:
        found = study.interaction_map(
            given,
            comm,
            folder=folder,
            resume=options.resume,
            workers=computing,
            stop=is_terminated,
            fresh=options.fresh,
        )
        return finish(found, comm, found.lines)


COMMAND = Command(
    "map",
    "map the motions of a body that rubs its casing over speed and engine order",
    map,
    (RUBBING_SCENE, RESUME_MAP, SCHEDULER, *FROM_MODEL),
)
