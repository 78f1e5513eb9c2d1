"""`fenicsrom campbell`: compute a Campbell diagram."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import FROM, RESULTS, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import source

TURNING_SCENE = scene_file(
    " with a [rotation] table; its [campbell] table gives the speeds", nargs="?"
)


def campbell(options: argparse.Namespace) -> int:
    """Compute a Campbell diagram."""
    comm, given, scene = source(options, unloaded=True)
    with opened(options, scene, comm) as folder:
        return finish(study.campbell(given, comm, folder=folder), comm)


COMMAND = Command(
    "campbell",
    "compute a Campbell diagram: frequencies and critical speeds",
    campbell,
    (TURNING_SCENE, FROM, *RESULTS),
)
