"""`fenicsrom compare`: compare reduced bases with the full model."""

from __future__ import annotations

import argparse

from fenicsrom import study
from fenicsrom.cli.arguments import RESULTS, Command, scene_file
from fenicsrom.cli.ending import finish
from fenicsrom.cli.output import opened
from fenicsrom.cli.starting import start

COMPARED_SCENE = scene_file("; its [compare] table lists the bases")


def compare(options: argparse.Namespace) -> int:
    """Compare bases with the full model."""
    comm, scene = start(options)
    with opened(options, scene, comm) as folder:
        return finish(study.compare(scene, comm, folder=folder), comm)


COMMAND = Command(
    "compare",
    "compare reduced bases with the full model: error and run time",
    compare,
    (COMPARED_SCENE, *RESULTS),
)
